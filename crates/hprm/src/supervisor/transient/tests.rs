//! Federates that are started again, under a script: events at times, and the orders that follow.

use hprm_core::{
    Nanos, PhysicalTime, Program, ProgramBuilder, Properties, Restart, RestartCondition,
};
use proptest::prelude::*;

use super::super::tests::{A, B, KILL, Stage, TERM, said};
use super::super::{FederateEnding, Observation, Refusal};
use super::*;
use crate::RtiEvent;

const SIGKILL: FederateEnding = FederateEnding::Signal(Signal::KILL);
const DONE: FederateEnding = FederateEnding::Code(0);

/// With two federates, of which b is transient, and perhaps started again.
fn program(restart: Option<Restart>) -> Program {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    for name in ["a", "b"] {
        let reactor = b.reactor(b.main(), name);
        let federate = b.federate(reactor, name, Nanos::MAX, None);
        if name == "b" {
            b.make_transient(federate);
            restart.into_iter().for_each(|restart| b.restart(federate, restart));
        }
    }
    b.build().expect("it is empty")
}

/// 200 ms after its end, three times within 10 s at most.
fn restart(condition: RestartCondition) -> Restart {
    Restart { pause: 200_000_000, burst: 3, ..Restart::new(condition) }
}

/// Both run.
fn running(condition: RestartCondition) -> Stage {
    started(Some(restart(condition)))
}

fn started(restart: Option<Restart>) -> Stage {
    let mut stage = Stage::of(&program(restart));
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.rti(RtiEvent::Joined { federate: B, launched: true });
    stage.rti(RtiEvent::Started(PhysicalTime(0)));
    stage
}

fn lost() -> RtiEvent {
    RtiEvent::Dropped { federate: B, report: Report::new(Kind::Lost, "it is lost").of("b") }
}

/// A process joins as b, which this supervisor has started or a user.
fn joins(stage: &mut Stage, launched: bool) {
    stage.rti(RtiEvent::Joined { federate: B, launched });
}

/// The process that was joining as b is killed.
fn withdraws(stage: &mut Stage) {
    let report = Some(Report::new(Kind::Lost, "it is lost").of("b"));
    stage.rti(RtiEvent::Withdrawn { federate: B, report });
}

fn refused(stage: &mut Stage, reason: Refusal) {
    stage.rti(RtiEvent::Refused { name: "b".to_owned(), reason });
}

/// b is killed, and the RTI notices.
fn kill(stage: &mut Stage) {
    stage.exits(B, SIGKILL);
    stage.rti(lost());
}

/// The federation ends in order, with b or without.
fn end(stage: &mut Stage, of_b: Option<FederateEnding>) {
    stage.rti(RtiEvent::Closing);
    of_b.into_iter().for_each(|how| stage.exits(B, how));
    stage.exits(A, DONE);
    stage.event(Observation::RtiEnded(Ok(())));
    stage.pass(500);
}

#[test]
fn it_is_started_again_after_the_pause_and_that_makes_up_for_the_failure() {
    let mut stage = running(RestartCondition::OnFailure);
    stage.pass(1_000);
    kill(&mut stage);
    stage.reported_once(
        "federate b was killed by signal 9 (SIGKILL); restart 1 follows, after 200 ms",
    );
    stage.pass(199);
    assert_eq!(stage.started, []);
    stage.pass(1);
    assert_eq!(stage.started, [(B, 1_200)]);
    stage.enters(B, true);
    stage.rti(RtiEvent::Closing);
    stage.exits(B, DONE);
    stage.exits(A, DONE);
    stage.event(Observation::RtiEnded(Ok(())));
    assert_eq!((stage.outcome(), stage.reports.len()), (Some(0), 1));
}

#[test]
fn an_end_that_the_rti_does_not_tell_of_is_enough() {
    let mut stage = running(RestartCondition::OnFailure);
    stage.exits(B, FederateEnding::Code(3));
    stage.pass(499);
    assert_eq!(stage.reports.len(), 0);
    stage.pass(1);
    stage.reported_once("federate b exited with code 3; restart 1");
    assert_eq!(stage.started, [(B, 500)]);
    // The RTI tells of the first process when the second one is there, and not in the federation yet.
    stage.rti(lost());
    stage.pass(5_000);
    assert_eq!((stage.started.len(), stage.reports.len(), stage.sent.len()), (1, 1, 0));
}

#[test]
fn one_that_fails_each_time_runs_into_the_limit_and_the_others_go_on() {
    let mut stage = running(RestartCondition::OnFailure);
    for _ in 0..3 {
        kill(&mut stage);
        stage.pass(200);
        stage.enters(B, true);
    }
    assert_eq!(stage.started, [(B, 200), (B, 400)]);
    assert_eq!(stage.reports.len(), 3);
    assert!(stage.reports[2].contains(
        "killed by signal 9 (SIGKILL); it is not started again: it has been started 3 times within 10 s"
    ));
    stage.pass(60_000);
    assert_eq!((stage.sent.len(), stage.outcome()), (0, None));
    end(&mut stage, None);
    assert_eq!((stage.outcome(), stage.reports.len()), (Some(1), 3));
}

#[test]
fn an_end_in_order_is_one_only_for_always() {
    for (condition, starts) in [
        (RestartCondition::OnFailure, 0),
        (RestartCondition::OnAbnormal, 0),
        (RestartCondition::Always, 1),
    ] {
        let mut stage = running(condition);
        stage.exits(B, DONE);
        stage.pass(5_000);
        assert_eq!((stage.started.len(), stage.reports.len()), (starts, starts), "{condition:?}");
    }
}

#[test]
fn one_that_was_asked_to_end_by_a_signal_is_told_and_starts_again_only_for_always() {
    for (condition, starts) in [
        (RestartCondition::OnFailure, 0),
        (RestartCondition::OnAbnormal, 0),
        (RestartCondition::Always, 1),
    ] {
        let mut stage = running(condition);
        stage.exits(B, FederateEnding::Signal(Signal::TERMINATE));
        stage.rti(lost());
        stage.pass(5_000);
        assert_eq!(stage.started.len(), starts, "{condition:?}");
        stage.reported_once("federate b was killed by signal 15 (SIGTERM)");
    }
}

#[test]
fn the_end_of_the_federation_starts_nothing() {
    let mut stage = running(RestartCondition::Always);
    stage.exits(B, DONE);
    stage.pass(100);
    end(&mut stage, None);
    assert_eq!(stage.outcome(), Some(0));
    assert!(stage.started.is_empty() && stage.reports.is_empty());
}

#[test]
fn an_end_within_the_pause_is_told_and_the_failure_counts() {
    let mut stage = running(RestartCondition::OnFailure);
    kill(&mut stage);
    stage.pass(100);
    end(&mut stage, None);
    assert_eq!((stage.outcome(), stage.started.len()), (Some(1), 0));
    assert!(stage.reports[1].contains("federate b does not come back: the federation ends"));
}

#[test]
fn one_that_comes_too_late_is_no_further_failure() {
    let mut stage = running(RestartCondition::OnFailure);
    kill(&mut stage);
    stage.pass(200);
    refused(&mut stage, Refusal::TooLate);
    end(&mut stage, Some(FederateEnding::Code(1)));
    assert_eq!(stage.outcome(), Some(1));
    assert_eq!(stage.reports.len(), 2, "{:?}", stage.reports);
    assert!(stage.reports[1].contains("federate b does not come back: the federation ends"));
}

#[test]
fn one_that_finds_no_rti_any_more_is_no_further_failure() {
    let mut stage = running(RestartCondition::Always);
    stage.exits(B, DONE);
    stage.pass(700);
    assert_eq!(stage.started.len(), 1);
    end(&mut stage, Some(FederateEnding::Code(1)));
    assert_eq!((stage.outcome(), stage.reports.len()), (Some(0), 2), "{:?}", stage.reports);
    assert!(stage.reports[1].contains("federate b does not come back: the federation ends"));
}

#[test]
fn one_that_fails_while_the_federation_ends_counts_unless_it_could_not_join() {
    let exits = |code, closes_first, joins: bool| {
        let mut stage = running(RestartCondition::Always);
        stage.exits(B, DONE);
        stage.pass(700);
        joins.then(|| stage.enters(B, true));
        if closes_first {
            stage.rti(RtiEvent::Closing);
        }
        stage.exits(B, FederateEnding::Code(code));
        stage.pass(10);
        end(&mut stage, None);
        assert!(!stage.reports.iter().any(|it| it.contains("does not come back")));
        stage.outcome()
    };
    assert_eq!(exits(3, true, false), Some(3));
    assert_eq!(exits(1, false, false), Some(1));
    assert_eq!(exits(1, true, true), Some(1));
}

#[test]
fn another_process_that_comes_too_late_changes_nothing() {
    let mut stage = running(RestartCondition::OnFailure);
    kill(&mut stage);
    stage.pass(200);
    stage.enters(B, true);
    stage.rti(RtiEvent::Closing);
    refused(&mut stage, Refusal::TooLate);
    end(&mut stage, Some(DONE));
    assert_eq!((stage.outcome(), stage.reports.len()), (Some(0), 1), "{:?}", stage.reports);
}

#[test]
fn a_signal_within_the_pause_ends_all_at_once() {
    let mut stage = running(RestartCondition::OnFailure);
    kill(&mut stage);
    stage.pass(100);
    stage.event(Observation::Signal(Signal::INTERRUPT));
    stage.exits(A, DONE);
    stage.event(Observation::RtiEnded(Ok(())));
    assert_eq!((stage.outcome(), stage.started.len(), stage.reports.len()), (Some(130), 0, 1));
}

#[test]
fn one_that_was_replaced_is_not_started_again() {
    let mut stage = running(RestartCondition::Always);
    // The user starts another process as b.
    joins(&mut stage, false);
    stage.exits(B, DONE);
    stage.pass(5_000);
    stage.rti(RtiEvent::Entered(B));
    stage.pass(5_000);
    assert!(stage.started.is_empty() && stage.reports.is_empty());
    // Nor is that process, which the supervisor does not know.
    stage.rti(lost());
    stage.pass(5_000);
    assert_eq!(stage.started.len(), 0);
    stage.reported_once("it is lost");
}

#[test]
fn the_loss_of_one_that_has_replaced_another_is_not_blamed_on_that_one() {
    for restart in [None, Some(restart(RestartCondition::OnFailure))] {
        for pause in [100, 1_000] {
            let mut stage = started(restart);
            stage.enters(B, false);
            stage.exits(B, DONE);
            stage.pass(pause);
            stage.rti(lost());
            stage.pass(5_000);
            stage.reported_once("it is lost");
            end(&mut stage, None);
            assert_eq!((stage.outcome(), stage.reports.len()), (Some(1), 1));
        }
    }
}

#[test]
fn that_its_predecessor_ends_in_order_does_not_make_up_for_a_lost_one() {
    for (restarts, slowly) in [(0, true), (1, true), (1, false)] {
        let mut stage = running(RestartCondition::OnFailure);
        for _ in 0..restarts {
            kill(&mut stage);
            stage.pass(200);
            stage.enters(B, true);
        }
        stage.enters(B, false);
        if slowly {
            stage.rti(lost());
            stage.pass(1_000);
            stage.exits(B, DONE);
        } else {
            stage.exits(B, DONE);
            stage.rti(lost());
        }
        stage.pass(5_000);
        end(&mut stage, None);
        assert_eq!((stage.outcome(), stage.reports.len()), (Some(1), 1 + restarts));
    }
}

#[test]
fn one_that_came_back_and_ended_before_its_last_tag_has_failed() {
    let mut stage = running(RestartCondition::OnAbnormal);
    kill(&mut stage);
    stage.pass(200);
    stage.enters(B, true);
    stage.exits(B, DONE);
    stage.rti(lost());
    stage.pass(600);
    assert!(stage.reports[1].contains("federate b exited with code 0 before its last tag"));
    end(&mut stage, None);
    assert_eq!(stage.outcome(), Some(1));
}

#[test]
fn one_that_is_refused_as_a_duplicate_has_not_failed() {
    for restart in [None, Some(restart(RestartCondition::OnFailure))] {
        for takes_part in [true, false] {
            // One that the user has started loads, and takes part or does not.
            let mut stage = Stage::of(&program(restart));
            stage.rti(RtiEvent::Joined { federate: A, launched: true });
            stage.rti(RtiEvent::Started(PhysicalTime(0)));
            joins(&mut stage, false);
            refused(&mut stage, Refusal::Duplicate);
            stage.exits(B, FederateEnding::Code(1));
            stage.pass(5_000);
            assert_eq!((stage.started.len(), stage.reports.len()), (0, 1), "{:?}", stage.reports);
            stage.reported_once("the RTI refuses a process as federate b: this federate has");
            if takes_part {
                stage.rti(RtiEvent::Entered(B));
            } else {
                withdraws(&mut stage);
            }
            stage.pass(5_000);
            let (starts, code) = match (takes_part, restart) {
                (true, _) => (0, 0),
                (false, Some(_)) => (1, 0),
                (false, None) => (0, 1),
            };
            assert_eq!(stage.started.len(), starts);
            end(&mut stage, (starts > 0).then_some(DONE));
            assert_eq!(stage.outcome(), Some(code), "{:?}", stage.reports);
        }
    }
    // The one that was refused is the user's: what the RTI tells is a failure of the own one.
    let mut stage = running(RestartCondition::OnFailure);
    refused(&mut stage, Refusal::Duplicate);
    stage.exits(B, FederateEnding::Code(1));
    stage.rti(lost());
    assert!(stage.reports[1].contains("it is lost; restart 1 follows"));
}

#[test]
fn one_that_is_refused_again_and_again_runs_into_the_limit() {
    let mut stage = running(RestartCondition::OnFailure);
    kill(&mut stage);
    for _ in 0..2 {
        stage.pass(200);
        refused(&mut stage, Refusal::Duplicate);
        stage.exits(B, FederateEnding::Code(1));
        stage.pass(500);
    }
    stage.pass(5_000);
    assert_eq!(stage.started, [(B, 200), (B, 900)]);
    let said = "federate b exited with code 1; it is not started again: it has been started 3";
    assert_eq!(stage.reports.iter().filter(|report| report.contains(said)).count(), 1);
}

#[test]
fn a_successor_that_does_not_take_part_changes_nothing() {
    for failure in ["it is lost", "a reaction raised"] {
        let mut stage = running(RestartCondition::OnFailure);
        joins(&mut stage, false);
        let kind = if failure == "it is lost" { Kind::Lost } else { Kind::Reaction };
        let report = Some(Report::new(kind, failure).of("b"));
        stage.rti(RtiEvent::Withdrawn { federate: B, report });
        let said = "another process was joining as federate b, and has ended";
        stage.reported_once(said);
        assert_eq!(stage.reports[0].contains(failure), kind == Kind::Reaction);
        stage.pass(5_000);
        kill(&mut stage);
        stage.pass(200);
        assert_eq!(stage.started.len(), 1);
        stage.enters(B, true);
        // One that leaves in order before it takes part is not even told.
        joins(&mut stage, false);
        stage.rti(RtiEvent::Withdrawn { federate: B, report: None });
        end(&mut stage, Some(DONE));
        assert_eq!((stage.outcome(), stage.reports.len()), (Some(0), 2), "{:?}", stage.reports);
    }
}

#[test]
fn the_loss_of_one_that_would_have_taken_the_place_of_one_that_has_left_counts() {
    for (condition, starts) in [(RestartCondition::OnFailure, 0), (RestartCondition::Always, 1)] {
        let mut stage = running(condition);
        joins(&mut stage, false);
        // It was told to leave for the other one.
        stage.exits(B, DONE);
        stage.pass(5_000);
        assert_eq!((stage.started.len(), stage.reports.len()), (0, 0));
        withdraws(&mut stage);
        stage.pass(5_000);
        assert_eq!(stage.started.len(), starts, "{:?}", stage.reports);
        let counts = i32::from(starts == 0);
        end(&mut stage, (starts > 0).then_some(DONE));
        assert_eq!(stage.outcome(), Some(counts));
    }
}

#[test]
fn one_that_is_away_comes_back_when_the_process_that_joins_instead_is_gone() {
    let mut stage = running(RestartCondition::OnFailure);
    joins(&mut stage, false);
    kill(&mut stage);
    stage.pass(5_000);
    assert_eq!(stage.started, []);
    withdraws(&mut stage);
    stage.pass(1);
    assert_eq!(stage.started.len(), 1);
    stage.enters(B, true);
    end(&mut stage, Some(DONE));
    assert_eq!((stage.outcome(), stage.reports.len()), (Some(0), 2), "{:?}", stage.reports);
}

#[test]
fn one_whose_place_is_taken_within_the_pause_is_not_started_again() {
    let mut stage = running(RestartCondition::Always);
    kill(&mut stage);
    stage.pass(100);
    stage.enters(B, false);
    stage.pass(5_000);
    assert!(stage.reports[1].contains("b is not started again: another process has joined as it"));
    assert_eq!((stage.started.len(), stage.reports.len()), (0, 2));
    end(&mut stage, None);
    assert_eq!((stage.outcome(), stage.reports.len()), (Some(1), 2));
}

#[test]
fn one_whose_place_is_taken_before_the_start_is_not_started_again() {
    let mut stage = Stage::of(&program(Some(restart(RestartCondition::OnFailure))));
    joins(&mut stage, true);
    kill(&mut stage);
    joins(&mut stage, false);
    stage.pass(5_000);
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.rti(RtiEvent::Started(PhysicalTime(0)));
    assert!(stage.reports[1].contains("b is not started again: another process has joined as it"));
    stage.pass(5_000);
    assert_eq!((stage.started.len(), stage.reports.len()), (0, 2));
}

#[test]
fn one_that_first_comes_when_the_federation_has_ended_has_not_failed() {
    let said = "federate b has not joined: the federation has ended";
    for restart in [None, Some(restart(RestartCondition::OnFailure))] {
        for is_refused in [false, true] {
            let mut stage = Stage::of(&program(restart));
            stage.rti(RtiEvent::Joined { federate: A, launched: true });
            stage.rti(RtiEvent::Started(PhysicalTime(0)));
            stage.pass(1_000);
            stage.rti(RtiEvent::Closing);
            is_refused.then(|| refused(&mut stage, Refusal::TooLate));
            end(&mut stage, Some(FederateEnding::Code(1)));
            assert_eq!((stage.outcome(), stage.reports.len()), (Some(0), 1), "{:?}", stage.reports);
            stage.reported_once(said);
        }
    }
    // One that has joined, and has another reason to end, has failed.
    let mut stage = started(None);
    stage.rti(RtiEvent::Closing);
    refused(&mut stage, Refusal::TooLate);
    end(&mut stage, Some(FederateEnding::Code(1)));
    assert_eq!(stage.outcome(), Some(1));
}

#[test]
fn one_that_joins_again_before_the_start_has_not_been_replaced() {
    let mut stage = Stage::of(&program(Some(restart(RestartCondition::OnFailure))));
    stage.rti(RtiEvent::Joined { federate: B, launched: true });
    stage.rti(RtiEvent::Left(B));
    stage.rti(RtiEvent::Joined { federate: B, launched: true });
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    stage.rti(RtiEvent::Started(PhysicalTime(0)));
    kill(&mut stage);
    stage.pass(200);
    assert_eq!(stage.started.len(), 1);
}

#[test]
fn one_that_does_not_answer_is_ended_and_started_again() {
    let mut stage = running(RestartCondition::OnAbnormal);
    stage.rti(lost());
    stage.pass(1_999);
    assert_eq!(stage.sent, []);
    stage.pass(1);
    assert_eq!(stage.sent, [(TERM, B)]);
    stage.pass(1_000);
    assert_eq!(stage.sent, [(TERM, B), (KILL, B)]);
    stage.pass(5_000);
    assert_eq!((stage.sent.len(), stage.reports.len()), (2, 0));
    stage.exits(B, SIGKILL);
    stage.reported_once("it is lost; restart 1 follows");
    stage.pass(200);
    assert_eq!(stage.started, [(B, 8_200)]);
}

#[test]
fn it_is_started_again_before_the_federation_starts_too() {
    let mut stage = Stage::of(&program(Some(restart(RestartCondition::OnFailure))));
    stage.exits(B, FederateEnding::Code(1));
    stage.pass(500);
    stage.rti(RtiEvent::Joined { federate: A, launched: true });
    assert_eq!(stage.started, [(B, 500)]);
    stage.rti(RtiEvent::Started(PhysicalTime(0)));
    assert_eq!(stage.outcome(), None);
}

#[test]
fn its_own_words_stand_in_the_line_and_below() {
    let mut stage = running(RestartCondition::OnFailure);
    let report = Report { details: Some("a traceback".to_owned()), ..said("raised ValueError", 1) };
    stage.rti(RtiEvent::Dropped { federate: B, report: report.of("b") });
    stage.exits(B, FederateEnding::Code(1));
    stage.reported_once("federate b: raised ValueError; restart 1 follows, after 200 ms");
    stage.reported_once("a traceback");
}

proptest! {
    /// Whatever happens to b, and when: it is started only while it does not run, and no sooner than its pause allows;
    /// and when the rest has ended, all is over.
    #[test]
    fn no_federate_runs_twice(steps in prop::collection::vec((0..10_u8, 0..700_u64), 1..60)) {
        let mut stage = running(RestartCondition::Always);
        let (mut ended, mut known) = (None, 0);
        for (step, wait) in steps {
            match step {
                0 => stage.rti(lost()),
                1 => joins(&mut stage, wait % 2 == 0),
                7 => stage.rti(RtiEvent::Entered(B)),
                8 => withdraws(&mut stage),
                9 => refused(&mut stage, Refusal::Duplicate),
                2..=4 if ended.is_none() => {
                    let how = [SIGKILL, DONE, FederateEnding::Code(1)][usize::from(step) - 2].clone();
                    stage.exits(B, how);
                    ended = Some(stage.now);
                }
                _ => {}
            }
            let until = stage.now + Duration::from_millis(wait);
            while stage.now < until {
                stage.pass(1);
                if stage.started.len() > known {
                    known += 1;
                    prop_assert_eq!(stage.started.len(), known);
                    let since = ended.take().map(|at: Duration| stage.now.saturating_sub(at));
                    prop_assert!(since.is_some_and(|it| it >= Duration::from_millis(200)), "{:?}", since);
                }
            }
        }
        end(&mut stage, ended.is_none().then_some(DONE));
        stage.pass(60_000);
        prop_assert!(stage.outcome().is_some());
        prop_assert_eq!(stage.started.len(), known);
    }
}
