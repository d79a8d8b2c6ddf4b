//! Bodies without an end: how they are detected, and where the program text goes on behind one.
//!
//! The scanner of [`body`](crate::body) would take the `=}` of the next body for the end. But `{=` is
//! no Python outside of strings and comments, so a `{=` inside a body shows that the body should have ended
//! before it.

/// Words that begin a line of the language and no statement of Python.
const WORDS: [&str; 17] = [
    "action",
    "const",
    "federated",
    "initial",
    "input",
    "logical",
    "main",
    "method",
    "mode",
    "mutable",
    "output",
    "physical",
    "preamble",
    "reaction",
    "reactor",
    "state",
    "timer",
];

/// Where the language goes on behind the body that starts at `start` and has no end before `limit`:
/// at a word or a brace that is no Python.
///
/// `is_code` tells for an offset whether the character there is outside of strings, comments and
/// brackets.
pub(crate) fn resume(
    text: &str,
    start: usize,
    limit: usize,
    is_code: impl Fn(usize) -> bool,
) -> usize {
    let mut at = start;
    for line in text[start..limit].split_inclusive('\n') {
        let indent = line.len() - line.trim_start().len();
        let here = at + indent;
        let rest = line.trim();
        // The line of `{=` is the body's own.
        let is_first = at == start;
        at += line.len();
        if is_first || rest.is_empty() || !is_code(here) {
            continue;
        }
        if let Some(behind) = closing_brace(rest) {
            return match closes_the_body(&text[here + behind..]) {
                true => here + behind,
                false => here,
            };
        }
        if starts_member(rest) || joins(rest) {
            return here;
        }
    }
    // The line of the next body is not this one's.
    text[start..limit].rfind('\n').map_or(limit, |end| start + end + 1)
}

/// The length of what was perhaps meant to be `=}`, at the start of a line.
fn closing_brace(line: &str) -> Option<usize> {
    if line.starts_with('}') {
        return Some(1);
    }
    let behind = line.strip_prefix('=')?.trim_start();
    behind.starts_with('}').then(|| line.len() - behind.len() + 1)
}

/// Whether a brace closes the body, not the reactor around it: more of the reactor follows.
fn closes_the_body(behind: &str) -> bool {
    let next = behind.trim_start();
    let top = ["reactor", "main", "federated", "import", "@"];
    !next.is_empty() && !top.iter().any(|word| next.starts_with(word))
}

/// Whether a line is an instantiation or a connection.
fn joins(line: &str) -> bool {
    let function = line.starts_with("def ") || line.starts_with("async ");
    line.contains("= new ") || (line.contains("->") && !function)
}

/// Whether a line starts with a word of the language, and goes on as its statements do.
fn starts_member(line: &str) -> bool {
    let end = line.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(line.len());
    let (word, rest) = line.split_at(end);
    let rest = rest.trim_start();
    // `input = 1` and `state.x` are Python.
    let goes_on = rest.starts_with(|c: char| c.is_ascii_alphabetic() || "([{_".contains(c));
    let python = rest.starts_with(['(', '[']) && !matches!(word, "reaction" | "reactor")
        || ["in ", "is ", "and ", "or ", "not ", "if "].iter().any(|op| rest.starts_with(op));
    WORDS.contains(&word) && goes_on && !python
}
