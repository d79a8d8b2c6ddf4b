//! The cells in HPRM: a federation of a hub and a node.
//!
//! There is no delay around their circle but one microstep, as in `bench/peers/programs`.

use std::time::Duration;

use hprm::prelude::*;

use crate::cell::{
    Cell, Contender, HUB, NODE, Numbered, Rounds, Waiting, Words, Workload, bytes, now, number,
};

impl Numbered for Array<u8> {
    fn numbered(number: u64) -> Self {
        bytes(number).to_vec().into()
    }

    fn number(&self) -> u64 {
        number(self)
    }
}

/// Runs a cell; in a federate, it does not return.
pub(crate) fn run(cell: &Cell) -> Result<(), Failure> {
    let properties = Properties { cpus: vec![HUB, NODE], ..Properties::default() };
    let mut pair = Federation::new("Pair").properties(properties).spin(spin(cell));
    if cell.contender == Contender::Decentralized {
        pair = pair.decentralized();
    }
    match cell.workload {
        Workload::Array => echo::<Array<u8>>(&mut pair, cell),
        Workload::Struct => echo::<Words>(&mut pair, cell),
        Workload::Loan(size) => loan(&mut pair, cell, size),
        Workload::Rate(size) => rate(&mut pair, cell, size),
    }
    pair.run()
}

fn spin(cell: &Cell) -> Duration {
    match cell.waiting {
        Waiting::Sleeping => Duration::ZERO,
        // Longer than a process ever waits here.
        Waiting::Polling => Duration::from_micros(200),
    }
}

fn join<A: Transfer, B: Transfer>(
    pair: &mut Federation,
    cell: &Cell,
    hub: (InputPort<A>, OutputPort<B>),
    node: (InputPort<B>, OutputPort<A>),
) {
    let there = pair.connect(hub.1, node.0);
    match cell.contender {
        Contender::Centralized => {
            there.after(Duration::ZERO);
            pair.connect(node.1, hub.0);
        }
        _ => {
            pair.connect(node.1, hub.0).after(Duration::ZERO);
        }
    }
}

fn echo<M: Transfer + Numbered>(pair: &mut Federation, cell: &Cell) {
    struct Hub {
        rounds: Rounds,
        sent: u64,
        began: u64,
    }
    let hub = Hub { rounds: Rounds::of(cell), sent: 0, began: 0 };
    let of_hub = pair.reactor("hub", hub, |hub| {
        let (inp, out) = (hub.input::<M>("inp"), hub.output::<M>("out"));
        let cell = cell.clone();
        hub.reaction().on(Startup).on(inp).sets(out).run(move |hub, ctx| {
            if let Some(reply) = ctx.get(inp) {
                let took = now() - hub.began;
                assert_eq!(reply.number(), hub.sent);
                if hub.rounds.add(took as f64 / 2.0) {
                    cell.write(hub.rounds.median());
                    return ctx.request_stop();
                }
            }
            hub.sent += 1;
            hub.began = now();
            ctx.set(out, M::numbered(hub.sent));
        });
        (inp, out)
    });
    let of_node = pair.reactor("node", (), |node| {
        let (inp, out) = (node.input::<M>("inp"), node.output::<M>("out"));
        node.reaction().on(inp).sets(out).run(move |(), ctx| {
            if let Some(message) = ctx.get(inp) {
                let message = message.clone();
                ctx.set(out, message);
            }
        });
        (inp, out)
    });
    join(pair, cell, of_hub, of_node);
}

/// The node answers with the time at which it could read.
fn loan(pair: &mut Federation, cell: &Cell, size: usize) {
    let state = (Rounds::of(cell), 0);
    let of_hub = pair.reactor("hub", state, |hub| {
        let (inp, out) = (hub.input::<u64>("inp"), hub.output::<Array<u8>>("out"));
        let cell = cell.clone();
        hub.reaction().on(Startup).on(inp).sets(out).run(move |(rounds, began), ctx| {
            if let Some(came) = ctx.get(inp)
                && rounds.add((came - *began) as f64)
            {
                cell.write(rounds.median());
                return ctx.request_stop();
            }
            // Nothing is written to it: that would empty the caches for what is measured.
            let loan = ctx.loan(&[size]);
            *began = now();
            ctx.set(out, loan.into());
        });
        (inp, out)
    });
    let of_node = pair.reactor("node", (), |node| {
        let (inp, out) = (node.input::<Array<u8>>("inp"), node.output::<u64>("out"));
        node.reaction().on(inp).sets(out).run(move |(), ctx| {
            let came = now();
            assert_eq!(ctx.get(inp).map(|array| array.len()), Some(size));
            ctx.set(out, came);
        });
        (inp, out)
    });
    join(pair, cell, of_hub, of_node);
}

/// Each message carries the time of the first one that counts, so there is no way back.
fn rate(pair: &mut Federation, cell: &Cell, size: usize) {
    let (rounds, warm_up) = (cell.rounds, cell.warm_up);
    let out = pair.reactor("hub", (0, 0), |hub| {
        let (step, out) = (hub.logical_action::<()>("step", Duration::ZERO), hub.output("out"));
        hub.reaction().on(Startup).on(step).sets(out).schedules(step).run(
            move |(sent, began), ctx| {
                if *sent == warm_up {
                    *began = now();
                }
                let mut message = vec![0; size];
                message[..8].copy_from_slice(&u64::to_le_bytes(*began));
                ctx.set(out, Array::from(message));
                *sent += 1;
                if *sent < rounds + warm_up {
                    ctx.schedule(step, Duration::ZERO, ());
                }
            },
        );
        out
    });
    let inp = pair.reactor("node", 0, |node| {
        let inp = node.input::<Array<u8>>("inp");
        let cell = cell.clone();
        node.reaction().on(inp).run(move |received, ctx| {
            *received += 1;
            if let Some(message) = ctx.get(inp)
                && *received == rounds + warm_up
            {
                cell.write((now() - number(message)) as f64 / rounds as f64);
                ctx.request_stop();
            }
        });
        inp
    });
    pair.connect(out, inp);
}
