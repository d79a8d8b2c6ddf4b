//! Running the RTI: one loop over the links of all federates.
//!
//! The loop sends all frames that one round of reading causes in one write per link, so a message and the grant
//! that it makes possible travel together. The machine decides which frames those are.

mod logging;
mod recording;
mod showing;

use std::collections::BTreeMap;
use std::io;
use std::mem;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use hprm_core::{FederateId, Fingerprint, Nanos, PhysicalTime, Program, Table};
use hprm_federated::codec::CodecError;
use hprm_federated::{
    Carried, FederationId, Frame, HangTimeout, LinkId, Refusal, RtiInput, RtiOutput, Topology,
};

use crate::board::{Identity, Role};
use crate::launch::allow_boards;
use crate::link::descriptors::no_notifier;
use crate::link::{Keys, Link, LinkAcceptor, Network, Purpose};
use crate::log::log_names;
use crate::pipe_notifier::PipeNotifier;
use crate::poller::{Broken, PollSet, PolledAcceptor, PolledLink, Poller};
use crate::recorder::TraceRequest;
use crate::spin;
use crate::variables::may_use_boards;
use crate::{Address, Clock, Failure, Report, Security, nanoseconds};

use self::logging::RtiLog;
use self::recording::RtiRecording;
use self::showing::RtiShowing;

/// How long after the last federate is ready the program starts: enough for the start time to reach all
/// processes of one machine.
const START_DELAY: Nanos = 10_000_000;

/// The same, if federates may be on other machines.
const START_DELAY_NETWORK: Nanos = 250_000_000;

/// What to coordinate, and where.
#[derive(Clone, Debug)]
pub struct RtiOptions {
    /// The program of the federation.
    pub program: Arc<Program>,
    /// The fingerprint that all federates must have: of the program, perhaps with its bodies and modules.
    pub fingerprint: Arc<Fingerprint>,
    /// The secret of the federation.
    pub federation: FederationId,
    /// Where to listen.
    pub listen: Address,
    /// Other addresses to listen at: for example a Unix socket, over which federates of this machine share
    /// memory.
    pub also_listen: Vec<Address>,
    /// How the links of the federation are protected.
    pub security: Security,
    /// For how long a federate may be silent; longer silence is its failure.
    pub hang_timeout: HangTimeout,
}

/// What an RTI reports while it runs.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum RtiEvent {
    /// A federate has joined.
    Joined {
        /// The federate.
        federate: FederateId,
        /// Whether the launcher of the federation has started its process.
        launched: bool,
    },
    /// A process may not join.
    Refused {
        /// The federate as which the process wants to join.
        name: String,
        /// Why.
        reason: Refusal,
    },
    /// The link of a federate has ended before all federates had joined. The federate may join again; the
    /// other federates wait for it.
    Left(FederateId),
    /// A federate has loaded its program, before the federation starts.
    Loaded(FederateId),
    /// A federate takes part that has joined the running federation.
    Entered(FederateId),
    /// A process that has joined the running federation does not take part after all; if it has failed, why.
    Withdrawn {
        /// The federate.
        federate: FederateId,
        /// Why it failed.
        report: Option<Report>,
    },
    /// All have joined and loaded; the program starts at this time.
    Started(PhysicalTime),
    /// A federate has not answered for that many nanoseconds. It may compute for long, or hang.
    Silent {
        /// The federate.
        federate: FederateId,
        /// For how long.
        silence: Nanos,
    },
    /// A federate that was silent answers again.
    Answers {
        /// The federate.
        federate: FederateId,
        /// After how long.
        silence: Nanos,
    },
    /// The federation ends: no federate may join any more.
    Closing,
    /// A transient federate has failed. The other federates continue.
    Dropped {
        /// The federate.
        federate: FederateId,
        /// Why it failed.
        report: Report,
    },
    /// The first failure of a federate. The RTI tells the other federates to end.
    Failed {
        /// The federate that failed.
        federate: FederateId,
        /// Why it failed.
        report: Report,
    },
}

/// Coordinates a federation.
#[derive(Debug)]
pub struct Rti {
    program: Arc<Program>,
    machine: hprm_federated::Rti,
    /// The first address at which it listens.
    address: Address,
    links: RtiLinks,
    poller: Poller,
    /// The links that may have something to read. Empty between rounds; the loop keeps the vector for its
    /// memory.
    ready: Vec<LinkId>,
    /// The frames that have come over a link. Empty between rounds; the loop keeps the vector for its memory.
    frames: Vec<(Frame, Option<OwnedFd>)>,
    next_link: u32,
    /// Descriptors of segments that the RTI forwards from owner to reader.
    descriptors: BTreeMap<(FederateId, FederateId, Carried), OwnedFd>,
    /// Links that the RTI closes once it has written everything to them.
    closing: Vec<LinkId>,
    control: Arc<Control>,
    failure: Option<Failure>,
    finished: bool,
    /// Whether it has reported that no federate may join any more.
    closed: bool,
    recording: RtiRecording,
    /// The log of all frames, if there is one.
    log: RtiLog,
    showing: RtiShowing,
}

/// The open links of the RTI, and the acceptor of new ones.
#[derive(Debug)]
struct RtiLinks {
    by_id: BTreeMap<LinkId, PolledLink>,
    acceptor: PolledAcceptor,
}

impl PollSet for RtiLinks {
    fn polled_links(&self) -> impl Iterator<Item = &PolledLink> {
        self.by_id.values()
    }

    fn polled_links_mut(&mut self) -> impl Iterator<Item = &mut PolledLink> {
        self.by_id.values_mut()
    }

    fn acceptor(&self) -> Option<&PolledAcceptor> {
        Some(&self.acceptor)
    }

    fn acceptor_mut(&mut self) -> Option<&mut PolledAcceptor> {
        Some(&mut self.acceptor)
    }
}

impl RtiLinks {
    fn get(&mut self, link: LinkId) -> Option<&mut Link> {
        self.by_id.get_mut(&link).map(|polled| &mut polled.link)
    }
}

/// Controls a running RTI from other threads.
#[derive(Clone, Debug)]
pub struct RtiHandle {
    control: Arc<Control>,
}

#[derive(Debug)]
struct Control {
    wakeups: PipeNotifier,
    stop: AtomicBool,
    abort: AtomicBool,
    /// How often each federate was started again, as its launcher says.
    restarts: Table<FederateId, AtomicU32>,
}

impl RtiHandle {
    /// Asks the federation to stop in order; before the start, the RTI refuses all federates.
    pub fn request_stop(&self) {
        self.control.stop.store(true, Ordering::Release);
        self.control.wakeups.notify();
    }

    /// Has the RTI show that a federate is started again.
    pub fn note_restart(&self, federate: FederateId) {
        self.control.restarts[federate].fetch_add(1, Ordering::Relaxed);
        self.control.wakeups.notify();
    }

    /// Closes all links and ends [`Rti::run`].
    pub fn abort(&self) {
        self.control.abort.store(true, Ordering::Release);
        self.control.wakeups.notify();
    }
}

impl Rti {
    /// Listens for the federates of a program.
    ///
    /// # Errors
    ///
    /// If the RTI cannot listen at an address, for example because another process does.
    pub fn bind(options: &RtiOptions) -> Result<Self, Failure> {
        let network = Network::sockets().map_err(|error| no_notifier(&error))?;
        Self::bind_on(options, &network)
    }

    pub(crate) fn bind_on(options: &RtiOptions, network: &Network) -> Result<Self, Failure> {
        log_names(&options.program);
        let topology = Topology::new(&options.program);
        let failed = |address: &Address, error: io::Error| Failure::listen(true, address, &error);
        let keys = Keys::new(options.federation, options.security.clone())?;
        let identity = Identity::new(&options.program, keys.name(), Role::Rti);
        let fingerprint = Arc::clone(&options.fingerprint);
        let mut addresses = std::iter::once(&options.listen).chain(&options.also_listen);
        let is_open = addresses.any(Address::is_open);
        let delay = if is_open { START_DELAY_NETWORK } else { START_DELAY };
        let machine = hprm_federated::Rti::new(topology, keys.name(), fingerprint, delay)
            .watching(options.hang_timeout);
        let federates = options.program.federates.len();
        let machine = match may_use_boards(network)? {
            // Where there are too few descriptors, the RTI says how far each federate may advance.
            true if allow_boards(machine.board_descriptors(), federates) => {
                machine.with_boards(is_open)
            }
            _ => machine,
        };
        let listeners = std::iter::once(&options.listen)
            .chain(&options.also_listen)
            .map(|address| {
                keys.check_for(address)?;
                network.listen(address).map_err(|error| failed(address, error))
            })
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            program: Arc::clone(&options.program),
            machine,
            address: listeners[0].address().clone(),
            links: RtiLinks {
                by_id: BTreeMap::new(),
                acceptor: PolledAcceptor::new(LinkAcceptor::new(
                    listeners,
                    Purpose::Coordination,
                    keys,
                    options.program.federates.len(),
                )),
            },
            poller: Poller::new(network.notifier(), spin::time_of_rti(&options.program)),
            ready: Vec::new(),
            frames: Vec::new(),
            next_link: 0,
            descriptors: BTreeMap::new(),
            closing: Vec::new(),
            control: Arc::new(Control {
                wakeups: PipeNotifier::new().map_err(|error| failed(&options.listen, error))?,
                stop: AtomicBool::new(false),
                abort: AtomicBool::new(false),
                restarts: options.program.federates.ids().map(|_| AtomicU32::new(0)).collect(),
            }),
            failure: None,
            finished: false,
            closed: false,
            recording: RtiRecording::default(),
            log: RtiLog::open(&options.program, network)?,
            showing: RtiShowing::new(&identity, &options.program),
        })
    }

    /// Makes the RTI give up if not all federates have joined after `limit` from now.
    #[must_use]
    pub fn join_timeout(mut self, limit: Duration) -> Self {
        self.machine = self.machine.with_join_limit(Clock::now(), nanoseconds(limit));
        self
    }

    /// Has the RTI record what passes it, if the run is traced.
    ///
    /// # Errors
    ///
    /// If the trace cannot be written.
    pub fn recorded(self, request: Option<&TraceRequest>) -> Result<Self, Failure> {
        Ok(Self { recording: RtiRecording::start(request, &self.program)?, ..self })
    }

    /// The first address at which it listens.
    #[must_use]
    pub fn address(&self) -> &Address {
        &self.address
    }

    /// All addresses at which it listens.
    pub fn addresses(&self) -> impl Iterator<Item = &Address> {
        self.links.acceptor.inner.addresses()
    }

    /// A handle by which other threads control this RTI.
    #[must_use]
    pub fn handle(&self) -> RtiHandle {
        RtiHandle { control: Arc::clone(&self.control) }
    }

    /// Coordinates until the federation has ended.
    ///
    /// # Errors
    ///
    /// The first failure of a federate, which `report` has received as well, or the names of the federates that
    /// have not joined in time.
    pub fn run(mut self, mut report: impl FnMut(RtiEvent)) -> Result<(), Failure> {
        let mut wakeup = None::<PhysicalTime>;
        loop {
            if self.control.abort.load(Ordering::Acquire) {
                break;
            }
            if self.control.stop.swap(false, Ordering::AcqRel) {
                self.handle_input(RtiInput::RequestStop);
            }
            if self.links.acceptor.is_ready() {
                self.accept(&mut report)?;
            }
            self.read_all();
            // The loop reads the links before it tells the machine the time: an answer that has already
            // arrived is not late.
            if wakeup.is_some_and(|at| at <= Clock::now()) {
                self.handle_input(RtiInput::Wake);
            }
            self.apply(&mut report);
            self.flush(&mut report);
            if self.finished && self.closing.is_empty() {
                break;
            }
            wakeup = self.machine.next_wakeup();
            if self.machine.leaves_it_to_boards() {
                self.poller.do_not_spin();
            }
            let until = self.showing.show(&self.machine, &self.control.restarts, wakeup);
            let found = self.poller.wait(&mut self.links, &self.control.wakeups, until);
            if found.notified {
                self.control.wakeups.clear();
            }
        }
        let recorded = self.recording.finish();
        self.failure.map_or(recorded, Err)
    }

    fn accept(&mut self, report: &mut impl FnMut(RtiEvent)) -> Result<(), Failure> {
        let failed = |error| Failure::system("the RTI cannot accept links", &error);
        let admitted = self.links.acceptor.admit(Clock::local()).map_err(failed)?;
        if !admitted.is_empty() {
            // A federate may have lost its link and opened a new one. The machine must know of the end of the
            // old link before it handles the first frame of the new one.
            self.links.by_id.values_mut().for_each(|polled| polled.note(true));
            self.read_all();
        }
        for (link, hello) in admitted {
            let id = LinkId(self.next_link);
            self.next_link += 1;
            let hello = if link.is_local() { hello } else { with_host_of_tcp(hello) };
            self.links.by_id.insert(id, PolledLink::new(link));
            self.handle_frame(id, hello, None);
            self.apply(report);
            // More frames may have come with the first one.
            self.read(id);
        }
        Ok(())
    }

    /// Reads the links that may have something to read.
    fn read_all(&mut self) {
        let mut ready = mem::take(&mut self.ready);
        let readable = self.links.by_id.iter().filter(|(_, polled)| polled.may_be_read());
        ready.extend(readable.map(|(link, _)| *link));
        ready.drain(..).for_each(|link| self.read(link));
        self.ready = ready;
    }

    /// Reads what a link has to read. If the link is broken, the RTI closes it; no other link is affected.
    fn read(&mut self, id: LinkId) {
        let Some(polled) = self.links.by_id.get_mut(&id) else { return };
        let mut frames = mem::take(&mut self.frames);
        let open = polled.read(|frame, descriptor| frames.push((frame, descriptor)));
        for (frame, descriptor) in frames.drain(..) {
            // Handling a frame may close the link.
            if self.links.by_id.contains_key(&id) {
                self.handle_frame(id, frame, descriptor);
            }
        }
        self.frames = frames;
        match open {
            Ok(true) => {}
            Ok(false) | Err(Broken::Link(_)) => self.close(id),
            Err(Broken::Frame(error @ CodecError::NoMemory(_))) => {
                self.fail_link(id, &Failure::Memory(error.to_string()));
            }
            Err(Broken::Frame(error)) => self.fail_link(id, &Failure::protocol(&error)),
            Err(Broken::Shortage(error)) if error.kind() == io::ErrorKind::OutOfMemory => {
                self.fail_link(id, &Failure::Memory(error.to_string()));
            }
            Err(Broken::Shortage(error)) => {
                self.fail_link(id, &Failure::system("the RTI cannot receive from it", &error));
            }
        }
    }

    fn handle_frame(&mut self, link: LinkId, frame: Frame, descriptor: Option<OwnedFd>) {
        if let (Some(carried), Some(fd)) = (frame.carries(), descriptor) {
            self.descriptors.insert(carried, fd);
        }
        self.recording.received(link, &frame);
        self.log.received(link, &frame);
        self.handle_input(RtiInput::Frame { link, frame });
    }

    fn close(&mut self, link: LinkId) {
        if self.links.by_id.remove(&link).is_some() {
            self.closing.retain(|closing| *closing != link);
            self.handle_input(RtiInput::Closed { link });
        }
    }

    /// Gives the machine an input. If a frame breaks the protocol, its sender is wrong, and the RTI closes the
    /// link.
    fn handle_input(&mut self, input: RtiInput) {
        let from = match &input {
            RtiInput::Frame { link, .. } => Some(*link),
            _ => None,
        };
        if let (Err(fault), Some(link)) = (self.machine.handle(Clock::now(), input), from) {
            self.fail_link(link, &Failure::protocol(&fault));
        }
    }

    /// Closes a link whose bytes are not valid, or for which there is no memory. That is the failure
    /// of the federate at its other end.
    fn fail_link(&mut self, link: LinkId, failure: &Failure) {
        let message = failure.report().encoded();
        self.handle_input(RtiInput::Broken { link, message });
        self.close(link);
    }

    fn apply(&mut self, report: &mut impl FnMut(RtiEvent)) {
        while let Some(output) = self.machine.poll() {
            match output {
                RtiOutput::Send { link, frame } => self.send(link, frame),
                RtiOutput::Close { link } => self.closing.push(link),
                RtiOutput::ProgramRequested { link } => {
                    if let Some(link) = self.links.get(link) {
                        link.trust();
                    }
                }
                RtiOutput::Refused { name, reason } => report(RtiEvent::Refused { name, reason }),
                RtiOutput::Joined { federate, link, launched } => {
                    if let Some(open) = self.links.get(link) {
                        open.trust();
                    }
                    self.recording.joined(federate, link);
                    report(RtiEvent::Joined { federate, launched });
                }
                RtiOutput::Left { federate } => report(RtiEvent::Left(federate)),
                RtiOutput::Loaded { federate } => report(RtiEvent::Loaded(federate)),
                RtiOutput::Entered { federate } => report(RtiEvent::Entered(federate)),
                RtiOutput::Withdrawn { federate, failure } => {
                    let said =
                        |(message, code): (String, _)| self.report_of(federate, &message, code);
                    report(RtiEvent::Withdrawn { federate, report: failure.map(said) });
                }
                RtiOutput::Started { at } => {
                    self.links.acceptor.inner.become_busy();
                    self.recording.started(at);
                    self.showing.started(at);
                    report(RtiEvent::Started(at));
                }
                RtiOutput::Silent { federate, silence } => {
                    report(RtiEvent::Silent { federate, silence });
                }
                RtiOutput::Answers { federate, silence } => {
                    report(RtiEvent::Answers { federate, silence });
                }
                RtiOutput::Dropped { federate, message, code } => {
                    report(RtiEvent::Dropped {
                        federate,
                        report: self.report_of(federate, &message, code),
                    });
                }
                RtiOutput::Failed { federate, message, code } => {
                    let received = self.report_of(federate, &message, code);
                    self.failure = Some(Failure::FederateFailed(Box::new(received.clone())));
                    report(RtiEvent::Failed { federate, report: received });
                }
                RtiOutput::Missing(missing) => self.failure = Some(Failure::Missing(missing)),
                RtiOutput::Finished => self.finished = true,
            }
        }
        if !self.closed && self.machine.is_closing() {
            self.closed = true;
            report(RtiEvent::Closing);
        }
        // Each descriptor left with the frame of its segment; those that remain were for federates that have
        // ended.
        self.descriptors.clear();
    }

    /// The report on a federate that has failed, with the federate's name.
    fn report_of(&self, federate: FederateId, message: &str, code: i32) -> Report {
        Report::from_message(&self.program.federates[federate].name, message, code)
    }

    fn send(&mut self, link: LinkId, frame: Frame) {
        self.recording.sent(link, &frame);
        self.log.sent(link, &frame);
        let Some(link) = self.links.get(link) else { return };
        let descriptor = frame.carries().and_then(|carried| self.descriptors.remove(&carried));
        link.queue(frame, descriptor);
    }

    fn flush(&mut self, report: &mut impl FnMut(RtiEvent)) {
        let mut without_memory = Vec::new();
        for (id, PolledLink { link, .. }) in &mut self.links.by_id {
            match link.flush() {
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::OutOfMemory => {
                    without_memory.push((*id, Failure::Memory(error.to_string())));
                }
                // The other end is closed. The frames that it sent before are still to be read, so the loop
                // handles the end of the link when it reads the link, and not here.
                Err(_) => link.discard(),
            }
        }
        without_memory.into_iter().for_each(|(id, failure)| self.fail_link(id, &failure));
        let moved: Vec<_> = self
            .links
            .by_id
            .iter_mut()
            .filter_map(|(id, polled)| polled.link.take_moved_chunks().then_some(*id))
            .collect();
        moved.into_iter().for_each(|link| self.handle_input(RtiInput::ChunksMoved { link }));
        let done: Vec<_> = self
            .closing
            .iter()
            .copied()
            .filter(|id| self.links.by_id.get(id).is_none_or(|polled| !polled.link.has_outbound()))
            .collect();
        for link in done {
            self.close(link);
            self.closing.retain(|closing| *closing != link);
        }
        // Closing a link may cause more frames, which are written before the next wait.
        self.apply(report);
    }
}

/// Changes the first frame of a link over TCP: it must not claim the host of a federate on this machine, because
/// federates on one host share memory.
fn with_host_of_tcp(mut hello: Frame) -> Frame {
    if let Frame::Hello { host, .. } = &mut hello {
        *host = host.joined_over_tcp();
    }
    hello
}
