//! A counter and an adder: the program of the README.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

/// Counts up at each period.
struct Counter {
    count: u32,
    period: Duration,
}

impl Reactor for Counter {
    type Ports = OutputPort<u32>;

    fn assemble(&mut self, counter: &mut ReactorBuilder<'_, Self>) -> OutputPort<u32> {
        let tick = counter.timer("tick", Duration::ZERO, self.period);
        let out = counter.output("out");
        counter.reaction().on(tick).sets(out).run(move |counter, ctx| {
            counter.count += 1;
            ctx.set(out, counter.count);
        });
        out
    }
}

fn main() -> Result<(), Failure> {
    let mut program = Program::new("Counting").timeout(Duration::from_millis(200));
    let count = program.add("counter", Counter { count: 0, period: Duration::from_millis(100) });
    // A reactor that is not worth a type: its state, and a closure that assembles it.
    let number = program.reactor("adder", 0, |adder| {
        let number = adder.input("number");
        adder.reaction().on(number).run(move |sum, ctx| {
            *sum += ctx.get(number).unwrap_or(&0);
            println!("{:?}: {sum}", ctx.elapsed());
        });
        number
    });
    program.connect(count, number);
    program.run()
}
