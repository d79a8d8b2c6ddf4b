//! Whatever the bytes are, they become a value or an error. Shared with the fuzz target in `fuzz/`.

use std::collections::BTreeMap;
use std::sync::Arc;

use hprm_codec::{Array, DecodeError, Dynamic, Memory, decode, encode};
use serde::Deserialize;
use serde::de::IgnoredAny;

/// A type of every shape that the decoder knows, which refers to itself.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
#[allow(dead_code, reason = "it is only decoded")]
struct Everything {
    a: Option<Box<Self>>,
    b: Vec<Self>,
    c: BTreeMap<i8, Self>,
    d: (u8, f32, String),
    e: Option<Choice>,
    f: Array<f32>,
    g: Vec<Vec<f64>>,
    h: (),
}

#[derive(Debug, Deserialize)]
#[allow(dead_code, reason = "it is only decoded")]
enum Choice {
    A,
    B(Box<Everything>),
    C(u8, Vec<Self>),
    D { a: Option<i128> },
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
#[allow(dead_code, reason = "it is only decoded")]
enum Either {
    Number(u8),
    Many(Vec<Self>),
    Array(Array<u8>),
    Named(BTreeMap<String, Self>),
}

/// Decodes the bytes as values of many types; the first one says how many of them are a part.
pub(crate) fn strange_values(bytes: &[u8]) {
    let (len, bytes) = bytes.split_first().map_or((0, bytes), |(len, bytes)| (*len, bytes));
    let (head, part) = bytes.split_at(bytes.len().saturating_sub(usize::from(len)));
    let part: Arc<dyn Memory> = Arc::new(part.to_vec());
    let parts = if len == 0 { vec![] } else { vec![part] };
    as_values(head, &parts);
    // Most starts are not those of a value: as if it had begun right.
    let mut begun = vec![1];
    begun.extend(head);
    as_values(&begun, &parts);
}

/// Decodes a head and its parts as values of many types.
pub(crate) fn as_values(head: &[u8], parts: &[Arc<dyn Memory>]) {
    tells(decode::<Everything>(head, parts));
    tells(decode::<Choice>(head, parts));
    tells(decode::<Either>(head, parts));
    tells(decode::<Vec<Vec<Vec<f32>>>>(head, parts));
    tells(decode::<Array<u16>>(head, parts));
    tells(decode::<(u8, String)>(head, parts));
    tells(decode::<IgnoredAny>(head, parts));
    let decoded = decode::<Dynamic>(head, parts);
    if let Ok(value) = &decoded {
        // NaN is not equal to itself, but its encoding is.
        let again = encode(value).expect("what has been decoded can be encoded");
        let memory: Vec<_> = again.parts.iter().map(|part| part.clone().into_memory()).collect();
        let second: Dynamic = decode(&again.head, &memory).expect("it is a value");
        assert_eq!(encode(&second).expect("likewise").head, again.head);
    }
    tells(decoded);
}

/// An error has a text.
fn tells<T>(decoded: Result<T, DecodeError>) {
    if let Err(error) = decoded {
        assert!(!error.to_string().is_empty());
    }
}
