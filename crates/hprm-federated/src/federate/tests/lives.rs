//! Federates that read boards, and transient ones that join or are killed.

use super::*;
use crate::{Posting, Tally};

fn peer(id: u16, life: u32) -> Peer {
    Peer { incarnation: life, life, ..peer_on(id, 1) }
}

/// A federate that knows those others, has linked to them and has their boards.
pub(super) fn linked(text: &str, name: &str, others: &[u16]) -> Federate {
    let me = new(text, name).me();
    on_boards(text, name, others.iter().chain([&me.0]).map(|id| peer(*id, 1)).collect())
}

pub(super) fn start(machine: &mut Federate, first: Tag) -> Vec<Output> {
    input(machine, 0, Input::FromRti(Frame::Start { at: START, first }))
}

fn gone(id: u16) -> Input {
    Input::FromRti(Frame::Gone { federate: FederateId(id), in_order: false })
}

/// What a federate has posted last.
pub(super) fn posted(outputs: &[Output]) -> Option<&Posting> {
    outputs.iter().rev().find_map(|output| match output {
        Output::Post(posting) => Some(posting),
        _ => None,
    })
}

#[test]
fn one_that_joins_takes_nothing_of_one_that_it_has_not_met() {
    let text = "transient a\ntransient b\na -> b\nb -> c";
    let delivers = |others: &[u16]| {
        let mut b = linked(text, "b", others);
        input(&mut b, 0, Input::PeerUp(FederateId(0)));
        let early = Input::FromPeer { from: FederateId(0), frame: message(0, at(50)) };
        assert!(input(&mut b, 0, early).is_empty());
        let outputs = start(&mut b, at(10));
        let is_delivered = |output: &Output| matches!(output, Output::Deliver { .. });
        let is_discarded = |output: &Output| matches!(output, Output::Discard { .. });
        let delivered = outputs.iter().any(is_delivered);
        assert_ne!(delivered, outputs.iter().any(is_discarded));
        let outputs = input(&mut b, 20, Input::NextEvent(at(20)));
        (delivered, posted(&outputs).map(|posting| posting.tallies[0]))
    };
    let one = Tally { messages: 1, latest: at(50), life: 1 };
    let none = Tally { messages: 0, latest: Tag::NEVER, life: 0 };
    assert_eq!(delivers(&[0, 2]), (true, Some(one)));
    assert_eq!(delivers(&[2]), (false, Some(none)));
}

#[test]
fn one_that_joins_takes_no_posting_of_one_that_it_has_not_met() {
    let a = FederateId(0);
    let text = "transient a\ntransient b\na -> b\nb -> c";
    let takes = |others: &[Peer]| {
        let mut b = on_boards(text, "b", others.to_vec());
        input(&mut b, 0, Input::PeerUp(a));
        start(&mut b, at(10));
        let tallies = vec![Tally { messages: 0, latest: Tag::NEVER, life: 1 }];
        let (next, waits) = (Step::begin(at(30)), Step::NEVER);
        let posting = Posting { next, waits, departs: false, ended: true, life: 1, tallies };
        let frame = Frame::Posting { owner: a, reader: b.me(), posting };
        b.handle(START, Input::FromPeer { from: a, frame })
    };
    let elsewhere = Peer { host: HostId(2), ..peer(0, 1) };
    assert_eq!(takes(&[elsewhere, peer(1, 1), peer(2, 1)]), Ok(()));
    // It has ended, and its last posting comes over the link that it had opened.
    assert_eq!(takes(&[peer(1, 1), peer(2, 1)]), Ok(()));
    let unexpected = Err(Fault::Unexpected { frame: "Posting" });
    assert_eq!(takes(&[peer(0, 1), peer(1, 1), peer(2, 1)]), unexpected, "it shares memory");
}

#[test]
fn a_federate_answers_about_one_that_joins_when_it_shows_that_it_knows_it() {
    let b = FederateId(1);
    let mut a = linked("transient b\na -> b", "a", &[]);
    start(&mut a, Tag::START);
    input(&mut a, 3, Input::NextEvent(at(3)));
    input(&mut a, 3, Input::Begun(at(3)));
    let joining = Input::FromRti(Frame::Joining { peer: peer(1, 2) });
    let connect = Output::Connect { peer: b, listen: "port 1".into() };
    assert_eq!(input(&mut a, 3, joining), [connect]);
    let met = Output::ToRti(Frame::Met { federate: b, incarnation: 2, after: at(3) });
    assert!(!input(&mut a, 3, Input::PeerUp(b)).contains(&met), "it has shown nothing yet");
    input(&mut a, 3, Input::Completed(at(3)));
    let outputs = input(&mut a, 3, Input::NextEvent(at(9)));
    assert!(outputs.contains(&met), "{outputs:?}");
    let none = Tally { messages: 0, latest: Tag::NEVER, life: 2 };
    assert_eq!(posted(&outputs).map(|posting| posting.tallies[0]), Some(none));
    let board = Frame::Board { owner: FederateId(0), reader: b, notifier: false };
    assert!(outputs.contains(&Output::ToRti(board)), "{outputs:?}");

    // Once more, when it relies on nothing that it had found without that one.
    let joined = Input::FromRti(Frame::Joined { federate: b, first: at(8) });
    assert!(input(&mut a, 4, joined).contains(&met));
}

#[test]
fn a_successor_is_met_when_the_link_to_its_predecessor_has_been_read_to_its_end() {
    let text = "transient b\na -> b after 1\nb -> a";
    let (b, second) = (FederateId(1), Input::FromRti(Frame::Joining { peer: peer(1, 2) }));
    let mut a = linked(text, "a", &[1]);
    start(&mut a, Tag::START);
    input(&mut a, 1, Input::NextEvent(at(5)));
    input(&mut a, 1, gone(1));
    // The RTI knows of the end; the link has not ended yet.
    assert_eq!(input(&mut a, 2, second), []);
    let is_met = |outputs: &[Output]| {
        let met = |output: &Output| matches!(output, Output::ToRti(Frame::Met { .. }));
        outputs.iter().any(met)
    };
    assert!(!is_met(&input(&mut a, 2, Input::NextEvent(at(6)))));
    let mut outputs = input(&mut a, 3, Input::PeerLost(b));
    outputs.extend(input(&mut a, 3, Input::PeerUp(b)));
    outputs.extend(input(&mut a, 3, Input::NextEvent(at(7))));
    assert!(is_met(&outputs), "{outputs:?}");
}

#[test]
fn nothing_is_sent_to_one_that_joins_before_it_is_met() {
    let (x, b) = (FederateId(0), FederateId(2));
    let mut a = linked("transient x\ntransient b\nx -> a\na -> b", "a", &[0]);
    start(&mut a, Tag::START);
    input(&mut a, 1, Input::NextEvent(at(5)));
    // Its link still brings what it has sent.
    input(&mut a, 1, gone(x.0));
    input(&mut a, 1, Input::FromRti(Frame::Joining { peer: peer(b.0, 1) }));
    input(&mut a, 1, Input::PeerUp(b));
    let sent = |a: &mut Federate| {
        let send = Input::Send { channel: ChannelId(1), tag: at(5), payload: Payload::default() };
        let outputs = input(a, 5, send);
        outputs.iter().any(|output| matches!(output, Output::ToPeer { .. }))
    };
    assert!(!sent(&mut a));
    input(&mut a, 6, Input::PeerLost(x));
    input(&mut a, 6, Input::NextEvent(at(7)));
    assert!(sent(&mut a));
}

#[test]
fn a_federate_does_not_answer_about_one_that_joins_before_it_shows_what_it_has_read() {
    // It exchanges nothing with the one that joins, which reads its board.
    let mut a = linked("c -> a\na -> d\nd -> b\ntransient b", "a", &[0, 2]);
    start(&mut a, Tag::START);
    let c = FederateId(0);
    let tallies = vec![Tally { messages: 0, latest: Tag::NEVER, life: 1 }];
    let next = Step::begin(at(100));
    let posting =
        Posting { next, waits: Step::NEVER, departs: false, ended: false, life: 1, tallies };
    input(&mut a, 1, Input::NextEvent(at(9)));
    input(&mut a, 1, Input::Board { from: c, posting });
    input(&mut a, 1, Input::NextEvent(at(9)));
    input(&mut a, 5, Input::FromPeer { from: c, frame: message(0, at(5)) });
    input(&mut a, 5, Input::FromRti(Frame::Joining { peer: peer(3, 1) }));
    let met = |outputs: Vec<Output>| {
        outputs.iter().any(|output| matches!(output, Output::ToRti(Frame::Met { .. })))
    };
    // It begins the tag at once, and posts nothing before.
    assert!(!met(input(&mut a, 5, Input::NextEvent(at(5)))));
    assert_eq!(a.permission(at(5), START.plus(5)), Permission::Granted);
    input(&mut a, 5, Input::Begun(at(5)));
    input(&mut a, 5, Input::Completed(at(5)));
    assert!(met(input(&mut a, 5, Input::NextEvent(at(9)))));
}

#[test]
fn one_that_leaves_does_nothing_at_tags_that_a_killed_one_has_begun() {
    let leaves = |has_successor: bool| {
        let mut a = linked("transient b\na -> b", "a", &[1]);
        start(&mut a, Tag::START);
        input(&mut a, 3, Input::NextEvent(at(90)));
        let tallies = vec![Tally { messages: 0, latest: Tag::NEVER, life: 1 }];
        let (next, waits) = (Step::begin(at(50)), Step::NEVER);
        let posting = Posting { next, waits, departs: false, ended: false, life: 1, tallies };
        input(&mut a, 4, Input::Board { from: FederateId(1), posting });
        input(&mut a, 60, Input::RequestDeparture);
        input(&mut a, 60, gone(1));
        input(&mut a, 60, Input::PeerLost(FederateId(1)));
        if has_successor {
            input(&mut a, 61, Input::FromRti(Frame::Joining { peer: peer(1, 2) }));
            input(&mut a, 61, Input::PeerUp(FederateId(1)));
            input(&mut a, 61, Input::NextEvent(at(90)));
        }
        let outputs = input(&mut a, 62, Input::FromRti(Frame::Depart { tag: at(4) }));
        outputs.into_iter().find_map(|output| match output {
            Output::LeaveAt(tag) => Some(tag),
            _ => None,
        })
    };
    assert_eq!(leaves(false), Some(at(50).succ()));
    assert_eq!(leaves(true), Some(at(50).succ()));
}

#[test]
fn a_federate_heeds_boards_while_something_on_them_may_let_it_go_on() {
    let c = FederateId(0);
    let mut a = linked("c -> a\na -> d", "a", &[0, 2]);
    start(&mut a, Tag::START);
    input(&mut a, 1, Input::NextEvent(at(9)));
    assert!(!a.heeds_boards(), "its next tag is not due");
    input(&mut a, 9, Input::Wake);
    assert!(a.heeds_boards(), "it waits for its input");
    let shows = |next, departs| {
        let tallies = vec![Tally { messages: 0, latest: Tag::NEVER, life: 0 }];
        let (next, waits) = (Step::begin(at(next)), Step::NEVER);
        let posting = Posting { next, waits, departs, ended: false, life: 0, tallies };
        Input::Board { from: c, posting }
    };
    input(&mut a, 9, shows(20, false));
    input(&mut a, 9, Input::NextEvent(at(9)));
    input(&mut a, 9, Input::Begun(at(9)));
    input(&mut a, 9, Input::Completed(at(9)));
    input(&mut a, 9, Input::NextEvent(at(40)));
    assert!(!a.heeds_boards());
    let departing = Frame::Departing { federate: c, incarnation: 0 };
    input(&mut a, 10, Input::FromRti(departing));
    assert!(a.heeds_boards(), "it has not read that the other one leaves");
    input(&mut a, 10, shows(20, true));
    input(&mut a, 10, Input::NextEvent(at(40)));
    assert!(!a.heeds_boards());
}

#[test]
fn a_federate_heeds_boards_until_all_has_been_read_of_one_that_was_killed() {
    let (b, third) = (FederateId(1), FederateId(2));
    let mut a = linked("transient b\na -> b after 1\nb -> a\nb -> c\nc -> a", "a", &[1, 2]);
    start(&mut a, Tag::START);
    input(&mut a, 1, Input::NextEvent(at(5)));
    input(&mut a, 1, gone(1));
    input(&mut a, 1, Input::PeerLost(b));
    input(&mut a, 1, Input::FromRti(Frame::Joining { peer: peer(1, 2) }));
    input(&mut a, 1, Input::PeerUp(b));
    input(&mut a, 1, Input::NextEvent(at(5)));
    assert!(a.heeds_boards(), "{third:?} may still read something of it");
}
