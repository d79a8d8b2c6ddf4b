//! Of which loop a board is, and what the numbers of its program mean.
//!
//! A program that an agent has started for another machine may have any names, so they are [printable](crate::printable) where they are read.

use std::collections::BTreeMap;

use hprm_core::{Coordination, FederateId, Program, ReactionId};
use hprm_federated::FederationId;
use serde::{Deserialize, Serialize};

use crate::clock::Clock;

/// Which form the contents of a board have, apart from its identity. A reader understands boards of its own format.
pub const FORMAT: u32 = 2;

/// What a loop is in its federation.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// The RTI.
    Rti,
    /// A federate, by its name.
    Federate(#[serde(deserialize_with = "crate::shown::text")] String),
}

impl Role {
    /// What people call it.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Rti => "RTI",
            Self::Federate(name) => name,
        }
    }
}

/// Of which loop a board is.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Identity {
    /// See [`FORMAT`].
    pub format: u32,
    /// The name of the federation: that of its program.
    #[serde(deserialize_with = "crate::shown::text")]
    pub federation: String,
    /// The same for all loops of one federation, and another one for each run. It does not tell the secret.
    pub id: String,
    /// What the loop is.
    pub role: Role,
    /// Its process, by the number that it has for itself; in a container that is another number than outside.
    pub pid: u32,
    /// The machine.
    #[serde(deserialize_with = "crate::shown::text")]
    pub host: String,
    /// When it began, in nanoseconds since the Unix epoch.
    pub since: i64,
    /// Whether the federation has centralized coordination.
    pub centralized: bool,
}

impl Identity {
    /// The identity of a loop of this process. `id` is the name of the federation in frames.
    pub(crate) fn new(program: &Program, id: FederationId, role: Role) -> Self {
        let system = rustix::system::uname();
        Self {
            format: FORMAT,
            federation: program.name.clone(),
            id: id.to_string(),
            role,
            pid: std::process::id(),
            host: system.nodename().to_string_lossy().into_owned(),
            since: Clock::local().0,
            centralized: program.properties.coordination == Coordination::Centralized,
        }
    }
}

/// A reaction, for people.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct ReactionName {
    /// What messages call it.
    #[serde(deserialize_with = "crate::shown::text")]
    pub label: String,
    /// Where it is in the source, as `FILE:LINE`, if that is known.
    #[serde(deserialize_with = "crate::shown::maybe")]
    pub place: Option<String>,
}

/// A channel from one federate to another.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct ChannelName {
    /// The number of the federate that sends.
    pub from: u16,
    /// The number of the federate that receives.
    pub to: u16,
    /// The port that sends.
    #[serde(deserialize_with = "crate::shown::text")]
    pub from_port: String,
    /// The port that receives.
    #[serde(deserialize_with = "crate::shown::text")]
    pub to_port: String,
    /// Whether the receiver gives its messages their tags.
    pub physical: bool,
}

/// What the numbers on a board mean.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct Names {
    /// All federates, by number.
    #[serde(deserialize_with = "crate::shown::all")]
    pub federates: Vec<String>,
    /// The reactions of the federate; none on the board of the RTI.
    pub reactions: BTreeMap<u32, ReactionName>,
    /// The channels that lead from the federate or to it; none on the board of the RTI.
    pub channels: BTreeMap<u32, ChannelName>,
}

impl Names {
    /// The names that the RTI needs.
    pub(crate) fn of_rti(program: &Program) -> Self {
        let federates = program.federates.values().map(|federate| federate.name.clone());
        Self { federates: federates.collect(), ..Self::default() }
    }

    /// The names that a federate needs; `place` says where its reactions are.
    pub(crate) fn of_federate(
        program: &Program,
        me: FederateId,
        place: impl Fn(ReactionId) -> Option<String>,
    ) -> Self {
        let own = program
            .reactions
            .iter()
            .filter(|(_, it)| program.reactors[it.reactor].federate == Some(me));
        let reactions = own.map(|(id, _)| {
            (id.0, ReactionName { label: program.reaction_label(id), place: place(id) })
        });
        let near =
            program.channels.iter().filter(|(_, channel)| channel.from == me || channel.to == me);
        let channels = near.map(|(id, channel)| {
            let connection = &program.connections[channel.connection];
            let name = ChannelName {
                from: channel.from.0,
                to: channel.to.0,
                from_port: program.port_name(connection.from),
                to_port: program.port_name(connection.to),
                physical: channel.physical,
            };
            (id.0, name)
        });
        Self {
            reactions: reactions.collect(),
            channels: channels.collect(),
            ..Self::of_rti(program)
        }
    }
}
