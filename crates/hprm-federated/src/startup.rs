//! How a federate gets to the start: it joins, learns of the others, opens links to some, and is ready.
//!
//! The handshake of a direct link is here as two pure steps. The driver performs them, because it
//! does not know before to which federate the link leads. The machine in `federate` uses all the rest.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use hprm_core::{ChannelId, FederateId, Payload, PhysicalTime, SortedMap, Tag};

use crate::boards::Reading;
use crate::{FederationId, Frame, HostId, PROTOCOL, Peer, Posting, Refusal};

/// A message that came before the start.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct EarlyMessage {
    pub(crate) channel: ChannelId,
    pub(crate) tag: Tag,
    pub(crate) payload: Payload,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Startup {
    federation: FederationId,
    host: HostId,
    /// All federates, once all have joined.
    peers: Option<SortedMap<FederateId, Peer>>,
    /// The federates whose direct links are up.
    linked: SortedMap<FederateId, ()>,
    /// The federates that exchange logical messages with this one, and may have a direct link with it.
    partners: BTreeSet<FederateId>,
    /// Direct links without which this federate does not start.
    needed: BTreeSet<FederateId>,
    /// Boards and notifiers of others without which this federate does not start.
    needed_boards: BTreeSet<(FederateId, bool)>,
    /// Those that have come before the list of peers.
    early_boards: Vec<(FederateId, bool)>,
    /// What federates elsewhere have shown before the list of peers.
    early_postings: BTreeMap<FederateId, Posting>,
    loaded: bool,
    ready: bool,
    start: Option<PhysicalTime>,
    early: VecDeque<EarlyMessage>,
}

impl Startup {
    pub(crate) fn new(
        federation: FederationId,
        host: HostId,
        partners: BTreeSet<FederateId>,
    ) -> Self {
        Self {
            needed: BTreeSet::new(),
            needed_boards: BTreeSet::new(),
            early_boards: Vec::new(),
            early_postings: BTreeMap::new(),
            partners,
            federation,
            host,
            peers: None,
            linked: SortedMap::new(),
            loaded: false,
            ready: false,
            start: None,
            early: VecDeque::new(),
        }
    }

    /// This federate exchanges messages on direct links, so it does not start without them.
    pub(crate) fn need_links(&mut self) {
        let is_there =
            |it: &FederateId| self.peers.as_ref().is_none_or(|peers| peers.contains_key(it));
        self.needed = self.partners.iter().copied().filter(is_there).collect();
    }

    /// This federate reads those boards, and wakes up those of their owners to which it sends with their notifiers. It does
    /// not start without them.
    pub(crate) fn need_boards<'a>(&mut self, readings: impl Iterator<Item = &'a Reading>) {
        let needed = |it: &'a Reading| it.descriptors().map(|notifier| (it.owner, notifier));
        self.needed_boards = readings.flat_map(needed).collect();
    }

    /// A board or notifier has come before the list of peers.
    pub(crate) fn keep_board(&mut self, owner: FederateId, notifier: bool) {
        self.early_boards.push((owner, notifier));
    }

    /// A federate elsewhere has shown this before the list of peers.
    pub(crate) fn keep_posting(&mut self, owner: FederateId, posting: Posting) {
        self.early_postings.insert(owner, posting);
    }

    pub(crate) fn take_early_postings(&mut self) -> BTreeMap<FederateId, Posting> {
        std::mem::take(&mut self.early_postings)
    }

    pub(crate) fn take_early_boards(&mut self) -> Vec<(FederateId, bool)> {
        std::mem::take(&mut self.early_boards)
    }

    /// Whether a board or notifier that has come is one for which this federate waits.
    pub(crate) fn takes_board(&mut self, owner: FederateId, notifier: bool) -> bool {
        self.needed_boards.remove(&(owner, notifier))
    }

    /// The time of tag zero, once it is known.
    pub(crate) fn start(&self) -> Option<PhysicalTime> {
        self.start
    }

    pub(crate) fn is_linked(&self, peer: FederateId) -> bool {
        self.linked.contains_key(&peer)
    }

    pub(crate) fn linked(&self) -> impl Iterator<Item = FederateId> {
        self.linked.iter().map(|(peer, ())| *peer)
    }

    pub(crate) fn shares_memory_with(&self, peer: FederateId) -> bool {
        let peers = self.peers.as_ref();
        peers.and_then(|peers| peers.get(&peer)).is_some_and(|peer| peer.host == self.host)
    }

    /// Whether this federate and a peer read each other's boards in memory.
    pub(crate) fn shares_boards_with(&self, peer: FederateId) -> bool {
        self.host.has_joined_over_unix_socket() && self.shares_memory_with(peer)
    }

    /// Whether the list of peers is still to come.
    pub(crate) fn awaits_peers(&self) -> bool {
        self.peers.is_none()
    }

    /// Takes the list of peers. This federate needs links only to those that have joined.
    pub(crate) fn set_peers(&mut self, peers: Vec<Peer>) {
        let peers: SortedMap<_, _> = peers.into_iter().map(|peer| (peer.federate, peer)).collect();
        self.needed.retain(|federate| peers.contains_key(federate));
        self.peers = Some(peers);
    }

    /// Adds a peer that has joined later.
    pub(crate) fn add(&mut self, peer: Peer) {
        self.peers.get_or_insert_default().insert(peer.federate, peer);
    }

    /// This federate starts without a direct link to a peer.
    pub(crate) fn needs_no_link_to(&mut self, peer: FederateId) {
        self.needed.remove(&peer);
        self.needed_boards.retain(|(owner, _)| *owner != peer);
    }

    /// The incarnation of a peer, as far as is known.
    pub(crate) fn incarnation(&self, peer: FederateId) -> u32 {
        let peers = self.peers.as_ref();
        peers.and_then(|peers| peers.get(&peer)).map_or(0, |peer| peer.incarnation)
    }

    /// The number of the process that is a federate, as boards have it, if one is: they count from one.
    pub(crate) fn life(&self, federate: FederateId) -> Option<u32> {
        Some(self.peers.as_ref()?.get(&federate)?.life)
    }

    /// Where a peer accepts direct links, if it does.
    pub(crate) fn address(&self, peer: FederateId) -> Option<String> {
        self.peers.as_ref()?.get(&peer)?.listen.clone()
    }

    pub(crate) fn link(&mut self, peer: FederateId) {
        self.linked.insert(peer, ());
    }

    pub(crate) fn unlink(&mut self, peer: FederateId) {
        self.linked.remove(&peer);
    }

    /// The federates to which direct links are needed and not up.
    pub(crate) fn missing_links(&self) -> impl Iterator<Item = FederateId> {
        self.needed.iter().copied().filter(|peer| !self.is_linked(*peer))
    }

    pub(crate) fn is_loaded(&self) -> bool {
        self.loaded
    }

    pub(crate) fn loaded(&mut self) {
        self.loaded = true;
    }

    /// True once: when everything that the start needs is complete.
    pub(crate) fn becomes_ready(&mut self) -> bool {
        let linked = self.peers.is_some() && self.needed.iter().all(|peer| self.is_linked(*peer));
        let complete = self.loaded && linked && self.needed_boards.is_empty();
        complete && !std::mem::replace(&mut self.ready, true)
    }

    /// Whether the start may be announced.
    pub(crate) fn awaits_start(&self) -> bool {
        self.ready && self.start.is_none()
    }

    /// Takes the start; returns the messages that have come before it.
    pub(crate) fn begin(&mut self, at: PhysicalTime) -> VecDeque<EarlyMessage> {
        self.start = Some(at);
        std::mem::take(&mut self.early)
    }

    /// Keeps a message from a peer that learned of the start before this federate.
    pub(crate) fn keep(&mut self, early: EarlyMessage) {
        self.early.push_back(early);
    }

    /// The first frame on a direct link that this side has opened.
    pub(crate) fn peer_hello(&self, from: FederateId) -> Frame {
        Frame::PeerHello { protocol: PROTOCOL, federation: self.federation, from }
    }

    /// Which federate has opened a direct link, by its first frame.
    pub(crate) fn opener(&self, frame: &Frame) -> Result<FederateId, Refusal> {
        match *frame {
            Frame::PeerHello { protocol, .. } if protocol != PROTOCOL => {
                Err(Refusal::WrongProtocol)
            }
            Frame::PeerHello { federation, .. } if federation != self.federation => {
                Err(Refusal::WrongFederation)
            }
            Frame::PeerHello { from, .. } if !self.partners.contains(&from) => {
                Err(Refusal::UnknownFederate)
            }
            Frame::PeerHello { from, .. } if self.is_linked(from) => Err(Refusal::Duplicate),
            Frame::PeerHello { from, .. } => Ok(from),
            _ => Err(Refusal::WrongProtocol),
        }
    }
}
