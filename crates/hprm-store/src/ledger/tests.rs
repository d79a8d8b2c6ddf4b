//! What the ledger promises: holds keep blocks, releases free them, limits are kept.

use proptest::prelude::*;

use super::*;

const OWNER: FederateId = FederateId(0);
const B: FederateId = FederateId(1);
const C: FederateId = FederateId(2);
const LIMITS: StoreLimits = StoreLimits {
    capacity_bytes: 8 << 20,
    segment_min_bytes: 2 << 20,
    when_full: WhenFull::Inline,
};

fn ledger() -> Ledger {
    Ledger::new(OWNER, LIMITS)
}

/// Asks as the store does: a segment is mapped when one is needed.
fn loan(ledger: &mut Ledger, len: u64) -> Result<Loan, LoanError> {
    match ledger.loan(len) {
        Err(LoanError::NeedsSegment { len: segment }) => {
            ledger.add_segment(segment);
            ledger.loan(len)
        }
        other => other,
    }
}

#[test]
fn a_segment_has_the_least_size_or_room_for_two() {
    assert_eq!(ledger().loan(100), Err(LoanError::NeedsSegment { len: 2 << 20 }));
    assert_eq!(ledger().loan((2 << 20) + 1), Err(LoanError::NeedsSegment { len: 6 << 20 }));
}

#[test]
fn an_object_stays_until_its_last_reader_releases_it() {
    let mut ledger = ledger();
    let loan = loan(&mut ledger, 100).unwrap();
    let object = ledger.seal(loan, &[B, C]);
    ledger.release(object.serial, C).unwrap();
    assert_eq!(ledger.stats().bytes_in_use, 128);
    ledger.release(object.serial, B).unwrap();
    assert_eq!((ledger.stats().bytes_in_use, ledger.stats().releases), (0, 2));
}

#[test]
fn an_object_sent_twice_to_a_reader_is_released_twice() {
    let mut ledger = ledger();
    let loan = loan(&mut ledger, 100).unwrap();
    let object = ledger.seal(loan, &[B, B]);
    ledger.release(object.serial, B).unwrap();
    assert_eq!(ledger.stats().bytes_in_use, 128);
    ledger.release(object.serial, B).unwrap();
    assert_eq!(ledger.stats().bytes_in_use, 0);
}

#[test]
fn a_release_that_is_not_due_changes_nothing() {
    let mut ledger = ledger();
    let loan = loan(&mut ledger, 100).unwrap();
    let object = ledger.seal(loan, &[B]);
    let before = ledger.clone();
    let serial = object.serial;
    assert_eq!(ledger.release(serial, C), Err(HoldError::NotHolding { serial, reader: C }));
    assert_eq!(ledger.release(77, B), Err(HoldError::UnknownObject { serial: 77 }));
    assert_eq!(ledger, before);
}

#[test]
fn without_readers_or_sealed_never_the_block_is_free_and_the_serial_used() {
    let mut ledger = ledger();
    let first = loan(&mut ledger, 100).unwrap();
    let first = ledger.seal(first, &[]);
    let second = loan(&mut ledger, 100).unwrap();
    ledger.abandon(second);
    let third = loan(&mut ledger, 100).unwrap();
    let third = ledger.seal(third, &[B]);
    assert_eq!((first.serial, third.serial), (0, 2));
    assert_eq!((first.segment, first.offset), (third.segment, third.offset));
    assert_eq!(ledger.stats().objects_sealed, 2);
}

#[test]
fn a_lost_reader_holds_nothing() {
    let mut ledger = ledger();
    let shared = loan(&mut ledger, 100).unwrap();
    let shared = ledger.seal(shared, &[B, C]);
    let alone = loan(&mut ledger, 100).unwrap();
    ledger.seal(alone, &[B, B]);
    ledger.reader_lost(B);
    assert_eq!(ledger.stats().bytes_in_use, 128);
    ledger.release(shared.serial, C).unwrap();
    assert_eq!(ledger.stats().bytes_in_use, 0);
}

#[test]
fn a_reader_can_be_added_while_the_object_is_held() {
    let mut ledger = ledger();
    let loan = loan(&mut ledger, 100).unwrap();
    let object = ledger.seal(loan, &[B]);
    let serial = object.serial;
    assert_eq!(ledger.add_reader(serial, C), Ok(object));
    ledger.release(serial, B).unwrap();
    ledger.release(serial, C).unwrap();
    assert_eq!(ledger.add_reader(serial, C), Err(HoldError::UnknownObject { serial }));
}

#[test]
fn the_owner_has_as_many_views_as_holds_and_only_it_ends_them() {
    let mut ledger = ledger();
    let loan = loan(&mut ledger, 100).unwrap();
    let object = ledger.seal(loan, &[OWNER]);
    let serial = object.serial;
    let forged = ObjectRef { len: 101, ..object };
    assert_eq!(ledger.view(&forged), Err(HoldError::UnknownObject { serial }));
    ledger.view(&object).unwrap();
    let none_left = HoldError::NotHolding { serial, reader: OWNER };
    assert_eq!(ledger.view(&object), Err(none_left));
    assert_eq!(ledger.release(serial, OWNER), Err(none_left));
    ledger.reader_lost(OWNER);
    assert_eq!(ledger.stats().bytes_in_use, 128);
    ledger.end_view(serial);
    assert_eq!(ledger.stats().bytes_in_use, 0);
}

#[test]
fn the_capacity_is_used_to_the_last_page_and_not_exceeded() {
    let mut ledger = ledger();
    let held = loan(&mut ledger, 5 << 20).unwrap();
    assert_eq!(ledger.stats().bytes_mapped, 8 << 20);
    let rest = loan(&mut ledger, 2 << 20).unwrap();
    assert_eq!(ledger.stats().bytes_mapped, 8 << 20);
    let full = LoanError::Full { asked: 2 << 20, capacity: 8 << 20, in_use: 7 << 20 };
    assert_eq!(loan(&mut ledger, 2 << 20), Err(full));
    assert!(matches!(loan(&mut ledger, u64::MAX), Err(LoanError::Full { .. })));
    let gap = loan(&mut ledger, 1 << 20).unwrap();
    assert!(matches!(loan(&mut ledger, 0), Err(LoanError::Full { asked: 0, .. })));
    ledger.abandon(gap);
    ledger.abandon(held);
    ledger.abandon(rest);
}

#[test]
fn growing_arrays_retire_segments_that_have_become_too_short() {
    let mut ledger = ledger();
    for len in [1 << 20, 3 << 20, 7 << 20, 8 << 20] {
        let loan = loan(&mut ledger, len).unwrap();
        assert!(ledger.stats().bytes_mapped <= LIMITS.capacity_bytes);
        ledger.abandon(loan);
    }
    assert_eq!(ledger.take_retired(), [0, 1]);
    assert_eq!((ledger.stats().segments, ledger.stats().bytes_mapped), (1, 8 << 20));
}

#[test]
fn no_segment_is_retired_in_vain() {
    let mut ledger = ledger();
    let held = loan(&mut ledger, 3 << 20).unwrap();
    let short = loan(&mut ledger, 2 << 20).unwrap();
    ledger.abandon(short);
    assert!(matches!(loan(&mut ledger, 6 << 20), Err(LoanError::Full { .. })));
    assert_eq!(ledger.take_retired(), []);
    ledger.abandon(held);
}

#[derive(Clone, Debug)]
enum Step {
    Put { len: u64, readers: Vec<u16> },
    Abandon { len: u64 },
    Release { which: prop::sample::Index },
    View { which: prop::sample::Index },
    Lost { reader: u16 },
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let len = 1_u64..3_000_000;
    let which = any::<prop::sample::Index>();
    let step = prop_oneof![
        3 => (len.clone(), prop::collection::vec(0_u16..4, 0..4))
            .prop_map(|(len, readers)| Step::Put { len, readers }),
        1 => len.prop_map(|len| Step::Abandon { len }),
        3 => which.clone().prop_map(|which| Step::Release { which }),
        1 => which.prop_map(|which| Step::View { which }),
        1 => (1_u16..4).prop_map(|reader| Step::Lost { reader }),
    ];
    prop::collection::vec(step, 1..80)
}

/// What the ledger should know: each hold with its object, and whether it is a view.
#[derive(Default)]
struct Holds(Vec<(ObjectRef, FederateId, bool)>);

impl Holds {
    fn assert_apart_from(&self, loan: &Loan) {
        let block = loan.block();
        for (object, ..) in &self.0 {
            let apart = object.segment != block.segment
                || object.offset + object.len <= block.offset
                || block.offset + block.len <= object.offset;
            assert!(apart, "{block:?} is loaned while {object:?} is held");
        }
    }

    fn release(&mut self, ledger: &mut Ledger, index: usize) {
        let (object, reader, view) = self.0.swap_remove(index);
        if view {
            ledger.end_view(object.serial);
        } else {
            ledger.release(object.serial, reader).unwrap();
        }
    }

    fn apply(&mut self, ledger: &mut Ledger, step: Step) {
        match step {
            Step::Put { len, readers } => {
                let Ok(loan) = loan(ledger, len) else { return };
                self.assert_apart_from(&loan);
                let readers: Vec<_> = readers.into_iter().map(FederateId).collect();
                let object = ledger.seal(loan, &readers);
                self.0.extend(readers.into_iter().map(|reader| (object, reader, false)));
            }
            Step::Abandon { len } => {
                let Ok(loan) = loan(ledger, len) else { return };
                self.assert_apart_from(&loan);
                ledger.abandon(loan);
            }
            Step::Release { which } if !self.0.is_empty() => {
                let index = which.index(self.0.len());
                self.release(ledger, index);
            }
            Step::View { which } if !self.0.is_empty() => {
                let index = which.index(self.0.len());
                let (object, reader, view) = &mut self.0[index];
                if *reader == OWNER && !*view {
                    ledger.view(object).unwrap();
                    *view = true;
                }
            }
            Step::Lost { reader } => {
                ledger.reader_lost(FederateId(reader));
                self.0.retain(|(_, holder, _)| *holder != FederateId(reader));
            }
            Step::Release { .. } | Step::View { .. } => {}
        }
    }
}

proptest! {
    #[test]
    fn what_is_held_is_not_loaned_and_what_is_released_is_free(steps in steps()) {
        let mut ledger = ledger();
        let mut holds = Holds::default();
        for step in steps {
            holds.apply(&mut ledger, step);
            prop_assert!(ledger.stats().bytes_mapped <= LIMITS.capacity_bytes);
            let held: BTreeMap<_, _> =
                holds.0.iter().map(|(object, ..)| (object.serial, object.len)).collect();
            prop_assert!(ledger.stats().bytes_in_use >= held.values().sum());
            prop_assert_eq!(ledger.sealed.len(), held.len());
        }
        while !holds.0.is_empty() {
            holds.release(&mut ledger, 0);
        }
        prop_assert_eq!(ledger.stats().bytes_in_use, 0);
        prop_assert_eq!(ledger.arena.free_segments().count(), ledger.stats().segments as usize);
    }
}
