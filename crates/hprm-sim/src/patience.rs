//! How long a federate may wait under decentralized coordination, computed from the program again: the
//! oracle for `maxwait` and `absent_after`.
//!
//! A tag begins no later than `maxwait` after it is due, and a level no later than that and the
//! `absent_after` of what is read up to there; and what comes sooner is not tardy.

use std::collections::BTreeMap;

use hprm_core::{
    Bound, ChannelId, Coordination, FederateId, Nanos, Overflow, PhysicalTime, Program, Tag,
};
use hprm_federated::Permission;

use crate::Plan;

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Patience {
    /// None under centralized coordination.
    inputs: Option<BTreeMap<ChannelId, Input>>,
    /// In force for the next tag, and for the current one.
    maxwait: Nanos,
    at_current: Nanos,
    /// The changes of `maxwait` by the program, each with the tag after which it holds.
    changes: Vec<(Tag, Nanos)>,
    /// The tags at which tardy messages were taken; the next of their channel are after those.
    taken: BTreeMap<ChannelId, Tag>,
    /// Whether nothing but a wait for inputs can be without an end.
    strict: bool,
    wrong: Option<String>,
}

#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
struct Input {
    first_reader: u32,
    absent_after: Nanos,
}

impl Patience {
    pub(crate) fn new(program: &Program, me: FederateId, plan: &Plan) -> Self {
        let decentralized = program.properties.coordination == Coordination::Decentralized;
        let channels = program.channels.iter().filter(|(_, c)| c.to == me && !c.physical);
        let inputs = channels.map(|(id, channel)| {
            let absent_after = program.connections[channel.connection].absent_after;
            (id, Input { first_reader: channel.first_reader, absent_after })
        });
        let changes = plan.maxwaits.iter().filter(|(federate, _, _)| *federate == me);
        let is_disturbed = plan.stop.is_some() || plan.crash.is_some() || plan.cut.is_some();
        let blocks = |bound: Bound| bound.overflow == Overflow::Block;
        let may_block = program.connections.values().any(|it| it.bound.is_some_and(blocks));
        let machines_fail = plan.machines.as_ref().is_some_and(|it| it.fatal().is_some());
        let has_transients = program.federates.values().any(|federate| federate.transient);
        Self {
            inputs: decentralized.then(|| inputs.collect()),
            maxwait: program.federates[me].maxwait,
            at_current: program.federates[me].maxwait,
            changes: changes.map(|(_, tag, wait)| (*tag, *wait)).collect(),
            taken: BTreeMap::new(),
            strict: !is_disturbed
                && plan.broken.is_none()
                && plan.broken_at_end.is_none()
                && !machines_fail
                && !has_transients
                && !may_block
                && plan.flow_limit.is_none()
                && plan.leaves.is_empty()
                && program.properties.keepalive,
            wrong: None,
        }
    }

    /// The first wrong answer of the machine.
    pub(crate) fn wrong(&self) -> Option<&str> {
        self.wrong.as_deref()
    }

    /// A tag is complete. Returns the new `maxwait`, if the program changes it now.
    pub(crate) fn completed(&mut self, tag: Tag) -> Option<Nanos> {
        let at = self.changes.iter().position(|(after, _)| *after <= tag)?;
        self.maxwait = self.changes.remove(at).1;
        Some(self.maxwait)
    }

    /// A tag has begun.
    pub(crate) fn began(&mut self) {
        self.at_current = self.maxwait;
    }

    /// The machine has been asked whether a tag may begin that is due at `due`.
    pub(crate) fn asked_to_begin(&mut self, tag: Tag, due: PhysicalTime, answer: Permission) {
        self.check(&format!("{tag}"), due.plus(self.maxwait), answer);
    }

    /// The same for a level of the current tag.
    pub(crate) fn asked_to_pass(
        &mut self,
        (tag, level): (Tag, Option<u32>),
        due: PhysicalTime,
        answer: Permission,
    ) {
        let level = level.unwrap_or(u32::MAX);
        let Some(inputs) = &self.inputs else { return };
        let read = inputs.values().filter(|input| input.first_reader <= level);
        let longest = read.map(|input| input.absent_after).max().unwrap_or(0);
        let until = due.plus(self.maxwait).plus(longest);
        self.check(&format!("level {level} of {tag}"), until, answer);
    }

    fn check(&mut self, what: &str, until: PhysicalTime, answer: Permission) {
        let too_long = match answer {
            _ if self.inputs.is_none() => false,
            Permission::Granted => false,
            Permission::WaitUntil(time) => time > until,
            Permission::Wait => self.strict && until < PhysicalTime::FOREVER,
        };
        if too_long {
            let wrong = format!("{what} waits for {answer:?}, but no longer than {}", until.0);
            self.wrong.get_or_insert(wrong);
        }
    }

    /// A message for `tag` arrives at `now` and is tardy at the current tag, which was due at `due`.
    pub(crate) fn came_late(
        &mut self,
        (channel, tag, taken): (ChannelId, Tag, Option<Tag>),
        current: Tag,
        (now, due): (PhysicalTime, PhysicalTime),
    ) {
        let Some(input) = self.inputs.as_ref().and_then(|inputs| inputs.get(&channel)) else {
            return;
        };
        let is_pushed = self.taken.get(&channel).is_some_and(|last| tag <= *last);
        self.taken.extend(taken.map(|taken| (channel, taken)));
        let until = match tag == current {
            true => due.plus(self.at_current).plus(input.absent_after),
            false => due.plus(self.at_current),
        };
        if tag <= current && !is_pushed && now < until {
            let wrong = format!(
                "the message of {channel:?} for {tag} is tardy at {current}, but it came at {}, and \
                 was to be waited for until {}",
                now.0, until.0
            );
            self.wrong.get_or_insert(wrong);
        }
    }
}
