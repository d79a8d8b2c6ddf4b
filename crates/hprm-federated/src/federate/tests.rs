//! A federate between an RTI and peers that the test plays.

mod dnet;
mod elsewhere;
mod lives;
mod posting;

use std::sync::Arc;

use hprm_core::{ChannelId, FederateId, Payload, PhysicalTime, Tag};

use super::Federate;
use crate::fixture::{federate, program};
use crate::{
    Attempt, Count, End, Fault, FederationId, Frame, HostId, Input, Output, PROTOCOL, Peer,
    Permission, Refusal, Step,
};

const FEDERATION: FederationId = FederationId(7);
const START: PhysicalTime = PhysicalTime(1_000);
const MILLISECOND: i64 = 1_000_000;

fn new(text: &str, name: &str) -> Federate {
    let program = program(text);
    let me = federate(&program, name);
    let fingerprint = Arc::new(program.fingerprint());
    Federate::new(me, &program, FEDERATION, fingerprint, HostId(1), Some(format!("at {name}")), 9)
}

fn at(time: i64) -> Tag {
    Tag::new(time, 0)
}

fn message(channel: u32, tag: Tag) -> Frame {
    Frame::Message { channel: ChannelId(channel), tag, payload: Payload::default() }
}

fn outputs(machine: &mut Federate) -> Vec<Output> {
    std::iter::from_fn(|| machine.poll()).collect()
}

/// What comes of an input, `after` nanoseconds after the start.
fn input(machine: &mut Federate, after: i64, input: Input) -> Vec<Output> {
    machine.handle(START.plus(after), input).unwrap();
    outputs(machine)
}

fn peer_on(id: u16, host: u128) -> Peer {
    let (federate, listen) = (FederateId(id), Some(format!("port {id}")));
    Peer { federate, incarnation: 0, life: 1, host: HostId(host), listen }
}

fn peers(count: u16) -> Frame {
    let peer = |id: u16| peer_on(id, u128::from(id / 2));
    Frame::Peers { peers: (0..count).map(peer).collect(), boards: false }
}

/// Everything up to the start, with as many federates.
fn started(text: &str, name: &str, count: u16, linked: &[u16]) -> Federate {
    let mut machine = new(text, name);
    input(&mut machine, 0, Input::FromRti(peers(count)));
    input(&mut machine, 0, Input::Loaded);
    for peer in linked {
        input(&mut machine, 0, Input::PeerUp(FederateId(*peer)));
    }
    input(&mut machine, 0, Input::FromRti(Frame::Start { at: START, first: Tag::START }));
    machine
}

/// A federate that reads boards, knows those others, has linked to those that it needs, and has their boards.
fn on_boards(text: &str, name: &str, peers: Vec<Peer>) -> Federate {
    let mut machine = new(text, name);
    let me = machine.me();
    let others = peers.iter().map(|peer| peer.federate).filter(|other| *other != me);
    let others: Vec<_> = others.collect();
    input(&mut machine, 0, Input::FromRti(Frame::Peers { peers, boards: true }));
    input(&mut machine, 0, Input::Loaded);
    for peer in machine.startup.missing_links().collect::<Vec<_>>() {
        input(&mut machine, 0, Input::PeerUp(peer));
    }
    for owner in others {
        for notifier in [false, true] {
            let board = Frame::Board { owner, reader: me, notifier };
            input(&mut machine, 0, Input::FromRti(board));
        }
    }
    machine
}

#[test]
fn a_federate_is_ready_when_all_links_are_up_and_the_program_is_loaded() {
    let mut machine = new("decentralized\na -> b\nb -> c\nc ~> b", "b");
    let hello = outputs(&mut machine);
    assert!(matches!(hello.as_slice(), [Output::ToRti(Frame::Hello { protocol: PROTOCOL, .. })]));
    let up = |id| Input::PeerUp(FederateId(id));
    assert!(input(&mut machine, 0, up(0)).is_empty());
    let connect = Output::Connect { peer: FederateId(2), listen: "port 2".into() };
    assert_eq!(input(&mut machine, 0, Input::FromRti(peers(3))), [connect]);
    assert_eq!(input(&mut machine, 0, Input::Loaded), [Output::ToRti(Frame::Loaded)]);
    let ready = Output::ToRti(Frame::Ready { now: START });
    assert_eq!(input(&mut machine, 0, up(2)), [ready]);
}

#[test]
fn of_two_that_send_to_each_other_one_opens_the_link() {
    let text = "decentralized\na -> b\nb -> a after 1";
    let connects = |name| {
        let outputs = input(&mut new(text, name), 0, Input::FromRti(peers(2)));
        outputs.iter().filter(|output| matches!(output, Output::Connect { .. })).count()
    };
    assert_eq!((connects("a"), connects("b")), (1, 0));
}

#[test]
fn only_neighbours_with_the_secret_may_link() {
    let machine = new("decentralized\na -> b\nc ~> b", "b");
    let hello = |federation, from| {
        let from = FederateId(from);
        machine.admit(&Frame::PeerHello { protocol: PROTOCOL, federation, from })
    };
    let welcome = Frame::PeerWelcome { federate: FederateId(1) };
    assert_eq!(hello(FEDERATION, 0), Ok((FederateId(0), welcome)));
    assert_eq!(hello(FederationId(8), 0), Err(Refusal::WrongFederation));
    assert_eq!(hello(FEDERATION, 2), Err(Refusal::UnknownFederate));
    assert_eq!(machine.admit(&Frame::Resign), Err(Refusal::WrongProtocol));
    let opened = new("decentralized\na -> b\nc ~> b", "a").peer_hello();
    assert!(machine.admit(&opened).is_ok());
}

#[test]
fn federates_with_equal_hosts_share_memory() {
    let machine = started("a -> b\nb -> c\nc -> d", "c", 4, &[]);
    let shares: Vec<_> = (0..4).map(|id| machine.shares_memory_with(FederateId(id))).collect();
    assert_eq!(shares, [false, false, true, true]);
}

#[test]
fn a_centralized_federate_reports_and_waits_for_its_grant() {
    let mut machine = started("a -> b\nb -> c", "b", 3, &[]);
    let tag = at(5);
    let report = |tag| Output::ToRti(Frame::NextEventTag { tag });
    assert_eq!(input(&mut machine, 0, Input::NextEvent(tag)), [report(tag)]);
    assert!(input(&mut machine, 0, Input::NextEvent(tag)).is_empty());
    assert_eq!(machine.permission(tag, START.plus(9)), Permission::Wait);
    input(&mut machine, 0, Input::FromRti(Frame::TagAdvanceGrant { tag: at(7) }));
    assert_eq!(machine.permission(tag, START), Permission::Granted);
    assert_eq!(machine.permission(at(8), START), Permission::Wait);
    assert!(input(&mut machine, 0, Input::Begun(tag)).is_empty());
    let channel = ChannelId(1);
    let send = Input::Send { channel, tag, payload: Payload::default() };
    assert_eq!(input(&mut machine, 0, send), [Output::ToRti(message(1, tag))]);
    let confirmed = Output::ToRti(Frame::LatestTagConfirmed { tag });
    assert_eq!(input(&mut machine, 0, Input::Completed(tag)), [confirmed]);
    // c needs to know, although it is within the grant.
    assert_eq!(input(&mut machine, 0, Input::NextEvent(at(6))), [report(at(6))]);
}

#[test]
fn a_federate_on_which_no_other_depends_sends_no_reports_within_its_grant() {
    let mut machine = started("a -> b", "b", 2, &[]);
    input(&mut machine, 0, Input::FromRti(Frame::TagAdvanceGrant { tag: at(7) }));
    assert!(input(&mut machine, 0, Input::NextEvent(at(6))).is_empty());
    assert_eq!(input(&mut machine, 0, Input::NextEvent(at(8))).len(), 1);
}

#[test]
fn a_federate_that_a_clock_may_wake_reports_no_more_than_its_clock() {
    let mut machine = started("b -> c\na ~> b", "b", 3, &[]);
    let reported = |outputs: Vec<Output>| match outputs.as_slice() {
        [] => None,
        [Output::ToRti(Frame::NextEventTag { tag })] => Some(*tag),
        other => panic!("{other:?}"),
    };
    assert_eq!(reported(input(&mut machine, 3, Input::NextEvent(Tag::FOREVER))), Some(at(3)));
    let wakeup = machine.next_wakeup().unwrap();
    assert_eq!(wakeup, START.plus(10 * MILLISECOND + 3));
    assert_eq!(reported(input(&mut machine, 9, Input::Wake)), None);
    let later = 10 * MILLISECOND + 3;
    assert_eq!(reported(input(&mut machine, later, Input::Wake)), Some(at(later)));
}

#[test]
fn a_decentralized_federate_waits_as_long_as_its_program_says() {
    let text = "decentralized\nmaxwait 100\na -> b\nc -> b after 50";
    let mut machine = started(text, "b", 3, &[0, 2]);
    let due = |tag: Tag| Permission::WaitUntil(tag.due(START).plus(100));
    assert_eq!(machine.permission(at(5), START), due(at(5)));
    assert_eq!(machine.permission(at(5), START.plus(105)), Permission::Granted);
    let from = FederateId(0);
    let arrives = |tag| Input::FromPeer { from, frame: message(0, tag) };
    let delivered = input(&mut machine, 0, arrives(at(5)));
    assert!(matches!(delivered.as_slice(), [Output::Deliver { channel: ChannelId(0), .. }]));
    // Nothing from c can come before 50.
    assert_eq!(machine.permission(at(5), START), Permission::Granted);
    assert_eq!(machine.permission(at(6), START), due(at(6)));
    input(&mut machine, 0, arrives(at(60)));
    assert_eq!(machine.permission(at(49), START), Permission::Granted);
    // The input is unknown only at the tag itself, and the reactions that read it wait for that.
    assert_eq!(machine.permission(at(50), START), Permission::Granted);
    input(&mut machine, 0, Input::Begun(at(50)));
    assert_eq!(machine.level_permission(None, START), due(at(50)));
    assert_eq!(machine.permission(at(51), START), due(at(51)));
    // A tardy message is delivered all the same: the scheduler sees that it is tardy.
    assert_eq!(input(&mut machine, 0, arrives(at(3))).len(), 1);
}

#[test]
fn a_reaction_waits_for_what_it_reads_and_for_nothing_else() {
    // Each connection ends at a reaction of its own, one level after the other.
    let text = "decentralized\nmaxwait 10\na -> c absent_after 5\nb -> c absent_after 40";
    let program = program(text);
    let levels: Vec<_> = program.channels.values().map(|channel| channel.first_reader).collect();
    assert!(levels[0] < levels[1], "{levels:?}");
    let mut machine = started(text, "c", 3, &[0, 2]);
    let until = |wait| Permission::WaitUntil(at(100).due(START).plus(wait));
    // Before: a message for an earlier tag may still come.
    assert_eq!(machine.permission(at(100), START), until(10));
    input(&mut machine, 110, Input::Begun(at(100)));
    let levels =
        [0, levels[0], levels[1]].map(|level| machine.level_permission(Some(level), START));
    assert_eq!(levels, [until(10), until(15), until(50)]);
    assert_eq!(machine.level_permission(None, START), until(50));
    // Known through the tag before: there is no reason to wait for that.
    for (from, channel) in [(0, 0), (2, 1)] {
        let frame = message(channel, at(100).pred());
        input(&mut machine, 110, Input::FromPeer { from: FederateId(from), frame });
    }
    assert_eq!(machine.level_permission(Some(0), START), Permission::Granted);
    assert_eq!(machine.level_permission(None, START), until(50));
}

#[test]
fn the_start_waits_for_nothing_but_what_is_read_there() {
    let machine = started("decentralized\nmaxwait 10\na -> b absent_after 5", "b", 2, &[0]);
    assert_eq!(machine.permission(Tag::START, START), Permission::Granted);
}

#[test]
fn how_long_it_waits_can_change() {
    let mut machine = started("decentralized\nmaxwait 100\na -> b", "b", 2, &[0]);
    let until = |wait| Permission::WaitUntil(at(5).due(START).plus(wait));
    assert_eq!(machine.permission(at(5), START), until(100));
    assert!(input(&mut machine, 0, Input::Maxwait(300)).is_empty());
    assert_eq!(machine.permission(at(5), START), until(300));
    input(&mut machine, 0, Input::Maxwait(0));
    assert_eq!(machine.permission(at(5), START), until(0));
    let mut centralized = started("a -> b", "b", 2, &[]);
    assert!(input(&mut centralized, 0, Input::Maxwait(0)).is_empty());
    assert_eq!(centralized.permission(at(5), START), Permission::Wait);
}

#[test]
fn a_patient_federate_reports_and_learns_what_is_safe() {
    let mut machine = started("decentralized\na -> b\nb -> a after 1", "b", 2, &[0]);
    let from = FederateId(0);
    input(&mut machine, 0, Input::FromPeer { from, frame: message(0, at(2)) });
    assert!(input(&mut machine, 0, Input::NextEvent(at(2))).is_empty());
    let wakeup = machine.next_wakeup().unwrap();
    let counts = vec![Count { channel: ChannelId(0), messages: 1 }];
    let report = Output::ToRti(Frame::Progress { next: Step::begin(at(2)), counts });
    assert_eq!(input(&mut machine, wakeup.since(START), Input::Wake), [report]);
    assert_eq!(machine.next_wakeup(), None);
    assert_eq!(machine.permission(at(9), START.plus(i64::MAX / 2)), Permission::Wait);
    input(&mut machine, 0, Input::FromRti(Frame::Safe { through: Step::end(at(9)) }));
    assert_eq!(machine.permission(at(9), START), Permission::Granted);
}

#[test]
fn a_peer_has_sent_all_when_it_resigns_or_is_gone_and_its_link_too() {
    let text = "decentralized\na -> b";
    let from = FederateId(0);
    let gone = || Input::FromRti(Frame::Gone { federate: from, in_order: false });
    let knows = |inputs: Vec<Input>| {
        let mut machine = started(text, "b", 2, &[0]);
        inputs.into_iter().for_each(|next| drop(input(&mut machine, 0, next)));
        machine.permission(at(9), START) == Permission::Granted
    };
    assert!(!knows(vec![gone()]));
    assert!(!knows(vec![Input::PeerLost(from)]));
    assert!(knows(vec![gone(), Input::PeerLost(from)]));
    assert!(knows(vec![Input::PeerLost(from), gone()]));
    assert!(knows(vec![Input::FromPeer { from, frame: Frame::Resign }]));
}

#[test]
fn a_federate_that_ended_in_order_has_resigned_on_its_link_or_messages_are_lost() {
    let from = FederateId(0);
    let gone = || Input::FromRti(Frame::Gone { federate: from, in_order: true });
    let said = || Input::FromPeer { from, frame: Frame::Resign };
    let is_lost = |inputs: Vec<Input>| {
        let mut machine = started("decentralized\na -> b", "b", 2, &[0]);
        let outputs = inputs.into_iter().flat_map(|next| input(&mut machine, 0, next));
        let outputs: Vec<_> = outputs.collect();
        let lost = |output: &Output| {
            matches!(output, Output::Ended { reason: End::Failed { message, .. } }
                if message == "the link to federate a has broken before all that it had sent was there")
        };
        outputs.iter().any(lost)
    };
    let reset = || Input::PeerLost(from);
    assert!(is_lost(vec![gone(), reset()]));
    assert!(is_lost(vec![reset(), gone()]));
    assert!(!is_lost(vec![gone(), said(), reset()]));
    assert!(!is_lost(vec![said(), gone(), reset()]));
    assert!(!is_lost(vec![said(), reset(), gone()]));
    // As long as the link is up, the rest may arrive.
    assert!(!is_lost(vec![gone(), Input::Wake]));
}

#[test]
fn a_predecessor_that_stands_still_does_not_block_its_successor() {
    let from = FederateId(0);
    let mut machine = started("decentralized\ntransient a\na -> b", "b", 2, &[0]);
    let peer = Peer { federate: from, incarnation: 7, life: 2, host: HostId(1), listen: None };
    let second = 1_000 * MILLISECOND;
    input(&mut machine, 0, Input::FromRti(Frame::Gone { federate: from, in_order: false }));
    assert!(input(&mut machine, 0, Input::FromRti(Frame::Joining { peer })).is_empty());
    assert!(input(&mut machine, second, Input::Wake).is_empty());
    let outputs = input(&mut machine, 2 * second, Input::Wake);
    let met = Frame::Met { federate: from, incarnation: 7, after: Tag::NEVER };
    let expected = [Output::Disconnect(from), Output::OwnerGone(from), Output::ToRti(met)];
    assert_eq!(outputs, expected);
}

/// On a cycle without a delay, another federate relies on it that nothing comes. So a message that would have changed
/// that is tardy, although the tag is still open.
#[test]
fn levels_of_which_others_know_that_nothing_comes_are_passed() {
    let text = "decentralized\nmaxwait 500\na -> b\nb -> a";
    let mut machine = started(text, "b", 2, &[0]);
    input(&mut machine, 0, Input::NextEvent(at(0)));
    assert_eq!(input(&mut machine, 500, Input::Begun(at(0))), []);
    assert_eq!(input(&mut machine, 499, Input::Reached(None)), []);
    // It reads at level 1 and writes at level 2.
    let absent = Frame::PortAbsent { channel: ChannelId(1), tag: at(0) };
    let told = [Output::ToPeer { to: FederateId(0), frame: absent }, Output::Passed(2)];
    assert_eq!(input(&mut machine, 500, Input::Reached(None)), told);
    assert_eq!(input(&mut machine, 500, Input::Reached(None)), []);
}

/// The RTI forgets what a federate has reported, and what the predecessor has sent, when it knows that the federate has
/// met the successor.
#[test]
fn a_federate_reports_again_when_it_has_met_a_successor() {
    let from = FederateId(0);
    let mut machine = started("decentralized\ntransient a\na -> b", "b", 2, &[0]);
    let report = |next, counts| Output::ToRti(Frame::Progress { next: Step::begin(next), counts });
    let now = 20 * MILLISECOND;
    let outputs = input(&mut machine, now, Input::NextEvent(at(5)));
    assert_eq!(outputs, [report(at(5), Vec::new())]);
    // The next report is due ten milliseconds after this one.
    input(&mut machine, now, Input::FromPeer { from, frame: message(0, at(3)) });
    assert_eq!(input(&mut machine, now, Input::NextEvent(at(3))), []);
    input(&mut machine, now, Input::FromPeer { from, frame: Frame::Resign });
    input(&mut machine, now, Input::PeerLost(from));
    input(&mut machine, now, Input::FromRti(Frame::Gone { federate: from, in_order: true }));
    let peer = Peer { federate: from, incarnation: 7, life: 2, host: HostId(1), listen: None };
    let outputs = input(&mut machine, now, Input::FromRti(Frame::Joining { peer }));
    let met = Output::ToRti(Frame::Met { federate: from, incarnation: 7, after: Tag::NEVER });
    assert_eq!(outputs, [met]);
    let later = now + 10 * MILLISECOND;
    assert_eq!(machine.next_wakeup(), Some(START.plus(later)));
    assert_eq!(input(&mut machine, later, Input::Wake), [report(at(3), Vec::new())]);
}

#[test]
fn a_link_that_breaks_must_be_explained() {
    let from = FederateId(0);
    let lost = || started("decentralized\nmaxwait 1\na -> b", "b", 2, &[0]);
    let second = 1_000 * MILLISECOND;
    let mut machine = lost();
    let late = START.plus(2 * second);
    assert_eq!(machine.permission(at(5), late), Permission::Granted);
    input(&mut machine, 0, Input::PeerLost(from));
    assert_eq!(machine.next_wakeup(), Some(late));
    assert_eq!(machine.permission(at(5), late), Permission::Wait);
    input(&mut machine, second, Input::FromRti(Frame::Gone { federate: from, in_order: false }));
    assert_eq!(machine.next_wakeup(), None);
    assert_eq!(machine.permission(at(5), late), Permission::Granted);
    let mut machine = lost();
    input(&mut machine, 0, Input::FromPeer { from, frame: Frame::Resign });
    input(&mut machine, 0, Input::PeerLost(from));
    assert_eq!(machine.next_wakeup(), None);
    let mut machine = lost();
    input(&mut machine, 0, Input::PeerLost(from));
    assert!(input(&mut machine, second, Input::Wake).is_empty());
    let outputs = input(&mut machine, 2 * second, Input::Wake);
    let [Output::ToRti(Frame::Failed { message, .. }), Output::Ended { .. }] = outputs.as_slice()
    else {
        panic!("{outputs:?}");
    };
    assert_eq!(message, "the link to federate a is broken, although it has not ended");
}

#[test]
fn a_link_that_breaks_while_it_is_opened_is_opened_again() {
    let from = FederateId(0);
    let second = 1_000 * MILLISECOND;
    let broken = || {
        let mut machine = new("decentralized\na -> b", "b");
        input(&mut machine, 0, Input::FromRti(peers(2)));
        input(&mut machine, 0, Input::Loaded);
        let ready = Output::ToRti(Frame::Ready { now: START });
        assert_eq!(input(&mut machine, 0, Input::PeerUp(from)), [ready]);
        assert!(input(&mut machine, 0, Input::PeerLost(from)).is_empty());
        // Its other end tries for as long as its user wants.
        assert_eq!(machine.next_wakeup(), None);
        assert!(input(&mut machine, 100 * second, Input::Wake).is_empty());
        machine
    };
    let start = || Input::FromRti(Frame::Start { at: START, first: Tag::START });
    let mut machine = broken();
    input(&mut machine, 100 * second, Input::PeerUp(from));
    input(&mut machine, 100 * second, start());
    assert_eq!(machine.next_wakeup(), None);
    // The link was up for the other end, which does not open it again.
    let mut machine = broken();
    input(&mut machine, 100 * second, start());
    assert_eq!(machine.next_wakeup(), Some(START.plus(102 * second)));
}

#[test]
fn a_link_that_cannot_be_opened_must_be_explained() {
    let peer = FederateId(1);
    let second = 1_000 * MILLISECOND;
    let unreachable = || {
        let mut machine = new("decentralized\na -> b", "a");
        input(&mut machine, 0, Input::FromRti(peers(2)));
        let reason = "at x: refused".to_owned();
        assert!(input(&mut machine, 0, Input::Unreachable { peer, reason }).is_empty());
        machine
    };
    let mut machine = unreachable();
    assert_eq!(machine.next_wakeup(), Some(START.plus(2 * second)));
    let failed = Frame::Failed { federate: peer, message: "killed".to_owned(), code: 1 };
    let outputs = input(&mut machine, second, Input::FromRti(failed));
    let reason = End::Failed { federate: peer, message: "killed".to_owned(), code: 1 };
    assert_eq!(outputs, [Output::Ended { reason }]);
    let outputs = input(&mut unreachable(), 2 * second, Input::Wake);
    let [Output::ToRti(Frame::Failed { message, .. }), Output::Ended { .. }] = outputs.as_slice()
    else {
        panic!("{outputs:?}");
    };
    assert_eq!(message, "federate b has not ended, but is not reachable at x: refused");
}

#[test]
fn a_federate_that_is_asked_answers() {
    let mut machine = started("a -> b", "b", 2, &[]);
    let answer = input(&mut machine, 0, Input::FromRti(Frame::Ping));
    assert_eq!(answer, [Output::ToRti(Frame::Pong)]);
}

#[test]
fn a_message_that_precedes_the_start_is_delivered_after_it() {
    let mut machine = new("decentralized\na -> b", "b");
    input(&mut machine, 0, Input::FromRti(peers(2)));
    input(&mut machine, 0, Input::Loaded);
    input(&mut machine, 0, Input::PeerUp(FederateId(0)));
    let early = Input::FromPeer { from: FederateId(0), frame: message(0, at(0)) };
    assert!(input(&mut machine, 0, early).is_empty());
    let outputs =
        input(&mut machine, 0, Input::FromRti(Frame::Start { at: START, first: Tag::START }));
    assert!(matches!(outputs.as_slice(), [Output::Start { .. }, Output::Deliver { .. }]));
}

/// What a transient federate that joins late, and reads what `a` sends, reports as received.
fn received_by_late(inputs: impl IntoIterator<Item = Input>) -> Vec<u64> {
    let mut machine = new("decentralized\ntransient b\na -> b", "b");
    input(&mut machine, 0, Input::Loaded);
    input(&mut machine, 0, Input::PeerUp(FederateId(0)));
    input(&mut machine, 0, Input::FromRti(peers(1)));
    for given in inputs {
        input(&mut machine, 0, given);
    }
    let outputs = input(&mut machine, MILLISECOND * 20, Input::NextEvent(at(20)));
    let counts = outputs.into_iter().filter_map(|output| match output {
        Output::ToRti(Frame::Progress { counts, .. }) => Some(counts),
        _ => None,
    });
    counts.flatten().map(|count| count.messages).collect()
}

#[test]
fn what_comes_for_the_time_before_the_first_tag_counts_as_received() {
    let sent = |tag| Input::FromPeer { from: FederateId(0), frame: message(0, tag) };
    let start = || Input::FromRti(Frame::Start { at: START, first: at(10) });
    assert_eq!(received_by_late([sent(at(8)), start(), sent(at(9)), sent(at(10))]), [3]);
}

#[test]
fn messages_that_are_discarded_or_read_before_the_start_block_no_sender() {
    let text = "decentralized\ntransient b\na -> b\na ~> b";
    let mut machine = new(text, "b").with_flow_limit(0);
    input(&mut machine, 0, Input::Loaded);
    input(&mut machine, 0, Input::PeerUp(FederateId(0)));
    input(&mut machine, 0, Input::FromRti(peers(1)));
    let processed = |outputs: Vec<Output>| {
        let frames = outputs.into_iter().filter_map(|output| match output {
            Output::ToPeer { frame: Frame::Processed { channel, messages, .. }, .. } => {
                Some((channel.0, messages))
            }
            _ => None,
        });
        frames.collect::<Vec<_>>()
    };
    let sent = |tag| Input::FromPeer { from: FederateId(0), frame: message(0, tag) };
    input(&mut machine, 0, sent(at(8)));
    input(&mut machine, 0, Input::FromRti(message(1, at(8))));
    let start = Input::FromRti(Frame::Start { at: START, first: at(10) });
    assert_eq!(processed(input(&mut machine, 0, start)), [(0, 1), (1, 1)]);
    assert_eq!(processed(input(&mut machine, 0, sent(at(9)))), [(0, 1)]);
    // A message for the first tag is not processed yet.
    assert_eq!(processed(input(&mut machine, 0, sent(at(10)))), []);
}

#[test]
fn what_a_peer_has_sent_and_did_not_come_before_its_end_is_not_waited_for() {
    let start = Input::FromRti(Frame::Start { at: START, first: at(10) });
    let gone = Input::FromRti(Frame::Gone { federate: FederateId(0), in_order: false });
    let lost = Input::PeerLost(FederateId(0));
    assert_eq!(received_by_late([start, gone, lost]), [u64::MAX]);
}

#[test]
fn a_federate_stays_before_the_tag_that_it_named_until_the_decision() {
    let mut machine = started("a -> b", "a", 2, &[]);
    input(&mut machine, 0, Input::NextEvent(at(5)));
    input(&mut machine, 0, Input::Begun(at(5)));
    let reply = input(&mut machine, 0, Input::FromRti(Frame::StopRequest { tag: at(2) }));
    let named = at(5).succ();
    assert_eq!(reply, [Output::ToRti(Frame::StopReply { tag: named })]);
    assert_eq!(machine.permission(named, START), Permission::Wait);
    assert!(input(&mut machine, 0, Input::RequestStop).is_empty());
    let granted = at(20);
    let outputs = input(&mut machine, 0, Input::FromRti(Frame::StopGranted { tag: granted }));
    assert_eq!(outputs, [Output::SetStop(granted)]);
    assert_eq!(machine.permission(named, START), Permission::Granted);
}

#[test]
fn a_federate_that_leaves_reports_its_last_tag() {
    let mut machine = started("a -> b", "a", 2, &[]);
    input(&mut machine, 0, Input::NextEvent(at(5)));
    input(&mut machine, 0, Input::Begun(at(5)));
    input(&mut machine, 0, Input::Completed(at(5)));
    let last = at(5).succ();
    assert_eq!(input(&mut machine, 0, Input::Depart), [Output::LeaveAt(last)]);
    let outputs = input(&mut machine, 0, Input::NextEvent(at(90)));
    assert_eq!(outputs, [Output::ToRti(Frame::NextEventTag { tag: last })]);
    input(&mut machine, 0, Input::Begun(last));
    let message = Input::Send { channel: ChannelId(0), tag: last, payload: Payload::default() };
    let outputs = input(&mut machine, 0, message);
    assert!(matches!(outputs.as_slice(), [Output::ToRti(Frame::Message { .. })]), "{outputs:?}");
    input(&mut machine, 0, Input::Completed(last));
    let expected = [Output::ToRti(Frame::Leave { tag: last })];
    let outputs = input(&mut machine, 0, Input::Finished);
    assert!(outputs.ends_with(&expected), "{outputs:?}");
}

#[test]
fn a_federate_asks_when_to_leave_if_others_count_on_what_it_does_next() {
    let mut machine = started("a -> b", "a", 2, &[]);
    input(&mut machine, 0, Input::NextEvent(at(50)));
    let asks = input(&mut machine, 0, Input::RequestDeparture);
    assert_eq!(asks, [Output::ToRti(Frame::Depart { tag: Tag::START })]);
    let outputs = input(&mut machine, 0, Input::FromRti(Frame::Depart { tag: at(20) }));
    assert_eq!(outputs[0], Output::LeaveAt(at(20)));
    assert!(input(&mut machine, 0, Input::RequestDeparture).is_empty());
    // Unless it does something before: then it reports itself what comes next.
    input(&mut machine, 0, Input::Begun(at(7)));
    let outputs = input(&mut machine, 0, Input::Completed(at(7)));
    assert!(outputs.ends_with(&[Output::LeaveAt(at(7).succ())]), "{outputs:?}");
}

#[test]
fn a_decentralized_federate_says_when_it_leaves_if_it_has_passed_the_tag_that_it_is_told() {
    let text = "decentralized\na -> b\nb -> a after 1";
    for (told, answers) in [(at(7), true), (at(8), false)] {
        let mut machine = started(text, "a", 2, &[1]);
        input(&mut machine, 0, Input::NextEvent(at(7)));
        input(&mut machine, 0, Input::Begun(at(7)));
        let outputs = input(&mut machine, 0, Input::FromRti(Frame::Depart { tag: told }));
        let last = told.max(at(7).succ());
        assert_eq!(outputs[0], Output::LeaveAt(last));
        let answer = Output::ToRti(Frame::Depart { tag: last });
        assert_eq!(outputs.contains(&answer), answers, "{outputs:?}");
        // The answer of the RTI changes nothing.
        let outputs = input(&mut machine, 0, Input::FromRti(Frame::Depart { tag: last }));
        assert_eq!(outputs[0], Output::LeaveAt(last));
        assert!(!outputs.contains(&answer), "{outputs:?}");
    }
}

#[test]
fn a_stop_takes_back_grants_that_did_not_know_of_it() {
    let mut machine = started("a -> b", "b", 2, &[]);
    input(&mut machine, 0, Input::FromRti(Frame::TagAdvanceGrant { tag: Tag::FOREVER }));
    input(&mut machine, 0, Input::FromRti(Frame::StopGranted { tag: at(9) }));
    assert_eq!(machine.permission(at(8), START), Permission::Granted);
    assert_eq!(machine.permission(at(9), START), Permission::Wait);
}

#[test]
fn after_the_last_tag_a_federate_resigns_on_all_links_and_sends_nothing_more() {
    let mut machine = started("decentralized\nmaxwait 5\na -> b", "a", 2, &[1]);
    let resign = || Frame::Resign;
    let expected = [Output::ToPeer { to: FederateId(1), frame: resign() }, Output::ToRti(resign())];
    assert_eq!(input(&mut machine, 0, Input::Finished), expected);
    assert!(input(&mut machine, 0, Input::RtiLost).is_empty());
}

#[test]
fn objects_are_announced_and_released_on_the_shortest_path() {
    let text = "decentralized\na -> b\nb -> c";
    let mut machine = started(text, "b", 3, &[0, 2]);
    let me = machine.me;
    let segment = |reader| Input::Segment { reader: FederateId(reader), segment: 1, len: 8 };
    let direct = input(&mut machine, 0, segment(2));
    assert!(matches!(direct.as_slice(), [Output::ToPeer { to: FederateId(2), .. }]));
    let serials = (0..5_000).collect();
    let released = input(&mut machine, 0, Input::Release { owner: FederateId(0), serials });
    assert_eq!(released.len(), 2);
    let release = Frame::Release { owner: me, reader: FederateId(2), serials: vec![3] };
    assert_eq!(
        input(&mut machine, 0, Input::FromPeer { from: FederateId(2), frame: release }),
        [Output::Released { reader: FederateId(2), serials: vec![3] }]
    );
    let gone = Input::FromRti(Frame::Gone { federate: FederateId(2), in_order: false });
    assert_eq!(input(&mut machine, 0, gone), [Output::ReaderGone(FederateId(2))]);
    input(&mut machine, 0, Input::PeerLost(FederateId(2)));
    assert!(input(&mut machine, 0, segment(2)).is_empty());
}

#[test]
fn the_end_of_another_ends_a_federate() {
    let mut machine = started("a -> b", "b", 2, &[]);
    let (federate, message, code) = (FederateId(0), "no".to_owned(), 3);
    let failed = Frame::Failed { federate, message: message.clone(), code };
    let reason = End::Failed { federate, message, code };
    assert_eq!(input(&mut machine, 0, Input::FromRti(failed)), [Output::Ended { reason }]);
    let mut machine = started("a -> b", "b", 2, &[]);
    let reason = End::RtiLost;
    assert_eq!(input(&mut machine, 0, Input::RtiLost), [Output::Ended { reason }]);
}

#[test]
fn a_faulty_frame_changes_nothing() {
    let centralized = started("a -> b\nb -> a after 1", "b", 2, &[]);
    let decentralized = started("decentralized\na -> b\nb -> a after 1", "b", 2, &[0]);
    let peer = |frame| Input::FromPeer { from: FederateId(0), frame };
    let unknown = Input::FromPeer { from: FederateId(5), frame: message(0, at(1)) };
    let payload = Payload::default();
    let cases = [
        (&centralized, Input::FromRti(message(1, at(1)))),
        (&centralized, Input::FromRti(Frame::Start { at: START, first: Tag::START })),
        (&centralized, Input::FromRti(Frame::Safe { through: Step::end(at(1)) })),
        (&centralized, peer(message(0, at(1)))),
        (&centralized, Input::Send { channel: ChannelId(0), tag: at(1), payload }),
        (&decentralized, Input::FromRti(Frame::TagAdvanceGrant { tag: at(1) })),
        (&decentralized, Input::FromRti(message(0, at(1)))),
        (&decentralized, peer(message(1, at(1)))),
        (&decentralized, peer(Frame::StopGranted { tag: at(1) })),
        (&decentralized, unknown),
    ];
    for (before, input) in cases {
        let mut after = before.clone();
        let result: Result<(), Fault> = after.handle(START, input.clone());
        assert!(result.is_err(), "{input:?}");
        assert_eq!(&after, before, "{input:?}");
    }
}

#[test]
fn a_long_failure_text_is_cut_between_characters() {
    let mut machine = started("a -> b", "b", 2, &[]);
    let message = "é".repeat(100_000);
    let outputs = input(&mut machine, 0, Input::Failed { message, code: 2 });
    let [Output::ToRti(Frame::Failed { message, code: 2, .. })] = outputs.as_slice() else {
        panic!("{outputs:?}");
    };
    assert_eq!(message.len(), 64 * 1024);
}

#[test]
fn a_federate_that_loses_the_rti_before_it_has_met_the_others_joins_again() {
    let mut machine = new("a -> b", "a");
    let Some(Output::ToRti(mut hello)) = machine.poll() else { panic!("it asks to join") };
    assert_eq!(input(&mut machine, 0, Input::RtiLost), [Output::Rejoin]);
    assert_eq!(input(&mut machine, 0, Input::Loaded), []);
    // The RTI may not have noticed that the former link has ended: it learns that the same process tries again.
    for again in 1..3 {
        let Frame::Hello { attempt, .. } = &mut hello else { panic!("it is a greeting") };
        *attempt = Attempt { number: again, ..*attempt };
        let sent = [Output::ToRti(hello.clone()), Output::ToRti(Frame::Loaded)];
        assert_eq!(input(&mut machine, 0, Input::Rejoins), sent);
        assert_eq!(input(&mut machine, 0, Input::RtiLost), [Output::Rejoin]);
    }
    input(&mut machine, 0, Input::Rejoins);
    input(&mut machine, 0, Input::FromRti(peers(2)));
    let lost = input(&mut machine, 0, Input::RtiLost);
    assert_eq!(lost, [Output::Ended { reason: End::RtiLost }]);
}

#[test]
fn a_federate_that_runs_twice_does_not_wait_for_the_other_process() {
    let mut machine = new("a -> b", "a");
    outputs(&mut machine);
    input(&mut machine, 0, Input::RtiLost);
    input(&mut machine, 0, Input::Rejoins);
    let reason = Refusal::Duplicate;
    let refused = Input::FromRti(Frame::Refused { reason: reason.clone() });
    let ended = Output::Ended { reason: End::Refused(reason) };
    assert_eq!(input(&mut machine, 0, refused), [ended]);
}
