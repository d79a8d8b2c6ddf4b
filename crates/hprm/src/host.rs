//! What the loops need from a host, which knows values and bodies.
//!
//! The Python extension is one host; a Rust program with closures is another. A host runs bodies
//! and turns values into payloads and back; it decides nothing about order or time.

use std::sync::Arc;

use hprm_core::{
    Body, ChannelId, Effects, Nanos, Payload, PhysicalTime, ReactionId, Scheduler, Turn,
};
use hprm_store::{Object, Store, StoreAllocator};

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

    /// Hands over the federate's store, for a host that makes values in its memory: those can be
    /// sealed in [`Self::encode`] without a copy. Called once, before any body runs, and not where
    /// federates share a process.
    fn furnish(&mut self, allocator: &Arc<StoreAllocator>) {
        let _ = allocator;
    }

    /// Turns a value into a payload. Large buffers go into objects of `store` that stay held until
    /// the last clone of `value` is dropped; the loop adds the readers. Several channels may ask
    /// for the same value: it should be encoded once. The receiver is `near` if it runs for the same
    /// user on this machine.
    ///
    /// # Errors
    ///
    /// If the value cannot be encoded; the program ends.
    fn encode(
        &mut self,
        store: &mut Store,
        channel: ChannelId,
        value: &Self::Value,
        near: bool,
    ) -> Result<Payload, Failure>;

    /// Makes a value of a payload that arrived; `objects` are those that the payload refers to, in
    /// its order. Decoding may wait until the value is read. `arrival` is the physical time. The sender
    /// is `near` if it runs for the same user on this machine.
    fn receive(
        &mut self,
        channel: ChannelId,
        payload: Payload,
        objects: Vec<Object>,
        arrival: PhysicalTime,
        near: bool,
    ) -> Self::Value;

    /// Prepares a value for another federate of this process, which runs in another thread. What is
    /// returned is not encoded and need not be a copy, but nothing that this federate does from now
    /// on may be seen in it.
    ///
    /// # Errors
    ///
    /// If the value cannot be handed over; the program ends.
    fn hand_over(
        &mut self,
        channel: ChannelId,
        value: &Self::Value,
    ) -> Result<Self::Value, Failure> {
        let _ = channel;
        Ok(value.clone())
    }

    /// Takes what another federate of this process has handed over. `arrival` is the physical time.
    fn take_over(
        &mut self,
        channel: ChannelId,
        value: Self::Value,
        arrival: PhysicalTime,
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

    /// Where a reaction is written, as `FILE:LINE`, for what is reported of it.
    fn place(&self, reaction: ReactionId) -> Option<String> {
        let _ = reaction;
        None
    }

    /// Waits, or lets workers run. A host that holds a lock which other threads of the process need
    /// releases it meanwhile.
    fn idle<R: Send>(&self, wait: impl FnOnce() -> R + Send) -> R {
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

    /// How long this federate is to wait for its inputs, if a body has changed that since this was
    /// last called.
    fn take_maxwait(&mut self) -> Option<Nanos> {
        None
    }

    /// Whether another thread than that of a body has asked that this federate alone stops, since this
    /// was last called.
    fn take_departure(&mut self) -> bool {
        false
    }

    /// Another federate has failed, and so this one ends too. A launcher of both may tell the user
    /// already.
    fn abandoned(&mut self, _report: &Report) {}

    /// Reports something that the user should know and that does not end the program: a tardy
    /// input that its reaction does not handle.
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
