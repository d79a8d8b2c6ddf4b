//! Talking to the person at the terminal.

use std::io::Write;

/// Writes a line, or several, to the standard error. A closed one is nobody's problem.
pub(crate) fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}
