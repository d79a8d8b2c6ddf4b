//! A value whose type the receiver does not know.
//!
//! It keeps what Python and Rust both know. What is of a class of Python arrives as what it is made of: an object as a
//! dict of its attributes, a member of an enumeration as its name, a set as a list.

use std::fmt;
use std::sync::Arc;

use serde::de::{self, Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::ser::{SerializeMap, SerializeTuple};
use serde::{Serialize, Serializer};

use crate::array::Array;
use crate::element::Dtype;
use crate::memory::Memory;
use crate::slot::{self, DYNAMIC, Incoming, IncomingArray};

/// A value of any type that both Rust and Python know.
///
/// ```
/// use hprm_codec::Dynamic;
///
/// let pose = Dynamic::Dict(vec![(Dynamic::Str("x".to_owned()), Dynamic::Float(0.5))]);
/// assert_eq!(pose.get("x"), Some(&Dynamic::Float(0.5)));
/// ```
#[derive(Clone, PartialEq, Debug)]
pub enum Dynamic {
    /// Nothing.
    None,
    /// A bool.
    Bool(bool),
    /// An integer.
    Int(i128),
    /// An integer that is too large for [`Int`](Self::Int).
    Unsigned(u128),
    /// A floating-point number.
    Float(f64),
    /// Text.
    Str(String),
    /// Bytes.
    Bytes(Vec<u8>),
    /// A list.
    List(Vec<Self>),
    /// A tuple.
    Tuple(Vec<Self>),
    /// A dict, in its order.
    Dict(Vec<(Self, Self)>),
    /// An array.
    Array(DynamicArray),
}

impl Dynamic {
    /// The value of a dict under that name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Self> {
        let Self::Dict(entries) = self else { return None };
        let is_it = |key: &Self| matches!(key, Self::Str(key) if key == name);
        entries.iter().find(|(key, _)| is_it(key)).map(|(_, value)| value)
    }
}

impl Serialize for Dynamic {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::None => serializer.serialize_unit(),
            Self::Bool(value) => serializer.serialize_bool(*value),
            Self::Int(number) => match i64::try_from(*number) {
                Ok(number) => serializer.serialize_i64(number),
                Err(_) => serializer.serialize_i128(*number),
            },
            Self::Unsigned(number) => serializer.serialize_u128(*number),
            Self::Float(number) => serializer.serialize_f64(*number),
            Self::Str(text) => serializer.serialize_str(text),
            Self::Bytes(bytes) => serializer.serialize_bytes(bytes),
            Self::List(members) => members.serialize(serializer),
            Self::Tuple(members) => {
                let mut tuple = serializer.serialize_tuple(members.len())?;
                members.iter().try_for_each(|member| tuple.serialize_element(member))?;
                tuple.end()
            }
            Self::Dict(entries) => {
                let mut map = serializer.serialize_map(Some(entries.len()))?;
                entries.iter().try_for_each(|(key, value)| map.serialize_entry(key, value))?;
                map.end()
            }
            Self::Array(array) => array.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Dynamic {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_newtype_struct(DYNAMIC, DynamicVisitor)
    }
}

struct DynamicVisitor;

/// Visits what is just a variant with the value.
macro_rules! visits {
    ($($visit:ident: $type:ty => $variant:ident),* $(,)?) => {
        $(
            fn $visit<E: de::Error>(self, value: $type) -> Result<Dynamic, E> {
                Ok(Dynamic::$variant(value.into()))
            }
        )*
    };
}

impl<'de> Visitor<'de> for DynamicVisitor {
    type Value = Dynamic;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a value that Rust and Python both know")
    }

    visits! {
        visit_bool: bool => Bool,
        visit_i64: i64 => Int,
        visit_i128: i128 => Int,
        visit_u64: u64 => Int,
        visit_f64: f64 => Float,
        visit_str: &str => Str,
        visit_string: String => Str,
        visit_bytes: &[u8] => Bytes,
        visit_byte_buf: Vec<u8> => Bytes,
    }

    fn visit_u128<E: de::Error>(self, number: u128) -> Result<Dynamic, E> {
        Ok(i128::try_from(number).map_or(Dynamic::Unsigned(number), Dynamic::Int))
    }

    fn visit_unit<E: de::Error>(self) -> Result<Dynamic, E> {
        Ok(Dynamic::None)
    }

    fn visit_none<E: de::Error>(self) -> Result<Dynamic, E> {
        Ok(Dynamic::None)
    }

    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<Dynamic, D::Error> {
        Dynamic::deserialize(deserializer)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Dynamic, A::Error> {
        let mut members = Vec::new();
        while let Some(member) = seq.next_element()? {
            members.push(member);
        }
        Ok(Dynamic::List(members))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Dynamic, A::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = map.next_entry()? {
            entries.push(entry);
        }
        Ok(Dynamic::Dict(entries))
    }

    fn visit_newtype_struct<D: Deserializer<'de>>(self, source: D) -> Result<Dynamic, D::Error> {
        match slot::announced() {
            Some(Incoming::Array(array)) => {
                source.deserialize_bytes(ArrayVisitor(array)).map(Dynamic::Array)
            }
            Some(Incoming::Tuple) => match source.deserialize_any(self)? {
                Dynamic::List(members) => Ok(Dynamic::Tuple(members)),
                other => Ok(other),
            },
            Some(Incoming::List) | None => source.deserialize_any(self),
        }
    }
}

/// Takes the bytes of an array that has them in the head.
struct ArrayVisitor(IncomingArray);

impl Visitor<'_> for ArrayVisitor {
    type Value = DynamicArray;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("the bytes of an array")
    }

    fn visit_bytes<E: de::Error>(self, inline: &[u8]) -> Result<DynamicArray, E> {
        DynamicArray::received(self.0, inline).map_err(E::custom)
    }
}

/// Writes an enumeration with an array of each type of elements.
macro_rules! dynamic_array {
    ($($dtype:ident => $element:ty),* $(,)?) => {
        /// An array of any type of elements.
        #[derive(Clone, PartialEq, Debug)]
        #[non_exhaustive]
        pub enum DynamicArray {
            $(
                #[doc = concat!("An array of `", stringify!($element), "`.")]
                $dtype(Array<$element>),
            )*
        }

        impl DynamicArray {
            fn received(array: IncomingArray, inline: &[u8]) -> Result<Self, crate::ShapeError> {
                match array.dtype {
                    $(Dtype::$dtype => Array::received(array, inline).map(Self::$dtype),)*
                }
            }

            /// The type of its elements.
            #[must_use]
            pub fn dtype(&self) -> Dtype {
                match self {
                    $(Self::$dtype(_) => Dtype::$dtype,)*
                }
            }

            /// The length of each dimension.
            #[must_use]
            pub fn shape(&self) -> &[usize] {
                match self {
                    $(Self::$dtype(array) => array.shape(),)*
                }
            }

            /// The memory in which its elements lie, in the order of C.
            #[must_use]
            pub fn memory(&self) -> Arc<dyn Memory> {
                match self {
                    $(Self::$dtype(array) => array.memory(),)*
                }
            }
        }

        impl Serialize for DynamicArray {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                match self {
                    $(Self::$dtype(array) => array.serialize(serializer),)*
                }
            }
        }

        $(
            impl From<Array<$element>> for DynamicArray {
                fn from(array: Array<$element>) -> Self {
                    Self::$dtype(array)
                }
            }
        )*
    };
}

dynamic_array! {
    Bool => bool,
    I8 => i8, I16 => i16, I32 => i32, I64 => i64,
    U8 => u8, U16 => u16, U32 => u32, U64 => u64,
    F32 => f32, F64 => f64, C32 => [f32; 2], C64 => [f64; 2],
}
