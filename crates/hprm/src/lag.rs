//! The lag watch: whether a program falls behind its clock for good, and which reaction costs most then.
//!
//! A program lags by the time between the moment at which a tag is due and the one at which it begins.
//! The watch is told of each tag that begins; only while the lag is large does it want to know how long
//! reactions take. A `fast` program follows no clock; it lags if its time stands still, because microstep
//! follows microstep. So can one that has a clock; where a connection `after 0` asks for it, that is as it should be.
//! The watch says nothing itself: see [`Workers`](crate::workers).

use hprm_core::{
    Delay, Nanos, PhysicalTime, Program, ReactionId, Reading, Scope, Table, Tag, show_time,
};

const SECOND: Nanos = 1_000_000_000;

/// With a larger lag, reactions are timed.
const NOTICED: Nanos = SECOND / 10;
/// A larger lag is an overload, if it lasts.
const BOUND: Nanos = SECOND;
/// How long it has to last.
const LASTS: Nanos = SECOND;
/// After how many microsteps at one time a program that follows no clock looks at one.
const LOOKS: u32 = 64;
/// Fewer microsteps at one time are not why it lasts: the end of a program is one after what its reactions have taken
/// long to do, and a few events with a delay of 0 are quick.
const MANY: u32 = 8;

/// See the module.
#[derive(Debug, Default)]
pub(crate) struct LagWatch {
    /// Whether the overload has been reported.
    is_over: bool,
    /// Whether the program asks that its time stands still: a connection `after 0` closes a cycle, for example, in which
    /// each step follows the one before as soon as it can.
    may_stand: bool,
    /// The logical time at which a program that follows no clock stands, and since when.
    stands: Option<(Nanos, PhysicalTime)>,
    /// The latest tag that was in time.
    in_time: Option<Tag>,
    behind: Option<Behind>,
    /// What reactions have taken since the lag was worth noticing; there from the start, so that a program
    /// that lags allocates nothing either.
    costs: Table<ReactionId, Cost>,
}

/// A lag that is worth noticing.
#[derive(Debug)]
struct Behind {
    first: Tag,
    /// When that began, and how late it was.
    at: PhysicalTime,
    jump: Nanos,
    /// Since when the lag has been over the bound.
    over: Option<PhysicalTime>,
}

/// How long a reaction has run.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct Cost {
    pub(crate) total: Nanos,
    pub(crate) longest: Nanos,
    pub(crate) runs: u64,
}

/// A lag that has lasted.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Overload {
    pub(crate) lag: Nanos,
    /// The first tag that was late.
    pub(crate) since: Tag,
    /// If all tags since then are of one time: how many microsteps have followed the first one.
    pub(crate) stands: Option<u32>,
    /// If most of the lag came at once: how much, and the tag before.
    pub(crate) jump: Option<(Nanos, Tag)>,
    /// For how long reactions have been timed, and how much of that they took.
    pub(crate) elapsed: Nanos,
    pub(crate) busy: Nanos,
    /// The reaction that took most of it.
    pub(crate) slowest: Option<(ReactionId, Cost)>,
}

impl LagWatch {
    /// For a program.
    pub(crate) fn new(program: &Program) -> Self {
        let costs = Table::filled(program.reactions.len(), Cost::default());
        let may_stand = program.connections.values().any(|it| it.delay == Delay::Microstep);
        Self { costs, may_stand, ..Self::default() }
    }

    /// Whether to say how long each reaction takes.
    #[inline]
    pub(crate) fn is_timing(&self) -> bool {
        self.behind.is_some()
    }

    /// Notes that `tag`, which was `due`, begins. Returns an overload once.
    #[inline]
    pub(crate) fn begins(
        &mut self,
        tag: Tag,
        due: PhysicalTime,
        now: PhysicalTime,
    ) -> Option<Overload> {
        let lag = now.since(due);
        // The first tag of a time that stands still was in time, or is what lags.
        let stands = || self.may_stand && self.in_time.is_some_and(|it| it.time == tag.time);
        if lag <= NOTICED || stands() {
            self.in_time = Some(tag);
            if self.behind.is_some() {
                self.behind = None;
            }
            return None;
        }
        self.begins_late(tag, lag, now)
    }

    /// Notes that `tag` of a program begins that follows no clock: only the first tag of a time that it stands at is
    /// due at a time. Returns once that the program does not get on.
    #[inline]
    pub(crate) fn begins_at_once(&mut self, tag: Tag, now: impl Reading) -> Option<Overload> {
        if tag.microstep % LOOKS != LOOKS - 1 {
            if tag.microstep == 0 && self.behind.is_some() {
                self.behind = None;
            }
            return None;
        }
        self.stands_still(tag, now.read())
    }

    #[cold]
    fn stands_still(&mut self, tag: Tag, now: PhysicalTime) -> Option<Overload> {
        let since = match self.stands {
            Some((time, since)) if time == tag.time => since,
            _ => now,
        };
        self.stands = Some((tag.time, since));
        self.begins(tag, since, now)
    }

    #[cold]
    fn begins_late(&mut self, tag: Tag, lag: Nanos, now: PhysicalTime) -> Option<Overload> {
        if self.is_over {
            return None;
        }
        let behind = self.behind.get_or_insert_with(|| {
            self.costs.ids().for_each(|reaction| self.costs[reaction] = Cost::default());
            Behind { first: tag, at: now, jump: lag, over: None }
        });
        if lag <= BOUND {
            behind.over = None;
            return None;
        }
        if now.since(*behind.over.get_or_insert(now)) < LASTS {
            return None;
        }
        self.is_over = true;
        let behind = self.behind.take()?;
        let overload = behind.overload((tag, lag), now, self.in_time, &self.costs);
        (!self.may_stand || overload.stands.is_none()).then_some(overload)
    }

    /// Notes how long a run of a reaction took.
    pub(crate) fn ran(&mut self, reaction: ReactionId, took: Nanos) {
        if self.behind.is_some() {
            let cost = &mut self.costs[reaction];
            cost.total = cost.total.saturating_add(took);
            cost.longest = cost.longest.max(took);
            cost.runs += 1;
        }
    }
}

impl Behind {
    fn overload(
        &self,
        (tag, lag): (Tag, Nanos),
        now: PhysicalTime,
        in_time: Option<Tag>,
        costs: &Table<ReactionId, Cost>,
    ) -> Overload {
        let ran = costs.iter().filter(|(_, cost)| cost.runs > 0);
        let slowest = ran.max_by_key(|(_, cost)| cost.total);
        Overload {
            lag,
            since: self.first,
            stands: (tag.time == self.first.time).then(|| tag.microstep - self.first.microstep),
            jump: in_time.filter(|_| self.jump > lag / 2).map(|before| (self.jump, before)),
            elapsed: now.since(self.at),
            busy: costs.values().map(|cost| cost.total).sum(),
            slowest: slowest.map(|(reaction, cost)| (reaction, *cost)),
        }
    }
}

impl Overload {
    /// Whether it is the many microsteps that keep the time still.
    fn is_stepwise(&self) -> bool {
        self.stands.is_some_and(|microsteps| microsteps >= MANY)
    }

    /// The warning for the user. `place` says where a reaction is written, if that is known.
    pub(crate) fn message(
        &self,
        program: &Program,
        scope: Scope,
        place: impl Fn(ReactionId) -> Option<String>,
    ) -> String {
        let (name, alone) = match scope {
            Scope::Whole => ("the program".to_owned(), true),
            Scope::Federate(id) => (format!("federate {}", program.federates[id].name), false),
        };
        let (lag, since) = (seconds(self.lag), show_tag(self.since));
        let mut text = match self.is_stepwise() {
            true => format!(
                "the logical time of {name} has stood still for {lag}, one microstep after the other, since tag \
                 {since}"
            ),
            false => format!("{name} lags {lag} behind its clock, since tag {since}"),
        };
        if let Some((jump, before)) = self.jump {
            text +=
                &format!(", before which {} went by at tag {}", seconds(jump), show_tag(before));
        }
        // Where the program waits, the reaction that took most of the little time is not the cause.
        let is_busy = self.busy >= self.elapsed / 2;
        if let Some((reaction, cost)) = self.slowest.filter(|_| is_busy || self.is_stepwise()) {
            let place = place(reaction).map_or_else(String::new, |place| format!(" ({place})"));
            let reaction = program.reaction_label(reaction);
            let Cost { total, longest, runs } = cost;
            let times = if runs == 1 { "once".to_owned() } else { format!("{runs} times") };
            let (total, longest) = (seconds(total), seconds(longest));
            text += &format!(
                "; reaction {reaction}{place} took longest: it ran {times}, {total} in all, {longest} at most"
            );
        }
        text += "\n  hint: ";
        text += match (is_busy, alone) {
            _ if self.is_stepwise() => {
                "an event with a delay of 0 comes at the same time, a microstep later; with a larger delay, time goes on"
            }
            (true, true) => {
                "let it run less often, make it quicker, give it a deadline, or move it into a \
                 federate of its own"
            }
            (true, false) => "let it run less often, make it quicker, or give it a deadline",
            (false, true) => {
                "its reactions took less than half of that time: is the machine busy with something \
                 else?"
            }
            (false, false) => {
                "its reactions took less than half of that time: it waits for other federates, or \
                 the machine is busy with something else"
            }
        };
        text
    }
}

/// A time that was measured, as a person wants to read it: `2.35 s`, `8.2 ms`.
pub(crate) fn seconds(nanos: Nanos) -> String {
    match nanos {
        10_000_000_000.. => format!("{} s", nanos / SECOND),
        100_000_000.. => format!("{}.{:02} s", nanos / SECOND, nanos % SECOND / 10_000_000),
        _ => format!("{}.{} ms", nanos / 1_000_000, nanos % 1_000_000 / 100_000),
    }
}

/// A tag with the unit in which a program states times: `(20 ms, 1)`.
pub(crate) fn show_tag(tag: Tag) -> String {
    format!("({}, {})", show_time(tag.time), tag.microstep)
}

#[cfg(test)]
mod tests {
    use hprm_core::{Direction, ProgramBuilder, Properties, ReactionSpec};

    use super::*;

    const MS: Nanos = 1_000_000;
    const SLOW: ReactionId = ReactionId(7);
    const QUICK: ReactionId = ReactionId(3);

    /// A reactor with eight reactions, and a connection with a delay from its output to its input.
    fn program(delay: Delay) -> Program {
        let mut b = ProgramBuilder::new("Main", Properties::default());
        let worker = b.reactor(b.main(), "worker");
        let from = b.port(worker, "out", Direction::Output);
        let to = b.port(worker, "inp", Direction::Input);
        b.connect(from, to, delay);
        (0..8).for_each(|_| _ = b.reaction(worker, ReactionSpec::default()));
        b.build().unwrap()
    }

    /// For such a program, whose time may stand still only if the delay is a microstep.
    fn watch(delay: Delay) -> LagWatch {
        LagWatch::new(&program(delay))
    }

    /// Runs a timer of 10 ms for so many tags, each of which takes as long as `cost` says.
    fn run(tags: i64, cost: impl Fn(i64) -> Nanos) -> (LagWatch, Vec<Overload>, u64) {
        let (mut watch, mut told, mut timed) = (watch(Delay::Time(MS)), Vec::new(), 0);
        let mut now = PhysicalTime(0);
        for index in 0..tags {
            let due = PhysicalTime(10 * MS * index);
            now = now.max(due);
            told.extend(watch.begins(Tag::new(due.0, 0), due, now));
            if watch.is_timing() {
                timed += 1;
                watch.ran(SLOW, cost(index));
                watch.ran(QUICK, MS / 10);
            }
            now = now.plus(cost(index) + MS / 10);
        }
        (watch, told, timed)
    }

    #[test]
    fn a_program_that_keeps_up_is_not_timed_and_gets_no_warning() {
        // Now and then a tag takes 90 ms, and the ones after it catch up.
        let (_, told, timed) = run(10_000, |index| if index % 100 == 0 { 90 * MS } else { MS });
        assert_eq!((told, timed), (Vec::new(), 0));
    }

    #[test]
    fn a_lag_that_is_made_good_is_no_overload() {
        // Three seconds are lost, and found again within one.
        let (watch, told, timed) = run(10_000, |index| if index == 50 { 3_000 * MS } else { MS });
        assert_eq!(told, Vec::new());
        assert!(timed > 0 && !watch.is_timing());
    }

    #[test]
    fn an_overload_is_told_once_with_the_slowest_reaction() {
        let (watch, told, _) = run(10_000, |index| if index < 100 { MS } else { 20 * MS });
        let [overload] = told.as_slice() else { panic!("{told:?}") };
        // 10.1 ms are lost with each tag, from one second on.
        assert_eq!(overload.since, Tag::new(1_100 * MS, 0));
        assert!((1_500 * MS..1_520 * MS).contains(&overload.lag), "{overload:?}");
        let (reaction, cost) = overload.slowest.unwrap();
        assert_eq!((reaction, cost.longest), (SLOW, 20 * MS));
        assert_eq!(cost.total, 20 * MS * i64::try_from(cost.runs).unwrap());
        assert_eq!(overload.jump, None);
        assert!(overload.busy > overload.elapsed / 10 * 9, "{overload:?}");
        assert!(!watch.is_timing(), "nothing is measured any more");
    }

    #[test]
    fn a_lag_that_came_at_once_is_told_as_such() {
        let cost = |index| if index == 50 { 5_000 * MS } else { 11 * MS };
        let (_, told, _) = run(1_000, cost);
        let before = Tag::new(500 * MS, 0);
        assert_eq!(told.len(), 1);
        let (jump, after) = told[0].jump.unwrap();
        assert_eq!(after, before);
        assert!((4_900 * MS..5_100 * MS).contains(&jump), "{jump}");
    }

    #[test]
    fn a_lag_must_last() {
        let mut watch = watch(Delay::Time(MS));
        let mut begins = |at: Nanos, lag: Nanos| {
            watch.begins(Tag::new(at, 0), PhysicalTime(at), PhysicalTime(at + lag))
        };
        assert_eq!(begins(0, 1_100 * MS), None);
        // Over the bound for less than a second, then just under it, then over it again.
        assert_eq!(begins(900 * MS, 1_100 * MS), None);
        assert_eq!(begins(950 * MS, 1_000 * MS), None);
        assert_eq!(begins(1_000 * MS, 1_100 * MS), None);
        assert_eq!(begins(1_999 * MS, 1_100 * MS), None);
        assert!(begins(2_000 * MS, 1_100 * MS).is_some());
    }

    #[test]
    fn a_message_names_the_reaction_its_place_and_its_cost() {
        let program = program(Delay::Time(MS));
        let cost = Cost { total: 2_350 * MS, longest: 61 * MS, runs: 39 };
        let mut overload = Overload {
            lag: 1_520 * MS,
            since: Tag::new(1_100 * MS, 2),
            stands: None,
            jump: None,
            elapsed: 2_400 * MS,
            busy: 2_360 * MS,
            slowest: Some((SLOW, cost)),
        };
        let place = |_| Some("Main.lf:12".to_owned());
        assert_eq!(
            overload.message(&program, Scope::Whole, place),
            "the program lags 1.52 s behind its clock, since tag (1100 ms, 2); reaction \
             Main.worker.8 (Main.lf:12) took longest: it ran 39 times, 2.35 s in all, 61.0 ms at \
             most\n  hint: let it run less often, make it quicker, give it a deadline, or move it \
             into a federate of its own"
        );
        overload.busy = MS;
        overload.jump = Some((12_000 * MS, Tag::START));
        let text = overload.message(&program, Scope::Whole, |_| None);
        assert!(text.contains("(1100 ms, 2), before which 12 s went by at tag (0, 0)\n"), "{text}");
        assert!(!text.contains("Main.worker"), "it waits: {text}");
        assert!(text.contains("is the machine busy with something else?"), "{text}");
    }

    /// Runs a program without a clock for `seconds` seconds, of which each has 100 tags; `tag` says which.
    fn run_at_once(delay: Delay, seconds: i64, tag: impl Fn(u32) -> Tag) -> Vec<Overload> {
        let mut watch = watch(delay);
        let tags = (0..).zip(0..seconds * 100);
        tags.filter_map(|(number, at)| {
            let told = watch.begins_at_once(tag(number), PhysicalTime(at * 10 * MS));
            watch.ran(SLOW, MS);
            told
        })
        .collect()
    }

    #[test]
    fn without_a_clock_to_follow_there_is_no_lag() {
        let delay = Delay::Time(MS);
        assert_eq!(run_at_once(delay, 100, |number| Tag::new(number.into(), 0)), []);
        // 80 microsteps at each time.
        let tag = |number: u32| Tag::new((number / 80).into(), number % 80);
        assert_eq!(run_at_once(delay, 100, tag), []);
    }

    #[test]
    fn a_time_that_stands_still_is_told_once() {
        let stands = |number: u32| match number {
            0..200 => Tag::new(0, number),
            _ => Tag::new(5 * MS, number - 200),
        };
        assert_eq!(run_at_once(Delay::Microstep, 20, stands), []);
        let told = run_at_once(Delay::Time(MS), 20, stands);
        assert_eq!(told.len(), 1);
        assert_eq!(told[0].since, Tag::new(5 * MS, 127));
        assert!((2_000 * MS..4_000 * MS).contains(&told[0].lag), "{told:?}");
        let text = told[0].message(&program(Delay::Time(MS)), Scope::Whole, |_| None);
        assert!(
            text.starts_with(
                "the logical time of the program has stood still for 2.56 s, one microstep after the \
                 other, since tag (5 ms, 127); reaction Main.worker.8 took longest"
            ),
            "{text}"
        );
        assert!(text.contains("hint: an event with a delay of 0 comes at the same time"), "{text}");
    }

    #[test]
    fn a_program_whose_time_may_stand_still_is_timed_only_when_it_goes_on() {
        let mut watch = watch(Delay::Microstep);
        // Time stands still for 5 s; then it goes on, and the program does not keep up.
        for number in 0..1_000 {
            let now = PhysicalTime(i64::from(number) * 5 * MS);
            assert_eq!(watch.begins(Tag::new(0, number), PhysicalTime(0), now), None);
            assert!(!watch.is_timing(), "at microstep {number}");
        }
        let mut told = (1..1_000).filter_map(|number| {
            let (due, now) =
                (PhysicalTime(number * MS), PhysicalTime(5_000 * MS + number * 5 * MS));
            watch.begins(Tag::new(due.0, 0), due, now)
        });
        let overload = told.next().unwrap();
        assert_eq!((overload.since, overload.stands), (Tag::new(MS, 0), None));
        assert_eq!(overload.jump.map(|(_, before)| before), Some(Tag::new(0, 999)));
        assert_eq!(told.next(), None);
    }

    #[test]
    fn a_long_reaction_and_the_end_a_microstep_later_are_no_time_that_stands_still() {
        let two_tags = |delay| {
            let mut watch = watch(delay);
            [(0, 3_000), (1, 5_500)].map(|(microstep, at)| {
                let now = PhysicalTime(at * MS);
                let told = watch.begins(Tag::new(0, microstep), PhysicalTime(0), now);
                watch.ran(SLOW, 2_500 * MS);
                told
            })
        };
        assert_eq!(two_tags(Delay::Microstep), [None, None]);
        let [None, Some(told)] = two_tags(Delay::Time(MS)) else { panic!("nothing is told") };
        assert_eq!((told.lag, told.stands), (5_500 * MS, Some(1)));
        let text = told.message(&program(Delay::Time(MS)), Scope::Whole, |_| None);
        assert!(
            text.starts_with(
                "the program lags 5.50 s behind its clock, since tag (0, 0); reaction"
            ),
            "{text}"
        );
        assert!(text.contains("hint: let it run less often"), "{text}");
    }
}
