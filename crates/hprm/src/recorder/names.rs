//! What the numbers in records mean, so that a share is read without the program.

use hprm_core::{FederateId, Program};
use serde::{Deserialize, Serialize};

/// Whose records they are.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum Member {
    /// The whole program, in one process.
    Whole,
    /// The RTI.
    Rti,
    /// A federate.
    Federate(u16),
}

impl Member {
    /// A federate.
    #[must_use]
    pub fn federate(federate: FederateId) -> Self {
        Self::Federate(federate.0)
    }
}

/// A channel from one federate to another.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct ChannelName {
    /// The port that sends.
    pub from: String,
    /// The port that receives.
    pub to: String,
    /// Whether the receiver gives its messages their tags.
    pub physical: bool,
}

/// The names of a program, and whose records follow.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Names {
    /// The program.
    pub program: String,
    /// Whose records they are.
    pub member: Member,
    /// Its process.
    pub process: u32,
    /// All federates.
    pub federates: Vec<String>,
    /// All reactions.
    pub reactions: Vec<String>,
    /// All channels.
    pub channels: Vec<ChannelName>,
    /// All actions.
    pub actions: Vec<String>,
}

impl Names {
    /// The names of a program, for the share of a member in this process.
    #[must_use]
    pub fn of(program: &Program, member: Member) -> Self {
        Self {
            program: program.name.clone(),
            member,
            process: std::process::id(),
            federates: program.federates.values().map(|it| it.name.clone()).collect(),
            reactions: program.reactions.ids().map(|id| program.reaction_name(id)).collect(),
            channels: program
                .channels
                .values()
                .map(|channel| {
                    let connection = &program.connections[channel.connection];
                    ChannelName {
                        from: program.port_name(connection.from),
                        to: program.port_name(connection.to),
                        physical: channel.physical,
                    }
                })
                .collect(),
            actions: program
                .actions
                .values()
                .map(|it| format!("{}.{}", program.reactors[it.reactor].name, it.name))
                .collect(),
        }
    }

    /// What people call the member.
    #[must_use]
    pub fn title(&self) -> String {
        match self.member {
            Member::Whole => self.program.clone(),
            Member::Rti => "RTI".to_owned(),
            Member::Federate(number) => {
                self.federates.get(usize::from(number)).cloned().unwrap_or_default()
            }
        }
    }
}
