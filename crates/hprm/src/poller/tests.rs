//! Waiting for links within this process, over which frames arrive at once.

use hprm_federated::FederationId;

use super::*;
use crate::link::{Keys, Network, Purpose};
use crate::pipe_notifier::PipeNotifier;
use crate::wait::Deadline;
use crate::{Address, Security, ValueExchange};

/// Longer than any test takes.
const LONG: Nanos = 3_600_000_000_000;

struct TestLinks {
    open: Vec<PolledLink>,
    acceptor: Option<PolledAcceptor>,
}

impl PollSet for TestLinks {
    fn polled_links(&self) -> impl Iterator<Item = &PolledLink> {
        self.open.iter()
    }

    fn polled_links_mut(&mut self) -> impl Iterator<Item = &mut PolledLink> {
        self.open.iter_mut()
    }

    fn acceptor(&self) -> Option<&PolledAcceptor> {
        self.acceptor.as_ref()
    }

    fn acceptor_mut(&mut self) -> Option<&mut PolledAcceptor> {
        self.acceptor.as_mut()
    }
}

impl TestLinks {
    /// All frames that have come, and whether the links are open.
    fn read(&mut self) -> (usize, bool) {
        let mut frames = 0;
        let open = self
            .open
            .iter_mut()
            .all(|polled| !polled.may_be_read() || polled.read(|_, _| frames += 1).unwrap());
        (frames, open)
    }
}

/// A link over which no frame has come, and its other end.
fn link() -> (TestLinks, Link) {
    let network = ValueExchange::<()>::new().network();
    let keys = Keys::new(FederationId(1), Security::default()).unwrap();
    let address: Address = "unix:@poller".parse().unwrap();
    let listener = network.listen(&address).unwrap();
    let far = network
        .connect(&address, Purpose::Messages, &keys, Deadline::at(PhysicalTime::FOREVER))
        .unwrap();
    let near = listener.accept(Purpose::Messages, &keys).unwrap().unwrap();
    let mut links = TestLinks { open: vec![PolledLink::new(near)], acceptor: None };
    assert_eq!(links.read(), (0, true));
    (links, far)
}

fn send(far: &mut Link) {
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
        assert_eq!(found, Found { readable: true, ..Found::default() });
        assert_eq!(links.read(), (1, true));
        assert_eq!(poller.look(&mut links, &wakeups, Clock::local()), Found::default());
        assert_eq!(links.read(), (0, true));
    }
}

#[test]
fn a_notification_ends_a_wait_until_it_is_cleared() {
    for spin in [0, LONG] {
        let (mut links, _far) = link();
        let (mut poller, wakeups) = (Poller::new(None, spin), PipeNotifier::new().unwrap());
        wakeups.notify();
        for _ in 0..2 {
            let found = poller.wait(&mut links, &wakeups, None);
            assert_eq!(found, Found { notified: true, ..Found::default() });
        }
        wakeups.clear();
        assert_eq!(poller.look(&mut links, &wakeups, Clock::local()), Found::default());
    }
}

#[test]
fn the_time_ends_a_wait_for_nothing() {
    for spin in [0, LONG] {
        let (mut links, _far) = link();
        let (mut poller, wakeups) = (Poller::new(None, spin), PipeNotifier::new().unwrap());
        let until = Clock::now().plus(1_000_000);
        let found = poller.wait(&mut links, &wakeups, Some(until));
        assert!(!found.is_anything() && Clock::now() >= until);
        // Where the poller has read the clock, it has seen that the time has come.
        assert_eq!(found.at.map(|at| at >= Clock::local_at(until)), (spin > 0).then_some(true));
    }
}

#[test]
fn a_link_whose_other_end_is_closed_is_readable() {
    let (mut links, far) = link();
    let (mut poller, wakeups) = (Poller::new(None, 0), PipeNotifier::new().unwrap());
    drop(far);
    assert!(poller.wait(&mut links, &wakeups, None).readable);
    assert_eq!(links.read(), (0, false));
}

#[test]
fn an_acceptor_is_ready_until_its_links_are_admitted() {
    let network = Network::sockets().unwrap();
    let keys = Keys::new(FederationId(1), Security::default()).unwrap();
    let acceptor = LinkAcceptor::new(Vec::new(), Purpose::Messages, keys, 1);
    let mut links = TestLinks { open: Vec::new(), acceptor: Some(PolledAcceptor::new(acceptor)) };
    let (mut poller, wakeups) = (Poller::new(network.notifier(), 0), PipeNotifier::new().unwrap());
    assert!(poller.look(&mut links, &wakeups, Clock::local()).readable);
    let acceptor = links.acceptor.as_mut().unwrap();
    assert!(acceptor.is_ready());
    assert!(acceptor.admit(Clock::local()).unwrap().is_empty());
    assert!(!poller.look(&mut links, &wakeups, Clock::local()).readable);
}

#[test]
fn what_is_to_be_written_has_left_when_a_drain_ends() {
    let (mut links, far) = link();
    let poller = Poller::new(None, 0);
    for polled in &mut links.open {
        polled.link.queue(Frame::Resign, None);
    }
    poller.drain(&mut links, LONG, false);
    assert!(links.links().all(|link| !link.has_outbound()));
    let mut there = TestLinks { open: vec![PolledLink::new(far)], acceptor: None };
    assert_eq!(there.read(), (1, true));
    // A drain does not wait for a link whose other end is closed.
    drop(there);
    links.open[0].link.queue(Frame::Resign, None);
    poller.drain(&mut links, LONG, true);
}
