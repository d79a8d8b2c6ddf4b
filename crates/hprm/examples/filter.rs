//! Reactors inside a reactor, and generics: a filter for values of any type that can be averaged, made of a delay and a
//! mean.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::ops::{Add, Div};
use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

/// What the filter can average.
trait Sample: Message + Copy + Default + Add<Output = Self> + Div<Self, Output = Self> {
    const TWO: Self;
}

impl Sample for f64 {
    const TWO: Self = 2.0;
}

impl Sample for i32 {
    const TWO: Self = 2;
}

/// The mean of the values at two inputs.
struct Mean<T> {
    last: [T; 2],
}

impl<T: Sample> Reactor for Mean<T> {
    type Ports = ([InputPort<T>; 2], OutputPort<T>);

    fn assemble(&mut self, mean: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (inputs, out) = ([mean.input("a"), mean.input("b")], mean.output("out"));
        mean.reaction().on(inputs).sets(out).run(move |mean, ctx| {
            for (index, value) in ctx.present(&inputs) {
                mean.last[index] = *value;
            }
            let [a, b] = mean.last;
            ctx.set(out, (a + b) / T::TWO);
        });
        (inputs, out)
    }
}

/// The mean of a value and of the one before it.
struct Filter<T> {
    before: T,
    period: Duration,
}

impl<T: Sample> Reactor for Filter<T> {
    type Ports = (InputPort<T>, OutputPort<T>);

    fn assemble(&mut self, filter: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (inp, out) = (filter.input("inp"), filter.output("out"));
        let ([now, before], mean) = filter.add("mean", Mean { last: [self.before; 2] });
        filter.connect(inp, now);
        filter.connect(inp, before).after(self.period);
        filter.connect(mean, out);
        (inp, out)
    }
}

/// A source of such values, a filter, and a printer.
fn filtered<T: Sample + std::fmt::Debug>(program: &mut Program, name: &str, values: [T; 4]) {
    let source = format!("{name}_source");
    let out = program.reactor(&source, values.into_iter(), |source| {
        let tick = source.timer("tick", Duration::ZERO, MS);
        let out = source.output("out");
        source.reaction().on(tick).sets(out).run(move |values, ctx| match values.next() {
            Some(value) => ctx.set(out, value),
            None => ctx.request_stop(),
        });
        out
    });
    let (inp, mean) = program.add(name, Filter { before: T::default(), period: MS });
    program.connect(out, inp);
    let name = name.to_owned();
    program.main().reaction().on(mean).run(move |(), ctx| {
        println!("{:?}: {name} {:?}", ctx.elapsed(), ctx.get(mean));
    });
}

fn main() -> Result<(), Failure> {
    let mut program = Program::new("Filters").fast();
    filtered(&mut program, "coarse", [10, 20, 40, 80]);
    filtered(&mut program, "fine", [1.0, 2.0, 4.0, 8.0]);
    program.run()
}
