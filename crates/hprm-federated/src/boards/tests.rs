//! What follows from boards, on those of small programs.

use hprm_core::{ChannelId, FederateId, Tag};

use super::{Boards, Posting, Reading, Tally, readings};
use crate::fixture::{federate, program};
use crate::{Step, Topology};

/// A federate's view of the boards of a program.
pub(super) struct View {
    pub(super) topology: Topology,
    pub(super) boards: Boards,
}

pub(super) fn view(text: &str, me: &str) -> View {
    let program = program(text);
    let topology = Topology::new(&program);
    let boards = Boards::new(&topology, federate(&program, me));
    View { topology, boards }
}

pub(super) fn at(time: i64) -> Tag {
    Tag::new(time, 0)
}

pub(super) fn tally(messages: u64, latest: i64) -> Tally {
    Tally { messages, latest: if messages == 0 { Tag::NEVER } else { at(latest) }, life: 0 }
}

/// What a federate shows that does nothing before a time.
pub(super) fn showing(next: i64, tallies: &[Tally]) -> Posting {
    Posting { next: Step::begin(at(next)), ..posting(tallies) }
}

fn posting(tallies: &[Tally]) -> Posting {
    Posting { tallies: tallies.to_vec(), ..Posting::new(0) }
}

impl View {
    /// Reads what the process shows that is a federate now.
    pub(super) fn read(&mut self, from: u16, posting: Posting) {
        let life = self.boards.postings.get(FederateId(from)).map_or(0, |known| known.life);
        self.boards.read(FederateId(from), Posting { life, ..posting });
    }

    pub(super) fn known(&mut self) -> Step {
        self.boards.known(&self.topology)
    }

    fn released(&mut self) -> Vec<FederateId> {
        self.boards.released(&self.topology)
    }

    fn post(&mut self, next: i64) {
        self.boards.post(Step::begin(at(next)), false);
    }
}

/// The channels whose messages a federate counts: all that lead from it or to it, but physical ones.
fn channels_of(topology: &Topology, federate: FederateId) -> impl Iterator<Item = ChannelId> {
    let logical = topology.channels().iter().filter(|(_, channel)| !channel.physical);
    logical.flat_map(move |(id, channel)| {
        let ends = usize::from(channel.from == federate) + usize::from(channel.to == federate);
        std::iter::repeat_n(id, ends)
    })
}

#[test]
fn a_federate_goes_as_far_as_others_say_that_nothing_comes() {
    let mut c = view("a -> b\nb -> c after 10", "c");
    assert_eq!(c.known(), Step::end(at(10).pred()));
    c.read(0, showing(50, &[tally(0, 0)]));
    // What b says counts, too.
    assert_eq!(c.known(), Step::end(at(10).pred()));
    c.read(1, showing(70, &[tally(0, 0), tally(0, 0)]));
    assert_eq!(c.known(), Step::end(at(60).pred()));
}

#[test]
fn a_message_that_has_not_been_read_may_come_at_its_tag() {
    let mut c = view("a -> b\nb -> c", "c");
    let [a, b] = [5, 5].map(|count| tally(count, 20));
    c.read(1, showing(90, &[tally(4, 10), tally(0, 0)]));
    c.read(0, showing(80, &[a]));
    assert_eq!(c.known().tag, at(20), "the only one that b has not read");
    c.read(0, showing(80, &[tally(6, 30)]));
    assert_eq!(c.known().tag, at(10).succ(), "the first one of two is after the last one read");
    c.read(1, showing(90, &[tally(6, 30), b]));
    assert_eq!(c.known().tag, Tag::NEVER.succ().max(at(0)), "this federate has read none");
    for time in [4, 8, 12, 16, 20] {
        c.boards.received(ChannelId(1), at(time));
    }
    c.post(100);
    assert_eq!(c.known().tag, at(80));
}

#[test]
fn a_message_that_has_arrived_counts_before_the_scheduler_tells_the_next_event() {
    let mut b = view("a -> b\nb -> a after 5", "b");
    b.post(100);
    b.read(0, showing(100, &[tally(1, 10), tally(0, 0)]));
    assert_eq!(b.known().tag, at(10), "it is on its way");
    b.boards.received(ChannelId(0), at(10));
    assert_eq!(b.known().tag, at(15), "what b sends because of it may come back");
    b.post(40);
    assert_eq!(b.known().tag, at(45));
}

#[test]
fn what_is_older_than_what_was_read_before_delays_and_permits_nothing() {
    let mut c = view("a -> b\nb -> c", "c");
    c.read(1, showing(90, &[tally(3, 30), tally(0, 0)]));
    // Of the time before a sent what b has read.
    c.read(0, showing(10, &[tally(0, 0)]));
    assert_eq!(c.known().tag, at(10));
}

#[test]
fn a_federate_that_has_ended_does_nothing_more_but_for_what_it_has_sent() {
    let mut c = view("a -> b\nb -> c", "c");
    let ended = Posting { ended: true, ..posting(&[tally(0, 0), tally(1, 40)]) };
    c.read(1, ended.clone());
    assert_eq!(c.known().tag, at(40));
    c.boards.received(ChannelId(1), at(40));
    c.post(50);
    assert_eq!(c.known(), Step::FOREVER);
    // And what is sent to it is never read.
    c.read(0, showing(60, &[tally(9, 55)]));
    assert_eq!(c.known(), Step::FOREVER);
}

#[test]
fn all_federates_do_something_at_the_last_tag() {
    let mut b = view("a -> b", "b");
    b.read(0, Posting { next: Step::FOREVER, ..posting(&[tally(0, 0)]) });
    assert_eq!(b.known(), Step::FOREVER);
    b.boards.stop_at(at(70));
    assert_eq!(b.known().tag, at(70));
    assert!(b.known() < Step::end(at(70)));
}

#[test]
fn those_are_released_that_wait_and_need_not_any_more() {
    let mut a = view("a -> b\nb -> c after 10\nd -> c", "a");
    a.post(100);
    let waits =
        |time, tallies: &[Tally]| Posting { waits: Step::end(at(time)), ..showing(time, tallies) };
    a.read(1, waits(90, &[tally(0, 0), tally(0, 0)]));
    a.read(2, waits(99, &[tally(0, 0), tally(0, 0)]));
    assert_eq!(a.released(), [FederateId(1)], "c waits for d, too");
    a.read(3, showing(200, &[tally(0, 0)]));
    assert_eq!(a.released(), [FederateId(1), FederateId(2)]);
    a.post(90);
    assert_eq!(a.released().len(), 1, "b's end of the tag is not known");
    a.read(1, showing(90, &[tally(0, 0), tally(0, 0)]));
    assert_eq!(a.released(), [FederateId(2)]);
}

#[test]
fn a_board_of_another_form_is_none() {
    let mut b = view("a -> b", "b");
    b.read(0, showing(50, &[]));
    b.read(7, showing(50, &[tally(0, 0)]));
    b.read(1, showing(50, &[tally(0, 0)]));
    assert_eq!(b.known().tag, at(0));
}

#[test]
fn each_end_of_a_channel_has_a_tally() {
    let topology = Topology::new(&program("a -> b\nb ~> a\nb -> a after 5\nb -> c"));
    let channels = |federate| channels_of(&topology, FederateId(federate)).collect::<Vec<_>>();
    assert_eq!([0, 1, 2].map(|federate| channels(federate).len()), [2, 3, 1]);
    let mut b = view("a -> b\nb ~> a\nb -> a after 5\nb -> c", "b");
    let [to_b, back, to_c] = <[_; 3]>::try_from(channels(1)).unwrap();
    b.boards.received(to_b, at(3));
    b.boards.sent(back, at(8));
    b.boards.sent(to_c, at(3));
    b.boards.sent(to_c, at(4));
    assert_eq!(b.boards.own().tallies, [tally(1, 3), tally(1, 8), tally(2, 4)]);
}

/// The boards that a federate reads, by name, with a star where it may wake up the owner.
fn read_by(text: &str, me: &str) -> String {
    let program = program(text);
    let topology = Topology::new(&program);
    let me = federate(&program, me);
    let read = readings(&topology).into_iter().filter(|it| it.reader == me);
    let name = |it: Reading| topology.name(it.owner) + if it.wakes { "*" } else { "" };
    read.map(name).collect::<Vec<_>>().join(" ")
}

#[test]
fn a_federate_reads_no_board_that_tells_it_nothing() {
    let chain = "a -> b\nb -> c";
    assert_eq!(read_by(chain, "a"), "b* c*");
    assert_eq!(read_by(chain, "b"), "a c*");
    assert_eq!(read_by(chain, "c"), "a b");
    // What `a` says tells `b` whether `c` still waits for something else.
    let fan_in = "a -> c\nb -> c\nd -> e";
    assert_eq!(read_by(fan_in, "b"), "a c*");
    assert_eq!(read_by(fan_in, "d"), "e*");
    let cycle = "a -> b\nb -> a";
    assert_eq!(read_by(cycle, "a"), "b*");
}
