//! Values of Rust programs in a logical trace.
//!
//! A value has the digest of what it is in the format of encoded values, which is that of the same value in Python:
//! `hprm-python` and `hprm._digest` make the others. So a trace does not tell in which language a federate is. Values of
//! types that no connection between federates carries cannot be encoded; numbers, texts and arrays have a digest
//! nevertheless, and of others only the name is known.

use std::any::TypeId;
use std::collections::BTreeMap;

use hprm_codec::{Array, Dtype, Dynamic, DynamicArray, Element};

use super::transport::Codec;
use super::value::{Message, Value};
use crate::trace::{Described, Digest, Digester};

/// The most characters of a text that are shown.
const SHOWN: usize = 60;

/// The types whose values can be encoded.
#[derive(Default)]
pub(super) struct Describer(BTreeMap<TypeId, Codec>);

impl Describer {
    /// Learns a type.
    pub(super) fn add(&mut self, codec: Codec) {
        for stored in codec.stored() {
            self.0.insert(stored, codec);
        }
    }

    /// Describes a value.
    pub(super) fn describe(&self, value: &Value) -> Described {
        let known = scalar(value).or_else(|| self.encoded(value)).or_else(|| any_array(value));
        known.unwrap_or_else(|| Described::opaque("value"))
    }

    fn encoded(&self, value: &Value) -> Option<Described> {
        let draft = self.0.get(&value.stored_type()?)?.encode(value)?.ok()?;
        let parts: Vec<_> = draft.parts.into_iter().map(hprm_codec::Source::into_memory).collect();
        let value = hprm_codec::decode::<Dynamic>(&draft.head, &parts).ok()?;
        Some(described(digest(&value), text(&value)))
    }
}

/// The digest of the same value in Python.
fn digest(value: &Dynamic) -> Digest {
    match value {
        Dynamic::None => Digest::of_bytes("none", &[]),
        Dynamic::Bool(truth) => Digest::of_bytes("bool", &[u8::from(*truth)]),
        Dynamic::Int(number) => Digest::of_bytes("int", &bytes(*number)),
        Dynamic::Unsigned(number) => Digest::of_bytes("int", &unsigned_bytes(*number)),
        Dynamic::Float(number) => {
            let number = if number.is_nan() { f64::NAN } else { *number };
            Digest::of_bytes("float", &number.to_le_bytes())
        }
        Dynamic::Str(text) => Digest::of_bytes("str", text.as_bytes()),
        Dynamic::Bytes(bytes) => Digest::of_bytes("bytes", bytes),
        Dynamic::List(all) => members("list", all.iter()),
        Dynamic::Tuple(all) => members("tuple", all.iter()),
        Dynamic::Dict(entries) => members("dict", entries.iter().flat_map(|(key, it)| [key, it])),
        Dynamic::Array(array) => array_digest(array),
    }
}

/// Containers begin with how many they hold; a dict counts its keys and its values.
fn members<'v>(kind: &str, all: impl Iterator<Item = &'v Dynamic>) -> Digest {
    let digests: Vec<_> = all.map(digest).collect();
    let mut digester = Digester::of_kind(kind);
    digester.write(&(digests.len() as u64).to_le_bytes());
    digests.iter().for_each(|digest| digester.write(&digest.0.to_le_bytes()));
    digester.finish()
}

fn array_digest(array: &DynamicArray) -> Digest {
    let mut elements = Digester::of_kind("buffer");
    let memory = array.memory();
    let bytes = memory.bytes();
    match array.dtype() {
        Dtype::F32 | Dtype::C32 => with_one_nan(&mut elements, bytes, |number| {
            f32::from_le_bytes(number).is_nan().then(|| f32::NAN.to_le_bytes())
        }),
        Dtype::F64 | Dtype::C64 => with_one_nan(&mut elements, bytes, |number| {
            f64::from_le_bytes(number).is_nan().then(|| f64::NAN.to_le_bytes())
        }),
        _ => elements.write(bytes),
    }
    let name = format!("array {} {}", array.dtype().name(), tuple(array.shape()));
    let mut digester = Digester::of_kind("object");
    digester.write(&Digest::of_bytes("name", name.as_bytes()).0.to_le_bytes());
    digester.write(&elements.finish().0.to_le_bytes());
    digester.finish()
}

/// All NaNs have the same bits in a digest.
fn with_one_nan<const N: usize>(
    digester: &mut Digester,
    bytes: &[u8],
    nan: impl Fn([u8; N]) -> Option<[u8; N]>,
) {
    let (numbers, _) = bytes.as_chunks::<N>();
    let replaced = |number: &[u8; N]| nan(*number).is_some_and(|nan| nan != *number);
    if numbers.iter().any(replaced) {
        numbers.iter().for_each(|number| digester.write(&nan(*number).unwrap_or(*number)));
    } else {
        digester.write(bytes);
    }
}

/// A shape as Python writes it.
fn tuple(shape: &[usize]) -> String {
    match shape {
        [one] => format!("({one},)"),
        all => format!("({})", all.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// A short text for people, much as Python's values have it.
fn text(value: &Dynamic) -> String {
    match value {
        Dynamic::None => "None".to_owned(),
        Dynamic::Bool(truth) => (if *truth { "True" } else { "False" }).to_owned(),
        Dynamic::Int(number) => number.to_string(),
        Dynamic::Unsigned(number) => number.to_string(),
        Dynamic::Float(number) => format!("{number:?}"),
        Dynamic::Str(text) => {
            let count = text.chars().count();
            let shown: String = text.chars().take(SHOWN).collect();
            if count > SHOWN { format!("{shown:?}... ({count})") } else { format!("{shown:?}") }
        }
        Dynamic::Bytes(bytes) => format!("bytes of {}", bytes.len()),
        Dynamic::List(all) => format!("list of {}", all.len()),
        Dynamic::Tuple(all) => format!("tuple of {}", all.len()),
        Dynamic::Dict(entries) => format!("dict of {}", entries.len()),
        Dynamic::Array(array) => {
            format!("ndarray {} {}", numpy_name(array.dtype()), tuple(array.shape()))
        }
    }
}

/// The long name of a type of elements, as NumPy shows it.
fn numpy_name(dtype: Dtype) -> String {
    let bits = 8 * dtype.size();
    match dtype.name().as_bytes()[1] {
        b'b' => "bool".to_owned(),
        b'i' => format!("int{bits}"),
        b'u' => format!("uint{bits}"),
        b'f' => format!("float{bits}"),
        _ => format!("complex{bits}"),
    }
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
            let sign = if number < 0 { 0xff } else { 0 };
            complement(number.to_le_bytes(), sign, number.unsigned_abs())
        }
    }
}

/// The same of an integer without a sign, if eight bytes are too few.
fn unsigned_bytes(number: u128) -> Vec<u8> {
    complement(number.to_le_bytes(), 0, number)
}

/// Two's complement with as many bytes as the bits of the magnitude and a sign need: up to seventeen.
fn complement(digits: [u8; 16], sign: u8, magnitude: u128) -> Vec<u8> {
    let bits = u128::BITS - magnitude.leading_zeros();
    digits.into_iter().chain([sign]).take((bits / 8 + 1) as usize).collect()
}

/// Describes an array of any type of elements, whether a connection carries it or not.
fn any_array(value: &Value) -> Option<Described> {
    fn array<T: Element>(value: &Value) -> Option<Dynamic>
    where
        DynamicArray: From<Array<T>>,
    {
        Some(Dynamic::Array(value.get::<Array<T>>()?.clone().into()))
    }
    let bytes = array::<u8>(value).or_else(|| array::<bool>(value)).or_else(|| array::<i8>(value));
    let signed =
        || array::<i16>(value).or_else(|| array::<i32>(value)).or_else(|| array::<i64>(value));
    let unsigned =
        || array::<u16>(value).or_else(|| array::<u32>(value)).or_else(|| array::<u64>(value));
    let floats = || array::<f32>(value).or_else(|| array::<f64>(value));
    let complex = || array::<[f32; 2]>(value).or_else(|| array::<[f64; 2]>(value));
    let array = bytes.or_else(signed).or_else(unsigned).or_else(floats).or_else(complex)?;
    Some(described(digest(&array), text(&array)))
}

fn described(digest: Digest, text: String) -> Described {
    Described { digest, text, opaque: false }
}

#[cfg(test)]
mod tests {
    use serde::{Deserialize, Serialize};

    use super::*;

    fn digest_of(value: Value) -> Digest {
        Describer::default().describe(&value).digest
    }

    #[test]
    fn equal_values_have_equal_digests_whatever_their_type() {
        assert_eq!(digest_of(Value::new(7_u8)), digest_of(Value::new(7_i64)));
        assert_eq!(digest_of(Value::new(0.5_f32)), digest_of(Value::new(0.5_f64)));
        assert_eq!(digest_of(Value::new("text")), digest_of(Value::new("text".to_owned())));
        assert_ne!(digest_of(Value::new(1_u8)), digest_of(Value::new(true)));
        assert_ne!(digest_of(Value::new(1_u8)), digest_of(Value::new(1.0)));
        assert_eq!(bytes(u64::MAX.into()), [255, 255, 255, 255, 255, 255, 255, 255, 0]);
        let [one, other] =
            [[1_u8, 2], [1, 3]].map(|it| digest_of(Value::new(Array::from(it.to_vec()))));
        assert_ne!(one, other);
        assert!(Describer::default().describe(&Value::new(vec![1])).opaque);
    }

    #[derive(Clone, Serialize, Deserialize)]
    struct Pose {
        x: f64,
        tags: Vec<(String, Option<i32>)>,
        image: Array<f32>,
    }

    #[test]
    fn a_value_that_travels_has_the_digest_of_what_it_is() {
        let mut describer = Describer::default();
        describer.add(Codec::of::<Pose>());
        describer.add(Codec::of::<(u8, f64)>());
        let pose = |number| Pose {
            x: 0.5,
            tags: vec![("a".to_owned(), Some(number))],
            image: Array::from(vec![1.0, f32::NAN]),
        };
        let described = [1, 1, 2].map(|number| describer.describe(&Value::new(pose(number))));
        assert_eq!(described[0], described[1]);
        assert_ne!(described[0].digest, described[2].digest);
        assert_eq!((described[0].text.as_str(), described[0].opaque), ("dict of 3", false));
        // As Python's `(1, 0.5)`, whatever the numbers are in Rust.
        let tuple = Dynamic::Tuple(vec![Dynamic::Int(1), Dynamic::Float(0.5)]);
        let pair = describer.describe(&Value::new((1_u8, 0.5)));
        assert_eq!((pair.digest, pair.text.as_str()), (digest(&tuple), "tuple of 2"));
    }

    #[test]
    fn an_integer_has_as_many_bytes_as_its_bits_and_its_sign_need() {
        // As `n.to_bytes(n.bit_length() // 8 + 1, "little", signed=True)` of Python, or eight.
        assert_eq!(bytes(i64::MIN.into()), [0, 0, 0, 0, 0, 0, 0, 0x80]);
        assert_eq!(bytes(1 << 63), [0, 0, 0, 0, 0, 0, 0, 0x80, 0]);
        assert_eq!(bytes(-1 << 64), [0, 0, 0, 0, 0, 0, 0, 0, 0xff]);
        assert_eq!(bytes(i128::MAX), [[0xff; 15].as_slice(), &[0x7f]].concat());
        assert_eq!(bytes(i128::MIN), [[0; 15].as_slice(), &[0x80, 0xff]].concat());
        assert_eq!(unsigned_bytes(u128::MAX), [[0xff; 16].as_slice(), &[0]].concat());
    }

    #[test]
    fn integers_that_differ_have_other_digests_however_large_they_are() {
        let mut describer = Describer::default();
        describer.add(Codec::of::<(u128, i128)>());
        let of = |pair: (u128, i128)| describer.describe(&Value::new(pair));
        let described =
            [(u128::MAX, i128::MIN), (1 << 127, i128::MIN), (u128::MAX, i128::MAX)].map(of);
        assert!(described.iter().all(|it| !it.opaque), "{described:?}");
        assert_ne!(described[0].digest, described[1].digest);
        assert_ne!(described[0].digest, described[2].digest);
    }

    #[test]
    fn all_nans_are_one() {
        let odd = f64::from_bits(f64::NAN.to_bits() | 1);
        let of = |number: f64| digest_of(Value::new(Array::from(vec![number, 1.0])));
        assert_eq!(of(odd), of(f64::NAN));
        assert_ne!(of(odd), of(0.0));
    }
}
