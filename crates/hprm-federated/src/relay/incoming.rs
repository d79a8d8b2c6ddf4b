//! What one end of a relayed link receives: frames in order, each once, and no more than it has room for.

use std::collections::BTreeMap;

use super::outgoing::Item;
use super::packet::{Header, RUNS};
use super::{Violation, WINDOW_BYTES, WINDOW_FRAMES};

/// So many items, or so many bytes of them, are much: the other end may wait for the answer, to send more.
const MUCH: (u64, u64) = (4, 16 << 10);

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Incoming {
    /// The number of the first item that has not come.
    next: u64,
    /// Items that have come before one that is missing, and their bytes.
    early: BTreeMap<u64, Item>,
    early_bytes: u64,
    /// The runs of their numbers: where each begins, and the number after it.
    runs: BTreeMap<u64, u64>,
    /// The items that were handed on, and their bytes, and those of them that the reader has taken.
    passed_bytes: u64,
    taken: u64,
    taken_bytes: u64,
    /// The number of the end, once it has come.
    finish: Option<u64>,
    /// What the other end was told last of what it may send, in bytes and items.
    told: (u64, u64),
    /// What has come since: items, and their bytes.
    untold: (u64, u64),
}

impl Incoming {
    pub(super) fn new() -> Self {
        Self {
            next: 0,
            early: BTreeMap::new(),
            early_bytes: 0,
            runs: BTreeMap::new(),
            passed_bytes: 0,
            taken: 0,
            taken_bytes: 0,
            finish: None,
            told: (WINDOW_FRAMES, WINDOW_BYTES),
            untold: (0, 0),
        }
    }

    /// An item has come. Returns whether it is new.
    pub(super) fn receive(&mut self, number: u64, item: Item) -> Result<bool, Violation> {
        if number < self.next || self.early.contains_key(&number) {
            return Ok(false);
        }
        let waiting = self.passed_bytes - self.taken_bytes + self.early_bytes;
        if number >= self.frame_limit() || waiting + item.len() > WINDOW_BYTES {
            return Err(Violation::Credit);
        }
        let is_last = item == Item::Finish;
        let after_end = self.finish.is_some_and(|finish| number > finish);
        let before_others = is_last && self.early.keys().any(|other| *other > number);
        if after_end || before_others {
            return Err(Violation::AfterEnd);
        }
        if is_last {
            self.finish = Some(number);
        }
        self.untold = (self.untold.0 + 1, self.untold.1 + item.len());
        self.early_bytes += item.len();
        self.early.insert(number, item);
        self.note(number);
        Ok(true)
    }

    /// The next item in order, if it has come.
    pub(super) fn pass(&mut self) -> Option<Item> {
        let item = self.early.remove(&self.next)?;
        if let Some(end) = self.runs.remove(&self.next).filter(|end| *end > self.next + 1) {
            self.runs.insert(self.next + 1, end);
        }
        self.next += 1;
        self.early_bytes -= item.len();
        self.passed_bytes += item.len();
        Some(item)
    }

    /// The reader has taken a frame of so many bytes. Returns whether the other end should be told that there is more
    /// room: after a quarter, so that it need not wait, and is not told of each frame.
    pub(super) fn take(&mut self, bytes: u64) -> bool {
        self.taken = (self.taken + 1).min(self.next);
        self.taken_bytes = (self.taken_bytes + bytes).min(self.passed_bytes);
        let (told_frames, told_bytes) = self.told;
        self.frame_limit() - told_frames >= WINDOW_FRAMES / 4
            || self.byte_limit() - told_bytes >= WINDOW_BYTES / 4
    }

    /// Whether the other end should be told at once of what has come: much, the end, or something after what is missing.
    pub(super) fn has_much_to_tell(&self) -> bool {
        let (items, bytes) = self.untold;
        items >= MUCH.0 || bytes >= MUCH.1 || self.finish.is_some() || !self.early.is_empty()
    }

    /// Whether the end has been handed on.
    pub(super) fn is_done(&self) -> bool {
        self.finish.is_some_and(|finish| finish < self.next)
    }

    /// Writes into a packet the first item that is missing, which later ones have come, and what may be sent.
    pub(super) fn tell(&mut self, header: &mut Header) {
        let mut before = self.next;
        for (start, end) in self.runs.iter().take(RUNS) {
            // The window is far smaller than the largest of these numbers.
            let short = |number: u64| u32::try_from(number).unwrap_or(u32::MAX);
            header.held.push((short(start - before), short(end - start)));
            before = *end;
        }
        header.next = self.next;
        self.told = (self.frame_limit(), self.byte_limit());
        self.untold = (0, 0);
        (header.frame_limit, header.byte_limit) = self.told;
    }

    /// Adds an item to the runs.
    fn note(&mut self, number: u64) {
        let end = self.runs.remove(&(number + 1)).unwrap_or(number + 1);
        let before = self.runs.range_mut(..number).next_back();
        match before.filter(|(_, before)| **before == number) {
            Some((_, before)) => *before = end,
            None => drop(self.runs.insert(number, end)),
        }
    }

    fn frame_limit(&self) -> u64 {
        self.taken + WINDOW_FRAMES
    }

    fn byte_limit(&self) -> u64 {
        self.taken_bytes + WINDOW_BYTES
    }
}
