//! Several stores of one process, with descriptors duplicated as a link would.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;

const A: FederateId = FederateId(0);
const B: FederateId = FederateId(1);

const LIMITS: StoreLimits = StoreLimits {
    capacity_bytes: 8 << 20,
    segment_min_bytes: 1 << 20,
    when_full: WhenFull::Inline,
};

fn stores() -> [Store; 2] {
    [A, B].map(|id| Store::new(id, LIMITS))
}

/// What a link does before a message: the announcements.
fn announce(from: &mut Store, to: &mut Store) -> usize {
    let announcements = from.unannounced(to.owner);
    for Announcement { segment, len, memory } in &announcements {
        let fd = memory.fd().try_clone_to_owned().unwrap();
        to.attach(from.owner, *segment, *len, fd).unwrap();
    }
    announcements.len()
}

/// What a link does after a message: the releases.
fn return_releases(from: &mut Store, to: &mut Store) {
    for object in from.drain_releases() {
        assert_eq!(object.owner, to.owner);
        to.release(object.serial, from.owner).unwrap();
    }
}

#[test]
fn an_object_is_read_where_it_was_written_and_comes_back() {
    let [mut a, mut b] = stores();
    let object = a.put(b"point cloud", &[B]).unwrap();
    assert_eq!(announce(&mut a, &mut b), 1);
    let opened = b.open(object).unwrap();
    let clone = opened.clone();
    assert_eq!((clone.as_bytes(), clone.object_ref()), (&b"point cloud"[..], object));
    drop(opened);
    assert!(b.drain_releases().is_empty());
    drop(clone);
    return_releases(&mut b, &mut a);
    assert_eq!((a.stats().bytes_in_use, a.stats().releases), (0, 1));
}

#[test]
fn four_readers_of_50_mb_cost_one_copy() {
    let mut a = Store::new(A, StoreLimits::default());
    let mut readers: Vec<Store> =
        (1..=4).map(|id| Store::new(FederateId(id), StoreLimits::default())).collect();
    let image: Vec<u8> = (0..50_000_000_u32).map(|i| i.to_le_bytes()[0]).collect();
    let ids: Vec<FederateId> = readers.iter().map(|reader| reader.owner).collect();
    let object = a.put(&image, &ids).unwrap();
    for reader in &mut readers {
        announce(&mut a, reader);
        assert!(reader.open(object).unwrap().as_bytes() == image);
        return_releases(reader, &mut a);
        assert_eq!(reader.stats().bytes_copied, 0);
    }
    let stats = a.stats();
    assert_eq!((stats.bytes_copied, stats.bytes_in_use, stats.releases), (50_000_000, 0, 4));
}

#[test]
fn a_steady_program_maps_nothing_after_its_first_rounds() {
    let [mut a, mut b] = stores();
    let frame = vec![7; 1_500_000];
    let mut announced = 0;
    let mut last = None;
    for _ in 0..100 {
        let object = a.put(&frame, &[B]).unwrap();
        announced += announce(&mut a, &mut b);
        // The reader keeps each frame until it has the next.
        last = Some(b.open(object).unwrap());
        return_releases(&mut b, &mut a);
    }
    assert!(announced <= 2);
    assert_eq!(a.stats().segments as usize, announced);
    assert_eq!(a.stats().objects_sealed, 100);
    drop(last);
}

#[test]
fn what_is_computed_in_a_loan_is_not_copied() {
    let mut a = Store::new(A, LIMITS);
    let mut loan = a.loan(4).unwrap();
    loan.copy_from_slice(&[1, 2, 3, 4]);
    loan.reverse();
    let address = loan.as_ptr();
    let object = a.seal(loan, &[A]);
    let own = a.open(object).unwrap();
    assert_eq!(own.as_bytes(), [4, 3, 2, 1]);
    assert_eq!(own.as_bytes().as_ptr(), address);
    assert_eq!(a.stats().bytes_copied, 0);
    drop(own);
    assert_eq!(a.stats().bytes_in_use, 0);
}

#[test]
fn the_owner_opens_what_it_holds_and_nothing_else() {
    let mut a = Store::new(A, LIMITS);
    let object = a.put(b"mine", &[A, B]).unwrap();
    let forged = ObjectRef { len: 1 << 20, ..object };
    let unknown = HoldError::UnknownObject { serial: object.serial };
    assert_eq!(a.open(forged).unwrap_err(), StoreError::Hold(unknown));
    let view = a.open(object).unwrap();
    let none_left = HoldError::NotHolding { serial: object.serial, reader: A };
    assert_eq!(a.open(object).unwrap_err(), StoreError::Hold(none_left));
    assert_eq!(a.decline(object), Err(StoreError::Hold(none_left)));
    a.reader_lost(B);
    assert_eq!(view.as_bytes(), b"mine");
}

#[test]
fn a_dropped_loan_gives_its_block_back_from_any_thread() {
    let mut a = Store::new(A, LIMITS);
    let loans: Vec<WritableLoan> = (0..7).map(|_| a.loan(1 << 20).unwrap()).collect();
    let mapped = a.stats().bytes_mapped;
    std::thread::Builder::new().spawn(move || drop(loans)).unwrap().join().unwrap();
    let again: Vec<WritableLoan> = (0..7).map(|_| a.loan(1 << 20).unwrap()).collect();
    assert_eq!(a.stats().bytes_mapped, mapped);
    drop(again);
    assert_eq!(a.stats().bytes_in_use, 0);
}

#[test]
fn a_full_store_says_so_and_works_again_after_a_release() {
    let mut a = Store::new(A, LIMITS);
    let held: Vec<ObjectRef> = std::iter::from_fn(|| a.put(&[0; 1 << 20], &[B]).ok()).collect();
    assert_eq!(held.len(), 8);
    let error = a.put(&[0; 1 << 20], &[B]).unwrap_err();
    let (asked, capacity, in_use) = (1 << 20, 8 << 20, 8 << 20);
    assert_eq!(error, StoreError::Full { owner: A, asked, capacity, in_use });
    let error_again = StoreError::Full { owner: A, asked, capacity, in_use };
    assert_eq!(a.fall_back(error), Ok(Some(error_again.clone())));
    assert_eq!(a.fall_back(error_again), Ok(None));
    a.release(held[3].serial, B).unwrap();
    let next = a.put(&[0; 1 << 20], &[B]).unwrap();
    assert_eq!((next.segment, next.offset), (held[3].segment, held[3].offset));
    assert_eq!(a.stats().inline_fallbacks, 2);
}

#[test]
fn a_store_that_may_not_fall_back_refuses() {
    let mut a = Store::new(A, StoreLimits { when_full: WhenFull::Error, ..LIMITS });
    let error = a.put(&[0; 9 << 20], &[B]).unwrap_err();
    assert!(error.to_string().contains("--store-limit"), "{error}");
    assert_eq!(a.fall_back(error.clone()), Err(error));
    assert_eq!(a.stats().inline_fallbacks, 0);
}

#[test]
fn only_a_lack_of_memory_is_made_good_by_falling_back() {
    let mut a = Store::new(A, LIMITS);
    let cause = rustix::io::Errno::NOMEM;
    let none = StoreError::Segment(SegmentError::Create { len: 1, step: "mmap", cause });
    assert_eq!(a.fall_back(none.clone()), Ok(Some(none)));
    let foreign = StoreError::Segment(SegmentError::NotSealed);
    assert_eq!(a.fall_back(foreign.clone()), Err(foreign));
}

#[test]
fn segments_that_are_too_short_are_given_up_and_readers_told() {
    let [mut a, mut b] = stores();
    for megabytes in 1..=7 {
        let object = a.put(&vec![1; megabytes << 20], &[B]).unwrap();
        for segment in a.retired(B) {
            b.detach(A, segment);
        }
        announce(&mut a, &mut b);
        assert_eq!(b.open(object).unwrap().as_bytes().len(), megabytes << 20);
        return_releases(&mut b, &mut a);
    }
    assert_eq!(b.attached.len(), a.segments.len());
    assert!(a.stats().bytes_mapped <= LIMITS.capacity_bytes);
}

#[test]
fn a_reference_that_describes_no_object_is_refused() {
    let [mut a, mut b] = stores();
    let object = a.put(&[0; 100], &[B]).unwrap();
    assert_eq!(b.open(object).unwrap_err(), StoreError::UnknownSegment { object });
    announce(&mut a, &mut b);
    for object in [
        ObjectRef { len: u64::MAX, ..object },
        ObjectRef { offset: 2 << 20, ..object },
        ObjectRef { offset: (2 << 20) - 99, ..object },
    ] {
        assert_eq!(b.open(object).unwrap_err(), StoreError::OutOfBounds { object });
    }
    assert!(b.drain_releases().is_empty());
}

#[test]
fn a_segment_is_attached_once_and_never_by_its_owner() {
    let [mut a, mut b] = stores();
    a.put(&[0; 100], &[B]).unwrap();
    let announcement = a.unannounced(B).remove(0);
    assert!(a.unannounced(B).is_empty());
    let Announcement { segment, len, .. } = announcement;
    let fd = || announcement.as_fd().try_clone_to_owned().unwrap();
    let known = Err(StoreError::KnownSegment { owner: A, segment });
    assert_eq!(a.attach(A, segment, len, fd()), known);
    b.attach(A, segment, len, fd()).unwrap();
    assert_eq!(b.attach(A, segment, len, fd()), known);
    b.owner_lost(A);
    b.attach(A, segment, len, fd()).unwrap();
}

#[test]
fn an_object_that_was_passed_on_is_held_by_the_next_reader() {
    let [mut a, mut b] = stores();
    let mut c = Store::new(FederateId(2), LIMITS);
    let object = a.put(b"map", &[B]).unwrap();
    announce(&mut a, &mut b);
    let at_b = b.open(object).unwrap();
    a.add_reader(at_b.object_ref().serial, c.owner).unwrap();
    drop(at_b);
    return_releases(&mut b, &mut a);
    announce(&mut a, &mut c);
    assert_eq!(c.open(object).unwrap().as_bytes(), b"map");
    return_releases(&mut c, &mut a);
    assert_eq!(a.stats().bytes_in_use, 0);
}

#[test]
fn a_lost_reader_holds_nothing_and_is_told_again_when_it_returns() {
    let [mut a, mut b] = stores();
    a.put(&[0; 100], &[B]).unwrap();
    announce(&mut a, &mut b);
    a.reader_lost(B);
    assert_eq!(a.stats().bytes_in_use, 0);
    let mut b = Store::new(B, LIMITS);
    let object = a.put(b"again", &[B]).unwrap();
    assert_eq!(announce(&mut a, &mut b), 1);
    assert_eq!(b.open(object).unwrap().as_bytes(), b"again");
}

#[test]
fn an_open_object_outlives_its_owner_and_both_stores() {
    let [mut a, mut b] = stores();
    let object = a.put(b"last words", &[B]).unwrap();
    announce(&mut a, &mut b);
    let opened = b.open(object).unwrap();
    b.owner_lost(A);
    drop((a, b));
    assert_eq!(opened.as_bytes(), b"last words");
}

#[test]
fn a_release_that_falls_due_wakes_whoever_sends_it() {
    let mut a = Store::new(A, LIMITS);
    let calls = Arc::new(AtomicUsize::new(0));
    let counter = Arc::clone(&calls);
    let wake: Wake = Box::new(move || {
        counter.fetch_add(1, Ordering::Relaxed);
    });
    let mut b = Store::with_wake(B, LIMITS, wake);
    let object = a.put(b"x", &[B, B]).unwrap();
    announce(&mut a, &mut b);
    let opened = [(); 2].map(|()| b.open(object).unwrap());
    assert_eq!(calls.load(Ordering::Relaxed), 0);
    drop(opened);
    assert_eq!(calls.load(Ordering::Relaxed), 1);
    assert_eq!(b.drain_releases(), [object, object]);
}

#[test]
fn a_declined_object_is_released_unopened() {
    let [mut a, mut b] = stores();
    let object = a.put(b"x", &[A, B]).unwrap();
    b.decline(object).unwrap();
    return_releases(&mut b, &mut a);
    a.decline(object).unwrap();
    assert_eq!(a.stats().bytes_in_use, 0);
}

#[test]
fn stores_loans_and_objects_go_to_any_thread() {
    fn send<T: Send>() {}
    fn shared<T: Send + Sync>() {}
    send::<Store>();
    shared::<WritableLoan>();
    shared::<Object>();
    shared::<Announcement>();
}

#[test]
fn an_empty_object_is_an_object() {
    let [mut a, mut b] = stores();
    let object = a.put(&[], &[B]).unwrap();
    announce(&mut a, &mut b);
    assert_eq!(b.open(object).unwrap().as_bytes(), b"");
}
