//! Direct links that this federate is opening: a link is being opened until the peer has answered the first
//! frame.
//!
//! An accident may end such a link, and so may an unauthenticated client that floods the peer with
//! connections. This federate then opens the link again, within the connect timeout, which counts from the
//! first such end: before that, the peer may be loading its program and answer nothing. What the peer decides,
//! for example about the secret, is final. This file decides when to open a link again, and when to tell the user;
//! `links` does it.

use std::collections::BTreeMap;
use std::io;

use hprm_core::{FederateId, Nanos, PhysicalTime};
use hprm_federated::Frame;

use super::reach::Reach;
use super::search::{PAUSES, is_transient_error};
use crate::{Address, Clock, nanoseconds};

/// How long after its first failed attempt a link may open without a message to the user. Between agents, which take a
/// moment to find one another, first attempts fail in a normal start.
const NOTICE_AFTER: Nanos = 5_000_000_000;

/// The links that are being opened.
pub(super) struct Openings {
    connect_timeout: Nanos,
    by_peer: BTreeMap<FederateId, Opening>,
}

/// What is needed to open a link, perhaps more than once.
struct Opening {
    address: Address,
    hello: Frame,
    pause: Nanos,
    /// When to try again, unless an attempt is under way. By the local clock, like the next one.
    next: Option<PhysicalTime>,
    /// When to give up, from the first attempt that has failed.
    give_up: Option<PhysicalTime>,
    /// When to tell the user, from the first attempt that has failed until that is told.
    tell: Option<PhysicalTime>,
    /// Why the latest attempt has failed.
    reason: String,
}

impl Openings {
    pub(super) fn new(reach: &Reach) -> Self {
        Self { connect_timeout: nanoseconds(reach.connect_timeout), by_peer: BTreeMap::new() }
    }

    /// A link to `peer` is to be opened.
    pub(super) fn begin(&mut self, peer: FederateId, address: Address, hello: Frame) {
        let (pause, reason) = (PAUSES.0, String::new());
        let opening =
            Opening { address, hello, pause, next: None, give_up: None, tell: None, reason };
        self.by_peer.insert(peer, opening);
    }

    /// Where to open the link to `peer`, and its first frame.
    pub(super) fn target(&self, peer: FederateId) -> Option<(&Address, &Frame)> {
        self.by_peer.get(&peer).map(|opening| (&opening.address, &opening.hello))
    }

    /// Whether no link is being opened.
    pub(super) fn is_empty(&self) -> bool {
        self.by_peer.is_empty()
    }

    /// Whether the link to `peer` is being opened.
    pub(super) fn contains(&self, peer: FederateId) -> bool {
        self.by_peer.contains_key(&peer)
    }

    /// The link to `peer` is open, or not wanted any more.
    pub(super) fn end(&mut self, peer: FederateId) {
        self.by_peer.remove(&peer);
    }

    /// An attempt has failed at `now`. Returns why, for people, if there will be no other one.
    pub(super) fn failed(
        &mut self,
        peer: FederateId,
        error: &io::Error,
        now: PhysicalTime,
    ) -> Option<String> {
        let opening = self.by_peer.get_mut(&peer)?;
        if opening.give_up.is_none() {
            opening.tell = Some(now.plus(NOTICE_AFTER));
        }
        let give_up = *opening.give_up.get_or_insert(now.plus(self.connect_timeout));
        let reason = reason(error);
        if now >= give_up || !is_transient_error(error) {
            let reason = format!("at {}: {reason}", opening.address);
            self.by_peer.remove(&peer);
            return Some(reason);
        }
        opening.reason = reason;
        opening.next = Some(now.plus(opening.pause).min(give_up));
        opening.pause = (2 * opening.pause).min(PAUSES.1);
        None
    }

    /// When to try again or to tell the user, by the federation's clock.
    pub(super) fn next_wakeup(&self) -> Option<PhysicalTime> {
        let times = self.by_peer.values().flat_map(|opening| [opening.next, opening.tell]);
        times.flatten().min().map(Clock::at)
    }

    /// The peers to which a link is to be opened again at `now`; an attempt is under way from now on.
    pub(super) fn take_due(&mut self, now: PhysicalTime) -> Vec<FederateId> {
        let due = self
            .by_peer
            .iter_mut()
            .filter_map(|(peer, opening)| opening.next.take_if(|next| *next <= now).map(|_| *peer));
        due.collect()
    }

    /// What the user is told at `now` of links that stay closed, once for each.
    pub(super) fn take_notices(&mut self, now: PhysicalTime) -> Vec<String> {
        let text = |opening: &mut Opening| {
            opening.tell.take_if(|at| *at <= now)?;
            let Opening { address, reason, .. } = opening;
            Some(format!("trying again to reach the federate at {address}: {reason}"))
        };
        self.by_peer.values_mut().filter_map(text).collect()
    }
}

fn reason(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::ConnectionReset => {
            "it closes links while they are opened (do other processes flood \
                                           it with connections?)"
                .to_owned()
        }
        _ => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use hprm_federated::PROTOCOL;

    use super::*;
    use crate::FederationId;

    const PEER: FederateId = FederateId(1);
    const SECOND: Nanos = 1_000_000_000;

    fn openings() -> Openings {
        let mut openings = Openings::new(&Reach::default());
        let from = FederateId(0);
        let hello = Frame::PeerHello { protocol: PROTOCOL, federation: FederationId(7), from };
        openings.begin(PEER, "127.0.0.1:7".parse().unwrap(), hello);
        openings
    }

    fn at(seconds: i64) -> PhysicalTime {
        PhysicalTime(seconds * SECOND)
    }

    #[test]
    fn an_accident_is_tried_again_within_the_connect_timeout() {
        let mut openings = openings();
        let reset = io::ErrorKind::ConnectionReset.into();
        assert!(openings.take_due(at(1_000)).is_empty(), "the first attempt is under way");
        // The peer has been loading for long: only what fails counts.
        for seconds in 1_000..1_060 {
            assert_eq!(openings.failed(PEER, &reset, at(seconds)), None);
            assert!(openings.take_due(at(seconds)).is_empty());
            assert_eq!(openings.take_due(at(seconds + 1)), [PEER]);
        }
        let reason = openings.failed(PEER, &reset, at(1_060)).unwrap();
        assert!(reason.starts_with("at tcp:127.0.0.1:7: it closes links"), "{reason}");
        assert!(!openings.contains(PEER));
    }

    #[test]
    fn a_link_that_opens_at_the_second_attempt_is_not_told() {
        let mut openings = openings();
        openings.failed(PEER, &io::ErrorKind::ConnectionReset.into(), at(0));
        assert_eq!(openings.take_due(at(1)), [PEER]);
        assert!(openings.take_notices(at(1)).is_empty());
        openings.end(PEER);
        assert_eq!(openings.next_wakeup(), None);
        assert!(openings.take_notices(at(60)).is_empty());
    }

    #[test]
    fn a_link_that_stays_closed_is_told_once_with_the_latest_reason() {
        let mut openings = openings();
        openings.failed(PEER, &io::ErrorKind::ConnectionReset.into(), at(0));
        openings.take_due(at(1));
        openings.failed(PEER, &io::Error::other("no such listener"), at(1));
        assert_eq!(openings.take_due(PhysicalTime(NOTICE_AFTER - 1)), [PEER]);
        assert!(openings.take_notices(PhysicalTime(NOTICE_AFTER - 1)).is_empty());
        // The third attempt is under way and may take long: the loop wakes up for the message alone.
        assert_eq!(openings.next_wakeup(), Some(Clock::at(PhysicalTime(NOTICE_AFTER))));
        let told = "trying again to reach the federate at tcp:127.0.0.1:7: no such listener";
        assert_eq!(openings.take_notices(PhysicalTime(NOTICE_AFTER)), [told]);
        assert_eq!(openings.next_wakeup(), None);
        openings.failed(PEER, &io::Error::other("another reason"), at(6));
        assert!(openings.take_notices(at(60)).is_empty());
    }

    #[test]
    fn a_link_that_is_given_up_is_an_error_and_not_told() {
        let mut openings = openings();
        let reset = io::ErrorKind::ConnectionReset.into();
        assert_eq!(openings.failed(PEER, &reset, at(0)), None);
        assert!(openings.failed(PEER, &reset, at(60)).is_some());
        assert!(openings.take_notices(at(60)).is_empty());
        assert_eq!(openings.next_wakeup(), None);
    }

    #[test]
    fn a_refusal_is_final() {
        let mut openings = openings();
        let refused = io::Error::new(io::ErrorKind::PermissionDenied, "another secret");
        let reason = openings.failed(PEER, &refused, at(0));
        assert_eq!(reason.as_deref(), Some("at tcp:127.0.0.1:7: another secret"));
    }
}
