//! What the loops need from a host, which knows values and bodies.
//!
//! The Python extension is one host; a Rust program with closures is another. A host runs bodies
//! and turns values into payloads and back; it decides nothing about order or time.

use std::sync::Arc;

use hprm_core::{Body, ChannelId, Effects, Nanos, Payload, ReactionId, Reading, Scheduler, Turn};
use hprm_model::Syntax;
use hprm_store::{Object, StoreAllocator};

use crate::recorder::Tracepoints;
use crate::supervisor::Signal;
use crate::trace::Described;
use crate::{Failure, Report};

/// Runs bodies, and carries values across the network.
pub trait Host {
    /// What ports and actions hold. Cloning it shares it.
    type Value: Clone;

    /// Runs a body of a reaction. Its inputs are in the scheduler, and so go its outputs.
    ///
    /// # Errors
    ///
    /// What the body raised; the program ends.
    fn react(
        &mut self,
        scheduler: &mut Scheduler<Self::Value>,
        reaction: ReactionId,
        body: Body,
    ) -> Result<(), Failure>;

    /// The bodies, for several threads at once. A host that has none always runs them one after the
    /// other, by [`Self::react`], however many workers the program asks for.
    fn shared_bodies(&self) -> Option<&dyn SharedBodies<Self::Value>> {
        None
    }

    /// Gives the host the allocator of the federate's store. A host that makes values in the memory of the
    /// store can seal them in [`Self::encode`] without a copy. The loop calls this once, before any body runs,
    /// but not if the federates are threads of one process.
    fn set_allocator(&mut self, allocator: &Arc<StoreAllocator>) {
        let _ = allocator;
    }

    /// Gives the host what records the tracepoints of bodies. The loop calls this once, before any body runs.
    fn set_tracepoints(&mut self, tracepoints: &Tracepoints) {
        let _ = tracepoints;
    }

    /// Turns a value into a payload. Large buffers go into objects of the store that stay held until
    /// the last clone of `value` is dropped; the loop adds the readers. Most values are small, so it is up to the host
    /// to lock the store. Several channels may ask
    /// for the same value: it should be encoded once. `is_local` says whether the receiver is a process of the
    /// same user on this machine.
    ///
    /// # Errors
    ///
    /// If the value cannot be encoded; the program ends.
    fn encode(
        &mut self,
        store: &StoreAllocator,
        channel: ChannelId,
        value: &Self::Value,
        is_local: bool,
    ) -> Result<Payload, Failure>;

    /// All messages of the current tag have been encoded: what the host keeps for further channels is of no use any more.
    fn tag_is_sent(&mut self) {}

    /// Makes a value of a payload that arrived; `objects` are those that the payload refers to, in
    /// its order. Decoding may wait until the value is read. `arrival` reads the physical time. `is_local` says
    /// whether the sender is a process of the same user on this machine.
    ///
    /// # Errors
    ///
    /// If the host decodes it now, and it is no value of the port; the program ends.
    fn receive(
        &mut self,
        channel: ChannelId,
        payload: Payload,
        objects: Vec<Object>,
        arrival: impl Reading,
        is_local: bool,
    ) -> Result<Self::Value, Failure>;

    /// Prepares a value for a federate that runs in another thread of this process, and tells how many bytes it has, as
    /// far as that is known. The returned value is not encoded and need not be a copy, but this federate must not be
    /// able to change it any more.
    ///
    /// # Errors
    ///
    /// If the value cannot be sent; the program ends.
    fn send_in_process(
        &mut self,
        channel: ChannelId,
        value: &Self::Value,
    ) -> Result<(Self::Value, u64), Failure> {
        let _ = channel;
        Ok((value.clone(), 0))
    }

    /// Makes a value of what another federate of this process has returned from
    /// [`Self::send_in_process`]. `arrival` reads the physical time.
    fn receive_in_process(
        &mut self,
        channel: ChannelId,
        value: Self::Value,
        arrival: impl Reading,
    ) -> Self::Value {
        let _ = (channel, arrival);
        value
    }

    /// Describes a value for the logical trace. A host that does not say what its values are gets a
    /// trace of what happens, but not of what is in the values.
    fn describe(&mut self, value: &Self::Value) -> Described {
        let _ = value;
        Described::opaque("value")
    }

    /// What the program is written in, for hints on how to change it.
    fn syntax(&self) -> Syntax {
        Syntax::default()
    }

    /// Where the source code of a reaction is, as `FILE:LINE`, for reports about the reaction.
    fn source_location(&self, reaction: ReactionId) -> Option<String> {
        let _ = reaction;
        None
    }

    /// Calls `wait`, which waits for input or for workers. If the host holds a lock that other threads of the
    /// process need, as Python's interpreter lock, it releases that lock during the call.
    fn run_unlocked<R: Send>(&self, wait: impl FnOnce() -> R + Send) -> R {
        wait()
    }

    /// Whether the user has asked the process to stop (Ctrl-C) since this was last called.
    fn interrupted(&mut self) -> bool {
        false
    }

    /// The signal by which the user has asked the process to stop.
    fn signal(&self) -> i32 {
        Signal::INTERRUPT.0
    }

    /// The new maxwait of this federate, if a body has changed it since the last call.
    fn take_maxwait(&mut self) -> Option<Nanos> {
        None
    }

    /// Whether a thread that runs no body has asked this federate to stop alone, without the others, since the
    /// last call.
    fn take_departure(&mut self) -> bool {
        false
    }

    /// The loop calls this if another federate has failed and this one ends for that reason. The host tells
    /// the user, unless a launcher of both federates does.
    fn other_federate_failed(&mut self, _report: &Report) {}

    /// Reports to the user something that does not end the program, for example a tardy input that its
    /// reaction does not handle.
    fn warn(&mut self, message: &str);
}

/// Runs bodies in several threads at once: of reactions that do not depend on one another, and never
/// two of one reactor.
pub trait SharedBodies<V>: Sync {
    /// Runs a body. Its inputs are in the scheduler, which does not change meanwhile; what it asks
    /// for goes into `effects`. It keeps no clone of `scheduler` when it returns.
    ///
    /// # Errors
    ///
    /// What the body raised; the program ends.
    fn react(
        &self,
        scheduler: &Arc<Scheduler<V>>,
        turn: &Turn,
        effects: &mut Effects<V>,
    ) -> Result<(), Failure>;

    /// Describes a value for the logical trace, as [`Host::describe`] does.
    fn describe(&self, value: &V) -> Described {
        let _ = value;
        Described::opaque("value")
    }
}
