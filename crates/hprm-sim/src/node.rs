//! One federate of the world: its machine, its scheduler, and the loop between them.
//!
//! It does what a driver does: it handles all inputs, reports the next event, asks whether the tag may
//! begin, and processes it.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::hash::{Hash, Hasher};
use std::sync::Arc;

use hprm_core::limits::FLOW_LIMIT;
use hprm_core::{
    Action, ChannelId, FederateId, Fingerprint, Nanos, Origin, Payload, PhysicalTime, Program,
    Scheduled, Scheduler, Scope, Table, Tag,
};
use hprm_federated::relay::TOLD;
use hprm_federated::{
    End, Fault, Federate, FederationId, HostId, Input, LinkId, Output, Permission,
};

use crate::behaviour::{run, run_level};
use crate::direct_links::DirectLinks;
use crate::explained::{Asked, Moment, Seen};
use crate::mailboxes::Mailboxes;
use crate::network::Instance;
use crate::patience::Patience;
use crate::plan::{Ending, Life};
use crate::{Log, Plan};

/// How far an attempt to advance has got.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Turn {
    /// A tag is complete.
    Done,
    /// It may not go on before that time, or for all it knows never, unless something arrives.
    Waits(Option<PhysicalTime>),
}

/// Notes of an observer about a federate; states that differ only in them are equal.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Noted(pub(crate) Nanos);

impl PartialEq for Noted {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Eq for Noted {}

impl Hash for Noted {
    fn hash<H: Hasher>(&self, _: &mut H) {}
}

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Node {
    pub(crate) me: Instance,
    pub(crate) machine: Federate,
    /// How many links to the RTI it has had before its current one.
    links: u32,
    /// Its direct links.
    pub(crate) direct_links: DirectLinks,
    scheduler: Scheduler<u64>,
    pub(crate) log: Log,
    /// Logical messages sent, by receiver and tag.
    pub(crate) sent: Table<FederateId, BTreeMap<Tag, usize>>,
    /// Logical messages that have arrived, by tag.
    pub(crate) received: BTreeMap<Tag, usize>,
    /// The same messages by channel and tag, in a program with transient federates.
    pub(crate) arrivals: Vec<(ChannelId, Tag)>,
    /// Tardy messages.
    pub(crate) tardy: usize,
    /// By how much, at most, a tag has begun after it was due.
    pub(crate) lag: Noted,
    keeps_arrivals: bool,
    start: Option<PhysicalTime>,
    /// The federates that had no process when it started.
    without: Vec<FederateId>,
    /// Whether the scheduler is within a tag.
    open: bool,
    /// Outputs that the network has to carry out.
    pub(crate) outputs: VecDeque<Output>,
    /// It asks to stop when it has processed this tag or a later one.
    stop_after: Option<Tag>,
    leaves: Vec<(FederateId, Tag)>,
    pub(crate) patience: Patience,
    mailboxes: Mailboxes,
    pub(crate) finished: bool,
    pub(crate) ended: Option<End>,
    pub(crate) crashed: bool,
    /// Whether the RTI has closed its link: the others go on without it, and may agree on a last tag that it has passed.
    pub(crate) given_up: bool,
    /// Its next wake-up; later wake-ups are void.
    pub(crate) wake: Option<PhysicalTime>,
    launch: Launch,
}

/// What a process is launched with.
#[derive(Clone, PartialEq, Eq, Debug)]
struct Launch {
    federation: FederationId,
    fingerprint: Arc<Fingerprint>,
    flow_limit: u64,
    /// Processes that users start.
    by_hand: BTreeSet<Instance>,
    host: HostId,
    /// How long the RTI has to explain why a direct link is broken, if not as long as usual.
    explanation: Option<Nanos>,
}

/// It never changes, so states are told apart without it.
impl Hash for Launch {
    fn hash<H: Hasher>(&self, _: &mut H) {}
}

impl Launch {
    /// The machine of a federate whose process has just been launched.
    fn machine(&self, me: Instance, program: &Program) -> Federate {
        let (listen, fingerprint) = (Some(me.address()), Arc::clone(&self.fingerprint));
        let (federation, process) = (self.federation, u64::from(me.link(0).0));
        let machine = Federate::new(
            me.federate,
            program,
            federation,
            fingerprint,
            self.host,
            listen,
            process,
        )
        .with_flow_limit(self.flow_limit)
        .launched(!self.by_hand.contains(&me));
        match self.explanation {
            Some(limit) => machine.with_explanation(limit),
            None => machine,
        }
    }
}

impl Node {
    pub(crate) fn new(
        me: Instance,
        program: &Arc<Program>,
        (federation, fingerprint): (FederationId, &Arc<Fingerprint>),
        plan: &Plan,
    ) -> Self {
        let launch = Launch {
            federation,
            fingerprint: Arc::clone(fingerprint),
            flow_limit: plan.flow_limit.unwrap_or(FLOW_LIMIT),
            by_hand: plan.by_hand.clone(),
            host: host(me.federate, plan),
            explanation: plan.machines.as_ref().map(|_| TOLD),
        };
        let stop = plan.stop.filter(|(federate, _)| *federate == me.federate && me.life == 0);
        Self {
            me,
            machine: launch.machine(me, program),
            links: 0,
            direct_links: DirectLinks::default(),
            scheduler: Scheduler::new(Arc::clone(program), Scope::Federate(me.federate)),
            log: Log::new(program),
            sent: Table::filled(program.federates.len(), BTreeMap::new()),
            received: BTreeMap::new(),
            arrivals: Vec::new(),
            tardy: 0,
            lag: Noted(0),
            keeps_arrivals: program.federates.values().any(|federate| federate.transient),
            start: None,
            without: Vec::new(),
            open: false,
            outputs: VecDeque::new(),
            stop_after: stop.map(|(_, tag)| tag),
            leaves: plan.leaves.clone(),
            patience: Patience::new(program, me.federate, plan),
            mailboxes: Mailboxes::default(),
            finished: false,
            ended: None,
            crashed: false,
            given_up: false,
            wake: None,
            launch,
        }
    }

    /// The same federate in a new process, for one that has ended before the start: nothing of what it
    /// does at its tags has begun.
    pub(crate) fn again(&self, me: Instance) -> Self {
        Self {
            me,
            machine: self.launch.machine(me, self.program()),
            links: 0,
            direct_links: DirectLinks::default(),
            open: false,
            outputs: VecDeque::new(),
            ended: None,
            crashed: false,
            wake: None,
            ..self.clone()
        }
    }

    /// Its link to the RTI.
    pub(crate) fn link(&self) -> LinkId {
        self.me.link(self.links)
    }

    /// It opens another link to the RTI.
    pub(crate) fn reconnect(&mut self) {
        self.links += 1;
    }

    pub(crate) fn is_over(&self) -> bool {
        self.finished || self.ended.is_some() || self.crashed
    }

    /// What is wrong with how it keeps the bounds of physical connections, if anything.
    pub(crate) fn wrong_bound(&self) -> Option<String> {
        self.mailboxes.wrong(&self.scheduler)
    }

    /// Whether it has started and may do something.
    pub(crate) fn is_running(&self) -> bool {
        self.start.is_some() && !self.is_over()
    }

    pub(crate) fn program(&self) -> &Arc<Program> {
        self.scheduler.program()
    }

    /// Schedules the federate's physical action, as another thread would. Returns for when.
    pub(crate) fn happen(&mut self, now: PhysicalTime) -> Result<Option<Tag>, Fault> {
        let scheduled = schedule(&mut self.scheduler, self.me.federate, now);
        if !self.open {
            let next = self.scheduler.next_event();
            self.input(now, Input::NextEvent(next))?;
        }
        Ok(scheduled)
    }

    /// The last tag of the program, as far as this federate knows.
    pub(crate) fn stop_tag(&self) -> Tag {
        self.scheduler.stop_tag()
    }

    /// Whether it left before the others.
    pub(crate) fn has_left(&self) -> bool {
        self.finished && self.scheduler.leaves_early()
    }

    /// How many messages of these federates did not arrive that this one had to get; if it has left, before it left.
    pub(crate) fn missed_of<'a>(&self, senders: impl Iterator<Item = &'a Self>) -> usize {
        let last = if self.has_left() { self.last_tag() } else { Tag::FOREVER };
        let until = |counts: &BTreeMap<Tag, usize>| -> usize {
            counts.range(..=last).map(|(_, n)| n).sum()
        };
        let sent: usize = senders.map(|node| until(&node.sent[self.me.federate])).sum();
        // A successor may get what its predecessor did not.
        sent.saturating_sub(until(&self.received))
    }

    /// The tag at which it starts; zero, as long as that is not known.
    pub(crate) fn first_tag(&self) -> Tag {
        self.scheduler.first_tag()
    }

    pub(crate) fn last_tag(&self) -> Tag {
        self.scheduler.tag()
    }

    /// The record of the process, if it has started.
    pub(crate) fn life(self) -> Option<Life> {
        self.start?;
        let end = match (self.finished, self.open) {
            (true, _) if self.given_up => Ending::GivenUp,
            (true, _) => Ending::InOrder,
            (false, false) => Ending::Between,
            (false, true) => Ending::Within,
        };
        let Instance { federate, .. } = self.me;
        let (first, last) = (self.scheduler.first_tag(), self.scheduler.tag());
        let Self { without, log, arrivals, .. } = self;
        Some(Life { federate, first, without, last, end, log, arrivals })
    }

    /// Takes an input.
    pub(crate) fn input(&mut self, now: PhysicalTime, input: Input) -> Result<(), Fault> {
        self.machine.handle(now, input)?;
        self.drain(now);
        Ok(())
    }

    /// Carries out what concerns the scheduler.
    pub(crate) fn drain(&mut self, now: PhysicalTime) {
        while let Some(output) = self.machine.poll() {
            match output {
                Output::Start { at, first } => {
                    self.start = Some(at);
                    let federates = self.scheduler.program().federates.ids();
                    self.without = federates.filter(|it| !self.machine.is_live(*it)).collect();
                    self.scheduler.start_late(at, first);
                }
                Output::Deliver { channel, tag, payload } => {
                    *self.received.entry(tag).or_default() += 1;
                    if self.keeps_arrivals {
                        self.arrivals.push((channel, tag));
                    }
                    let taken = self.scheduler.deliver(channel, tag, value(&payload), false);
                    let late = taken.map_or(tag <= self.scheduler.tag(), |taken| taken != tag);
                    self.tardy += usize::from(late);
                    if late {
                        self.note_late(now, (channel, tag, taken));
                    }
                }
                Output::DeliverPhysical { channel, payload, .. } => {
                    let tag = self.scheduler.deliver_physical(channel, now, value(&payload));
                    self.machine.assign_tag(channel, tag);
                    self.mailboxes.arrived(&self.scheduler, channel, tag);
                }
                Output::Passed(level) => self.scheduler.pass(level),
                Output::SetStop(tag) => self.scheduler.set_stop(tag),
                Output::LeaveAt(tag) => self.scheduler.leave_at(tag),
                Output::Ended { reason } => self.ended = Some(reason),
                output => {
                    if let Output::ReaderGone(peer) = &output {
                        self.mailboxes.sender_gone(self.scheduler.program(), *peer);
                    }
                    self.outputs.push_back(output);
                }
            }
        }
    }

    fn note_late(&mut self, now: PhysicalTime, message: (ChannelId, Tag, Option<Tag>)) {
        let Some(start) = self.start else { return };
        let current = self.scheduler.tag();
        self.patience.came_late(message, current, (now, current.due(start)));
    }

    /// What is wrong with what the federate says it waits for, if anything.
    pub(crate) fn wrong_blockers(&self, now: PhysicalTime, seen: &mut Seen) -> Option<String> {
        let start = self.start.filter(|_| !self.is_over())?;
        let asked = match self.open {
            true => Asked::Level(self.scheduler.next_level()),
            false => Asked::Tag(self.scheduler.next_tag()),
        };
        let (program, machine) = (self.program(), &self.machine);
        Moment { program, machine, asked, start, now }.wrong(seen)
    }

    /// The next wake-up of its machine.
    pub(crate) fn wakeup(&self) -> Option<PhysicalTime> {
        self.machine.next_wakeup().filter(|_| !self.is_over())
    }

    /// Processes tags as far as it may. Returns the next wake-up.
    pub(crate) fn advance(&mut self, now: PhysicalTime) -> Result<Option<PhysicalTime>, Fault> {
        loop {
            match self.advance_once(now)? {
                Turn::Done => {}
                Turn::Waits(until) => return Ok(until),
            }
        }
    }

    /// Processes one tag, or the rest of one, as far as it may.
    pub(crate) fn advance_once(&mut self, now: PhysicalTime) -> Result<Turn, Fault> {
        if self.wakeup().is_some_and(|wakeup| wakeup <= now) {
            self.input(now, Input::Wake)?;
        }
        let Some(start) = self.start.filter(|_| !self.is_over()) else {
            // The machine may wait too long for a link or an answer before the start, too.
            return Ok(Turn::Waits(self.wakeup()));
        };
        if !self.open {
            self.input(now, Input::NextEvent(self.scheduler.next_event()))?;
            let tag = self.scheduler.next_tag();
            let due = tag.due(start);
            let permission = self.machine.permission(tag, now);
            self.patience.asked_to_begin(tag, due, permission);
            let until = match permission {
                Permission::Granted => due,
                Permission::WaitUntil(until) => until.max(due),
                Permission::Wait => PhysicalTime::FOREVER,
            };
            if until > now {
                let wakeup = self.machine.next_wakeup();
                let until = wakeup.map_or(until, |wakeup| wakeup.min(until));
                return Ok(Turn::Waits(Some(until).filter(|until| *until < PhysicalTime::FOREVER)));
            }
            self.scheduler.begin(tag);
            self.mailboxes.began(&self.scheduler, tag);
            self.patience.began();
            self.lag.0 = self.lag.0.max(now.since(due));
            self.open = true;
            self.input(now, Input::Begun(tag))?;
        }
        if self.go_on(now)? {
            return Ok(Turn::Done);
        }
        let until = match self.machine.level_permission(self.scheduler.next_level(), now) {
            Permission::WaitUntil(until) => Some(until),
            Permission::Granted | Permission::Wait => None,
        };
        Ok(Turn::Waits(self.machine.next_wakeup().into_iter().chain(until).min()))
    }

    /// Processes the rest of the current tag as far as it may. Returns whether that was all.
    fn go_on(&mut self, now: PhysicalTime) -> Result<bool, Fault> {
        while self.machine.is_stepwise() {
            let level = self.scheduler.next_level();
            self.input(now, Input::Reached(level))?;
            let permission = self.machine.level_permission(level, now);
            let at = self.scheduler.tag();
            let due = at.due(self.scheduler.start_time());
            self.patience.asked_to_pass((at, level), due, permission);
            if permission != Permission::Granted {
                return Ok(false);
            }
            let Some(level) = level else { break };
            run_level(&mut self.scheduler, now, level, &self.leaves, &mut self.log);
            self.scheduler.pass(level);
            self.send(now)?;
        }
        let tag = self.scheduler.tag();
        run(&mut self.scheduler, now, &self.leaves, &mut self.log);
        let last = self.scheduler.end(now);
        self.open = false;
        self.send(now)?;
        if self.stop_after.take_if(|after| tag >= *after).is_some() {
            self.input(now, Input::RequestStop)?;
        }
        self.input(now, Input::Completed(tag))?;
        if let Some(maxwait) = self.patience.completed(tag) {
            self.input(now, Input::Maxwait(maxwait))?;
        }
        if self.scheduler.take_departure() && !last {
            self.input(now, Input::Depart)?;
        }
        if last {
            self.input(now, Input::Finished)?;
            self.finished = true;
        }
        Ok(true)
    }

    fn send(&mut self, now: PhysicalTime) -> Result<(), Fault> {
        while let Some(message) = self.scheduler.poll_outbound() {
            let channel = self.scheduler.program().channels[message.channel];
            if !channel.physical {
                *self.sent[channel.to].entry(message.tag).or_default() += 1;
            }
            let payload =
                Payload { head: message.value.to_le_bytes().to_vec(), ..Payload::default() };
            self.input(now, Input::Send { channel: message.channel, tag: message.tag, payload })?;
        }
        Ok(())
    }
}

/// The machine of a federate, as it tells others.
fn host(federate: FederateId, plan: &Plan) -> HostId {
    let Some(machines) = &plan.machines else { return HostId(1) };
    let machine = HostId(2 * machines.of(federate) as u128);
    match machines.is_at_rti(federate) {
        true => machine.joined_over_unix_socket(),
        false => machine.joined_over_tcp(),
    }
}

/// Schedules the physical action of a federate. Returns for when, if it has one and it will happen.
pub(crate) fn schedule(
    scheduler: &mut Scheduler<u64>,
    federate: FederateId,
    now: PhysicalTime,
) -> Option<Tag> {
    let program = Arc::clone(scheduler.program());
    let is_here = |action: &Action| {
        let at = program.reactors[action.reactor].federate;
        action.origin == Origin::Physical && at == Some(federate)
    };
    let (action, _) = program.actions.iter().find(|(_, action)| is_here(action))?;
    match scheduler.schedule(action, 0, Some(EVENT), now) {
        Scheduled::At(tag) => Some(tag).filter(|tag| *tag <= scheduler.stop_tag()),
        Scheduled::Dropped | Scheduled::AfterStop | Scheduled::Suspended => None,
    }
}

/// The value of a physical action, which reactions may forward often enough.
const EVENT: u64 = 0xabc7;

fn value(payload: &Payload) -> u64 {
    let bytes = payload.head.as_slice().try_into().expect("a simulated value has eight bytes");
    u64::from_le_bytes(bytes)
}
