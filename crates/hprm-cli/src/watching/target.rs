//! Which channels a user means by `FED.PORT`.

use std::collections::BTreeMap;

use hprm_core::{ChannelId, Direction, FederateId, PortId, Program};
use hprm_model::existing;

use super::short;
use crate::message::Error;

/// The channels of a port.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Target {
    /// By the federates that send on them.
    pub(super) channels: BTreeMap<FederateId, Vec<ChannelId>>,
    /// Whether the port is an output, so that the sender's tag is the one to show.
    pub(super) is_output: bool,
    /// Whether there are several ports.
    pub(super) is_several: bool,
}

impl Target {
    /// All channels of the federation.
    ///
    /// # Errors
    ///
    /// If there are none.
    pub(super) fn all(program: &Program) -> Result<Self, Error> {
        let (channels, is_several) = (by_sender(program, |_| true), program.channels.len() > 1);
        match channels.is_empty() {
            true => {
                Err(Error::new(format!("{} has no connections between federates", program.name)))
            }
            false => Ok(Self { channels, is_output: true, is_several }),
        }
    }

    /// What `FED.PORT` means.
    ///
    /// # Errors
    ///
    /// If there is no such port, or no connection to another federate at it.
    pub(super) fn of(program: &Program, text: &str) -> Result<Self, Error> {
        let federates: Vec<_> = program.federates.iter().map(|(id, _)| id).collect();
        let (federate, port) = text.split_once('.').ok_or_else(|| {
            Error::option(format!("{text} is no port of a federate"))
                .hint("name a federate and its port, as in camera.image")
        })?;
        let meant: Vec<_> =
            federates.iter().copied().filter(|id| is_called(program, *id, federate)).collect();
        if meant.is_empty() {
            let said = format!("{} has no federate {federate}", program.name);
            let names = federates.iter().map(|id| shown(program, *id));
            return Err(Error::option(said).hint(list("its federates", federate, names.collect())));
        }
        let ports = ports_of(program, &meant);
        let named: Vec<_> =
            ports.iter().copied().filter(|id| is(port, &program.ports[*id].name)).collect();
        let Some(first) = named.first() else {
            let said = format!("{federate} has no port {port}");
            let names = ports.iter().map(|id| program.ports[*id].name.clone());
            return Err(Error::option(said).hint(list("its ports", port, names.collect())));
        };
        let is_output = program.ports[*first].direction == Direction::Output;
        let channels = by_sender(program, |channel| {
            let connection = &program.connections[program.channels[channel].connection];
            named.contains(if is_output { &connection.from } else { &connection.to })
        });
        if channels.is_empty() {
            return Err(unconnected(text, is_output));
        }
        Ok(Self { channels, is_output, is_several: named.len() > 1 })
    }
}

fn unconnected(port: &str, is_output: bool) -> Error {
    let error = Error::option(format!("there is no connection to another federate at {port}"));
    error.hint(match is_output {
        true => "no reaction of another federate reads it, so nothing is sent",
        false => "no other federate sends to it, or no reaction reads it",
    })
}

/// The channels that are meant, by their senders.
fn by_sender(
    program: &Program,
    is_meant: impl Fn(ChannelId) -> bool,
) -> BTreeMap<FederateId, Vec<ChannelId>> {
    let mut channels: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for (id, channel) in program.channels.iter().filter(|(id, _)| is_meant(*id)) {
        channels.entry(channel.from).or_default().push(id);
    }
    channels
}

/// A federate as Lingua Franca names it: `camera[1]`.
fn shown(program: &Program, federate: FederateId) -> String {
    short(&program.reactors[program.federates[federate].reactor].name).to_owned()
}

/// Whether a federate is called that: `camera[1]`, `camera__1`, or `camera` as the others of its bank.
fn is_called(program: &Program, federate: FederateId, name: &str) -> bool {
    is(name, &shown(program, federate)) || program.federates[federate].name == name
}

/// Whether a name means one that may have an index: `image` means `image[0]` too.
fn is(name: &str, full: &str) -> bool {
    name == full || full.strip_prefix(name).is_some_and(|index| index.starts_with('['))
}

/// The ports of some federates, not of reactors in them.
fn ports_of(program: &Program, federates: &[FederateId]) -> Vec<PortId> {
    let reactors: Vec<_> = federates.iter().map(|id| program.federates[*id].reactor).collect();
    let ports = program.ports.iter().filter(|(_, port)| reactors.contains(&port.reactor));
    ports.map(|(id, _)| id).collect()
}

/// What there is, or what was probably meant.
fn list(title: &str, name: &str, mut names: Vec<String>) -> String {
    names.sort_unstable();
    names.dedup();
    existing(name, title, names.iter().map(String::as_str))
}

#[cfg(test)]
mod tests {
    use hprm_core::{Delay, Effect, Nanos, ProgramBuilder, Properties, ReactionSpec, Trigger};

    use super::*;

    /// `camera[0..2].image[0..2] -> planner.images[..]`, and `planner.log`, which no federate reads.
    fn program() -> Program {
        let mut b = ProgramBuilder::new("Main", Properties::default());
        let planner = b.reactor(b.main(), "planner");
        b.federate(planner, "planner", Nanos::MAX, None);
        let log = b.port(planner, "log", Direction::Output);
        for bank in 0..2 {
            let camera = b.reactor(b.main(), &format!("camera[{bank}]"));
            b.federate(camera, &format!("camera__{bank}"), Nanos::MAX, None);
            for channel in 0..2 {
                let out = b.port(camera, &format!("image[{channel}]"), Direction::Output);
                let at = 2 * bank + channel;
                let input = b.port(planner, &format!("images[{at}]"), Direction::Input);
                b.connect(out, input, Delay::None);
                let effects = vec![Effect::Port(out)];
                let triggers = vec![Trigger::Startup];
                b.reaction(camera, ReactionSpec { triggers, effects, ..ReactionSpec::default() });
                let (triggers, effects) = (vec![Trigger::Port(input)], vec![Effect::Port(log)]);
                b.reaction(planner, ReactionSpec { triggers, effects, ..ReactionSpec::default() });
            }
        }
        b.build().unwrap()
    }

    fn ends_of(text: &str) -> Vec<String> {
        let program = program();
        let target = Target::of(&program, text).unwrap();
        let channels = target.channels.values().flatten();
        channels.map(|id| super::super::ends(&program, *id).join(" -> ")).collect()
    }

    #[test]
    fn an_index_means_one_and_no_index_all() {
        assert_eq!(ends_of("camera[1].image[0]"), ["camera[1].image[0] -> planner.images[2]"]);
        assert_eq!(ends_of("camera__1.image[0]"), ends_of("camera[1].image[0]"));
        assert_eq!(ends_of("planner.images[2]"), ends_of("camera[1].image[0]"));
        assert_eq!(ends_of("camera[0].image").len(), 2);
        assert_eq!(ends_of("camera.image").len(), 4);
        assert_eq!(ends_of("planner.images").len(), 4);
    }

    #[test]
    fn what_is_wrong_is_told_with_what_there_is() {
        let program = program();
        for (text, said) in [
            ("camera", "camera is no port of a federate"),
            ("camrea.image", "Main has no federate camrea"),
            ("camera[2].image", "Main has no federate camera[2]"),
            ("camera.imgae", "camera has no port imgae"),
            ("camera.imag", "camera has no port imag"),
            ("planner.log", "there is no connection to another federate at planner.log"),
        ] {
            let error = Target::of(&program, text).unwrap_err();
            assert!(format!("{error:?}").contains(said), "{text}: {error:?}");
        }
    }
}
