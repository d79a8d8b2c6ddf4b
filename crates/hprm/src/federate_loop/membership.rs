//! Belonging to a federation, before there is anything to run.
//!
//! A federate joins first and loads its program then, so that all federates load at the same time,
//! and one that cannot load says so to the others.

use std::path::PathBuf;
use std::sync::Arc;

use hprm_core::{FederateId, Fingerprint, Nanos, Program};
use hprm_federated::{Federate, FederationId, Input, Output};
use hprm_store::{Store, StoreLimits};

use super::objects::Objects;
use super::reach::Reach;
use super::time::Time;
use super::wires::{LineId, Wires};
use crate::wire::Network;
use crate::{Address, Clock, Failure, Inbox, Security};

/// How long a federate that ends waits until its last frames have arrived.
const FAREWELL: Nanos = 2_000_000_000;

/// Which federate to run, and where its federation is.
#[derive(Clone, Debug)]
pub struct FederateOptions {
    /// The program of the federation.
    pub program: Arc<Program>,
    /// What it must have like the RTI: that of the program, or more.
    pub fingerprint: Arc<Fingerprint>,
    /// Which federate of it.
    pub federate: FederateId,
    /// Where the RTI listens.
    pub rti: Address,
    /// The secret of the federation.
    pub federation: FederationId,
    /// How its links are protected.
    pub security: Security,
    /// How long to look for the RTI, and where others find this federate.
    pub reach: Reach,
    /// How much memory its object store may take.
    pub store: StoreLimits,
    /// Where its share of the logical trace goes, if it is wanted.
    pub trace: Option<PathBuf>,
}

/// What connects a federate to its federation.
pub(super) struct Membership {
    pub(super) machine: Federate,
    pub(super) wires: Wires,
    pub(super) objects: Objects,
    pub(super) time: Time,
}

impl Membership {
    /// Asks the RTI to let a federate join. Fails if no RTI listens there, or this federate cannot
    /// listen itself.
    pub(super) fn join<V: Send + 'static>(
        options: &FederateOptions,
        inbox: &Inbox<V>,
        network: Network,
    ) -> Result<Self, Failure> {
        let wires = Wires::connect(options, network)?;
        let machine = Federate::new(
            options.federate,
            &options.program,
            wires.federation(),
            Arc::clone(&options.fingerprint),
            wires.host(),
            wires.advertised(),
        );
        let notified = inbox.clone();
        let wake = Box::new(move || notified.notify());
        let objects = Objects::new(Store::with_wake(options.federate, options.store, wake));
        let time = Time::new(&options.program, &wires);
        let mut membership = Self { machine, wires, objects, time };
        // The greeting leaves before the program is loaded.
        membership.tell_rti();
        membership.wires.flush();
        Ok(membership)
    }

    /// Which federate this is.
    pub(super) fn me(&self) -> FederateId {
        self.machine.me()
    }

    /// Adds what has come from links.
    pub(super) fn read(&mut self, inputs: &mut Vec<(LineId, Input)>) -> Result<(), Failure> {
        let Self { machine, wires, .. } = self;
        wires.read(|hello| machine.admit(hello).ok(), inputs)
    }

    /// Tells the others why this federate ends, and returns it.
    pub(super) fn fail(&mut self, failure: Failure) -> Failure {
        let report = failure.report();
        let (message, code) = (report.encoded(), report.code);
        // The machine may have ended already; then no other process is left to tell.
        let _ = self.machine.handle(Clock::now(), Input::Failed { message, code });
        self.tell_rti();
        self.wires.leave(FAREWELL, false);
        failure
    }

    /// Makes sure that what has been said arrives, however long it is.
    pub(super) fn say_goodbye(&mut self) {
        self.wires.leave(FAREWELL, true);
    }

    fn tell_rti(&mut self) {
        while let Some(output) = self.machine.poll() {
            if let Output::ToRti(frame) = output {
                self.wires.tell_rti(frame, None);
            }
        }
    }
}
