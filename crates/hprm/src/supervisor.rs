//! The supervisor decides what is to be done about the federates that this process has launched. It is a
//! machine: it handles no process or thread itself.
//!
//! Its [`Driver`] tells the supervisor what happens, and when; the supervisor gives orders to the driver. It
//! reports the first failure, once the true cause is known, and not the failures that follow from it. After
//! that the federates have some time to end by themselves. Then the supervisor has the remaining processes
//! asked to end, and at last killed, so that none is left. Threads end with the process.
//!
//! Time is counted from the launch. The driver is the command's launcher if federates are processes, and the
//! Python package if they are threads.

mod advice;
mod driver;
mod signal;
mod starts;
mod transient;
mod verdict;

use std::collections::VecDeque;
use std::time::Duration;

use hprm_core::{FederateId, Program, Table};
use hprm_federated::Refusal;

use self::starts::Starts;
use self::transient::{Places, Renewal};
use crate::{Failure, Kind, Report, RtiEvent};
pub use advice::Advice;
pub use driver::{Driver, Outcome};
pub use signal::Signal;
pub use verdict::{FederateEnding, Verdict, on_answer, on_silent};

/// How long the supervisor waits for the second report of a failure after the first one: the RTI reports the
/// failure, and so does the end of the federate's process.
const GRACE: Duration = Duration::from_millis(500);
/// How long the other federates may take to end by themselves after a failure.
const AFTER_FAILURE: Duration = Duration::from_secs(2);
/// Two signals within this time count as one: the command `timeout` sends its signal both to a process and to
/// the process group.
pub const SIGNAL_DEBOUNCE: Duration = Duration::from_millis(100);
/// How long an orderly stop may take.
pub(crate) const AFTER_INTERRUPT: Duration = Duration::from_secs(5);
/// After this time the federates that have not ended get the signal themselves, and report the reaction
/// that does not return.
const REMINDER: Duration = Duration::from_secs(2);
/// How long a process may take to obey SIGTERM, and the system to obey SIGKILL.
pub(crate) const AFTER_SIGNAL: Duration = Duration::from_secs(1);

/// Whether federates are processes or threads.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Members {
    /// Processes, which can be asked to end, and killed.
    Processes,
    /// Threads of this process, which can neither be asked nor killed.
    Threads,
}

/// Something that has happened.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Observation {
    /// A federate has ended, and all that it wrote has been forwarded.
    Ended {
        /// The federate.
        federate: FederateId,
        /// In which way it has ended.
        how: FederateEnding,
    },
    /// The RTI reports an event.
    Rti(RtiEvent),
    /// The RTI has come to its end.
    RtiEnded(Result<(), Failure>),
    /// The output of federates cannot be forwarded.
    Unwritable(Box<Report>),
    /// A signal asks this process to stop.
    Signal(Signal),
}

/// Something to do.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Order {
    /// Ask the federation to stop at its next tag.
    RequestStop,
    /// Send a signal to a process, which has not been seen to end.
    Send {
        /// The signal.
        signal: Signal,
        /// The federate whose process it is.
        to: FederateId,
    },
    /// Start a federate again, whose process has ended.
    Start(FederateId),
    /// Show an error.
    Report(Box<Report>),
    /// Show a warning.
    Warn(Box<Report>),
}

/// What is known of a federate.
#[derive(Clone, PartialEq, Eq, Debug)]
struct FederateState {
    name: String,
    /// Whether the other federates continue without it.
    transient: bool,
    /// If this is a transient federate that has failed: the RTI's report of it, and when it came.
    dropped: Option<(Report, Duration)>,
    /// Whether the failure of its process has been reported.
    is_reported: bool,
    joined: bool,
    /// Whether it has loaded its program.
    loaded: bool,
    /// Whether its link has ended before all had joined, and it has not joined again.
    left: bool,
    /// Which processes the RTI knows as it, if it is transient.
    places: Places,
    /// Whether the RTI has refused a process because another one has joined as this federate.
    has_duplicate: bool,
    /// Whether the RTI has refused its process because the federation was ending.
    is_late: bool,
    /// How its process ended, and when that was known.
    ending: Option<(FederateEnding, Duration)>,
    /// When it has failed and with which exit code, if it is transient and has not come back.
    owed: Option<(Duration, i32)>,
    /// The same of a process that the supervisor has not started. It starts nothing that makes up for it.
    forfeit: Option<(Duration, i32)>,
    /// For a federate that is started again when it has ended.
    renewal: Option<Renewal>,
}

impl FederateState {
    /// Whether it belongs to the federation: it has joined, and its link has not ended since.
    fn is_member(&self) -> bool {
        self.joined && !self.left
    }
}

/// How far the end of the federation has come.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Phase {
    /// The supervisor has not ended it.
    Running,
    /// The federates are to end by themselves: in order, or because the federation has failed.
    Stopping { until: Duration, in_order: bool },
    /// They have been asked to end.
    Terminating { until: Duration },
    /// They have been killed.
    Killing { until: Duration },
}

/// The machine that this module describes.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Supervisor {
    members: Members,
    advice: Advice,
    federates: Table<FederateId, FederateState>,
    /// When all must have joined and loaded, so that the federation starts.
    start_until: Duration,
    started: bool,
    rti_ended: bool,
    /// Since when the RTI lets no federate join any more.
    closing: Option<Duration>,
    /// The federate that failed first according to the RTI, the RTI's report, and when it came.
    first_failure: Option<(FederateId, Report, Duration)>,
    /// With which failure the RTI has ended, and when.
    rti_failure: Option<(Failure, Duration)>,
    phase: Phase,
    /// Whether the supervisor has reported a failure: it reports only the first one.
    reported: bool,
    /// The exit code that follows from the first signal or failure.
    exit_code: Option<i32>,
    /// When a signal has asked this process to stop, if that was before anything failed.
    interrupted: Option<Duration>,
    /// When to send the signal to the federates that have not ended.
    reminder: Option<Duration>,
    orders: VecDeque<Order>,
    /// When [`Self::tick`] was called last: what was due then is done.
    last_tick: Duration,
}

impl Supervisor {
    /// A supervisor of federates that have just been started, and must all have joined and loaded within
    /// `join_timeout`.
    #[must_use]
    pub fn new(program: &Program, members: Members, join_timeout: Duration) -> Self {
        let federates = program.federates.values().map(|federate| FederateState {
            name: federate.name.clone(),
            transient: federate.transient,
            dropped: None,
            is_reported: false,
            joined: false,
            loaded: false,
            left: false,
            places: Places::default(),
            has_duplicate: false,
            is_late: false,
            ending: None,
            owed: None,
            forfeit: None,
            renewal: federate.restart.map(|restart| Renewal::new(Starts::new(restart))),
        });
        Self {
            members,
            advice: Advice::COMMAND,
            federates: federates.collect(),
            start_until: join_timeout,
            started: false,
            rti_ended: false,
            closing: None,
            first_failure: None,
            rti_failure: None,
            phase: Phase::Running,
            reported: false,
            exit_code: None,
            interrupted: None,
            reminder: None,
            orders: VecDeque::new(),
            last_tick: Duration::ZERO,
        }
    }

    /// Gives other advice than for users of the command.
    #[must_use]
    pub fn with_advice(self, advice: Advice) -> Self {
        Self { advice, ..self }
    }

    /// Starts no federate again that ends.
    pub fn leave(&mut self, federate: FederateId) {
        self.federates[federate].renewal = None;
    }

    /// Tells the supervisor what has happened.
    pub fn handle(&mut self, now: Duration, observed: Observation) {
        match observed {
            Observation::Ended { federate, how } => {
                self.federates[federate].ending.get_or_insert((how, now));
            }
            Observation::Rti(event) => self.handle_rti_event(now, event),
            Observation::RtiEnded(outcome) => {
                self.rti_ended = true;
                self.rti_failure = outcome.err().map(|failure| (failure, now));
            }
            Observation::Unwritable(report) if self.exit_code.is_none() => {
                self.reported = true;
                self.exit_code = Some(1);
                self.orders.push_back(Order::Report(report));
                self.stop(now);
            }
            Observation::Unwritable(_) => {}
            Observation::Signal(signal) => self.interrupt(now, signal),
        }
        self.tick(now);
    }

    /// Applies the time limits that have passed.
    pub fn tick(&mut self, now: Duration) {
        self.last_tick = now;
        let awaits_verdict = matches!(self.phase, Phase::Running | Phase::Stopping { .. });
        if awaits_verdict
            && !self.reported
            && let Some(verdict) = self.verdict(now)
        {
            self.fail(now, verdict);
        }
        self.tend_transient_federates(now);
        if let Some(at) = self.reminder
            && now >= at
        {
            self.reminder = None;
            self.send_all(Signal::INTERRUPT);
        }
        match self.phase {
            Phase::Stopping { until, in_order } if now >= until => {
                let (what, limit) = match in_order {
                    true => ("stopped in order", AFTER_INTERRUPT),
                    false => ("ended", AFTER_FAILURE),
                };
                let limit = limit.as_secs();
                self.warn_of_unfinished(&format!(
                    "ends federates that have not {what} within {limit} s"
                ));
                self.terminate(now);
            }
            Phase::Terminating { until } if now >= until => {
                self.warn_of_unfinished("killed federates that did not end by themselves");
                self.kill(now);
            }
            _ => {}
        }
    }

    /// The next order, if there is one.
    pub fn poll(&mut self) -> Option<Order> {
        self.orders.pop_front()
    }

    /// When to call [`Self::tick`] if nothing happens. That time may have passed since the last call.
    pub fn next_wakeup(&self) -> Option<Duration> {
        let phase = match self.phase {
            Phase::Running => None,
            Phase::Stopping { until, .. }
            | Phase::Terminating { until }
            | Phase::Killing { until } => Some(until),
        };
        let starting = (!self.started).then_some(self.start_until);
        let transient = self.federates.values().flat_map(FederateState::next_wakeup);
        let reported = self
            .first_failure
            .as_ref()
            .map(|(_, _, at)| *at)
            .into_iter()
            .chain(self.rti_failure.as_ref().map(|(_, at)| *at));
        let graces = reported.map(|at| at + GRACE);
        phase
            .into_iter()
            .chain(starting)
            .chain(self.reminder)
            .chain(graces)
            .chain(transient)
            .filter(|at| *at > self.last_tick)
            .min()
    }

    /// The exit code, once all is over.
    pub fn outcome(&self, now: Duration) -> Option<i32> {
        let gone = self.all_ended();
        let over = match self.phase {
            // The driver may not have seen yet that a killed process has ended: it forwards the output first,
            // which may be stuck.
            Phase::Killing { until } => gone || now >= until,
            _ if self.reported || matches!(self.phase, Phase::Terminating { .. }) => gone,
            // The RTI may still report a failure that no exit code shows.
            _ => gone && !self.awaits_start() && self.is_certain_of_success(now),
        };
        over.then(|| self.exit_code.or_else(|| self.transient_code()).unwrap_or(0))
    }

    /// Whether neither a failure nor a signal has ended the federation so far.
    pub fn has_not_failed(&self) -> bool {
        self.exit_code.is_none()
    }

    /// Whether a signal has stopped the federation.
    pub fn is_interrupted(&self) -> bool {
        self.interrupted.is_some()
    }

    fn handle_rti_event(&mut self, now: Duration, event: RtiEvent) {
        match event {
            RtiEvent::Refused { name, reason } => self.refused(&name, &reason),
            RtiEvent::Joined { federate, launched } => self.joined(federate, launched),
            RtiEvent::Closing => self.closing = self.closing.or(Some(now)),
            RtiEvent::Entered(federate) => self.entered(federate),
            RtiEvent::Withdrawn { federate, report } => self.withdrawn(now, federate, report),
            RtiEvent::Loaded(federate) => self.federates[federate].loaded = true,
            RtiEvent::Left(federate) => self.left(federate),
            RtiEvent::Started(_) => self.started(),
            RtiEvent::Silent { federate, silence } => {
                let name = &self.federates[federate].name;
                let report = Report::new(Kind::Lost, on_silent(name, silence));
                let report = report.hint(self.advice.silent);
                self.orders.push_back(Order::Warn(Box::new(report)));
            }
            RtiEvent::Answers { federate, silence } => {
                let name = &self.federates[federate].name;
                self.warn(Kind::Lost, on_answer(name, silence));
            }
            RtiEvent::Dropped { federate, report } => self.dropped(now, federate, report),
            RtiEvent::Failed { federate, report } => {
                self.first_failure.get_or_insert((federate, report, now));
            }
        }
    }

    /// The RTI has told a process that it may not join as that federate.
    fn refused(&mut self, name: &str, reason: &Refusal) {
        let named = self.federates.iter().find(|(_, federate)| federate.name == name);
        if let Some((id, _)) = named {
            let federate = &mut self.federates[id];
            match reason {
                Refusal::TooLate => federate.is_late |= federate.places.may_refuse_own(),
                Refusal::Duplicate => federate.has_duplicate = true,
                _ => {}
            }
        }
        if *reason != Refusal::TooLate {
            let said = format!("the RTI refuses a process as federate {name}: {reason}");
            let hint = reason.hint().map(str::to_owned);
            let report = Report { hint, ..Report::new(Kind::Refused, said) };
            self.orders.push_back(Order::Warn(Box::new(report)));
        }
    }

    /// A signal asks this process to stop. At the first signal the federation stops in order, at the second
    /// one the supervisor has all processes killed.
    fn interrupt(&mut self, now: Duration, signal: Signal) {
        if self.interrupted.is_some_and(|at| now < at + SIGNAL_DEBOUNCE) {
            return;
        }
        if self.exit_code.is_some() {
            // A broken pipe is no second signal: the driver reports it for each federate that writes to it.
            if signal != Signal::BROKEN_PIPE {
                if !matches!(self.phase, Phase::Killing { .. }) {
                    self.warn_of_unfinished(
                        "killed federates that had not ended at the second signal",
                    );
                }
                self.kill(now);
            }
            return;
        }
        self.exit_code = Some(signal.exit_code());
        self.interrupted = Some(now);
        self.stop(now);
    }

    /// Has the federation stop in order, if it runs.
    fn stop(&mut self, now: Duration) {
        if self.started && !self.rti_ended {
            self.orders.push_back(Order::RequestStop);
            self.phase = Phase::Stopping { until: now + AFTER_INTERRUPT, in_order: true };
            self.reminder = Some(now + REMINDER);
        } else {
            self.terminate(now);
        }
    }

    fn fail(&mut self, now: Duration, verdict: Verdict) {
        self.reported = true;
        self.exit_code.get_or_insert(verdict.code);
        self.orders.push_back(Order::Report(Box::new(verdict.report)));
        self.reminder = None;
        // The RTI has told the other federates to end, and they need time to do that in order. Processes that
        // have not started need none.
        if self.started || self.members == Members::Threads {
            // A failure after a signal ends the time for an orderly stop.
            self.phase = Phase::Stopping { until: now + AFTER_FAILURE, in_order: false };
        } else {
            self.terminate(now);
        }
    }

    /// Asks processes to end; threads cannot be asked.
    fn terminate(&mut self, now: Duration) {
        if self.members == Members::Threads {
            return self.kill(now);
        }
        self.reminder = None;
        self.phase = Phase::Terminating { until: now + AFTER_SIGNAL };
        self.send_all(Signal::TERMINATE);
    }

    /// Ends processes; threads end with this process, at once.
    fn kill(&mut self, now: Duration) {
        self.reminder = None;
        let grace = match self.members {
            Members::Processes => AFTER_SIGNAL,
            Members::Threads => Duration::ZERO,
        };
        self.phase = Phase::Killing { until: now + grace };
        self.send_all(Signal::KILL);
    }

    /// Sends a signal to the processes that have not ended; threads have none of their own.
    fn send_all(&mut self, signal: Signal) {
        if self.members == Members::Threads {
            return;
        }
        let unfinished = self.federates.iter().filter(|(_, federate)| federate.ending.is_none());
        self.orders.extend(unfinished.map(|(to, _)| Order::Send { signal, to }));
    }

    /// Reports what happens to the federates that have not ended, and why.
    fn warn_of_unfinished(&mut self, action: &str) {
        let unfinished = self.federates.values().filter(|federate| federate.ending.is_none());
        let names: Vec<_> = unfinished.map(|federate| federate.name.as_str()).collect();
        if !names.is_empty() {
            let warning = format!("{action}: {}", names.join(", "));
            self.warn(Kind::Unfinished, warning);
        }
    }

    fn warn(&mut self, kind: Kind, warning: String) {
        self.orders.push_back(Order::Warn(Box::new(Report::new(kind, warning))));
    }

    /// The cause of a failure, as soon as it is known.
    ///
    /// If a signal has killed a federate's process, that is the cause of all other reports. Otherwise the cause
    /// is what the RTI reports, because it knows which federate failed first; otherwise the failure of the RTI
    /// itself, which ends all federates; otherwise the exit code of a federate that the RTI has not reported.
    fn verdict(&self, now: Duration) -> Option<Verdict> {
        let due = |at: Duration| now >= at + GRACE;
        let signalled = self.first_ending(|_, how| matches!(how, FederateEnding::Signal(_)));
        if let Some((federate, _)) = signalled {
            return Some(self.verdict_on(federate));
        }
        if let Some((federate, _, at)) = &self.first_failure {
            let complete = self.federates[*federate].ending.is_some();
            return (complete || due(*at)).then(|| self.verdict_on(*federate));
        }
        if let Some((failure, at)) = &self.rti_failure {
            return due(*at).then(|| Verdict::on_rti(failure));
        }
        let disorderly =
            self.first_ending(|federate, how| !self.is_orderly(how) || !federate.is_member());
        if let Some((federate, at)) = disorderly {
            return due(at).then(|| self.verdict_on(federate));
        }
        // If the federation has been asked to stop, federates that still wait for others are told to stop, so
        // none is late.
        let is_running = self.phase == Phase::Running;
        (is_running && now >= self.start_until && !self.started)
            .then(|| self.verdict_on_late_start())
    }

    /// The failure of a federate, by what the RTI has reported of it and how its process has ended.
    fn verdict_on(&self, id: FederateId) -> Verdict {
        let federate = &self.federates[id];
        let first_failure = self.first_failure.as_ref().filter(|(federate, _, _)| *federate == id);
        let rti_report = first_failure.map(|(_, report, _)| report);
        let ending = federate.ending.as_ref().map(|(how, _)| how);
        let absent = (!federate.joined).then_some(self.advice);
        Verdict::on_federate(&federate.name, absent, rti_report, ending)
    }

    /// The failure of a federation that has not started in time: names the federates that have not joined, or, if
    /// all have joined, those that have not loaded their programs.
    fn verdict_on_late_start(&self) -> Verdict {
        let absent =
            self.federates.values().filter(|federate| !federate.is_member() && !federate.transient);
        let absent: Vec<_> = absent.map(|federate| federate.name.as_str()).collect();
        let loading =
            self.federates.values().filter(|federate| federate.is_member() && !federate.loaded);
        let loading: Vec<_> = loading.map(|federate| federate.name.as_str()).collect();
        let seconds = self.start_until.as_secs_f64();
        Verdict::on_late_start(&absent, &loading, seconds, self.advice)
    }

    /// Among the federates that are not transient and have ended in a way for which `is` holds, the one that
    /// ended first, and when.
    fn first_ending(
        &self,
        is: impl Fn(&FederateState, &FederateEnding) -> bool,
    ) -> Option<(FederateId, Duration)> {
        let required = self.federates.iter().filter(|(_, federate)| !federate.transient);
        let ended = required.filter_map(|(id, federate)| {
            let (how, at) = federate.ending.as_ref()?;
            is(federate, how).then_some((id, *at))
        });
        ended.min_by_key(|(_, at)| *at)
    }

    /// Whether all federates have ended in order, and no report of a failure can come any more.
    fn is_certain_of_success(&self, now: Duration) -> bool {
        let has_succeeded = |federate: &FederateState| {
            let is_orderly = federate.ending.as_ref().is_some_and(|(how, _)| self.is_orderly(how));
            match federate.transient {
                true => federate.dropped.is_none() && (is_orderly || federate.is_reported),
                false => federate.joined && is_orderly,
            }
        };
        let endings = self.federates.values().filter_map(|federate| federate.ending.as_ref());
        let grace_is_over = endings.map(|(_, at)| *at).max().is_none_or(|at| now >= at + GRACE);
        let none_has_failed = self.first_failure.is_none() && self.rti_failure.is_none();
        none_has_failed
            && self.federates.values().all(has_succeeded)
            && (self.rti_ended || grace_is_over)
    }

    /// Whether a federate's process that ends like this has ended in order. The signal that has stopped this
    /// process may have reached the federate's process too: then that one ends with the signal's code.
    fn is_orderly(&self, how: &FederateEnding) -> bool {
        *how == FederateEnding::Code(0)
            || self.is_interrupted() && *how == FederateEnding::Code(Signal::INTERRUPT.exit_code())
    }

    /// Whether all federates have ended.
    #[must_use]
    pub fn all_ended(&self) -> bool {
        self.federates.values().all(|federate| federate.ending.is_some())
    }
}

#[cfg(test)]
mod tests;
