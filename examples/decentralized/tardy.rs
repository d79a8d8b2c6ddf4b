//! A control loop that does not wait for frames, and a frame that is tardy.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::thread;
use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

fn main() -> Result<(), Failure> {
    let mut program = Federation::new("Tardy").decentralized().timeout(2000 * MS);
    let frame = program.reactor("camera", 0, |camera| {
        let tick = camera.timer("tick", Duration::ZERO, 1000 * MS);
        let frame = camera.output("frame");
        camera.reaction().on(tick).sets(frame).run(move |number, ctx| {
            if *number == 1 {
                thread::sleep(800 * MS); // This frame comes late.
            }
            ctx.set(frame, *number);
            *number += 1;
        });
        frame
    });
    let motor = Federate::new("motor").maxwait(Duration::ZERO);
    let received = program.reactor(motor, (), |motor| {
        let control = motor.timer("control", Duration::ZERO, 1000 * MS);
        let frame = motor.input::<u32>("frame");
        motor.reaction().on(control).run(|(), ctx| {
            println!("control at {} ms", ctx.elapsed().as_millis());
        });
        let number = move |ctx: &Context<'_>| ctx.get(frame).copied().unwrap_or_default();
        motor
            .reaction()
            .on(frame)
            .tardy(move |(), ctx| println!("frame {} is tardy", number(ctx)))
            .run(move |(), ctx| println!("frame {}", number(ctx)));
        frame
    });
    program.connect(frame, received).absent_after(600 * MS);
    program.run()
}
