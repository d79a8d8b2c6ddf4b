//! What boards tell of transient federates, on those of small programs.

use hprm_core::{ChannelId, FederateId, Tag};

use super::ALL;
use crate::Step;
use crate::boards::tests::{View, at, showing};
use crate::boards::{Posting, Tally, tests};

const A: FederateId = FederateId(0);
const B: FederateId = FederateId(1);
const CHAIN: &str = "transient a\na -> b\nb -> c";

/// The same, with a first process of `a`.
fn view(text: &str, me: &str) -> View {
    let mut view = tests::view(text, me);
    view.meet(A, 1);
    view
}

fn tally(messages: u64, latest: i64, life: u32) -> Tally {
    Tally { messages, latest: at(latest), life }
}

impl View {
    fn meet(&mut self, federate: FederateId, life: u32) {
        self.boards.meet(&self.topology, federate, life);
    }
}

#[test]
fn what_was_counted_for_a_process_does_not_count_for_its_successor() {
    let mut c = view(CHAIN, "c");
    c.read(A.0, showing(90, &[tally(5, 20, 0)]));
    c.read(B.0, showing(90, &[tally(4, 10, 1), tally(0, 0, 0)]));
    assert_eq!(c.known().tag, at(20), "one message has not been read");
    c.meet(A, 2);
    c.read(A.0, showing(80, &[tally(1, 50, 0)]));
    assert_eq!(c.known().tag, at(50), "b has read four of another process");
    c.read(B.0, showing(90, &[tally(1, 50, 2), tally(0, 0, 0)]));
    assert_eq!(c.known().tag, at(80));
    c.read(B.0, showing(90, &[tally(0, 0, 3), tally(0, 0, 0)]));
    assert_eq!(c.known().tag, at(80), "b has met a later one, and has read all of this one before");
}

#[test]
fn what_a_former_process_has_shown_does_not_count_for_its_successor() {
    let mut c = view(CHAIN, "c");
    c.read(B.0, showing(90, &[tally(0, 0, 2), tally(0, 0, 0)]));
    // It has ended, and its board is read again when the successor is known and has shown nothing yet.
    let last = Posting { ended: true, life: 1, ..showing(40, &[tally(0, 0, 0)]) };
    c.boards.read(A, last.clone());
    assert_eq!(c.known().tag, at(90));
    c.meet(A, 2);
    c.boards.joins(A, at(50));
    c.boards.read(A, last);
    assert_eq!(c.known().tag, at(50), "the successor has not ended");
    // Nor does a process count before it is met.
    c.boards.read(A, Posting { life: 3, ..showing(80, &[tally(0, 0, 0)]) });
    assert_eq!(c.known().tag, at(50));
    c.boards.read(A, Posting { life: 2, ..showing(80, &[tally(0, 0, 0)]) });
    assert_eq!(c.known().tag, at(80));
}

#[test]
fn both_ends_count_from_zero_for_each_process() {
    let mut b = view("transient a\na -> b\nb -> a", "b");
    b.boards.received(ChannelId(0), at(3));
    b.boards.sent(ChannelId(1), at(3));
    assert_eq!(b.boards.own().tallies, [tally(1, 3, 1), tally(1, 3, 1)]);
    b.meet(A, 2);
    assert_eq!(b.boards.own().tallies, [Tally { life: 2, ..Tally::NONE }; 2]);
}

#[test]
fn one_that_joins_does_nothing_before_its_first_tag() {
    let mut c = view(CHAIN, "c");
    c.boards.is_without(A);
    c.read(B.0, showing(90, &[tally(0, 0, 1), tally(0, 0, 0)]));
    assert_eq!(c.known().tag, at(90), "nothing comes of a");
    c.boards.joins(A, at(30));
    assert_eq!(c.known().tag, at(30));
    c.read(A.0, showing(40, &[tally(0, 0, 0)]));
    assert_eq!(c.known().tag, at(40));
    c.boards.joins(A, at(35));
    assert_eq!(c.known().tag, at(40), "it has started meanwhile");
}

#[test]
fn one_that_was_killed_counts_until_its_receivers_have_read_all() {
    let mut c = view(CHAIN, "c");
    c.read(A.0, showing(40, &[tally(2, 20, 0)]));
    c.read(B.0, showing(90, &[tally(2, 20, 1), tally(0, 0, 0)]));
    c.boards.dies(A);
    assert_eq!(c.known().tag, at(40), "what it sent at its next tag, it may not have counted");
    assert!(c.boards.may_receive_from(A));
    c.read(B.0, showing(90, &[tally(ALL, 20, 1), tally(0, 0, 0)]));
    assert!(!c.boards.may_receive_from(A));
    assert_eq!(c.known().tag, at(90));
}

#[test]
fn a_receiver_of_one_that_was_killed_has_read_all_when_it_has_noticed_its_end() {
    let mut b = view("transient a\na -> b", "b");
    b.read(A.0, showing(40, &[tally(3, 30, 0)]));
    b.boards.received(ChannelId(0), at(20));
    b.boards.dies(A);
    assert!(b.known().tag < at(40), "two messages are on their way");
    b.boards.has_read_all_of(&b.topology, A);
    assert_eq!(b.boards.own().tallies, [tally(ALL, 20, 1)]);
    b.boards.bury();
    assert_eq!(b.known().tag, Tag::FOREVER);
    // It stays so, whatever is counted.
    b.boards.received(ChannelId(0), at(50));
    assert_eq!(b.boards.own().tallies, [tally(ALL, 50, 1)]);
}

#[test]
fn a_receiver_that_joins_later_shows_whether_it_gets_something_of_one_that_has_ended() {
    let text = "transient a\ntransient b\na -> b\nb -> c";
    let joined = |met: u32| {
        let mut c = view(text, "c");
        c.meet(B, 1);
        c.read(A.0, showing(40, &[tally(1, 30, 2)]));
        c.boards.dies(A);
        c.boards.awaits(B);
        c.meet(B, 2);
        c.boards.joins(B, at(20));
        assert!(c.known().tag <= at(30), "it has shown nothing yet");
        assert!(c.boards.may_receive_from(A));
        c.read(B.0, showing(60, &[tally(0, 0, met), tally(0, 0, 0)]));
        c
    };
    let mut c = joined(1);
    assert!(c.known().tag <= at(30), "the message is on its way");
    assert!(c.boards.may_receive_from(A));
    let mut c = joined(0);
    assert_eq!(c.known().tag, at(60));
    assert!(!c.boards.may_receive_from(A));
}

#[test]
fn the_last_tag_of_a_process_is_what_it_may_have_begun_or_sent() {
    let mut c = view(CHAIN, "c");
    c.read(A.0, showing(40, &[tally(2, 20, 0)]));
    assert_eq!(c.boards.last_of(A), Some(at(40)));
    c.read(A.0, Posting { next: Step::FOREVER, ..showing(0, &[tally(3, 50, 0)]) });
    assert_eq!(c.boards.last_of(A), Some(at(50)), "no event is known of it after that");
    c.read(A.0, Posting { ended: true, ..showing(60, &[tally(3, 50, 0)]) });
    assert_eq!(c.boards.last_of(A), None, "it has said itself where it ends");
    assert_eq!(c.boards.last_of(B), None, "b is no transient federate");
}
