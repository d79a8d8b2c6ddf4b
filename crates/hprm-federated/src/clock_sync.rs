//! How far a federate's clock is from the RTI's, and how sure that is.
//!
//! The federate asks, the RTI answers with the readings of its clock. However long the question and the
//! answer took, the answer was sent before it arrived and the question arrived after it was sent;
//! so an exchange tells two bounds of the offset between the clocks, which are as far apart as the
//! round trip took. Bounds of several exchanges are intersected, and grow apart by as much as clocks
//! may drift. So they hold, provided only that no clock drifts more than [`DRIFT`] against another.
//!
//! Here is the federate's side; the RTI only reads its clock twice.

use hprm_core::{ClockSyncMode, ClockSyncOptions, Nanos, PhysicalTime};

use crate::slewed::part;
use crate::{Frame, SlewedClock};

/// The most that two clocks drift apart, in billionths: twice what bad oscillators are made for.
pub const DRIFT: i64 = 500_000;

/// How much later a comparison must be to estimate the drift.
const BASELINE: Nanos = 1_000_000_000;

/// After how long the drift is estimated again: it changes with the temperature.
const MEMORY: Nanos = 60_000_000_000;

/// The shortest time between two questions.
const LEAST_PERIOD: Nanos = 1_000_000;

/// Bounds of the RTI's time minus the local one, at some local time.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
struct Bounds {
    at: PhysicalTime,
    least: Nanos,
    most: Nanos,
}

/// How far apart two clocks are.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Estimate {
    /// The RTI's time minus the local one.
    pub offset: Nanos,
    /// By how much that may be wrong.
    pub error: Nanos,
    /// How fast the RTI's clock gains on the local one, in billionths.
    pub drift: i64,
}

/// What to do to a clock.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Correction {
    /// Before the federate relies on the clock.
    Step {
        /// The RTI's time minus the local one.
        offset: Nanos,
    },
    /// From then on.
    Steer {
        /// The same.
        offset: Nanos,
        /// How fast it grows, in billionths.
        drift: i64,
        /// Within what time the clock reaches that offset.
        within: Nanos,
    },
}

/// A federate's side of clock synchronization. All times are those of the local clock.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct ClockSync {
    options: ClockSyncOptions,
    bounds: Option<Bounds>,
    /// An earlier comparison, which tells the drift together with a later one.
    anchor: Option<Bounds>,
    drift: i64,
    /// By how much that may be wrong.
    drift_error: i64,
    /// The question that has no answer yet.
    asked: Option<PhysicalTime>,
    /// When to ask next; none, when nothing more is to be asked.
    next: Option<PhysicalTime>,
    /// Comparisons since the last correction.
    trials: u32,
    settled: bool,
}

impl ClockSync {
    /// A federate that has compared nothing yet; it is `local` time. With `clock-sync: off` it never
    /// will.
    #[must_use]
    pub fn new(options: ClockSyncOptions, local: PhysicalTime) -> Self {
        let off = options.mode == ClockSyncMode::Off;
        Self {
            options,
            bounds: None,
            anchor: None,
            drift: 0,
            drift_error: DRIFT,
            asked: None,
            next: (!off).then_some(local),
            trials: 0,
            settled: off,
        }
    }

    /// Whether the clock is good enough to start with.
    #[must_use]
    pub fn is_settled(&self) -> bool {
        self.settled
    }

    /// When [`Self::ask`] has a question.
    #[must_use]
    pub fn next_wakeup(&self) -> Option<PhysicalTime> {
        self.next
    }

    /// The question for the RTI, if it is time for one.
    pub fn ask(&mut self, local: PhysicalTime) -> Option<Frame> {
        if self.next.is_none_or(|next| local < next) {
            return None;
        }
        self.next = None;
        self.asked = Some(local);
        Some(Frame::ClockRequest { asked: local })
    }

    /// An answer, which arrived at the `local` time. An answer without a question is ignored.
    /// Returns how to correct the clock, if enough is known for that.
    pub fn answered(
        &mut self,
        local: PhysicalTime,
        asked: PhysicalTime,
        received: PhysicalTime,
        sent: PhysicalTime,
    ) -> Option<Correction> {
        self.asked.take_if(|question| *question == asked)?;
        let took = local.since(asked).max(0);
        let fresh = Bounds {
            at: local,
            least: sent.since(local),
            // It was true when the question was asked, and that is a while ago.
            most: received.since(asked).saturating_add(drifted(took)),
        };
        self.learn(fresh);
        self.trials += 1;
        let enough = self.trials >= self.options.trials.max(1);
        let pause = if self.settled { self.options.period.max(LEAST_PERIOD) } else { 0 };
        self.next = Some(local.plus(pause));
        if !enough {
            return None;
        }
        self.trials = 0;
        let Estimate { offset, drift, .. } = self.estimate(local)?;
        if !std::mem::replace(&mut self.settled, true) {
            self.next = (self.options.mode == ClockSyncMode::On)
                .then(|| local.plus(self.options.period.max(LEAST_PERIOD)));
            return Some(Correction::Step { offset });
        }
        let round = pause.saturating_mul(i64::from(self.options.trials.max(1)));
        let within = round.saturating_mul(i64::from(self.options.attenuation.max(1)));
        Some(Correction::Steer { offset, drift, within })
    }

    /// How far apart the clocks are at a local time that is not in the past.
    #[must_use]
    pub fn estimate(&self, local: PhysicalTime) -> Option<Estimate> {
        let Bounds { least, most, .. } = self.bounds?.widened(local);
        let width = i128::from(most) - i128::from(least);
        let half = i64::try_from(width / 2).unwrap_or(i64::MAX);
        let offset = least.saturating_add(half);
        Some(Estimate { offset, error: most.saturating_sub(offset), drift: self.drift })
    }

    /// By how much a clock that follows the corrections may differ from the RTI's.
    #[must_use]
    pub fn error(&self, clock: &SlewedClock, local: PhysicalTime) -> Option<Nanos> {
        let Bounds { least, most, .. } = self.bounds?.widened(local);
        let offset = clock.offset_at(local);
        Some(offset.saturating_sub(least).max(most.saturating_sub(offset)))
    }

    fn learn(&mut self, fresh: Bounds) {
        let known = self.bounds.map(|bounds| bounds.widened(fresh.at));
        let both = known.map(|known| Bounds {
            at: fresh.at,
            least: known.least.max(fresh.least),
            most: known.most.min(fresh.most),
        });
        match both.filter(|both| both.least <= both.most) {
            Some(both) => self.bounds = Some(both),
            None => {
                // The first one, or a clock has been set: older bounds are worthless.
                self.bounds = Some(fresh);
                self.anchor = None;
                (self.drift, self.drift_error) = (0, DRIFT);
            }
        }
        self.learn_drift(fresh);
    }

    fn learn_drift(&mut self, fresh: Bounds) {
        let Some(anchor) = self.anchor else {
            self.anchor = Some(fresh);
            return;
        };
        let apart = fresh.at.since(anchor.at);
        if apart >= BASELINE {
            let between = i128::from(apart);
            let per =
                |nanos: i128| i64::try_from(nanos * 1_000_000_000 / between).unwrap_or(i64::MAX);
            let middle = |b: Bounds| i128::from(b.least) + i128::from(b.most);
            let width = |b: Bounds| i128::from(b.most) - i128::from(b.least);
            let drift = per((middle(fresh) - middle(anchor)) / 2).clamp(-DRIFT, DRIFT);
            let error = per((width(fresh) + width(anchor)) / 2);
            if error < self.drift_error {
                (self.drift, self.drift_error) = (drift, error);
            }
        }
        let width = |b: Bounds| b.most.saturating_sub(b.least);
        if apart >= MEMORY {
            self.drift_error = DRIFT;
            self.anchor = Some(fresh);
        } else if width(fresh) < width(anchor) / 2 {
            self.anchor = Some(fresh);
        }
    }
}

impl Bounds {
    fn widened(self, at: PhysicalTime) -> Self {
        let drifted = drifted(at.since(self.at).max(0));
        Self {
            at,
            least: self.least.saturating_sub(drifted),
            most: self.most.saturating_add(drifted),
        }
    }
}

/// How far clocks drift apart in that time, at most.
fn drifted(time: Nanos) -> Nanos {
    part(time, DRIFT).saturating_add(1)
}

impl SlewedClock {
    /// Carries out a correction.
    pub fn correct(&mut self, local: PhysicalTime, correction: Correction) {
        match correction {
            Correction::Step { offset } => self.step(local, offset),
            Correction::Steer { offset, drift, within } => {
                self.steer(local, offset, drift, within);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Two clocks: the RTI's is right, the local one is not.
    #[derive(Clone, Copy, Debug)]
    struct Truth {
        ahead: i64,
        drift: i64,
    }

    impl Truth {
        fn local(self, real: i64) -> PhysicalTime {
            PhysicalTime(real + self.ahead + part(real, self.drift))
        }

        /// When the local clock shows `local`, or just after.
        fn real(self, local: PhysicalTime) -> i64 {
            let mut real = local.0 - self.ahead;
            real -= part(real, self.drift);
            while self.local(real) < local {
                real += 1;
            }
            real
        }
    }

    /// A federate in a simulated world, where the test says how long every message takes.
    struct World {
        truth: Truth,
        sync: ClockSync,
        clock: SlewedClock,
        real: i64,
        shown: Option<PhysicalTime>,
    }

    impl World {
        fn new(truth: Truth, options: ClockSyncOptions) -> Self {
            let sync = ClockSync::new(options, truth.local(0));
            Self { truth, sync, clock: SlewedClock::new(), real: 0, shown: None }
        }

        /// One exchange. Checks what is promised, all the way.
        fn exchange(&mut self, there: i64, at_rti: i64, back: i64) -> Option<Correction> {
            let wakeup = self.sync.next_wakeup().expect("it wants to ask");
            self.pass(self.truth.real(wakeup).max(self.real) - self.real);
            let asked = self.truth.local(self.real);
            let question = self.sync.ask(asked).expect("it is time");
            assert_eq!(question, Frame::ClockRequest { asked });
            self.pass(there);
            let received = PhysicalTime(self.real);
            self.pass(at_rti);
            let sent = PhysicalTime(self.real);
            self.pass(back);
            let local = self.truth.local(self.real);
            let correction = self.sync.answered(local, asked, received, sent);
            if let Some(correction) = correction {
                self.clock.correct(local, correction);
            }
            self.check();
            correction
        }

        fn pass(&mut self, time: i64) {
            for piece in [time / 2, time - time / 2] {
                self.real += piece;
                self.check();
            }
        }

        fn check(&mut self) {
            let local = self.truth.local(self.real);
            if let Some(Estimate { offset, error, .. }) = self.sync.estimate(local) {
                let wrong = self.real - local.0 - offset;
                assert!(wrong.abs() <= error, "{offset} is wrong by {wrong}, more than {error}");
            }
            if !self.sync.is_settled() {
                return;
            }
            let shown = self.clock.at(local);
            assert!(self.shown.is_none_or(|before| shown >= before), "it goes back");
            self.shown = Some(shown);
            let error = self.sync.error(&self.clock, local).expect("it is settled");
            let wrong = shown.0 - self.real;
            assert!(wrong.abs() <= error, "the clock is wrong by {wrong}, more than {error}");
        }
    }

    fn on() -> ClockSyncOptions {
        ClockSyncOptions { mode: ClockSyncMode::On, ..ClockSyncOptions::default() }
    }

    #[test]
    fn off_is_settled_and_asks_nothing() {
        let options = ClockSyncOptions { mode: ClockSyncMode::Off, ..on() };
        let mut sync = ClockSync::new(options, PhysicalTime(5));
        assert!(sync.is_settled());
        assert_eq!(sync.ask(PhysicalTime(9)), None);
    }

    #[test]
    fn init_steps_once_and_asks_no_more() {
        let options = ClockSyncOptions { mode: ClockSyncMode::Init, ..on() };
        let mut world = World::new(Truth { ahead: 7_000_000_000, drift: 0 }, options);
        for _ in 1..options.trials {
            assert_eq!(world.exchange(1_000, 10, 1_000), None);
            assert!(!world.sync.is_settled());
        }
        let correction = world.exchange(1_000, 10, 1_000).unwrap();
        let Correction::Step { offset } = correction else { panic!("{correction:?}") };
        assert!((offset + 7_000_000_000).abs() <= 1_010, "{offset}");
        assert_eq!(world.sync.next_wakeup(), None);
        // An hour later it is less sure, and still right.
        world.pass(3_600_000_000_000);
    }

    #[test]
    fn an_answer_to_another_question_is_nothing() {
        let mut sync = ClockSync::new(on(), PhysicalTime(0));
        let at = PhysicalTime;
        assert_eq!(sync.answered(at(5), at(0), at(0), at(0)), None);
        sync.ask(at(10)).unwrap();
        assert_eq!(sync.answered(at(20), at(9), at(0), at(0)), None);
        assert_eq!(sync.estimate(at(20)), None);
        sync.answered(at(20), at(10), at(15), at(15));
        assert!(sync.estimate(at(20)).is_some());
    }

    #[test]
    fn the_error_is_half_the_best_round_trip_and_what_has_drifted_since() {
        let mut world = World::new(Truth { ahead: 0, drift: 0 }, on());
        world.exchange(4_000_000, 0, 4_000_000);
        world.exchange(100_000, 0, 300_000);
        let Estimate { error, .. } = world.sync.estimate(world.truth.local(world.real)).unwrap();
        // The drift is counted over the round trip, too.
        assert!((200_000..200_500).contains(&error), "{error}");
    }

    #[test]
    fn clocks_drift_while_an_answer_is_on_its_way() {
        let mut world = World::new(Truth { ahead: 0, drift: -200_000 }, on());
        world.exchange(0, 0, 1_000_000_000);
    }

    #[test]
    fn drift_is_found_and_followed() {
        let mut world = World::new(Truth { ahead: -3_000_000, drift: 200_000 }, on());
        for _ in 0..4_000 {
            world.exchange(50_000, 1_000, 60_000);
        }
        let local = world.truth.local(world.real);
        let Estimate { drift, .. } = world.sync.estimate(local).unwrap();
        assert!((drift + 200_000).abs() < 10_000, "{drift}");
        let error = world.sync.error(&world.clock, local).unwrap();
        assert!(error < 200_000, "{error}");
    }

    #[test]
    fn a_clock_that_is_set_is_noticed() {
        let mut world = World::new(Truth { ahead: 0, drift: 0 }, on());
        for _ in 0..10 {
            world.exchange(1_000, 0, 1_000);
        }
        world.truth.ahead = 5_000_000_000;
        world.shown = None;
        // Until the next answer the federate cannot know.
        let asked = world.sync.next_wakeup().unwrap().plus(5_000_000_000);
        world.sync.ask(asked).unwrap();
        world.real = world.truth.real(asked) + 2_000;
        let sent = PhysicalTime(world.real - 1_000);
        let local = world.truth.local(world.real);
        world.sync.answered(local, asked, sent, sent);
        let Estimate { offset, .. } = world.sync.estimate(local).unwrap();
        assert!((offset + 5_000_000_000).abs() <= 2_000, "{offset}");
    }

    proptest! {
        #[test]
        fn what_is_stated_holds_and_time_never_goes_back(
            ahead in -1_000_000_000_000..1_000_000_000_000_i64,
            drift in -200_000..=200_000_i64,
            base in (1_000_000..5_000_000_i64, 1_000_000..5_000_000_i64),
            jitters in prop::collection::vec(
                (0..20_000_000_i64, 0..1_000_000_i64, 0..20_000_000_i64),
                12..150,
            ),
            // From a network that takes milliseconds to one where only drift matters.
            quicker in prop_oneof![Just(1), Just(1_000), Just(100_000)],
            period in 0..100_000_000_i64,
            trials in 0..12_u32,
            attenuation in 0..12_u32,
        ) {
            let options = ClockSyncOptions { period, trials, attenuation, ..on() };
            let mut world = World::new(Truth { ahead, drift }, options);
            for (there, at_rti, back) in jitters {
                let there = (base.0 + there) / quicker;
                world.exchange(there, at_rti / quicker, (base.1 + back) / quicker);
            }
            prop_assert!(world.sync.is_settled());
        }
    }
}
