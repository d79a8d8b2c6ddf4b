//! Ends a process that outlives its federation, because a reaction does not return.
//!
//! The loop does not read its links while a body runs. So a thread waits for the end of the link to the RTI, from the
//! start of the program until the loop has ended. When the link has ended and the loop has not, some time later, the
//! process ends by force. Nothing else would end it: a federate that was started by hand has no launcher.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use rustix::event::{EventfdFlags, PollFd, PollFlags, Timespec, eventfd, poll};
use rustix::io::{Errno, write};

use crate::link::CloseInChild;
use crate::{Kind, Report};

/// How long the loop may still run after the link has ended.
const PATIENCE: Duration = Duration::from_secs(5);

/// Ends the process, and says why.
pub type EndProcess = fn(&Report);

/// The thread, which ends when this is dropped.
///
/// It has a descriptor of the link of its own, which is closed by then: so the other end sees the end of the link as soon
/// as the loop closes it. A forked process has no such thread; it drops nothing either, because it never returns from its
/// body.
pub(super) struct OutliveWatch {
    over: OwnedFd,
    thread: Option<JoinHandle<()>>,
}

impl OutliveWatch {
    /// Watches the link to the RTI, whose socket this is.
    ///
    /// # Errors
    ///
    /// If the system has no descriptor or no thread for that.
    pub(super) fn start(
        link: BorrowedFd<'_>,
        federation: &str,
        end_process: EndProcess,
    ) -> io::Result<Self> {
        let link = OwnLink::of(link)?;
        let over = eventfd(0, EventfdFlags::CLOEXEC)?;
        let seen = over.try_clone()?;
        let federation = federation.to_owned();
        let watch = move || {
            if has_outlived(link.as_fd(), seen.as_fd(), PATIENCE) {
                end_process(&outlived(&federation));
            }
        };
        let thread = thread::Builder::new().name("hprm-rti-link".to_owned()).spawn(watch)?;
        Ok(Self { over, thread: Some(thread) })
    }
}

impl Drop for OutliveWatch {
    fn drop(&mut self) {
        // An eventfd that is written once takes it.
        let _ = write(&self.over, &1_u64.to_ne_bytes());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A descriptor of the link for the thread alone. Child processes that the program forks close it, as they close the
/// loop's: otherwise the RTI would not see that this process has ended.
struct OwnLink {
    // Dropped first: the list of the descriptors that a child closes never has one that is closed here.
    _close_in_child: CloseInChild,
    socket: OwnedFd,
}

impl OwnLink {
    fn of(link: BorrowedFd<'_>) -> io::Result<Self> {
        let socket = link.try_clone_to_owned()?;
        Ok(Self { _close_in_child: CloseInChild::of(&socket), socket })
    }
}

impl AsFd for OwnLink {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

/// Waits until the loop is over, which is false, or the link has ended and the loop has gone on for so long.
fn has_outlived(link: BorrowedFd<'_>, over: BorrowedFd<'_>, patience: Duration) -> bool {
    let mut both = [
        PollFd::from_borrowed_fd(over, PollFlags::IN),
        PollFd::from_borrowed_fd(link, PollFlags::RDHUP),
    ];
    loop {
        match poll(&mut both, None) {
            Ok(_) if !both[0].revents().is_empty() => return false,
            Ok(_) if !both[1].revents().is_empty() => break,
            Ok(_) | Err(Errno::INTR) => {}
            // The system cannot tell: nothing is ended for that reason.
            Err(_) => return false,
        }
    }
    let until = Instant::now() + patience;
    loop {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return true;
        }
        let left = Timespec::try_from(left).ok();
        match poll(&mut both[..1], left.as_ref()) {
            Ok(0) | Err(Errno::INTR) => {}
            Ok(_) | Err(_) => return false,
        }
    }
}

fn outlived(federation: &str) -> Report {
    let seconds = PATIENCE.as_secs();
    let what = format!(
        "the federation {federation} has ended, and a reaction of this federate has not returned {seconds} s later: the \
         process ends now"
    );
    Report::new(Kind::Unfinished, what)
        .hint("the RTI and the other federates say why the federation has ended")
}

#[cfg(test)]
mod tests {
    use rustix::net::{AddressFamily, SocketFlags, SocketType, socketpair};

    use super::*;

    fn pair() -> [OwnedFd; 2] {
        let flags = SocketFlags::CLOEXEC;
        socketpair(AddressFamily::UNIX, SocketType::STREAM, flags, None).unwrap().into()
    }

    fn event(value: u32) -> OwnedFd {
        eventfd(value, EventfdFlags::CLOEXEC).unwrap()
    }

    #[test]
    fn a_loop_that_ends_before_the_link_or_soon_after_it_outlives_nothing() {
        let [link, other] = pair();
        assert!(!has_outlived(link.as_fd(), event(1).as_fd(), Duration::ZERO));
        drop(other);
        assert!(!has_outlived(link.as_fd(), event(1).as_fd(), Duration::ZERO));
        let over = event(0);
        thread::scope(|scope| {
            let waits = scope.spawn(|| has_outlived(link.as_fd(), over.as_fd(), Duration::MAX / 4));
            write(&over, &1_u64.to_ne_bytes()).unwrap();
            assert!(!waits.join().unwrap());
        });
    }

    #[test]
    fn a_loop_that_goes_on_after_the_end_of_the_link_outlives_the_federation() {
        let [link, other] = pair();
        // What has come and was not read does not hide the end.
        write(&other, b"frame").unwrap();
        drop(other);
        assert!(has_outlived(link.as_fd(), event(0).as_fd(), Duration::from_millis(1)));
    }

    #[test]
    fn a_watch_that_is_dropped_ends_its_thread_and_closes_its_link() {
        let [link, other] = pair();
        let never: EndProcess = |report| panic!("{}", report.message);
        drop(OutliveWatch::start(link.as_fd(), "Main", never).unwrap());
        drop(link);
        let mut end = [PollFd::new(&other, PollFlags::RDHUP)];
        assert_eq!(poll(&mut end, None), Ok(1));
    }
}
