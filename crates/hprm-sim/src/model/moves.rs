//! What machines do, computed once for each of their states: many states of a federation differ only in others.
//!
//! What a machine does follows from its state, the time, and the input: from nothing else.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::hash::Hash;
use std::rc::Rc;

use hprm_core::PhysicalTime;
use hprm_federated::{Fault, Frame, Input, Output, Rti, RtiInput, RtiOutput, Step};

use super::digest::{Shared, digest};
use super::state::Seat;
use crate::node::Turn;

/// What a federate is to do.
#[derive(Hash)]
pub(super) enum Move {
    /// It reports, or processes a tag.
    Advance,
    /// It handles an input.
    Handle(Input),
}

/// A machine after a move, the outputs of that, and how it ended.
pub(super) struct Moved<M, O, R> {
    pub(super) machine: Shared<M>,
    pub(super) outputs: Vec<O>,
    pub(super) result: Result<R, Fault>,
}

type MovedSeat = Moved<Seat, Output, Turn>;
type MovedRti = Moved<Rti, RtiOutput, ()>;

/// All moves so far. The states of one search share them.
#[derive(Clone, Default)]
pub(super) struct Moves(Rc<OfAll>);

#[derive(Default)]
struct OfAll {
    seats: Known<Seat, Output, Turn>,
    rti: Known<Rti, RtiOutput, ()>,
}

impl Moves {
    /// A federate does something.
    pub(super) fn of_seat(
        &self,
        seat: &Shared<Seat>,
        now: PhysicalTime,
        what: Move,
    ) -> Rc<MovedSeat> {
        self.0.seats.moved(seat, (now, what), |seat, (now, what)| {
            let result = seat.go(now, what);
            (result, std::mem::take(&mut seat.node.outputs).into())
        })
    }

    /// The RTI handles an input.
    pub(super) fn of_rti(
        &self,
        rti: &Shared<Rti>,
        now: PhysicalTime,
        input: RtiInput,
    ) -> Rc<MovedRti> {
        self.0.rti.moved(rti, (now, input), |rti, (now, input)| {
            let result = rti.handle(now, input);
            (result, std::iter::from_fn(|| rti.poll()).collect())
        })
    }
}

/// The moves of machines of one kind.
struct Known<M, O, R>(RefCell<ByDigest<M, O, R>>);

/// By the digest of what they follow from.
type ByDigest<M, O, R> = BTreeMap<u128, Rc<Moved<M, O, R>>>;

impl<M: Clone + Hash, O, R> Known<M, O, R> {
    /// What `go` makes of the machine and the cause; it is called the first time only.
    fn moved<C: Hash>(
        &self,
        machine: &Shared<M>,
        cause: C,
        go: impl FnOnce(&mut M, C) -> (Result<R, Fault>, Vec<O>),
    ) -> Rc<Moved<M, O, R>> {
        let key = digest(&(machine.digest(), &cause));
        let mut known = self.0.borrow_mut();
        let moved = known.entry(key).or_insert_with(|| {
            let mut machine = machine.clone();
            let (result, outputs) = machine.change(|machine| go(machine, cause));
            machine.digest();
            Rc::new(Moved { machine, outputs, result })
        });
        Rc::clone(moved)
    }
}

impl<M, O, R> Default for Known<M, O, R> {
    fn default() -> Self {
        Self(RefCell::default())
    }
}

impl Seat {
    fn go(&mut self, now: PhysicalTime, what: Move) -> Result<Turn, Fault> {
        let input = match what {
            Move::Advance => return self.node.advance_once(now),
            Move::Handle(input) => input,
        };
        match input {
            Input::FromRti(Frame::TagAdvanceGrant { tag }) => self.grant(Step::end(tag)),
            Input::FromRti(
                Frame::ProvisionalTagAdvanceGrant { through } | Frame::Safe { through },
            ) => self.grant(through),
            Input::FromRti(Frame::StopGranted { tag }) => {
                self.granted = self.granted.min(Step::end(tag.pred()));
            }
            _ => {}
        }
        self.node.input(now, input).map(|()| Turn::Done)
    }

    fn grant(&mut self, through: Step) {
        self.granted = self.granted.max(through);
    }
}
