//! A federate's side of the coordination: joining, advancing, exchanging messages, ending.
//!
//! One machine for both coordinations. What differs between them is in `centralized` and
//! `decentralized`; `startup` and `stop` keep the state of those phases. This file passes each
//! input to the code for it, which is in `starting`, `meeting`, `messages` and `ending`.

mod blockers;
mod elsewhere;
mod ending;
mod meeting;
mod messages;
mod posting;
mod starting;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use hprm_core::limits::FLOW_LIMIT;
use hprm_core::{
    ChannelId, Coordination, FederateId, Fingerprint, Nanos, PhysicalTime, Program, Tag,
};

use crate::centralized::Centralized;
use crate::decentralized::Decentralized;
use crate::federate::ending::Lingering;
use crate::federate::meeting::Meeting;
use crate::federate::posting::Showing;
use crate::flow::Flow;
use crate::startup::{EarlyMessage, Startup};
use crate::stop::Stop;
use crate::{
    Attempt, End, Fault, FederationId, Frame, HostId, Input, Output, PROTOCOL, Permission, Refusal,
    Step, Topology, log,
};

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
enum Coordinator {
    Centralized(Centralized),
    Decentralized(Decentralized),
}

/// What the scheduler does, by its last input to the machine.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum Activity {
    /// It has not reported its next event since its last tag.
    Unknown,
    /// It processes the current tag.
    Processing,
    /// It waits within the current tag, before this step.
    Within(Step),
    /// It is between tags, and this is the next one.
    Idle(Tag),
}

/// A federate's machine.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Federate {
    me: FederateId,
    topology: Arc<Topology>,
    /// The fingerprint of its program, for the RTI to compare.
    fingerprint: Arc<Fingerprint>,
    startup: Startup,
    coordinator: Coordinator,
    /// The boards in shared memory, if they say how far this federate may advance.
    showing: Option<Showing>,
    /// Whether tags begin before they are due.
    is_fast: bool,
    stop: Stop,
    activity: Activity,
    /// The latest tag that has begun.
    current: Tag,
    /// The tag at which this federate starts.
    first: Tag,
    /// Its last tag, if it leaves while the federation may go on.
    departure: Option<Tag>,
    /// Whether this federate has asked the RTI at which tag it may leave. It then leaves after the next tag
    /// that it completes, if that is before the RTI's tag.
    wants_to_leave: bool,
    /// Federates that have ended, or not joined yet.
    gone: BTreeSet<FederateId>,
    /// Federates that have sent their last frame on their direct links.
    resigned: BTreeSet<FederateId>,
    /// Federates to which this one opens direct links; the others open theirs.
    opened: BTreeSet<FederateId>,
    /// Federates whose direct links have ended without a `Resign` or cannot be opened. For each: until when
    /// this federate waits for the RTI to report its end, and why the link cannot be opened.
    broken_links: BTreeMap<FederateId, (PhysicalTime, Option<String>)>,
    /// Federates that have ended, in order or not, and whose direct links are still open; and until when they
    /// may stay open.
    lingering: BTreeMap<FederateId, Lingering>,
    /// How long the RTI has to explain why a direct link is broken.
    explanation: Nanos,
    /// Federates that are about to join, and about which this one has not answered the RTI yet.
    meeting: Meeting,
    /// Counts messages in transit to receivers and from senders.
    flow: Flow,
    /// The frame with which this federate asks to join.
    hello: Frame,
    /// Whether the link to the RTI is lost, and the driver opens another one.
    rti_link_lost: bool,
    /// Whether this federate has resigned or failed, or the RTI has told it to end. Then the machine ignores
    /// all inputs.
    ended: bool,
    outputs: VecDeque<Output>,
}

impl Federate {
    /// A federate that asks to join. `listen` is the address at which it accepts direct links; under
    /// decentralized coordination a federate with inputs needs one. `process` is a random number: no other
    /// process that joins has the same.
    #[must_use]
    pub fn new(
        me: FederateId,
        program: &Program,
        federation: FederationId,
        fingerprint: Arc<Fingerprint>,
        host: HostId,
        listen: Option<String>,
        process: u64,
    ) -> Self {
        let topology = Arc::new(Topology::new(program));
        let neighbours = topology.upstream(me).iter().chain(topology.downstream(me));
        let partners = neighbours.map(|edge| edge.federate).collect();
        let mut startup = Startup::new(federation, host, partners);
        let coordinator = match topology.coordination() {
            Coordination::Centralized => Coordinator::Centralized(Centralized::new(&topology, me)),
            Coordination::Decentralized => {
                startup.need_links();
                Coordinator::Decentralized(Decentralized::new(program, &topology, me))
            }
        };
        let hello = Frame::Hello {
            protocol: PROTOCOL,
            federation,
            fingerprint: fingerprint.digest(),
            federate: me,
            host,
            listen,
            attempt: Attempt { process, number: 0 },
            launched: false,
        };
        Self {
            me,
            flow: Flow::new(&topology, me, FLOW_LIMIT),
            topology,
            fingerprint,
            startup,
            coordinator,
            showing: None,
            is_fast: program.properties.fast,
            stop: Stop::Open,
            activity: Activity::Unknown,
            current: Tag::NEVER,
            first: Tag::START,
            departure: None,
            wants_to_leave: false,
            gone: BTreeSet::new(),
            resigned: BTreeSet::new(),
            opened: BTreeSet::new(),
            broken_links: BTreeMap::new(),
            lingering: BTreeMap::new(),
            explanation: ending::EXPLANATION,
            meeting: Meeting::default(),
            ended: false,
            outputs: VecDeque::from([Output::ToRti(hello.clone())]),
            rti_link_lost: false,
            hello,
        }
    }

    /// Has the RTI know whether the launcher of the federation has started this process, which has sent nothing so far.
    #[must_use]
    pub fn launched(mut self, is: bool) -> Self {
        if let Frame::Hello { launched, .. } = &mut self.hello {
            *launched = is;
        }
        self.outputs = VecDeque::from([Output::ToRti(self.hello.clone())]);
        self
    }

    /// Sets another limit for the bytes in transit to a receiver when a tag begins. The limit must be the same in
    /// all federates.
    #[must_use]
    pub fn with_flow_limit(mut self, bytes: u64) -> Self {
        self.flow = Flow::new(&self.topology, self.me, bytes);
        self
    }

    /// Messages are references to values of this process ([`Payload::reference`]): their values count as what lies in the object
    /// store.
    #[must_use]
    pub fn with_references(mut self) -> Self {
        self.flow.count_references();
        self
    }

    /// Sets how long the RTI has to explain why a direct link is broken, in nanoseconds, if what it says may take longer
    /// than usual to arrive: over relayed links, [`TOLD`](crate::relay::TOLD).
    #[must_use]
    pub fn with_explanation(mut self, limit: Nanos) -> Self {
        self.explanation = limit;
        self
    }

    // Getters.

    /// Which federate it is.
    #[must_use]
    pub fn me(&self) -> FederateId {
        self.me
    }

    /// Whether `tag` may begin, as far as other federates are concerned. The driver waits until it is
    /// due by the clock.
    #[must_use]
    pub fn permission(&self, tag: Tag, now: PhysicalTime) -> Permission {
        if self.stop.refuses(tag)
            || self.may_starve()
            || self.flow.is_ahead(tag)
            || self.flow.is_full()
        {
            return Permission::Wait;
        }
        let Some(start) = self.started() else {
            return Permission::Wait;
        };
        match &self.coordinator {
            Coordinator::Centralized(machine) if machine.is_stepwise() => {
                machine.permission(Step::begin(tag))
            }
            Coordinator::Centralized(machine) => machine.permission(Step::end(tag)),
            Coordinator::Decentralized(machine) => machine.may_begin(tag, now, start),
        }
    }

    /// Whether this federate has no more events, and perhaps no federate has. In that case the program ends for
    /// starvation before its timeout, so this federate must not begin the tag of the timeout.
    fn may_starve(&self) -> bool {
        self.activity == Activity::Idle(Tag::FOREVER)
            && self.topology.starves()
            && self.stop != Stop::Decided
    }

    /// Whether this federate goes through tags level by level: the driver asks [`Self::level_permission`] before each
    /// level, and tells the machine by [`Input::Reached`] how far the scheduler has come.
    #[must_use]
    pub fn is_stepwise(&self) -> bool {
        match &self.coordinator {
            Coordinator::Centralized(machine) => machine.is_stepwise(),
            Coordinator::Decentralized(machine) => machine.is_stepwise(),
        }
    }

    /// Whether the reactions of a level of the current tag may run, as far as other federates are
    /// concerned. Without a level: whether the federate may complete the tag.
    #[must_use]
    pub fn level_permission(&self, level: Option<u32>, now: PhysicalTime) -> Permission {
        self.step_permission(self.step(level), now)
    }

    fn step_permission(&self, step: Step, now: PhysicalTime) -> Permission {
        let Some(start) = self.started() else {
            return Permission::Wait;
        };
        match &self.coordinator {
            Coordinator::Centralized(machine) => machine.permission(step),
            Coordinator::Decentralized(machine) => machine.permission(step, now, start),
        }
    }

    /// The time of tag zero, once the federation has started and while no link is broken.
    fn started(&self) -> Option<PhysicalTime> {
        // Messages on a link that has broken may be lost, unless its other end has ended.
        let intact = !self.ended && self.broken_links.is_empty();
        self.startup.start().filter(|_| intact)
    }

    fn step(&self, level: Option<u32>) -> Step {
        Step { tag: self.current, level: level.unwrap_or(u32::MAX) }
    }

    /// When the machine wants an [`Input::Wake`], if nothing happens before.
    #[must_use]
    pub fn next_wakeup(&self) -> Option<PhysicalTime> {
        if self.ended {
            return None;
        }
        let report = match &self.coordinator {
            _ if self.startup.start().is_none() => None,
            Coordinator::Centralized(machine) => {
                let start = self.startup.start()?;
                self.next_step().and_then(|next| machine.next_wakeup(start, next))
            }
            Coordinator::Decentralized(machine) => {
                self.next_step().and_then(|next| machine.next_wakeup(next))
            }
        };
        let broken_links = self.broken_links.values().map(|(until, _)| *until).min();
        let lingering = self.lingering.values().map(|lingering| lingering.until).min();
        let times = [report, self.next_look(), broken_links, lingering].into_iter().flatten();
        times.filter(|time| *time < PhysicalTime::FOREVER).min()
    }

    /// Whether a peer runs on the same host: it can read objects of this store by reference.
    #[must_use]
    pub fn shares_memory_with(&self, peer: FederateId) -> bool {
        self.startup.shares_memory_with(peer)
    }

    /// Where a peer accepts direct links, and on which machine it gets shipments, as it says.
    #[must_use]
    pub fn listens_at(&self, peer: FederateId) -> Option<String> {
        self.startup.address(peer)
    }

    /// The federate that sends on a channel.
    #[must_use]
    pub fn sender(&self, channel: ChannelId) -> Option<FederateId> {
        self.topology.channels().get(channel).map(|channel| channel.from)
    }

    /// Whether a peer has not ended, as far as is known.
    #[must_use]
    pub fn is_live(&self, peer: FederateId) -> bool {
        !self.gone.contains(&peer)
    }

    /// What the machine wants done next, if anything.
    #[inline]
    pub fn poll(&mut self) -> Option<Output> {
        let output = self.outputs.pop_front()?;
        if log::is_on() {
            log::federate_output(&output);
        }
        Some(output)
    }

    /// Tells the machine at which tag the scheduler will process the message of the last
    /// [`Output::DeliverPhysical`]; none if never. The sender may wait until it is processed.
    pub fn assign_tag(&mut self, channel: ChannelId, tag: Option<Tag>) {
        self.flow.assign_tag(channel, tag);
    }

    // The handshake of direct links, which precedes `Input::PeerUp`.

    /// The first frame on a direct link that this side has opened; [`Frame::PeerWelcome`] answers.
    #[must_use]
    pub fn peer_hello(&self) -> Frame {
        self.startup.peer_hello(self.me)
    }

    /// From the first frame of a direct link: which federate has opened the link, and the answer to that frame.
    ///
    /// # Errors
    ///
    /// If the peer may not link to this federate. The driver should close the link.
    pub fn admit(&self, hello: &Frame) -> Result<(FederateId, Frame), Refusal> {
        let peer = self.startup.opener(hello)?;
        Ok((peer, Frame::PeerWelcome { federate: self.me }))
    }

    // Inputs.

    /// Tells the machine what has happened.
    ///
    /// # Errors
    ///
    /// If the input breaks the protocol. Nothing has changed; if it came from a link, that link
    /// should be closed.
    pub fn handle(&mut self, now: PhysicalTime, input: Input) -> Result<(), Fault> {
        if self.ended {
            // Whether others wait for what this federate has posted last, their boards tell.
            if let Input::Board { from, posting } = input {
                self.read_board(from, posting);
            }
            return Ok(());
        }
        if log::is_on() {
            log::federate_input(&input);
        }
        // The driver reads all that has come, and then says how far it is.
        let is_followed = matches!(input, Input::Board { .. } | Input::FromPeer { .. });
        match input {
            Input::FromRti(frame) => self.rti_frame(now, frame)?,
            // Most frames are messages, and on this way they are moved once.
            Input::FromPeer { from, frame: Frame::Message { channel, tag, payload } } => {
                self.peer_message(from, (channel, tag), payload)?;
            }
            Input::FromPeer { from, frame } => self.peer_frame(from, frame)?,
            Input::RtiLost => self.rti_lost(),
            Input::Rejoins => self.rejoin(),
            Input::PeerUp(peer) => {
                self.startup.link(peer);
                self.broken_links.remove(&peer);
                self.get_ready(now);
                self.link_is_up(peer);
            }
            Input::PeerLost(peer) => self.peer_lost(now, peer),
            Input::Unreachable { peer, reason } => self.unreachable(now, peer, reason),
            Input::Loaded => {
                self.startup.loaded();
                self.report_loaded();
                self.get_ready(now);
            }
            Input::NextEvent(tag) => {
                if !matches!(self.activity, Activity::Processing | Activity::Within(_)) {
                    // At its last tag the federate runs its shutdown reactions, even if the scheduler has no
                    // event there.
                    let next = tag.min(self.last_tag());
                    self.activity = Activity::Idle(next);
                    self.reached(next);
                }
            }
            Input::Reached(level) => self.passed_levels(now, self.step(level)),
            Input::Begun(tag) => {
                self.current = tag;
                self.activity = Activity::Processing;
            }
            Input::Completed(tag) => self.completed(now, tag),
            Input::Send { channel, tag, payload } => self.send(channel, tag, payload)?,
            Input::Release { owner, serials } => self.release(owner, &serials),
            Input::Segment { .. } | Input::Retired { .. } => self.tell_reader(input),
            Input::RequestStop => self.request_stop(),
            Input::Maxwait(maxwait) => {
                if let Coordinator::Decentralized(machine) = &mut self.coordinator
                    && self.showing.is_none()
                {
                    machine.set_maxwait(maxwait);
                }
            }
            Input::Depart => self.depart(Tag::START),
            Input::RequestDeparture => self.request_departure(),
            Input::Finished if self.departure.is_some() => self.resign(self.leave_frame()),
            Input::Finished => self.resign(Frame::Resign),
            Input::Leave => self.resign(self.leave_frame()),
            Input::Failed { message, code } => self.fail(message, code),
            Input::Board { from, posting } => self.read_board(from, posting),
            Input::Wake => self.apply_link_limits(now),
        }
        self.report(now);
        if !is_followed {
            self.look_at_boards(now);
        }
        Ok(())
    }

    fn rti_frame(&mut self, now: PhysicalTime, frame: Frame) -> Result<(), Fault> {
        let unexpected = Err(Fault::Unexpected { frame: frame.name() });
        match frame {
            Frame::Refused { reason } => self.end(End::Refused(reason)),
            Frame::Peers { peers, boards } if self.startup.awaits_peers() => {
                self.set_peers(peers);
                if boards {
                    self.use_boards();
                }
                self.connect();
                self.get_ready(now);
            }
            Frame::Start { at, first } if self.startup.awaits_start() => {
                self.begin(now, at, first);
            }
            Frame::Joining { peer } if !self.startup.awaits_peers() => self.peer_joining(now, peer),
            Frame::Board { owner, reader, notifier } if reader == self.me => {
                self.take_board(now, owner, notifier);
            }
            Frame::Departing { federate, .. } if federate == self.me => self.request_departure(),
            Frame::Departing { federate, incarnation } => self.peer_departs(federate, incarnation),
            Frame::Joined { federate, first } => self.joined(federate, first),
            Frame::Depart { tag } if self.startup.start().is_some() => {
                self.told_to_leave(now, tag);
            }
            Frame::TagAdvanceGrant { .. }
            | Frame::ProvisionalTagAdvanceGrant { .. }
            | Frame::DownstreamNextEventTag { .. }
            | Frame::Safe { .. } => return self.advance_frame(&frame),
            Frame::Message { channel, tag, payload } => {
                let spec = self.topology.channel(channel, None, Some(self.me))?;
                let Some(start) = self.startup.start() else {
                    return self.early(spec, EarlyMessage { channel, tag, payload });
                };
                if spec.physical {
                    self.deliver_physical(now.since(start), EarlyMessage { channel, tag, payload });
                } else if matches!(self.coordinator, Coordinator::Centralized(_)) {
                    self.deliver((channel, tag), payload);
                } else {
                    return unexpected;
                }
            }
            Frame::StopRequest { tag } => {
                let current = self.current.max(self.first.pred());
                if let Some(tag) = self.stop.reply(tag, current) {
                    self.outputs.push_back(Output::ToRti(Frame::StopReply { tag }));
                }
            }
            Frame::StopGranted { tag } => self.stop_at(tag),
            Frame::Gone { federate, in_order } => self.peer_gone(now, federate, in_order),
            Frame::ProgramRequest if self.startup.awaits_peers() => {
                let (name, facts) = (self.topology.name(self.me), self.fingerprint.report());
                self.outputs.push_back(Output::ToRti(Frame::ProgramReply { name, facts }));
            }
            Frame::Ping => self.outputs.push_back(Output::ToRti(Frame::Pong)),
            Frame::Failed { federate, message, code } => {
                self.end(End::Failed { federate, message, code });
            }
            frame => return self.member_frame(None, frame),
        }
        Ok(())
    }

    /// A frame of the RTI that permits the federate to advance, or says which reports the RTI does not need.
    fn advance_frame(&mut self, frame: &Frame) -> Result<(), Fault> {
        match (&mut self.coordinator, frame) {
            (Coordinator::Centralized(machine), Frame::TagAdvanceGrant { tag }) => {
                machine.grant(Step::end(*tag));
            }
            (Coordinator::Centralized(machine), Frame::ProvisionalTagAdvanceGrant { through })
                if machine.is_stepwise() =>
            {
                machine.grant(*through);
            }
            (Coordinator::Centralized(machine), Frame::DownstreamNextEventTag { tag, sent }) => {
                machine.skip_reports(*tag, *sent);
            }
            (Coordinator::Decentralized(machine), Frame::Safe { through }) => {
                machine.safe(*through);
            }
            _ => return Err(Fault::Unexpected { frame: frame.name() }),
        }
        Ok(())
    }

    fn peer_frame(&mut self, from: FederateId, frame: Frame) -> Result<(), Fault> {
        if !self.startup.is_linked(from) {
            return Err(Fault::UnknownLink);
        }
        match frame {
            Frame::PortAbsent { channel, tag } => {
                self.topology.channel(channel, Some(from), Some(self.me))?;
                if let Coordinator::Decentralized(machine) = &mut self.coordinator {
                    machine.absent(channel, tag);
                }
            }
            Frame::Resign => {
                self.resigned.insert(from);
                self.lingering.remove(&from);
                self.closed(from);
            }
            frame => return self.member_frame(Some(from), frame),
        }
        Ok(())
    }

    /// A frame of another federate, which comes through the RTI, or from the other end of a direct link.
    fn member_frame(&mut self, from: Option<FederateId>, frame: Frame) -> Result<(), Fault> {
        let is_from = |member| from.is_none_or(|from| from == member);
        match frame {
            Frame::Posting { owner, reader, posting } if is_from(owner) && reader == self.me => {
                self.take_posting(owner, posting)?;
            }
            Frame::Segment { owner, reader, segment, len }
                if is_from(owner) && reader == self.me =>
            {
                self.outputs.push_back(Output::Segment { owner, segment, len });
            }
            Frame::Retired { owner, reader, segments } if is_from(owner) && reader == self.me => {
                self.outputs.push_back(Output::Retired { owner, segments });
            }
            Frame::Release { owner, reader, serials } if owner == self.me && is_from(reader) => {
                self.outputs.push_back(Output::Released { reader, serials });
            }
            Frame::Processed { channel, messages, bytes } => {
                let reader = self.topology.channel(channel, Some(self.me), from)?.to;
                self.flow.processed(reader, channel, messages, bytes);
            }
            frame => return Err(Fault::Unexpected { frame: frame.name() }),
        }
        Ok(())
    }

    // Advancing.

    /// All levels of the current tag before a step are done.
    fn passed_levels(&mut self, now: PhysicalTime, next: Step) {
        self.learn_from_boards();
        if let Some(level) = self.report_absent_ports(next, now) {
            self.outputs.push_back(Output::Passed(level));
        }
        self.activity = match self.step_permission(next, now) {
            Permission::Granted => Activity::Processing,
            Permission::Wait | Permission::WaitUntil(_) => Activity::Within(next),
        };
    }

    fn completed(&mut self, now: PhysicalTime, tag: Tag) {
        self.activity = Activity::Unknown;
        for (sender, report) in self.flow.completed(tag) {
            self.route(sender, report);
        }
        self.report_absent_ports(Step::end(tag), now);
        if let Coordinator::Centralized(machine) = &mut self.coordinator
            && machine.completed(tag)
        {
            self.outputs.push_back(Output::ToRti(Frame::LatestTagConfirmed { tag }));
        }
        if std::mem::take(&mut self.wants_to_leave) && tag < self.last_tag() {
            self.depart(Tag::START);
        }
    }

    /// The step that the scheduler wants to take next, if it has reported that.
    fn next_step(&self) -> Option<Step> {
        match self.activity {
            Activity::Unknown | Activity::Processing => None,
            Activity::Idle(tag) => Some(Step::begin(tag)),
            Activity::Within(step) => Some(step),
        }
    }

    /// All steps before `next` are done: tells the other federates of a cycle without delay which channels to
    /// them carry no message at the current tag. Returns the last level through which that is said.
    fn report_absent_ports(&mut self, next: Step, now: PhysicalTime) -> Option<u32> {
        let (Coordinator::Decentralized(machine), Some(start)) =
            (&mut self.coordinator, self.startup.start())
        else {
            return None;
        };
        let (absent, last) = machine.absent_channels(next, now, start);
        for (to, channel) in absent {
            if self.startup.is_linked(to) {
                let frame = Frame::PortAbsent { channel, tag: next.tag };
                self.outputs.push_back(Output::ToPeer { to, frame });
            }
        }
        last
    }

    /// Reports the next event to the RTI, if the scheduler has reported it and the RTI needs to know.
    fn report(&mut self, now: PhysicalTime) {
        let (Some(next), Some(start)) = (self.next_step(), self.startup.start()) else {
            return;
        };
        if self.ended {
            return;
        }
        let frame = match &mut self.coordinator {
            Coordinator::Centralized(machine) => machine.report(now, start, self.current, next),
            Coordinator::Decentralized(machine) => {
                let report = machine.report(now, start, self.current, next);
                report.map(|(next, counts)| Frame::Progress { next, counts })
            }
        };
        if let Some(frame) = frame {
            self.outputs.push_back(Output::ToRti(frame));
        }
    }
}
