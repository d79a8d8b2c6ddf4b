//! A sensor: a thread that schedules a physical action, and waits while too many of its readings wait for reactions.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::thread;
use std::time::Duration;

use hprm::prelude::*;

/// What the sensor measures.
#[derive(Clone, Copy)]
struct Reading {
    number: u32,
    celsius: f32,
}

/// Has a thread, which measures as quickly as it may.
struct Sensor;

impl Reactor for Sensor {
    type Ports = OutputPort<Reading>;

    fn assemble(&mut self, sensor: &mut ReactorBuilder<'_, Self>) -> OutputPort<Reading> {
        let measured = sensor.physical_action::<Reading>("measured", Duration::ZERO);
        // At most four readings wait. With `WhenFull::Refuse`, the thread would get an error instead.
        sensor.bound(measured, 4, WhenFull::Wait);
        let sender = sensor.sender(measured);
        let out = sensor.output("out");
        sensor.reaction().on(Startup).run(move |_, _| {
            let sender = sender.clone();
            thread::spawn(move || measure(&sender));
        });
        sensor.reaction().on(measured).sets(out).run(move |_, ctx| {
            if let Some(reading) = ctx.get(measured).copied() {
                ctx.set(out, reading);
            }
        });
        out
    }
}

/// Ends when the program has ended.
fn measure(sender: &Sender<Reading>) -> Result<(), ScheduleError> {
    for number in 0.. {
        let celsius = 20.0 + (number % 4) as f32;
        sender.schedule(Duration::ZERO, Reading { number, celsius })?;
    }
    Ok(())
}

fn main() -> Result<(), Failure> {
    // Without `keepalive`, the program would end before the first reading.
    let mut program = Program::new("Sensing").keepalive();
    let reading = program.add("sensor", Sensor);
    program.main().reaction().on(reading).run(move |(), ctx| {
        let Some(Reading { number, celsius }) = ctx.get(reading).copied() else { return };
        println!("reading {number}: {celsius} °C");
        if number == 4 {
            ctx.request_stop();
        }
    });
    program.run()
}
