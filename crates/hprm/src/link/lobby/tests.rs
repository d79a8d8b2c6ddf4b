//! What strangers can do to a lobby, and what they cannot.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixStream};

use hprm_federated::FederationId;

use super::*;
use crate::doorbell::Doorbell;
use crate::link::{Link, Security};
use crate::wait::Deadline;
use crate::wire::Network;

const NOW: PhysicalTime = PhysicalTime(1_000);

/// What a handshake begins with.
const HELLO: [u8; 40] = *b"HPRM-L01 and a number that is never used";

fn lobby() -> (Lobby, String) {
    let lobby = lobby_at(&["127.0.0.1:0".to_owned()], Security::default());
    let Some(Address::Tcp(address)) = lobby.addresses().next().cloned() else {
        panic!("it is TCP")
    };
    (lobby, address)
}

fn lobby_at(addresses: &[String], security: Security) -> Lobby {
    let network = Network::sockets().unwrap();
    let gates = addresses.iter().map(|at| network.listen(&at.parse().unwrap()).unwrap()).collect();
    Lobby::new(gates, Purpose::Coordination, keys(security), 2)
}

fn keys(security: Security) -> Keys {
    Keys::new(FederationId(7), security).unwrap()
}

/// Lets so many strangers come who say this, each after the one before.
fn flood(lobby: &mut Lobby, address: &str, count: usize, words: &[u8]) -> Vec<TcpStream> {
    let connect = |_| {
        let mut stranger = TcpStream::connect(address).unwrap();
        stranger.write_all(words).unwrap();
        assert!(lobby.admit(NOW).unwrap().is_empty());
        stranger
    };
    (0..count).map(connect).collect()
}

/// A member, whose link goes on as far as `until` says.
fn member(lobby: &mut Lobby, address: &str, until: impl Fn(&Link) -> bool) -> Link {
    let address = Address::Tcp(address.to_owned());
    let doorbell = Doorbell::new().unwrap();
    let patience = Deadline::at(Clock::now().plus(10_000_000_000));
    let keys = keys(Security::default());
    let link = Link::connect(&address, Purpose::Coordination, &keys, &doorbell, patience);
    let mut link = link.unwrap();
    while !until(&link) {
        link.flush().unwrap();
        link.read().unwrap();
        assert!(lobby.admit(NOW).unwrap().is_empty());
    }
    link
}

/// The first frame of a member arrives.
fn is_admitted(lobby: &mut Lobby, mut link: Link) -> bool {
    link.queue(Frame::Resign, None);
    for _ in 0..1000 {
        if link.flush().is_err() || link.read().is_err() {
            return false;
        }
        match lobby.admit(NOW).unwrap().as_slice() {
            [] => {}
            [(_, frame)] => return *frame == Frame::Resign,
            _ => panic!("only one has come"),
        }
    }
    false
}

/// Whether the other end has hung up without a word.
fn is_hung_up(stream: &mut TcpStream) -> bool {
    stream
        .read(&mut [0])
        .map_or_else(|error| error.kind() == io::ErrorKind::ConnectionReset, |count| count == 0)
}

#[test]
fn who_is_silent_is_hung_up_on_and_the_loop_woken_for_that() {
    let (mut lobby, address) = lobby();
    let mut silent = TcpStream::connect(address).unwrap();
    assert!(lobby.admit(NOW).unwrap().is_empty());
    let wakeup = lobby.next_wakeup().unwrap();
    assert_eq!(wakeup, NOW.plus(PATIENCE));
    assert_eq!(lobby.interests().count(), 2);
    assert!(lobby.admit(wakeup).unwrap().is_empty());
    assert_eq!(lobby.next_wakeup(), None);
    assert!(is_hung_up(&mut silent));
}

#[test]
fn who_does_not_speak_the_protocol_hears_nothing() {
    for words in [&b"GET / HTTP/1.1\r\n\r\n"[..], &[0; 4096], b"HPRM-L00", b"\xff"] {
        let (mut lobby, address) = lobby();
        let mut stranger = TcpStream::connect(address).unwrap();
        stranger.write_all(words).unwrap();
        assert!(lobby.admit(NOW).unwrap().is_empty());
        while lobby.next_wakeup().is_some() {
            assert!(lobby.admit(NOW).unwrap().is_empty());
        }
        assert!(is_hung_up(&mut stranger));
    }
}

#[test]
fn a_crowd_of_strangers_is_bounded_and_the_latest_has_a_place() {
    let (mut lobby, address) = lobby();
    let mut crowd = flood(&mut lobby, &address, FROM_ONE + 3, b"");
    assert_eq!(lobby.crowd.strangers(), FROM_ONE);
    assert!(crowd[..3].iter_mut().all(is_hung_up));
}

#[test]
fn who_has_proved_the_secret_stays_whatever_strangers_come() {
    for words in [&b""[..], b"HPRM-", &HELLO] {
        let (mut lobby, address) = lobby();
        let link = member(&mut lobby, &address, Link::is_established);
        drop(flood(&mut lobby, &address, 3 * STRANGERS, words));
        assert!(is_admitted(&mut lobby, link));
    }
}

#[test]
fn who_begins_to_prove_it_stays_whatever_silent_strangers_come() {
    for words in [&b""[..], b"HPRM-"] {
        let (mut lobby, address) = lobby();
        // It has begun, and has heard the answer; its proof has not left.
        let mut begun = TcpStream::connect(&address).unwrap();
        begun.write_all(&HELLO).unwrap();
        assert!(lobby.admit(NOW).unwrap().is_empty());
        begun.read_exact(&mut [0; 40]).unwrap();
        drop(flood(&mut lobby, &address, 3 * STRANGERS, words));
        begun.set_nonblocking(true).unwrap();
        assert_eq!(begun.read(&mut [0]).unwrap_err().kind(), io::ErrorKind::WouldBlock);
    }
}

#[test]
fn who_comes_beside_a_flood_of_those_who_begin_has_a_place() {
    let (mut lobby, address) = lobby();
    let crowd = flood(&mut lobby, &address, 3 * STRANGERS, &HELLO);
    let link = member(&mut lobby, &address, Link::is_established);
    assert!(is_admitted(&mut lobby, link));
    drop(crowd);
}

#[test]
fn a_process_of_the_same_user_stays_whatever_strangers_come() {
    for auth in [false, true] {
        let name = format!("hprm-lobby-{}-{auth}", std::process::id());
        let addresses = ["127.0.0.1:0".to_owned(), format!("unix:@{name}")];
        let mut lobby = lobby_at(&addresses, Security { auth, ..Security::default() });
        let Some(Address::Tcp(tcp)) = lobby.addresses().next().cloned() else {
            panic!("it is TCP")
        };
        let name = SocketAddr::from_abstract_name(&name).unwrap();
        let mut silent = UnixStream::connect_addr(&name).unwrap();
        assert!(lobby.admit(NOW).unwrap().is_empty());
        let crowd = flood(&mut lobby, &tcp, 3 * STRANGERS, &HELLO);
        silent.set_nonblocking(true).unwrap();
        assert_eq!(silent.read(&mut [0]).unwrap_err().kind(), io::ErrorKind::WouldBlock);
        drop(crowd);
    }
}

#[test]
fn one_address_takes_no_place_from_another() {
    let (mut lobby, address) = lobby();
    let port = address.rsplit_once(':').unwrap().1;
    let mut one = flood(&mut lobby, &address, 1, b"");
    // Another address of this machine, which connects to the same port.
    let mut crowd = Vec::new();
    for _ in 0..3 * STRANGERS {
        crowd.push(connect_from("127.0.0.2:0", port));
        assert!(lobby.admit(NOW).unwrap().is_empty());
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
fn strangers_take_a_part_of_the_descriptors_that_are_left() {
    let taken = |free| 2 * places_for(3, free).strangers;
    assert_eq!(taken(1_000_000), 2 * STRANGERS);
    assert_eq!(taken(100), 24);
    assert_eq!(taken(16), 4);
    // Even then, a member must be able to get in.
    assert_eq!(taken(0), 2);
    assert!(
        places_for(200, 1_000_000).from_one >= 200,
        "many federates of one machine come at once"
    );
}

#[test]
fn strangers_get_a_share_of_the_time_of_who_is_busy() {
    let (mut lobby, address) = lobby();
    lobby.rest_after(NOW, 2 * ROUND);
    assert_eq!(lobby.next_wakeup(), None, "whoever waits for members has time");
    lobby.become_busy();
    lobby.rest_after(NOW, ROUND / 10);
    assert_eq!(lobby.next_wakeup(), None, "a few members are no burden");
    lobby.rest_after(NOW, ROUND);
    let until = NOW.plus(ROUND * (1 + REST));
    assert_eq!(lobby.next_wakeup(), Some(until));
    let _stranger = TcpStream::connect(&address).unwrap();
    assert!(lobby.admit(NOW).unwrap().is_empty());
    assert_eq!((lobby.crowd.strangers(), lobby.interests().count()), (0, 0));
    assert!(lobby.admit(until).unwrap().is_empty());
    assert_eq!(lobby.crowd.strangers(), 1);
}
