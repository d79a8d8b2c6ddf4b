//! Which reports a federate skips after a downstream next event tag, and when it reports again.

use hprm_core::{ChannelId, Payload, Tag};

use super::{MILLISECOND, at, input, message, started};
use crate::{Federate, Frame, Input, Output};

fn dnet(machine: &mut Federate, through: Tag, sent: u64) -> Vec<Output> {
    let frame = Frame::DownstreamNextEventTag { tag: through, sent };
    input(machine, 0, Input::FromRti(frame))
}

/// The reports on a tag without messages, and on the next event after it.
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
fn a_federate_reports_events_beyond_its_dnet() {
    let mut machine = started("a -> b", "a", 2, &[]);
    assert_eq!(process(&mut machine, at(0), at(1)), both(at(0), at(1)));
    assert!(dnet(&mut machine, at(4), 0).is_empty());
    assert!(process(&mut machine, at(1), at(2)).is_empty());
    assert!(process(&mut machine, at(2), at(4)).is_empty());
    assert_eq!(process(&mut machine, at(4), at(5)), both(at(4), at(5)));
    assert_eq!(process(&mut machine, at(5), at(6)), both(at(5), at(6)));
}

#[test]
fn a_federate_that_is_recalled_reports_its_next_event() {
    let mut machine = started("a -> b", "a", 2, &[]);
    process(&mut machine, at(0), at(1));
    dnet(&mut machine, Tag::FOREVER, 0);
    assert!(process(&mut machine, at(1), at(7)).is_empty());
    let report = Output::ToRti(Frame::NextEventTag { tag: at(7) });
    assert_eq!(dnet(&mut machine, Tag::NEVER, 0), [report]);
}

#[test]
fn a_message_ends_a_dnet_and_a_dnet_from_before_the_message_is_void() {
    let mut machine = started("a -> b", "a", 2, &[]);
    dnet(&mut machine, Tag::FOREVER, 0);
    input(&mut machine, 0, Input::Begun(at(0)));
    let (channel, payload) = (ChannelId(0), Payload::default());
    input(&mut machine, 0, Input::Send { channel, tag: at(0), payload });
    assert!(dnet(&mut machine, Tag::FOREVER, 0).is_empty());
    let completed = Output::ToRti(Frame::LatestTagConfirmed { tag: at(0) });
    assert_eq!(input(&mut machine, 0, Input::Completed(at(0))), [completed]);
    let report = Output::ToRti(Frame::NextEventTag { tag: at(3) });
    assert_eq!(input(&mut machine, 0, Input::NextEvent(at(3))), [report]);
    dnet(&mut machine, Tag::FOREVER, 1);
    assert!(process(&mut machine, at(3), at(4)).is_empty());
}

#[test]
fn a_federate_with_a_dnet_still_asks_for_grants_and_confirms_messages() {
    let mut machine = started("x -> a\na -> b", "a", 3, &[]);
    dnet(&mut machine, Tag::FOREVER, 0);
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
fn a_stop_ends_a_dnet() {
    let mut machine = started("a -> b", "a", 2, &[]);
    dnet(&mut machine, Tag::FOREVER, 0);
    assert!(process(&mut machine, at(0), at(1)).is_empty());
    input(&mut machine, 0, Input::FromRti(Frame::StopGranted { tag: at(9) }));
    assert_eq!(process(&mut machine, at(1), at(2)), both(at(1), at(2)));
}

#[test]
fn a_clock_within_a_dnet_is_not_reported() {
    let mut machine = started("x ~> a\na -> b", "a", 3, &[]);
    let idle =
        |machine: &mut Federate, after| input(machine, after, Input::NextEvent(Tag::FOREVER));
    assert!(!idle(&mut machine, 0).is_empty());
    dnet(&mut machine, at(50 * MILLISECOND), 0);
    assert!(idle(&mut machine, 20 * MILLISECOND).is_empty());
    let wakeup = machine.next_wakeup().unwrap();
    assert_eq!(wakeup, at(50 * MILLISECOND).due(super::START).plus(1));
    let after = wakeup.since(super::START);
    let report = Output::ToRti(Frame::NextEventTag { tag: at(after) });
    assert_eq!(input(&mut machine, after, Input::Wake), [report]);
}

#[test]
fn a_clock_is_reported_if_the_grant_of_its_federate_depends_on_it() {
    // The RTI grants what y cannot precede, and y waits for a.
    let mut machine = started("x ~> a\ny -> a\na -> y after 1", "a", 3, &[]);
    let report = |tag| Output::ToRti(Frame::NextEventTag { tag });
    let idle = |machine: &mut Federate, after| {
        input(machine, after, Input::NextEvent(at(30 * MILLISECOND)))
    };
    idle(&mut machine, 0);
    dnet(&mut machine, at(50 * MILLISECOND), 0);
    let wakeup = machine.next_wakeup().expect("a waits for a grant, and only a can report more");
    let after = wakeup.since(super::START);
    assert!(after < 30 * MILLISECOND, "{after}");
    assert_eq!(input(&mut machine, after, Input::Wake), [report(at(after))]);
    // Once it has its grant, no federate needs reports of its clock.
    input(
        &mut machine,
        after,
        Input::FromRti(Frame::TagAdvanceGrant { tag: at(40 * MILLISECOND) }),
    );
    assert_eq!(machine.next_wakeup(), None);
}
