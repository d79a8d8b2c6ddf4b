//! What containers hold: members of lists, entries of dicts, numbers of arrays.

use serde::de::value::BorrowedStrDeserializer;
use serde::de::{DeserializeSeed, IntoDeserializer, MapAccess, SeqAccess};

use super::Walk;
use crate::cursor::Cursor;
use crate::error::DecodeError;
use crate::format::Malformed;
use crate::place;

/// The members of a list, a tuple or a set.
pub(super) struct Items<'w, 'a> {
    walk: &'w mut Walk<'a>,
    count: usize,
    at: usize,
}

impl<'w, 'a> Items<'w, 'a> {
    pub(super) fn new(walk: &'w mut Walk<'a>, count: usize) -> Self {
        Self { walk, count, at: 0 }
    }

    /// All of them have been read.
    pub(super) fn finish(&self, name: &str) -> Result<(), DecodeError> {
        if self.at == self.count {
            return Ok(());
        }
        let (at, count) = (self.at, self.count);
        Err(DecodeError::new(format!("expected {at} members, found {name} of {count} members")))
    }
}

impl<'a> SeqAccess<'a> for &mut Items<'_, 'a> {
    type Error = DecodeError;

    fn next_element_seed<T: DeserializeSeed<'a>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, DecodeError> {
        if self.at == self.count {
            return Ok(None);
        }
        let at = self.at;
        self.at += 1;
        let member = seed.deserialize(&mut *self.walk);
        member.map(Some).map_err(|error| error.within(|| place::index(at)))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.count - self.at)
    }
}

/// The entries of a dict.
pub(super) struct Pairs<'w, 'a> {
    walk: &'w mut Walk<'a>,
    left: usize,
    /// Where the last key began.
    key: Cursor<'a>,
}

impl<'w, 'a> Pairs<'w, 'a> {
    pub(super) fn new(walk: &'w mut Walk<'a>) -> Result<Self, DecodeError> {
        let left = walk.head.count()?;
        let key = walk.head;
        Ok(Self { walk, left, key })
    }

    pub(super) fn finish(&self) -> Result<(), DecodeError> {
        if self.left == 0 {
            return Ok(());
        }
        Err(DecodeError::new(format!("the dict has {} entries too many", self.left)))
    }
}

impl<'a> MapAccess<'a> for &mut Pairs<'_, 'a> {
    type Error = DecodeError;

    #[inline(always)]
    fn next_key_seed<K: DeserializeSeed<'a>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, DecodeError> {
        if self.left == 0 {
            return Ok(None);
        }
        self.left -= 1;
        self.key = self.walk.head;
        let key = seed.deserialize(&mut *self.walk);
        key.map(Some).map_err(|error| error.within(|| place::key(self.key)))
    }

    #[inline(always)]
    fn next_value_seed<T: DeserializeSeed<'a>>(
        &mut self,
        seed: T,
    ) -> Result<T::Value, DecodeError> {
        let value = seed.deserialize(&mut *self.walk);
        value.map_err(|error| error.within(|| place::item(self.key)))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.left)
    }
}

/// The attributes of an object.
pub(super) struct Fields<'w, 'a> {
    walk: &'w mut Walk<'a>,
    names: &'w [&'a str],
    at: usize,
}

impl<'w, 'a> Fields<'w, 'a> {
    pub(super) fn new(walk: &'w mut Walk<'a>, names: &'w [&'a str]) -> Self {
        Self { walk, names, at: 0 }
    }

    pub(super) fn finish(&self) -> Result<(), DecodeError> {
        if self.at == self.names.len() {
            return Ok(());
        }
        Err(DecodeError::new(format!("the receiver has no use for `.{}`", self.names[self.at])))
    }
}

impl<'a> MapAccess<'a> for &mut Fields<'_, 'a> {
    type Error = DecodeError;

    fn next_key_seed<K: DeserializeSeed<'a>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, DecodeError> {
        let Some(name) = self.names.get(self.at) else { return Ok(None) };
        seed.deserialize(BorrowedStrDeserializer::new(name)).map(Some)
    }

    fn next_value_seed<T: DeserializeSeed<'a>>(
        &mut self,
        seed: T,
    ) -> Result<T::Value, DecodeError> {
        let name = self.names.get(self.at).ok_or(Malformed("a value without a name"))?;
        self.at += 1;
        let value = seed.deserialize(&mut *self.walk);
        value.map_err(|error| error.within(|| format!(".{name}")))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.names.len() - self.at)
    }
}

/// Numbers that are in a row, as those of bytes.
pub(super) struct Numbers<I> {
    numbers: I,
    at: usize,
}

impl<I> Numbers<I> {
    pub(super) fn new(numbers: I) -> Self {
        Self { numbers, at: 0 }
    }
}

impl<'a, I> SeqAccess<'a> for Numbers<I>
where
    I: ExactSizeIterator,
    I::Item: IntoDeserializer<'a, DecodeError>,
{
    type Error = DecodeError;

    fn next_element_seed<T: DeserializeSeed<'a>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, DecodeError> {
        let Some(number) = self.numbers.next() else { return Ok(None) };
        let at = self.at;
        self.at += 1;
        let member = seed.deserialize(number.into_deserializer());
        member.map(Some).map_err(|error| error.within(|| place::index(at)))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.numbers.len())
    }
}
