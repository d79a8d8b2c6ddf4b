//! Direct links over TCP that end by accident while they are opened: they are opened again.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;

use hprm::{Address, Failure, FederateOptions, Reach, Rti, RtiOptions, Security};
use hprm_core::{Coordination, FederateId};

use crate::common::{SECRET, federate_with, options, rounds_of, rti_options};

const TCP: &str = "127.0.0.1:0";

/// What happens to a connection.
enum Fate {
    /// It is reset before the handshake is over.
    ResetAtOnce,
    /// It ends after the handshake, but before the answer to the first frame.
    CutLater,
    Forwarded,
}

/// Decides that by the port to which the connection goes, and the number of those before it.
type Fates = fn(port: u16, count: usize) -> Fate;

/// What the server has told the user in the test that looks at it.
static TOLD: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// What the acceptor sends until both ends have proved that they know the secret.
const PROVED: [usize; 2] = [40, 33];

/// Forwards connections to a federate that listens at `target`, except some.
fn unreliable(target: String, fates: Fates) -> u16 {
    let listener = TcpListener::bind(TCP).unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        for (count, client) in listener.incoming().enumerate() {
            let mut client = client.unwrap();
            let fate = fates(port, count);
            if let Fate::ResetAtOnce = fate {
                // What is dropped with something unread is reset.
                let _ = client.read_exact(&mut [0; 8][..count.min(8)]);
                continue;
            }
            let mut server = TcpStream::connect(&target).unwrap();
            if let Fate::CutLater = fate {
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
fn misleading(rti: &Address, fates: Fates) -> Address {
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
                *ports.entry(target.clone()).or_insert_with(|| unreliable(target, fates))
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
    name: &str,
    fates: Fates,
    reach: &Reach,
) -> (Vec<Result<(), Failure>>, Result<(), Failure>) {
    let (program, react) = rounds_of(Coordination::Decentralized, 64, 5);
    let program = Arc::new(program);
    let unix: Address = format!("unix:@hprm-direct-{}-{name}", std::process::id()).parse().unwrap();
    let listen = TCP.parse().unwrap();
    let bound = RtiOptions {
        also_listen: vec![unix.clone()],
        ..rti_options(&program, listen, &Security::default())
    };
    let rti = Rti::bind(&bound).unwrap();
    let first = misleading(rti.address(), fates);
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
    let fates = |_, count| match count {
        0..4 => Fate::ResetAtOnce,
        4..6 => Fate::CutLater,
        _ => Fate::Forwarded,
    };
    let (federates, rti) = outcomes("again", fates, &Reach::default());
    assert_eq!((federates, rti), (vec![Ok(()); 4], Ok(())));
}

/// Each link of the server opens only once the server has told the user of it.
#[test]
fn a_link_that_stays_closed_is_told_once() {
    let fates: Fates = |port, _| {
        let start = format!("trying again to reach the federate at tcp:127.0.0.1:{port}: ");
        match TOLD.lock().unwrap().iter().any(|told| told.starts_with(&start)) {
            true => Fate::Forwarded,
            false => Fate::ResetAtOnce,
        }
    };
    let notice = |text: &str| TOLD.lock().unwrap().push(text.to_owned());
    let reach = Reach { notice: Some(notice), ..Reach::default() };
    let (federates, rti) = outcomes("told", fates, &reach);
    assert_eq!((federates, rti), (vec![Ok(()); 4], Ok(())));
    let told = TOLD.lock().unwrap();
    let reason = "it closes links while they are opened";
    assert!(told.iter().all(|it| it.contains(reason)), "{told:?}");
    let addresses = told.iter().map(|it| it.split(": ").next().unwrap());
    assert_eq!((told.len(), addresses.collect::<BTreeSet<_>>().len()), (3, 3), "{told:?}");
}

#[test]
fn a_link_that_is_always_reset_ends_the_federation_after_the_connect_timeout() {
    let connect_timeout = std::time::Duration::from_millis(50);
    let (federates, rti) = outcomes(
        "always",
        |_, _| Fate::ResetAtOnce,
        &Reach { connect_timeout, ..Reach::default() },
    );
    assert!(federates.iter().all(Result::is_err), "{federates:?}");
    let message = rti.unwrap_err().to_string();
    assert!(message.starts_with("federate client__"), "{message}");
    assert!(message.contains("has not ended, but is not reachable at tcp:127.0.0.1:"), "{message}");
    assert!(message.contains("it closes links while they are opened"), "{message}");
}
