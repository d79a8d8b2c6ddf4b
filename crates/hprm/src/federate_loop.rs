//! Running one federate: one loop, run to completion.
//!
//! ```text
//! read every link -> machine -> deliver;  next tag -> machine -> permission?
//!     yes: run the tag, hand its messages to the machine;  no: write, then wait
//! ```
//!
//! The loop owns the links, the store and the clock, and decides nothing: the scheduler says which tag is next,
//! and the federate's machine whether that tag may begin.

mod links;
mod membership;
mod objects;
mod openings;
mod pace;
mod reach;
mod search;
mod time;

use std::mem;
use std::sync::Arc;

use hprm_core::{
    ChannelId, FederateId, OutboundMessage, Payload, PhysicalTime, Program, Scheduler, Scope, Tag,
};
use hprm_federated::{End, Frame, Input, Output, Permission};

use crate::link::Network;
use crate::link::descriptors::no_notifier;
use crate::log::log_names;
use crate::trace::Trace;
use crate::workers::Workers;
use crate::{Clock, Failure, Host, Inbox, Report, ValueExchange, enter_realtime};
pub use membership::FederateOptions;
pub use reach::Reach;

use links::LinkSerial;
use membership::Membership;
use objects::Changes;
use pace::{LINGER, Pace, Used};

/// Runs a federate to its end. `load` makes the host; it is called once the federate has joined, so
/// that all federates load at the same time, and the federate reports any failure from then on to the RTI.
///
/// # Errors
///
/// What a reaction raised, or why the federation ended. A failure that another federate has
/// reported has an empty message.
pub fn run_federate<H: Host>(
    options: &FederateOptions,
    inbox: &Inbox<H::Value>,
    load: impl FnOnce() -> Result<H, Failure>,
) -> Result<(), Failure>
where
    H::Value: Send + Sync + 'static,
{
    run(options, None, inbox, load)
}

/// Runs a federate to its end, as [`run_federate`] does, whose federation is in this process: in
/// `exchange`, and so is its RTI.
///
/// # Errors
///
/// As [`run_federate`].
pub fn run_federate_in<H: Host>(
    options: &FederateOptions,
    exchange: &ValueExchange<H::Value>,
    inbox: &Inbox<H::Value>,
    load: impl FnOnce() -> Result<H, Failure>,
) -> Result<(), Failure>
where
    H::Value: Send + Sync + 'static,
{
    let outcome = run(options, Some(exchange), inbox, load);
    exchange.clear(options.federate);
    outcome
}

fn run<H: Host>(
    options: &FederateOptions,
    exchange: Option<&ValueExchange<H::Value>>,
    inbox: &Inbox<H::Value>,
    load: impl FnOnce() -> Result<H, Failure>,
) -> Result<(), Failure>
where
    H::Value: Send + Sync + 'static,
{
    if exchange.is_none() {
        log_names(&options.program);
    }
    let network = match exchange {
        Some(exchange) => exchange.network(),
        None => Network::sockets().map_err(|error| no_notifier(&error))?,
    };
    let properties = &options.program.properties;
    enter_realtime(properties, Some(options.federate.index()))?;
    let mut federation = Membership::join(options, inbox, network)?;
    let scope = Scope::Federate(options.federate);
    let made = load().and_then(|host| {
        let trace = options.trace.as_deref().map(|path| Trace::create(path, &options.program));
        Ok((host, Workers::new(&options.program, scope, trace.transpose()?)?))
    });
    let (host, workers) = match made {
        Ok(made) => made,
        Err(failure) => return Err(federation.fail(failure)),
    };
    let mut federate = FederateLoop {
        scheduler: Scheduler::new(Arc::clone(&options.program), scope),
        workers,
        now: Clock::now(),
        inbox,
        host,
        federation,
        exchange: exchange.cloned(),
        phase: Phase::Joining,
        loaded: false,
        interrupted: false,
        inputs: Vec::new(),
        looked_at: PhysicalTime(0),
        pace: Pace::new(),
    };
    if federate.exchange.is_none() {
        federate.host.furnish(federate.federation.objects.allocator());
    }
    if options.trace.is_some() {
        federate.scheduler.start_recording();
    }
    let outcome = federate.run();
    inbox.close();
    federate.workers.report_dropped(&federate.scheduler, &mut federate.host);
    federate.leave(outcome)
}

struct FederateLoop<'a, H: Host> {
    scheduler: Scheduler<H::Value>,
    workers: Workers<H::Value>,
    /// The time at which this round of the loop has read the clock.
    now: PhysicalTime,
    inbox: &'a Inbox<H::Value>,
    host: H,
    federation: Membership,
    /// Holds the values of messages, if the federation is in this process.
    exchange: Option<ValueExchange<H::Value>>,
    phase: Phase,
    /// Whether the machine knows that this federate is ready to start.
    loaded: bool,
    interrupted: bool,
    /// What has come over links. Empty between rounds; its memory is used again.
    inputs: Vec<(LinkSerial, Input)>,
    /// When the loop last looked at the links: it has read what had come by then.
    looked_at: PhysicalTime,
    /// Decides whether messages may wait for more of them.
    pace: Pace,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Phase {
    /// Waiting for the start time.
    Joining,
    /// Between tags.
    Running,
    /// Within a tag.
    Processing,
    /// The last tag is complete.
    Done,
}

impl<H: Host> FederateLoop<'_, H>
where
    H::Value: Send + Sync,
{
    fn run(&mut self) -> Result<(), Failure> {
        let mut moved = false;
        while self.phase != Phase::Done {
            self.compare_clocks();
            // Before the inbox: an action that is scheduled from now on has a later time, so what the machine
            // promises to other federates by this reading of the clock stays true.
            let before = mem::replace(&mut self.now, Clock::now());
            if moved {
                self.pace.took(self.now.since(before), Used::by_this_thread);
            }
            self.read_inbox()?;
            self.read_links()?;
            self.get_ready()?;
            self.send_releases()?;
            self.handle(Input::Wake)?;
            moved = match self.phase {
                Phase::Running => self.step()?,
                Phase::Processing => self.go_on()?,
                Phase::Joining | Phase::Done => false,
            };
            if !moved && self.phase != Phase::Done {
                self.flush();
                self.wait();
            }
        }
        Ok(())
    }

    /// Ends in order or with a failure, and tells the federation which.
    fn leave(mut self, outcome: Result<(), Failure>) -> Result<(), Failure> {
        let traced = self.end_trace(&outcome);
        match Failure::or_untraced(outcome, traced) {
            Ok(()) => {
                self.federation.say_goodbye();
                match self.interrupted {
                    true => Err(self.interruption()),
                    false => Ok(()),
                }
            }
            Err(Failure::Left) => {
                // The program chose to leave: for other federates that is an ordinary end.
                let ended = self.handle(Input::Leave);
                self.federation.say_goodbye();
                ended
            }
            // The exception of Python does not tell which signal it was.
            Err(Failure::Interrupted { .. }) => {
                let interruption = self.interruption();
                Err(self.federation.fail(interruption))
            }
            Err(failure) => Err(self.federation.fail(failure)),
        }
    }

    fn end_trace(&mut self, outcome: &Result<(), Failure>) -> Result<(), Failure> {
        if outcome.is_ok() && self.interrupted {
            let outcome = Err(self.interruption());
            return self.workers.end_trace(&self.scheduler, &outcome);
        }
        self.workers.end_trace(&self.scheduler, outcome)
    }

    fn interruption(&self) -> Failure {
        Failure::Interrupted { signal: self.host.signal() }
    }

    fn read_links(&mut self) -> Result<(), Failure> {
        let mut inputs = mem::take(&mut self.inputs);
        self.federation.read(&mut inputs)?;
        for (serial, input) in inputs.drain(..) {
            match input {
                input if self.federation.links.is_past(serial, &input) => {}
                Input::FromRti(frame @ Frame::ClockReply { .. }) => {
                    if self.federation.time.answered(&frame) {
                        self.now = Clock::now();
                    }
                }
                input => self.handle(input)?,
            }
        }
        self.inputs = inputs;
        Ok(())
    }

    fn compare_clocks(&mut self) {
        let Membership { time, links, .. } = &mut self.federation;
        time.ask(links);
    }

    /// Tells the machine once that this federate is ready to start; only after the clock has been set right,
    /// because the machine sends times of that clock.
    fn get_ready(&mut self) -> Result<(), Failure> {
        if self.loaded || !self.federation.time.is_settled() {
            return Ok(());
        }
        self.loaded = true;
        self.handle(Input::Loaded)
    }

    fn read_inbox(&mut self) -> Result<(), Failure> {
        let mut stop = self.inbox.take_stop()?;
        if self.host.interrupted() {
            // An orderly stop needs the other federates; after a second interrupt this one does not wait for
            // them.
            if self.interrupted || self.phase == Phase::Joining {
                return Err(self.interruption());
            }
            self.interrupted = true;
            stop = true;
        }
        let is_running = matches!(self.phase, Phase::Running | Phase::Processing);
        if is_running && self.inbox.has_requests() {
            for request in self.inbox.take_requests() {
                // The time of the request may come from a clock that was still ahead.
                let at = request.at.min(Clock::now());
                self.scheduler.schedule(request.action, request.extra, request.value, at);
            }
        }
        if self.phase == Phase::Running {
            if self.host.take_departure() {
                let me = self.federation.me();
                self.scheduler.mark_departure(Some(me));
                self.handle(Input::RequestDeparture)?;
            }
            // Before any other input: the machine promises nothing beyond the next event.
            self.handle(Input::NextEvent(self.scheduler.next_event()))?;
        }
        if stop {
            self.handle(Input::RequestStop)?;
        }
        Ok(())
    }

    /// Tells the owners of objects which of them this federate does not use any more.
    fn send_releases(&mut self) -> Result<(), Failure> {
        for (owner, serials) in self.federation.objects.dropped() {
            self.handle(Input::Release { owner, serials })?;
        }
        Ok(())
    }

    /// Runs the next tag if it may begin. Returns whether it did.
    fn step(&mut self) -> Result<bool, Failure> {
        self.handle(Input::NextEvent(self.scheduler.next_event()))?;
        let tag = self.scheduler.next_tag();
        let due = tag.due(self.scheduler.start_time());
        if tag == Tag::FOREVER
            || due > self.now
            || self.federation.machine.permission(tag, self.now) != Permission::Granted
        {
            return Ok(false);
        }
        if self.should_look(tag) {
            self.looked_at = self.now;
            if self.federation.links.look(self.inbox).readable {
                // Perhaps a message for this tag, or an earlier one.
                return Ok(true);
            }
        }
        if !self.pace.may_linger(self.now) || self.federation.links.have_much_to_write() {
            self.flush();
        }
        tracing::trace!("begins tag {tag}");
        self.handle(Input::Begun(tag))?;
        self.workers.watch_lag(&self.scheduler, &mut self.host, (tag, due), self.now);
        self.scheduler.begin(tag);
        self.phase = Phase::Processing;
        self.go_on()
    }

    /// Whether something may have come that the loop must read before a tag begins. If the tag was already safe
    /// when the loop last looked at the links, it has read all that had come when the tag became safe; but
    /// other requests to this federate must not wait for long either.
    fn should_look(&self, tag: Tag) -> bool {
        let was_safe = tag.due(self.scheduler.start_time()) <= self.looked_at
            && self.federation.machine.permission(tag, self.looked_at) == Permission::Granted;
        !was_safe || self.now.since(self.looked_at) > LINGER
    }

    fn flush(&mut self) {
        self.pace.flushed(self.now);
        self.federation.links.flush();
    }

    /// Runs the rest of the current tag as far as the machine permits. Returns false if it has to wait.
    fn go_on(&mut self) -> Result<bool, Failure> {
        while self.federation.machine.is_stepwise() {
            let level = self.scheduler.next_level();
            self.handle(Input::Reached(level))?;
            let now = Clock::now();
            if self.federation.machine.may_pass(level, now) != Permission::Granted {
                return Ok(false);
            }
            if self.federation.machine.may_pass(level, self.looked_at) != Permission::Granted {
                // The passing of time has made the level safe, so the loop must first read what had come by
                // then.
                self.looked_at = now;
                if self.federation.links.look(self.inbox).readable {
                    return Ok(true);
                }
            }
            let Some(level) = level else { break };
            self.workers.run_level(&mut self.scheduler, &mut self.host, level)?;
            self.scheduler.pass(level);
            self.send_all()?;
        }
        let tag = self.scheduler.tag();
        self.workers.run_tag(&mut self.scheduler, &mut self.host)?;
        let last = self.scheduler.end(Clock::now);
        self.phase = Phase::Running;
        self.send_all()?;
        self.handle(Input::Completed(tag))?;
        if let Some(maxwait) = self.host.take_maxwait() {
            self.handle(Input::Maxwait(maxwait))?;
        }
        if self.scheduler.take_stop_request() {
            self.handle(Input::RequestStop)?;
        }
        // Before the machine hears of the next event.
        if self.scheduler.take_departure() && !last {
            self.handle(Input::Depart)?;
        }
        if last {
            // While the RTI still hears of it if the trace cannot be written.
            self.end_trace(&Ok(()))?;
            self.handle(Input::Finished)?;
            self.phase = Phase::Done;
        }
        Ok(true)
    }

    fn send_all(&mut self) -> Result<(), Failure> {
        // First: a receiver of a message of this tag can then use the memory of its earlier objects again.
        self.send_releases()?;
        while let Some(message) = self.scheduler.poll_outbound() {
            self.send(message)?;
        }
        self.send_releases()
    }

    fn send(&mut self, message: OutboundMessage<H::Value>) -> Result<(), Failure> {
        let OutboundMessage { channel, tag, value, physical } = message;
        let route = self.scheduler.program().channels[channel];
        let to = route.to;
        let Membership { machine, objects, links, .. } = &mut self.federation;
        if !machine.is_live(to) {
            return Ok(());
        }
        if let Some(exchange) = &self.exchange {
            let mut payload = exchange.put(to, self.host.hand_over(channel, &value)?);
            payload.physical = physical;
            return self.handle(Input::Send { channel, tag, payload });
        }
        let shares_memory = machine.shares_memory_with(to);
        let near = shares_memory && links.is_beside(to);
        let payload = self.host.encode(&mut objects.store(), channel, &value, near)?;
        let (mut payload, changes) = if shares_memory && links.pass_descriptors(to, route.physical)
        {
            let changes = objects.share(&payload, to)?;
            (payload, changes)
        } else {
            (objects.inline(payload)?, Changes::default())
        };
        for (segment, len) in changes.mapped {
            self.handle(Input::Segment { reader: to, segment, len })?;
        }
        if !changes.retired.is_empty() {
            self.handle(Input::Retired { reader: to, segments: changes.retired })?;
        }
        payload.physical = physical;
        self.handle(Input::Send { channel, tag, payload })
    }

    /// Gives the machine an input, and carries out its outputs.
    fn handle(&mut self, input: Input) -> Result<(), Failure> {
        let handled = self.federation.machine.handle(self.now, input);
        while let Some(output) = self.federation.machine.poll() {
            self.apply(output)?;
        }
        handled.map_err(Failure::from)
    }

    fn apply(&mut self, output: Output) -> Result<(), Failure> {
        let Membership { links, objects, machine, .. } = &mut self.federation;
        match output {
            Output::ToRti(frame) => {
                let descriptor = objects.descriptor_for(&frame)?;
                links.tell_rti(Report::in_frame(frame), descriptor);
            }
            Output::ToPeer { to, frame } => {
                let descriptor = objects.descriptor_for(&frame)?;
                links.tell_peer(to, frame, descriptor);
            }
            Output::Connect { peer, listen } => {
                let same_host = machine.shares_memory_with(peer);
                let hello = machine.peer_hello();
                let connected = links.connect_peer(peer, &listen, same_host, hello);
                if let Err(reason) = connected {
                    self.handle(Input::Unreachable { peer, reason })?;
                }
            }
            Output::Rejoin => links.lose_rti()?,
            Output::Start { at, first } => {
                links.become_busy();
                self.scheduler.start_late(at, first);
                self.phase = Phase::Running;
            }
            Output::Discard { payload } => drop(objects.open(&payload)?),
            Output::Deliver { channel, tag, payload } => {
                let physical = payload.physical;
                let value = self.receive(channel, payload)?;
                self.scheduler.deliver(channel, tag, value, physical);
            }
            Output::DeliverPhysical { channel, payload, .. } => {
                let value = self.receive(channel, payload)?;
                self.scheduler.deliver_physical(channel, Clock::now(), value);
            }
            Output::Disconnect(peer) => links.disconnect(peer),
            Output::SetStop(tag) => self.scheduler.set_stop(tag),
            Output::LeaveAt(tag) => self.scheduler.leave_at(tag),
            Output::Segment { owner, segment, len } => {
                objects.attach(owner, segment, len, links.take_descriptor(owner, segment))?;
            }
            Output::Retired { owner, segments } => objects.retired(owner, &segments),
            Output::Released { reader, serials } => objects.released(reader, &serials),
            Output::ReaderGone(federate) => {
                links.give_up(federate);
                objects.store().reader_lost(federate);
            }
            Output::OwnerGone(federate) => objects.store().owner_lost(federate),
            Output::Ended { reason } => {
                let failure = ended(self.scheduler.program(), self.federation.me(), reason);
                if let Failure::Abandoned(report) = &failure {
                    self.host.abandoned(report);
                }
                // An interrupted federate was to end anyway, and neither could it wait for the others, nor the
                // others for it.
                return Err(if self.interrupted { self.interruption() } else { failure });
            }
        }
        Ok(())
    }

    fn receive(&mut self, channel: ChannelId, payload: Payload) -> Result<H::Value, Failure> {
        if let Some(exchange) = &self.exchange {
            let me = self.scheduler.program().channels[channel].to;
            let value = exchange
                .take(me, &payload)
                .expect("the sender puts the value there before it sends the message");
            return Ok(self.host.take_over(channel, value, Clock::now()));
        }
        let from = self.scheduler.program().channels[channel].from;
        let Membership { machine, objects, links, .. } = &mut self.federation;
        let near = machine.shares_memory_with(from) && links.is_beside(from);
        let opened = objects.open(&payload)?;
        Ok(self.host.receive(channel, payload, opened, Clock::now(), near))
    }

    /// Waits until something may have changed.
    fn wait(&mut self) {
        let until = self.wakeup();
        tracing::trace!(
            "waits, {:?}, for tag {} until {until:?}; it is {:?}",
            self.phase,
            self.scheduler.next_tag(),
            self.now
        );
        let Membership { links, .. } = &mut self.federation;
        let inbox = self.inbox;
        let found = inbox.may_sleep().then(|| self.host.idle(|| links.wait(inbox, until)));
        inbox.waited(found.is_some_and(|found| found.notified));
        self.looked_at = Clock::now();
        self.pace.waited(self.looked_at);
    }

    fn wakeup(&self) -> Option<PhysicalTime> {
        let Membership { machine, time, links, .. } = &self.federation;
        match self.phase {
            Phase::Joining => {
                let wakeups = [machine.next_wakeup(), time.next_wakeup(), links.next_wakeup()];
                return wakeups.into_iter().flatten().min();
            }
            Phase::Done => return None,
            Phase::Processing | Phase::Running => {}
        }
        let processing = self.phase == Phase::Processing;
        let (tag, permission) = if processing {
            let level = self.scheduler.next_level();
            (self.scheduler.tag(), machine.may_pass(level, self.now))
        } else {
            let tag = self.scheduler.next_tag();
            (tag, machine.permission(tag, self.now))
        };
        let due = tag.due(self.scheduler.start_time());
        let permitted = match permission {
            Permission::Granted => Some(due),
            Permission::WaitUntil(time) => Some(due.max(time)),
            Permission::Wait => None,
        };
        [permitted, machine.next_wakeup(), time.next_wakeup()].into_iter().flatten().min()
    }
}

fn ended(program: &Program, me: FederateId, reason: End) -> Failure {
    match reason {
        End::Failed { federate, message, .. } if federate == me => Failure::Link(message),
        End::Failed { federate, message, code } => {
            let name = &program.federates[federate].name;
            Failure::Abandoned(Box::new(Report::heard(name, &message, code)))
        }
        End::Refused(refusal) => Failure::Refused(refusal),
        End::RtiLost => Failure::RtiLost { program: program.name.clone() },
    }
}
