//! A federation drawn from a seed, with the faults that happen to it, and the verdict on what it did.
//!
//! The program, the network, the clocks and the faults all come from one number. `generate` draws
//! the program; this file draws the rest, and says what must be true at the end.

use std::any::Any;
use std::collections::BTreeSet;
use std::fmt;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Arc;

use hprm_core::{Bound, Coordination, FederateId, Nanos, PhysicalTime, Program, Tag};
use hprm_federated::{DnetMode, Topology};

use crate::changes;
use crate::history::History;
use crate::plan::Resets;
use crate::rng::mix;
use crate::{
    Latency, Log, Machines, Outcome, Partition, Plan, Rng, Shape, Skew, Traffic, Visit, World,
    difference, generate, lives, reference_until, visits,
};

/// How long frames may be in transit; a program lasts 20,000 at most.
const JITTERS: [u64; 5] = [1, 300, 5_000, 50_000, 200_000];

/// How long federates wait that do not wait for ever.
const MAXWAITS: [Nanos; 4] = [0, 500, 2_000, 20_000];

/// How many bytes may be in transit to a receiver: those of no message, or of a few.
const FLOW_LIMITS: [u64; 4] = [0, 150, 400, 1_500];

/// Separates the draws for flow control from all others of a seed.
const FLOW: u64 = 0xf10e;

/// The same for whether federates read boards.
const BOARDS: u64 = 0xb0a2;

/// The same for when the RTI sends downstream next event tags.
const DNET: u64 = 0x5111;

/// See the module.
#[derive(Clone, Debug)]
pub struct Trial {
    seed: u64,
    shape: Shape,
    plan: Plan,
    program: Arc<Program>,
    /// Whether every federate waits for its inputs for ever.
    patient: bool,
    rng: Rng,
}

/// The outcome of a trial in which nothing was wrong.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Verdict {
    /// How many things happened.
    pub events: usize,
    /// How many reactions were executed.
    pub executions: usize,
    /// How many processes did not take part, while the one ran whose place they would have taken.
    pub withdrawn: usize,
    /// How many messages were tardy, or arrived after the end of their receiver.
    pub tardy: usize,
    /// Whether the federation failed, as it must if a federate dies.
    pub failed: bool,
    /// Whether what it did was compared with what the program must do.
    pub compared: bool,
    /// What federates and the RTI have waited for, by kind, at the moments at which that was looked at.
    pub waits: BTreeSet<&'static str>,
    /// What has come of the links between machines.
    pub traffic: Traffic,
}

impl Trial {
    /// The trial of that seed.
    #[must_use]
    pub fn draw(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        let coordination = match rng.percent(50) {
            true => Coordination::Centralized,
            false => Coordination::Decentralized,
        };
        let impatient = coordination == Coordination::Decentralized && rng.percent(30);
        let shape = Shape {
            coordination,
            maxwait: if impatient { pick(&mut rng, &MAXWAITS) } else { Nanos::MAX },
            physical: rng.percent(25),
            cycles: rng.percent(50),
        };
        let mut program = generate(&mut rng, shape);
        let mut plan = plan(&mut rng, shape, &program);
        plan.boards = Rng::new(mix(seed ^ BOARDS)).percent(50);
        visits::draw(seed, shape, &mut program, &mut plan);
        plan.by_hand = visits::by_hand(seed, &program);
        let mut program = Arc::new(program);
        plan.maxwaits = changes::waits(seed, &mut program);
        changes::bounds(seed, &mut program);
        plan.leaves = changes::leaves(seed, &program);
        plan.visits.extend(changes::departures(seed, &program));
        let patient = program.federates.values().all(|federate| federate.maxwait == Nanos::MAX)
            && plan.maxwaits.is_empty();
        plan.flow_limit = flow_limit(seed);
        plan.dnet = dnet_mode(seed);
        Machines::draw(seed, &program, &mut plan);
        Self { seed, shape, plan, program, patient, rng }
    }

    /// Runs it.
    ///
    /// # Errors
    ///
    /// If something is wrong with what it did: what.
    pub fn run(&self) -> Result<Verdict, String> {
        // A machine that panics would otherwise not tell which seed made it.
        let run = || World::new(&self.program, self.rng.clone(), self.plan.clone()).run();
        let outcome = panic::catch_unwind(AssertUnwindSafe(run));
        self.judge(outcome.unwrap_or_else(|cause| Err(words(cause.as_ref()))))
    }

    /// Runs it, and shows each event, a line each, and the verdict. Of a run that goes on for ever it shows the
    /// beginning and the last events.
    #[must_use]
    pub fn tell(&self) -> String {
        let mut history = History::default();
        let world = World::new(&self.program, self.rng.clone(), self.plan.clone());
        let watch = |shown: &dyn fmt::Display| history.add(shown);
        let outcome = panic::catch_unwind(AssertUnwindSafe(|| world.run_watched(watch)));
        let outcome = outcome.unwrap_or_else(|cause| Err(words(cause.as_ref())));
        match self.judge(outcome) {
            Ok(verdict) => format!("{self}{history}{verdict}\n"),
            Err(wrong) => format!("{self}{history}WRONG: {wrong}\n"),
        }
    }

    fn judge(&self, outcome: Result<Outcome, String>) -> Result<Verdict, String> {
        let outcome = outcome?;
        let patient = self.patient;
        let lost = if self.has_transients() { 0 } else { outcome.lost };
        let tardy = outcome.tardy + lost;
        if patient && outcome.tardy > 0 {
            return Err(format!(
                "{} messages were tardy, but all federates wait for ever",
                outcome.tardy
            ));
        }
        // A federate that does not wait may have missed a message that its sender died before sending.
        let certain = patient || outcome.failed.is_none();
        let departed = !self.has_transients() && self.departs(&outcome);
        let compared = !self.shape.physical && tardy == 0 && certain && !departed;
        match outcome.failed {
            Some(victim) => self.failed(victim, &outcome, compared)?,
            None => self.ended(&outcome, compared)?,
        }
        let entries = outcome.log.entries.values();
        Ok(Verdict {
            events: outcome.events,
            executions: entries.map(Vec::len).sum(),
            withdrawn: outcome.withdrawn,
            tardy,
            failed: outcome.failed.is_some(),
            compared,
            waits: outcome.seen,
            traffic: outcome.traffic,
        })
    }

    /// What must be true if a federate has failed.
    fn failed(&self, victim: FederateId, outcome: &Outcome, compared: bool) -> Result<(), String> {
        let victims = [self.plan.crash, self.plan.cut].map(|fault| fault.map(|(victim, _)| victim));
        let broken = self.plan.broken.is_some_and(|(one, other, _)| [one, other].contains(&victim));
        let broken = broken || self.plan.broken_at_end.is_some_and(|me| me != victim);
        let severed = outcome.traffic.severed.contains(&victim);
        if !victims.contains(&Some(victim)) && !broken && !severed {
            return Err(format!("{} is reported, but nothing happened to it", self.name(victim)));
        }
        let fatal = self.plan.machines.as_ref().and_then(Machines::fatal).filter(|_| severed);
        if let Some((from, until)) = fatal.filter(|(_, until)| outcome.over.0 > *until) {
            let late = (until - from) / 1_000_000;
            return Err(format!("not all have ended {late} ms after what happened to the links"));
        }
        let must = reference_until(&self.program, outcome.stop, None, &self.plan.leaves);
        let compared = compared && !self.has_transients();
        if compared && let Some(wrong) = excess(&self.program, &outcome.log, &must, outcome.stop) {
            return Err(wrong);
        }
        Ok(())
    }

    /// What must be true if all federates have ended.
    fn ended(&self, outcome: &Outcome, compared: bool) -> Result<(), String> {
        let stays = |me: FederateId| !self.program.federates[me].transient && !outcome.left[me];
        let mut stayed = outcome.last.iter().filter(|(me, _)| stays(*me));
        let last = stayed.next().map_or(Tag::FOREVER, |(_, last)| *last);
        if let Some((me, other)) = stayed.find(|(_, tag)| **tag != last) {
            return Err(format!("{} ends at {other}, another one at {last}", self.name(me)));
        }
        if self.has_transients() {
            let wrong = || {
                let Outcome { lives, stop, lost_from, .. } = outcome;
                lives::wrong(&self.program, lives, (*stop, *lost_from), self.patient)
            };
            let wrong = compared.then(wrong).flatten();
            return wrong.map_or(Ok(()), Err);
        }
        // A federate that does not wait may end before the link does.
        if self.patient && outcome.lost_from < Tag::FOREVER {
            return Err(format!("a link lost a message for {}, unnoticed", outcome.lost_from));
        }
        if self.patient && outcome.lost > 0 && self.plan.stop.is_none() {
            return Err(format!("{} messages did not arrive", outcome.lost));
        }
        let must = compared.then(|| reference_until(&self.program, last, None, &self.plan.leaves));
        let wrong =
            must.and_then(|must| difference(&self.program, &outcome.log, &must, Tag::FOREVER));
        wrong.map_or(Ok(()), Err)
    }

    /// Whether a federate was asked from outside to leave. At which tag it does, and whether the program still ends where
    /// no federate has an event, depends on clocks.
    fn departs(&self, outcome: &Outcome) -> bool {
        self.plan.visits.iter().any(|(_, at, _)| *at <= outcome.over)
    }

    fn has_transients(&self) -> bool {
        self.program.federates.values().any(|federate| federate.transient)
    }

    fn name(&self, federate: FederateId) -> &str {
        &self.program.federates[federate].name
    }
}

/// The text of a panic of a machine.
fn words(cause: &(dyn Any + Send)) -> String {
    let words = cause.downcast_ref::<String>().map(String::as_str);
    let words = words.or_else(|| cause.downcast_ref::<&str>().copied());
    format!("a machine panicked: {}", words.unwrap_or("without a text"))
}

/// The first execution, by reaction, before `end` that the program does not have there.
fn excess(program: &Program, is: &Log, must: &Log, end: Tag) -> Option<String> {
    let cut = |id, log: &Log| -> Vec<_> {
        log.entries[id].iter().filter(|entry| entry.tag < end).cloned().collect()
    };
    program.reactions.ids().find_map(|id| {
        let (is, must) = (cut(id, is), cut(id, must));
        let at = (0..is.len()).find(|at| is.get(*at) != must.get(*at))?;
        let name = program.reaction_name(id);
        Some(format!("execution {at} of {name}: {:?}, but must be {:?}", is[at], must.get(at)))
    })
}

fn plan(rng: &mut Rng, shape: Shape, program: &Program) -> Plan {
    let count = program.federates.len() as u64;
    let any = |rng: &mut Rng| FederateId(u16::try_from(rng.below(count)).unwrap_or(0));
    let time = |rng: &mut Rng| PhysicalTime(rng.below(60_000).cast_signed());
    let least = if rng.percent(30) { rng.below(2_000) } else { 0 };
    let jitter = pick(rng, &JITTERS);
    let spikes = if rng.percent(20) { 3 } else { 0 };
    let mut plan = Plan { latency: Latency { least, jitter, spikes }, ..Plan::default() };
    if rng.percent(15) {
        let (federate, from) = (any(rng), time(rng));
        let until = from.plus(rng.below(100_000).cast_signed());
        plan.partition = Some(Partition { federate, from, until });
    }
    if rng.percent(40) {
        let skew = |_| Skew {
            offset: rng.below(20_000).cast_signed() - 10_000,
            drift: rng.below(2_000).cast_signed() - 1_000,
        };
        plan.clocks = (0..count).map(skew).collect();
    }
    if rng.percent(25) {
        plan.stop = Some((any(rng), Tag::new(rng.below(8_000).cast_signed(), 0)));
    }
    if rng.percent(10) {
        plan.crash = Some((any(rng), time(rng)));
    } else if rng.percent(10) {
        plan.cut = Some((any(rng), time(rng)));
    }
    if shape.physical {
        plan.events = (0..rng.below(4)).map(|_| (any(rng), time(rng))).collect();
    }
    plan
}

/// The limit is drawn apart from the rest, so that the other draws of a seed stay the same.
fn flow_limit(seed: u64) -> Option<u64> {
    let mut rng = Rng::new(mix(seed ^ FLOW));
    rng.percent(60).then(|| pick(&mut rng, &FLOW_LIMITS))
}

/// Mostly `Eager`: programs are too short for `Usual` to send many.
fn dnet_mode(seed: u64) -> DnetMode {
    let mut rng = Rng::new(mix(seed ^ DNET));
    match rng.below(10) {
        0 => DnetMode::Off,
        1..=3 => DnetMode::Usual,
        _ => DnetMode::Eager,
    }
}

fn pick<T: Copy>(rng: &mut Rng, among: &[T]) -> T {
    among[usize::try_from(rng.below(among.len() as u64)).unwrap_or(0)]
}

impl fmt::Display for Trial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { seed, shape, plan, program, .. } = self;
        let coordination = match shape.coordination {
            Coordination::Centralized => "centralized",
            Coordination::Decentralized => "decentralized",
        };
        writeln!(f, "seed {seed}: {coordination}, {} federates", program.federates.len())?;
        for federate in program.federates.values().filter(|f| f.maxwait < Nanos::MAX) {
            writeln!(f, "  {} waits {} ns for its inputs", federate.name, federate.maxwait)?;
        }
        if let Some(timeout) = program.properties.timeout {
            writeln!(f, "  it ends at {timeout} ns")?;
        }
        for cycle in Topology::new(program).zero_delay_cycles() {
            let names: Vec<_> = cycle.iter().map(|me| self.name(*me)).collect();
            writeln!(f, "  a cycle without a delay: {}", names.join(", "))?;
        }
        for channel in program.channels.values() {
            let arrow = if channel.physical { "~>" } else { "->" };
            let (from, to) = (self.name(channel.from), self.name(channel.to));
            let absent_after = match program.connections[channel.connection].absent_after {
                0 => String::new(),
                wait => format!(", absent after {wait}"),
            };
            let bound = match program.connections[channel.connection].bound {
                None => String::new(),
                Some(Bound { messages, overflow }) => format!(", bound {messages}, {overflow:?}"),
            };
            writeln!(f, "  {from} {arrow} {to}, delay {:?}{absent_after}{bound}", channel.delay)?;
        }
        self.write_plan(f, plan)
    }
}

impl Trial {
    fn write_plan(&self, f: &mut fmt::Formatter<'_>, plan: &Plan) -> fmt::Result {
        let Latency { least, jitter, spikes } = plan.latency;
        writeln!(
            f,
            "  latency from {least} ns to {} ns, {spikes} % fifty times",
            least + jitter.saturating_sub(1)
        )?;
        if let Some(Latency { least, jitter, spikes }) = plan.direct_latency {
            let most = least + jitter.saturating_sub(1);
            let range = format!("from {least} ns to {most} ns, {spikes} % fifty times");
            writeln!(f, "  on direct links, {range}")?;
        }
        for (me, Skew { offset, drift }) in self.program.federates.ids().zip(&plan.clocks) {
            writeln!(f, "  the clock of {}: {offset:+} ns, {drift:+} ppm", self.name(me))?;
        }
        if let Some(Partition { federate, from, until }) = plan.partition {
            writeln!(f, "  {} is cut off from {} to {}", self.name(federate), from.0, until.0)?;
        }
        if let Some(limit) = plan.flow_limit {
            writeln!(f, "  at most {limit} bytes are in transit to a receiver when a tag begins")?;
        }
        match plan.dnet {
            DnetMode::Off => writeln!(f, "  federates report every next event")?,
            DnetMode::Eager => {
                writeln!(f, "  the RTI sends downstream next event tags as often as it can")?;
            }
            DnetMode::Usual => {}
        }
        if plan.boards && self.shape.coordination == Coordination::Centralized {
            writeln!(f, "  federates read boards")?;
        }
        if let Some((federate, tag)) = plan.stop {
            writeln!(f, "  {} asks to stop at {tag} or later", self.name(federate))?;
        }
        for (federate, tag) in &plan.leaves {
            writeln!(f, "  {} leaves at {tag} or later", self.name(*federate))?;
        }
        for (federate, tag, wait) in &plan.maxwaits {
            writeln!(f, "  {} waits {wait} ns for its inputs after {tag}", self.name(*federate))?;
        }
        if let Some((federate, at)) = plan.crash {
            writeln!(f, "  {} is killed at {}", self.name(federate), at.0)?;
        }
        self.write_broken_links(f, plan)?;
        for (me, _) in self.program.federates.iter().filter(|(_, federate)| federate.transient) {
            let absent = if plan.absent.contains(&me) { ", and absent at the start" } else { "" };
            writeln!(f, "  {} is transient{absent}", self.name(me))?;
            let by_hand = plan.by_hand.iter().filter(|it| it.federate == me);
            let by_hand: Vec<_> = by_hand.map(|it| it.life.to_string()).collect();
            if !by_hand.is_empty() {
                writeln!(f, "  users start its processes {}", by_hand.join(", "))?;
            }
        }
        for (federate, at, visit) in &plan.visits {
            let what = match visit {
                Visit::Launch => "is launched",
                Visit::Leave => "asks to leave",
                Visit::Crash => "is killed",
            };
            writeln!(f, "  {} {what} at {}", self.name(*federate), at.0)?;
        }
        for (federate, at) in &plan.events {
            writeln!(
                f,
                "  a physical action of {} is scheduled at {}",
                self.name(*federate),
                at.0
            )?;
        }
        Ok(())
    }

    fn write_broken_links(&self, f: &mut fmt::Formatter<'_>, plan: &Plan) -> fmt::Result {
        if let Some((federate, at)) = plan.cut {
            writeln!(f, "  the link of {} to the RTI breaks at {}", self.name(federate), at.0)?;
        }
        if let Some((one, other, at)) = plan.broken {
            let (one, other) = (self.name(one), self.name(other));
            writeln!(f, "  the direct link between {one} and {other} breaks at {}", at.0)?;
        }
        if let Some(me) = plan.broken_at_end {
            writeln!(f, "  the direct links of {} break when it has ended", self.name(me))?;
        }
        if let Some(Resets { count, pause }) = plan.resets {
            writeln!(
                f,
                "  {count} direct links end while they are opened; again after {pause} ns"
            )?;
        }
        plan.machines.iter().try_for_each(|machines| write!(f, "{machines}"))
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { events, executions, tardy, .. } = self;
        write!(f, "  {events} events, {executions} reactions")?;
        if *tardy > 0 {
            write!(f, ", {tardy} messages tardy or lost")?;
        }
        let comparison = match (self.compared, self.failed) {
            (true, false) => "equal to the program in one scheduler",
            (true, true) => "ended as it must, with what the program does so far",
            (false, true) => "ended as it must",
            (false, false) => "all ended at one tag",
        };
        write!(f, ": {comparison}")
    }
}
