//! Boards of federations in this process, as other processes of this user find them.

use std::sync::{Arc, Mutex};

use hprm::board::{FORMAT, Identity, Role, Running, running};
use hprm_core::{Body, Coordination, ReactionId, Scheduler};

use crate::common::{Bytes, Federation, Gather, React, federation, gather, well};

/// The boards of a federation that is named like this.
fn boards(name: &str) -> Vec<Running> {
    let mut found = running().unwrap();
    found.retain(|it| it.identity.federation == name);
    found
}

/// A program of two federates and the RTI, and what its first reaction finds.
fn seen_from_within(coordination: Coordination, name: &str) -> (Federation, Vec<Running>) {
    let Gather { mut program, start, .. } = gather(coordination, 1);
    program.name = name.to_owned();
    let (found, name) = (Arc::new(Mutex::new(Vec::new())), name.to_owned());
    let seen = Arc::clone(&found);
    let react: Arc<React> =
        Arc::new(move |scheduler: &mut Scheduler<Bytes>, id: ReactionId, _: Body| {
            if id == start {
                *seen.lock().unwrap() = boards(&name);
                scheduler.request_stop();
            }
            Ok(())
        });
    let ended = well(federation(program, "unix:@hprm-test-UNIQUE", react));
    let found = std::mem::take(&mut *found.lock().unwrap());
    (ended, found)
}

#[test]
fn the_loops_of_a_federation_are_found_while_they_run() {
    for (coordination, name) in
        [(Coordination::Centralized, "BoardsA"), (Coordination::Decentralized, "BoardsB")]
    {
        let (_, found) = seen_from_within(coordination, name);
        let roles: Vec<_> = found.iter().map(|it| it.identity.role.name()).collect();
        assert_eq!(roles, ["RTI", "client__0", "server"]);
        let me = std::process::id();
        for Running { identity, pid, .. } in &found {
            assert_eq!((identity.format, identity.pid, *pid), (FORMAT, me, me));
            assert_eq!(identity.centralized, coordination == Coordination::Centralized);
            assert_eq!(identity.id, found[0].identity.id);
        }
        assert!(boards(name).is_empty());
    }
}

#[test]
fn two_federations_with_one_program_are_apart() {
    let (_, first) = seen_from_within(Coordination::Centralized, "BoardsC");
    let (_, second) = seen_from_within(Coordination::Centralized, "BoardsC");
    let of_rti = |found: &[Running]| -> Identity {
        let rti = found.iter().find(|it| it.identity.role == Role::Rti);
        rti.expect("the RTI has a board").identity.clone()
    };
    let (first, second) = (of_rti(&first), of_rti(&second));
    assert!(first.since < second.since);
    assert_eq!(first.federation, second.federation);
}
