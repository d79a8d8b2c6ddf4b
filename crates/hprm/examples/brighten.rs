//! A filter of images that is a federate of a program in Lingua Franca or Python, which names this executable: between
//! federates of any language.

use hprm::prelude::*;

/// Multiplies images by a factor, which can be changed.
struct Brighten {
    gain: f64,
}

/// Its ports.
#[derive(Clone, Copy)]
struct Ports {
    image: InputPort<Array<f64>>,
    gain: InputPort<f64>,
    bright: OutputPort<Array<f64>>,
    mean: OutputPort<f64>,
}

impl Interface for Ports {
    fn each(&self, add: &mut dyn FnMut(&dyn Interface)) {
        add(&self.image);
        add(&self.gain);
        add(&self.bright);
        add(&self.mean);
    }
}

impl Reactor for Brighten {
    type Ports = Ports;

    fn assemble(&mut self, filter: &mut ReactorBuilder<'_, Self>) -> Ports {
        let (image, gain) = (filter.input("image"), filter.input("gain"));
        let (bright, mean) = (filter.output("bright"), filter.output("mean"));
        let ports = Ports { image, gain, bright, mean };
        filter.reaction().on(gain).run(move |filter, ctx| {
            filter.gain = ctx.get(gain).copied().unwrap_or(filter.gain);
        });
        filter.reaction().on(image).sets([bright]).sets([mean]).run(move |filter, ctx| {
            let Some(image) = ctx.get(image) else { return };
            // Written where its receivers read it.
            let mut result = ctx.loan(image.shape());
            for (to, from) in result.iter_mut().zip(image.iter()) {
                *to = from * filter.gain;
            }
            let sum: f64 = result.iter().sum();
            let count = result.len();
            ctx.set(bright, result.into());
            ctx.set(mean, sum / count as f64);
        });
        ports
    }
}

fn main() -> Result<(), Failure> {
    run_as_federate("Brighten", Brighten { gain: 2.0 })
}
