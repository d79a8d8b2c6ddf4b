//! The programs that the scheduler is measured with. Their bodies do next to nothing, so what is
//! measured is what lies between two bodies.

use std::time::Duration;

use hprm::prelude::*;

/// How many reactors a chain has, how many readers a fan-out, how many timers a storm.
pub(crate) const WIDTH: u64 = 100;

/// The periods of a storm's timers, in nanoseconds, in turn.
pub(crate) const PERIODS: [u64; 4] = [2, 3, 5, 7];

/// A program to be measured.
pub(crate) struct Workload {
    /// What the tables call it.
    pub(crate) name: &'static str,
    /// How many units of work it does in the time of a short measurement.
    pub(crate) units: u64,
    /// Makes the program that does so many.
    pub(crate) build: fn(u64, Properties) -> Runnable,
    /// What is counted.
    pub(crate) unit: &'static str,
}

/// All of them.
pub(crate) const WORKLOADS: [Workload; 5] = [
    Workload { name: "ping-pong", units: 400_000, build: ping_pong, unit: "rounds" },
    Workload { name: "timer", units: 1_000_000, build: timer, unit: "events" },
    Workload { name: "timer storm", units: 1_000_000, build: timer_storm, unit: "events" },
    Workload { name: "chain of 100", units: 1_000_000, build: chain, unit: "reactions" },
    Workload { name: "fan-out to 100", units: 1_000_000, build: fan_out, unit: "reactions" },
];

/// As fast as possible, in so many threads.
pub(crate) fn properties() -> Properties {
    Properties { fast: true, ..Properties::default() }
}

/// Two reactors that answer each other. A round is one logical action, two port writes, three
/// reactions.
fn ping_pong(rounds: u64, properties: Properties) -> Runnable {
    let mut program = Program::new("PingPong").properties(properties);
    let (ping, pong) = program.reactor("ping", rounds, |reactor| {
        let serve = reactor.logical_action("serve", Duration::ZERO);
        let (ping, pong) = (reactor.output("ping"), reactor.input("pong"));
        reactor.reaction().on(Startup).schedules(serve).run(move |_, ctx| {
            ctx.schedule(serve, Duration::ZERO, ());
        });
        reactor.reaction().on(serve).sets(ping).run(move |left, ctx| {
            *left -= 1;
            ctx.set(ping, *left);
        });
        reactor.reaction().on(pong).schedules(serve).run(move |left, ctx| {
            if *left == 0 {
                ctx.request_stop();
            } else {
                ctx.schedule(serve, Duration::ZERO, ());
            }
        });
        (ping, pong)
    });
    let (inp, out) = program.reactor("pong", 0, relay);
    program.connect(ping, inp);
    program.connect(out, pong);
    program.build().expect("the program is fixed")
}

/// Sends what it receives, and adds it up.
fn relay(reactor: &mut ReactorBuilder<'_, u64>) -> (InputPort<u64>, OutputPort<u64>) {
    let (inp, out) = (reactor.input("inp"), reactor.output("out"));
    reactor.reaction().on(inp).sets(out).run(move |sum, ctx| {
        let value = ctx.get(inp).copied().unwrap_or_default();
        *sum = sum.wrapping_add(value);
        ctx.set(out, value);
    });
    (inp, out)
}

/// Counts timer events; stops the program after `limit`.
fn ticker(reactor: &mut ReactorBuilder<'_, u64>, period: u64, limit: u64) {
    let tick = reactor.timer("tick", Duration::ZERO, Duration::from_nanos(period));
    reactor.reaction().on(tick).run(move |count, ctx| {
        *count += 1;
        if *count == limit {
            ctx.request_stop();
        }
    });
}

/// One timer.
fn timer(events: u64, properties: Properties) -> Runnable {
    let mut program = Program::new("Timer").properties(properties);
    program.reactor("ticker", 0, |reactor| ticker(reactor, 1, events));
    program.build().expect("the program is fixed")
}

/// A hundred timers of different periods.
fn timer_storm(events: u64, properties: Properties) -> Runnable {
    let mut program = Program::new("TimerStorm").properties(properties);
    for (i, period) in (0..WIDTH).zip(PERIODS.into_iter().cycle()) {
        // The first one has the shortest period; it stops the program.
        let limit = if i == 0 { storm_limit(events) } else { u64::MAX };
        program.reactor(&format!("ticker[{i}]"), 0, |reactor| ticker(reactor, period, limit));
    }
    program.build().expect("the program is fixed")
}

/// How many events of its first timer a storm has in all of so many.
pub(crate) fn storm_limit(events: u64) -> u64 {
    let share: f64 = PERIODS.iter().map(|period| PERIODS[0] as f64 / *period as f64).sum();
    (events as f64 / (share * WIDTH as f64 / PERIODS.len() as f64)) as u64
}

/// A timer, then a hundred reactors of which each sets the next one's input.
fn chain(reactions: u64, properties: Properties) -> Runnable {
    let mut program = Program::new("Chain").properties(properties);
    let mut last = source(&mut program, reactions / WIDTH);
    for i in 0..WIDTH {
        let (inp, out) = program.reactor(&format!("relay[{i}]"), 0, relay);
        program.connect(last, inp);
        last = out;
    }
    program.build().expect("the program is fixed")
}

/// A timer, then a hundred reactors that read the same output.
fn fan_out(reactions: u64, properties: Properties) -> Runnable {
    let mut program = Program::new("FanOut").properties(properties);
    let out = source(&mut program, reactions / WIDTH);
    for i in 0..WIDTH {
        let (inp, _) = program.reactor(&format!("relay[{i}]"), 0, relay);
        program.connect(out, inp);
    }
    program.build().expect("the program is fixed")
}

/// Sets an output `limit` times, then stops the program.
fn source(program: &mut Program, limit: u64) -> OutputPort<u64> {
    program.reactor("source", 0, |reactor| {
        let tick = reactor.timer("tick", Duration::ZERO, Duration::from_nanos(1));
        let out = reactor.output("out");
        reactor.reaction().on(tick).sets(out).run(move |count, ctx| {
            *count += 1;
            ctx.set(out, *count);
            if *count == limit {
                ctx.request_stop();
            }
        });
        out
    })
}
