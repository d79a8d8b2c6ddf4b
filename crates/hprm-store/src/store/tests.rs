//! Several stores of one process, with descriptors duplicated as a link would.

use std::sync::atomic::{AtomicUsize, Ordering};

use proptest::prelude::*;

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
    for announcement in &announcements {
        let fd = announcement.as_fd().try_clone_to_owned().unwrap();
        to.attach(from.owner, announcement.segment, announcement.len, fd).unwrap();
    }
    announcements.len()
}

/// What a link does after a message: the releases.
fn send_releases(from: &mut Store, to: &mut Store) {
    for object in from.drain_releases() {
        assert_eq!(object.owner, to.owner);
        to.release(object.serial, from.owner).unwrap();
    }
}

#[test]
fn an_object_is_read_where_it_was_written_and_released() {
    let [mut a, mut b] = stores();
    let object = a.put(b"point cloud", &[B]).unwrap();
    assert_eq!(announce(&mut a, &mut b), 1);
    let opened = b.open(object).unwrap();
    let clone = opened.clone();
    assert_eq!((clone.as_bytes(), clone.object_ref()), (&b"point cloud"[..], object));
    drop(opened);
    assert!(b.drain_releases().is_empty());
    drop(clone);
    send_releases(&mut b, &mut a);
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
        send_releases(reader, &mut a);
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
        // The reader holds each frame until it has the next.
        last = Some(b.open(object).unwrap());
        send_releases(&mut b, &mut a);
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
fn a_loan_that_is_dropped_on_any_thread_releases_its_block() {
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
    assert!(error.to_string().contains("is full: 1048576 bytes were asked for"), "{error}");
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
    let said = error.to_string();
    let larger = "a value of 9437184 bytes is larger than the federate's object store, which takes at most 8388608; ";
    assert!(said.starts_with(larger) && said.contains("--store-limit"), "{said}");
    assert_eq!(a.fall_back(error.clone()), Err(error));
    assert_eq!(a.stats().inline_fallbacks, 0);
}

#[test]
fn only_a_lack_of_memory_leads_to_an_inline_payload() {
    let mut a = Store::new(A, LIMITS);
    let cause = rustix::io::Errno::NOMEM;
    let none = StoreError::Segment(SegmentError::Create { len: 1, step: "mmap", cause });
    assert_eq!(a.fall_back(none.clone()), Ok(Some(none)));
    let foreign = StoreError::Segment(SegmentError::NotSealed);
    assert_eq!(a.fall_back(foreign.clone()), Err(foreign));
}

#[test]
fn segments_that_are_too_short_are_retired_and_readers_are_told() {
    let [mut a, mut b] = stores();
    for megabytes in 1..=7 {
        let object = a.put(&vec![1; megabytes << 20], &[B]).unwrap();
        for segment in a.retired(B) {
            b.detach(A, segment);
        }
        announce(&mut a, &mut b);
        assert_eq!(b.open(object).unwrap().as_bytes().len(), megabytes << 20);
        send_releases(&mut b, &mut a);
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
fn an_object_that_is_sent_again_is_held_by_the_next_reader() {
    let [mut a, mut b] = stores();
    let mut c = Store::new(FederateId(2), LIMITS);
    let object = a.put(b"map", &[B]).unwrap();
    announce(&mut a, &mut b);
    let at_b = b.open(object).unwrap();
    a.add_reader(at_b.object_ref().serial, c.owner).unwrap();
    drop(at_b);
    send_releases(&mut b, &mut a);
    announce(&mut a, &mut c);
    assert_eq!(c.open(object).unwrap().as_bytes(), b"map");
    send_releases(&mut c, &mut a);
    assert_eq!(a.stats().bytes_in_use, 0);
}

#[test]
fn a_lost_reader_holds_nothing_and_gets_announcements_again_when_it_returns() {
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
    let object = a.put(b"last value", &[B]).unwrap();
    announce(&mut a, &mut b);
    let opened = b.open(object).unwrap();
    b.owner_lost(A);
    drop((a, b));
    assert_eq!(opened.as_bytes(), b"last value");
}

#[test]
fn the_first_release_that_is_due_calls_the_wake_function() {
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
    send_releases(&mut b, &mut a);
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

const C: FederateId = FederateId(2);

/// Sends an object from one store to another, and opens it there.
fn send(from: &mut Store, object: ObjectRef, to: &mut Store) -> Object {
    from.add_reader(object.serial, to.owner).unwrap();
    announce(from, to);
    to.open(object).unwrap()
}

/// A, whose object B has forwarded to C; B itself has dropped it.
fn forwarded_object() -> ([Store; 3], Object) {
    let [mut a, mut b] = stores();
    let mut c = Store::new(C, LIMITS);
    let object = a.put(b"point cloud", &[B]).unwrap();
    announce(&mut a, &mut b);
    let received = b.open(object).unwrap();
    let forwarded = b.forward(&received).unwrap();
    let read = send(&mut b, forwarded.object_ref(), &mut c);
    drop((received, forwarded));
    send_releases(&mut b, &mut a);
    ([a, b, c], read)
}

#[test]
fn a_forwarded_object_is_not_copied_and_is_released_hop_by_hop() {
    let ([mut a, mut b, mut c], read) = forwarded_object();
    assert_eq!((read.as_bytes(), read.object_ref().owner), (&b"point cloud"[..], B));
    let stats = b.stats();
    assert_eq!((stats.bytes_copied, stats.bytes_mapped, stats.objects_passed_on), (0, 0, 1));
    assert_eq!(a.stats().bytes_in_use, 64);
    drop(read);
    send_releases(&mut c, &mut b);
    send_releases(&mut b, &mut a);
    assert_eq!(a.stats().bytes_in_use, 0);
}

#[test]
fn an_object_that_is_forwarded_to_its_owner_is_read_like_any_other() {
    let [mut a, mut b] = stores();
    let object = a.put(b"point cloud", &[B]).unwrap();
    announce(&mut a, &mut b);
    let received = b.open(object).unwrap();
    let forwarded = b.forward(&received).unwrap();
    let back = send(&mut b, forwarded.object_ref(), &mut a);
    assert_eq!(back.as_bytes(), b"point cloud");
    assert_eq!(b.forward(&received).unwrap().object_ref(), forwarded.object_ref());
    drop((received, forwarded, back));
    send_releases(&mut a, &mut b);
    send_releases(&mut b, &mut a);
    assert_eq!(a.stats().bytes_in_use, 0);
}

#[test]
fn a_forwarded_object_stays_after_the_forwarder_has_ended_until_its_readers_drop_it() {
    let ([mut a, b, mut c], read) = forwarded_object();
    drop(b);
    a.reader_lost(B);
    c.owner_lost(B);
    assert_eq!(a.stats().bytes_in_use, 64);
    assert_eq!(read.as_bytes(), b"point cloud");
    drop(read);
    assert_eq!(a.stats().bytes_in_use, 0);
}

#[test]
fn an_object_that_was_forwarded_twice_stays_after_both_forwarders_have_ended() {
    let ([mut a, b, mut c], read) = forwarded_object();
    let mut d = Store::new(FederateId(3), LIMITS);
    let forwarded = c.forward(&read).unwrap();
    let last = send(&mut c, forwarded.object_ref(), &mut d);
    drop((b, forwarded, read));
    a.reader_lost(B);
    c.owner_lost(B);
    assert_eq!(a.stats().bytes_in_use, 64);
    drop(c);
    d.owner_lost(C);
    assert_eq!((last.as_bytes(), a.stats().bytes_in_use), (&b"point cloud"[..], 64));
    drop(last);
    assert_eq!(a.stats().bytes_in_use, 0);
}

#[test]
fn a_forwarded_object_is_released_when_its_readers_have_ended() {
    let ([mut a, mut b, c], read) = forwarded_object();
    drop((c, read));
    b.reader_lost(C);
    send_releases(&mut b, &mut a);
    assert_eq!(a.stats().bytes_in_use, 0);
}

#[test]
fn a_forwarded_object_can_be_read_after_its_owner_has_ended() {
    let ([a, mut b, mut c], read) = forwarded_object();
    drop(a);
    b.owner_lost(A);
    let mut d = Store::new(FederateId(3), LIMITS);
    let again = c.forward(&read).unwrap();
    let last = send(&mut c, again.object_ref(), &mut d);
    assert_eq!(last.as_bytes(), b"point cloud");
    drop((read, again, last));
    send_releases(&mut d, &mut c);
    send_releases(&mut c, &mut b);
    // No object of the segment is forwarded any more, and none will be.
    assert_eq!(b.retired(C), [1 << 26]);
}

#[test]
fn the_bytes_of_a_forwarded_object_can_be_sent_inline() {
    let ([_a, mut b, _c], read) = forwarded_object();
    let object = read.object_ref();
    b.add_reader(object.serial, B).unwrap();
    assert_eq!(b.open(object).unwrap().as_bytes(), b"point cloud");
}

#[test]
fn a_store_with_many_segments_keeps_few_descriptors() {
    let [mut a, mut b] = stores();
    let object = a.put(b"point cloud", &[B]).unwrap();
    let [announcement] = &a.unannounced(B)[..] else { panic!("one segment") };
    let owner = |number: usize| FederateId(u16::try_from(number).unwrap() + 10);
    for number in 0..MAX_DESCRIPTORS + 20 {
        let fd = announcement.as_fd().try_clone_to_owned().unwrap();
        b.attach(owner(number), 0, announcement.len, fd).unwrap();
    }
    assert_eq!(b.attached.values().filter(|view| view.fd().is_some()).count(), MAX_DESCRIPTORS);
    let sent = |number| ObjectRef { owner: owner(number), segment: 0, ..object };
    let [first, last] = [0, MAX_DESCRIPTORS + 19].map(|number| b.open(sent(number)).unwrap());
    assert_eq!(last.as_bytes(), first.as_bytes());
    assert!(b.forward(&first).is_some());
    assert!(b.forward(&last).is_none());
}

/// Federates that send, forward, drop and end in any order.
struct Federates {
    stores: Vec<Option<Store>>,
    /// The open objects: the federate, the value of all bytes, and the object.
    open: Vec<(usize, u8, Object)>,
    sent: u8,
}

#[derive(Clone, Debug)]
enum Step {
    Send { from: usize, to: usize, len: usize },
    Forward { which: prop::sample::Index, to: usize },
    Drop { which: prop::sample::Index },
    End { federate: usize },
}

const FEDERATES: usize = 6;

impl Federates {
    fn new() -> Self {
        let id = |it: usize| FederateId(u16::try_from(it).unwrap());
        let stores = (0..FEDERATES).map(|it| Some(Store::new(id(it), LIMITS))).collect();
        Self { stores, open: Vec::new(), sent: 0 }
    }

    fn apply(&mut self, step: Step) {
        match step {
            Step::Send { from, to, len } => {
                self.sent = self.sent.wrapping_add(1);
                let Some(sender) = self.stores[from].as_mut() else { return };
                let me = sender.owner;
                if let Ok(object) = sender.put(&vec![self.sent; len], &[me]) {
                    let own = sender.open(object).unwrap();
                    self.deliver(from, to, self.sent, &own);
                }
            }
            Step::Forward { which, to } if !self.open.is_empty() => {
                let (from, content, received) = self.open[which.index(self.open.len())].clone();
                let forwarded = self.stores[from].as_mut().unwrap().forward(&received).unwrap();
                self.deliver(from, to, content, &forwarded);
            }
            Step::Drop { which } if !self.open.is_empty() => {
                self.open.swap_remove(which.index(self.open.len()));
            }
            Step::End { federate } => self.end(federate),
            Step::Forward { .. } | Step::Drop { .. } => {}
        }
        self.exchange();
    }

    fn deliver(&mut self, from: usize, to: usize, content: u8, object: &Object) {
        if from == to || self.stores[to].is_none() {
            return;
        }
        let mut sender = self.stores[from].take().unwrap();
        let opened = send(&mut sender, object.object_ref(), self.stores[to].as_mut().unwrap());
        self.stores[from] = Some(sender);
        self.open.push((to, content, opened));
    }

    fn end(&mut self, federate: usize) {
        let Some(store) = self.stores[federate].take() else { return };
        let id = store.owner;
        self.open.retain(|(at, ..)| *at != federate);
        drop(store);
        for store in self.stores.iter_mut().flatten() {
            store.reader_lost(id);
            store.owner_lost(id);
        }
    }

    /// Delivers all releases, over any number of hops.
    fn exchange(&mut self) {
        // Several rounds: a store finds out only by looking that readers have dropped an object which a
        // federate that has ended had forwarded to them.
        let mut idle_rounds = 0;
        while idle_rounds < FEDERATES {
            let mut releases = 0;
            for at in 0..FEDERATES {
                let Some(store) = self.stores[at].as_mut() else { continue };
                let me = store.owner;
                for object in store.drain_releases() {
                    releases += 1;
                    if let Some(owner) = self.stores[usize::from(object.owner.0)].as_mut() {
                        owner.release(object.serial, me).unwrap();
                    }
                }
            }
            idle_rounds = if releases == 0 { idle_rounds + 1 } else { 0 };
        }
    }
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let federate = || 0..FEDERATES;
    let which = any::<prop::sample::Index>;
    prop::collection::vec(
        prop_oneof![
            6 => (federate(), federate(), prop::sample::select(vec![64_usize, 4096, 300_000]))
                .prop_map(|(from, to, len)| Step::Send { from, to, len }),
            6 => (which(), federate()).prop_map(|(which, to)| Step::Forward { which, to }),
            6 => which().prop_map(|which| Step::Drop { which }),
            1 => federate().prop_map(|federate| Step::End { federate }),
        ],
        1..60,
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn bytes_that_a_federate_reads_never_change_and_no_block_stays_in_use(steps in steps()) {
        let mut federates = Federates::new();
        for step in steps {
            federates.apply(step);
            for (_, content, object) in &federates.open {
                let bytes = object.as_bytes();
                prop_assert!(bytes == vec![*content; bytes.len()]);
            }
        }
        federates.open.clear();
        federates.exchange();
        for store in federates.stores.iter_mut().flatten() {
            prop_assert_eq!(store.stats().bytes_in_use, 0);
        }
    }
}

#[test]
fn an_object_that_a_forked_process_may_read_is_released_when_that_process_has_ended() {
    let (mut a, mut b) = (Store::new(A, LIMITS), Store::new(B, LIMITS));
    let mut send = |b: &mut Store| {
        let object = a.put(&[7; 100_000], &[B]).unwrap();
        announce(&mut a, b);
        b.open(object).unwrap()
    };
    let before = send(&mut b);
    let forked = b.forks().begin();
    let after = send(&mut b);
    let owed = [before.object_ref(), after.object_ref()];
    drop((before, after));
    assert_eq!(b.drain_releases(), owed[1..]);
    assert_eq!(b.drain_releases(), []);
    drop(forked);
    assert_eq!(b.drain_releases(), owed[..1]);
}
