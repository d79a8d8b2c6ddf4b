//! What agents say of their machines.
//!
//! `hprm machines` shows it. It is for people: nothing of it decides what a federation does. Another machine may say anything,
//! so texts are [printable](crate::printable).

use serde::{Deserialize, Serialize};

/// A machine whose agent is there.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Machine {
    /// As its agent is named.
    pub name: String,
    /// Whether it is the machine whose agent was asked.
    pub is_here: bool,
    /// What its agent says; none if it has not answered in time.
    pub about: Option<About>,
    /// What its clock shows beside that of the machine whose agent was asked; none for that machine itself.
    pub clock: Option<ClockReading>,
    /// The machine whose agent leads what the two agents say to one another; none if they reach one another.
    #[serde(default)]
    pub through: Option<String>,
}

/// What an agent says of its machine.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct About {
    /// The version of HPRM.
    #[serde(deserialize_with = "crate::shown::text")]
    pub version: String,
    /// Where the agent listens for other agents, `HOST:PORT` each.
    #[serde(deserialize_with = "crate::shown::all")]
    pub addresses: Vec<String>,
    /// How many processors the agent may use.
    pub processors: u64,
    /// The memory of the machine, in bytes.
    pub memory: u64,
    /// The names of the federations of the agent's user that have processes there.
    #[serde(deserialize_with = "crate::shown::all")]
    pub federations: Vec<String>,
    /// Until when the certificate of the machine is valid, in seconds since 1970; none if it has none.
    #[serde(default)]
    pub certificate_ends: Option<i64>,
    /// For what the limits of the programs count that the agent starts; none if it starts none.
    #[serde(default)]
    pub limits: Option<Limited>,
}

/// For what a limit of memory or of processes counts.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Limited {
    /// All processes of a program together, by cgroups.
    Program,
    /// Each process, and all processes of the user.
    Process,
}

/// What the clock of a machine shows beside another one, found from round trips.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct ClockReading {
    /// By how many nanoseconds it is ahead.
    pub offset: i64,
    /// How far the true offset can be from that, in nanoseconds: half of the time that the messages took.
    pub bound: i64,
}

impl ClockReading {
    /// What follows from a question that was sent and answered, and from what the other clock showed in between. All
    /// times are in nanoseconds.
    #[must_use]
    pub fn of(sent: i64, shown: i64, answered: i64) -> Self {
        let half = answered.saturating_sub(sent).max(0).saturating_add(1) / 2;
        Self { offset: shown.saturating_sub(sent).saturating_sub(half), bound: half }
    }
}

#[cfg(test)]
mod tests {
    use super::ClockReading;

    #[test]
    fn the_true_offset_is_within_the_bound_whichever_way_was_slower() {
        for (there, back) in [(0, 0), (3, 5), (0, 1001), (777, 0)] {
            for ahead in [-5_000, 0, 123] {
                let sent = 1_000_000;
                let reading = ClockReading::of(sent, sent + there + ahead, sent + there + back);
                assert!((reading.offset - ahead).abs() <= reading.bound, "{reading:?}");
            }
        }
    }
}
