//! Workers with two modes: each works for a while, then rests, and the supervisor sees them all.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

/// Works until it is tired, and rests then.
struct Worker {
    strength: u32,
    done: u32,
}

impl Reactor for Worker {
    type Ports = OutputPort<&'static str>;

    fn assemble(&mut self, worker: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let state = worker.output("state");
        let working = worker.initial_mode("working");
        let resting = worker.mode("resting");
        worker.in_mode(working, |worker| {
            let step = worker.timer("step", MS, MS);
            worker.reaction().on(step).sets(state).enters(resting.reset()).run(
                move |worker, ctx| {
                    worker.done += 1;
                    if worker.done == worker.strength {
                        ctx.set(state, "tired");
                        ctx.enter(resting.reset());
                    }
                },
            );
        });
        worker.in_mode(resting, |worker| {
            let rested = worker.timer("rested", 4 * MS, Duration::ZERO);
            worker.reaction().on(rested).sets(state).enters(working.reset()).run(
                move |worker, ctx| {
                    worker.done = 0;
                    ctx.set(state, "rested");
                    ctx.enter(working.reset());
                },
            );
        });
        state
    }
}

fn main() -> Result<(), Failure> {
    let mut program = Program::new("Shift").fast().timeout(10 * MS);
    let states = program.bank("worker", (2..=4).map(|strength| Worker { strength, done: 0 }));
    let inputs = program.reactor("supervisor", (), |supervisor| {
        let inputs = supervisor.inputs("worker", 3);
        let all = inputs.clone();
        supervisor.reaction().on(&inputs).run(move |(), ctx| {
            for (index, state) in ctx.present(&all) {
                println!("{} ms: worker {index} is {state}", ctx.elapsed().as_millis());
            }
        });
        inputs
    });
    program.connect_each(states, inputs);
    program.run()
}
