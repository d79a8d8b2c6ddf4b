//! Encrypted federations: with certificates that the test makes, over real sockets.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::thread;

use hprm::FederationId;
use hprm::{Address, FederateOptions, RtiEvent, Security, TlsFiles};
use hprm_core::{Coordination, FederateId, Program};
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};

use crate::common::{
    BOTH, React, bind, federate_with, federation_beside, gather, options, rounds_of, well,
};

const TCP: &str = "127.0.0.1:0";

/// An authority, and certificates that it has signed.
struct Authority {
    folder: tempfile::TempDir,
    issuer: Issuer<'static, KeyPair>,
}

impl Authority {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let key = KeyPair::generate().unwrap();
        let mut params = CertificateParams::new([]).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let certificate = params.self_signed(&key).unwrap();
        std::fs::write(folder.path().join("ca.pem"), certificate.pem()).unwrap();
        Self { folder, issuer: Issuer::new(params, key) }
    }

    fn member(&self, name: &str) -> Security {
        let key = KeyPair::generate().unwrap();
        let params = CertificateParams::new([name.to_owned()]).unwrap();
        let certificate = params.signed_by(&key, &self.issuer).unwrap();
        let path = |kind: &str| self.folder.path().join(format!("{name}.{kind}"));
        std::fs::write(path("pem"), certificate.pem()).unwrap();
        std::fs::write(path("key"), key.serialize_pem()).unwrap();
        let authority = self.folder.path().join("ca.pem");
        let tls = TlsFiles { certificate: path("pem"), key: path("key"), authority };
        Security { tls: Some(tls), ..Security::default() }
    }

    /// One certificate for all processes; the authority's folder must outlive its use.
    fn member_for_all(self) -> (Self, Security) {
        let security = self.member("robot");
        (self, security)
    }
}

fn in_vain(options: &FederateOptions) -> String {
    let react: Arc<React> = Arc::new(|_, _, _| panic!("it must not join"));
    federate_with(options, react, Arc::new(Mutex::new(Vec::new()))).unwrap_err().to_string()
}

fn alone(program: &Arc<Program>, security: &Security) -> (Address, hprm::RtiHandle) {
    let rti = bind(program, TCP.parse().unwrap(), security);
    let (address, handle) = (rti.address().clone(), rti.handle());
    thread::spawn(move || rti.run(|event| assert!(!matches!(event, RtiEvent::Joined { .. }))));
    (address, handle)
}

#[test]
fn a_federation_runs_encrypted() {
    let security = Authority::new().member_for_all();
    for coordination in BOTH {
        for (len, rounds) in [(64, 50), (1_000_000, 5)] {
            let (program, react) = rounds_of(coordination, len, rounds);
            well(federation_beside(program, TCP, &security.1, react, |_| ()));
        }
    }
}

/// Forwards everything between one client and `target`, and keeps what it sees.
fn listen_in(target: &Address) -> (Address, Arc<Mutex<Vec<u8>>>) {
    let Address::Tcp(target) = target.clone() else { panic!("it is TCP") };
    let listener = TcpListener::bind(TCP).unwrap();
    let address = Address::Tcp(listener.local_addr().unwrap().to_string());
    let seen = Arc::new(Mutex::new(Vec::new()));
    let captured = Arc::clone(&seen);
    thread::spawn(move || {
        let (client, _) = listener.accept().unwrap();
        let server = TcpStream::connect(target).unwrap();
        for (mut from, mut to) in
            [(client.try_clone().unwrap(), server.try_clone().unwrap()), (server, client)]
        {
            let captured = Arc::clone(&captured);
            thread::spawn(move || {
                let mut buffer = [0; 4096];
                while let Ok(count @ 1..) = from.read(&mut buffer) {
                    captured.lock().unwrap().extend_from_slice(&buffer[..count]);
                    if to.write_all(&buffer[..count]).is_err() {
                        break;
                    }
                }
                let _ = to.shutdown(std::net::Shutdown::Both);
            });
        }
    });
    (address, seen)
}

/// Runs rounds whose messages are zeros, ones and so on, and returns what the first federate and the
/// RTI have sent one another.
fn overheard(security: &Security) -> Vec<u8> {
    let (program, react) = rounds_of(Coordination::Centralized, 200, 5);
    let program = Arc::new(program);
    let rti = bind(&program, TCP.parse().unwrap(), security);
    let address = rti.address().clone();
    let (tapped, seen) = listen_in(&address);
    let rti = thread::spawn(move || rti.run(|_| {}));
    let federates: Vec<_> = program
        .federates
        .ids()
        .map(|federate| {
            let way = if federate == FederateId(0) { &tapped } else { &address };
            let options = options(&program, federate, way, security);
            let react = Arc::clone(&react);
            thread::spawn(move || federate_with(&options, react, Arc::new(Mutex::new(Vec::new()))))
        })
        .collect();
    assert!(federates.into_iter().all(|federate| federate.join().unwrap() == Ok(())));
    assert_eq!(rti.join().unwrap(), Ok(()));
    let seen = seen.lock().unwrap();
    seen.clone()
}

#[test]
fn an_eavesdropper_does_not_see_what_is_sent() {
    let message = [7; 100];
    let shows = |seen: &[u8]| seen.windows(message.len()).any(|window| window == message);
    assert!(shows(&overheard(&Security::default())), "without TLS it is seen");
    let (_authority, security) = Authority::new().member_for_all();
    assert!(!shows(&overheard(&security)));
}

#[test]
fn a_certificate_of_another_authority_is_refused_by_both_ends() {
    let program = Arc::new(gather(Coordination::Centralized, 1).program);
    let (ours, theirs) = (Authority::new(), Authority::new());
    let (address, handle) = alone(&program, &ours.member("rti"));
    let message = in_vain(&options(&program, FederateId(0), &address, &theirs.member("camera")));
    assert!(message.contains("TLS: invalid peer certificate"), "{message}");
    // It accepts the certificate of the RTI, and the RTI does not accept its certificate.
    let mut half = theirs.member("camera");
    half.tls.as_mut().unwrap().authority = ours.folder.path().join("ca.pem");
    let message = in_vain(&options(&program, FederateId(0), &address, &half));
    assert!(message.contains("does not accept the certificate of this process"), "{message}");
    handle.abort();
}

#[test]
fn a_certificate_does_not_stand_in_for_the_secret() {
    let program = Arc::new(gather(Coordination::Centralized, 1).program);
    let (_authority, security) = Authority::new().member_for_all();
    let (address, handle) = alone(&program, &security);
    let options = options(&program, FederateId(0), &address, &security);
    let message = in_vain(&FederateOptions { federation: FederationId(8), ..options });
    assert!(message.contains("check what --federation-file names"), "{message}");
    handle.abort();
}

#[test]
fn with_and_without_tls_do_not_meet() {
    let program = Arc::new(gather(Coordination::Centralized, 1).program);
    let (_authority, security) = Authority::new().member_for_all();
    let (address, handle) = alone(&program, &security);
    let message = in_vain(&options(&program, FederateId(0), &address, &Security::default()));
    assert!(message.contains("the other end uses TLS, and this process has no"), "{message}");
    handle.abort();
    let (address, handle) = alone(&program, &Security::default());
    let message = in_vain(&options(&program, FederateId(0), &address, &security));
    assert!(message.contains("the other end does not use TLS, and this process does"), "{message}");
    handle.abort();
}

#[test]
fn a_program_that_wants_tls_does_not_run_without() {
    let program = Arc::new(gather(Coordination::Centralized, 1).program);
    let security = Security { encrypt: true, ..Security::default() };
    let rti = hprm::Rti::bind(&hprm::RtiOptions {
        program: Arc::clone(&program),
        fingerprint: Arc::new(program.fingerprint()),
        federation: FederationId(7),
        listen: TCP.parse().unwrap(),
        also_listen: Vec::new(),
        security: security.clone(),
        hang_timeout: hprm::HangTimeout::default(),
    });
    let message = rti.unwrap_err().report().hint.unwrap_or_default();
    assert!(message.contains("--tls-cert"), "{message}");
    let rti: Address = "127.0.0.1:1".parse().unwrap();
    let message = in_vain(&options(&program, FederateId(0), &rti, &security));
    assert!(message.contains("comm-type: TLS"), "{message}");
    // Within a machine, no bytes travel that an eavesdropper could read.
    let (program, react) = rounds_of(Coordination::Centralized, 64, 5);
    well(federation_beside(program, "unix:@hprm-tls-UNIQUE", &security, react, |_| ()));
}

#[test]
fn files_that_are_not_what_they_should_be_are_named() {
    let program = Arc::new(gather(Coordination::Centralized, 1).program);
    let authority = Authority::new();
    let rti: Address = "127.0.0.1:1".parse().unwrap();
    let wrong = |change: &dyn Fn(&mut TlsFiles, &Path)| {
        let mut security = authority.member("camera");
        change(security.tls.as_mut().unwrap(), authority.folder.path());
        in_vain(&options(&program, FederateId(0), &rti, &security))
    };
    let message = wrong(&|files, folder| files.certificate = folder.join("gone.pem"));
    assert!(message.contains("TLS cannot read ") && message.contains("gone.pem: "), "{message}");
    let message = wrong(&|files, folder| files.certificate = folder.join("camera.key"));
    assert!(message.contains("there is no certificate in it"), "{message}");
    let message = wrong(&|files, folder| files.key = folder.join("ca.pem"));
    assert!(message.contains("ca.pem: there is no private key in it"), "{message}");
    authority.member("other");
    let message = wrong(&|files, folder| files.key = folder.join("other.key"));
    assert!(message.contains("other.key: it is not the key of the certificate"), "{message}");
}
