//! Encodes a value: serde's data model as nodes of a head, and large buffers that are not copied yet.
//!
//! `encode/members.rs` writes what containers hold. Where the buffers go is decided by the caller.

mod members;

use std::sync::Arc;

use hprm_core::limits::INLINE_LIMIT;
use serde::Serialize;
use serde::ser::Serializer;

use self::members::Members;
use crate::element::Dtype;
use crate::error::EncodeError;
use crate::format::{self, DEPTH_LIMIT, Head, LAYER_LIMIT, NodeKind, Order, put_number};
use crate::memory::{Draft, Source};
use crate::slot::{self, ARRAY, Outgoing, Shape};

/// Encodes `value`. Large arrays are in the draft as handles of their memory, and not copied.
///
/// # Errors
///
/// If the value is nested too deeply, if its own `Serialize` refuses, or if the system has no memory.
pub fn encode<T: Serialize + ?Sized>(value: &T) -> Result<Draft, EncodeError> {
    let mut writer = Writer {
        head: Head::new(),
        parts: Vec::new(),
        depth: 0,
        layers: 0,
        numbered: 0,
        arrays: Vec::new(),
    };
    writer.head.push(format::DIRECT);
    value.serialize(&mut writer)?;
    writer.head.check()?;
    let (mut head, mut parts) = (writer.head.into_bytes(), writer.parts);
    if head.len() > INLINE_LIMIT {
        parts.push(Source::Bytes(head));
        head = vec![format::INDIRECT];
    }
    Ok(Draft { head, parts })
}

/// A value that is being encoded.
struct Writer {
    head: Head,
    parts: Vec<Source>,
    depth: u32,
    /// How many `Some` and newtypes, which leave no bytes, are around the value.
    layers: u32,
    /// How many values have begun to which the head may refer.
    numbered: u64,
    /// The large arrays so far.
    arrays: Vec<Seen>,
}

/// An array to which the head may refer.
struct Seen {
    number: u64,
    /// Which part it is.
    part: usize,
    dtype: Dtype,
    shape: Shape,
}

impl Writer {
    #[inline]
    fn kind(&mut self, kind: NodeKind) {
        self.head.push(kind as u8);
    }

    /// Begins the node of a value that has a number.
    #[inline]
    fn begin(&mut self, kind: NodeKind) {
        self.kind(kind);
        self.numbered += 1;
    }

    /// Begins the node of a container.
    #[inline]
    fn open(&mut self, kind: NodeKind) -> Result<(), EncodeError> {
        self.depth += 1;
        if self.depth > DEPTH_LIMIT {
            return Err(EncodeError::new(format!(
                "it is nested more than {DEPTH_LIMIT} deep (hint: send a tree as a list of its nodes)"
            )));
        }
        self.begin(kind);
        self.head.check()?;
        Ok(())
    }

    /// Writes what is in a `Some` or a newtype.
    #[inline]
    fn layer<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), EncodeError> {
        self.layers += 1;
        if self.layers > LAYER_LIMIT {
            return Err(EncodeError::new(format!(
                "more than {LAYER_LIMIT} options and newtypes are within one another (hint: send a chain as a list)"
            )));
        }
        value.serialize(&mut *self)?;
        self.layers -= 1;
        Ok(())
    }

    #[inline]
    fn integer(&mut self, number: i64) {
        format::put_integer(&mut self.head, number);
    }

    /// Writes an integer of so many bits, with as many bytes as Python takes. Its two's complement is `digits`, and then
    /// bytes that are `sign`.
    fn long(&mut self, digits: [u8; 16], sign: u8, bits: u32) {
        let mut complement = [sign; 17];
        complement[..16].copy_from_slice(&digits);
        self.kind(NodeKind::Long);
        self.inline(&complement[..bits as usize / 8 + 1]);
    }

    #[inline(always)]
    fn blob(&mut self, bytes: &[u8]) -> Result<(), EncodeError> {
        if bytes.len() > INLINE_LIMIT {
            let copy = hprm_core::copy_of(bytes)?;
            self.part(bytes.len(), Source::Bytes(copy));
        } else {
            self.inline(bytes);
        }
        Ok(())
    }

    #[inline]
    fn inline(&mut self, bytes: &[u8]) {
        put_number(&mut self.head, (bytes.len() as u64) << 1);
        self.head.extend_from_slice(bytes);
    }

    fn part(&mut self, len: usize, source: Source) {
        put_number(&mut self.head, (len as u64) << 1 | 1);
        self.parts.push(source);
    }

    #[inline(always)]
    fn text(&mut self, text: &str) -> Result<(), EncodeError> {
        self.kind(NodeKind::Str);
        self.blob(text.as_bytes())
    }

    fn array(&mut self, array: Outgoing) {
        if let Some(number) = self.number_of(&array) {
            self.kind(NodeKind::BackReference);
            put_number(&mut self.head, number);
            return;
        }
        let number = self.numbered;
        self.begin(NodeKind::Array);
        let Outgoing { dtype, shape, memory } = array;
        put_number(&mut self.head, dtype.name().len() as u64 + 1);
        self.head.push(format::SIMPLE);
        self.head.extend_from_slice(dtype.name().as_bytes());
        self.head.push(Order::C as u8);
        put_number(&mut self.head, shape.len() as u64);
        for length in &shape {
            put_number(&mut self.head, *length as u64);
        }
        let len = memory.bytes().len();
        if len > INLINE_LIMIT {
            self.arrays.push(Seen { number, part: self.parts.len(), dtype, shape });
            self.part(len, Source::Memory(memory));
        } else {
            self.inline(memory.bytes());
        }
    }

    /// The number of the same array, if it is a large one that has occurred before.
    fn number_of(&self, array: &Outgoing) -> Option<u64> {
        let is_same = |seen: &&Seen| match &self.parts[seen.part] {
            Source::Memory(memory) => {
                Arc::ptr_eq(memory, &array.memory)
                    && seen.dtype == array.dtype
                    && seen.shape == array.shape
            }
            Source::Bytes(_) => false,
        };
        self.arrays.iter().find(is_same).map(|seen| seen.number)
    }

    /// Begins an enumeration's variant with contents: a dict of one entry.
    fn variant(&mut self, variant: &'static str) -> Result<(), EncodeError> {
        self.open(NodeKind::Dict)?;
        put_number(&mut self.head, 1);
        self.text(variant)
    }
}

impl<'w> Serializer for &'w mut Writer {
    type Ok = ();
    type Error = EncodeError;
    type SerializeSeq = Members<'w>;
    type SerializeTuple = Members<'w>;
    type SerializeTupleStruct = Members<'w>;
    type SerializeTupleVariant = Members<'w>;
    type SerializeMap = Members<'w>;
    type SerializeStruct = Members<'w>;
    type SerializeStructVariant = Members<'w>;

    fn serialize_bool(self, value: bool) -> Result<(), EncodeError> {
        self.kind(if value { NodeKind::True } else { NodeKind::False });
        Ok(())
    }

    fn serialize_i8(self, value: i8) -> Result<(), EncodeError> {
        self.serialize_i64(value.into())
    }

    fn serialize_i16(self, value: i16) -> Result<(), EncodeError> {
        self.serialize_i64(value.into())
    }

    fn serialize_i32(self, value: i32) -> Result<(), EncodeError> {
        self.serialize_i64(value.into())
    }

    fn serialize_i64(self, value: i64) -> Result<(), EncodeError> {
        self.integer(value);
        Ok(())
    }

    fn serialize_i128(self, value: i128) -> Result<(), EncodeError> {
        if let Ok(value) = i64::try_from(value) {
            return self.serialize_i64(value);
        }
        let sign = if value < 0 { 0xff } else { 0 };
        self.long(value.to_le_bytes(), sign, 128 - value.unsigned_abs().leading_zeros());
        Ok(())
    }

    fn serialize_u8(self, value: u8) -> Result<(), EncodeError> {
        self.serialize_i64(value.into())
    }

    fn serialize_u16(self, value: u16) -> Result<(), EncodeError> {
        self.serialize_i64(value.into())
    }

    fn serialize_u32(self, value: u32) -> Result<(), EncodeError> {
        self.serialize_i64(value.into())
    }

    fn serialize_u64(self, value: u64) -> Result<(), EncodeError> {
        match i64::try_from(value) {
            Ok(value) => self.serialize_i64(value),
            Err(_) => self.serialize_u128(value.into()),
        }
    }

    fn serialize_u128(self, value: u128) -> Result<(), EncodeError> {
        if let Ok(value) = i64::try_from(value) {
            return self.serialize_i64(value);
        }
        self.long(value.to_le_bytes(), 0, 128 - value.leading_zeros());
        Ok(())
    }

    fn serialize_f32(self, value: f32) -> Result<(), EncodeError> {
        self.serialize_f64(value.into())
    }

    fn serialize_f64(self, value: f64) -> Result<(), EncodeError> {
        let mut node = [NodeKind::Float as u8; 9];
        node[1..].copy_from_slice(&value.to_le_bytes());
        self.head.extend_from_slice(&node);
        Ok(())
    }

    fn serialize_char(self, value: char) -> Result<(), EncodeError> {
        self.text(value.encode_utf8(&mut [0; 4]))
    }

    fn serialize_str(self, value: &str) -> Result<(), EncodeError> {
        self.text(value)
    }

    fn serialize_bytes(self, value: &[u8]) -> Result<(), EncodeError> {
        self.begin(NodeKind::Bytes);
        self.blob(value)
    }

    fn serialize_none(self) -> Result<(), EncodeError> {
        self.serialize_unit()
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Result<(), EncodeError> {
        self.layer(value)
    }

    fn serialize_unit(self) -> Result<(), EncodeError> {
        self.kind(NodeKind::None);
        Ok(())
    }

    fn serialize_unit_struct(self, _: &'static str) -> Result<(), EncodeError> {
        self.serialize_unit()
    }

    fn serialize_unit_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
    ) -> Result<(), EncodeError> {
        self.text(variant)
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(
        self,
        name: &'static str,
        value: &T,
    ) -> Result<(), EncodeError> {
        if name == ARRAY
            && let Some(array) = slot::accept()
        {
            self.array(array);
            return Ok(());
        }
        self.layer(value)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        value: &T,
    ) -> Result<(), EncodeError> {
        self.variant(variant)?;
        value.serialize(&mut *self).map_err(|error| error.within(|| format!("['{variant}']")))?;
        self.depth -= 1;
        Ok(())
    }

    fn serialize_seq(self, len: Option<usize>) -> Result<Members<'w>, EncodeError> {
        Members::begin(self, NodeKind::List, len)
    }

    fn serialize_tuple(self, len: usize) -> Result<Members<'w>, EncodeError> {
        Members::begin(self, NodeKind::Tuple, Some(len))
    }

    fn serialize_tuple_struct(
        self,
        _: &'static str,
        len: usize,
    ) -> Result<Members<'w>, EncodeError> {
        Members::begin(self, NodeKind::Tuple, Some(len))
    }

    fn serialize_tuple_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        len: usize,
    ) -> Result<Members<'w>, EncodeError> {
        self.variant(variant)?;
        Members::begin(self, NodeKind::Tuple, Some(len)).map(|members| members.of_variant(variant))
    }

    fn serialize_map(self, len: Option<usize>) -> Result<Members<'w>, EncodeError> {
        Members::begin(self, NodeKind::Dict, len)
    }

    fn serialize_struct(self, _: &'static str, len: usize) -> Result<Members<'w>, EncodeError> {
        Members::begin(self, NodeKind::Dict, Some(len))
    }

    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        len: usize,
    ) -> Result<Members<'w>, EncodeError> {
        self.variant(variant)?;
        Members::begin(self, NodeKind::Dict, Some(len)).map(|members| members.of_variant(variant))
    }
}
