//! A counter and an adder: ports, state, parameters and a connection.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

/// Counts up at each period.
struct Counter {
    next: u32,
    period: Duration,
}

impl Reactor for Counter {
    type Ports = OutputPort<u32>;

    fn assemble(&mut self, counter: &mut ReactorBuilder<'_, Self>) -> OutputPort<u32> {
        let tick = counter.timer("tick", Duration::ZERO, self.period);
        let count = counter.output("count");
        counter.reaction().on(tick).sets(count).run(move |counter, ctx| {
            ctx.set(count, counter.next);
            counter.next += 1;
        });
        count
    }
}

fn main() -> Result<(), Failure> {
    let mut program = Program::new("Counting").timeout(Duration::from_millis(200));
    let count = program.add("counter", Counter { next: 1, period: Duration::from_millis(100) });
    // A reactor that is not worth a type: its state, and a closure that assembles it.
    let number = program.reactor("adder", 0, |adder| {
        let number = adder.input("number");
        adder.reaction().on(number).run(move |sum, ctx| {
            *sum += ctx.get(number).unwrap_or(&0);
            println!("{} ms: {sum}", ctx.elapsed().as_millis());
        });
        number
    });
    program.connect(count, number);
    program.run()
}
