//! A watchdog: it raises an alarm when no heartbeat has come for 100 ms. `cargo test --example watchdog` tests it.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

struct Watchdog {
    beats: u32,
}

impl Reactor for Watchdog {
    type Ports = (InputPort<u32>, OutputPort<u32>);

    fn assemble(&mut self, watchdog: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (heartbeat, alarm) = (watchdog.input("heartbeat"), watchdog.output("alarm"));
        let expired = watchdog.logical_action("expired", 100 * MS);
        watchdog.reaction().on(heartbeat).schedules(expired).run(move |watchdog, ctx| {
            watchdog.beats += 1;
            ctx.schedule(expired, Duration::ZERO, watchdog.beats);
        });
        watchdog.reaction().on(expired).sets(alarm).run(move |watchdog, ctx| {
            // No heartbeat since.
            if ctx.get(expired) == Some(&watchdog.beats) {
                ctx.set(alarm, watchdog.beats);
            }
        });
        (heartbeat, alarm)
    }
}

/// Heartbeats at some times, and when the alarms come, in virtual time.
fn alarms(beats: &'static [u32]) -> Result<Vec<u128>, Failure> {
    let (noted, alarms) = std::sync::mpsc::channel();
    let mut program = Program::new("Test").fast().timeout(1000 * MS);
    let (heartbeat, alarm) = program.add("watchdog", Watchdog { beats: 0 });
    let mut main = program.main();
    let beat = main.logical_action("beat", Duration::ZERO);
    main.reaction().on(Startup).schedules(beat).run(move |(), ctx| {
        for &time in beats {
            ctx.schedule(beat, time * MS, time);
        }
    });
    main.reaction().on(beat).sets(heartbeat).run(move |(), ctx| {
        ctx.set(heartbeat, ctx.get(beat).copied().unwrap_or_default());
    });
    main.reaction().on(alarm).run(move |(), ctx| {
        let _ = noted.send(ctx.elapsed().as_millis());
    });
    program.run()?;
    Ok(alarms.try_iter().collect())
}

fn main() -> Result<(), Failure> {
    println!("alarms at {:?} ms", alarms(&[0, 60, 120])?);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::alarms;

    #[test]
    fn an_alarm_follows_the_last_heartbeat() {
        assert_eq!(alarms(&[0, 60, 120]).unwrap(), [220]);
    }

    #[test]
    fn each_long_gap_raises_one_alarm() {
        assert_eq!(alarms(&[0, 100, 201, 500]).unwrap(), [200, 301, 600]);
    }
}
