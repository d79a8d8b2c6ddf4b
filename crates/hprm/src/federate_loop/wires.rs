//! A federate's links: to the RTI, and under decentralized coordination to its peers.
//!
//! It greets peers and turns bytes into frames. What a frame means is the machine's business.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::io;
use std::os::fd::{AsFd, OwnedFd};

use hprm_core::limits::EAGER_BUFFER;
use hprm_core::{Coordination, FederateId, Nanos, PhysicalTime};
use hprm_federated::codec::CodecError;
use hprm_federated::{FederationId, Frame, HostId};

use super::FederateOptions;
use super::reach;
use super::search::Search;
use crate::link::descriptors::is_shortage;
use crate::link::{Arrival, Keys, Lobby, Purpose, READS};
use crate::wait::{GLANCE, Interest, Interests, Ready, SPIN_GLANCE, wait};
use crate::wire::{Network, Wire};
use crate::{Clock, Failure, Inbox};

/// A time that has come, whatever the clock says.
const NOW: PhysicalTime = PhysicalTime(0);

/// What has come from a link.
pub(super) enum Event {
    FromRti(Frame),
    FromPeer {
        from: FederateId,
        frame: Frame,
    },
    RtiLost,
    /// There is another link to the RTI.
    RtiFound,
    PeerUp(FederateId),
    PeerLost(FederateId),
}

/// A link, and what is known of it without asking the kernel.
struct Line {
    wire: Wire,
    /// Whether there may be something to read.
    is_ready: bool,
    is_closed: bool,
}

/// Descriptors of segments that have come, by owner and number.
type Descriptors = BTreeMap<(FederateId, u32), OwnedFd>;

/// The links of one federate.
pub(super) struct Wires {
    network: Network,
    rti: Option<Line>,
    search: Search,
    /// Whether the RTI is being looked for again.
    is_away: bool,
    keys: Keys,
    /// Where peers open links, if the coordination needs them.
    lobby: Option<Lobby>,
    /// Whether somebody may be at the door.
    lobby_is_ready: bool,
    advertised: Option<String>,
    /// Links that this federate opened: its messages go there.
    outgoing: BTreeMap<FederateId, Line>,
    /// Links that peers opened: their messages come from there.
    incoming: BTreeMap<FederateId, Line>,
    /// When the system was last asked what has come.
    asked_at: PhysicalTime,
    /// Whether somebody has left something then, or made room for what is to be written.
    is_stirred: bool,
    host: HostId,
    descriptors: Descriptors,
    /// Why something could not be written.
    lack: Option<Failure>,
}

impl Wires {
    /// Connects to the RTI, and listens for peers if the coordination needs them.
    pub(super) fn connect(options: &FederateOptions, network: Network) -> Result<Self, Failure> {
        let keys = Keys::new(options.federation, options.security.clone())?;
        let mut search = Search::new(options);
        let rti = search.find(&keys, &network)?;
        let decentralized = options.program.properties.coordination == Coordination::Decentralized;
        let (mut lobby, mut advertised) = (None, None);
        if decentralized {
            let (gates, addresses) = reach::listen(options, &rti, &keys, &network)?;
            let members = options.program.federates.len();
            lobby = Some(Lobby::new(gates, Purpose::Messages, keys.clone(), members));
            advertised = Some(addresses);
        }
        Ok(Self {
            host: reach::host_id(rti.is_local(), decentralized),
            network,
            rti: Some(Line::new(rti)),
            search,
            is_away: false,
            keys,
            lobby_is_ready: lobby.is_some(),
            lobby,
            advertised,
            outgoing: BTreeMap::new(),
            incoming: BTreeMap::new(),
            asked_at: NOW,
            is_stirred: false,
            descriptors: BTreeMap::new(),
            lack: None,
        })
    }

    /// The link to the RTI is of no use, and this federate joins again over another one.
    ///
    /// # Errors
    ///
    /// If that is in vain.
    pub(super) fn lose_rti(&mut self) -> Result<(), Failure> {
        self.rti = None;
        self.is_away = true;
        self.search.lost()
    }

    /// When to look for the RTI again, if it is lost.
    pub(super) fn next_wakeup(&self) -> Option<PhysicalTime> {
        self.is_away.then(|| self.search.next())
    }

    /// The federation runs: members come before strangers.
    pub(super) fn become_busy(&mut self) {
        self.lobby.iter_mut().for_each(Lobby::become_busy);
    }

    /// Whether the RTI runs on this host.
    pub(super) fn is_beside_rti(&self) -> bool {
        self.rti.as_ref().is_some_and(|line| line.wire.is_within_host())
    }

    /// What frames call this federation.
    pub(super) fn federation(&self) -> FederationId {
        self.keys.name()
    }

    /// Which federates share this one's memory: those with the same number.
    pub(super) fn host(&self) -> HostId {
        self.host
    }

    /// Where peers reach this federate.
    pub(super) fn advertised(&self) -> Option<String> {
        self.advertised.clone()
    }

    /// Opens the link that carries this federate's messages to `peer`, which listens at one of
    /// `addresses`. It does not wait for the other end, which may be doing the same.
    ///
    /// # Errors
    ///
    /// Where it cannot be reached, and why.
    pub(super) fn connect_peer(
        &mut self,
        peer: FederateId,
        addresses: &str,
        same_host: bool,
        hello: Frame,
    ) -> Result<(), String> {
        let mut link = reach::peer(addresses, same_host, &self.keys, &self.network)?;
        link.queue(hello, None);
        self.outgoing.insert(peer, Line::new(link));
        Ok(())
    }

    /// Whether descriptors reach a federate on the same host before a message on such a channel.
    pub(super) fn pass_descriptors(&self, to: FederateId, physical: bool) -> bool {
        match self.outgoing.get(&to).or_else(|| self.incoming.get(&to)) {
            // A message on a physical channel takes the other way, and may overtake them.
            Some(line) => line.is_local() && !physical,
            None => self.rti.as_ref().is_some_and(Line::is_local),
        }
    }

    /// Whether all links with a peer, or the one with the RTI if there are none, are such as only
    /// processes of one user on one machine have.
    pub(super) fn is_beside(&self, peer: FederateId) -> bool {
        let mut links = self.outgoing.get(&peer).into_iter().chain(self.incoming.get(&peer));
        match links.next() {
            Some(link) => link.is_local() && links.all(Line::is_local),
            None => self.rti.as_ref().is_some_and(Line::is_local),
        }
    }

    pub(super) fn tell_rti(&mut self, frame: Frame, descriptor: Option<OwnedFd>) {
        if let Some(line) = &mut self.rti {
            line.wire.queue(frame, descriptor);
        }
    }

    pub(super) fn tell_peer(&mut self, to: FederateId, frame: Frame, descriptor: Option<OwnedFd>) {
        let link = self.outgoing.get_mut(&to).or_else(|| self.incoming.get_mut(&to));
        if let Some(line) = link {
            line.wire.queue(frame, descriptor);
        }
    }

    /// The descriptor that came with the announcement of a segment.
    pub(super) fn take_descriptor(&mut self, owner: FederateId, segment: u32) -> Option<OwnedFd> {
        self.descriptors.remove(&(owner, segment))
    }

    /// Writes what can be written. A peer that is gone is noticed when its link is read, and so is that
    /// there was no memory for it.
    pub(super) fn flush(&mut self) {
        let mut lack = None;
        for link in self.links_mut() {
            match link.flush() {
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::OutOfMemory => {
                    lack = Some(Broken::memory(&error).failure());
                }
                Err(_) => link.discard(),
            }
        }
        self.lack = self.lack.take().or(lack);
    }

    /// Whether there is as much to write as the other end reads at once. Where it took no more the last
    /// time, it is not tried again each time there is something to add.
    pub(super) fn have_much_to_write(&self) -> bool {
        self.links().any(|link| link.writable_len() >= EAGER_BUFFER)
    }

    /// Says goodbye: writes everything within `patience`, and makes sure that it arrives. `all` means that
    /// a long message may take longer, as long as it moves.
    pub(super) fn leave(&mut self, patience: Nanos, all: bool) {
        self.drain(patience, all);
        let until = Clock::now().plus(patience);
        // A TCP connection that is closed before everything has been read is reset, and the other
        // end loses what it has not read yet. So it is closed from there.
        let mut links: Vec<_> = self.links_mut().filter(|link| !link.is_local()).collect();
        links.iter_mut().for_each(|link| link.finish());
        while !links.is_empty() && Clock::now() < until {
            links.retain_mut(|link| link.is_open());
            let waiting: Vec<_> =
                links.iter().map(|link| Interest { fd: link.as_fd(), write: false }).collect();
            if !waiting.is_empty() {
                wait(&waiting, Some(until));
            }
        }
    }

    fn drain(&mut self, patience: Nanos, all: bool) {
        let mut until = Clock::now().plus(patience);
        while Clock::now() < until {
            // A link that cannot be written has nobody left to read it.
            self.links_mut().for_each(|link| link.flush().unwrap_or_else(|_| link.discard()));
            let moved = self.links_mut().fold(false, |moved, link| link.take_moved() | moved);
            if all && moved {
                until = Clock::now().plus(patience);
            }
            let blocked = self.links().filter(|link| link.has_outbound());
            let mut interests: Interests = blocked
                .map(|link| Interest { fd: link.as_fd(), write: link.waits_for_socket() })
                .collect();
            if interests.is_empty() {
                return;
            }
            let doorbell = self.network.doorbell();
            interests.extend(doorbell.map(|bell| Interest { fd: bell.as_fd(), write: false }));
            wait(&interests, Some(until));
            doorbell.iter().for_each(|bell| bell.silence());
        }
    }

    /// Reads what the links hold that are known to be ready, up to a limit for each. `admit` tells
    /// who greets, and what to answer.
    pub(super) fn read(
        &mut self,
        admit: impl Fn(&Frame) -> Option<(FederateId, Frame)>,
        events: &mut Vec<Event>,
    ) -> Result<(), Failure> {
        self.lack.take().map_or(Ok(()), Err)?;
        self.read_rti(events)?;
        self.read_greetings(admit, events)?;
        self.read_peers(events)
    }

    /// Waits until a link is ready, the bell rings, or `until` has come; for the first `spin`
    /// nanoseconds without going to sleep. Returns whether the bell has rung.
    pub(super) fn wait<V>(
        &mut self,
        bell: &Inbox<V>,
        until: Option<PhysicalTime>,
        spin: Nanos,
    ) -> bool {
        let in_memory = self.lines().all(|line| line.wire.is_in_memory());
        if in_memory && Clock::local().since(self.asked_at) < GLANCE && self.has_news() {
            return false;
        }
        if spin > 0 {
            let give_up = Clock::local().plus(spin);
            self.is_stirred = false;
            loop {
                let now = Clock::local();
                if now >= give_up {
                    break;
                }
                let ask = !in_memory || now.since(self.asked_at) > SPIN_GLANCE;
                let bell_rings = ask && self.sleep(bell, Some(NOW));
                let due = until.is_some_and(|until| until <= Clock::now());
                if bell_rings || due || self.is_stirred || self.has_news() {
                    return bell_rings;
                }
            }
        }
        self.sleep(bell, until)
    }

    fn sleep<V>(&mut self, bell: &Inbox<V>, until: Option<PhysicalTime>) -> bool {
        let sleeps = until != Some(NOW);
        if sleeps {
            self.links_mut().for_each(Wire::fall_asleep);
        }
        // After that: whoever has seen nobody sleep has left something.
        let bell_rings = self.ask(bell, until);
        if sleeps {
            self.links_mut().for_each(Wire::wake_up);
        }
        self.asked_at = Clock::local();
        bell_rings
    }

    fn ask<V>(&mut self, bell: &Inbox<V>, until: Option<PhysicalTime>) -> bool {
        let impatience = self.lobby.as_ref().and_then(Lobby::next_wakeup).map(Clock::at);
        let unread = self.lines().any(Line::may_be_read).then(Clock::now);
        let until = until.into_iter().chain(impatience).chain(unread).min();
        let mut ready = wait(&self.interests(bell), until).into_iter();
        let bell_rings = ready.next().is_some_and(Ready::is_ready);
        let mut is_stirred = false;
        if let Some(doorbell) = self.network.doorbell()
            && ready.next().is_some_and(Ready::is_ready)
        {
            doorbell.silence();
            is_stirred = true;
        }
        self.lines_mut().zip(&mut ready).for_each(|(line, ready)| {
            line.is_ready |= ready.can_be_read();
            is_stirred |= ready.can_be_written();
        });
        self.is_stirred = is_stirred;
        // Somebody may have taken too long, of which no descriptor tells.
        let too_long = impatience.is_some_and(|at| at <= Clock::now());
        self.lobby_is_ready |= too_long || ready.any(Ready::is_ready);
        bell_rings
    }

    fn interests<'a, V>(&'a self, bell: &'a Inbox<V>) -> Interests<'a> {
        let mut interests = Interests::new();
        interests.push(Interest { fd: bell.as_fd(), write: false });
        let doorbell = self.network.doorbell();
        interests.extend(doorbell.map(|bell| Interest { fd: bell.as_fd(), write: false }));
        let links = self.links();
        interests.extend(
            links.map(|link| Interest { fd: link.as_fd(), write: link.waits_for_socket() }),
        );
        interests.extend(self.lobby.iter().flat_map(Lobby::interests));
        interests
    }

    /// Whether there is something to read by now. It does not wait.
    pub(super) fn look<V>(&mut self, bell: &Inbox<V>) -> bool {
        let in_memory = self.lines().all(|line| line.wire.is_in_memory());
        if !in_memory || Clock::local().since(self.asked_at) >= GLANCE {
            self.sleep(bell, Some(NOW));
        }
        self.has_news()
    }

    fn has_news(&self) -> bool {
        self.lobby_is_ready || self.lines().any(Line::may_be_read)
    }

    fn lines(&self) -> impl Iterator<Item = &Line> {
        self.rti.iter().chain(self.outgoing.values()).chain(self.incoming.values())
    }

    fn lines_mut(&mut self) -> impl Iterator<Item = &mut Line> {
        self.rti.iter_mut().chain(self.outgoing.values_mut()).chain(self.incoming.values_mut())
    }

    fn links(&self) -> impl Iterator<Item = &Wire> {
        self.lines().map(|line| &line.wire)
    }

    fn links_mut(&mut self) -> impl Iterator<Item = &mut Wire> {
        self.lines_mut().map(|line| &mut line.wire)
    }

    fn read_rti(&mut self, events: &mut Vec<Event>) -> Result<(), Failure> {
        if self.is_away
            && let Some(link) = self.search.look(&self.keys, &self.network)?
        {
            self.rti = Some(Line::new(link));
            self.is_away = false;
            events.push(Event::RtiFound);
        }
        let Some(line) = &mut self.rti else { return Ok(()) };
        let descriptors = &mut self.descriptors;
        let open = line.read(|frame, descriptor| {
            keep(descriptors, &frame, descriptor);
            events.push(Event::FromRti(frame));
        });
        let open = open.map_err(Broken::failure)?;
        if !open {
            self.rti = None;
            events.push(Event::RtiLost);
        }
        Ok(())
    }

    /// A peer's first frame says whose link it is. Whoever cannot say that is not answered.
    fn read_greetings(
        &mut self,
        admit: impl Fn(&Frame) -> Option<(FederateId, Frame)>,
        events: &mut Vec<Event>,
    ) -> Result<(), Failure> {
        let Some(lobby) = &mut self.lobby else { return Ok(()) };
        if !std::mem::take(&mut self.lobby_is_ready) {
            return Ok(());
        }
        let admitted = lobby
            .admit(Clock::local())
            .map_err(|error| Failure::system("cannot accept a connection of a peer", &error))?;
        for (mut link, hello) in admitted {
            if let Some((from, welcome)) = admit(&hello) {
                link.trust();
                link.queue(welcome, None);
                self.incoming.insert(from, Line::new(link));
                events.push(Event::PeerUp(from));
            }
        }
        Ok(())
    }

    /// A peer whose link is broken is as good as gone.
    fn read_peers(&mut self, events: &mut Vec<Event>) -> Result<(), Failure> {
        let Self { outgoing, incoming, descriptors, .. } = self;
        for (peer, line) in &mut *outgoing {
            line.check_proof(*peer)?;
            if !line.read_peer(*peer, descriptors, events)?
                // Its messages come over the other link, and there may be more of them.
                && !incoming.contains_key(peer)
            {
                events.push(Event::PeerLost(*peer));
            }
        }
        for (peer, line) in &mut *incoming {
            if !line.read_peer(*peer, descriptors, events)? {
                events.push(Event::PeerLost(*peer));
            }
        }
        outgoing.retain(|_, line| !line.is_closed);
        incoming.retain(|_, line| !line.is_closed);
        Ok(())
    }
}

impl Line {
    fn new(wire: Wire) -> Self {
        // What came while it was opened is not news to the kernel.
        Self { wire, is_ready: true, is_closed: false }
    }

    fn is_local(&self) -> bool {
        self.wire.is_local()
    }

    fn may_be_read(&self) -> bool {
        self.is_ready || self.wire.has_unread()
    }

    /// Whoever listens where a peer should must prove that it is one.
    fn check_proof(&mut self, peer: FederateId) -> Result<(), Failure> {
        if self.wire.is_established() {
            return Ok(());
        }
        self.wire
            .read()
            .map(drop)
            .map_err(|error| Failure::Link(format!("the link to federate {}: {error}", peer.0)))
    }

    /// Reads a link of a peer, if it is ready. Returns whether it is still open. Only what is the fault
    /// of neither of them is a failure.
    fn read_peer(
        &mut self,
        from: FederateId,
        descriptors: &mut Descriptors,
        events: &mut Vec<Event>,
    ) -> Result<bool, Failure> {
        let open = self.read(|frame, descriptor| {
            if let Frame::PeerWelcome { .. } = frame {
                events.push(Event::PeerUp(from));
                return;
            }
            keep(descriptors, &frame, descriptor);
            events.push(Event::FromPeer { from, frame });
        });
        self.is_closed = match open {
            Ok(open) => !open,
            Err(Broken::Link(_)) => true,
            Err(Broken::Memory(failure)) => return Err(failure),
        };
        Ok(!self.is_closed)
    }

    /// Reads what the link holds, if it is ready. Returns whether the other end is still open.
    fn read(&mut self, mut arrive: impl FnMut(Frame, Option<OwnedFd>)) -> Result<bool, Broken> {
        if !self.may_be_read() {
            return Ok(true);
        }
        self.is_ready = false;
        for _ in 0..READS {
            let arrival = self.wire.read().map_err(Broken::reading)?;
            while let Some((frame, descriptor)) =
                self.wire.next_frame().map_err(Broken::decoding)?
            {
                arrive(frame, descriptor);
            }
            match arrival {
                Arrival::Bytes => {}
                Arrival::Rest | Arrival::Nothing => return Ok(true),
                Arrival::Closed => return Ok(false),
            }
        }
        self.is_ready = true;
        Ok(true)
    }
}

fn keep(descriptors: &mut Descriptors, frame: &Frame, descriptor: Option<OwnedFd>) {
    if let (Frame::Segment { owner, segment, .. }, Some(descriptor)) = (frame, descriptor) {
        descriptors.insert((*owner, *segment), descriptor);
    }
}

/// A message is too much for this process, which sends or receives it.
pub(super) fn no_memory(error: &dyn Display) -> Failure {
    Failure::Memory(error.to_string())
}

/// Why a link is not read any further.
enum Broken {
    Link(Failure),
    /// There is no memory for what has come.
    Memory(Failure),
}

impl Broken {
    fn reading(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::OutOfMemory => Self::memory(&error),
            _ if is_shortage(&error) => {
                Self::Memory(Failure::system("cannot receive from another federate", &error))
            }
            _ => Self::link(&error),
        }
    }

    fn decoding(error: CodecError) -> Self {
        match error {
            CodecError::NoMemory(_) => Self::memory(&error),
            _ => Self::link(&error),
        }
    }

    fn link(error: &dyn Display) -> Self {
        Self::Link(Failure::Link(format!("a link is broken: {error}")))
    }

    fn memory(error: &dyn Display) -> Self {
        Self::Memory(no_memory(error))
    }

    fn failure(self) -> Failure {
        match self {
            Self::Link(failure) | Self::Memory(failure) => failure,
        }
    }
}
