//! What a federate leaves out when nobody waits for it, and when it speaks again.

use hprm_core::{ChannelId, Payload, Tag};

use super::{MILLISECOND, at, input, message, started};
use crate::{Federate, Frame, Input, Output};

fn quiet(machine: &mut Federate, through: Tag, sent: u64) -> Vec<Output> {
    let frame = Frame::DownstreamNextEventTag { tag: through, sent };
    input(machine, 0, Input::FromRti(frame))
}

/// What the RTI hears of a tag without messages, and of the next event after it.
fn process(machine: &mut Federate, tag: Tag, next: Tag) -> Vec<Output> {
    [Input::Begun(tag), Input::Completed(tag), Input::NextEvent(next)]
        .into_iter()
        .flat_map(|next| input(machine, 0, next))
        .collect()
}

fn both(completed: Tag, next: Tag) -> [Output; 2] {
    [Frame::LatestTagConfirmed { tag: completed }, Frame::NextEventTag { tag: next }]
        .map(Output::ToRti)
}

#[test]
fn a_quiet_federate_reports_what_is_beyond() {
    let mut machine = started("a -> b", "a", 2, &[]);
    assert_eq!(process(&mut machine, at(0), at(1)), both(at(0), at(1)));
    assert!(quiet(&mut machine, at(4), 0).is_empty());
    assert!(process(&mut machine, at(1), at(2)).is_empty());
    assert!(process(&mut machine, at(2), at(4)).is_empty());
    assert_eq!(process(&mut machine, at(4), at(5)), both(at(4), at(5)));
    assert_eq!(process(&mut machine, at(5), at(6)), both(at(5), at(6)));
}

#[test]
fn a_federate_that_is_called_says_where_it_is() {
    let mut machine = started("a -> b", "a", 2, &[]);
    process(&mut machine, at(0), at(1));
    quiet(&mut machine, Tag::FOREVER, 0);
    assert!(process(&mut machine, at(1), at(7)).is_empty());
    let report = Output::ToRti(Frame::NextEventTag { tag: at(7) });
    assert_eq!(quiet(&mut machine, Tag::NEVER, 0), [report]);
}

#[test]
fn a_message_ends_silence_and_what_did_not_know_of_it_is_void() {
    let mut machine = started("a -> b", "a", 2, &[]);
    quiet(&mut machine, Tag::FOREVER, 0);
    input(&mut machine, 0, Input::Begun(at(0)));
    let (channel, payload) = (ChannelId(0), Payload::default());
    input(&mut machine, 0, Input::Send { channel, tag: at(0), payload });
    assert!(quiet(&mut machine, Tag::FOREVER, 0).is_empty());
    let completed = Output::ToRti(Frame::LatestTagConfirmed { tag: at(0) });
    assert_eq!(input(&mut machine, 0, Input::Completed(at(0))), [completed]);
    let report = Output::ToRti(Frame::NextEventTag { tag: at(3) });
    assert_eq!(input(&mut machine, 0, Input::NextEvent(at(3))), [report]);
    quiet(&mut machine, Tag::FOREVER, 1);
    assert!(process(&mut machine, at(3), at(4)).is_empty());
}

#[test]
fn a_quiet_federate_says_what_it_wants_itself_and_which_messages_it_has_processed() {
    let mut machine = started("x -> a\na -> b", "a", 3, &[]);
    quiet(&mut machine, Tag::FOREVER, 0);
    let report = |tag| Output::ToRti(Frame::NextEventTag { tag });
    assert_eq!(input(&mut machine, 0, Input::NextEvent(at(2))), [report(at(2))]);
    input(&mut machine, 0, Input::FromRti(Frame::TagAdvanceGrant { tag: at(9) }));
    assert!(process(&mut machine, at(2), at(3)).is_empty());
    input(&mut machine, 0, Input::FromRti(message(0, at(3))));
    let completed = Output::ToRti(Frame::LatestTagConfirmed { tag: at(3) });
    assert_eq!(process(&mut machine, at(3), at(4)), [completed]);
    assert_eq!(process(&mut machine, at(4), at(10)), [report(at(10))]);
}

#[test]
fn a_stop_ends_silence() {
    let mut machine = started("a -> b", "a", 2, &[]);
    quiet(&mut machine, Tag::FOREVER, 0);
    assert!(process(&mut machine, at(0), at(1)).is_empty());
    input(&mut machine, 0, Input::FromRti(Frame::StopGranted { tag: at(9) }));
    assert_eq!(process(&mut machine, at(1), at(2)), both(at(1), at(2)));
}

#[test]
fn a_clock_of_which_nobody_needs_to_hear_is_not_reported() {
    let mut machine = started("x ~> a\na -> b", "a", 3, &[]);
    let idle =
        |machine: &mut Federate, after| input(machine, after, Input::NextEvent(Tag::FOREVER));
    assert!(!idle(&mut machine, 0).is_empty());
    quiet(&mut machine, at(50 * MILLISECOND), 0);
    assert!(idle(&mut machine, 20 * MILLISECOND).is_empty());
    let wakeup = machine.next_wakeup().unwrap();
    assert_eq!(wakeup, at(50 * MILLISECOND).due(super::START).plus(1));
    let after = wakeup.since(super::START);
    let report = Output::ToRti(Frame::NextEventTag { tag: at(after) });
    assert_eq!(input(&mut machine, after, Input::Wake), [report]);
}

#[test]
fn a_clock_is_reported_to_the_one_who_grants_if_its_federate_waits_for_that() {
    // The RTI grants what y cannot precede, and y waits for a.
    let mut machine = started("x ~> a\ny -> a\na -> y after 1", "a", 3, &[]);
    let report = |tag| Output::ToRti(Frame::NextEventTag { tag });
    let idle = |machine: &mut Federate, after| {
        input(machine, after, Input::NextEvent(at(30 * MILLISECOND)))
    };
    idle(&mut machine, 0);
    quiet(&mut machine, at(50 * MILLISECOND), 0);
    let wakeup = machine.next_wakeup().expect("a waits for a grant, and nobody else says more");
    let after = wakeup.since(super::START);
    assert!(after < 30 * MILLISECOND, "{after}");
    assert_eq!(input(&mut machine, after, Input::Wake), [report(at(after))]);
    // Once it has what it waits for, nobody needs to hear of its clock.
    input(
        &mut machine,
        after,
        Input::FromRti(Frame::TagAdvanceGrant { tag: at(40 * MILLISECOND) }),
    );
    assert_eq!(machine.next_wakeup(), None);
}
