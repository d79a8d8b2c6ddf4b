//! Loans and holds in any order: no byte is in two blocks, and all are free at the end.
//!
//! First with the ledger alone, then with memory: an object that a reader holds keeps its bytes, whatever
//! else is written.

use std::collections::{BTreeMap, BTreeSet};
use std::os::fd::AsFd;

use hprm_core::{FederateId, ObjectRef};
use hprm_store::{Block, Ledger, Loan, LoanError, Object, Store, StoreLimits, WritableLoan};
use proptest::prelude::*;
use proptest::sample::Index;

const OWNER: FederateId = FederateId(0);
const READERS: u16 = 4;
const CAPACITY: u64 = 6 << 20;

fn limits() -> StoreLimits {
    StoreLimits { capacity_bytes: CAPACITY, segment_min_bytes: 1 << 20, ..StoreLimits::default() }
}

#[derive(Clone, Debug)]
enum Step {
    Loan { len: u64 },
    Seal { which: Index, readers: Vec<u16> },
    Abandon { which: Index },
    Add { which: Index, reader: u16 },
    Release { which: Index },
    ReleaseAtRandom { serial: u64, reader: u16 },
    View { which: Index },
    EndView { which: Index },
    Lost { reader: u16 },
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let reader = || 0..READERS;
    let which = any::<Index>;
    // Small ones, large ones, and those that fit in no segment.
    let len = prop_oneof![4 => 0_u64..100_000, 3 => 100_000_u64..2_000_000, 1 => any::<u64>()];
    let step = prop_oneof![
        4 => len.prop_map(|len| Step::Loan { len }),
        3 => (which(), prop::collection::vec(reader(), 0..4))
            .prop_map(|(which, readers)| Step::Seal { which, readers }),
        1 => which().prop_map(|which| Step::Abandon { which }),
        2 => (which(), reader()).prop_map(|(which, reader)| Step::Add { which, reader }),
        4 => which().prop_map(|which| Step::Release { which }),
        1 => (0_u64..40, reader())
            .prop_map(|(serial, reader)| Step::ReleaseAtRandom { serial, reader }),
        1 => which().prop_map(|which| Step::View { which }),
        1 => which().prop_map(|which| Step::EndView { which }),
        1 => (1..READERS).prop_map(|reader| Step::Lost { reader }),
    ];
    prop::collection::vec(step, 1..120)
}

/// A simple model of what the ledger must do.
#[derive(Default)]
struct Model {
    ledger: Option<Ledger>,
    /// The lengths of the segments; the number of a retired segment is never used again.
    segments: BTreeMap<u32, u64>,
    retired: BTreeSet<u32>,
    loans: Vec<Loan>,
    /// By serial number: the reference, the block, the holders (once for each hold), and the views.
    objects: BTreeMap<u64, (ObjectRef, Block, Vec<FederateId>, usize)>,
}

impl Model {
    fn new() -> Self {
        Self { ledger: Some(Ledger::new(OWNER, limits())), ..Self::default() }
    }

    fn ledger(&mut self) -> &mut Ledger {
        self.ledger.as_mut().expect("it is set from the start")
    }

    /// Requests a loan as the store does. Returns whether there was room.
    fn loan(&mut self, len: u64) -> bool {
        let mut loan = self.ledger().loan(len);
        if let Err(LoanError::NeedsSegment { len: needed }) = loan {
            for segment in self.ledger().take_retired() {
                assert!(self.owners().iter().all(|block| block.segment != segment), "{segment}");
                assert!(self.segments.remove(&segment).is_some(), "{segment} never existed");
                self.retired.insert(segment);
            }
            let segment = self.ledger().add_segment(needed);
            assert!(!self.retired.contains(&segment), "{segment} is used again");
            self.segments.insert(segment, needed);
            loan = self.ledger().loan(len);
        }
        let Ok(loan) = loan else { return false };
        assert!(loan.block().len >= len);
        self.loans.push(loan);
        true
    }

    /// The blocks of all loans and objects.
    fn owners(&self) -> Vec<Block> {
        let objects = self.objects.values().map(|(_, block, ..)| *block);
        self.loans.iter().map(Loan::block).chain(objects).collect()
    }

    fn pick(&self, which: Index) -> Option<u64> {
        let serials: Vec<_> = self.objects.keys().copied().collect();
        (!serials.is_empty()).then(|| *which.get(&serials))
    }

    fn forget_unheld(&mut self) {
        self.objects.retain(|_, (_, _, holds, views)| !holds.is_empty() || *views > 0);
    }

    fn apply(&mut self, step: Step) {
        match step {
            Step::Loan { len } => drop(self.loan(len)),
            Step::Seal { which, readers } if !self.loans.is_empty() => {
                let loan = self.loans.swap_remove(which.index(self.loans.len()));
                let (block, len) = (loan.block(), loan.len());
                let holds: Vec<_> = readers.into_iter().map(FederateId).collect();
                let object = self.ledger().seal(loan, &holds);
                assert_eq!((object.segment, object.offset), (block.segment, block.offset));
                assert_eq!((object.owner, object.len), (OWNER, len));
                self.objects.insert(object.serial, (object, block, holds, 0));
            }
            Step::Abandon { which } if !self.loans.is_empty() => {
                let loan = self.loans.swap_remove(which.index(self.loans.len()));
                self.ledger().abandon(loan);
            }
            Step::Add { which, reader } => {
                let Some(serial) = self.pick(which) else { return };
                let added = self.ledger().add_reader(serial, FederateId(reader));
                let (object, _, holds, _) = self.objects.get_mut(&serial).expect("it was picked");
                assert_eq!(added, Ok(*object));
                holds.push(FederateId(reader));
            }
            Step::Release { which } => {
                let Some(serial) = self.pick(which) else { return };
                let (_, _, holds, _) = self.objects.get_mut(&serial).expect("it was picked");
                let Some(reader) = holds.pop() else { return };
                self.ledger().release(serial, reader).expect("it holds the object");
            }
            Step::ReleaseAtRandom { serial, reader } => {
                let reader = FederateId(reader);
                let holds = self.objects.get_mut(&serial).map(|(_, _, holds, _)| holds);
                let at = holds.and_then(|holds| {
                    let at = holds.iter().position(|holder| *holder == reader)?;
                    Some(holds.swap_remove(at))
                });
                let before = self.ledger().clone();
                let released = self.ledger().release(serial, reader);
                assert_eq!(released.is_ok(), at.is_some());
                assert!(released.is_ok() || before == *self.ledger(), "an error changes nothing");
            }
            Step::View { which } => {
                let Some(serial) = self.pick(which) else { return };
                let (object, _, holds, views) = self.objects.get_mut(&serial).expect("picked");
                let object = *object;
                let at = holds.iter().position(|holder| *holder == OWNER);
                if let Some(at) = at {
                    holds.swap_remove(at);
                    *views += 1;
                }
                assert_eq!(self.ledger().view(&object).is_ok(), at.is_some());
            }
            Step::EndView { which } => {
                let Some(serial) = self.pick(which) else { return };
                let (_, _, _, views) = self.objects.get_mut(&serial).expect("it was picked");
                if *views > 0 {
                    *views -= 1;
                    self.ledger().end_view(serial);
                }
            }
            Step::Lost { reader } => {
                self.ledger().reader_lost(FederateId(reader));
                for (_, _, holds, _) in self.objects.values_mut() {
                    holds.retain(|holder| *holder != FederateId(reader));
                }
            }
            Step::Seal { .. } | Step::Abandon { .. } => {}
        }
        self.forget_unheld();
    }

    fn check(&mut self) {
        let mut owners = self.owners();
        owners.sort_by_key(|block| (block.segment, block.offset));
        for block in &owners {
            let segment = self.segments.get(&block.segment);
            assert!(segment.is_some_and(|len| block.offset + block.len <= *len), "{block:?}");
        }
        for pair in owners.windows(2) {
            let apart = pair[0].segment != pair[1].segment
                || pair[0].offset + pair[0].len <= pair[1].offset;
            assert!(apart, "{pair:?} have bytes in common");
        }
        let mapped: u64 = self.segments.values().sum();
        let stats = self.ledger().stats();
        assert!(mapped <= CAPACITY);
        assert_eq!(stats.bytes_in_use, owners.iter().map(|block| block.len).sum::<u64>());
        assert!(stats.bytes_mapped <= mapped, "some of it may be about to be retired");
    }
}

proptest! {
    #[test]
    fn no_byte_has_two_owners_and_all_are_free_at_the_end(steps in steps()) {
        let mut model = Model::new();
        for step in steps {
            model.apply(step);
            model.check();
        }
        for loan in std::mem::take(&mut model.loans) {
            model.ledger().abandon(loan);
        }
        for (serial, (_, _, holds, views)) in std::mem::take(&mut model.objects) {
            holds.iter().for_each(|holder| model.ledger().release(serial, *holder).unwrap());
            (0..views).for_each(|_| model.ledger().end_view(serial));
        }
        model.check();
        prop_assert_eq!(model.ledger().stats().bytes_in_use, 0);
        // The whole capacity can be loaned in one piece again.
        prop_assert!(model.loan(CAPACITY));
    }
}

/// A reader, and its open objects, each with the byte that fills it.
struct Reader {
    store: Store,
    open: Vec<(Object, u8)>,
}

impl Reader {
    fn new(id: FederateId) -> Self {
        Self { store: Store::new(id, limits()), open: Vec::new() }
    }

    fn is_intact(&self) -> bool {
        self.open.iter().all(|(object, fill)| is_filled(object.as_bytes(), *fill))
    }
}

/// Compares page by page, which takes a tenth of the time in a build for tests.
fn is_filled(bytes: &[u8], fill: u8) -> bool {
    let page = [fill; 4096];
    bytes.chunks(page.len()).all(|chunk| *chunk == page[..chunk.len()])
}

#[derive(Clone, Debug)]
enum ReaderStep {
    Write { len: usize },
    Publish { which: Index, to: Vec<u16> },
    DropLoan { which: Index },
    Drop { reader: u16, which: Index },
    End { reader: u16 },
}

fn reader_steps() -> impl Strategy<Value = Vec<ReaderStep>> {
    let len = prop_oneof![0_usize..5_000, 100_000_usize..900_000];
    let to = prop::collection::vec(0..2_u16, 1..4);
    let step = prop_oneof![
        3 => len.prop_map(|len| ReaderStep::Write { len }),
        3 => (any::<Index>(), to).prop_map(|(which, to)| ReaderStep::Publish { which, to }),
        1 => any::<Index>().prop_map(|which| ReaderStep::DropLoan { which }),
        4 => (0..2_u16, any::<Index>()).prop_map(|(reader, which)| ReaderStep::Drop { reader, which }),
        1 => (0..2_u16).prop_map(|reader| ReaderStep::End { reader }),
    ];
    prop::collection::vec(step, 1..60)
}

/// An owner of memory, and two readers.
struct Stores {
    owner: Store,
    loans: Vec<(WritableLoan, u8)>,
    readers: [Reader; 2],
    written: u8,
}

impl Stores {
    fn apply(&mut self, step: ReaderStep) {
        match step {
            ReaderStep::Write { len } => {
                if let Ok(mut loan) = self.owner.loan(len) {
                    self.written = self.written.wrapping_add(1);
                    loan.fill(self.written);
                    self.loans.push((loan, self.written));
                }
            }
            ReaderStep::Publish { which, to } if !self.loans.is_empty() => {
                let (loan, fill) = self.loans.swap_remove(which.index(self.loans.len()));
                let ids: Vec<_> = to.iter().map(|reader| FederateId(reader + 1)).collect();
                let object = self.owner.seal(loan, &ids);
                for reader in to {
                    self.send(object, fill, usize::from(reader));
                }
            }
            ReaderStep::DropLoan { which } if !self.loans.is_empty() => {
                drop(self.loans.swap_remove(which.index(self.loans.len())));
            }
            ReaderStep::Drop { reader, which } => {
                let Reader { store, open } = &mut self.readers[usize::from(reader)];
                if !open.is_empty() {
                    open.swap_remove(which.index(open.len()));
                }
                for object in store.drain_releases() {
                    self.owner.release(object.serial, FederateId(reader + 1)).unwrap();
                }
            }
            ReaderStep::End { reader } => {
                let id = FederateId(reader + 1);
                self.readers[usize::from(reader)] = Reader::new(id);
                self.owner.reader_lost(id);
            }
            ReaderStep::Publish { .. } | ReaderStep::DropLoan { .. } => {}
        }
    }

    fn send(&mut self, object: ObjectRef, fill: u8, reader: usize) {
        let id = FederateId(u16::try_from(reader + 1).unwrap_or(0));
        let Reader { store, open } = &mut self.readers[reader];
        for segment in self.owner.retired(id) {
            store.detach(OWNER, segment);
        }
        for segment in self.owner.unannounced(id) {
            let fd = segment.as_fd().try_clone_to_owned().unwrap();
            store.attach(OWNER, segment.segment, segment.len, fd).unwrap();
        }
        open.push((store.open(object).unwrap(), fill));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn an_object_that_a_reader_holds_keeps_its_bytes(reader_steps in reader_steps()) {
        let readers = [1, 2].map(|id| Reader::new(FederateId(id)));
        let owner = Store::new(OWNER, limits());
        let mut stores = Stores { owner, loans: Vec::new(), readers, written: 0 };
        for step in reader_steps {
            stores.apply(step);
            prop_assert!(stores.readers.iter().all(Reader::is_intact));
            prop_assert!(stores.loans.iter().all(|(loan, fill)| is_filled(loan, *fill)));
        }
        stores.loans.clear();
        for reader in 0..2 {
            stores.apply(ReaderStep::End { reader });
        }
        prop_assert_eq!(stores.owner.stats().bytes_in_use, 0);
    }
}
