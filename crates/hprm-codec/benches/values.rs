//! What it takes to encode and decode small values, in nanoseconds: `cargo bench -p hprm-codec`.

#![allow(clippy::print_stdout, clippy::disallowed_methods, reason = "it measures, and prints")]

use std::hint::black_box;
use std::time::Instant;

use hprm_codec::{Array, decode, encode};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Eight numbers with names.
#[derive(Serialize, serde::Deserialize)]
struct State {
    x: f64,
    y: f64,
    z: f64,
    roll: f64,
    pitch: f64,
    yaw: f64,
    speed: f64,
    turn: f64,
}

/// How many calls are timed at once: so few that most of these times see no other program.
const CALLS: u32 = 200;

/// The least time of one call.
fn time(mut call: impl FnMut()) -> f64 {
    let round = |_| {
        let start = Instant::now();
        (0..CALLS).for_each(|_| call());
        start.elapsed().as_nanos() as f64 / f64::from(CALLS)
    };
    (0..10_000).map(round).fold(f64::INFINITY, f64::min)
}

fn measure<T: Serialize + DeserializeOwned>(name: &str, value: &T) {
    let draft = encode(value).expect("it can be encoded");
    let encoding = time(|| drop(black_box(encode(black_box(value)))));
    let decoding = time(|| drop(black_box(decode::<T>(black_box(&draft.head), &[]))));
    println!("{name:24} encode {encoding:6.1} ns   decode {decoding:6.1} ns");
}

fn main() {
    measure("u64", &1_000_000_u64);
    measure("(f64, f64, f64)", &(1.0, 2.0, 3.0));
    let (x, y, z, roll, pitch, yaw, speed, turn) = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0);
    measure("struct of 8 f64", &State { x, y, z, roll, pitch, yaw, speed, turn });
    measure("String of 20", &"x".repeat(20));
    measure("Vec<f64> of 100", &vec![0.5; 100]);
    measure("Array<f64> of 100", &Array::from(vec![0.5; 100]));
}
