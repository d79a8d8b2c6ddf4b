//! Objects that only Python reads, for those that look at values: what they are, and their parts.

use serde::de::value::StrDeserializer;
use serde::de::{DeserializeSeed, Deserializer, MapAccess, Visitor};
use serde::forward_to_deserialize_any;

use super::Walk;
use super::nodes::Want;
use crate::error::DecodeError;

impl<'a> Walk<'a> {
    /// Reads an object of so many parts as a dict of one entry, under its name.
    pub(super) fn outlined<V: Visitor<'a>>(
        &mut self,
        visitor: V,
        name: &'static str,
        count: usize,
    ) -> Result<V::Value, DecodeError> {
        visitor.visit_map(Outline { walk: self, name: Some(name), count })
    }
}

/// The only entry.
struct Outline<'w, 'a> {
    walk: &'w mut Walk<'a>,
    /// None once the key has been read.
    name: Option<&'static str>,
    count: usize,
}

impl<'a> MapAccess<'a> for Outline<'_, 'a> {
    type Error = DecodeError;

    fn next_key_seed<K: DeserializeSeed<'a>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, DecodeError> {
        self.name.take().map(|name| seed.deserialize(StrDeserializer::new(name))).transpose()
    }

    fn next_value_seed<S: DeserializeSeed<'a>>(
        &mut self,
        seed: S,
    ) -> Result<S::Value, DecodeError> {
        seed.deserialize(Parts { walk: self.walk, count: self.count })
    }
}

/// The parts, as a list.
struct Parts<'w, 'a> {
    walk: &'w mut Walk<'a>,
    count: usize,
}

impl<'a> Deserializer<'a> for Parts<'_, 'a> {
    type Error = DecodeError;

    fn deserialize_any<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, DecodeError> {
        self.walk.members(visitor, Want::Any, self.count, "parts of an object")
    }

    forward_to_deserialize_any! {
        <V: Visitor<'a>>
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map struct enum identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use crate::format::{DIRECT, NodeKind};
    use crate::{Dynamic, decode, outline};

    #[test]
    fn an_object_of_python_is_what_it_is_and_its_parts() {
        // `[Fraction(1, 3), 7]`: a list of two; an object of class 2 with two parts, each a zigzag number.
        let object =
            [NodeKind::Reconstructed as u8, 2, 2, NodeKind::Int as u8, 2, NodeKind::Int as u8, 6];
        let mut head = vec![DIRECT, NodeKind::List as u8, 2];
        head.extend(object);
        head.extend([NodeKind::Int as u8, 14]);
        let parts = Dynamic::List(vec![Dynamic::Int(1), Dynamic::Int(3)]);
        let fraction =
            Dynamic::Dict(vec![(Dynamic::Str("a fractions.Fraction".to_owned()), parts)]);
        let expected = Dynamic::List(vec![fraction, Dynamic::Int(7)]);
        assert_eq!(outline(&head, &[]), Ok(expected));
        let error = decode::<Dynamic>(&head, &[]).unwrap_err();
        assert!(error.to_string().contains("only Python reads"), "{error}");
    }

    #[test]
    fn an_array_that_rust_does_not_have_is_an_array_with_the_reason() {
        let mut head = vec![DIRECT, NodeKind::Array as u8, 4, 0];
        head.extend(b"<f2");
        // In the order of C, one dimension of one element, two bytes.
        head.extend([0, 1, 1, 4, 0, 60]);
        let text = |text: &str| Dynamic::Str(text.to_owned());
        let why = text("Rust has no elements of the array's dtype <f2");
        assert_eq!(outline(&head, &[]), Ok(Dynamic::Dict(vec![(text("an array"), why)])));
    }

    #[test]
    fn what_is_no_value_is_an_error() {
        assert!(
            outline(&[DIRECT, NodeKind::Reconstructed as u8, 2, 9], &[])
                .unwrap_err()
                .is_malformed()
        );
        assert!(outline(&[], &[]).is_err());
    }
}
