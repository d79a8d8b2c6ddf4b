//! What unauthenticated clients can do to an acceptor, and what they cannot.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixStream};
use std::time::Duration;

use hprm_federated::FederationId;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::*;
use crate::link::Network;
use crate::link::Security;
use crate::link::stream_link::StreamLink;
use crate::notifier::Notifier;
use crate::wait::Deadline;

const NOW: PhysicalTime = PhysicalTime(1_000);

/// What a handshake begins with.
const HELLO: [u8; 40] = *b"HPRM-L01 and a number that is never used";

fn acceptor() -> (LinkAcceptor, String) {
    let acceptor = acceptor_at(&["127.0.0.1:0".to_owned()], Security::default());
    let Some(Address::Tcp(address)) = acceptor.addresses().next().cloned() else {
        panic!("it is TCP")
    };
    (acceptor, address)
}

fn acceptor_at(addresses: &[String], security: Security) -> LinkAcceptor {
    let network = Network::sockets().unwrap();
    let listeners =
        addresses.iter().map(|at| network.listen(&at.parse().unwrap()).unwrap()).collect();
    LinkAcceptor::new(listeners, Purpose::Coordination, keys(security), 2)
}

fn keys(security: Security) -> Keys {
    Keys::new(FederationId(7), security).unwrap()
}

/// Opens so many connections that send these bytes, one after the other.
fn flood(acceptor: &mut LinkAcceptor, address: &str, count: usize, words: &[u8]) -> Vec<TcpStream> {
    let connect = |_| {
        let mut client = TcpStream::connect(address).unwrap();
        client.write_all(words).unwrap();
        assert!(acceptor.admit(NOW).unwrap().is_empty());
        // On a busy machine the time of one round may be over before it accepts anything.
        while has_arrivals(acceptor) {
            assert!(acceptor.admit(NOW).unwrap().is_empty());
        }
        client
    };
    (0..count).map(connect).collect()
}

/// Whether connections wait to be accepted.
fn has_arrivals(acceptor: &LinkAcceptor) -> bool {
    let listeners = acceptor
        .listeners
        .iter()
        .map(|listener| PollFd::from_borrowed_fd(listener.as_fd(), PollFlags::IN));
    let mut listeners: Vec<_> = listeners.collect();
    poll(&mut listeners, Some(&Timespec::default())).unwrap() > 0
}

/// A member, whose link goes on as far as `until` says.
fn member(
    acceptor: &mut LinkAcceptor,
    address: &str,
    until: impl Fn(&StreamLink) -> bool,
) -> StreamLink {
    let address = Address::Tcp(address.to_owned());
    let notifier = Notifier::new().unwrap();
    let deadline = Deadline::at(Clock::now().plus(10_000_000_000));
    let keys = keys(Security::default());
    let link = StreamLink::connect(&address, Purpose::Coordination, &keys, &notifier, deadline);
    let mut link = link.unwrap();
    while !until(&link) {
        link.flush().unwrap();
        link.read().unwrap();
        assert!(acceptor.admit(NOW).unwrap().is_empty());
    }
    link
}

/// The first frame of a member arrives.
fn is_admitted(acceptor: &mut LinkAcceptor, mut link: StreamLink) -> bool {
    link.queue(Frame::Resign, None);
    for _ in 0..1000 {
        if link.flush().is_err() || link.read().is_err() {
            return false;
        }
        match acceptor.admit(NOW).unwrap().as_slice() {
            [] => {}
            [(_, frame)] => return *frame == Frame::Resign,
            _ => panic!("only one has come"),
        }
    }
    false
}

/// Whether the other end has closed the link without an answer.
fn is_hung_up(stream: &mut TcpStream) -> bool {
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    stream
        .read(&mut [0])
        .map_or_else(|error| error.kind() == io::ErrorKind::ConnectionReset, |count| count == 0)
}

#[test]
fn a_silent_link_is_closed_and_the_loop_woken_up_for_that() {
    let (mut acceptor, address) = acceptor();
    let mut silent = TcpStream::connect(address).unwrap();
    assert!(acceptor.admit(NOW).unwrap().is_empty());
    let wakeup = acceptor.next_wakeup().unwrap();
    assert_eq!(wakeup, NOW.plus(FIRST_FRAME_TIMEOUT));
    assert_eq!(acceptor.sources().count(), 2);
    assert!(acceptor.admit(wakeup).unwrap().is_empty());
    assert_eq!(acceptor.next_wakeup(), None);
    assert!(is_hung_up(&mut silent));
}

#[test]
fn a_process_that_does_not_speak_the_protocol_gets_no_answer() {
    for words in [&b"GET / HTTP/1.1\r\n\r\n"[..], &[0; 4096], b"HPRM-L00", b"\xff"] {
        let (mut acceptor, address) = acceptor();
        let mut client = TcpStream::connect(address).unwrap();
        client.write_all(words).unwrap();
        assert!(acceptor.admit(NOW).unwrap().is_empty());
        while acceptor.next_wakeup().is_some() {
            assert!(acceptor.admit(NOW).unwrap().is_empty());
        }
        assert!(is_hung_up(&mut client));
    }
}

#[test]
fn the_number_of_pending_links_is_bounded_and_the_latest_has_a_place() {
    let (mut acceptor, address) = acceptor();
    let mut pending = flood(&mut acceptor, &address, FROM_ONE + 3, b"");
    assert_eq!(acceptor.pending.unproved(), FROM_ONE);
    assert!(pending[..3].iter_mut().all(is_hung_up));
}

#[test]
fn a_link_that_has_proved_the_secret_stays_whatever_others_come() {
    for words in [&b""[..], b"HPRM-", &HELLO] {
        let (mut acceptor, address) = acceptor();
        let link = member(&mut acceptor, &address, StreamLink::is_established);
        drop(flood(&mut acceptor, &address, 3 * MOST_UNPROVED, words));
        assert!(is_admitted(&mut acceptor, link));
    }
}

#[test]
fn a_link_that_has_begun_the_handshake_stays_whatever_silent_links_come() {
    for words in [&b""[..], b"HPRM-"] {
        let (mut acceptor, address) = acceptor();
        // It has begun, and has received the answer; it has not sent its proof.
        let mut begun = TcpStream::connect(&address).unwrap();
        begun.write_all(&HELLO).unwrap();
        assert!(acceptor.admit(NOW).unwrap().is_empty());
        begun.read_exact(&mut [0; 40]).unwrap();
        drop(flood(&mut acceptor, &address, 3 * MOST_UNPROVED, words));
        begun.set_nonblocking(true).unwrap();
        assert_eq!(begun.read(&mut [0]).unwrap_err().kind(), io::ErrorKind::WouldBlock);
    }
}

#[test]
fn a_link_has_a_place_beside_a_flood_of_those_that_begin_the_handshake() {
    let (mut acceptor, address) = acceptor();
    let pending = flood(&mut acceptor, &address, 3 * MOST_UNPROVED, &HELLO);
    let link = member(&mut acceptor, &address, StreamLink::is_established);
    assert!(is_admitted(&mut acceptor, link));
    drop(pending);
}

#[test]
fn a_process_of_the_same_user_stays_whatever_others_come() {
    for auth in [false, true] {
        let name = format!("hprm-acceptor-{}-{auth}", std::process::id());
        let addresses = ["127.0.0.1:0".to_owned(), format!("unix:@{name}")];
        let mut acceptor = acceptor_at(&addresses, Security { auth, ..Security::default() });
        let Some(Address::Tcp(tcp)) = acceptor.addresses().next().cloned() else {
            panic!("it is TCP")
        };
        let name = SocketAddr::from_abstract_name(&name).unwrap();
        let mut silent = UnixStream::connect_addr(&name).unwrap();
        assert!(acceptor.admit(NOW).unwrap().is_empty());
        let pending = flood(&mut acceptor, &tcp, 3 * MOST_UNPROVED, &HELLO);
        silent.set_nonblocking(true).unwrap();
        assert_eq!(silent.read(&mut [0]).unwrap_err().kind(), io::ErrorKind::WouldBlock);
        drop(pending);
    }
}

#[test]
fn one_address_takes_no_place_from_another() {
    let (mut acceptor, address) = acceptor();
    let port = address.rsplit_once(':').unwrap().1;
    let mut one = flood(&mut acceptor, &address, 1, b"");
    // Another address of this machine, which connects to the same port.
    let mut pending = Vec::new();
    for _ in 0..3 * MOST_UNPROVED {
        pending.push(connect_from("127.0.0.2:0", port));
        assert!(acceptor.admit(NOW).unwrap().is_empty());
    }
    one[0].set_nonblocking(true).unwrap();
    assert_eq!(one[0].read(&mut [0]).unwrap_err().kind(), io::ErrorKind::WouldBlock);
}

fn connect_from(here: &str, port: &str) -> TcpStream {
    use rustix::net::{AddressFamily, SocketType, bind, connect, socket};
    let socket = socket(AddressFamily::INET, SocketType::STREAM, None).unwrap();
    bind(&socket, &here.parse::<std::net::SocketAddr>().unwrap()).unwrap();
    let there = format!("127.0.0.1:{port}").parse::<std::net::SocketAddr>().unwrap();
    connect(&socket, &there).unwrap();
    socket.into()
}

#[test]
fn pending_links_take_a_part_of_the_descriptors_that_are_left() {
    let taken = |free| 2 * limits_for(3, free).unproved;
    assert_eq!(taken(1_000_000), 2 * MOST_UNPROVED);
    assert_eq!(taken(100), 24);
    assert_eq!(taken(16), 4);
    // Even then, a member must be able to get in.
    assert_eq!(taken(0), 2);
    assert!(
        limits_for(200, 1_000_000).from_one >= 200,
        "many federates of one machine come at once"
    );
}

#[test]
fn pending_links_get_a_share_of_the_time_of_a_busy_process() {
    let (mut acceptor, address) = acceptor();
    acceptor.rest_after(NOW, 2 * ROUND);
    assert_eq!(acceptor.next_wakeup(), None, "a process that waits for members has time");
    acceptor.become_busy();
    acceptor.rest_after(NOW, ROUND / 10);
    assert_eq!(acceptor.next_wakeup(), None, "a few members are no burden");
    acceptor.rest_after(NOW, ROUND);
    let until = NOW.plus(ROUND * (1 + REST));
    assert_eq!(acceptor.next_wakeup(), Some(until));
    let _client = TcpStream::connect(&address).unwrap();
    assert!(acceptor.admit(NOW).unwrap().is_empty());
    assert_eq!((acceptor.pending.unproved(), acceptor.sources().count()), (0, 0));
    assert!(acceptor.admit(until).unwrap().is_empty());
    assert_eq!(acceptor.pending.unproved(), 1);
}
