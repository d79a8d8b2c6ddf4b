//! What a process and the agent of its machine say to one another before a link begins: one line each.
//!
//! A process connects to the Unix socket of the agent, writes a [`Request`], and reads an [`Answer`]. After
//! [`Request::Connect`] the connection is the link: the bytes of both ends follow. After [`Request::Listen`] it is a
//! registration: for each link that another machine opens, the agent sends a byte with the descriptor of a connection.
//! After [`Request::Machines`] the agent sends a list of [`Machine`] as JSON, and ends the connection.
//! [`Request::Route`] asks which machine is next on the way to another one: that one, or one in the middle.
//! The agent links Zenoh; this crate only knows these lines.

mod machines;
mod rest;

use std::fmt;
use std::io;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

pub use self::machines::{About, ClockReading, Limited, Machine};
pub use self::rest::{Rest, has_come};
use crate::link::{ask_for_machines, connect_through_agent};
use crate::{Address, printable};

/// Names an address at which the agent of this machine listens, if it is not the usual one.
pub const AGENT: &str = "HPRM_AGENT";

/// The listener of every machine at which its agent starts programs, if it may: each link to it has a starter of its
/// own. No process can listen there.
pub const STARTERS: &str = "starters";

/// The most bytes of a line.
pub const LINE_LIMIT: usize = 512;

/// The most bytes of the name of a machine or of a listener.
const NAME_LIMIT: usize = 64;

/// The name that a listener's own machine has for its process.
const HERE: &str = ".";

/// Where the agent of this machine listens: what the environment says, or an abstract Unix socket of this user.
///
/// # Errors
///
/// If the environment names no Unix socket.
pub fn agent_address() -> Result<Address, String> {
    let Some(text) = std::env::var_os(AGENT) else {
        let user = rustix::process::geteuid().as_raw();
        return Ok(Address::Abstract(format!("hprm-agent-{user}")));
    };
    let address = text.to_str().and_then(|text| text.parse::<Address>().ok());
    let wrong =
        || format!("{AGENT} is {}: write unix:@NAME or unix:/PATH", PathBuf::from(text).display());
    address.filter(Address::is_unix).ok_or_else(wrong)
}

/// The machines of which the agent of this one knows: this one first, the others by their names.
///
/// # Errors
///
/// If no agent runs here, or it does not answer within some seconds.
pub fn machines() -> io::Result<Vec<Machine>> {
    ask_for_machines()
}

/// Connects to a listener on another machine. The connection does not block.
///
/// # Errors
///
/// If no agent runs here, or the listener is not there, or is not reached in time.
pub fn connect(place: &Place, within: Duration) -> io::Result<UnixStream> {
    connect_through_agent(place, within)
}

/// A name of a listener, and the machine on which it is: `MACHINE/NAME`.
#[derive(Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct Place {
    /// The machine, as its agent is named.
    pub machine: String,
    /// The listener on that machine.
    pub name: String,
}

impl Place {
    /// A listener on this machine, whatever its name is.
    #[must_use]
    pub fn here(name: &str) -> Self {
        Self { machine: HERE.to_owned(), name: name.to_owned() }
    }

    /// Whether it is on the machine of that name, on which this process is.
    #[must_use]
    pub fn is_on(&self, machine: &str) -> bool {
        self.machine == HERE || self.machine == machine
    }
}

/// Whether a text may name a machine or a listener: letters, digits, and `-`, `_` and `.` between them. It is part of
/// a key of Zenoh, where other characters mean something.
#[must_use]
pub fn is_name(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    let begins = text.starts_with(|c: char| c.is_ascii_alphanumeric());
    begins && text.len() <= NAME_LIMIT && text.chars().all(plain)
}

impl FromStr for Place {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let (machine, name) = text.split_once('/').ok_or(())?;
        let valid = (is_name(machine) || machine == HERE) && is_name(name);
        valid.then(|| Self { machine: machine.to_owned(), name: name.to_owned() }).ok_or(())
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.machine, self.name)
    }
}

/// What a process wants of the agent.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Request {
    /// A link to a listener.
    Connect(Place),
    /// To be that listener, until the connection ends.
    Listen(Place),
    /// What is known of all machines.
    Machines,
    /// The machine next on the way to another one.
    Route(String),
}

/// What the agent answers.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Answer {
    /// It is done. The text is the name of the machine: that of the agent, or the one that was asked for.
    Done(String),
    /// There is no such machine or listener, perhaps not yet.
    Absent(String),
    /// It cannot be done, now or later.
    Refused(String),
}

/// The version of these lines.
const VERSION: &str = "hprm-agent-1";

impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Connect(place) => writeln!(f, "{VERSION} connect {place}"),
            Self::Listen(place) => writeln!(f, "{VERSION} listen {place}"),
            Self::Machines => writeln!(f, "{VERSION} machines"),
            Self::Route(machine) => writeln!(f, "{VERSION} route {machine}"),
        }
    }
}

impl Request {
    /// Reads a line without its end.
    ///
    /// # Errors
    ///
    /// What is wrong with it.
    pub fn read(line: &str) -> Result<Self, String> {
        let wrong = || "the request is none that this version of the agent knows".to_owned();
        let rest = line.strip_prefix(VERSION).ok_or_else(wrong)?.trim_start();
        let (word, place) = rest.split_once(' ').unwrap_or((rest, ""));
        let machine = is_name(place).then_some(place);
        let place = || place.parse().map_err(|()| wrong());
        match word {
            "connect" => Ok(Self::Connect(place()?)),
            "listen" => Ok(Self::Listen(place()?)),
            "machines" => Ok(Self::Machines),
            "route" => machine.map(|it| Self::Route(it.to_owned())).ok_or_else(wrong),
            _ => Err(wrong()),
        }
    }
}

impl fmt::Display for Answer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (word, text) = match self {
            Self::Done(text) => ("done", text),
            Self::Absent(text) => ("absent", text),
            Self::Refused(text) => ("refused", text),
        };
        let room = LINE_LIMIT - word.len() - 2;
        let line: String = text.replace(['\n', '\r'], " ");
        let end = (0..=line.len().min(room)).rev().find(|end| line.is_char_boundary(*end));
        writeln!(f, "{word} {}", &line[..end.unwrap_or_default()])
    }
}

impl Answer {
    /// Reads a line without its end. Another machine may have written it, so the text is [printable].
    #[must_use]
    pub fn read(line: &str) -> Self {
        let (word, text) = line.split_once(' ').unwrap_or((line, ""));
        let text = || printable(text).into_owned();
        match word {
            "done" => Self::Done(text()),
            "absent" => Self::Absent(text()),
            "refused" => Self::Refused(text()),
            _ => Self::Refused("the agent answers what this version does not know".to_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_and_answers_are_lines() {
        let place: Place = "robot-1/rti".parse().unwrap();
        for request in [
            Request::Connect(place.clone()),
            Request::Listen(Place::here("a.b_c")),
            Request::Machines,
            Request::Route("robot-1".to_owned()),
        ] {
            let line = request.to_string();
            assert_eq!(Request::read(line.strip_suffix('\n').unwrap()), Ok(request));
        }
        for text in [
            "",
            "connect a/b",
            "hprm-agent-1",
            "hprm-agent-1 connect a",
            "hprm-agent-2 machines",
            "hprm-agent-1 route",
            "hprm-agent-1 route a/b",
        ] {
            assert!(Request::read(text).is_err(), "{text}");
        }
        let long = Answer::Absent(format!("two\nlines {}", "ü".repeat(LINE_LIMIT))).to_string();
        assert!(long.len() <= LINE_LIMIT && long.matches('\n').count() == 1);
        assert_eq!(Answer::read("done robot1"), Answer::Done("robot1".to_owned()));
        assert_eq!(Answer::read("absent \x1b[2J"), Answer::Absent("\\u{1b}[2J".to_owned()));
        assert!(matches!(Answer::read("what?"), Answer::Refused(_)));
    }

    #[test]
    fn names_are_safe_in_keys() {
        for text in ["robot1/rti", "./x", "a-b.c_d/9"] {
            assert_eq!(text.parse::<Place>().unwrap().to_string(), text);
        }
        let long = format!("a/{}", "b".repeat(65));
        for text in ["", "a", "a/", "/a", "a/b/c", "*/a", "a/**", "a/$x", "../a", "a b/c", &long] {
            assert!(text.parse::<Place>().is_err(), "{text}");
        }
    }
}
