//! Pending links: those that were accepted and have sent no frame yet, and which of them are closed.
//!
//! A link is in one of three stages: silent, speaking (its other end has begun the handshake), or proved (its
//! other end has proved the secret, or the kernel has told its user). Each stage has places of its own, so
//! a flood of links in one stage takes no place from links in later or earlier stages. When a stage is
//! full, the oldest link of the address with the most links in it is closed.

use std::collections::BTreeMap;
use std::collections::VecDeque;
use std::net::{IpAddr, Ipv6Addr};

use hprm_core::PhysicalTime;

use crate::wire::Wire;

/// How far the other end of a link has come.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum Stage {
    /// It has said nothing, or not enough to tell what it is.
    Silent,
    /// It speaks the protocol, and has proved nothing yet.
    Speaking,
    /// It belongs to the federation, and has not said which part of it it is.
    Proved,
}

const UNPROVED: [Stage; 2] = [Stage::Silent, Stage::Speaking];

/// Where a link comes from. A host with an address of version 6 has all with the same first half.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum Origin {
    /// A process of the same user on this machine.
    Here,
    Network(IpAddr),
}

impl Origin {
    pub(super) fn of(wire: &Wire) -> Self {
        let Ok(address) = wire.peer_address() else { return Self::Here };
        Self::Network(match address.ip().to_canonical() {
            IpAddr::V6(ip) => {
                IpAddr::V6(Ipv6Addr::from_bits(ip.to_bits() & u128::from(u64::MAX) << 64))
            }
            ip @ IpAddr::V4(_) => ip,
        })
    }
}

/// How many links may wait.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Places {
    /// For each stage before the last one.
    pub(super) unproved: usize,
    /// For links of one address, in each stage before the last one.
    pub(super) from_one: usize,
    /// For links in the last stage.
    pub(super) proved: usize,
}

/// A link that waits.
#[derive(Debug)]
pub(super) struct Waiting {
    pub(super) wire: Wire,
    pub(super) until: PhysicalTime,
    pub(super) origin: Origin,
}

impl Waiting {
    pub(super) fn stage(&self) -> Stage {
        match () {
            () if self.wire.is_proved() => Stage::Proved,
            () if self.wire.has_spoken() => Stage::Speaking,
            () => Stage::Silent,
        }
    }
}

/// See the module. The oldest link is first.
#[derive(Debug, Default)]
pub(super) struct PendingLinks(VecDeque<Waiting>);

impl PendingLinks {
    pub(super) fn push(&mut self, waiting: Waiting) {
        self.0.push_back(waiting);
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Waiting> {
        self.0.iter()
    }

    /// Gives each link to `look`, which keeps it or not; the oldest is the first.
    pub(super) fn visit(&mut self, mut look: impl FnMut(Waiting) -> Option<Waiting>) {
        self.0 = std::mem::take(&mut self.0).into_iter().filter_map(&mut look).collect();
    }

    /// How many links have proved nothing.
    pub(super) fn unproved(&self) -> usize {
        self.0.iter().filter(|waiting| waiting.stage() < Stage::Proved).count()
    }

    /// Closes the links for which there is no place.
    pub(super) fn make_room(&mut self, places: Places) {
        for stage in UNPROVED {
            while let Some(victim) = self.one_too_many(stage, places) {
                self.0.remove(victim);
            }
        }
        while self.0.iter().filter(|it| it.stage() == Stage::Proved).count() > places.proved {
            let oldest = self.0.iter().position(|it| it.stage() == Stage::Proved);
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

    fn one_too_many(&self, stage: Stage, places: Places) -> Option<usize> {
        let here = || self.0.iter().enumerate().filter(move |(_, it)| it.stage() == stage);
        let mut counts = BTreeMap::new();
        here().for_each(|(_, it)| *counts.entry(it.origin).or_insert(0) += 1);
        let (most, count) = counts.iter().max_by_key(|(_, count)| **count)?;
        let is_full = *count > places.from_one || counts.values().sum::<usize>() > places.unproved;
        let mut theirs = here().filter(|(_, it)| it.origin == *most);
        is_full.then(|| theirs.next().map(|(at, _)| at)).flatten()
    }
}
