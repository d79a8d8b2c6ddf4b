//! Pending links: those that were accepted and have sent no frame yet, and which of them are closed.
//!
//! A link is in one of three stages: silent, speaking (its other end has begun the handshake), or proved (its
//! other end has proved that it knows the secret, or the kernel has told its user). Each stage has a limit of
//! its own, so a flood of links in one stage takes no place from links in later or earlier stages. When a stage
//! is full, the oldest link of the address with the most links in it is closed.

use std::collections::BTreeMap;
use std::collections::VecDeque;
use std::net::{IpAddr, Ipv6Addr};

use hprm_core::PhysicalTime;

use crate::link::Link;
use crate::wait::SourceId;

/// How far the other end of a link has come.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum LinkStage {
    /// It has sent nothing, or not enough to tell what it is.
    Silent,
    /// It speaks the protocol, and has proved nothing yet.
    Speaking,
    /// It belongs to the federation, and has not sent the frame that tells which federate it is.
    Proved,
}

const UNPROVED: [LinkStage; 2] = [LinkStage::Silent, LinkStage::Speaking];

/// Where a link comes from. A host with an IPv6 address has all addresses with the same first half.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum LinkOrigin {
    /// A process of the same user on this machine.
    Here,
    Network(IpAddr),
}

impl LinkOrigin {
    pub(super) fn of(link: &Link) -> Self {
        let Ok(address) = link.peer_address() else { return Self::Here };
        Self::Network(match address.ip().to_canonical() {
            IpAddr::V6(ip) => {
                IpAddr::V6(Ipv6Addr::from_bits(ip.to_bits() & u128::from(u64::MAX) << 64))
            }
            ip @ IpAddr::V4(_) => ip,
        })
    }
}

/// How many links may be pending.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct PendingLimits {
    /// For each stage before the last one.
    pub(super) unproved: usize,
    /// For links of one address, in each stage before the last one.
    pub(super) from_one: usize,
    /// For links in the last stage.
    pub(super) proved: usize,
}

/// A link whose first frame has not come yet.
#[derive(Debug)]
pub(super) struct PendingLink {
    pub(super) link: Link,
    pub(super) id: SourceId,
    pub(super) until: PhysicalTime,
    pub(super) origin: LinkOrigin,
}

impl PendingLink {
    pub(super) fn stage(&self) -> LinkStage {
        match () {
            () if self.link.is_authenticated() => LinkStage::Proved,
            () if self.link.has_begun_handshake() => LinkStage::Speaking,
            () => LinkStage::Silent,
        }
    }
}

/// See the module. The oldest link is first.
#[derive(Debug, Default)]
pub(super) struct PendingLinks(VecDeque<PendingLink>);

impl PendingLinks {
    pub(super) fn push(&mut self, waiting: PendingLink) {
        self.0.push_back(waiting);
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &PendingLink> {
        self.0.iter()
    }

    /// Gives each link to `look`, which keeps it or not; the oldest is the first.
    pub(super) fn visit(&mut self, mut look: impl FnMut(PendingLink) -> Option<PendingLink>) {
        self.0 = std::mem::take(&mut self.0).into_iter().filter_map(&mut look).collect();
    }

    /// How many links have proved nothing.
    pub(super) fn unproved(&self) -> usize {
        self.0.iter().filter(|waiting| waiting.stage() < LinkStage::Proved).count()
    }

    /// Closes the links for which there is no place.
    pub(super) fn make_room(&mut self, limits: PendingLimits) {
        for stage in UNPROVED {
            while let Some(victim) = self.one_too_many(stage, limits) {
                self.0.remove(victim);
            }
        }
        while self.0.iter().filter(|it| it.stage() == LinkStage::Proved).count() > limits.proved {
            let oldest = self.0.iter().position(|it| it.stage() == LinkStage::Proved);
            oldest.map(|at| self.0.remove(at));
        }
    }

    /// Closes the oldest link that has proved nothing, a silent one if there is one. Returns whether there was
    /// any.
    pub(super) fn hang_up(&mut self) -> bool {
        let first = |stage| self.0.iter().position(move |waiting| waiting.stage() == stage);
        let oldest = UNPROVED.into_iter().find_map(first);
        oldest.is_some_and(|at| self.0.remove(at).is_some())
    }

    fn one_too_many(&self, stage: LinkStage, limits: PendingLimits) -> Option<usize> {
        let here = || self.0.iter().enumerate().filter(move |(_, it)| it.stage() == stage);
        let mut counts = BTreeMap::new();
        here().for_each(|(_, it)| *counts.entry(it.origin).or_insert(0) += 1);
        let (most, count) = counts.iter().max_by_key(|(_, count)| **count)?;
        let is_full = *count > limits.from_one || counts.values().sum::<usize>() > limits.unproved;
        let mut theirs = here().filter(|(_, it)| it.origin == *most);
        is_full.then(|| theirs.next().map(|(at, _)| at)).flatten()
    }
}
