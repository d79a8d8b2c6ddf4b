//! A relayed link drawn from a seed, with the faults of its carrier, and the verdict on what came of it.
//!
//! `relayed/line.rs` is the carrier, `relayed/world.rs` runs both ends. This file draws what happens, and says what
//! must be true at the end.

pub(crate) mod line;
mod world;

use std::fmt;

use hprm_core::Nanos;
use hprm_federated::relay::{End, TOLD};

use crate::Rng;
use line::Line;
use world::World;

const MS: Nanos = 1_000_000;
const SECOND: Nanos = 1_000 * MS;

/// When the first fault begins at the latest, and how much time lies between two of them: then an end is not silent
/// for longer than the longest fault.
const FIRST: u64 = 2_000;
pub(crate) const BETWEEN: Nanos = 6 * SECOND;

/// How long everything may take once the carrier works: slow readers take that long.
const LONGEST: Nanos = 240 * SECOND;

/// What one end does.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Load {
    /// The lengths of the frames that it writes.
    pub(crate) frames: Vec<usize>,
    /// How long it waits at most between two frames that it writes, and between two that it reads.
    pub(crate) writes_every: u64,
    pub(crate) reads_every: u64,
    /// It says that it sends no more frames at that time, or after the last one.
    pub(crate) finishes_at: Nanos,
}

/// What happens to the link.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Fault {
    /// Nothing is carried; the ends are told so, or not.
    Cut { told: bool },
    /// Everything takes so much longer than usual, in nanoseconds, as on a machine that is busy: what is late is not lost.
    Slow { by: Nanos },
    /// One end stands still.
    Pause { end: usize },
    /// Both ends stand still, as they do if they are on one machine that is suspended.
    Suspended,
    /// Nothing is carried any more.
    Dead { told: bool },
    /// One end is killed.
    Killed { end: usize },
    /// One end is killed and started again.
    Restarted { end: usize },
    /// The program at one end gives up.
    Aborted { end: usize },
}

/// A fault, from when and until when.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Episode {
    pub(crate) fault: Fault,
    pub(crate) from: Nanos,
    pub(crate) until: Nanos,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct RelayTrial {
    seed: u64,
    line: Line,
    loads: [Load; 2],
    episodes: Vec<Episode>,
    rng: Rng,
}

/// What has come of a link, and nothing was wrong.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct RelayVerdict {
    /// The frames that have arrived.
    pub frames: usize,
    /// The packets that were sent, and those that were lost.
    pub packets: u64,
    /// See above.
    pub lost: u64,
    /// Frames that arrived once more.
    pub duplicates: u64,
    /// Whether the link ended before everything had arrived, as it must.
    pub failed: bool,
}

impl RelayTrial {
    /// The link of a seed.
    #[must_use]
    pub fn draw(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        let line = Line::draw(&mut rng);
        let mut loads = [Load::draw(&mut rng), Load::draw(&mut rng)];
        for end in [0, 1] {
            if loads[1 - end].frames.len() > 1_000 {
                loads[end].reads_every = loads[end].reads_every.min(40_000);
            }
        }
        let mut episodes = breaks(&mut rng);
        if rng.percent(30) {
            let latest = if rng.percent(50) { 500 } else { 30_000 };
            let from = 10 * MS + nanos(rng.below(latest)) * MS;
            episodes.retain(|episode| episode.until + SECOND < from);
            let end = usize::from(rng.percent(50));
            let told = rng.percent(50);
            let fault = match rng.below(4) {
                0 => Fault::Dead { told },
                1 => Fault::Killed { end },
                2 => Fault::Restarted { end },
                _ => Fault::Aborted { end },
            };
            episodes.push(Episode { fault, from, until: Nanos::MAX });
        }
        Self { seed, line, loads, episodes, rng }
    }

    /// A link of a seed that loses nothing, on which one end sends much, and which is slow at times.
    #[must_use]
    pub fn draw_late(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        let line = Line::steady();
        let frames = (0..4_000).map(|_| usize::try_from(rng.below(200)).unwrap_or(0)).collect();
        let writes_every = 200 + rng.below(3_000);
        let sends = Load { frames, writes_every, reads_every: 1, finishes_at: 0 };
        let takes = Load { frames: Vec::new(), ..sends.clone() };
        let mut from = 100 * MS;
        let mut episodes = Vec::new();
        while episodes.len() < 4 {
            let until = from + nanos(200 + rng.below(500)) * MS;
            episodes.push(Episode { fault: slow(&mut rng), from, until });
            from = until + nanos(rng.below(500)) * MS;
        }
        Self { seed, line, loads: [sends, takes], episodes, rng }
    }

    /// A link of a seed that loses every other packet, on which one end sends many frames at once: there are more gaps than an
    /// answer has room to tell of.
    #[must_use]
    pub fn draw_gaps(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        let frames = (0..200).map(|_| usize::try_from(rng.below(20)).unwrap_or(0)).collect();
        let sends = Load { frames, writes_every: 1, reads_every: 1, finishes_at: 0 };
        let takes = Load { frames: Vec::new(), ..sends.clone() };
        Self { seed, line: Line::leaky(), loads: [sends, takes], episodes: Vec::new(), rng }
    }

    /// Runs the link to its end.
    ///
    /// # Errors
    ///
    /// What was wrong.
    pub fn run(&self) -> Result<RelayVerdict, String> {
        let mut world = World::new(&self.line, &self.loads, &self.episodes, self.rng.clone());
        let fatal = self.episodes.last().filter(|episode| episode.until == Nanos::MAX);
        let calm = self.episodes.last().map_or(0, |episode| match fatal {
            Some(_) => episode.from,
            None => episode.until,
        });
        let bound = if fatal.is_some() { TOLD } else { LONGEST };
        world.run(calm + bound.max(LONGEST))?;
        let mut verdict = RelayVerdict { failed: false, ..world.verdict() };
        for end in [0, 1] {
            if matches!(fatal, Some(Episode { fault: Fault::Killed { end: killed }, .. }) if *killed == end)
            {
                continue;
            }
            let Some((time, ended)) = world.ended(end) else {
                return Err(format!("end {end} has not ended"));
            };
            if *ended != End::Finished {
                verdict.failed = true;
                self.judge_failure(fatal, end, *time, ended)?;
            } else if world.missing(1 - end) > 0 {
                return Err(format!("end {end} has finished, but frames are missing"));
            }
        }
        match verdict.packets > self.most_packets(&verdict, calm) {
            true => Err(format!("{} packets for {} frames", verdict.packets, verdict.frames)),
            false => Ok(verdict),
        }
    }

    /// How many packets the link may take on a line that keeps their order and almost none of them is duplicated: a
    /// few for each frame, those of the questions, and what is sent in vain while the other end does not answer.
    fn most_packets(&self, verdict: &RelayVerdict, calm: Nanos) -> u64 {
        let seconds = u64::try_from((calm + LONGEST) / SECOND).unwrap_or_default();
        match self.line.is_orderly() {
            true => 200 + 5 * verdict.frames as u64 + 10 * seconds + 64 * seconds.min(60),
            false => u64::MAX,
        }
    }

    /// An end may fail only after a fatal fault, of which it must learn in time.
    fn judge_failure(
        &self,
        fatal: Option<&Episode>,
        end: usize,
        time: Nanos,
        ended: &End,
    ) -> Result<(), String> {
        let Some(fatal) = fatal else {
            return Err(format!("end {end} has failed, but nothing was fatal: {ended}"));
        };
        if time < fatal.from || time > fatal.from + TOLD {
            return Err(format!(
                "end {end} has failed {} ms after the fault: {ended}",
                (time - fatal.from) / MS
            ));
        }
        let silent = matches!(ended, End::Silent(_) | End::Unheard);
        let fits = match fatal.fault {
            Fault::Restarted { .. } => *ended == End::Restarted || silent,
            Fault::Aborted { end: aborted } if aborted == end => matches!(ended, End::Aborted(_)),
            Fault::Aborted { .. } => matches!(ended, End::PeerAborted(_)),
            _ => silent,
        };
        if fits { Ok(()) } else { Err(format!("end {end} gives a wrong reason: {ended}")) }
    }
}

impl Load {
    fn draw(rng: &mut Rng) -> Self {
        // Many links are idle; few carry much, because that takes long to simulate.
        let (count, longest) = match rng.below(100) {
            0..15 => (0, 0),
            15..90 => (rng.below(60), 200),
            90..98 => (rng.below(200), 5_000),
            98 => (rng.below(80), 65_537),
            _ => (3_000, 4),
        };
        let frames = (0..count).map(|_| usize::try_from(rng.below(longest)).unwrap_or(0)).collect();
        let mut of = |values: [u64; 3]| match rng.below(10) {
            0..6 => values[0],
            6..9 => values[1],
            _ => values[2],
        };
        let many = count > 1_000;
        let writes_every =
            of([1_000, if many { 10 } else { 50_000 }, if many { 1 } else { 400_000 }]);
        let reads_every = of([1, 1_000, 300_000]);
        let finishes_at = of([0, 3_000, 40_000]);
        let finishes_at = nanos(rng.below(finishes_at + 1)) * MS;
        Self { frames, writes_every, reads_every, finishes_at }
    }
}

/// Breaks that a link outlasts: one of them may be long.
fn breaks(rng: &mut Rng) -> Vec<Episode> {
    let mut episodes = Vec::new();
    let mut from = nanos(rng.below(FIRST)) * MS;
    let long = rng.below(4);
    for at in 0..rng.below(4) {
        let length = match at == long {
            true if rng.percent(50) => 15 * SECOND,
            true => 8 * SECOND,
            false => nanos(1 + rng.below(2_000)) * MS,
        };
        let (fault, length) = match rng.below(12) {
            0..5 => (Fault::Cut { told: rng.percent(50) }, length),
            5..9 => (Fault::Pause { end: usize::from(rng.percent(50)) }, length),
            9 => (Fault::Suspended, 4 * length),
            _ => (slow(rng), length),
        };
        episodes.push(Episode { fault, from, until: from + length });
        from += length + BETWEEN + nanos(rng.below(3_000)) * MS;
    }
    episodes
}

/// A line that becomes slow, by less than what other faults are away.
fn slow(rng: &mut Rng) -> Fault {
    Fault::Slow { by: nanos(20 + rng.below(480)) * MS }
}

/// A number that is far below the largest time.
pub(crate) fn nanos(number: u64) -> Nanos {
    Nanos::try_from(number).unwrap_or(Nanos::MAX)
}

impl fmt::Display for RelayTrial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "seed {}: {:?}", self.seed, self.line)?;
        for (end, load) in self.loads.iter().enumerate() {
            let bytes: usize = load.frames.iter().sum();
            let (count, writes, reads) = (load.frames.len(), load.writes_every, load.reads_every);
            writeln!(
                f,
                "  end {end} sends {count} frames with {bytes} bytes, one in {writes} µs, reads one in {reads} µs"
            )?;
        }
        for Episode { fault, from, until } in &self.episodes {
            writeln!(f, "  {fault:?} from {} ms until {} ms", from / MS, until / MS)?;
        }
        Ok(())
    }
}
