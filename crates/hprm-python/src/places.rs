//! Where reactions are written, for messages about them.

use hprm_core::{ReactionId, Table};
use hprm_model::{Compiled, Runs, Syntax};

/// By reaction: its file and line.
pub(crate) struct Places {
    files: Vec<String>,
    /// The position of the file, and the line; none of a reaction that is not in the program text.
    lines: Table<ReactionId, Option<(usize, u32)>>,
    /// What the program is written in.
    pub(crate) syntax: Syntax,
}

impl Places {
    pub(crate) fn of(compiled: &Compiled) -> Self {
        let mut files: Vec<String> = Vec::new();
        let mut lines = Table::new();
        for code in compiled.bodies.values() {
            let Runs::Reaction(index) = code.runs else {
                lines.push(None);
                continue;
            };
            let body = &compiled.classes[code.class].reactions[index];
            let path = compiled.sources.path(body.file);
            let known = files.iter().position(|file| file == path);
            let file = known.unwrap_or_else(|| {
                files.push(path.to_owned());
                files.len() - 1
            });
            lines.push(Some((file, body.line)));
        }
        Self { files, lines, syntax: compiled.syntax }
    }

    /// `FILE:LINE` of the word `reaction`.
    pub(crate) fn of_reaction(&self, reaction: ReactionId) -> Option<String> {
        let (file, line) = self.lines[reaction]?;
        Some(format!("{}:{line}", self.files[file]))
    }
}
