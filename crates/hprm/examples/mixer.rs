//! A federate with a multiport and a bank, whose reactions name single channels and members: a desk that mixes voices.

use hprm::prelude::*;

/// The first voice is the leader's: it is forwarded as it is. The others are added up.
struct Mixer;

/// Its ports.
struct Ports {
    voices: Vec<InputPort<i64>>,
    mixed: Vec<OutputPort<i64>>,
}

impl Interface for Ports {
    fn each(&self, add: &mut dyn FnMut(&dyn Interface)) {
        self.voices.iter().for_each(|voice| add(voice));
        self.mixed.iter().for_each(|mixed| add(mixed));
    }
}

/// Makes a voice louder.
struct Amplifier {
    factor: i64,
}

impl Reactor for Amplifier {
    type Ports = (InputPort<i64>, OutputPort<i64>);

    fn assemble(&mut self, amplifier: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (voice, loud) = (amplifier.input("voice"), amplifier.output("loud"));
        amplifier.reaction().on(voice).sets(loud).run(move |amplifier, ctx| {
            if let Some(voice) = ctx.get(voice) {
                ctx.set(loud, voice * amplifier.factor);
            }
        });
        (voice, loud)
    }
}

impl Reactor for Mixer {
    type Ports = Ports;

    fn assemble(&mut self, mixer: &mut ReactorBuilder<'_, Self>) -> Ports {
        let voices = mixer.inputs("voices", 3);
        let mixed = mixer.outputs("mixed", 2);
        let amplifiers = mixer.bank("amplifiers", [10, 100].map(|factor| Amplifier { factor }));
        let (leader, led) = (voices[0], mixed[0]);
        mixer.reaction().on(leader).sets(led).run(move |_, ctx| {
            if let Some(voice) = ctx.get(leader) {
                ctx.set(led, *voice);
            }
        });
        for (voice, (inp, _)) in voices[1..].iter().zip(&amplifiers) {
            mixer.connect(*voice, *inp);
        }
        // Only when the second amplifier says something.
        let (first, second, sum) = (amplifiers[0].1, amplifiers[1].1, mixed[1]);
        mixer.reaction().on(second).reads(first).sets(sum).run(move |_, ctx| {
            let voices = [ctx.get(first), ctx.get(second)];
            ctx.set(sum, voices.into_iter().flatten().sum());
        });
        Ports { voices, mixed }
    }
}

fn main() -> Result<(), Failure> {
    run_as_federate("Mixer", Mixer)
}
