//! The parameters that an executable is given by the program that names it, as a type of the user's.
//!
//! Values are encoded as messages are, so that which types fit is the same for both. Where they come from is up to
//! `executable`, and what is told of a mistake up to `describe`.

use std::fmt::{self, Display};
use std::sync::Arc;

use hprm_codec::{Dynamic, Memory, decode_seed, encode};
use hprm_model::{Given, OtherGiven};
use serde::de::value::StrDeserializer;
use serde::de::{self, DeserializeOwned, DeserializeSeed, Deserializer, MapAccess, Visitor};
use serde::forward_to_deserialize_any;

/// What is wrong with parameters.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum Mistake {
    /// There is none of that name.
    Missing(String),
    /// The type does not have this one.
    Unknown(String),
    /// The value of that one does not fit, or something else is wrong.
    Wrong(Option<String>, String),
}

impl Display for Mistake {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing(name) => write!(formatter, "the parameter `{name}` is missing"),
            Self::Unknown(name) => write!(formatter, "there is no parameter `{name}`"),
            Self::Wrong(Some(name), why) => write!(formatter, "the parameter `{name}`: {why}"),
            Self::Wrong(None, why) => write!(formatter, "the parameters: {why}"),
        }
    }
}

impl std::error::Error for Mistake {}

impl de::Error for Mistake {
    fn custom<T: Display>(what: T) -> Self {
        Self::Wrong(None, what.to_string())
    }

    fn missing_field(field: &'static str) -> Self {
        Self::Missing(field.to_owned())
    }

    fn unknown_field(field: &str, _: &'static [&'static str]) -> Self {
        Self::Unknown(field.to_owned())
    }
}

/// Parameters as a type.
///
/// # Errors
///
/// What is wrong with the first one that does not fit.
pub(super) fn read<P: DeserializeOwned>(given: &[(String, Given)]) -> Result<P, Mistake> {
    let encoded = given.iter().map(|(name, value)| Encoded::new(name, value));
    let encoded = encoded.collect::<Result<Vec<_>, _>>()?;
    P::deserialize(Parameters(&encoded))
}

/// A parameter whose value is encoded.
struct Encoded {
    name: String,
    is_time: bool,
    head: Vec<u8>,
    parts: Vec<Arc<dyn Memory>>,
}

impl Encoded {
    fn new(name: &str, value: &Given) -> Result<Self, Mistake> {
        let draft = encode(&dynamic(value))
            .map_err(|error| Mistake::Wrong(Some(name.to_owned()), error.to_string()))?;
        Ok(Self {
            name: name.to_owned(),
            is_time: matches!(value, Given::Other(OtherGiven::Time(_))),
            head: draft.head,
            parts: draft.parts.into_iter().map(|part| part.into_memory()).collect(),
        })
    }
}

/// A value as it would travel. A time is what `std::time::Duration` is made of.
fn dynamic(value: &Given) -> Dynamic {
    let all = |members: &[Given]| members.iter().map(dynamic).collect();
    match value {
        Given::Nothing => Dynamic::None,
        Given::Bool(truth) => Dynamic::Bool(*truth),
        Given::Integer(number) => Dynamic::Int((*number).into()),
        Given::Text(text) => Dynamic::Str(text.clone()),
        Given::List(members) => Dynamic::List(all(members)),
        Given::Other(OtherGiven::Float(number)) => Dynamic::Float(*number),
        Given::Other(OtherGiven::Tuple(members)) => Dynamic::Tuple(all(members)),
        Given::Other(OtherGiven::Dict(entries)) => {
            let entries = entries.iter().map(|(key, value)| (dynamic(key), dynamic(value)));
            Dynamic::Dict(entries.collect())
        }
        Given::Other(OtherGiven::Time(nanos)) => {
            const SECOND: i64 = 1_000_000_000;
            let part = |name: &str, number: i64| {
                (Dynamic::Str(name.to_owned()), Dynamic::Int(number.into()))
            };
            let (secs, nanos) = (nanos.div_euclid(SECOND), nanos.rem_euclid(SECOND));
            Dynamic::Dict(vec![part("secs", secs), part("nanos", nanos)])
        }
    }
}

/// All parameters, from which a type is made.
struct Parameters<'a>(&'a [Encoded]);

impl<'a> Parameters<'a> {
    fn entries(self, known: Option<&'static [&'static str]>) -> Entries<'a> {
        Entries { left: self.0, known }
    }
}

impl<'de> Deserializer<'de> for Parameters<'de> {
    type Error = Mistake;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        visitor.visit_map(self.entries(None))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        visitor.visit_map(self.entries(Some(fields)))
    }

    fn deserialize_unit<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        match self.0.first() {
            Some(first) => Err(Mistake::Unknown(first.name.clone())),
            None => visitor.visit_unit(),
        }
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        self.deserialize_unit(visitor)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        visitor.visit_newtype_struct(self)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option seq tuple
        tuple_struct map enum identifier ignored_any
    }
}

/// The parameters that have not been read.
struct Entries<'a> {
    left: &'a [Encoded],
    /// The fields of the struct that reads them, if one does.
    known: Option<&'static [&'static str]>,
}

impl<'de> MapAccess<'de> for Entries<'de> {
    type Error = Mistake;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, Mistake> {
        let Some(Encoded { name, .. }) = self.left.first() else { return Ok(None) };
        if self.known.is_some_and(|known| !known.contains(&name.as_str())) {
            return Err(Mistake::Unknown(name.clone()));
        }
        seed.deserialize(StrDeserializer::new(name)).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Mistake> {
        let Some((first, left)) = self.left.split_first() else {
            return Err(de::Error::custom("a value was asked for that is not there"));
        };
        self.left = left;
        decode_seed(seed, &first.head, &first.parts).map_err(|error| {
            let hint = if first.is_time { " (a time is a `std::time::Duration`)" } else { "" };
            Mistake::Wrong(Some(first.name.clone()), format!("{error}{hint}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::time::Duration;

    use serde::Deserialize;

    use super::*;

    #[derive(PartialEq, Debug, Deserialize)]
    struct Camera {
        rate: u32,
        #[serde(default)]
        name: String,
        exposure: Option<Duration>,
        #[serde(default)]
        gains: Vec<f64>,
        #[serde(default)]
        corner: (i8, i8),
    }

    fn given(json: &str) -> Vec<(String, Given)> {
        serde_json::from_str(json).unwrap()
    }

    fn camera(json: &str) -> Result<Camera, Mistake> {
        read(&given(json))
    }

    #[test]
    fn values_become_the_fields_of_a_struct() {
        let json = r#"[["rate", 20], ["name", "front"], ["exposure", {"time": 1500000000}],
            ["gains", [1, {"float": "0.5"}]], ["corner", {"tuple": [3, -4]}]]"#;
        assert_eq!(
            camera(json).unwrap(),
            Camera {
                rate: 20,
                name: "front".to_owned(),
                exposure: Some(Duration::from_millis(1500)),
                gains: vec![1.0, 0.5],
                corner: (3, -4),
            }
        );
        assert_eq!(camera(r#"[["rate", 1], ["exposure", null]]"#).unwrap().exposure, None);
    }

    #[test]
    fn floats_are_exact() {
        for number in [0.1, f64::MIN_POSITIVE / 3.0, f64::NEG_INFINITY, 1e300] {
            let text = serde_json::to_string(&Given::Other(OtherGiven::Float(number))).unwrap();
            let back: Given = serde_json::from_str(&text).unwrap();
            assert_eq!(back, Given::Other(OtherGiven::Float(number)), "{text}");
        }
    }

    #[test]
    fn what_does_not_fit_is_told_with_the_name() {
        let wrong = |json| camera(json).unwrap_err().to_string();
        assert_eq!(wrong("[]"), "the parameter `rate` is missing");
        assert_eq!(wrong(r#"[["rate", 1], ["speed", 2]]"#), "there is no parameter `speed`");
        assert_eq!(
            wrong(r#"[["rate", "fast"]]"#),
            "the parameter `rate`: `value`: expected u32, found the str 'fast'"
        );
        assert_eq!(
            wrong(r#"[["rate", {"float": "2.0"}]]"#),
            "the parameter `rate`: `value`: expected u32, found the float 2.0"
        );
        assert!(
            wrong(r#"[["rate", {"time": 5}]]"#).ends_with("(a time is a `std::time::Duration`)")
        );
        assert!(wrong(r#"[["rate", -1]]"#).starts_with("the parameter `rate`: `value`: "));
    }

    #[test]
    fn nothing_takes_no_parameters_and_a_map_takes_all() {
        assert!(read::<()>(&[]).is_ok());
        assert_eq!(
            read::<()>(&given(r#"[["rate", 1]]"#)),
            Err(Mistake::Unknown("rate".to_owned()))
        );
        let map: BTreeMap<String, Dynamic> =
            read(&given(r#"[["rate", 1], ["on", true]]"#)).unwrap();
        assert_eq!(map["on"], Dynamic::Bool(true));
    }
}
