//! The reactors: a sensor, a filter and a display.

use std::time::Duration;

use hprm::prelude::*;

/// Stands for a sensor: each reading is one more than the last one.
#[derive(Default)]
pub struct Sensor {
    count: u32,
}

impl Reactor for Sensor {
    type Ports = OutputPort<u32>;

    fn assemble(&mut self, sensor: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let reading = sensor.output("reading");
        let t = sensor.timer("t", Duration::ZERO, Duration::from_millis(100));
        sensor
            .reaction()
            .on(t)
            .sets(reading)
            .run(move |sensor, ctx| {
                sensor.count += 1;
                ctx.set(reading, sensor.count);
            });
        reading
    }
}

/// The mean of the last `size` readings.
pub struct Filter {
    pub size: usize,
    pub last: Vec<u32>,
}

impl Reactor for Filter {
    type Ports = (InputPort<u32>, OutputPort<f64>);

    fn assemble(&mut self, filter: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (reading, mean) = (filter.input("reading"), filter.output("mean"));
        filter
            .reaction()
            .on(reading)
            .sets(mean)
            .run(move |filter, ctx| {
                filter.last.extend(ctx.get(reading));
                let start = filter.last.len().saturating_sub(filter.size);
                filter.last.drain(..start);
                ctx.set(
                    mean,
                    f64::from(filter.last.iter().sum::<u32>()) / filter.last.len() as f64,
                );
            });
        (reading, mean)
    }
}

/// Prints each mean, and the logical time at which it was calculated.
pub struct Display;

impl Reactor for Display {
    type Ports = InputPort<f64>;

    fn assemble(&mut self, display: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let mean = display.input("mean");
        display.reaction().on(mean).run(move |_, ctx| {
            if let Some(value) = ctx.get(mean) {
                println!("{} ms: {value:.1}", ctx.elapsed().as_millis());
            }
        });
        mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_filter_gives_the_mean_of_the_last_readings() -> Result<(), Failure> {
        // Without federates and `fast`, a program waits for nothing.
        let mut program = Program::new("Test").fast();
        let (reading, mean) = program.add(
            "filter",
            Filter {
                size: 2,
                last: Vec::new(),
            },
        );
        let mut main = program.main();
        let t = main.timer("t", Duration::ZERO, Duration::from_secs(3600));
        let mut readings = [4, 8, 20].into_iter();
        main.reaction()
            .on(t)
            .sets(reading)
            .run(move |(), ctx| match readings.next() {
                Some(value) => ctx.set(reading, value),
                None => ctx.request_stop(),
            });
        let mut means = [4.0, 6.0, 14.0].into_iter();
        main.reaction().on(mean).run(move |(), ctx| {
            assert_eq!(ctx.get(mean).copied(), means.next());
        });
        program.run()
    }
}
