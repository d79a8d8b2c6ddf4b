//! Waiting for links within this process, which are there at once.

use hprm_federated::FederationId;

use super::*;
use crate::link::{Keys, Purpose};
use crate::pipe_notifier::PipeNotifier;
use crate::wait::Deadline;
use crate::wire::Network;
use crate::{Address, Security, ValueExchange};

/// Longer than any test takes.
const LONG: Nanos = 3_600_000_000_000;

struct Links {
    lines: Vec<Line>,
    door: Option<Door>,
}

impl Watched for Links {
    fn lines(&self) -> impl Iterator<Item = &Line> {
        self.lines.iter()
    }

    fn lines_mut(&mut self) -> impl Iterator<Item = &mut Line> {
        self.lines.iter_mut()
    }

    fn door(&self) -> Option<&Door> {
        self.door.as_ref()
    }

    fn door_mut(&mut self) -> Option<&mut Door> {
        self.door.as_mut()
    }
}

impl Links {
    /// All frames that have come, and whether the links are open.
    fn read(&mut self) -> (usize, bool) {
        let mut frames = 0;
        let open = self.lines.iter_mut().all(|line| line.read(|_, _| frames += 1).unwrap());
        (frames, open)
    }
}

/// A link that nothing has come over, and its other end.
fn link() -> (Links, Wire) {
    let network = ValueExchange::<()>::new().network();
    let keys = Keys::new(FederationId(1), Security::default()).unwrap();
    let address: Address = "unix:@poller".parse().unwrap();
    let gate = network.listen(&address).unwrap();
    let far = network
        .connect(&address, Purpose::Messages, &keys, Deadline::at(PhysicalTime::FOREVER))
        .unwrap();
    let near = gate.accept(Purpose::Messages, &keys).unwrap().unwrap();
    let mut links = Links { lines: vec![Line::new(near)], door: None };
    assert_eq!(links.read(), (0, true));
    (links, far)
}

fn send(far: &mut Wire) {
    far.queue(Frame::Resign, None);
    far.flush().unwrap();
}

#[test]
fn a_frame_ends_a_wait_and_is_read_once() {
    for spin in [0, LONG] {
        let (mut links, mut far) = link();
        let (mut poller, wakeups) = (Poller::new(None, spin), PipeNotifier::new().unwrap());
        send(&mut far);
        let found = poller.wait(&mut links, &wakeups, None);
        assert_eq!(found, Found { news: true, ..Found::default() });
        assert_eq!(links.read(), (1, true));
        assert_eq!(poller.look(&mut links, &wakeups), Found::default());
        assert_eq!(links.read(), (0, true));
    }
}

#[test]
fn the_bell_ends_a_wait_and_rings_until_it_is_silenced() {
    for spin in [0, LONG] {
        let (mut links, _far) = link();
        let (mut poller, wakeups) = (Poller::new(None, spin), PipeNotifier::new().unwrap());
        wakeups.notify();
        for _ in 0..2 {
            let found = poller.wait(&mut links, &wakeups, None);
            assert_eq!(found, Found { notified: true, ..Found::default() });
        }
        wakeups.clear();
        assert_eq!(poller.look(&mut links, &wakeups), Found::default());
    }
}

#[test]
fn the_time_ends_a_wait_for_nothing() {
    for spin in [0, LONG] {
        let (mut links, _far) = link();
        let (mut poller, wakeups) = (Poller::new(None, spin), PipeNotifier::new().unwrap());
        let until = Clock::now().plus(1_000_000);
        assert_eq!(poller.wait(&mut links, &wakeups, Some(until)), Found::default());
        assert!(Clock::now() >= until);
    }
}

#[test]
fn an_end_that_is_closed_is_news() {
    let (mut links, far) = link();
    let (mut poller, wakeups) = (Poller::new(None, 0), PipeNotifier::new().unwrap());
    drop(far);
    assert!(poller.wait(&mut links, &wakeups, None).news);
    assert_eq!(links.read(), (0, false));
}

#[test]
fn whoever_is_at_the_door_is_news_until_the_door_is_opened() {
    let network = Network::sockets().unwrap();
    let keys = Keys::new(FederationId(1), Security::default()).unwrap();
    let acceptor = LinkAcceptor::new(Vec::new(), Purpose::Messages, keys, 1);
    let mut links = Links { lines: Vec::new(), door: Some(Door::new(acceptor)) };
    let (mut poller, wakeups) = (Poller::new(network.notifier(), 0), PipeNotifier::new().unwrap());
    assert!(poller.look(&mut links, &wakeups).news);
    let door = links.door.as_mut().unwrap();
    assert!(door.is_ready());
    assert!(door.admit(Clock::local()).unwrap().is_empty());
    assert!(!poller.look(&mut links, &wakeups).news);
}

#[test]
fn what_is_to_be_written_has_left_when_a_drain_ends() {
    let (mut links, far) = link();
    let poller = Poller::new(None, 0);
    for line in &mut links.lines {
        line.wire.queue(Frame::Resign, None);
    }
    poller.drain(&mut links, LONG, false);
    assert!(links.wires().all(|link| !link.has_outbound()));
    let mut there = Links { lines: vec![Line::new(far)], door: None };
    assert_eq!(there.read(), (1, true));
    // A link whose other end is closed keeps nobody.
    drop(there);
    links.lines[0].wire.queue(Frame::Resign, None);
    poller.drain(&mut links, LONG, true);
}
