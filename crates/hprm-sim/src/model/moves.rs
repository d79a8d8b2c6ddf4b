//! What machines do, computed once for each of their states: many states of a federation differ only in others.
//!
//! What a machine does follows from its state, the time, and the input: from nothing else.

use std::cell::RefCell;
use std::collections::BTreeMap;
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

/// All moves so far, by the digest of what they follow from. The states of one search share them.
#[derive(Clone, Default)]
pub(super) struct Moves(Rc<RefCell<Known>>);

#[derive(Default)]
struct Known {
    seats: BTreeMap<u128, Rc<MovedSeat>>,
    rti: BTreeMap<u128, Rc<MovedRti>>,
}

impl Moves {
    /// A federate does something.
    pub(super) fn of_seat(
        &self,
        seat: &Shared<Seat>,
        now: PhysicalTime,
        what: Move,
    ) -> Rc<MovedSeat> {
        let key = digest(&(seat.digest(), now, &what));
        let known = &mut self.0.borrow_mut().seats;
        let moved = known.entry(key).or_insert_with(|| {
            let mut machine = seat.clone();
            let (result, outputs) = machine.change(|seat| {
                let result = seat.go(now, what);
                (result, std::mem::take(&mut seat.node.outputs).into())
            });
            machine.digest();
            Rc::new(Moved { machine, outputs, result })
        });
        Rc::clone(moved)
    }

    /// The RTI handles an input.
    pub(super) fn of_rti(
        &self,
        rti: &Shared<Rti>,
        now: PhysicalTime,
        input: RtiInput,
    ) -> Rc<MovedRti> {
        let key = digest(&(rti.digest(), now, &input));
        let known = &mut self.0.borrow_mut().rti;
        let moved = known.entry(key).or_insert_with(|| {
            let mut machine = rti.clone();
            let (result, outputs) = machine.change(|rti| {
                let result = rti.handle(now, input);
                (result, std::iter::from_fn(|| rti.poll()).collect())
            });
            machine.digest();
            Rc::new(Moved { machine, outputs, result })
        });
        Rc::clone(moved)
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
