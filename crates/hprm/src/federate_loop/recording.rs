//! What the loop records of itself for the trace. Nothing here decides anything.

use hprm_core::{ChannelId, Payload, PhysicalTime, Tag};
use hprm_federated::{Estimate, Input};

use super::{FederateLoop, Phase};
use crate::recorder::{Flags, Kind, Size, Wait, Waiting};
use crate::{Clock, Host};

impl<H: Host> FederateLoop<'_, H>
where
    H::Value: Send + Sync,
{
    /// A message has arrived.
    #[inline]
    pub(super) fn note_received(&mut self, message: (ChannelId, Tag), payload: &Payload) {
        self.counts.message(message.0, message.1, payload);
        if self.recorder.is_on() {
            let size = match self.exchange {
                Some(_) => Size::REFERENCE,
                None => Size::of(payload, Flags::NONE),
            };
            // The loop has read all messages of this round before it handles the first of them.
            let at = *self.messages_at.get_or_insert_with(Clock::now);
            self.recorder.received(message, size, at);
        }
    }

    /// The RTI has sent a frame.
    #[inline]
    pub(super) fn note_from_rti(&self, input: &Input) {
        if let Input::FromRti(frame) = input {
            self.recorder.frame(Kind::FrameReceived, self.federation.me(), frame);
        }
    }

    /// The clock was set to another time.
    #[cold]
    pub(super) fn note_clock_set(&self, set: Estimate) {
        let is_kept = self.federation.time.is_kept();
        self.recorder.clock_set(set.offset, set.error, is_kept);
    }

    /// The loop waits now.
    #[inline]
    pub(super) fn note_wait(&mut self, until: Option<PhysicalTime>) {
        if !self.recorder.is_on() {
            return;
        }
        let tag = match self.phase {
            Phase::Processing => self.scheduler.tag(),
            _ => self.scheduler.next_tag(),
        };
        let due = self.due(tag);
        let what = match self.phase {
            Phase::Joining => Wait::Start,
            _ if tag == Tag::FOREVER => Wait::Events,
            _ if due > self.now => Wait::Time,
            _ => Wait::Permission,
        };
        let tag = if self.phase == Phase::Joining { Tag::NEVER } else { tag };
        self.waiting = Some(Waiting { what, tag, since: self.now, until });
    }

    /// A round of the loop begins.
    #[inline]
    pub(super) fn note_round(&mut self) {
        self.messages_at = None;
        if let Some(waiting) = self.waiting.take() {
            self.recorder.waited(waiting, self.now);
            // What has ended a wait was there before the loop has read the clock; it need not read it again for that.
            self.messages_at = Some(self.now);
        }
    }
}
