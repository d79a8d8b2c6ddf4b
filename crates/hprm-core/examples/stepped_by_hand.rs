//! A thermostat as on a microcontroller: no operating system, no threads, and a main loop that gives the
//! scheduler the time of its clock.
//!
//! A timer reads the sensor every 10 ms, a controller compares the temperature with the one that is wanted, and
//! a heater is switched on or off, all at one tag. A button, of which an interrupt tells, raises the wanted
//! temperature by a degree. The part in `thermostat` needs the crates `core` and `alloc` and no more; `main`
//! stands for the hardware.
//!
//! ```text
//! cargo run -p hprm-core --example stepped_by_hand
//! ```

extern crate alloc;

mod thermostat {
    use alloc::sync::Arc;
    use alloc::vec;

    use hprm_core::{
        ActionId, Delay, Direction, Effect, Nanos, Origin, PhysicalTime, PortId, ProgramBuilder,
        ProgramError, Properties, ReactionId, ReactionSpec, Scheduler, Scope, Tag, Trigger,
    };

    const MILLISECOND: Nanos = 1_000_000;

    /// What the hardware does for the program. Temperatures are in tenths of a degree Celsius.
    pub(crate) trait Hardware {
        /// The time since it was switched on.
        fn now(&self) -> PhysicalTime;
        fn temperature(&self) -> i32;
        fn heat(&mut self, on: bool);
    }

    pub(crate) struct Thermostat {
        scheduler: Scheduler<i32>,
        parts: Parts,
        wanted: i32,
    }

    /// The parts of the program that bodies refer to.
    struct Parts {
        button: ActionId,
        measured: PortId,
        temperature: PortId,
        sense: ReactionId,
        adjust: ReactionId,
        control: ReactionId,
    }

    impl Thermostat {
        /// A thermostat that starts `now`.
        ///
        /// # Errors
        ///
        /// If the program is wrong: with parts that depend on one another in a cycle, for example.
        pub(crate) fn new(wanted: i32, now: PhysicalTime) -> Result<Self, ProgramError> {
            let mut b = ProgramBuilder::new("Thermostat", Properties::default());
            let [sensor, controller] =
                ["sensor", "controller"].map(|name| b.reactor(b.main(), name));
            let timer = b.timer(sensor, "every", 0, 10 * MILLISECOND);
            let measured = b.port(sensor, "measured", Direction::Output);
            let temperature = b.port(controller, "temperature", Direction::Input);
            let button = b.action(controller, "button", Origin::Physical, 0);
            b.connect(measured, temperature, Delay::None);
            let on = |trigger| ReactionSpec { triggers: vec![trigger], ..ReactionSpec::default() };
            let effects = vec![Effect::Port(measured)];
            let sense = b.reaction(sensor, ReactionSpec { effects, ..on(Trigger::Timer(timer)) });
            // Of two reactions of one reactor at one tag, the first in the text runs first.
            let adjust = b.reaction(controller, on(Trigger::Action(button)));
            let control = b.reaction(controller, on(Trigger::Port(temperature)));
            let mut scheduler = Scheduler::new(Arc::new(b.build()?), Scope::Whole);
            scheduler.start(now);
            let parts = Parts { button, measured, temperature, sense, adjust, control };
            Ok(Self { scheduler, parts, wanted })
        }

        /// The button was pressed `now`.
        pub(crate) fn pressed(&mut self, now: PhysicalTime) {
            self.scheduler.schedule(self.parts.button, 0, None, now);
        }

        /// Runs the next tag, if it is due. Returns when to call again at the latest.
        pub(crate) fn step(&mut self, hardware: &mut impl Hardware) -> PhysicalTime {
            let tag = self.scheduler.next_tag();
            if tag.due(self.scheduler.start_time()) <= hardware.now() {
                self.run(tag, hardware);
            }
            self.scheduler.next_tag().due(self.scheduler.start_time())
        }

        fn run(&mut self, tag: Tag, hardware: &mut impl Hardware) {
            let Self { scheduler, parts, wanted } = self;
            scheduler.begin(tag);
            while let Some((reaction, _)) = scheduler.next_reaction(hardware.now()) {
                if reaction == parts.sense {
                    scheduler.set(parts.measured, hardware.temperature());
                } else if reaction == parts.adjust {
                    *wanted += 10;
                } else if reaction == parts.control
                    && let Some(temperature) = scheduler.port(parts.temperature)
                {
                    hardware.heat(temperature < wanted);
                }
                scheduler.finish(reaction);
            }
            scheduler.end(hardware.now());
        }
    }
}

use hprm_core::PhysicalTime;
use thermostat::{Hardware, Thermostat};

/// A room with a heater, and a clock that a program can read but nothing else advances.
struct Room {
    now: PhysicalTime,
    temperature: i32,
    heats: bool,
    /// When the heater was switched, in milliseconds, and whether on.
    switched: Vec<(i64, bool)>,
}

impl Hardware for Room {
    fn now(&self) -> PhysicalTime {
        self.now
    }

    fn temperature(&self) -> i32 {
        self.temperature
    }

    fn heat(&mut self, on: bool) {
        if on != self.heats {
            self.heats = on;
            self.switched.push((self.now.0 / 1_000_000, on));
        }
    }
}

/// A tenth of a second in the room, in which the button is pressed once. Returns when the heater was switched.
fn run() -> Vec<(i64, bool)> {
    let mut room = Room { now: PhysicalTime(0), temperature: 195, heats: false, switched: vec![] };
    let mut thermostat = Thermostat::new(200, room.now).expect("the program is correct");
    for millisecond in 0..100 {
        room.now = PhysicalTime(millisecond * 1_000_000);
        if millisecond % 2 == 1 {
            room.temperature += if room.heats { 1 } else { -1 };
        }
        if millisecond == 35 {
            thermostat.pressed(room.now);
        }
        // As long as something is due; on a microcontroller, the loop would sleep until then, or until an
        // interrupt.
        while thermostat.step(&mut room) <= room.now {}
    }
    room.switched
}

#[allow(clippy::print_stdout)]
fn main() {
    for (millisecond, on) in run() {
        println!("{millisecond:3} ms: the heater is {}", if on { "on" } else { "off" });
    }
}

#[test]
fn the_heater_is_switched_when_the_temperature_is_measured() {
    let to_20 = [(0, true), (10, false), (20, true), (30, false)];
    // From 35 ms on, the room is to be a degree warmer.
    let to_21 = [(40, true), (70, false), (80, true), (90, false)];
    assert_eq!(run(), [to_20, to_21].concat());
}
