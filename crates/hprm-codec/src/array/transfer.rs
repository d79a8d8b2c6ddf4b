//! What an array is for serde: itself in this crate's format, and a struct of shape and elements in any other.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{self, DeserializeOwned, Deserializer, Error as _, Visitor};
use serde::{Deserialize, Serialize, Serializer};

use super::Array;
use crate::element::Element;
use crate::slot::{self, ARRAY, Incoming, Outgoing};

/// An array in any other format.
#[derive(Serialize)]
struct Lent<'a, T> {
    shape: &'a [usize],
    data: &'a [T],
}

/// Likewise, for reading.
#[derive(Deserialize)]
#[serde(bound = "T: DeserializeOwned", rename = "Array", expecting = "an array")]
struct Owned<T> {
    shape: Vec<usize>,
    data: Vec<T>,
}

impl<T: Element> Serialize for Array<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let lent = Lent { shape: self.shape(), data: self.as_slice() };
        let shape = self.shape().into();
        let array = Outgoing { dtype: T::DTYPE, shape, memory: self.memory() };
        slot::offer(array, || serializer.serialize_newtype_struct(ARRAY, &lent))
    }
}

impl<'de, T: Element> Deserialize<'de> for Array<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_newtype_struct(ARRAY, ArrayVisitor(PhantomData))
    }
}

struct ArrayVisitor<T>(PhantomData<T>);

impl<'de, T: Element> Visitor<'de> for ArrayVisitor<T> {
    type Value = Array<T>;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "an array of the dtype {}", T::DTYPE.name())
    }

    fn visit_newtype_struct<D: Deserializer<'de>>(self, source: D) -> Result<Array<T>, D::Error> {
        match slot::announced() {
            Some(Incoming::Array(array)) if array.dtype == T::DTYPE => {
                source.deserialize_bytes(InlineVisitor(array, PhantomData))
            }
            Some(Incoming::Array(array)) => {
                let (wanted, came) = (T::DTYPE.name(), array.dtype.name());
                Err(D::Error::custom(format_args!(
                    "expected {}, found one of the dtype {came} (hint: send array.astype('{wanted}'), or receive \
                     an Array<{}>)",
                    &self as &dyn de::Expected, array.dtype
                )))
            }
            Some(Incoming::List | Incoming::Tuple) => Vec::deserialize(source).map(Array::from),
            // Formats for people describe themselves, also where serde has kept a value for later.
            None if source.is_human_readable() => source.deserialize_any(self),
            None => {
                let Owned { shape, data } = Owned::deserialize(source)?;
                Array::from_shape_vec(&shape, data).map_err(D::Error::custom)
            }
        }
    }

    fn visit_map<A: de::MapAccess<'de>>(self, map: A) -> Result<Array<T>, A::Error> {
        let Owned { shape, data } = Owned::deserialize(de::value::MapAccessDeserializer::new(map))?;
        Array::from_shape_vec(&shape, data).map_err(A::Error::custom)
    }

    /// Elements alone, as an array of one dimension has them where serde has kept a value for later.
    fn visit_seq<A: de::SeqAccess<'de>>(self, seq: A) -> Result<Array<T>, A::Error> {
        Vec::deserialize(de::value::SeqAccessDeserializer::new(seq)).map(Array::from)
    }
}

/// Takes the bytes of an array that has them in the head.
struct InlineVisitor<T>(slot::IncomingArray, PhantomData<T>);

impl<T: Element> Visitor<'_> for InlineVisitor<T> {
    type Value = Array<T>;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("the bytes of an array")
    }

    fn visit_bytes<E: de::Error>(self, inline: &[u8]) -> Result<Array<T>, E> {
        Array::received(self.0, inline).map_err(E::custom)
    }
}
