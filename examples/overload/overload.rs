//! A camera that is faster than its viewers, and what each viewer gets of its frames.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::thread;
use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

/// Sees frames, and keeps their numbers.
struct Viewer {
    seen: Vec<u32>,
}

impl Reactor for Viewer {
    type Ports = InputPort<u32>;

    fn assemble(&mut self, viewer: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let frame = viewer.input("frame");
        viewer.reaction().on(Startup).run(|_, _| {
            thread::sleep(1000 * MS); // Busy, while ten frames arrive.
        });
        viewer.reaction().on(frame).run(move |viewer, ctx| viewer.seen.extend(ctx.get(frame)));
        viewer.reaction().on(Shutdown).run(|viewer, _| println!("frames {:?}", viewer.seen));
        frame
    }
}

fn main() -> Result<(), Failure> {
    let mut program = Federation::new("Overload").timeout(2000 * MS);
    let frame = program.reactor("camera", 0, |camera| {
        let tick = camera.timer("tick", Duration::ZERO, 10 * MS);
        let frame = camera.output("frame");
        camera.reaction().on(tick).sets(frame).run(move |number, ctx| {
            if *number < 10 {
                ctx.set(frame, *number);
                *number += 1;
            }
        });
        frame
    });
    let newest = program.add("newest", Viewer { seen: vec![] });
    let first = program.add("first", Viewer { seen: vec![] });
    let all = program.add("all", Viewer { seen: vec![] });
    program.connect(frame, newest).physical().bound(1, Overflow::Replace);
    program.connect(frame, first).physical().bound(3, Overflow::Drop);
    program.connect(frame, all);
    program.run()
}
