"""What puts mutants into code, and what it refuses: `tests/mutants` runs the mutants themselves."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "mutants"))

from mutant import Mutant, Unusable
from schemata import with_mutants

TEXT = """\
struct Held { tag: u64 }

impl Held {
    /// Not a brace: {
    fn later<'a>(&'a self, by: [u8; { 2 + 1 }]) -> u64 {
        let brace = '{';
        let text = r#"fn no() { "} "#;
        self.tag + 1
    }

    fn all(&self) -> impl Iterator<Item = u64> {
        (0..self.tag).filter(|it| it % 2 == 0)
    }

    const fn none(&self) -> bool {
        self.tag == 0
    }
}
"""


def mutant(name: str, old: str, new: str) -> Mutant:
    return Mutant(name, "wrong", "held.rs", old, new)


def test_each_mutant_is_a_body_of_its_function() -> None:
    mutants = [
        (3, mutant("more", "self.tag + 1", "self.tag + 2")),
        (7, mutant("other", "let brace = '{';", "let brace = '}';")),
    ]
    text = with_mutants(TEXT, mutants, "crate::active")
    body = TEXT.split("{ 2 + 1 }]) -> u64 {")[1].split("}\n\n    fn all")[0]
    three, seven = body.replace("tag + 1", "tag + 2"), body.replace("'{'", "'}'")
    chosen = (
        f"match crate::active() {{\n3 => {{ // The mutant more.\n{three}\n}}\n"
        f"7 => {{ // The mutant other.\n{seven}\n}}\n_ => {{\n{body}\n}}\n}}\n"
    )
    assert text.replace(chosen, body) == TEXT


@pytest.mark.parametrize(
    ("old", "refusal"),
    [
        ("self.tag - 1", "bad: its old lines occur 0 times in held.rs, not once"),
        ("self.tag", "bad: its old lines occur 3 times in held.rs, not once"),
        ("struct Held", "bad: its old lines are not within a function"),
        ("-> u64 {\n        let brace", "bad: its old lines are not within a function"),
        ("it % 2 == 0", "bad: its function is `const` or returns `impl`"),
        ("self.tag == 0", "bad: its function is `const` or returns `impl`"),
    ],
)
def test_a_mutant_that_does_not_fit_is_refused(old: str, refusal: str) -> None:
    with pytest.raises(Unusable) as caught:
        with_mutants(TEXT, [(1, mutant("bad", old, "x"))], "crate::active")
    assert str(caught.value).startswith(refusal)


def test_a_mutant_in_a_function_of_the_function_of_another_one_is_refused() -> None:
    text = "fn outer() {\n    fn inner() { one() }\n    two()\n}\n"
    both = [(1, mutant("inner", "one()", "1")), (2, mutant("outer", "two()", "2"))]
    with pytest.raises(Unusable, match=r"^outer: another mutant is in a function of its function$"):
        with_mutants(text, both, "crate::active")


def test_a_text_says_what_is_wrong_where_and_what_finds_it(tmp_path: Path) -> None:
    path = tmp_path / "grant.txt"
    path.write_text("# It is wrong.\ncrates/a.rs model::boards\n-old {\n-}\n+new {}\n")
    read = Mutant.read(path)
    assert read == Mutant(
        "grant", "It is wrong.", "crates/a.rs", "old {\n}", "new {}", "model::boards"
    )
    path.write_text("# It is wrong.\ncrates/a.rs other::boards\n-old\n+new\n")
    with pytest.raises(Unusable, match=r"grant\.txt names no test that looks for faults"):
        Mutant.read(path)
    path.write_text("# It is wrong.\ncrates/a.rs\n+new\n")
    with pytest.raises(Unusable, match=r"grant\.txt lacks the line that says what is wrong"):
        Mutant.read(path)
