//! The stop timer: what a process does after signals have asked it to stop, and when.
//!
//! The first signal asks for an orderly stop. A second one, or the end of the time for that, interrupts what
//! runs. If the process still runs some time after that, it ends at once. The caller reads the clock,
//! receives the signals and ends the process.

use std::time::Duration;

use crate::supervisor::{AFTER_INTERRUPT, SIGNAL_DEBOUNCE, Signal};

/// How long the interpreter may take to notice that a signal interrupts what runs. Code that is not Python's
/// may hold it.
const NOTICE: Duration = Duration::from_secs(1);
/// How long the process may take to end after that.
const UNWIND: Duration = Duration::from_secs(3);

/// What is to be done.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum StopStep {
    /// Nothing has ended in time: interrupt what runs, by this signal.
    Interrupt(Signal),
    /// End the process now.
    End {
        /// The first signal.
        signal: Signal,
        /// How long the process has not ended after that interruption.
        after: Duration,
    },
}

/// What the process has done so far.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct StopProgress {
    /// Whether the interpreter has noticed the interrupting signal.
    pub interrupted: bool,
    /// Whether the program has ended.
    pub over: bool,
}

/// See the module.
#[derive(Clone, Debug, Default)]
pub struct StopTimer {
    /// The first signal, and when it came.
    stop_requested: Option<(Signal, Duration)>,
    /// When a signal interrupted what ran.
    interrupted: Option<Duration>,
    ended: bool,
    /// How far the process had come at the last [`Self::tick`].
    progress: StopProgress,
}

impl StopTimer {
    /// How long an orderly stop may take.
    pub const ORDERLY: Duration = AFTER_INTERRUPT;

    /// A signal has come.
    pub fn signal(&mut self, now: Duration, signal: Signal) {
        match self.stop_requested {
            None => self.stop_requested = Some((signal, now)),
            Some((_, at)) if now >= at + SIGNAL_DEBOUNCE => {
                self.interrupted.get_or_insert(now);
            }
            Some(_) => {}
        }
    }

    /// What is due; each step once.
    pub fn tick(&mut self, now: Duration, progress: StopProgress) -> Option<StopStep> {
        self.progress = progress;
        let (signal, stop_requested) =
            self.stop_requested.filter(|_| !progress.over && !self.ended)?;
        let Some(interrupted) = self.interrupted else {
            if now < stop_requested + Self::ORDERLY {
                return None;
            }
            self.interrupted = Some(now);
            return Some(StopStep::Interrupt(signal));
        };
        let after = self.time_to_end();
        if now < interrupted + after {
            return None;
        }
        self.ended = true;
        Some(StopStep::End { signal, after })
    }

    /// When to call [`Self::tick`] if no signal comes. That time may have passed since the last call.
    pub fn next_wakeup(&self) -> Option<Duration> {
        let (_, stop_requested) =
            self.stop_requested.filter(|_| !self.progress.over && !self.ended)?;
        Some(match self.interrupted {
            None => stop_requested + Self::ORDERLY,
            Some(interrupted) => interrupted + self.time_to_end(),
        })
    }

    /// How long the process may still run after a signal has interrupted it.
    fn time_to_end(&self) -> Duration {
        if self.progress.interrupted { UNWIND } else { NOTICE }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RUNS: StopProgress = StopProgress { interrupted: false, over: false };
    const INTERRUPTED: StopProgress = StopProgress { interrupted: true, over: false };
    const OVER: StopProgress = StopProgress { interrupted: false, over: true };

    fn ms(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    /// What is done, and when, if signals come at these times.
    fn steps(signals: &[u64], progress: impl Fn(u64) -> StopProgress) -> Vec<(u64, StopStep)> {
        let mut timer = StopTimer::default();
        let mut signals: Vec<_> = signals.iter().map(|at| ms(*at)).collect();
        let mut steps = Vec::new();
        let mut now = Duration::ZERO;
        loop {
            while signals.first().is_some_and(|at| *at <= now) {
                timer.signal(signals.remove(0), Signal::TERMINATE);
            }
            let at = u64::try_from(now.as_millis()).unwrap();
            steps.extend(timer.tick(now, progress(at)).map(|step| (at, step)));
            let next = timer.next_wakeup().into_iter().chain(signals.first().copied()).min();
            let Some(next) = next else { return steps };
            assert!(next > now, "it never asks to be called at once");
            now = next;
        }
    }

    const INTERRUPT: StopStep = StopStep::Interrupt(Signal::TERMINATE);

    fn end(after: u64) -> StopStep {
        StopStep::End { signal: Signal::TERMINATE, after: ms(after) }
    }

    #[test]
    fn a_limit_that_comes_due_after_the_tick_is_not_forgotten() {
        let mut timer = StopTimer::default();
        timer.signal(ms(10), Signal::TERMINATE);
        assert_eq!(timer.tick(ms(5009), RUNS), None);
        // The driver asks later: the limit has passed by now, but it has not been applied.
        assert_eq!(timer.next_wakeup(), Some(ms(5010)));
        assert_eq!(timer.tick(ms(5020), RUNS), Some(INTERRUPT));
        assert_eq!(timer.tick(ms(6019), RUNS), None);
        assert_eq!(timer.next_wakeup(), Some(ms(6020)));
        assert_eq!(timer.tick(ms(6030), RUNS), Some(end(1000)));
        assert_eq!(timer.next_wakeup(), None);
    }

    #[test]
    fn a_program_that_stops_in_order_is_left_alone() {
        let stops = |at| if at >= 4000 { OVER } else { RUNS };
        assert_eq!(steps(&[10], stops), []);
        assert_eq!(steps(&[], |_| RUNS), []);
    }

    #[test]
    fn one_signal_ends_what_never_answers() {
        assert_eq!(steps(&[10], |_| RUNS), [(5010, INTERRUPT), (6010, end(1000))]);
    }

    #[test]
    fn what_was_interrupted_may_take_longer_to_end() {
        let interrupted = |at| if at >= 5500 { INTERRUPTED } else { RUNS };
        assert_eq!(steps(&[10], interrupted), [(5010, INTERRUPT), (8010, end(3000))]);
        let ends = |at| if at >= 7000 { OVER } else { interrupted(at) };
        assert_eq!(steps(&[10], ends), [(5010, INTERRUPT)]);
    }

    #[test]
    fn a_second_signal_does_not_wait() {
        assert_eq!(steps(&[10, 300], |_| RUNS), [(1300, end(1000))]);
        assert_eq!(steps(&[10, 300], |_| INTERRUPTED), [(3300, end(3000))]);
        // More of them change nothing, and one sent twice is one.
        assert_eq!(steps(&[10, 300, 400, 2000], |_| INTERRUPTED), [(3300, end(3000))]);
        assert_eq!(steps(&[10, 50], |_| RUNS), [(5010, INTERRUPT), (6010, end(1000))]);
    }
}
