//! Whether and when one federate that has ended is started again, by what the program states for it.
//!
//! A machine of its own: it is told when the federate is started and how it ends. The
//! [`supervisor`](super::Supervisor) knows whether there is a federation to come back to.

use std::collections::VecDeque;
use std::time::Duration;

use hprm_core::{Restart, RestartCondition};

use super::{FederateEnding, Signal};

/// The ends that a condition tells apart.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum End {
    /// In order, or by a signal that asks a process to end.
    Orderly,
    /// By an exit code or a failure of its own.
    Failed,
    /// By another signal.
    Killed,
    /// It has not answered, and was ended for that.
    Silent,
}

impl End {
    /// What the end of a process is, as systemd has it.
    pub(super) fn of(ending: &FederateEnding) -> Self {
        const ASKING: [Signal; 4] =
            [Signal::HANG_UP, Signal::INTERRUPT, Signal::TERMINATE, Signal::BROKEN_PIPE];
        match ending {
            FederateEnding::Code(0) => Self::Orderly,
            // That is how interpreters end which such a signal has reached.
            FederateEnding::Code(code) if ASKING.iter().any(|it| it.exit_code() == *code) => {
                Self::Orderly
            }
            FederateEnding::Signal(signal) if ASKING.contains(signal) => Self::Orderly,
            FederateEnding::Code(_) | FederateEnding::Failed(_) => Self::Failed,
            FederateEnding::Signal(_) => Self::Killed,
        }
    }
}

/// What is to be done about a federate that has ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Decision {
    /// Nothing: the program does not ask for it.
    Leave,
    /// It is started again at that time.
    Again(Duration),
    /// The program asks for it, and it has been started too often.
    TooOften,
}

/// The starts of a federate.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Starts {
    restart: Restart,
    /// When it was started, as far as that counts: as often as is allowed within an interval, at most.
    recent: VecDeque<Duration>,
    /// How often it was started again.
    again: u32,
}

impl Starts {
    /// A federate that has just been started.
    pub(super) fn new(restart: Restart) -> Self {
        Self { restart, recent: VecDeque::from([Duration::ZERO]), again: 0 }
    }

    /// What to do about an end. It is started at `earliest`, if the pause is over before.
    pub(super) fn decide(&self, end: End, ended: Duration, earliest: Duration) -> Decision {
        let applies = match self.restart.condition {
            RestartCondition::OnFailure => end != End::Orderly,
            RestartCondition::OnAbnormal => matches!(end, End::Killed | End::Silent),
            RestartCondition::Always => true,
        };
        match applies {
            true => self.again(ended, earliest),
            false => Decision::Leave,
        }
    }

    /// The same about a process that could not join, whatever the program asks for.
    pub(super) fn again(&self, ended: Duration, earliest: Duration) -> Decision {
        let at = ended.saturating_add(self.pause()).max(earliest);
        match self.is_allowed(at) {
            true => Decision::Again(at),
            false => Decision::TooOften,
        }
    }

    /// It is started again.
    pub(super) fn start(&mut self, now: Duration) {
        self.again = self.again.saturating_add(1);
        self.recent.push_back(now);
        while self.recent.len() > self.burst() {
            self.recent.pop_front();
        }
    }

    /// How long after its end it is started again.
    pub(super) fn pause(&self) -> Duration {
        Duration::from_nanos(self.restart.pause.unsigned_abs())
    }

    /// How often it was started again.
    pub(super) fn count(&self) -> u32 {
        self.again
    }

    /// How often it may be started, and within which time.
    pub(super) fn limit(&self) -> (u32, Duration) {
        (self.restart.burst, self.interval())
    }

    fn interval(&self) -> Duration {
        Duration::from_nanos(self.restart.interval.unsigned_abs())
    }

    fn burst(&self) -> usize {
        usize::try_from(self.restart.burst.max(1)).unwrap_or(usize::MAX)
    }

    /// Whether a start then is one of so many within an interval as are allowed.
    fn is_allowed(&self, at: Duration) -> bool {
        let interval = self.interval();
        let is_over = |start: &Duration| at.saturating_sub(*start) >= interval;
        self.recent.len() < self.burst() || self.recent.front().is_none_or(is_over)
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::Nanos;
    use proptest::prelude::*;

    use super::*;

    const MILLI: Duration = Duration::from_millis(1);

    fn starts(condition: RestartCondition, pause: Nanos, burst: u32, interval: Nanos) -> Starts {
        Starts::new(Restart { condition, pause, burst, interval })
    }

    #[test]
    fn a_condition_is_about_the_end() {
        let ends = [End::Orderly, End::Failed, End::Killed, End::Silent];
        let applies = |condition| {
            let starts = Starts::new(Restart::new(condition));
            ends.map(|end| starts.decide(end, MILLI, MILLI) != Decision::Leave)
        };
        assert_eq!(applies(RestartCondition::OnFailure), [false, true, true, true]);
        assert_eq!(applies(RestartCondition::OnAbnormal), [false, false, true, true]);
        assert_eq!(applies(RestartCondition::Always), [true; 4]);
    }

    #[test]
    fn ends_are_told_apart_as_systemd_does() {
        let code = |code| End::of(&FederateEnding::Code(code));
        assert_eq!(
            [0, 1, 137, 143].map(code),
            [End::Orderly, End::Failed, End::Failed, End::Orderly]
        );
        let signal = |signal| End::of(&FederateEnding::Signal(signal));
        assert_eq!(signal(Signal::KILL), End::Killed);
        assert_eq!(signal(Signal::TERMINATE), End::Orderly);
    }

    #[test]
    fn the_pause_is_counted_from_the_end() {
        let starts = starts(RestartCondition::OnFailure, 200_000_000, 5, 0);
        let at =
            |ended: u32, earliest: u32| starts.decide(End::Failed, MILLI * ended, MILLI * earliest);
        assert_eq!(at(1000, 1100), Decision::Again(MILLI * 1200));
        assert_eq!(at(1000, 1500), Decision::Again(MILLI * 1500));
    }

    #[test]
    fn the_first_start_counts_and_an_old_one_does_not() {
        let mut starts = starts(RestartCondition::OnFailure, 0, 2, 10_000_000_000);
        let at =
            |starts: &Starts, millis| starts.decide(End::Failed, MILLI * millis, MILLI * millis);
        assert_eq!(at(&starts, 1), Decision::Again(MILLI));
        starts.start(MILLI);
        assert_eq!(at(&starts, 9_999), Decision::TooOften);
        assert_eq!(at(&starts, 10_000), Decision::Again(MILLI * 10_000));
        starts.start(MILLI * 10_000);
        assert_eq!((at(&starts, 10_000), starts.count()), (Decision::TooOften, 2));
    }

    proptest! {
        /// However a federate fails: no pause is shorter than stated, no more starts than allowed are within an
        /// interval, and none is refused that would be allowed.
        #[test]
        fn starts_obey_the_limit(
            pause in 0..3_000_u32,
            burst in 1..6_u32,
            interval in 0..9_000_u32,
            runs in prop::collection::vec(0..4_000_u32, 1..40),
        ) {
            let (pause, interval) = (MILLI * pause, MILLI * interval);
            let nanos = |time: Duration| i64::try_from(time.as_nanos()).unwrap();
            let mut starts =
                starts(RestartCondition::Always, nanos(pause), burst, nanos(interval));
            let mut all = vec![Duration::ZERO];
            for run in runs {
                let ended = *all.last().unwrap() + MILLI * run;
                let at = ended + pause;
                let within = all.iter().filter(|start| at - **start < interval).count();
                match starts.decide(End::Failed, ended, ended) {
                    Decision::Again(next) => {
                        prop_assert_eq!(next, at);
                        prop_assert!(within < burst as usize);
                        starts.start(at);
                        all.push(at);
                    }
                    decision => {
                        prop_assert_eq!(decision, Decision::TooOften);
                        prop_assert!(within >= burst as usize);
                        break;
                    }
                }
            }
            prop_assert_eq!(starts.count() as usize, all.len() - 1);
        }
    }
}
