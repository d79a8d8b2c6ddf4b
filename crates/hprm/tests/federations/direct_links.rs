//! Direct links over TCP that end by accident while they are opened: they are opened again.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;

use hprm::{Address, Failure, FederateOptions, Reach, Rti, RtiOptions, Security};
use hprm_core::{Coordination, FederateId};

use crate::common::{SECRET, federate_with, options, rounds_of, rti_options};

const TCP: &str = "127.0.0.1:0";

/// How many connections are reset before the handshake is over, and how many after it, but before the
/// answer to the first frame.
const RESETS: (usize, usize) = (4, 2);

/// What the acceptor sends until both ends have proved that they know the secret.
const PROVED: [usize; 2] = [40, 33];

/// Forwards connections to a federate that listens at `target`, after it has reset some.
fn unreliable(target: String, resets: (usize, usize)) -> u16 {
    let listener = TcpListener::bind(TCP).unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        for (count, client) in listener.incoming().enumerate() {
            let mut client = client.unwrap();
            if count < resets.0 {
                // What is dropped with something unread is reset.
                let _ = client.read_exact(&mut [0; 8][..count]);
                continue;
            }
            let mut server = TcpStream::connect(&target).unwrap();
            if count < resets.0 + resets.1 {
                let (from, to) = (client.try_clone().unwrap(), server.try_clone().unwrap());
                forward(from, to);
                for part in PROVED {
                    let mut proof = vec![0; part];
                    server.read_exact(&mut proof).unwrap();
                    client.write_all(&proof).unwrap();
                }
                // The first byte of its answer to the first frame.
                server.read_exact(&mut [0; 1]).unwrap();
                [client, server]
                    .iter()
                    .for_each(|end| drop(end.shutdown(std::net::Shutdown::Both)));
                continue;
            }
            forward(client.try_clone().unwrap(), server.try_clone().unwrap());
            forward(server, client);
        }
    });
    port
}

fn forward(mut from: TcpStream, mut to: TcpStream) {
    thread::spawn(move || {
        let _ = std::io::copy(&mut from, &mut to);
        let _ = to.shutdown(std::net::Shutdown::Write);
    });
}

/// Forwards a connection to the RTI, and puts an unreliable port in the place of each port at which a
/// federate listens.
fn misleading(rti: &Address, resets: (usize, usize)) -> Address {
    let Address::Tcp(target) = rti.clone() else { panic!("it is TCP") };
    let listener = TcpListener::bind(TCP).unwrap();
    let address = Address::Tcp(listener.local_addr().unwrap().to_string());
    thread::spawn(move || {
        let (mut client, _) = listener.accept().unwrap();
        let mut server = TcpStream::connect(target).unwrap();
        forward(client.try_clone().unwrap(), server.try_clone().unwrap());
        let (mut ports, mut buffer) = (BTreeMap::new(), [0; 65_536]);
        while let Ok(count @ 1..) = server.read(&mut buffer) {
            mislead(&mut buffer[..count], |target| {
                *ports.entry(target.clone()).or_insert_with(|| unreliable(target, resets))
            });
            if client.write_all(&buffer[..count]).is_err() {
                break;
            }
        }
        let _ = client.shutdown(std::net::Shutdown::Both);
    });
    address
}

/// Replaces the ports in addresses. All that the kernel chooses have five digits.
fn mislead(bytes: &mut [u8], mut port: impl FnMut(String) -> u16) {
    const BEFORE: &[u8] = b"tcp:127.0.0.1:";
    for at in 0..(bytes.len() + 1).saturating_sub(BEFORE.len() + 5) {
        if bytes[at..].starts_with(BEFORE) {
            let digits = &mut bytes[at + BEFORE.len()..][..5];
            let target = format!("127.0.0.1:{}", str::from_utf8(digits).unwrap());
            digits.copy_from_slice(format!("{:05}", port(target)).as_bytes());
        }
    }
}

/// Runs a federation whose server reaches its clients over links that break while they are opened; the
/// server has joined from elsewhere, as far as the clients know.
fn outcomes(
    resets: (usize, usize),
    reach: &Reach,
) -> (Vec<Result<(), Failure>>, Result<(), Failure>) {
    let (program, react) = rounds_of(Coordination::Decentralized, 64, 5);
    let program = Arc::new(program);
    let unix: Address =
        format!("unix:@hprm-direct-{}-{}", std::process::id(), resets.1).parse().unwrap();
    let listen = TCP.parse().unwrap();
    let bound = RtiOptions {
        also_listen: vec![unix.clone()],
        ..rti_options(&program, listen, &Security::default())
    };
    let rti = Rti::bind(&bound).unwrap();
    let first = misleading(rti.address(), resets);
    let rti = thread::spawn(move || rti.run(|_| {}));
    let run = |federate: FederateId| {
        let (address, reach) = match federate.0 {
            0 => (&first, reach.clone()),
            _ => (&unix, Reach { advertise: Some("127.0.0.1".to_owned()), ..Reach::default() }),
        };
        let options = options(&program, federate, address, &Security::default());
        let options = FederateOptions { reach, federation: SECRET, ..options };
        let react = Arc::clone(&react);
        thread::spawn(move || federate_with(&options, react, Arc::new(Mutex::new(Vec::new()))))
    };
    let federates: Vec<_> = program.federates.ids().map(run).collect();
    let federates = federates.into_iter().map(|federate| federate.join().unwrap()).collect();
    (federates, rti.join().unwrap())
}

#[test]
fn a_link_that_is_reset_while_it_is_opened_is_opened_again() {
    let (federates, rti) = outcomes(RESETS, &Reach::default());
    assert_eq!((federates, rti), (vec![Ok(()); 4], Ok(())));
}

#[test]
fn a_link_that_is_always_reset_ends_the_federation_after_the_connect_timeout() {
    let connect_timeout = std::time::Duration::from_millis(50);
    let (federates, rti) =
        outcomes((usize::MAX, 0), &Reach { connect_timeout, ..Reach::default() });
    assert!(federates.iter().all(Result::is_err), "{federates:?}");
    let message = rti.unwrap_err().to_string();
    assert!(message.starts_with("federate client__"), "{message}");
    assert!(message.contains("has not ended, but is not reachable at tcp:127.0.0.1:"), "{message}");
    assert!(message.contains("it closes links while they are opened"), "{message}");
}
