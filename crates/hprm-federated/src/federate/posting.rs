//! What this federate shows on its board, and what it finds on the boards of others.
//!
//! The rules by which boards tell how far a federate may advance are in `boards`. Here is when this federate posts:
//! whenever it knows its next step and others would learn something. While it processes a tag, its board says what was true
//! before, which is safe.
//!
//! A federate that begins a tag at once because of one message posts nothing before: for the others, the bound for a message
//! that it has not read is the tag of that message. Where its board would say more, as that a clock has gone on, or which of
//! several messages is the next, it posts before it begins, because the tag may take long.
//!
//! Inputs that the driver follows with its next event, or with how far it has come within a tag, change nothing here:
//! however many boards and messages have come, this federate looks once.

use std::collections::BTreeMap;

use hprm_core::{FederateId, Nanos, PhysicalTime, Tag};

use super::elsewhere::Elsewhere;
use super::{Activity, Coordinator, Federate};
use crate::boards::{Boards, Reading, readings};
use crate::decentralized::Decentralized;
use crate::{Fault, Frame, Output, Permission, Posting, Step};

/// How often a federate that a clock may wake at any moment posts how far its clock is.
const CLOCK_POST: Nanos = 10_000_000;

/// The boards, and what this federate has shown on its own.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Showing {
    pub(super) boards: Boards,
    /// The federates that share no memory with this one.
    pub(super) elsewhere: Elsewhere,
    /// Whether it sends to no federate, and none joins late, to which all show what they have counted.
    is_last: bool,
    /// What it has posted last, but for its tallies.
    shown: Option<Shown>,
    /// When it posted last.
    shown_at: PhysicalTime,
    /// Federates that ask to leave, with the number of the process, for which the RTI waits until this one has read
    /// that on their boards.
    departing: BTreeMap<FederateId, u32>,
}

/// What a posting says, but for its tallies and whether the federate has ended.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
struct Shown {
    next: Step,
    waits: Step,
    departs: bool,
}

impl Federate {
    /// From now on, boards say how far this federate may advance, and its messages go directly to their receivers.
    pub(super) fn use_boards(&mut self) {
        let near = |other| self.startup.shares_boards_with(other);
        let boards = Boards::new(&self.topology, self.me);
        let readings = readings(&self.topology).into_iter();
        let readings: Vec<_> =
            readings.filter(|it| it.partner_of(self.me).is_some_and(near)).collect();
        let elsewhere = Elsewhere::new();
        let shown_at = PhysicalTime(i64::MIN);
        let departing = BTreeMap::new();
        let is_last = !boards.has_downstream() && !self.topology.has_transients();
        let shown = None;
        self.showing = Some(Showing { boards, elsewhere, is_last, shown, shown_at, departing });
        for federate in self.topology.federates() {
            self.meet_on_boards(federate);
        }
        let mut machine = Decentralized::on_boards(&self.topology, self.me);
        self.gone.iter().for_each(|peer| machine.closed(*peer));
        self.coordinator = Coordinator::Decentralized(machine);
        self.startup.need_links();
        self.startup.need_boards(readings.iter().filter(|it| it.reader == self.me));
        self.hand_out_board(readings.into_iter());
        for (owner, notifier) in self.startup.take_early_boards() {
            self.attach_board(owner, notifier);
        }
        for (owner, posting) in self.startup.take_early_postings() {
            self.read_board(owner, posting);
        }
    }

    /// Takes into account which process is a federate now, if one is, and whether that shares memory with this federate.
    pub(super) fn meet_on_boards(&mut self, federate: FederateId) {
        let is_near = federate == self.me || self.startup.shares_boards_with(federate);
        let life = self.startup.life(federate);
        let Some(Showing { boards, elsewhere, .. }) = &mut self.showing else { return };
        boards.is_near(federate, is_near);
        elsewhere.forget(federate);
        match life {
            None => boards.is_without(federate),
            Some(_) if !is_near => elsewhere.meet(&self.topology, self.me, federate),
            Some(_) => {}
        }
        if let Some(life) = life.filter(|_| self.topology.has_transients()) {
            boards.meet(&self.topology, federate, life);
        }
    }

    /// Gives the board of this federate to others that read it.
    pub(super) fn hand_out_board(&mut self, readings: impl Iterator<Item = Reading>) {
        for reading in readings.filter(|it| it.owner == self.me) {
            for notifier in reading.descriptors() {
                let Reading { reader, owner, .. } = reading;
                self.outputs.push_back(Output::ToRti(Frame::Board { owner, reader, notifier }));
            }
        }
    }

    /// The board of another federate has come, or what wakes it up; to one that joins late, before it knows the others.
    pub(super) fn take_board(&mut self, now: PhysicalTime, owner: FederateId, notifier: bool) {
        match self.startup.awaits_peers() {
            true => self.startup.keep_board(owner, notifier),
            false => self.attach_board(owner, notifier),
        }
        self.get_ready(now);
    }

    fn attach_board(&mut self, owner: FederateId, notifier: bool) {
        let joins_late = self.reads_boards() && self.topology.is_transient(owner);
        if self.startup.takes_board(owner, notifier) || joins_late {
            self.outputs.push_back(Output::Board { owner, notifier });
        }
    }

    /// How many tallies this federate shows.
    #[must_use]
    pub fn tallies(&self) -> usize {
        self.showing.as_ref().map_or(0, |showing| showing.boards.own().tallies.len())
    }

    /// Whether this federate reads boards.
    #[must_use]
    pub fn reads_boards(&self) -> bool {
        self.showing.is_some()
    }

    /// Through which step, as the boards say, every message has arrived that is read there; none without boards.
    #[must_use]
    pub fn known_by_boards(&self) -> Option<Step> {
        match &self.coordinator {
            Coordinator::Decentralized(machine) => {
                self.showing.as_ref().map(|_| machine.safe_through())
            }
            Coordinator::Centralized(_) => None,
        }
    }

    /// Whether what others show may let this federate go on, or answer the RTI. Otherwise it may leave their boards unread.
    #[must_use]
    pub fn heeds_boards(&self) -> bool {
        let Some(Showing { shown, departing, .. }) = &self.showing else { return false };
        let waits = shown.is_none_or(|shown| shown.waits > Step::NEVER);
        waits || !departing.is_empty() || self.meeting.awaits_boards()
    }

    /// The federates that need not wait any more because of what this federate has posted.
    #[must_use]
    pub fn released(&mut self) -> Vec<FederateId> {
        let tells = self.next_step().is_some() || self.ended;
        let showing = self.showing.as_mut().filter(|_| tells);
        showing.map(|showing| showing.boards.released(&self.topology)).unwrap_or_default()
    }

    /// A federate elsewhere shows something new.
    pub(super) fn take_posting(&mut self, from: FederateId, posting: Posting) -> Result<(), Fault> {
        if self.startup.awaits_peers() && self.topology.is_transient(self.me) {
            self.startup.keep_posting(from, posting);
            return Ok(());
        }
        if self.is_not_met(from) {
            return Ok(());
        }
        if !self.showing.as_mut().is_some_and(|showing| showing.elsewhere.came(from)) {
            return Err(Fault::Unexpected { frame: "Posting" });
        }
        self.read_board(from, posting);
        Ok(())
    }

    /// Another federate shows something new.
    pub(super) fn read_board(&mut self, from: FederateId, posting: Posting) {
        if let Some(showing) = &mut self.showing {
            showing.boards.read(from, posting);
        }
    }

    /// A federate asks to leave. This one answers when it has read that on the board.
    pub(super) fn peer_departs(&mut self, federate: FederateId, incarnation: u32) {
        if let Some(showing) = &mut self.showing {
            showing.departing.insert(federate, incarnation);
        }
    }

    /// Posts what is new, finds out how far this federate may advance, and answers about federates that leave.
    #[inline]
    pub(super) fn look_at_boards(&mut self, now: PhysicalTime) {
        if self.reads_boards() {
            self.post_and_find_out(now);
        }
    }

    fn post_and_find_out(&mut self, now: PhysicalTime) {
        let Some(start) = self.startup.start().filter(|_| !self.ended) else { return };
        let Some(next) = self.next_on_boards() else { return };
        self.include_those_that_may_be(now.since(start));
        if self.needs_no_posting(next, now, start) {
            return;
        }
        let departs = self.wants_to_leave && self.departure.is_none();
        let (Some(showing), Coordinator::Decentralized(machine)) =
            (&mut self.showing, &mut self.coordinator)
        else {
            return;
        };
        let mut certain = machine.certain(now, start, self.current, next);
        if departs {
            certain = certain.min(Step::begin(self.current.succ().max(self.first)));
        }
        showing.boards.post(certain, departs);
        if departs {
            // What this federate had promised before has gone around a cycle, perhaps, and come back as what it knows.
            machine.only_safe(showing.boards.known(&self.topology));
        }
        let says_less = showing.shown.is_some_and(|shown| shown.next >= certain);
        let is_known = says_less && showing.boards.unshown() <= 1 && !departs;
        // Before that, nothing depends on it, and then this federate looks again. Often its messages tell it enough.
        if self.awaited(next, now, start) > Step::NEVER {
            self.learn_from_boards();
        }
        if !is_known || !self.begins_at_once(now, start) {
            let waits = self.awaited(next, now, start);
            self.show(now, Shown { next: certain, waits, departs }, certain < next && !departs);
        }
        self.tell_elsewhere(next);
        self.answer_about_departures();
        self.answer_about_arrivals();
    }

    /// Whether what this federate does matters to no other one, and it waits for none.
    fn needs_no_posting(&self, next: Step, now: PhysicalTime, start: PhysicalTime) -> bool {
        let matters_to_none = self.showing.as_ref().is_some_and(Showing::matters_to_none);
        let waits = || self.awaited(next, now, start) > Step::NEVER;
        matters_to_none && !self.wants_to_leave && (!waits() || self.begins_at_once(now, start))
    }

    /// Sends what this federate shows to those that need it, and to those for whose boards it waits. It tells the latter
    /// before its next tag is due: their answers take time.
    fn tell_elsewhere(&mut self, next: Step) {
        if self.showing.as_ref().is_none_or(|showing| showing.elsewhere.is_empty()) {
            return;
        }
        let needs = if next.tag < Tag::FOREVER { self.needs(next) } else { Step::NEVER };
        let Some(Showing { boards, elsewhere, .. }) = &mut self.showing else { return };
        let mut knows = || needs <= Step::NEVER || needs <= boards.known(&self.topology);
        let waits = if !elsewhere.may_ask() || knows() { Step::NEVER } else { needs };
        elsewhere.wait_for(waits);
        let postings = elsewhere.due(boards, &self.topology);
        self.send_postings(postings);
    }

    fn send_postings(&mut self, postings: Vec<(FederateId, Posting)>) {
        for (reader, posting) in postings {
            self.route(reader, Frame::Posting { owner: self.me, reader, posting });
        }
    }

    /// Finds out how far this federate may advance, from what it has read.
    pub(super) fn learn_from_boards(&mut self) {
        if let (Some(showing), Coordinator::Decentralized(machine)) =
            (&mut self.showing, &mut self.coordinator)
        {
            machine.safe(showing.boards.known(&self.topology));
        }
    }

    /// Whether this federate is between two tags, and the driver begins the next one now.
    fn begins_at_once(&self, now: PhysicalTime, start: PhysicalTime) -> bool {
        let Activity::Idle(tag) = self.activity else { return false };
        tag < Tag::FOREVER
            && self.is_due(tag, now, start)
            && self.permission(tag, now) == Permission::Granted
    }

    fn show(&mut self, now: PhysicalTime, shown: Shown, by_clock: bool) {
        let Some(showing) = &mut self.showing else { return };
        if let Some(posting) = showing.news(now, shown, by_clock) {
            showing.elsewhere.show(&posting);
            self.outputs.push_back(Output::Post(posting));
        }
    }

    /// This federate has ended: nothing more comes from it.
    pub(super) fn post_end(&mut self) {
        if let Some(showing) = &mut self.showing {
            showing.boards.end();
            let posting = showing.boards.own().clone();
            let postings = showing.elsewhere.last(&posting);
            self.outputs.push_back(Output::Post(posting));
            self.send_postings(postings);
        }
    }

    /// When to look at the boards again, if nothing wakes this federate up before: others do not wake it up for a
    /// tag that is not due, and they may wait for what a clock can cause here.
    pub(super) fn next_look(&self) -> Option<PhysicalTime> {
        let (showing, next) = (self.showing.as_ref()?, self.next_on_boards()?);
        let start = self.startup.start()?;
        let posting = showing.boards.own();
        let limited = posting.next < next && !posting.departs && showing.boards.has_downstream();
        let clock = limited.then(|| showing.shown_at.plus(CLOCK_POST));
        let due = next.tag.due(start);
        let unasked = posting.waits == Step::NEVER && !self.is_fast;
        let due = (unasked && self.needs(next) > Step::NEVER).then_some(due);
        clock.into_iter().chain(due).min()
    }

    /// The next step of this federate, if it is known and there are boards.
    fn next_on_boards(&self) -> Option<Step> {
        Some(self.showing.as_ref()?.boards.until_stop(self.next_step()?))
    }

    /// Through which step this federate must know its inputs now, to go on; `NEVER` if it does not wait for that.
    fn awaited(&self, next: Step, now: PhysicalTime, start: PhysicalTime) -> Step {
        match self.is_due(next.tag, now, start) {
            true => self.needs(next),
            false => Step::NEVER,
        }
    }

    /// Whether a tag begins as soon as the coordination permits it.
    fn is_due(&self, tag: Tag, now: PhysicalTime, start: PhysicalTime) -> bool {
        self.is_fast || tag.due(start) <= now
    }

    fn needs(&self, next: Step) -> Step {
        let Coordinator::Decentralized(machine) = &self.coordinator else { return Step::NEVER };
        match self.activity {
            Activity::Within(step) => machine.needs(step),
            _ => machine.needs_to_begin(next.tag),
        }
    }

    /// Answers about the federates that ask to leave, if their boards say so by now. From then on this federate
    /// relies on nothing that they said before.
    fn answer_about_departures(&mut self) {
        let (Some(showing), Coordinator::Decentralized(machine)) =
            (&mut self.showing, &mut self.coordinator)
        else {
            return;
        };
        let Showing { boards, departing, .. } = showing;
        let read: Vec<_> = departing.keys().copied().filter(|it| boards.departs(*it)).collect();
        for federate in read {
            let Some(incarnation) = departing.remove(&federate) else { continue };
            machine.only_safe(boards.known(&self.topology));
            let frame = Frame::Met { federate, incarnation, after: self.current };
            self.outputs.push_back(Output::ToRti(frame));
        }
    }
}

impl Showing {
    /// Whether no federate needs to know how far this one has got: it sends to none, and neither shows that it waits nor
    /// asks federates elsewhere, nor does one that leaves wait for its answer. Those that release it count its messages.
    fn matters_to_none(&self) -> bool {
        let does_not_wait = || self.shown.is_some_and(|shown| shown.waits == Step::NEVER);
        let is_asked = || !self.departing.is_empty();
        self.is_last && self.elsewhere.is_empty() && does_not_wait() && !is_asked()
    }

    /// What is to be posted, if it is new. What only a clock changes is posted now and then.
    fn news(&mut self, now: PhysicalTime, new: Shown, by_clock: bool) -> Option<Posting> {
        if let Some(shown) = self.shown.filter(|_| self.boards.unshown() == 0) {
            let same = Shown { next: shown.next, ..new } == shown;
            let soon = by_clock && now < self.shown_at.plus(CLOCK_POST);
            if same && (new.next == shown.next || soon) {
                return None;
            }
        }
        self.shown_at = now;
        self.shown = Some(new);
        Some(self.boards.show(new.waits))
    }
}
