//! What is opened at the start and closed at the end.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

fn main() -> Result<(), Failure> {
    let mut program = Program::new("Device").timeout(Duration::from_millis(100));
    let mut main = program.main();
    main.reaction().on(Startup).run(|(), _| println!("open"));
    main.reaction().on(Shutdown).run(|(), _| println!("close"));
    program.run()
}
