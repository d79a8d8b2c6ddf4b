//! The bodies of an app, with the states that they work on: the host of its program.

use std::any::Any;
use std::fmt::Display;
use std::sync::{Arc, Mutex, PoisonError};

use hprm_core::{
    Body, ChannelId, Effect, Effects, Payload, PhysicalTime, Program, Reaction, ReactionId,
    ReactorId, Scheduler, Table, Trigger, Turn,
};
use hprm_store::{Object, Store};

use super::context::{Access, Context};
use super::handle::{Key, Readable};
use crate::{Failure, Host, SharedBodies, Source};

/// What a body returns: nothing, or a result whose error ends the program.
pub trait Outcome {
    /// The error's text.
    ///
    /// # Errors
    ///
    /// If the body failed.
    fn outcome(self) -> Result<(), String>;
}

impl Outcome for () {
    fn outcome(self) -> Result<(), String> {
        Ok(())
    }
}

impl<E: Display> Outcome for Result<(), E> {
    fn outcome(self) -> Result<(), String> {
        self.map_err(|error| error.to_string())
    }
}

/// Why a body failed, in words. A boxed text fits into registers, together with there being none.
pub(super) type Words = Box<str>;

/// A closure, of any type, for a reactor whose state has any type. It is given the state of its own
/// reactor.
pub(super) type BodyFn<V> =
    Box<dyn FnMut(&mut dyn Any, &mut Context<'_, V>) -> Result<(), Words> + Send>;

/// What a reaction runs.
pub(super) struct Code<V> {
    pub(super) main: BodyFn<V>,
    pub(super) deadline: Option<BodyFn<V>>,
}

impl<V> Code<V> {
    fn body(&mut self, body: Body) -> &mut BodyFn<V> {
        match (body, &mut self.deadline) {
            (Body::Deadline, Some(handler)) => handler,
            _ => &mut self.main,
        }
    }
}

/// What a reaction may touch.
pub(super) struct Site {
    reactor: ReactorId,
    /// Sorted.
    reads: Box<[Key]>,
    /// Sorted.
    effects: Box<[Key]>,
}

/// All bodies of an app, and the states that they work on.
///
/// Only workers lock anything, and no worker waits for a lock: two reactions of one reactor never run
/// at the same time.
pub(super) struct Bodies<V> {
    /// Nothing for the main reactor, which has no body.
    states: Table<ReactorId, Mutex<Box<dyn Any + Send>>>,
    codes: Table<ReactionId, Mutex<Code<V>>>,
    /// Empty while reactors are assembled.
    sites: Table<ReactionId, Site>,
}

impl<V> Bodies<V> {
    pub(super) fn new() -> Self {
        Self { states: Table::new(), codes: Table::new(), sites: Table::new() }
    }

    /// Puts the state of a reactor in its place.
    pub(super) fn insert(&mut self, reactor: ReactorId, state: Box<dyn Any + Send>) {
        while self.states.len() <= reactor.index() {
            self.states.push(Mutex::new(Box::new(())));
        }
        self.states[reactor] = Mutex::new(state);
    }

    /// Adds the code of the next reaction of the program.
    pub(super) fn push(&mut self, code: Code<V>) {
        self.codes.push(Mutex::new(code));
    }

    /// The same, with what the reactions of `program` declare.
    pub(super) fn of(mut self, program: &Program) -> Self {
        self.sites = program.reactions.values().map(Site::of).collect();
        self
    }
}

impl Site {
    fn of(reaction: &Reaction) -> Self {
        let triggers = reaction.triggers.iter().filter_map(|trigger| match *trigger {
            Trigger::Port(port) => Some(Readable::Port(port)),
            Trigger::Action(action) => Some(Readable::Action(action)),
            _ => None,
        });
        let sources = reaction.sources.iter().map(|port| Readable::Port(*port));
        let written = reaction.effects.iter().filter_map(|effect| match *effect {
            Effect::Port(port) => Some(Readable::Port(port)),
            Effect::Action(action) => Some(Readable::Action(action)),
            Effect::Mode(..) => None,
        });
        let sorted = |readables: &mut dyn Iterator<Item = Readable>| {
            let mut keys: Vec<_> = readables.map(Readable::key).collect();
            keys.sort_unstable();
            keys.into()
        };
        Self {
            reactor: reaction.reactor,
            effects: sorted(&mut written.clone()),
            reads: sorted(&mut triggers.chain(sources).chain(written)),
        }
    }

    #[inline]
    pub(super) fn reads(&self, readable: Readable) -> bool {
        contains(&self.reads, readable.key())
    }

    #[inline]
    pub(super) fn affects(&self, effect: Readable) -> bool {
        contains(&self.effects, effect.key())
    }
}

/// Whether a sorted slice holds an item. Most have few items, and a search costs more than a look.
#[inline]
fn contains(sorted: &[Key], item: Key) -> bool {
    if sorted.len() <= 8 { sorted.contains(&item) } else { sorted.binary_search(&item).is_ok() }
}

impl<V: Clone + Send + Sync> Host for Bodies<V> {
    type Value = V;

    #[inline]
    fn react(
        &mut self,
        scheduler: &mut Scheduler<V>,
        reaction: ReactionId,
        body: Body,
    ) -> Result<(), Failure> {
        let site = &self.sites[reaction];
        let state = self.states[site.reactor].get_mut().unwrap_or_else(PoisonError::into_inner);
        let code = self.codes[reaction].get_mut().unwrap_or_else(PoisonError::into_inner);
        let mut context = Context { access: Access::Alone(scheduler), reaction, site };
        match code.body(body)(&mut **state, &mut context) {
            Ok(()) => Ok(()),
            Err(error) => Err(failed(scheduler, reaction, &error)),
        }
    }

    fn shared_bodies(&self) -> Option<&dyn SharedBodies<V>> {
        Some(self)
    }

    fn encode(&mut self, _: &mut Store, _: ChannelId, _: &V, _: bool) -> Result<Payload, Failure> {
        unreachable!("an app has no federates")
    }

    fn receive(&mut self, _: ChannelId, _: Payload, _: Vec<Object>, _: PhysicalTime, _: bool) -> V {
        unreachable!("an app has no federates")
    }

    #[allow(clippy::print_stderr, reason = "a warning has no other place to go")]
    fn warn(&mut self, message: &str) {
        eprintln!("warning: {message}");
    }
}

impl<V: Clone + Send + Sync> SharedBodies<V> for Bodies<V> {
    fn react(
        &self,
        scheduler: &Arc<Scheduler<V>>,
        turn: &Turn,
        effects: &mut Effects<V>,
    ) -> Result<(), Failure> {
        let Turn { reaction, body, .. } = *turn;
        let site = &self.sites[reaction];
        let mut state = self.states[site.reactor].lock().unwrap_or_else(PoisonError::into_inner);
        let mut code = self.codes[reaction].lock().unwrap_or_else(PoisonError::into_inner);
        let mut context = Context { access: Access::Shared(scheduler, effects), reaction, site };
        let outcome = code.body(body)(&mut **state, &mut context);
        outcome.map_err(|error| failed(scheduler, reaction, &error))
    }
}

#[cold]
fn failed<V: Clone>(scheduler: &Scheduler<V>, reaction: ReactionId, error: &str) -> Failure {
    let name = scheduler.program().reaction_name(reaction);
    let message = format!("reaction {name} failed: {error}");
    Failure::raised(Source::Reaction { name, tag: scheduler.tag() }, message)
}
