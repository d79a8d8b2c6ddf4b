//! The names and the types of the parameters that an executable takes, found without a value: serde is asked which
//! fields the user's struct has, and then for each what it would read.

use std::fmt;

use serde::de::value::StrDeserializer;
use serde::de::{self, DeserializeOwned, DeserializeSeed, Deserializer, MapAccess, Visitor};
use serde::forward_to_deserialize_any;

/// The names of the fields of a struct, and their types as people know them; none if it is no struct.
pub(super) fn of<P: DeserializeOwned>() -> Option<Vec<(String, String)>> {
    let mut fields = None;
    // It ends where the fields are known.
    let _ = P::deserialize(Probe { fields: &mut fields, field: None, ty: &mut String::new() });
    let named = |name: &&'static str| {
        let mut ty = String::new();
        let _ = P::deserialize(Probe { fields: &mut None, field: Some(name), ty: &mut ty });
        ((*name).to_owned(), ty)
    };
    fields.map(|fields| fields.iter().map(named).collect())
}

/// That enough is known.
#[derive(Debug)]
struct Enough;

impl fmt::Display for Enough {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("enough is known")
    }
}

impl std::error::Error for Enough {}

impl de::Error for Enough {
    fn custom<T: fmt::Display>(_: T) -> Self {
        Self
    }
}

/// What the struct is read from: it notes the fields, or what is read as the value of one.
struct Probe<'p> {
    fields: &'p mut Option<&'static [&'static str]>,
    field: Option<&'static str>,
    ty: &'p mut String,
}

impl<'de> Deserializer<'de> for Probe<'_> {
    type Error = Enough;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Enough> {
        Err(Enough)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Enough> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Enough> {
        if self.field.is_none() {
            *self.fields = Some(fields);
            return Err(Enough);
        }
        visitor.visit_map(self)
    }

    fn deserialize_unit<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Enough> {
        *self.fields = Some(&[]);
        Err(Enough)
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Enough> {
        self.deserialize_unit(visitor)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option seq tuple
        tuple_struct map enum identifier ignored_any
    }
}

impl<'de> MapAccess<'de> for Probe<'_> {
    type Error = Enough;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, Enough> {
        let field = self.field.take().map(StrDeserializer::new);
        field.map(|field| seed.deserialize(field)).transpose()
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Enough> {
        seed.deserialize(Type(self.ty))
    }
}

/// What a value is read from: it notes as what.
struct Type<'p>(&'p mut String);

macro_rules! names {
    ($($method:ident $(($($argument:ty),*))?: $name:literal),* $(,)?) => {$(
        fn $method<V: Visitor<'de>>(self $($(, _: $argument)*)?, _: V) -> Result<V::Value, Enough> {
            $name.clone_into(self.0);
            Err(Enough)
        }
    )*};
}

impl<'de> Deserializer<'de> for Type<'_> {
    type Error = Enough;

    names! {
        deserialize_any: "any value", deserialize_bool: "bool",
        deserialize_i8: "i8", deserialize_i16: "i16", deserialize_i32: "i32", deserialize_i64: "i64",
        deserialize_i128: "i128", deserialize_u8: "u8", deserialize_u16: "u16", deserialize_u32: "u32",
        deserialize_u64: "u64", deserialize_u128: "u128", deserialize_f32: "f32", deserialize_f64: "f64",
        deserialize_char: "char", deserialize_str: "String", deserialize_string: "String",
        deserialize_bytes: "bytes", deserialize_byte_buf: "bytes", deserialize_unit: "()",
        deserialize_unit_struct(&'static str): "()", deserialize_seq: "a list", deserialize_tuple(usize): "a tuple",
        deserialize_tuple_struct(&'static str, usize): "a tuple", deserialize_map: "a dict",
        deserialize_identifier: "String", deserialize_ignored_any: "any value",
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Enough> {
        let inner = visitor.visit_some(Type(&mut *self.0));
        *self.0 = format!("{} or None", self.0);
        inner
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        visitor: V,
    ) -> Result<V::Value, Enough> {
        // What a newtype is made of says more than its name; some hide that.
        name.clone_into(self.0);
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        _: &'static [&'static str],
        _: V,
    ) -> Result<V::Value, Enough> {
        name.clone_into(self.0);
        Err(Enough)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        _: &'static [&'static str],
        _: V,
    ) -> Result<V::Value, Enough> {
        name.clone_into(self.0);
        Err(Enough)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::time::Duration;

    use serde::Deserialize;

    use super::*;

    #[derive(Deserialize)]
    #[allow(dead_code, reason = "only its fields are looked at")]
    struct Camera {
        rate: u32,
        name: Option<String>,
        exposure: Duration,
        #[serde(default)]
        gains: Vec<f64>,
    }

    #[test]
    fn the_fields_of_a_struct_are_known_with_their_types() {
        let known = of::<Camera>().unwrap();
        let known: Vec<_> = known.iter().map(|(name, ty)| format!("{name}: {ty}")).collect();
        assert_eq!(
            known,
            ["rate: u32", "name: String or None", "exposure: Duration", "gains: a list"]
        );
        assert_eq!(of::<()>(), Some(Vec::new()));
        assert_eq!(of::<BTreeMap<String, u32>>(), None);
    }
}
