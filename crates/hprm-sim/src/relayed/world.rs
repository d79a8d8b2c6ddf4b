//! Two ends of a relayed link, their programs, and the carrier between them, in virtual time.

use std::collections::VecDeque;

use hprm_core::{Nanos, PhysicalTime};
use hprm_federated::relay::{End, Input, Output, Relay, WINDOW_BYTES, WINDOW_FRAMES};

use super::line::{Carried, Line};
use super::{Episode, Fault, Load, RelayVerdict, nanos};
use crate::Rng;

/// A link that goes on after so many events never ends.
const EVENTS: usize = 3_000_000;

/// What lies between two packets at least that a line has delayed: it does not change their order then.
const GAP: Nanos = 60_000;

/// One end, and its program.
struct Site<'a> {
    relay: Relay,
    load: &'a Load,
    /// How many frames the program has written and read, and when it goes on with either.
    written: usize,
    read: usize,
    writes_at: Nanos,
    reads_at: Nanos,
    /// Frames that have come, and are not read yet.
    waiting: VecDeque<usize>,
    /// How many have come; frames are compared as they come.
    arrived: usize,
    has_finished: bool,
    ended: Option<(Nanos, End)>,
    /// What has come while the end was paused.
    backlog: VecDeque<Vec<u8>>,
    is_paused: bool,
    is_killed: bool,
    /// Which life of the program this is, and of the other end as the first frame from there told.
    life: u8,
    other_life: Option<u8>,
    /// The machine has ended long ago, and is there no more.
    is_gone: bool,
}

/// See the module.
pub(crate) struct World<'a> {
    line: &'a Line,
    rng: Rng,
    now: Nanos,
    sites: [Site<'a>; 2],
    carried: Carried<usize>,
    is_cut: bool,
    /// By how much packets enter the line later, and when the last one did for each end: they do in their order.
    slow: Nanos,
    entered: [Nanos; 2],
    /// What begins and what ends, in the order of times.
    changes: VecDeque<(Nanos, bool, Fault)>,
}

impl<'a> World<'a> {
    pub(crate) fn new(
        line: &'a Line,
        loads: &'a [Load; 2],
        episodes: &[Episode],
        mut rng: Rng,
    ) -> Self {
        let mut site = |load| Site::new(load, rng.draw());
        let sites = [site(&loads[0]), site(&loads[1])];
        let changes = episodes.iter().flat_map(|Episode { fault, from, until }| {
            let end = (*until < Nanos::MAX).then_some((*until, false, *fault));
            std::iter::once((*from, true, *fault)).chain(end)
        });
        let changes = changes.collect();
        let (carried, slow, entered) = (Carried::new(), 0, [0; 2]);
        Self { line, rng, now: 0, sites, carried, is_cut: false, slow, entered, changes }
    }

    /// Runs until both ends have ended, or until a time.
    pub(crate) fn run(&mut self, until: Nanos) -> Result<(), String> {
        for _ in 0..EVENTS {
            if self.sites.iter().all(|site| site.ended.is_some() || site.is_killed) {
                return Ok(());
            }
            let next = self.next_event();
            if next > until {
                return Err(format!("no end by {} ms: {}", until / 1_000_000, self.progress()));
            }
            self.now = self.now.max(next);
            self.step()?;
        }
        Err("it goes on for ever".to_owned())
    }

    /// Why and when an end has ended.
    pub(crate) fn ended(&self, end: usize) -> Option<&(Nanos, End)> {
        self.sites[end].ended.as_ref()
    }

    /// How many frames of an end have not arrived at the other one.
    pub(crate) fn missing(&self, from: usize) -> usize {
        self.sites[from].load.frames.len() - self.sites[1 - from].arrived
    }

    pub(crate) fn verdict(&self) -> RelayVerdict {
        RelayVerdict {
            frames: self.sites.iter().map(|site| site.arrived).sum(),
            packets: self.carried.sent,
            lost: self.carried.lost,
            duplicates: self.sites.iter().map(|site| site.relay.dropped().duplicates).sum(),
            failed: false,
        }
    }

    fn progress(&self) -> String {
        let site = |site: &Site<'_>| {
            format!("{} written, {} read, {:?}", site.written, site.read, site.ended)
        };
        format!("{}; {}", site(&self.sites[0]), site(&self.sites[1]))
    }

    fn next_event(&self) -> Nanos {
        let sites = self.sites.iter().filter(|site| site.runs()).map(Site::next_event);
        let changes = self.changes.front().map(|(time, _, _)| *time);
        let all = sites.chain(changes).chain(self.carried.next());
        all.min().unwrap_or(Nanos::MAX)
    }

    fn step(&mut self) -> Result<(), String> {
        while self.changes.front().is_some_and(|(time, _, _)| *time <= self.now) {
            if let Some((_, begins, fault)) = self.changes.pop_front() {
                self.change(begins, fault)?;
            }
        }
        while let Some((to, packet)) = self.carried.arrived(self.now) {
            if self.sites[to].runs() {
                self.give(to, Input::Packet(packet.into()))?;
            } else if self.sites[to].backlog.len() < self.line.backlog {
                self.sites[to].backlog.push_back(packet);
            } else {
                self.carried.lost += 1;
            }
        }
        for end in [0, 1] {
            if self.sites[end].runs() {
                self.act(end)?;
            }
        }
        Ok(())
    }

    fn change(&mut self, begins: bool, fault: Fault) -> Result<(), String> {
        match fault {
            Fault::Cut { told } | Fault::Dead { told } => {
                self.is_cut = begins;
                self.carried.cut(|_| true);
                let input = if begins { Input::CarrierDown } else { Input::CarrierUp };
                for end in [0, 1].into_iter().filter(|_| told) {
                    self.give(end, input.clone())?;
                }
            }
            Fault::Slow { by } => self.slow = if begins { by } else { 0 },
            Fault::Pause { end } => {
                self.sites[end].is_paused = begins;
                while let Some(packet) = self.sites[end].backlog.pop_front().filter(|_| !begins) {
                    self.give(end, Input::Packet(packet.into()))?;
                }
            }
            Fault::Suspended => {
                for end in [0, 1] {
                    self.change(begins, Fault::Pause { end })?;
                }
            }
            Fault::Killed { end } => self.sites[end].is_killed = true,
            Fault::Restarted { end } => {
                let site = &mut self.sites[end];
                site.relay = Relay::new(self.rng.draw(), PhysicalTime(self.now));
                // The program at that end is another one, too.
                (site.written, site.read, site.arrived) = (0, 0, 0);
                site.life += 1;
                (site.has_finished, site.ended, site.is_gone) = (false, None, false);
                site.waiting.clear();
                site.other_life = None;
            }
            Fault::Aborted { end } => self.give(end, Input::Abort("enough".to_owned()))?,
        }
        Ok(())
    }

    /// The program at one end does what is due, and its machine is told the time.
    fn act(&mut self, end: usize) -> Result<(), String> {
        let site = &mut self.sites[end];
        if site.ended.is_none() && site.writes_at <= self.now {
            if let Some(len) = site.load.frames.get(site.written).copied() {
                if site.relay.room() >= len.max(1) {
                    let input = Input::Frame(content(site.life, site.written, len).into());
                    site.written += 1;
                    site.writes_at = self.now + pause(&mut self.rng, site.load.writes_every);
                    self.give(end, input)?;
                }
            } else if !site.has_finished && site.load.finishes_at <= self.now {
                site.has_finished = true;
                self.give(end, Input::Finish)?;
            }
        }
        let site = &mut self.sites[end];
        if site.reads_at <= self.now
            && let Some(len) = site.waiting.pop_front()
        {
            site.read += 1;
            site.reads_at = self.now + pause(&mut self.rng, site.load.reads_every);
            self.give(end, Input::Taken(len))?;
        }
        let site = &mut self.sites[end];
        site.is_gone |= site.relay.is_over(PhysicalTime(self.now));
        if !site.is_gone && site.relay.next_wakeup().0 <= self.now {
            self.give(end, Input::Wake)?;
        }
        Ok(())
    }

    fn give(&mut self, end: usize, input: Input) -> Result<(), String> {
        let site = &mut self.sites[end];
        if site.is_killed {
            return Ok(());
        }
        if site.is_gone {
            let Input::Packet(packet) = input else { return Ok(()) };
            if let Some(refusal) = Relay::refusal(&packet).filter(|_| !self.is_cut) {
                self.carried.send(self.line, &mut self.rng, self.now, 1 - end, refusal);
            }
            return Ok(());
        }
        let taken = site.relay.handle(PhysicalTime(self.now), input);
        taken.map_err(|error| error.to_string())?;
        while let Some(output) = site.relay.poll() {
            match output {
                Output::Packet(packet) if self.is_cut => drop(packet),
                Output::Packet(packet) => {
                    let entered = &mut self.entered[1 - end];
                    let after = if *entered > self.now { *entered + GAP } else { self.now };
                    *entered = (self.now + self.slow).max(after);
                    let packet = packet.into_vec();
                    self.carried.send(self.line, &mut self.rng, *entered, 1 - end, packet);
                }
                Output::Frame(bytes) => site.takes(&bytes)?,
                Output::Finished => site.told_finished()?,
                Output::Ended(reason) if site.ended.is_none() => {
                    site.ended = Some((self.now, reason));
                }
                Output::Ended(reason) => return Err(format!("it ends twice: {reason}")),
            }
        }
        let other = &self.sites[1 - end];
        if self.sites[end].arrived > other.load.frames.len() {
            return Err("a frame comes that was never sent".to_owned());
        }
        Ok(())
    }
}

impl<'a> Site<'a> {
    fn new(load: &'a Load, epoch: u64) -> Self {
        Self {
            relay: Relay::new(epoch, PhysicalTime(0)),
            load,
            written: 0,
            read: 0,
            writes_at: 0,
            reads_at: 0,
            waiting: VecDeque::new(),
            arrived: 0,
            has_finished: false,
            ended: None,
            backlog: VecDeque::new(),
            is_paused: false,
            is_killed: false,
            life: 0,
            other_life: None,
            is_gone: false,
        }
    }

    fn runs(&self) -> bool {
        !self.is_paused && !self.is_killed
    }

    /// When this end has something to do.
    fn next_event(&self) -> Nanos {
        let len = self.load.frames.get(self.written).copied();
        let writes = match len {
            _ if self.ended.is_some() || self.has_finished => Nanos::MAX,
            Some(len) if self.relay.room() < len.max(1) => Nanos::MAX,
            Some(_) => self.writes_at,
            None => self.writes_at.max(self.load.finishes_at),
        };
        let reads = if self.waiting.is_empty() { Nanos::MAX } else { self.reads_at };
        let wakes = if self.is_gone { Nanos::MAX } else { self.relay.next_wakeup().0 };
        writes.min(reads).min(wakes)
    }

    /// A frame comes out: it must be the next one, whole, and there must be room for it.
    fn takes(&mut self, bytes: &[u8]) -> Result<(), String> {
        if self.ended.is_some() {
            return Err("a frame comes after the end".to_owned());
        }
        if let Some(last) = bytes.last() {
            let life = *self.other_life.get_or_insert(last & 1);
            let expected = content(life, self.arrived, bytes.len());
            if *bytes != expected {
                return Err(format!("frame {} is not the next one", self.arrived));
            }
        }
        self.arrived += 1;
        self.waiting.push_back(bytes.len());
        let held: usize = self.waiting.iter().sum();
        if held as u64 > WINDOW_BYTES || self.waiting.len() as u64 > WINDOW_FRAMES {
            return Err(format!("{held} bytes wait for the reader"));
        }
        Ok(())
    }

    fn told_finished(&mut self) -> Result<(), String> {
        match self.ended {
            None => Ok(()),
            Some(_) => Err("it finishes after the end".to_owned()),
        }
    }
}

/// The bytes of a frame, from which its number and the life of its sender follow, as far as it is long enough.
fn content(life: u8, number: usize, len: usize) -> Vec<u8> {
    let mut bytes = vec![(number % 127) as u8 * 2 + life; len];
    let number = number.to_le_bytes();
    let known = len.saturating_sub(1).min(number.len());
    bytes[..known].copy_from_slice(&number[..known]);
    bytes
}

fn pause(rng: &mut Rng, every: u64) -> Nanos {
    1_000 * nanos(1 + rng.below(every))
}
