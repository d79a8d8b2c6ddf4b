//! A federate's links: to the RTI, and under decentralized coordination to its peers.
//!
//! It greets peers and turns bytes into frames. What a frame means is the machine's business.

use std::collections::BTreeMap;
use std::os::fd::{AsFd, OwnedFd};

use hprm_core::{Coordination, FederateId, PhysicalTime};
use hprm_federated::{FederationId, Frame, HostId};

use super::FederateOptions;
use super::reach;
use crate::link::{Arrival, Keys, Lobby, Purpose, READS};
use crate::wait::{Interest, wait};
use crate::wire::{Network, Wire};
use crate::{Clock, Failure, Inbox};

/// What has come from a link.
pub(super) enum Event {
    FromRti(Frame),
    FromPeer { from: FederateId, frame: Frame },
    RtiLost,
    PeerUp(FederateId),
    PeerLost(FederateId),
}

/// The links of one federate.
pub(super) struct Wires {
    network: Network,
    rti: Option<Wire>,
    keys: Keys,
    /// Where peers open links, if the coordination needs them.
    lobby: Option<Lobby>,
    advertised: Option<String>,
    /// Links that this federate opened: its messages go there.
    outgoing: BTreeMap<FederateId, Wire>,
    /// Links that peers opened: their messages come from there.
    incoming: BTreeMap<FederateId, Wire>,
    host: HostId,
    events: Vec<Event>,
    descriptors: BTreeMap<(FederateId, u32), OwnedFd>,
}

impl Wires {
    /// Connects to the RTI, and listens for peers if the coordination needs them.
    pub(super) fn connect(options: &FederateOptions, network: Network) -> Result<Self, Failure> {
        let keys = Keys::new(options.federation, options.security.clone())?;
        let rti = reach::rti(options, &keys, &network)?;
        let decentralized = options.program.properties.coordination == Coordination::Decentralized;
        let (mut lobby, mut advertised) = (None, None);
        if decentralized {
            let (gates, addresses) = reach::listen(options, &rti, &keys, &network)?;
            lobby = Some(Lobby::new(gates, Purpose::Messages, keys.clone()));
            advertised = Some(addresses);
        }
        Ok(Self {
            host: reach::host_id(rti.is_local(), decentralized),
            network,
            rti: Some(rti),
            keys,
            lobby,
            advertised,
            outgoing: BTreeMap::new(),
            incoming: BTreeMap::new(),
            events: Vec::new(),
            descriptors: BTreeMap::new(),
        })
    }

    /// Whether the RTI runs on this host.
    pub(super) fn is_beside_rti(&self) -> bool {
        self.rti.as_ref().is_some_and(Wire::is_within_host)
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
        hello: &Frame,
    ) -> Result<(), String> {
        let mut link = reach::peer(addresses, same_host, &self.keys, &self.network)?;
        link.queue(hello, None);
        self.outgoing.insert(peer, link);
        Ok(())
    }

    /// Whether descriptors reach a federate on the same host before a message on such a channel.
    pub(super) fn pass_descriptors(&self, to: FederateId, physical: bool) -> bool {
        match self.outgoing.get(&to).or_else(|| self.incoming.get(&to)) {
            // A message on a physical channel takes the other way, and may overtake them.
            Some(link) => link.is_local() && !physical,
            None => self.rti.as_ref().is_some_and(Wire::is_local),
        }
    }

    pub(super) fn tell_rti(&mut self, frame: &Frame, descriptor: Option<OwnedFd>) {
        if let Some(link) = &mut self.rti {
            link.queue(frame, descriptor);
        }
    }

    pub(super) fn tell_peer(&mut self, to: FederateId, frame: &Frame, descriptor: Option<OwnedFd>) {
        let link = self.outgoing.get_mut(&to).or_else(|| self.incoming.get_mut(&to));
        if let Some(link) = link {
            link.queue(frame, descriptor);
        }
    }

    /// The descriptor that came with the announcement of a segment.
    pub(super) fn take_descriptor(&mut self, owner: FederateId, segment: u32) -> Option<OwnedFd> {
        self.descriptors.remove(&(owner, segment))
    }

    /// Writes what can be written. A peer that is gone is noticed when its link is read.
    pub(super) fn flush(&mut self) {
        self.links_mut().for_each(|link| link.flush().unwrap_or_else(|_| link.discard()));
    }

    /// Says goodbye: writes everything, until `until` at the latest, and makes sure that it arrives.
    pub(super) fn leave(&mut self, until: PhysicalTime) {
        self.drain(until);
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

    fn drain(&mut self, until: PhysicalTime) {
        while Clock::now() < until {
            // A link that cannot be written has nobody left to read it.
            self.links_mut().for_each(|link| link.flush().unwrap_or_else(|_| link.discard()));
            let blocked: Vec<_> = self
                .links()
                .filter(|link| link.has_outbound())
                .map(|link| Interest { fd: link.as_fd(), write: true })
                .collect();
            if blocked.is_empty() {
                return;
            }
            wait(&blocked, Some(until));
        }
    }

    /// Reads what the sockets hold, up to a limit for each. `admit` tells who greets, and what to
    /// answer.
    pub(super) fn read(
        &mut self,
        admit: impl Fn(&Frame) -> Option<(FederateId, Frame)>,
    ) -> Result<Vec<Event>, Failure> {
        self.read_rti()?;
        self.read_greetings(admit)?;
        self.read_peers()?;
        Ok(std::mem::take(&mut self.events))
    }

    /// Waits until a link is ready, the bell rings, or `until` has come.
    pub(super) fn wait<V>(&self, bell: &Inbox<V>, until: Option<PhysicalTime>) {
        let mut interests = vec![Interest { fd: bell.as_fd(), write: false }];
        let links = self.links();
        interests
            .extend(links.map(|link| Interest { fd: link.as_fd(), write: link.has_outbound() }));
        interests.extend(self.lobby.iter().flat_map(Lobby::interests));
        let impatience = self.lobby.as_ref().and_then(Lobby::next_wakeup).map(Clock::at);
        let unread = self.links().any(Wire::has_unread).then(Clock::now);
        wait(&interests, until.into_iter().chain(impatience).chain(unread).min());
    }

    fn links(&self) -> impl Iterator<Item = &Wire> {
        self.rti.iter().chain(self.outgoing.values()).chain(self.incoming.values())
    }

    fn links_mut(&mut self) -> impl Iterator<Item = &mut Wire> {
        self.rti.iter_mut().chain(self.outgoing.values_mut()).chain(self.incoming.values_mut())
    }

    fn read_rti(&mut self) -> Result<(), Failure> {
        let Some(link) = &mut self.rti else { return Ok(()) };
        let mut frames = Vec::new();
        let open = read_frames(link, &mut frames)?;
        for (frame, descriptor) in frames {
            self.keep(&frame, descriptor);
            self.events.push(Event::FromRti(frame));
        }
        if !open {
            self.rti = None;
            self.events.push(Event::RtiLost);
        }
        Ok(())
    }

    /// A peer's first frame says whose link it is. Whoever cannot say that is not answered.
    fn read_greetings(
        &mut self,
        admit: impl Fn(&Frame) -> Option<(FederateId, Frame)>,
    ) -> Result<(), Failure> {
        let Some(lobby) = &mut self.lobby else { return Ok(()) };
        let admitted = lobby.admit(Clock::local()).map_err(|error| {
            Failure::new(format!("error: cannot accept a connection of a peer: {error}"))
        })?;
        for (mut link, hello) in admitted {
            if let Some((from, welcome)) = admit(&hello) {
                link.trust();
                link.queue(&welcome, None);
                self.incoming.insert(from, link);
                self.events.push(Event::PeerUp(from));
            }
        }
        Ok(())
    }

    /// A peer whose link is broken is as good as gone.
    fn read_peers(&mut self) -> Result<(), Failure> {
        let outgoing: Vec<_> = self.outgoing.keys().copied().collect();
        for peer in outgoing {
            self.check_proof(peer)?;
            if !self.read_peer(peer, |wires| &mut wires.outgoing)
                // Its messages come over the other link, and there may be more of them.
                && !self.incoming.contains_key(&peer)
            {
                self.events.push(Event::PeerLost(peer));
            }
        }
        let incoming: Vec<_> = self.incoming.keys().copied().collect();
        for peer in incoming {
            if !self.read_peer(peer, |wires| &mut wires.incoming) {
                self.events.push(Event::PeerLost(peer));
            }
        }
        Ok(())
    }

    /// Whoever listens where a peer should must prove that it is one.
    fn check_proof(&mut self, peer: FederateId) -> Result<(), Failure> {
        match self.outgoing.get_mut(&peer) {
            Some(link) if !link.is_established() => link.read().map(drop).map_err(|error| {
                Failure::new(format!("error: the link to federate {}: {error}", peer.0))
            }),
            _ => Ok(()),
        }
    }

    /// Reads one of a peer's links. Returns whether it is still open.
    fn read_peer(
        &mut self,
        peer: FederateId,
        links: fn(&mut Self) -> &mut BTreeMap<FederateId, Wire>,
    ) -> bool {
        let Some(link) = links(self).get_mut(&peer) else { return true };
        let mut frames = Vec::new();
        let open = read_frames(link, &mut frames).unwrap_or(false);
        self.arrive(peer, frames);
        if !open {
            links(self).remove(&peer);
        }
        open
    }

    fn arrive(&mut self, from: FederateId, frames: Vec<(Frame, Option<OwnedFd>)>) {
        for (frame, descriptor) in frames {
            if let Frame::PeerWelcome { .. } = frame {
                self.events.push(Event::PeerUp(from));
                continue;
            }
            self.keep(&frame, descriptor);
            self.events.push(Event::FromPeer { from, frame });
        }
    }

    fn keep(&mut self, frame: &Frame, descriptor: Option<OwnedFd>) {
        if let (Frame::Segment { owner, segment, .. }, Some(descriptor)) = (frame, descriptor) {
            self.descriptors.insert((*owner, *segment), descriptor);
        }
    }
}

/// Reads what the socket holds. Returns whether the other end is still open.
fn read_frames(
    link: &mut Wire,
    frames: &mut Vec<(Frame, Option<OwnedFd>)>,
) -> Result<bool, Failure> {
    let broken =
        |error: &dyn std::fmt::Display| Failure::new(format!("error: a link is broken: {error}"));
    for _ in 0..READS {
        let arrival = link.read().map_err(|error| broken(&error))?;
        while let Some(frame) = link.next_frame().map_err(|error| broken(&error))? {
            frames.push(frame);
        }
        match arrival {
            Arrival::Bytes => {}
            Arrival::Nothing => return Ok(true),
            Arrival::Closed => return Ok(false),
        }
    }
    Ok(true)
}
