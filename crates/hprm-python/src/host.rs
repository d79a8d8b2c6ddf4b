//! The host: runs the Python bodies of a program, and carries Python objects across the network.

use std::collections::BTreeMap;
use std::mem;
use std::sync::Arc;

use hprm::recorder::Tracepoints;
use hprm::trace::Described;
use hprm::{Failure, Host, Kind, Pickling, Report, SharedBodies, Source};
use hprm_core::{
    Body, ChannelId, Effects, FederateId, Nanos, Payload, PortId, ReactionId, Reading, Scheduler,
    Table, Turn,
};
use hprm_model::Syntax;
use hprm_store::{Object, StoreAllocator};
use pyo3::prelude::*;

use crate::bodies::Bodies;
use crate::codec::Codec;
use crate::failure::failure_at;
use crate::fork;
use crate::interrupt::Interrupt;
use crate::numpy_memory;
use crate::places::Places;
use crate::runtime::{DeadlineHandler, Runtime};
use crate::serialize::Trust;
use crate::stalls;
use crate::thread;
use crate::value::Value;

/// Runs Python bodies.
pub(crate) struct PyHost {
    pub(crate) runtime: Arc<Runtime>,
    /// The reactions that run here.
    pub(crate) bodies: BTreeMap<ReactionId, Bodies>,
    /// Whether they are functions of modules, rather than text of the program.
    pub(crate) is_bound: bool,
    pub(crate) interrupt: Py<Interrupt>,
    /// Whether another process or thread reports failures of other federates to the user.
    pub(crate) launched: bool,
    pub(crate) codecs: Table<ChannelId, Arc<Codec>>,
    /// Which federates may send pickles to which.
    pub(crate) pickling: Pickling,
    /// Of ports whose values are sent from here: where they are set.
    pub(crate) origins: BTreeMap<PortId, String>,
    pub(crate) places: Arc<Places>,
    /// Owner of what is stored; meaningless where there is no network.
    pub(crate) federate: FederateId,
    /// Whether other federates run in this process.
    pub(crate) is_thread: bool,
    /// The loop's scheduler while a reaction runs alone, otherwise one of no use.
    pub(crate) shared: Arc<Scheduler<Value>>,
    /// Empty, but with room for what a reaction asks for.
    pub(crate) effects: Effects<Value>,
}

impl PyHost {
    fn call(
        &self,
        py: Python<'_>,
        scheduler: &Arc<Scheduler<Value>>,
        (reaction, body): (ReactionId, Body),
        effects: &mut Effects<Value>,
    ) -> PyResult<()> {
        let bodies = &self.bodies[&reaction];
        let late = bodies.deadline.as_ref().filter(|_| body != Body::Deadline).map(|handler| {
            DeadlineHandler {
                handler: handler.clone_ref(py),
                arguments: bodies.arguments.clone_ref(py),
            }
        });
        let here = (reaction, thread::ident(py));
        self.runtime.begin_reaction(scheduler, here, mem::take(effects), late);
        let outcome = bodies.call(py, body, self.is_bound);
        if let Err(error) = &outcome {
            // Only while the reaction runs can its ports be asked.
            let (hints, error) = (py.import("hprm._hints"), error.clone_ref(py).into_value(py));
            let _ = hints.and_then(|hints| hints.call_method1("explain", (error,)));
        }
        *effects = self.runtime.end_reaction(reaction);
        outcome
    }

    fn run(
        &self,
        scheduler: &Arc<Scheduler<Value>>,
        turn: (ReactionId, Body),
        effects: &mut Effects<Value>,
    ) -> Result<(), Failure> {
        // Perhaps a worker's thread.
        match self.is_thread {
            true => thread::belong_to(self.federate),
            false => thread::run_bodies(),
        }
        Python::attach(|py| {
            if !self.is_thread {
                numpy_memory::enter(py);
            }
            let outcome = fork::leave_if_child(py, self.call(py, scheduler, turn, effects));
            outcome.map_err(|error| {
                let name = self.runtime.program().reaction_label(turn.0);
                // A body that is text has a frame in any case.
                let place = self.places.of_reaction(turn.0).filter(|_| self.is_bound);
                let place = (place.as_deref().unwrap_or_default(), self.is_bound);
                failure_at(py, error, Source::Reaction { name, tag: scheduler.tag() }, place)
            })
        })
    }

    /// Puts the loop's scheduler where the objects of the program can reach it, or takes it back.
    fn swap(&mut self, scheduler: &mut Scheduler<Value>) {
        match Arc::get_mut(&mut self.shared) {
            Some(shared) => mem::swap(shared, scheduler),
            None => unreachable!("a reaction that has returned holds no scheduler"),
        }
    }

    /// What to tell if a value could not be sent.
    fn not_sent(&self, py: Python<'_>, channel: ChannelId, error: PyErr) -> Failure {
        let program = self.runtime.program();
        let connection = &program.connections[program.channels[channel].connection];
        let [from, to] = [connection.from, connection.to].map(|port| program.port_name(port));
        let origin = self.origins.get(&connection.from).map_or("", String::as_str);
        failure_at(py, error, Source::Connection { from, to }, (origin, self.is_bound))
    }
}

impl Drop for PyHost {
    fn drop(&mut self) {
        stalls::unwatch(&self.runtime);
        Python::attach(|py| {
            numpy_memory::leave(py);
            self.interrupt.get().release(py);
        });
    }
}

impl Host for PyHost {
    type Value = Value;

    fn react(
        &mut self,
        scheduler: &mut Scheduler<Value>,
        reaction: ReactionId,
        body: Body,
    ) -> Result<(), Failure> {
        let mut effects = mem::take(&mut self.effects);
        self.swap(scheduler);
        let outcome = self.run(&self.shared, (reaction, body), &mut effects);
        self.swap(scheduler);
        scheduler.apply(&mut effects);
        self.effects = effects;
        outcome
    }

    fn shared_bodies(&self) -> Option<&dyn SharedBodies<Value>> {
        Some(self)
    }

    fn set_allocator(&mut self, allocator: &Arc<StoreAllocator>) {
        let mut channels = self.runtime.program().channels.values();
        // A federate that sends nothing needs no memory that others can read.
        if channels.any(|channel| channel.from == self.federate) {
            numpy_memory::set_allocator(allocator);
        }
        if let Err(error) = fork::watch(allocator) {
            self.warn(&format!("processes that bodies fork may see arrays change: {error}"));
        }
    }

    fn set_tracepoints(&mut self, tracepoints: &Tracepoints) {
        self.runtime.set_tracepoints(tracepoints);
    }

    fn encode(
        &mut self,
        store: &StoreAllocator,
        channel: ChannelId,
        value: &Value,
        is_local: bool,
    ) -> Result<Payload, Failure> {
        let (codec, trust) = (&self.codecs[channel], Trust::new(self.pickling, is_local));
        let payload = Python::attach(|py| {
            let encoded = value.encoded(py, codec, store, self.federate, trust);
            // A serializer of the program's own may fork, too.
            let encoded = fork::leave_if_child(py, encoded);
            encoded.map_err(|error| self.not_sent(py, channel, error))
        });
        // A small value leaves the store as it was.
        if payload.as_ref().is_ok_and(|payload| !payload.parts.is_empty()) {
            self.runtime.note_store_stats(store.store().stats());
        }
        payload
    }

    fn receive(
        &mut self,
        channel: ChannelId,
        payload: Payload,
        objects: Vec<Object>,
        arrival: impl Reading,
        is_local: bool,
    ) -> Result<Value, Failure> {
        let way = (Arc::clone(&self.codecs[channel]), Trust::new(self.pickling, is_local));
        Ok(Value::arrived(way, payload, objects, arrival.read()))
    }

    fn send_in_process(
        &mut self,
        channel: ChannelId,
        value: &Value,
    ) -> Result<(Value, u64), Failure> {
        let trust = Trust::new(self.pickling, true);
        Python::attach(|py| {
            let prepared = value.sent_in_process(py, &self.codecs[channel], trust);
            prepared.map_err(|error| self.not_sent(py, channel, error))
        })
    }

    fn receive_in_process(
        &mut self,
        channel: ChannelId,
        value: Value,
        arrival: impl Reading,
    ) -> Value {
        value.received_in_process(
            Arc::clone(&self.codecs[channel]),
            Trust::new(self.pickling, true),
            arrival.read(),
        )
    }

    fn describe(&mut self, value: &Value) -> Described {
        Python::attach(|py| value.described(py))
    }

    fn syntax(&self) -> Syntax {
        self.places.syntax
    }

    fn source_location(&self, reaction: ReactionId) -> Option<String> {
        self.places.of_reaction(reaction)
    }

    fn run_unlocked<R: Send>(&self, wait: impl FnOnce() -> R + Send) -> R {
        // The loop of a thread holds the interpreter's lock only while it runs a body.
        if self.is_thread { wait() } else { Python::attach(|py| py.detach(wait)) }
    }

    fn interrupted(&mut self) -> bool {
        // Signals come to the main thread only.
        !self.is_thread
            && Python::attach(|py| {
                let asked = self.interrupt.get().take(py);
                // Handlers of the program's own have run, and may have forked.
                fork::leave_if_child(py, Ok(asked)).unwrap_or(true)
            })
    }

    fn signal(&self) -> i32 {
        self.interrupt.get().signal()
    }

    fn take_maxwait(&mut self) -> Option<Nanos> {
        self.runtime.take_maxwait()
    }

    fn take_departure(&mut self) -> bool {
        self.runtime.take_departure()
    }

    fn other_federate_failed(&mut self, report: &Report) {
        if self.launched {
            return;
        }
        let federate = report.federate.as_deref().unwrap_or_default();
        let reason = report.message.lines().next().unwrap_or_default();
        let message = match report.kind {
            Kind::Lost => format!("{reason}, so all end"),
            _ if report.is_only_code() => {
                let code = report.code;
                format!("federate {federate} has left with exit code {code}, so all end")
            }
            _ => format!("federate {federate} has failed, so all end: {reason}"),
        };
        // Its place and what to do about it are told where it runs.
        crate::console::show(&Report { code: 1, ..Report::new(report.kind, message).of(federate) });
    }

    fn warn(&mut self, message: &str) {
        // A launcher of processes puts their names in front of what they say.
        let name = || &self.runtime.program().federates[self.federate].name;
        let prefix = if self.is_thread { format!("[{}] ", name()) } else { String::new() };
        crate::console::say(&format!("{prefix}warning: {message}"));
    }
}

impl SharedBodies<Value> for PyHost {
    fn react(
        &self,
        scheduler: &Arc<Scheduler<Value>>,
        turn: &Turn,
        effects: &mut Effects<Value>,
    ) -> Result<(), Failure> {
        self.run(scheduler, (turn.reaction, turn.body), effects)
    }

    fn describe(&self, value: &Value) -> Described {
        Python::attach(|py| value.described(py))
    }
}
