"""Puts all mutants into a text in Rust, of which the program chooses one when it runs.

So all of them are compiled together, once. A function in which there are mutants gets a body for
each of them besides its own; `mutants::active()`, which `CHOICE` is, says which of them runs.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from mutant import Mutant, Unusable

CHOICE = """
/// Which mutant the program is: what the variable HPRM_MUTANT says, or none of them.
pub mod mutants {
    extern crate std;

    static ACTIVE: std::sync::OnceLock<u32> = std::sync::OnceLock::new();

    /// Its number, or zero.
    #[inline]
    pub fn active() -> u32 {
        *ACTIVE.get_or_init(|| {
            std::env::var("HPRM_MUTANT").map_or(0, |it| it.parse().expect("a number"))
        })
    }
}
"""

# What is no code: comments, texts, characters. A lifetime is no character.
_OPAQUE = re.compile(
    r"""//[^\n]* | /\*.*?\*/ | r(\#*)".*?"\1 | "(?:[^"\\]|\\.)*" | '(?:[^'\\\n]|\\[^\n]+?)'""",
    re.VERBOSE | re.DOTALL,
)
_FUNCTION = re.compile(r"\bfn\s+\w+")
_BEFORE = re.compile(r"\bconst\s+(?:unsafe\s+)?$")


class _Function:
    """Where the body of a function is, without its braces, and whether it can have several."""

    def __init__(self, begin: int, end: int, has_one_body: bool) -> None:
        self.begin, self.end, self.has_one_body = begin, end, has_one_body


def with_mutants(text: str, mutants: Sequence[tuple[int, Mutant]], active: str) -> str:
    """Return a text with these mutants, each with its number.

    ``active`` is the path of the function that says which of them is chosen.
    """
    functions = list(_functions(text))
    bodies: dict[int, tuple[_Function, list[tuple[int, Mutant]]]] = {}
    for number, mutant in mutants:
        function = _around(functions, text, mutant)
        bodies.setdefault(function.begin, (function, []))[1].append((number, mutant))
    begins_after = len(text)
    # From the last one on, so that the places of the others stay right.
    for _, (function, inside) in sorted(bodies.items(), reverse=True):
        if function.end > begins_after:
            raise Unusable(f"{inside[0][1].name}: another mutant is in a function of its function")
        begins_after = function.begin
        text = _with_bodies(text, function, inside, active)
    return text


def _around(functions: list[_Function], text: str, mutant: Mutant) -> _Function:
    """Return the innermost function in which the lines of a mutant are."""
    count = text.count(mutant.old)
    if count != 1:
        raise Unusable(
            f"{mutant.name}: its old lines occur {count} times in {mutant.file}, not once"
        )
    begin = text.index(mutant.old)
    end = begin + len(mutant.old)
    around = [it for it in functions if it.begin <= begin and end <= it.end]
    if not around:
        raise Unusable(f"{mutant.name}: its old lines are not within a function")
    function = max(around, key=lambda it: it.begin)
    if function.has_one_body:
        raise Unusable(
            f"{mutant.name}: its function is `const` or returns `impl`, so it cannot have another"
            " body: move the lines that it replaces into a function of their own"
        )
    return function


def _with_bodies(
    text: str, function: _Function, mutants: list[tuple[int, Mutant]], active: str
) -> str:
    body = text[function.begin : function.end]
    arms = [
        f"{number} => {{ // The mutant {it.name}.\n{body.replace(it.old, it.new)}\n}}\n"
        for number, it in mutants
    ]
    chosen = f"match {active}() {{\n{''.join(arms)}_ => {{\n{body}\n}}\n}}\n"
    return text[: function.begin] + chosen + text[function.end :]


def _functions(text: str) -> Iterator[_Function]:
    """Find the functions that have bodies."""
    code = _OPAQUE.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)
    ends = _closing(code)
    for found in _FUNCTION.finditer(code):
        depth = 0
        for at in range(found.end(), len(code)):
            depth += (code[at] in "([") - (code[at] in ")]")
            if depth == 0 and code[at] in "{;":
                break
        if code[at] == "{":
            signature = code[found.end() : at]
            has_one_body = "-> impl " in signature or bool(_BEFORE.search(code, 0, found.start()))
            yield _Function(at + 1, ends[at], has_one_body)


def _closing(code: str) -> dict[int, int]:
    """Return for each opening brace where it is closed."""
    closing, opened = {}, []
    for at, character in enumerate(code):
        if character == "{":
            opened.append(at)
        elif character == "}":
            closing[opened.pop()] = at
    return closing
