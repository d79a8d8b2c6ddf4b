//! What one end of a relayed link sends: frames until the other end has them.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use hprm_core::PhysicalTime;

use super::bytes::Bytes;
use super::pace::Pace;
use super::packet::{FRAME_LIMIT, Header, RUNS};
use super::{Violation, WINDOW_BYTES, WINDOW_FRAMES};

/// So many later transmissions may arrive before an earlier one counts as lost: the carrier may reorder a little.
const REORDERED: u64 = 3;

/// What has a number on the link.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) enum Item {
    Frame(Bytes),
    Finish,
}

impl Item {
    pub(super) fn len(&self) -> u64 {
        match self {
            Self::Frame(bytes) => bytes.len() as u64,
            Self::Finish => 0,
        }
    }

    /// What it counts of what may be on its way. A packet costs the carrier something, however short it is.
    fn cost(&self) -> u64 {
        self.len().max(WINDOW_BYTES / WINDOW_FRAMES)
    }
}

/// An item that the other end may not have.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Slot {
    /// None once it has arrived there, while one before it has not.
    item: Option<Item>,
    /// The bytes of all items through this one.
    end: u64,
    /// When it was sent last, and that transmission, if it is on its way.
    sent: Option<PhysicalTime>,
    transmission: Option<u64>,
    /// Its only transmission, if that counts as lost for no other reason than that there was no answer in time.
    overdue: Option<u64>,
    /// Whether it has been sent more than once, so an answer does not tell which was answered.
    again: bool,
}

/// What is known of transmissions that have had no answer in time. They are lost, or only late: then each that is sent again is in
/// vain. So one is sent again, and what is answered first tells which it is.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum Probe {
    /// The last of the items that the other end could tell of is to be sent again.
    Due,
    /// This one has been.
    Sent(u64),
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Outgoing {
    /// The number of the first slot.
    first: u64,
    slots: VecDeque<Slot>,
    /// The first item that has never been sent.
    unsent: u64,
    /// Items that have been sent, and have not arrived as far as is known; those of them that are lost.
    open: BTreeSet<u64>,
    lost: BTreeSet<u64>,
    /// Transmissions on their way: which item, and since when.
    under_way: BTreeMap<u64, (u64, PhysicalTime)>,
    transmissions: u64,
    /// What is on its way, by cost; how many bytes are held here, and have been given in all.
    flight: u64,
    held: u64,
    given: u64,
    /// What the other end takes: the numbers below, and the bytes.
    frame_limit: u64,
    byte_limit: u64,
    is_finished: bool,
    probe: Option<Probe>,
    /// Of what has these numbers or later ones, the other end's last answer said nothing: it had no room for more runs.
    untold: u64,
    pace: Pace,
}

impl Outgoing {
    pub(super) fn new() -> Self {
        Self {
            first: 0,
            slots: VecDeque::new(),
            unsent: 0,
            open: BTreeSet::new(),
            lost: BTreeSet::new(),
            under_way: BTreeMap::new(),
            transmissions: 0,
            flight: 0,
            held: 0,
            given: 0,
            frame_limit: WINDOW_FRAMES,
            byte_limit: WINDOW_BYTES,
            is_finished: false,
            probe: None,
            untold: u64::MAX,
            pace: Pace::new(WINDOW_BYTES),
        }
    }

    /// How long a frame may be that is given now.
    pub(super) fn room(&self) -> usize {
        if self.is_finished || self.slots.len() as u64 >= WINDOW_FRAMES {
            return 0;
        }
        usize::try_from(WINDOW_BYTES - self.held).unwrap_or(usize::MAX).min(FRAME_LIMIT)
    }

    /// What is on its way, by cost.
    pub(super) fn flight(&self) -> u64 {
        self.flight
    }

    /// Takes a frame for which there is room, or the end.
    pub(super) fn give(&mut self, item: Item) {
        self.is_finished |= item == Item::Finish;
        self.held += item.len();
        self.given += item.len();
        let (sent, transmission, overdue) = (None, None, None);
        let end = self.given;
        let slot = Slot { item: Some(item), end, sent, transmission, overdue, again: false };
        self.slots.push_back(slot);
    }

    /// Whether the other end has everything, the end too.
    pub(super) fn is_done(&self) -> bool {
        self.is_finished && self.slots.is_empty()
    }

    /// Whether the end has been given.
    pub(super) fn is_finished(&self) -> bool {
        self.is_finished
    }

    /// Whether an item waits until the other end takes more.
    pub(super) fn waits_for_credit(&self) -> bool {
        self.unsent < self.end() && !self.has_credit()
    }

    /// When the oldest transmission without an answer counts as lost.
    pub(super) fn timeout(&self) -> Option<PhysicalTime> {
        let (_, (_, since)) = self.under_way.first_key_value()?;
        Some(since.plus(self.pace.timeout()))
    }

    /// The next item to be sent, with its number, which then is on its way.
    pub(super) fn send(&mut self, now: PhysicalTime) -> Option<(u64, &Item)> {
        if self.flight >= self.pace.window() {
            return None;
        }
        let next = match self.probe {
            Some(Probe::Sent(_)) => return None,
            Some(Probe::Due) => self.lost.range(..self.untold).next_back().copied(),
            None => None,
        };
        let next = next.or_else(|| self.lost.first().copied());
        self.lost.remove(&next.unwrap_or(u64::MAX));
        let number = match next {
            Some(number) => number,
            None if self.unsent < self.end() && self.has_credit() => {
                self.open.insert(self.unsent);
                self.unsent += 1;
                self.unsent - 1
            }
            None => return None,
        };
        self.probe = self.probe.map(|_| Probe::Sent(number));
        let transmission = self.transmissions;
        self.transmissions += 1;
        self.under_way.insert(transmission, (number, now));
        let at = self.index(number)?;
        let slot = &mut self.slots[at];
        slot.again = slot.sent.is_some();
        (slot.sent, slot.transmission, slot.overdue) = (Some(now), Some(transmission), None);
        let item = slot.item.as_ref()?;
        self.flight += item.cost();
        Some((number, item))
    }

    /// Takes what a packet says of what has arrived at the other end, and of what that end takes.
    pub(super) fn acknowledge(
        &mut self,
        header: &Header,
        now: PhysicalTime,
    ) -> Result<(), Violation> {
        let mut runs = Vec::new();
        let mut end = header.next;
        for (missing, there) in &header.held {
            let start = end.saturating_add(u64::from(*missing));
            end = start.saturating_add(u64::from(*there));
            runs.push(start..end);
        }
        if end > self.unsent {
            return Err(Violation::Acknowledged);
        }
        self.untold = if header.held.len() < RUNS { u64::MAX } else { end };
        self.frame_limit = self.frame_limit.max(header.frame_limit);
        self.byte_limit = self.byte_limit.max(header.byte_limit);
        let (mut latest, mut are_late) = (None, false);
        for run in std::iter::once(0..header.next).chain(runs) {
            while let Some(number) = self.open.range(run.clone()).next().copied() {
                self.open.remove(&number);
                are_late |= self.is_overdue(number);
                latest = latest.max(self.arrived(number, now));
            }
        }
        if are_late {
            self.recall(now);
        } else if self.lost.is_empty() && self.probe == Some(Probe::Due) {
            self.probe = None;
        }
        while self.first < header.next {
            self.slots.pop_front();
            self.first += 1;
        }
        if let Some(latest) = latest {
            self.find_losses(latest);
        }
        Ok(())
    }

    /// No transmission on its way will be answered, or none has been for too long.
    pub(super) fn time_out(&mut self, now: PhysicalTime) {
        if self.timeout().is_some_and(|due| due <= now) {
            self.pace.timed_out();
            self.lose(u64::MAX, true);
            self.probe = Some(Probe::Due);
        }
    }

    /// The carrier works again after a break. What was on its way is lost.
    pub(super) fn resume(&mut self) {
        self.pace.resumed();
        self.lose(u64::MAX, false);
        self.probe = None;
    }

    fn end(&self) -> u64 {
        self.first + self.slots.len() as u64
    }

    fn index(&self, number: u64) -> Option<usize> {
        let at = usize::try_from(number.checked_sub(self.first)?).ok()?;
        (at < self.slots.len()).then_some(at)
    }

    /// Whether the other end takes the first item that has never been sent.
    fn has_credit(&self) -> bool {
        let Some(at) = self.index(self.unsent) else { return false };
        self.unsent < self.frame_limit && self.slots[at].end <= self.byte_limit
    }

    /// An item is at the other end. Returns its transmission, if that was the only one: of several, it is not known
    /// which has arrived.
    fn arrived(&mut self, number: u64, now: PhysicalTime) -> Option<u64> {
        let at = self.index(number)?;
        let slot = &mut self.slots[at];
        let item = slot.item.take()?;
        self.lost.remove(&number);
        self.held -= item.len();
        self.pace.arrived(item.cost());
        let transmission = slot.transmission.take();
        if let Some(transmission) = transmission {
            self.flight -= item.cost();
            self.under_way.remove(&transmission);
        }
        if self.probe == Some(Probe::Sent(number)) {
            // What was sent before it and has not come is lost, as far as is known.
            self.probe = None;
        }
        if slot.again {
            return None;
        }
        // However late it is: the next ones may be as late.
        self.pace.measured(now.since(slot.sent?));
        transmission.or(slot.overdue)
    }

    /// Whether an item counts as lost for no other reason than that there was no answer in time.
    fn is_overdue(&self, number: u64) -> bool {
        self.index(number).is_some_and(|at| self.slots[at].overdue.is_some())
    }

    /// One of the transmissions without an answer was only late, so the others may be on their way, too.
    fn recall(&mut self, now: PhysicalTime) {
        self.probe = None;
        self.pace.was_hasty();
        let lost = std::mem::take(&mut self.lost);
        for number in lost {
            let Some(at) = self.index(number) else { continue };
            let slot = &mut self.slots[at];
            let (Some(transmission), Some(item)) = (slot.overdue.take(), &slot.item) else {
                self.lost.insert(number);
                continue;
            };
            slot.transmission = Some(transmission);
            self.flight += item.cost();
            self.under_way.insert(transmission, (number, now));
        }
    }

    /// A transmission has arrived, so those well before it are lost.
    fn find_losses(&mut self, latest: u64) {
        let Some(through) = latest.checked_sub(REORDERED) else { return };
        let first = self.under_way.first_key_value().map(|(transmission, _)| *transmission);
        if let Some(transmission) = first.filter(|first| *first <= through) {
            self.pace.lost(transmission, self.transmissions);
            self.lose(through, false);
        }
    }

    /// The transmissions through that one are lost, as far as is known: they may only be overdue.
    fn lose(&mut self, through: u64, are_overdue: bool) {
        while let Some(entry) = self.under_way.first_entry().filter(|entry| *entry.key() <= through)
        {
            let (transmission, (number, _)) = entry.remove_entry();
            let Some(at) = self.index(number) else { continue };
            let slot = &mut self.slots[at];
            slot.transmission = None;
            slot.overdue = Some(transmission).filter(|_| are_overdue && !slot.again);
            self.flight -= slot.item.as_ref().map_or(0, Item::cost);
            self.lost.insert(number);
        }
    }
}
