//! The stall watch: which reactions have been running for long, and which of them to report.
//!
//! The caller samples what runs, about twice a second, and shows it here. A run has a number, so the same number
//! in two samples is one reaction that has not returned in between; to find that out costs the loops
//! nothing. The caller reads the clock and writes the warnings.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use hprm_core::ReactionId;

/// How long a reaction may go on after the user has asked the program to stop, before that is reported.
const AFTER_SIGNAL: Duration = Duration::from_secs(1);

/// One run of a reaction.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct ReactionRun {
    /// The loop, where several run in one process.
    pub program: usize,
    /// The reaction.
    pub reaction: ReactionId,
    /// Different for each run of one loop.
    pub number: u64,
}

/// A reaction that is to be reported.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Stall {
    /// What runs.
    pub run: ReactionRun,
    /// For how long, at least.
    pub lasts: Duration,
    /// Whether the user waits for the program to stop.
    pub delays_stop: bool,
}

/// See the module.
#[derive(Debug)]
pub struct StallWatch {
    /// None if a long run alone is not reported.
    limit: Option<Duration>,
    seen: BTreeMap<ReactionRun, Seen>,
    /// The reactions that have been reported. Each is reported once.
    reported: BTreeSet<(usize, ReactionId)>,
    /// When the user has asked the program to stop, as far as samples show.
    stop_requested_at: Option<Duration>,
}

#[derive(Clone, Copy, Debug)]
struct Seen {
    since: Duration,
    /// Whether it has been reported that the end waits for it.
    delays_stop: bool,
}

impl StallWatch {
    /// Reports reactions that take longer than `limit`.
    #[must_use]
    pub fn new(limit: Option<Duration>) -> Self {
        Self { limit, seen: BTreeMap::new(), reported: BTreeSet::new(), stop_requested_at: None }
    }

    /// Takes a sample of what runs at the time `now`. `stop_requested` says whether the user has asked the program to
    /// stop.
    /// Returns what to report.
    pub fn sample(
        &mut self,
        now: Duration,
        runs: impl IntoIterator<Item = ReactionRun>,
        stop_requested: bool,
    ) -> Vec<Stall> {
        if stop_requested {
            self.stop_requested_at.get_or_insert(now);
        }
        let before = std::mem::take(&mut self.seen);
        let is_due = self.stop_requested_at.is_some_and(|at| now >= at + AFTER_SIGNAL);
        let mut stalls = Vec::new();
        for run in runs {
            let mut seen =
                before.get(&run).copied().unwrap_or(Seen { since: now, delays_stop: false });
            let lasts = now.saturating_sub(seen.since);
            if is_due && lasts >= AFTER_SIGNAL && !seen.delays_stop {
                seen.delays_stop = true;
                self.reported.insert((run.program, run.reaction));
                stalls.push(Stall { run, lasts, delays_stop: true });
            } else if self.limit.is_some_and(|limit| lasts >= limit)
                && self.reported.insert((run.program, run.reaction))
            {
                stalls.push(Stall { run, lasts, delays_stop: false });
            }
            self.seen.insert(run, seen);
        }
        stalls
    }

    /// Since when a reaction has been running, as far as samples show; if it is in none, it has just begun.
    #[must_use]
    pub fn since(&self, run: ReactionRun) -> Duration {
        self.seen.get(&run).map_or(Duration::MAX, |seen| seen.since)
    }

    /// The user interrupts what runs. Returns what has not been reported since the program was asked to
    /// stop.
    pub fn interrupt(
        &mut self,
        now: Duration,
        runs: impl IntoIterator<Item = ReactionRun>,
    ) -> Vec<Stall> {
        let mut stalls = Vec::new();
        for run in runs {
            let seen = self.seen.entry(run).or_insert(Seen { since: now, delays_stop: false });
            if !std::mem::replace(&mut seen.delays_stop, true) {
                self.reported.insert((run.program, run.reaction));
                let lasts = now.saturating_sub(seen.since);
                stalls.push(Stall { run, lasts, delays_stop: true });
            }
        }
        stalls
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn run(reaction: u32, number: u64) -> ReactionRun {
        ReactionRun { program: 0, reaction: ReactionId(reaction), number }
    }

    /// Looks twice a second, from `from` to before `to`, at what `runs` says.
    fn look(
        watch: &mut StallWatch,
        (from, to): (u64, u64),
        runs: impl Fn(u64) -> Vec<ReactionRun>,
        stop_requested: bool,
    ) -> Vec<(u64, Stall)> {
        let mut reported = Vec::new();
        for half in 2 * from..2 * to {
            let now = Duration::from_millis(500 * half);
            reported.extend(
                watch
                    .sample(now, runs(half), stop_requested)
                    .into_iter()
                    .map(|stall| (half, stall)),
            );
        }
        reported
    }

    fn five() -> StallWatch {
        StallWatch::new(Some(Duration::from_secs(5)))
    }

    #[test]
    fn a_reaction_that_does_not_return_is_reported_once() {
        let reported = look(&mut five(), (0, 60), |_| vec![run(3, 17)], false);
        let lasts = Duration::from_secs(5);
        assert_eq!(reported, [(10, Stall { run: run(3, 17), lasts, delays_stop: false })]);
    }

    #[test]
    fn a_reaction_that_runs_again_and_again_is_none_that_runs_for_long() {
        assert_eq!(look(&mut five(), (0, 60), |half| vec![run(3, half)], false), []);
        // Nine samples of each run.
        assert_eq!(look(&mut five(), (0, 60), |half| vec![run(3, half / 9)], false), []);
    }

    #[test]
    fn each_reaction_is_reported_once_however_often_it_takes_long() {
        let runs = |half| vec![run(3, half / 20), run(4, 100 + half / 20)];
        let reported = look(&mut five(), (0, 60), runs, false);
        let reactions: Vec<_> = reported.iter().map(|(_, stall)| stall.run.reaction.0).collect();
        assert_eq!(reactions, [3, 4]);
    }

    #[test]
    fn without_a_limit_nothing_is_reported_before_a_stop_request() {
        let mut watch = StallWatch::new(None);
        assert_eq!(look(&mut watch, (0, 60), |_| vec![run(3, 1)], false), []);
        let reported = look(&mut watch, (60, 70), |_| vec![run(3, 1)], true);
        let lasts = Duration::from_secs(61);
        assert_eq!(reported, [(122, Stall { run: run(3, 1), lasts, delays_stop: true })]);
    }

    #[test]
    fn a_reaction_that_keeps_the_end_waiting_is_reported_again() {
        let mut watch = five();
        assert_eq!(look(&mut watch, (0, 8), |_| vec![run(3, 1)], false).len(), 1);
        let reported = look(&mut watch, (8, 20), |_| vec![run(3, 1)], true);
        assert_eq!(
            reported.iter().map(|(half, stall)| (*half, stall.delays_stop)).collect::<Vec<_>>(),
            [(18, true)]
        );
        // A shutdown reaction that began after the signal.
        let reported = look(&mut watch, (20, 30), |_| vec![run(5, 2)], true);
        assert_eq!(
            reported.iter().map(|(half, stall)| (*half, stall.delays_stop)).collect::<Vec<_>>(),
            [(42, true)]
        );
    }

    #[test]
    fn a_reaction_that_returns_soon_after_the_signal_is_not_reported() {
        let mut watch = five();
        assert_eq!(look(&mut watch, (0, 2), |_| vec![run(3, 1)], false), []);
        assert_eq!(watch.sample(Duration::from_secs(2), [run(3, 1)], true), []);
        assert_eq!(watch.sample(Duration::from_millis(2500), [run(3, 1)], true), []);
        assert_eq!(look(&mut watch, (3, 9), |_| Vec::new(), true), []);
    }

    #[test]
    fn a_reaction_that_the_user_interrupts_is_reported_unless_it_has_been() {
        let mut watch = five();
        watch.sample(Duration::from_secs(1), [run(3, 1)], false);
        let now = Duration::from_secs(3);
        let [stall] = watch.interrupt(now, [run(3, 1)])[..] else { panic!("it is reported") };
        assert_eq!((stall.lasts, stall.delays_stop), (Duration::from_secs(2), true));
        assert_eq!(watch.interrupt(now, [run(3, 1)]), []);
        assert_eq!(watch.sample(Duration::from_secs(9), [run(3, 1)], true), []);
    }
}
