//! Federations with real sockets and real memory, but in one process and without Python.

use std::sync::Arc;
use std::thread;

use hprm::{Address, Failure, RtiEvent, Security};
use hprm_core::{Body, Coordination, FederateId, ReactionId, Scheduler};

use crate::common::{BOTH, Bytes, Gather, bind, federation, gather, run_rounds};

#[test]
fn small_messages_over_unix_sockets() {
    for coordination in BOTH {
        let federation = run_rounds(coordination, "unix:@hprm-test-UNIQUE", 64, 200);
        assert!(federation.events.iter().any(|event| matches!(event, RtiEvent::Started(_))));
    }
}

#[test]
fn large_messages_through_the_object_store() {
    for coordination in BOTH {
        run_rounds(coordination, "unix:@hprm-test-UNIQUE", 3_000_000, 20);
    }
}

#[test]
fn any_messages_over_tcp() {
    for coordination in BOTH {
        run_rounds(coordination, "tcp:127.0.0.1:0", 64, 50);
        run_rounds(coordination, "tcp:127.0.0.1:0", 1_000_000, 5);
    }
}

#[test]
fn a_reaction_that_fails_ends_the_federation_and_is_reported_once() {
    for coordination in BOTH {
        let Gather { program, out, round, start, requests, replies, .. } = gather(coordination, 2);
        let react = move |scheduler: &mut Scheduler<Bytes>, id: ReactionId, _: Body| {
            let hello = Bytes::Own(Arc::new(b"hello".to_vec()));
            if id == round {
                return Err(Failure::Exited { code: 3 });
            }
            if id == start {
                scheduler.set(out, hello);
            } else {
                let which = requests.iter().position(|p| scheduler.port(*p).is_some()).unwrap();
                scheduler.set(replies[which], hello);
            }
            Ok(())
        };
        let name = program.federates[FederateId(0)].name.clone();
        let federation = federation(program, "unix:@hprm-test-UNIQUE", Arc::new(react));
        assert_eq!(federation.outcomes[0], Err(Failure::Exited { code: 3 }));
        let report = Failure::Exited { code: 3 }.report().of(name);
        let outcome = federation.rti.unwrap_err();
        assert_eq!((outcome.exit_code(), outcome.report()), (3, report.clone()));
        for outcome in &federation.outcomes[1..] {
            let outcome = outcome.clone().unwrap_err();
            assert_eq!(outcome, Failure::OtherFederateFailed(Box::new(report.clone())));
            assert!(!outcome.needs_report() && outcome.exit_code() == 1);
        }
        let failed = federation.events.iter().filter(|e| matches!(e, RtiEvent::Failed { .. }));
        assert_eq!(failed.count(), 1);
    }
}

#[test]
fn a_timeout_ends_every_federate_at_its_tag() {
    for coordination in BOTH {
        let Gather { mut program, .. } = gather(coordination, 2);
        program.properties.timeout = Some(20_000_000);
        let federation =
            federation(program, "unix:@hprm-test-UNIQUE", Arc::new(|_: &mut _, _, _| Ok(())));
        assert_eq!(federation.rti, Ok(()));
        assert!(federation.outcomes.iter().all(Result::is_ok), "{:?}", federation.outcomes);
    }
}

#[test]
fn a_client_that_claims_to_send_much_is_disconnected() {
    use std::io::{Read, Write};

    let program = Arc::new(gather(Coordination::Centralized, 1).program);
    let listen = "tcp:127.0.0.1:0".parse().unwrap();
    let rti = bind(&program, listen, &Security::default());
    let Address::Tcp(address) = rti.address().clone() else { unreachable!("it is TCP") };
    let handle = rti.handle();
    let rti = thread::spawn(move || rti.run(|_| {}));
    let mut client = std::net::TcpStream::connect(address).unwrap();
    // A message of a gigabyte, or so it says.
    client.write_all(&[0, 0, 0, 64, 1]).unwrap();
    assert_eq!(client.read(&mut [0]).unwrap(), 0);
    handle.abort();
    assert_eq!(rti.join().unwrap(), Ok(()));
}
