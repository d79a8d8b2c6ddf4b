//! A motor that stops rather than follow a plan that is too late.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::thread;
use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

fn main() -> Result<(), Failure> {
    let mut program = Program::new("Late").timeout(1000 * MS);
    let target = program.reactor("planner", 0, |planner| {
        let tick = planner.timer("tick", Duration::ZERO, 500 * MS);
        let target = planner.output("target");
        planner.reaction().on(tick).sets(target).run(move |plans, ctx| {
            *plans += 1;
            if *plans == 2 {
                thread::sleep(450 * MS); // A plan that takes too long.
            }
            ctx.set(target, *plans);
        });
        target
    });
    let followed = program.reactor("motor", (), |motor| {
        let target = motor.input::<u32>("target");
        let plan = move |ctx: &Context<'_>| ctx.get(target).copied().unwrap_or_default();
        motor
            .reaction()
            .on(target)
            .deadline(400 * MS, move |(), ctx| println!("stops: plan {} is too late", plan(ctx)))
            .run(move |(), ctx| println!("follows plan {}", plan(ctx)));
        target
    });
    program.connect(target, followed);
    program.run()
}
