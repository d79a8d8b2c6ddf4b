//! What a pickle tells of itself without being read by Python: nothing of it is executed.

use std::sync::Arc;

use crate::format::{self, NodeKind};
use crate::memory::Memory;

/// A value that has arrived as a pickle.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Pickle {
    /// The first class or function that it names, as `module.name`: mostly the class of the value.
    pub names: Option<String>,
}

impl Pickle {
    /// The pickle that a payload is; none if it is something else.
    #[must_use]
    pub fn of(head: &[u8], parts: &[Arc<dyn Memory>]) -> Option<Self> {
        let (mut head, _) = format::root(head, parts, |part| part.bytes()).ok()?;
        if head.kind().ok()? != NodeKind::Pickle {
            return None;
        }
        // Where the bytes of the pickle are matters little: a blob that is elsewhere is the first part.
        let here = head.rest();
        let names = first_global(here).or_else(|| first_global(parts.first()?.bytes()));
        Some(Self { names })
    }
}

/// The longest name that is believed.
const NAME: usize = 200;

/// The first two strings of which an opcode makes a class or function, as protocol 4 of `pickle` writes them: each
/// `\x8c`, a length, its bytes and `\x94`, then `\x93`.
fn first_global(pickle: &[u8]) -> Option<String> {
    let end = pickle.len().min(1 << 16);
    (0..end).find_map(|at| {
        let (module, rest) = short_string(&pickle[at..])?;
        let (name, rest) = short_string(rest)?;
        (rest.first() == Some(&0x93)).then(|| format!("{module}.{name}"))
    })
}

/// A short string that is memoized, and what follows it.
fn short_string(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let (text, rest) = match bytes {
        [0x8c, len, rest @ ..] if usize::from(*len) <= NAME => {
            rest.split_at_checked((*len).into())?
        }
        _ => return None,
    };
    let [0x94, rest @ ..] = rest else { return None };
    let text = std::str::from_utf8(text).ok()?;
    let is_name = |it: char| it.is_alphanumeric() || it == '_' || it == '.';
    (!text.is_empty() && text.chars().all(is_name)).then_some((text, rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `pickle.dumps(decimal.Decimal(1), 5)`.
    const DECIMAL: &[u8] = b"\x80\x05\x95!\x00\x00\x00\x00\x00\x00\x00\x8c\x07decimal\x94\x8c\x07Decimal\x94\x93\x94\x8c\x011\x94\x85\x94R\x94.";

    fn payload(pickle: &[u8]) -> Vec<u8> {
        let mut head = vec![format::DIRECT, NodeKind::Pickle as u8];
        // A blob that is here: twice its length.
        head.push(u8::try_from(pickle.len() * 2).unwrap());
        head.extend(pickle);
        head
    }

    #[test]
    fn a_pickle_tells_its_class() {
        let names = Pickle::of(&payload(DECIMAL), &[]).expect("it is one").names;
        assert_eq!(names.as_deref(), Some("decimal.Decimal"));
    }

    #[test]
    fn what_names_nothing_is_still_a_pickle() {
        assert_eq!(Pickle::of(&payload(b"\x80\x05."), &[]), Some(Pickle { names: None }));
        assert_eq!(Pickle::of(&[format::DIRECT, NodeKind::None as u8], &[]), None);
        assert_eq!(Pickle::of(&[], &[]), None);
    }
}
