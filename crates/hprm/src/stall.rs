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
    /// The reactions that have been reported: once each.
    told: BTreeSet<(usize, ReactionId)>,
    /// When the user was first known to wait for the end.
    asked: Option<Duration>,
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
        Self { limit, seen: BTreeMap::new(), told: BTreeSet::new(), asked: None }
    }

    /// Takes a sample of what runs at the time `now`, and whether the user has `asked` the program to stop.
    /// Returns what to report.
    pub fn look(
        &mut self,
        now: Duration,
        runs: impl IntoIterator<Item = ReactionRun>,
        asked: bool,
    ) -> Vec<Stall> {
        if asked {
            self.asked.get_or_insert(now);
        }
        let before = std::mem::take(&mut self.seen);
        let is_due = self.asked.is_some_and(|at| now >= at + AFTER_SIGNAL);
        let mut stalls = Vec::new();
        for run in runs {
            let mut seen =
                before.get(&run).copied().unwrap_or(Seen { since: now, delays_stop: false });
            let lasts = now.saturating_sub(seen.since);
            if is_due && lasts >= AFTER_SIGNAL && !seen.delays_stop {
                seen.delays_stop = true;
                self.told.insert((run.program, run.reaction));
                stalls.push(Stall { run, lasts, delays_stop: true });
            } else if self.limit.is_some_and(|limit| lasts >= limit)
                && self.told.insert((run.program, run.reaction))
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

    /// The user breaks into what runs. Returns what has not been reported since the program was asked to
    /// stop.
    pub fn break_in(
        &mut self,
        now: Duration,
        runs: impl IntoIterator<Item = ReactionRun>,
    ) -> Vec<Stall> {
        let mut stalls = Vec::new();
        for run in runs {
            let seen = self.seen.entry(run).or_insert(Seen { since: now, delays_stop: false });
            if !std::mem::replace(&mut seen.delays_stop, true) {
                self.told.insert((run.program, run.reaction));
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
        asked: bool,
    ) -> Vec<(u64, Stall)> {
        let mut told = Vec::new();
        for half in 2 * from..2 * to {
            let now = Duration::from_millis(500 * half);
            told.extend(watch.look(now, runs(half), asked).into_iter().map(|stall| (half, stall)));
        }
        told
    }

    fn five() -> StallWatch {
        StallWatch::new(Some(Duration::from_secs(5)))
    }

    #[test]
    fn a_reaction_that_does_not_return_is_told_once() {
        let told = look(&mut five(), (0, 60), |_| vec![run(3, 17)], false);
        let lasts = Duration::from_secs(5);
        assert_eq!(told, [(10, Stall { run: run(3, 17), lasts, delays_stop: false })]);
    }

    #[test]
    fn a_reaction_that_runs_again_and_again_is_none_that_runs_for_long() {
        assert_eq!(look(&mut five(), (0, 60), |half| vec![run(3, half)], false), []);
        // Nine samples of each run.
        assert_eq!(look(&mut five(), (0, 60), |half| vec![run(3, half / 9)], false), []);
    }

    #[test]
    fn each_reaction_is_told_once_however_often_it_takes_long() {
        let runs = |half| vec![run(3, half / 20), run(4, 100 + half / 20)];
        let told = look(&mut five(), (0, 60), runs, false);
        let reactions: Vec<_> = told.iter().map(|(_, stall)| stall.run.reaction.0).collect();
        assert_eq!(reactions, [3, 4]);
    }

    #[test]
    fn without_a_limit_nothing_is_told_before_the_end_is_asked_for() {
        let mut watch = StallWatch::new(None);
        assert_eq!(look(&mut watch, (0, 60), |_| vec![run(3, 1)], false), []);
        let told = look(&mut watch, (60, 70), |_| vec![run(3, 1)], true);
        let lasts = Duration::from_secs(61);
        assert_eq!(told, [(122, Stall { run: run(3, 1), lasts, delays_stop: true })]);
    }

    #[test]
    fn a_reaction_that_keeps_the_end_waiting_is_told_again() {
        let mut watch = five();
        assert_eq!(look(&mut watch, (0, 8), |_| vec![run(3, 1)], false).len(), 1);
        let told = look(&mut watch, (8, 20), |_| vec![run(3, 1)], true);
        assert_eq!(
            told.iter().map(|(half, stall)| (*half, stall.delays_stop)).collect::<Vec<_>>(),
            [(18, true)]
        );
        // A shutdown reaction that began after the signal.
        let told = look(&mut watch, (20, 30), |_| vec![run(5, 2)], true);
        assert_eq!(
            told.iter().map(|(half, stall)| (*half, stall.delays_stop)).collect::<Vec<_>>(),
            [(42, true)]
        );
    }

    #[test]
    fn a_reaction_that_returns_soon_after_the_signal_is_not_told() {
        let mut watch = five();
        assert_eq!(look(&mut watch, (0, 2), |_| vec![run(3, 1)], false), []);
        assert_eq!(watch.look(Duration::from_secs(2), [run(3, 1)], true), []);
        assert_eq!(watch.look(Duration::from_millis(2500), [run(3, 1)], true), []);
        assert_eq!(look(&mut watch, (3, 9), |_| Vec::new(), true), []);
    }

    #[test]
    fn a_reaction_that_the_user_breaks_into_is_told_unless_that_is_known() {
        let mut watch = five();
        watch.look(Duration::from_secs(1), [run(3, 1)], false);
        let now = Duration::from_secs(3);
        let [stall] = watch.break_in(now, [run(3, 1)])[..] else { panic!("it is told") };
        assert_eq!((stall.lasts, stall.delays_stop), (Duration::from_secs(2), true));
        assert_eq!(watch.break_in(now, [run(3, 1)]), []);
        assert_eq!(watch.look(Duration::from_secs(9), [run(3, 1)], true), []);
    }
}
