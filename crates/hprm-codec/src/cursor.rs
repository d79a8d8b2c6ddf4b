//! Reading the primitives of a head: numbers, counts, blobs, and what describes an array.
//!
//! The bytes may be anything. No length is believed before the bytes are there.

use smallvec::SmallVec;

use crate::format::{self, Malformed, NodeKind, Order};

/// What has not been read of a head.
#[derive(Clone, Copy, Debug)]
pub struct Cursor<'a>(&'a [u8]);

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
        Self(bytes)
    }

    /// What has not been read.
    #[inline]
    #[must_use]
    pub fn rest(&self) -> &'a [u8] {
        self.0
    }

    /// The kind of the node that begins here, which stays unread.
    ///
    /// # Errors
    ///
    /// If there is none, or if the byte is of no kind.
    #[inline]
    pub fn peek(&self) -> Result<NodeKind, Malformed> {
        let byte = *self.0.first().ok_or(Malformed("it ends too early"))?;
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
        self.0 = &self.0[1..];
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
        if let [byte @ 0..0x80, rest @ ..] = self.0 {
            self.0 = rest;
            return Ok((*byte).into());
        }
        let (number, len) = format::number(self.0).ok_or(Malformed("it ends within a number"))?;
        self.0 = &self.0[len..];
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
            Ok(count) if count <= self.0.len() => Ok(count),
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
        let (taken, rest) = self.0.split_first_chunk().ok_or(Malformed("it ends too early"))?;
        self.0 = rest;
        Ok(*taken)
    }

    /// So many bytes.
    ///
    /// # Errors
    ///
    /// If there are fewer.
    #[inline]
    pub fn bytes(&mut self, len: usize) -> Result<&'a [u8], Malformed> {
        let (taken, rest) = self.0.split_at_checked(len).ok_or(Malformed("it ends too early"))?;
        self.0 = rest;
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
