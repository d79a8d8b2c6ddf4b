//! Two threads at the ends of a pair of rings, as two processes are.

use std::sync::mpsc;

use hprm_store::{RING_CAPACITY, map_ring_pair, ring_pair};

#[test]
fn two_threads_exchange_bytes_and_wake_one_another() {
    const TOTAL: usize = 20 * RING_CAPACITY;
    let (mut writer, mut reader, file) = ring_pair().unwrap();
    let (mut back, mut there) = map_ring_pair(&file).unwrap();
    let (bell, ear) = mpsc::channel();
    let (other_bell, other_ear) = mpsc::channel();
    let echo = std::thread::spawn(move || {
        let (mut buffer, mut done) = (vec![0; 1000], 0);
        while done < TOTAL {
            let count = there.read(&mut buffer).unwrap();
            assert!((done..).zip(&buffer[..count]).all(|(at, byte)| at as u8 == *byte));
            if count == 0 {
                there.fall_asleep();
                if there.is_empty() {
                    ear.recv().unwrap();
                }
                there.wake_up();
            }
            if there.take_waiter() {
                other_bell.send(()).unwrap();
            }
            done += count;
        }
        back.open(17);
        back.write(b"done").unwrap();
    });
    let bytes: Vec<_> = (0..TOTAL).map(|at| at as u8).collect();
    let mut done = 0;
    while done < TOTAL {
        // In odd pieces.
        let until = TOTAL.min(done + 777);
        let count = writer.write(&bytes[done..until]).unwrap();
        done += count;
        if writer.take_sleeper() {
            bell.send(()).unwrap();
        }
        if count == 0 && !writer.has_room_or_waits().unwrap() {
            other_ear.recv().unwrap();
        }
    }
    echo.join().unwrap();
    assert_eq!(reader.opened(), Some(17));
    let mut buffer = [0; 8];
    assert_eq!(reader.read(&mut buffer), Ok(4));
    assert_eq!(&buffer[..4], b"done");
}
