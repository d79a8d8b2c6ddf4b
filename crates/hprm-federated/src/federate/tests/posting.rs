//! What a federate shows on its board, and when.

use super::lives::{linked, posted, start};
use super::*;
use crate::Posting;

/// A message reaches a federate that is idle, and it processes the tag. Returns all that this gives.
fn takes(machine: &mut Federate, from: u16, channel: u32, time: i64) -> Vec<Output> {
    let frame = message(channel, at(time));
    let mut outputs = input(machine, time, Input::FromPeer { from: FederateId(from), frame });
    outputs.extend(input(machine, time, Input::NextEvent(at(time))));
    if machine.permission(at(time), START.plus(time)) == Permission::Granted {
        outputs.extend(input(machine, time, Input::Begun(at(time))));
        outputs.extend(input(machine, time, Input::Completed(at(time))));
        outputs.extend(input(machine, time, Input::NextEvent(Tag::FOREVER)));
    }
    outputs
}

#[test]
fn a_federate_that_sends_to_none_shows_nothing_but_what_it_waits_for() {
    let mut c = linked("a -> c\nb -> c", "c", &[0, 2]);
    start(&mut c, Tag::START);
    let first = input(&mut c, 0, Input::NextEvent(Tag::FOREVER));
    assert_eq!(posted(&first).map(|posting| posting.waits), Some(Step::NEVER));
    for time in [10, 20] {
        takes(&mut c, 0, 0, time);
        takes(&mut c, 2, 1, time);
    }
    // It has shown that it waits for the other message of each tag.
    let outputs = takes(&mut c, 0, 0, 30);
    let posting = posted(&outputs).expect("it waits");
    assert!(posting.waits > Step::NEVER);
    let counts =
        |posting: &Posting| posting.tallies.iter().map(|it| it.messages).collect::<Vec<_>>();
    assert_eq!(counts(posting), [3, 2]);
    // While it waits, what it counts says whether it need not wait any more.
    let later = Input::FromPeer { from: FederateId(0), frame: message(0, at(40)) };
    input(&mut c, 31, later);
    let outputs = input(&mut c, 31, Input::NextEvent(at(30)));
    assert_eq!(posted(&outputs).map(counts), Some(vec![4, 2]));
}

#[test]
fn messages_to_a_federate_that_sends_to_none_cause_no_postings() {
    let mut b = linked("a -> b", "b", &[0]);
    start(&mut b, Tag::START);
    input(&mut b, 0, Input::NextEvent(Tag::FOREVER));
    for time in [10, 20, 30] {
        assert_eq!(posted(&takes(&mut b, 0, 0, time)), None, "at {time}");
    }
    // A federate that sends on shows how far it has got.
    let mut b = linked("a -> b\nb -> c", "b", &[0, 2]);
    start(&mut b, Tag::START);
    input(&mut b, 0, Input::NextEvent(Tag::FOREVER));
    assert!(posted(&takes(&mut b, 0, 0, 10)).is_some());
}
