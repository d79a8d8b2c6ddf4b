//! The workloads, written for boomerang.

use std::error::Error;

use boomerang::builder::prelude::*;
use boomerang::{Reaction, Reactor, runtime};

use crate::workloads::{WIDTH, storm_limit};

const N: usize = WIDTH as usize;

/// The workload of that name, ready to run.
pub(crate) fn build(name: &str, units: u64) -> Result<runtime::Scheduler, Box<dyn Error>> {
    let mut env = EnvBuilder::new();
    match name {
        "ping-pong" => {
            PingPong::build("main", units, None, None, &mut env)?;
        }
        "timer" => {
            Ticker1::build("main", Count { count: 0, limit: units }, None, None, &mut env)?;
        }
        "timer storm" => {
            Storm::build("main", storm_limit(units), None, None, &mut env)?;
        }
        "chain of 100" => {
            let main = Relays::build("main", units / WIDTH, None, None, &mut env)?;
            env.bind_port(main.source.out, main.relays[0].inp)?;
            for pair in main.relays.windows(2) {
                env.bind_port(pair[0].out, pair[1].inp)?;
            }
        }
        "fan-out to 100" => {
            let main = Relays::build("main", units / WIDTH, None, None, &mut env)?;
            for relay in &main.relays {
                env.bind_port(main.source.out, relay.inp)?;
            }
        }
        other => return Err(format!("no workload {other}").into()),
    }
    let (env, graph, _) = env.into_runtime_parts()?;
    Ok(runtime::Scheduler::new(env, graph, true, false))
}

/// Makes sure that the peer has done the work.
pub(crate) fn check(
    name: &str,
    units: u64,
    scheduler: runtime::Scheduler,
) -> Result<(), Box<dyn Error>> {
    let env = scheduler.into_env();
    // A relay adds up 1, 2, 3 and so on.
    let sum = |count: u64| count * (count + 1) / 2;
    let (reactor, expected) = match name {
        "ping-pong" => ("pong", sum(units - 1)),
        "chain of 100" | "fan-out to 100" => ("relays99", sum(units / WIDTH)),
        _ => return Ok(()),
    };
    let found = env.find_reactor_by_name(reactor).and_then(|found| found.get_state::<u64>());
    if found == Some(&expected) {
        Ok(())
    } else {
        Err(format!("{name}: {reactor} has {found:?} instead of {expected}").into())
    }
}

// Ping-pong.

#[derive(Reactor)]
#[reactor(
    state = "u64",
    connection(from = "ping.ping", to = "pong.inp"),
    connection(from = "pong.out", to = "ping.pong")
)]
struct PingPong {
    #[reactor(child = "state")]
    ping: Ping,
    #[reactor(child = "0")]
    pong: Relay,
}

#[derive(Reactor)]
#[reactor(state = "u64", reaction = "Start", reaction = "Serve", reaction = "Again")]
struct Ping {
    ping: TypedPortKey<u64, Output>,
    pong: TypedPortKey<u64, Input>,
    serve: TypedActionKey,
}

#[derive(Reaction)]
#[reaction(reactor = "Ping", triggers(startup))]
struct Start<'a> {
    serve: runtime::ActionRef<'a>,
}

impl Trigger<Ping> for Start<'_> {
    fn trigger(mut self, ctx: &mut runtime::Context, _: &mut u64) {
        ctx.schedule_action(&mut self.serve, None, None);
    }
}

#[derive(Reaction)]
#[reaction(reactor = "Ping", triggers(action = "serve"))]
struct Serve<'a> {
    ping: runtime::OutputRef<'a, u64>,
}

impl Trigger<Ping> for Serve<'_> {
    fn trigger(mut self, _: &mut runtime::Context, left: &mut u64) {
        *left -= 1;
        *self.ping = Some(*left);
    }
}

#[derive(Reaction)]
#[reaction(reactor = "Ping", triggers(port = "pong"))]
struct Again<'a> {
    serve: runtime::ActionRef<'a>,
}

impl Trigger<Ping> for Again<'_> {
    fn trigger(mut self, ctx: &mut runtime::Context, left: &mut u64) {
        if *left == 0 {
            ctx.schedule_shutdown(None);
        } else {
            ctx.schedule_action(&mut self.serve, None, None);
        }
    }
}

// Relays.

#[derive(Reactor)]
#[reactor(state = "u64", reaction = "Pass")]
struct Relay {
    inp: TypedPortKey<u64, Input>,
    out: TypedPortKey<u64, Output>,
}

#[derive(Reaction)]
#[reaction(reactor = "Relay")]
struct Pass<'a> {
    inp: runtime::InputRef<'a, u64>,
    out: runtime::OutputRef<'a, u64>,
}

impl Trigger<Relay> for Pass<'_> {
    fn trigger(mut self, _: &mut runtime::Context, sum: &mut u64) {
        let value = self.inp.unwrap_or_default();
        *sum = sum.wrapping_add(value);
        *self.out = Some(value);
    }
}

#[derive(Clone)]
struct Count {
    count: u64,
    limit: u64,
}

#[derive(Reactor)]
#[reactor(state = "Count", reaction = "Emit")]
struct Source {
    #[reactor(timer(period = "1 nsec"))]
    tick: TimerActionKey,
    out: TypedPortKey<u64, Output>,
}

#[derive(Reaction)]
#[reaction(reactor = "Source", triggers(action = "tick"))]
struct Emit<'a> {
    out: runtime::OutputRef<'a, u64>,
}

impl Trigger<Source> for Emit<'_> {
    fn trigger(mut self, ctx: &mut runtime::Context, state: &mut Count) {
        state.count += 1;
        *self.out = Some(state.count);
        if state.count == state.limit {
            ctx.schedule_shutdown(None);
        }
    }
}

/// A source and relays; the ports are connected from outside.
#[derive(Reactor)]
#[reactor(state = "u64")]
struct Relays {
    #[reactor(child = "Count { count: 0, limit: state }")]
    source: Source,
    #[reactor(child = "0")]
    relays: [Relay; N],
}

// Timers.

macro_rules! tickers {
    ($($reactor:ident $reactor_name:literal $reaction:ident $name:literal $period:literal;)*) => {$(
        #[derive(Reactor)]
        #[reactor(state = "Count", reaction = $name)]
        struct $reactor {
            #[reactor(timer(period = $period))]
            tick: TimerActionKey,
        }

        #[derive(Reaction)]
        #[reaction(reactor = $reactor_name, triggers(action = "tick"))]
        struct $reaction;

        impl Trigger<$reactor> for $reaction {
            fn trigger(self, ctx: &mut runtime::Context, state: &mut Count) {
                state.count += 1;
                if state.count == state.limit {
                    ctx.schedule_shutdown(None);
                }
            }
        }
    )*};
}

tickers! {
    Ticker1 "Ticker1" Tick1 "Tick1" "1 nsec";
    Ticker2 "Ticker2" Tick2 "Tick2" "2 nsec";
    Ticker3 "Ticker3" Tick3 "Tick3" "3 nsec";
    Ticker5 "Ticker5" Tick5 "Tick5" "5 nsec";
    Ticker7 "Ticker7" Tick7 "Tick7" "7 nsec";
}

const QUARTER: usize = N / 4;

#[derive(Reactor)]
#[reactor(state = "u64")]
#[allow(dead_code, reason = "the fields are there for what the derive makes of them")]
struct Storm {
    #[reactor(child = "Count { count: 0, limit: state }")]
    first: Ticker2,
    #[reactor(child = "Count { count: 0, limit: u64::MAX }")]
    twos: [Ticker2; QUARTER - 1],
    #[reactor(child = "Count { count: 0, limit: u64::MAX }")]
    threes: [Ticker3; QUARTER],
    #[reactor(child = "Count { count: 0, limit: u64::MAX }")]
    fives: [Ticker5; QUARTER],
    #[reactor(child = "Count { count: 0, limit: u64::MAX }")]
    sevens: [Ticker7; QUARTER],
}
