//! The bodies of an app, with the states that they work on: the host of its program.

use std::fmt::Display;
use std::sync::{Arc, Mutex, PoisonError};

use hprm_core::{
    Body, ChannelId, Effect, Effects, Payload, PhysicalTime, Program, Reaction, ReactionId,
    ReactorId, Scheduler, Table, Trigger, Turn,
};
use hprm_store::{Object, Store};

use super::context::{Access, Context};
use super::handle::{Key, Readable};
use crate::{Failure, Host, SharedBodies};

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

/// A closure, of any type.
pub(super) type BodyFn<S, V> =
    Box<dyn FnMut(&mut S, &mut Context<'_, V>) -> Result<(), Words> + Send>;

/// What a reaction runs.
pub(super) struct Code<S, V> {
    pub(super) main: BodyFn<S, V>,
    pub(super) deadline: Option<BodyFn<S, V>>,
}

/// A reactor's state and bodies.
pub(super) struct Live<S, V> {
    pub(super) state: S,
    pub(super) reactions: Vec<Code<S, V>>,
}

/// A reactor whose state has any type.
pub(super) trait Behaviour<V>: Send {
    /// Runs a body of the reaction at `index` among the reactor's own.
    fn react(&mut self, index: usize, body: Body, ctx: &mut Context<'_, V>) -> Result<(), Words>;
}

impl<S: Send, V> Behaviour<V> for Live<S, V> {
    fn react(&mut self, index: usize, body: Body, ctx: &mut Context<'_, V>) -> Result<(), Words> {
        let code = &mut self.reactions[index];
        let function = match (body, &mut code.deadline) {
            (Body::Deadline, Some(handler)) => handler,
            _ => &mut code.main,
        };
        function(&mut self.state, ctx)
    }
}

/// A reactor that several threads know, of which one at a time runs it.
type Shared<V> = Mutex<Box<dyn Behaviour<V>>>;

/// What a reaction may touch, and where its code is.
pub(super) struct Site {
    reactor: ReactorId,
    index: usize,
    /// Sorted.
    reads: Box<[Key]>,
    /// Sorted.
    effects: Box<[Key]>,
}

/// All bodies of an app.
pub(super) struct Bodies<V> {
    /// None while the reactor is being assembled, and for the main reactor, which has no body.
    ///
    /// Locked only by workers; two reactions of one reactor never run at the same time.
    reactors: Table<ReactorId, Option<Shared<V>>>,
    sites: Table<ReactionId, Site>,
}

impl<V> Bodies<V> {
    pub(super) fn new() -> Self {
        Self { reactors: Table::new(), sites: Table::new() }
    }

    /// Puts the bodies of a reactor in their place.
    pub(super) fn insert(&mut self, reactor: ReactorId, behaviour: Box<dyn Behaviour<V>>) {
        while self.reactors.len() <= reactor.index() {
            self.reactors.push(None);
        }
        self.reactors[reactor] = Some(Mutex::new(behaviour));
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
            index: reaction.number as usize - 1,
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

    fn react(
        &mut self,
        scheduler: &mut Scheduler<V>,
        reaction: ReactionId,
        body: Body,
    ) -> Result<(), Failure> {
        let site = &self.sites[reaction];
        let Some(reactor) = &mut self.reactors[site.reactor] else {
            unreachable!("a reaction belongs to a reactor that was assembled");
        };
        let reactor = reactor.get_mut().unwrap_or_else(PoisonError::into_inner);
        let mut context = Context { access: Access::Alone(scheduler), reaction, site };
        match reactor.react(site.index, body, &mut context) {
            Ok(()) => Ok(()),
            Err(error) => Err(failed(scheduler.program(), reaction, &error)),
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
        let Some(reactor) = &self.reactors[site.reactor] else {
            unreachable!("a reaction belongs to a reactor that was assembled");
        };
        let mut reactor = reactor.lock().unwrap_or_else(PoisonError::into_inner);
        let mut context = Context { access: Access::Shared(scheduler, effects), reaction, site };
        let outcome = reactor.react(site.index, body, &mut context);
        outcome.map_err(|error| failed(scheduler.program(), reaction, &error))
    }
}

fn failed(program: &Program, reaction: ReactionId, error: &str) -> Failure {
    let name = program.reaction_name(reaction);
    Failure::new(format!("error: reaction {name} failed: {error}"))
}
