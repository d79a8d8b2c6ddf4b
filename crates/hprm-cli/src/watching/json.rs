//! Messages as JSON: values are what JSON has for them, and objects with one key where it has nothing.

use hprm::watch::{Sight, Unseen};
use hprm::{Dynamic, DynamicArray};
use hprm_core::Tag;
use serde_json::{Map, Value, json};

use super::summary::Summary;
use super::value::why;

/// How many elements of an array are shown.
const ELEMENTS: usize = 6;

/// A message at a port, before which so many were missed.
pub(super) fn message(port: &str, tag: Option<Tag>, sight: &Sight, missed: u64) -> Value {
    json!({
        "port": port,
        "tag": tag.map(|tag| json!({ "time": tag.time, "microstep": tag.microstep })),
        "sent": sight.at.0,
        "bytes": sight.bytes,
        "missed": missed,
        "value": match &sight.value {
            Ok(value) => of(value),
            Err(Unseen::Pickle { names }) => json!({ "pickle": names }),
            Err(unseen) => json!({ "unseen": why(unseen) }),
        },
    })
}

fn of(value: &Dynamic) -> Value {
    match value {
        Dynamic::None => Value::Null,
        Dynamic::Bool(value) => json!(value),
        Dynamic::Int(number) => match i64::try_from(*number) {
            Ok(number) => json!(number),
            Err(_) => json!({ "int": number.to_string() }),
        },
        Dynamic::Unsigned(number) => json!({ "int": number.to_string() }),
        Dynamic::Float(number) => match number.is_finite() {
            true => json!(number),
            false => json!({ "float": super::value::float(*number) }),
        },
        Dynamic::Str(text) => json!(text),
        Dynamic::Bytes(bytes) => json!({ "bytes": bytes.len() }),
        Dynamic::List(members) | Dynamic::Tuple(members) => members.iter().map(of).collect(),
        Dynamic::Dict(entries) => dict(entries),
        Dynamic::Array(array) => json!({ "array": summary(array) }),
    }
}

/// An object if all keys are texts, and pairs otherwise.
fn dict(entries: &[(Dynamic, Dynamic)]) -> Value {
    let named = entries.iter().map(|(key, value)| match key {
        Dynamic::Str(key) => Some((key.clone(), of(value))),
        _ => None,
    });
    match named.collect::<Option<Map<_, _>>>() {
        Some(object) => Value::Object(object),
        None => {
            let pairs = entries.iter().map(|(key, value)| json!([of(key), of(value)]));
            json!({ "dict": pairs.collect::<Value>() })
        }
    }
}

fn summary(array: &DynamicArray) -> Value {
    let Summary { dtype, shape, range, not_numbers, first, .. } = Summary::of(array, ELEMENTS);
    let number = |text: &String| match text.as_str() {
        "True" => json!(true),
        "False" => json!(false),
        text => serde_json::from_str(text).unwrap_or_else(|_| json!(text)),
    };
    let first: Vec<_> = first.iter().map(number).collect();
    let mut told = json!({ "dtype": dtype, "shape": shape, "first": first, "nan": not_numbers });
    if let Some(range) = range {
        told["min"] = number(&range.min);
        told["max"] = number(&range.max);
        told["mean"] = json!(range.mean);
    }
    told
}

#[cfg(test)]
mod tests {
    use hprm::Array;
    use hprm_core::{ChannelId, PhysicalTime};

    use super::*;

    #[test]
    fn a_message_is_an_object() {
        let value = Dynamic::Dict(vec![
            (Dynamic::Str("n".to_owned()), Dynamic::Float(f64::INFINITY)),
            (Dynamic::Str("a".to_owned()), Dynamic::Array(Array::from(vec![1_u8, 3]).into())),
        ]);
        let tag = Tag { time: 10, microstep: 1 };
        let sight = Sight {
            channel: ChannelId(0),
            tag,
            arrives: None,
            start: PhysicalTime(0),
            at: PhysicalTime(5),
            bytes: 9,
            dropped: 2,
            value: Ok(value),
        };
        let array = json!({ "dtype": "uint8", "shape": [2], "first": [1, 3], "nan": 0, "min": 1, "max": 3, "mean": 2.0 });
        assert_eq!(
            message("camera.image", Some(tag), &sight, 2),
            json!({
                "port": "camera.image",
                "tag": { "time": 10, "microstep": 1 },
                "sent": 5,
                "bytes": 9,
                "missed": 2,
                "value": { "n": { "float": "inf" }, "a": { "array": array } },
            })
        );
        let sight = Sight { value: Err(Unseen::Pickle { names: Some("a.B".to_owned()) }), ..sight };
        assert_eq!(message("p", None, &sight, 0)["value"], json!({ "pickle": "a.B" }));
        assert_eq!(
            of(&Dynamic::Dict(vec![(Dynamic::Int(1), Dynamic::None)])),
            json!({ "dict": [[1, null]] })
        );
    }
}
