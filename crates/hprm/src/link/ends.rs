//! Closes the sockets of links in child processes that the program forks: as long as a child has them open
//! too, the peer cannot see that this process has ended.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::os::fd::{AsRawFd, RawFd};
use std::sync::{Mutex, MutexGuard, Once, PoisonError};

use hprm_store::{at_fork, is_forked, replace_with_null};

/// The descriptors of all sockets of links, connected or listening.
static ENDS: Mutex<BTreeSet<RawFd>> = Mutex::new(BTreeSet::new());
static WATCHING: Once = Once::new();

thread_local! {
    /// The thread that forks holds the lock from before the fork until after it: so the list is right in the
    /// child.
    static HELD: RefCell<Option<MutexGuard<'static, BTreeSet<RawFd>>>> = const { RefCell::new(None) };
}

extern "C" fn prepare() {
    if !is_forked() {
        let _ = HELD.try_with(|held| held.replace(Some(ends())));
    }
}

extern "C" fn in_parent() {
    let _ = HELD.try_with(RefCell::take);
}

extern "C" fn in_child() {
    let Some(ends) = HELD.try_with(RefCell::take).ok().flatten() else { return };
    for descriptor in ends.iter() {
        // Without a descriptor to put there, the link stays open as long as the child runs.
        let _ = replace_with_null(*descriptor);
    }
}

/// Keeps a socket in the list, as long as this lives: it is dropped before the descriptor is closed.
#[derive(Debug)]
pub(crate) struct CloseInChild(RawFd);

impl CloseInChild {
    pub(crate) fn of(socket: &impl AsRawFd) -> Self {
        // If the system does not report forks, children keep links open.
        WATCHING.call_once(|| drop(at_fork(prepare, in_parent, in_child)));
        let descriptor = socket.as_raw_fd();
        ends().insert(descriptor);
        Self(descriptor)
    }
}

impl Drop for CloseInChild {
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
        let end = CloseInChild::of(&socket);
        assert!(ends().contains(&socket.as_raw_fd()));
        drop(end);
        assert!(!ends().contains(&socket.as_raw_fd()));
    }
}
