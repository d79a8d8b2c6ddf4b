//! Whatever the JSON is, there is an answer: a program, at least one error, or that it is no declaration.

#[path = "common/answers.rs"]
mod answers;
mod common;

use answers::answers;
use proptest::collection::vec;
use proptest::prelude::*;
use serde_json::{Value, json};

/// What takes the place of a piece of a declaration.
fn replacements() -> Vec<Value> {
    let deep = (0..100).fold(json!(1), |inner, _| json!({"list": [inner]}));
    vec![
        Value::Null,
        json!(true),
        json!(0),
        json!(1),
        json!(2),
        json!(-1),
        json!(1_000_000_000),
        json!(i64::MAX),
        json!(i64::MIN),
        json!(u64::MAX),
        json!(0.5),
        json!(""),
        json!("image"),
        json!("a b"),
        json!("x".repeat(300)),
        json!("startup"),
        json!([]),
        json!([0, 0]),
        json!([0, 99, 99, 99]),
        json!(vec![0; 300]),
        json!({}),
        json!({"time": -1}),
        deep,
    ]
}

fn count(value: &Value) -> usize {
    1 + match value {
        Value::Array(items) => items.iter().map(count).sum(),
        Value::Object(entries) => entries.values().map(count).sum(),
        _ => 0,
    }
}

/// The piece with this number, in the order of the text.
fn piece<'v>(value: &'v mut Value, number: &mut usize) -> Option<&'v mut Value> {
    if *number == 0 {
        return Some(value);
    }
    *number -= 1;
    match value {
        Value::Array(items) => items.iter_mut().find_map(|item| piece(item, number)),
        Value::Object(entries) => entries.values_mut().find_map(|item| piece(item, number)),
        _ => None,
    }
}

proptest! {
    #[test]
    fn any_declaration_has_an_answer(changes in vec((any::<usize>(), any::<usize>(), any::<usize>()), 1..6)) {
        let mut document = common::vision();
        let replacements = replacements();
        for (target, origin, kind) in changes {
            let all = count(&document);
            let mut other = origin % all;
            let replacement = match kind % 3 {
                // Another piece of the same declaration.
                0 => piece(&mut document, &mut other).cloned().unwrap_or_default(),
                _ => replacements[origin % replacements.len()].clone(),
            };
            let mut target = target % all;
            if let Some(piece) = piece(&mut document, &mut target) {
                *piece = replacement;
            }
        }
        answers(&document.to_string());
    }

    #[test]
    fn any_text_has_an_answer(start in any::<usize>(), length in 0..40_usize, text in ".{0,20}") {
        let mut document = common::vision().to_string();
        let start = start % document.len();
        let range = start..(start + length).min(document.len());
        if document.is_char_boundary(range.start) && document.is_char_boundary(range.end) {
            document.replace_range(range, &text);
        }
        answers(&document);
    }
}

#[test]
fn reactors_that_share_their_contents_do_not_multiply_without_end() {
    let reactor = |index: usize| {
        let children: Vec<Value> = if index == 0 {
            Vec::new()
        } else {
            let child = |name: &str| json!({"name": name, "at": [0, 1, 0, -1], "members": [index - 1], "bank": false});
            vec![child("a"), child("b")]
        };
        json!({"name": "R", "at": [0, 1, 0, -1], "children": children})
    };
    for (deep, message) in [(40, "more than 2000000"), (300, "more than 200 deep")] {
        let reactors: Vec<Value> = (0..deep).map(reactor).collect();
        let files = json!([{"path": "app.py", "text": "class R: ...\n"}]);
        let document = json!({"files": files, "main": deep - 1, "reactors": reactors});
        assert!(common::errors(&document).contains(message));
    }
}
