//! Two federates that send one message to and fro, and say how they wait for it.

use std::time::Duration;

use hprm::prelude::*;
use nix::sys::resource::{UsageWho, getrusage};

const ROUNDS: u64 = 400;

/// Each federate busy-polls for so long.
pub(crate) fn spinning(time: Duration) -> Federation {
    let mut federation = Federation::new("Spinning").decentralized().spin(time);
    let (answer, serve) = federation.reactor("hub", 0, |hub| {
        let (inp, out) = (hub.input::<u64>("inp"), hub.output("out"));
        hub.reaction().on(Startup).on(inp).sets(out).run(move |sleeps, ctx| {
            let count = ctx.get(inp).copied().unwrap_or(0);
            if count == 0 {
                *sleeps = -slept();
            }
            if count < ROUNDS {
                ctx.set(out, count + 1);
            } else {
                ctx.request_stop();
            }
        });
        says_how_it_waits(hub);
        (inp, out)
    });
    let (ball, back) = federation.reactor("node", 0, |node| {
        let (inp, out) = (node.input::<u64>("inp"), node.output("out"));
        node.reaction().on(inp).sets(out).run(move |sleeps, ctx| {
            let count = ctx.get(inp).copied().unwrap_or(0);
            if count == 1 {
                *sleeps = -slept();
            }
            ctx.set(out, count);
        });
        says_how_it_waits(node);
        (inp, out)
    });
    federation.connect(serve, ball);
    federation.connect(back, answer).after(Duration::ZERO);
    federation
}

/// How often this thread has left its processor because it had to wait for something.
fn slept() -> i64 {
    getrusage(UsageWho::RUSAGE_THREAD).unwrap().voluntary_context_switches()
}

/// At the end, `sleeps` becomes how often the federate slept during its rounds: then it is not negative.
fn says_how_it_waits(reactor: &mut ReactorBuilder<'_, i64>) {
    reactor.reaction().on(Shutdown).run(|sleeps, _| {
        *sleeps += slept();
        let often = *sleeps > (ROUNDS / 2) as i64;
        println!("{}", if often { "sleeps" } else { "polls" });
    });
}
