//! A camera and a detector, each a process of this executable: the first program of the handbook.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

struct Camera;

impl Reactor for Camera {
    type Ports = OutputPort<Array<f64>>;

    fn assemble(&mut self, camera: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let image = camera.output("image");
        let t = camera.timer("t", Duration::ZERO, Duration::from_millis(100));
        camera.reaction().on(t).sets(image).run(move |_, ctx| {
            // In memory that the detector reads in place.
            let mut pixels = ctx.loan(&[1080, 1920, 3]);
            pixels.fill(0.5);
            ctx.set(image, pixels.into());
        });
        image
    }
}

fn main() -> Result<(), Failure> {
    let mut vision = Federation::new("Vision").timeout(Duration::from_millis(200));
    let output = vision.add("camera", Camera);
    // A reactor that is not worth a type: its state, and a closure that assembles it.
    let input = vision.reactor("detector", (), |detector| {
        let image = detector.input::<Array<f64>>("image");
        detector.reaction().on(image).run(move |(), ctx| {
            if let Some(pixels) = ctx.get(image) {
                let mean = pixels.iter().sum::<f64>() / pixels.len() as f64;
                println!("{} {mean}", ctx.elapsed().as_nanos());
            }
        });
        image
    });
    vision.connect(output, input);
    vision.run()
}
