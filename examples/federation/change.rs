//! A painter that changes a copy of the image that it gets.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

fn main() -> Result<(), Failure> {
    let mut program = Federation::new("Change").timeout(Duration::ZERO);
    let output = program.reactor("camera", (), |camera| {
        let image = camera.output("image");
        camera.reaction().on(Startup).sets(image).run(move |(), ctx| {
            let mut pixels = ctx.loan::<f64>(&[1080, 1920]);
            pixels.fill(0.0);
            ctx.set(image, pixels.into());
        });
        image
    });
    let input = program.reactor("painter", (), |painter| {
        let image = painter.input::<Array<f64>>("image");
        painter.reaction().on(image).run(move |(), ctx| {
            if let Some(pixels) = ctx.get(image) {
                let mut painted = pixels.to_vec();
                painted[0] = 1.0;
                println!("sum: {:.1}", painted.iter().sum::<f64>());
            }
        });
        image
    });
    program.connect(output, input);
    program.run()
}
