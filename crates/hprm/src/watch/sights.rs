//! Waiting for what several federates send, in one thread.

use std::os::fd::AsFd;
use std::sync::Arc;
use std::time::Duration;

use hprm_core::{PhysicalTime, Program, Tag};

use super::search::{Opened, Watched};
use super::watcher::{Arrived, Sight, WatchError};
use crate::wait::{Interest, wait};
use crate::{Clock, nanoseconds};

/// All that is watched of a federation.
#[derive(Debug)]
pub struct Sights {
    program: Arc<Program>,
    watched: Vec<Watched>,
    /// How many messages each of them has missed so far.
    dropped: Vec<u64>,
    /// Which of them is asked first: each in turn.
    first: usize,
}

/// What can be seen of a federation next.
#[derive(Debug)]
pub struct Shown {
    /// The port at which the message is seen: `camera.image`.
    pub port: String,
    /// Its tag there; none if that is the time of arrival.
    pub tag: Option<Tag>,
    /// How many messages were missed before it.
    pub missed: u64,
    /// The package that the connection serializes with, if it names one.
    pub serializer: Option<String>,
    /// The message.
    pub sight: Sight<Arrived>,
}

/// What a wait has brought.
#[derive(Debug)]
pub enum Next {
    /// A message.
    Shown(Box<Shown>),
    /// Nothing in that time, or a signal.
    Nothing,
    /// All federates have ended.
    Ended,
}

impl Sights {
    /// What is seen from now on.
    #[must_use]
    pub fn new(opened: Opened) -> Self {
        let Opened { program, watched, .. } = opened;
        let dropped = vec![0; watched.len()];
        Self { program, watched, dropped, first: 0 }
    }

    /// Waits no longer than that for the next message. What was seen before should be dropped by now: only a few
    /// messages can be held.
    ///
    /// # Errors
    ///
    /// If a federate cannot be watched any more, and has not ended.
    pub fn next(&mut self, limit: Duration) -> Result<Next, WatchError> {
        let until = Clock::now().plus(nanoseconds(limit));
        loop {
            if let Some(shown) = self.at_once()? {
                return Ok(Next::Shown(Box::new(shown)));
            }
            if self.watched.is_empty() {
                return Ok(Next::Ended);
            }
            let interests: Vec<_> = self
                .watched
                .iter()
                .map(|it| Interest { fd: it.watching.as_fd(), write: false })
                .collect();
            let is_ready = wait(&interests, Some(until)).iter().any(|it| it.is_ready());
            if !is_ready {
                return Ok(Next::Nothing);
            }
        }
    }

    /// A message that has come already. Federates that have ended are left out from now on.
    fn at_once(&mut self) -> Result<Option<Shown>, WatchError> {
        let mut asked = 0;
        while asked < self.watched.len() {
            let at = (self.first + asked) % self.watched.len();
            match self.watched[at].watching.sight_by(Some(PhysicalTime(0))) {
                Ok(Some(sight)) => {
                    self.first = at + 1;
                    return Ok(Some(self.shown(at, sight)));
                }
                Ok(None) => asked += 1,
                Err(WatchError::Ended) => {
                    self.watched.remove(at);
                    self.dropped.remove(at);
                    (self.first, asked) = (0, 0);
                }
                Err(error) => return Err(error),
            }
        }
        Ok(None)
    }

    fn shown(&mut self, at: usize, sight: Sight<Arrived>) -> Shown {
        let (port, tag) = self.watched[at].place(&self.program, &sight);
        let missed = sight.dropped - std::mem::replace(&mut self.dropped[at], sight.dropped);
        let connection = &self.program.connections[self.program.channels[sight.channel].connection];
        Shown { port, tag, missed, serializer: connection.serializer.clone(), sight }
    }
}
