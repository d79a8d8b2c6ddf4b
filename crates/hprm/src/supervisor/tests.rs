//! The supervisor under a script: events at times, and the orders that follow.

use hprm_core::{Nanos, PhysicalTime, ProgramBuilder, Properties};

use super::*;

pub(super) const A: FederateId = FederateId(0);
pub(super) const B: FederateId = FederateId(1);
const JOIN: Duration = Duration::from_secs(30);

/// With two federates, of which b may be transient.
fn program(transient: bool) -> Program {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    for name in ["a", "b"] {
        let reactor = b.reactor(b.main(), name);
        let federate = b.federate(reactor, name, Nanos::MAX, None);
        if transient && name == "b" {
            b.make_transient(federate);
        }
    }
    b.build().expect("it is empty")
}

/// A supervisor of two federates, and its clock.
pub(super) struct Stage {
    pub(super) supervisor: Supervisor,
    pub(super) now: Duration,
    pub(super) reports: Vec<String>,
    pub(super) sent: Vec<(i32, FederateId)>,
    stops: usize,
    /// Federates that are started again, and when.
    pub(super) started: Vec<(FederateId, u128)>,
}

impl Stage {
    /// No federate has joined.
    fn empty() -> Self {
        Self::of(&program(false))
    }

    pub(super) fn of(program: &Program) -> Self {
        Self::with(Supervisor::new(program, Members::Processes, JOIN))
    }

    fn with(supervisor: Supervisor) -> Self {
        let (reports, sent, stops, started) = (Vec::new(), Vec::new(), 0, Vec::new());
        Self { supervisor, now: Duration::ZERO, reports, sent, stops, started }
    }

    /// All have joined and run.
    fn running() -> Self {
        let mut stage = Self::empty();
        stage.start();
        stage
    }

    /// The same with threads instead of processes.
    fn threads() -> Self {
        let forever = Duration::MAX;
        Self::with(Supervisor::new(&program(false), Members::Threads, forever))
    }

    fn start(&mut self) {
        self.rti(RtiEvent::Joined { federate: A, launched: true });
        self.rti(RtiEvent::Joined { federate: B, launched: true });
        self.rti(RtiEvent::Started(PhysicalTime(0)));
    }

    /// A process joins that this supervisor has launched or a user, and takes part.
    pub(super) fn enters(&mut self, federate: FederateId, launched: bool) {
        self.rti(RtiEvent::Joined { federate, launched });
        self.rti(RtiEvent::Entered(federate));
    }

    pub(super) fn event(&mut self, event: Observation) {
        self.supervisor.handle(self.now, event);
        self.collect();
    }

    pub(super) fn rti(&mut self, event: RtiEvent) {
        self.event(Observation::Rti(event));
    }

    pub(super) fn exits(&mut self, federate: FederateId, how: FederateEnding) {
        self.event(Observation::Ended { federate, how });
    }

    fn fails(&mut self, federate: FederateId, message: &str, code: i32) {
        let name = if federate == A { "a" } else { "b" };
        self.rti(RtiEvent::Failed { federate, report: said(message, code).of(name) });
    }

    /// Lets time pass, as the loop does: from one wake-up to the next.
    pub(super) fn pass(&mut self, millis: u64) {
        let until = self.now + Duration::from_millis(millis);
        while let Some(at) = self.supervisor.next_wakeup().filter(|at| *at <= until) {
            self.now = at;
            self.supervisor.tick(at);
            self.collect();
        }
        self.now = until;
    }

    fn collect(&mut self) {
        while let Some(order) = self.supervisor.poll() {
            match order {
                Order::RequestStop => self.stops += 1,
                Order::Send { signal, to } => self.sent.push((signal.0, to)),
                Order::Start(federate) => self.started.push((federate, self.now.as_millis())),
                Order::Report(error) | Order::Warn(error) => {
                    self.reports.push(format!("{error:?}"));
                }
            }
        }
    }

    pub(super) fn outcome(&self) -> Option<i32> {
        self.supervisor.outcome(self.now)
    }

    #[track_caller]
    pub(super) fn reported_once(&self, text: &str) {
        assert_eq!(self.reports.len(), 1, "{:?}", self.reports);
        assert!(self.reports[0].contains(text), "{:?}", self.reports);
    }
}

/// What a federate says of itself: that it ends with this code if there is no message.
pub(super) fn said(message: &str, code: i32) -> Report {
    let kind = if message.is_empty() { Kind::Exit } else { Kind::Reaction };
    Report { code, ..Report::new(kind, message) }
}

pub(super) const TERM: i32 = Signal::TERMINATE.0;
const INT: i32 = Signal::INTERRUPT.0;
pub(super) const KILL: i32 = Signal::KILL.0;

#[test]
fn all_is_well_once_all_federates_and_the_rti_have_ended() {
    let mut stage = Stage::running();
    stage.exits(A, FederateEnding::Code(0));
    stage.pass(60_000);
    assert_eq!(stage.outcome(), None, "a federate may leave long before the others");
    stage.exits(B, FederateEnding::Code(0));
    assert_eq!(stage.outcome(), None, "the RTI may still tell of a failure");
    stage.event(Observation::RtiEnded(Ok(())));
    assert_eq!(stage.outcome(), Some(0));
    assert!(stage.reports.is_empty() && stage.sent.is_empty());
}

#[test]
fn an_rti_that_does_not_end_is_not_waited_for() {
    let mut stage = Stage::running();
    stage.exits(A, FederateEnding::Code(0));
    stage.exits(B, FederateEnding::Code(0));
    stage.pass(499);
    assert_eq!(stage.outcome(), None);
    stage.pass(1);
    assert_eq!(stage.outcome(), Some(0));
}

#[test]
fn the_first_failure_is_reported_and_what_follows_is_not() {
    let mut stage = Stage::running();
    stage.fails(B, "reaction Main.b.1 raised ValueError: no", 1);
    stage.exits(A, FederateEnding::Code(1));
    assert!(stage.reports.is_empty(), "the exit status of b is not known yet");
    stage.exits(B, FederateEnding::Code(1));
    stage.reported_once("federate b: reaction Main.b.1 raised ValueError: no");
    assert_eq!(stage.outcome(), Some(1));
    assert!(stage.sent.is_empty());
}

#[test]
fn a_consequence_seen_first_is_not_the_cause() {
    let mut stage = Stage::running();
    stage.exits(A, FederateEnding::Code(1));
    stage.pass(100);
    stage.fails(B, "", 3);
    stage.exits(B, FederateEnding::Code(3));
    stage.reported_once("federate b exited with code 3");
    assert_eq!(stage.outcome(), Some(3));
}

#[test]
fn a_killed_federate_is_told_from_a_lost_link() {
    for rti_first in [false, true] {
        let mut stage = Stage::running();
        if rti_first {
            stage.fails(B, "its process ended before its last tag", 1);
            stage.pass(10);
        }
        stage.exits(B, FederateEnding::Signal(Signal::KILL));
        if !rti_first {
            stage.fails(B, "its process ended before its last tag", 1);
        }
        stage.exits(A, FederateEnding::Code(1));
        stage.reported_once("federate b was killed by signal 9 (SIGKILL)");
        assert_eq!(stage.outcome(), Some(1));
    }
}

#[test]
fn a_federate_that_hangs_after_its_failure_is_not_waited_for() {
    let mut stage = Stage::running();
    stage.fails(B, "bad", 4);
    stage.pass(500);
    stage.reported_once("federate b: bad");
    stage.exits(A, FederateEnding::Code(1));
    stage.pass(1_999);
    assert_eq!(stage.sent, []);
    stage.pass(1);
    assert_eq!(stage.sent, [(TERM, B)]);
    stage.pass(1_000);
    assert_eq!(stage.sent, [(TERM, B), (KILL, B)]);
    assert!(stage.reports[1].contains("ends federates that have not ended within 2 s: b"));
    assert!(stage.reports[2].contains("killed federates that did not end by themselves: b"));
    stage.exits(B, FederateEnding::Signal(Signal::KILL));
    assert_eq!(stage.reports.len(), 3, "the end that was ordered is no news");
    assert_eq!(stage.outcome(), Some(4));
}

#[test]
fn an_end_without_a_word_is_a_failure_after_the_grace() {
    let mut stage = Stage::running();
    stage.exits(B, FederateEnding::Code(3));
    stage.pass(499);
    assert!(stage.reports.is_empty());
    stage.pass(1);
    stage.reported_once("federate b exited with code 3");
}

#[test]
fn before_the_start_the_others_are_ended_at_once() {
    let mut stage = Stage::empty();
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.exits(B, FederateEnding::Code(3));
    stage.pass(500);
    stage.reported_once("federate b exited with code 3 before it joined");
    assert_eq!(stage.sent, [(TERM, A)]);
    stage.exits(A, FederateEnding::Signal(Signal::TERMINATE));
    assert_eq!(stage.reports.len(), 1);
    assert_eq!(stage.outcome(), Some(3));
}

#[test]
fn leaving_before_joining_is_a_failure_even_with_code_zero() {
    let mut stage = Stage::empty();
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.exits(B, FederateEnding::Code(0));
    stage.pass(500);
    stage.reported_once("federate b exited with code 0 before it joined");
    stage.exits(A, FederateEnding::Signal(Signal::TERMINATE));
    assert_eq!(stage.outcome(), Some(1));
}

#[test]
fn leaving_after_joining_is_a_failure_too_if_the_others_have_not_joined() {
    let mut stage = Stage::empty();
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.rti(RtiEvent::Left(A));
    stage.exits(A, FederateEnding::Code(0));
    stage.pass(500);
    stage.reported_once("federate a exited with code 0 before its last tag");
    stage.exits(B, FederateEnding::Signal(Signal::TERMINATE));
    assert_eq!(stage.outcome(), Some(1));
}

#[test]
fn a_federate_that_has_left_and_joined_again_is_not_missed() {
    let mut stage = Stage::empty();
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.rti(RtiEvent::Left(A));
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.rti(RtiEvent::Joined { federate: B, launched: true });
    stage.rti(RtiEvent::Started(PhysicalTime(0)));
    stage.exits(A, FederateEnding::Code(0));
    stage.exits(B, FederateEnding::Code(0));
    stage.pass(500);
    assert_eq!(stage.reports.len(), 0);
    assert_eq!(stage.outcome(), Some(0));
}

#[test]
fn news_of_joining_may_come_after_the_end() {
    let mut stage = Stage::empty();
    stage.exits(A, FederateEnding::Code(0));
    stage.exits(B, FederateEnding::Code(0));
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.rti(RtiEvent::Joined { federate: B, launched: true });
    stage.rti(RtiEvent::Started(PhysicalTime(0)));
    stage.event(Observation::RtiEnded(Ok(())));
    assert_eq!(stage.outcome(), Some(0));
    assert!(stage.reports.is_empty());
}

#[test]
fn the_missing_are_waited_for_until_the_time_is_over() {
    let mut stage = Stage::empty();
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.pass(29_999);
    assert!(stage.reports.is_empty());
    stage.pass(1);
    stage.reported_once("federate b did not join within 30 s");
    assert_eq!(stage.sent, [(TERM, A), (TERM, B)]);
}

#[test]
fn those_that_load_are_waited_for_until_the_time_is_over() {
    let mut stage = Stage::empty();
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.rti(RtiEvent::Joined { federate: B, launched: true });
    stage.rti(RtiEvent::Loaded(B));
    stage.pass(29_999);
    assert!(stage.reports.is_empty());
    stage.pass(1);
    stage.reported_once("federate a did not load its program within 30 s");
    assert_eq!(stage.sent, [(TERM, A), (TERM, B)]);
}

#[test]
fn after_the_start_no_time_is_over() {
    let mut stage = Stage::running();
    stage.pass(1_000_000);
    assert!(stage.reports.is_empty());
}

#[test]
fn an_interrupt_stops_in_order() {
    let mut stage = Stage::running();
    stage.event(Observation::Signal(Signal::INTERRUPT));
    assert_eq!((stage.stops, stage.sent.len()), (1, 0));
    stage.exits(A, FederateEnding::Code(0));
    stage.exits(B, FederateEnding::Code(0));
    stage.event(Observation::RtiEnded(Ok(())));
    assert_eq!(stage.outcome(), Some(130));
    assert!(stage.reports.is_empty());
}

#[test]
fn a_second_interrupt_kills() {
    let mut stage = Stage::running();
    stage.event(Observation::Signal(Signal::INTERRUPT));
    stage.exits(A, FederateEnding::Code(0));
    // The same one, by another way.
    stage.event(Observation::Signal(Signal::INTERRUPT));
    assert_eq!((stage.stops, stage.sent.len()), (1, 0));
    stage.pass(100);
    stage.event(Observation::Signal(Signal::INTERRUPT));
    assert_eq!(stage.sent, [(KILL, B)]);
    stage.event(Observation::Signal(Signal::INTERRUPT));
    stage.exits(B, FederateEnding::Signal(Signal::KILL));
    assert_eq!(stage.outcome(), Some(130));
    stage.reported_once("killed federates that had not ended at the second signal: b");
}

#[test]
fn an_interrupt_that_is_not_obeyed_says_what_is_ended_and_why() {
    let mut stage = Stage::running();
    stage.event(Observation::Signal(Signal::TERMINATE));
    stage.exits(A, FederateEnding::Code(0));
    stage.pass(4_999);
    assert!(stage.reports.is_empty());
    stage.pass(1);
    stage.reported_once("ends federates that have not stopped in order within 5 s: b");
    stage.exits(B, FederateEnding::Signal(Signal::TERMINATE));
    assert_eq!((stage.outcome(), stage.reports.len()), (Some(143), 1));
}

#[test]
fn an_orderly_stop_takes_five_seconds_at_most() {
    let mut stage = Stage::running();
    stage.event(Observation::Signal(Signal::TERMINATE));
    stage.pass(1_999);
    assert!(stage.sent.is_empty());
    stage.pass(1);
    assert_eq!(stage.sent, [(INT, A), (INT, B)], "they say what keeps them");
    stage.pass(2_999);
    assert_eq!(stage.sent.len(), 2);
    stage.pass(1);
    assert_eq!(stage.sent[2..], [(TERM, A), (TERM, B)]);
    stage.pass(1_000);
    assert_eq!(stage.sent[4..], [(KILL, A), (KILL, B)]);
    stage.pass(999);
    assert_eq!(stage.outcome(), None);
    stage.pass(1);
    assert_eq!(stage.outcome(), Some(143), "even if nothing reports their end");
}

#[test]
fn an_interrupt_may_reach_the_federates_too() {
    let mut stage = Stage::running();
    stage.event(Observation::Signal(Signal::INTERRUPT));
    let interrupted = || FederateEnding::Code(Signal::INTERRUPT.exit_code());
    stage.exits(A, interrupted());
    stage.exits(B, interrupted());
    stage.event(Observation::RtiEnded(Ok(())));
    stage.pass(2_000);
    assert_eq!((stage.reports.len(), stage.outcome()), (0, Some(130)));
    assert!(stage.supervisor.is_interrupted());
    // Without a signal here, it is a failure like any other.
    let mut stage = Stage::running();
    stage.exits(A, interrupted());
    stage.pass(2_000);
    stage.reported_once("federate a exited with code 130");
    assert!(!stage.supervisor.is_interrupted());
}

#[test]
fn a_failure_while_stopping_is_reported_but_the_interrupt_counts() {
    let mut stage = Stage::running();
    stage.event(Observation::Signal(Signal::INTERRUPT));
    stage.fails(A, "shutdown raised ValueError", 1);
    stage.exits(A, FederateEnding::Code(1));
    stage.exits(B, FederateEnding::Code(1));
    stage.reported_once("federate a: shutdown raised ValueError");
    assert_eq!(stage.outcome(), Some(130));
}

#[test]
fn an_interrupt_after_a_failure_kills_and_keeps_the_code() {
    let mut stage = Stage::running();
    stage.fails(A, "", 3);
    stage.exits(A, FederateEnding::Code(3));
    stage.event(Observation::Signal(Signal::INTERRUPT));
    assert_eq!(stage.sent, [(KILL, B)]);
    stage.exits(B, FederateEnding::Signal(Signal::KILL));
    assert_eq!(stage.outcome(), Some(3));
}

#[test]
fn an_interrupt_before_the_start_ends_all_at_once() {
    let mut stage = Stage::empty();
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.event(Observation::Signal(Signal::INTERRUPT));
    assert_eq!(stage.sent, [(TERM, A), (TERM, B)]);
    stage.exits(A, FederateEnding::Signal(Signal::TERMINATE));
    stage.exits(B, FederateEnding::Signal(Signal::TERMINATE));
    assert_eq!(stage.outcome(), Some(130));
    assert!(stage.reports.is_empty());
}

#[test]
fn a_broken_pipe_is_not_a_second_interrupt() {
    let mut stage = Stage::running();
    stage.event(Observation::Signal(Signal::BROKEN_PIPE));
    stage.event(Observation::Signal(Signal::BROKEN_PIPE));
    assert_eq!((stage.stops, stage.sent.len()), (1, 0));
    stage.exits(A, FederateEnding::Code(0));
    stage.exits(B, FederateEnding::Code(0));
    stage.event(Observation::RtiEnded(Ok(())));
    assert_eq!(stage.outcome(), Some(141));
}

/// A federation whose output cannot be written; each federate reports that.
fn unwritable() -> Stage {
    let mut stage = Stage::running();
    for _ in 0..2 {
        let report = Report::new(Kind::Command, "the disk is full");
        stage.event(Observation::Unwritable(Box::new(report)));
    }
    stage.reported_once("the disk is full");
    stage
}

#[test]
fn a_federation_whose_output_cannot_be_written_stops_in_order() {
    let mut stage = unwritable();
    assert_eq!((stage.stops, stage.sent.len()), (1, 0));
    stage.exits(A, FederateEnding::Code(0));
    stage.exits(B, FederateEnding::Code(0));
    stage.event(Observation::RtiEnded(Ok(())));
    assert_eq!((stage.outcome(), stage.reports.len()), (Some(1), 1));
}

#[test]
fn output_that_cannot_be_written_is_one_failure() {
    let mut stage = unwritable();
    stage.pass(5_000);
    assert!(stage.sent.ends_with(&[(TERM, A), (TERM, B)]));
    stage.exits(A, FederateEnding::Signal(Signal::TERMINATE));
    stage.exits(B, FederateEnding::Signal(Signal::TERMINATE));
    assert_eq!((stage.outcome(), stage.reports.len()), (Some(1), 2));
    let warning = "ends federates that have not stopped in order within 5 s: a, b";
    assert!(stage.reports[1].contains(warning));
}

#[test]
fn the_end_of_the_rti_explains_the_end_of_the_others() {
    let mut stage = Stage::running();
    let failure = Failure::System { message: "no descriptor left".to_owned(), hint: None };
    stage.event(Observation::RtiEnded(Err(failure)));
    stage.exits(A, FederateEnding::Code(1));
    stage.exits(B, FederateEnding::Code(1));
    stage.pass(500);
    stage.reported_once("no descriptor left");
    assert_eq!(stage.outcome(), Some(1));
}

/// a runs; b is transient and has not joined.
fn without_the_transient() -> Stage {
    let mut stage = Stage::of(&program(true));
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.rti(RtiEvent::Started(PhysicalTime(0)));
    stage
}

fn dropped(message: &str, code: i32) -> RtiEvent {
    RtiEvent::Dropped { federate: B, report: said(message, code).of("b") }
}

#[test]
fn a_transient_federate_need_not_join() {
    let mut stage = without_the_transient();
    stage.pass(40_000);
    assert!(stage.reports.is_empty());
    for federate in [B, A] {
        stage.exits(federate, FederateEnding::Code(0));
    }
    stage.event(Observation::RtiEnded(Ok(())));
    assert_eq!(stage.outcome(), Some(0));
}

#[test]
fn a_transient_federate_fails_alone() {
    let mut stage = without_the_transient();
    stage.enters(B, true);
    stage.rti(dropped("no", 7));
    assert!(stage.reports.is_empty());
    stage.exits(B, FederateEnding::Code(7));
    stage.reported_once("federate b: no");
    stage.pass(10_000);
    assert!(stage.sent.is_empty() && stage.stops == 0);
    // The user starts it again, and it fails again.
    stage.enters(B, false);
    stage.rti(dropped("no again", 1));
    stage.pass(500);
    assert_eq!(stage.reports.len(), 2);
    stage.exits(A, FederateEnding::Code(0));
    stage.event(Observation::RtiEnded(Ok(())));
    assert_eq!(stage.outcome(), Some(7));
}

#[test]
fn an_end_of_a_transient_federate_without_a_word_is_told_after_the_grace() {
    let mut stage = without_the_transient();
    stage.exits(B, FederateEnding::Signal(Signal::KILL));
    stage.pass(499);
    assert!(stage.reports.is_empty());
    stage.exits(A, FederateEnding::Code(0));
    stage.event(Observation::RtiEnded(Ok(())));
    assert_eq!(stage.outcome(), None);
    stage.pass(1);
    stage.reported_once("federate b was killed by signal 9");
    assert_eq!(stage.outcome(), Some(1));
}

#[test]
fn threads_that_do_not_end_end_with_the_process() {
    let mut stage = Stage::threads();
    stage.start();
    stage.exits(A, FederateEnding::Failed(Box::new(said("no", 3).of("a"))));
    stage.pass(500);
    stage.reported_once("federate a: no");
    stage.pass(1_999);
    assert_eq!(stage.outcome(), None);
    stage.pass(1);
    assert_eq!(stage.outcome(), Some(3));
    assert!(
        stage.reports[1].contains("ends federates that have not ended within 2 s: b"),
        "{:?}",
        stage.reports
    );
    assert_eq!((stage.sent.len(), stage.stops), (0, 0));
}

#[test]
fn threads_have_time_to_end_before_the_start_too() {
    let mut stage = Stage::threads();
    stage.exits(A, FederateEnding::Failed(Box::new(said("no", 1).of("a"))));
    stage.pass(500);
    assert_eq!(stage.outcome(), None);
    stage.exits(B, FederateEnding::Failed(Box::new(said("federate a has failed", 1).of("a"))));
    assert_eq!(stage.outcome(), Some(1));
    stage.reported_once("federate a: no");
}

#[test]
fn a_second_interrupt_ends_threads_at_once() {
    let mut stage = Stage::threads();
    stage.start();
    stage.event(Observation::Signal(Signal::INTERRUPT));
    assert_eq!((stage.stops, stage.outcome()), (1, None));
    stage.pass(4_000);
    stage.event(Observation::Signal(Signal::INTERRUPT));
    assert_eq!((stage.sent.len(), stage.outcome()), (0, Some(130)));
    stage.reported_once("killed federates that had not ended at the second signal: a, b");
}

#[test]
fn an_interrupt_before_the_start_ends_threads_at_once() {
    let mut stage = Stage::threads();
    stage.event(Observation::Signal(Signal::TERMINATE));
    assert_eq!((stage.stops, stage.outcome()), (0, Some(143)));
    assert!(stage.reports.is_empty());
}

#[test]
fn what_comes_due_while_the_driver_carries_out_orders_is_done() {
    let mut stage = Stage::running();
    stage.event(Observation::Signal(Signal::TERMINATE));
    let limit = stage.now + AFTER_INTERRUPT;
    // An event comes just before the limit; the driver asks for the next wakeup just after it.
    stage.now = limit - Duration::from_nanos(1);
    stage.rti(RtiEvent::Left(A));
    assert_eq!(stage.supervisor.next_wakeup(), Some(limit));
    stage.now = limit + Duration::from_millis(3);
    assert_eq!(stage.supervisor.next_wakeup(), Some(limit));
    stage.pass(0);
    assert!(stage.sent.contains(&(TERM, B)), "{:?}", stage.sent);
}
