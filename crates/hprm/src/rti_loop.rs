//! Running the RTI: one loop over the links of all federates.
//!
//! Whatever one round of reading causes leaves in one write per link, so a message and the grant
//! that it makes possible travel together. Which frames those are is the machine's business.

use std::collections::BTreeMap;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use hprm_core::{FederateId, Fingerprint, Nanos, PhysicalTime, Program};
use hprm_federated::{
    FederationId, Frame, LinkId, Patience, Refusal, RtiInput, RtiOutput, Topology,
};

use crate::bell::Bell;
use crate::doorbell::Doorbell;
use crate::link::descriptors::{advice, is_shortage, no_doorbell};
use crate::link::{Arrival, Keys, Lobby, Purpose, READS};
use crate::log::log_names;
use crate::spin;
use crate::wait::{GLANCE, Interest, Interests, Ready, SPIN_GLANCE, wait};
use crate::wire::{Network, Wire};
use crate::{Address, Clock, Failure, Report, Security};

/// Time between the last federate's being ready and the start of the program: enough for the start
/// time to reach everybody on one machine.
const START_DELAY: Nanos = 10_000_000;

/// The same, if federates may be on other machines.
const START_DELAY_ACROSS: Nanos = 250_000_000;

/// What to coordinate, and where.
#[derive(Clone, Debug)]
pub struct RtiOptions {
    /// The program of the federation.
    pub program: Arc<Program>,
    /// What federates must have alike: that of the program, or more.
    pub fingerprint: Arc<Fingerprint>,
    /// Its secret.
    pub federation: FederationId,
    /// Where to listen.
    pub listen: Address,
    /// Where to listen as well: on a Unix socket for this machine, perhaps, where federates share
    /// memory.
    pub also_listen: Vec<Address>,
    /// How its links are protected.
    pub security: Security,
    /// When it is a failure that a federate does not answer.
    pub patience: Patience,
}

/// What an RTI reports while it runs.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum RtiEvent {
    /// A federate has joined.
    Joined(FederateId),
    /// A process may not join.
    Refused {
        /// As which federate.
        name: String,
        /// Why.
        reason: Refusal,
    },
    /// A federate's link has ended before all had joined. It may join again; the others wait for it.
    Left(FederateId),
    /// All have joined; the program starts at this time.
    Started(PhysicalTime),
    /// A federate has not answered for that many nanoseconds. It may compute for long, or hang.
    Silent {
        /// Who.
        federate: FederateId,
        /// For how long.
        silence: Nanos,
    },
    /// A federate that was silent answers again.
    Answers {
        /// Who.
        federate: FederateId,
        /// After how long.
        silence: Nanos,
    },
    /// A transient federate could not go on. The others do.
    Dropped {
        /// Who.
        federate: FederateId,
        /// What has become of it.
        report: Report,
    },
    /// The first failure of a federate. The others are being told to end.
    Failed {
        /// Who failed.
        federate: FederateId,
        /// What has become of it.
        report: Report,
    },
}

/// Coordinates a federation.
#[derive(Debug)]
pub struct Rti {
    program: Arc<Program>,
    machine: hprm_federated::Rti,
    lobby: Lobby,
    /// The first address that the lobby listens at.
    address: Address,
    links: BTreeMap<LinkId, Wire>,
    /// What others ring who have left something in memory.
    doorbell: Option<Doorbell>,
    /// When the system was last asked what has come.
    asked_at: PhysicalTime,
    next_link: u32,
    /// Descriptors of segments on their way from owner to reader.
    descriptors: BTreeMap<(FederateId, FederateId, u32), OwnedFd>,
    /// Links to be closed once everything has been written.
    closing: Vec<LinkId>,
    control: Arc<Control>,
    failure: Option<Failure>,
    finished: bool,
    /// How long to look for news before sleeping.
    spin: Nanos,
}

/// Reaches a running RTI from other threads.
#[derive(Clone, Debug)]
pub struct RtiHandle {
    control: Arc<Control>,
}

#[derive(Debug)]
struct Control {
    bell: Bell,
    stop: AtomicBool,
    abort: AtomicBool,
}

impl RtiHandle {
    /// Asks the federation to stop in order; before the start, all are sent home.
    pub fn request_stop(&self) {
        self.control.stop.store(true, Ordering::Release);
        self.control.bell.ring();
    }

    /// Closes all links and ends [`Rti::run`].
    pub fn abort(&self) {
        self.control.abort.store(true, Ordering::Release);
        self.control.bell.ring();
    }
}

impl Rti {
    /// Listens for the federates of a program.
    ///
    /// # Errors
    ///
    /// If an address is taken.
    pub fn bind(options: &RtiOptions) -> Result<Self, Failure> {
        let network = Network::sockets().map_err(|error| no_doorbell(&error))?;
        Self::bind_on(options, &network)
    }

    pub(crate) fn bind_on(options: &RtiOptions, network: &Network) -> Result<Self, Failure> {
        log_names(&options.program);
        let topology = Topology::new(&options.program);
        let failed = |address: &Address, error: io::Error| Failure::listen(true, address, &error);
        let keys = Keys::new(options.federation, options.security.clone())?;
        let fingerprint = Arc::clone(&options.fingerprint);
        let mut addresses = std::iter::once(&options.listen).chain(&options.also_listen);
        let delay = if addresses.any(Address::is_open) { START_DELAY_ACROSS } else { START_DELAY };
        let machine = hprm_federated::Rti::new(topology, keys.name(), fingerprint, delay)
            .watching(options.patience);
        let gates = std::iter::once(&options.listen)
            .chain(&options.also_listen)
            .map(|address| {
                keys.suffice_for(address)?;
                network.listen(address).map_err(|error| failed(address, error))
            })
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            program: Arc::clone(&options.program),
            machine,
            address: gates[0].address().clone(),
            lobby: Lobby::new(gates, Purpose::Coordination, keys, options.program.federates.len()),
            links: BTreeMap::new(),
            doorbell: network.doorbell().cloned(),
            asked_at: PhysicalTime(0),
            next_link: 0,
            descriptors: BTreeMap::new(),
            closing: Vec::new(),
            control: Arc::new(Control {
                bell: Bell::new().map_err(|error| failed(&options.listen, error))?,
                stop: AtomicBool::new(false),
                abort: AtomicBool::new(false),
            }),
            failure: None,
            finished: false,
            spin: spin::time(&options.program),
        })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> &Address {
        &self.address
    }

    /// Everywhere it listens.
    pub fn addresses(&self) -> impl Iterator<Item = &Address> {
        self.lobby.addresses()
    }

    /// A handle for other threads.
    #[must_use]
    pub fn handle(&self) -> RtiHandle {
        RtiHandle { control: Arc::clone(&self.control) }
    }

    /// Coordinates until the federation has ended.
    ///
    /// # Errors
    ///
    /// The first failure of a federate, which has been reported as well.
    pub fn run(mut self, mut report: impl FnMut(RtiEvent)) -> Result<(), Failure> {
        let mut news = News { lobby: true, ..News::default() };
        loop {
            if self.control.abort.load(Ordering::Acquire) {
                break;
            }
            if self.control.stop.swap(false, Ordering::AcqRel) {
                self.handle_input(RtiInput::RequestStop);
            }
            if news.lobby {
                self.accept(&mut report)?;
            }
            for link in news.links.drain(..) {
                self.read(link);
            }
            // After what has come: an answer that is there is not late.
            if news.wakeup.is_some_and(|at| at <= Clock::now()) {
                self.handle_input(RtiInput::Wake);
            }
            self.apply(&mut report);
            self.flush(&mut report);
            if self.finished && self.closing.is_empty() {
                break;
            }
            self.wait(&mut news);
        }
        self.failure.map_or(Ok(()), Err)
    }

    fn accept(&mut self, report: &mut impl FnMut(RtiEvent)) -> Result<(), Failure> {
        let failed = |error| Failure::system("the RTI cannot accept links", &error);
        let admitted = self.lobby.admit(Clock::local()).map_err(failed)?;
        if !admitted.is_empty() {
            // Who had ended before they came is to be known to have ended.
            let links: Vec<_> = self.links.keys().copied().collect();
            links.into_iter().for_each(|link| self.read(link));
        }
        for (link, hello) in admitted {
            let id = LinkId(self.next_link);
            self.next_link += 1;
            let hello = if link.is_local() { hello } else { from_elsewhere(hello) };
            self.links.insert(id, link);
            self.frame(id, hello, None);
            self.apply(report);
            // More may have come with it.
            self.read(id);
        }
        Ok(())
    }

    /// Reads what a link holds; one that is broken is closed, and nobody else suffers.
    fn read(&mut self, id: LinkId) {
        for _ in 0..READS {
            let Some(link) = self.links.get_mut(&id) else { return };
            let arrival = match link.read() {
                Err(error) if error.kind() == io::ErrorKind::OutOfMemory || is_shortage(&error) => {
                    let advice =
                        advice(&error).map_or_else(String::new, |hint| format!("\n  hint: {hint}"));
                    self.break_off(id, format!("{error}{advice}"));
                    return;
                }
                arrival => arrival.unwrap_or(Arrival::Closed),
            };
            loop {
                let Some(link) = self.links.get_mut(&id) else { return };
                match link.next_frame() {
                    Ok(Some((frame, descriptor))) => self.frame(id, frame, descriptor),
                    Ok(None) => break,
                    Err(error) => {
                        self.break_off(id, error.to_string());
                        return;
                    }
                }
            }
            match arrival {
                Arrival::Bytes => {}
                Arrival::Rest | Arrival::Nothing => return,
                Arrival::Closed => {
                    self.close(id);
                    return;
                }
            }
        }
    }

    fn frame(&mut self, link: LinkId, frame: Frame, descriptor: Option<OwnedFd>) {
        if let (Frame::Segment { owner, reader, segment, .. }, Some(fd)) = (&frame, descriptor) {
            self.descriptors.insert((*owner, *reader, *segment), fd);
        }
        self.handle_input(RtiInput::Frame { link, frame });
    }

    fn close(&mut self, link: LinkId) {
        if self.links.remove(&link).is_some() {
            self.closing.retain(|closing| *closing != link);
            self.handle_input(RtiInput::Closed { link });
        }
    }

    /// A fault is the peer's, and costs it its link.
    fn handle_input(&mut self, input: RtiInput) {
        let from = match &input {
            RtiInput::Frame { link, .. } => Some(*link),
            _ => None,
        };
        if let (Err(fault), Some(link)) = (self.machine.handle(Clock::now(), input), from) {
            self.break_off(link, fault.to_string());
        }
    }

    /// Closes a link on which nothing more can be trusted.
    fn break_off(&mut self, link: LinkId, reason: String) {
        self.handle_input(RtiInput::Broken { link, reason });
        self.close(link);
    }

    fn apply(&mut self, report: &mut impl FnMut(RtiEvent)) {
        while let Some(output) = self.machine.poll() {
            match output {
                RtiOutput::Send { link, frame } => self.send(link, frame),
                RtiOutput::Close { link } => self.closing.push(link),
                RtiOutput::Asked { link } => {
                    if let Some(link) = self.links.get_mut(&link) {
                        link.trust();
                    }
                }
                RtiOutput::Refused { name, reason } => report(RtiEvent::Refused { name, reason }),
                RtiOutput::Joined { federate, link } => {
                    if let Some(link) = self.links.get_mut(&link) {
                        link.trust();
                    }
                    report(RtiEvent::Joined(federate));
                }
                RtiOutput::Left { federate } => report(RtiEvent::Left(federate)),
                RtiOutput::Started { at } => {
                    self.lobby.become_busy();
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
                        report: self.heard(federate, &message, code),
                    });
                }
                RtiOutput::Failed { federate, message, code } => {
                    let heard = self.heard(federate, &message, code);
                    self.failure = Some(Failure::Federate(Box::new(heard.clone())));
                    report(RtiEvent::Failed { federate, report: heard });
                }
                RtiOutput::Finished => self.finished = true,
            }
        }
        // What is left was for federates that have ended.
        self.descriptors.clear();
    }

    fn heard(&self, federate: FederateId, message: &str, code: i32) -> Report {
        Report::heard(&self.program.federates[federate].name, message, code)
    }

    fn send(&mut self, link: LinkId, frame: Frame) {
        let Some(link) = self.links.get_mut(&link) else { return };
        let descriptor = match &frame {
            Frame::Segment { owner, reader, segment, .. } => {
                self.descriptors.remove(&(*owner, *reader, *segment))
            }
            _ => None,
        };
        link.queue(frame, descriptor);
    }

    fn flush(&mut self, report: &mut impl FnMut(RtiEvent)) {
        let mut lacks = Vec::new();
        for (id, link) in &mut self.links {
            match link.flush() {
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::OutOfMemory => {
                    lacks.push((*id, error.to_string()));
                }
                // The other end is closed. What it said before is still to be read, so its end is
                // noticed there and not here.
                Err(_) => link.discard(),
            }
        }
        lacks.into_iter().for_each(|(id, reason)| self.break_off(id, reason));
        let moved: Vec<_> = self
            .links
            .iter_mut()
            .filter_map(|(id, link)| link.take_moved().then_some(*id))
            .collect();
        moved.into_iter().for_each(|link| self.handle_input(RtiInput::Moved { link }));
        let done: Vec<_> = self
            .closing
            .iter()
            .copied()
            .filter(|id| self.links.get(id).is_none_or(|link| !link.has_outbound()))
            .collect();
        for link in done {
            self.close(link);
            self.closing.retain(|closing| *closing != link);
        }
        // Closing may have caused more to say; it is written before the next wait.
        self.apply(report);
    }

    /// Waits until something may have happened; for the first nanoseconds, perhaps, without going to
    /// sleep.
    fn wait(&mut self, news: &mut News) {
        news.wakeup = self.machine.next_wakeup();
        let in_memory = self.links.values().all(Wire::is_in_memory);
        if in_memory && Clock::local().since(self.asked_at) < GLANCE && self.glance(news) {
            return;
        }
        if self.spin > 0 {
            let give_up = Clock::local().plus(self.spin);
            loop {
                let now = Clock::local();
                if now >= give_up {
                    break;
                }
                if !in_memory || now.since(self.asked_at) > SPIN_GLANCE {
                    self.sleep(news, Some(PhysicalTime(0)));
                } else {
                    self.glance(news);
                }
                let due = news.wakeup.is_some_and(|at| at <= Clock::now());
                if due || news.bell || news.is_stirred || news.lobby || !news.links.is_empty() {
                    return;
                }
            }
        }
        self.sleep(news, news.wakeup);
    }

    /// Looks at what has come through memory, without asking the system. Returns whether there is
    /// anything.
    fn glance(&self, news: &mut News) -> bool {
        (news.bell, news.is_stirred, news.lobby) = (false, false, false);
        let links = self.links.iter().filter(|(_, link)| link.has_unread());
        news.links.extend(links.map(|(id, _)| *id));
        !news.links.is_empty()
    }

    fn sleep(&mut self, news: &mut News, until: Option<PhysicalTime>) {
        let sleeps = until != Some(PhysicalTime(0));
        if sleeps {
            self.links.values_mut().for_each(Wire::fall_asleep);
        }
        // After that: whoever has seen nobody sleep has left something.
        self.ask(news, until);
        if sleeps {
            self.links.values_mut().for_each(Wire::wake_up);
        }
        self.asked_at = Clock::local();
    }

    fn ask(&self, news: &mut News, until: Option<PhysicalTime>) {
        let mut interests = Interests::new();
        interests.push(Interest { fd: self.control.bell.as_fd(), write: false });
        let doorbell = self.doorbell.iter();
        interests.extend(doorbell.map(|bell| Interest { fd: bell.as_fd(), write: false }));
        interests.extend(
            self.links
                .values()
                .map(|link| Interest { fd: link.as_fd(), write: link.waits_for_socket() }),
        );
        interests.extend(self.lobby.interests());
        let unread = self.links.values().any(Wire::has_unread).then(Clock::now);
        let impatience = self.lobby.next_wakeup().map(Clock::at);
        let until = [until, impatience, unread];
        let mut ready = wait(&interests, until.into_iter().flatten().min()).into_iter();
        news.bell = ready.next().is_some_and(Ready::is_ready);
        if news.bell {
            self.control.bell.silence();
        }
        news.is_stirred = false;
        if let Some(doorbell) = &self.doorbell
            && ready.next().is_some_and(Ready::is_ready)
        {
            doorbell.silence();
            news.is_stirred = true;
        }
        for ((id, link), ready) in self.links.iter().zip(&mut ready) {
            news.is_stirred |= ready.can_be_written();
            if ready.can_be_read() || link.has_unread() {
                news.links.push(*id);
            }
        }
        // Somebody may have taken too long, of which no descriptor tells.
        let too_long = impatience.is_some_and(|at| at <= Clock::now());
        news.lobby = too_long || ready.any(Ready::is_ready);
    }
}

/// What a wait has brought.
#[derive(Default)]
struct News {
    /// The links that have something to read.
    links: Vec<LinkId>,
    /// Whether another thread has rung.
    bell: bool,
    /// Whether another process has left something, or made room for what is to be written.
    is_stirred: bool,
    /// Whether somebody may be at the door.
    lobby: bool,
    /// When the machine wants to be woken.
    wakeup: Option<PhysicalTime>,
}

/// What somebody says who has come over TCP: not to be on this machine, even if he does.
fn from_elsewhere(mut hello: Frame) -> Frame {
    if let Frame::Hello { host, .. } = &mut hello {
        *host = host.elsewhere();
    }
    hello
}
