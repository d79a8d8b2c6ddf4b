//! Bytes arrive as they were written, whatever the other side does.

use std::collections::VecDeque;

use proptest::prelude::*;

use super::*;

type Heap = Arc<[AtomicU64]>;

/// The ends of one ring, and its memory.
fn ring() -> (Writer<Heap>, Reader<Heap>, Ring<Heap>) {
    let (ring, _) = ends((0..2 * RING_WORDS).map(|_| AtomicU64::new(0)).collect::<Heap>());
    (Writer::new(ring.clone()), Reader::new(ring.clone()), ring)
}

#[derive(Clone, Debug)]
enum Step {
    Write(usize),
    Read(usize),
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    // A word or less, some words, and what fills the ring.
    let len = || prop_oneof![1_usize..20, 20_usize..3_000, 60_000_usize..140_000];
    let step = prop_oneof![len().prop_map(Step::Write), len().prop_map(Step::Read)];
    prop::collection::vec(step, 1..80)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn carries_what_was_written_and_as_much_as_it_holds(steps in steps()) {
        let (mut writer, mut reader, _) = ring();
        let mut model = VecDeque::new();
        let mut next = 0_u8;
        for step in steps {
            match step {
                Step::Write(len) => {
                    let bytes: Vec<_> = (0..len).map(|at| next.wrapping_add(at as u8)).collect();
                    let room = RING_CAPACITY - model.len();
                    let count = writer.write(&bytes).unwrap();
                    // Odd steps, so that a byte in a wrong place does not look right.
                    next = next.wrapping_add(count as u8).wrapping_add(91);
                    prop_assert_eq!(count, len.min(room));
                    model.extend(&bytes[..count]);
                    prop_assert_eq!(writer.has_room_or_waits().unwrap(), model.len() < RING_CAPACITY);
                }
                Step::Read(len) => {
                    let mut buffer = vec![0; len];
                    let count = reader.read(&mut buffer).unwrap();
                    prop_assert_eq!(count, len.min(model.len()));
                    let expected: Vec<_> = model.drain(..count).collect();
                    prop_assert_eq!(&buffer[..count], &expected[..]);
                    prop_assert_eq!(reader.is_empty(), model.is_empty());
                }
            }
        }
    }

    #[test]
    fn a_side_that_tells_impossible_things_causes_an_error_or_wrong_bytes_and_never_more(
        written in any::<u64>(), read in any::<u64>(), len in 1_usize..200, origin in any::<u64>(),
    ) {
        let (mut writer, mut reader, ring) = ring();
        writer.write(&[7; 100]).unwrap();
        ring.store(WRITTEN, written);
        ring.store(ORIGIN, origin);
        let mut buffer = vec![0; len];
        match reader.read(&mut buffer) {
            Ok(count) => prop_assert!(count <= len && written <= RING_CAPACITY as u64),
            Err(RingError) => prop_assert!(written > RING_CAPACITY as u64),
        }
        let origin = origin % (written.wrapping_add(1)).max(1);
        ring.store(ORIGIN, origin);
        prop_assert_eq!(reader.read(&mut buffer).is_err(), written > RING_CAPACITY as u64);
        ring.store(READ, read);
        prop_assert_eq!(writer.has_room_or_waits().is_err(), read > 100);
    }
}

#[test]
fn a_ring_whose_reader_keeps_up_uses_its_first_pages_only() {
    let (mut writer, mut reader, ring) = ring();
    let mut buffer = [0; 200];
    for number in 0..10_000_u32 {
        let bytes = [number as u8 | 1; 100];
        assert_eq!(writer.write(&bytes), Ok(100));
        // The reader is late by a message at times.
        if number % 3 > 0 {
            let count = reader.read(&mut buffer).unwrap();
            assert_eq!(buffer[count - 100..count], bytes);
        }
    }
    let used = ring.data().iter().rposition(|word| word.load(Ordering::Relaxed) != 0).unwrap();
    assert!((used * WORD) as u64 <= 2 * SPAN, "{used} words are in use");
}

#[test]
fn a_reader_that_has_read_fewer_bytes_than_before_is_an_error() {
    let (mut writer, mut reader, ring) = ring();
    assert_eq!(writer.write(&[1; RING_CAPACITY + 5]), Ok(RING_CAPACITY));
    assert_eq!(reader.read(&mut [0; 10]), Ok(10));
    assert_eq!(writer.write(&[2; 20]), Ok(10));
    ring.store(READ, 9);
    assert_eq!(writer.write(&[3; 20]), Err(RingError));
}

#[test]
fn a_writer_that_has_written_fewer_bytes_than_before_is_an_error() {
    let (mut writer, mut reader, ring) = ring();
    writer.write(&[1; 10]).unwrap();
    assert_eq!(reader.read(&mut [0; 10]), Ok(10));
    ring.store(WRITTEN, 9);
    assert_eq!(reader.read(&mut [0; 10]), Err(RingError));
}
