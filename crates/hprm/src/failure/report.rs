//! What is told of a failure: to people as text, to programs as JSON, and to other processes of the
//! federation in the frame that says that a federate has failed.

use std::fmt::Write;

use hprm_federated::Frame;
use serde::{Deserialize, Serialize};

use super::exit_code;
use crate::console::without_numbers;

/// The longest text that travels to others, in bytes: less than the protocol cuts off.
const LONGEST_SENT: usize = 60_000;

/// What kind of failure it is. Programs may rely on the names.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// A body of a reaction raised an exception or returned an error.
    Reaction,
    /// A thread of the program raised an exception.
    Thread,
    /// A value could not be made into bytes.
    Connection,
    /// Other code of the program raised an exception: when it was loaded, for example.
    Code,
    /// The program has chosen an exit code.
    Exit,
    /// The program has ended itself with a text.
    Quit,
    /// The program has chosen to leave, and all is well.
    Left,
    /// A signal has asked the program to stop.
    Interrupted,
    /// The text of the program has a mistake, which was found before the program ran.
    Program,
    /// An option, a target property on the command line or an environment variable is wrong, or does not fit
    /// the program.
    Option,
    /// The system refuses something.
    System,
    /// The logical trace cannot be written.
    Trace,
    /// There is no RTI, or none any more.
    Rti,
    /// The RTI does not let a federate join.
    Refused,
    /// A link cannot be used any more.
    Link,
    /// What comes over a link does not follow the protocol.
    Protocol,
    /// The object store cannot do what it should.
    Store,
    /// There is no memory for a message.
    Memory,
    /// The RTI has lost a federate: its link has ended, or it does not answer.
    Lost,
    /// A process was killed by a signal.
    Killed,
    /// Federates did not join, or load their programs, in time.
    Absent,
    /// The federation has not stopped in order.
    Unfinished,
    /// The command cannot do what it was asked for.
    Command,
}

/// What a message starts with.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Label {
    /// Something has ended, or does not begin.
    Error,
    /// Something goes on nevertheless.
    Warning,
}

/// A failure as it is told. As JSON, it has all fields, and `null` for those that do not apply.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Report {
    /// What kind of failure it is.
    pub kind: Kind,
    /// What has happened, in a sentence without a period; more lines may follow.
    pub message: String,
    /// The exit code that it leads to.
    pub code: i32,
    /// The code of the diagnostic, if the program has mistakes.
    pub diagnostic: Option<String>,
    /// The federate that has failed.
    pub federate: Option<String>,
    /// The full name of the reaction that has failed.
    pub reaction: Option<String>,
    /// The tag at which it ran: nanoseconds since the start, and the microstep.
    pub tag: Option<(i64, u32)>,
    /// The file in which it happened.
    pub file: Option<String>,
    /// The line of the file, from 1.
    pub line: Option<u32>,
    /// The column in the line, from 1.
    pub column: Option<u32>,
    /// The lines around that place, if people are shown them.
    pub excerpt: Option<String>,
    /// More, on lines of its own: a traceback.
    pub details: Option<String>,
    /// What to do about it.
    pub hint: Option<String>,
    /// All of it as people see it, if it was made elsewhere.
    #[serde(skip)]
    pub rendered: Option<String>,
}

impl Report {
    /// A report with exit code 1. What the operating system says has no number in it, unless a program says so.
    #[must_use]
    pub fn new(kind: Kind, message: impl Into<String>) -> Self {
        let is_theirs = matches!(kind, Kind::Reaction | Kind::Thread | Kind::Code | Kind::Quit);
        let message = message.into();
        let message = if is_theirs { message } else { without_numbers(&message) };
        Self {
            kind,
            message,
            code: 1,
            diagnostic: None,
            federate: None,
            reaction: None,
            tag: None,
            file: None,
            line: None,
            column: None,
            excerpt: None,
            details: None,
            hint: None,
            rendered: None,
        }
    }

    /// Adds what to do about it.
    #[must_use]
    pub fn hint(self, hint: impl Into<String>) -> Self {
        Self { hint: Some(hint.into()), ..self }
    }

    /// Says which federate it is about.
    #[must_use]
    pub fn of(self, federate: impl Into<String>) -> Self {
        Self { federate: Some(federate.into()), ..self }
    }

    /// The exit code, if the program has chosen it and said nothing more, or a signal has.
    #[must_use]
    pub fn is_only_code(&self) -> bool {
        matches!(self.kind, Kind::Exit | Kind::Interrupted | Kind::Left)
    }

    /// The report for a reader of several federates: it begins with the federate. Reports of the RTI have
    /// that already.
    #[must_use]
    pub fn named(self) -> Self {
        let Some(federate) = &self.federate else { return self };
        let message = match self.kind {
            Kind::Lost => self.message,
            _ if self.is_only_code() => {
                format!("federate {federate} exited with code {}", self.code)
            }
            _ => format!("federate {federate}: {}", self.message),
        };
        Self { message, rendered: None, ..self }
    }

    /// The text for people, without an end of line: what, where, more about it, and what to do. With
    /// `color`, its labels have colours.
    #[must_use]
    pub fn text(&self, label: Label, color: bool) -> String {
        if let Some(rendered) = &self.rendered {
            return rendered.clone();
        }
        let painted = |label: &str, paint: &str| {
            if color { format!("\x1b[{paint}m{label}:\x1b[0m") } else { format!("{label}:") }
        };
        let (word, paint) = match label {
            Label::Error => ("error", "1;31"),
            Label::Warning => ("warning", "1;33"),
        };
        let word = match &self.diagnostic {
            Some(code) => format!("{word}[{code}]"),
            None => word.to_owned(),
        };
        let mut text = format!("{} {}", painted(&word, paint), self.message.trim_end());
        if let Some(place) = self.excerpt.clone().or_else(|| self.place()) {
            let _ = write!(text, "\n{place}");
        }
        if let Some(details) = &self.details {
            let _ = write!(text, "\n{}", details.trim_end());
        }
        if let Some(hint) = &self.hint {
            let _ = write!(text, "\n  {} {hint}", painted("hint", "1;36"));
        }
        text
    }

    fn place(&self) -> Option<String> {
        let mut text = format!("  --> {}", self.file.as_ref()?);
        for number in [self.line, self.column].into_iter().flatten() {
            let _ = write!(text, ":{number}");
        }
        Some(text)
    }

    /// One line for programs.
    #[must_use]
    pub fn json(&self) -> String {
        serde_json::to_string(self).expect("its fields are numbers and texts")
    }

    /// What others of the federation are sent.
    pub(crate) fn encoded(&self) -> String {
        let mut report = self.clone();
        loop {
            let text = report.json();
            if text.len() <= LONGEST_SENT {
                return text;
            }
            // The end of a long text is of the least interest.
            for part in [Some(&mut report.message), report.details.as_mut()].into_iter().flatten() {
                halve(part);
            }
            (report.excerpt, report.hint) = (None, None);
        }
    }

    /// What others of the federation have sent; none if it is not from a process but from a machine of
    /// the protocol, which has only words.
    pub(crate) fn decoded(text: &str) -> Option<Self> {
        serde_json::from_str(text).ok()
    }

    /// The report of a federate in the message of a frame `Failed`, or, if the RTI has written the message as
    /// plain text, a report with that text.
    pub(crate) fn from_message(federate: &str, message: &str, code: i32) -> Self {
        let report = Self::decoded(message).unwrap_or_else(|| Self::new(Kind::Lost, message));
        Self { code: exit_code(code), ..report.of(federate) }
    }

    /// A frame as it leaves a federate: what its machine says of its own failure is a report as well.
    pub(crate) fn in_frame(frame: Frame) -> Frame {
        match frame {
            Frame::Failed { federate, message, code } if Self::decoded(&message).is_none() => {
                let message = Self { code, ..Self::new(Kind::Link, message) }.encoded();
                Frame::Failed { federate, message, code }
            }
            frame => frame,
        }
    }
}

fn halve(text: &mut String) {
    let half = (0..=text.len() / 2).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0);
    text.truncate(half);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whole() -> Report {
        Report {
            reaction: Some("Main.a.1".to_owned()),
            tag: Some((5, 1)),
            file: Some("A.lf".to_owned()),
            line: Some(3),
            details: Some("Traceback:\n  here\n".to_owned()),
            ..Report::new(Kind::Reaction, "reaction Main.a.1 raised ValueError: no").hint("say yes")
        }
    }

    #[test]
    fn people_read_what_where_and_what_to_do() {
        let expected = "error: reaction Main.a.1 raised ValueError: no\n  --> A.lf:3\nTraceback:\n  \
                        here\n  hint: say yes";
        assert_eq!(whole().text(Label::Error, false), expected);
        let short = Report::new(Kind::Command, "no").hint("yes");
        assert_eq!(short.text(Label::Warning, false), "warning: no\n  hint: yes");
        let mistake =
            Report { diagnostic: Some("LF1001".to_owned()), ..Report::new(Kind::Program, "no") };
        assert_eq!(mistake.text(Label::Error, false), "error[LF1001]: no");
        let colored = "\x1b[1;31merror:\x1b[0m no\n  \x1b[1;36mhint:\x1b[0m yes";
        assert_eq!(short.text(Label::Error, true), colored);
    }

    #[test]
    fn programs_read_all_fields() {
        let json: serde_json::Value = serde_json::from_str(&whole().json()).unwrap();
        assert_eq!(json["kind"], "reaction");
        assert_eq!(json["tag"], serde_json::json!([5, 1]));
        assert_eq!(json["federate"], serde_json::Value::Null);
        assert_eq!((&json["line"], &json["code"]), (&3.into(), &1.into()));
    }

    #[test]
    fn the_federate_that_has_failed_comes_first_and_once() {
        let named = |report: Report| report.of("b").named().message;
        assert_eq!(named(Report::new(Kind::Reaction, "no")), "federate b: no");
        let lost = "the process of federate b ended";
        assert_eq!(named(Report::new(Kind::Lost, lost)), lost);
        let exit = Report { code: 3, ..Report::new(Kind::Exit, "exited with code 3") };
        assert_eq!(named(exit), "federate b exited with code 3");
        assert_eq!(Report::new(Kind::Exit, "no").named().message, "no");
    }

    #[test]
    fn reports_travel_and_long_ones_lose_their_ends() {
        let sent = whole();
        assert_eq!(Report::decoded(&sent.encoded()), Some(sent.clone()));
        let long = Report { details: Some("\u{1}ä".repeat(50_000)), ..sent };
        let text = long.encoded();
        assert!(text.len() <= LONGEST_SENT);
        let received = Report::from_message("b", &text, 1);
        assert!(
            received.details.is_some_and(|details| long.details.unwrap().starts_with(&details))
        );
        assert_eq!((received.line, received.federate.as_deref()), (Some(3), Some("b")));
    }

    #[test]
    fn words_without_a_report_are_those_of_a_machine() {
        let received = Report::from_message("b", "federate b has not answered for 3 s", 1);
        assert_eq!(
            (received.kind, received.named().message.as_str()),
            (Kind::Lost, "federate b has not answered for 3 s")
        );
        let me = hprm_core::FederateId(0);
        let said = "the link to federate b is broken".to_owned();
        let frame = Report::in_frame(Frame::Failed { federate: me, message: said, code: 1 });
        let Frame::Failed { message, .. } = &frame else { panic!("it is the same frame") };
        let received = Report::from_message("a", message, 1);
        assert_eq!(received.kind, Kind::Link);
        assert_eq!(received.named().message, "federate a: the link to federate b is broken");
        assert_eq!(Report::in_frame(frame.clone()), frame);
    }
}
