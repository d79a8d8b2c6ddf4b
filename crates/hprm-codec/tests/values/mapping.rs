//! What Rust's types are in the format, which node serves for which type, and what errors say.

use std::collections::BTreeMap;

use crate::common::{head, read, refused, sent};
use hprm_codec::encode;
use serde::{Deserialize, Serialize};

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
struct Point {
    x: f64,
    y: f64,
}

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
struct Metres(f64);

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
struct Pair(u8, String);

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
struct Marker;

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
enum Shape {
    Nothing,
    Sphere(f64),
    Line(Point, Point),
    Box { corner: Point, size: u32 },
}

#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
struct Scene {
    name: String,
    #[serde(default)]
    boxes: Vec<Boxed>,
    note: Option<String>,
}

#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
struct Boxed {
    width: u8,
}

/// Sends the value and gets it back.
fn returns<T: Serialize + for<'de> Deserialize<'de> + PartialEq + std::fmt::Debug>(value: T) {
    assert_eq!(sent::<T>(&value), Ok(value));
}

#[test]
fn values_of_all_types_return() {
    returns(());
    returns(Marker);
    returns([true, false]);
    returns((i8::MIN, i16::MIN, i32::MIN, i64::MIN, i128::MIN));
    returns((u8::MAX, u16::MAX, u32::MAX, u64::MAX, u128::MAX, i128::MAX));
    returns((1.5_f32, f64::MIN_POSITIVE, f64::INFINITY));
    returns(('ß', String::from("text"), Some(String::new())));
    returns((None::<u8>, Some(7_u8)));
    returns(vec![vec![1_u64, 2], vec![]]);
    returns(BTreeMap::from([(3, Point { x: 1.0, y: 2.0 })]));
    returns((Metres(1.0), Pair(3, "three".into())));
    returns(vec![
        Shape::Nothing,
        Shape::Sphere(2.0),
        Shape::Line(Point { x: 0.0, y: 0.0 }, Point { x: 1.0, y: 1.0 }),
        Shape::Box { corner: Point { x: 0.0, y: 0.0 }, size: 3 },
    ]);
}

#[test]
fn each_type_has_its_node() {
    assert_eq!(head(&()), [1, 0]);
    assert_eq!(head(&None::<u8>), [1, 0]);
    assert_eq!(head(&true), [1, 2]);
    assert_eq!(head(&-1_i8), [1, 3, 1]);
    assert_eq!(head(&u64::MAX), [1, 4, 18, 255, 255, 255, 255, 255, 255, 255, 255, 0]);
    assert_eq!(head(&(i128::from(i64::MIN) - 1))[..3], [1, 4, 18]);
    assert_eq!(head(&1.0_f32), [1, 5, 0, 0, 0, 0, 0, 0, 240, 63]);
    assert_eq!(head("hé"), [1, 6, 6, b'h', 0xc3, 0xa9]);
    assert_eq!(head(&'h'), [1, 6, 2, b'h']);
    assert_eq!(head(&vec![1_u8, 2]), [1, 9, 2, 3, 2, 3, 4]);
    assert_eq!(head(&(1_u8, false)), [1, 10, 2, 3, 2, 1]);
    assert_eq!(head(&BTreeMap::from([(1, 2)])), [1, 11, 1, 3, 2, 3, 4]);
    assert_eq!(head(&Boxed { width: 1 }), [1, 11, 1, 6, 10, b'w', b'i', b'd', b't', b'h', 3, 2]);
    assert_eq!(head(&Shape::Nothing)[..3], [1, 6, 14]);
    assert_eq!(head(&Shape::Sphere(0.0))[..5], [1, 11, 1, 6, 12]);
}

#[test]
fn the_length_of_a_sequence_may_be_unknown() {
    struct Unknown(u64);

    impl Serialize for Unknown {
        fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
            serializer.collect_seq((0..self.0).filter(|number| number % 2 == 0))
        }
    }

    assert_eq!(sent::<Vec<u64>>(&Unknown(5)).unwrap(), [0, 2, 4]);
    assert_eq!(sent::<Vec<u64>>(&Unknown(1000)).unwrap().len(), 500);
}

#[test]
fn lists_and_tuples_serve_for_one_another() {
    assert_eq!(sent(&vec![1, 2]), Ok((1_u8, 2_u8)));
    assert_eq!(sent(&(1_u8, 2_u8)), Ok(vec![1, 2]));
    assert_eq!(sent(&vec![1, 2]), Ok([1_i64, 2]));
    assert_eq!(
        refused::<(u8, u8)>(&head(&[1, 2, 3])),
        "`value`: expected a tuple of size 2, found a tuple of 3 members"
    );
}

#[test]
fn integers_serve_for_floats_and_not_the_other_way_round() {
    assert_eq!(sent(&7), Ok(7.0_f32));
    assert_eq!(sent(&u64::MAX), Ok(u64::MAX as f64));
    assert_eq!(sent(&i128::MIN), Ok(i128::MIN as f64));
    assert_eq!(refused::<i32>(&head(&1.0)), "`value`: expected i32, found the float 1.0");
    assert_eq!(refused::<f64>(&head(&true)), "`value`: expected f64, found True");
    assert_eq!(refused::<bool>(&head(&1)), "`value`: expected a boolean, found the int 1");
}

#[test]
fn integers_out_of_range_are_errors() {
    assert_eq!(refused::<u8>(&head(&256)), "`value`: expected u8, found the int 256");
    assert_eq!(refused::<u64>(&head(&-1)), "`value`: expected u64, found the int -1");
    assert_eq!(
        refused::<i64>(&head(&u64::MAX)),
        "`value`: expected i64, found the int 18446744073709551615"
    );
    assert_eq!(
        refused::<u64>(&head(&(u128::from(u64::MAX) + 1))),
        "`value`: expected u64, found the int 18446744073709551616"
    );
    assert_eq!(
        refused::<i128>(&head(&u128::MAX)),
        format!("`value`: expected i128, found the int {}", u128::MAX)
    );
    assert_eq!(
        refused::<u128>(&head(&i128::MIN)),
        format!("`value`: expected u128, found the int {}", i128::MIN)
    );
    let huge = [1, 4, 40, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20];
    assert_eq!(refused::<u128>(&huge), "`value`: expected u128, found an int of about 160 bits");
}

#[test]
fn unknown_fields_are_skipped_and_missing_ones_are_told() {
    let entries = BTreeMap::from([("x", 1.0), ("y", 2.0), ("z", 3.0)]);
    assert_eq!(sent(&entries), Ok(Point { x: 1.0, y: 2.0 }));
    assert_eq!(
        refused::<Point>(&head(&BTreeMap::from([("x", 1.0)]))),
        "`value`: the field 'y' is missing"
    );
    assert_eq!(
        sent(&BTreeMap::from([("name", "a")])),
        Ok(Scene { name: "a".into(), ..Scene::default() })
    );
}

#[test]
fn errors_say_where_and_what() {
    let box_of = |width: i64| BTreeMap::from([("width", width)]);
    let boxes = vec![box_of(1), box_of(2), box_of(300)];
    let scene = BTreeMap::from([("boxes", boxes)]);
    assert_eq!(
        refused::<Scene>(&head(&scene)),
        "`value['boxes'][2]['width']`: expected u8, found the int 300"
    );
    assert_eq!(
        refused::<BTreeMap<u8, bool>>(&head(&BTreeMap::from([(1, 2)]))),
        "`value[1]`: expected a boolean, found the int 2"
    );
    assert_eq!(
        refused::<BTreeMap<u8, bool>>(&head(&BTreeMap::from([("a", true)]))),
        "`value{key 'a'}`: expected u8, found the str 'a'"
    );
    assert_eq!(
        refused::<Point>(&head(&(1.0, 2.0))),
        "`value`: expected struct Point, found a tuple"
    );
    assert_eq!(
        refused::<Vec<u8>>(&head("text")),
        "`value`: expected a sequence, found the str 'text'"
    );
    assert_eq!(refused::<String>(&head(&[0; 2])), "`value`: expected a string, found a tuple");
    assert_eq!(refused::<u8>(&head(&vec![0])), "`value`: expected u8, found a list");
    assert_eq!(refused::<u8>(&head(&box_of(1))), "`value`: expected u8, found a dict");
    assert_eq!(
        refused::<Shape>(&head("Square")),
        "`value`: the receiver knows no variant 'Square'; it knows 'Nothing', 'Sphere', 'Line', 'Box'"
    );
    assert_eq!(
        refused::<Shape>(&head(&3)),
        "`value`: expected enum Shape (a variant's name, or {name: contents}), found the int 3"
    );
    assert_eq!(
        refused::<Shape>(&head(&BTreeMap::from([("Sphere", "wide")]))),
        "`value['Sphere']`: expected f64, found the str 'wide'"
    );
}

#[test]
fn a_pickle_is_refused_with_advice() {
    let text = refused::<u8>(&[1, 14, 2, 0, 0]);
    assert!(
        text.starts_with("the value has arrived as a pickle, which only Python can read (hint: "),
        "{text}"
    );
    // `pickle.dumps(decimal.Decimal(1), 5)`.
    let pickle = b"\x80\x05\x95!\x00\x00\x00\x00\x00\x00\x00\x8c\x07decimal\x94\x8c\x07Decimal\x94\x93\x94\x8c\x011\x94\x85\x94R\x94.";
    let blob = [2 * u8::try_from(pickle.len()).unwrap()];
    let text = refused::<u8>(&[&[1, 14], blob.as_slice(), pickle, &[0]].concat());
    assert!(text.starts_with("the value has arrived as a pickle of decimal.Decimal, "), "{text}");
}

#[test]
fn what_occurs_twice_is_read_twice() {
    // {'a': [1], 'b': <the same>, 'c': <the same>}
    let head = [1, 11, 3, 6, 2, b'a', 9, 1, 3, 2, 6, 2, b'b', 12, 1, 6, 2, b'c', 12, 1];
    let read: BTreeMap<String, Vec<u8>> = read(&head).unwrap();
    assert_eq!(read, ["a", "b", "c"].map(|name| (name.to_owned(), vec![1])).into());
}

#[test]
fn what_occurs_first_where_it_is_ignored_is_read_where_it_occurs_again() {
    #[derive(Deserialize)]
    struct Second {
        b: Vec<(u8, u8)>,
    }
    // {'a': [(1, 2)], 'b': [<the tuple>, <the tuple>]}
    let head = [1, 11, 2, 6, 2, b'a', 9, 1, 10, 2, 3, 2, 3, 4, 6, 2, b'b', 9, 2, 12, 2, 12, 2];
    assert_eq!(read::<Second>(&head).unwrap().b, [(1, 2), (1, 2)]);
}

#[derive(Debug, Deserialize)]
struct Nested {
    #[serde(default)]
    inner: Vec<Self>,
}

#[test]
fn a_cycle_is_refused() {
    // value = {'inner': [<value>]}
    let mut head = vec![1, 11, 1, 6, 10];
    head.extend(b"inner");
    head.extend([9, 1, 12, 0]);
    assert_eq!(
        refused::<Nested>(&head),
        "`value['inner'][0]`: the value contains itself, which only Python can receive (hint: send a tree, or a \
         list of nodes that refer to one another by index)"
    );
    assert!(read::<Nested>(&[1, 11, 0]).unwrap().inner.is_empty());
}

#[derive(Serialize, Deserialize)]
struct List(Option<Box<(Self,)>>);

/// So many tuples within one another.
fn nested(depth: usize) -> List {
    (0..depth).fold(List(None), |inner, _| List(Some(Box::new((inner,)))))
}

#[test]
fn nesting_has_a_limit() {
    assert!(sent::<List>(&nested(100)).is_ok());
    let refused = encode(&nested(101)).unwrap_err().to_string();
    assert!(refused.contains("[0]`: it is nested more than 100 deep"), "{refused}");
    let mut head = vec![1];
    (0..101).for_each(|_| head.extend([10, 1]));
    head.push(0);
    assert_eq!(self::refused::<List>(&head), "malformed payload: values nested too deeply");
    // So deep a place is cut.
    let place = "`value[0][0][0][0][0][0]...[0][0][0]`: ";
    assert!(refused.starts_with(place), "{refused}");
}

/// What is within one another without a byte of it.
#[derive(Serialize, Deserialize)]
struct Chain(Option<Box<Self>>);

#[test]
fn options_and_newtypes_within_one_another_have_a_limit() {
    let chain = (0..20_000).fold(Chain(None), |inner, _| Chain(Some(Box::new(inner))));
    let refused = encode(&chain).map(drop).unwrap_err().to_string();
    // Its `drop` goes as deep.
    std::mem::forget(chain);
    assert_eq!(
        refused,
        "`value`: more than 500 options and newtypes are within one another (hint: send a chain as a list)"
    );
    let short = (0..200).fold(Chain(None), |inner, _| Chain(Some(Box::new(inner))));
    assert!(encode(&short).is_ok());
    // A value that the type would take for ever.
    let endless = self::refused::<Chain>(&[1, 3, 2]);
    assert_eq!(
        endless,
        "`value`: the receiver's type has more than 500 options and newtypes within one another here"
    );
}

#[test]
fn a_large_head_is_a_part() {
    let numbers: Vec<u64> = (0..50_000).collect();
    let draft = encode(&numbers).unwrap();
    assert_eq!((draft.head.as_slice(), draft.parts.len()), ([2].as_slice(), 1));
    returns(numbers);
}

#[test]
fn large_text_is_a_part() {
    let text = "ü".repeat(40_000);
    let draft = encode(&(&text, 1)).unwrap();
    assert_eq!(draft.parts.len(), 1);
    assert!(draft.head.len() < 20);
    returns((text, 1));
}

#[test]
fn errors_of_a_value_say_where_it_is() {
    #[derive(Serialize)]
    struct Refuses(#[serde(serialize_with = "refuse")] u8);

    fn refuse<S: serde::Serializer>(_: &u8, _: S) -> Result<S::Ok, S::Error> {
        Err(serde::ser::Error::custom("no"))
    }

    let value = BTreeMap::from([("a", vec![Shape::Nothing])]);
    assert!(encode(&value).is_ok());
    let value = BTreeMap::from([("a", vec![Refuses(1)])]);
    assert_eq!(encode(&value).unwrap_err().to_string(), "`value['a'][0]`: no");
}
