//! Shows what Rust makes of encoded values, for tests of other languages that speak the format.
//!
//! Reads lines of JSON, `{"type": "Vec<f64>", "head": "0109...", "parts": ["..."]}` with bytes in hexadecimal, decodes
//! each as a value of that type, and encodes that again. The answer is a line of JSON: what the value is, its head and
//! parts, or an error.
//!
//!     echo '{"type": "u8", "head": "010302", "parts": []}' | cargo run -q -p hprm-codec --example convert

#![allow(clippy::print_stdout, reason = "that is its purpose")]

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Debug;
use std::io;
use std::sync::Arc;

use hprm_codec::{Array, Dynamic, Memory, Transfer, decode, encode};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Pose {
    x: f64,
    label: String,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Scene {
    boxes: Vec<Pose>,
    image: Option<Array<u8>>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Strict {
    x: f64,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
enum Command {
    Stop,
    Drive(f64),
    Turn(f64, i32),
    Goto { x: f64, y: f64 },
}

/// Bytes in one piece, as the crate `serde_bytes` has them.
#[derive(Clone, Debug)]
struct Bytes(Vec<u8>);

impl Serialize for Bytes {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.0)
    }
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;

        impl serde::de::Visitor<'_> for Visitor {
            type Value = Bytes;

            fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                formatter.write_str("bytes")
            }

            fn visit_bytes<E>(self, bytes: &[u8]) -> Result<Bytes, E> {
                Ok(Bytes(bytes.to_vec()))
            }
        }

        deserializer.deserialize_bytes(Visitor)
    }
}

/// What a line asks for.
#[derive(Deserialize)]
struct Request {
    r#type: String,
    head: String,
    parts: Vec<String>,
}

fn main() -> Result<(), Box<dyn Error>> {
    for line in io::stdin().lines() {
        let request: Request = serde_json::from_str(&line?)?;
        println!("{}", answer(&request)?);
    }
    Ok(())
}

/// Calls `convert` for the type of that name.
macro_rules! by_name {
    ($name:expr, $head:expr, $parts:expr; $($type:ty),* $(,)?) => {
        match $name {
            $(stringify!($type) => convert::<$type>($head, $parts),)*
            unknown => Err(format!("no type {unknown}").into()),
        }
    };
}

fn answer(request: &Request) -> Result<Value, Box<dyn Error>> {
    let head = bytes(&request.head)?;
    let mut parts: Vec<Arc<dyn Memory>> = Vec::new();
    for part in &request.parts {
        parts.push(Arc::new(bytes(part)?));
    }
    by_name! {
        request.r#type.as_str(), &head, &parts;
        (), bool, i8, i64, i128, u8, u32, u64, u128, f32, f64, char, String, Bytes, Dynamic,
        Option<f64>, Option<String>, Vec<bool>, Vec<u8>, Vec<i64>, Vec<f64>, Vec<Vec<f64>>, Vec<Command>,
        (i64, String), (f64, f64), [f64; 3], Vec<(u8, u8)>, BTreeMap<String, i64>, BTreeMap<i64, bool>,
        Pose, Vec<Pose>, Scene, Strict, Command,
        Array<bool>, Array<u8>, Array<i16>, Array<u32>, Array<i64>, Array<f32>, Array<f64>, Array<[f64; 2]>,
    }
}

/// Decodes a value and encodes it again.
fn convert<T: Transfer + Debug>(
    head: &[u8],
    parts: &[Arc<dyn Memory>],
) -> Result<Value, Box<dyn Error>> {
    Ok(match decode::<T>(head, parts) {
        Ok(value) => {
            let draft = encode(&value)?;
            let parts: Vec<_> = draft.parts.iter().map(|part| hex(part.bytes())).collect();
            json!({"value": format!("{value:?}"), "head": hex(&draft.head), "parts": parts})
        }
        Err(error) => json!({"error": error.to_string()}),
    })
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn bytes(hex: &str) -> Result<Vec<u8>, Box<dyn Error>> {
    let pairs = hex.as_bytes().chunks(2);
    pairs.map(|pair| Ok(u8::from_str_radix(std::str::from_utf8(pair)?, 16)?)).collect()
}
