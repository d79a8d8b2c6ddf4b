//! Why a federation failed, in words and as an exit code.
//!
//! Two sources tell how a federate ended: the RTI, which has its report or has lost its link, and the system,
//! which has its exit status. A verdict makes one report of both. The [`supervisor`](super) decides which
//! federate has caused the failure, and when it knows enough.

use hprm_core::Nanos;
use hprm_federated::show_silence;

use super::{Advice, Signal};
use crate::{Failure, Kind, Report, exit_code};

const SECOND: Nanos = 1_000_000_000;

/// How a federate ended: its process or, with a report, its thread.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum FederateEnding {
    /// By itself, with an exit code.
    Code(i32),
    /// By a signal.
    Signal(Signal),
    /// By a failure that it has reported.
    Failed(Box<Report>),
}

/// What to say about a failure, and the exit code that it leads to: never zero.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Verdict {
    /// What to say.
    pub report: Report,
    /// The exit code.
    pub code: i32,
}

impl Verdict {
    /// A federate was the first to fail. `rti_report` is the report of the RTI on it. With `absent`, the federate
    /// had not joined, and that is the advice then.
    #[must_use]
    pub fn on_federate(
        name: &str,
        absent: Option<Advice>,
        rti_report: Option<&Report>,
        ending: Option<&FederateEnding>,
    ) -> Self {
        let announced = rti_report.map(|report| report.code);
        let code = match ending {
            Some(FederateEnding::Code(code)) if *code != 0 => exit_code(*code),
            Some(FederateEnding::Signal(_)) => 1,
            Some(FederateEnding::Failed(report)) => exit_code(report.code),
            _ => announced.unwrap_or(1),
        };
        let report = match (ending, rti_report) {
            (Some(FederateEnding::Signal(signal)), _) => killed(name, *signal),
            (Some(FederateEnding::Code(ended)), _) if announced != Some(*ended) => {
                exited(name, absent, *ended, rti_report)
            }
            // The RTI may know no more than that it has lost the federate.
            (Some(FederateEnding::Failed(report)), rti_report)
                if rti_report.is_none_or(|rti_report| rti_report.kind == Kind::Lost) =>
            {
                report.clone().named()
            }
            (_, Some(report)) => report.clone().named(),
            (_, None) => exited(name, absent, code, None),
        };
        let federate = report.federate.clone().unwrap_or_else(|| name.to_owned());
        Self { report: Report { code, ..report.of(federate) }, code }
    }

    /// Some federates did not join in time, or all have joined and some did not load in time.
    pub(super) fn on_late_start(
        absent: &[&str],
        loading: &[&str],
        seconds: f64,
        advice: Advice,
    ) -> Self {
        let (names, what) = match absent {
            [] => (loading, "load its program"),
            _ => (absent, "join"),
        };
        let said = match names {
            [name] => format!("federate {name} did not {what} within {seconds} s"),
            _ => {
                let what = what.replace("its program", "their programs");
                format!("federates {} did not {what} within {seconds} s", names.join(", "))
            }
        };
        let report = Report::new(Kind::Absent, said).hint(advice.late_start);
        Self { report, code: 1 }
    }

    /// The RTI itself has failed.
    #[must_use]
    pub fn on_rti(failure: &Failure) -> Self {
        Self { report: failure.report(), code: exit_code(failure.exit_code()) }
    }
}

/// A federate does not answer.
#[must_use]
pub fn on_silent(name: &str, silence: Nanos) -> String {
    let time = show_silence(silence);
    format!("federate {name} has not answered for {time}; federates that need its messages wait")
}

/// A federate that did not answer does so again.
#[must_use]
pub fn on_answer(name: &str, silence: Nanos) -> String {
    let tenths = silence / (SECOND / 10);
    format!("federate {name} answers again, after {}.{} s", tenths / 10, tenths % 10)
}

fn killed(name: &str, signal: Signal) -> Report {
    let said = format!("federate {name} was killed by signal {signal}");
    let report = Report::new(Kind::Killed, said);
    match signal {
        Signal::KILL => {
            report.hint("if you did not kill it, the system may have had no memory left: see dmesg")
        }
        _ => report,
    }
}

/// The report of a process that has exited. `rti_report` counts only if it says more than that the process has
/// ended, or with which code.
fn exited(name: &str, absent: Option<Advice>, code: i32, rti_report: Option<&Report>) -> Report {
    let rti_report =
        rti_report.filter(|report| report.kind != Kind::Lost && !report.is_only_code());
    let when = match (absent, code) {
        (Some(_), _) => " before it joined",
        (None, 0) => " before its last tag",
        (None, _) => "",
    };
    let exited = format!("federate {name} exited with code {code}{when}");
    if let Some(report) = rti_report {
        let message = format!("{exited}: {}", report.message);
        return Report { message, rendered: None, ..report.clone() };
    }
    let report = Report::new(kind_of_code(code), exited);
    match absent {
        Some(advice) => report.hint(advice.unexplained),
        None => report,
    }
}

/// What an exit code says by itself: 128 and the number of a signal that asks a process to end says that the
/// signal has stopped it, as shells and `hprm` have it.
fn kind_of_code(code: i32) -> Kind {
    let signals = [Signal::HANG_UP, Signal::INTERRUPT, Signal::TERMINATE];
    match signals.iter().any(|signal| signal.exit_code() == code) {
        true => Kind::Interrupted,
        false => Kind::Exit,
    }
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
    fn verdict(rti_report: Option<&Report>, ending: Option<FederateEnding>) -> (String, i32) {
        let Verdict { report, code } = Verdict::on_federate("b", None, rti_report, ending.as_ref());
        assert_eq!(report.code, code);
        assert_eq!(report.federate.as_deref(), Some("b"));
        (report.message.clone(), code)
    }

    #[test]
    fn a_federate_speaks_for_itself() {
        let said = raised("reaction Main.b.1 raised ValueError: no");
        let expected = "federate b: reaction Main.b.1 raised ValueError: no";
        for ending in [None, Some(FederateEnding::Code(1))] {
            assert_eq!(verdict(Some(&said), ending.clone()), (expected.to_owned(), 1));
            let report = Verdict::on_federate("b", None, Some(&said), ending.as_ref()).report;
            assert_eq!((report.kind, report.line), (Kind::Reaction, Some(3)));
        }
    }

    #[test]
    fn an_exit_without_words_is_told_by_its_code() {
        let expected = ("federate b exited with code 3".to_owned(), 3);
        assert_eq!(verdict(Some(&exit(3)), Some(FederateEnding::Code(3))), expected);
        assert_eq!(verdict(Some(&exit(3)), None), expected);
        assert_eq!(verdict(None, Some(FederateEnding::Code(3))), expected);
        // It has said another code than the one that it ended with.
        assert_eq!(verdict(Some(&exit(4)), Some(FederateEnding::Code(3))), expected);
    }

    #[test]
    fn an_exit_code_of_a_signal_is_an_interruption() {
        let kind = |rti_report: Option<&Report>, code| {
            let ending = FederateEnding::Code(code);
            let Verdict { report, code: kept } =
                Verdict::on_federate("b", None, rti_report, Some(&ending));
            assert_eq!(report.message, format!("federate b exited with code {code}"));
            assert_eq!(kept, code);
            report.kind
        };
        for signal in [Signal::HANG_UP, Signal::INTERRUPT, Signal::TERMINATE] {
            let code = signal.exit_code();
            assert_eq!(kind(None, code), Kind::Interrupted);
            assert_eq!(kind(Some(&lost()), code), Kind::Interrupted);
            // It has told the RTI that the program chose this code.
            assert_eq!(kind(Some(&exit(code)), code), Kind::Exit);
        }
        assert_eq!(kind(None, 3), Kind::Exit);
        assert_eq!(kind(None, Signal::KILL.exit_code()), Kind::Exit);
    }

    #[test]
    fn a_signal_explains_a_lost_link() {
        let (said, code) = verdict(Some(&lost()), Some(FederateEnding::Signal(Signal(11))));
        assert_eq!((said.as_str(), code), ("federate b was killed by signal 11 (SIGSEGV)", 1));
        // Without a status there is only what the RTI saw, and it names the federate already.
        let (said, _) = verdict(Some(&lost()), None);
        assert_eq!(said, "the process of federate b ended before its last tag");
    }

    #[test]
    fn reports_that_differ_are_combined() {
        let said = Report::new(Kind::Link, "its link is broken").of("b");
        let (told, code) = verdict(Some(&said), Some(FederateEnding::Code(3)));
        assert_eq!((told.as_str(), code), ("federate b exited with code 3: its link is broken", 3));
        let (told, code) = verdict(Some(&said), Some(FederateEnding::Code(0)));
        let expected = "federate b exited with code 0 before its last tag: its link is broken";
        assert_eq!((told.as_str(), code), (expected, 1));
    }

    #[test]
    fn a_thread_tells_of_its_failure_itself() {
        let failed = FederateEnding::Failed(Box::new(Report { code: 3, ..raised("no").of("b") }));
        let expected = ("federate b: no".to_owned(), 3);
        assert_eq!(verdict(None, Some(failed.clone())), expected);
        // That its link has ended is a consequence.
        assert_eq!(verdict(Some(&lost()), Some(failed.clone())), expected);
        assert_eq!(verdict(Some(&raised("yes")), Some(failed)).0, "federate b: yes");
    }

    #[test]
    fn what_the_exit_code_tells_is_not_told_twice() {
        let (said, _) = verdict(Some(&lost()), Some(FederateEnding::Code(4)));
        assert_eq!(said, "federate b exited with code 4");
    }

    #[test]
    fn no_failure_has_exit_code_zero() {
        // As the system and Python have it, the last eight bits count.
        for (code, kept) in [(0, 1), (-1, 255), (256, 1), (259, 3), (i32::MIN, 1)] {
            assert_eq!(verdict(None, Some(FederateEnding::Code(code))).1, kept);
            let rti_report = Report { code, ..lost() };
            let failure = Failure::FederateFailed(Box::new(rti_report));
            assert_eq!(Verdict::on_rti(&failure).code, kept);
        }
    }

    #[test]
    fn the_missing_are_named() {
        let late = |absent: &[&str], loading: &[&str]| {
            Verdict::on_late_start(absent, loading, 0.5, Advice::COMMAND).report.message
        };
        assert_eq!(late(&["a"], &["c"]), "federate a did not join within 0.5 s");
        assert_eq!(late(&["a", "b"], &[]), "federates a, b did not join within 0.5 s");
        assert_eq!(late(&[], &["a"]), "federate a did not load its program within 0.5 s");
        assert_eq!(
            late(&[], &["a", "b"]),
            "federates a, b did not load their programs within 0.5 s"
        );
    }

    #[test]
    fn before_joining_the_output_tells_more() {
        let told = |advice| {
            let ending = FederateEnding::Code(3);
            Verdict::on_federate("b", Some(advice), None, Some(&ending)).report
        };
        let report = told(Advice::COMMAND);
        assert_eq!(report.message, "federate b exited with code 3 before it joined");
        assert!(report.hint.as_ref().is_some_and(|hint| hint.contains("hprm doctor")));
        assert!(told(Advice::PROGRAM).hint.is_some_and(|hint| !hint.contains("hprm")));
    }
}
