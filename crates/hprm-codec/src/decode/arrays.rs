//! Arrays: in one piece for a receiver that wants an array, otherwise element by element.

mod elements;

use std::iter;
use std::sync::Arc;

use serde::de::Visitor;
use serde::de::value::{BorrowedBytesDeserializer, MapDeserializer};

use self::elements::{Cell, Flat};
use super::Walk;
use super::nodes::Want;
use crate::array::elements_in;
use crate::cursor::ArrayHeader;
use crate::element::Dtype;
use crate::error::DecodeError;
use crate::format::{FIELDS, Malformed, NodeKind, Order, SIMPLE};
use crate::memory::Memory;
use crate::slot::{self, Incoming, IncomingArray, Shape};

impl<'a> Walk<'a> {
    /// Reads a value for a receiver that has to know beforehand what comes.
    pub(super) fn announced<V: Visitor<'a>>(
        &mut self,
        visitor: V,
    ) -> Result<V::Value, DecodeError> {
        let start = self.head;
        match self.head.kind()? {
            NodeKind::BackReference => self.repeat(|walk| walk.announced(visitor)),
            NodeKind::Array => {
                self.number(start);
                let array = match Elements::read(self) {
                    Err(error) if self.is_outline && !error.is_malformed() => {
                        // What to send instead is no matter for those that look, and where it is, they see.
                        let text = error.to_string();
                        let text = text.split(" (hint").next().unwrap_or(&text);
                        let why = text.strip_prefix("`value`: ").unwrap_or(text);
                        let entries = iter::once(("an array", why));
                        return visitor.visit_map(MapDeserializer::new(entries));
                    }
                    array => array?,
                };
                let is_copied = array.memory.is_none() || array.needs_copy();
                self.charge(if is_copied { 1 + array.bytes.len() } else { 1 })?;
                let bytes = if array.memory.is_some() { &[] } else { array.bytes };
                let incoming = Incoming::Array(IncomingArray {
                    dtype: array.dtype,
                    shape: array.shape,
                    fortran: array.order == Order::Fortran,
                    memory: array.memory.map(Arc::clone),
                });
                slot::announce(Some(incoming), || {
                    visitor.visit_newtype_struct(BorrowedBytesDeserializer::new(bytes))
                })
            }
            kind => {
                self.head = start;
                let incoming = match kind {
                    NodeKind::List => Some(Incoming::List),
                    NodeKind::Tuple => Some(Incoming::Tuple),
                    _ => None,
                };
                slot::announce(incoming, || visitor.visit_newtype_struct(self))
            }
        }
    }

    /// Reads an array element by element.
    pub(super) fn array<V: Visitor<'a>>(
        &mut self,
        visitor: V,
        want: Want,
    ) -> Result<V::Value, DecodeError> {
        let array = Elements::read(self)?;
        self.charge(array.bytes.len())?;
        let serves = match want {
            Want::Any | Want::Seq | Want::Bytes => true,
            Want::Tuple(len) => array.shape.first() == Some(&len),
            _ => false,
        };
        if array.shape.is_empty() || serves {
            array.check_rows()?;
            let steps = array.steps();
            return if want == Want::Any && array.shape.len() > 1 {
                visitor.visit_map(Flat::new(&array, &steps))
            } else {
                Cell::whole(&array, &steps).visit(visitor)
            };
        }
        let (shape, name) = (&array.shape[..], array.dtype.name());
        let found = format!("a NumPy array of the shape {shape:?} and the dtype {name}");
        Err(DecodeError::mismatch(&visitor, &found))
    }
}

/// The most dimensions that NumPy knows.
const DIMENSIONS: usize = 64;

/// The most rows without elements that are read one by one.
const EMPTY_ROWS: usize = 1 << 10;

/// The elements of an array.
struct Elements<'a> {
    dtype: Dtype,
    order: Order,
    shape: Shape,
    bytes: &'a [u8],
    memory: Option<&'a Arc<dyn Memory>>,
}

impl<'a> Elements<'a> {
    /// Those that come in the head and the parts.
    fn read(walk: &mut Walk<'a>) -> Result<Self, DecodeError> {
        let ArrayHeader { description, order, shape } = walk.head.array_header()?;
        let (bytes, memory) = walk.blob()?;
        let dtype = match description {
            [SIMPLE, name @ ..] => Dtype::of(name).ok_or_else(|| unreadable(name))?,
            [FIELDS, ..] => {
                return Err(DecodeError::new(
                    "its elements have fields, which only Python reads (hint: send one array for each field)",
                ));
            }
            _ => return Err(Malformed("unknown form of a dtype").into()),
        };
        if shape.len() > DIMENSIONS {
            return Err(Malformed("an array of too many dimensions").into());
        }
        let lengths = shape.iter().map(|length| usize::try_from(*length));
        let shape: Shape = lengths.collect::<Result<_, _>>().map_err(|_| MISSHAPEN)?;
        let len = elements_in(&shape).and_then(|count| count.checked_mul(dtype.size()));
        if len != Some(bytes.len()) {
            return Err(MISSHAPEN.into());
        }
        Ok(Self { dtype, order, shape, bytes, memory })
    }

    /// Whether the receiver cannot have the elements in place.
    fn needs_copy(&self) -> bool {
        self.order == Order::Fortran
            || self.dtype == Dtype::Bool
            || self.bytes.as_ptr().align_offset(self.dtype.size().min(8)) != 0
    }

    /// Looks whether there are many more rows than elements: those of a shape such as `(1000000, 0)` are nothing but
    /// numbers in the head.
    fn check_rows(&self) -> Result<(), Malformed> {
        let lengths = self.shape.iter().take_while(|length| **length > 0);
        let rows = lengths.fold(1, |rows: usize, length| rows.saturating_mul(*length));
        if self.bytes.is_empty() && rows > EMPTY_ROWS {
            return Err(Malformed("an array of very many empty rows"));
        }
        Ok(())
    }

    /// How many bytes further on the next element of each dimension is.
    fn steps(&self) -> Shape {
        let mut steps = Shape::from_elem(0, self.shape.len());
        let mut step = self.dtype.size();
        let mut dimension = |at: usize| {
            steps[at] = step;
            step = step.saturating_mul(self.shape[at]);
        };
        match self.order {
            Order::C => (0..self.shape.len()).rev().for_each(&mut dimension),
            Order::Fortran => (0..self.shape.len()).for_each(&mut dimension),
        }
        steps
    }
}

const MISSHAPEN: Malformed = Malformed("an array of another shape than its elements have");

fn unreadable(name: &[u8]) -> DecodeError {
    let name = String::from_utf8_lossy(name);
    let (order, kind) = name.split_at_checked(1).unwrap_or_default();
    let foreign = if cfg!(target_endian = "little") { ">" } else { "<" };
    let swapped = name.replacen(foreign, if foreign == ">" { "<" } else { ">" }, 1);
    if order == foreign && Dtype::of(swapped.as_bytes()).is_some() {
        return DecodeError::new(format!(
            "the elements of the array have the byte order of another machine: the dtype is {name} (hint: send \
             array.astype('{swapped}'))"
        ));
    }
    let hint = match kind.get(..1) {
        Some("M" | "m") => " (hint: send array.view('i8'))",
        Some("f") => " (hint: send array.astype('f4'))",
        _ => "",
    };
    DecodeError::new(format!("Rust has no elements of the array's dtype {name}{hint}"))
}
