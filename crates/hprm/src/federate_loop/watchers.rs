//! What the loop shows to watchers: the messages that it sends. Nothing here changes what happens at a tag.

use hprm_core::{ChannelId, Payload, Tag};

use super::FederateLoop;
use super::membership::Membership;
use crate::watch::Sample;
use crate::{Clock, Host};

/// A message: its channel, and its tag at the receiver, unless that is the time of arrival.
type Message = (ChannelId, Option<Tag>);

impl Membership {
    /// Does what watchers ask for, if they do.
    #[inline]
    pub(super) fn serve_watchers(&mut self) {
        let Self { links, objects, .. } = self;
        if let Some(watch) = links.watch()
            && watch.is_ready()
        {
            watch.serve(&mut objects.store());
        }
    }

    /// Whether any channel is watched.
    #[inline]
    pub(super) fn is_watched(&mut self) -> bool {
        self.links.watch().is_some_and(|watch| !watch.is_idle())
    }
}

impl<H: Host> FederateLoop<'_, H>
where
    H::Value: Send + Sync,
{
    /// Shows a message to those that watch its channel. `value` says why there is no payload, if there is none.
    #[cold]
    pub(super) fn show(&mut self, (channel, arrives): Message, value: Result<&Payload, String>) {
        let program = self.scheduler.program();
        let port = program.connections[program.channels[channel].connection].from;
        let bytes = value.as_ref().map_or(0, |payload| payload.byte_count());
        let (tag, start) = (self.scheduler.tag(), self.scheduler.start_time());
        let sample = Sample { channel, port, tag, start, at: Clock::now(), bytes };
        let Membership { links, objects, .. } = &mut self.federation;
        if let Some(watch) = links.watch() {
            watch.show(&sample, arrives, value, &mut objects.store());
        }
    }

    /// The same for a value that goes to another thread as it is: it is encoded only for the watchers.
    #[cold]
    pub(super) fn show_reference(&mut self, message: Message, value: &H::Value) {
        let Membership { links, objects, .. } = &mut self.federation;
        if !links.watch().is_some_and(|watch| watch.wants_values(message.0)) {
            return self.show(message, Err(String::new()));
        }
        let payload = self.host.encode(objects.allocator(), message.0, value, true);
        let payload = payload.map_err(|failure| failure.report().message);
        self.show(message, payload.as_ref().map_err(Clone::clone));
    }
}
