//! What comes from the shipping service of one machine, over one link.
//!
//! A label says what begins; the service gives memory for it, into which the link is read. The bytes of a shipment for
//! which there is no memory, or no reader, are taken and forgotten.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::os::fd::BorrowedFd;

use hprm_core::Shipment;
use hprm_federated::relay::Bytes;

use super::blocks::BLOCK;
use super::content::Content;
use super::label::{Hello, Item, Key, LABEL_LIMIT, LENGTH, Label, OPEN, VERSION, receipt};
use super::pipe::Pipe;
use crate::records::decode;

/// How many bytes are read before others have their turn.
const TURN: usize = 1 << 20;

/// See the module.
#[derive(Debug)]
pub(super) struct Incoming {
    pipe: Pipe,
    /// The other machine, once it has said so.
    machine: Option<String>,
    /// The machines of which shipments come over this link, as long as they reach the other one; that one, too.
    reached: BTreeSet<String>,
    part: Part,
    /// The shipments that have begun and are not complete.
    open: BTreeMap<Key, Open>,
    /// Receipts that have not left.
    receipts: Vec<u8>,
}

/// What is being read.
#[derive(Debug)]
enum Part {
    /// A length, and as many bytes.
    Item(Vec<u8>),
    /// A shipment begins, and the service has not said where its bytes go.
    Asks(Label),
    /// A piece of a shipment, of which so many bytes are missing.
    Bytes { of: Key, left: usize },
    /// A compressed piece: what has come of it, what is missing, and how many bytes it becomes.
    Packed { of: Key, piece: Vec<u8>, left: usize, len: usize },
}

/// A shipment of which not all bytes have come.
#[derive(Debug)]
struct Open {
    label: Label,
    into: Option<Content>,
    filled: u64,
}

/// What has come.
#[derive(Debug)]
pub(super) enum Came {
    /// Nothing that the service has to know.
    Nothing,
    /// A label: [`Incoming::read_into`] says where the bytes go.
    Label(Label),
    /// A machine does not reach the other one any more.
    Gone(String),
    /// A shipment is complete, or lost, and where its bytes are, if they are anywhere.
    Shipment(Label, Option<Content>),
}

impl Incoming {
    pub(super) fn new(pipe: Pipe) -> Self {
        let part = Part::Item(Vec::new());
        let (machine, reached, open) = (None, BTreeSet::new(), BTreeMap::new());
        Self { pipe, machine, reached, part, open, receipts: Vec::new() }
    }

    /// The machine at the other end, as far as it is known.
    pub(super) fn machine(&self) -> Option<&str> {
        self.machine.as_deref()
    }

    /// Whether shipments of a machine come over this link.
    pub(super) fn reaches(&self, machine: &str) -> bool {
        self.reached.contains(machine)
    }

    /// The link is at its end, and so is what has come in part. Returns the machines of which shipments came over it.
    pub(super) fn into_reached(self) -> BTreeSet<String> {
        self.open.values().filter_map(|open| open.into.as_ref()).for_each(Content::break_off);
        self.reached
    }

    /// What to wait for: something to take, and room for what is to be given.
    pub(super) fn interests(&self) -> impl Iterator<Item = BorrowedFd<'_>> {
        let to_give = (!self.receipts.is_empty()).then(|| self.pipe.to_give());
        [self.pipe.to_take()].into_iter().chain(to_give)
    }

    /// The bytes of the shipment whose label has come last go there.
    pub(super) fn read_into(&mut self, label: Label, into: Option<Content>) {
        self.part = Part::Item(Vec::new());
        self.open.insert(label.shipment.key(), Open { label, into, filled: 0 });
    }

    /// Tells the other end that it need not keep a shipment.
    ///
    /// # Errors
    ///
    /// If the link has ended.
    pub(super) fn acknowledge(&mut self, shipment: Shipment) -> io::Result<()> {
        self.receipts.extend(receipt(shipment));
        self.settle()
    }

    /// Gives the receipts away, if there is room.
    fn settle(&mut self) -> io::Result<()> {
        if self.receipts.is_empty() {
            return Ok(());
        }
        let receipts = Bytes::from(std::mem::take(&mut self.receipts));
        match self.pipe.give(&receipts) {
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                self.receipts = receipts.to_vec();
                Ok(())
            }
            given => given,
        }
    }

    /// Reads until something has come that the service has to know, for one turn at the most.
    ///
    /// # Errors
    ///
    /// If the link has ended, or says what it must not.
    pub(super) fn proceed(&mut self) -> io::Result<Came> {
        self.settle()?;
        let mut turn = 0;
        while turn < TURN {
            let read = match &mut self.part {
                Part::Item(bytes) => read_item(&self.pipe, bytes),
                Part::Asks(label) => return Ok(Came::Label(label.clone())),
                Part::Bytes { of, left } => {
                    let into = self.open.get(of).and_then(|open| open.into.as_ref());
                    read_bytes(&self.pipe, *left, into)
                }
                Part::Packed { piece, left, .. } => read_more(&self.pipe, piece, *left),
            };
            match read {
                Ok(count) => {
                    turn += count;
                    if let Some(came) = self.came(count)? {
                        return Ok(came);
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) => return Err(error),
            }
        }
        Ok(Came::Nothing)
    }

    /// So many bytes have come.
    fn came(&mut self, count: usize) -> io::Result<Option<Came>> {
        match &mut self.part {
            Part::Item(bytes) if missing(bytes) == Some(0) => {
                let body = bytes.split_off(LENGTH);
                bytes.clear();
                if self.machine.is_none() {
                    self.greeted(&body)?;
                    return Ok(None);
                }
                self.item(decode(&body).ok_or_else(nonsense)?)
            }
            Part::Item(_) | Part::Asks(_) => Ok(None),
            Part::Bytes { of, left } => {
                let of = *of;
                *left -= count;
                if *left == 0 {
                    self.part = Part::Item(Vec::new());
                }
                Ok(self.filled(of, count))
            }
            Part::Packed { of, piece, left, len } => {
                *left -= count;
                if *left > 0 {
                    return Ok(None);
                }
                let (of, len) = (*of, *len);
                if let Some(into) = self.open.get(&of).and_then(|open| open.into.as_ref()) {
                    into.unpack(piece, len)?;
                }
                self.part = Part::Item(Vec::new());
                Ok(self.filled(of, len))
            }
        }
    }

    /// So many bytes of a shipment are there. If it is complete, returns it.
    fn filled(&mut self, of: Key, count: usize) -> Option<Came> {
        let open = self.open.get_mut(&of)?;
        open.filled += count as u64;
        if open.filled < open.label.bytes() {
            return None;
        }
        let Open { label, into, .. } = self.open.remove(&of)?;
        Some(Came::Shipment(label, into))
    }

    fn item(&mut self, item: Item) -> io::Result<Option<Came>> {
        match item {
            Item::Leads { machine, is_there: true } => {
                self.reached.insert(machine);
                Ok(None)
            }
            Item::Leads { machine, is_there: false } => {
                self.reached.remove(&machine);
                Ok(Some(Came::Gone(machine)))
            }
            Item::Shipment(label) if label.bytes() == 0 => Ok(Some(Came::Shipment(label, None))),
            Item::Shipment(label) => {
                if self.open.len() >= OPEN || self.open.contains_key(&label.shipment.key()) {
                    return Err(nonsense());
                }
                self.part = Part::Asks(label.clone());
                Ok(Some(Came::Label(label)))
            }
            Item::Piece { of, len, packed } => {
                self.part = self.piece(of, len, packed).ok_or_else(nonsense)?;
                Ok(None)
            }
            Item::Broken { of } => {
                // What has begun elsewhere with its bytes is broken, too.
                let open = self.open.remove(&of).ok_or_else(nonsense)?;
                open.into.iter().for_each(Content::break_off);
                Ok(None)
            }
        }
    }

    /// A piece follows; none if it cannot be one.
    fn piece(&self, of: Key, len: u32, packed: Option<u32>) -> Option<Part> {
        let open = self.open.get(&of)?;
        let fits = len > 0 && u64::from(len) <= open.label.bytes() - open.filled;
        let len = usize::try_from(len).ok().filter(|_| fits)?;
        Some(match packed {
            None => Part::Bytes { of, left: len },
            Some(left) => {
                let left = usize::try_from(left).ok().filter(|left| *left > 0 && *left < len)?;
                let piece = Vec::new();
                (len <= BLOCK).then_some(Part::Packed { of, piece, left, len })?
            }
        })
    }

    /// What a service says first.
    fn greeted(&mut self, body: &[u8]) -> io::Result<()> {
        let hello: Hello = decode(body).ok_or_else(nonsense)?;
        if hello.version != VERSION {
            let text = "the other agent has another version of shipments";
            return Err(io::Error::new(io::ErrorKind::InvalidData, text));
        }
        self.reached.extend(hello.leads);
        self.reached.insert(hello.machine.clone());
        self.machine = Some(hello.machine);
        Ok(())
    }
}

/// How many bytes of a length or of what follows it are missing; none if it is too long.
fn missing(bytes: &[u8]) -> Option<usize> {
    let Some((len, rest)) = bytes.split_first_chunk::<LENGTH>() else {
        return Some(LENGTH - bytes.len());
    };
    let len = usize::try_from(u32::from_le_bytes(*len)).ok().filter(|len| *len <= LABEL_LIMIT)?;
    len.checked_sub(rest.len())
}

/// Reads no more than belongs to an item: the bytes after it go elsewhere.
fn read_item(pipe: &Pipe, bytes: &mut Vec<u8>) -> io::Result<usize> {
    let missing = missing(bytes).ok_or_else(nonsense)?;
    read_more(pipe, bytes, missing)
}

/// Reads no more than so many bytes behind others.
fn read_more(pipe: &Pipe, bytes: &mut Vec<u8>, missing: usize) -> io::Result<usize> {
    let piece = some(pipe.take(missing))?;
    bytes.extend_from_slice(&piece);
    Ok(piece.len())
}

fn read_bytes(mut pipe: &Pipe, left: usize, into: Option<&Content>) -> io::Result<usize> {
    match into {
        Some(content) => match content.read_from(&mut pipe, left)? {
            0 => Err(io::ErrorKind::ConnectionReset.into()),
            count => Ok(count),
        },
        None => some(pipe.take(left)).map(|piece| piece.len()),
    }
}

/// Nothing more will come if nothing has.
fn some(taken: io::Result<Option<Bytes>>) -> io::Result<Bytes> {
    taken?.ok_or_else(|| io::ErrorKind::ConnectionReset.into())
}

fn nonsense() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "this is no shipment")
}
