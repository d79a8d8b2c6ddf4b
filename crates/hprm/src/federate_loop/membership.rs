//! What connects a federate to its federation, from before its program is loaded.
//!
//! A federate joins first and loads its program then, so that all federates load at the same time, and a
//! federate that cannot load reports that to the federation.

use std::sync::Arc;

use hprm_core::{Connection, FederateId, Fingerprint, Nanos, Payload, Program};
use hprm_federated::{Federate, FederationId, Input, Output, machine_in, relay};
use hprm_store::{Store, StoreLimits};

use super::holding::Held;
use super::links::{FederateLinks, LinkSerial};
use super::objects::Objects;
use super::outlive::EndProcess;
use super::reach::Reach;
use super::time::Time;
use crate::link::Network;
use crate::recorder::TraceRequest;
use crate::shipping::Way;
use crate::trace::TraceShare;
use crate::{Address, Clock, Failure, Inbox, Security, random_bytes};

/// How long a federate that ends waits until its last frames have arrived.
const CLOSE_TIMEOUT: Nanos = 2_000_000_000;

/// Which federate to run, and where its federation is.
#[derive(Clone, Debug)]
pub struct FederateOptions {
    /// The program of the federation.
    pub program: Arc<Program>,
    /// The fingerprint, which must be that of the RTI: of the program, or of more.
    pub fingerprint: Arc<Fingerprint>,
    /// Which federate of it.
    pub federate: FederateId,
    /// Where the RTI listens.
    pub rti: Address,
    /// The secret of the federation.
    pub federation: FederationId,
    /// How the links of the federation are protected.
    pub security: Security,
    /// How long to look for the RTI, and where peers find this federate.
    pub reach: Reach,
    /// How much memory its object store may take.
    pub store: StoreLimits,
    /// Where its share of the logical trace goes, if it is wanted.
    pub trace: Option<TraceShare>,
    /// Where its records go, if the run is traced.
    pub record: Option<TraceRequest>,
    /// Whether the launcher of the federation has started this process.
    pub launched: bool,
    /// Ends the process if a reaction does not return for long after the federation has ended; none if a launcher does
    /// that, or the process has more to do.
    pub end_process: Option<EndProcess>,
}

/// What connects a federate to its federation.
pub(super) struct Membership {
    pub(super) machine: Federate,
    pub(super) links: FederateLinks,
    pub(super) objects: Objects,
    pub(super) time: Time,
    /// Messages that wait for shipments, and what waits behind them.
    pub(super) held: Held,
}

impl Membership {
    /// Asks the RTI to let a federate join. Fails if no RTI listens there, or this federate cannot
    /// listen itself.
    pub(super) fn join<V: Send + 'static>(
        options: &FederateOptions,
        inbox: &Inbox<V>,
        network: Network,
    ) -> Result<Self, Failure> {
        let process = random_bytes()?;
        let in_process = matches!(network, Network::Process(_));
        let mut links = FederateLinks::connect(options, network)?;
        links.listen_for_watchers(options, options.store.capacity_bytes);
        let machine = Federate::new(
            options.federate,
            &options.program,
            links.federation(),
            Arc::clone(&options.fingerprint),
            links.host(),
            links.advertised(),
            u64::from_le_bytes(process),
        )
        .launched(options.launched);
        let machine = match super::reach::is_reached_through_agent(options) {
            true => machine.with_explanation(relay::TOLD),
            false => machine,
        };
        let machine = if in_process { machine.with_references() } else { machine };
        let notified = inbox.clone();
        let wake = Box::new(move || notified.notify());
        let objects = Objects::new(Store::with_wake(options.federate, options.store, wake));
        let time = Time::new(&options.program, &links);
        let mut membership = Self { machine, links, objects, time, held: Held::default() };
        // The first frame leaves before the program is loaded.
        membership.send_to_rti();
        membership.links.flush();
        Ok(membership)
    }

    /// Which federate this is.
    pub(super) fn me(&self) -> FederateId {
        self.machine.me()
    }

    /// Adds what has come from links.
    pub(super) fn read(&mut self, inputs: &mut Vec<(LinkSerial, Input)>) -> Result<(), Failure> {
        let Self { machine, links, .. } = self;
        links.read(|hello| machine.admit(hello).ok(), inputs)?;
        self.await_shipments(inputs)
    }

    /// The payload as it travels to a federate that does not share memory with this one: large parts as shipments, if
    /// agents take them there, and all others in the message.
    pub(super) fn carried(
        &mut self,
        mut payload: Payload,
        to: FederateId,
        connection: &Connection,
    ) -> Result<Payload, Failure> {
        let Self { machine, links, objects, .. } = self;
        if payload.objects().next().is_some()
            && let Some(shipping) = links.shipping()
            && let Some(listens) = machine.listens_at(to)
            && let Some(there) = machine_in(&listens)
        {
            let &Connection { physical, compress, .. } = connection;
            let way = Way { machine: there, receiver: to, is_physical: physical, compress };
            let loaded = shipping.load(&mut payload, way, &mut objects.store());
            loaded.map_err(|error| Failure::store(&error))?;
        }
        objects.inline(payload)
    }

    /// Hands over what agents take to other machines: all messages of a tag are known.
    pub(super) fn leave_shipments(&mut self) {
        let Self { links, objects, .. } = self;
        if let Some(shipping) = links.shipping() {
            shipping.leave(&mut objects.store());
        }
    }

    /// Tells the federation why this federate ends, and returns the failure.
    pub(super) fn fail(&mut self, failure: Failure) -> Failure {
        let report = failure.report();
        let (message, code) = (report.encoded(), report.code);
        // The machine may have ended already; then no other process is left to tell.
        let _ = self.machine.handle(Clock::now(), Input::Failed { message, code });
        self.send_to_rti();
        self.links.close_in_order(CLOSE_TIMEOUT, false);
        failure
    }

    /// Ends the links in order, and waits until all frames have left, however long they are.
    pub(super) fn finish_sending(&mut self) {
        self.links.close_in_order(CLOSE_TIMEOUT, true);
    }

    fn send_to_rti(&mut self) {
        while let Some(output) = self.machine.poll() {
            if let Output::ToRti(frame) = output {
                self.links.send_to_rti(frame, None);
            }
        }
    }
}
