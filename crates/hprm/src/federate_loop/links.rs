//! A federate's links: to the RTI, and under decentralized coordination to its peers.
//!
//! It opens and accepts links. `reading` takes the frames of peers from them, `writing` decides when frames leave. The
//! machine decides what a frame means.

mod reading;
mod writing;

use std::collections::BTreeMap;
use std::fmt::Display;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use hprm_core::{Coordination, FederateId, Nanos, PhysicalTime, SortedMap};
use hprm_federated::codec::CodecError;
use hprm_federated::{Carried, FederationId, Frame, HostId, Input, shipments_to};

use super::FederateOptions;
use super::boards::Boards;
use super::openings::Openings;
use super::reach;
use super::search::Search;
use crate::agent::agent_address;
use crate::frame_log::{FrameLog, Party};
use crate::link::{Keys, Link, LinkAcceptor, Network, Purpose};
use crate::poller::{Broken, Found, PollSet, PolledAcceptor, PolledLink, Poller};
use crate::shipping::Shipping;
use crate::spin;
use crate::variables::may_use_boards;
use crate::wait::{Deadline, Interest, wait};
use crate::watch::WatchServer;
use crate::{Address, Clock, Failure};

/// How long one attempt to connect to a peer may take. The federate's loop does nothing else meanwhile.
const CONNECT_TIMEOUT: Nanos = 2_000_000_000;

/// Descriptors that have arrived, by owner and what they are for.
type Descriptors = BTreeMap<(FederateId, Carried), OwnedFd>;

/// The links of one federate, with what opens, accepts and polls them.
pub(super) struct FederateLinks {
    network: Network,
    poller: Poller,
    polled: PolledLinks,
    search: Search,
    openings: Openings,
    /// Tells the user something.
    notice: Option<fn(&str)>,
    /// Whether the link to the RTI is lost, and this federate looks for the RTI again.
    rti_link_lost: bool,
    keys: Keys,
    advertised: Option<String>,
    host: HostId,
    serials: LinkSerials,
    descriptors: Descriptors,
    /// The peers to which frames are to be sent since the last flush, in the order of the first ones. On a machine whose
    /// processors are busy, the kernel may let a process that is notified run at once, and the next one waits for it.
    unsent: Vec<FederateId>,
    /// Whether other links with peers may have something to write. If not, a flush looks at none of them.
    peers_may_have_outbound: bool,
    /// The same for the link to the RTI.
    rti_may_have_outbound: bool,
    /// The failure of a write for which this process had no memory. The next read returns it.
    write_failure: Option<Failure>,
    /// The log of all frames, if there is one.
    log: FrameLog,
}

/// The number of a link. A federate and a peer may open and close several links one after the other; a later
/// link has a greater number.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) struct LinkSerial(u64);

impl LinkSerial {
    /// The number of the link to the RTI, and of the link to a peer if there has been none: less than that of any
    /// link to a peer.
    const RTI: Self = Self(0);

    /// The link of that number.
    #[cfg(test)]
    pub(super) fn of(number: u64) -> Self {
        Self(number)
    }
}

/// For each peer, the numbers of the latest links, and the greatest number that was in use when this federate
/// last closed the links with the peer.
#[derive(Default)]
struct LinkSerials {
    count: u64,
    outgoing: SortedMap<FederateId, LinkSerial>,
    incoming: SortedMap<FederateId, LinkSerial>,
    closed: SortedMap<FederateId, LinkSerial>,
}

impl LinkSerials {
    fn next(&mut self) -> LinkSerial {
        self.count += 1;
        LinkSerial(self.count)
    }

    fn open(&mut self, peer: FederateId) {
        let serial = self.next();
        self.outgoing.insert(peer, serial);
    }

    fn accept(&mut self, peer: FederateId) -> LinkSerial {
        let serial = self.next();
        self.incoming.insert(peer, serial);
        serial
    }

    fn close(&mut self, peer: FederateId) {
        self.closed.insert(peer, LinkSerial(self.count));
    }

    fn outgoing(&self, peer: FederateId) -> LinkSerial {
        self.outgoing.get(&peer).copied().unwrap_or(LinkSerial::RTI)
    }

    fn incoming(&self, peer: FederateId) -> LinkSerial {
        self.incoming.get(&peer).copied().unwrap_or(LinkSerial::RTI)
    }

    fn is_closed(&self, peer: FederateId, serial: LinkSerial) -> bool {
        self.closed.get(&peer).is_some_and(|closed| serial <= *closed)
    }
}

/// The open links of a federate, and the acceptor of new ones.
struct PolledLinks {
    rti: Option<PolledLink>,
    /// Links that this federate opened: it sends its messages over these.
    outgoing: SortedMap<FederateId, PolledLink>,
    /// Links that peers opened: their messages come over these.
    incoming: SortedMap<FederateId, PolledLink>,
    /// Accepts links of peers, if the coordination needs them.
    acceptor: Option<PolledAcceptor>,
    /// Shows the messages of this federate to watchers.
    watch: Option<WatchServer>,
    /// What federates show one another, if that coordinates them.
    boards: Option<Boards>,
    /// Takes large values to other machines, and gets theirs, if agents do that.
    shipping: Option<Shipping>,
}

impl PollSet for PolledLinks {
    fn polled_links(&self) -> impl Iterator<Item = &PolledLink> {
        self.rti.iter().chain(self.outgoing.values()).chain(self.incoming.values())
    }

    fn polled_links_mut(&mut self) -> impl Iterator<Item = &mut PolledLink> {
        self.rti.iter_mut().chain(self.outgoing.values_mut()).chain(self.incoming.values_mut())
    }

    fn acceptor(&self) -> Option<&PolledAcceptor> {
        self.acceptor.as_ref()
    }

    fn acceptor_mut(&mut self) -> Option<&mut PolledAcceptor> {
        self.acceptor.as_mut()
    }

    fn watch(&self) -> Option<&WatchServer> {
        self.watch.as_ref()
    }

    fn watch_mut(&mut self) -> Option<&mut WatchServer> {
        self.watch.as_mut()
    }

    fn boards(&self) -> Option<&Boards> {
        self.boards.as_ref()
    }

    fn shipping(&self) -> Option<&Shipping> {
        self.shipping.as_ref()
    }

    fn shipping_mut(&mut self) -> Option<&mut Shipping> {
        self.shipping.as_mut()
    }
}

impl PolledLinks {
    /// The link that carries this federate's messages to a peer, unless they go through the RTI.
    fn to(&self, peer: FederateId) -> Option<&PolledLink> {
        self.outgoing.get(&peer).or_else(|| self.incoming.get(&peer))
    }

    fn to_mut(&mut self, peer: FederateId) -> Option<&mut PolledLink> {
        self.outgoing.get_mut(&peer).or_else(|| self.incoming.get_mut(&peer))
    }

    /// Whether the RTI certainly runs as the same user on this machine: a Unix socket links only such processes.
    fn rti_is_same_user(&self) -> bool {
        self.rti.as_ref().is_some_and(|polled| polled.link.is_local())
    }
}

impl FederateLinks {
    /// Connects to the RTI, and listens for peers if the coordination needs them.
    pub(super) fn connect(options: &FederateOptions, network: Network) -> Result<Self, Failure> {
        let keys = Keys::new(options.federation, options.security.clone())?;
        let me = Party::Federate(options.federate);
        let in_process = matches!(network, Network::Process(_));
        let log = FrameLog::of_this_process(&options.program, me, in_process)?;
        let mut search = Search::new(options);
        let rti = search.find(&keys, &network)?;
        let decentralized = options.program.properties.coordination == Coordination::Decentralized;
        let mut acceptor = None;
        let mut addresses = String::new();
        // Without the RTI's grants, messages need direct links, as those between agents are.
        let is_reached = rti.is_local() || reach::is_reached_through_agent(options);
        // Where others read boards, one that joins late has to.
        let is_late = options.program.federates[options.federate].transient;
        let may_read = || {
            Ok::<_, Failure>(may_use_boards(&network)? || is_late && network.notifier().is_some())
        };
        let is_linked = decentralized || is_reached && may_read()?;
        if is_linked {
            let listeners;
            (listeners, addresses) = reach::listen(options, &rti, &keys, &network)?;
            let members = options.program.federates.len();
            acceptor = Some(PolledAcceptor::new(LinkAcceptor::new(
                listeners,
                Purpose::Messages,
                keys.clone(),
                members,
            )));
        }
        // Between agents, shipments are as safe as the agents make them, which is not what TLS promises.
        let has_tls = options.security.tls.is_some();
        let shipping = reach::is_reached_through_agent(options) && !in_process && !has_tls;
        let shipping = shipping.then(|| Shipping::join(keys.name(), options.federate)).flatten();
        let shipments = shipping.iter().map(|it| shipments_to(it.machine()));
        let words: Vec<_> = [addresses].into_iter().chain(shipments).collect();
        let words = words.join(" ");
        let advertised = (!words.trim().is_empty()).then(|| words.trim().to_owned());
        let agent = match options.rti {
            Address::Agent(_) => agent_address().ok(),
            _ => None,
        };
        Ok(Self {
            host: reach::host_id(rti.is_local(), is_linked, agent.as_ref()),
            poller: Poller::new(network.notifier(), spin::time(&options.program)),
            network,
            polled: PolledLinks {
                rti: Some(PolledLink::new(rti)),
                outgoing: SortedMap::new(),
                incoming: SortedMap::new(),
                acceptor,
                watch: None,
                boards: None,
                shipping,
            },
            search,
            openings: Openings::new(&options.reach),
            notice: options.reach.notice,
            rti_link_lost: false,
            keys,
            advertised,
            serials: LinkSerials::default(),
            descriptors: BTreeMap::new(),
            unsent: Vec::new(),
            peers_may_have_outbound: true,
            rti_may_have_outbound: true,
            write_failure: None,
            log,
        })
    }

    /// Lets processes of this user watch what this federate sends, whose store has that capacity.
    pub(super) fn listen_for_watchers(&mut self, options: &FederateOptions, capacity: u64) {
        let id = self.federation().to_string();
        self.polled.watch = WatchServer::listen(&options.program, options.federate, &id, capacity);
    }

    /// What shows messages to watchers, if this federate can be watched.
    pub(super) fn watch(&mut self) -> Option<&mut WatchServer> {
        self.polled.watch.as_mut()
    }

    /// What takes large values to other machines, if agents do that.
    pub(super) fn shipping(&mut self) -> Option<&mut Shipping> {
        self.polled.shipping.as_mut()
    }

    /// Drops the link to the RTI, which is broken. This federate then looks for the RTI, and joins again over a
    /// new link.
    ///
    /// # Errors
    ///
    /// If the RTI cannot be found any more.
    pub(super) fn drop_rti_link(&mut self) -> Result<(), Failure> {
        self.polled.rti = None;
        self.rti_link_lost = true;
        self.search.lost()
    }

    /// When to look for the RTI again, if the link to it is lost.
    pub(super) fn next_wakeup(&self) -> Option<PhysicalTime> {
        self.rti_link_lost.then(|| self.search.next_attempt())
    }

    /// The socket of the link to the RTI; none if the RTI is in this process.
    pub(super) fn rti_socket(&self) -> Option<BorrowedFd<'_>> {
        match &self.polled.rti.as_ref()?.link {
            Link::Stream(link) => Some(link.as_fd()),
            Link::Queue(_) => None,
        }
    }

    /// Notes that the federation runs: from now on the loop serves members before pending connections.
    pub(super) fn become_busy(&mut self) {
        self.polled.acceptor.iter_mut().for_each(|acceptor| acceptor.inner.become_busy());
    }

    /// Whether the RTI runs on this host.
    pub(super) fn is_on_host_of_rti(&self) -> bool {
        self.polled.rti.as_ref().is_some_and(|polled| polled.link.is_within_host())
    }

    /// The name of this federation in frames.
    pub(super) fn federation(&self) -> FederationId {
        self.keys.name()
    }

    /// The number of this federate's host. Federates with the same number share memory.
    pub(super) fn host(&self) -> HostId {
        self.host
    }

    /// Where peers reach this federate.
    pub(super) fn advertised(&self) -> Option<String> {
        self.advertised.clone()
    }

    /// Opens the link that carries this federate's messages to `peer`, which listens at one of
    /// `addresses`. Does not wait for the peer, which may open its own link at the same time. A link that
    /// breaks while it is opened is opened again.
    ///
    /// # Errors
    ///
    /// Why the peer cannot be reached.
    pub(super) fn connect_peer(
        &mut self,
        peer: FederateId,
        addresses: &str,
        same_host: bool,
        hello: Frame,
    ) -> Result<(), String> {
        let address = reach::peer_address(addresses, same_host)?;
        self.openings.begin(peer, address, hello);
        self.open_link(peer).map_or(Ok(()), Err)
    }

    /// Tries to open the link to a peer. Returns why it cannot be opened, if that is final.
    fn open_link(&mut self, peer: FederateId) -> Option<String> {
        let (address, hello) = self.openings.target(peer)?;
        let deadline = Deadline::at(Clock::now().plus(CONNECT_TIMEOUT));
        match self.network.connect(address, Purpose::Messages, &self.keys, deadline) {
            Ok(mut link) => {
                self.log.sent(Party::Federate(peer), hello);
                link.queue(hello.clone(), None);
                self.peers_may_have_outbound = true;
                self.polled.outgoing.insert(peer, PolledLink::new(link));
                self.serials.open(peer);
                None
            }
            Err(error) => self.openings.failed(peer, &error, Clock::local()),
        }
    }

    /// Opens links again whose last attempt has failed a while ago.
    #[inline(never)]
    fn open_links(&mut self, inputs: &mut Vec<(LinkSerial, Input)>) {
        for peer in self.openings.take_due(Clock::local()) {
            if let Some(reason) = self.open_link(peer) {
                inputs.push((self.serials.outgoing(peer), Input::Unreachable { peer, reason }));
            }
        }
    }

    /// Tells the user of links that do not open. After the links were read: one that has opened by now is not told.
    #[inline(never)]
    fn tell_of_links(&mut self) {
        for text in self.openings.take_notices(Clock::local()) {
            self.notice.iter().for_each(|notice| notice(&text));
        }
    }

    /// Stops opening a link to a peer, because the peer has ended.
    pub(super) fn stop_opening(&mut self, peer: FederateId) {
        if self.openings.contains(peer) {
            self.openings.end(peer);
            self.polled.outgoing.remove(&peer);
        }
    }

    /// Closes the links with a peer.
    pub(super) fn disconnect(&mut self, peer: FederateId) {
        self.openings.end(peer);
        self.polled.outgoing.remove(&peer);
        self.polled.incoming.remove(&peer);
        self.serials.close(peer);
    }

    /// Whether an input came over a link that this federate, after it had read the input, has closed or replaced
    /// by another link with the same peer.
    pub(super) fn is_from_closed_link(&self, serial: LinkSerial, input: &Input) -> bool {
        let (Input::PeerUp(peer) | Input::PeerLost(peer) | Input::FromPeer { from: peer, .. }) =
            input
        else {
            return false;
        };
        let replaced =
            self.polled.outgoing.contains_key(peer) && serial < self.serials.outgoing(*peer);
        replaced || self.serials.is_closed(*peer, serial)
    }

    /// Whether a descriptor that this federate sends to `to` arrives before a message that it sends afterwards
    /// on a channel, `physical` or not. Only then may the message refer to an object in that segment.
    pub(super) fn descriptors_precede(&self, to: FederateId, physical: bool) -> bool {
        match self.polled.to(to) {
            // A message on a physical channel goes through the RTI, and may overtake the descriptor.
            Some(polled) => polled.link.is_local() && !physical,
            None => self.polled.rti_is_same_user(),
        }
    }

    /// Whether a peer certainly runs as the same user on this machine: its links, or the link to the RTI if
    /// messages go through that, are Unix sockets, which link only such processes.
    pub(super) fn is_same_user(&self, peer: FederateId) -> bool {
        let PolledLinks { outgoing, incoming, .. } = &self.polled;
        match (outgoing.get(&peer), incoming.get(&peer)) {
            (None, None) => self.polled.rti_is_same_user(),
            (one, other) => [one, other].into_iter().flatten().all(|it| it.link.is_local()),
        }
    }

    pub(super) fn send_to_rti(&mut self, frame: Frame, descriptor: Option<OwnedFd>) {
        if let Some(polled) = &mut self.polled.rti {
            self.log.sent(Party::Rti, &frame);
            polled.link.queue(frame, descriptor);
            self.rti_may_have_outbound = true;
        }
    }

    pub(super) fn send_to_peer(
        &mut self,
        to: FederateId,
        frame: Frame,
        descriptor: Option<OwnedFd>,
    ) {
        if let Some(polled) = self.polled.to_mut(to) {
            self.log.sent(Party::Federate(to), &frame);
            polled.link.queue(frame, descriptor);
            if !self.unsent.contains(&to) {
                self.unsent.push(to);
            }
        }
    }

    /// The descriptor that came with a frame.
    pub(super) fn take_descriptor(
        &mut self,
        owner: FederateId,
        carried: Carried,
    ) -> Option<OwnedFd> {
        self.descriptors.remove(&(owner, carried))
    }

    /// Makes the board of this federate, which shows so many `tallies`, if it is not there yet, and returns a
    /// descriptor of it, or of what wakes this federate up.
    pub(super) fn board_descriptor(
        &mut self,
        carried: Carried,
        tallies: usize,
    ) -> Result<OwnedFd, Failure> {
        let boards = match &mut self.polled.boards {
            Some(boards) => boards,
            boards => boards.insert(Boards::new(tallies)?),
        };
        let descriptor = match carried {
            Carried::Notifier => self.network.notifier().map(|it| it.as_fd().try_clone_to_owned()),
            _ => Some(boards.descriptor()),
        };
        descriptor
            .unwrap_or_else(|| Err(io::ErrorKind::Unsupported.into()))
            .map_err(|error| Failure::system("cannot show itself to other federates", &error))
    }

    /// Reads the board of another federate from now on, or wakes it up with its notifier.
    pub(super) fn attach_board(
        &mut self,
        owner: FederateId,
        notifier: bool,
    ) -> Result<(), Failure> {
        let carried = if notifier { Carried::Notifier } else { Carried::Board };
        let descriptor = self.take_descriptor(owner, carried);
        let Some((boards, descriptor)) = self.polled.boards.as_mut().zip(descriptor) else {
            return Err(Failure::store(&"a board came without its descriptor"));
        };
        boards.attach(owner, notifier, descriptor)
    }

    /// The boards that this federate reads, if there are any.
    pub(super) fn boards(&mut self) -> Option<&mut Boards> {
        self.polled.boards.as_mut()
    }

    /// Closes the links in order: writes everything within `timeout`, and makes sure that it arrives. With
    /// `all`, `timeout` begins again whenever the kernel has taken some bytes of a long message.
    pub(super) fn close_in_order(&mut self, timeout: Nanos, all: bool) {
        if let Some(shipping) = &mut self.polled.shipping {
            shipping.finish(Clock::now().plus(timeout));
        }
        self.poller.drain(&mut self.polled, timeout, all);
        let until = Clock::now().plus(timeout);
        // If this end closed a TCP connection before it has read everything, the kernel would reset the
        // connection, and the other end would lose what it has not read yet. So this end waits until the
        // other end closes the connection.
        let mut links: Vec<_> = self.polled.links_mut().filter(|link| !link.is_local()).collect();
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

    /// Reads the links that are known to be ready, up to a limit for each. `admit` finds out from the first
    /// frame of a new link which federate opened it, and what to answer.
    pub(super) fn read(
        &mut self,
        admit: impl Fn(&Frame) -> Option<(FederateId, Frame)>,
        inputs: &mut Vec<(LinkSerial, Input)>,
    ) -> Result<(), Failure> {
        if self.write_failure.is_some() {
            return self.write_failure.take().map_or(Ok(()), Err);
        }
        self.read_rti(inputs)?;
        if self.polled.acceptor.as_ref().is_some_and(PolledAcceptor::is_ready) {
            self.accept_peers(admit, inputs)?;
        }
        if self.openings.is_empty() {
            return self.read_peers(inputs);
        }
        self.open_links(inputs);
        self.read_peers(inputs)?;
        self.tell_of_links();
        Ok(())
    }

    /// Waits until a link is ready, the loop is notified, or `until` has come.
    pub(super) fn wait(&mut self, inbox: &impl AsFd, until: Option<PhysicalTime>) -> Found {
        let until = until.into_iter().chain(self.openings.next_wakeup()).min();
        let found = self.poller.wait(&mut self.polled, inbox, until);
        self.note_room(found)
    }

    /// Looks for what has come by now. It does not wait; it is about `now`.
    pub(super) fn look(&mut self, inbox: &impl AsFd, now: PhysicalTime) -> Found {
        let found = self.poller.look(&mut self.polled, inbox, Clock::local_at(now));
        self.note_room(found)
    }

    /// Notes whether a link may take more than before.
    fn note_room(&mut self, found: Found) -> Found {
        self.peers_may_have_outbound |= found.peer_activity;
        self.rti_may_have_outbound |= found.peer_activity;
        found
    }

    fn read_rti(&mut self, inputs: &mut Vec<(LinkSerial, Input)>) -> Result<(), Failure> {
        if self.rti_link_lost
            && let Some(link) = self.search.try_if_due(&self.keys, &self.network)?
        {
            self.polled.rti = Some(PolledLink::new(link));
            self.rti_may_have_outbound = true;
            self.rti_link_lost = false;
            inputs.push((LinkSerial::RTI, Input::Rejoins));
        }
        let Some(polled) = self.polled.rti.as_mut().filter(|it| it.may_be_read()) else {
            return Ok(());
        };
        let (descriptors, log) = (&mut self.descriptors, &mut self.log);
        let open = polled.read(|frame, descriptor| {
            log.received(Party::Rti, &frame);
            keep_descriptor(descriptors, &frame, descriptor);
            inputs.push((LinkSerial::RTI, Input::FromRti(frame)));
        });
        if !open.map_err(failure)? {
            self.polled.rti = None;
            inputs.push((LinkSerial::RTI, Input::RtiLost));
        }
        Ok(())
    }

    /// Accepts links of peers. The first frame of a link says which peer opened it; a link whose first frame
    /// does not say so gets no answer.
    #[inline(never)]
    fn accept_peers(
        &mut self,
        admit: impl Fn(&Frame) -> Option<(FederateId, Frame)>,
        inputs: &mut Vec<(LinkSerial, Input)>,
    ) -> Result<(), Failure> {
        let Some(acceptor) = self.polled.acceptor.as_mut() else { return Ok(()) };
        let admitted = acceptor
            .admit(Clock::local())
            .map_err(|error| Failure::system("cannot accept a connection of a peer", &error))?;
        for (mut link, hello) in admitted {
            if let Some((from, welcome)) = admit(&hello) {
                link.trust();
                self.log.received(Party::Federate(from), &hello);
                self.log.sent(Party::Federate(from), &welcome);
                link.queue(welcome, None);
                self.peers_may_have_outbound = true;
                self.polled.incoming.insert(from, PolledLink::new(link));
                inputs.push((self.serials.accept(from), Input::PeerUp(from)));
            }
        }
        Ok(())
    }
}

/// The failure if this process has no memory for a message that it sends or receives.
pub(super) fn no_memory(error: &dyn Display) -> Failure {
    Failure::Memory(error.to_string())
}

/// Keeps the descriptor that came with a segment until the segment is mapped.
fn keep_descriptor(descriptors: &mut Descriptors, frame: &Frame, descriptor: Option<OwnedFd>) {
    if let (Some((owner, _, carried)), Some(descriptor)) = (frame.carries(), descriptor) {
        descriptors.insert((owner, carried), descriptor);
    }
}

/// The failure of a federate that cannot read a link any further.
fn failure(broken: Broken) -> Failure {
    match broken {
        Broken::Shortage(error) if error.kind() == io::ErrorKind::OutOfMemory => no_memory(&error),
        Broken::Shortage(error) => Failure::system("cannot receive from another federate", &error),
        Broken::Frame(error @ CodecError::NoMemory(_)) => no_memory(&error),
        Broken::Frame(error) => Failure::protocol(&error),
        Broken::Link(error) => Failure::Link(format!("a link is broken: {error}")),
    }
}
