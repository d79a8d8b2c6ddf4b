//! Minimum spacing, policy by policy: which events of an action happen, when, and with what value.

use std::sync::Arc;

use hprm_core::{
    Effect, Nanos, Origin, PhysicalTime, Policy, ProgramBuilder, Properties, ReactionSpec,
    Scheduled, Scheduler, Scope, Spacing, Tag, Trigger,
};

const START: PhysicalTime = PhysicalTime(1_000_000);

/// Schedules an action with each `(at, extra)`, `at` a multiple of ten, with the position as value.
/// Returns what was answered, and which events happened.
fn run(
    spacing: Option<Spacing>,
    calls: &[(Nanos, Nanos)],
) -> (Vec<Scheduled>, Vec<(Nanos, u32, usize)>) {
    let properties = Properties { timeout: Some(1_000), ..Properties::default() };
    let mut b = ProgramBuilder::new("Main", properties);
    let timer = b.timer(b.main(), "t", 0, 10);
    let action = b.action(b.main(), "a", Origin::Logical, 1);
    if let Some(spacing) = spacing {
        b.space(action, spacing);
    }
    let effects = vec![Effect::Action(action)];
    let triggers = vec![Trigger::Timer(timer)];
    let ask = b.reaction(b.main(), ReactionSpec { triggers, effects, ..ReactionSpec::default() });
    let triggers = vec![Trigger::Action(action)];
    b.reaction(b.main(), ReactionSpec { triggers, ..ReactionSpec::default() });
    let mut scheduler = Scheduler::new(Arc::new(b.build().unwrap()), Scope::Whole);
    scheduler.start(START);
    let (mut answers, mut events) = (Vec::new(), Vec::new());
    loop {
        let tag = scheduler.next_tag();
        scheduler.begin(tag);
        while let Some((reaction, _)) = scheduler.next_reaction(START) {
            if reaction == ask {
                let due = calls.iter().enumerate().filter(|(_, (at, _))| *at == tag.time);
                for (value, (_, extra)) in due {
                    answers.push(scheduler.schedule(action, *extra, Some(value), START));
                }
            } else {
                let value = scheduler.action(action).unwrap().copied().unwrap();
                events.push((tag.time, tag.microstep, value));
            }
            scheduler.finish(reaction);
        }
        if scheduler.end(START) {
            return (answers, events);
        }
    }
}

fn spaced(min: Nanos, policy: Policy) -> Option<Spacing> {
    Some(Spacing { min, policy })
}

#[test]
fn far_enough_is_far_enough_with_every_policy() {
    for policy in [Policy::Defer, Policy::Drop, Policy::Replace, Policy::Update] {
        let (_, events) = run(spaced(10, policy), &[(0, 0), (10, 0), (20, 5)]);
        assert_eq!(events, [(1, 0, 0), (11, 0, 1), (26, 0, 2)], "{policy:?}");
    }
}

#[test]
fn defer_keeps_all_events_at_the_least_distance_of_assigned_tags() {
    let (_, events) = run(spaced(25, Policy::Defer), &[(0, 0), (10, 0), (20, 0), (80, 0)]);
    assert_eq!(events, [(1, 0, 0), (26, 0, 1), (51, 0, 2), (81, 0, 3)]);
}

#[test]
fn drop_counts_from_the_latest_event_that_was_not_dropped_even_if_it_has_happened() {
    let (answers, events) = run(spaced(25, Policy::Drop), &[(0, 0), (10, 0), (20, 0), (30, 0)]);
    assert_eq!(events, [(1, 0, 0), (31, 0, 3)]);
    assert_eq!(answers[1..3], [Scheduled::Dropped, Scheduled::Dropped]);
}

#[test]
fn replace_changes_the_value_of_an_event_that_waits_and_defers_after_one_that_does_not() {
    let (answers, events) = run(spaced(25, Policy::Replace), &[(0, 0), (10, 0), (20, 0), (30, 0)]);
    assert_eq!(events, [(1, 0, 0), (26, 0, 2), (51, 0, 3)]);
    assert_eq!(answers[1], Scheduled::At(Tag::new(26, 0)));
    assert_eq!(answers[2], answers[1], "the tag stays");
}

#[test]
fn update_removes_the_event_that_waits_and_keeps_the_tag_that_was_meant() {
    let (_, events) = run(spaced(25, Policy::Update), &[(0, 30), (10, 0), (20, 0)]);
    assert_eq!(events, [(11, 0, 1), (21, 0, 2)], "too close to one that has happened is allowed");
    let (_, events) = run(spaced(25, Policy::Update), &[(0, 9), (0, 50), (10, 9), (20, 0)]);
    assert_eq!(events, [(10, 0, 0), (20, 0, 2), (21, 0, 3)]);
}

#[test]
fn two_events_for_one_tag_never_merge_whatever_the_policy_removes() {
    // The third is meant for the tag of the first, and only the second makes room for it.
    let (_, events) = run(spaced(5, Policy::Update), &[(0, 10), (0, 20), (0, 10)]);
    assert_eq!(events, [(11, 0, 0), (11, 1, 2)]);
}

#[test]
fn a_spacing_of_zero_is_not_the_same_as_none() {
    let twice = [(0, 4), (0, 4)];
    let (_, events) = run(None, &twice);
    assert_eq!(events, [(5, 0, 0), (5, 1, 1)]);
    for (policy, expected) in [
        (Policy::Drop, vec![(5, 0, 0)]),
        (Policy::Replace, vec![(5, 0, 1)]),
        (Policy::Update, vec![(5, 0, 1)]),
        (Policy::Defer, vec![(5, 0, 0), (5, 1, 1)]),
    ] {
        assert_eq!(run(spaced(0, policy), &twice).1, expected, "{policy:?}");
    }
}

#[test]
fn a_deferred_event_may_come_after_the_end() {
    let (answers, events) = run(spaced(990, Policy::Defer), &[(0, 0), (10, 0), (20, 0)]);
    assert_eq!(events, [(1, 0, 0), (991, 0, 1)]);
    assert_eq!(answers[2], Scheduled::AfterStop);
}

#[test]
fn what_is_displaced_is_handed_back() {
    for policy in [Policy::Replace, Policy::Update] {
        let mut b = ProgramBuilder::new("Main", Properties::default());
        let action = b.action(b.main(), "a", Origin::Logical, 0);
        b.space(action, Spacing { min: 7, policy });
        let mut scheduler = Scheduler::new(Arc::new(b.build().unwrap()), Scope::Whole);
        scheduler.start(START);
        scheduler.begin(Tag::START);
        scheduler.schedule(action, 3, Some('a'), START);
        assert_eq!(scheduler.take_displaced(), None);
        scheduler.schedule(action, 5, Some('b'), START);
        assert_eq!(scheduler.take_displaced(), Some('a'));
        assert_eq!(scheduler.take_displaced(), None);
    }
}
