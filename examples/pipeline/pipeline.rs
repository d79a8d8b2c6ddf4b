//! A pipeline of four federates, with feedback and a deadline.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::thread;
use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

/// Counts its frames.
struct Camera {
    number: i32,
}

impl Reactor for Camera {
    type Ports = OutputPort<i32>;

    fn assemble(&mut self, camera: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let tick = camera.timer("tick", Duration::ZERO, 1000 * MS);
        let frame = camera.output("frame");
        camera.reaction().on(tick).sets(frame).run(move |camera, ctx| {
            ctx.set(frame, camera.number);
            camera.number += 1;
        });
        frame
    }
}

/// Finds the distance to an obstacle.
struct Detector;

impl Reactor for Detector {
    type Ports = (InputPort<i32>, OutputPort<i32>);

    fn assemble(&mut self, detector: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (frame, distance) = (detector.input("frame"), detector.output("distance"));
        detector.reaction().on(frame).sets(distance).run(move |_, ctx| {
            if let Some(number) = ctx.get(frame) {
                ctx.set(distance, 10 - number);
            }
        });
        (frame, distance)
    }
}

/// Knows the speed that the motor had last.
struct Planner {
    speed: i32,
}

struct PlannerPorts {
    distance: InputPort<i32>,
    speed: InputPort<i32>,
    target: OutputPort<i32>,
}

impl Reactor for Planner {
    type Ports = PlannerPorts;

    fn assemble(&mut self, planner: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let distance = planner.input::<i32>("distance");
        let speed = planner.input("speed");
        let target = planner.output("target");
        planner.reaction().on(speed).run(move |planner, ctx| {
            planner.speed = ctx.get(speed).copied().unwrap_or_default();
        });
        planner.reaction().on(distance).sets(target).run(move |planner, ctx| {
            let Some(&distance) = ctx.get(distance) else { return };
            if distance == 8 {
                thread::sleep(950 * MS); // A plan that takes too long.
            }
            ctx.set(target, distance.min(planner.speed + 2));
        });
        PlannerPorts { distance, speed, target }
    }
}

/// Drives at the speed that it is told, and tells it.
struct Motor;

impl Reactor for Motor {
    type Ports = (InputPort<i32>, OutputPort<i32>);

    fn assemble(&mut self, motor: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (target, speed) = (motor.input("target"), motor.output("speed"));
        let too_late = move |_: &mut Self, ctx: &mut Context<'_>| {
            println!("too late: stop");
            ctx.set(speed, 0);
        };
        motor.reaction().on(target).sets(speed).deadline(800 * MS, too_late).run(move |_, ctx| {
            let Some(&target) = ctx.get(target) else { return };
            println!("drive at {target}");
            ctx.set(speed, target);
        });
        (target, speed)
    }
}

fn main() -> Result<(), Failure> {
    let mut pipeline = Federation::new("Pipeline").timeout(3000 * MS);
    let frame = pipeline.add("camera", Camera { number: 0 });
    let (seen, distance) = pipeline.add("detector", Detector);
    let planner = pipeline.add("planner", Planner { speed: 0 });
    let (target, speed) = pipeline.add("motor", Motor);
    pipeline.connect(frame, seen);
    pipeline.connect(distance, planner.distance);
    pipeline.connect(planner.target, target);
    pipeline.connect(speed, planner.speed).after(10 * MS);
    pipeline.run()
}
