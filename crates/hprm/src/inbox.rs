//! Where other threads leave events for a loop: physical actions, and calls to stop.
//!
//! A loop waits on the inbox's descriptor together with its links, so nothing here polls.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use hprm_core::{ActionId, Nanos, PhysicalTime};

use crate::bell::Bell;
use crate::wait::wait_for;
use crate::{Clock, Failure};

/// An action that a thread outside of the loop has scheduled.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Request<V> {
    pub(crate) action: ActionId,
    pub(crate) extra: Nanos,
    pub(crate) value: Option<V>,
    pub(crate) at: PhysicalTime,
}

/// A handle by which any thread reaches the loop. Clones share one inbox.
#[derive(Debug)]
pub struct Inbox<V> {
    shared: Arc<Shared<V>>,
}

#[derive(Debug)]
struct Shared<V> {
    pending: Mutex<Pending<V>>,
    bell: Bell,
    /// Whether somebody has rung, or may have, since the loop last looked. A loop that runs one tag
    /// after the other looks here, and spares the lock and the call of the kernel.
    rung: AtomicBool,
    /// Whether the loop waits, or is about to: else it looks soon anyway, and the bell is spared.
    asleep: AtomicBool,
    /// Whether the bell rings, or may.
    loud: AtomicBool,
    /// Whether there are requests.
    requested: AtomicBool,
}

#[derive(Debug)]
struct Pending<V> {
    requests: Vec<Request<V>>,
    stop: bool,
    failure: Option<Failure>,
    closed: bool,
}

impl<V> Clone for Inbox<V> {
    fn clone(&self) -> Self {
        Self { shared: Arc::clone(&self.shared) }
    }
}

impl<V> Inbox<V> {
    /// An empty inbox.
    ///
    /// # Errors
    ///
    /// If the process has no descriptor left.
    pub fn new() -> io::Result<Self> {
        let pending =
            Mutex::new(Pending { requests: Vec::new(), stop: false, failure: None, closed: false });
        Ok(Self {
            shared: Arc::new(Shared {
                pending,
                bell: Bell::new()?,
                rung: AtomicBool::new(false),
                asleep: AtomicBool::new(true),
                loud: AtomicBool::new(false),
                requested: AtomicBool::new(false),
            }),
        })
    }

    /// Schedules a physical action now. Returns false if the program has ended.
    pub fn schedule(&self, action: ActionId, extra: Nanos, value: Option<V>) -> bool {
        let mut pending = self.pending();
        if pending.closed {
            return false;
        }
        // Read under the lock, so that requests are in the order of their times.
        let at = Clock::now();
        pending.requests.push(Request { action, extra, value, at });
        self.shared.requested.store(true, Ordering::Release);
        drop(pending);
        self.ring();
        true
    }

    /// Asks the program to stop at its next tag.
    pub fn request_stop(&self) {
        self.pending().stop = true;
        self.ring();
    }

    /// Ends the program: a thread of it cannot go on. The first failure counts. Returns false if the
    /// program has ended.
    pub fn fail(&self, failure: Failure) -> bool {
        let mut pending = self.pending();
        if pending.closed {
            return false;
        }
        pending.failure.get_or_insert(failure);
        drop(pending);
        self.ring();
        true
    }

    /// Wakes the loop without leaving anything.
    pub fn ring(&self) {
        // This and the question whether the loop sleeps are in one order with what `may_sleep` does:
        // one of the two sees what the other has done.
        self.shared.rung.store(true, Ordering::SeqCst);
        if self.shared.asleep.load(Ordering::SeqCst) {
            self.shared.loud.store(true, Ordering::Release);
            self.shared.bell.ring();
        }
    }

    /// A descriptor for those who can do no more than write a byte, such as a signal handler: that
    /// wakes the loop. It never blocks.
    #[must_use]
    pub fn wakeup(&self) -> BorrowedFd<'_> {
        self.shared.bell.rope()
    }

    /// Waits until somebody rings, or `until` has come: for a thread that has no loop.
    pub fn sleep(&self, until: Option<PhysicalTime>) {
        wait_for(self.as_fd(), until);
        self.shared.bell.silence();
    }

    /// Whether a loop may wait: nobody has rung since it last looked. From now on the bell tells it.
    pub(crate) fn may_sleep(&self) -> bool {
        self.shared.asleep.store(true, Ordering::SeqCst);
        !self.shared.rung.load(Ordering::SeqCst)
    }

    /// Notes that a loop has waited, and whether the bell has ended that: a signal handler may have
    /// rung, which leaves nothing but a byte.
    pub(crate) fn waited(&self, bell_rings: bool) {
        self.shared.asleep.store(false, Ordering::Release);
        if bell_rings {
            self.shared.rung.store(true, Ordering::Release);
            self.shared.loud.store(true, Ordering::Release);
        }
    }

    /// Silences the bell, and takes whether a thread has asked to stop. Look for requests after
    /// this, not before.
    ///
    /// # Errors
    ///
    /// If a thread of the program cannot go on: its failure.
    #[inline]
    pub(crate) fn take_stop(&self) -> Result<bool, Failure> {
        if self.shared.rung.load(Ordering::Acquire) { self.silence() } else { Ok(false) }
    }

    /// The same, after a thread has rung.
    fn silence(&self) -> Result<bool, Failure> {
        // Before the bell, so that whoever rings from here on is heard again.
        self.shared.rung.store(false, Ordering::Release);
        if self.shared.loud.swap(false, Ordering::AcqRel) {
            self.shared.bell.silence();
        }
        let mut pending = self.pending();
        match pending.failure.take() {
            Some(failure) => Err(failure),
            None => Ok(std::mem::take(&mut pending.stop)),
        }
    }

    /// Whether actions may have been scheduled since they were last taken.
    #[inline]
    pub(crate) fn has_requests(&self) -> bool {
        self.shared.requested.load(Ordering::Acquire)
    }

    /// Takes the actions that have been scheduled, in the order of their times.
    pub(crate) fn take_requests(&self) -> Vec<Request<V>> {
        self.shared.requested.store(false, Ordering::Release);
        std::mem::take(&mut self.pending().requests)
    }

    /// Refuses everything from now on.
    pub(crate) fn close(&self) {
        self.pending().closed = true;
    }

    fn pending(&self) -> MutexGuard<'_, Pending<V>> {
        self.shared.pending.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<V> AsFd for Inbox<V> {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.shared.bell.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};

    use super::*;

    #[test]
    fn a_ring_ends_a_sleep_and_a_time_does_too() {
        let inbox = Inbox::<()>::new().unwrap();
        inbox.ring();
        inbox.sleep(None);
        inbox.sleep(Some(Clock::now()));
    }

    #[test]
    fn the_bell_rings_only_for_a_loop_that_sleeps() {
        let is_ringing = |inbox: &Inbox<()>| {
            let mut asked = [PollFd::new(inbox, PollFlags::IN)];
            poll(&mut asked, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).unwrap() > 0
        };
        let inbox = Inbox::<()>::new().unwrap();
        inbox.waited(false);
        inbox.ring();
        assert!(!is_ringing(&inbox) && !inbox.may_sleep());
        inbox.waited(false);
        inbox.take_stop().unwrap();
        assert!(inbox.may_sleep());
        inbox.ring();
        assert!(is_ringing(&inbox));
        inbox.waited(true);
        inbox.take_stop().unwrap();
        assert!(!is_ringing(&inbox) && inbox.may_sleep());
    }

    #[test]
    fn the_first_failure_of_a_thread_counts() {
        let inbox = Inbox::<()>::new().unwrap();
        let failure = |message: &str| Failure::Quit { said: message.to_owned() };
        assert!(inbox.fail(failure("first")) && inbox.fail(failure("second")));
        inbox.request_stop();
        assert_eq!(inbox.take_stop(), Err(failure("first")));
        inbox.close();
        assert!(!inbox.fail(failure("third")), "nothing is left to end");
    }

    #[test]
    fn a_thread_leaves_events_in_order() {
        let inbox = Inbox::new().unwrap();
        let sender = inbox.clone();
        std::thread::spawn(move || {
            for value in 0..3 {
                assert!(sender.schedule(ActionId(0), 0, Some(value)));
            }
        })
        .join()
        .unwrap();
        let stop = inbox.take_stop().unwrap();
        assert!(inbox.has_requests());
        let requests = inbox.take_requests();
        assert!(!inbox.has_requests());
        assert_eq!(
            requests.iter().map(|r| r.value).collect::<Vec<_>>(),
            [Some(0), Some(1), Some(2)]
        );
        assert!(requests.is_sorted_by_key(|r| r.at));
        assert!(!stop);
        inbox.close();
        assert!(!inbox.schedule(ActionId(0), 0, None));
    }
}
