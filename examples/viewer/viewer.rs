//! A viewer that joins, leaves, and joins again, while the camera runs.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

#[derive(Default)]
struct Camera {
    number: u32,
    visits: u32,
}

impl Reactor for Camera {
    type Ports = (InputPort<bool>, OutputPort<u32>);

    fn assemble(&mut self, camera: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (visit, frame) = (camera.input("visit"), camera.output("frame"));
        let tick = camera.timer("tick", Duration::ZERO, 20 * MS);
        camera.reaction().on(tick).sets(frame).run(move |camera, ctx| {
            ctx.set(frame, camera.number);
            camera.number += 1;
        });
        camera.reaction().on(visit).run(|camera, ctx| {
            camera.visits += 1;
            println!("visits: {}", camera.visits);
            if camera.visits == 2 {
                ctx.request_stop();
            }
        });
        (visit, frame)
    }
}

#[derive(Default)]
struct Viewer {
    seen: Vec<u32>,
}

impl Reactor for Viewer {
    type Ports = (InputPort<u32>, OutputPort<bool>);

    fn assemble(&mut self, viewer: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (frame, visit) = (viewer.input("frame"), viewer.output("visit"));
        viewer.reaction().on(Startup).run(|_, _| println!("joins"));
        viewer.reaction().on(frame).run(move |viewer, ctx| {
            viewer.seen.extend(ctx.get(frame));
            if viewer.seen.len() == 3 {
                ctx.leave();
            }
        });
        viewer.reaction().on(Shutdown).sets(visit).run(move |viewer, ctx| {
            let in_a_row: Vec<_> = viewer.seen.iter().map(|it| it - viewer.seen[0]).collect();
            println!("leaves, has seen {in_a_row:?}");
            ctx.set(visit, true);
        });
        (frame, visit)
    }
}

fn main() -> Result<(), Failure> {
    let mut program = Federation::new("Viewing").timeout(Duration::from_secs(60));
    let (count, frames) = program.add("camera", Camera::default());
    let (shown, visit) = program.add(Federate::new("viewer").transient(), Viewer::default());
    program.connect(frames, shown);
    program.connect(visit, count).after(10 * MS);
    program.run()
}
