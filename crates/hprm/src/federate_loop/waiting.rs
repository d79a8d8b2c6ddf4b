//! How the loop waits, until when, and what time it is afterwards. What it waits for, the poller finds out; what a tag
//! waits for, the machine says.

use hprm_core::{Nanos, PhysicalTime};
use hprm_federated::{Input, Permission};

use super::membership::Membership;
use super::{FederateLoop, Phase};
use crate::{Clock, Failure, Host};

/// How long the machine may not know that time passes, in nanoseconds, unless it has asked for a time: as long as several
/// tags take that follow one another quickly.
const WAKE_PAUSE: Nanos = 10_000;

/// What the loop knows of its last waits.
pub(super) struct Waits {
    /// When the machine was last told that time passes.
    told_at: PhysicalTime,
    /// When it wanted to be told, as it said before the last wait.
    wakes_at: Option<PhysicalTime>,
    /// What the local clock showed shortly before the last wait ended, if the poller has read it.
    found_at: Option<PhysicalTime>,
}

impl Waits {
    pub(super) fn new() -> Self {
        Self { told_at: PhysicalTime(0), wakes_at: None, found_at: None }
    }
}

impl<H: Host> FederateLoop<'_, H>
where
    H::Value: Send + Sync,
{
    /// Reads the clock, at the beginning of a round, unless the poller has just done so. Returns what it showed at the
    /// beginning of the last one.
    #[inline]
    pub(super) fn read_clock(&mut self) -> PhysicalTime {
        let now = self.waits.found_at.take().map_or_else(Clock::now, Clock::at);
        std::mem::replace(&mut self.now, now)
    }

    /// Tells the machine that time passes: when it had asked for that before the last wait, and otherwise now and then.
    pub(super) fn wake_machine(&mut self) -> Result<(), Failure> {
        let Waits { told_at, wakes_at, .. } = &mut self.waits;
        let is_due = wakes_at.is_some_and(|at| at <= self.now);
        // A clock that is set back before the start is no reason to wait.
        if (0..WAKE_PAUSE).contains(&self.now.since(*told_at)) && !is_due {
            return Ok(());
        }
        (*told_at, *wakes_at) = (self.now, None);
        self.handle(Input::Wake)
    }

    /// Waits until a link, another thread or the clock may permit this federate to continue.
    #[inline(never)]
    pub(super) fn wait(&mut self) {
        let until = self.wakeup();
        tracing::trace!(
            "waits, {:?}, for tag {} until {until:?}; it is {:?}",
            self.phase,
            self.scheduler.next_tag(),
            self.now
        );
        self.note_wait(until);
        let until = self.show_waiting(until);
        let Membership { links, .. } = &mut self.federation;
        let inbox = self.inbox;
        let found = inbox.may_sleep().then(|| self.host.run_unlocked(|| links.wait(inbox, until)));
        self.waits.found_at = found.and_then(|found| found.at);
        inbox.waited(found.is_some_and(|found| found.notified));
        // The wait has found what had come before it. This thread may have been preempted since the kernel
        // looked last, so of what came during the wait, the loop may not know yet.
        if found.is_some() {
            self.looked_at = self.now;
        }
    }

    fn wakeup(&mut self) -> Option<PhysicalTime> {
        let Membership { machine, time, links, .. } = &self.federation;
        let wakes_at = machine.next_wakeup();
        self.waits.wakes_at = wakes_at;
        match self.phase {
            Phase::Joining => {
                let wakeups = [wakes_at, time.next_wakeup(), links.next_wakeup()];
                return wakeups.into_iter().flatten().min();
            }
            Phase::Done => return None,
            Phase::Processing | Phase::Running => {}
        }
        let processing = self.phase == Phase::Processing;
        let (tag, permission) = if processing {
            let level = self.scheduler.next_level();
            (self.scheduler.tag(), machine.level_permission(level, self.now))
        } else {
            let tag = self.scheduler.next_tag();
            (tag, machine.permission(tag, self.now))
        };
        let due = self.due(tag);
        let permitted = match permission {
            Permission::Granted => Some(due),
            Permission::WaitUntil(time) => Some(due.max(time)),
            Permission::Wait => None,
        };
        [permitted, wakes_at, time.next_wakeup()].into_iter().flatten().min()
    }
}
