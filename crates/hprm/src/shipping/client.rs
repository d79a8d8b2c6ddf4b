//! A federate's end of the connection with the shipping service of its machine. It never waits, but to join.

use std::collections::BTreeMap;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::time::Duration;

use hprm_core::{FederateId, ObjectRef, Part, Payload, PhysicalTime, Shipment};
use hprm_federated::FederationId;
use hprm_store::{Store, StoreError};

use super::records::{Ask, Destination, Told, VERSION};
use super::{SERVICE, SHORTEST, socket_name};
use crate::agent::agent_address;
use crate::records::{self, RecordQueue, RecordSocket};
use crate::wait::{Interest, Ready, Source, SourceId, wait, wait_for};
use crate::{Clock, Failure, nanoseconds, random_bytes};

/// How long the service may take to answer.
const JOINING: Duration = Duration::from_secs(5);

/// See the module.
#[derive(Debug)]
pub(crate) struct Shipping {
    queue: RecordQueue,
    id: SourceId,
    /// This machine.
    machine: String,
    /// Whether there may be something to read, and whether the service is there.
    is_ready: bool,
    is_open: bool,
    logical: Stream,
    physical: Stream,
    /// What is to be shipped once all messages of the tag are known.
    offers: Vec<Offer>,
    /// What has come, and no message has named yet: the object, and how many messages will.
    arrived: BTreeMap<(u64, u64), (ObjectRef, u32)>,
    /// Shipments for which a message waits, and that will not come: why.
    lost: BTreeMap<(u64, u64), String>,
    /// Why the service does not serve this federate any more, if it has said so.
    refused: Option<String>,
}

/// Messages on logical connections and those on physical ones take different ways, so each kind has an order of its own.
///
/// Shipments that leave together are a batch, and have numbers from a multiple of [`BATCH`] on. Messages of a batch come
/// in any order, and before those of the next one.
#[derive(Debug)]
struct Stream {
    id: u64,
    batch: u64,
    next: u64,
}

/// The most shipments of a batch.
const BATCH: u64 = 1 << 20;

/// An object, and where it goes.
#[derive(Debug)]
struct Offer {
    object: ObjectRef,
    shipment: Shipment,
    to: Vec<Destination>,
    compress: bool,
}

/// The way of a message to another machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Way<'a> {
    pub(crate) machine: &'a str,
    pub(crate) receiver: FederateId,
    pub(crate) is_physical: bool,
    /// Whether its large parts are to be compressed.
    pub(crate) compress: bool,
}

impl Stream {
    fn new() -> Result<Self, Failure> {
        Ok(Self { id: u64::from_le_bytes(random_bytes()?), batch: 0, next: 0 })
    }

    fn next(&mut self, len: u64) -> Shipment {
        let number = self.batch * BATCH + self.next;
        self.next += 1;
        Shipment { stream: self.id, number, len }
    }

    fn begin_batch(&mut self) {
        self.batch += 1;
        self.next = 0;
    }
}

impl Shipping {
    /// Joins the service of this machine; none if there is none: then large values travel in their messages.
    pub(crate) fn join(federation: FederationId, federate: FederateId) -> Option<Self> {
        let address = agent_address().map_err(io::Error::other);
        let joined = address.and_then(|it| Self::join_at(&socket_name(&it), federation, federate));
        joined.inspect_err(|error| tracing::debug!("no shipments: {error}")).ok()
    }

    /// Joins the service that listens at an abstract name.
    pub(super) fn join_at(
        name: &str,
        federation: FederationId,
        federate: FederateId,
    ) -> io::Result<Self> {
        let socket = RecordSocket::connect(name)?;
        let join = Ask::Join { version: VERSION, federation, federate };
        socket.send(&records::encode(&join), None)?;
        if !wait_for(socket.as_fd(), Some(Clock::now().plus(nanoseconds(JOINING)))) {
            return Err(io::ErrorKind::TimedOut.into());
        }
        let answer = socket.receive()?.and_then(|(record, _)| records::decode::<Told>(&record));
        let Some(Told::Joined { version: VERSION, machine }) = answer else {
            return Err(io::Error::other("the agent is of another version"));
        };
        socket.do_not_wait()?;
        let stream = || Stream::new().map_err(|failure| io::Error::other(failure.to_string()));
        Ok(Self {
            queue: RecordQueue::new(socket),
            id: SourceId::new(),
            machine,
            is_ready: true,
            is_open: true,
            logical: stream()?,
            physical: stream()?,
            offers: Vec::new(),
            arrived: BTreeMap::new(),
            lost: BTreeMap::new(),
            refused: None,
        })
    }

    /// The name of this machine.
    pub(crate) fn machine(&self) -> &str {
        &self.machine
    }

    /// Whether the service is there. Once it is not, nothing comes any more.
    pub(crate) fn is_open(&self) -> bool {
        self.is_open
    }

    /// Whether something has not been handed to the service yet.
    pub(crate) fn has_waiting(&self) -> bool {
        self.is_open && self.queue.waiting() > 0
    }

    /// What to wait for.
    pub(crate) fn source(&self) -> Option<Source<'_>> {
        let interest = Interest { fd: self.queue.as_fd(), write: self.queue.waiting() > 0 };
        self.is_open.then_some(Source::new(self.id, interest))
    }

    /// Notes whether that is ready.
    pub(crate) fn note(&mut self, ready: Ready) {
        self.is_ready |= ready.is_ready();
    }

    /// Whether there may be something to read.
    pub(crate) fn is_ready(&self) -> bool {
        self.is_ready
    }

    /// Replaces the large objects of a payload by shipments to a federate on another machine.
    ///
    /// # Errors
    ///
    /// If the store does not hold an object.
    pub(crate) fn load(
        &mut self,
        payload: &mut Payload,
        way: Way<'_>,
        store: &mut Store,
    ) -> Result<(), StoreError> {
        for part in &mut payload.parts {
            if let Part::Object(object) = part
                && object.len >= SHORTEST
                && self.is_open
                && (self.offers.len() as u64) < BATCH
            {
                let shipment = self.offer(*object, way, store)?;
                self.address(shipment, way);
                *part = Part::Shipped(shipment);
            }
        }
        Ok(())
    }

    /// The shipment of an object, which the service holds from now on.
    fn offer(
        &mut self,
        object: ObjectRef,
        way: Way<'_>,
        store: &mut Store,
    ) -> Result<Shipment, StoreError> {
        let stream = if way.is_physical { &mut self.physical } else { &mut self.logical };
        let is_meant = |it: &&Offer| {
            let is_same = it.object.serial == object.serial && it.compress == way.compress;
            is_same && it.shipment.stream == stream.id
        };
        if let Some(offer) = self.offers.iter().find(is_meant) {
            return Ok(offer.shipment);
        }
        store.add_reader(object.serial, SERVICE)?;
        let shipment = stream.next(object.len);
        self.offers.push(Offer { object, shipment, to: Vec::new(), compress: way.compress });
        Ok(shipment)
    }

    fn address(&mut self, shipment: Shipment, Way { machine, receiver, .. }: Way<'_>) {
        let Some(offer) = self.offers.iter_mut().find(|it| it.shipment == shipment) else { return };
        match offer.to.iter_mut().find(|(name, _)| name == machine) {
            Some((_, receivers)) => match receivers.iter_mut().find(|(it, _)| *it == receiver) {
                Some((_, uses)) => *uses += 1,
                None => receivers.push((receiver, 1)),
            },
            None => offer.to.push((machine.to_owned(), vec![(receiver, 1)])),
        }
    }

    /// Hands the service what is to be shipped: no more receivers will follow.
    pub(crate) fn leave(&mut self, store: &mut Store) {
        if self.offers.is_empty() {
            return;
        }
        for announcement in store.unannounced(SERVICE) {
            let (segment, len) = (announcement.segment, announcement.len);
            match announcement.as_fd().try_clone_to_owned() {
                Ok(descriptor) => self.ask(&Ask::Segment { segment, len }, Some(descriptor)),
                Err(_) => self.is_open = false,
            }
        }
        let segments = store.retired(SERVICE);
        if !segments.is_empty() {
            self.ask(&Ask::Retired { segments }, None);
        }
        self.logical.begin_batch();
        self.physical.begin_batch();
        for Offer { object, shipment, to, compress } in std::mem::take(&mut self.offers) {
            self.ask(&Ask::Ship { shipment, object, to, compress }, None);
        }
    }

    fn ask(&mut self, ask: &Ask, with: Option<OwnedFd>) {
        if self.is_open && self.queue.push(records::encode(ask), with).is_err() {
            self.is_open = false;
        }
    }

    /// Releases objects of the service.
    pub(crate) fn release(&mut self, serials: &[u64]) {
        self.ask(&Ask::Release { serials: serials.to_vec() }, None);
    }

    /// Takes what the service says. If it is gone, what it holds is released.
    ///
    /// # Errors
    ///
    /// If this process cannot map what has come.
    pub(crate) fn serve(&mut self, store: &mut Store) -> Result<(), StoreError> {
        self.is_ready = false;
        if self.queue.settle().is_err() {
            self.is_open = false;
        }
        while self.is_open {
            match self.queue.receive() {
                Ok(None) => return Ok(()),
                Ok(Some((record, with))) => match records::decode::<Told>(&record) {
                    Some(Told::Segment { segment, len }) => match with {
                        Some(descriptor) => store.attach(SERVICE, segment, len, descriptor)?,
                        None => self.is_open = false,
                    },
                    Some(told) => self.take(told, store),
                    None => self.is_open = false,
                },
                Err(_) => self.is_open = false,
            }
        }
        store.reader_lost(SERVICE);
        Ok(())
    }

    fn take(&mut self, told: Told, store: &mut Store) {
        match told {
            Told::Joined { .. } | Told::Segment { .. } => {}
            Told::Released { serials } => {
                for serial in serials {
                    // A hold that the store does not know is an error of the service, and harmless.
                    let _ = store.release(serial, SERVICE);
                }
            }
            Told::Retired { segments } => {
                segments.iter().for_each(|segment| store.detach(SERVICE, *segment));
            }
            Told::Arrived { shipment, object, uses } => {
                self.arrived.insert(shipment.key(), (object, uses));
            }
            Told::Refused { why } => self.refused = Some(why),
            Told::Lost { shipment, why } => {
                self.lost.insert(shipment.key(), why);
            }
        }
    }

    /// Puts objects in the place of the shipments of a payload, if all have come.
    ///
    /// # Errors
    ///
    /// Why one of them will not come.
    pub(crate) fn claim(
        &mut self,
        payload: &mut Payload,
        store: &mut Store,
    ) -> Result<bool, String> {
        for shipment in payload.shipments() {
            if let Some(why) = self.lost.get(&shipment.key()) {
                return Err(why.clone());
            }
            match self.arrived.get(&shipment.key()) {
                None => return Ok(false),
                Some((object, _)) if object.len == shipment.len => {}
                Some((object, _)) => {
                    return Err(format!(
                        "{} bytes have come instead of {}",
                        object.len, shipment.len
                    ));
                }
            }
        }
        for part in &mut payload.parts {
            let Part::Shipped(shipment) = *part else { continue };
            if let Some((object, uses)) = self.arrived.get_mut(&shipment.key()) {
                *part = Part::Object(*object);
                *uses -= 1;
                if *uses == 0 {
                    self.arrived.remove(&shipment.key());
                }
            }
            self.drop_before(shipment, store);
        }
        Ok(true)
    }

    /// Releases what has come for messages that have not, and will not: those of earlier batches.
    fn drop_before(&mut self, shipment: Shipment, store: &mut Store) {
        let batch = shipment.number / BATCH * BATCH;
        let before = (shipment.stream, 0)..(shipment.stream, batch);
        let old: Vec<_> = self.arrived.range(before).map(|(key, _)| *key).collect();
        for key in old {
            let Some((object, uses)) = self.arrived.remove(&key) else { continue };
            for _ in 0..uses {
                // It is of another store, so this only owes a release.
                let _ = store.decline(object);
            }
        }
    }

    /// Why the service does not serve this federate any more, if it has said so. What was to be shipped may be lost.
    pub(crate) fn refused(&self) -> Option<&str> {
        self.refused.as_deref()
    }

    /// A message waits for its shipments, which come from that machine; perhaps its link has ended since.
    pub(crate) fn expect(&mut self, shipments: &[Shipment], from: &str, link_ended: bool) {
        for &shipment in shipments {
            if !self.arrived.contains_key(&shipment.key()) {
                self.ask(&Ask::Expect { shipment, from: from.to_owned(), link_ended }, None);
            }
        }
    }

    /// Asks for what no service can do.
    #[cfg(test)]
    pub(super) fn ask_to_ship_nothing(&mut self) {
        let shipment = self.logical.next(5);
        let object = ObjectRef { owner: FederateId(4), serial: 0, segment: 9, offset: 0, len: 5 };
        self.ask(&Ask::Ship { shipment, object, to: Vec::new(), compress: false }, None);
    }

    /// Hands the service what waits, before this process ends.
    pub(crate) fn finish(&mut self, until: PhysicalTime) {
        while self.is_open && self.queue.waiting() > 0 && Clock::now() < until {
            let interest = Interest { fd: self.queue.as_fd(), write: true };
            wait(&[interest], Some(until));
            if self.queue.settle().is_err() {
                self.is_open = false;
            }
        }
    }
}
