//! Connecting to the federates of a federation, which are found by their boards.

use std::collections::BTreeMap;
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use hprm_core::{ChannelId, FederateId, Program};

use super::records::{self, Introduction, Told};
use super::watcher::{WatchError, Watching, next_of};
use super::{Wish, socket_name};
use crate::board::RunningFederation;
use crate::records::RecordSocket;

/// How long federates may take to answer: one may be busy in a reaction, and another one is meant.
const FIRST_ANSWER: Duration = Duration::from_secs(2);

/// A connection to a federate.
#[derive(Debug)]
pub(super) struct Watcher {
    socket: RecordSocket,
    pub(super) program: Arc<Program>,
    pub(super) federate: FederateId,
}

/// Connections to the federates of a federation, by their names.
pub(super) struct Connections {
    /// Where each of them listens.
    sockets: BTreeMap<String, String>,
    /// What came of connecting to it; none for one that is used.
    watchers: BTreeMap<String, Result<Watcher, WatchError>>,
}

impl Connections {
    /// Connects to all federates of a federation that run here.
    pub(super) fn new(federation: &RunningFederation) -> Self {
        let sockets = federation.federates().into_iter().map(|(name, running)| {
            let socket = socket_name(federation.id(), name, running.identity.pid);
            (name.to_owned(), socket)
        });
        let sockets: BTreeMap<_, _> = sockets.collect();
        // All of them get ready to answer at the same time.
        let connected: Vec<_> = sockets.iter().map(|(name, it)| (name, connect(it))).collect();
        let until = Instant::now() + FIRST_ANSWER;
        let left = || until.saturating_duration_since(Instant::now());
        let answered = connected.into_iter().map(|(name, socket)| {
            (name.clone(), socket.and_then(|socket| Watcher::new(socket, left())))
        });
        Self { watchers: answered.collect(), sockets }
    }

    /// The program of the federation, as one of its federates has it; or why none of them tells.
    pub(super) fn program(&mut self) -> Result<Arc<Program>, WatchError> {
        if let Some(watcher) = self.watchers.values().find_map(|it| it.as_ref().ok()) {
            return Ok(Arc::clone(&watcher.program));
        }
        // Of several errors, one says as much as all.
        let error = self.watchers.pop_first().and_then(|(_, it)| it.err());
        Err(error.unwrap_or(WatchError::NotListening))
    }

    /// A connection to a federate that is not used yet.
    pub(super) fn take(&mut self, federate: &str) -> Result<Watcher, WatchError> {
        let Some(socket) = self.sockets.get(federate) else { return Err(WatchError::NotListening) };
        let first = self.watchers.remove(federate);
        first.unwrap_or_else(|| Watcher::new(connect(socket)?, FIRST_ANSWER))
    }
}

pub(super) fn connect(name: &str) -> Result<RecordSocket, WatchError> {
    RecordSocket::connect(name).map_err(|error| match error.kind() {
        io::ErrorKind::ConnectionRefused | io::ErrorKind::NotFound => WatchError::NotListening,
        io::ErrorKind::PermissionDenied => WatchError::OtherUser,
        // As many others wait until it accepts them.
        io::ErrorKind::WouldBlock => WatchError::Silent,
        _ => WatchError::System(error),
    })
}

impl Watcher {
    /// A connection to a federate that answers within that time.
    pub(super) fn new(socket: RecordSocket, limit: Duration) -> Result<Self, WatchError> {
        let (first, _) = next_of(&socket, Some(limit))?;
        match records::decode_first(&first) {
            None => Err(WatchError::OtherVersion),
            Some(Told::Federate(introduction)) => {
                let Introduction { program, federate } = *introduction;
                Ok(Self { socket, program: Arc::new(program), federate })
            }
            Some(_) => Err(WatchError::Full),
        }
    }

    /// Watches these channels, on which the federate sends.
    ///
    /// # Errors
    ///
    /// If the federate has ended, or does not answer.
    pub(super) fn watch(
        self,
        channels: Vec<ChannelId>,
        wish: Wish,
    ) -> Result<Watching, WatchError> {
        Watching::new(self.socket, self.federate, channels, wish)
    }
}
