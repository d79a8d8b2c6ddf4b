//! One link between two machines: a relayed link, and at each end the connection to a process.
//!
//! What the processes send is kept here as events; the relayed link carries frames that name them by their numbers.

use std::collections::VecDeque;

use hprm_core::{Nanos, PhysicalTime};
use hprm_federated::codec::encode;
use hprm_federated::relay::{End, Input, Output, Relay};
use hprm_federated::{Frame, Input as FederateInput, LinkId, RtiInput};

use crate::Rng;
use crate::network::{Event, LinkEvent, Place};

/// One end of a link, and the process there.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Site {
    pub(super) place: Place,
    pub(super) machine: usize,
    /// None before anything has come or left here, and once the agent was killed.
    pub(super) relay: Option<Relay>,
    /// What the process has sent, and the relayed link has not taken.
    unsent: VecDeque<Event>,
    /// What it has taken, and has not come out at the other end.
    sent: VecDeque<Event>,
    /// How many frames have come in and out here.
    given: u64,
    taken: u64,
    /// The process has been told that the link has ended, or its agent is gone.
    pub(super) has_ended: bool,
    /// The process does not read any more.
    is_deaf: bool,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Link {
    /// First the end that has opened it.
    pub(super) sites: [Site; 2],
    /// The number that the RTI gives to it, if it leads there.
    number: Option<LinkId>,
}

/// What a link does.
#[derive(Debug)]
pub(super) enum Effect {
    /// It hands a packet to the carrier, for the other end.
    Packet(Vec<u8>),
    /// It tells a process.
    Event(Event),
    /// It ends at this end for a reason that is no process's.
    Ended(End),
}

impl Link {
    pub(super) fn new(from: (Place, usize), to: (Place, usize)) -> Self {
        Self { sites: [Site::new(from), Site::new(to)], number: None }
    }

    /// The end at a place.
    pub(super) fn end_at(&self, place: Place) -> usize {
        usize::from(self.sites[1].place == place)
    }

    /// The process at an end sends something. Returns a message that is lost, if it is one.
    pub(super) fn send(&mut self, end: usize, event: Event) -> Option<Frame> {
        if let Event::Rti(RtiInput::Frame { link, .. } | RtiInput::Closed { link }) = &event {
            self.number = Some(*link);
        }
        if self.sites[end].has_ended {
            return frame(&event).cloned();
        }
        self.sites[end].unsent.push_back(event);
        None
    }

    /// Whether the process at an end has sent what the relayed link has not taken.
    pub(super) fn has_unsent(&self, end: usize) -> bool {
        !self.sites[end].unsent.is_empty()
    }

    /// Whether everything that was sent has come out, and neither end waits for the other one to notice the end.
    pub(super) fn is_idle(&self) -> bool {
        let all_out = |site: &Site| site.unsent.is_empty() && site.sent.is_empty();
        self.sites.iter().all(all_out) && self.sites[0].has_ended == self.sites[1].has_ended
    }

    /// When an end is to be told the time.
    pub(super) fn wakeup(&self, end: usize) -> Option<Nanos> {
        self.sites[end].relay.as_ref().map(|relay| relay.next_wakeup().0)
    }

    /// Begins the life of an end, if it has none and has not ended.
    pub(super) fn begin(&mut self, end: usize, now: Nanos, rng: &mut Rng) {
        let site = &mut self.sites[end];
        if site.relay.is_none() && !site.has_ended {
            site.relay = Some(Relay::new(rng.draw(), PhysicalTime(now)));
        }
    }

    /// Something happens to the relayed link at an end.
    pub(super) fn handle(&mut self, end: usize, now: Nanos, input: Input) {
        if let Some(relay) = &mut self.sites[end].relay {
            relay.handle(PhysicalTime(now), input).expect("no frame is given here");
            if relay.is_over(PhysicalTime(now)) {
                self.sites[end].relay = None;
            }
        }
    }

    /// How many frames the processes have sent.
    pub(super) fn frames(&self) -> u64 {
        self.sites.iter().map(|site| site.given).sum()
    }

    /// The agent at an end does what is to be done. Frames have `len` bytes, or as many as in the protocol.
    pub(super) fn proceed(
        &mut self,
        end: usize,
        now: Nanos,
        mut len: impl FnMut() -> Option<usize>,
    ) -> Vec<Effect> {
        let mut effects = Vec::new();
        loop {
            let taken = self.fill(end, now, &mut len);
            let before = effects.len();
            self.drain(end, now, &mut effects);
            if !taken && before == effects.len() {
                return effects;
            }
        }
    }

    /// Gives the relayed link what the process has sent, as far as there is room.
    fn fill(&mut self, end: usize, now: Nanos, len: &mut impl FnMut() -> Option<usize>) -> bool {
        let site = &mut self.sites[end];
        let Some(relay) = &mut site.relay else { return false };
        let mut any = false;
        while let Some(event) = site.unsent.front() {
            let mut bytes = site.given.to_le_bytes().to_vec();
            let len = len().unwrap_or_else(|| encoded(event));
            bytes.resize(len.max(bytes.len()), 0);
            if relay.room() < bytes.len() {
                break;
            }
            relay.handle(PhysicalTime(now), Input::Frame(bytes.into())).expect("there is room");
            site.given += 1;
            site.sent.extend(site.unsent.pop_front());
            any = true;
        }
        any
    }

    fn drain(&mut self, end: usize, now: Nanos, effects: &mut Vec<Effect>) {
        while let Some(output) = self.sites[end].relay.as_mut().and_then(Relay::poll) {
            match output {
                Output::Packet(packet) => effects.push(Effect::Packet(packet.into_vec())),
                Output::Frame(bytes) => {
                    let event = self.take(end, &bytes);
                    let relay = self.sites[end].relay.as_mut().expect("it has put this out");
                    let read = Input::Taken(bytes.len());
                    relay.handle(PhysicalTime(now), read).expect("no frame is given here");
                    if !self.sites[end].is_deaf {
                        effects.push(Effect::Event(event));
                    }
                }
                Output::Ended(reason) => {
                    effects.extend(self.end(end).map(Effect::Event));
                    effects.push(Effect::Ended(reason));
                }
                Output::Finished => unreachable!("no end of these links finishes"),
            }
        }
    }

    /// A frame comes out: it must be the next one.
    fn take(&mut self, end: usize, bytes: &[u8]) -> Event {
        let event = self.sites[1 - end].sent.pop_front().expect("what comes out was sent");
        let number = bytes.first_chunk().map(|number| u64::from_le_bytes(*number));
        assert_eq!(number, Some(self.sites[end].taken), "frames come in order, each once");
        self.sites[end].taken += 1;
        event
    }

    /// The process at an end does not read any more.
    pub(super) fn deafen(&mut self, end: usize) {
        self.sites[end].is_deaf = true;
    }

    /// The RTI does not read a link any more. Returns the messages that it has not read.
    pub(super) fn read_no_more(&mut self, number: LinkId) -> Vec<Frame> {
        if self.number != Some(number) {
            return Vec::new();
        }
        let end = self.end_at(Place::Rti);
        self.deafen(end);
        let Site { sent, unsent, .. } = &self.sites[1 - end];
        sent.iter().chain(unsent).filter_map(frame).cloned().collect()
    }

    /// The process at an end learns that the link has ended, if it knows of the link.
    pub(super) fn end(&mut self, end: usize) -> Option<Event> {
        let knows = end == 0 || self.sites[end].taken > 0;
        let other = self.sites[1 - end].place;
        let site = &mut self.sites[end];
        if std::mem::replace(&mut site.has_ended, true) || site.is_deaf || !knows {
            return None;
        }
        match (site.place, other) {
            (Place::Rti, _) => Some(Event::Rti(RtiInput::Closed { link: self.number? })),
            (Place::Federate(me), Place::Rti) => Some(Event::Federate(me, FederateInput::RtiLost)),
            (Place::Federate(to), Place::Federate(from)) => {
                Some(Event::Peer { from, to, link_event: LinkEvent::Lost })
            }
            _ => None,
        }
    }

    /// The messages that do not come out any more, since an end has ended.
    pub(super) fn take_lost(&mut self) -> Vec<Frame> {
        let mut lost = Vec::new();
        if self.sites[0].has_ended && self.sites[1].relay.is_none() {
            // It has never been opened, and is not opened any more.
            self.sites[1].has_ended = true;
        }
        for end in [0, 1] {
            if self.sites[end].has_ended {
                lost.extend(self.sites[end].unsent.drain(..));
                lost.extend(self.sites[1 - end].sent.drain(..));
            }
        }
        lost.iter().filter_map(frame).cloned().collect()
    }
}

impl Site {
    fn new((place, machine): (Place, usize)) -> Self {
        Self {
            place,
            machine,
            relay: None,
            unsent: VecDeque::new(),
            sent: VecDeque::new(),
            given: 0,
            taken: 0,
            has_ended: false,
            is_deaf: false,
        }
    }
}

/// How many bytes an event has in the protocol.
fn encoded(event: &Event) -> usize {
    let mut bytes = Vec::new();
    if let Some(frame) = frame(event) {
        // A frame that cannot be encoded is not sent either.
        let _ = encode(frame, &mut bytes);
    }
    bytes.len()
}

/// The frame that an event brings.
fn frame(event: &Event) -> Option<&Frame> {
    match event {
        Event::Rti(RtiInput::Frame { frame, .. })
        | Event::Federate(_, FederateInput::FromRti(frame))
        | Event::Peer { link_event: LinkEvent::Frame(frame), .. } => Some(frame),
        _ => None,
    }
}
