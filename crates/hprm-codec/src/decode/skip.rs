//! Skips what the receiver has no use for. Its values get their numbers nevertheless.

use super::Walk;
use crate::error::DecodeError;
use crate::format::{Malformed, NodeKind};

impl Walk<'_> {
    /// Skips a node.
    pub(super) fn skip(&mut self) -> Result<(), DecodeError> {
        self.charge(1)?;
        let start = self.head;
        match self.head.kind()? {
            NodeKind::None | NodeKind::False | NodeKind::True => {}
            NodeKind::Int => {
                self.head.number()?;
            }
            NodeKind::Float => {
                self.head.take::<8>()?;
            }
            NodeKind::Complex => {
                self.head.take::<16>()?;
            }
            NodeKind::Long | NodeKind::Str => {
                self.blob()?;
            }
            NodeKind::Bytes | NodeKind::ByteArray | NodeKind::Buffer => {
                self.number(start);
                self.blob()?;
            }
            NodeKind::BackReference => {
                let number = self.head.number()?;
                if !usize::try_from(number).is_ok_and(|number| number < self.seen.len()) {
                    return Err(Malformed("a reference to nothing").into());
                }
            }
            NodeKind::Pickle => return Err(Malformed("a pickle inside of another value").into()),
            NodeKind::Array => {
                self.number(start);
                self.head.array_header()?;
                self.blob()?;
            }
            NodeKind::List | NodeKind::Tuple | NodeKind::Set | NodeKind::FrozenSet => {
                self.enter(start, |walk| {
                    let count = walk.head.count()?;
                    walk.skip_all(count)
                })?;
            }
            NodeKind::Dict => {
                self.enter(start, |walk| {
                    let count = walk.head.count()?;
                    walk.skip_all(count.saturating_mul(2))
                })?;
            }
            NodeKind::Reconstructed => {
                self.enter(start, |walk| {
                    walk.head.number()?;
                    let count = walk.head.count()?;
                    walk.skip_all(count)
                })?;
            }
        }
        Ok(())
    }

    /// Skips so many nodes.
    pub(super) fn skip_all(&mut self, count: usize) -> Result<(), DecodeError> {
        (0..count).try_for_each(|_| self.skip())
    }
}
