//! A pair of rings between two threads, in place of two processes.

use std::sync::mpsc;

use hprm_store::{RING_CAPACITY, map_ring_pair, ring_pair};

#[test]
fn two_threads_exchange_bytes_and_wake_one_another() {
    const TOTAL: usize = 20 * RING_CAPACITY;
    let (mut writer, mut reader, file) = ring_pair().unwrap();
    let (mut outbound, mut inbound) = map_ring_pair(&file).unwrap();
    let (notifier, notified) = mpsc::channel();
    let (other_notifier, other_notified) = mpsc::channel();
    let echo = std::thread::spawn(move || {
        let (mut buffer, mut done) = (vec![0; 1000], 0);
        while done < TOTAL {
            let count = inbound.read(&mut buffer).unwrap();
            assert!((done..).zip(&buffer[..count]).all(|(at, byte)| at as u8 == *byte));
            if count == 0 {
                inbound.announce_sleep();
                if inbound.is_empty() {
                    notified.recv().unwrap();
                }
                inbound.end_sleep();
            }
            if inbound.take_waiting_writer() {
                other_notifier.send(()).unwrap();
            }
            done += count;
        }
        outbound.open(17);
        outbound.write(b"done").unwrap();
    });
    let bytes: Vec<_> = (0..TOTAL).map(|at| at as u8).collect();
    let mut done = 0;
    while done < TOTAL {
        // In pieces of a length that does not divide the capacity.
        let until = TOTAL.min(done + 777);
        let count = writer.write(&bytes[done..until]).unwrap();
        done += count;
        if writer.take_sleeping_reader() {
            notifier.send(()).unwrap();
        }
        if count == 0 && !writer.has_room_or_waits().unwrap() {
            other_notified.recv().unwrap();
        }
    }
    echo.join().unwrap();
    assert_eq!(reader.opened(), Some(17));
    let mut buffer = [0; 8];
    assert_eq!(reader.read(&mut buffer), Ok(4));
    assert_eq!(&buffer[..4], b"done");
}
