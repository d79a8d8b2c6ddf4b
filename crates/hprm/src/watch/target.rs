//! Which channels users mean by `FED.PORT`.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{ChannelId, Direction, FederateId, PortId, Program};
use hprm_model::existing;

use super::Wish;
use crate::{Kind, Report};

/// What users want to watch.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Target {
    pub(super) shares: Vec<Share>,
    /// Whether there are several ports.
    pub(super) is_several: bool,
}

/// What is watched over one connection to a federate.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Share {
    /// The federate that sends.
    pub(super) federate: FederateId,
    pub(super) channels: Vec<ChannelId>,
    /// Whether it is watched at its outputs.
    pub(super) is_output: bool,
}

/// Channels, by the federates that send on them.
type BySender = BTreeMap<FederateId, Vec<ChannelId>>;

/// What one `FED.PORT` means.
struct Named {
    ports: Vec<PortId>,
    channels: Vec<ChannelId>,
    is_output: bool,
}

impl Target {
    /// What some `FED.PORT` mean, or all connections of the federation, if there are none.
    ///
    /// # Errors
    ///
    /// If there is no such port, or no connection to another federate at it.
    pub(super) fn of(program: &Program, ports: &[String], wish: Wish) -> Result<Self, Box<Report>> {
        if ports.is_empty() {
            return Self::all(program);
        }
        let (mut outputs, mut inputs) = (BTreeSet::new(), BTreeSet::new());
        let mut shown = BTreeSet::new();
        for text in ports {
            let named = Named::of(program, text)?;
            shown.extend(named.ports);
            let channels = if named.is_output { &mut outputs } else { &mut inputs };
            channels.extend(named.channels);
        }
        let rounds = match wish {
            Wish::Values => apart(program, inputs),
            Wish::Counts => {
                outputs.append(&mut inputs);
                Vec::new()
            }
        };
        let outputs = shares(program, outputs, true);
        let inputs = rounds.into_iter().flat_map(|it| shares(program, it, false));
        Ok(Self { shares: outputs.chain(inputs).collect(), is_several: shown.len() > 1 })
    }

    fn all(program: &Program) -> Result<Self, Box<Report>> {
        let channels: Vec<_> = program.channels.iter().map(|(id, _)| id).collect();
        if channels.is_empty() {
            let said = format!("{} has no connections between federates", program.name);
            return Err(Box::new(Report::new(Kind::Command, said)));
        }
        let is_several = channels.len() > 1;
        Ok(Self { shares: shares(program, channels, true).collect(), is_several })
    }
}

/// Groups of channels such that no two channels of a group come from one port: over one connection, a value that goes
/// to several receivers is shown once.
fn apart(program: &Program, channels: BTreeSet<ChannelId>) -> Vec<Vec<ChannelId>> {
    let mut counts: BTreeMap<PortId, usize> = BTreeMap::new();
    let mut groups: Vec<Vec<ChannelId>> = Vec::new();
    for channel in channels {
        let port = program.connections[program.channels[channel].connection].from;
        let count = counts.entry(port).or_default();
        if groups.len() == *count {
            groups.push(Vec::new());
        }
        groups[*count].push(channel);
        *count += 1;
    }
    groups
}

/// A share for each federate that sends on one of these channels.
fn shares(
    program: &Program,
    channels: impl IntoIterator<Item = ChannelId>,
    is_output: bool,
) -> impl Iterator<Item = Share> {
    let mut by_sender = BySender::new();
    for channel in channels {
        by_sender.entry(program.channels[channel].from).or_default().push(channel);
    }
    by_sender.into_iter().map(move |(federate, channels)| Share { federate, channels, is_output })
}

impl Named {
    fn of(program: &Program, text: &str) -> Result<Self, Box<Report>> {
        let federates: Vec<_> = program.federates.iter().map(|(id, _)| id).collect();
        let Some((federate, port)) = text.split_once('.') else {
            return Err(Box::new(without_port(program, text)));
        };
        let meant: Vec<_> = program.federates_meant(federate).collect();
        if meant.is_empty() {
            let said = format!("{} has no federate {federate}", program.name);
            let names = federates.iter().map(|id| shown(program, *id));
            return Err(Box::new(wrong(said).hint(list(
                "its federates",
                federate,
                names.collect(),
            ))));
        }
        let ports = ports_of(program, &meant);
        let named: Vec<_> =
            ports.iter().copied().filter(|id| is(port, &program.ports[*id].name)).collect();
        let Some(first) = named.first() else {
            let said = format!("{federate} has no port {port}");
            let names = ports.iter().map(|id| program.ports[*id].name.clone());
            return Err(Box::new(wrong(said).hint(list("its ports", port, names.collect()))));
        };
        let is_output = program.ports[*first].direction == Direction::Output;
        let channels = program.channels.iter().filter(|(_, channel)| {
            let connection = &program.connections[channel.connection];
            named.contains(if is_output { &connection.from } else { &connection.to })
        });
        let channels: Vec<_> = channels.map(|(id, _)| id).collect();
        if channels.is_empty() {
            return Err(Box::new(unconnected(text, is_output)));
        }
        Ok(Self { ports: named, channels, is_output })
    }
}

fn wrong(said: impl Into<String>) -> Report {
    Report::new(Kind::Option, said)
}

/// That a text names no port, and which ports it may mean if it names a federate.
fn without_port(program: &Program, text: &str) -> Report {
    let meant: Vec<_> = program.federates_meant(text).collect();
    let ports = ports_of(program, &meant);
    if ports.is_empty() {
        return wrong(format!("{text} is no port of a federate"))
            .hint("name a federate and its port, as in camera.image");
    }
    let names = ports.iter().map(|id| format!("{text}.{}", program.ports[*id].name));
    wrong(format!("{text} is a federate, and not one of its ports")).hint(list(
        "its ports",
        "",
        names.collect(),
    ))
}

fn unconnected(port: &str, is_output: bool) -> Report {
    let error = wrong(format!("there is no connection to another federate at {port}"));
    error.hint(match is_output {
        true => "no reaction of another federate reads it, so nothing is sent",
        false => "no other federate sends to it, or no reaction reads it",
    })
}

/// The name of a port, without that of the main reactor.
fn short(name: &str) -> &str {
    name.split_once('.').map_or(name, |(_, rest)| rest)
}

/// Both ends of a channel: `camera.image` and `planner.image`.
#[must_use]
pub fn ends(program: &Program, channel: ChannelId) -> [String; 2] {
    let connection = &program.connections[program.channels[channel].connection];
    [connection.from, connection.to].map(|port| short(&program.port_name(port)).to_owned())
}

/// A federate as Lingua Franca names it: `camera[1]`.
fn shown(program: &Program, federate: FederateId) -> String {
    short(&program.reactors[program.federates[federate].reactor].name).to_owned()
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

    fn target(ports: &[&str], wish: Wish) -> Target {
        let ports: Vec<_> = ports.iter().map(|it| (*it).to_owned()).collect();
        Target::of(&program(), &ports, wish).unwrap()
    }

    fn ends_of(text: &str) -> Vec<String> {
        let (program, target) = (program(), target(&[text], Wish::Values));
        let channels = target.shares.iter().flat_map(|it| &it.channels);
        channels.map(|id| ends(&program, *id).join(" -> ")).collect()
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
    fn several_ports_share_connections_to_their_senders() {
        let two =
            target(&["camera[0].image", "camera[1].image[0]", "camera[0].image[1]"], Wish::Values);
        let channels: Vec<_> = two.shares.iter().map(|it| it.channels.len()).collect();
        assert_eq!((channels, two.is_several), (vec![2, 1], true));
        let all = target(&[], Wish::Values);
        assert_eq!(all.shares, target(&["camera.image"], Wish::Values).shares);
        let both = target(&["camera[0].image[0]", "planner.images[0]"], Wish::Values);
        let ends: Vec<_> = both.shares.iter().map(|it| it.is_output).collect();
        assert_eq!(ends, [true, false]);
        // What is only counted is counted once.
        assert_eq!(
            target(&["camera[0].image[0]", "planner.images[0]"], Wish::Counts).shares.len(),
            1
        );
    }

    #[test]
    fn inputs_of_one_output_are_watched_apart() {
        let mut b = ProgramBuilder::new("Main", Properties::default());
        let reactors = ["camera", "planner[0]", "planner[1]"].map(|name| {
            let reactor = b.reactor(b.main(), name);
            let name = name.replace('[', "__").replace(']', "");
            b.federate(reactor, &name, Nanos::MAX, None);
            reactor
        });
        let out = b.port(reactors[0], "image", Direction::Output);
        let (triggers, effects) = (vec![Trigger::Startup], vec![Effect::Port(out)]);
        b.reaction(reactors[0], ReactionSpec { triggers, effects, ..ReactionSpec::default() });
        for reactor in &reactors[1..] {
            let input = b.port(*reactor, "image", Direction::Input);
            b.connect(out, input, Delay::None);
            let triggers = vec![Trigger::Port(input)];
            b.reaction(*reactor, ReactionSpec { triggers, ..ReactionSpec::default() });
        }
        let program = b.build().unwrap();
        let of = |port: &str| Target::of(&program, &[port.to_owned()], Wish::Values).unwrap();
        assert_eq!(of("planner.image").shares.len(), 2);
        assert_eq!(of("camera.image").shares.len(), 1);
    }

    #[test]
    fn what_is_wrong_is_told_with_what_there_is() {
        let program = program();
        for (text, said) in [
            ("image", "image is no port of a federate"),
            ("camrea.image", "Main has no federate camrea"),
            ("camera[2].image", "Main has no federate camera[2]"),
            ("camera[1]", "camera[1] is a federate, and not one of its ports"),
            ("camera.imgae", "camera has no port imgae"),
            ("camera.imag", "camera has no port imag"),
            ("planner.log", "there is no connection to another federate at planner.log"),
        ] {
            let error = Target::of(&program, &[text.to_owned()], Wish::Values).unwrap_err();
            assert!(error.message.contains(said), "{text}: {error:?}");
        }
    }
}
