//! Records of what reactions did, for the logical trace, with marks on what may depend on the physical
//! world.
//!
//! Recording is off at first, and then costs one test of an option. A record is complete when its
//! reaction finishes. A comparison of two runs leaves out what is marked as physical, so the mark spreads
//! to everything that it may have influenced:
//!
//! - Events of physical actions and messages of physical connections are marked.
//! - A reaction that an event or a port with a mark triggers, or that may read such a port, is
//!   marked, and from then on all reactions of its reactor are, since its state may depend on
//!   it. If it changes the mode of its reactor, that holds for all reactors inside as well.
//! - A reaction that reads the clock is marked for this one time.
//! - What a marked reaction sets or schedules from then on has the mark.
//!
//! The driver knows what a value is, and writes it down. It asks for the inputs of a reaction
//! ([`Scheduler::inputs`]) before it runs the body: later, the value may have changed, since clones share
//! it.

use alloc::boxed::Box;
use alloc::collections::{BTreeSet, VecDeque};
use alloc::vec::Vec;

use super::{Body, Scheduled, Scheduler};
use crate::{
    ActionId, FederateId, ModeId, Origin, PortId, Program, ReactionId, ReactorId, Tag, Transition,
    Trigger,
};

/// What one reaction did at one tag.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct ReactionRecord<V> {
    /// The tag.
    pub tag: Tag,
    /// The reaction.
    pub reaction: ReactionId,
    /// Which of its bodies ran.
    pub body: Body,
    /// The tag that an input was meant for, if one was tardy.
    pub tardy: Option<Tag>,
    /// Whether it may depend on something that the program has read from the physical world.
    pub physical: bool,
    /// The ports that it set, each once and in their order, with their last values.
    pub ports: Vec<(PortId, V)>,
    /// The actions that it scheduled, in the order of its calls.
    pub actions: Vec<ScheduleRequest<V>>,
    /// The modes that it requested, in the order of its calls.
    pub modes: Vec<(ModeId, Transition)>,
    /// Whether it asked the program to stop.
    pub stops: bool,
    /// Whether it asked its federate to leave the program.
    pub leaves: bool,
}

/// The value at one of the triggers or sources of a reaction.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct InputValue<'a, V> {
    /// The port or the action.
    pub input: InputId,
    /// The value there; an action may have none.
    pub value: Option<&'a V>,
    /// Whether the port is absent, and remembers the value.
    pub remembered: bool,
}

/// What a reaction may read.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum InputId {
    /// A port that triggers it or is a source of it.
    Port(PortId),
    /// An action that triggers it.
    Action(ActionId),
}

/// An action that a reaction scheduled.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct ScheduleRequest<V> {
    /// The action.
    pub action: ActionId,
    /// The value for it.
    pub value: Option<V>,
    /// The result of the request.
    pub outcome: Scheduled,
}

/// Records, and what is marked.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Recorder<V> {
    /// The record of the running reaction; its ports have no values yet.
    open: Option<OpenRecord<V>>,
    complete: VecDeque<ReactionRecord<V>>,
    /// Roots whose values are marked at this tag.
    ports: BTreeSet<PortId>,
    /// Actions whose events are marked at this tag.
    present_actions: BTreeSet<ActionId>,
    /// Actions that have had marked events, which may have shifted later ones.
    actions: BTreeSet<ActionId>,
    /// Reactors whose state is marked.
    reactors: BTreeSet<ReactorId>,
    /// Whether the program's end is marked.
    stop: bool,
    /// Whether the clock has given tags to messages that no reaction reads.
    unread: bool,
}

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct OpenRecord<V> {
    record: ReactionRecord<V>,
    set: Vec<PortId>,
}

impl<V> Recorder<V> {
    const fn new() -> Self {
        Self {
            open: None,
            complete: VecDeque::new(),
            ports: BTreeSet::new(),
            present_actions: BTreeSet::new(),
            actions: BTreeSet::new(),
            reactors: BTreeSet::new(),
            stop: false,
            unread: false,
        }
    }

    #[cold]
    fn note_port(&mut self, port: PortId) {
        if let Some(open) = &mut self.open {
            open.set.push(port);
        }
    }

    #[cold]
    fn mark_port(&mut self, root: PortId) {
        self.ports.insert(root);
    }

    #[cold]
    fn marks_action(&mut self, action: ActionId, origin: Origin) -> bool {
        if origin == Origin::Physical || self.is_marked() {
            self.actions.insert(action);
        }
        self.actions.contains(&action)
    }

    #[inline]
    fn is_marked(&self) -> bool {
        self.open.as_ref().is_some_and(|open| open.record.physical)
    }
}

impl<V: Clone> Scheduler<V> {
    /// Records from now on what reactions do. To be called before the start.
    pub fn start_recording(&mut self) {
        self.recorder.get_or_insert_with(|| Box::new(Recorder::new()));
    }

    /// A reaction that has finished, if recording is on. Within a tag they come in the order in
    /// which they finished, which workers may change.
    pub fn poll_record(&mut self) -> Option<ReactionRecord<V>> {
        self.recorder.as_mut()?.complete.pop_front()
    }

    /// The values at the triggers and sources of a reaction that begins now: of those that are present, and
    /// of persistent ports that remember one. Each once, in the order of the program.
    #[must_use]
    pub fn inputs(&self, reaction: ReactionId) -> Vec<InputValue<'_, V>> {
        let spec = &self.program.reactions[reaction];
        let triggers = spec.triggers.iter().filter_map(|trigger| match *trigger {
            Trigger::Port(port) => Some(InputId::Port(port)),
            Trigger::Action(action) => Some(InputId::Action(action)),
            Trigger::Startup | Trigger::Shutdown | Trigger::Reset | Trigger::Timer(_) => None,
        });
        let mut inputs: Vec<InputId> =
            triggers.chain(spec.sources.iter().copied().map(InputId::Port)).collect();
        inputs.sort_unstable();
        inputs.dedup();
        let found = inputs.into_iter().filter_map(|input| match input {
            InputId::Port(port) => {
                let (value, remembered) = (self.latest(port)?, self.port(port).is_none());
                Some(InputValue { input, value: Some(value), remembered })
            }
            InputId::Action(action) => {
                Some(InputValue { input, value: self.action(action)?, remembered: false })
            }
        });
        found.collect()
    }

    /// Notes that the running reaction has read from the physical world, for example the clock.
    pub fn mark_physical(&mut self) {
        if let Some(open) = self.recorder.as_mut().and_then(|recorder| recorder.open.as_mut()) {
            open.record.physical = true;
        }
    }

    /// Whether the end of the program may depend on the physical world.
    #[must_use]
    pub fn stops_physically(&self) -> bool {
        self.recorder.as_ref().is_some_and(|recorder| recorder.stop)
    }

    // For the rest of the scheduler. All of these do nothing while recording is off.

    /// The running reaction begins.
    #[inline]
    pub(super) fn record_start(&mut self, reaction: ReactionId, body: Body) {
        if self.recorder.is_some() {
            self.open_record(reaction, body);
        }
    }

    #[cold]
    fn open_record(&mut self, reaction: ReactionId, body: Body) {
        let tardy = self.earliest_intended(reaction);
        let Some(recorder) = &mut self.recorder else { return };
        let spec = &self.program.reactions[reaction];
        let read = spec.triggers.iter().any(|trigger| match trigger {
            Trigger::Port(port) => recorder.ports.contains(&self.wiring.root(*port)),
            Trigger::Action(action) => recorder.present_actions.contains(action),
            _ => false,
        });
        let may_read =
            spec.sources.iter().any(|port| recorder.ports.contains(&self.wiring.root(*port)));
        if read || may_read {
            recorder.reactors.insert(spec.reactor);
        }
        let record = ReactionRecord {
            tag: self.tag,
            reaction,
            body,
            tardy,
            physical: recorder.reactors.contains(&spec.reactor),
            ports: Vec::new(),
            actions: Vec::new(),
            modes: Vec::new(),
            stops: false,
            leaves: false,
        };
        recorder.open = Some(OpenRecord { record, set: Vec::new() });
    }

    /// The running reaction has set a port.
    #[inline]
    pub(super) fn record_port(&mut self, port: PortId) {
        if let Some(recorder) = &mut self.recorder {
            recorder.note_port(port);
        }
    }

    /// The running reaction has scheduled an action.
    pub(super) fn record_action(&mut self, request: ScheduleRequest<V>) {
        if let Some(open) = self.recorder.as_mut().and_then(|recorder| recorder.open.as_mut()) {
            open.record.actions.push(request);
        }
    }

    /// The running reaction has requested a mode.
    pub(super) fn record_mode(&mut self, mode: ModeId, transition: Transition) {
        let Some(recorder) = &mut self.recorder else { return };
        let Some(open) = &mut recorder.open else { return };
        open.record.modes.push((mode, transition));
        if open.record.physical {
            let around = self.program.modes[mode].reactor;
            let inside =
                self.program.reactors.ids().filter(|r| is_within(&self.program, *r, around));
            recorder.reactors.extend(inside);
        }
    }

    /// The running reaction, or the driver, has requested the end.
    pub(super) fn record_stop(&mut self) {
        let Some(recorder) = &mut self.recorder else { return };
        if let Some(open) = &mut recorder.open {
            open.record.stops = true;
        }
        recorder.stop |= recorder.open.as_ref().is_none_or(|open| open.record.physical);
    }

    /// The running reaction has requested the end of its federate.
    pub(super) fn record_departure(&mut self) {
        let Some(recorder) = &mut self.recorder else { return };
        let Some(open) = &mut recorder.open else { return };
        open.record.leaves = true;
        if open.record.physical {
            let reactor = self.program.reactions[open.record.reaction].reactor;
            self.mark_departure(self.program.reactors[reactor].federate);
        }
    }

    /// The end of a federate depends on the physical world, and so do its reactions at the end.
    pub fn mark_departure(&mut self, federate: Option<FederateId>) {
        if let Some(recorder) = &mut self.recorder {
            let reactors = self.program.reactors.iter();
            let of_federate = reactors.filter(|(_, reactor)| reactor.federate == federate);
            recorder.reactors.extend(of_federate.map(|(id, _)| id));
        }
    }

    /// A message was sent that no reaction reads; `physical` if the clock gave it its tag.
    pub(super) fn record_unread(&mut self, physical: bool) {
        if let Some(recorder) = &mut self.recorder {
            recorder.unread |= physical;
        }
    }

    /// The program ends because nothing can happen any more.
    pub(super) fn record_starved(&mut self) {
        if let Some(recorder) = &mut self.recorder {
            recorder.stop |= recorder.unread;
        }
    }

    /// The running reaction has returned.
    #[inline]
    pub(super) fn record_finish(&mut self) {
        if self.recorder.is_some() {
            self.close_record();
        }
    }

    #[cold]
    fn close_record(&mut self) {
        let Some(recorder) = &mut self.recorder else { return };
        let Some(OpenRecord { mut record, mut set }) = recorder.open.take() else { return };
        set.sort_unstable();
        set.dedup();
        let values = set.into_iter().filter_map(|port| {
            let present = self.current.ports[self.wiring.root(port)].clone()?;
            Some((port, present))
        });
        record.ports = values.collect();
        recorder.complete.push_back(record);
    }

    /// The tag is complete.
    #[inline]
    pub(super) fn record_end(&mut self) {
        if let Some(recorder) = &mut self.recorder {
            recorder.ports.clear();
            recorder.present_actions.clear();
        }
    }

    // Marks.

    /// Whether the running reaction is marked.
    pub(super) fn is_marked(&self) -> bool {
        self.recorder.as_ref().is_some_and(|recorder| recorder.is_marked())
    }

    /// Whether an event of the action is marked that is scheduled now.
    #[inline]
    pub(super) fn marks_action(&mut self, action: ActionId) -> bool {
        match &mut self.recorder {
            Some(recorder) => recorder.marks_action(action, self.program.actions[action].origin),
            None => false,
        }
    }

    /// Marks the value at a root, if it is `physical` or replaces one that was.
    #[inline]
    pub(super) fn mark_port(&mut self, root: PortId, physical: bool) {
        if let Some(recorder) = self.recorder.as_mut().filter(|_| physical) {
            recorder.mark_port(root);
        }
    }

    /// Whether the value at a root is marked.
    #[inline]
    pub(super) fn is_port_marked(&self, root: PortId) -> bool {
        self.recorder.as_ref().is_some_and(|recorder| recorder.ports.contains(&root))
    }

    /// Marks an action that is present.
    #[inline]
    pub(super) fn mark_action(&mut self, action: ActionId) {
        if let Some(recorder) = &mut self.recorder {
            recorder.present_actions.insert(action);
        }
    }
}

/// Whether `reactor` is `around` or is inside it, at any depth.
fn is_within(program: &Program, reactor: ReactorId, around: ReactorId) -> bool {
    let mut here = Some(reactor);
    while let Some(reactor) = here {
        if reactor == around {
            return true;
        }
        here = program.reactors[reactor].parent;
    }
    false
}
