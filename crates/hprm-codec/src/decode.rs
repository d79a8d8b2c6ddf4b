//! Decodes a value: nodes of a head, and the parts beside it, as serde's data model.
//!
//! The bytes may be anything: whatever is wrong with them becomes an error, no length is believed before the bytes are
//! there, and what is repeated by reference is bounded. `decode/nodes.rs` says which node serves where which type is
//! expected, `members.rs` reads containers, `objects.rs` what Python's classes were made of, `outline.rs` what of them only Python reads, `variants.rs`
//! enumerations, `arrays.rs` arrays and `skip.rs` what the receiver has no use for.

mod arrays;
mod members;
mod nodes;
mod objects;
mod outline;
mod skip;
mod variants;

use std::marker::PhantomData;
use std::sync::Arc;

use serde::de::{DeserializeOwned, DeserializeSeed, Deserializer, Visitor};
use smallvec::SmallVec;

use self::nodes::Want;
use crate::cursor::{Blob, Cursor};
use crate::dynamic::Dynamic;
use crate::error::DecodeError;
use crate::format::{self, DEPTH_LIMIT, LAYER_LIMIT, Malformed, NodeKind};
use crate::memory::Memory;
use crate::pickle::Pickle;
use crate::slot::{ARRAY, DYNAMIC};

/// How many bytes of a value may be read again by reference, however small it is.
const REPEATED: usize = 1 << 20;
/// And how many times the length of all that has come.
const REPEATED_TIMES: usize = 16;

/// Decodes a value from the head of a payload and its parts. Large arrays are not copied: they keep the part in which
/// they are.
///
/// # Errors
///
/// If the bytes are no value, or one of another type.
pub fn decode<T: DeserializeOwned>(
    head: &[u8],
    parts: &[Arc<dyn Memory>],
) -> Result<T, DecodeError> {
    whole(PhantomData::<T>, head, parts, false)
}

/// Decodes a value as `seed` does it, for whatever hands on parts of values: the value may borrow from the head.
///
/// # Errors
///
/// If the bytes are no value, or one of another type.
pub fn decode_seed<'a, S: DeserializeSeed<'a>>(
    seed: S,
    head: &'a [u8],
    parts: &'a [Arc<dyn Memory>],
) -> Result<S::Value, DecodeError> {
    whole(seed, head, parts, false)
}

/// Decodes a value to look at, of whatever type it is. An object that only Python reads becomes a dict of one entry: what
/// it is, and a list of its parts. An array whose elements Rust does not have becomes a text that says so.
///
/// # Errors
///
/// If the bytes are no value, or one that contains itself, or a pickle.
pub fn outline(head: &[u8], parts: &[Arc<dyn Memory>]) -> Result<Dynamic, DecodeError> {
    whole(PhantomData::<Dynamic>, head, parts, true)
}

fn whole<'a, S: DeserializeSeed<'a>>(
    seed: S,
    head: &'a [u8],
    parts: &'a [Arc<dyn Memory>],
    is_outline: bool,
) -> Result<S::Value, DecodeError> {
    let (node, parts_of_node) = format::root(head, parts, |part| part.bytes())?;
    if node.peek()? == NodeKind::Pickle {
        return Err(DecodeError::pickle(Pickle::of(head, parts)));
    }
    let parts = parts_of_node;
    let mut walk = Walk::new(node, parts);
    walk.is_outline = is_outline;
    let value = seed.deserialize(&mut walk)?;
    if walk.head.rest().is_empty() && walk.part == parts.len() {
        Ok(value)
    } else {
        Err(Malformed("bytes after its end").into())
    }
}

/// A value that is being decoded.
struct Walk<'a> {
    /// What has not been read.
    head: Cursor<'a>,
    parts: &'a [Arc<dyn Memory>],
    /// Which part is the next one.
    part: usize,
    /// The values to which the head may refer.
    seen: SmallVec<[Seen<'a>; 8]>,
    depth: u32,
    /// How many options and newtypes, of which there is nothing in the bytes, are around the value.
    layers: u32,
    /// Whether this is a value that has been read before.
    repeating: bool,
    /// How much more may be read again; none if nothing has been read again yet.
    repeatable: Option<usize>,
    /// Whether what Rust does not read is outlined.
    is_outline: bool,
}

/// A value to which the head may refer: where it begins.
struct Seen<'a> {
    head: Cursor<'a>,
    part: usize,
    /// Whether it is being read just now.
    is_open: bool,
}

/// Bytes, and the part in which they are, if they are not in the head.
type Placed<'a> = (&'a [u8], Option<&'a Arc<dyn Memory>>);

/// The number of a value that is being read; none if it has been read before.
type Number = Option<usize>;

impl<'a> Walk<'a> {
    #[inline]
    fn new(head: Cursor<'a>, parts: &'a [Arc<dyn Memory>]) -> Self {
        let seen = SmallVec::new();
        Self {
            head,
            parts,
            part: 0,
            seen,
            depth: 0,
            layers: 0,
            repeating: false,
            repeatable: None,
            is_outline: false,
        }
    }

    /// Numbers a value that begins at `start` and has no members.
    #[inline]
    fn number(&mut self, start: Cursor<'a>) {
        if !self.repeating {
            self.seen.push(Seen { head: start, part: self.part, is_open: false });
        }
    }

    /// Numbers a value that begins at `start`, and reads it.
    fn enter<R>(
        &mut self,
        start: Cursor<'a>,
        read: impl FnOnce(&mut Self) -> Result<R, DecodeError>,
    ) -> Result<R, DecodeError> {
        let number = self.open(start)?;
        let value = read(self)?;
        self.close(number);
        Ok(value)
    }

    #[inline]
    fn open(&mut self, start: Cursor<'a>) -> Result<Number, DecodeError> {
        self.depth += 1;
        if self.depth > DEPTH_LIMIT {
            return Err(Malformed("values nested too deeply").into());
        }
        if self.repeating {
            return Ok(None);
        }
        self.seen.push(Seen { head: start, part: self.part, is_open: true });
        Ok(Some(self.seen.len() - 1))
    }

    #[inline]
    fn close(&mut self, number: Number) {
        self.depth -= 1;
        if let Some(number) = number {
            self.seen[number].is_open = false;
        }
    }

    /// Reads what is in an option or a newtype. A type may contain itself in this way, without end.
    #[inline]
    fn layer<R>(
        &mut self,
        read: impl FnOnce(&mut Self) -> Result<R, DecodeError>,
    ) -> Result<R, DecodeError> {
        self.layers += 1;
        if self.layers > LAYER_LIMIT {
            return Err(DecodeError::new(format!(
                "the receiver's type has more than {LAYER_LIMIT} options and newtypes within one another here"
            )));
        }
        let value = read(self)?;
        self.layers -= 1;
        Ok(value)
    }

    /// Reads the value again whose number comes in the head.
    fn repeat<R>(
        &mut self,
        read: impl FnOnce(&mut Self) -> Result<R, DecodeError>,
    ) -> Result<R, DecodeError> {
        let number = usize::try_from(self.head.number()?).unwrap_or(usize::MAX);
        let seen = self.seen.get_mut(number).ok_or(Malformed("a reference to nothing"))?;
        if seen.is_open {
            return Err(DecodeError::new(
                "the value contains itself, which only Python can receive (hint: send a tree, or a list of nodes \
                 that refer to one another by index)",
            ));
        }
        seen.is_open = true;
        let resume = (self.head, self.part, self.repeating);
        (self.head, self.part, self.repeating) = (seen.head, seen.part, true);
        let value = read(self)?;
        (self.head, self.part, self.repeating) = resume;
        self.seen[number].is_open = false;
        Ok(value)
    }

    /// Reads the kind of a node that is read the first time, if it is this one: what most nodes are, at once.
    #[inline]
    fn begins_with(&mut self, kind: NodeKind) -> bool {
        let begins = !self.repeating && self.head.peek() == Ok(kind);
        begins && self.head.kind().is_ok()
    }

    /// Counts what is read again, so that a few bytes cannot ask for much memory or time.
    #[inline]
    fn charge(&mut self, amount: usize) -> Result<(), DecodeError> {
        if self.repeating { self.charge_repeated(amount) } else { Ok(()) }
    }

    fn charge_repeated(&mut self, amount: usize) -> Result<(), DecodeError> {
        let left = self.repeatable.unwrap_or_else(|| {
            let seen = self.seen.first().map_or(0, |first| first.head.rest().len());
            let parts: usize = self.parts.iter().map(|part| part.bytes().len()).sum();
            REPEATED + REPEATED_TIMES * (seen + parts)
        });
        let left = left.checked_sub(amount).ok_or_else(|| {
            DecodeError::new(
                "it refers to parts of itself so often that it would become very large",
            )
        })?;
        self.repeatable = Some(left);
        Ok(())
    }

    /// A blob, and the part that it is.
    #[inline]
    fn blob(&mut self) -> Result<Placed<'a>, Malformed> {
        let len = match self.head.blob()? {
            Blob::Inline(bytes) => return Ok((bytes, None)),
            Blob::Part(len) => len,
        };
        let part = self.parts.get(self.part).ok_or(Malformed("a buffer is missing"))?;
        self.part += 1;
        if part.bytes().len() != len {
            return Err(Malformed("a buffer of another length than announced"));
        }
        Ok((part.bytes(), Some(part)))
    }

    /// The bytes of a blob that the receiver copies.
    #[inline]
    fn bytes(&mut self) -> Result<&'a [u8], DecodeError> {
        let (bytes, _) = self.blob()?;
        self.charge(bytes.len())?;
        Ok(bytes)
    }

    #[inline]
    fn text(&mut self) -> Result<&'a str, DecodeError> {
        Ok(text_of(self.bytes()?)?)
    }
}

#[inline(always)]
fn text_of(bytes: &[u8]) -> Result<&str, Malformed> {
    std::str::from_utf8(bytes).map_err(|_| Malformed("a string that is not UTF-8"))
}

/// Methods that differ only in what they want.
macro_rules! wanting {
    ($($method:ident => $want:ident),* $(,)?) => {
        $(
            fn $method<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, DecodeError> {
                self.node(visitor, Want::$want)
            }
        )*
    };
}

/// Methods for integers of at most 64 bits.
macro_rules! integers {
    ($($method:ident),* $(,)?) => {
        $(
            #[inline]
            fn $method<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, DecodeError> {
                match self.begins_with(NodeKind::Int) {
                    true => visitor.visit_i64(format::unzigzag(self.head.number()?)),
                    false => self.node(visitor, Want::Int),
                }
            }
        )*
    };
}

impl<'a> Deserializer<'a> for &mut Walk<'a> {
    type Error = DecodeError;

    wanting! {
        deserialize_any => Any,
        deserialize_bool => Scalar,
        deserialize_i128 => Wide,
        deserialize_u128 => UnsignedWide,
        deserialize_f32 => Float,
        deserialize_char => Scalar,
        deserialize_str => Scalar,
        deserialize_string => Scalar,
        deserialize_bytes => Bytes,
        deserialize_byte_buf => Bytes,
        deserialize_unit => Scalar,
        deserialize_seq => Seq,
        deserialize_map => Fields,
    }

    integers! {
        deserialize_i8, deserialize_i16, deserialize_i32, deserialize_i64,
        deserialize_u8, deserialize_u16, deserialize_u32, deserialize_u64,
    }

    #[inline]
    fn deserialize_f64<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, DecodeError> {
        match self.begins_with(NodeKind::Float) {
            true => visitor.visit_f64(f64::from_le_bytes(self.head.take()?)),
            false => self.node(visitor, Want::Float),
        }
    }

    #[inline]
    fn deserialize_identifier<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, DecodeError> {
        match self.begins_with(NodeKind::Str) {
            true => match self.head.short_blob() {
                Some(name) => visitor.visit_borrowed_str(text_of(name)?),
                None => visitor.visit_borrowed_str(self.text()?),
            },
            false => self.node(visitor, Want::Scalar),
        }
    }

    fn deserialize_option<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, DecodeError> {
        if self.head.peek()? == NodeKind::None {
            self.head.kind()?;
            self.charge(1)?;
            return visitor.visit_none();
        }
        self.layer(|walk| visitor.visit_some(walk))
    }

    fn deserialize_unit_struct<V: Visitor<'a>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, DecodeError> {
        self.node(visitor, Want::Scalar)
    }

    fn deserialize_newtype_struct<V: Visitor<'a>>(
        self,
        name: &'static str,
        visitor: V,
    ) -> Result<V::Value, DecodeError> {
        if name == ARRAY || name == DYNAMIC {
            return self.announced(visitor);
        }
        self.layer(|walk| visitor.visit_newtype_struct(walk))
    }

    fn deserialize_tuple<V: Visitor<'a>>(
        self,
        len: usize,
        visitor: V,
    ) -> Result<V::Value, DecodeError> {
        self.node(visitor, Want::Tuple(len))
    }

    fn deserialize_tuple_struct<V: Visitor<'a>>(
        self,
        _: &'static str,
        len: usize,
        visitor: V,
    ) -> Result<V::Value, DecodeError> {
        self.node(visitor, Want::Tuple(len))
    }

    fn deserialize_struct<V: Visitor<'a>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, DecodeError> {
        self.node(visitor, Want::Fields)
    }

    fn deserialize_enum<V: Visitor<'a>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, DecodeError> {
        self.variant(visitor)
    }

    fn deserialize_ignored_any<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, DecodeError> {
        self.skip()?;
        visitor.visit_unit()
    }
}
