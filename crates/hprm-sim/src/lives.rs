//! What transient federates must do: each of their processes is a scheduler of its own, from
//! its first tag to its last one, and messages take no time.
//!
//! Which tags those are depends on clocks and on the network; everything else follows from them. A
//! message that is sent to a federate at its first tag or later arrives. A message that was sent before,
//! for such a tag, may arrive; here it arrives if it did in the run. The same holds for a message for a tag
//! after the last one of the program: a federate that does not know that tag yet sends it, and one that does
//! not. A process that was killed may have passed the last tag, and have taken such a message; what others send to it at the last
//! tag, which they have agreed on without it, it does not get. One that was killed when
//! another federate was about to join may have passed the first tag of that one, which has started without it: it gets nothing of it.

use std::collections::BTreeSet;
use std::sync::Arc;

use hprm_core::{ChannelId, PhysicalTime, Program, Scheduler, Scope, Tag};

use crate::behaviour::run_level;
use crate::plan::{Ending, Life};
use crate::{Log, difference};

struct Actor<'a> {
    life: &'a Life,
    arrivals: BTreeSet<(ChannelId, Tag)>,
    scheduler: Scheduler<u64>,
    log: Log,
    /// The last tag of the program, if it ends there. Its scheduler learns of it as late as is possible, when it
    /// begins that tag.
    stop: Option<Tag>,
    /// Whether it is within the tag that is being processed.
    open: bool,
    /// Whether it ends by itself, at the last tag of the program or where it leaves.
    ends: bool,
    over: bool,
}

/// What is wrong with what the processes of a federation did, if anything. Federates that are not
/// `patient` may end before a message arrives; then there is nothing to compare with. The program
/// ends at `stop`, and links have lost messages for `lost_from` and later.
pub(crate) fn wrong(
    program: &Arc<Program>,
    lives: &[Life],
    (stop, lost_from): (Tag, Tag),
    patient: bool,
) -> Option<String> {
    // The test knows neither what a process did that was killed within a tag, nor what a broken link
    // lost.
    let within = lives.iter().filter(|life| life.end == Ending::Within);
    let certain = within.map(|life| life.last).chain([lost_from]).min();
    let mut stage = Stage {
        actors: lives.iter().map(|life| Actor::new(program, life, stop)).collect(),
        wrong: None,
        stop,
        certain: certain.unwrap_or(Tag::FOREVER),
    };
    while stage.wrong.is_none()
        && let Some(tag) = stage.next()
        && tag < stage.certain
    {
        stage.process(tag);
    }
    let differs = |actor: &Actor| {
        let Life { federate, first, last, log, .. } = actor.life;
        let wrong = difference(program, log, &actor.log, stage.certain)?;
        Some(format!("{wrong} ({federate:?} from {first} to {last})"))
    };
    match &stage.wrong {
        Some(missing) => patient.then(|| missing.clone()),
        None => stage.actors.iter().find_map(differs),
    }
}

impl<'a> Actor<'a> {
    fn new(program: &Arc<Program>, life: &'a Life, stop: Tag) -> Self {
        let scope = Scope::Federate(life.federate);
        let mut scheduler = Scheduler::new(Arc::clone(program), scope);
        scheduler.start_late(PhysicalTime(0), life.first);
        let ends = match life.end {
            Ending::InOrder => true,
            Ending::GivenUp => life.last <= stop,
            Ending::Between | Ending::Within => false,
        };
        if ends && life.last < stop {
            scheduler.leave_at(life.last);
        }
        Self {
            life,
            arrivals: life.arrivals.iter().copied().collect(),
            scheduler,
            log: Log::new(program),
            // The others may agree on a last tag that one has passed that was killed, or given up.
            stop: ends.then(|| stop.max(life.first)),
            open: false,
            ends,
            over: life.last == Tag::NEVER,
        }
    }

    /// Whether another process has started when this one had been killed, at a tag that this one had passed.
    fn was_killed_before(&self, other: &Life) -> bool {
        let Life { federate, first, .. } = *self.life;
        !self.ends && first <= other.first && other.without.contains(&federate)
    }

    /// Whether it was killed after it had passed the last tag of the program, of which others did not know then.
    fn has_passed(&self, stop: Tag) -> bool {
        !self.ends && self.life.last > stop
    }

    /// What it does next, unless it is killed before.
    fn next(&self) -> Option<Tag> {
        let next = self.scheduler.next_tag().min(self.stop.unwrap_or(Tag::FOREVER));
        let lives = self.ends || next <= self.life.last;
        (!self.over && lives && next < Tag::FOREVER).then_some(next)
    }
}

struct Stage<'a> {
    actors: Vec<Actor<'a>>,
    wrong: Option<String>,
    /// The last tag of the program.
    stop: Tag,
    certain: Tag,
}

impl Stage<'_> {
    fn next(&self) -> Option<Tag> {
        self.actors.iter().filter_map(Actor::next).min()
    }

    fn process(&mut self, tag: Tag) {
        let now = tag.due(PhysicalTime(0));
        for at in 0..self.actors.len() {
            self.open(at, tag);
        }
        let open = |actor: &&mut Actor| actor.open;
        while let Some(level) =
            self.actors.iter_mut().filter(open).filter_map(|it| it.scheduler.next_level()).min()
        {
            for at in 0..self.actors.len() {
                let actor = &mut self.actors[at];
                if actor.open && actor.scheduler.next_level() == Some(level) {
                    run_level(&mut actor.scheduler, now, level, &[], &mut actor.log);
                    actor.scheduler.pass(level);
                    self.send(at, tag);
                }
            }
        }
        for at in 0..self.actors.len() {
            let actor = &mut self.actors[at];
            if std::mem::take(&mut actor.open) {
                actor.over = actor.scheduler.end(now);
                self.send(at, tag);
            }
        }
    }

    /// Begins the tag, if there is something to do.
    fn open(&mut self, at: usize, tag: Tag) {
        let actor = &mut self.actors[at];
        if !actor.open && actor.next() == Some(tag) {
            if actor.stop == Some(tag) {
                actor.scheduler.set_stop(tag);
            }
            actor.scheduler.begin(tag);
            actor.open = true;
        }
    }

    /// Delivers what an actor has sent.
    fn send(&mut self, from: usize, now: Tag) {
        while let Some(send) = self.actors[from].scheduler.poll_outbound() {
            let channel = self.actors[from].scheduler.program().channels[send.channel];
            let receives = |actor: &Actor| {
                let Life { federate, first, last, .. } = *actor.life;
                federate == channel.to && first <= send.tag && send.tag <= last
            };
            let Some(to) = self.actors.iter().position(receives) else { continue };
            let sender = self.actors[from].life;
            let actor = &mut self.actors[to];
            let arrived = actor.arrivals.contains(&(send.channel, send.tag));
            let must = now >= actor.life.first
                && send.tag <= self.stop
                && !(now == self.stop && actor.has_passed(now))
                && !actor.was_killed_before(sender);
            if must && !arrived && send.tag < self.certain {
                let (sent, at) = (send.channel, send.tag);
                self.wrong =
                    Some(format!("what {sent:?} carried at {now}, for {at}, did not come"));
            }
            if must || arrived {
                actor.scheduler.deliver(send.channel, send.tag, send.value, false);
                self.open(to, now);
            }
        }
    }
}
