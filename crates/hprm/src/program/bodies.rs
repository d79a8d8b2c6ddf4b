//! The bodies of a program, with the states that they work on: the host of its program.

use std::any::Any;
use std::collections::BTreeMap;
use std::error::Error;
use std::sync::{Arc, Mutex, PoisonError};

use hprm_core::{
    Body, ChannelId, Effect, Effects, Payload, PortId, Program, Reaction, ReactionId, ReactorId,
    Reading, Scheduler, Table, Trigger, Turn,
};
use hprm_store::{Object, StoreAllocator};

use super::context::{Access, Context};
use super::digest::Describer;
use super::handle::{Entry, Key, Slot};
use super::identity::{GraphNumber, Identity, Of};
use super::running::Asked;
use super::sender::{Entrances, running_reactions};
use super::transport::{Codec, Transport};
use super::value::Value;
use crate::failure::ReactionFailure;
use crate::trace::Described;
use crate::{Failure, Host, SharedBodies};

/// A closure, of any type, for a reactor whose state has any type. It is given the state of its own
/// reactor.
pub(super) type BodyFn = Box<dyn FnMut(&mut dyn Any, &mut Context<'_>) -> Result<(), Cause> + Send>;

/// Why a body failed.
type Cause = Box<dyn Error + Send + Sync>;

/// What a reaction runs.
pub(super) struct Code {
    pub(super) main: BodyFn,
    pub(super) deadline: Option<BodyFn>,
    pub(super) tardy: Option<BodyFn>,
}

impl Code {
    /// The code of a reaction that another process runs.
    fn none() -> Self {
        Self { main: Box::new(|_, _| Ok(())), deadline: None, tardy: None }
    }

    fn body(&mut self, body: Body) -> &mut BodyFn {
        let handler = match body {
            Body::Main => None,
            Body::Deadline => self.deadline.as_mut(),
            Body::Tardy => self.tardy.as_mut(),
        };
        handler.unwrap_or(&mut self.main)
    }
}

/// What a reaction may touch.
pub(super) struct Site {
    reactor: ReactorId,
    pub(super) graph: GraphNumber,
    /// Sorted.
    reads: Box<[Key]>,
    /// Sorted.
    effects: Box<[Key]>,
    /// Where its loans come from; nothing if there is no other federate. It is here, and not in what is made anew for
    /// each body that runs.
    pub(super) memory: Option<Arc<StoreAllocator>>,
}

/// All bodies of a program, and the states that they work on.
///
/// Only workers lock anything, and no worker waits for a lock: two reactions of one reactor never run
/// at the same time.
pub(super) struct Bodies {
    /// Nothing for the main reactor, which has no body.
    states: Table<ReactorId, Mutex<Box<dyn Any + Send>>>,
    codes: Table<ReactionId, Mutex<Code>>,
    /// Empty while reactors are assembled.
    sites: Table<ReactionId, Site>,
    /// How the values of ports travel that are connected to other federates.
    codecs: BTreeMap<PortId, Codec>,
    /// Describes values for the logical trace.
    describer: Describer,
    /// What the process of a federate has beside that.
    federated: Option<Federated>,
    /// Which program its handles belong to; none while reactors are assembled.
    _identity: Option<Identity>,
}

/// What connects the bodies of a federate to others.
struct Federated {
    transport: Transport,
    asked: Arc<Asked>,
    /// Closed when the federate ends.
    _entrances: Entrances,
}

impl Bodies {
    pub(super) fn new() -> Self {
        Self {
            states: Table::new(),
            codes: Table::new(),
            sites: Table::new(),
            codecs: BTreeMap::new(),
            describer: Describer::default(),
            federated: None,
            _identity: None,
        }
    }

    /// States how the values of a port travel to other federates.
    pub(super) fn carry(&mut self, port: PortId, codec: Codec) {
        self.codecs.insert(port, codec);
        self.describer.add(codec);
    }

    /// Whether it is stated how the values of a port travel.
    pub(super) fn carries(&self, port: PortId) -> bool {
        self.codecs.contains_key(&port)
    }

    /// The same, as those of one federate.
    pub(super) fn federated(
        mut self,
        program: &Arc<Program>,
        asked: Arc<Asked>,
        entrances: Entrances,
    ) -> Self {
        let transport = Transport::new(program, &self.codecs);
        self.federated = Some(Federated { transport, asked, _entrances: entrances });
        self
    }

    fn transport(&mut self) -> &mut Transport {
        let federated = self.federated.as_mut();
        &mut federated.expect("only a federate sends and receives").transport
    }

    /// Puts the state of a reactor in its place.
    pub(super) fn insert(&mut self, reactor: ReactorId, state: Box<dyn Any + Send>) {
        while self.states.len() <= reactor.index() {
            self.states.push(Mutex::new(Box::new(())));
        }
        self.states[reactor] = Mutex::new(state);
    }

    /// Puts the code of a reaction in its place.
    pub(super) fn insert_code(&mut self, reaction: ReactionId, code: Code) {
        while self.codes.len() <= reaction.index() {
            self.codes.push(Mutex::new(Code::none()));
        }
        self.codes[reaction] = Mutex::new(code);
    }

    /// The same, with what the reactions of `program` declare.
    pub(super) fn of(mut self, program: &Program, identity: Identity) -> Self {
        let graph = identity.number();
        self.sites = program.reactions.values().map(|it| Site::of(it, graph)).collect();
        self._identity = Some(identity);
        while self.codes.len() < program.reactions.len() {
            self.codes.push(Mutex::new(Code::none()));
        }
        while self.states.len() < program.reactors.len() {
            self.states.push(Mutex::new(Box::new(())));
        }
        self
    }
}

impl Site {
    fn of(reaction: &Reaction, graph: GraphNumber) -> Self {
        let slot = |id: Slot| Of { id, graph }.key();
        let triggers = reaction.triggers.iter().filter_map(|trigger| match *trigger {
            Trigger::Port(port) => Some(slot(Slot::Port(port))),
            Trigger::Action(action) => Some(slot(Slot::Action(action))),
            _ => None,
        });
        let sources = reaction.sources.iter().map(|port| slot(Slot::Port(*port)));
        let effects = reaction.effects.iter().map(|effect| match *effect {
            Effect::Port(port) => slot(Slot::Port(port)),
            Effect::Action(action) => slot(Slot::Action(action)),
            Effect::Mode(id, transition) => Entry(Of { id, graph }, transition).key(),
        });
        let sorted = |keys: &mut dyn Iterator<Item = Key>| {
            let mut keys: Vec<_> = keys.collect();
            keys.sort_unstable();
            keys.into()
        };
        Self {
            reactor: reaction.reactor,
            graph,
            memory: None,
            effects: sorted(&mut effects.clone()),
            reads: sorted(&mut triggers.chain(sources).chain(effects)),
        }
    }

    #[inline]
    pub(super) fn reads(&self, key: Key) -> bool {
        contains(&self.reads, key)
    }

    #[inline]
    pub(super) fn affects(&self, key: Key) -> bool {
        contains(&self.effects, key)
    }
}

/// Whether a sorted slice holds an item. Most have few items, and a search costs more than a look.
#[inline]
fn contains(sorted: &[Key], item: Key) -> bool {
    if sorted.len() <= 8 { sorted.contains(&item) } else { sorted.binary_search(&item).is_ok() }
}

impl Host for Bodies {
    type Value = Value;

    #[inline]
    fn react(
        &mut self,
        scheduler: &mut Scheduler<Value>,
        reaction: ReactionId,
        body: Body,
    ) -> Result<(), Failure> {
        let site = &self.sites[reaction];
        let state = self.states[site.reactor].get_mut().unwrap_or_else(PoisonError::into_inner);
        let code = self.codes[reaction].get_mut().unwrap_or_else(PoisonError::into_inner);
        let mut context = Context { access: Access::Alone(scheduler), reaction, site };
        match code.body(body)(&mut **state, &mut context) {
            Ok(()) => Ok(()),
            Err(error) => Err(failed(scheduler, reaction, error)),
        }
    }

    fn shared_bodies(&self) -> Option<&dyn SharedBodies<Value>> {
        Some(self)
    }

    fn set_allocator(&mut self, allocator: &Arc<StoreAllocator>) {
        let sites = self.sites.ids().collect::<Vec<_>>();
        for site in sites {
            self.sites[site].memory = Some(Arc::clone(allocator));
        }
    }

    fn tag_is_sent(&mut self) {
        self.transport().forget();
    }

    fn encode(
        &mut self,
        store: &StoreAllocator,
        channel: ChannelId,
        value: &Value,
        _is_local: bool,
    ) -> Result<Payload, Failure> {
        let payload = self.transport().encode(store, channel, value)?;
        for warning in self.transport().take_warnings() {
            self.warn(&warning);
        }
        Ok(payload)
    }

    fn receive(
        &mut self,
        channel: ChannelId,
        payload: Payload,
        objects: Vec<Object>,
        _arrival: impl Reading,
        _is_local: bool,
    ) -> Result<Value, Failure> {
        self.transport().decode(channel, payload, objects)
    }

    fn describe(&mut self, value: &Value) -> Described {
        self.describer.describe(value)
    }

    fn interrupted(&mut self) -> bool {
        self.federated.as_ref().is_some_and(|federated| federated.asked.take())
    }

    fn signal(&self) -> i32 {
        let signal = self.federated.as_ref().map(|federated| federated.asked.signal());
        signal.unwrap_or(crate::supervisor::Signal::INTERRUPT.0)
    }

    #[allow(clippy::print_stderr, reason = "a warning has no other place to go")]
    fn warn(&mut self, message: &str) {
        eprintln!("warning: {message}");
    }
}

impl SharedBodies<Value> for Bodies {
    fn react(
        &self,
        scheduler: &Arc<Scheduler<Value>>,
        turn: &Turn,
        effects: &mut Effects<Value>,
    ) -> Result<(), Failure> {
        let Turn { reaction, body, .. } = *turn;
        let site = &self.sites[reaction];
        let mut state = self.states[site.reactor].lock().unwrap_or_else(PoisonError::into_inner);
        let mut code = self.codes[reaction].lock().unwrap_or_else(PoisonError::into_inner);
        let access = Access::Shared(scheduler, effects);
        let mut context = Context { access, reaction, site };
        let outcome = running_reactions(|| code.body(body)(&mut **state, &mut context));
        outcome.map_err(|error| failed(scheduler, reaction, error))
    }

    fn describe(&self, value: &Value) -> Described {
        self.describer.describe(value)
    }
}

#[cold]
fn failed(scheduler: &Scheduler<Value>, reaction: ReactionId, error: Cause) -> Failure {
    let name = scheduler.program().reaction_name(reaction);
    Failure::Reaction(Box::new(ReactionFailure::new(name, scheduler.tag(), error)))
}
