//! A camera and a planner on two machines: the same executable on both.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

fn main() -> Result<(), Failure> {
    let mut program = Federation::new("Machines").timeout(100 * MS);
    let output = program.reactor(Federate::new("camera").at("camera.local"), 0, |camera| {
        let tick = camera.timer("tick", Duration::ZERO, 50 * MS);
        let image = camera.output("image");
        camera.reaction().on(tick).sets(image).run(move |number, ctx| {
            let mut pixels = ctx.loan::<u8>(&[480, 640]);
            pixels.fill(*number);
            ctx.set(image, pixels.into());
            *number += 1;
        });
        image
    });
    let input = program.reactor(Federate::new("planner").at("robot.local"), (), |planner| {
        let image = planner.input::<Array<u8>>("image");
        planner.reaction().on(image).run(move |(), ctx| {
            if let Some(pixels) = ctx.get(image) {
                println!("{} ms: image {}", ctx.elapsed().as_millis(), pixels[0]);
            }
        });
        image
    });
    program.connect(output, input);
    program.run()
}
