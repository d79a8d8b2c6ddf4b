//! The standard streams of this process: what the launcher and the command write for people.
//!
//! Everything is written in one piece, so lines of different threads never mix.

use std::io::{self, IsTerminal, Write};

use crate::{Failure, Label, Report};

/// Shows a report on the standard error, as people read it.
pub fn show(label: Label, report: &Report) {
    print_error(format!("{}\n", report.text(label, color(&io::stderr()))).as_bytes());
}

/// Whether a stream is for eyes that want colour (<https://no-color.org>).
pub fn color(stream: &impl IsTerminal) -> bool {
    let unwanted = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    let unable = std::env::var_os("TERM").is_some_and(|value| value == "dumb");
    stream.is_terminal() && !unwanted && !unable
}

/// Writes to the standard output.
///
/// # Errors
///
/// If it cannot be written; its reader may have closed it.
pub fn print(bytes: &[u8]) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(bytes)?;
    out.flush()
}

/// The failure that the standard output cannot be written.
pub fn unwritable(error: &io::Error) -> Failure {
    Failure::command(format!("cannot write to the standard output: {}", reason(error)))
}

/// The reason alone: `No such file or directory`, without the number of the error.
pub fn reason(error: &io::Error) -> String {
    without_numbers(&error.to_string())
}

/// A text without the numbers of errors of the operating system, such as ` (os error 2)`.
pub(crate) fn without_numbers(text: &str) -> String {
    let (mut kept, mut rest) = (String::new(), text);
    while let Some((before, numbered)) = rest.split_once(" (os error ")
        && let Some((_number, after)) = numbered.split_once(')')
    {
        kept.push_str(before);
        rest = after;
    }
    kept + rest
}

/// Writes to the standard error; a failure of that cannot be reported.
pub fn print_error(bytes: &[u8]) {
    let _ = io::stderr().lock().write_all(bytes);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_errors_are_not_told() {
        let reason = io::Error::from_raw_os_error(2).to_string();
        assert_eq!(
            without_numbers(&format!("cannot read {reason}: why?")),
            "cannot read No such file or directory: why?"
        );
        assert_eq!(without_numbers("a (os error 1), b (os error 22)"), "a, b");
        assert_eq!(without_numbers("a (os error 1"), "a (os error 1");
    }
}
