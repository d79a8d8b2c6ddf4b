//! Which federations coordinate themselves by boards, and what the RTI forwards there.

use super::*;
use crate::{Posting, Step};

const HERE: HostId = HostId(1);
const THERE: HostId = HostId(2);
const ELSEWHERE: HostId = HostId(4);

/// The RTI of a program whose federates join one after another from those hosts, and accept direct links there.
fn joined(text: &str, from: &[(HostId, &str)]) -> (Rti, bool) {
    let mut rti = rti(text).with_boards(false);
    let mut last = Vec::new();
    for (id, (host, listen)) in (0..).zip(from) {
        let mut hello = hello(id);
        let Frame::Hello { host: at, listen: address, .. } = &mut hello else {
            unreachable!("it is a greeting");
        };
        (*at, *address) = (*host, Some((*listen).to_owned()).filter(|it| !it.is_empty()));
        last = input(&mut rti, id.into(), hello).unwrap();
    }
    let peers = last.iter().find_map(|output| match output {
        RtiOutput::Send { frame: Frame::Peers { boards, .. }, .. } => Some(*boards),
        _ => None,
    });
    (rti, peers.expect("all have joined"))
}

#[test]
fn boards_need_direct_links_and_some_that_share_memory() {
    let uses = |text, from: &[(HostId, &str)]| joined(text, from).1;
    let (local, agent) = ("unix:@a", "unix:@a agent:robot/1");
    assert!(uses("a -> b", &[(HERE, local), (HERE, local)]));
    assert!(!uses("a -> b", &[(HERE, local), (HERE, "")]));
    assert!(!uses("decentralized\na -> b", &[(HERE, local), (HERE, local)]));
    // Without agents, nothing tells which federates reach each other.
    assert!(!uses("a -> b\nb -> c", &[(HERE, local), (HERE, local), (THERE, local)]));
    assert!(!uses("a -> b\nb -> c", &[(HERE, local), (HERE, local), (THERE, agent)]));
    assert!(uses("a -> b\nb -> c", &[(HERE, agent), (HERE, agent), (THERE, agent)]));
    assert!(uses("a -> b\nb -> c", &[(HERE, agent), (THERE, agent), (THERE, agent)]));
    // What each shows would have to travel to every other one.
    assert!(!uses("a -> b\nb -> c", &[(HERE, agent), (THERE, agent), (ELSEWHERE, agent)]));
    // The two that share memory have nothing to do with each other.
    assert!(!uses(
        "a -> b\nc -> d",
        &[(HERE, agent), (THERE, agent), (HERE, agent), (ELSEWHERE, agent),]
    ));
}

#[test]
fn postings_are_forwarded_while_the_federation_runs() {
    let agent = "agent:robot/1";
    let (mut rti, boards) =
        joined("a -> b\nb -> c", &[(HERE, agent), (HERE, agent), (THERE, agent)]);
    assert!(boards && rti.leaves_it_to_boards());
    let posting = |owner, reader| {
        let next = Step::begin(Tag::START);
        let (owner, reader) = (FederateId(owner), FederateId(reader));
        let posting = Posting {
            next,
            waits: Step::NEVER,
            departs: false,
            ended: false,
            life: 0,
            tallies: Vec::new(),
        };
        Frame::Posting { owner, reader, posting }
    };
    let fault = Fault::Unexpected { frame: "Posting" };
    assert_eq!(input(&mut rti, 0, posting(0, 2)), Err(fault.clone()));
    for id in 0..3 {
        input(&mut rti, id, Frame::Ready { now: NOW }).unwrap();
    }
    assert_eq!(input(&mut rti, 0, posting(0, 2)).unwrap(), [sent(2, posting(0, 2))]);
    // One federate speaks for no other one.
    assert_eq!(input(&mut rti, 0, posting(1, 2)), Err(fault));
    let unknown = Err(Fault::UnknownFederate(FederateId(9)));
    assert_eq!(input(&mut rti, 0, posting(0, 9)), unknown);
}
