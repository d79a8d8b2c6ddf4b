//! When what is to be sent leaves over a federate's links. What it is, the machine decides; how it gets there, the link.

use std::io;
use std::mem;

use hprm_core::limits::EAGER_BUFFER;

use super::{FederateLinks, PolledLinks, no_memory};
use crate::Failure;
use crate::link::Link;
use crate::poller::PollSet;
use crate::shipping::Shipping;

impl FederateLinks {
    /// Whether the agent has not taken all shipments yet. Then messages stay here: one that has left without its
    /// shipments could never be read if this process was killed now.
    fn shipments_wait(&self) -> bool {
        self.polled.shipping.as_ref().is_some_and(Shipping::has_waiting)
    }

    /// Writes what can be written. It reports no failure: the next read of the links finds out that a peer has
    /// ended, or that there was no memory for a frame.
    pub(in crate::federate_loop) fn flush(&mut self) {
        if self.shipments_wait() {
            return;
        }
        self.flush_peers();
        if mem::take(&mut self.rti_may_have_outbound)
            && let Some(rti) = &mut self.polled.rti
        {
            self.rti_may_have_outbound = flush(&mut rti.link, &mut self.write_failure);
        }
    }

    /// The same for the links with peers alone.
    pub(in crate::federate_loop) fn flush_peers(&mut self) {
        if self.shipments_wait() {
            return;
        }
        let others = mem::take(&mut self.peers_may_have_outbound);
        let Self { unsent, polled, write_failure, peers_may_have_outbound, .. } = self;
        for peer in &*unsent {
            if let Some(polled) = polled.to_mut(*peer) {
                *peers_may_have_outbound |= flush(&mut polled.link, write_failure);
            }
        }
        unsent.clear();
        if !others {
            return;
        }
        let PolledLinks { outgoing, incoming, .. } = &mut self.polled;
        for peer in outgoing.values_mut().chain(incoming.values_mut()) {
            self.peers_may_have_outbound |= flush(&mut peer.link, &mut self.write_failure);
        }
    }

    /// The same for those with peers that need not be woken up for it.
    pub(in crate::federate_loop) fn flush_awake_peers(&mut self) {
        if self.shipments_wait() {
            return;
        }
        let Self { unsent, polled, write_failure, peers_may_have_outbound, .. } = self;
        unsent.retain(|peer| match polled.to_mut(*peer) {
            Some(polled) if polled.link.reader_is_awake() => {
                *peers_may_have_outbound |= flush(&mut polled.link, write_failure);
                false
            }
            _ => true,
        });
    }

    /// Whether there is as much to write as the other end reads at once. A link whose other end took no more
    /// the last time does not count, so that the loop does not try again for each new frame.
    pub(in crate::federate_loop) fn have_much_to_write(&self) -> bool {
        self.polled.links().any(|link| link.writable_len() >= EAGER_BUFFER)
    }
}

/// Writes what can be written to a link. Returns whether it must be flushed again.
fn flush(link: &mut Link, write_failure: &mut Option<Failure>) -> bool {
    match link.flush() {
        Ok(()) => {}
        Err(error) if error.kind() == io::ErrorKind::OutOfMemory => {
            write_failure.get_or_insert_with(|| no_memory(&error));
        }
        Err(_) => link.discard(),
    }
    link.must_flush_again()
}
