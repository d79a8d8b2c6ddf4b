//! Federations across machines, drawn from a seed: which process is where, what the network between the machines does
//! to packets, and what happens to the agents.
//!
//! An agent leads each link between two machines as a relayed link. `machines/agents.rs` runs the agents,
//! `machines/link.rs` is one link. All draws are apart from the rest, so that the other draws of a seed stay the same.

mod agents;
mod link;

use std::fmt;

use hprm_core::{FederateId, Nanos, PhysicalTime, Program};
use hprm_federated::relay::{SILENCE, TOLD};

pub use agents::Traffic;
pub(crate) use agents::{Agents, Notice};

use crate::relayed::line::Line;
use crate::relayed::{BETWEEN, nanos};
use crate::rng::mix;
use crate::{Plan, Rng};

/// Separates the draws of this file from all others of a seed.
const MACHINES: u64 = 0x3ac4;

const MS: Nanos = 1_000_000;
const SECOND: Nanos = 1_000 * MS;

/// How much later than over quick links the faults of processes come: these links are slower.
const LATER: [Nanos; 3] = [1, 200, 20_000];

/// When the first trouble begins, at the latest, in round trips: while federates join, or later.
const FIRST: [u64; 3] = [2, 8, 30];

/// What agents and federates may need on top of [`TOLD`], until all processes have ended: broken direct links are
/// explained, and what they say is sent again where it is lost.
const AFTERWARDS: Nanos = 20 * SECOND;

/// Which process is on which machine, and what happens between them.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Machines {
    /// The machine of each federate.
    federates: Vec<usize>,
    rti: usize,
    pub(crate) line: Line,
    /// The most bytes that a frame has, if it has not those of the protocol.
    pub(crate) longest: Option<u64>,
    pub(crate) troubles: Vec<Trouble>,
}

/// What happens between machines.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(crate) enum Kind {
    /// Nothing is carried between a machine and the others; their agents are told so, or not.
    Cut { told: bool },
    /// The agent of a machine stands still.
    Pause,
    /// The agent of a machine is killed, and started again.
    Restart,
}

/// Something that happens to a machine, from when and until when.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Trouble {
    pub(crate) kind: Kind,
    pub(crate) machine: usize,
    pub(crate) from: Nanos,
    pub(crate) until: Nanos,
}

impl Trouble {
    /// Whether links do not outlast it.
    pub(crate) fn is_fatal(&self) -> bool {
        self.kind == Kind::Restart || self.until - self.from >= SILENCE
    }
}

impl Machines {
    /// The machines of federates and of the RTI, in a network that loses nothing. Frames have the sizes of the protocol.
    #[must_use]
    pub fn in_a_good_network(federates: Vec<usize>, rti: usize) -> Self {
        Self { federates, rti, line: Line::good(), longest: None, troubles: Vec::new() }
    }

    /// The machine of a federate.
    pub(crate) fn of(&self, federate: FederateId) -> usize {
        self.federates[federate.index()]
    }

    /// Whether a federate shares a machine with the RTI.
    pub(crate) fn is_at_rti(&self, federate: FederateId) -> bool {
        self.of(federate) == self.rti
    }

    /// Whether two federates can map memory that the RTI hands from one to the other.
    pub(crate) fn share_boards(&self, one: FederateId, other: FederateId) -> bool {
        self.is_at_rti(one) && self.is_at_rti(other)
    }

    /// The machine of the RTI.
    pub(crate) fn rti(&self) -> usize {
        self.rti
    }

    /// How many machines there are.
    pub(crate) fn count(&self) -> usize {
        1 + self.federates.iter().copied().chain([self.rti]).max().unwrap_or(0)
    }

    /// From when until when links may end although no process has, if they may.
    pub(crate) fn fatal(&self) -> Option<(Nanos, Nanos)> {
        let trouble = self.troubles.iter().find(|trouble| trouble.is_fatal())?;
        Some((trouble.from, trouble.from + TOLD + AFTERWARDS))
    }

    /// Puts the processes of some federations on several machines.
    pub(crate) fn draw(seed: u64, program: &Program, plan: &mut Plan) {
        let mut rng = Rng::new(mix(seed ^ MACHINES));
        // Links within a machine break in other ways.
        let breaks = plan.cut.is_some()
            || plan.broken.is_some()
            || plan.broken_at_end.is_some()
            || plan.resets.is_some();
        // What goes wrong around federates that join late is seldom seen, and needs many seeds with
        // quick links.
        let has_transients = program.federates.iter().any(|(_, federate)| federate.transient);
        if breaks || !rng.percent(if has_transients { 5 } else { 35 }) {
            return;
        }
        let count = 2 + rng.below(3);
        let mut machine = || usize::try_from(rng.below(count)).unwrap_or(0);
        let rti = machine();
        let federates = program.federates.ids().map(|_| machine()).collect();
        let line = Line::draw(&mut rng);
        let longest = Some([8, 300, 20_000][usize::try_from(rng.below(3)).unwrap_or(0)]);
        let later = LATER[usize::try_from(rng.below(3)).unwrap_or(0)];
        if let Some((_, at)) = &mut plan.crash {
            at.0 *= later;
        }
        for (_, at, _) in &mut plan.visits {
            at.0 *= later;
        }
        let mut machines = Self { federates, rti, line, longest, troubles: Vec::new() };
        machines.troubles = troubles(&mut rng, machines.count(), line.round_trip());
        // What others learn of a death is held up, which matters most if that takes long.
        if let Some(Trouble { from, until, .. }) = machines.troubles.first().copied()
            && rng.percent(if until - from > 3 * SECOND { 60 } else { 10 })
        {
            let later = rng.below(u64::try_from(until - from).unwrap_or(0));
            let victim =
                FederateId(u16::try_from(any(&mut rng, program.federates.len())).unwrap_or(0));
            plan.crash = Some((victim, PhysicalTime(from + nanos(later))));
        }
        plan.machines = Some(machines);
    }
}

/// What links outlast, and at the end perhaps what they do not.
fn troubles(rng: &mut Rng, machines: usize, round_trip: u64) -> Vec<Trouble> {
    let mut troubles = Vec::new();
    let first = round_trip * FIRST[usize::try_from(rng.below(3)).unwrap_or(0)];
    let mut from = nanos(rng.below(first));
    for _ in 0..rng.below(3) {
        let length = match rng.below(10) {
            0 => 8 * SECOND,
            1 => 15 * SECOND,
            2..6 => nanos(1 + rng.below(2_000)) * MS,
            _ => nanos(1 + rng.below(2_000)) * 1_000,
        };
        let told = rng.percent(50);
        let kind = if rng.percent(50) { Kind::Cut { told } } else { Kind::Pause };
        troubles.push(Trouble { kind, machine: any(rng, machines), from, until: from + length });
        // Otherwise two of them could be one long silence.
        from += length + BETWEEN + nanos(rng.below(1_000)) * MS;
    }
    if rng.percent(20) {
        if rng.percent(70) {
            troubles.clear();
            from = nanos(rng.below(first));
        }
        let machine = any(rng, machines);
        let until = from + TOLD + nanos(rng.below(10_000)) * MS;
        let told = rng.percent(50);
        troubles.push(match rng.percent(50) {
            true => Trouble { kind: Kind::Cut { told }, machine, from, until },
            false => {
                let until = from + nanos(1 + rng.below(3_000)) * MS;
                Trouble { kind: Kind::Restart, machine, from, until }
            }
        });
    }
    troubles
}

fn any(rng: &mut Rng, count: usize) -> usize {
    usize::try_from(rng.below(count as u64)).unwrap_or(0)
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, machine, from, until } = self;
        let what = match kind {
            Kind::Cut { told: true } => "is cut off, as its agents are told,",
            Kind::Cut { told: false } => "is cut off",
            Kind::Pause => "has an agent that stands still",
            Kind::Restart => "has an agent that is killed, and started again,",
        };
        write!(f, "machine {machine} {what} from {from} ns until {until} ns")
    }
}

impl fmt::Display for Machines {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { federates, rti, line, troubles, .. } = self;
        writeln!(f, "  the RTI is on machine {rti}, the federates on {federates:?}: {line:?}")?;
        troubles.iter().try_for_each(|trouble| writeln!(f, "  {trouble}"))
    }
}
