//! Where in a value something is, for people: `value['boxes'][3].width`, as Python writes it.

use std::fmt;

use crate::cursor::{Blob, Cursor};
use crate::format::{self, NodeKind};

/// How many steps of a long way are shown: those from the value.
const FIRST: usize = 6;
/// And those to the place.
const LAST: usize = 3;

/// The steps from a value to a part of it, the last one first, because errors find their way out.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Place(Vec<String>);

impl Place {
    /// The container of this place has it there.
    pub(crate) fn within(&mut self, step: String) {
        self.0.push(step);
    }
}

impl fmt::Display for Place {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let steps = &self.0;
        formatter.write_str("`value")?;
        if steps.len() <= FIRST + LAST + 1 {
            steps.iter().rev().try_for_each(|step| formatter.write_str(step))?;
        } else {
            steps.iter().rev().take(FIRST).try_for_each(|step| formatter.write_str(step))?;
            formatter.write_str("...")?;
            steps[..LAST].iter().rev().try_for_each(|step| formatter.write_str(step))?;
        }
        formatter.write_str("`")
    }
}

/// The step to a member of a list.
pub(crate) fn index(at: usize) -> String {
    format!("[{at}]")
}

/// The step to the value of a dict whose key begins at `key`.
pub(crate) fn item(key: Cursor<'_>) -> String {
    format!("[{}]", short(key))
}

/// The step to a key of a dict.
pub(crate) fn key(key: Cursor<'_>) -> String {
    format!("{{key {}}}", short(key))
}

/// How many characters of a text an error shows.
const SHOWN: usize = 40;

/// A text as Python shows it, cut where it is long.
pub(crate) fn quoted(text: &str) -> String {
    let mut cut: String = text.chars().take(SHOWN).collect();
    if cut.len() < text.len() {
        cut.push_str("...");
    }
    let escaped = cut.escape_debug().to_string().replace("\\\"", "\"");
    // Python prefers single quotes as long as there are none inside.
    match (cut.contains('\''), cut.contains('"')) {
        (true, false) => format!("\"{}\"", escaped.replace("\\'", "'")),
        (false, _) => format!("'{escaped}'"),
        (true, true) => format!("'{}'", escaped.replace("\\'", "'").replace('\'', "\\'")),
    }
}

/// A key, if it is short: text or a number.
fn short(mut node: Cursor<'_>) -> String {
    let text = match node.kind() {
        Ok(NodeKind::Str) => match node.blob() {
            Ok(Blob::Inline(bytes)) => std::str::from_utf8(bytes).ok().map(quoted),
            _ => None,
        },
        Ok(NodeKind::Int) => node.number().ok().map(|n| format::unzigzag(n).to_string()),
        Ok(NodeKind::True) => Some("True".to_owned()),
        Ok(NodeKind::False) => Some("False".to_owned()),
        Ok(NodeKind::None) => Some("None".to_owned()),
        _ => None,
    };
    text.unwrap_or_else(|| "...".to_owned())
}
