//! Three cameras, and a federate that fuses their images.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

/// Takes an image of every so many frames.
struct Camera {
    number: u8,
    every: u32,
    frame: u32,
}

impl Reactor for Camera {
    type Ports = OutputPort<Array<u8>>;

    fn assemble(&mut self, camera: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let tick = camera.timer("tick", Duration::ZERO, 50 * MS);
        let image = camera.output("image");
        camera.reaction().on(tick).sets(image).run(move |camera, ctx| {
            if camera.frame.is_multiple_of(camera.every) {
                let mut pixels = ctx.loan(&[480, 640]);
                pixels.fill(camera.number);
                ctx.set(image, pixels.into());
            }
            camera.frame += 1;
        });
        image
    }
}

fn main() -> Result<(), Failure> {
    let mut program = Federation::new("Cameras").timeout(100 * MS);
    let cameras = (1..).zip([1, 1, 2]).map(|(number, every)| Camera { number, every, frame: 0 });
    let outputs = program.bank("cameras", cameras);
    let inputs = program.reactor("fusion", (), |fusion| {
        let images = fusion.inputs::<Array<u8>>("images", 3);
        let all = images.clone();
        fusion.reaction().on(&images).run(move |(), ctx| {
            let seen: Vec<_> = ctx.present(&all).map(|(_, pixels)| pixels[0]).collect();
            println!("{} ms: images {seen:?}", ctx.elapsed().as_millis());
        });
        images
    });
    program.connect_each(outputs, inputs);
    program.run()
}
