//! What leaves for one machine, in order, over a link that is opened again when it ends.
//!
//! A shipment is held until its receipt comes, and is sent again over the next link if none has. The service opens
//! links; this file says when it should.

use std::collections::{BTreeSet, VecDeque};
use std::io::{self, IoSlice, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;

use hprm_core::{Nanos, PhysicalTime, Shipment};
use hprm_store::Object;

use super::blocks::{BLOCK, packed};
use super::label::{Hello, Item, Label, RECEIPT, VERSION, framed, receipt};

/// How long after a link has ended, or could not be opened, the next one is opened.
const PAUSE: Nanos = 500_000_000;

/// How long a machine may not be reached before what is to go there is dropped. Links of federates end earlier.
const GIVE_UP: Nanos = 60_000_000_000;

/// How many links may end, one after the other, without a receipt before the first shipment counts as lost.
const IN_VAIN: u32 = 4;

/// How many bytes are written before others have their turn.
const TURN: usize = 1 << 20;

/// See the module.
#[derive(Debug)]
pub(super) struct Outgoing {
    /// This machine.
    from: String,
    link: Link,
    cargo: VecDeque<Cargo>,
    /// The machines that reach this one, and from which it leads shipments there.
    leads: BTreeSet<String>,
    /// When the machine was last reached, or nothing was to be sent.
    reached_at: PhysicalTime,
    /// How many links one after the other have ended without any receipt.
    in_vain: u32,
    /// What need not be kept any more: the other end has it, or it is given up.
    done: Vec<Shipment>,
}

#[derive(Debug)]
enum Link {
    /// None; the next one is to be opened then.
    Closed {
        until: PhysicalTime,
    },
    /// It is being opened.
    Opening,
    Open(OpenLink),
}

#[derive(Debug)]
struct OpenLink {
    stream: UnixStream,
    /// What is left of what is said first.
    hello: Vec<u8>,
    /// How many shipments have been written completely and wait for their receipts; and how many bytes of the next.
    sent: usize,
    written: usize,
    /// The block of that shipment that is being written, if it is compressed.
    block: Block,
    /// A receipt of which not all bytes have come, and whether any has come whole.
    receipt: Vec<u8>,
    has_receipts: bool,
}

/// A compressed block.
#[derive(Debug, Default)]
struct Block {
    bytes: Vec<u8>,
    written: usize,
    /// How many bytes of the shipment are in this block and in those before it.
    taken: usize,
}

/// A shipment with its bytes, or what is told between shipments.
#[derive(Debug)]
struct Cargo {
    /// None of what is only told: there is no receipt for that.
    shipment: Option<Shipment>,
    item: Item,
    /// The item as bytes.
    label: Vec<u8>,
    /// None if it is lost.
    object: Option<Object>,
    compress: bool,
}

impl Cargo {
    fn shipment(label: Label, object: Option<Object>) -> Self {
        let (shipment, compress) = (Some(label.shipment), label.compress);
        let item = Item::Shipment(label);
        Self { shipment, label: framed(&item), item, object, compress }
    }

    /// The same without its bytes, which will not come.
    fn lost(self, why: &str) -> Self {
        match self.item {
            Item::Shipment(label) => {
                Self::shipment(Label { lost: Some(why.to_owned()), ..label }, None)
            }
            Item::Leads { .. } => self,
        }
    }

    /// What stands on it, if it is a shipment.
    fn label_of(&self) -> Option<&Label> {
        match &self.item {
            Item::Shipment(label) => Some(label),
            Item::Leads { .. } => None,
        }
    }

    fn bytes(&self) -> &[u8] {
        self.object.as_ref().map_or(&[], Object::as_bytes)
    }
}

impl Outgoing {
    pub(super) fn new(from: &str, now: PhysicalTime) -> Self {
        let link = Link::Closed { until: now };
        Self {
            from: from.to_owned(),
            link,
            cargo: VecDeque::new(),
            leads: BTreeSet::new(),
            reached_at: now,
            in_vain: 0,
            done: Vec::new(),
        }
    }

    /// Adds a shipment.
    pub(super) fn push(&mut self, label: &Label, object: Option<Object>, now: PhysicalTime) {
        if self.cargo.is_empty() {
            self.reached_at = now;
        }
        self.cargo.push_back(Cargo::shipment(label.clone(), object));
    }

    /// Shipments of another machine are led there, as long as that reaches this one.
    pub(super) fn lead(&mut self, machine: &str, is_there: bool) {
        let changes = match is_there {
            true => self.leads.insert(machine.to_owned()),
            false => self.leads.remove(machine),
        };
        // Without a link, the next one begins with it.
        if changes && matches!(self.link, Link::Open(_)) {
            let item = Item::Leads { machine: machine.to_owned(), is_there };
            let (shipment, label, object) = (None, framed(&item), None);
            self.cargo.push_back(Cargo { shipment, label, item, object, compress: false });
        }
    }

    /// Whether nothing is to be sent, and no receipt is waited for.
    pub(super) fn is_empty(&self) -> bool {
        self.cargo.is_empty()
    }

    /// How much is to be sent, or waits for its receipt.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.cargo.len()
    }

    /// Whether there is nothing to keep: nothing to send, and no link.
    pub(super) fn is_over(&self) -> bool {
        self.is_empty() && matches!(self.link, Link::Closed { .. })
    }

    /// Whether a link is to be opened now. From then on, [`Self::opened`] is waited for.
    pub(super) fn begins_to_open(&mut self, now: PhysicalTime) -> bool {
        let is_due = matches!(self.link, Link::Closed { until } if until <= now);
        let begins = is_due && !self.cargo.is_empty();
        if begins {
            self.link = Link::Opening;
        }
        begins
    }

    /// When there is something to do without a descriptor that says so.
    pub(super) fn next_wakeup(&self) -> Option<PhysicalTime> {
        match self.link {
            Link::Closed { until } if !self.cargo.is_empty() => Some(until),
            _ => None,
        }
    }

    /// A link is open, or could not be opened. If that has been so for long, what is to be sent is dropped.
    pub(super) fn opened(&mut self, opened: io::Result<UnixStream>, now: PhysicalTime) {
        match opened {
            Ok(stream) => {
                let leads = self.leads.iter().cloned().collect();
                let machine = self.from.clone();
                let hello = framed(&Hello { version: VERSION, machine, leads });
                self.cargo.retain(|it| it.shipment.is_some());
                self.reached_at = now;
                self.link = Link::Open(OpenLink {
                    stream,
                    hello,
                    sent: 0,
                    written: 0,
                    block: Block::default(),
                    receipt: Vec::new(),
                    has_receipts: false,
                });
            }
            Err(error) => {
                tracing::debug!("cannot ship: {error}");
                self.close(now);
            }
        }
    }

    /// The link has ended, or could not be opened.
    fn close(&mut self, now: PhysicalTime) {
        let before = std::mem::replace(&mut self.link, Link::Closed { until: now.plus(PAUSE) });
        if let Link::Open(link) = before {
            let is_in_vain = !link.has_receipts && !self.cargo.is_empty();
            self.in_vain = if is_in_vain { self.in_vain + 1 } else { 0 };
        }
        let mut dropped = 0;
        if now.since(self.reached_at) > GIVE_UP {
            (self.reached_at, dropped) = (now, self.cargo.len());
        } else if self.in_vain == IN_VAIN {
            // It may be what ends the links, and others wait behind it.
            (self.in_vain, dropped) = (0, 1);
        }
        for cargo in
            self.cargo.drain(..dropped.min(self.cargo.len())).collect::<Vec<_>>().into_iter().rev()
        {
            // Its receivers wait for it, so they are told when they can be.
            if cargo.object.is_some() {
                self.done.extend(cargo.shipment);
                self.cargo.push_front(cargo.lost("its machine was not reached for too long"));
            }
        }
    }

    /// The machines to which shipments of this one go, if there is no link.
    pub(super) fn stranded(&self) -> BTreeSet<&str> {
        let is_closed = matches!(self.link, Link::Closed { .. });
        let labels = self.cargo.iter().filter_map(Cargo::label_of).filter(|_| is_closed);
        let own = labels.filter(|label| label.from == self.from);
        own.flat_map(|label| label.to.iter().map(|(machine, _)| machine.as_str())).collect()
    }

    /// Takes these shipments out: another way leads there.
    pub(super) fn take_stranded(&mut self) -> Vec<(Label, Option<Object>)> {
        let from = &self.from;
        let is_own = |it: &Cargo| it.label_of().is_some_and(|label| label.from == *from);
        let (own, others) = self.cargo.drain(..).partition(is_own);
        self.cargo = others;
        let own: VecDeque<Cargo> = own;
        let own = own.into_iter();
        own.filter_map(|it| Some((it.label_of()?.clone(), it.object))).collect()
    }

    /// What to wait for: the link, and whether it is to be written.
    pub(super) fn interest(&self) -> Option<(BorrowedFd<'_>, bool)> {
        match &self.link {
            Link::Open(link) => {
                let writes = !link.hello.is_empty() || link.sent < self.cargo.len();
                Some((link.stream.as_fd(), writes))
            }
            _ => None,
        }
    }

    /// Writes and reads what the link takes and has.
    pub(super) fn proceed(&mut self, now: PhysicalTime) {
        let Link::Open(link) = &mut self.link else { return };
        let written = link.write(&mut self.cargo);
        match written.and_then(|()| link.read(&mut self.cargo, &mut self.done)) {
            Ok(()) => self.reached_at = now,
            Err(error) => {
                tracing::debug!("a link for shipments has ended: {error}");
                self.close(now);
            }
        }
    }

    /// The shipments that need not be kept any more: the other end has them, or they are given up.
    pub(super) fn take_done(&mut self) -> Vec<Shipment> {
        std::mem::take(&mut self.done)
    }
}

impl OpenLink {
    fn write(&mut self, cargo: &mut VecDeque<Cargo>) -> io::Result<()> {
        let mut turn = 0;
        while turn < TURN {
            let written = if !self.hello.is_empty() {
                self.stream.write(&self.hello)
            } else if let Some(next) = cargo.get(self.sent) {
                self.write_cargo(next)
            } else {
                return Ok(());
            };
            match written {
                Ok(count) => {
                    turn += count;
                    self.wrote(count, cargo);
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Writes some of a shipment.
    fn write_cargo(&mut self, next: &Cargo) -> io::Result<usize> {
        let label = next.label.get(self.written..).unwrap_or_default();
        if !next.compress {
            let from = self.written.saturating_sub(next.label.len());
            let bytes = &next.bytes()[from..];
            return self.stream.write_vectored(&[IoSlice::new(label), IoSlice::new(bytes)]);
        }
        if !label.is_empty() {
            return self.stream.write(label);
        }
        if self.block.written == self.block.bytes.len() {
            let rest = &next.bytes()[self.block.taken..];
            let more = &rest[..rest.len().min(BLOCK)];
            let taken = self.block.taken + more.len();
            self.block = Block { bytes: packed(more), written: 0, taken };
        }
        self.stream.write(&self.block.bytes[self.block.written..])
    }

    /// Whether all of a shipment has been written.
    fn has_written(&self, next: &Cargo) -> bool {
        let (label, bytes) = (next.label.len(), next.bytes().len());
        if !next.compress {
            return self.written == label + bytes;
        }
        let block = &self.block;
        self.written == label && block.taken == bytes && block.written == block.bytes.len()
    }

    fn wrote(&mut self, count: usize, cargo: &mut VecDeque<Cargo>) {
        if !self.hello.is_empty() {
            self.hello.drain(..count);
            return;
        }
        let next = &cargo[self.sent];
        if next.compress && self.written == next.label.len() {
            self.block.written += count;
        } else {
            self.written += count;
        }
        if self.has_written(next) {
            self.block = Block::default();
            self.written = 0;
            match next.shipment {
                Some(_) => self.sent += 1,
                None => drop(cargo.remove(self.sent)),
            }
        }
    }

    /// Reads receipts. A shipment is dropped once its receipt has come.
    fn read(&mut self, cargo: &mut VecDeque<Cargo>, done: &mut Vec<Shipment>) -> io::Result<()> {
        let mut buffer = [0; 64 * RECEIPT];
        loop {
            match self.stream.read(&mut buffer) {
                Ok(0) => return Err(io::ErrorKind::ConnectionReset.into()),
                Ok(count) => self.receipt.extend(&buffer[..count]),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
            let whole = self.receipt.len() - self.receipt.len() % RECEIPT;
            for came in self.receipt.drain(..whole).collect::<Vec<_>>().chunks(RECEIPT) {
                let is_meant = |it: &Cargo| it.shipment.map(receipt).is_some_and(|it| it == *came);
                let at = cargo.iter().take(self.sent).position(is_meant);
                if let Some(cargo) = at.and_then(|at| cargo.remove(at)) {
                    self.sent -= 1;
                    self.has_receipts = true;
                    // What is lost has been given up before.
                    done.extend(cargo.shipment.filter(|_| cargo.object.is_some()));
                }
            }
        }
    }
}
