//! Which descriptors of this process are ends of links, for a process that the program forks: as long as
//! that has them too, nobody sees the links end when this one does.

use std::collections::BTreeSet;
use std::os::fd::{AsRawFd, RawFd};
use std::sync::{Mutex, MutexGuard, PoisonError};

static ENDS: Mutex<BTreeSet<RawFd>> = Mutex::new(BTreeSet::new());

/// The descriptors of all sockets of links, connected or listening.
///
/// Whoever forks asks before that, and lets go of them in the new process.
#[must_use]
pub fn link_descriptors() -> Vec<RawFd> {
    ends().iter().copied().collect()
}

/// An end of a link, as long as this lives: it goes before the descriptor is closed.
#[derive(Debug)]
pub(super) struct End(RawFd);

impl End {
    pub(super) fn of(socket: &impl AsRawFd) -> Self {
        let descriptor = socket.as_raw_fd();
        ends().insert(descriptor);
        Self(descriptor)
    }
}

impl Drop for End {
    fn drop(&mut self) {
        ends().remove(&self.0);
    }
}

fn ends() -> MutexGuard<'static, BTreeSet<RawFd>> {
    ENDS.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixStream;

    use super::*;

    #[test]
    fn an_end_is_listed_as_long_as_it_lives() {
        let (socket, _other) = UnixStream::pair().unwrap();
        let end = End::of(&socket);
        assert!(link_descriptors().contains(&socket.as_raw_fd()));
        drop(end);
        assert!(!link_descriptors().contains(&socket.as_raw_fd()));
    }
}
