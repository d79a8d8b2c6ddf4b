//! Why a federation failed, in words and as an exit code.
//!
//! Two witnesses tell of a federate's end: the RTI, which has its report or has lost its link, and the
//! system, which has its exit status. They make one report. Which federate is to blame, and when enough
//! has been heard, is decided by the [`supervisor`](crate::supervisor).

use hprm::{Failure, Kind, Report, exit_code};
use hprm_core::Nanos;

use crate::message::Error;
use crate::signals::Signal;

const SECOND: Nanos = 1_000_000_000;

/// How a process ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Ending {
    /// By itself, with an exit code.
    Code(i32),
    /// By a signal.
    Signal(Signal),
}

/// What to say about a failure, and the exit code that it leads to: never zero.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Verdict {
    pub(crate) error: Error,
    pub(crate) code: i32,
}

impl Verdict {
    /// A federate was the first to fail. `heard` is what the RTI knows of it.
    pub(crate) fn on_federate(
        name: &str,
        joined: bool,
        heard: Option<&Report>,
        ending: Option<Ending>,
    ) -> Self {
        let announced = heard.map(|report| report.code);
        let code = match ending {
            Some(Ending::Code(code)) if code != 0 => exit_code(code),
            Some(Ending::Signal(_)) => 1,
            _ => announced.unwrap_or(1),
        };
        let error = match (ending, heard) {
            (Some(Ending::Signal(signal)), _) => killed(name, signal),
            (Some(Ending::Code(ended)), _) if announced != Some(ended) => {
                exited(name, joined, ended, heard)
            }
            (_, Some(report)) => Error::from(report.clone().named()),
            (_, None) => exited(name, joined, code, None),
        };
        Self { error: error.federate(name).code(code), code }
    }

    /// Some federates did not join in time.
    pub(crate) fn on_absent(names: &[&str], seconds: f64) -> Self {
        let (noun, names) = match names {
            [name] => ("federate", (*name).to_owned()),
            _ => ("federates", names.join(", ")),
        };
        let said = format!("{noun} {names} did not join within {seconds} s");
        let error = Error::of(Kind::Absent, said)
            .hint("programs that take long to load need a longer --join-timeout");
        Self { error, code: 1 }
    }

    /// The RTI itself could not go on.
    pub(crate) fn on_rti(failure: &Failure) -> Self {
        Self { error: Error::from(failure), code: exit_code(failure.exit_code()) }
    }
}

/// A federate does not answer.
pub(crate) fn on_silent(name: &str, silence: Nanos) -> String {
    let seconds = silence / SECOND;
    format!(
        "federate {name} has not answered for {seconds} s; federates that need its messages wait"
    )
}

/// A federate that did not answer does so again.
pub(crate) fn on_answer(name: &str, silence: Nanos) -> String {
    let tenths = silence / (SECOND / 10);
    format!("federate {name} answers again, after {}.{} s", tenths / 10, tenths % 10)
}

fn killed(name: &str, signal: Signal) -> Error {
    let said = format!("federate {name} was killed by signal {}", signal.description());
    let error = Error::of(Kind::Killed, said);
    match signal {
        Signal::KILL => {
            error.hint("if you did not kill it, the system may have had no memory left: see dmesg")
        }
        _ => error,
    }
}

/// What is `heard` adds what the exit code does not tell; that the process has ended, it does tell.
fn exited(name: &str, joined: bool, code: i32, heard: Option<&Report>) -> Error {
    let heard = heard.filter(|report| report.kind != Kind::Lost && !report.is_only_code());
    let when = match (joined, code) {
        (false, _) => " before it joined",
        (true, 0) => " before its last tag",
        (true, _) => "",
    };
    let exited = format!("federate {name} exited with code {code}{when}");
    if let Some(report) = heard {
        let message = format!("{exited}: {}", report.message);
        return Error::from(Report { message, rendered: None, ..report.clone() });
    }
    let error = Error::of(Kind::Exit, exited);
    if joined {
        return error;
    }
    error.hint("if its own output does not say why, see what hprm doctor says")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raised(message: &str) -> Report {
        Report { line: Some(3), ..Report::new(Kind::Reaction, message) }.of("b")
    }

    fn lost() -> Report {
        Report::new(Kind::Lost, "the process of federate b ended before its last tag").of("b")
    }

    fn exit(code: i32) -> Report {
        Report { code, ..Failure::Exited { code }.report() }.of("b")
    }

    /// What is said, and with which exit code.
    fn verdict(heard: Option<&Report>, ending: Option<Ending>) -> (String, i32) {
        let Verdict { error, code } = Verdict::on_federate("b", true, heard, ending);
        assert_eq!(error.report().code, code);
        assert_eq!(error.report().federate.as_deref(), Some("b"));
        (error.report().message.clone(), code)
    }

    #[test]
    fn a_federate_speaks_for_itself() {
        let said = raised("reaction Main.b.1 raised ValueError: no");
        let expected = "federate b: reaction Main.b.1 raised ValueError: no";
        for ending in [None, Some(Ending::Code(1))] {
            assert_eq!(verdict(Some(&said), ending), (expected.to_owned(), 1));
            let error = Verdict::on_federate("b", true, Some(&said), ending).error;
            assert_eq!((error.report().kind, error.report().line), (Kind::Reaction, Some(3)));
        }
    }

    #[test]
    fn an_exit_without_words_is_told_by_its_code() {
        let expected = ("federate b exited with code 3".to_owned(), 3);
        assert_eq!(verdict(Some(&exit(3)), Some(Ending::Code(3))), expected);
        assert_eq!(verdict(Some(&exit(3)), None), expected);
        assert_eq!(verdict(None, Some(Ending::Code(3))), expected);
        // It has said another code than the one that it ended with.
        assert_eq!(verdict(Some(&exit(4)), Some(Ending::Code(3))), expected);
    }

    #[test]
    fn a_signal_explains_a_lost_link() {
        let (said, code) = verdict(Some(&lost()), Some(Ending::Signal(Signal(11))));
        assert_eq!((said.as_str(), code), ("federate b was killed by signal 11 (SIGSEGV)", 1));
        // Without a status there is only what the RTI saw, and it names the federate already.
        let (said, _) = verdict(Some(&lost()), None);
        assert_eq!(said, "the process of federate b ended before its last tag");
    }

    #[test]
    fn witnesses_that_differ_are_both_heard() {
        let said = Report::new(Kind::Link, "its link is broken").of("b");
        let (told, code) = verdict(Some(&said), Some(Ending::Code(3)));
        assert_eq!((told.as_str(), code), ("federate b exited with code 3: its link is broken", 3));
        let (told, code) = verdict(Some(&said), Some(Ending::Code(0)));
        let expected = "federate b exited with code 0 before its last tag: its link is broken";
        assert_eq!((told.as_str(), code), (expected, 1));
    }

    #[test]
    fn what_the_exit_code_tells_is_not_told_twice() {
        let (said, _) = verdict(Some(&lost()), Some(Ending::Code(4)));
        assert_eq!(said, "federate b exited with code 4");
    }

    #[test]
    fn no_failure_has_exit_code_zero() {
        for code in [0, -1, 256, i32::MIN] {
            assert_eq!(verdict(None, Some(Ending::Code(code))).1, 1);
            let heard = Report { code, ..lost() };
            let failure = Failure::Federate(Box::new(heard));
            assert_eq!(Verdict::on_rti(&failure).code, 1);
        }
    }

    #[test]
    fn the_missing_are_named() {
        let absent = |names: &[&str]| Verdict::on_absent(names, 0.5).error.report().message.clone();
        assert_eq!(absent(&["a"]), "federate a did not join within 0.5 s");
        assert_eq!(absent(&["a", "b"]), "federates a, b did not join within 0.5 s");
    }

    #[test]
    fn before_joining_the_output_tells_more() {
        let error = Verdict::on_federate("b", false, None, Some(Ending::Code(3))).error;
        assert_eq!(error.report().message, "federate b exited with code 3 before it joined");
        assert!(error.report().hint.as_ref().is_some_and(|hint| hint.contains("hprm doctor")));
    }
}
