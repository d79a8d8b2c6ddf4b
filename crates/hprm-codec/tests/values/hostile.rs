//! Bytes that are no value, or nearly one: each becomes a value or an error, in little memory and time.

#[path = "../common/strange_values.rs"]
mod strange_values;

use std::sync::Arc;

use crate::common::{parts, read, sent};
use hprm_codec::{Array, Dynamic, Memory, decode, encode, format, outline};
use proptest::collection::vec;
use proptest::prelude::*;
use strange_values::{as_values, strange_values};

fn arrays() -> impl Strategy<Value = Dynamic> {
    let shapes = vec(0_usize..4, 0..4);
    (shapes, any::<u8>(), any::<bool>()).prop_map(|(shape, first, large)| {
        let shape = if large { vec![9000, 1] } else { shape };
        let count = shape.iter().product();
        let numbers = (0..count).map(|at: usize| first.wrapping_add(at as u8));
        Dynamic::Array(match first % 4 {
            0 => Array::from_shape_vec(&shape, numbers.map(f64::from).collect()).unwrap().into(),
            1 => Array::from_shape_vec(&shape, numbers.map(|n| n > 9).collect()).unwrap().into(),
            2 => Array::from_shape_vec(&shape, numbers.map(u64::from).collect()).unwrap().into(),
            _ => Array::from_shape_vec(&shape, numbers.collect()).unwrap().into(),
        })
    })
}

/// Any value.
fn values() -> impl Strategy<Value = Dynamic> {
    let leaves = prop_oneof![
        Just(Dynamic::None),
        any::<bool>().prop_map(Dynamic::Bool),
        any::<i64>().prop_map(|number| Dynamic::Int(number.into())),
        any::<i128>().prop_map(Dynamic::Int),
        any::<u128>().prop_map(|number| Dynamic::Unsigned(number | 1 << 127)),
        (-1.0e9..1.0e9).prop_map(Dynamic::Float),
        any::<String>().prop_map(Dynamic::Str),
        vec(any::<u8>(), 0..9).prop_map(Dynamic::Bytes),
        arrays(),
    ];
    leaves.prop_recursive(6, 48, 6, |inner| {
        prop_oneof![
            vec(inner.clone(), 0..6).prop_map(Dynamic::List),
            vec(inner.clone(), 0..6).prop_map(Dynamic::Tuple),
            vec((inner.clone(), inner), 0..4).prop_map(Dynamic::Dict),
        ]
    })
}

/// A change to bytes.
fn change(bytes: &mut Vec<u8>, at: usize, byte: u8, how: u8) {
    let at = at % (bytes.len() + 1);
    match how {
        0 if at < bytes.len() => bytes[at] = byte,
        1 if at < bytes.len() => drop(bytes.remove(at)),
        2 => bytes.insert(at, byte),
        3 => bytes.truncate(at),
        _ => bytes.splice(at..at, [0xff; 8]).for_each(drop),
    }
}

proptest! {
    #[test]
    fn values_return(value in values()) {
        prop_assert_eq!(sent::<Dynamic>(&value), Ok(value));
    }

    #[test]
    fn any_bytes_are_a_value_or_an_error(bytes in vec(prop_oneof![0_u8..24, any::<u8>()], 0..80)) {
        strange_values(&bytes);
        let head: Vec<u8> = std::iter::once(format::DIRECT).chain(bytes).collect();
        if let Err(error) = outline(&head, &[]) {
            prop_assert!(decode::<Dynamic>(&head, &[]).is_err(), "{error}");
        }
    }

    #[test]
    fn changed_values_are_a_value_or_an_error(
        value in values(),
        changes in vec((any::<usize>(), any::<u8>(), 0_u8..5), 1..4),
    ) {
        let draft = encode(&value).unwrap();
        let mut head = draft.head.clone();
        for (at, byte, how) in changes {
            change(&mut head, at, byte, how);
        }
        as_values(&head, &parts(&draft));
    }

    #[test]
    fn a_value_that_is_cut_off_is_malformed(value in values(), at in any::<usize>()) {
        let draft = encode(&value).unwrap();
        let cut = &draft.head[..at % draft.head.len()];
        prop_assert!(decode::<Dynamic>(cut, &parts(&draft)).unwrap_err().is_malformed());
    }
}

/// Lists within lists, each of which refers so many times to the one before it: `[[...], <that>, <that>, ...]`.
fn doubled(depth: u8, references: u8) -> Vec<u8> {
    let mut head = vec![1];
    (0..depth).for_each(|_| head.extend([9, references + 1]));
    head.push(0);
    for level in (0..depth).rev() {
        for _ in 0..references {
            // The innermost list refers to nothing.
            if level + 1 == depth { head.push(0) } else { head.extend([12, level + 1]) }
        }
    }
    head
}

#[test]
fn a_value_that_repeats_itself_does_not_grow_without_bound() {
    assert!(read::<Dynamic>(&doubled(8, 1)).is_ok());
    for (depth, references) in [(60, 1), (12, 100)] {
        let refused = read::<Dynamic>(&doubled(depth, references)).unwrap_err().to_string();
        assert!(refused.ends_with("so often that it would become very large"), "{refused}");
    }
}

#[test]
fn large_parts_are_not_repeated_without_bound() {
    let part: Arc<dyn Memory> = Arc::new(vec![b'a'; 1 << 20]);
    // A list of bytes in a part, and of references to them.
    let mut head = vec![1, 9, 101, 7];
    head.extend([0x81, 0x80, 0x80, 0x01]);
    (0..100).for_each(|_| head.extend([12, 1]));
    let refused = decode::<Dynamic>(&head, &[part]).unwrap_err().to_string();
    assert!(refused.contains("very large"), "{refused}");
}

#[test]
fn an_array_may_occur_as_often_as_there_is_room_for_references() {
    let array = Array::from(vec![1.0_f64; 1 << 17]);
    let many = vec![array; 1000];
    let draft = encode(&many).unwrap();
    assert_eq!(draft.parts.len(), 1);
    let received: Vec<Array<f64>> = decode(&draft.head, &parts(&draft)).unwrap();
    assert!(received.iter().all(|each| each.as_ptr() == many[0].as_ptr()));
}

#[test]
fn lengths_are_not_believed() {
    for head in [
        &[1, 9, 0xff, 0xff, 0xff, 0xff, 0x0f][..],
        &[1, 11, 0xff, 0xff, 0xff, 0xff, 0x0f],
        &[1, 6, 0xfe, 0xff, 0xff, 0xff, 0x0f],
        &[1, 7, 0xff, 0xff, 0xff, 0xff, 0x0f],
        &[1, 19, 16, 0xff, 0xff, 0xff, 0x0f],
        &[2],
        &[1],
        &[],
        &[1, 0, 0],
    ] {
        assert!(read::<Dynamic>(head).unwrap_err().is_malformed());
    }
}
