//! Random federated programs: a few federates, channels with every kind of delay.

use hprm_core::{
    Connection, Coordination, Delay, Direction, Effect, Nanos, Origin, PortId, Program,
    ProgramBuilder, ProgramError, Properties, ReactionSpec, ReactorId, Trigger,
};

use crate::Rng;

/// A thousandth of the time that a program runs.
const TICK: Nanos = 1_000;

/// What kind of program.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Shape {
    /// How its federates are coordinated.
    pub coordination: Coordination,
    /// How long each of them waits for inputs, if it is the decentralized way.
    pub maxwait: Nanos,
    /// Whether it has physical actions and physical connections. What it does then depends on the
    /// clock, and no two runs are alike.
    pub physical: bool,
    /// Whether federates may send to one another on cycles without any delay.
    pub cycles: bool,
}

/// A program of that shape.
#[must_use]
pub fn generate(rng: &mut Rng, shape: Shape) -> Program {
    loop {
        // Cycles of federates are welcome, but some are cycles of reactions.
        match attempt(rng, shape) {
            Err(ProgramError::CausalityLoop { .. }) if shape.cycles => {}
            built => return built.expect("cycles have delays, and every input has one source"),
        }
    }
}

fn attempt(rng: &mut Rng, shape: Shape) -> Result<Program, ProgramError> {
    // Without periodic timers all federates become idle at some time, and then the program ends.
    let rests = !shape.physical && rng.percent(25);
    let timeout = TICK * (1 + rng.below(20).cast_signed());
    let properties = Properties {
        timeout: (!rests || rng.percent(30)).then_some(timeout),
        keepalive: !rests,
        coordination: shape.coordination,
        ..Properties::default()
    };
    let mut b = ProgramBuilder::new("Main", properties);
    let federates: Vec<_> = (0..2 + rng.below(3))
        .map(|index| {
            let name = format!("f{index}");
            let reactor = b.reactor(b.main(), &name);
            b.federate(reactor, &name, shape.maxwait, None);
            Ports { reactor, inputs: Vec::new(), outputs: Vec::new() }
        })
        .collect();
    let federates = connect(&mut b, rng, shape, federates);
    for ports in &federates {
        contents(&mut b, rng, (shape, rests), ports);
    }
    b.build()
}

struct Ports {
    reactor: ReactorId,
    inputs: Vec<PortId>,
    outputs: Vec<PortId>,
}

fn connect(
    b: &mut ProgramBuilder,
    rng: &mut Rng,
    shape: Shape,
    mut federates: Vec<Ports>,
) -> Vec<Ports> {
    for from in 0..federates.len() {
        for to in 0..federates.len() {
            if from == to || !rng.percent(55) {
                continue;
            }
            let output = output(b, rng, &mut federates[from]);
            let input = {
                let ports = &mut federates[to];
                let name = format!("in{from}");
                let input = b.port(ports.reactor, &name, Direction::Input);
                // Some inputs have no reaction; a message to them delays the end of the program all the
                // same.
                if rng.percent(90) {
                    ports.inputs.push(input);
                }
                input
            };
            let physical = shape.physical && rng.percent(30);
            let forward = from < to || shape.cycles && rng.percent(50);
            let delay = delay(rng, forward);
            let (from, to) = (output, input);
            b.connection(Connection {
                from,
                to,
                delay,
                physical,
                serializer: None,
                absent_after: 0,
                compress: false,
                bound: None,
                mode: None,
            });
        }
    }
    federates
}

/// A new output, or sometimes one that is connected already.
fn output(b: &mut ProgramBuilder, rng: &mut Rng, ports: &mut Ports) -> PortId {
    if let Some(known) = ports.outputs.last()
        && rng.percent(30)
    {
        return *known;
    }
    let name = format!("out{}", ports.outputs.len());
    let output = b.port(ports.reactor, &name, Direction::Output);
    ports.outputs.push(output);
    output
}

fn delay(rng: &mut Rng, forward: bool) -> Delay {
    match rng.below(if forward { 5 } else { 2 }) {
        0 => Delay::Microstep,
        1 => Delay::Time(TICK / 2 * (1 + rng.below(8).cast_signed())),
        _ => Delay::None,
    }
}

fn contents(b: &mut ProgramBuilder, rng: &mut Rng, (shape, rests): (Shape, bool), ports: &Ports) {
    let clocked = shape.physical && rng.percent(60);
    let origin = if clocked { Origin::Physical } else { Origin::Logical };
    let action = b.action(ports.reactor, "a", origin, rng.below(3).cast_signed() * 250);
    let mut triggers = vec![Trigger::Action(action)];
    if rng.percent(50) {
        triggers.push(Trigger::Startup);
    }
    if rng.percent(50) {
        triggers.push(Trigger::Shutdown);
    }
    for index in 0..rng.below(3) {
        let period = if rests { 0 } else { TICK * rng.below(4).cast_signed() };
        let offset = TICK / 2 * rng.below(6).cast_signed();
        let timer = b.timer(ports.reactor, &format!("t{index}"), offset, period);
        triggers.push(Trigger::Timer(timer));
    }
    triggers.extend(ports.inputs.iter().map(|input| Trigger::Port(*input)));
    for trigger in triggers {
        let effects = ports.outputs.iter().map(|output| Effect::Port(*output));
        let mut effects: Vec<_> = effects.filter(|_| rng.percent(60)).collect();
        if rng.percent(40) {
            effects.push(Effect::Action(action));
        }
        let sources = ports.inputs.iter().copied().filter(|_| rng.percent(30)).collect();
        b.reaction(
            ports.reactor,
            ReactionSpec { triggers: vec![trigger], sources, effects, ..ReactionSpec::default() },
        );
    }
}
