//! The lines of a logical trace.
//!
//! Names are full names from the main reactor down, tags count from the start, and nothing tells
//! which process wrote a line. A file is a header, then one entry for each reaction that ran, by tag,
//! level and place in the program, then the end.

use std::collections::BTreeMap;

use hprm_core::{Body, Program, Reaction, ReactionId, Scheduled, Tag, Transition};
use serde::{Deserialize, Serialize};

use super::Described;

/// The version of the format. Another one cannot be compared with this.
pub const VERSION: u32 = 2;

/// A tag: nanoseconds since the start, and the microstep.
pub type At = (i64, u32);

/// The tag as it is written.
#[must_use]
pub fn at(tag: Tag) -> At {
    (tag.time, tag.microstep)
}

/// One line.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Line {
    /// The first line.
    Header(Header),
    /// The last line.
    End(End),
    /// Any line between them.
    Entry(Entry),
}

/// What the trace is of.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Header {
    /// [`VERSION`].
    pub hprm_logical_trace: u32,
    /// The name of the program.
    pub program: String,
    /// Whether the program is federated, however it was run.
    pub federated: bool,
    /// What the program calls its reactions that have names, by the names that all have. For people: a program with
    /// other names may do the same.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub names: BTreeMap<String, String>,
}

impl Header {
    pub(super) fn of(program: &Program) -> Self {
        let named = |(id, reaction): (ReactionId, &Reaction)| {
            let is_named = reaction.label.is_some();
            is_named.then(|| (program.reaction_name(id), program.reaction_label(id)))
        };
        Self {
            hprm_logical_trace: VERSION,
            program: program.name.clone(),
            federated: program.is_federated(),
            names: program.reactions.iter().filter_map(named).collect(),
        }
    }

    /// What messages call a reaction.
    #[must_use]
    pub fn name_of<'a>(&'a self, reaction: &'a str) -> &'a str {
        self.names.get(reaction).map_or(reaction, String::as_str)
    }
}

/// What a reaction did.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Entry {
    /// When.
    pub tag: At,
    /// Its full name.
    pub reaction: String,
    /// Which of its bodies ran.
    #[serde(default, skip_serializing_if = "Which::is_main")]
    pub body: Which,
    /// What it found at its triggers and sources when its body began, in the order of the program.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reads: Vec<Read>,
    /// The ports that it set, in the order of the program.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sets: Vec<Set>,
    /// The actions that it scheduled, in the order of its calls.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub schedules: Vec<Schedule>,
    /// The modes that it asked for, in the order of its calls.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub enters: Vec<Enter>,
    /// Whether it asked the program to stop.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub stops: bool,
    /// Whether it asked its federate to leave the program.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub leaves: bool,
    /// The tag that an input was meant for, if one came too late.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tardy: Option<At>,
    /// Whether it may depend on the physical world.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub physical: bool,
}

/// A body of a reaction.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Which {
    /// The reaction itself.
    #[default]
    Main,
    /// Its deadline handler.
    Deadline,
    /// Its handler for inputs that come too late.
    Tardy,
}

/// An input or an action of a reaction, as it was when the body began.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Read {
    /// The full name of the port or action.
    pub from: String,
    /// The value; an action may have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<Described>,
    /// Whether the port is absent, and remembers the value.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub remembered: bool,
}

/// A port that was set.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Set {
    /// Its full name.
    pub port: String,
    /// The value that it was left with.
    pub value: Described,
}

/// An action that was scheduled.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Schedule {
    /// Its full name.
    pub action: String,
    /// What became of that.
    pub at: ScheduleOutcome,
    /// Whether the clock decides on its tag.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub physical: bool,
    /// The value for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<Described>,
}

/// What became of a call to schedule an action.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub enum ScheduleOutcome {
    /// It will be present.
    At(At),
    /// It will not, or it is not known when.
    Not(Reason),
}

/// Why an action has no tag.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    /// It was too close to the event before.
    Dropped,
    /// The program ends before.
    AfterStop,
    /// Its mode is not active.
    Suspended,
}

/// A mode that was asked for.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Enter {
    /// Its full name.
    pub mode: String,
    /// How.
    pub how: How,
}

/// How a mode is entered.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum How {
    /// As if for the first time.
    Reset,
    /// As it was left.
    History,
}

/// How the run ended.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct End {
    /// The last tag. It is complete if the run ended in order.
    pub end: At,
    /// Whether it did.
    pub outcome: RunEnding,
    /// Why not, for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
    /// Whether a reaction that may depend on the physical world asked for the end.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub physical: bool,
    /// How many reactions had an input that came too late.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub tardy: u64,
    /// Whether this is the share of a federate that left before the others. The merged trace has none.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub early: bool,
    /// The federates of which processes took part that have left nothing here, with how many of them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub missing: BTreeMap<String, u32>,
}

/// How a run ended, from good to bad.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RunEnding {
    /// At its last tag.
    Done,
    /// At its last tag, which the user chose.
    Interrupted,
    /// In the middle of a tag: a reaction chose to leave.
    Left,
    /// In the middle of a tag: something went wrong.
    Failed,
}

impl Which {
    fn is_main(&self) -> bool {
        *self == Self::Main
    }
}

impl From<Body> for Which {
    fn from(body: Body) -> Self {
        match body {
            Body::Main => Self::Main,
            Body::Deadline => Self::Deadline,
            Body::Tardy => Self::Tardy,
        }
    }
}

impl From<Scheduled> for ScheduleOutcome {
    fn from(scheduled: Scheduled) -> Self {
        match scheduled {
            Scheduled::At(tag) => Self::At(at(tag)),
            Scheduled::Dropped => Self::Not(Reason::Dropped),
            Scheduled::AfterStop => Self::Not(Reason::AfterStop),
            Scheduled::Suspended => Self::Not(Reason::Suspended),
        }
    }
}

impl From<Transition> for How {
    fn from(transition: Transition) -> Self {
        match transition {
            Transition::Reset => Self::Reset,
            Transition::History => Self::History,
        }
    }
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(text: &str) -> Entry {
        match serde_json::from_str(text) {
            Ok(Line::Entry(entry)) => entry,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_line_is_read_as_it_is_written() {
        let digest = "99aa06d3014798d86001c324468d497f";
        let full = format!(
            r#"{{"tag":[5,1],"reaction":"M.a.1","body":"tardy","reads":[{{"from":"M.a.inp","value":{{"digest":"{digest}","text":"2"}},"remembered":true}},{{"from":"M.a.b"}}],"sets":[{{"port":"M.a.out","value":{{"digest":"{digest}","text":"1"}}}}],"schedules":[{{"action":"M.a.b","at":[7,0]}},{{"action":"M.a.b","at":"after-stop","physical":true,"value":{{"digest":"{digest}","text":"f","opaque":true}}}}],"enters":[{{"mode":"M.a.m","how":"reset"}}],"stops":true,"tardy":[4,0],"physical":true}}"#
        );
        for text in [
            r#"{"hprm_logical_trace":2,"program":"M","federated":false}"#,
            r#"{"tag":[0,0],"reaction":"M.1"}"#,
            &full,
            r#"{"end":[10,0],"outcome":"done"}"#,
            r#"{"end":[10,0],"outcome":"failed","message":"no","physical":true,"tardy":3}"#,
            r#"{"end":[10,0],"outcome":"done","physical":true,"missing":{"a":2}}"#,
        ] {
            let line: Line = serde_json::from_str(text).unwrap();
            assert_eq!(serde_json::to_string(&line).unwrap(), text);
        }
        assert_eq!(entry(&full).schedules[1].at, ScheduleOutcome::Not(Reason::AfterStop));
    }

    #[test]
    fn other_lines_are_no_lines() {
        for text in [r#"{"tag":[0,0]}"#, r#"{"tag":0,"reaction":"M.1"}"#, "[]", r#"{"end":[1,0]}"#]
        {
            assert!(serde_json::from_str::<Line>(text).is_err(), "{text}");
        }
    }
}
