//! What the reactions of a simulated program do: they hash what they see, and forward the hash.
//!
//! A value carries how often reactions may still forward it, so a cycle becomes idle at some time.

use hprm_core::{
    Effect, FederateId, PhysicalTime, Program, ReactionId, Scheduler, Table, Tag, Trigger,
};

use crate::rng::mix;

/// The low bits of a value: how often reactions may forward it.
const HOPS: u64 = 7;

/// One execution of a reaction.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Entry {
    /// When.
    pub tag: Tag,
    /// The values of its triggers and sources, as far as they have one.
    pub seen: Vec<Option<u64>>,
}

/// What every reaction has done, in order.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Log {
    /// By reaction.
    pub entries: Table<ReactionId, Vec<Entry>>,
}

impl Log {
    /// Nothing has happened.
    #[must_use]
    pub fn new(program: &Program) -> Self {
        Self { entries: Table::filled(program.reactions.len(), Vec::new()) }
    }
}

/// Federates that leave, each at its first reaction at that tag or a later one.
pub(crate) type Leaves = [(FederateId, Tag)];

/// Runs all reactions of the tag that `scheduler` has begun.
pub(crate) fn run(
    scheduler: &mut Scheduler<u64>,
    now: PhysicalTime,
    leaves: &Leaves,
    log: &mut Log,
) {
    while let Some((reaction, _)) = scheduler.next_reaction(now) {
        react(scheduler, (reaction, now), leaves, log);
        scheduler.finish(reaction);
    }
}

/// Runs those of one level.
pub(crate) fn run_level(
    scheduler: &mut Scheduler<u64>,
    now: PhysicalTime,
    level: u32,
    leaves: &Leaves,
    log: &mut Log,
) {
    while scheduler.ready_level() == Some(level)
        && let Some((reaction, _)) = scheduler.next_reaction(now)
    {
        react(scheduler, (reaction, now), leaves, log);
        scheduler.finish(reaction);
    }
}

fn react(
    scheduler: &mut Scheduler<u64>,
    (reaction, now): (ReactionId, PhysicalTime),
    leaves: &Leaves,
    log: &mut Log,
) {
    let program = scheduler.program().clone();
    let spec = &program.reactions[reaction];
    let tag = scheduler.tag();
    let me = program.reactors[spec.reactor].federate;
    if leaves.iter().any(|(federate, from)| Some(*federate) == me && tag >= *from) {
        scheduler.leave();
    }
    let read = |trigger: &Trigger| match *trigger {
        Trigger::Port(port) => scheduler.port(port).copied(),
        Trigger::Action(action) => scheduler.action(action).flatten().copied(),
        Trigger::Startup | Trigger::Shutdown | Trigger::Reset | Trigger::Timer(_) => None,
    };
    let sources = spec.sources.iter().map(|port| scheduler.port(*port).copied());
    let seen: Vec<_> = spec.triggers.iter().map(read).chain(sources).collect();
    let own = seen.iter().all(Option::is_none);
    let hops = seen.iter().flatten().map(|value| value & HOPS).max();
    let seed = [u64::from(reaction.0), tag.time.cast_unsigned(), u64::from(tag.microstep)];
    let values = seen.iter().map(|value| value.unwrap_or(1));
    let hash = seed.into_iter().chain(values).fold(0, |hash, value| mix(hash ^ value));
    log.entries[reaction].push(Entry { tag, seen });
    let hops = if own { hash & HOPS } else { hops.unwrap_or(0) };
    let Some(hops) = hops.checked_sub(1) else {
        return;
    };
    for (index, effect) in spec.effects.iter().enumerate() {
        let hash = mix(hash ^ mix(index as u64));
        if hash >> 60 < 4 {
            continue;
        }
        let value = (hash & !HOPS) | hops;
        match *effect {
            Effect::Port(port) => {
                scheduler.set(port, value);
            }
            Effect::Action(action) => {
                let extra = (hash >> 40) % 3 * 500;
                scheduler.schedule(action, extra.cast_signed(), Some(value), now);
            }
            Effect::Mode(mode, transition) => scheduler.enter(mode, transition),
        }
    }
}
