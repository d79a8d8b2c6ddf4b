//! A deadline, and an error that ends the program: it is told with the reaction, its tag and its cause.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::num::ParseIntError;
use std::time::Duration;

use hprm::prelude::*;

const LINES: [&str; 3] = ["12", "30", "many"];

fn main() -> Result<(), Failure> {
    let mut program = Program::new("Parsing").fast();
    let line = program.reactor("reader", LINES.into_iter(), |reader| {
        let next = reader.timer("next", Duration::ZERO, Duration::from_millis(5));
        let line = reader.output("line");
        reader.reaction().on(next).sets(line).run(move |lines, ctx| match lines.next() {
            Some(text) => ctx.set(line, text),
            None => ctx.request_stop(),
        });
        line
    });
    let inp = program.reactor("parser", (), |parser| {
        let inp = parser.input::<&str>("line");
        parser
            .reaction()
            .on(inp)
            // A fast program does not wait for physical time, so it is in time.
            .deadline(Duration::from_secs(60), |(), ctx| println!("late by {:?}", ctx.lag()))
            .run(move |(), ctx| -> Result<(), ParseIntError> {
                if let Some(line) = ctx.get(inp) {
                    let number: u8 = line.parse()?;
                    println!("{:?}: {number}", ctx.elapsed());
                }
                Ok(())
            });
        inp
    });
    program.connect(line, inp);
    if let Err(failure) = program.run() {
        println!("error: {failure:?}");
    }
    Ok(())
}
