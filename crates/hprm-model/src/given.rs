//! Values of parameters that an executable is given: all of them are known before anything runs, so they are data.
//!
//! What an executable makes of one is up to it. The JSON of a value is what the front ends, launchers and executables
//! exchange: nothing, truth values, integers, texts and lists are themselves; everything else is an object of one
//! entry, such as `{"time": 10000000}`.

use hprm_core::Nanos;
use serde::{Deserialize, Serialize};

/// A value of a parameter.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Given {
    /// Python's `None`.
    Nothing,
    /// A truth value.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A text.
    Text(String),
    /// A list.
    List(Vec<Self>),
    /// What JSON does not have.
    Other(OtherGiven),
}

/// A value that JSON does not have.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OtherGiven {
    /// A number with a point.
    #[serde(with = "as_text")]
    Float(f64),
    /// A time in nanoseconds.
    Time(Nanos),
    /// A tuple.
    Tuple(Vec<Given>),
    /// A dictionary: keys and values.
    Dict(Vec<(Given, Given)>),
}

/// A float as text: exact, also if it is infinite or no number.
mod as_text {
    use serde::de::{Deserialize, Deserializer, Error};
    use serde::ser::Serializer;

    pub(super) fn serialize<S: Serializer>(number: &f64, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(&format_args!("{number:?}"))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        let text = String::deserialize(from)?;
        text.parse().map_err(|_| D::Error::custom(format_args!("{text:?} is no float")))
    }
}
