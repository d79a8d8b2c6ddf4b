//! Executing a program: one tag after the other, and within a tag by rank.
//!
//! The scheduler decides what runs at which tag, and in which order; it holds the values of ports
//! and actions while they are present. It does not run bodies, wait for physical time, or coordinate
//! with other federates: a driver does, in this order:
//!
//! ```text
//! start(at);  loop { g = next_tag(); (wait); begin(g);
//!                    while let Some((reaction, body)) = next_reaction(now) { run it; finish(reaction);
//!                        (while let Some(record) = poll_record() { … }) }
//!                    last = end(now);  while let Some(message) = poll_outbound() { … }
//!                    if last { break } }
//! ```
//!
//! A driver with several threads takes `next_turns` instead of `next_reaction`: all reactions that
//! may run at the same time. Each of them gets its own [`Effects`], which the driver commits.

use alloc::boxed::Box;
use alloc::collections::{BTreeMap, VecDeque};
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::mem;

use self::current_tag::CurrentTag;
use self::departures::Departures;
pub use self::effects::{Effects, Turn};
use self::modes::Modes;
use self::ready::Ready;
use self::record::Recorder;
use crate::bound::{BacklogWatch, Waiting};
use crate::order::{Batch, Position};
use crate::queue::{EventQueue, QueuedEvent};
use crate::wiring::{PortRoute, Wiring};
use crate::{
    ActionId, ChannelId, ConnectionId, Delay, FederateId, Nanos, PhysicalTime, PortId, Program,
    ReactionId, Reading, Scope, Table, Tag, Trigger,
};

mod current_tag;
mod departures;
mod effects;
mod kept;
mod messages;
mod modes;
mod ready;
mod record;
mod requests;
mod steps;

pub use record::{InputId, InputValue, ReactionRecord, ScheduleRequest};

/// Which of a reaction's bodies runs.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Body {
    /// The reaction itself.
    Main,
    /// Its deadline handler, instead: physical time is too far ahead of the tag.
    Deadline,
    /// Its tardy handler, instead: an input arrived too late for its tag.
    Tardy,
}

/// A value for another federate.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct OutboundMessage<V> {
    /// The channel on which it is sent.
    pub channel: ChannelId,
    /// The tag at the receiver; meaningless if the channel is physical.
    pub tag: Tag,
    /// The value.
    pub value: V,
    /// Whether it depends on the physical world; known only while reactions are recorded.
    pub physical: bool,
}

/// The result of a request to schedule an action.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Scheduled {
    /// The action will be present at this tag.
    At(Tag),
    /// It is too close to the latest event, and the action's policy is to drop it.
    Dropped,
    /// The program ends before that.
    AfterStop,
    /// Its mode is not active: the event waits until it is.
    Suspended,
}

/// Executes a program, or one federate's share of it.
///
/// `V` is a value: a Python object, a number in a simulation, anything.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Scheduler<V> {
    program: Arc<Program>,
    wiring: Arc<Wiring>,
    scope: Scope,
    start: PhysicalTime,
    /// The first tag: `START`, unless this federate has joined late.
    first: Tag,
    tag: Tag,
    /// The last tag that the program declares. Later events never happen, so they are dropped.
    timeout: Tag,
    /// The last tag here, as far as it is known: perhaps one on which the federates have agreed. Later
    /// events are kept, although they will not happen: so what reactions see until then does not depend on
    /// when this scheduler learns of the last tag.
    stop: Tag,
    /// The last tag of the program; after `stop`, if this federate leaves before the others.
    program_end: Tag,
    stop_requested: bool,
    departures: Departures,
    queue: EventQueue<V>,
    /// When the last message arrives that no reaction reads, for each federate that sends one.
    unread: BTreeMap<Option<FederateId>, Tag>,
    /// Empty, apart from the time in which the events of a tag are taken from the queue.
    taken_events: Vec<QueuedEvent<V>>,
    /// What is present at the current tag.
    current: CurrentTag<V>,
    /// What persistent ports remember.
    kept: BTreeMap<PortId, V>,
    /// The messages of physical connections with a bound.
    bounded: BTreeMap<ConnectionId, Waiting>,
    backlog_watch: BacklogWatch,
    /// The latest tag given to an event of each action.
    last_scheduled: Table<ActionId, Option<Tag>>,
    /// The deadlines in force: the declared ones, unless they have been changed.
    deadlines: Table<ReactionId, Option<Nanos>>,
    /// The value that the latest call to `schedule` removed from the queue.
    displaced: Option<V>,
    /// The latest tag given to a message of each connection.
    last_assigned: Table<ConnectionId, Tag>,
    ready: Ready,
    running: Option<ReactionId>,
    /// The intended tag of a tardy input that the running reaction did not handle.
    tardy: Option<Tag>,
    outbound: VecDeque<OutboundMessage<V>>,
    modes: Modes<V>,
    /// None while recording is off.
    recorder: Option<Box<Recorder<V>>>,
    /// What was scheduled since the driver last took this; none unless it has asked for that.
    schedule_log: Option<Vec<(ActionId, Scheduled)>>,
}

impl<V: Clone> Scheduler<V> {
    /// A scheduler for `scope` that has not started.
    #[must_use]
    pub fn new(program: Arc<Program>, scope: Scope) -> Self {
        let wiring = Arc::new(Wiring::new(&program, scope));
        let timeout = program.properties.timeout.map_or(Tag::FOREVER, |t| Tag::new(t.max(0), 0));
        Self {
            start: PhysicalTime(0),
            first: Tag::START,
            tag: Tag::NEVER,
            timeout,
            stop: timeout,
            program_end: timeout,
            stop_requested: false,
            departures: Departures::default(),
            queue: EventQueue::new(),
            unread: BTreeMap::new(),
            taken_events: Vec::new(),
            current: CurrentTag::new(program.ports.len(), program.actions.len()),
            kept: BTreeMap::new(),
            bounded: BTreeMap::new(),
            backlog_watch: BacklogWatch::new(),
            last_scheduled: Table::filled(program.actions.len(), None),
            deadlines: program.reactions.values().map(|reaction| reaction.deadline).collect(),
            displaced: None,
            last_assigned: Table::filled(program.connections.len(), Tag::NEVER),
            ready: Ready::new(wiring.order.len()),
            running: None,
            tardy: None,
            outbound: VecDeque::new(),
            modes: Modes::new(&program, &wiring),
            recorder: None,
            schedule_log: None,
            program,
            wiring,
            scope,
        }
    }

    // Getters.

    /// The program.
    #[must_use]
    pub fn program(&self) -> &Arc<Program> {
        &self.program
    }

    /// The current tag; `NEVER` before the first.
    #[must_use]
    pub fn tag(&self) -> Tag {
        self.tag
    }

    /// The last tag of the program, as far as it is known.
    #[must_use]
    pub fn stop_tag(&self) -> Tag {
        self.program_end
    }

    /// The physical time of tag zero.
    #[must_use]
    pub fn start_time(&self) -> PhysicalTime {
        self.start
    }

    /// The tag at which this scheduler's reactors start: tag zero, unless they belong to a federate
    /// that has joined late.
    #[must_use]
    pub fn first_tag(&self) -> Tag {
        self.first
    }

    /// The value at a port, if it is present.
    #[must_use]
    pub fn port(&self, port: PortId) -> Option<&V> {
        self.current.ports[self.wiring.root(port)].as_ref()
    }

    /// The tag that a message at the port was meant for, if it is tardy.
    #[must_use]
    pub fn intended_tag(&self, port: PortId) -> Option<Tag> {
        let root = self.wiring.root(port);
        let tardy = self.current.tardy_ports.iter().find(|(port, _)| *port == root);
        tardy.map(|(_, intended)| *intended)
    }

    /// Whether an event of the action is present, and its value.
    #[must_use]
    pub fn action(&self, action: ActionId) -> Option<Option<&V>> {
        self.current.actions[action].as_ref().map(Option::as_ref)
    }

    /// The earliest tag at which there is something to do. `FOREVER` if only physical actions and messages
    /// can cause events, which is possible if the program is kept alive.
    #[must_use]
    pub fn next_tag(&self) -> Tag {
        self.tag_of(self.next_event())
    }

    /// [`Self::next_tag`], if that is the [next event](Self::next_event).
    #[must_use]
    #[inline]
    pub fn tag_of(&self, next_event: Tag) -> Tag {
        next_event.min(self.stop)
    }

    /// The same without regard to the last tag of the program, at which there may be nothing but its end.
    #[must_use]
    #[inline]
    pub fn next_event(&self) -> Tag {
        if self.tag == Tag::NEVER {
            return self.first;
        }
        if self.modes.has_due() || self.departures.are_due() {
            return self.tag.succ();
        }
        self.pending().unwrap_or_else(|| match self.outlives_its_events() {
            true => Tag::FOREVER,
            false => self.tag.succ(),
        })
    }

    // Commands of the driver.

    /// Sets the physical time of tag zero and inserts the first events of timers.
    pub fn start(&mut self, at: PhysicalTime) {
        self.start_late(at, Tag::START);
    }

    /// The same for a federate that joins at the tag `first`: its timers count from there.
    pub fn start_late(&mut self, at: PhysicalTime, first: Tag) {
        assert_eq!(self.tag, Tag::NEVER, "a program starts once");
        self.start = at;
        self.first = first;
        let wiring = Arc::clone(&self.wiring);
        for timer in &wiring.timers {
            let at = match self.program.timers[*timer].offset.max(0) {
                0 => first,
                offset => Delay::Time(offset).shift(first),
            };
            self.start_timer(*timer, at);
        }
    }

    /// Advances to `tag`: makes its events present and queues the reactions that they trigger.
    ///
    /// # Panics
    ///
    /// If `tag` is not after the current one, or events before it would be skipped.
    pub fn begin(&mut self, tag: Tag) {
        assert!(tag > self.tag, "tags increase: {tag} after {}", self.tag);
        assert!(self.queue.first().is_none_or(|first| first >= tag), "an event would be skipped");
        let first = self.tag == Tag::NEVER;
        let starved = !first
            && self.pending().is_none()
            && !self.outlives_its_events()
            && !self.modes.has_due()
            && !self.departures.are_due();
        self.tag = tag;
        self.displaced = None;
        self.current.level = Some(0);
        if first {
            self.queue_startup();
        }
        if starved {
            self.end_at(tag);
            self.record_starved();
        }
        self.queue_due();
        let mut events = mem::take(&mut self.taken_events);
        self.queue.take(tag, &mut events);
        for event in &mut events {
            self.process_event(event);
        }
        events.clear();
        // What is replaced has no memory, so nothing has to look whether it should be freed.
        mem::forget(mem::replace(&mut self.taken_events, events));
        if tag >= self.stop {
            self.queue.truncate(Tag::NEVER);
            self.queue_shutdown(|_| true);
        } else if self.departures.are_due() {
            self.queue_departures();
        }
    }

    /// The next reaction to run at this tag and which of its bodies, given the physical time.
    /// None once the tag is complete.
    // Always inline: a call for each reaction would cost as much as the body of many.
    #[inline(always)]
    pub fn next_reaction(&mut self, now: impl Reading) -> Option<(ReactionId, Body)> {
        assert!(self.running.is_none(), "one reaction at a time");
        let position = self.ready.pop()?;
        let reaction = self.wiring.order.reaction(position);
        // True for nearly all reactions: they need no `Turn`.
        if self.current.tardy_ports.is_empty() && self.deadlines[reaction].is_none() {
            self.running = Some(reaction);
            self.record_start(reaction, Body::Main);
            return Some((reaction, Body::Main));
        }
        Some((reaction, self.take_turn_at(position, now)))
    }

    /// Begins the turn of the reaction at a position. Returns which of its bodies runs.
    #[inline(never)]
    fn take_turn_at(&mut self, position: Position, now: impl Reading) -> Body {
        let turn = self.turn(position, now);
        self.take_turn(&turn);
        turn.body
    }

    /// The reaction at a position, and how it runs.
    fn turn(&self, position: Position, now: impl Reading) -> Turn {
        let reaction = self.wiring.order.reaction(position);
        let tardy = self.earliest_intended(reaction);
        let (body, unhandled_tardy) =
            if tardy.is_some() && self.program.reactions[reaction].handles_tardy {
                (Body::Tardy, None)
            } else if self.deadlines[reaction].is_some()
                && self.program.reactions[reaction].deadline.is_some()
                && self.misses_deadline(reaction, now.read())
            {
                (Body::Deadline, tardy)
            } else {
                (Body::Main, tardy)
            };
        Turn { reaction, body, unhandled_tardy }
    }

    /// The earliest tag that a tardy trigger of the reaction was meant for.
    fn earliest_intended(&self, reaction: ReactionId) -> Option<Tag> {
        if self.current.tardy_ports.is_empty() {
            return None;
        }
        let triggers = self.program.reactions[reaction].triggers.iter();
        let intended = triggers.filter_map(|trigger| match trigger {
            Trigger::Port(port) => self.intended_tag(*port),
            _ => None,
        });
        intended.min()
    }

    /// Whether the deadline of a reaction, declared or set, has passed at the current tag. A deadline of
    /// zero always has.
    #[must_use]
    pub fn misses_deadline(&self, reaction: ReactionId, now: PhysicalTime) -> bool {
        self.deadlines[reaction].is_some_and(|deadline| self.is_late(deadline, now))
    }

    fn is_late(&self, deadline: Nanos, now: PhysicalTime) -> bool {
        deadline == 0 || now.since(self.start) > self.tag.time.saturating_add(deadline)
    }

    /// The tag that a tardy input of the running reaction was meant for, if the reaction has no
    /// handler for that.
    #[must_use]
    pub fn unhandled_tardy(&self) -> Option<Tag> {
        self.tardy
    }

    /// Reports that the running reaction has returned.
    #[inline]
    pub fn finish(&mut self, reaction: ReactionId) {
        assert!(self.running == Some(reaction), "the reaction that finishes is running");
        self.running = None;
        self.tardy = None;
        self.record_finish();
    }

    /// Completes the tag: sends what is present along delayed connections and to other federates,
    /// makes everything absent, and changes modes. Returns whether it was the last tag.
    pub fn end(&mut self, now: impl Reading) -> bool {
        assert!(self.running.is_none() && self.ready.is_empty(), "the tag is not complete");
        self.remember();
        self.send_present(now);
        self.current.clear();
        self.record_end();
        self.depart();
        self.change_modes();
        self.tag >= self.stop
    }

    /// Ends the program at `tag`, or at the next one if that has passed. An earlier end stands.
    pub fn set_stop(&mut self, tag: Tag) {
        self.end_at(tag.max(self.tag.succ()).max(self.first));
    }

    fn end_at(&mut self, tag: Tag) {
        self.program_end = self.program_end.min(tag);
        self.stop = self.stop.min(tag);
    }

    /// Whether a reaction has asked the federation to stop since this was last called.
    pub fn take_stop_request(&mut self) -> bool {
        mem::take(&mut self.stop_requested)
    }

    // Commands of a reaction.

    /// Sets a port. The last value set at a tag wins; an earlier one is returned.
    #[inline]
    pub fn set(&mut self, port: PortId, value: V) -> Option<V> {
        self.record_port(port);
        self.make_present(self.wiring.routes[port], value, self.tardy, self.is_marked())
    }

    // Internals.

    /// Takes the value out of an event. The event stays where it is, because most have nothing to be moved.
    #[inline]
    fn process_event(&mut self, event: &mut QueuedEvent<V>) {
        match event {
            QueuedEvent::Timer(timer) => {
                let timer = *timer;
                let period = self.program.timers[timer].period;
                if let Some(time) = self.tag.time.checked_add(period).filter(|_| period > 0) {
                    let next = Tag::new(time, 0);
                    if next <= self.timeout {
                        self.queue.insert_timer(next, timer);
                    }
                }
                self.queue_all(|wiring| &wiring.triggered_by_timer[timer]);
            }
            QueuedEvent::Action { action, value, physical } => {
                let (action, physical) = (*action, *physical);
                self.current.actions[action] = Some(value.take());
                self.current.present_actions.push(action);
                if physical {
                    self.mark_action(action);
                }
                self.queue_all(|wiring| &wiring.triggered_by_action[action]);
            }
            QueuedEvent::Message { connection, value, intended, physical } => {
                let Some(value) = value.take() else { return };
                let route = self.wiring.routes[self.program.connections[*connection].to];
                let earlier = self.make_present(route, value, *intended, *physical);
                assert!(earlier.is_none(), "two messages at one port and tag");
            }
        }
    }

    // For most values, a call would cost as much as the body.
    #[inline(always)]
    fn make_present(
        &mut self,
        PortRoute { root, triggers, has_relays, is_sent }: PortRoute,
        value: V,
        intended: Option<Tag>,
        physical: bool,
    ) -> Option<V> {
        let earlier = self.current.ports[root].replace(value);
        if intended.is_some() || !self.current.tardy_ports.is_empty() {
            self.note_tardy(root, intended);
        }
        self.mark_port(root, physical);
        if earlier.is_none() {
            self.current.present_ports.push(root);
            if is_sent {
                self.current.outbound_ports.push(root);
            }
            match triggers {
                Some(batch) => self.ready.add(batch),
                None => self.queue_readers(root),
            }
        }
        if has_relays {
            self.relay(root, intended, physical);
        }
        earlier
    }

    /// Notes the tag that the value at a root was meant for, if it is tardy.
    #[cold]
    fn note_tardy(&mut self, root: PortId, intended: Option<Tag>) {
        self.current.tardy_ports.retain(|(port, _)| *port != root);
        self.current.tardy_ports.extend(intended.map(|tag| (root, tag)));
    }

    /// Copies the value at a root along the connections of active modes.
    #[inline(never)]
    fn relay(&mut self, root: PortId, intended: Option<Tag>, physical: bool) {
        let wiring = Arc::clone(&self.wiring);
        for connection in &wiring.relays[root] {
            if self.modes.is_active(wiring.modes.of_connection[*connection])
                && let Some(value) = self.current.ports[root].clone()
            {
                let to = wiring.routes[self.program.connections[*connection].to];
                self.make_present(to, value, intended, physical);
            }
        }
    }

    /// The tag of the next event, unless a physical action or a message comes first. A message that no
    /// reaction reads counts if there is no other event.
    #[inline]
    fn pending(&self) -> Option<Tag> {
        match self.queue.first() {
            Some(first) if first <= self.stop => Some(first),
            _ if self.unread.is_empty() => None,
            _ => self.pending_unread(),
        }
    }

    #[inline(never)]
    fn pending_unread(&self) -> Option<Tag> {
        let unread = self.unread.values().copied();
        unread.filter(|unread| *unread > self.tag && *unread <= self.stop).max()
    }

    /// Whether the program goes on when its event queue is empty.
    fn outlives_its_events(&self) -> bool {
        self.program.properties.keepalive || self.scope != Scope::Whole
    }

    /// Queues the reactions that a value at a root triggers, where its route does not have them.
    #[inline(never)]
    fn queue_readers(&mut self, root: PortId) {
        self.queue_all(|wiring| &wiring.triggered_by_port[root]);
    }

    /// Queues the reactions that a present port, action or timer triggers, if their modes are active.
    #[inline]
    fn queue_all(&mut self, triggered: impl Fn(&Wiring) -> &[Batch]) {
        let wiring = &*self.wiring;
        let all_active = self.modes.all_active();
        for batch in triggered(wiring) {
            let runs = if all_active { *batch } else { self.modes.active_of(wiring, *batch) };
            self.ready.add(runs);
        }
    }
}
