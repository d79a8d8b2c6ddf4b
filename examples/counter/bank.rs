//! A bank of three cameras, and a multiport with a channel for each.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

struct Camera {
    index: usize,
}

impl Reactor for Camera {
    type Ports = OutputPort<String>;

    fn assemble(&mut self, camera: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let image = camera.output("image");
        camera.reaction().on(Startup).sets(image).run(move |camera, ctx| {
            if camera.index != 1 {
                ctx.set(image, format!("image of camera {}", camera.index));
            }
        });
        image
    }
}

fn main() -> Result<(), Failure> {
    let mut program = Program::new("Bank").timeout(Duration::ZERO);
    let outputs = program.bank("cameras", (0..3).map(|index| Camera { index }));
    let inputs = program.reactor("fusion", (), |fusion| {
        let images = fusion.inputs::<String>("images", 3);
        let channels = images.clone();
        fusion.reaction().on(&images).run(move |(), ctx| {
            for (index, image) in channels.iter().enumerate() {
                println!("{index} {}", ctx.get(*image).map_or("is absent", String::as_str));
            }
        });
        images
    });
    program.connect_each(outputs, inputs);
    program.run()
}
