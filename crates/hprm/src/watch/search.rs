//! What a user wants to watch: finding it, and connecting to the federates that send it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use hprm_core::{Program, Tag};

use super::Wish;
use super::connecting::Connections;
use super::target::{Share, Target, ends};
use super::watcher::{Sight, WatchError, Watching};
use crate::board::RunningFederation;
use crate::{Kind, Label, Report, console};

/// How often to look whether a federation runs.
const LOOKING: Duration = Duration::from_millis(50);

/// What a user wants to watch.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Search {
    /// The federation, by its name or by the number of a process; none for the only one that runs.
    pub federation: Option<String>,
    /// `FED.PORT`, any number of them; all connections between federates if there are none.
    pub ports: Vec<String>,
    /// What to know of the messages.
    pub wish: Wish,
    /// How users say what they want.
    pub words: Words,
}

/// How users say what they want, for hints.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Words {
    /// By options of the command.
    Options,
    /// By arguments of a function in Python.
    Arguments,
}

impl Words {
    fn of(self, pid: u32) -> String {
        match self {
            Self::Options => format!("--of {pid}"),
            Self::Arguments => format!("of={pid}"),
        }
    }

    fn wait(self) -> &'static str {
        match self {
            Self::Options => "--wait SECONDS",
            Self::Arguments => "wait=\"10 s\"",
        }
    }
}

/// What is watched.
#[derive(Debug)]
pub struct Opened {
    /// The program of the federation.
    pub program: Arc<Program>,
    /// Whether there are several ports.
    pub is_several: bool,
    /// The connections to the federates that send there.
    pub watched: Vec<Watched>,
}

/// A federate that is watched.
#[derive(Debug)]
pub struct Watched {
    /// Its name.
    pub federate: String,
    /// Whether it is watched at its outputs, so that the sender's tag is the one to show.
    pub is_output: bool,
    /// The connection.
    pub watching: Watching,
}

/// What is found at a moment: what is there, and an error if something is missing that may be there later.
struct Found {
    opened: Option<Opened>,
    missing: Option<Report>,
}

impl Search {
    /// Watches what is meant, and waits for it no longer than that; `pause` waits between two looks, or says why there
    /// should be no further one. Federates that are not there in time are left out, unless none is.
    ///
    /// # Errors
    ///
    /// If there is no such port; or no such federation, or none of the federates that send there can be watched in
    /// time; or what `pause` returns.
    pub fn open<E: From<Report>>(
        &self,
        limit: Duration,
        mut pause: impl FnMut(Duration) -> Result<(), E>,
    ) -> Result<Opened, E> {
        let until = Instant::now() + limit;
        loop {
            let is_late = Instant::now() >= until;
            match self.look().map_err(|report| *report)? {
                Found { opened: Some(opened), missing: None } => return Ok(opened),
                Found { opened: Some(opened), missing: Some(missing) }
                    if is_late && !opened.watched.is_empty() =>
                {
                    console::show(Label::Warning, &missing);
                    return Ok(opened);
                }
                Found { missing: Some(missing), .. } if is_late => return Err(missing.into()),
                _ => pause(LOOKING)?,
            }
        }
    }

    /// Looks for what is meant. What is wrong, and will not be right later, is an error.
    fn look(&self) -> Result<Found, Box<Report>> {
        let federation = match RunningFederation::choose(self.federation.as_deref()) {
            Ok(federation) => federation,
            Err(error) => {
                let missing = error.report(|pid| self.words.of(pid));
                return match error.may_come() {
                    true => Ok(Found { opened: None, missing: Some(missing) }),
                    false => Err(Box::new(missing)),
                };
            }
        };
        let mut connections = Connections::new(&federation);
        match connections.program() {
            Ok(program) => self.watch(program, connections),
            Err(error) => {
                let missing = self.unwatched(&format!("federation {}", federation.name()), &error);
                Ok(Found { opened: None, missing: Some(missing) })
            }
        }
    }

    /// Watches what is meant in a federation.
    fn watch(
        &self,
        program: Arc<Program>,
        mut connections: Connections,
    ) -> Result<Found, Box<Report>> {
        let Target { shares, is_several } = Target::of(&program, &self.ports, self.wish)?;
        let (mut watched, mut missing) = (Vec::new(), None);
        for Share { federate, channels, is_output } in shares {
            let federate = program.federates[federate].name.clone();
            let watcher = connections.take(&federate);
            match watcher.and_then(|it| it.watch(channels, self.wish)) {
                Ok(watching) => watched.push(Watched { federate, is_output, watching }),
                Err(error) => {
                    missing = Some(self.unwatched(&format!("federate {federate}"), &error));
                }
            }
        }
        Ok(Found { opened: Some(Opened { program, is_several, watched }), missing })
    }

    fn unwatched(&self, what: &str, error: &WatchError) -> Report {
        let said = Report::new(Kind::Command, format!("{what} cannot be watched: {error}"));
        match error {
            WatchError::NotListening => said.hint(format!(
                "has it ended, is it about to start ({}), or does it run on another machine? Federates are watched on the \
                 machine on which they run",
                self.words.wait()
            )),
            WatchError::Silent => {
                said.hint(format!("wait longer for it: {}", self.words.wait()))
            }
            WatchError::OtherUser => said.hint("only its own user can watch it"),
            WatchError::Full => said.hint("end one of the processes that watch it"),
            WatchError::OtherVersion => {
                said.hint("watch it with the command of its own version of hprm")
            }
            _ => said,
        }
    }
}

impl Watched {
    /// The port at which a message is shown, and its tag there; no tag if that is the time of arrival.
    #[must_use]
    pub fn place<V>(&self, program: &Program, sight: &Sight<V>) -> (String, Option<Tag>) {
        let [from, to] = ends(program, sight.channel);
        if self.is_output { (from, Some(sight.tag)) } else { (to, sight.arrives) }
    }
}
