//! What each code of a diagnostic means, for people: why it is a mistake, an example, and its cure.
//!
//! The texts are the Markdown files beside this one, one for each group of codes. A section is headed
//! `error[LF0503]: title`; its examples follow a line that begins with `Wrong` or `Right`. A block of an example is a
//! file, whose name follows the language (`Main.lf` or `main.py` if there is none), or, as `console`, the command
//! that shows it. How texts look in a terminal is for the caller to say.
//!
//! Tests run all examples: `crates/hprm-lf/tests/language/explanations.rs`, and `tests/python/test_explain.py` those that
//! need the command.

use crate::diagnostic::Severity;

const FILES: [&str; 12] = [
    include_str!("explanation/LF00.md"),
    include_str!("explanation/LF01.md"),
    include_str!("explanation/LF02.md"),
    include_str!("explanation/LF03.md"),
    include_str!("explanation/LF04.md"),
    include_str!("explanation/LF05.md"),
    include_str!("explanation/LF06.md"),
    include_str!("explanation/LF07.md"),
    include_str!("explanation/LF08.md"),
    include_str!("explanation/LF09.md"),
    include_str!("explanation/LF10.md"),
    include_str!("explanation/LF11.md"),
];

/// What one code means.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Explanation {
    /// The code: `LF0503`.
    pub code: &'static str,
    /// Of most diagnostics with this code.
    pub severity: Severity,
    /// What is wrong, in one line.
    pub title: &'static str,
    /// The explanation in Markdown, without its heading.
    pub text: &'static str,
}

/// Codes about one subject.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Group {
    /// What all of them begin with: `LF05`.
    pub prefix: &'static str,
    /// What they are about.
    pub title: &'static str,
    /// The codes, in order.
    pub explanations: Vec<Explanation>,
}

/// A piece of an explanation's text, in order.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Part {
    /// A paragraph, over several lines.
    Paragraph(&'static str),
    /// The line before the blocks of an example.
    Label(&'static str),
    /// A block of an example.
    Block(Block),
}

/// A file of an example, or its command.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Block {
    /// `lf`, `python`, `text`, or `console` for a command.
    pub language: &'static str,
    /// The name of the file, if it is stated.
    pub name: Option<&'static str>,
    /// What is in it.
    pub text: &'static str,
}

/// A program that has the mistake, or one that does not.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Example {
    /// Whether it is the cure.
    pub is_right: bool,
    /// The command that shows it, if that is not `hprm check` of the first file.
    pub command: Option<&'static str>,
    /// Its files with their names; the first one is the program.
    pub files: Vec<(&'static str, &'static str)>,
}

/// All codes, in order.
#[must_use]
pub fn groups() -> Vec<Group> {
    FILES.into_iter().filter_map(group).collect()
}

/// What a code means; upper or lower case, and zeros and letters before it may be missing: `lf503`.
#[must_use]
pub fn explanation(code: &str) -> Option<Explanation> {
    let wanted = normalized(code)?;
    let mut all = groups().into_iter().flat_map(|group| group.explanations);
    all.find(|explanation| explanation.code == wanted)
}

/// The most codes that the end of a report offers to explain.
const OFFERED: usize = 4;

/// The line at the end of a report that says how to read more about its codes; none if it has none.
#[must_use]
pub fn offer<Code: AsRef<str>>(codes: impl IntoIterator<Item = Code>) -> Option<String> {
    let mut offered: Vec<String> = Vec::new();
    for code in codes {
        if offered.len() < OFFERED && !offered.iter().any(|it| it == code.as_ref()) {
            offered.push(code.as_ref().to_owned());
        }
    }
    (!offered.is_empty()).then(|| format!("`hprm explain {}` says more", offered.join(" ")))
}

/// The codes whose spelling is the nearest to what is no code, or whose titles contain it as a word.
#[must_use]
pub fn nearest(word: &str) -> Vec<Explanation> {
    const SHOWN: usize = 3;
    let all = groups().into_iter().flat_map(|group| group.explanations);
    let Some(code) = normalized(word) else {
        let word = word.to_lowercase();
        return all.filter(|it| it.title.to_lowercase().contains(&word)).take(SHOWN).collect();
    };
    // Digits of one group first, then those with the same number in another one.
    let far = |other: &str| {
        let differ = |(a, b): &(char, char)| a != b;
        let digits = code.chars().zip(other.chars()).skip(2);
        let group = digits.clone().take(2).filter(differ).count();
        2 * group + digits.skip(2).filter(differ).count()
    };
    let mut near: Vec<_> = all.map(|it| (far(it.code), it)).filter(|(far, _)| *far <= 2).collect();
    near.sort_by_key(|(far, it)| (*far, it.code));
    near.into_iter().take(SHOWN).map(|(_, it)| it).collect()
}

impl Explanation {
    /// The text, piece by piece.
    #[must_use]
    pub fn parts(&self) -> Vec<Part> {
        let mut parts = Vec::new();
        let mut rest = self.text.trim_start();
        while !rest.is_empty() {
            let (part, after) = match rest.strip_prefix("```") {
                Some(fenced) => {
                    let (head, body) = fenced.split_once('\n').unwrap_or((fenced, ""));
                    let (text, after) = body.split_once("```").unwrap_or((body, ""));
                    let (language, name) = match head.split_once(' ') {
                        Some((language, name)) => (language, Some(name)),
                        None => (head, None),
                    };
                    (Part::Block(Block { language, name, text }), after)
                }
                None => {
                    let (text, after) = rest.split_once("\n\n").unwrap_or((rest, ""));
                    let text = text.trim_end();
                    let is_label = ["Wrong", "Right"].iter().any(|word| text.starts_with(word))
                        && text.ends_with(':');
                    (if is_label { Part::Label(text) } else { Part::Paragraph(text) }, after)
                }
            };
            parts.push(part);
            rest = after.trim_start();
        }
        parts
    }

    /// The examples, in order.
    #[must_use]
    pub fn examples(&self) -> Vec<Example> {
        let mut examples: Vec<Example> = Vec::new();
        for part in self.parts() {
            match (part, examples.last_mut()) {
                (Part::Label(text), _) => {
                    let is_right = text.starts_with("Right");
                    examples.push(Example { is_right, command: None, files: Vec::new() });
                }
                (Part::Block(Block { language: "console", text, .. }), Some(example)) => {
                    example.command = text.trim_end().strip_prefix("$ ");
                }
                (Part::Block(block), Some(example)) => {
                    example.files.push((block.file(), block.text));
                }
                (Part::Paragraph(_) | Part::Block(_), _) => {}
            }
        }
        examples
    }
}

impl Block {
    /// The name of its file.
    #[must_use]
    pub fn file(&self) -> &'static str {
        self.name.unwrap_or(if self.language == "python" { "main.py" } else { "Main.lf" })
    }
}

/// `LF0503` of `lf503`, `503` or `error[LF0503]`; none if it has not the form of a code.
fn normalized(code: &str) -> Option<String> {
    let code = code.trim().to_ascii_uppercase();
    let code = code.split_once('[').map_or(code.as_str(), |(_, rest)| rest.trim_end_matches(']'));
    let digits = code.strip_prefix("LF").unwrap_or(code);
    let is_number = matches!(digits.len(), 1..=4) && digits.bytes().all(|b| b.is_ascii_digit());
    is_number.then(|| format!("LF{digits:0>4}"))
}

/// The codes of one file.
fn group(text: &'static str) -> Option<Group> {
    let mut sections = text.split("\n## ");
    let (prefix, title) = sections.next()?.strip_prefix("# ")?.trim_end().split_once(": ")?;
    Some(Group { prefix, title, explanations: sections.filter_map(section).collect() })
}

/// A section without the signs before its heading.
fn section(text: &'static str) -> Option<Explanation> {
    let (head, text) = text.split_once('\n')?;
    let (kind, rest) = head.split_once('[')?;
    let (code, title) = rest.split_once("]: ")?;
    let severity = match kind {
        "error" => Severity::Error,
        "warning" => Severity::Warning,
        _ => return None,
    };
    Some(Explanation { code, severity, title, text: text.trim() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_heading_is_a_code_of_its_group() {
        let sections: usize = FILES.iter().map(|text| text.matches("\n## ").count()).sum();
        let groups = groups();
        assert_eq!(groups.len(), FILES.len());
        assert_eq!(groups.iter().map(|group| group.explanations.len()).sum::<usize>(), sections);
        for group in &groups {
            assert!(group.explanations.is_sorted_by(|a, b| a.code < b.code), "{}", group.prefix);
            let other = group.explanations.iter().find(|it| !it.code.starts_with(group.prefix));
            assert_eq!(other, None);
        }
    }

    #[test]
    fn each_text_ends_with_its_examples() {
        for explanation in groups().iter().flat_map(|group| &group.explanations) {
            let Explanation { code, title, .. } = explanation;
            assert!(title.len() < 100 && !title.ends_with('.'), "{code}");
            let parts = explanation.parts();
            assert!(matches!(parts[0], Part::Paragraph(text) if text.len() > 60), "{code}");
            let examples = explanation.examples();
            assert!(examples.iter().all(|example| !example.files.is_empty()), "{code}");
            let right: Vec<_> = examples.iter().map(|example| example.is_right).collect();
            assert!(right.chunks(2).all(|pair| pair == [false, true]), "{code}: {right:?}");
        }
    }

    #[test]
    fn a_code_is_understood_in_many_spellings() {
        for word in ["LF0503", "lf0503", "lf503", "503", "0503", "error[LF0503]", " Lf503 "] {
            assert_eq!(explanation(word).unwrap().code, "LF0503", "{word}");
        }
        for word in ["", "LF", "lf9999", "LF05033", "cycle", "E0503", "-1"] {
            assert_eq!(explanation(word), None, "{word}");
        }
    }

    #[test]
    fn what_is_no_code_has_neighbours() {
        let codes = |word| nearest(word).iter().map(|it| it.code).collect::<Vec<_>>();
        assert_eq!(codes("lf508")[..3], ["LF0501", "LF0502", "LF0503"]);
        assert_eq!(codes("lf1201")[..2], ["LF0201", "LF1001"]);
        assert_eq!(codes("cycle"), ["LF0503"]);
        assert_eq!(codes("lf9999"), [""; 0]);
        assert_eq!(codes("nothing of the kind"), [""; 0]);
    }

    #[test]
    fn blocks_are_files_or_the_command() {
        let [wrong, right] = &explanation("LF0608").unwrap().examples()[..] else { panic!() };
        assert_eq!(wrong.command, Some("hprm run Main.lf --property timeout"));
        assert_eq!((wrong.files.len(), wrong.files[0].0), (1, "Main.lf"));
        assert!(right.is_right && right.files[0].1.starts_with("target Python\n"));
        let [wrong, _] = &explanation("LF0101").unwrap().examples()[..] else { panic!() };
        assert_eq!((wrong.command, wrong.files[1].0), (None, "lib/Gain.lf"));
    }
}
