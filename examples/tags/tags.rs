//! What is present at a tag, and what comes a microstep later.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

struct Ticker {
    period: Duration,
}

impl Reactor for Ticker {
    type Ports = OutputPort<bool>;

    fn assemble(&mut self, ticker: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let t = ticker.timer("t", Duration::ZERO, self.period);
        let tick = ticker.output("tick");
        ticker.reaction().on(t).sets(tick).run(move |_, ctx| ctx.set(tick, true));
        tick
    }
}

fn main() -> Result<(), Failure> {
    let mut program = Program::new("Tags").timeout(200 * MS);
    let fast = program.add("fast", Ticker { period: 100 * MS });
    let slow = program.add("slow", Ticker { period: 200 * MS });
    let watched = program.reactor("watcher", (), |watcher| {
        let names = ["fast", "slow", "echo"];
        let ports = names.map(|name| watcher.input::<bool>(name));
        watcher.reaction().on(ports).run(move |(), ctx| {
            let present: Vec<_> = ctx.present(&ports).map(|(index, _)| names[index]).collect();
            let tag = (ctx.elapsed().as_millis(), ctx.tag().microstep);
            println!("{tag:?} {}", present.join(" "));
        });
        ports
    });
    program.connect(fast, watched[0]);
    program.connect(slow, watched[1]);
    program.connect(slow, watched[2]).after(Duration::ZERO);
    program.run()
}
