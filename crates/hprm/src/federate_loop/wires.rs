//! A federate's links: to the RTI, and under decentralized coordination to its peers.
//!
//! It greets peers and turns bytes into frames. What a frame means is the machine's business.

use std::collections::BTreeMap;
use std::os::fd::{AsFd, OwnedFd};

use hprm_core::{Coordination, FederateId, PhysicalTime};
use hprm_federated::{Frame, HostId};

use super::FederateOptions;
use crate::link::{Arrival, READS};
use crate::wait::{Interest, wait};
use crate::wire::{Gate, Network, Wire};
use crate::{Address, Clock, Failure, Inbox};

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
    listener: Option<Gate>,
    /// Links that peers opened and have not yet said whose they are.
    greeting: Vec<Wire>,
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
        let rti = network.connect(&options.rti).map_err(|error| {
            Failure::new(format!(
                "error: no RTI at {}: {error}\n  hint: start the federation with `hprm run`, or \
                 the RTI with `hprm rti`",
                options.rti
            ))
        })?;
        let decentralized = options.program.properties.coordination == Coordination::Decentralized;
        let listener = decentralized.then(|| listen(options, &network)).transpose()?;
        Ok(Self {
            host: host_id(rti.is_local()),
            network,
            rti: Some(rti),
            listener,
            greeting: Vec::new(),
            outgoing: BTreeMap::new(),
            incoming: BTreeMap::new(),
            events: Vec::new(),
            descriptors: BTreeMap::new(),
        })
    }

    /// Which federates share this one's memory: those with the same number.
    pub(super) fn host(&self) -> HostId {
        self.host
    }

    /// Where peers reach this federate.
    pub(super) fn listen_address(&self) -> Option<String> {
        self.listener.as_ref().map(|listener| listener.address().to_string())
    }

    /// Opens the link that carries this federate's messages to `peer`.
    pub(super) fn connect_peer(
        &mut self,
        peer: FederateId,
        listen: &str,
        hello: &Frame,
    ) -> Result<(), Failure> {
        let unreachable = |error: &dyn std::fmt::Display| {
            Failure::new(format!(
                "error: federate {} is not reachable at {listen}: {error}",
                peer.0
            ))
        };
        let address: Address = listen.parse().map_err(|error| unreachable(&error))?;
        let mut link = self.network.connect(&address).map_err(|error| unreachable(&error))?;
        link.queue(hello, None);
        self.outgoing.insert(peer, link);
        Ok(())
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
        self.accept()?;
        self.read_greetings(admit);
        self.read_peers();
        Ok(std::mem::take(&mut self.events))
    }

    /// Waits until a link is ready, the bell rings, or `until` has come.
    pub(super) fn wait<V>(&self, bell: &Inbox<V>, until: Option<PhysicalTime>) {
        let mut interests = vec![Interest { fd: bell.as_fd(), write: false }];
        interests.extend(
            self.links()
                .chain(&self.greeting)
                .map(|link| Interest { fd: link.as_fd(), write: link.has_outbound() }),
        );
        interests.extend(
            self.listener.iter().map(|listener| Interest { fd: listener.as_fd(), write: false }),
        );
        wait(&interests, until);
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

    fn accept(&mut self) -> Result<(), Failure> {
        let Some(listener) = &self.listener else { return Ok(()) };
        while let Some(link) = listener.accept().map_err(|error| {
            Failure::new(format!("error: cannot accept a connection of a peer: {error}"))
        })? {
            self.greeting.push(link);
        }
        Ok(())
    }

    /// A peer's first frame says whose link it is. Whoever cannot say that is not answered.
    fn read_greetings(&mut self, admit: impl Fn(&Frame) -> Option<(FederateId, Frame)>) {
        for mut link in std::mem::take(&mut self.greeting) {
            let open = !matches!(link.read(), Ok(Arrival::Closed) | Err(_));
            match link.next_frame() {
                Ok(Some((hello, _))) => {
                    if let Some((from, welcome)) = admit(&hello) {
                        link.trust();
                        link.queue(&welcome, None);
                        self.incoming.insert(from, link);
                        self.events.push(Event::PeerUp(from));
                    }
                }
                Ok(None) if open => self.greeting.push(link),
                _ => {}
            }
        }
    }

    /// A peer whose link is broken is as good as gone.
    fn read_peers(&mut self) {
        let outgoing: Vec<_> = self.outgoing.keys().copied().collect();
        for peer in outgoing {
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

/// Peers are reached the way the RTI is.
fn listen(options: &FederateOptions, network: &Network) -> Result<Gate, Failure> {
    // With the number of the process: a transient federate may have a predecessor.
    let mine = format!("{}-{}", options.federate.0, std::process::id());
    let address = match &options.rti {
        Address::Abstract(rti) => Address::Abstract(format!("{rti}-{mine}")),
        Address::Path(rti) => Address::Path(format!("{rti}-{mine}")),
        Address::Tcp(_) => Address::Tcp("127.0.0.1:0".to_owned()),
    };
    network
        .listen(&address)
        .map_err(|error| Failure::new(format!("error: cannot listen at {address}: {error}")))
}

/// The number of this machine since it was booted. A federate whose links carry no descriptors
/// shares memory with nobody, so its number is its own.
fn host_id(local: bool) -> HostId {
    let source = if local { "boot_id" } else { "uuid" };
    let text = std::fs::read_to_string(format!("/proc/sys/kernel/random/{source}"));
    let digits: String = text.unwrap_or_default().chars().filter(char::is_ascii_hexdigit).collect();
    HostId(u128::from_str_radix(&digits, 16).unwrap_or_default())
}
