//! What is measured, for both contenders alike: a cell is one run of two processes, the hub and the node.

use std::error::Error;
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::prelude::ZeroCopySend;
use rustix::thread::{CpuSet, sched_setaffinity};
use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};

/// The bytes of a small message.
pub(crate) const SMALL: usize = 64;

/// The processors of the hub and of the node.
pub(crate) const HUB: u32 = 0;
pub(crate) const NODE: u32 = 1;

#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(crate) enum Contender {
    Decentralized,
    Centralized,
    Iceoryx2,
}

/// How a process waits for the next message.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(crate) enum Waiting {
    Polling,
    Sleeping,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(crate) enum Workload {
    /// Half of a round trip of an array of 64 bytes; the node sends back what it has got.
    Array,
    /// The same with a struct of eight numbers.
    Struct,
    /// From before a loan of that many bytes is sent until the node may read it.
    Loan(usize),
    /// Messages of that many bytes, one way, as fast as the hub can.
    Rate(usize),
}

/// One run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Cell {
    pub(crate) contender: Contender,
    pub(crate) waiting: Waiting,
    pub(crate) workload: Workload,
    /// How many messages count, and how many before them do not.
    pub(crate) rounds: u64,
    pub(crate) warm_up: u64,
    /// Where the result goes.
    pub(crate) result: PathBuf,
}

impl Cell {
    /// Nanoseconds; for a rate, those of each message.
    pub(crate) fn write(&self, result: f64) {
        fs::write(&self.result, result.to_string()).expect("the folder of the result is there");
    }

    pub(crate) fn read(&self) -> Result<f64, Box<dyn Error>> {
        let text = fs::read_to_string(&self.result)
            .map_err(|error| format!("{self:?} has written no result: {error}"))?;
        fs::remove_file(&self.result)?;
        Ok(text.parse()?)
    }
}

/// A message that repeats a number.
pub(crate) trait Numbered {
    fn numbered(number: u64) -> Self;
    fn number(&self) -> u64;
}

/// The struct.
#[derive(Clone, Copy, Default, Debug, Serialize, Deserialize, ZeroCopySend)]
#[repr(C)]
pub(crate) struct Words {
    number: u64,
    x: u64,
    y: u64,
    z: u64,
    roll: u64,
    pitch: u64,
    yaw: u64,
    time: u64,
}

impl Numbered for Words {
    fn numbered(number: u64) -> Self {
        // As wide as such numbers are: small ones would be shorter in what travels.
        let wide = u64::MAX / 3;
        Self { number, x: wide, y: wide, z: wide, roll: wide, pitch: wide, yaw: wide, time: wide }
    }

    fn number(&self) -> u64 {
        self.number
    }
}

/// The bytes of a small array.
pub(crate) fn bytes(number: u64) -> [u8; SMALL] {
    let mut bytes = [7; SMALL];
    bytes[..8].copy_from_slice(&number.to_le_bytes());
    bytes
}

/// The number that a small array begins with.
pub(crate) fn number(bytes: &[u8]) -> u64 {
    let first = bytes.first_chunk().expect("each message has eight bytes");
    u64::from_le_bytes(*first)
}

/// Nanoseconds of a clock that all processes share.
pub(crate) fn now() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    let now = Duration::try_from(now).expect("this clock begins with the system");
    u64::try_from(now.as_nanos()).expect("a system runs for less than 500 years")
}

/// Keeps this process on a processor.
pub(crate) fn pin(cpu: u32) -> Result<(), Box<dyn Error>> {
    let mut cpus = CpuSet::new();
    cpus.set(cpu as usize);
    Ok(sched_setaffinity(None, &cpus)?)
}

pub(crate) fn median(mut samples: Vec<f64>) -> f64 {
    samples.sort_by(f64::total_cmp);
    samples[samples.len() / 2]
}

/// The times of the rounds of a hub: it is told when one begins and what it took.
pub(crate) struct Rounds {
    left: u64,
    counted: u64,
    times: Vec<f64>,
}

impl Rounds {
    pub(crate) fn of(cell: &Cell) -> Self {
        Self { left: cell.rounds + cell.warm_up, counted: cell.rounds, times: Vec::new() }
    }

    /// Takes the time of a round, and says whether it was the last one.
    pub(crate) fn add(&mut self, nanoseconds: f64) -> bool {
        if self.left <= self.counted {
            self.times.push(nanoseconds);
        }
        self.left -= 1;
        self.left == 0
    }

    pub(crate) fn median(&mut self) -> f64 {
        median(std::mem::take(&mut self.times))
    }
}
