//! How the command speaks: `error: ...`, an indented `hint: ...`, and colour where it is wanted.
//!
//! Diagnostics of programs look different; they come from the renderer of the front end.

use std::io::{self, ErrorKind, IsTerminal, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use hprm::Failure;
use serde_json::{Value, json};

/// What went wrong, and what to do about it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Error {
    message: String,
    hint: Option<String>,
}

impl Error {
    /// An error. The first line of `message` is a sentence without a period; more may follow.
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self { message: message.into(), hint: None }
    }

    /// What a library says, which may already say that it is an error.
    pub(crate) fn of(failure: &Failure) -> Self {
        Self::new(plain(&failure.message))
    }

    /// Adds what to do about it.
    pub(crate) fn hint(self, hint: impl Into<String>) -> Self {
        Self { hint: Some(hint.into()), ..self }
    }

    /// Writes it to the standard error, in one piece.
    pub(crate) fn show(&self) {
        let text = self.text("error", "\x1b[1;31m", color(&io::stderr()));
        print_error(text.as_bytes());
    }

    /// Writes it to the standard error as something that does not stop anybody.
    pub(crate) fn show_as_warning(&self) {
        let text = self.text("warning", "\x1b[1;33m", color(&io::stderr()));
        print_error(text.as_bytes());
    }

    /// For programs: `message`, and `hint` if there is one.
    pub(crate) fn as_json(&self) -> Value {
        json!({ "message": self.message.trim_end(), "hint": self.hint })
    }

    fn text(&self, label: &str, paint: &str, color: bool) -> String {
        let painted = |label: &str, paint: &str| {
            if color { format!("{paint}{label}:\x1b[0m") } else { format!("{label}:") }
        };
        let mut text = format!("{} {}\n", painted(label, paint), self.message.trim_end());
        if let Some(hint) = &self.hint {
            text.push_str(&format!("  {} {hint}\n", painted("hint", "\x1b[1;36m")));
        }
        text
    }
}

/// For commands that print one JSON object: it has the key `error` if there is nothing else to print.
///
/// # Errors
///
/// As `outcome`, if text is wanted.
pub(crate) fn or_json(json: bool, outcome: Result<ExitCode, Error>) -> Result<ExitCode, Error> {
    match outcome {
        Err(error) if json => {
            print_line(&json!({ "error": error.as_json() }).to_string());
            Ok(ExitCode::FAILURE)
        }
        outcome => outcome,
    }
}

/// A message without a label of its own.
pub(crate) fn plain(message: &str) -> &str {
    message.strip_prefix("error: ").unwrap_or(message).trim()
}

/// Whether a stream is for eyes that want colour (<https://no-color.org>).
pub(crate) fn color(stream: &impl IsTerminal) -> bool {
    let unwanted = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    let unable = std::env::var_os("TERM").is_some_and(|value| value == "dumb");
    stream.is_terminal() && !unwanted && !unable
}

/// Writes to the standard output.
///
/// # Errors
///
/// If nobody reads it any more.
pub(crate) fn print(bytes: &[u8]) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(bytes)?;
    out.flush()
}

/// Whether something could not be written that somebody waits for.
static UNWRITTEN: AtomicBool = AtomicBool::new(false);

/// Writes a line to the standard output; if nobody reads it any more, it is for nobody.
pub(crate) fn print_line(line: &str) {
    if let Err(error) = print(format!("{line}\n").as_bytes())
        && error.kind() != ErrorKind::BrokenPipe
        && !UNWRITTEN.swap(true, Ordering::Relaxed)
    {
        unwritable(&error).show();
    }
}

/// Whether [`print_line`] has failed, and has said so.
pub(crate) fn is_unwritten() -> bool {
    UNWRITTEN.load(Ordering::Relaxed)
}

/// That the standard output takes nothing any more.
pub(crate) fn unwritable(error: &io::Error) -> Error {
    let reason = error.to_string();
    let reason = reason.split(" (os error").next().unwrap_or_default();
    Error::new(format!("cannot write to the standard output: {reason}"))
}

/// Writes to the standard error, where there is nobody left to tell if that fails.
pub(crate) fn print_error(bytes: &[u8]) {
    let _ = io::stderr().lock().write_all(bytes);
}

#[cfg(test)]
mod tests {
    use super::Error;

    #[test]
    fn an_error_is_a_sentence_and_a_hint() {
        let error = Error::new("there is no python3").hint("install it");
        assert_eq!(
            error.text("error", "", false),
            "error: there is no python3\n  hint: install it\n"
        );
    }

    #[test]
    fn colour_is_on_the_labels_only() {
        let error = Error::new("no").hint("yes");
        let text = error.text("error", "\x1b[1;31m", true);
        assert_eq!(text, "\x1b[1;31merror:\x1b[0m no\n  \x1b[1;36mhint:\x1b[0m yes\n");
    }

    #[test]
    fn a_message_of_several_lines_stays_one() {
        let error = Error::new("reaction Main.a.1 raised ValueError\n  --> A.lf:3\n");
        assert_eq!(
            error.text("error", "", false),
            "error: reaction Main.a.1 raised ValueError\n  --> A.lf:3\n"
        );
    }
}
