//! The example of `docs/reference/codec.md` is what it says.

use std::fs;

use crate::common::{head, read};
use hprm_codec::{Array, Dynamic};
use serde::{Deserialize, Serialize};

#[derive(PartialEq, Debug, Serialize, Deserialize)]
struct Example {
    size: (u8, i8),
    ok: (bool, Option<u8>),
    same: Vec<i64>,
    scan: Array<f32>,
}

/// The bytes of the table below the heading.
fn documented() -> Vec<u8> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/reference/codec.md");
    let text = fs::read_to_string(path).unwrap();
    let (_, section) = text.split_once("## An example").unwrap();
    let (section, _) = section.split_once("\n## ").unwrap();
    let rows = section.lines().filter_map(|line| line.strip_prefix("| `"));
    let bytes = rows.flat_map(|row| row.split('`').next().unwrap().split(' '));
    bytes.map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
}

#[test]
fn the_example_of_the_document_is_that_value() {
    let example = Example {
        size: (3, -1),
        ok: (true, None),
        same: vec![3, -1],
        scan: Array::from_shape_vec(&[1, 2], vec![1.0, 2.5]).unwrap(),
    };
    assert_eq!(read(&documented()), Ok(example));
}

#[test]
fn rust_writes_the_same_except_for_what_occurs_twice() {
    let example: Dynamic = read(&documented()).unwrap();
    let mut expected = documented();
    let reference = expected.windows(2).position(|bytes| bytes == [12, 1]).unwrap();
    expected.splice(reference..reference + 2, [9, 2, 3, 6, 3, 1]);
    assert_eq!(head(&example), expected);
}
