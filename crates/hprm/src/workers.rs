//! Running the reactions of a tag: one after the other, or those that do not depend on one another
//! in several threads.
//!
//! Threads read the scheduler and write down what their reactions ask for. The loop's thread does that
//! afterwards, in the order of the program, so a program's logical behaviour is the same with any number of
//! workers. Waiting, links and messages stay with the loop's thread.

use std::mem;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use hprm_core::{
    Body, Connection, ConnectionId, Effects, LARGE_BACKLOG, Nanos, PhysicalTime, Program,
    ReactionId, Scheduler, Scope, Tag, Turn,
};
use rayon_core::{ThreadPool, ThreadPoolBuilder};

use crate::board::BoardLanes;
use crate::lag::{LagWatch, Overload};
use crate::recorder::{Flags, Recorder};
use crate::trace::line::Read;
use crate::trace::{Trace, reads};
use crate::{Clock, Failure, Host};

/// What runs the reactions of one loop.
pub(crate) struct Workers<V> {
    /// None if there is one worker: the loop's own thread.
    team: Option<Team<V>>,
    /// The trace of what the reactions do, if there is one.
    trace: Option<Trace>,
    recorder: Recorder,
    lanes: BoardLanes,
    /// Whether nothing has to be done after each reaction: there is one worker, no trace and no recording.
    is_plain: bool,
    /// Whose reactions run here.
    scope: Scope,
    lag: LagWatch,
    /// Whether the user knows of a connection without a bound for which many messages wait.
    backlog_is_reported: bool,
}

/// The loop's thread and further worker threads.
struct Team<V> {
    threads: ThreadPool,
    /// How many further threads.
    others: usize,
    /// A scheduler of no use, which stands in for the loop's while that is shared.
    shared: Arc<Scheduler<V>>,
    turns: Vec<Turn>,
    /// What became of each turn.
    results: Vec<Mutex<Ran<V>>>,
}

/// What a reaction asked for and how it ended, once it has.
struct Ran<V> {
    effects: Effects<V>,
    outcome: Option<thread::Result<Result<(), Failure>>>,
    /// What it found when it began, for the trace.
    found: Vec<Read>,
    /// How long it took, if that was asked for.
    took: Nanos,
}

/// How many threads run the reactions of a program; the thread of the loop is one of them.
pub(crate) fn count(program: &Program) -> usize {
    match program.properties.workers {
        None => 1,
        Some(0) => thread::available_parallelism().map_or(1, usize::from),
        Some(workers) => workers as usize,
    }
}

impl<V: Clone> Workers<V> {
    /// As many as the program says. If there is a trace, the scheduler must be recording.
    ///
    /// # Errors
    ///
    /// If the system starts no thread.
    pub(crate) fn new(
        program: &Arc<Program>,
        scope: Scope,
        trace: Option<Trace>,
        recorder: Recorder,
    ) -> Result<Self, Failure> {
        let team = Team::new(program, scope)?;
        let is_plain = team.is_none() && trace.is_none() && !recorder.is_on();
        let lag = LagWatch::new(program);
        let (lanes, backlog_is_reported) = (BoardLanes::default(), false);
        Ok(Self { team, trace, recorder, lanes, is_plain, scope, lag, backlog_is_reported })
    }

    /// The same, and a board shows which reactions run.
    pub(crate) fn shown_on(self, lanes: BoardLanes) -> Self {
        Self { lanes, ..self }
    }

    /// Notes that a tag that was `due` begins now, and warns once if the program has fallen behind for good, and
    /// once if many messages wait on a physical connection without a bound.
    #[inline]
    pub(crate) fn watch_lag<H: Host<Value = V>>(
        &mut self,
        scheduler: &Scheduler<V>,
        host: &mut H,
        (tag, due): (Tag, PhysicalTime),
        now: PhysicalTime,
    ) {
        let overload = match scheduler.program().properties.fast {
            true => self.lag.begins_at_once(tag, Clock::now),
            false => self.lag.begins(tag, due, now),
        };
        if let Some(overload) = overload {
            warn_of_overload(scheduler.program(), self.scope, host, &overload);
        }
        if let Some(connection) = scheduler.connection_with_backlog()
            && !self.backlog_is_reported
        {
            self.backlog_is_reported = true;
            warn_of_backlog(scheduler.program(), host, connection);
        }
    }

    /// Reports how many messages were dropped because a physical connection has a bound.
    pub(crate) fn report_dropped<H: Host<Value = V>>(
        &self,
        scheduler: &Scheduler<V>,
        host: &mut H,
    ) {
        let program = scheduler.program();
        for (connection, dropped) in scheduler.dropped_messages() {
            let [from, to] = ends(program, connection);
            let bound = program.connections[connection].bound;
            let messages = bound.map_or(0, |bound| bound.messages);
            let were = if dropped == 1 { "message was" } else { "messages were" };
            let bound = host.syntax().option("bound");
            host.warn(&format!(
                "{dropped} {were} dropped on the connection {from} ~> {to}: {messages} may wait \
                 ({bound})"
            ));
        }
    }

    /// Runs the reactions of the current tag.
    ///
    /// # Errors
    ///
    /// What a reaction raised: the first one in the order of the program.
    #[inline]
    pub(crate) fn run_tag<H: Host<Value = V>>(
        &mut self,
        scheduler: &mut Scheduler<V>,
        host: &mut H,
    ) -> Result<(), Failure>
    where
        V: Send + Sync,
    {
        if self.is_plain && !self.lag.is_timing() {
            // Most programs: nothing else has to be done after each reaction.
            if self.lanes.is_on() {
                return self.run_shown(scheduler, host);
            }
            while let Some((reaction, body)) = scheduler.next_reaction(Clock::now) {
                run_alone(scheduler, host, reaction, body)?;
            }
            return Ok(());
        }
        self.run_attended(scheduler, host)
    }

    /// The same for a federate, whose board shows which reaction runs.
    #[inline(never)]
    fn run_shown<H: Host<Value = V>>(
        &mut self,
        scheduler: &mut Scheduler<V>,
        host: &mut H,
    ) -> Result<(), Failure> {
        while let Some((reaction, body)) = scheduler.next_reaction(Clock::now) {
            self.lanes.begins(0, reaction);
            run_alone(scheduler, host, reaction, body)?;
        }
        Ok(())
    }

    /// The same for programs with several workers, a trace or a lag: apart, so that the loop of the
    /// others stays small enough for the compiler to put it where it is called.
    #[inline(never)]
    fn run_attended<H: Host<Value = V>>(
        &mut self,
        scheduler: &mut Scheduler<V>,
        host: &mut H,
    ) -> Result<(), Failure>
    where
        V: Send + Sync,
    {
        while self.run_next(scheduler, host)? {}
        Ok(())
    }

    /// Runs those of one level.
    ///
    /// # Errors
    ///
    /// As [`Self::run_tag`].
    pub(crate) fn run_level<H: Host<Value = V>>(
        &mut self,
        scheduler: &mut Scheduler<V>,
        host: &mut H,
        level: u32,
    ) -> Result<(), Failure>
    where
        V: Send + Sync,
    {
        while scheduler.ready_level() == Some(level) && self.run_next(scheduler, host)? {}
        Ok(())
    }

    /// Runs the next reaction, or as many as may run at the same time. Returns whether there was one.
    fn run_next<H: Host<Value = V>>(
        &mut self,
        scheduler: &mut Scheduler<V>,
        host: &mut H,
    ) -> Result<bool, Failure>
    where
        V: Send + Sync,
    {
        let Self { team, trace, recorder, lanes, lag, .. } = self;
        let ran = match team {
            Some(team) if host.shared_bodies().is_some() => {
                team.run_next(scheduler, host, trace.as_mut(), (lag, recorder, lanes))?
            }
            _ => match scheduler.next_reaction(Clock::now) {
                Some((reaction, body)) => {
                    if let Some(trace) = trace {
                        let found = reads(scheduler, reaction, |value| host.describe(value));
                        trace.begin(reaction, found);
                    }
                    let tag = scheduler.tag();
                    recorder.reaction(0, reaction, body, tag);
                    lanes.begins(0, reaction);
                    let ran = timed(lag, reaction, || run_alone(scheduler, host, reaction, body));
                    recorder.reaction_end(0, reaction, tag);
                    ran?;
                    true
                }
                None => false,
            },
        };
        if recorder.is_on() {
            scheduler.take_scheduled().for_each(|it| recorder.scheduled(it, Flags::NONE));
        }
        if let Some(trace) = trace {
            // At once: a value may change later, when other reactions have it.
            while let Some(record) = scheduler.poll_record() {
                trace.add(host, record)?;
            }
        }
        Ok(ran)
    }

    /// Writes what the trace has of the tag, which is over, if there is a trace.
    ///
    /// # Errors
    ///
    /// If it cannot be written.
    pub(crate) fn write_trace(&mut self) -> Result<(), Failure> {
        self.trace.as_mut().map_or(Ok(()), Trace::flush)
    }

    /// Ends the trace, if there is one, with what became of the run.
    ///
    /// # Errors
    ///
    /// If it cannot be written.
    pub(crate) fn end_trace(
        &mut self,
        scheduler: &Scheduler<V>,
        outcome: &Result<(), Failure>,
    ) -> Result<(), Failure> {
        self.trace.take().map_or(Ok(()), |trace| trace.end(scheduler, outcome))
    }
}

/// Runs a body of the reaction whose turn it is.
#[inline]
fn run_alone<H: Host>(
    scheduler: &mut Scheduler<H::Value>,
    host: &mut H,
    reaction: ReactionId,
    body: Body,
) -> Result<(), Failure> {
    if let Some(intended) = scheduler.unhandled_tardy() {
        warn_of_tardy(scheduler, host, reaction, intended);
    }
    host.react(scheduler, reaction, body)?;
    scheduler.finish(reaction);
    Ok(())
}

impl<V: Clone> Team<V> {
    /// The threads that the program asks for; none, if it asks for one.
    fn new(program: &Arc<Program>, scope: Scope) -> Result<Option<Self>, Failure> {
        let workers = count(program);
        if workers <= 1 {
            return Ok(None);
        }
        let others = workers - 1;
        let threads = ThreadPoolBuilder::new()
            .num_threads(others)
            .thread_name(|index| format!("worker-{}", index + 1))
            .build()
            .map_err(|error| {
                let error = std::io::Error::other(error);
                Failure::system(format!("cannot start {others} threads"), &error)
            })?;
        let shared = Arc::new(Scheduler::new(Arc::clone(program), scope));
        Ok(Some(Self { threads, others, shared, turns: Vec::new(), results: Vec::new() }))
    }
}

impl<V: Clone + Send + Sync> Team<V> {
    fn run_next<H: Host<Value = V>>(
        &mut self,
        scheduler: &mut Scheduler<V>,
        host: &mut H,
        trace: Option<&mut Trace>,
        (lag, recorder, lanes): (&mut LagWatch, &Recorder, &BoardLanes),
    ) -> Result<bool, Failure> {
        scheduler.next_turns(Clock::now, &mut self.turns);
        for turn in &self.turns {
            if let Some(intended) = turn.unhandled_tardy {
                warn_of_tardy(scheduler, host, turn.reaction, intended);
            }
        }
        match self.turns.as_slice() {
            [] => return Ok(false),
            // Not worth waking up another thread.
            [turn] => {
                scheduler.take_turn(turn);
                if let Some(trace) = trace {
                    let found = reads(scheduler, turn.reaction, |value| host.describe(value));
                    trace.begin(turn.reaction, found);
                }
                let tag = scheduler.tag();
                recorder.reaction(0, turn.reaction, turn.body, tag);
                lanes.begins(0, turn.reaction);
                let ran =
                    timed(lag, turn.reaction, || host.react(scheduler, turn.reaction, turn.body));
                recorder.reaction_end(0, turn.reaction, tag);
                ran?;
                scheduler.finish(turn.reaction);
            }
            _ => {
                let (traced, timed) = (trace.is_some(), lag.is_timing());
                self.run_turns(scheduler, host, (recorder, lanes), (traced, timed));
                for (turn, ran) in self.turns.iter().zip(&mut self.results) {
                    let ran = ran.get_mut().unwrap_or_else(PoisonError::into_inner);
                    lag.ran(turn.reaction, ran.took);
                }
                if let Some(trace) = trace {
                    for (turn, ran) in self.turns.iter().zip(&mut self.results) {
                        let ran = ran.get_mut().unwrap_or_else(PoisonError::into_inner);
                        trace.begin(turn.reaction, mem::take(&mut ran.found));
                    }
                }
                self.commit(scheduler)?;
            }
        }
        Ok(true)
    }

    /// Runs the bodies of all turns. Notes for a trace what each finds, and for the lag watch how long it
    /// takes.
    fn run_turns<H: Host<Value = V>>(
        &mut self,
        scheduler: &mut Scheduler<V>,
        host: &H,
        (recorder, lanes): (&Recorder, &BoardLanes),
        (traced, timed): (bool, bool),
    ) {
        let Some(bodies) = host.shared_bodies() else {
            unreachable!("a host that has shared bodies keeps them")
        };
        self.results.resize_with(self.turns.len().max(self.results.len()), Mutex::default);
        self.swap(scheduler);
        let Self { threads, others, shared, turns, results } = self;
        let next = AtomicUsize::new(0);
        let work = || {
            let lane = threads.current_thread_index().map_or(0, |worker| worker + 1);
            // A thread that is free takes the next turn.
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                let (Some(turn), Some(result)) = (turns.get(index), results.get(index)) else {
                    return;
                };
                let mut ran = result.lock().unwrap_or_else(PoisonError::into_inner);
                let Ran { effects, outcome, found, took } = &mut *ran;
                if traced {
                    *found = reads(shared, turn.reaction, |value| bodies.describe(value));
                }
                let began = timed.then(Clock::local);
                let body = AssertUnwindSafe(|| bodies.react(shared, turn, effects));
                recorder.reaction(lane, turn.reaction, turn.body, shared.tag());
                lanes.begins(lane, turn.reaction);
                *outcome = Some(catch_unwind(body));
                lanes.ends(lane);
                recorder.reaction_end(lane, turn.reaction, shared.tag());
                *took = began.map_or(0, |began| Clock::local().since(began));
            }
        };
        let helpers = (*others).min(turns.len() - 1);
        host.run_unlocked(|| {
            threads.in_place_scope(|scope| {
                for _ in 0..helpers {
                    scope.spawn(|_| work());
                }
                work();
            });
        });
        self.swap(scheduler);
    }

    /// Does what the reactions have asked for, up to the first that failed.
    fn commit(&mut self, scheduler: &mut Scheduler<V>) -> Result<(), Failure> {
        for (turn, result) in self.turns.iter().zip(&mut self.results) {
            let ran = result.get_mut().unwrap_or_else(PoisonError::into_inner);
            match ran.outcome.take() {
                Some(Ok(Ok(()))) => scheduler.commit(turn, &mut ran.effects),
                Some(Ok(Err(failure))) => return Err(failure),
                Some(Err(panic)) => resume_unwind(panic),
                None => unreachable!("every turn is taken before the threads are done"),
            }
        }
        Ok(())
    }

    /// Puts the loop's scheduler where all threads can read it, or takes it back.
    fn swap(&mut self, scheduler: &mut Scheduler<V>) {
        match Arc::get_mut(&mut self.shared) {
            Some(shared) => mem::swap(shared, scheduler),
            None => unreachable!("a body that has returned holds no scheduler"),
        }
    }
}

impl<V: Clone> Default for Ran<V> {
    fn default() -> Self {
        Self { effects: Effects::default(), outcome: None, found: Vec::new(), took: 0 }
    }
}

/// Runs a reaction, and notes how long that takes while the program lags.
#[inline]
fn timed(
    lag: &mut LagWatch,
    reaction: ReactionId,
    run: impl FnOnce() -> Result<(), Failure>,
) -> Result<(), Failure> {
    if !lag.is_timing() {
        return run();
    }
    let began = Clock::local();
    run()?;
    lag.ran(reaction, Clock::local().since(began));
    Ok(())
}

#[cold]
fn warn_of_overload<H: Host>(program: &Program, scope: Scope, host: &mut H, overload: &Overload) {
    let message = overload.message(program, scope, |reaction| host.source_location(reaction));
    host.warn(&message);
}

#[cold]
fn warn_of_backlog<H: Host>(program: &Program, host: &mut H, connection: ConnectionId) {
    let [from, to] = ends(program, connection);
    let [newest, all] =
        ["1, \"replace\"", "n, \"block\""].map(|value| host.syntax().option_with("bound", value));
    host.warn(&format!(
        "{LARGE_BACKLOG} messages wait on the connection {from} ~> {to}, because its receiver is too slow\n  \
         hint: {newest} at the connection keeps only the newest message, and {all} makes the sender wait"
    ));
}

/// The names of the ports at the ends of a connection.
fn ends(program: &Program, connection: ConnectionId) -> [String; 2] {
    let Connection { from, to, .. } = &program.connections[connection];
    [from, to].map(|port| program.port_name(*port))
}

#[cold]
fn warn_of_tardy<H: Host>(
    scheduler: &Scheduler<H::Value>,
    host: &mut H,
    reaction: ReactionId,
    intended: Tag,
) {
    let start = scheduler.start_time();
    let lag = Clock::now().since(intended.due(start));
    host.warn(&format!(
        "reaction {} runs at {} for an input that was meant for {intended} and came {lag} ns after \
         that time. Give the federate a longer maxwait, or the reaction a `tardy` handler",
        scheduler.program().reaction_label(reaction),
        scheduler.tag(),
    ));
}
