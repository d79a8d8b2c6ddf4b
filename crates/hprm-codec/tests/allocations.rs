//! What small values cost: the head, and nothing else.

use allocation_counter::measure;
use hprm_codec::{Array, decode, encode};
use serde::{Deserialize, Serialize};

#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
struct State {
    position: [f64; 3],
    velocity: (f64, f64, f64),
    angle: f64,
    number: u64,
    mode: Mode,
}

#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
enum Mode {
    #[default]
    Idle,
    Following {
        target: u32,
    },
}

/// How many allocations it takes to encode and to decode the value.
fn allocations<T: Serialize + for<'de> Deserialize<'de>>(value: &T) -> (u64, u64) {
    let mut draft = None;
    let encoding = measure(|| draft = Some(encode(value).unwrap()));
    let draft = draft.unwrap();
    let parts: Vec<_> = draft.parts.into_iter().map(|part| part.into_memory()).collect();
    let decoding = measure(|| drop(decode::<T>(&draft.head, &parts).unwrap()));
    (encoding.count_total, decoding.count_total)
}

#[test]
fn a_small_value_costs_one_allocation() {
    assert_eq!(allocations(&u64::MAX), (1, 0));
    assert_eq!(allocations(&(1.0, 2, true)), (1, 0));
    let state = State { mode: Mode::Following { target: 3 }, ..State::default() };
    assert_eq!(allocations(&state), (1, 0));
    // A head of more than 160 bytes grows once.
    assert_eq!(allocations(&(state, [0.5; 8])), (2, 0));
}

#[test]
fn a_large_array_costs_no_copy() {
    let array = Array::from(vec![0.5_f64; 1 << 20]);
    let mut draft = None;
    let encoding = measure(|| draft = Some(encode(&array).unwrap()));
    assert!(encoding.bytes_total < 4096, "{encoding:?}");
    let draft = draft.unwrap();
    let parts: Vec<_> = draft.parts.into_iter().map(|part| part.into_memory()).collect();
    let decoding = measure(|| drop(decode::<Array<f64>>(&draft.head, &parts).unwrap()));
    assert!(decoding.bytes_total < 4096, "{decoding:?}");
}
