//! Federates that leave: each stops at the next microstep, and the rest of the program goes on.
//!
//! A scheduler that runs one federate only reports the request, and its driver answers with
//! [`Scheduler::leave_at`]. In the scheduler of a whole program the federate's reactors run their
//! shutdown reactions and then nothing; messages that they have sent still arrive.

use alloc::sync::Arc;
use alloc::vec::Vec;

use super::Scheduler;
use crate::queue::QueuedEvent;
use crate::wiring::Wiring;
use crate::{ActionId, FederateId, PortId, ReactionId, ReactorId, Scope, Tag};

/// Which federates leave a whole program, or whether the one federate that runs here asks to leave.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(super) struct Departures {
    /// Whether a reaction has asked, in the scheduler of one federate.
    requested: bool,
    /// Federates whose last tag is the next microstep.
    due: Vec<FederateId>,
    /// Federates whose last tag is the current one.
    leaving: Vec<FederateId>,
    /// Federates that have left.
    gone: Vec<FederateId>,
}

impl Departures {
    /// Whether the next microstep is the last tag of a federate.
    #[inline]
    pub(super) fn are_due(&self) -> bool {
        !self.due.is_empty()
    }

    fn is_known(&self, federate: FederateId) -> bool {
        [&self.due, &self.leaving, &self.gone].iter().any(|known| known.contains(&federate))
    }
}

impl<V: Clone> Scheduler<V> {
    /// Ends the federate of the running reaction at the next microstep; the others go on. If the
    /// program has no federates, it ends. The scheduler of one federate only reports the request: see
    /// [`Self::take_departure`].
    pub fn leave(&mut self) {
        let reactor = self.running.map(|reaction| self.program.reactions[reaction].reactor);
        let Some(federate) = reactor.and_then(|reactor| self.program.reactors[reactor].federate)
        else {
            self.request_stop();
            return;
        };
        self.record_departure();
        let goes_on = self.stop > self.tag.succ();
        match self.scope {
            Scope::Federate(_) => self.departures.requested |= goes_on,
            Scope::Whole if goes_on && !self.departures.is_known(federate) => {
                self.departures.due.push(federate);
            }
            Scope::Whole => {}
        }
    }

    /// Whether a reaction has asked that this federate leaves since this was last called.
    pub fn take_departure(&mut self) -> bool {
        core::mem::take(&mut self.departures.requested)
    }

    /// Ends this federate at `tag`, or at the next one if that has passed, while the program goes on.
    /// An earlier end stands.
    pub fn leave_at(&mut self, tag: Tag) {
        self.stop = self.stop.min(tag.max(self.tag.succ()).max(self.first));
        // Messages that no reaction reads count if there is no other event until the end. This federate may have
        // told others that it does nothing before an event that is after its end now.
        self.unread.clear();
    }

    /// Whether this federate ends before the program does, as far as is known.
    #[must_use]
    pub fn leaves_early(&self) -> bool {
        self.stop < self.program_end
    }

    /// The last tag for which a reactor may schedule an action. It must not see that an end is near, but
    /// it may see that the current tag is its last one.
    #[inline]
    pub(super) fn last_of(&self, reactor: ReactorId) -> Tag {
        if self.tag >= self.stop {
            return self.tag;
        }
        let Departures { leaving, gone, .. } = &self.departures;
        if leaving.is_empty() && gone.is_empty() {
            return self.timeout;
        }
        match self.program.reactors[reactor].federate {
            Some(federate) if gone.contains(&federate) => Tag::NEVER,
            Some(federate) if leaving.contains(&federate) => self.tag,
            _ => self.timeout,
        }
    }

    /// The current tag is the last one of federates that have asked to leave: queues their shutdown
    /// reactions, and removes their later events.
    pub(super) fn queue_departures(&mut self) {
        self.departures.leaving = core::mem::take(&mut self.departures.due);
        let program = Arc::clone(&self.program);
        let leaving = self.departures.leaving.clone();
        self.queue_shutdown(|reaction| {
            let federate = program.reactors[program.reactions[reaction].reactor].federate;
            federate.is_some_and(|federate| leaving.contains(&federate))
        });
        self.forget_departing();
    }

    /// The tag is complete: federates whose last tag it was do nothing any more. A program that all
    /// federates have left has ended.
    #[inline]
    pub(super) fn depart(&mut self) {
        if !self.departures.leaving.is_empty() {
            self.finish_departures();
        }
    }

    #[cold]
    fn finish_departures(&mut self) {
        self.forget_departing();
        let Departures { leaving, gone, .. } = &mut self.departures;
        gone.append(leaving);
        let all_gone = self.program.federates.ids().all(|federate| gone.contains(&federate));
        self.wiring = Arc::new(Wiring::without(&self.program, self.scope, gone));
        if all_gone {
            self.end_at(self.tag);
        }
    }

    /// Removes the events of federates that leave, and their requests for modes.
    fn forget_departing(&mut self) {
        let Self { program, wiring, queue, unread, modes, departures, .. } = self;
        let leaves = |reactor: ReactorId| {
            let federate = program.reactors[reactor].federate;
            federate.is_some_and(|federate| departures.leaving.contains(&federate))
        };
        let of_action = |action: ActionId| program.actions[action].reactor;
        let of_port = |port: PortId| program.ports[port].reactor;
        let of_event = |event: &QueuedEvent<V>| {
            leaves(match event {
                QueuedEvent::Timer(timer) => program.timers[*timer].reactor,
                QueuedEvent::Action { action, .. } => of_action(*action),
                QueuedEvent::Message { connection, .. } => {
                    of_port(program.connections[*connection].to)
                }
            })
        };
        let of_reaction = |reaction: ReactionId| leaves(program.reactions[reaction].reactor);
        queue.extract(|event| of_event(event));
        unread.retain(|sender, _| {
            sender.is_none_or(|federate| !departures.leaving.contains(&federate))
        });
        modes.forget(&wiring.modes, leaves, of_reaction, of_event);
    }
}
