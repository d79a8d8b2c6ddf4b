//! Running one federate: one loop, run to completion.
//!
//! ```text
//! read every link -> machine -> deliver;  next tag -> machine -> permission?
//!     yes: run the tag, hand its messages to the machine;  no: write, then wait
//! ```
//!
//! The loop owns the links, the store and the clock, and decides nothing: the scheduler says which tag is next,
//! and the federate's machine whether that tag may begin.

pub(crate) mod boards;
mod holding;
mod links;
mod membership;
mod objects;
mod openings;
mod outlive;
mod pace;
mod reach;
mod recording;
mod search;
mod showing;
mod time;
mod waiting;
mod watchers;

use std::mem;
use std::sync::Arc;

use hprm_core::{
    ChannelId, FederateId, OutboundMessage, Payload, PhysicalTime, Program, Scheduler, Scope, Tag,
};
use hprm_federated::{Carried, End, Frame, Input, Output, Permission};

use crate::board::{BoardWriter, FederateState, Stage};
use crate::launch::raise_for_federate;
use crate::link::Network;
use crate::link::descriptors::no_notifier;
use crate::log::log_names;
use crate::recorder::{Flags, Kind, LoopRecording, Member, Recorder, Size, Waiting};
use crate::shipping;
use crate::trace::Trace;
use crate::workers::Workers;
use crate::{Clock, Failure, Host, Inbox, Report, ValueExchange, enter_realtime};
pub use membership::FederateOptions;
pub use outlive::EndProcess;
pub use reach::{Reach, THROUGH_AGENT};

use links::LinkSerial;
use membership::Membership;
use objects::Changes;
use outlive::OutliveWatch;
use pace::{LINGER, Pace, ThreadUsage};
use showing::Counts;
use waiting::Waits;

/// Runs a federate to its end. `load` makes the host; it is called once the federate has joined, so
/// that all federates load at the same time, and the federate reports any failure from then on to the RTI.
///
/// # Errors
///
/// What a reaction raised, or why the federation ended. If another federate has failed first, that is
/// [`Failure::OtherFederateFailed`] with the report of the other federate.
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

/// Runs a federate to its end, as [`run_federate`] does, if all federates and the RTI are threads of this
/// process. Values travel through `exchange`, which the threads share.
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
        raise_for_federate(options.program.federates.len());
    }
    let network = match exchange {
        Some(exchange) => exchange.network(),
        None => Network::sockets().map_err(|error| no_notifier(&error))?,
    };
    let member = Member::federate(options.federate);
    // Before this thread has a priority that the collector must not have.
    let recording = LoopRecording::start(options.record.as_ref(), &options.program, member)?;
    let recorder = recording.recorder();
    enter_realtime(&options.program.properties, Some(options.federate.index()))?;
    let mut board = showing::board(options);
    let mut federation = Membership::join(options, inbox, network)?;
    board.show(&FederateState::before(Stage::Loading));
    let scope = Scope::Federate(options.federate);
    let loaded = load().and_then(|host| {
        let trace =
            options.trace.as_ref().map(|share| Trace::create_share(share, &options.program));
        let (program, recorder) = (&options.program, recorder.clone());
        let workers = Workers::new(program, scope, trace.transpose()?, recorder)?;
        Ok((host, workers.shown_on(board.lanes())))
    });
    let (host, workers) = match loaded {
        Ok(loaded) => loaded,
        Err(failure) => return Err(federation.fail(failure)),
    };
    showing::name_places(&board, options, &host);
    let mut federate = FederateLoop {
        scheduler: Scheduler::new(Arc::clone(&options.program), scope),
        workers,
        recorder,
        waiting: None,
        messages_at: None,
        now: Clock::now(),
        inbox,
        host,
        federation,
        counts: Counts::new(&board, options.program.channels.len(), exchange.is_some()),
        board,
        exchange: exchange.cloned(),
        phase: Phase::Joining,
        has_reported_loaded: false,
        reported: None,
        interrupted: false,
        inputs: Vec::new(),
        looked_at: PhysicalTime(0),
        spent: Vec::new(),
        waits: Waits::new(),
        pace: Pace::new(),
        end_process: options.end_process,
        outlive: None,
    };
    if federate.exchange.is_none() {
        federate.host.set_allocator(federate.federation.objects.allocator());
    }
    if options.trace.is_some() {
        federate.scheduler.start_recording();
    }
    if federate.recorder.is_on() {
        federate.scheduler.log_schedules();
    }
    federate.host.set_tracepoints(&recording.tracepoints());
    let outcome = federate.run();
    federate.show_end();
    federate.outlive = None;
    inbox.close();
    federate.workers.report_dropped(&federate.scheduler, &mut federate.host);
    // Before the federation learns that this federate has ended, and may make the trace.
    let outcome = recording.end(&mut federate.host, outcome);
    federate.leave(outcome)
}

struct FederateLoop<'a, H: Host> {
    scheduler: Scheduler<H::Value>,
    workers: Workers<H::Value>,
    recorder: Recorder,
    /// What the last round of the loop waited for, if the run is traced.
    waiting: Option<Waiting>,
    /// When the messages of this round had come, once that is known, if the run is traced.
    messages_at: Option<PhysicalTime>,
    /// What the clock showed at the beginning of this round of the loop.
    now: PhysicalTime,
    inbox: &'a Inbox<H::Value>,
    host: H,
    federation: Membership,
    board: BoardWriter,
    counts: Counts,
    /// Holds the values of messages, if the federation is in this process.
    exchange: Option<ValueExchange<H::Value>>,
    phase: Phase,
    /// Whether the loop has told the machine that this federate has loaded its program.
    has_reported_loaded: bool,
    /// The next event, if the machine knows it, and since then has got no other input and the scheduler no other events.
    reported: Option<Tag>,
    /// Whether a signal has asked this process to stop.
    interrupted: bool,
    /// What the links have received. Empty between rounds; the loop keeps the vector for its memory.
    inputs: Vec<(LinkSerial, Input)>,
    /// The loop has read, or is about to read, all that had come over the links by this time.
    looked_at: PhysicalTime,
    /// Small values that were sent at this tag: to drop them takes time, for which its messages need not wait.
    spent: Vec<H::Value>,
    waits: Waits,
    /// Decides whether outbound messages may wait for those of the next tags.
    pace: Pace,
    /// What ends this process if it outlives the federation; none if the launcher does that.
    end_process: Option<EndProcess>,
    /// Watches for that, while the program runs.
    outlive: Option<OutliveWatch>,
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
        let mut advanced = false;
        while self.phase != Phase::Done {
            self.compare_clocks();
            // The loop reads the clock before the inbox: an action that another thread schedules after that has
            // a later time, so what the machine promises to other federates for this time stays true.
            let before = self.read_clock();
            self.note_round();
            match advanced {
                true => {
                    self.pace.tag_took(self.now.since(before), ThreadUsage::of_this_thread);
                    self.show_busy();
                }
                // The next wait shows for what, if it is time to.
                false => self.pace.waited(self.now),
            }
            self.read_inbox()?;
            self.read_links()?;
            self.read_boards_if_needed()?;
            self.federation.serve_watchers();
            if !self.has_reported_loaded {
                self.report_loaded()?;
            }
            self.send_releases()?;
            self.wake_machine()?;
            advanced = match self.phase {
                Phase::Running => self.run_next_tag()?,
                Phase::Processing => self.continue_tag()?,
                Phase::Joining | Phase::Done => false,
            };
            if !advanced && self.phase != Phase::Done {
                self.flush();
            }
            let may_go_on = self.wake_up_others()?;
            if !advanced && !may_go_on && self.phase != Phase::Done {
                self.wait();
            }
        }
        Ok(())
    }

    /// Ends the federate, in order or with a failure, and tells the other federates which of the two it is.
    fn leave(mut self, outcome: Result<(), Failure>) -> Result<(), Failure> {
        let traced = self.end_trace(&outcome);
        match Failure::with_trace_outcome(outcome, traced) {
            Ok(()) => {
                self.federation.finish_sending();
                match self.interrupted {
                    true => Err(self.interruption()),
                    false => Ok(()),
                }
            }
            Err(Failure::LeftFederation) => {
                // The program has exited with code 0: for other federates that is an orderly end.
                let ended = self.handle(Input::Leave);
                self.federation.finish_sending();
                ended
            }
            // The failure comes from a Python exception, which does not say which signal it was.
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
            if self.federation.links.is_from_closed_link(serial, &input) {
                continue;
            }
            if let Input::FromRti(frame @ Frame::ClockReply { .. }) = &input {
                if let Some(set) = self.federation.time.answered(frame) {
                    self.now = Clock::now();
                    self.note_clock_set(set);
                }
                continue;
            }
            self.note_from_rti(&input);
            self.handle(input)?;
        }
        self.inputs = inputs;
        Ok(())
    }

    fn compare_clocks(&mut self) {
        let Membership { time, links, .. } = &mut self.federation;
        time.ask(links);
    }

    /// Tells the machine once that this federate has loaded its program. That must wait until the clock is
    /// synchronized, because the machine then sends the clock's time to the RTI.
    #[inline(never)]
    fn report_loaded(&mut self) -> Result<(), Failure> {
        if !self.federation.time.is_settled() {
            return Ok(());
        }
        self.has_reported_loaded = true;
        self.handle(Input::Loaded)
    }

    fn read_inbox(&mut self) -> Result<(), Failure> {
        let mut stop = self.inbox.take_stop()?;
        if self.host.interrupted() {
            self.interrupt()?;
            stop = true;
        }
        let is_running = matches!(self.phase, Phase::Running | Phase::Processing);
        if is_running && self.inbox.has_requests() {
            self.schedule_requests();
        }
        if self.phase == Phase::Running {
            if self.host.take_departure() {
                self.request_departure()?;
            }
            // The machine must know the next event before it gets any other input: only then does it promise
            // nothing beyond that event.
            self.report_next_event()?;
        }
        if stop {
            self.handle(Input::RequestStop)?;
        }
        Ok(())
    }

    /// A signal has asked this federate to end.
    #[cold]
    fn interrupt(&mut self) -> Result<(), Failure> {
        // An orderly stop waits for the other federates. After a second signal this federate ends without them.
        if self.interrupted || self.phase == Phase::Joining {
            return Err(self.interruption());
        }
        self.interrupted = true;
        Ok(())
    }

    /// Schedules what other threads have asked for.
    #[inline(never)]
    fn schedule_requests(&mut self) {
        for request in self.inbox.take_requests() {
            // The clock may have been set back after the other thread had read it.
            let at = request.at.min(Clock::now());
            self.scheduler.schedule(request.action, request.extra, request.value, at);
        }
        self.reported = None;
        let scheduled = self.scheduler.take_scheduled();
        scheduled.for_each(|it| self.recorder.scheduled(it, Flags::OUTSIDE));
    }

    #[cold]
    fn request_departure(&mut self) -> Result<(), Failure> {
        let me = self.federation.me();
        self.scheduler.mark_departure(Some(me));
        self.handle(Input::RequestDeparture)
    }

    /// Tells the machine the next event, unless nothing has happened since it was told last. Returns that event.
    fn report_next_event(&mut self) -> Result<Tag, Failure> {
        if let Some(reported) = self.reported {
            return Ok(reported);
        }
        let next = self.scheduler.next_event();
        self.handle(Input::NextEvent(next))?;
        Ok(self.reported.unwrap_or_else(|| self.scheduler.next_event()))
    }

    /// Tells the owners of objects which of them this federate does not use any more.
    #[inline]
    fn send_releases(&mut self) -> Result<(), Failure> {
        match self.federation.objects.may_have_dropped() {
            false => Ok(()),
            true => self.release_dropped(),
        }
    }

    #[inline(never)]
    fn release_dropped(&mut self) -> Result<(), Failure> {
        for (owner, serials) in self.federation.objects.dropped() {
            if owner == shipping::SERVICE {
                self.federation.links.shipping().into_iter().for_each(|it| it.release(&serials));
                continue;
            }
            self.handle(Input::Release { owner, serials })?;
        }
        Ok(())
    }

    /// Runs the next tag, if it may begin. Returns false if the loop has to wait before it tries again.
    fn run_next_tag(&mut self) -> Result<bool, Failure> {
        let next = self.report_next_event()?;
        let tag = self.scheduler.tag_of(next);
        let due = self.due(tag);
        let may_begin = |at| {
            let is_due = tag != Tag::FOREVER && due <= at;
            is_due && self.federation.machine.permission(tag, at) == Permission::Granted
        };
        // If the tag was already safe when the loop last looked at the links, the loop has read all messages for the tag.
        let was_safe = may_begin(self.looked_at.min(self.now));
        if !was_safe && !may_begin(self.now) {
            return Ok(false);
        }
        // It looks again after a while nevertheless, because other requests to this federate must not wait for long.
        if !was_safe || self.now.since(self.looked_at) > LINGER {
            self.looked_at = self.now;
            if self.federation.links.look(self.inbox, self.now).readable {
                // A message for this tag, or for an earlier one, may have come: the loop reads it first.
                return Ok(true);
            }
        }
        if !self.pace.may_linger(self.now) || self.federation.links.have_much_to_write() {
            self.flush();
        }
        tracing::trace!("begins tag {tag}");
        self.handle(Input::Begun(tag))?;
        self.note_tag(tag);
        self.workers.watch_lag(&self.scheduler, &mut self.host, (tag, due), self.now);
        self.scheduler.begin(tag);
        self.phase = Phase::Processing;
        self.continue_tag()
    }

    /// When a tag is due: at once, if the program does not wait for physical time.
    fn due(&self, tag: Tag) -> PhysicalTime {
        let is_now = self.scheduler.program().properties.fast && tag != Tag::FOREVER;
        (if is_now { Tag::START } else { tag }).due(self.scheduler.start_time())
    }

    fn flush(&mut self) {
        self.pace.flushed(self.now);
        self.federation.links.flush();
    }

    /// Runs the rest of the current tag as far as the machine permits. Returns false if the loop has to wait
    /// before it tries again.
    fn continue_tag(&mut self) -> Result<bool, Failure> {
        if self.federation.machine.is_stepwise()
            && let Some(advanced) = self.run_levels()?
        {
            return Ok(advanced);
        }
        let tag = self.scheduler.tag();
        self.workers.run_tag(&mut self.scheduler, &mut self.host)?;
        let is_last = self.scheduler.end(Clock::now);
        // Whatever becomes of this process, the trace has what others receive of this tag.
        self.workers.write_trace()?;
        self.phase = Phase::Running;
        self.send_all()?;
        self.host.tag_is_sent();
        if !self.pace.may_linger(self.now) {
            // Only the RTI waits for what is still to be said of this tag. With boards, a receiver that woke up now would
            // find there that it has to wait for more; one that is awake decodes the messages meanwhile.
            match self.federation.machine.reads_boards() {
                true => self.federation.links.flush_awake_peers(),
                false => self.federation.links.flush_peers(),
            }
        }
        self.spent.clear();
        self.handle(Input::Completed(tag))?;
        if let Some(maxwait) = self.host.take_maxwait() {
            self.handle(Input::Maxwait(maxwait))?;
        }
        if self.scheduler.take_stop_request() {
            self.handle(Input::RequestStop)?;
        }
        // The machine must know that the federate leaves before it reports the next event to the RTI.
        if self.scheduler.take_departure() && !is_last {
            self.handle(Input::Depart)?;
        }
        if is_last {
            // After `Finished` it would be too late to tell the RTI that the trace cannot be written.
            self.end_trace(&Ok(()))?;
            self.handle(Input::Finished)?;
            self.phase = Phase::Done;
        } else if !self.pace.may_linger(self.now) {
            // The RTI gets the next event in the same write as the messages of the tag.
            self.report_next_event()?;
            self.flush();
        }
        Ok(true)
    }

    /// Runs the current tag level by level, as far as the machine permits. Returns what [`Self::continue_tag`] does, unless no
    /// level is left.
    #[inline(never)]
    fn run_levels(&mut self) -> Result<Option<bool>, Failure> {
        loop {
            let level = self.scheduler.next_level();
            self.handle(Input::Reached(level))?;
            let now = Clock::now();
            if self.federation.machine.level_permission(level, now) != Permission::Granted {
                return Ok(Some(false));
            }
            if self.federation.machine.level_permission(level, self.looked_at)
                != Permission::Granted
            {
                // The level has become safe only since the loop last looked at the links, because time has
                // passed. So the loop must first read the messages that came meanwhile.
                self.looked_at = now;
                if self.federation.links.look(self.inbox, now).readable {
                    return Ok(Some(true));
                }
            }
            let Some(level) = level else { return Ok(None) };
            self.board.begins(self.scheduler.tag(), now);
            self.workers.run_level(&mut self.scheduler, &mut self.host, level)?;
            self.scheduler.pass(level);
            self.send_all()?;
        }
    }

    fn send_all(&mut self) -> Result<(), Failure> {
        // Releases go before messages: a receiver of both can recycle the released memory when it handles the
        // message.
        self.send_releases()?;
        while let Some(message) = self.scheduler.poll_outbound() {
            self.send(message)?;
        }
        self.federation.leave_shipments();
        self.send_releases()
    }

    fn send(&mut self, message: OutboundMessage<H::Value>) -> Result<(), Failure> {
        let OutboundMessage { channel, tag, value, physical } = message;
        let route = self.scheduler.program().channels[channel];
        let to = route.to;
        if !self.federation.machine.is_live(to) {
            return Ok(());
        }
        let arrives = (!route.physical).then_some(tag);
        if self.exchange.is_some() && self.federation.is_watched() {
            self.show_reference((channel, arrives), &value);
        }
        if let Some(exchange) = &self.exchange {
            let mut payload = exchange.put(to, self.host.send_in_process(channel, &value)?);
            payload.physical = physical;
            self.recorder.sent((channel, tag), Size::REFERENCE);
            self.counts.message(channel, tag, &payload);
            return self.handle(Input::Send { channel, tag, payload });
        }
        let Membership { machine, objects, links, .. } = &mut self.federation;
        let shares_memory = machine.shares_memory_with(to);
        let is_local = shares_memory && links.is_same_user(to);
        let precede = shares_memory && links.descriptors_precede(to, route.physical);
        let copied = self.recorder.is_on().then(|| objects.store().bytes_copied());
        let payload = self.host.encode(objects.allocator(), channel, &value, is_local)?;
        if self.federation.is_watched() {
            self.show((channel, arrives), Ok(&payload));
        }
        let (mut payload, changes) = if precede {
            let changes = self.federation.objects.share(&payload, to)?;
            (payload, changes)
        } else {
            let connection = &self.scheduler.program().connections[route.connection];
            (self.federation.carried(payload, to, connection)?, Changes::default())
        };
        for (segment, len) in changes.mapped {
            self.handle(Input::Segment { reader: to, segment, len })?;
        }
        if !changes.retired.is_empty() {
            self.handle(Input::Retired { reader: to, segments: changes.retired })?;
        }
        payload.physical = physical;
        if let Some(before) = copied {
            let now = self.federation.objects.store().bytes_copied();
            let flags = if now == before { Flags::NONE } else { Flags::COPIED };
            self.recorder.sent((channel, tag), Size::of(&payload, flags));
        }
        self.counts.message(channel, tag, &payload);
        if payload.parts.is_empty() {
            self.spent.push(value);
        }
        self.handle(Input::Send { channel, tag, payload })
    }

    /// Gives the machine an input, and carries out its outputs.
    fn handle(&mut self, input: Input) -> Result<(), Failure> {
        match input {
            Input::Wake => {}
            Input::NextEvent(next) => self.reported = Some(next),
            _ => self.reported = None,
        }
        let handled = self.federation.machine.handle(self.now, input);
        while let Some(output) = self.federation.machine.poll() {
            self.apply(output)?;
        }
        handled.map_err(Failure::from)
    }

    /// Begins to run at `first`, if tag zero is at `at`.
    fn begin(&mut self, at: PhysicalTime, first: Tag) -> Result<(), Failure> {
        let Membership { links, .. } = &mut self.federation;
        links.become_busy();
        if let Some((end_process, link)) = self.end_process.zip(links.rti_socket()) {
            let federation = &self.scheduler.program().name;
            let watch = OutliveWatch::start(link, federation, end_process);
            self.outlive =
                Some(watch.map_err(|error| {
                    Failure::system("cannot watch the link to the RTI", &error)
                })?);
        }
        self.scheduler.start_late(at, first);
        self.recorder.started(at);
        self.phase = Phase::Running;
        self.show_start();
        Ok(())
    }

    fn apply(&mut self, output: Output) -> Result<(), Failure> {
        let Membership { links, objects, machine, .. } = &mut self.federation;
        self.reported = self.reported.filter(|_| !output.is_for_scheduler());
        match output {
            Output::ToRti(frame) => {
                self.recorder.frame(Kind::FrameSent, machine.me(), &frame);
                let descriptor = match frame.carries() {
                    Some((_, _, carried @ (Carried::Board | Carried::Notifier))) => {
                        Some(links.board_descriptor(carried, machine.tallies())?)
                    }
                    _ => objects.descriptor_for(&frame)?,
                };
                links.send_to_rti(Report::in_frame(frame), descriptor);
            }
            Output::ToPeer { to, frame } => {
                let descriptor = objects.descriptor_for(&frame)?;
                links.send_to_peer(to, frame, descriptor);
            }
            Output::Connect { peer, listen } => {
                let same_host = machine.shares_memory_with(peer);
                let hello = machine.peer_hello();
                let connected = links.connect_peer(peer, &listen, same_host, hello);
                if let Err(reason) = connected {
                    self.handle(Input::Unreachable { peer, reason })?;
                }
            }
            Output::Rejoin => links.drop_rti_link()?,
            Output::Start { at, first } => self.begin(at, first)?,
            // This federate holds the objects of a message from its arrival on. Opening and dropping the message
            // releases them.
            Output::Discard { payload } => drop(objects.open(&payload)?),
            Output::Deliver { channel, tag, payload } => {
                let physical = payload.physical;
                self.note_received((channel, tag), &payload);
                let value = self.receive(channel, payload)?;
                let taken = self.scheduler.deliver(channel, tag, value, physical);
                self.counts.delivered(taken, tag, self.scheduler.tag());
            }
            Output::DeliverPhysical { channel, payload, .. } => {
                self.note_received((channel, Tag::NEVER), &payload);
                let value = self.receive(channel, payload)?;
                let tag = self.scheduler.deliver_physical(channel, Clock::now(), value);
                self.federation.machine.assign_tag(channel, tag);
            }
            Output::Board { owner, notifier } => links.attach_board(owner, notifier)?,
            Output::Post(posting) => {
                if let Some(boards) = links.boards() {
                    boards.post(posting);
                }
            }
            Output::Disconnect(peer) => links.disconnect(peer),
            Output::Passed(level) => self.scheduler.pass(level),
            Output::SetStop(tag) => self.scheduler.set_stop(tag),
            Output::LeaveAt(tag) => self.scheduler.leave_at(tag),
            Output::Segment { owner, segment, len } => {
                let descriptor = links.take_descriptor(owner, Carried::Segment(segment));
                objects.attach(owner, segment, len, descriptor)?;
            }
            Output::Retired { owner, segments } => objects.retired(owner, &segments),
            Output::Released { reader, serials } => objects.released(reader, &serials),
            Output::ReaderGone(federate) => {
                links.stop_opening(federate);
                objects.store().reader_lost(federate);
            }
            Output::OwnerGone(federate) => objects.store().owner_lost(federate),
            Output::Ended { reason } => return Err(self.ended(reason)),
        }
        Ok(())
    }

    /// Why the loop ends, if the federation has ended for this federate.
    fn ended(&mut self, reason: End) -> Failure {
        let failure = failure_of_end(self.scheduler.program(), self.federation.me(), reason);
        if let Failure::OtherFederateFailed(report) = &failure {
            self.host.other_federate_failed(report);
        }
        // A federate that a signal has interrupted ends because of the signal, even if the failure of another
        // federate has kept it from stopping in order.
        if self.interrupted { self.interruption() } else { failure }
    }

    fn receive(&mut self, channel: ChannelId, payload: Payload) -> Result<H::Value, Failure> {
        if let Some(exchange) = &self.exchange {
            let me = self.scheduler.program().channels[channel].to;
            let value = exchange
                .take(me, &payload)
                .expect("the sender puts the value there before it sends the message");
            return Ok(self.host.receive_in_process(channel, value, Clock::now));
        }
        let from = self.scheduler.program().channels[channel].from;
        let Membership { machine, objects, links, .. } = &mut self.federation;
        let is_local = machine.shares_memory_with(from) && links.is_same_user(from);
        let opened = objects.open(&payload)?;
        self.host.receive(channel, payload, opened, Clock::now, is_local)
    }
}

/// The failure with which this federate ends when the machine has ended for `reason`.
fn failure_of_end(program: &Program, me: FederateId, reason: End) -> Failure {
    match reason {
        End::Failed { federate, message, .. } if federate == me => Failure::Link(message),
        End::Failed { federate, message, code } => {
            let name = &program.federates[federate].name;
            Failure::OtherFederateFailed(Box::new(Report::from_message(name, &message, code)))
        }
        End::Refused(refusal) => Failure::Refused(refusal),
        End::RtiLost => Failure::RtiLost { program: program.name.clone() },
    }
}
