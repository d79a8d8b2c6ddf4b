//! The two ends of a link on one machine.

use std::fs::File;
use std::io::Read;

use hprm_core::{ChannelId, FederateId, Part, Payload, PhysicalTime, Tag};
use hprm_federated::codec::{self, CodecError};
use hprm_federated::{FederationId, Frame};
use rustix::pipe::pipe;

use super::*;
use crate::Clock;
use crate::link::socket::SocketListener;
use crate::link::stream_link::StreamLink;
use crate::link::{Arrival, Keys, Link, Purpose, Security};
use crate::poller::{Broken, PolledLink};
use crate::wait::{Deadline, Interest, wait};

/// Two ends that are opened and trust one another, with their notifiers.
struct Pair {
    near: (StreamLink, Notifier),
    far: (StreamLink, Notifier),
}

fn soon() -> Deadline {
    Deadline::at(Clock::now().plus(20_000_000_000))
}

fn pair(name: &str) -> Pair {
    let keys = Keys::new(FederationId(7), Security::default()).unwrap();
    let address = format!("unix:@hprm-rings-{}-{name}", std::process::id()).parse().unwrap();
    let listener = SocketListener::bind(&address).unwrap();
    let (here, there) = (Notifier::new().unwrap(), Notifier::new().unwrap());
    let near = StreamLink::connect(&address, Purpose::Messages, &keys, &here, soon()).unwrap();
    let socket = listener.accept().unwrap().unwrap();
    let far = StreamLink::accepted(socket, Purpose::Messages, &keys, &there).unwrap();
    Pair { near: (near, here), far: (far, there) }
}

/// The same, with rings that both ends already use.
fn pair_with_rings(name: &str) -> Pair {
    let mut pair = pair(name);
    let (near, far) = (&mut pair.near.0, &mut pair.far.0);
    near.queue(Frame::Ping, None);
    near.flush().unwrap();
    assert_eq!(read_all(far), [Frame::Ping]);
    assert!(!far.is_in_memory());
    far.trust();
    far.queue(Frame::Pong, None);
    far.flush().unwrap();
    // The first read brings the notifier, without which this end does not know of the ring.
    assert_eq!(read_all(near), [Frame::Pong]);
    assert!(near.is_in_memory());
    near.queue(Frame::Resign, None);
    near.flush().unwrap();
    assert_eq!(read_all(far), [Frame::Resign]);
    assert!(far.is_in_memory());
    pair
}

fn failed(number: i32, len: usize) -> Frame {
    let byte = char::from(b'a' + u8::try_from(number % 20).unwrap());
    let message = String::from_iter(vec![byte; len]);
    Frame::Failed { federate: FederateId(1), message, code: number }
}

fn segment(number: u32) -> Frame {
    Frame::Segment { owner: FederateId(0), reader: FederateId(1), segment: number, len: 4096 }
}

/// The frames that have come by now.
fn read_all(link: &mut StreamLink) -> Vec<Frame> {
    let mut frames = Vec::new();
    while matches!(link.read().unwrap(), Arrival::Bytes | Arrival::LastBytes) || link.has_unread() {
        while let Some((frame, _)) = link.next_frame().unwrap() {
            frames.push(frame);
        }
    }
    frames
}

fn is_notified(notifier: &Notifier) -> bool {
    let now = Some(PhysicalTime(0));
    let ready = wait(&[Interest { fd: notifier.as_fd(), write: false }], now);
    notifier.clear();
    ready[0].is_ready()
}

#[test]
fn only_a_process_that_sleeps_is_notified() {
    let Pair { near: (mut near, _), far: (mut far, notifier) } = pair_with_rings("sleep");
    near.queue(Frame::Ping, None);
    near.flush().unwrap();
    assert!(!is_notified(&notifier));
    assert!(far.has_unread());
    assert_eq!(read_all(&mut far), [Frame::Ping]);
    far.announce_sleep();
    assert!(!far.has_unread());
    near.queue(Frame::Ping, None);
    near.flush().unwrap();
    assert!(is_notified(&notifier));
    // Once is enough.
    near.queue(Frame::Pong, None);
    near.flush().unwrap();
    assert!(!is_notified(&notifier));
    far.end_sleep();
    assert_eq!(read_all(&mut far), [Frame::Ping, Frame::Pong]);
}

#[test]
fn more_than_a_ring_holds_waits_and_comes_in_order() {
    let Pair { near: (mut near, notifier), far: (mut far, _) } = pair_with_rings("full");
    let frames: Vec<_> = (0..50).map(|number| failed(number, 10_007)).collect();
    frames.iter().for_each(|frame| near.queue(frame.clone(), None));
    near.flush().unwrap();
    assert!(near.has_outbound());
    // The socket could be written at once, and that would not help.
    assert!(!near.waits_for_socket());
    let mut come = Vec::new();
    while come.len() < frames.len() {
        let more = read_all(&mut far);
        assert!(!more.is_empty() || near.has_outbound());
        assert_eq!(is_notified(&notifier), near.has_outbound());
        near.flush().unwrap();
        come.extend(more);
    }
    assert_eq!(come, frames);
    assert!(!near.has_outbound());
}

#[test]
fn a_descriptor_comes_with_its_frame_whatever_is_before_it() {
    let Pair { near: (mut near, _), far: (mut far, _) } = pair_with_rings("descriptors");
    let mut writers = Vec::new();
    for number in 0..20 {
        near.queue(failed(number, 12_000), None);
        let (reader, writer) = pipe().unwrap();
        near.queue(segment(u32::try_from(number).unwrap()), Some(reader));
        writers.push(writer);
    }
    let (mut frames, mut next) = (0, 0);
    while next < writers.len() {
        near.flush().unwrap();
        far.read().unwrap();
        while let Some((frame, descriptor)) = far.next_frame().unwrap() {
            frames += 1;
            if let Frame::Segment { segment, .. } = frame {
                assert_eq!(usize::try_from(segment), Ok(next));
                rustix::io::write(&writers[next], &[7]).unwrap();
                let mut byte = [0];
                File::from(descriptor.unwrap()).read_exact(&mut byte).unwrap();
                assert_eq!(byte, [7]);
                next += 1;
            }
        }
    }
    assert_eq!(frames, 40);
}

fn long(len: usize) -> Frame {
    let parts = vec![Part::Inline(vec![7; len])];
    let payload = Payload { head: vec![1], parts, physical: false };
    Frame::Message { channel: ChannelId(3), tag: Tag::START, payload }
}

#[test]
fn long_messages_keep_their_place_among_frames_and_descriptors() {
    let Pair { near: (mut near, _), far: (mut far, _) } = pair_with_rings("long");
    let frames: Vec<_> =
        [Frame::Ping, long(3 << 20), Frame::Pong, long(1 << 20), segment(4), long(300_000)].into();
    for frame in &frames {
        let descriptor = matches!(frame, Frame::Segment { .. }).then(|| pipe().unwrap().0);
        near.queue(frame.clone(), descriptor);
    }
    let mut come = Vec::new();
    while come.len() < frames.len() {
        assert!(near.has_outbound() || far.has_unread());
        near.flush().unwrap();
        far.read().unwrap();
        while let Some((frame, descriptor)) = far.next_frame().unwrap() {
            assert_eq!(descriptor.is_some(), matches!(frame, Frame::Segment { .. }));
            come.push(frame);
        }
    }
    assert_eq!(come, frames);
    assert!(near.take_moved_chunks() && far.take_moved_chunks() && !far.take_moved_chunks());
    assert!(!near.has_outbound());
}

#[test]
fn an_unauthenticated_client_sends_no_long_message() {
    let Pair { near: (mut near, _), far: (mut far, _) } = pair("unauthenticated");
    near.queue(long(1 << 20), None);
    near.flush().unwrap();
    far.read().unwrap();
    let refused = far.next_frame().unwrap_err();
    assert!(matches!(refused, CodecError::TooLong { limit: 4096, .. }), "{refused}");
}

#[test]
fn what_was_written_before_an_end_is_read_and_then_the_end() {
    let Pair { near: (mut near, _), far: (mut far, _) } = pair_with_rings("end");
    near.queue(failed(1, 60_000), None);
    near.queue(segment(3), Some(pipe().unwrap().0));
    near.flush().unwrap();
    drop(near);
    let mut frames = Vec::new();
    while far.read().unwrap() != Arrival::Closed {
        while let Some((frame, descriptor)) = far.next_frame().unwrap() {
            assert_eq!(descriptor.is_some(), matches!(frame, Frame::Segment { .. }));
            frames.push(frame);
        }
    }
    assert_eq!(frames, [failed(1, 60_000), segment(3)]);
}

#[test]
fn an_end_before_the_first_answer_is_an_end() {
    let Pair { near: (mut near, _), far: (mut far, _) } = pair("early");
    near.queue(Frame::Ping, None);
    near.flush().unwrap();
    assert_eq!(read_all(&mut far), [Frame::Ping]);
    far.trust();
    far.queue(Frame::Pong, None);
    far.flush().unwrap();
    drop(far);
    let mut frames = Vec::new();
    while near.read().unwrap() != Arrival::Closed {
        while let Some((frame, _)) = near.next_frame().unwrap() {
            frames.push(frame);
        }
    }
    assert_eq!(frames, [Frame::Pong]);
}

#[test]
fn what_was_sent_before_an_end_is_read_although_the_rings_came_too_late() {
    let Pair { near: (mut near, _), far: (mut far, _) } = pair("hasty");
    near.queue(Frame::Ping, None);
    near.queue(failed(1, 60_000), None);
    near.flush().unwrap();
    drop(near);
    assert_eq!(far.read().unwrap(), Arrival::Bytes);
    assert_eq!(far.next_frame().unwrap().map(|(frame, _)| frame), Some(Frame::Ping));
    far.trust();
    let mut frames = Vec::new();
    while far.read().unwrap() != Arrival::Closed {
        while let Some((frame, _)) = far.next_frame().unwrap() {
            frames.push(frame);
        }
    }
    assert_eq!(frames, [failed(1, 60_000)]);
}

#[test]
fn a_process_that_fills_the_ring_of_one_that_has_ended_gets_an_error() {
    let Pair { near: (mut near, _), far: (far, _) } = pair_with_rings("gone");
    drop(far);
    near.queue(failed(1, 200_000), None);
    assert_eq!(near.flush().unwrap_err().kind(), io::ErrorKind::BrokenPipe);
    near.discard();
    assert!(!near.has_outbound());
}

#[test]
fn what_is_no_memory_for_rings_breaks_the_link_after_the_frames_before() {
    let keys = Keys::new(FederationId(7), Security::default()).unwrap();
    let address = format!("unix:@hprm-rings-{}-lie", std::process::id()).parse().unwrap();
    let listener = SocketListener::bind(&address).unwrap();
    let liar = Socket::connect(&address, soon()).unwrap();
    let notifier = Notifier::new().unwrap();
    let socket = listener.accept().unwrap().unwrap();
    let mut link = StreamLink::accepted(socket, Purpose::Messages, &keys, &notifier).unwrap();
    let (reader, writer) = pipe().unwrap();
    let mut bytes = Vec::new();
    codec::encode(&Frame::Ping, &mut bytes).unwrap();
    codec::encode(&Frame::Resign, &mut bytes).unwrap();
    liar.send_with(&bytes, &[reader.as_fd(), writer.as_fd()]).unwrap();
    assert_eq!(link.read().unwrap(), Arrival::Bytes);
    assert_eq!(link.next_frame().unwrap().map(|(frame, _)| frame), Some(Frame::Ping));
    link.trust();
    let mut frames = Vec::new();
    let outcome = PolledLink::new(Link::Stream(link)).read(|frame, _| frames.push(frame));
    assert!(matches!(outcome, Err(Broken::Link(_))), "{outcome:?}");
    assert_eq!(frames, [Frame::Resign]);
}

#[test]
fn a_reader_is_awake_until_it_announces_that_it_sleeps() {
    let Pair { near: (mut near, _), far: (mut far, _) } = pair_with_rings("awake");
    assert!(near.reader_is_awake() && far.reader_is_awake());
    far.announce_sleep();
    assert!(!near.reader_is_awake() && far.reader_is_awake());
    // It is woken up once, and is not to be counted on before it says so.
    near.queue(Frame::Ping, None);
    near.flush().unwrap();
    far.end_sleep();
    assert!(near.reader_is_awake());
    // Over a socket, nothing tells that.
    let Pair { near: (near, _), .. } = pair("unopened");
    assert!(!near.reader_is_awake());
}
