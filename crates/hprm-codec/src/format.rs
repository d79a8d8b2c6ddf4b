//! The bytes of an encoded value: what each node of a head looks like.
//!
//! A head is one byte that says which format it has, then one node. A node is a byte of [`NodeKind`] and
//! what belongs to it. Numbers are LEB128; a blob is its length, times two, plus one if the bytes
//! are the payload's next part rather than here. Containers, byte strings, arrays and what is made of
//! parts are counted as they begin, and [`NodeKind::BackReference`] refers to them by that number. A pickle is
//! a whole value, never inside of one, so that one byte tells whether there is any. `docs/reference/codec.md` specifies it
//! byte by byte.

use hprm_core::NoMemory;

use crate::cursor::Cursor;

/// The bytes are no encoded value; the text says why.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("malformed payload: {0}")]
pub struct Malformed(pub &'static str);

/// The head is right here.
pub const DIRECT: u8 = 1;
/// The head is the payload's last part, because it is too large to travel inside a message.
pub const INDIRECT: u8 = 2;

/// Values nested deeper than this are left to pickle, which has its own limit.
pub const DEPTH_LIMIT: u32 = 100;

/// How many options and newtypes of Rust may be within one another. There is nothing of them in the bytes, so the depth
/// does not bound them.
pub(crate) const LAYER_LIMIT: u32 = 500;

/// How long most heads are, at most.
const USUAL_HEAD: usize = 160;

/// How the description of a dtype begins that is NumPy's short name of it, as `<f4`.
pub const SIMPLE: u8 = 0;
/// How the description of any other dtype begins, as one with fields: JSON that only NumPy understands.
pub const FIELDS: u8 = 2;

/// What a node is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[repr(u8)]
pub enum NodeKind {
    /// `None`.
    None = 0,
    /// `False`.
    False = 1,
    /// `True`.
    True = 2,
    /// An integer of 64 bits: a zigzag number.
    Int = 3,
    /// Any other integer: a blob, little-endian and in two's complement.
    Long = 4,
    /// A float: eight bytes, little-endian.
    Float = 5,
    /// A string: a blob of UTF-8.
    Str = 6,
    /// Bytes: a blob.
    Bytes = 7,
    /// A bytearray: a blob.
    ByteArray = 8,
    /// A list: a number, then as many nodes.
    List = 9,
    /// A tuple: a number, then as many nodes.
    Tuple = 10,
    /// A dict: a number, then as many pairs of nodes, in the order of insertion.
    Dict = 11,
    /// A value that occurred before: its number.
    BackReference = 12,
    /// A NumPy array: a number and as many bytes, which describe the dtype; a byte of [`Order`]; a number and as
    /// many numbers, the lengths of the dimensions; a blob.
    Array = 13,
    /// A pickle: a blob, then a number and as many blobs, the buffers that are out of band.
    Pickle = 14,
    /// A complex number: two floats.
    Complex = 15,
    /// A set: a number, then as many nodes, in the order of their bytes.
    Set = 16,
    /// A frozenset: likewise.
    FrozenSet = 17,
    /// Bytes that are read where they lie: a blob.
    Buffer = 18,
    /// What `hprm._kinds` makes: a number that says how, a number, then as many nodes.
    Reconstructed = 19,
}

impl NodeKind {
    /// The kind of that byte.
    #[inline]
    #[must_use]
    pub fn of(byte: u8) -> Option<Self> {
        const KINDS: [NodeKind; 20] = [
            NodeKind::None,
            NodeKind::False,
            NodeKind::True,
            NodeKind::Int,
            NodeKind::Long,
            NodeKind::Float,
            NodeKind::Str,
            NodeKind::Bytes,
            NodeKind::ByteArray,
            NodeKind::List,
            NodeKind::Tuple,
            NodeKind::Dict,
            NodeKind::BackReference,
            NodeKind::Array,
            NodeKind::Pickle,
            NodeKind::Complex,
            NodeKind::Set,
            NodeKind::FrozenSet,
            NodeKind::Buffer,
            NodeKind::Reconstructed,
        ];
        KINDS.get(usize::from(byte)).copied()
    }
}

/// Which index of an array varies fastest.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[repr(u8)]
pub enum Order {
    /// The last one.
    C = 0,
    /// The first one.
    Fortran = 1,
}

/// The head of a value that is being written. Where there is no memory for it, it says so later, and what
/// is appended is lost.
#[derive(Debug, Default)]
pub struct Head {
    bytes: Vec<u8>,
    /// How long it would have had to be.
    lacks: Option<NoMemory>,
}

impl Head {
    /// An empty one, with room for what most values need.
    #[must_use]
    pub fn new() -> Self {
        Self::with_room(USUAL_HEAD)
    }

    /// An empty one, with room for so many bytes.
    #[must_use]
    pub fn with_room(bytes: usize) -> Self {
        let mut head = Self::default();
        head.reserve(bytes);
        head
    }

    /// Appends a byte.
    #[inline]
    pub fn push(&mut self, byte: u8) {
        if self.bytes.len() < self.bytes.capacity() {
            self.bytes.push(byte);
        } else {
            self.extend_from_slice(&[byte]);
        }
    }

    /// Appends bytes.
    #[inline]
    pub fn extend_from_slice(&mut self, bytes: &[u8]) {
        if bytes.len() <= self.bytes.capacity() - self.bytes.len() || self.reserve(bytes.len()) {
            self.bytes.extend_from_slice(bytes);
        }
    }

    /// Appends the first `len` bytes of an array: all of it, and takes back the others. So many bytes at once are moved
    /// without asking how many.
    #[inline]
    fn extend_from_start<const N: usize>(&mut self, bytes: [u8; N], len: usize) {
        if N <= self.bytes.capacity() - self.bytes.len() {
            let end = self.bytes.len() + len;
            self.bytes.extend_from_slice(&bytes);
            self.bytes.truncate(end);
        } else {
            self.extend_from_slice(&bytes[..len]);
        }
    }

    /// Whether there is memory for so many bytes more.
    fn reserve(&mut self, more: usize) -> bool {
        let is_there = self.bytes.try_reserve(more).is_ok();
        if !is_there {
            self.lacks = Some(NoMemory(self.bytes.len() + more));
            self.bytes = Vec::new();
        }
        is_there
    }

    /// Looks whether there is memory for so many bytes beside it.
    pub fn probe(&mut self, len: usize) {
        if Vec::<u8>::new().try_reserve_exact(len).is_err() {
            self.lacks = Some(NoMemory(self.bytes.len() + len));
        }
    }

    /// What has been written so far.
    #[inline]
    #[must_use]
    pub fn written(&self) -> &[u8] {
        &self.bytes
    }

    /// Whether all of it is there.
    ///
    /// # Errors
    ///
    /// If there was no memory for it.
    #[inline]
    pub fn check(&self) -> Result<(), NoMemory> {
        self.lacks.map_or(Ok(()), Err)
    }

    /// The bytes.
    #[must_use]
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }
}

/// The most bytes that a number has.
const LONGEST: usize = 10;

/// Appends `number`.
#[inline]
pub fn put_number(head: &mut Head, number: u64) {
    if number < 0x80 {
        head.push(number as u8);
    } else {
        let (digits, len) = digits(number);
        head.extend_from_start(digits.to_le_bytes(), len);
    }
}

/// Appends the node of an integer.
#[inline]
pub(crate) fn put_integer(head: &mut Head, number: i64) {
    let (digits, len) = digits(zigzag(number));
    head.extend_from_start((digits << 8 | NodeKind::Int as u128).to_le_bytes(), 1 + len);
}

/// The bytes of a number, the first one lowest, and how many there are.
fn digits(number: u64) -> (u128, usize) {
    let len = (u64::BITS - (number | 1).leading_zeros()).div_ceil(7) as usize;
    // All but the last byte say that another one follows.
    let more = MORE.checked_shr(8 * (9_u32.saturating_sub(len as u32))).unwrap_or(0);
    let ninth = (number >> 56) & 0x7f | if len > 9 { 0x80 } else { 0 };
    let last = ninth | (number >> 63) << 8;
    (u128::from(spread(number) | more) | u128::from(last) << 64, len)
}

/// Inserts `number` at byte `at`: how many entries there are, once they are written.
pub(crate) fn insert_number(head: &mut Head, at: usize, number: u64) {
    let end = head.bytes.len();
    put_number(head, number);
    if let Some(tail) = head.bytes.get_mut(at..).filter(|_| head.lacks.is_none()) {
        tail.rotate_right(tail.len() - (end - at));
    }
}

/// The outermost node of a payload, and the parts that belong to it. `bytes` reads a part.
///
/// # Errors
///
/// If the format is unknown.
pub fn root<'a, P>(
    head: &'a [u8],
    parts: &'a [P],
    bytes: impl FnOnce(&'a P) -> &'a [u8],
) -> Result<(Cursor<'a>, &'a [P]), Malformed> {
    let (node, parts) = match (head, parts) {
        ([DIRECT, node @ ..], parts) => (node, parts),
        ([INDIRECT], [parts @ .., head]) => match bytes(head) {
            [DIRECT, node @ ..] => (node, parts),
            _ => return Err(Malformed("an unknown format")),
        },
        _ => return Err(Malformed("an unknown format")),
    };
    Ok((Cursor::new(node), parts))
}

/// The number at the start of `bytes` and its length, if there is a whole one.
#[must_use]
pub fn number(bytes: &[u8]) -> Option<(u64, usize)> {
    let Some(word) = bytes.first_chunk() else { return number_by_bytes(bytes) };
    let word = u64::from_le_bytes(*word);
    // The lowest bit of those that tell where a number ends.
    match !word & MORE {
        0 => match bytes.get(8..LONGEST) {
            Some([digits @ 0..0x80, _]) => Some((gather(word) | u64::from(*digits) << 56, 9)),
            Some([digits, last @ 0..=1]) => {
                let digits = u64::from(digits & 0x7f) | u64::from(*last) << 7;
                Some((gather(word) | digits << 56, LONGEST))
            }
            _ => number_by_bytes(bytes),
        },
        end => {
            let bits = end.trailing_zeros() + 1;
            Some((gather(word & (u64::MAX >> (64 - bits))), bits as usize / 8))
        }
    }
}

/// In each byte of a word, the bit that says that another byte follows.
const MORE: u64 = 0x8080_8080_8080_8080;

/// The digits that the bytes of a word have, seven bits each: all at once.
#[inline]
fn gather(word: u64) -> u64 {
    let digits = word & !MORE;
    // Pairs of seven bits, then of fourteen, then of twenty-eight.
    let digits = digits & 0x007f_007f_007f_007f | (digits & 0x7f00_7f00_7f00_7f00) >> 1;
    let digits = digits & 0x0000_3fff_0000_3fff | (digits & 0x3fff_0000_3fff_0000) >> 2;
    digits & 0x0fff_ffff | (digits & 0x0fff_ffff_0000_0000) >> 4
}

/// The inverse of [`gather`], for the lowest 56 bits of a number.
#[inline]
fn spread(number: u64) -> u64 {
    let digits = number & 0x0fff_ffff | (number << 4) & 0x0fff_ffff_0000_0000;
    let digits = digits & 0x0000_3fff_0000_3fff | (digits << 2) & 0x3fff_0000_3fff_0000;
    digits & 0x007f_007f_007f_007f | (digits << 1) & 0x7f00_7f00_7f00_7f00
}

fn number_by_bytes(bytes: &[u8]) -> Option<(u64, usize)> {
    let mut number = 0;
    for (at, byte) in bytes.iter().take(LONGEST).enumerate() {
        let digits = u64::from(byte & 0x7f);
        if at == LONGEST - 1 && digits > 1 {
            return None;
        }
        number |= digits << (7 * at);
        if byte & 0x80 == 0 {
            return Some((number, at + 1));
        }
    }
    None
}

/// A signed number as one that is small if it is near zero.
#[inline]
#[must_use]
pub fn zigzag(number: i64) -> u64 {
    ((number << 1) ^ (number >> 63)) as u64
}

/// The inverse of [`zigzag`].
#[inline]
#[must_use]
pub fn unzigzag(number: u64) -> i64 {
    (number >> 1) as i64 ^ -((number & 1) as i64)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn written(number: u64) -> Vec<u8> {
        let mut head = Head::new();
        put_number(&mut head, number);
        head.into_bytes()
    }

    #[test]
    fn a_number_has_a_byte_for_seven_bits() {
        assert_eq!(written(0), [0]);
        assert_eq!(written(0x80), [0x80, 1]);
        assert_eq!(written(300), [0xac, 2]);
        assert_eq!(written(u64::MAX), [[0xff; 9].as_slice(), &[1]].concat());
        assert_eq!(number(&[[0xff; 9].as_slice(), &[2]].concat()), None);
        assert_eq!(number(&[0xff; 20]), None);
    }

    proptest! {
        #[test]
        fn a_number_is_read_as_it_was_written(
            number in any::<u64>(), shift in 0_u32..64, after in prop::collection::vec(any::<u8>(), 0..12),
        ) {
            let number = number >> shift;
            let bytes = written(number);
            let len = bytes.len();
            let bytes = [bytes, after].concat();
            prop_assert_eq!(super::number(&bytes), Some((number, len)));
            prop_assert_eq!(super::number(&bytes[..len - 1]), None);
        }

        #[test]
        fn all_digits_at_once_are_the_same_as_one_by_one(bytes in prop::collection::vec(any::<u8>(), 8..12)) {
            prop_assert_eq!(number(&bytes), number_by_bytes(&bytes));
        }

        #[test]
        fn an_integer_is_a_kind_and_a_number(number in any::<i64>()) {
            let mut head = Head::new();
            put_integer(&mut head, number);
            let bytes = head.into_bytes();
            prop_assert_eq!(bytes[0], NodeKind::Int as u8);
            prop_assert_eq!(&bytes[1..], &written(zigzag(number))[..]);
        }
    }
}
