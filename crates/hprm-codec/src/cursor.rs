//! Reading the primitives of a head: numbers, counts, blobs, and what describes an array.
//!
//! The bytes may be anything. No length is believed before the bytes are there.

use smallvec::SmallVec;

use crate::format::{self, Malformed, NodeKind, Order};

/// What has not been read of a head.
///
/// Only one word of it changes as it goes on. A slice would be two, and the processor would wait for both to be written
/// whenever it is copied.
#[derive(Clone, Copy, Debug)]
pub struct Cursor<'a> {
    bytes: &'a [u8],
    /// Where the first byte is that has not been read: within the bytes, or at their end.
    at: usize,
}

/// Where the bytes of a blob are.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Blob<'a> {
    /// In the head.
    Inline(&'a [u8]),
    /// They are the next part of the payload, and this is their length.
    Part(usize),
}

/// What describes the bytes of an array.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ArrayHeader<'a> {
    /// The dtype: a byte that says how it is described, and the description.
    pub description: &'a [u8],
    /// Which index varies fastest.
    pub order: Order,
    /// The length of each dimension.
    pub shape: SmallVec<[u64; 4]>,
}

impl<'a> Cursor<'a> {
    /// At the start of `bytes`.
    #[inline]
    #[must_use]
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// What has not been read.
    #[inline]
    #[must_use]
    pub fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// The kind of the node that begins here, which stays unread.
    ///
    /// # Errors
    ///
    /// If there is none, or if the byte is of no kind.
    #[inline]
    pub fn peek(&self) -> Result<NodeKind, Malformed> {
        let byte = *self.bytes.get(self.at).ok_or(Malformed("it ends too early"))?;
        NodeKind::of(byte).ok_or(Malformed("an unknown kind of value"))
    }

    /// The kind of the node that begins here.
    ///
    /// # Errors
    ///
    /// If there is none, or if the byte is of no kind.
    #[inline]
    pub fn kind(&mut self) -> Result<NodeKind, Malformed> {
        let kind = self.peek()?;
        self.at += 1;
        Ok(kind)
    }

    /// A number.
    ///
    /// # Errors
    ///
    /// If there is no whole one.
    #[inline]
    pub fn number(&mut self) -> Result<u64, Malformed> {
        // Most numbers are small.
        if let Some(byte @ 0..0x80) = self.bytes.get(self.at) {
            self.at += 1;
            return Ok((*byte).into());
        }
        let number = format::number(self.rest());
        let (number, len) = number.ok_or(Malformed("it ends within a number"))?;
        self.at += len;
        Ok(number)
    }

    /// How many entries follow. An entry has at least one byte, so there are no more of them than bytes.
    ///
    /// # Errors
    ///
    /// If there are fewer bytes.
    #[inline]
    pub fn count(&mut self) -> Result<usize, Malformed> {
        match usize::try_from(self.number()?) {
            Ok(count) if count <= self.bytes.len() - self.at => Ok(count),
            _ => Err(Malformed("more entries than bytes")),
        }
    }

    /// As many bytes as the array has.
    ///
    /// # Errors
    ///
    /// If there are fewer.
    #[inline]
    pub fn take<const N: usize>(&mut self) -> Result<[u8; N], Malformed> {
        let taken = self.rest().first_chunk().ok_or(Malformed("it ends too early"))?;
        self.at += N;
        Ok(*taken)
    }

    /// So many bytes.
    ///
    /// # Errors
    ///
    /// If there are fewer.
    #[inline]
    pub fn bytes(&mut self, len: usize) -> Result<&'a [u8], Malformed> {
        let taken = self.rest().get(..len).ok_or(Malformed("it ends too early"))?;
        self.at += len;
        Ok(taken)
    }

    /// A blob.
    ///
    /// # Errors
    ///
    /// If its bytes should be here and are not.
    #[inline]
    pub fn blob(&mut self) -> Result<Blob<'a>, Malformed> {
        let header = self.number()?;
        let len = usize::try_from(header >> 1).map_err(|_| Malformed("a buffer too long"))?;
        Ok(if header & 1 == 0 { Blob::Inline(self.bytes(len)?) } else { Blob::Part(len) })
    }

    /// The bytes of a blob that begins here, if it is short and they are here, as those of most texts: they are read at
    /// once.
    #[inline]
    pub(crate) fn short_blob(&mut self) -> Option<&'a [u8]> {
        let header = usize::from(*self.bytes.get(self.at)?);
        if header >= 0x80 || header % 2 != 0 {
            return None;
        }
        let start = self.at + 1;
        let end = start + header / 2;
        let blob = self.bytes.get(start..end)?;
        self.at = end;
        Some(blob)
    }

    /// What a node of an array has before its blob.
    ///
    /// # Errors
    ///
    /// If it is not all there.
    pub fn array_header(&mut self) -> Result<ArrayHeader<'a>, Malformed> {
        let len = self.count()?;
        let description = self.bytes(len)?;
        let order = match self.take()? {
            [0] => Order::C,
            [1] => Order::Fortran,
            _ => return Err(Malformed("an unknown order of an array")),
        };
        let mut shape = SmallVec::new();
        for _ in 0..self.count()? {
            shape.push(self.number()?);
        }
        Ok(ArrayHeader { description, order, shape })
    }
}
