//! What the classes of Python were made of: objects with named attributes, members of enumerations, and numbers of
//! NumPy.
//!
//! The numbers of the classes are those of `python/hprm/_kinds`, and never change. Most of them only Python reads.

use serde::Deserialize;
use serde::de::Visitor;

use super::Walk;
use super::members::Fields;
use super::nodes::Want;
use crate::error::DecodeError;
use crate::format::{Malformed, NodeKind};

/// An object with attributes: of a dataclass, or a class of attrs.
const INSTANCE: u64 = 16;
/// A named tuple.
const NAMED_TUPLE: u64 = 17;
/// A member of an enumeration.
const MEMBER: u64 = 18;
/// An object of a class of pydantic.
const MODEL: u64 = 20;
/// A number of NumPy: an array without dimensions.
const SCALAR: u64 = 21;
/// A string of NumPy.
const TEXT_SCALAR: u64 = 22;

/// How many parts name a class and its attributes.
const NAMES: usize = 3;

/// Where the attributes of a model are in its state.
const ATTRIBUTES: &str = "__dict__";

/// Where an error says what Rust does not read, by number.
const OTHERS: [&str; 49] = [
    "a str with lone surrogates",
    "a decimal.Decimal",
    "a fractions.Fraction",
    "a datetime.datetime",
    "a datetime.date",
    "a datetime.time",
    "a datetime.timedelta",
    "a datetime.timezone",
    "a zoneinfo.ZoneInfo",
    "a uuid.UUID",
    "a pathlib path",
    "a range",
    "a slice",
    "an ellipsis",
    "a memoryview of a format of its own",
    "an array.array",
    "an object",
    "a named tuple",
    "a member of an enumeration",
    "a combination of flags",
    "a pydantic model",
    "a number of NumPy",
    "a string of NumPy",
    "a NumPy array of objects",
    "a masked NumPy array",
    "a PyTorch tensor",
    "an array of a library that shares memory by DLPack",
    "a pyarrow schema",
    "a pyarrow batch",
    "a pyarrow table",
    "a pyarrow array",
    "a pyarrow chunked array",
    "a pandas frame",
    "a pandas series",
    "a pandas index",
    "a pandas index",
    "a pandas index",
    "a pandas column",
    "a pandas column",
    "a pandas column",
    "a pandas column",
    "a pandas column",
    "a pandas timestamp",
    "a pandas duration",
    "a missing value of pandas",
    "a pyarrow scalar",
    "a pandas column",
    "a pandas column",
    "a time zone of pytz",
];

/// What an object is made of: how, and how many parts follow.
pub(super) struct Code {
    code: u64,
    count: usize,
}

impl Code {
    /// The one that comes in the head.
    pub(super) fn read(walk: &mut Walk<'_>) -> Result<Self, DecodeError> {
        let (code, count) = (walk.head.number()?, walk.head.count()?);
        let least = match code {
            INSTANCE | NAMED_TUPLE | MEMBER | MODEL => NAMES,
            SCALAR | TEXT_SCALAR => 1,
            _ => 0,
        };
        let most = if matches!(code, INSTANCE | NAMED_TUPLE) || least == 0 { count } else { least };
        if (least..=most).contains(&count) {
            Ok(Self { code, count })
        } else {
            Err(Malformed("an object of another number of parts").into())
        }
    }

    pub(super) fn is_member(&self) -> bool {
        self.code == MEMBER
    }

    /// What it is, for people.
    pub(super) fn name(&self) -> &'static str {
        let known = usize::try_from(self.code).ok().and_then(|code| OTHERS.get(code));
        known.copied().unwrap_or("an object of a kind that this version does not know")
    }
}

impl<'a> Walk<'a> {
    /// Reads what an object is made of.
    pub(super) fn object<V: Visitor<'a>>(
        &mut self,
        visitor: V,
        want: Want,
    ) -> Result<V::Value, DecodeError> {
        let code = Code::read(self)?;
        match code.code {
            SCALAR | TEXT_SCALAR => self.node(visitor, want),
            MEMBER if matches!(want, Want::Any | Want::Scalar) => {
                visitor.visit_borrowed_str(self.member()?)
            }
            INSTANCE | NAMED_TUPLE if want.takes_dict() => self.attributes(visitor, code.count),
            NAMED_TUPLE if want.takes_list() => {
                self.skip_all(NAMES)?;
                self.members(visitor, want, code.count - NAMES, "a named tuple")
            }
            MODEL if want.takes_dict() => self.model(visitor),
            _ if self.is_outline => self.outlined(visitor, code.name(), code.count),
            INSTANCE | NAMED_TUPLE | MEMBER | MODEL => {
                Err(DecodeError::mismatch(&visitor, code.name()))
            }
            _ => Err(DecodeError::mismatch(
                &visitor,
                &format!(
                    "{}, which only Python reads (hint: send numbers, strings, lists, dicts, dataclasses or NumPy \
                     arrays)",
                    code.name()
                ),
            )),
        }
    }

    fn attributes<V: Visitor<'a>>(
        &mut self,
        visitor: V,
        count: usize,
    ) -> Result<V::Value, DecodeError> {
        self.skip_all(NAMES - 1)?;
        let names = Vec::<&'a str>::deserialize(&mut *self)
            .map_err(|_| Malformed("an object whose attributes have no names"))?;
        if names.len() != count - NAMES {
            return Err(Malformed("an object of another number of parts").into());
        }
        let mut fields = Fields::new(self, &names);
        let value = visitor.visit_map(&mut fields)?;
        fields.finish()?;
        Ok(value)
    }

    /// The name of an enumeration's member.
    pub(super) fn member(&mut self) -> Result<&'a str, DecodeError> {
        self.skip_all(NAMES - 1)?;
        <&'a str>::deserialize(self)
    }

    fn model<V: Visitor<'a>>(&mut self, visitor: V) -> Result<V::Value, DecodeError> {
        self.skip_all(NAMES - 1)?;
        let start = self.head;
        if self.head.kind()? != NodeKind::Dict {
            return Err(Malformed("a model without a state").into());
        }
        self.enter(start, |walk| {
            let (mut visitor, mut value) = (Some(visitor), None);
            for _ in 0..walk.head.count()? {
                match <&'a str>::deserialize(&mut *walk)? {
                    ATTRIBUTES if let Some(visitor) = visitor.take() => {
                        value = Some(walk.node(visitor, Want::Fields)?);
                    }
                    _ => walk.skip()?,
                }
            }
            Ok(value.ok_or(Malformed("a model without attributes"))?)
        })
    }
}
