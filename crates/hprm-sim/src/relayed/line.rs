//! A carrier of packets that loses, duplicates, reorders and delays them, and carries nothing while it is cut.

use std::collections::BTreeMap;

use hprm_core::Nanos;

use super::nanos;
use crate::Rng;

/// What a carrier does to packets, in cases of a hundred and microseconds.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Line {
    loss: u64,
    duplicates: u64,
    latency: u64,
    jitter: u64,
    /// A paused end loses what is beyond so many packets.
    pub(crate) backlog: usize,
}

impl Line {
    /// That of a network which only takes its time.
    pub(crate) fn good() -> Self {
        Self { loss: 0, duplicates: 0, latency: 200, jitter: 50, backlog: 256 }
    }

    /// One on which all packets take the same time.
    pub(crate) fn steady() -> Self {
        Self { jitter: 0, ..Self::good() }
    }

    /// One that loses every other packet.
    pub(crate) fn leaky() -> Self {
        Self { loss: 50, ..Self::good() }
    }

    /// Whether it keeps the order of packets, but for a few.
    pub(crate) fn is_orderly(&self) -> bool {
        self.jitter <= 50 && self.duplicates <= 5 && self.loss <= 5
    }

    /// How long a packet and its answer take at most, in nanoseconds.
    pub(crate) fn round_trip(&self) -> u64 {
        2_000 * (self.latency + self.jitter)
    }

    pub(crate) fn draw(rng: &mut Rng) -> Self {
        let of = |rng: &mut Rng, values: [u64; 4]| values[rng.draw() as usize % 4];
        Self {
            loss: of(rng, [0, 1, 5, 15]),
            duplicates: of(rng, [0, 0, 5, 30]),
            latency: of(rng, [20, 500, 5_000, 60_000]),
            jitter: of(rng, [0, 50, 5_000, 100_000]),
            backlog: if rng.percent(50) { 16 } else { 256 },
        }
    }
}

/// The packets on their way, with the ends to which they lead.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Carried<End> {
    by_arrival: BTreeMap<(Nanos, u64), (End, Vec<u8>)>,
    pub(crate) sent: u64,
    pub(crate) lost: u64,
}

impl<End: Copy> Carried<End> {
    pub(crate) fn new() -> Self {
        Self { by_arrival: BTreeMap::new(), sent: 0, lost: 0 }
    }

    /// Takes a packet.
    pub(crate) fn send(
        &mut self,
        line: &Line,
        rng: &mut Rng,
        now: Nanos,
        to: End,
        packet: Vec<u8>,
    ) {
        let copies = 1 + u64::from(rng.percent(line.duplicates));
        for _ in 0..copies {
            self.sent += 1;
            if rng.percent(line.loss) {
                self.lost += 1;
                continue;
            }
            let micros = line.latency + rng.below(line.jitter + 1);
            let arrival = now + 1_000 * nanos(micros);
            self.by_arrival.insert((arrival, self.sent), (to, packet.clone()));
        }
    }

    /// When the next packet arrives.
    pub(crate) fn next(&self) -> Option<Nanos> {
        self.by_arrival.first_key_value().map(|((arrival, _), _)| *arrival)
    }

    /// The next packet, if it has arrived.
    pub(crate) fn arrived(&mut self, now: Nanos) -> Option<(End, Vec<u8>)> {
        let entry = self.by_arrival.first_entry().filter(|entry| entry.key().0 <= now)?;
        Some(entry.remove())
    }

    /// The packets on their way to those ends are lost.
    pub(crate) fn cut(&mut self, is_cut: impl Fn(End) -> bool) {
        let before = self.by_arrival.len();
        self.by_arrival.retain(|_, (to, _)| !is_cut(*to));
        self.lost += (before - self.by_arrival.len()) as u64;
    }
}
