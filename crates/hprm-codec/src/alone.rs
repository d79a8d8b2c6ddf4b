//! A small array that is the whole value: it takes a short way, and its bytes are those of the long one.
//!
//! Serde has an array pass by a slot of the thread, with a handle of its memory. What is small is copied all the same, so
//! here its bytes and its shape are written and read at once. Whatever is unusual goes the long way.

use std::any::Any;

use hprm_core::limits::INLINE_LIMIT;

use crate::array::{Array, elements_in};
use crate::cursor::{Blob, Cursor};
use crate::element::Element;
use crate::format::{DIRECT, Head, NodeKind, Order, SIMPLE, put_number};
use crate::memory::Draft;
use crate::slot::Shape;

/// The most dimensions that go the short way, and the most bytes that a head has then beside those of the elements.
const DIMENSIONS: usize = 4;
const BESIDE: usize = 64;

const ARRAY: u8 = NodeKind::Array as u8;
const ORDER: u8 = Order::C as u8;

/// Does something for each type of elements. The compiler knows which of them a value has, so none is looked for.
macro_rules! each_element {
    ($try:ident) => {
        $try!(u8 i8 u16 i16 u32 i32 u64 i64 f32 f64 [f32; 2] [f64; 2] bool)
    };
}

/// The draft of a value that is a small array and nothing else; none of all others.
pub(crate) fn encode<T: 'static>(value: &T) -> Option<Draft> {
    let value: &dyn Any = value;
    macro_rules! attempt {
        ($($element:ty)*) => {$(
            if let Some(array) = value.downcast_ref::<Array<$element>>() {
                return draft(array);
            }
        )*};
    }
    each_element!(attempt);
    None
}

/// The value, if it is an array and nothing else, and its bytes are those of a small one; none in all other cases.
pub(crate) fn decode<T: 'static>(head: &[u8]) -> Option<T> {
    let mut made: Option<T> = None;
    let place: &mut dyn Any = &mut made;
    macro_rules! attempt {
        ($($element:ty)*) => {$(
            if let Some(array) = place.downcast_mut::<Option<Array<$element>>>() {
                *array = received(head);
                return made;
            }
        )*};
    }
    each_element!(attempt);
    made
}

fn draft<T: Element>(array: &Array<T>) -> Option<Draft> {
    let (bytes, shape) = (array.bytes(), array.shape());
    if bytes.len() > INLINE_LIMIT - BESIDE || shape.len() > DIMENSIONS {
        return None;
    }
    let name = T::DTYPE.name().as_bytes();
    let mut head = Head::with_room(BESIDE + bytes.len());
    head.extend_from_slice(&[DIRECT, ARRAY, name.len() as u8 + 1, SIMPLE]);
    head.extend_from_slice(name);
    head.extend_from_slice(&[ORDER, shape.len() as u8]);
    shape.iter().for_each(|length| put_number(&mut head, *length as u64));
    put_number(&mut head, (bytes.len() as u64) << 1);
    head.extend_from_slice(bytes);
    head.check().ok()?;
    Some(Draft { head: head.into_bytes(), parts: Vec::new() })
}

fn received<T: Element>(head: &[u8]) -> Option<Array<T>> {
    let name = T::DTYPE.name().as_bytes();
    let [DIRECT, ARRAY, described, SIMPLE, rest @ ..] = head else { return None };
    let [ORDER, dimensions, rest @ ..] = rest.strip_prefix(name)? else { return None };
    if usize::from(*described) != name.len() + 1 || usize::from(*dimensions) > DIMENSIONS {
        return None;
    }
    let mut node = Cursor::new(rest);
    let mut shape = Shape::new();
    for _ in 0..*dimensions {
        shape.push(usize::try_from(node.number().ok()?).ok()?);
    }
    let Ok(Blob::Inline(bytes)) = node.blob() else { return None };
    let len = elements_in(&shape)?.checked_mul(size_of::<T>())?;
    if len != bytes.len() || !node.rest().is_empty() {
        return None;
    }
    Some(Array::of(shape, T::copy(bytes)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn both_ways<T: Element + std::fmt::Debug>(elements: Vec<T>) -> Result<(), TestCaseError> {
        let len = elements.len();
        for shape in [vec![len], vec![1, len], vec![len, 1, 1, 1]] {
            let array = Array::from_shape_vec(&shape, elements.clone()).unwrap();
            let long = crate::encode(&array).unwrap();
            let short = encode(&array).unwrap();
            prop_assert_eq!(&short.head, &long.head);
            prop_assert!(short.parts.is_empty() && long.parts.is_empty());
            prop_assert_eq!(decode(&short.head), Some(array.clone()));
            prop_assert_eq!(crate::decode(&short.head, &[]), Ok(array));
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn both_ways_lead_to_the_same_bytes_and_back(
            bytes in prop::collection::vec(any::<u8>(), 0..300),
            words in prop::collection::vec(any::<i32>(), 0..300),
            bits in prop::collection::vec(any::<bool>(), 0..300),
        ) {
            both_ways(bytes)?;
            both_ways(words.iter().map(|word| f64::from(*word)).collect())?;
            both_ways(words.iter().map(|word| [*word as f32, 0.5]).collect())?;
            both_ways(words)?;
            both_ways(bits)?;
        }

        #[test]
        fn what_the_short_way_reads_the_long_one_reads_too(
            len in 0_usize..20, at in 0_usize..40, byte in any::<u8>(),
        ) {
            let mut head = crate::encode(&Array::from(vec![7_u16; len])).unwrap().head;
            if let Some(place) = head.get_mut(at) {
                *place = byte;
            } else {
                head.push(byte);
            }
            if let Some(array) = decode::<Array<u16>>(&head) {
                prop_assert_eq!(crate::decode::<Array<u16>>(&head, &[]), Ok(array));
            }
        }
    }

    #[test]
    fn what_is_large_or_no_array_goes_the_long_way() {
        assert!(encode(&Array::from(vec![0_u8; INLINE_LIMIT])).is_none());
        assert!(encode(&Array::filled(&[1; DIMENSIONS + 1], 0_u8)).is_none());
        assert!(encode(&7_u8).is_none());
        assert_eq!(decode::<u8>(&crate::encode(&7_u8).unwrap().head), None);
        let bytes = crate::encode(&Array::from(vec![1_u8])).unwrap().head;
        assert_eq!(decode::<Array<i8>>(&bytes), None);
    }
}
