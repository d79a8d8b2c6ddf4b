//! Enumerations: a name, or a dict of one entry, whose key is the variant's name and whose value its contents.

use serde::de::value::BorrowedStrDeserializer;
use serde::de::{Deserialize, DeserializeSeed, EnumAccess, VariantAccess, Visitor};

use super::Walk;
use super::nodes::Want;
use super::objects::Code;
use crate::error::DecodeError;
use crate::format::NodeKind;
use crate::place;

impl<'a> Walk<'a> {
    /// Reads an enumeration.
    pub(super) fn variant<V: Visitor<'a>>(&mut self, visitor: V) -> Result<V::Value, DecodeError> {
        self.charge(1)?;
        let start = self.head;
        match self.head.kind()? {
            NodeKind::Str => visitor.visit_enum(BorrowedStrDeserializer::new(self.text()?)),
            NodeKind::Dict => self.enter(start, |walk| {
                let count = walk.head.count()?;
                if count != 1 {
                    let found = format!("a dict of {count} entries");
                    return Err(DecodeError::mismatch(&visitor, &found));
                }
                visitor.visit_enum(Entry(walk))
            }),
            NodeKind::BackReference => self.repeat(|walk| walk.variant(visitor)),
            NodeKind::Reconstructed => self.enter(start, |walk| {
                let code = Code::read(walk)?;
                match code.is_member() {
                    true => visitor.visit_enum(BorrowedStrDeserializer::new(walk.member()?)),
                    false => Err(DecodeError::mismatch(&visitor, code.name())),
                }
            }),
            _ => {
                self.head = start;
                self.node(OtherThan(visitor), Want::Scalar)
            }
        }
    }
}

/// A value that is no enumeration: an error that says what it is.
struct OtherThan<V>(V);

impl<'a, V: Visitor<'a>> Visitor<'a> for OtherThan<V> {
    type Value = V::Value;

    fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.expecting(formatter)?;
        formatter.write_str(" (a variant's name, or {name: contents})")
    }
}

/// A dict of one entry.
struct Entry<'w, 'a>(&'w mut Walk<'a>);

/// The value of that entry.
struct Contents<'w, 'a> {
    walk: &'w mut Walk<'a>,
    key: crate::cursor::Cursor<'a>,
}

impl<'w, 'a> EnumAccess<'a> for Entry<'w, 'a> {
    type Error = DecodeError;
    type Variant = Contents<'w, 'a>;

    fn variant_seed<V: DeserializeSeed<'a>>(
        self,
        seed: V,
    ) -> Result<(V::Value, Contents<'w, 'a>), DecodeError> {
        let key = self.0.head;
        let variant = seed.deserialize(&mut *self.0)?;
        Ok((variant, Contents { walk: self.0, key }))
    }
}

impl<'a> VariantAccess<'a> for Contents<'_, 'a> {
    type Error = DecodeError;

    fn unit_variant(self) -> Result<(), DecodeError> {
        let contents = <()>::deserialize(self.walk);
        contents.map_err(|error| error.within(|| place::item(self.key)))
    }

    fn newtype_variant_seed<T: DeserializeSeed<'a>>(
        self,
        seed: T,
    ) -> Result<T::Value, DecodeError> {
        let contents = seed.deserialize(self.walk);
        contents.map_err(|error| error.within(|| place::item(self.key)))
    }

    fn tuple_variant<V: Visitor<'a>>(
        self,
        len: usize,
        visitor: V,
    ) -> Result<V::Value, DecodeError> {
        let contents = self.walk.node(visitor, Want::Tuple(len));
        contents.map_err(|error| error.within(|| place::item(self.key)))
    }

    fn struct_variant<V: Visitor<'a>>(
        self,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, DecodeError> {
        let contents = self.walk.node(visitor, Want::Fields);
        contents.map_err(|error| error.within(|| place::item(self.key)))
    }
}
