//! The federates of this machine that can be watched: those that listen, and are processes of this user.

use std::fs;
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use hprm_core::{ChannelId, FederateId, Program};

use super::record_socket::RecordSocket;
use super::records::{self, Introduction, Told};
use super::watcher::{WatchError, Watching, next_of};
use super::{NAME, Wish};

/// How long federates may take to say which they are: one may be busy in a reaction, and another federation is meant.
const FIRST_ANSWER: Duration = Duration::from_secs(2);

/// Where the kernel lists Unix sockets.
const SOCKETS: &str = "/proc/net/unix";

/// A connection to a federate.
#[derive(Debug)]
pub struct Watcher {
    socket: RecordSocket,
    program: Arc<Program>,
    federate: FederateId,
    federation: String,
    processes: [u32; 2],
}

/// Connections to all federates that listen, or why one of them cannot be watched.
///
/// # Errors
///
/// If the kernel does not list sockets.
pub fn running() -> io::Result<Vec<Result<Watcher, WatchError>>> {
    let names = names(&fs::read_to_string(SOCKETS)?);
    // All of them get ready to answer at the same time.
    let connected: Vec<_> = names.iter().map(|name| connect(name)).collect();
    let is_there = |it: &Result<_, WatchError>| !matches!(it, Err(WatchError::NotListening));
    let until = Instant::now() + FIRST_ANSWER;
    let left = || until.saturating_duration_since(Instant::now());
    Ok(connected.into_iter().filter(is_there).map(|it| Watcher::new(it?, left())).collect())
}

/// The names of sockets that are those of federates. A socket that a listener has accepted is listed, too.
fn names(sockets: &str) -> Vec<String> {
    let names =
        sockets.lines().filter_map(|line| line.split_whitespace().last()?.strip_prefix('@'));
    let mut names: Vec<_> = names.filter(|it| it.starts_with(NAME)).map(str::to_owned).collect();
    names.sort_unstable();
    names.dedup();
    names
}

pub(super) fn connect(name: &str) -> Result<RecordSocket, WatchError> {
    RecordSocket::connect(name).map_err(|error| match error.kind() {
        io::ErrorKind::ConnectionRefused | io::ErrorKind::NotFound => WatchError::NotListening,
        io::ErrorKind::PermissionDenied => WatchError::OtherUser,
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
                let Introduction { program, federate, federation, processes } = *introduction;
                let program = Arc::new(program);
                Ok(Self { socket, program, federate, federation, processes })
            }
            Some(_) => Err(WatchError::Full),
        }
    }

    /// The program of its federation.
    #[must_use]
    pub fn program(&self) -> &Arc<Program> {
        &self.program
    }

    /// Which federate it is.
    #[must_use]
    pub fn federate(&self) -> FederateId {
        self.federate
    }

    /// The name of its federation in frames, which no other federation has.
    #[must_use]
    pub fn federation(&self) -> &str {
        &self.federation
    }

    /// Whether that is the number of its process, or of the one that has started it.
    #[must_use]
    pub fn is_process(&self, number: u32) -> bool {
        self.processes.contains(&number)
    }

    /// The number of its process, or of the one that has started it if that has started the others, too.
    #[must_use]
    pub fn processes(&self) -> [u32; 2] {
        self.processes
    }

    /// Watches these channels, on which the federate sends.
    ///
    /// # Errors
    ///
    /// If the federate has ended, or does not answer.
    pub fn watch(self, channels: Vec<ChannelId>, wish: Wish) -> Result<Watching, WatchError> {
        Watching::new(self.socket, self.federate, channels, wish)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sockets_of_federates_are_told_by_their_names() {
        let listed = "Num       RefCount Protocol Flags    Type St Inode Path\n\
            0000: 00000002 00000000 00010000 0005 01 1 @hprm-watch-b\n\
            0000: 00000003 00000000 00000000 0005 03 2 @hprm-watch-b\n\
            0000: 00000003 00000000 00000000 0001 03 3\n\
            0000: 00000002 00000000 00010000 0005 01 4 @hprm-watch-a\n\
            0000: 00000002 00000000 00010000 0001 01 5 @other\n";
        assert_eq!(names(listed), ["hprm-watch-a", "hprm-watch-b"]);
    }
}
