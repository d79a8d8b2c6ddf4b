//! Which node serves where which type is expected.

use serde::de::{Error as _, Unexpected, Visitor};

use super::Walk;
use super::members::{Items, Numbers, Pairs};
use crate::error::DecodeError;
use crate::format::{self, Malformed, NodeKind};

/// What the receiver's type asks for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Want {
    /// Whatever comes.
    Any,
    /// `None`, a bool or text.
    Scalar,
    /// An integer of at most 64 bits.
    Int,
    /// An `i128`.
    Wide,
    /// A `u128`.
    UnsignedWide,
    /// A floating-point number.
    Float,
    /// Bytes, or a list of them.
    Bytes,
    /// Any number of members.
    Seq,
    /// So many members.
    Tuple(usize),
    /// A struct or a map.
    Fields,
}

impl Want {
    /// Whether a list serves.
    pub(super) fn takes_list(self) -> bool {
        matches!(self, Self::Any | Self::Bytes | Self::Seq | Self::Tuple(_))
    }

    /// Whether a dict serves.
    pub(super) fn takes_dict(self) -> bool {
        matches!(self, Self::Any | Self::Fields)
    }
}

impl<'a> Walk<'a> {
    /// Reads a node for a receiver that wants that.
    pub(super) fn node<V: Visitor<'a>>(
        &mut self,
        visitor: V,
        want: Want,
    ) -> Result<V::Value, DecodeError> {
        self.charge(1)?;
        let start = self.head;
        match self.head.kind()? {
            NodeKind::None => visitor.visit_unit(),
            NodeKind::False => visitor.visit_bool(false),
            NodeKind::True => visitor.visit_bool(true),
            NodeKind::Int => visitor.visit_i64(format::unzigzag(self.head.number()?)),
            NodeKind::Long => self.long(visitor, want),
            NodeKind::Float => visitor.visit_f64(f64::from_le_bytes(self.head.take()?)),
            NodeKind::Str => visitor.visit_borrowed_str(self.text()?),
            NodeKind::Bytes | NodeKind::ByteArray | NodeKind::Buffer => {
                self.number(start);
                self.bytes_for(visitor, want)
            }
            NodeKind::Complex => {
                let [real, imaginary] =
                    [self.head.take()?, self.head.take()?].map(f64::from_le_bytes);
                if !want.takes_list() {
                    return Err(DecodeError::mismatch(&visitor, "a complex number"));
                }
                visitor.visit_seq(Numbers::new([real, imaginary].into_iter()))
            }
            NodeKind::BackReference => self.repeat(|walk| walk.node(visitor, want)),
            NodeKind::Pickle => Err(Malformed("a pickle inside of another value").into()),
            NodeKind::Array => {
                self.number(start);
                self.array(visitor, want)
            }
            kind @ (NodeKind::List | NodeKind::Tuple | NodeKind::Set | NodeKind::FrozenSet) => {
                self.enter(start, |walk| walk.items(visitor, want, kind))
            }
            NodeKind::Dict => self.enter(start, |walk| walk.pairs(visitor, want)),
            NodeKind::Reconstructed => self.enter(start, |walk| walk.object(visitor, want)),
        }
    }

    fn items<V: Visitor<'a>>(
        &mut self,
        visitor: V,
        want: Want,
        kind: NodeKind,
    ) -> Result<V::Value, DecodeError> {
        let name = match kind {
            NodeKind::List => "a list",
            NodeKind::Tuple => "a tuple",
            NodeKind::Set => "a set",
            _ => "a frozenset",
        };
        let count = self.head.count()?;
        self.members(visitor, want, count, name)
    }

    /// Reads so many nodes as members of a list.
    pub(super) fn members<V: Visitor<'a>>(
        &mut self,
        visitor: V,
        want: Want,
        count: usize,
        name: &str,
    ) -> Result<V::Value, DecodeError> {
        if !want.takes_list() {
            return Err(DecodeError::mismatch(&visitor, name));
        }
        if let Want::Tuple(len) = want
            && len != count
        {
            let found = format!("{name} of {count} members");
            return Err(DecodeError::mismatch(&visitor, &found));
        }
        let mut items = Items::new(self, count);
        let value = visitor.visit_seq(&mut items)?;
        items.finish(name)?;
        Ok(value)
    }

    /// Reads a dict.
    pub(super) fn pairs<V: Visitor<'a>>(
        &mut self,
        visitor: V,
        want: Want,
    ) -> Result<V::Value, DecodeError> {
        if !want.takes_dict() {
            return Err(DecodeError::mismatch(&visitor, "a dict"));
        }
        let mut pairs = Pairs::new(self)?;
        let value = visitor.visit_map(&mut pairs)?;
        pairs.finish()?;
        Ok(value)
    }

    fn bytes_for<V: Visitor<'a>>(
        &mut self,
        visitor: V,
        want: Want,
    ) -> Result<V::Value, DecodeError> {
        let bytes = self.bytes()?;
        match want {
            Want::Tuple(len) if len != bytes.len() => {
                let found = format!("bytes of the length {}", bytes.len());
                Err(DecodeError::mismatch(&visitor, &found))
            }
            Want::Seq | Want::Tuple(_) => visitor.visit_seq(Numbers::new(bytes.iter().copied())),
            Want::Any | Want::Bytes => visitor.visit_borrowed_bytes(bytes),
            _ => Err(DecodeError::mismatch(&visitor, "bytes")),
        }
    }

    /// Reads an integer of more than 64 bits, or one that could have been shorter.
    fn long<V: Visitor<'a>>(&mut self, visitor: V, want: Want) -> Result<V::Value, DecodeError> {
        let bytes = self.bytes()?;
        let number = Long::of(bytes);
        if let Some(number) = number.and_then(Long::as_i64) {
            return visitor.visit_i64(number);
        }
        match (number, want) {
            (None, _) => {
                let found = format!("an int of about {} bits", bytes.len().saturating_mul(8));
                Err(DecodeError::mismatch(&visitor, &found))
            }
            (Some(Long::Signed(number)), Want::Float) => visitor.visit_f64(number as f64),
            (Some(Long::Unsigned(number)), Want::Float) => visitor.visit_f64(number as f64),
            (Some(Long::Unsigned(number)), want) => match (u64::try_from(number), want) {
                (Ok(number), _) => visitor.visit_u64(number),
                (Err(_), Want::UnsignedWide) => visitor.visit_u128(number),
                (Err(_), Want::Any | Want::Wide) if i128::try_from(number).is_ok() => {
                    visitor.visit_i128(number as i128)
                }
                (Err(_), Want::Any) => visitor.visit_u128(number),
                _ => Err(too_long(&visitor, &number)),
            },
            (Some(Long::Signed(number)), Want::Any | Want::Wide) => visitor.visit_i128(number),
            (Some(Long::Signed(number)), _) => Err(too_long(&visitor, &number)),
        }
    }
}

fn too_long<'a, V: Visitor<'a>>(visitor: &V, number: &dyn std::fmt::Display) -> DecodeError {
    DecodeError::invalid_value(Unexpected::Other(&format!("the int {number}")), visitor)
}

/// An integer of at most 128 bits.
#[derive(Clone, Copy, Debug)]
enum Long {
    Signed(i128),
    Unsigned(u128),
}

impl Long {
    /// The integer that these bytes are, little-endian and in two's complement.
    fn of(bytes: &[u8]) -> Option<Self> {
        let is_negative = bytes.last().is_some_and(|byte| byte & 0x80 != 0);
        let sign = if is_negative { 0xff } else { 0 };
        let mut digits = [sign; 16];
        let low = bytes.len().min(16);
        digits[..low].copy_from_slice(&bytes[..low]);
        if bytes[low..].iter().any(|byte| *byte != sign) {
            return None;
        }
        if !is_negative {
            return Some(Self::Unsigned(u128::from_le_bytes(digits)));
        }
        let number = i128::from_le_bytes(digits);
        (number < 0).then_some(Self::Signed(number))
    }

    fn as_i64(self) -> Option<i64> {
        match self {
            Self::Signed(number) => i64::try_from(number).ok(),
            Self::Unsigned(number) => i64::try_from(number).ok(),
        }
    }
}
