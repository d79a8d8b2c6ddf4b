//! Chains of made-up federations.

use std::collections::BTreeMap;
use std::time::Duration;

use hprm::board::{Blocker, FederateState, Moment, Names, Stage, StoreState};
use hprm_core::{ChannelId, FederateId, PhysicalTime, Tag};

use super::*;
use crate::top::federation::{Board, Federation, Member, Process, ProcessState, RunningReaction};
use crate::top::text;

const NOW: PhysicalTime = PhysicalTime(5_000_000_000);
const START: PhysicalTime = PhysicalTime(1_000_000_000);

fn state(blockers: Vec<Blocker>) -> FederateState {
    FederateState {
        moment: Moment { at: NOW, ahead: 0 },
        notes: 7,
        stage: Stage::Running,
        start: Some(START),
        current: Some(Tag::new(1_000_000_000, 0)),
        complete: true,
        next: Tag::new(2_000_000_000, 0),
        waits: !blockers.is_empty(),
        blockers,
        tags: 3,
        channels: Vec::new(),
        store: StoreState::default(),
        tardy: 0,
        dropped: 0,
    }
}

fn member(name: &str, blockers: Vec<Blocker>) -> Member {
    let process = Process { pid: 7, state: ProcessState::Alive, host: "here".to_owned() };
    let names = Names { channels: BTreeMap::new(), ..Names::default() };
    let state = state(blockers);
    let board = Board { state, names, now: NOW, begun: None, reactions: Vec::new() };
    Member {
        name: name.to_owned(),
        process: Some(process),
        board: Some(board),
        known: None,
        restarts: 0,
    }
}

fn federation(members: Vec<Member>) -> Federation {
    Federation {
        name: "Robot".to_owned(),
        id: "1".to_owned(),
        centralized: false,
        members,
        rti: None,
        has_foreign: false,
        read_at: Duration::ZERO,
    }
}

fn message(from: u16) -> Blocker {
    let (channel, from) = (ChannelId(3), FederateId(from));
    let until = Some(NOW.plus(90_000_000_000));
    Blocker::Message { channel, from, through: Tag::new(2_000_000_000, 0), until }
}

#[test]
fn a_chain_ends_at_the_federate_that_does_not_wait() {
    let mut camera = member("camera", Vec::new());
    let board = camera.board.as_mut().unwrap();
    board.begun = Some((Tag::new(1_500_000_000, 0), NOW.plus(-3_200_000_000)));
    board.reactions = vec![RunningReaction {
        label: "Robot.camera.2".to_owned(),
        place: Some("camera.lf:14".to_owned()),
    }];
    let federation = federation(vec![
        member("motor", vec![message(1)]),
        member("planner", vec![message(2)]),
        camera,
    ]);
    let [motor, planner, camera] = [0, 1, 2].map(Part::Federate);
    assert_eq!(federation.chain(motor), [motor, planner, camera]);
    assert_eq!(federation.tree(), [(0, camera), (1, planner), (2, motor)]);
    assert_eq!(
        text::why(&federation, None),
        [
            "camera has been at tag (1500 ms, 0) for 3.2 s, in reaction Robot.camera.2 (camera.lf:14)",
            "  planner waits for camera to send on channel 3 at (2 s, 0), for 90.0 s more",
            "    motor waits for planner to send on channel 3 at (2 s, 0), for 90.0 s more",
        ]
    );
    let member = &federation.members[2];
    assert_eq!(member.board.as_ref().unwrap().lag(), Some(2_500_000_000));
}

#[test]
fn federates_that_wait_for_one_another_are_shown_once_each() {
    let one = vec![message(1)];
    let other = vec![message(0)];
    let federation = federation(vec![member("a", one), member("b", other)]);
    let [a, b] = [0, 1].map(Part::Federate);
    assert_eq!(federation.chain(a), [a, b]);
    assert_eq!(federation.tree(), [(0, a), (1, b)]);
}

#[test]
fn what_else_a_federate_waits_for_before_its_tag_is_due_does_not_count() {
    let until = NOW.plus(300_000_000);
    let blockers = vec![Blocker::Time { until }, message(1)];
    let federation = federation(vec![member("a", blockers), member("b", Vec::new())]);
    let doing = federation.doing(Part::Federate(0));
    assert_eq!(doing.kind, Kind::Idle);
    assert_eq!(doing.text, "waits for its clock: its tag (2 s, 0) is due in 300 ms");
    assert_eq!(federation.chain(Part::Federate(0)), [Part::Federate(0)]);
}

#[test]
fn a_stopped_process_explains_everything_else() {
    let mut stopped = member("a", vec![message(1)]);
    stopped.process.as_mut().unwrap().state = ProcessState::Stopped;
    let federation = federation(vec![stopped, member("b", vec![message(0)])]);
    let [a, b] = [0, 1].map(Part::Federate);
    assert_eq!(federation.chain(b), [b, a]);
    assert_eq!(federation.doing(a).kind, Kind::Stopped);
}
