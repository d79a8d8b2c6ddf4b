//! The RTI against processes that are no members, and against federates that fail or break the protocol.

mod boards;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use hprm_core::{ChannelId, Fact, FederateId, Fingerprint, Payload, PhysicalTime, Tag};

use super::{HangTimeout, LinkId, Rti, RtiInput, RtiOutput, show_silence};
use crate::fixture::program;
use crate::{
    Attempt, Count, Fault, FederationId, Frame, HostId, Missing, PROTOCOL, Refusal, Step, Topology,
};

const FEDERATION: FederationId = FederationId(7);
const NOW: PhysicalTime = PhysicalTime(0);

fn rti(text: &str) -> Rti {
    Rti::new(Topology::new(&program(text)), FEDERATION, Arc::new(fingerprint("4 s")), 100)
}

/// What a program with that timeout is like.
fn fingerprint(timeout: &str) -> Fingerprint {
    Fingerprint::new(vec![Fact::text("property timeout".to_owned(), timeout.to_owned())])
}

/// The greeting of another process each time.
fn hello(federate: u16) -> Frame {
    static PROCESSES: AtomicU64 = AtomicU64::new(1_000);
    let process = PROCESSES.fetch_add(1, Ordering::Relaxed);
    attempt(federate, Attempt { process, number: 0 })
}

/// The greeting of a process that tries to join.
fn attempt(federate: u16, attempt: Attempt) -> Frame {
    Frame::Hello {
        protocol: PROTOCOL,
        federation: FEDERATION,
        fingerprint: fingerprint("4 s").digest(),
        federate: FederateId(federate),
        host: HostId(1),
        listen: None,
        attempt,
        launched: false,
    }
}

fn input(rti: &mut Rti, link: u32, frame: Frame) -> Result<Vec<RtiOutput>, Fault> {
    rti.handle(NOW, RtiInput::Frame { link: LinkId(link), frame })?;
    Ok(std::iter::from_fn(|| rti.poll()).collect())
}

fn close(rti: &mut Rti, link: u32) -> Vec<RtiOutput> {
    rti.handle(NOW, RtiInput::Closed { link: LinkId(link) }).unwrap();
    std::iter::from_fn(|| rti.poll()).collect()
}

fn sent(link: u32, frame: Frame) -> RtiOutput {
    RtiOutput::Send { link: LinkId(link), frame }
}

/// All federates have joined and are ready.
fn running(text: &str) -> Rti {
    let mut rti = rti(text);
    let federates = u16::try_from(rti.members.len()).unwrap();
    (0..federates).for_each(|id| drop(input(&mut rti, id.into(), hello(id)).unwrap()));
    for id in 0..federates {
        let now = PhysicalTime(10 * i64::from(id));
        input(&mut rti, id.into(), Frame::Ready { now }).unwrap();
    }
    rti
}

#[test]
fn only_a_member_may_ask_for_the_time() {
    let mut rti = rti("a -> b");
    let question = Frame::ClockRequest { asked: PhysicalTime(3) };
    assert_eq!(input(&mut rti, 5, question.clone()), Err(Fault::UnknownLink));
    input(&mut rti, 5, hello(0)).unwrap();
    let now = PhysicalTime(77);
    rti.handle(now, RtiInput::Frame { link: LinkId(5), frame: question }).unwrap();
    let answer = Frame::ClockReply { asked: PhysicalTime(3), received: now, sent: now };
    assert_eq!(std::iter::from_fn(|| rti.poll()).last(), Some(sent(5, answer)));
}

#[test]
fn all_federates_start_together_after_the_latest_clock() {
    let mut rti = rti("a -> b");
    assert_eq!(input(&mut rti, 5, hello(0)).unwrap().len(), 1);
    let outputs = input(&mut rti, 6, hello(1)).unwrap();
    assert!(matches!(
        outputs.as_slice(),
        [
            RtiOutput::Joined { link: LinkId(6), .. },
            RtiOutput::Send { link: LinkId(5), frame: Frame::Peers { .. } },
            RtiOutput::Send { link: LinkId(6), frame: Frame::Peers { .. } },
        ]
    ));
    let loaded = |id| RtiOutput::Loaded { federate: FederateId(id) };
    assert_eq!(input(&mut rti, 5, Frame::Ready { now: PhysicalTime(30) }).unwrap(), [loaded(0)]);
    let (at, first) = (PhysicalTime(130), Tag::START);
    assert_eq!(
        input(&mut rti, 6, Frame::Ready { now: PhysicalTime(20) }).unwrap(),
        [
            loaded(1),
            sent(5, Frame::Start { at, first }),
            sent(6, Frame::Start { at, first }),
            RtiOutput::Started { at }
        ]
    );
}

#[test]
fn the_start_is_a_multiple_of_what_the_program_says() {
    let mut program = program("a -> b");
    program.properties.start_time_multiple = 1_000;
    let mut rti = Rti::new(Topology::new(&program), FEDERATION, Arc::new(fingerprint("4 s")), 100);
    (0..2).for_each(|id| drop(input(&mut rti, id.into(), hello(id)).unwrap()));
    input(&mut rti, 0, Frame::Ready { now: PhysicalTime(1_910) }).unwrap();
    let outputs = input(&mut rti, 1, Frame::Ready { now: PhysicalTime(1_900) }).unwrap();
    assert_eq!(outputs.last(), Some(&RtiOutput::Started { at: PhysicalTime(3_000) }));
}

#[test]
fn processes_that_are_no_members_are_refused_with_a_reason() {
    let other = |change: fn(&mut Frame)| {
        let mut frame = hello(1);
        change(&mut frame);
        frame
    };
    let cases = [
        (
            other(|f| {
                if let Frame::Hello { protocol, .. } = f {
                    *protocol += 1;
                }
            }),
            Refusal::WrongProtocol,
        ),
        (
            other(|f| {
                if let Frame::Hello { federation, .. } = f {
                    federation.0 += 1;
                }
            }),
            Refusal::WrongFederation,
        ),
        (hello(9), Refusal::UnknownFederate),
        (hello(0), Refusal::Duplicate),
    ];
    let mut rti = rti("a -> b");
    input(&mut rti, 0, hello(0)).unwrap();
    for (frame, reason) in cases {
        let close = RtiOutput::Close { link: LinkId(3) };
        let Frame::Hello { federate, .. } = &frame else { unreachable!("all are greetings") };
        let name = rti.topology.name(*federate);
        let sent = sent(3, Frame::Refused { reason: reason.clone() });
        let refused = [sent, close, RtiOutput::Refused { name, reason }];
        assert_eq!(input(&mut rti, 3, frame).unwrap(), refused);
        assert!(self::close(&mut rti, 3).is_empty());
    }
    let mut running = running("a -> b");
    let outputs = input(&mut running, 3, hello(0)).unwrap();
    assert_eq!(outputs[0], sent(3, Frame::Refused { reason: Refusal::TooLate }));
}

/// The greeting of a federate whose program has another timeout, and what its program is like.
fn other(federate: u16, timeout: &str) -> (Frame, Frame) {
    let mut hello = hello(federate);
    if let Frame::Hello { fingerprint, .. } = &mut hello {
        *fingerprint = self::fingerprint(timeout).digest();
    }
    let facts = fingerprint(timeout).report();
    (hello, Frame::ProgramReply { name: "b".to_owned(), facts })
}

#[test]
fn another_program_is_refused_with_what_differs() {
    let mut rti = rti("a -> b");
    input(&mut rti, 0, hello(0)).unwrap();
    let (hello_of_b, reply) = other(1, "1 s");
    let link = LinkId(3);
    let asked = [RtiOutput::ProgramRequested { link }, sent(3, Frame::ProgramRequest)];
    assert_eq!(input(&mut rti, 3, hello_of_b).unwrap(), asked);
    // The federate may have loaded its program before the request arrives, and asks for the time.
    assert!(input(&mut rti, 3, Frame::Loaded).unwrap().is_empty());
    let question = Frame::ClockRequest { asked: PhysicalTime(3) };
    assert_eq!(input(&mut rti, 3, question).unwrap().len(), 1);
    assert!(input(&mut rti, 3, Frame::Resign).is_err());
    let differences = vec!["property timeout is 1 s at federate b and 4 s at the RTI".to_owned()];
    let reason = Refusal::WrongProgram { differences };
    let words = reason.to_string();
    assert!(words.contains("\n  - property timeout is 1 s at federate b"), "{words}");
    assert_eq!(
        input(&mut rti, 3, reply).unwrap(),
        [
            sent(3, Frame::Refused { reason: reason.clone() }),
            RtiOutput::Close { link },
            RtiOutput::Refused { name: "b".to_owned(), reason },
        ]
    );
    close(&mut rti, 3);
    // There is still a place for the right one.
    assert!(input(&mut rti, 4, hello(1)).unwrap().len() > 1);
}

#[test]
fn a_program_that_agrees_in_all_that_is_compared_is_the_same() {
    for joins_late in [false, true] {
        let mut rti = rti(if joins_late { "transient b\na -> b" } else { "a -> b" });
        input(&mut rti, 0, hello(0)).unwrap();
        if joins_late {
            input(&mut rti, 0, Frame::Ready { now: NOW }).unwrap();
            assert_eq!(rti.phase, super::Phase::Running);
        }
        let (hello, _) = other(1, "1 s");
        input(&mut rti, 3, hello).unwrap();
        input(&mut rti, 3, Frame::Loaded).unwrap();
        // It has a module that the RTI lacks.
        let mut facts = fingerprint("4 s").report();
        facts.push(Fact::digest("module pixels".to_owned(), [&b"1"[..]]).if_present());
        let name = "b".to_owned();
        let outputs = input(&mut rti, 3, Frame::ProgramReply { name, facts }).unwrap();
        let joined =
            RtiOutput::Joined { federate: FederateId(1), link: LinkId(3), launched: false };
        assert_eq!(outputs[0], joined);
        // One that joins late is introduced, as it has loaded its program.
        let introduced = |output: &RtiOutput| {
            matches!(output, RtiOutput::Send { frame: Frame::Joining { .. }, .. })
        };
        assert_eq!(outputs.iter().any(introduced), joins_late, "{outputs:?}");
    }
}

#[test]
fn not_all_of_many_federates_with_other_programs_are_asked() {
    let mut rti = rti("a -> b");
    for link in 0..100 {
        let asks = input(&mut rti, link, other(1, "1 s").0).unwrap().len() == 2;
        assert_eq!(asks, link < 64, "{link}");
    }
    close(&mut rti, 0);
    assert_eq!(input(&mut rti, 100, other(1, "1 s").0).unwrap().len(), 2);
}

#[test]
fn a_faulty_frame_changes_nothing() {
    let tag = Tag::new(5, 0);
    let message =
        |channel| Frame::Message { channel: ChannelId(channel), tag, payload: Payload::default() };
    let count = |channel| Count { channel: ChannelId(channel), messages: 1 };
    let mut centralized = running("a -> b\nb -> c after 10");
    input(&mut centralized, 0, Frame::NextEventTag { tag: Tag::new(50, 0) }).unwrap();
    input(&mut centralized, 1, Frame::NextEventTag { tag: Tag::new(20, 0) }).unwrap();
    let decentralized = running("decentralized\na -> b\nb -> c after 10");
    let progress = |counts| Frame::Progress { next: Step::begin(tag), counts };
    let cases = [
        (&centralized, 7, Frame::Resign),
        (&centralized, 0, hello(0)),
        (&centralized, 0, Frame::Ready { now: NOW }),
        (&centralized, 0, Frame::StopReply { tag }),
        (&centralized, 0, Frame::TagAdvanceGrant { tag }),
        (&centralized, 0, message(1)),
        (&centralized, 0, message(9)),
        // b may process everything before 50 already.
        (&centralized, 0, message(0)),
        (&centralized, 0, progress(vec![])),
        (
            &centralized,
            0,
            Frame::Release { owner: FederateId(1), reader: FederateId(2), serials: vec![] },
        ),
        (&decentralized, 0, message(0)),
        (&decentralized, 0, Frame::NextEventTag { tag }),
        (&decentralized, 0, progress(vec![count(0), count(1)])),
    ];
    for (before, link, frame) in cases {
        let mut after = before.clone();
        let result = input(&mut after, link, frame.clone());
        assert!(result.is_err(), "{frame:?} gave {result:?}");
        assert_eq!(&after, before, "{frame:?}");
    }
}

#[test]
fn the_limit_of_a_predecessor_that_has_left_in_time_wakes_the_rti_no_more() {
    let mut rti = running("transient a\ntransient b\na -> b\nc -> a");
    for (federate, link) in [(1, 11), (0, 10)] {
        input(&mut rti, link, hello(federate)).unwrap();
        let outputs = input(&mut rti, link, Frame::Loaded).unwrap();
        assert!(outputs.contains(&sent(federate.into(), Frame::Depart { tag: Tag::START })));
    }
    let limit = rti.next_wakeup().unwrap();
    for link in [1, 0] {
        input(&mut rti, link, Frame::Leave { tag: Tag::START }).unwrap();
    }
    // The new a has no predecessor any more, and waits until the new b, its neighbour, has linked to c.
    assert!(rti.arrivals.next_wakeup().is_some_and(|at| at > limit), "{:?}", rti.arrivals);
}

#[test]
fn only_the_first_failure_is_reported_and_all_federates_are_told() {
    let mut rti = running("a -> b\nb -> c");
    let federate = FederateId(1);
    let failed = || Frame::Failed { federate, message: "no".into(), code: 3 };
    assert_eq!(
        input(&mut rti, 1, failed()).unwrap(),
        [
            sent(0, failed()),
            sent(2, failed()),
            RtiOutput::Failed { federate, message: "no".into(), code: 3 },
        ]
    );
    assert!(close(&mut rti, 1).is_empty());
    assert!(close(&mut rti, 0).is_empty());
    assert_eq!(close(&mut rti, 2), [RtiOutput::Finished]);
}

#[test]
fn a_link_that_ends_without_a_resign_is_a_failure_with_a_name() {
    let mut rti = running("a -> b");
    let outputs = close(&mut rti, 0);
    let [RtiOutput::Send { link: LinkId(1), .. }, RtiOutput::Failed { message, .. }] =
        outputs.as_slice()
    else {
        panic!("{outputs:?}");
    };
    assert_eq!(message, "the process of federate a ended before its last tag");
}

#[test]
fn a_federate_that_leaves_before_all_have_joined_may_join_again() {
    let mut rti = rti("a -> b");
    let federate = FederateId(0);
    input(&mut rti, 5, hello(0)).unwrap();
    assert_eq!(close(&mut rti, 5), [RtiOutput::Left { federate }]);
    let joined = RtiOutput::Joined { federate, link: LinkId(6), launched: false };
    assert_eq!(input(&mut rti, 6, hello(0)).unwrap(), [joined]);
    // Once the other one has joined, all have: the second link of the first federate counts.
    input(&mut rti, 7, hello(1)).unwrap();
    for link in [6, 7] {
        input(&mut rti, link, Frame::Ready { now: NOW }).unwrap();
    }
    assert_eq!(rti.phase, super::Phase::Running);
}

/// The frames of a process over its links to the RTI: it has opened one after the other.
fn tries(federate: u16, process: u64) -> impl Fn(u32) -> Frame {
    move |number| attempt(federate, Attempt { process, number })
}

#[test]
fn a_process_that_joins_again_is_no_duplicate_of_itself() {
    let mut rti = rti("a -> b");
    let (federate, tries) = (FederateId(0), tries(0, 1));
    input(&mut rti, 5, tries(0)).unwrap();
    // The RTI has not noticed yet that the former link has ended.
    let outputs = [
        RtiOutput::Left { federate },
        RtiOutput::Close { link: LinkId(5) },
        RtiOutput::Joined { federate, link: LinkId(6), launched: false },
    ];
    assert_eq!(input(&mut rti, 6, tries(1)).unwrap(), outputs);
    // Nothing counts any more that comes over the former link.
    assert!(input(&mut rti, 5, Frame::Loaded).unwrap().is_empty());
    assert!(close(&mut rti, 5).is_empty());
    // Another process is a duplicate, for however long the first one has tried.
    let outputs = input(&mut rti, 7, hello(0)).unwrap();
    assert_eq!(outputs[0], sent(7, Frame::Refused { reason: Refusal::Duplicate }));
    let outputs = input(&mut rti, 8, hello(1)).unwrap();
    assert!(outputs.iter().any(|output| matches!(output, RtiOutput::Send { link: LinkId(6), .. })));
}

#[test]
fn an_attempt_that_comes_after_a_later_one_does_not_count() {
    for joins_late in [false, true] {
        let mut rti = rti(if joins_late { "transient a\na -> b" } else { "a -> b" });
        if joins_late {
            input(&mut rti, 0, hello(1)).unwrap();
            input(&mut rti, 0, Frame::Ready { now: NOW }).unwrap();
        }
        let tries = tries(0, 1);
        input(&mut rti, 6, tries(1)).unwrap();
        // The driver reads the former link late. Its process has given it up, so there is no use in an answer.
        for number in [0, 1] {
            let close = RtiOutput::Close { link: LinkId(5) };
            assert_eq!(input(&mut rti, 5, tries(number)).unwrap(), [close]);
            assert!(input(&mut rti, 5, Frame::Loaded).unwrap().is_empty());
            assert!(self::close(&mut rti, 5).is_empty());
        }
        // The later one counts.
        assert!(rti.links.contains_key(&LinkId(6)));
    }
}

#[test]
fn a_transient_federate_that_arrives_again_over_another_link_has_not_failed() {
    let mut rti = running("decentralized\ntransient a\na -> b");
    close(&mut rti, 0);
    let (federate, tries) = (FederateId(0), tries(0, 1));
    input(&mut rti, 5, tries(0)).unwrap();
    let introduced = |outputs: &[RtiOutput]| {
        let joining = |output: &_| {
            matches!(output, RtiOutput::Send { link: LinkId(1), frame: Frame::Joining { .. } })
        };
        outputs.iter().any(joining)
    };
    assert!(introduced(&input(&mut rti, 5, Frame::Loaded).unwrap()));
    let gone = Frame::Gone { federate, in_order: false };
    let outputs = [
        RtiOutput::Withdrawn { federate, failure: None },
        sent(1, gone),
        RtiOutput::Close { link: LinkId(5) },
        RtiOutput::Joined { federate, link: LinkId(6), launched: false },
    ];
    assert_eq!(input(&mut rti, 6, tries(1)).unwrap(), outputs);
    assert!(introduced(&input(&mut rti, 6, Frame::Loaded).unwrap()));
}

/// A process that a launcher has started asks to join.
fn launched(federate: u16) -> Frame {
    let mut hello = hello(federate);
    if let Frame::Hello { launched, .. } = &mut hello {
        *launched = true;
    }
    hello
}

#[test]
fn what_a_launcher_starts_takes_no_place_of_a_process_that_a_user_has_started() {
    let federate = FederateId(0);
    let is_joined = |outputs: &[RtiOutput]| {
        outputs.iter().any(|output| matches!(output, RtiOutput::Joined { .. }))
    };
    let mut rti = running("transient a\na -> b");
    let refused = sent(5, Frame::Refused { reason: Refusal::Duplicate });
    assert_eq!(input(&mut rti, 5, launched(0)).unwrap()[0], refused);
    // Another one of the user may, and one of the launcher when there is none.
    assert!(is_joined(&input(&mut rti, 6, hello(0)).unwrap()));
    let message = "the process of federate a ended before its last tag".to_owned();
    let withdrawn = RtiOutput::Withdrawn { federate, failure: Some((message, 1)) };
    assert_eq!(close(&mut rti, 6), [withdrawn]);
    assert!(rti.members[federate].is_live());
    close(&mut rti, 0);
    assert!(is_joined(&input(&mut rti, 7, launched(0)).unwrap()));
    input(&mut rti, 7, Frame::Loaded).unwrap();
    input(&mut rti, 1, Frame::Met { federate, incarnation: 7, after: Tag::NEVER }).unwrap();
    input(&mut rti, 7, Frame::Ready { now: NOW }).unwrap();
    assert_eq!(rti.members[federate].link(), Some(LinkId(7)));
    // The launcher's own one may be gone without the RTI's knowledge.
    assert!(is_joined(&input(&mut rti, 8, launched(0)).unwrap()));
}

#[test]
fn a_process_that_joins_again_after_all_have_joined_has_failed() {
    let mut rti = rti("a -> b");
    let tries = tries(0, 1);
    input(&mut rti, 0, tries(0)).unwrap();
    input(&mut rti, 1, hello(1)).unwrap();
    let outputs = input(&mut rti, 2, tries(1)).unwrap();
    assert!(outputs.iter().any(|output| matches!(output, RtiOutput::Failed { .. })), "{outputs:?}");
    let refused = sent(2, Frame::Refused { reason: Refusal::TooLate });
    assert!(outputs.contains(&refused), "{outputs:?}");
}

#[test]
fn the_program_of_a_process_that_joins_again_is_asked_for_again() {
    let mut rti = rti("a -> b");
    let changed = |number| {
        let mut hello = tries(1, 1)(number);
        if let Frame::Hello { fingerprint, .. } = &mut hello {
            *fingerprint = self::fingerprint("1 s").digest();
        }
        hello
    };
    input(&mut rti, 3, changed(0)).unwrap();
    let link = LinkId(4);
    let asked = [
        RtiOutput::Close { link: LinkId(3) },
        RtiOutput::ProgramRequested { link },
        sent(4, Frame::ProgramRequest),
    ];
    assert_eq!(input(&mut rti, 4, changed(1)).unwrap(), asked);
    assert!(input(&mut rti, 3, Frame::Loaded).unwrap().is_empty());
}

#[test]
fn a_federate_that_leaves_once_all_have_joined_has_failed() {
    let mut rti = rti("a -> b");
    (0..2).for_each(|id| drop(input(&mut rti, id.into(), hello(id)).unwrap()));
    let outputs = close(&mut rti, 0);
    assert!(matches!(outputs.last(), Some(RtiOutput::Failed { .. })), "{outputs:?}");
    assert_eq!(close(&mut rti, 1), [RtiOutput::Finished]);
}

#[test]
fn a_federation_that_fails_while_it_joins_ends_when_all_have_left() {
    let mut rti = rti("a -> b\nb -> c");
    (0..2).for_each(|id| drop(input(&mut rti, id.into(), hello(id)).unwrap()));
    let failed = Frame::Failed { federate: FederateId(0), message: "no".into(), code: 1 };
    input(&mut rti, 0, failed).unwrap();
    assert!(close(&mut rti, 0).is_empty());
    assert_eq!(close(&mut rti, 1), [RtiOutput::Finished]);
}

#[test]
fn a_stop_before_the_start_refuses_all_federates() {
    for count in 0..=2 {
        let mut rti = rti("a -> b");
        (0..count).for_each(|id| drop(input(&mut rti, id.into(), hello(id)).unwrap()));
        rti.handle(NOW, RtiInput::RequestStop).unwrap();
        let outputs: Vec<_> = std::iter::from_fn(|| rti.poll()).collect();
        let refused = |id: u16| {
            let reason = Refusal::Stopped;
            let link = LinkId(id.into());
            [sent(id.into(), Frame::Refused { reason }), RtiOutput::Close { link }]
        };
        let expected: Vec<_> = (0..count).flat_map(refused).chain([RtiOutput::Finished]).collect();
        assert_eq!(outputs, expected);
        // A second one changes nothing.
        rti.handle(NOW, RtiInput::RequestStop).unwrap();
        assert_eq!(rti.poll(), None);
    }
}

#[test]
fn a_federation_that_is_not_complete_in_time_is_called_off() {
    let limit = PhysicalTime(60 * SECOND);
    let wait = |rti: &mut Rti, until: PhysicalTime| -> Vec<RtiOutput> {
        rti.handle(until, RtiInput::Wake).unwrap();
        std::iter::from_fn(|| rti.poll()).collect()
    };
    let joining = || rti("transient t\na -> b\nb -> c\nc -> t").with_join_limit(NOW, limit.0);
    let id = |name| joining().topology.federates().find(|id| joining().topology.name(*id) == name);
    let hello_of = |name| hello(id(name).unwrap().0);
    // As long as federates may join, and once all have, nothing happens.
    let mut rti = joining();
    assert_eq!(rti.next_wakeup(), Some(limit));
    assert!(wait(&mut rti, PhysicalTime(limit.0 - 1)).is_empty());
    for (link, name) in ["a", "b", "c"].into_iter().enumerate() {
        input(&mut rti, link.try_into().unwrap(), hello_of(name)).unwrap();
    }
    assert_eq!(rti.next_wakeup(), None);
    assert!(wait(&mut rti, limit).is_empty());
    // One never joins, and one does not join again.
    let mut rti = joining();
    input(&mut rti, 0, hello_of("a")).unwrap();
    input(&mut rti, 1, hello_of("b")).unwrap();
    close(&mut rti, 1);
    let missing = Missing { never: vec!["c".into()], left: vec!["b".into()], limit: limit.0 };
    assert_eq!(
        missing.to_string(),
        "federate c did not join, and federate b left before the start and did not join again within 60 s"
    );
    let reason = Refusal::Missing(missing.clone());
    let expected = [
        RtiOutput::Missing(missing),
        sent(0, Frame::Refused { reason }),
        RtiOutput::Close { link: LinkId(0) },
        RtiOutput::Finished,
    ];
    assert_eq!(wait(&mut rti, limit), expected);
    assert_eq!(rti.next_wakeup(), None);
    // One that is back is not missing.
    let mut rti = joining();
    input(&mut rti, 0, hello_of("b")).unwrap();
    close(&mut rti, 0);
    input(&mut rti, 1, hello_of("b")).unwrap();
    let outputs = wait(&mut rti, limit);
    let Some(RtiOutput::Missing(missing)) = outputs.first() else { panic!("{outputs:?}") };
    assert_eq!(missing.to_string(), "federates a, c did not join within 60 s");
}

#[test]
fn frames_about_objects_reach_their_federate_until_it_is_gone() {
    let mut rti = running("a -> b");
    let (owner, reader) = (FederateId(0), FederateId(1));
    let segment = Frame::Segment { owner, reader, segment: 0, len: 9 };
    assert_eq!(input(&mut rti, 0, segment.clone()).unwrap(), [sent(1, segment.clone())]);
    let release = Frame::Release { owner, reader, serials: vec![4] };
    assert_eq!(input(&mut rti, 1, release.clone()).unwrap(), [sent(0, release)]);
    input(&mut rti, 1, Frame::Resign).unwrap();
    assert!(input(&mut rti, 0, segment).unwrap().is_empty());
}

const SECOND: i64 = 1_000_000_000;

/// What a wake-up at that second leads to.
fn wake(rti: &mut Rti, second: i64) -> Vec<RtiOutput> {
    let now = PhysicalTime(110 + second * SECOND);
    assert!(rti.next_wakeup().is_some_and(|at| at <= now));
    rti.handle(now, RtiInput::Wake).unwrap();
    std::iter::from_fn(|| rti.poll()).collect()
}

#[test]
fn a_silent_federate_is_asked_and_then_reported() {
    let federate = FederateId(1);
    let mut rti = running("a -> b").watching(HangTimeout::default());
    rti.restart_silence(PhysicalTime(110));
    assert_eq!(wake(&mut rti, 1), [sent(0, Frame::Ping), sent(1, Frame::Ping)]);
    let answer = |rti: &mut Rti, link, second| {
        let now = PhysicalTime(110 + second * SECOND);
        let frame = Frame::Pong;
        rti.handle(now, RtiInput::Frame { link: LinkId(link), frame }).unwrap();
        rti.poll()
    };
    assert_eq!(answer(&mut rti, 0, 1), None);
    assert_eq!(wake(&mut rti, 2), [sent(0, Frame::Ping)]);
    assert_eq!(answer(&mut rti, 0, 4), None);
    assert_eq!(wake(&mut rti, 5)[1], RtiOutput::Silent { federate, silence: 5 * SECOND });
    let answers = RtiOutput::Answers { federate, silence: 9 * SECOND };
    assert_eq!(answer(&mut rti, 1, 9), Some(answers));
}

#[test]
fn a_federate_that_takes_or_sends_some_of_a_long_message_is_not_silent() {
    let mut rti = running("a -> b").watching(HangTimeout { limit: Some(3 * SECOND) });
    rti.restart_silence(PhysicalTime(110));
    for second in 1..10 {
        let now = PhysicalTime(110 + second * SECOND);
        for link in [LinkId(0), LinkId(1), LinkId(77)] {
            rti.handle(now, RtiInput::ChunksMoved { link }).unwrap();
        }
        assert_eq!(rti.next_silence(), Some(now.plus(SECOND)));
    }
}

#[test]
fn silence_is_a_failure_if_the_user_says_so() {
    let mut rti = running("a -> b").watching(HangTimeout { limit: Some(3 * SECOND) });
    rti.restart_silence(PhysicalTime(110));
    wake(&mut rti, 1);
    rti.note_frame(FederateId(0), PhysicalTime(110 + 2 * SECOND));
    let outputs = wake(&mut rti, 3);
    let message = "federate b has not answered for 3 s";
    let failed = outputs
        .iter()
        .any(|output| matches!(output, RtiOutput::Failed { message: said, .. } if said == message));
    assert!(failed, "{outputs:?}");
    assert_eq!(show_silence(400_700_000), "400 ms");
    assert_eq!(show_silence(SECOND), "1 s");
}

#[test]
fn no_federate_is_given_up_without_being_asked() {
    let asked = [sent(0, Frame::Ping), sent(1, Frame::Ping)];
    // A limit that is shorter than the time after which others are asked.
    let mut rti = running("a -> b").watching(HangTimeout { limit: Some(SECOND) });
    rti.restart_silence(PhysicalTime(110));
    assert_eq!(rti.next_silence(), Some(PhysicalTime(110 + SECOND / 2)));
    // The RTI itself stood still: the federates were not silent.
    assert_eq!(wake(&mut rti, 60), asked);
    assert_eq!(rti.next_silence(), Some(PhysicalTime(110 + 60 * SECOND + SECOND / 2)));
    let mut rti = running("a -> b").watching(HangTimeout::default());
    rti.restart_silence(PhysicalTime(110));
    assert_eq!(wake(&mut rti, 60), asked);
    assert_eq!(rti.next_silence(), Some(PhysicalTime(110 + 61 * SECOND)));
}
