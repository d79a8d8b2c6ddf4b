//! A camera that is a federate of a program in Lingua Franca or Python, which names this executable.
//!
//! The program states its ports and how fast it is; docs/howto/mixed.md has such programs.

use std::time::Duration;

use hprm::prelude::*;
use serde::Deserialize;

/// A camera; its fields are the parameters that the program states.
#[derive(Deserialize)]
struct Camera {
    /// Images in a second.
    #[serde(default = "hundred")]
    rate: u32,
}

fn hundred() -> u32 {
    100
}

impl Reactor for Camera {
    type Ports = (OutputPort<Array<f64>>, OutputPort<u32>);

    fn assemble(&mut self, camera: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (image, number) = (camera.output("image"), camera.output("number"));
        let tick = camera.timer("tick", Duration::ZERO, Duration::from_secs(1) / self.rate);
        let mut taken = 0;
        camera.reaction().on(tick).sets(image).sets(number).run(move |_, ctx| {
            // In memory that receivers read in place.
            let mut pixels = ctx.loan(&[480, 640]);
            pixels.fill(0.5);
            ctx.set(image, pixels.into());
            taken += 1;
            ctx.set(number, taken);
        });
        (image, number)
    }
}

fn main() -> Result<(), Failure> {
    run_as_federate_with("Camera", |camera: Camera| camera)
}
