//! Has the connections of Zenoh closed at once.
//!
//! Zenoh 1.10 has the kernel wait, when a connection is closed, until the other machine has taken what was sent, for ten seconds
//! at most (`SO_LINGER`), and no setting changes that. It waits on the thread on which all connections are read and
//! written: a machine that has vanished would hold up all others. Without that option the kernel sends the rest
//! after the connection is closed, and nothing waits.
//!
//! Zenoh shows nobody its sockets, so this file looks for those of the process, again and again: Zenoh sets the option when a
//! connection has been opened, and closes it much later. Where the system does not let a process have its own descriptors again
//! (`pidfd_getfd`, which some containers forbid), connections linger.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::io;
use std::os::fd::{OwnedFd, RawFd};

use hprm::Clock;
use hprm_core::{Nanos, PhysicalTime};
use rustix::net::{AddressFamily, sockopt};
use rustix::process::{PidfdFlags, PidfdGetfdFlags, getpid, pidfd_getfd, pidfd_open};

/// How often to look. A connection that is closed sooner after it was opened has seldom much to send.
const EVERY: Nanos = 500_000_000;

/// See the module.
pub(crate) struct Lingering {
    /// This process, if the system gives that.
    this: Option<OwnedFd>,
    /// The descriptors that need no further look, and which sockets those are.
    done: BTreeMap<RawFd, OsString>,
    next: PhysicalTime,
}

impl Lingering {
    /// Has found nothing yet.
    pub(crate) fn new() -> Self {
        let this = pidfd_open(getpid(), PidfdFlags::empty()).ok();
        let next = if this.is_some() { PhysicalTime(0) } else { PhysicalTime::FOREVER };
        Self { this, done: BTreeMap::new(), next }
    }

    /// When to look.
    pub(crate) fn next_wakeup(&self) -> PhysicalTime {
        self.next
    }

    /// Looks, if it is time. What cannot be found out is as it was: then it takes longer to close a connection.
    pub(crate) fn look(&mut self) {
        let now = Clock::local();
        if now < self.next {
            return;
        }
        self.next = now.plus(EVERY);
        let before = std::mem::take(&mut self.done);
        let Some(this) = &self.this else { return };
        for (fd, socket) in sockets().unwrap_or_default() {
            if before.get(&fd) == Some(&socket) || is_done(this, fd).unwrap_or(false) {
                self.done.insert(fd, socket);
            }
        }
    }
}

/// Takes the option from a socket of this process. Returns whether it has done so, or never has to.
fn is_done(this: &OwnedFd, fd: RawFd) -> io::Result<bool> {
    let socket = pidfd_getfd(this, fd, PidfdGetfdFlags::empty())?;
    if !matches!(sockopt::socket_domain(&socket)?, AddressFamily::INET | AddressFamily::INET6) {
        return Ok(true);
    }
    let lingers = sockopt::socket_linger(&socket)?.is_some();
    if lingers {
        sockopt::set_socket_linger(&socket, None)?;
    }
    Ok(lingers)
}

/// The sockets of this process: their descriptors, and which ones they are.
fn sockets() -> io::Result<Vec<(RawFd, OsString)>> {
    let mut sockets = Vec::new();
    for entry in fs::read_dir("/proc/self/fd")? {
        let entry = entry?;
        let Some(fd) = entry.file_name().to_str().and_then(|name| name.parse().ok()) else {
            continue;
        };
        // The descriptor of this folder is among them, and others end meanwhile.
        let Ok(what) = fs::read_link(entry.path()) else { continue };
        if what.as_os_str().as_encoded_bytes().starts_with(b"socket:") {
            sockets.push((fd, what.into_os_string()));
        }
    }
    Ok(sockets)
}

#[cfg(test)]
mod tests {
    use std::net::{TcpListener, TcpStream};
    use std::time::Duration;

    use super::*;

    #[test]
    fn connections_do_not_linger_whenever_that_was_set() {
        let mut lingering = Lingering::new();
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let stream = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        lingering.look();
        // After the first look, as where a handshake takes its time.
        sockopt::set_socket_linger(&stream, Some(Duration::from_secs(10))).unwrap();
        lingering.look();
        assert!(sockopt::socket_linger(&stream).unwrap().is_some(), "it was not time");
        lingering.next = PhysicalTime(0);
        lingering.look();
        assert_eq!(sockopt::socket_linger(&stream).unwrap(), None);
        // Another socket has the number of one that has ended.
        drop(stream);
        let stream = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        sockopt::set_socket_linger(&stream, Some(Duration::from_secs(10))).unwrap();
        lingering.next = PhysicalTime(0);
        lingering.look();
        assert_eq!(sockopt::socket_linger(&stream).unwrap(), None);
    }
}
