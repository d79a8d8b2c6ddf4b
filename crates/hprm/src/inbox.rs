//! Where other threads leave events for a loop: physical actions, and calls to stop.
//!
//! A loop waits on the inbox's descriptor together with its links, so nothing here polls.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use hprm_core::{ActionId, Nanos, PhysicalTime};

use crate::pipe_notifier::PipeNotifier;
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
    notifier: PipeNotifier,
    /// Whether a thread has notified the loop, or may have, since the loop last looked. A loop that runs one
    /// tag after the other looks here, without the lock and without a system call.
    notified: AtomicBool,
    /// Whether the loop waits, or is about to: otherwise it looks soon anyway, and no system call is needed.
    asleep: AtomicBool,
    /// Whether the notifier has to be cleared, or may have to be.
    must_clear: AtomicBool,
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
                notifier: PipeNotifier::new()?,
                notified: AtomicBool::new(false),
                asleep: AtomicBool::new(true),
                must_clear: AtomicBool::new(false),
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
        self.notify();
        true
    }

    /// Asks the program to stop at its next tag.
    pub fn request_stop(&self) {
        self.pending().stop = true;
        self.notify();
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
        self.notify();
        true
    }

    /// Wakes up the loop without an event.
    pub fn notify(&self) {
        // This and the question whether the loop sleeps are in one order with what `may_sleep` does:
        // one of the two sees what the other has done.
        self.shared.notified.store(true, Ordering::SeqCst);
        if self.shared.asleep.load(Ordering::SeqCst) {
            self.shared.must_clear.store(true, Ordering::Release);
            self.shared.notifier.notify();
        }
    }

    /// Whether a loop may wait: it was not notified since it last looked. From now on the notifier wakes it
    /// up.
    pub(crate) fn may_sleep(&self) -> bool {
        self.shared.asleep.store(true, Ordering::SeqCst);
        !self.shared.notified.load(Ordering::SeqCst)
    }

    /// Notes that a loop has waited, and whether the notifier has ended that.
    pub(crate) fn waited(&self, notified: bool) {
        self.shared.asleep.store(false, Ordering::Release);
        if notified {
            self.shared.notified.store(true, Ordering::Release);
            self.shared.must_clear.store(true, Ordering::Release);
        }
    }

    /// Clears the notifier, and takes whether a thread has asked to stop. Look for requests after
    /// this, not before.
    ///
    /// # Errors
    ///
    /// If a thread of the program cannot go on: its failure.
    #[inline]
    pub(crate) fn take_stop(&self) -> Result<bool, Failure> {
        if self.shared.notified.load(Ordering::Acquire) { self.clear() } else { Ok(false) }
    }

    /// The same, after a notification.
    fn clear(&self) -> Result<bool, Failure> {
        // Before the notifier is cleared, so that a notification from here on is noticed.
        self.shared.notified.store(false, Ordering::Release);
        if self.shared.must_clear.swap(false, Ordering::AcqRel) {
            self.shared.notifier.clear();
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
        self.shared.notifier.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};

    use super::*;

    #[test]
    fn only_a_loop_that_sleeps_is_notified() {
        let is_ringing = |inbox: &Inbox<()>| {
            let mut asked = [PollFd::new(inbox, PollFlags::IN)];
            poll(&mut asked, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).unwrap() > 0
        };
        let inbox = Inbox::<()>::new().unwrap();
        inbox.waited(false);
        inbox.notify();
        assert!(!is_ringing(&inbox) && !inbox.may_sleep());
        inbox.waited(false);
        inbox.take_stop().unwrap();
        assert!(inbox.may_sleep());
        inbox.notify();
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
