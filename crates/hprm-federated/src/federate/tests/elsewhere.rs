//! Federates that read boards, and share no memory with one of the others.

use super::*;
use crate::{Posting, Tally};

/// A federate on host 1 that has started, with all links up that it needs, and all boards that it reads there. The hosts are
/// those of all federates, in order; those with an odd one share memory with the RTI.
fn started_on(text: &str, name: &str, hosts: &[u128]) -> Federate {
    let peers = (0..).zip(hosts).map(|(id, host)| peer_on(id, *host)).collect();
    let mut machine = on_boards(text, name, peers);
    input(&mut machine, 0, Input::FromRti(Frame::Start { at: START, first: Tag::START }));
    machine
}

/// What leaves for federates elsewhere: for which, and the posting.
fn told(outputs: Vec<Output>) -> Vec<(u16, Posting)> {
    let told = outputs.into_iter().filter_map(|output| match output {
        Output::ToPeer { frame: Frame::Posting { reader, posting, .. }, to } => {
            assert_eq!(to, reader);
            Some((reader.0, posting))
        }
        Output::ToRti(Frame::Posting { reader, posting, .. }) => Some((reader.0, posting)),
        _ => None,
    });
    told.collect()
}

fn shows(next: i64, waits: Step, tallies: usize) -> Posting {
    let tallies = vec![Tally { messages: 0, latest: Tag::NEVER, life: 0 }; tallies];
    Posting { next: Step::begin(at(next)), waits, departs: false, ended: false, life: 0, tallies }
}

fn from(owner: u16, reader: u16, posting: Posting) -> Frame {
    Frame::Posting { owner: FederateId(owner), reader: FederateId(reader), posting }
}

#[test]
fn a_federate_that_waits_asks_and_one_that_does_not_says_so_once() {
    let mut b = started_on("a -> b\nb -> c", "b", &[2, 1, 1]);
    let asked = told(input(&mut b, 0, Input::NextEvent(at(5))));
    let [(0, posting)] = asked.as_slice() else { panic!("a is asked, but c is not: {asked:?}") };
    assert_eq!(posting.waits.tag, at(5));
    // It asks once, before the tag is due.
    assert_eq!(told(input(&mut b, 0, Input::NextEvent(at(5)))), []);
    assert_ne!(b.permission(at(5), START), Permission::Granted);
    let peer = FederateId(0);
    let frame = from(0, 1, shows(9, Step::NEVER, 1));
    input(&mut b, 9, Input::FromPeer { from: peer, frame });
    assert_eq!(told(input(&mut b, 9, Input::NextEvent(at(5)))), []);
    assert_eq!(b.permission(at(5), START.plus(9)), Permission::Granted);
    let frame = from(0, 1, shows(20, Step::NEVER, 1));
    input(&mut b, 9, Input::FromPeer { from: peer, frame });
    let told_now = told(input(&mut b, 9, Input::NextEvent(at(5))));
    assert_eq!(
        told_now.iter().map(|(to, it)| (*to, it.waits)).collect::<Vec<_>>(),
        [(0, Step::NEVER)]
    );
    assert_eq!(told(input(&mut b, 9, Input::NextEvent(at(5)))), []);
}

#[test]
fn a_federate_that_waits_for_an_earlier_step_asks_again() {
    let mut b = started_on("a -> b\nb -> c", "b", &[2, 1, 1]);
    for time in [7, 3, 8] {
        let asked = told(input(&mut b, 0, Input::NextEvent(at(time))));
        assert_eq!(asked.iter().map(|(_, it)| it.waits.tag).collect::<Vec<_>>(), [at(time)]);
    }
}

#[test]
fn what_cannot_release_a_federate_elsewhere_is_not_sent_to_it() {
    // c is no neighbour of a, so the RTI forwards what they tell each other.
    let mut a = started_on("a -> b\nb -> c", "a", &[1, 1, 2]);
    assert_eq!(told(input(&mut a, 0, Input::NextEvent(at(3)))), []);
    let waits = from(2, 0, shows(5, Step::end(at(5)), 1));
    assert_eq!(told(input(&mut a, 0, Input::FromRti(waits))), []);
    input(&mut a, 3, Input::Begun(at(3)));
    input(&mut a, 3, Input::Completed(at(3)));
    assert_eq!(told(input(&mut a, 3, Input::NextEvent(at(5)))), []);
    input(&mut a, 5, Input::Begun(at(5)));
    input(&mut a, 5, Input::Completed(at(5)));
    let sent = told(input(&mut a, 5, Input::NextEvent(at(6))));
    assert_eq!(
        sent.iter().map(|(to, it)| (*to, it.next)).collect::<Vec<_>>(),
        [(2, Step::begin(at(6)))]
    );
    assert_eq!(told(input(&mut a, 5, Input::NextEvent(at(6)))), []);
}

#[test]
fn a_posting_follows_a_message_without_being_asked_for() {
    let mut a = started_on("a -> b\na -> c", "a", &[1, 2, 1]);
    input(&mut a, 0, Input::NextEvent(at(3)));
    input(&mut a, 3, Input::Begun(at(3)));
    let send = Input::Send { channel: ChannelId(0), tag: at(3), payload: Payload::default() };
    input(&mut a, 3, send);
    input(&mut a, 3, Input::Completed(at(3)));
    let sent = told(input(&mut a, 3, Input::NextEvent(at(8))));
    assert_eq!(
        sent.iter().map(|(to, it)| (*to, it.next)).collect::<Vec<_>>(),
        [(1, Step::begin(at(8)))]
    );
    assert_eq!(sent[0].1.tallies[0], Tally { messages: 1, latest: at(3), life: 0 });
    input(&mut a, 8, Input::Begun(at(8)));
    input(&mut a, 8, Input::Completed(at(8)));
    assert_eq!(told(input(&mut a, 8, Input::NextEvent(at(9)))), []);
}

#[test]
fn one_that_asks_to_leave_and_one_that_ends_tell_all_that_rely_on_them() {
    let mut a = started_on("a -> b\na -> c", "a", &[1, 2, 1]);
    assert_eq!(told(input(&mut a, 0, Input::NextEvent(at(3)))), []);
    let asks = told(input(&mut a, 0, Input::RequestDeparture));
    assert_eq!(asks.iter().map(|(to, it)| (*to, it.departs)).collect::<Vec<_>>(), [(1, true)]);
    let outputs = input(&mut a, 0, Input::Leave);
    let resigns = |it: &Output| matches!(it, Output::ToPeer { frame: Frame::Resign, .. });
    let posts = |it: &Output| matches!(it, Output::ToPeer { frame: Frame::Posting { .. }, .. });
    assert!(outputs.iter().position(posts) < outputs.iter().position(resigns));
    let last = told(outputs);
    assert_eq!(last.iter().map(|(to, it)| (*to, it.ended)).collect::<Vec<_>>(), [(1, true)]);
}

#[test]
fn only_federates_elsewhere_send_postings() {
    let mut b = started_on("a -> b\nc -> b", "b", &[2, 1, 1]);
    let near = from(2, 1, shows(9, Step::NEVER, 1));
    let fault = Fault::Unexpected { frame: "Posting" };
    assert_eq!(b.handle(START, Input::FromRti(near)), Err(fault.clone()));
    let of_another =
        Input::FromPeer { from: FederateId(2), frame: from(0, 1, shows(9, Step::NEVER, 1)) };
    assert_eq!(b.handle(START, of_another), Err(fault));
    // One that does not fit the program is of no use.
    input(&mut b, 0, Input::FromRti(from(0, 1, shows(9, Step::NEVER, 7))));
}
