//! A planner and a motor that answer each other, with a delay in the cycle.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

fn main() -> Result<(), Failure> {
    let mut program = Program::new("Feedback").timeout(30 * MS);
    let (speed, target) = program.reactor("planner", (), |planner| {
        let speed = planner.input::<u32>("speed");
        let target = planner.output("target");
        planner.reaction().on(Startup).sets(target).run(move |(), ctx| ctx.set(target, 1));
        planner.reaction().on(speed).sets(target).run(move |(), ctx| {
            let Some(&speed) = ctx.get(speed) else { return };
            println!("the motor turns at {speed}");
            ctx.set(target, speed + 1);
        });
        (speed, target)
    });
    let (told, turns) = program.reactor("motor", (), |motor| {
        let target = motor.input::<u32>("target");
        let speed = motor.output("speed");
        motor.reaction().on(target).sets(speed).run(move |(), ctx| {
            if let Some(&target) = ctx.get(target) {
                ctx.set(speed, target);
            }
        });
        (target, speed)
    });
    program.connect(target, told);
    program.connect(turns, speed).after(10 * MS);
    program.run()
}
