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
use hprm_federated::{FederationId, Frame, HostId, Input};

use super::FederateOptions;
use super::reach;
use super::search::Search;
use crate::link::{Keys, LinkAcceptor, Purpose};
use crate::poller::{Broken, Door, Found, Line, Poller, Watched};
use crate::spin;
use crate::wait::{Interest, wait};
use crate::wire::Network;
use crate::{Clock, Failure};

/// Descriptors of segments that have come, by owner and number.
type Descriptors = BTreeMap<(FederateId, u32), OwnedFd>;

/// The links of one federate.
pub(super) struct Wires {
    network: Network,
    poller: Poller,
    links: Links,
    search: Search,
    /// Whether the RTI is being looked for again.
    is_away: bool,
    keys: Keys,
    advertised: Option<String>,
    host: HostId,
    ids: Ids,
    descriptors: Descriptors,
    /// Why something could not be written.
    lack: Option<Failure>,
}

/// Tells the links with a peer apart that follow one another: a greater number is a later one.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) struct LineId(u64);

impl LineId {
    const RTI: Self = Self(0);
}

/// The latest links with each peer, and the last that this federate closed.
#[derive(Default)]
struct Ids {
    count: u64,
    outgoing: BTreeMap<FederateId, LineId>,
    incoming: BTreeMap<FederateId, LineId>,
    closed: BTreeMap<FederateId, LineId>,
}

impl Ids {
    fn next(&mut self) -> LineId {
        self.count += 1;
        LineId(self.count)
    }

    fn open(&mut self, peer: FederateId) {
        let id = self.next();
        self.outgoing.insert(peer, id);
    }

    fn accept(&mut self, peer: FederateId) -> LineId {
        let id = self.next();
        self.incoming.insert(peer, id);
        id
    }

    fn close(&mut self, peer: FederateId) {
        self.closed.insert(peer, LineId(self.count));
    }

    fn outgoing(&self, peer: FederateId) -> LineId {
        self.outgoing.get(&peer).copied().unwrap_or(LineId::RTI)
    }

    fn incoming(&self, peer: FederateId) -> LineId {
        self.incoming.get(&peer).copied().unwrap_or(LineId::RTI)
    }

    fn is_closed(&self, peer: FederateId, id: LineId) -> bool {
        self.closed.get(&peer).is_some_and(|closed| id <= *closed)
    }
}

/// The links of a federate.
struct Links {
    rti: Option<Line>,
    /// Those that this federate opened: its messages go there.
    outgoing: BTreeMap<FederateId, Line>,
    /// Those that peers opened: their messages come from there.
    incoming: BTreeMap<FederateId, Line>,
    /// Where peers open links, if the coordination needs them.
    door: Option<Door>,
}

impl Watched for Links {
    fn lines(&self) -> impl Iterator<Item = &Line> {
        self.rti.iter().chain(self.outgoing.values()).chain(self.incoming.values())
    }

    fn lines_mut(&mut self) -> impl Iterator<Item = &mut Line> {
        self.rti.iter_mut().chain(self.outgoing.values_mut()).chain(self.incoming.values_mut())
    }

    fn door(&self) -> Option<&Door> {
        self.door.as_ref()
    }

    fn door_mut(&mut self) -> Option<&mut Door> {
        self.door.as_mut()
    }
}

impl Links {
    /// What carries this federate's messages to a peer, if they do not go by way of the RTI.
    fn to(&self, peer: FederateId) -> Option<&Line> {
        self.outgoing.get(&peer).or_else(|| self.incoming.get(&peer))
    }

    /// Whether the link to the RTI is such as only processes of one user on one machine have.
    fn is_beside_rti(&self) -> bool {
        self.rti.as_ref().is_some_and(|line| line.wire.is_local())
    }
}

impl Wires {
    /// Connects to the RTI, and listens for peers if the coordination needs them.
    pub(super) fn connect(options: &FederateOptions, network: Network) -> Result<Self, Failure> {
        let keys = Keys::new(options.federation, options.security.clone())?;
        let mut search = Search::new(options);
        let rti = search.find(&keys, &network)?;
        let decentralized = options.program.properties.coordination == Coordination::Decentralized;
        let (mut door, mut advertised) = (None, None);
        if decentralized {
            let (gates, addresses) = reach::listen(options, &rti, &keys, &network)?;
            let members = options.program.federates.len();
            door =
                Some(Door::new(LinkAcceptor::new(gates, Purpose::Messages, keys.clone(), members)));
            advertised = Some(addresses);
        }
        Ok(Self {
            host: reach::host_id(rti.is_local(), decentralized),
            poller: Poller::new(network.notifier(), spin::time(&options.program)),
            network,
            links: Links {
                rti: Some(Line::new(rti)),
                outgoing: BTreeMap::new(),
                incoming: BTreeMap::new(),
                door,
            },
            search,
            is_away: false,
            keys,
            advertised,
            ids: Ids::default(),
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
        self.links.rti = None;
        self.is_away = true;
        self.search.lost()
    }

    /// When to look for the RTI again, if it is lost.
    pub(super) fn next_wakeup(&self) -> Option<PhysicalTime> {
        self.is_away.then(|| self.search.next())
    }

    /// The federation runs: members come before pending links.
    pub(super) fn become_busy(&mut self) {
        self.links.door.iter_mut().for_each(|door| door.acceptor.become_busy());
    }

    /// Whether the RTI runs on this host.
    pub(super) fn is_beside_rti(&self) -> bool {
        self.links.rti.as_ref().is_some_and(|line| line.wire.is_within_host())
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
        self.links.outgoing.insert(peer, Line::new(link));
        self.ids.open(peer);
        Ok(())
    }

    /// Closes the links with a peer.
    pub(super) fn disconnect(&mut self, peer: FederateId) {
        self.links.outgoing.remove(&peer);
        self.links.incoming.remove(&peer);
        self.ids.close(peer);
    }

    /// Whether an input comes from a link with a peer that this federate has closed since it was read, or
    /// has replaced by another link.
    pub(super) fn is_past(&self, id: LineId, input: &Input) -> bool {
        let (Input::PeerUp(peer) | Input::PeerLost(peer) | Input::FromPeer { from: peer, .. }) =
            input
        else {
            return false;
        };
        let replaced = self.links.outgoing.contains_key(peer) && id < self.ids.outgoing(*peer);
        replaced || self.ids.is_closed(*peer, id)
    }

    /// Whether descriptors reach a federate on the same host before a message on such a channel.
    pub(super) fn pass_descriptors(&self, to: FederateId, physical: bool) -> bool {
        match self.links.to(to) {
            // A message on a physical channel takes the other way, and may overtake them.
            Some(line) => line.wire.is_local() && !physical,
            None => self.links.is_beside_rti(),
        }
    }

    /// Whether all links with a peer, or the one with the RTI if there are none, are such as only
    /// processes of one user on one machine have.
    pub(super) fn is_beside(&self, peer: FederateId) -> bool {
        let Links { outgoing, incoming, .. } = &self.links;
        let mut lines = outgoing.get(&peer).into_iter().chain(incoming.get(&peer));
        match lines.next() {
            Some(line) => line.wire.is_local() && lines.all(|line| line.wire.is_local()),
            None => self.links.is_beside_rti(),
        }
    }

    pub(super) fn tell_rti(&mut self, frame: Frame, descriptor: Option<OwnedFd>) {
        if let Some(line) = &mut self.links.rti {
            line.wire.queue(frame, descriptor);
        }
    }

    pub(super) fn tell_peer(&mut self, to: FederateId, frame: Frame, descriptor: Option<OwnedFd>) {
        let Links { outgoing, incoming, .. } = &mut self.links;
        let link = outgoing.get_mut(&to).or_else(|| incoming.get_mut(&to));
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
        for link in self.links.wires_mut() {
            match link.flush() {
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::OutOfMemory => {
                    lack = Some(no_memory(&error));
                }
                Err(_) => link.discard(),
            }
        }
        self.lack = self.lack.take().or(lack);
    }

    /// Whether there is as much to write as the other end reads at once. Where it took no more the last
    /// time, it is not tried again each time there is something to add.
    pub(super) fn have_much_to_write(&self) -> bool {
        self.links.wires().any(|link| link.writable_len() >= EAGER_BUFFER)
    }

    /// Says goodbye: writes everything within `patience`, and makes sure that it arrives. `all` means that
    /// a long message may take longer, as long as it moves.
    pub(super) fn leave(&mut self, patience: Nanos, all: bool) {
        self.poller.drain(&mut self.links, patience, all);
        let until = Clock::now().plus(patience);
        // A TCP connection that is closed before everything has been read is reset, and the other
        // end loses what it has not read yet. So it is closed from there.
        let mut links: Vec<_> = self.links.wires_mut().filter(|link| !link.is_local()).collect();
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

    /// Reads what the links hold that are known to be ready, up to a limit for each. `admit` tells
    /// who greets, and what to answer.
    pub(super) fn read(
        &mut self,
        admit: impl Fn(&Frame) -> Option<(FederateId, Frame)>,
        inputs: &mut Vec<(LineId, Input)>,
    ) -> Result<(), Failure> {
        self.lack.take().map_or(Ok(()), Err)?;
        self.read_rti(inputs)?;
        self.read_greetings(admit, inputs)?;
        self.read_peers(inputs)
    }

    /// Waits until a link is ready, the loop is notified, or `until` has come.
    pub(super) fn wait(&mut self, inbox: &impl AsFd, until: Option<PhysicalTime>) -> Found {
        self.poller.wait(&mut self.links, inbox, until)
    }

    /// Looks for what has come by now. It does not wait.
    pub(super) fn look(&mut self, inbox: &impl AsFd) -> Found {
        self.poller.look(&mut self.links, inbox)
    }

    fn read_rti(&mut self, inputs: &mut Vec<(LineId, Input)>) -> Result<(), Failure> {
        if self.is_away
            && let Some(link) = self.search.look(&self.keys, &self.network)?
        {
            self.links.rti = Some(Line::new(link));
            self.is_away = false;
            inputs.push((LineId::RTI, Input::Rejoins));
        }
        let Some(line) = &mut self.links.rti else { return Ok(()) };
        let descriptors = &mut self.descriptors;
        let open = line.read(|frame, descriptor| {
            keep(descriptors, &frame, descriptor);
            inputs.push((LineId::RTI, Input::FromRti(frame)));
        });
        if !open.map_err(failure)? {
            self.links.rti = None;
            inputs.push((LineId::RTI, Input::RtiLost));
        }
        Ok(())
    }

    /// A peer's first frame says whose link it is. Whoever cannot say that is not answered.
    fn read_greetings(
        &mut self,
        admit: impl Fn(&Frame) -> Option<(FederateId, Frame)>,
        inputs: &mut Vec<(LineId, Input)>,
    ) -> Result<(), Failure> {
        let Some(door) = self.links.door.as_mut().filter(|door| door.is_ready()) else {
            return Ok(());
        };
        let admitted = door
            .admit(Clock::local())
            .map_err(|error| Failure::system("cannot accept a connection of a peer", &error))?;
        for (mut link, hello) in admitted {
            if let Some((from, welcome)) = admit(&hello) {
                link.trust();
                link.queue(welcome, None);
                self.links.incoming.insert(from, Line::new(link));
                inputs.push((self.ids.accept(from), Input::PeerUp(from)));
            }
        }
        Ok(())
    }

    /// A peer whose link is broken is as good as gone.
    fn read_peers(&mut self, inputs: &mut Vec<(LineId, Input)>) -> Result<(), Failure> {
        let Self { links: Links { outgoing, incoming, .. }, descriptors, ids, .. } = self;
        // Messages of a peer whose own link has ended come over the other one, and there may be more.
        let mut ended = Vec::new();
        for (peer, line) in &mut *outgoing {
            check_proof(line, *peer)?;
            let id = ids.outgoing(*peer);
            if !read_peer(line, (*peer, id), descriptors, inputs)? {
                ended.push(*peer);
                if !incoming.contains_key(peer) {
                    inputs.push((id, Input::PeerLost(*peer)));
                }
            }
        }
        ended.drain(..).for_each(|peer| drop(outgoing.remove(&peer)));
        for (peer, line) in &mut *incoming {
            let id = ids.incoming(*peer);
            if !read_peer(line, (*peer, id), descriptors, inputs)? {
                ended.push(*peer);
                inputs.push((id, Input::PeerLost(*peer)));
            }
        }
        ended.drain(..).for_each(|peer| drop(incoming.remove(&peer)));
        Ok(())
    }
}

/// Whoever listens where a peer should must prove that it is one.
fn check_proof(line: &mut Line, peer: FederateId) -> Result<(), Failure> {
    if line.wire.is_established() {
        return Ok(());
    }
    let read = line.wire.read().map(drop);
    read.map_err(|error| Failure::Link(format!("the link to federate {}: {error}", peer.0)))
}

/// Reads a link of a peer, if it is ready. Returns whether it is still open. Only what is the fault of
/// neither of them is a failure.
fn read_peer(
    line: &mut Line,
    (from, id): (FederateId, LineId),
    descriptors: &mut Descriptors,
    inputs: &mut Vec<(LineId, Input)>,
) -> Result<bool, Failure> {
    let open = line.read(|frame, descriptor| {
        if let Frame::PeerWelcome { .. } = frame {
            inputs.push((id, Input::PeerUp(from)));
            return;
        }
        keep(descriptors, &frame, descriptor);
        inputs.push((id, Input::FromPeer { from, frame }));
    });
    match open {
        Err(broken @ (Broken::Shortage(_) | Broken::Frame(CodecError::NoMemory(_)))) => {
            Err(failure(broken))
        }
        open => Ok(open.unwrap_or(false)),
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

/// What it means that a link cannot be read any further.
fn failure(broken: Broken) -> Failure {
    match broken {
        Broken::Shortage(error) if error.kind() == io::ErrorKind::OutOfMemory => no_memory(&error),
        Broken::Shortage(error) => Failure::system("cannot receive from another federate", &error),
        Broken::Frame(error @ CodecError::NoMemory(_)) => no_memory(&error),
        Broken::Frame(error) => Failure::Link(format!("a link is broken: {error}")),
        Broken::Link(error) => Failure::Link(format!("a link is broken: {error}")),
    }
}
