//! Why a federation failed, in words and as an exit code.
//!
//! Two witnesses tell of a federate's end: the RTI, which has its last words or has lost its link,
//! and the system, which has its exit status. They make one message. Which federate is to blame,
//! and when enough has been heard, is decided by the [`supervisor`](crate::supervisor).

use hprm::Failure;
use hprm_core::Nanos;

use crate::message::{self, Error};
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

/// What the RTI heard of a federate that cannot go on.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct LastWords {
    pub(crate) message: String,
    pub(crate) code: i32,
}

/// What to say about a failure, and the exit code that it leads to: never zero.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Verdict {
    pub(crate) error: Error,
    pub(crate) code: i32,
}

impl Verdict {
    /// A federate was the first to fail.
    pub(crate) fn on_federate(
        name: &str,
        joined: bool,
        words: Option<&LastWords>,
        ending: Option<Ending>,
    ) -> Self {
        let said = words.map_or("", |words| message::plain(&words.message));
        let announced = words.map(|words| words.code);
        let code = match ending {
            Some(Ending::Code(code)) if code != 0 => code,
            Some(Ending::Signal(_)) => 1,
            _ => announced.unwrap_or(1),
        };
        let error = match ending {
            Some(Ending::Signal(signal)) => killed(name, signal),
            Some(Ending::Code(code)) if announced != Some(code) => exited(name, joined, code, said),
            _ if said.is_empty() => exited(name, joined, code, said),
            _ if said.contains(&format!("federate {name}")) => Error::new(said),
            _ => Error::new(format!("federate {name}: {said}")),
        };
        Self { error, code: exit_code(code) }
    }

    /// Some federates did not join in time.
    pub(crate) fn on_absent(names: &[&str], seconds: f64) -> Self {
        let (noun, names) = match names {
            [name] => ("federate", (*name).to_owned()),
            _ => ("federates", names.join(", ")),
        };
        let error = Error::new(format!("{noun} {names} did not join within {seconds} s"))
            .hint("programs that take long to load need a longer --join-timeout");
        Self { error, code: 1 }
    }

    /// The RTI itself could not go on.
    pub(crate) fn on_rti(failure: &Failure) -> Self {
        let error = match message::plain(&failure.message) {
            "" => Error::new("the RTI failed and gave no reason"),
            message => Error::new(message),
        };
        Self { error, code: exit_code(failure.code) }
    }
}

/// A federate does not answer.
pub(crate) fn on_silent(name: &str, silence: Nanos) -> String {
    let seconds = silence / SECOND;
    format!("federate {name} has not answered for {seconds} s; whoever needs it waits")
}

/// A federate that did not answer does so again.
pub(crate) fn on_answer(name: &str, silence: Nanos) -> String {
    let tenths = silence / (SECOND / 10);
    format!("federate {name} answers again, after {}.{} s", tenths / 10, tenths % 10)
}

/// What of a failure's code the system can carry, and nobody takes for success.
fn exit_code(code: i32) -> i32 {
    if (1..=255).contains(&code) { code } else { 1 }
}

fn killed(name: &str, signal: Signal) -> Error {
    let error =
        Error::new(format!("federate {name} was killed by signal {}", signal.description()));
    match signal {
        Signal::KILL => error.hint("if nobody did that, the memory may have run out: see dmesg"),
        _ => error,
    }
}

/// `said` adds what the exit code does not tell; that the process has ended, it does tell.
fn exited(name: &str, joined: bool, code: i32, said: &str) -> Error {
    let said = if said.contains(&format!("federate {name}")) { "" } else { said };
    let when = match (joined, code) {
        (false, _) => " before it joined",
        (true, 0) => " before its last tag",
        (true, _) => "",
    };
    let colon = if said.is_empty() { "" } else { ": " };
    let error = Error::new(format!("federate {name} exited with code {code}{when}{colon}{said}"));
    if joined || !said.is_empty() {
        return error;
    }
    error.hint("if its own output does not say why, see what hprm doctor says")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(message: &str, code: i32) -> LastWords {
        LastWords { message: message.to_owned(), code }
    }

    fn verdict(words: Option<LastWords>, ending: Option<Ending>) -> (Error, i32) {
        let Verdict { error, code } = Verdict::on_federate("b", true, words.as_ref(), ending);
        (error, code)
    }

    #[test]
    fn a_federate_speaks_for_itself() {
        let said = words("error: reaction Main.b.1 raised ValueError: no\n  --> A.lf:3", 1);
        let expected =
            Error::new("federate b: reaction Main.b.1 raised ValueError: no\n  --> A.lf:3");
        for ending in [None, Some(Ending::Code(1))] {
            assert_eq!(verdict(Some(said.clone()), ending), (expected.clone(), 1));
        }
    }

    #[test]
    fn an_exit_without_words_is_told_by_its_code() {
        let expected = Error::new("federate b exited with code 3");
        assert_eq!(verdict(Some(words("", 3)), Some(Ending::Code(3))), (expected.clone(), 3));
        assert_eq!(verdict(Some(words("", 3)), None), (expected.clone(), 3));
        assert_eq!(verdict(None, Some(Ending::Code(3))), (expected, 3));
    }

    #[test]
    fn a_signal_explains_a_lost_link() {
        let lost = words("the process of federate b ended before its last tag", 1);
        let (error, code) = verdict(Some(lost.clone()), Some(Ending::Signal(Signal(11))));
        assert_eq!(error, Error::new("federate b was killed by signal 11 (SIGSEGV)"));
        assert_eq!(code, 1);
        // Without a status there is only what the RTI saw, and it names the federate already.
        let (error, _) = verdict(Some(lost), None);
        assert_eq!(error, Error::new("the process of federate b ended before its last tag"));
    }

    #[test]
    fn witnesses_that_differ_are_both_heard() {
        let lost = words("its link is lost", 1);
        let (error, code) = verdict(Some(lost.clone()), Some(Ending::Code(3)));
        assert_eq!(error, Error::new("federate b exited with code 3: its link is lost"));
        assert_eq!(code, 3);
        let (error, code) = verdict(Some(lost), Some(Ending::Code(0)));
        let told = "federate b exited with code 0 before its last tag: its link is lost";
        assert_eq!(error, Error::new(told));
        assert_eq!(code, 1);
    }

    #[test]
    fn what_the_exit_code_tells_is_not_told_twice() {
        let lost = words("the process of federate b ended before its last tag", 1);
        let (error, _) = verdict(Some(lost), Some(Ending::Code(4)));
        assert_eq!(error, Error::new("federate b exited with code 4"));
    }

    #[test]
    fn no_failure_has_exit_code_zero() {
        for code in [0, -1, 256, i32::MIN] {
            assert_eq!(verdict(Some(words("bad", code)), None).1, 1);
            assert_eq!(Verdict::on_rti(&Failure { message: "bad".to_owned(), code }).code, 1);
        }
    }

    #[test]
    fn the_missing_are_named() {
        let absent = |names: &[&str]| format!("{:?}", Verdict::on_absent(names, 0.5).error);
        assert!(absent(&["a"]).contains("federate a did not join within 0.5 s"));
        assert!(absent(&["a", "b"]).contains("federates a, b did not join within 0.5 s"));
    }

    #[test]
    fn before_joining_the_output_tells_more() {
        let error = Verdict::on_federate("b", false, None, Some(Ending::Code(3))).error;
        let text = format!("{error:?}");
        assert!(text.contains("federate b exited with code 3 before it joined"), "{text}");
        assert!(text.contains("hprm doctor"), "{text}");
    }
}
