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
    ousting: Option<Ousting>,
}

impl Renewal {
    pub(super) fn new(starts: Starts) -> Self {
        Self { starts, at: None, ousting: None }
    }

    fn begin(&mut self, now: Duration) {
        *self = Self::new(self.starts.clone());
        self.starts.start(now);
    }
}

/// Which process it is that has joined as a federate.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Origin {
    /// The one that the supervisor has started last.
    Own,
    /// One that a user has started.
    Other,
}

/// The processes that are a transient federate, as far as the RTI has told. What the RTI tells of a process that ended before
/// the supervisor's last start is about neither.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(super) struct Places {
    /// The process that takes part.
    member: Option<Origin>,
    /// The process that joins meanwhile, and will take its place.
    joining: Option<Origin>,
    /// Whether the supervisor's own process has joined since it was started.
    has_own_joined: bool,
}

impl Places {
    fn join(&mut self, origin: Origin, is_running: bool) {
        self.has_own_joined |= origin == Origin::Own;
        let place = match is_running || self.member.is_some() {
            true => &mut self.joining,
            false => &mut self.member,
        };
        *place = Some(origin);
    }

    /// The process that was joining, or has joined just before the start, does not take part.
    fn withdraw(&mut self) -> Option<Origin> {
        self.joining.take().or_else(|| self.member.take())
    }

    /// Whether a process that is refused now may be the supervisor's own one.
    pub(super) fn may_refuse_own(&self) -> bool {
        match self.joining {
            Some(origin) => origin == Origin::Own,
            None => !self.has_own_joined,
        }
    }

    fn is_taken(&self) -> bool {
        self.member == Some(Origin::Other)
    }

    fn is_being_taken(&self) -> bool {
        self.joining == Some(Origin::Other)
    }

    /// The supervisor starts a process, because its former one has ended.
    fn begin(&mut self) {
        for place in [&mut self.member, &mut self.joining] {
            place.take_if(|origin| *origin == Origin::Own);
        }
        self.has_own_joined = false;
    }
}

impl FederateState {
    /// The end of its process that is to be dealt with.
    fn new_ending(&self) -> Option<&(FederateEnding, Duration)> {
        self.ending.as_ref().filter(|_| self.transient && !self.is_reported)
    }

    /// Whether its process has ended because it was refused: another one has joined as this federate. Of a member that
    /// fails, the RTI tells.
    fn was_duplicate(&self) -> bool {
        let own = self.new_ending().map(|(how, _)| how);
        self.has_duplicate && self.dropped.is_none() && own == Some(&REFUSED)
    }

    /// Whether its process has ended because there was no federation any more that it could join, since `closing`.
    fn came_too_late(&self, closing: Option<Duration>) -> bool {
        let Some((how, at)) = self.new_ending() else { return false };
        // The RTI may have gone before the process could ask it.
        let found_none = !self.places.has_own_joined
            && *how == REFUSED
            && closing.is_some_and(|closing| *at >= closing);
        found_none || self.is_late && *how != FederateEnding::Code(0)
    }

    /// Whether it goes on, or comes back, without a process that was joining as it.
    fn does_without_other(&self, now: Duration) -> bool {
        let goes_on = self.places.member == Some(Origin::Own) && self.ending.is_none();
        let comes_back = |renewal: &Renewal| {
            let decide = |(how, at): &(_, _)| renewal.starts.decide(End::of(how), *at, now);
            let decision = self.new_ending().map(decide);
            renewal.at.is_some() || matches!(decision, Some(Decision::Again(_)))
        };
        goes_on || self.renewal.as_ref().is_some_and(comes_back)
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

    /// A process has joined as that federate.
    pub(super) fn joined(&mut self, id: FederateId, launched: bool) {
        let is_running = self.started;
        let federate = &mut self.federates[id];
        (federate.joined, federate.left) = (true, false);
        let origin = if launched { Origin::Own } else { Origin::Other };
        federate.places.join(origin, is_running);
    }

    /// The link of a process has ended before the start. It may join again.
    pub(super) fn left(&mut self, id: FederateId) {
        let federate = &mut self.federates[id];
        federate.left = true;
        federate.places.member = None;
    }

    /// The federation starts, with the processes that have joined.
    pub(super) fn started(&mut self) {
        self.started = true;
        let ids: Vec<_> = self.federates.ids().collect();
        ids.into_iter().for_each(|id| self.give_way(id));
    }

    /// The process that was joining takes part.
    pub(super) fn entered(&mut self, id: FederateId) {
        let places = &mut self.federates[id].places;
        places.member = places.joining.take().or(places.member);
        self.give_way(id);
    }

    /// If a process takes part that a user has started, the supervisor starts none in its place.
    fn give_way(&mut self, id: FederateId) {
        let federate = &mut self.federates[id];
        let planned = federate.renewal.as_mut().filter(|_| federate.places.is_taken());
        if planned.and_then(|renewal| renewal.at.take()).is_some() {
            let name = &federate.name;
            let said =
                format!("federate {name} is not started again: another process has joined as it");
            self.warn(Kind::Left, said);
        }
    }

    /// The process that took part as that federate has failed.
    pub(super) fn dropped(&mut self, now: Duration, id: FederateId, report: Report) {
        let federate = &mut self.federates[id];
        match federate.places.member.take() {
            Some(Origin::Own) => federate.dropped = Some((report, now)),
            Some(Origin::Other) => self.lost_other(now, id, &report),
            // The supervisor has dealt with the end of that process.
            None => {}
        }
    }

    /// The process that was joining as that federate does not take part.
    pub(super) fn withdrawn(&mut self, now: Duration, id: FederateId, report: Option<Report>) {
        let federate = &mut self.federates[id];
        let (Some(origin), Some(report)) = (federate.places.withdraw(), report) else { return };
        match origin {
            Origin::Own => federate.dropped = Some((report, now)),
            Origin::Other if federate.does_without_other(now) => {
                let name = &federate.name;
                let said = format!("another process was joining as federate {name}, and has ended");
                let said = match report.kind {
                    Kind::Lost => said,
                    _ => format!("{said}: {}", report.message),
                };
                self.warn(Kind::Left, said);
            }
            Origin::Other => self.lost_other(now, id, &report),
        }
    }

    /// The federation has lost a process that a user has started.
    fn lost_other(&mut self, now: Duration, id: FederateId, report: &Report) {
        let federate = &mut self.federates[id];
        let verdict = Verdict::on_federate(&federate.name, None, Some(report), None);
        federate.forfeit.get_or_insert((now, verdict.code));
        if self.exit_code.is_none() {
            self.orders.push_back(Order::Report(Box::new(verdict.report)));
        }
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
        if federate.ending.is_some() || !is_lost || !is_open {
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

    /// Deals with an end or a failure of its own process, once both that and the RTI have told of it.
    fn settle(&mut self, now: Duration, id: FederateId) {
        let due = |at: Duration| now >= at + GRACE;
        let federate = &self.federates[id];
        let ended = federate.new_ending();
        let failed = ended.filter(|(how, _)| *how != FederateEnding::Code(0));
        // What has ended in order is asked for no report: but the RTI may say that the federation ends. What has ended
        // for a process that joins in its place is started again only if that one does not take part.
        let orderly = ended.filter(|(how, _)| *how == FederateEnding::Code(0));
        let orderly = orderly.filter(|_| !federate.places.is_being_taken());
        let is_kept = federate.renewal.is_some() && federate.ending.is_none();
        let complete = match (&federate.dropped, failed) {
            (None, None) => orderly.is_some_and(|(_, at)| due(*at)) && federate.renewal.is_some(),
            (Some(_), Some(_)) => true,
            (Some((_, at)), None) => due(*at) && !is_kept,
            (None, Some((_, at))) => due(*at),
        };
        if !complete {
            return;
        }
        if federate.came_too_late(self.closing) {
            self.conclude_late(id);
        } else if federate.was_duplicate() {
            self.conclude_duplicate(now, id);
        } else {
            self.conclude(now, id);
        }
    }

    /// What could not join because the federation ends has not failed.
    fn conclude_late(&mut self, id: FederateId) {
        let is_ending_well = self.exit_code.is_none() && !self.reported;
        let federate = &mut self.federates[id];
        (federate.is_reported, federate.dropped) = (true, None);
        let is_back = federate.renewal.as_ref().is_some_and(|it| it.starts.count() > 0);
        let said = match is_back {
            true => "does not come back: the federation ends",
            false => "has not joined: the federation has ended",
        };
        if is_ending_well {
            let said = format!("federate {} {said}", federate.name);
            self.warn(Kind::Absent, said);
        }
    }

    /// Nor has what could not join because another process has. If that one does not take part after all, another one is
    /// started.
    fn conclude_duplicate(&mut self, now: Duration, id: FederateId) {
        let is_open = self.is_open();
        let federate = &mut self.federates[id];
        federate.is_reported = true;
        let Some(renewal) = federate.renewal.as_mut().filter(|_| is_open) else { return };
        if federate.places.is_taken() {
            return;
        }
        match renewal.starts.again(now, now) {
            Decision::Again(at) => renewal.at = Some(at),
            _ => {
                let verdict = Verdict::on_federate(&federate.name, None, None, Some(&REFUSED));
                let report = verdict.too_often(renewal.starts.limit(), self.advice);
                self.orders.push_back(Order::Warn(Box::new(report)));
            }
        }
    }

    fn conclude(&mut self, now: Duration, id: FederateId) {
        let is_open = self.is_open();
        let federate = &mut self.federates[id];
        let ended = federate.new_ending().cloned();
        let dropped = federate.dropped.take().map(|(report, _)| report);
        federate.is_reported |= ended.is_some();
        let renewal = federate.renewal.as_mut();
        let is_ousted = renewal.as_ref().is_some_and(|it| it.ousting.is_some());
        let decision = match (&ended, &renewal) {
            (Some((how, at)), Some(renewal)) if is_open && !federate.places.is_taken() => {
                let end = if is_ousted { End::Silent } else { End::of(how) };
                renewal.starts.decide(end, *at, now)
            }
            _ => Decision::Leave,
        };
        let how = ended.map(|(how, _)| how);
        let in_order = how == Some(FederateEnding::Code(0)) && dropped.is_none();
        // The signal that has ended it was the supervisor's: the silence before is what happened.
        let told = how.as_ref().filter(|_| !is_ousted || dropped.is_none());
        let verdict = match in_order {
            true => Verdict::on_leave(&federate.name),
            false => Verdict::on_federate(&federate.name, None, dropped.as_ref(), told),
        };
        match in_order {
            true => federate.owed = None,
            false => drop(federate.owed.get_or_insert((now, verdict.code))),
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
        let federate = &mut self.federates[id];
        let Some(renewal) = &mut federate.renewal else { return };
        if renewal.at.is_some() && !is_open {
            renewal.at = None;
            if is_ending_well {
                let name = &federate.name;
                let said = format!("federate {name} does not come back: the federation ends");
                self.warn(Kind::Absent, said);
            }
            return;
        }
        let places = &federate.places;
        if renewal.at.is_none_or(|at| now < at) || places.is_being_taken() || places.is_taken() {
            return;
        }
        renewal.begin(now);
        (federate.joined, federate.left, federate.loaded) = (false, false, false);
        (federate.has_duplicate, federate.is_late) = (false, false);
        federate.places.begin();
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
