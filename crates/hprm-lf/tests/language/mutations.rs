//! Programs with pieces of others in them, or without some of their own: the same ones on each run.
//!
//! `fuzz/` looks for more with the same function, for as long as one lets it.

#![allow(clippy::disallowed_methods, reason = "the programs of the repository are read from disk")]

use std::ops::Range;
use std::path::Path;

/// How many programs are made of each one.
const ROUNDS: usize = 400;

/// Words that mean something, and numbers that are hard to bear.
const WORDS: [&str; 24] = [
    "{",
    "}",
    "(",
    ")",
    "[",
    "]",
    "{=",
    "=}",
    "\"",
    "'''",
    "->",
    "~>",
    "extends A, B",
    "main",
    "federated",
    "initial mode M {",
    "reset(",
    "new[100000]",
    "9223372036854775807 weeks",
    "input[100000] x",
    "import A from <a/b.lf>",
    "@maxwait(",
    "interleaved(",
    "\0target Python",
];

/// Numbers that are the same on each run (xorshift).
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        usize::try_from(self.0 >> 33).unwrap_or(0) % end.max(1)
    }

    /// A range of `text`, most often a short one.
    fn range(&mut self, text: &[u8]) -> Range<usize> {
        let longest = if self.below(4) == 0 { text.len() } else { 40.min(text.len()) };
        let length = self.below(longest + 1);
        let start = self.below(text.len() - length + 1);
        start..start + length
    }
}

fn mutated(numbers: &mut Numbers, corpus: &[Vec<u8>], program: &[u8]) -> Vec<u8> {
    let mut text = program.to_vec();
    for _ in 0..=numbers.below(4) {
        let range = numbers.range(&text);
        let piece = match numbers.below(6) {
            0 | 1 => Vec::new(),
            2 => text[range.clone()].repeat(2),
            3 => WORDS[numbers.below(WORDS.len())].as_bytes().to_vec(),
            4 => {
                let other = &corpus[numbers.below(corpus.len())];
                other[numbers.range(other)].to_vec()
            }
            _ => vec![u8::try_from(numbers.below(256)).unwrap_or(0)],
        };
        text.splice(range, piece);
    }
    text
}

fn programs(folder: &Path, corpus: &mut Vec<Vec<u8>>) {
    let mut entries: Vec<_> =
        std::fs::read_dir(folder).expect("the folder is there").filter_map(Result::ok).collect();
    entries.sort_by_key(std::fs::DirEntry::path);
    for entry in entries {
        let path = entry.path();
        if path.is_dir() {
            programs(&path, corpus);
        } else if path.extension().is_some_and(|extension| extension == "lf") {
            corpus.push(std::fs::read(&path).expect("it can be read"));
        }
    }
}

#[test]
fn programs_with_changes_are_answered() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut corpus = vec![include_bytes!("fuzz_seed.lf").to_vec()];
    programs(&root.join("../../tests/lf"), &mut corpus);
    programs(&root.join("../../examples"), &mut corpus);
    assert!(corpus.len() >= 5, "the programs of the repository are there");
    let mut numbers = Numbers(0x9E37_79B9_7F4A_7C15);
    for program in &corpus {
        for _ in 0..ROUNDS {
            crate::answers::answers(&mutated(&mut numbers, &corpus, program));
        }
    }
}
