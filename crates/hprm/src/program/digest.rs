//! Values of Rust programs in a logical trace.
//!
//! Numbers, texts and arrays have the digests of their contents, numbers and texts the same ones as in Python. Of other
//! types only the name is known: a trace tells that there was a value, but not which.

use hprm_codec::{Array, Element};

use super::value::{Message, Value};
use crate::trace::{Described, Digest};

/// Describes a value.
pub(super) fn describe(value: &Value) -> Described {
    scalar(value)
        .or_else(|| array::<u8>(value))
        .or_else(|| array::<u16>(value))
        .or_else(|| array::<i16>(value))
        .or_else(|| array::<i32>(value))
        .or_else(|| array::<i64>(value))
        .or_else(|| array::<f32>(value))
        .or_else(|| array::<f64>(value))
        .unwrap_or_else(|| Described::opaque("value"))
}

fn scalar(value: &Value) -> Option<Described> {
    if value.get::<()>().is_some() {
        return Some(described(Digest::of_bytes("none", &[]), "None".to_owned()));
    }
    if let Some(truth) = value.get::<bool>() {
        let text = if *truth { "True" } else { "False" };
        return Some(described(Digest::of_bytes("bool", &[u8::from(*truth)]), text.to_owned()));
    }
    if let Some(number) = float(value) {
        let number = if number.is_nan() { f64::NAN } else { number };
        return Some(described(
            Digest::of_bytes("float", &number.to_le_bytes()),
            format!("{number:?}"),
        ));
    }
    if let Some(number) = integer(value) {
        return Some(described(Digest::of_bytes("int", &bytes(number)), number.to_string()));
    }
    let text = value.get::<String>().map(String::as_str);
    let text = text.or_else(|| value.get::<&'static str>().copied())?;
    Some(described(Digest::of_bytes("str", text.as_bytes()), format!("{text:?}")))
}

fn float(value: &Value) -> Option<f64> {
    value.get::<f64>().copied().or_else(|| value.get::<f32>().map(|number| f64::from(*number)))
}

fn integer(value: &Value) -> Option<i128> {
    fn of<N: Message + Copy + TryInto<i128>>(value: &Value) -> Option<i128> {
        value.get::<N>().and_then(|number| (*number).try_into().ok())
    }
    let signed = of::<i64>(value).or_else(|| of::<i32>(value)).or_else(|| of::<i16>(value));
    let signed = signed.or_else(|| of::<i8>(value)).or_else(|| of::<isize>(value));
    let unsigned = || of::<u64>(value).or_else(|| of::<u32>(value)).or_else(|| of::<u16>(value));
    signed.or_else(unsigned).or_else(|| of::<u8>(value)).or_else(|| of::<usize>(value))
}

/// The bytes of an integer as Python counts them: eight, or as many as it needs.
fn bytes(number: i128) -> Vec<u8> {
    match i64::try_from(number) {
        Ok(number) => number.to_le_bytes().to_vec(),
        Err(_) => {
            let bits = i128::BITS - number.unsigned_abs().leading_zeros();
            number.to_le_bytes()[..=(bits / 8) as usize].to_vec()
        }
    }
}

fn array<T: Element>(value: &Value) -> Option<Described> {
    let array = value.get::<Array<T>>()?;
    let text = format!("array {} {:?}", std::any::type_name::<T>(), array.shape());
    let mut bytes = text.clone().into_bytes();
    bytes.push(0);
    bytes.extend_from_slice(array.memory().bytes());
    Some(described(Digest::of_bytes("array", &bytes), text))
}

fn described(digest: Digest, text: String) -> Described {
    Described { digest, text, opaque: false }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_have_equal_digests_whatever_their_type() {
        let digest = |value: Value| describe(&value).digest;
        assert_eq!(digest(Value::new(7_u8)), digest(Value::new(7_i64)));
        assert_eq!(digest(Value::new(0.5_f32)), digest(Value::new(0.5_f64)));
        assert_eq!(digest(Value::new("text")), digest(Value::new("text".to_owned())));
        assert_ne!(digest(Value::new(1_u8)), digest(Value::new(true)));
        assert_ne!(digest(Value::new(1_u8)), digest(Value::new(1.0)));
        assert_eq!(bytes(u64::MAX.into()), [255, 255, 255, 255, 255, 255, 255, 255, 0]);
        assert_ne!(
            digest(Value::new(Array::from(vec![1_u8, 2]))),
            digest(Value::new(Array::from(vec![1_u8, 3])))
        );
        assert!(describe(&Value::new(vec![1])).opaque);
    }
}
