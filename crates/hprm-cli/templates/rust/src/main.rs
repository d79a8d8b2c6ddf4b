//! The program; each of its reactors is a process: cargo run.

use std::time::Duration;

use hprm::prelude::*;
use new_project::{Display, Filter, Sensor};

fn main() -> Result<(), Failure> {
    let mut program = Federation::new("NewProject").timeout(Duration::from_secs(1));
    let readings = program.add("sensor", Sensor::default());
    let (reading, mean) = program.add(
        "filter",
        Filter {
            size: 3,
            last: Vec::new(),
        },
    );
    let means = program.add("display", Display);
    program.connect(readings, reading);
    program.connect(mean, means);
    program.run()
}
