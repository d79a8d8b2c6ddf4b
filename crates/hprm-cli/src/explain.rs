//! `hprm explain`: what a code of a diagnostic means. The texts are those of `hprm-model`; this lays them out for a
//! terminal.

use std::fmt::Write;
use std::io;
use std::process::ExitCode;

use hprm_model::Severity;
use hprm_model::explanation::{self, Block, Explanation, Group, Part};
use serde_json::{Value, json};

use crate::args::Explain;
use crate::message::{self, Error};

/// How wide text is where no terminal says how wide it is.
const WIDTH: usize = 80;

/// Its bounds: a narrower page cannot hold the words, a wider one is hard to read.
const NARROWEST: usize = 40;
const WIDEST: usize = 100;

/// Explains codes, or lists all.
///
/// # Errors
///
/// If there is no such code.
pub(crate) fn explain(wanted: &Explain) -> Result<ExitCode, Error> {
    let groups = explanation::groups();
    let found: Vec<_> = match wanted.codes.as_slice() {
        [] => groups.into_iter().map(Found::Group).collect(),
        codes => codes.iter().map(|code| find(code, &groups)).collect::<Result<_, _>>()?,
    };
    if wanted.json {
        let all = found.iter().flat_map(Found::explanations);
        all.for_each(|it| message::print_line(&as_json(it).to_string()));
        return Ok(ExitCode::SUCCESS);
    }
    let page = Page::of_terminal();
    let texts = found.iter().map(|found| match found {
        Found::Group(group) if wanted.markdown => group_as_markdown(group),
        Found::Group(group) => listed(group),
        Found::One(one) if wanted.markdown => as_markdown(one, 1),
        Found::One(one) => page.explanation(one),
    });
    message::print_line(texts.collect::<Vec<_>>().join("\n").trim_end());
    Ok(ExitCode::SUCCESS)
}

/// What is shown for a word of the command line.
#[derive(Debug)]
enum Found {
    One(Explanation),
    Group(Group),
}

impl Found {
    fn explanations(&self) -> &[Explanation] {
        match self {
            Self::One(one) => std::slice::from_ref(one),
            Self::Group(group) => &group.explanations,
        }
    }
}

/// A group, if the word is how its codes begin (`LF05`), or one code.
fn find(code: &str, groups: &[Group]) -> Result<Found, Error> {
    if let Some(group) = groups.iter().find(|group| group.prefix.eq_ignore_ascii_case(code)) {
        return Ok(Found::Group(group.clone()));
    }
    explanation::explanation(code).map(Found::One).ok_or_else(|| unknown(code))
}

/// Says at the end of a report, on the standard error, how to read more about its codes.
pub(crate) fn offer<Code: AsRef<str>>(codes: impl IntoIterator<Item = Code>) {
    if let Some(offer) = explanation::offer(codes) {
        message::print_error(format!("{offer}\n").as_bytes());
    }
}

fn unknown(code: &str) -> Error {
    let near = explanation::nearest(code);
    let error = Error::option(format!("there is no code `{code}`")).code(1);
    if near.is_empty() {
        return error.hint("hprm explain lists all codes");
    }
    let near: Vec<_> = near.iter().map(|it| format!("{} ({})", it.code, it.title)).collect();
    error.hint(format!("near it: {}", near.join("; ")))
}

fn severity(explanation: &Explanation) -> &'static str {
    match explanation.severity {
        Severity::Error => "error",
        Severity::Warning => "warning",
    }
}

fn listed(group: &Group) -> String {
    let mut text = format!("{}: {}\n", group.prefix, group.title);
    for it in &group.explanations {
        let _ = writeln!(text, "  {}  {:7}  {}", it.code, severity(it), it.title);
    }
    text
}

fn group_as_markdown(group: &Group) -> String {
    let sections: Vec<_> = group.explanations.iter().map(|it| as_markdown(it, 2)).collect();
    format!("# {}: {}\n\n{}", group.prefix, group.title, sections.join("\n"))
}

fn as_markdown(explanation: &Explanation, level: usize) -> String {
    let Explanation { code, title, text, .. } = explanation;
    format!("{} {}[{code}]: {title}\n\n{text}\n", "#".repeat(level), severity(explanation))
}

fn as_json(explanation: &Explanation) -> Value {
    let examples = explanation.examples().into_iter().map(|example| {
        let files = example.files.iter().map(|(name, text)| json!({ "name": name, "text": text }));
        json!({
            "right": example.is_right,
            "command": example.command,
            "files": files.collect::<Vec<_>>(),
        })
    });
    json!({
        "code": explanation.code,
        "severity": severity(explanation),
        "title": explanation.title,
        "text": explanation.text,
        "examples": examples.collect::<Vec<_>>(),
    })
}

/// What a text is laid out for.
#[derive(Clone, Copy, Debug)]
struct Page {
    width: usize,
    color: bool,
}

impl Page {
    fn of_terminal() -> Self {
        let out = io::stdout();
        let stated = std::env::var("COLUMNS").ok().and_then(|columns| columns.parse().ok());
        let shown =
            || rustix::termios::tcgetwinsize(&out).ok().map(|size| usize::from(size.ws_col));
        let width = stated.or_else(shown).filter(|width| *width > 0).unwrap_or(WIDTH);
        Self { width: width.clamp(NARROWEST, WIDEST), color: message::color(&out) }
    }

    fn explanation(self, explanation: &Explanation) -> String {
        let head = format!("{}[{}]", severity(explanation), explanation.code);
        let red_or_yellow = match explanation.severity {
            Severity::Error => "1;31",
            Severity::Warning => "1;33",
        };
        let title = self.wrapped(&format!("{head}: {}", explanation.title));
        let title = match title.strip_prefix(&head) {
            Some(rest) => self.styled(&head, red_or_yellow) + &self.styled(rest, "1"),
            None => title,
        };
        let mut text = title + "\n";
        for part in explanation.parts() {
            let part = match part {
                Part::Paragraph(paragraph) => self.wrapped(paragraph),
                Part::Label(label) => self.styled(label, "1"),
                Part::Block(block) => shown(&block),
            };
            let _ = write!(text, "\n{part}\n");
        }
        text
    }

    fn styled(self, text: &str, style: &str) -> String {
        if self.color { format!("\x1b[{style}m{text}\x1b[0m") } else { text.to_owned() }
    }

    /// The words of a text in lines that fit.
    fn wrapped(self, text: &str) -> String {
        let mut lines = vec![String::new()];
        for word in text.split_whitespace() {
            let line = lines.last_mut().expect("there is always a line");
            let fits = line.chars().count() + 1 + word.chars().count() <= self.width;
            if line.is_empty() {
                line.push_str(word);
            } else if fits {
                line.push(' ');
                line.push_str(word);
            } else {
                lines.push(word.to_owned());
            }
        }
        lines.join("\n")
    }
}

/// A block, indented, behind the name of its file if that is stated.
fn shown(block: &Block) -> String {
    let indented = |line: &str| if line.is_empty() { String::new() } else { format!("    {line}") };
    let lines = block.text.lines().map(indented);
    let name = block.name.map(|name| format!("  {name}"));
    name.into_iter().chain(lines).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_wrapped_and_examples_are_not() {
        let page = Page { width: 40, color: false };
        let wanted = explanation::explanation("LF0101").unwrap();
        let text = page.explanation(&wanted);
        assert!(text.starts_with("error[LF0101]: a file cannot be read\n\n"), "{text}");
        assert!(
            text.contains("\n\nWrong:\n\n    target Python\n    import Gain from \"Gain.lf\"\n")
        );
        assert!(text.contains("\n\n  lib/Gain.lf\n    target Python\n"), "{text}");
        let prose = text.lines().filter(|line| !line.starts_with(' '));
        assert!(prose.clone().all(|line| line.chars().count() <= 40), "{text}");
        assert!(prose.clone().any(|line| line.chars().count() > 30), "{text}");
        assert!(!text.contains("```"));
    }

    #[test]
    fn color_is_for_the_head_and_for_labels() {
        let page = Page { width: 80, color: true };
        let text = page.explanation(&explanation::explanation("LF0104").unwrap());
        assert!(text.starts_with("\x1b[1;33mwarning[LF0104]\x1b[0m\x1b[1m: an import"), "{text}");
        assert!(text.contains("\x1b[1mRight:\x1b[0m"));
    }
}
