//! Unauthenticated clients of a federation, over real sockets: they are refused, and no federate is
//! affected.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::thread;

use hprm::FederationId;
use hprm::{Address, Failure, FederateOptions, Reach, RtiEvent, Security};
use hprm_core::{Coordination, FederateId, Program};

use crate::common::{
    BOTH, React, bind, federate_with, federation_beside, gather, options, rounds_of, well,
};

const TCP: &str = "127.0.0.1:0";
const MAGIC: &[u8; 8] = b"HPRM-L01";

fn connect(address: &Address) -> TcpStream {
    let Address::Tcp(address) = address else { panic!("it is TCP") };
    TcpStream::connect(address).unwrap()
}

/// What comes until the other end closes the connection.
fn all_that_comes(stream: &mut TcpStream) -> Vec<u8> {
    let mut received = Vec::new();
    // A connection may also be reset; what came before is here.
    let _ = stream.read_to_end(&mut received);
    received
}

/// Joins as a process that is no member. Its reactions never run.
fn join(options: &FederateOptions) -> Failure {
    let react: Arc<React> = Arc::new(|_, _, _| panic!("an unauthenticated client runs a reaction"));
    federate_with(options, react, Arc::new(Mutex::new(Vec::new()))).unwrap_err()
}

#[test]
fn unauthenticated_clients_that_stay_do_not_keep_members_from_joining_and_running() {
    for coordination in BOTH {
        let (program, react) = rounds_of(coordination, 64, 50);
        let federation = federation_beside(program, TCP, &Security::default(), react, |rti| {
            let mut pending: Vec<_> = (0..100).map(|_| connect(rti)).collect();
            for (number, client) in pending.iter_mut().enumerate() {
                let hello = [&MAGIC[..], &[7; 32]].concat();
                let words: &[u8] = match number % 4 {
                    0 => b"",
                    1 => b"\x00\x00\x00\x40\x01 garbage",
                    2 => &hello[..number % hello.len()],
                    _ => &hello,
                };
                // If the connection has been closed already, even this may fail.
                let _ = client.write_all(words);
            }
            pending
        });
        let joined =
            well(federation).events.iter().filter(|e| matches!(e, RtiEvent::Joined { .. })).count();
        assert_eq!(joined, 4);
    }
}

#[test]
fn a_federate_with_another_secret_is_refused_and_told_so() {
    let (program, react) = rounds_of(Coordination::Centralized, 64, 5);
    let copy = Arc::new(program.clone());
    let federation = federation_beside(program, TCP, &Security::default(), react, |rti| {
        let rti = rti.clone();
        thread::spawn(move || {
            let options = options(&copy, FederateId(0), &rti, &Security::default());
            join(&FederateOptions { federation: FederationId(8), ..options })
        })
    });
    well(federation);
}

fn alone(program: &Arc<Program>, security: &Security) -> (Address, hprm::RtiHandle) {
    let rti = bind(program, TCP.parse().unwrap(), security);
    let (address, handle) = (rti.address().clone(), rti.handle());
    thread::spawn(move || rti.run(|_| {}));
    (address, handle)
}

#[test]
fn a_wrong_secret_names_itself() {
    let program = Arc::new(gather(Coordination::Centralized, 1).program);
    let (address, handle) = alone(&program, &Security::default());
    let options = options(&program, FederateId(0), &address, &Security::default());
    let failure = join(&FederateOptions { federation: FederationId(8), ..options });
    assert!(failure.to_string().contains("check what --federation-file names"), "{failure}");
    handle.abort();
}

#[test]
fn an_unauthenticated_client_gets_a_refusal_and_nothing_else() {
    let program = Arc::new(gather(Coordination::Centralized, 1).program);
    let (address, handle) = alone(&program, &Security::default());
    let mut client = connect(&address);
    client.write_all(MAGIC).unwrap();
    client.write_all(&[7; 32]).unwrap();
    let mut hello = [0; 40];
    client.read_exact(&mut hello).unwrap();
    assert_eq!(hello[..8], MAGIC[..]);
    // A false proof, and frames behind it.
    client.write_all(&[9; 32]).unwrap();
    assert_eq!(all_that_comes(&mut client), [0; 33]);
    handle.abort();
}

/// Forwards everything between a client and `target`, once, and returns what the client sent.
fn tap(target: Address) -> (Address, thread::JoinHandle<Vec<u8>>) {
    let listener = TcpListener::bind(TCP).unwrap();
    let address = Address::Tcp(listener.local_addr().unwrap().to_string());
    let thread = thread::spawn(move || {
        let (mut client, _) = listener.accept().unwrap();
        let mut server = connect(&target);
        let (mut from_server, mut to_client) =
            (server.try_clone().unwrap(), client.try_clone().unwrap());
        thread::spawn(move || {
            let _ = std::io::copy(&mut from_server, &mut to_client);
            let _ = to_client.shutdown(std::net::Shutdown::Both);
        });
        // The hello and the proof.
        let mut said = vec![0; 72];
        for part in [0..40, 40..72] {
            client.read_exact(&mut said[part.clone()]).unwrap();
            server.write_all(&said[part]).unwrap();
        }
        thread::spawn(move || {
            let _ = std::io::copy(&mut client, &mut server);
            let _ = server.shutdown(std::net::Shutdown::Write);
        });
        said
    });
    (address, thread)
}

#[test]
fn a_recorded_handshake_does_not_authenticate_again() {
    let (program, react) = rounds_of(Coordination::Centralized, 64, 5);
    let program = Arc::new(program);
    let rti = bind(&program, TCP.parse().unwrap(), &Security::default());
    let address = rti.address().clone();
    let rti = thread::spawn(move || rti.run(|_| {}));
    let run = |federate, address: &Address| {
        let options = options(&program, federate, address, &Security::default());
        let react = Arc::clone(&react);
        thread::spawn(move || federate_with(&options, react, Arc::new(Mutex::new(Vec::new()))))
    };
    let (tapped, said) = tap(address.clone());
    let first = run(FederateId(0), &tapped);
    let said = said.join().unwrap();
    let mut thief = connect(&address);
    thief.write_all(&said[..40]).unwrap();
    thief.read_exact(&mut [0; 40]).unwrap();
    thief.write_all(&said[40..]).unwrap();
    assert_eq!(all_that_comes(&mut thief), [0; 33]);
    // The federation continues.
    let others: Vec<_> = (1..4).map(|id| run(FederateId(id), &address)).collect();
    assert_eq!(first.join().unwrap(), Ok(()));
    assert!(others.into_iter().all(|federate| federate.join().unwrap() == Ok(())));
    assert_eq!(rti.join().unwrap(), Ok(()));
}

#[test]
fn a_false_rti_that_sends_everything_back_is_refused() {
    let program = Arc::new(gather(Coordination::Centralized, 1).program);
    let listener = TcpListener::bind(TCP).unwrap();
    let address = Address::Tcp(listener.local_addr().unwrap().to_string());
    let echo = thread::spawn(move || {
        let (mut victim, _) = listener.accept().unwrap();
        let mut hello = [0; 40];
        victim.read_exact(&mut hello).unwrap();
        victim.write_all(&hello).unwrap();
        let mut proof = [0; 32];
        victim.read_exact(&mut proof).unwrap();
        victim.write_all(&[&[1][..], &proof].concat()).unwrap();
        all_that_comes(&mut victim)
    });
    let failure = join(&options(&program, FederateId(0), &address, &Security::default()));
    assert!(failure.to_string().contains("does not know the secret"), "{failure}");
    assert_eq!(
        echo.join().unwrap(),
        [0; 0],
        "no frame is sent to a process that has not proved the secret"
    );
}

#[test]
fn a_unix_socket_asks_for_proofs_too_if_the_program_says_so() {
    let auth = Security { auth: true, ..Security::default() };
    for coordination in BOTH {
        let (program, react) = rounds_of(coordination, 100_000, 5);
        well(federation_beside(program, "unix:@hprm-auth-UNIQUE", &auth, react, |_| ()));
    }
    let program = Arc::new(gather(Coordination::Centralized, 1).program);
    let listen: Address = format!("unix:@hprm-auth-{}", std::process::id()).parse().unwrap();
    let rti = bind(&program, listen.clone(), &auth);
    let handle = rti.handle();
    let rti = thread::spawn(move || rti.run(|_| {}));
    // It sends frames where a proof is wanted.
    let failure = join(&options(&program, FederateId(0), &listen, &Security::default()));
    assert!(!failure.to_string().is_empty());
    handle.abort();
    assert_eq!(rti.join().unwrap(), Ok(()));
}

#[test]
fn federates_wait_for_the_rti() {
    // A port that is free: no other process gets it, as long as the kernel has others.
    let address = TcpListener::bind(TCP).unwrap().local_addr().unwrap();
    let address = Address::Tcp(address.to_string());
    let (program, react) = rounds_of(Coordination::Centralized, 64, 5);
    let program = Arc::new(program);
    let (waiting, waits) = mpsc::channel();
    let federates: Vec<_> = program
        .federates
        .ids()
        .map(|federate| {
            let options = options(&program, federate, &address, &Security::default());
            let (react, waiting) = (Arc::clone(&react), waiting.clone());
            thread::spawn(move || {
                WAITING.set(Some(waiting));
                let reach = Reach { notice: Some(note), ..Reach::default() };
                let options = FederateOptions { reach, ..options };
                federate_with(&options, react, Arc::new(Mutex::new(Vec::new())))
            })
        })
        .collect();
    for _ in &federates {
        let notice: String = waits.recv().unwrap();
        assert!(notice.contains("waiting for the RTI at tcp:127.0.0.1:"), "{notice}");
    }
    let rti = bind(&program, address, &Security::default());
    assert_eq!(rti.run(|_| {}), Ok(()));
    assert!(federates.into_iter().all(|federate| federate.join().unwrap() == Ok(())));
}

thread_local! {
    static WAITING: std::cell::Cell<Option<mpsc::Sender<String>>> =
        const { std::cell::Cell::new(None) };
}

fn note(text: &str) {
    let waiting = WAITING.take().expect("it is told once");
    waiting.send(text.to_owned()).unwrap();
}

/// More often than a link to a Unix socket may break while it is opened.
const RESETS: usize = 6;

/// What happens to a connection: it ends at both ends, or the RTI's end stays open.
#[derive(Clone, Copy, PartialEq)]
enum Cut {
    Both,
    Client,
}

/// Forwards connections to `target`. The first ones are reset before the handshake is over, and one
/// when `cut` says so.
fn unreliable(target: Address, cut: mpsc::Receiver<Cut>) -> Address {
    let listener = TcpListener::bind(TCP).unwrap();
    let address = Address::Tcp(listener.local_addr().unwrap().to_string());
    let mut cut = Some(cut);
    thread::spawn(move || {
        // What is dropped with something unread is reset.
        for client in listener.incoming().skip(RESETS) {
            let (client, server) = (client.unwrap(), connect(&target));
            let both = [client.try_clone().unwrap(), server.try_clone().unwrap()];
            let stays_open = Arc::new(AtomicBool::new(false));
            if let Some(cut) = cut.take() {
                let stays_open = Arc::clone(&stays_open);
                thread::spawn(move || {
                    let ends = cut.recv().unwrap();
                    stays_open.store(ends == Cut::Client, Ordering::Release);
                    let closed = if ends == Cut::Client { &both[..1] } else { &both[..] };
                    closed.iter().for_each(|end| end.shutdown(std::net::Shutdown::Both).unwrap());
                    // Until the test is over.
                    let _ = cut.recv();
                });
            }
            let ways =
                [(client.try_clone().unwrap(), server.try_clone().unwrap()), (server, client)];
            for (mut from, mut to) in ways {
                let stays_open = Arc::clone(&stays_open);
                thread::spawn(move || {
                    let _ = std::io::copy(&mut from, &mut to);
                    if !stays_open.load(Ordering::Acquire) {
                        let _ = to.shutdown(std::net::Shutdown::Write);
                    }
                });
            }
        }
    });
    address
}

#[test]
fn a_federate_whose_link_is_reset_while_it_joins_joins_again() {
    let cases = BOTH.into_iter().flat_map(|how| [(how, Cut::Both), (how, Cut::Client)]);
    for (coordination, ends) in cases {
        let (program, react) = rounds_of(coordination, 64, 5);
        let program = Arc::new(program);
        let rti = bind(&program, TCP.parse().unwrap(), &Security::default());
        let address = rti.address().clone();
        let (report, events) = mpsc::channel();
        let rti = thread::spawn(move || rti.run(|event| report.send(event).unwrap()));
        let run = |federate, address: &Address| {
            let options = options(&program, federate, address, &Security::default());
            let react = Arc::clone(&react);
            thread::spawn(move || federate_with(&options, react, Arc::new(Mutex::new(Vec::new()))))
        };
        let (cut, is_cut) = mpsc::channel();
        let first = run(FederateId(0), &unreliable(address.clone(), is_cut));
        assert!(matches!(events.recv().unwrap(), RtiEvent::Joined { .. }));
        cut.send(ends).unwrap();
        assert_eq!(events.recv().unwrap(), RtiEvent::Left(FederateId(0)));
        assert!(matches!(events.recv().unwrap(), RtiEvent::Joined { .. }));
        let others: Vec<_> = (1..4).map(|id| run(FederateId(id), &address)).collect();
        assert_eq!(first.join().unwrap(), Ok(()));
        assert!(others.into_iter().all(|federate| federate.join().unwrap() == Ok(())));
        drop(events.iter().collect::<Vec<_>>());
        assert_eq!(rti.join().unwrap(), Ok(()));
    }
}

#[test]
fn an_rti_that_is_stopped_before_the_start_ends_all_federates() {
    for listen in [TCP.to_owned(), format!("unix:@hprm-home-{}", std::process::id())] {
        let program = Arc::new(gather(Coordination::Centralized, 1).program);
        let rti = bind(&program, listen.parse().unwrap(), &Security::default());
        let (address, handle) = (rti.address().clone(), rti.handle());
        let rti = thread::spawn(move || {
            rti.run(|event| match event {
                RtiEvent::Joined { .. } => handle.request_stop(),
                event => assert_eq!(event, RtiEvent::Closing),
            })
        });
        let failure = join(&options(&program, FederateId(0), &address, &Security::default()));
        assert!(failure.to_string().contains("the RTI has been stopped"), "{failure}");
        assert_eq!(rti.join().unwrap(), Ok(()));
    }
}

#[test]
fn the_connect_timeout_ends_with_a_message() {
    let program = Arc::new(gather(Coordination::Centralized, 1).program);
    let address = TcpListener::bind(TCP).unwrap().local_addr().unwrap();
    let address = Address::Tcp(address.to_string());
    let options = options(&program, FederateId(0), &address, &Security::default());
    let reach = Reach { connect_timeout: std::time::Duration::ZERO, ..Reach::default() };
    let failure = join(&FederateOptions { reach, ..options });
    assert!(failure.to_string().starts_with(&format!("no RTI at {address}: ")));
    assert!(matches!(&failure, Failure::NoRti { .. }) && failure.report().hint.is_some());
}
