//! What comes from the shipping service of one machine, over one link.
//!
//! A label says what follows; the service gives memory for it, into which the link is read. The bytes of a shipment for
//! which there is no memory, or no reader, are read and forgotten.

use std::collections::BTreeSet;
use std::io::{self, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;

use hprm_core::Shipment;
use hprm_store::WritableLoan;

use super::blocks::{self, BLOCK};
use super::label::{Hello, Item, LABEL_LIMIT, LENGTH, Label, VERSION, receipt};
use crate::records::decode;

/// How many bytes are read before others have their turn.
const TURN: usize = 1 << 20;

/// How many bytes are read at once of what is forgotten.
const FORGOTTEN: usize = 64 << 10;

/// See the module.
#[derive(Debug)]
pub(super) struct Incoming {
    stream: UnixStream,
    /// The other machine, once it has said so.
    machine: Option<String>,
    /// The machines of which shipments come over this link, as long as they reach the other one; that one, too.
    reached: BTreeSet<String>,
    part: Part,
    /// Receipts that have not left.
    receipts: Vec<u8>,
}

/// What is being read.
#[derive(Debug)]
enum Part {
    /// A length, and as many bytes.
    Label(Vec<u8>),
    /// A label has come, and the service has not said where the bytes go.
    Asks(Label),
    Bytes {
        label: Label,
        into: Option<WritableLoan>,
        filled: u64,
    },
    /// The same, in blocks, of which one has come in part.
    Blocks {
        label: Label,
        into: Option<WritableLoan>,
        filled: u64,
        block: Vec<u8>,
    },
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
    Shipment(Label, Option<WritableLoan>),
}

impl Incoming {
    pub(super) fn new(stream: UnixStream) -> Self {
        let part = Part::Label(Vec::new());
        let (machine, reached) = (None, BTreeSet::new());
        Self { stream, machine, reached, part, receipts: Vec::new() }
    }

    /// The machine at the other end, as far as it is known.
    pub(super) fn machine(&self) -> Option<&str> {
        self.machine.as_deref()
    }

    /// Whether shipments of a machine come over this link.
    pub(super) fn reaches(&self, machine: &str) -> bool {
        self.reached.contains(machine)
    }

    /// The machines of which shipments came over this link, which is at its end.
    pub(super) fn into_reached(self) -> BTreeSet<String> {
        self.reached
    }

    /// What to wait for: the link, and whether it is to be written.
    pub(super) fn interest(&self) -> (BorrowedFd<'_>, bool) {
        (self.stream.as_fd(), !self.receipts.is_empty())
    }

    /// The bytes of the label that has come last go there.
    pub(super) fn read_into(&mut self, label: Label, into: Option<WritableLoan>) {
        self.part = match label.compress {
            true => Part::Blocks { label, into, filled: 0, block: Vec::new() },
            false => Part::Bytes { label, into, filled: 0 },
        };
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

    /// Writes receipts, as far as there is room.
    fn settle(&mut self) -> io::Result<()> {
        while !self.receipts.is_empty() {
            match self.stream.write(&self.receipts) {
                Ok(count) => drop(self.receipts.drain(..count)),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
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
                Part::Label(bytes) => read_label(&mut self.stream, bytes),
                Part::Asks(label) => return Ok(Came::Label(label.clone())),
                Part::Bytes { label, into, filled } => {
                    let left = label.bytes() - *filled;
                    read_bytes(&mut self.stream, left, into.as_mut())
                }
                Part::Blocks { block, .. } => {
                    let missing = blocks::missing(block).ok_or_else(nonsense)?;
                    read_more(&mut self.stream, block, missing)
                }
            };
            match read {
                Ok(count) => {
                    turn += count;
                    if let Some(came) = self.came(count)? {
                        return Ok(came);
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(Came::Nothing)
    }

    /// So many bytes have come.
    fn came(&mut self, count: usize) -> io::Result<Option<Came>> {
        match &mut self.part {
            Part::Label(bytes) if missing(bytes) == Some(0) => {
                let body = bytes.split_off(LENGTH);
                bytes.clear();
                if self.machine.is_none() {
                    self.greeted(&body)?;
                    return Ok(None);
                }
                self.item(decode(&body).ok_or_else(nonsense)?)
            }
            Part::Label(_) | Part::Asks(_) => Ok(None),
            Part::Bytes { label, filled, .. } => {
                *filled += count as u64;
                Ok((*filled == label.bytes()).then(|| self.complete()))
            }
            Part::Blocks { label, into, filled, block } => {
                if blocks::missing(block) != Some(0) {
                    return Ok(None);
                }
                let left = usize::try_from(label.bytes() - *filled).unwrap_or(usize::MAX);
                let len = left.min(BLOCK);
                if let Some(loan) = into {
                    let at = loan.len() - left;
                    blocks::unpack(block, &mut loan[at..at + len])?;
                }
                *filled += len as u64;
                block.clear();
                Ok((*filled == label.bytes()).then(|| self.complete()))
            }
        }
    }

    /// All bytes of a shipment have come.
    fn complete(&mut self) -> Came {
        match std::mem::replace(&mut self.part, Part::Label(Vec::new())) {
            Part::Bytes { label, into, .. } | Part::Blocks { label, into, .. } => {
                Came::Shipment(label, into)
            }
            Part::Label(_) | Part::Asks(_) => unreachable!("bytes have come"),
        }
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
                self.part = Part::Asks(label.clone());
                Ok(Some(Came::Label(label)))
            }
        }
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

/// Reads no more than belongs to a label: the bytes after it go elsewhere.
fn read_label(stream: &mut UnixStream, bytes: &mut Vec<u8>) -> io::Result<usize> {
    let missing = missing(bytes).ok_or_else(nonsense)?;
    read_more(stream, bytes, missing)
}

/// Reads no more than so many bytes behind others.
fn read_more(stream: &mut UnixStream, bytes: &mut Vec<u8>, missing: usize) -> io::Result<usize> {
    let before = bytes.len();
    bytes.resize(before + missing, 0);
    let read = stream.read(&mut bytes[before..]);
    bytes.truncate(before + read.as_ref().map_or(0, |count| *count));
    some(read)
}

fn read_bytes(
    stream: &mut UnixStream,
    left: u64,
    into: Option<&mut WritableLoan>,
) -> io::Result<usize> {
    let rest = usize::try_from(left).unwrap_or(usize::MAX);
    match into {
        Some(loan) => {
            let at = loan.len() - rest;
            some(stream.read(&mut loan[at..]))
        }
        None => {
            let mut forgotten = [0; FORGOTTEN];
            some(stream.read(&mut forgotten[..rest.min(FORGOTTEN)]))
        }
    }
}

/// Nothing more will come if nothing has.
fn some(read: io::Result<usize>) -> io::Result<usize> {
    match read {
        Ok(0) => Err(io::ErrorKind::ConnectionReset.into()),
        read => read,
    }
}

fn nonsense() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "this is no shipment")
}
