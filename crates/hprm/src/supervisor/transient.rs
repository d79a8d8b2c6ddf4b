//! Transient federates under a supervisor: their failures, and starting them again.
//!
//! The others go on whatever becomes of them. [`Starts`] says whether one is to be started again; here is whether there
//! is a federation to come back to, and what is told.

use std::time::Duration;

use hprm_core::{FederateId, show_time};

use super::starts::{Decision, End, Starts};
use super::{
    AFTER_FAILURE, AFTER_SIGNAL, FederateEnding, FederateState, GRACE, Order, Phase, Signal,
    Supervisor, Verdict,
};
use crate::{Kind, Report};

/// How a process ends that could not join.
const REFUSED: FederateEnding = FederateEnding::Code(1);

/// How far a process is ended that the federation has lost, and that has not ended itself.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Ousting {
    /// It has been asked to end.
    Asked { until: Duration },
    /// It has been killed.
    Killed,
}

/// What is known of a federate that is started again when it has ended.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Renewal {
    pub(super) starts: Starts,
    /// When it is started again.
    pub(super) at: Option<Duration>,
    /// Whether the RTI has refused a process because the federation was ending.
    is_late: bool,
    /// Whether it has been told that it does not come back.
    is_given_up: bool,
    ousting: Option<Ousting>,
}

impl Renewal {
    pub(super) fn new(starts: Starts) -> Self {
        Self { starts, at: None, is_late: false, is_given_up: false, ousting: None }
    }

    /// A process has come when the federation was ending.
    pub(super) fn refused(&mut self) {
        self.is_late = self.starts.count() > 0;
    }

    fn begin(&mut self, now: Duration) {
        *self = Self::new(self.starts.clone());
        self.starts.start(now);
    }
}

impl FederateState {
    /// Whether what the RTI says of a failure can only be about an earlier process: this one has not joined.
    pub(super) fn is_old_news(&self) -> bool {
        let renewal = self.renewal.as_ref();
        renewal.is_some_and(|it| it.starts.count() > 0 && !self.joined && self.ending.is_none())
    }

    /// The end of its process that is to be dealt with.
    fn new_ending(&self) -> Option<&(FederateEnding, Duration)> {
        self.ending.as_ref().filter(|_| self.transient && !self.is_reported)
    }

    /// Whether the process that the federation has lost is another one than the supervisor's own, which has not ended
    /// or has ended in order.
    fn is_loss_of_other(&self) -> bool {
        let own = self.new_ending().map(|(how, _)| how);
        let own_is_well = own.is_none_or(|how| *how == FederateEnding::Code(0));
        self.is_replaced && self.dropped.is_some() && own_is_well
    }

    /// Whether its process has ended because it was refused: another one was joining as this federate. Of a member that
    /// fails, the RTI tells.
    fn was_duplicate(&self) -> bool {
        let own = self.new_ending().map(|(how, _)| how);
        self.has_duplicate && self.dropped.is_none() && own == Some(&REFUSED)
    }

    /// When the supervisor has something to do about it, if nothing more becomes known.
    pub(super) fn next_wakeup(&self) -> impl Iterator<Item = Duration> + '_ {
        let lost = self.dropped.as_ref().map(|(_, at)| *at);
        let renewal = self.renewal.as_ref();
        let ousting = match renewal.and_then(|it| it.ousting) {
            Some(Ousting::Asked { until }) => Some(until),
            _ => None,
        };
        let end = self.ending.as_ref().map(|(_, at)| *at + GRACE);
        let silence = lost.map(|at| at + AFTER_FAILURE).filter(|_| renewal.is_some());
        let again = renewal.and_then(|it| it.at);
        [lost.map(|at| at + GRACE), end, silence, ousting, again].into_iter().flatten()
    }
}

impl Supervisor {
    /// Reports transient federates that have failed, and has those started again for which the program states it.
    pub(super) fn tend_transient_federates(&mut self, now: Duration) {
        let ids: Vec<_> = self.federates.ids().collect();
        for id in ids {
            self.oust(now, id);
            self.settle(now, id);
            self.renew(now, id);
        }
    }

    /// Whether a federate that is started now can take part.
    fn is_open(&self) -> bool {
        self.phase == Phase::Running
            && !self.reported
            && self.exit_code.is_none()
            && self.closing.is_none()
            && !self.rti_ended
    }

    /// A process has joined as that federate. It may be one that a user has started while the supervisor's own one runs, or
    /// in the pause after its end: it has taken that one's place.
    pub(super) fn joined(&mut self, id: FederateId) {
        let federate = &mut self.federates[id];
        federate.is_replaced |= federate.is_member();
        (federate.joined, federate.left) = (true, false);
        let planned = federate.renewal.as_mut().filter(|_| federate.is_replaced);
        if planned.and_then(|renewal| renewal.at.take()).is_some() {
            let name = &federate.name;
            let said =
                format!("federate {name} is not started again: another process has joined as it");
            self.warn(Kind::Left, said);
        }
    }

    /// Whether the process of a federate that was started again has ended because there was no federation any more that
    /// it could join.
    fn came_too_late(&self, federate: &FederateState) -> bool {
        let Some((how, at)) = &federate.ending else { return false };
        let renewal = federate.renewal.as_ref().filter(|it| it.starts.count() > 0);
        // The RTI may have gone before the process could ask it.
        let found_none = !federate.joined
            && *how == REFUSED
            && self.closing.is_some_and(|closing| *at >= closing);
        renewal.is_some_and(|it| found_none || it.is_late && *how != FederateEnding::Code(0))
    }

    /// Whether a federate is to be started again.
    pub(super) fn awaits_start(&self) -> bool {
        let renewals = self.federates.values().filter_map(|federate| federate.renewal.as_ref());
        self.is_open() && renewals.clone().any(|renewal| renewal.at.is_some())
    }

    /// Ends a process that the federation has lost, so that it can be started again.
    fn oust(&mut self, now: Duration, id: FederateId) {
        let is_open = self.is_open();
        let federate = &mut self.federates[id];
        let Some(renewal) = &mut federate.renewal else { return };
        let is_lost = federate.dropped.as_ref().is_some_and(|(_, at)| now >= *at + AFTER_FAILURE);
        let is_own = federate.joined && !federate.is_replaced;
        if federate.ending.is_some() || !is_lost || !is_own || !is_open {
            return;
        }
        let signal = match renewal.ousting {
            None => {
                renewal.ousting = Some(Ousting::Asked { until: now + AFTER_SIGNAL });
                Signal::TERMINATE
            }
            Some(Ousting::Asked { until }) if now >= until => {
                renewal.ousting = Some(Ousting::Killed);
                Signal::KILL
            }
            Some(_) => return,
        };
        self.orders.push_back(Order::Send { signal, to: id });
    }

    /// Deals with an end or a failure, once both the process and the RTI have told of it. If the user has started
    /// such a federate by hand, only the RTI tells of its failure.
    fn settle(&mut self, now: Duration, id: FederateId) {
        let due = |at: Duration| now >= at + GRACE;
        let federate = &self.federates[id];
        let ended = federate.new_ending();
        let failed = ended.filter(|(how, _)| *how != FederateEnding::Code(0));
        // What has ended in order is asked for no report: but the RTI may say that the federation ends.
        let orderly = ended.filter(|(how, _)| *how == FederateEnding::Code(0));
        let is_kept = federate.renewal.is_some() && federate.joined && !federate.is_replaced;
        let complete = match (&federate.dropped, failed) {
            (None, None) => orderly.is_some_and(|(_, at)| due(*at)) && federate.renewal.is_some(),
            (Some(_), Some(_)) => true,
            (Some((_, at)), None) => due(*at) && !(is_kept && federate.ending.is_none()),
            (None, Some((_, at))) => due(*at),
        };
        if complete {
            self.conclude(now, id);
        }
    }

    fn conclude(&mut self, now: Duration, id: FederateId) {
        let is_open = self.is_open();
        let is_late = self.came_too_late(&self.federates[id]);
        let federate = &mut self.federates[id];
        let ended = federate.new_ending().cloned();
        let (is_of_other, was_duplicate) = (federate.is_loss_of_other(), federate.was_duplicate());
        federate.is_replaced |= was_duplicate;
        let dropped = federate.dropped.take().map(|(report, _)| report);
        federate.is_reported |= ended.is_some();
        let renewal = federate.renewal.as_mut();
        let is_ousted = renewal.as_ref().is_some_and(|it| it.ousting.is_some());
        let decision = match (&ended, &renewal) {
            (Some((how, at)), Some(renewal)) if is_open && !federate.is_replaced && !is_late => {
                let end = if is_ousted { End::Silent } else { End::of(how) };
                renewal.starts.decide(end, *at, now)
            }
            _ => Decision::Leave,
        };
        let how = ended.map(|(how, _)| how);
        let in_order = how == Some(FederateEnding::Code(0)) && dropped.is_none();
        // The signal that has ended it was the supervisor's: the silence before is what happened.
        let told = how.as_ref().filter(|_| !is_of_other && (!is_ousted || dropped.is_none()));
        let verdict = match in_order {
            true => Verdict::on_leave(&federate.name),
            false => Verdict::on_federate(&federate.name, None, dropped.as_ref(), told),
        };
        // What could not join has not failed.
        if is_late || was_duplicate {
            return;
        }
        match (in_order, is_of_other) {
            (true, _) => federate.owed = None,
            (false, true) => drop(federate.forfeit.get_or_insert((now, verdict.code))),
            (false, false) => drop(federate.owed.get_or_insert((now, verdict.code))),
        }
        match (decision, &mut federate.renewal) {
            (Decision::Again(at), Some(renewal)) => {
                renewal.at = Some(at);
                let again = verdict.again(renewal.starts.pause(), renewal.starts.count() + 1);
                self.orders.push_back(Order::Warn(Box::new(again)));
            }
            (Decision::TooOften, Some(renewal)) => {
                let report = verdict.too_often(renewal.starts.limit(), self.advice);
                self.orders.push_back(Order::Report(Box::new(report)));
            }
            _ if !in_order && self.exit_code.is_none() => {
                self.orders.push_back(Order::Report(Box::new(verdict.report)));
            }
            _ => {}
        }
    }

    /// Starts a federate again when it is time, or gives that up.
    fn renew(&mut self, now: Duration, id: FederateId) {
        let is_open = self.is_open();
        let is_ending_well = self.exit_code.is_none() && !self.reported;
        let was_late = self.came_too_late(&self.federates[id]);
        let federate = &mut self.federates[id];
        let Some(renewal) = &mut federate.renewal else { return };
        let is_given_up = renewal.at.is_some() && !is_open;
        if is_given_up || was_late {
            renewal.at = None;
            if is_ending_well && !std::mem::replace(&mut renewal.is_given_up, true) {
                let name = &federate.name;
                let said = format!("federate {name} does not come back: the federation ends");
                self.warn(Kind::Absent, said);
            }
            return;
        }
        if renewal.at.is_none_or(|at| now < at) {
            return;
        }
        renewal.begin(now);
        (federate.joined, federate.left, federate.loaded) = (false, false, false);
        (federate.is_replaced, federate.has_duplicate) = (false, false);
        (federate.is_reported, federate.dropped, federate.ending) = (false, None, None);
        self.orders.push_back(Order::Start(id));
    }

    /// The exit code that follows from the first failure of a transient federate that has not come back.
    pub(super) fn transient_code(&self) -> Option<i32> {
        let is_made_up = |federate: &FederateState| {
            let came_back = federate.renewal.as_ref().is_some_and(|it| it.starts.count() > 0);
            let ended = federate.ending.as_ref().map(|(how, _)| how);
            // An end that was dealt with has cleared what is owed, or is a failure itself.
            came_back && !federate.is_reported && ended == Some(&FederateEnding::Code(0))
        };
        let owed = |federate: &FederateState| federate.owed.filter(|_| !is_made_up(federate));
        let all = self.federates.values().flat_map(|it| [owed(it), it.forfeit]).flatten();
        all.min_by_key(|(at, _)| *at).map(|(_, code)| code)
    }
}

impl Verdict {
    /// A federate has left in order.
    fn on_leave(name: &str) -> Self {
        let report = Report::new(Kind::Left, format!("federate {name} has ended with code 0"));
        Self { report: report.of(name), code: 0 }
    }

    /// The same, and that it is started again.
    fn again(&self, pause: Duration, number: u32) -> Report {
        let pause = show_time(i64::try_from(pause.as_nanos()).unwrap_or(i64::MAX));
        let report = self.report.clone();
        // What to do is being done.
        Report {
            hint: None,
            ..report.continued(&format!("; restart {number} follows, after {pause}"))
        }
    }

    /// The same, and that it is not started again, because it has been started too often.
    fn too_often(&self, (burst, interval): (u32, Duration), advice: super::Advice) -> Report {
        let interval = show_time(i64::try_from(interval.as_nanos()).unwrap_or(i64::MAX));
        let times = if burst == 1 { "once".to_owned() } else { format!("{burst} times") };
        let said =
            format!("; it is not started again: it has been started {times} within {interval}");
        self.report.clone().continued(&said).hint(advice.too_often)
    }
}

impl Report {
    /// The same, with something added to the first line of its message.
    fn continued(self, more: &str) -> Self {
        let (first, rest) = match self.message.split_once('\n') {
            Some((first, rest)) => (first, format!("\n{rest}")),
            None => (self.message.as_str(), String::new()),
        };
        Self { message: format!("{first}{more}{rest}"), rendered: None, ..self }
    }
}

#[cfg(test)]
mod tests;
