//! A timer says hello.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

fn main() -> Result<(), Failure> {
    let mut program = Program::new("Hello").timeout(200 * MS);
    let mut main = program.main();
    let tick = main.timer("tick", Duration::ZERO, 100 * MS);
    main.reaction().on(tick).run(|(), ctx| println!("{} ms: hello", ctx.elapsed().as_millis()));
    program.run()
}
