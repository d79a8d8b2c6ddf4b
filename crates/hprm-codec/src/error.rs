//! Why a value cannot be encoded or decoded: where in it, what was expected, and what came.

use std::fmt::{self, Display};

use hprm_core::NoMemory;
use serde::de::{self, Expected, Unexpected};
use serde::ser;

use crate::format::Malformed;
use crate::pickle::Pickle;
use crate::place::{Place, quoted};

/// Why a value cannot be encoded.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct EncodeError(Box<Cause>);

/// Why bytes do not become a value of the type that is expected.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct DecodeError(Box<Cause>);

#[derive(Clone, PartialEq, Eq, Debug)]
enum Cause {
    /// Something is wrong with the value at a place.
    At(Place, String),
    /// The bytes are no value.
    Malformed(Malformed),
    /// The system has no memory for the encoded value.
    NoMemory(NoMemory),
    /// The value is a pickle, and this is the class that it names first.
    Pickle(Option<String>),
}

const PICKLE: &str = "which only Python can read (hint: send a dataclass, or a dict of numbers, strings, lists and \
    NumPy arrays; the handbook page reference/codec lists what both sides know. With HPRM_PICKLE=deny in its environment, \
    the sender says which part of the value needs a pickle)";

impl Display for Cause {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::At(place, what) => write!(formatter, "{place}: {what}"),
            Self::Malformed(malformed) => malformed.fmt(formatter),
            Self::NoMemory(no_memory) => no_memory.fmt(formatter),
            Self::Pickle(None) => write!(formatter, "the value has arrived as a pickle, {PICKLE}"),
            Self::Pickle(Some(class)) => {
                write!(formatter, "the value has arrived as a pickle of {class}, {PICKLE}")
            }
        }
    }
}

impl Cause {
    fn at_value(what: String) -> Box<Self> {
        Box::new(Self::At(Place::default(), what))
    }

    fn within(&mut self, step: impl FnOnce() -> String) {
        if let Self::At(place, _) = self {
            place.within(step());
        }
    }
}

impl EncodeError {
    /// A text about the value that is being encoded.
    pub(crate) fn new(what: impl Into<String>) -> Self {
        Self(Cause::at_value(what.into()))
    }

    /// Adds where in its container the value is.
    pub(crate) fn within(mut self, step: impl FnOnce() -> String) -> Self {
        self.0.within(step);
        self
    }
}

impl DecodeError {
    /// A text about the value that is being decoded.
    pub(crate) fn new(what: impl Into<String>) -> Self {
        Self(Cause::at_value(what.into()))
    }

    /// The value is a pickle.
    pub(crate) fn pickle(pickle: Option<Pickle>) -> Self {
        Self(Box::new(Cause::Pickle(pickle.and_then(|pickle| pickle.names))))
    }

    /// `found` has come where `expected` should.
    pub(crate) fn mismatch(expected: &dyn Expected, found: &str) -> Self {
        Self::new(format!("expected {expected}, found {found}"))
    }

    /// Adds where in its container the value is.
    pub(crate) fn within(mut self, step: impl FnOnce() -> String) -> Self {
        self.0.within(step);
        self
    }

    /// Whether the bytes are no value at all, rather than one of another type.
    #[must_use]
    pub fn is_malformed(&self) -> bool {
        matches!(*self.0, Cause::Malformed(_))
    }
}

impl Display for EncodeError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(formatter)
    }
}

impl Display for DecodeError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(formatter)
    }
}

impl std::error::Error for EncodeError {}

impl std::error::Error for DecodeError {}

impl From<NoMemory> for EncodeError {
    fn from(no_memory: NoMemory) -> Self {
        Self(Box::new(Cause::NoMemory(no_memory)))
    }
}

impl From<Malformed> for DecodeError {
    fn from(malformed: Malformed) -> Self {
        Self(Box::new(Cause::Malformed(malformed)))
    }
}

impl ser::Error for EncodeError {
    fn custom<T: Display>(what: T) -> Self {
        Self::new(what.to_string())
    }
}

impl de::Error for DecodeError {
    fn custom<T: Display>(what: T) -> Self {
        Self::new(what.to_string())
    }

    fn invalid_type(unexpected: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::mismatch(expected, &found(unexpected))
    }

    fn invalid_value(unexpected: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::mismatch(expected, &found(unexpected))
    }

    fn invalid_length(len: usize, expected: &dyn Expected) -> Self {
        Self::mismatch(expected, &format!("{len} members"))
    }

    fn missing_field(field: &'static str) -> Self {
        Self::new(format!("the field {} is missing", quoted(field)))
    }

    fn duplicate_field(field: &'static str) -> Self {
        Self::new(format!("the field {} occurs twice", quoted(field)))
    }

    fn unknown_field(field: &str, expected: &'static [&'static str]) -> Self {
        let known = alternatives(expected);
        Self::new(format!("the receiver knows no field {}; it knows {known}", quoted(field)))
    }

    fn unknown_variant(variant: &str, expected: &'static [&'static str]) -> Self {
        let known = alternatives(expected);
        Self::new(format!("the receiver knows no variant {}; it knows {known}", quoted(variant)))
    }
}

fn alternatives(names: &[&str]) -> String {
    let names: Vec<_> = names.iter().map(|name| quoted(name)).collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

/// What came, in the words of Python.
fn found(unexpected: Unexpected<'_>) -> String {
    match unexpected {
        Unexpected::Bool(value) => (if value { "True" } else { "False" }).to_owned(),
        Unexpected::Unsigned(number) => format!("the int {number}"),
        Unexpected::Signed(number) => format!("the int {number}"),
        Unexpected::Float(number) => format!("the float {number:?}"),
        Unexpected::Char(text) => format!("the str {}", quoted(&text.to_string())),
        Unexpected::Str(text) => format!("the str {}", quoted(text)),
        Unexpected::Bytes(_) => "bytes".to_owned(),
        Unexpected::Unit | Unexpected::Option => "None".to_owned(),
        Unexpected::Seq => "a list".to_owned(),
        Unexpected::Map => "a dict".to_owned(),
        other => other.to_string(),
    }
}
