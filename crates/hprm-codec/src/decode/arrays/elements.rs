//! The elements of an array, one by one: as rows within rows, or in a row beside the shape.

use serde::de::value::{BorrowedStrDeserializer, SeqAccessDeserializer};
use serde::de::{DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::forward_to_deserialize_any;

use super::super::members::Numbers;
use super::{Elements, MISSHAPEN};
use crate::element::Dtype;
use crate::error::DecodeError;
use crate::place;

/// A part of an array: an element, a row, rows of rows.
#[derive(Clone, Copy)]
pub(super) struct Cell<'x> {
    array: &'x Elements<'x>,
    /// How many bytes further on the next element of each dimension is.
    steps: &'x [usize],
    /// How many dimensions this is inside of.
    level: usize,
    /// Where in the bytes it begins.
    at: usize,
}

impl<'x> Cell<'x> {
    pub(super) fn whole(array: &'x Elements<'x>, steps: &'x [usize]) -> Self {
        Self { array, steps, level: 0, at: 0 }
    }

    pub(super) fn visit<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, DecodeError> {
        let Some(len) = self.array.shape.get(self.level) else {
            return self.visit_element(visitor);
        };
        let mut row = Row { cell: self, len: *len, at: 0 };
        let value = visitor.visit_seq(&mut row)?;
        if row.at == row.len {
            return Ok(value);
        }
        let (at, len) = (row.at, row.len);
        Err(DecodeError::new(format!("expected {at} elements, found an array of {len} elements")))
    }

    fn element<const N: usize>(&self) -> Result<[u8; N], DecodeError> {
        let bytes = self.array.bytes.get(self.at..).and_then(<[u8]>::first_chunk);
        Ok(*bytes.ok_or(MISSHAPEN)?)
    }

    fn visit_element<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, DecodeError> {
        match self.array.dtype {
            Dtype::Bool => visitor.visit_bool(self.element::<1>()? != [0]),
            Dtype::I8 => visitor.visit_i64(i8::from_ne_bytes(self.element()?).into()),
            Dtype::I16 => visitor.visit_i64(i16::from_ne_bytes(self.element()?).into()),
            Dtype::I32 => visitor.visit_i64(i32::from_ne_bytes(self.element()?).into()),
            Dtype::I64 => visitor.visit_i64(i64::from_ne_bytes(self.element()?)),
            Dtype::U8 => visitor.visit_u64(u8::from_ne_bytes(self.element()?).into()),
            Dtype::U16 => visitor.visit_u64(u16::from_ne_bytes(self.element()?).into()),
            Dtype::U32 => visitor.visit_u64(u32::from_ne_bytes(self.element()?).into()),
            Dtype::U64 => visitor.visit_u64(u64::from_ne_bytes(self.element()?)),
            Dtype::F32 => visitor.visit_f64(f32::from_ne_bytes(self.element()?).into()),
            Dtype::F64 => visitor.visit_f64(f64::from_ne_bytes(self.element()?)),
            Dtype::C32 => {
                let parts = bytemuck::cast::<[u8; 8], [f32; 2]>(self.element()?);
                visitor.visit_seq(Numbers::new(parts.map(f64::from).into_iter()))
            }
            Dtype::C64 => {
                let parts = bytemuck::cast::<[u8; 16], [f64; 2]>(self.element()?);
                visitor.visit_seq(Numbers::new(parts.into_iter()))
            }
        }
    }
}

impl<'de> Deserializer<'de> for Cell<'_> {
    type Error = DecodeError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, DecodeError> {
        self.visit(visitor)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, DecodeError> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, DecodeError> {
        visitor.visit_newtype_struct(self)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map struct enum identifier ignored_any
    }
}

/// What is in a row.
struct Row<'x> {
    cell: Cell<'x>,
    len: usize,
    at: usize,
}

impl<'de> SeqAccess<'de> for &mut Row<'_> {
    type Error = DecodeError;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, DecodeError> {
        if self.at == self.len {
            return Ok(None);
        }
        let at = self.at;
        self.at += 1;
        let Cell { level, at: start, steps, .. } = self.cell;
        let inner = Cell { level: level + 1, at: start + at * steps[level], ..self.cell };
        seed.deserialize(inner).map(Some).map_err(|error| error.within(|| place::index(at)))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.len - self.at)
    }
}

/// An array as what [`Array`](crate::Array) is for other formats: its shape, and its elements in the order of C.
pub(super) struct Flat<'x> {
    array: &'x Elements<'x>,
    steps: &'x [usize],
    /// How many of the two have been read.
    read: usize,
}

impl<'x> Flat<'x> {
    pub(super) fn new(array: &'x Elements<'x>, steps: &'x [usize]) -> Self {
        Self { array, steps, read: 0 }
    }
}

impl<'de> MapAccess<'de> for Flat<'_> {
    type Error = DecodeError;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, DecodeError> {
        let Some(name) = ["shape", "data"].get(self.read) else { return Ok(None) };
        self.read += 1;
        seed.deserialize(BorrowedStrDeserializer::new(name)).map(Some)
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<T::Value, DecodeError> {
        if self.read == 1 {
            let lengths = self.array.shape.iter().map(|length| *length as u64);
            return seed.deserialize(SeqAccessDeserializer::new(Numbers::new(lengths)));
        }
        let size = self.array.dtype.size();
        let cells = FlatCells { flat: self, count: self.array.bytes.len() / size, at: 0 };
        seed.deserialize(SeqAccessDeserializer::new(cells))
    }
}

/// The elements in the order of C.
struct FlatCells<'f, 'x> {
    flat: &'f Flat<'x>,
    count: usize,
    at: usize,
}

impl FlatCells<'_, '_> {
    /// Where an element begins.
    fn start(&self, mut element: usize) -> usize {
        let mut start = 0;
        for (length, step) in self.flat.array.shape.iter().zip(self.flat.steps).rev() {
            start += element % length * step;
            element /= length;
        }
        start
    }
}

impl<'de> SeqAccess<'de> for FlatCells<'_, '_> {
    type Error = DecodeError;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, DecodeError> {
        if self.at == self.count {
            return Ok(None);
        }
        let (array, steps) = (self.flat.array, self.flat.steps);
        let cell = Cell { array, steps, level: array.shape.len(), at: self.start(self.at) };
        self.at += 1;
        seed.deserialize(cell).map(Some)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.count - self.at)
    }
}
