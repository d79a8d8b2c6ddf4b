//! What leaves for one machine, in order, over a link that is opened again when it ends.
//!
//! A shipment is held until its receipt comes, and is sent again over the next link if none has. Of one that is still
//! coming, what is there leaves; while nothing is, others pass it. The service opens links; this file says when it should.

use std::collections::{BTreeSet, VecDeque};
use std::io;
use std::os::fd::BorrowedFd;

use hprm_core::{Nanos, PhysicalTime, Shipment};
use hprm_federated::relay::Bytes;

use super::blocks::{BLOCK, packed};
use super::content::Content;
use super::label::{Hello, Item, Label, OPEN, RECEIPT, VERSION, framed, receipt};
use super::pipe::Pipe;

/// How long after a link has ended, or could not be opened, the next one is opened.
const PAUSE: Nanos = 500_000_000;

/// How long a machine may not be reached before what is to go there is dropped. Links of federates end earlier.
const GIVE_UP: Nanos = 60_000_000_000;

/// How many links may end, one after the other, without a receipt before the first shipment counts as lost.
pub(super) const IN_VAIN: u32 = 4;

/// How many bytes are given before others have their turn.
const TURN: usize = 1 << 20;

/// The most bytes of a piece that is not compressed: four of the frames that an agent makes of it.
const PIECE: usize = 4 * (63 << 10);

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
    pipe: Pipe,
    /// What is given next.
    waiting: VecDeque<Bytes>,
    /// How many shipments at the front are complete on this link, and wait for their receipts.
    sent: usize,
    /// A receipt of which not all bytes have come, and whether any has come whole.
    receipt: Vec<u8>,
    has_receipts: bool,
}

/// A shipment with its bytes, or what is told between shipments.
#[derive(Debug)]
struct Cargo {
    /// None of what is only told: there is no receipt for that.
    shipment: Option<Shipment>,
    item: Item,
    /// None if it is lost.
    content: Option<Content>,
    compress: bool,
    /// Whether it has begun on this link, and how many of its bytes have.
    has_begun: bool,
    taken: usize,
    /// Whether the rest of it does not come. It has begun here, so the other end is to be told.
    is_broken: bool,
}

impl Cargo {
    fn shipment(label: Label, content: Option<Content>) -> Self {
        let (shipment, compress) = (Some(label.shipment), label.compress);
        let (item, has_begun, is_broken) = (Item::Shipment(label), false, false);
        Self { shipment, item, content, compress, has_begun, taken: 0, is_broken }
    }

    fn told(item: Item) -> Self {
        let (shipment, content, compress) = (None, None, false);
        let (has_begun, is_broken) = (false, false);
        Self { shipment, item, content, compress, has_begun, taken: 0, is_broken }
    }

    /// The same without its bytes, which will not come.
    fn lost(self, why: &str) -> Self {
        match self.item {
            Item::Shipment(label) => {
                Self::shipment(Label { lost: Some(why.to_owned()), ..label }, None)
            }
            item => Self::told(item),
        }
    }

    /// What stands on it, if it is a shipment.
    fn label_of(&self) -> Option<&Label> {
        match &self.item {
            Item::Shipment(label) => Some(label),
            _ => None,
        }
    }

    /// How many of its bytes are there, and have not begun on this link.
    fn ready(&self) -> usize {
        self.content.as_ref().map_or(0, |it| it.there().saturating_sub(self.taken))
    }

    /// Whether it is on this link as a whole.
    fn is_complete(&self) -> bool {
        let bytes = self.label_of().map_or(0, Label::bytes);
        self.has_begun && self.taken as u64 == bytes
    }

    /// Whether there is something of it to be written, if others may begin or not.
    fn has_more(&self, may_begin: bool) -> bool {
        match self.has_begun {
            true => self.is_broken || self.ready() > 0,
            false => may_begin,
        }
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
    pub(super) fn push(&mut self, label: &Label, content: Option<Content>, now: PhysicalTime) {
        if self.cargo.is_empty() {
            self.reached_at = now;
        }
        self.cargo.push_back(Cargo::shipment(label.clone(), content));
    }

    /// Some of what was coming is broken. What has begun here stays until the other end is told.
    pub(super) fn drop_broken(&mut self) {
        let is_broken = |it: &Cargo| it.content.as_ref().is_some_and(Content::is_broken);
        self.cargo.retain(|it| it.has_begun || !is_broken(it));
        for cargo in self.cargo.iter_mut().filter(|it| is_broken(it)) {
            // A piece that has left holds its bytes itself.
            (cargo.content, cargo.is_broken) = (None, true);
        }
    }

    /// Shipments of another machine are led there, as long as that reaches this one.
    pub(super) fn lead(&mut self, machine: &str, is_there: bool) {
        let changes = match is_there {
            true => self.leads.insert(machine.to_owned()),
            false => self.leads.remove(machine),
        };
        // Without a link, the next one begins with it.
        if changes && matches!(self.link, Link::Open(_)) {
            let machine = machine.to_owned();
            self.cargo.push_back(Cargo::told(Item::Leads { machine, is_there }));
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
    pub(super) fn opened(&mut self, opened: io::Result<Pipe>, now: PhysicalTime) {
        match opened {
            Ok(pipe) => {
                let leads = self.leads.iter().cloned().collect();
                let machine = self.from.clone();
                let hello = framed(&Hello { version: VERSION, machine, leads });
                self.cargo.retain(|it| it.shipment.is_some());
                self.reached_at = now;
                self.link = Link::Open(OpenLink {
                    pipe,
                    waiting: VecDeque::from([hello.into()]),
                    sent: 0,
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
        // All of it begins again.
        self.cargo.retain(|it| !it.is_broken);
        self.cargo.iter_mut().for_each(|it| (it.has_begun, it.taken) = (false, 0));
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
            if cargo.content.is_some() {
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
    pub(super) fn take_stranded(&mut self) -> Vec<(Label, Option<Content>)> {
        let from = &self.from;
        let is_own = |it: &Cargo| it.label_of().is_some_and(|label| label.from == *from);
        let (own, others) = self.cargo.drain(..).partition(is_own);
        self.cargo = others;
        let own: VecDeque<Cargo> = own;
        let own = own.into_iter();
        own.filter_map(|it| Some((it.label_of()?.clone(), it.content))).collect()
    }

    /// What to wait for: something to take, and room for what is to be given.
    pub(super) fn interests(&self) -> impl Iterator<Item = BorrowedFd<'_>> {
        let link = match &self.link {
            Link::Open(link) => Some(link),
            _ => None,
        };
        let gives = |it: &&OpenLink| !it.waiting.is_empty() || it.next(&self.cargo).is_some();
        let to_give = link.filter(gives).map(|it| it.pipe.to_give());
        link.map(|it| it.pipe.to_take()).into_iter().chain(to_give)
    }

    /// Gives and takes what the link takes and has.
    pub(super) fn proceed(&mut self, now: PhysicalTime) {
        let Link::Open(link) = &mut self.link else { return };
        let given = link.give(&mut self.cargo);
        match given.and_then(|()| link.take(&mut self.cargo, &mut self.done)) {
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
    fn give(&mut self, cargo: &mut VecDeque<Cargo>) -> io::Result<()> {
        let mut turn = 0;
        while turn < TURN {
            if self.waiting.is_empty() && !self.go_on(cargo) {
                return Ok(());
            }
            let Some(next) = self.waiting.front() else { continue };
            match self.pipe.give(next) {
                Ok(()) => {
                    turn += next.len();
                    self.waiting.pop_front();
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Which of the cargo is given next: the first of which something is there.
    fn next(&self, cargo: &VecDeque<Cargo>) -> Option<usize> {
        let mut open = 0;
        for (at, one) in cargo.iter().enumerate().skip(self.sent) {
            if one.has_more(open < OPEN) {
                return Some(at);
            }
            if !one.has_begun {
                // What is behind it must not begin before it.
                return None;
            }
            open += usize::from(!one.is_complete());
        }
        None
    }

    /// Goes on with the next of the cargo; false if nothing of it is there.
    fn go_on(&mut self, cargo: &mut VecDeque<Cargo>) -> bool {
        let Some(at) = self.next(cargo) else { return false };
        let next = &mut cargo[at];
        if next.is_broken {
            let broken = next.shipment.map(|it| framed(&Item::Broken { of: it.key() }));
            self.waiting.extend(broken.map(Bytes::from));
            cargo.remove(at);
            return true;
        }
        let mut items = Vec::new();
        if !next.has_begun {
            next.has_begun = true;
            items = framed(&next.item);
        }
        let piece = next.shipment.and_then(|it| add_piece(next, it, &mut items));
        self.waiting.push_back(items.into());
        self.waiting.extend(piece);
        if next.shipment.is_none() {
            // There is no receipt for what is only told.
            cargo.remove(at);
        }
        while cargo.get(self.sent).is_some_and(Cargo::is_complete) {
            self.sent += 1;
        }
        true
    }

    /// Takes receipts. A shipment is dropped once its receipt has come.
    fn take(&mut self, cargo: &mut VecDeque<Cargo>, done: &mut Vec<Shipment>) -> io::Result<()> {
        loop {
            match self.pipe.take(64 * RECEIPT) {
                Ok(None) => return Err(io::ErrorKind::ConnectionReset.into()),
                Ok(Some(receipts)) => self.receipt.extend_from_slice(&receipts),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) => return Err(error),
            }
            let whole = self.receipt.len() - self.receipt.len() % RECEIPT;
            for came in self.receipt.drain(..whole).collect::<Vec<_>>().chunks(RECEIPT) {
                let is_meant = |it: &Cargo| it.shipment.map(receipt).is_some_and(|it| it == *came);
                let at = cargo.iter().position(|it| it.is_complete() && is_meant(it));
                if let Some((at, cargo)) = at.and_then(|at| Some((at, cargo.remove(at)?))) {
                    self.sent -= usize::from(at < self.sent);
                    self.has_receipts = true;
                    // What is lost has been given up before.
                    done.extend(cargo.shipment.filter(|_| cargo.content.is_some()));
                }
            }
        }
    }
}

/// The next bytes of a shipment, if some are there. Before them comes an item; compressed ones are added behind it, and others
/// stay where they are.
fn add_piece(cargo: &mut Cargo, shipment: Shipment, items: &mut Vec<u8>) -> Option<Bytes> {
    let len = cargo.ready().min(if cargo.compress { BLOCK } else { PIECE });
    let content = cargo.content.as_ref().filter(|_| len > 0)?;
    let range = cargo.taken..cargo.taken + len;
    cargo.taken = range.end;
    let short = |len: usize| u32::try_from(len).expect("a piece is short");
    let pack = |bytes: &[u8]| bytes.get(range.clone()).and_then(packed);
    let bytes = cargo.compress.then(|| content.look(pack)).flatten();
    let packed = bytes.as_ref().map(|bytes| short(bytes.len()));
    items.extend(framed(&Item::Piece { of: shipment.key(), len: short(len), packed }));
    match bytes {
        Some(bytes) => {
            items.extend(bytes);
            None
        }
        None => Some(content.piece(range)),
    }
}
