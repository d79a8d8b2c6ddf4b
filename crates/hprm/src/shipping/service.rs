//! The shipping service of a machine: one thread of its agent, which waits for federates, for links, and for time.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use hprm_core::{FederateId, Nanos, PhysicalTime, Shipment};
use hprm_federated::{FederationId, relay};
use hprm_store::WritableLoan;

use super::content::Content;
use super::customer::{Customer, Joined};
use super::depot::Depot;
use super::dock::{Harbor, News, ShippingDock, dock};
use super::incoming::{Came, Incoming};
use super::label::{LABEL_LIMIT, Label, framed};
use super::led::Led;
use super::outgoing::Outgoing;
use super::records::{Ask, Destination, Told, VERSION};
use super::routes::Routes;
use super::socket_name;
use crate::Clock;
use crate::agent::{Rest, agent_address, has_come};
use crate::records::{self, RecordListener};
use crate::wait::{Interest, Interests, wait};

/// How often the service looks for what does not come, and for memory that is not used.
const LOOK: Nanos = 1_000_000_000;

/// How long a message may wait for a shipment while there is no link from the sender's machine: as long as a link is
/// kept that is silent.
const PATIENCE: Nanos = 24_000_000_000;
const _: () = assert!(PATIENCE == relay::TOLD);

/// How long the memory of a federation is kept that nothing uses here.
const UNUSED: Nanos = 10_000_000_000;

/// The most federates of this machine; a further one has no shipments.
const CUSTOMERS: usize = 4096;

/// How many records of a federate, or how much of a link, is read in one turn.
const READS: usize = 64;

/// See the module.
#[derive(Debug)]
pub struct ShippingService {
    /// This machine.
    machine: String,
    listener: RecordListener,
    rest: Rest,
    /// Tells the user something.
    tell: fn(&str),
    /// Where the agent is.
    harbor: Harbor,
    depots: BTreeMap<FederationId, Depot>,
    customers: BTreeMap<u64, Customer>,
    outgoing: BTreeMap<String, Outgoing>,
    incoming: BTreeMap<u64, Incoming>,
    /// What is led to other machines, and not there yet.
    led: Led,
    routes: Routes,
    /// Whether this machine leads what others send one another.
    leads: Arc<AtomicBool>,
    /// The number of the next customer or link.
    next: u64,
}

impl ShippingService {
    /// Listens for federates of this machine, which has that name. Returns also where the agent meets the service, which tells the
    /// user by `tell` of what people must know.
    ///
    /// # Errors
    ///
    /// If the system does not allow it, or another agent of this user does.
    pub fn open(machine: &str, tell: fn(&str)) -> io::Result<(Self, ShippingDock)> {
        let address = agent_address().map_err(io::Error::other)?;
        let listener = RecordListener::bind(&socket_name(&address))?;
        Self::with(machine, listener, tell)
    }

    fn with(
        machine: &str,
        listener: RecordListener,
        tell: fn(&str),
    ) -> io::Result<(Self, ShippingDock)> {
        let (dock, harbor) = dock()?;
        let service = Self {
            machine: machine.to_owned(),
            listener,
            rest: Rest::default(),
            tell,
            harbor,
            depots: BTreeMap::new(),
            customers: BTreeMap::new(),
            outgoing: BTreeMap::new(),
            incoming: BTreeMap::new(),
            led: Led::default(),
            routes: Routes::default(),
            leads: Arc::default(),
            next: 0,
        };
        Ok((service, dock))
    }

    /// Says whether the machine is a router, which it is not at first: then the service also leads what others send one
    /// another.
    #[must_use]
    pub fn leads(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.leads)
    }

    /// Runs until the agent ends.
    ///
    /// # Errors
    ///
    /// Why the service cannot go on.
    pub fn run(mut self) -> io::Result<Infallible> {
        let mut looks_at = Clock::now().plus(LOOK);
        loop {
            self.wait(looks_at);
            self.admit();
            self.take_news()?;
            self.serve_customers();
            self.read_links();
            self.write_links();
            if Clock::now() >= looks_at {
                looks_at = Clock::now().plus(LOOK);
                self.look();
            }
            self.settle_customers();
        }
    }

    fn number(&mut self) -> u64 {
        self.next += 1;
        self.next
    }

    /// Waits until anything may be there.
    fn wait(&self, looks_at: PhysicalTime) {
        let to_read = |fd| Interest { fd, write: false };
        let mut interests: Interests<'_> = Interests::new();
        interests.push(to_read(self.harbor.as_fd()));
        if self.rest.until().is_none() {
            interests.push(to_read(self.listener.as_fd()));
        }
        let customers = self.customers.values();
        interests
            .extend(customers.map(|it| Interest { fd: it.queue.as_fd(), write: it.has_waiting() }));
        let links = self.outgoing.values().flat_map(Outgoing::interests);
        let links = links.chain(self.incoming.values().flat_map(Incoming::interests));
        interests.extend(links.map(to_read));
        let wakeups = self.outgoing.values().filter_map(Outgoing::next_wakeup);
        wait(&interests, wakeups.chain([looks_at]).chain(self.rest.until()).min());
    }

    /// Accepts federates.
    fn admit(&mut self) {
        let now = Clock::now();
        while self.rest.is_over(now)
            && let Some(accepted) = self.listener.accept()
        {
            let socket = match accepted {
                Ok(socket) => socket,
                Err(error) if has_come(&self.listener) => {
                    self.rest.begins_in_agent(&error, now, self.tell);
                    continue;
                }
                Err(_) => break,
            };
            if self.customers.len() >= CUSTOMERS {
                continue;
            }
            let number = self.number();
            self.customers.insert(number, Customer::new(socket));
        }
    }

    /// Takes the links that the agent has opened.
    fn take_news(&mut self) -> io::Result<()> {
        self.harbor.acknowledge();
        while let Some(news) = self.harbor.next()? {
            match news {
                News::Opened(machine, opened) => {
                    if let Some(outgoing) = self.outgoing.get_mut(&machine) {
                        outgoing.opened(opened, Clock::now());
                        self.lead_another_way(&machine);
                    }
                }
                News::Came(pipe) => {
                    let number = self.number();
                    self.incoming.insert(number, Incoming::new(pipe));
                }
            }
        }
        Ok(())
    }

    /// If what waits for a machine goes another way by now, it does so.
    fn lead_another_way(&mut self, hop: &str) {
        let Some(outgoing) = self.outgoing.get(hop) else { return };
        let stranded: Vec<String> = outgoing.stranded().into_iter().map(str::to_owned).collect();
        let mut has_another = false;
        for machine in stranded {
            has_another |= self.routes.hop_now(&machine) != hop;
        }
        if !has_another {
            return;
        }
        let taken = self.outgoing.get_mut(hop).map(Outgoing::take_stranded).unwrap_or_default();
        for (label, content) in taken {
            self.send(&label, content.as_ref());
        }
    }

    fn serve_customers(&mut self) {
        let numbers: Vec<u64> = self.customers.keys().copied().collect();
        for number in numbers {
            for _ in 0..READS {
                let Some(customer) = self.customers.get_mut(&number) else { break };
                let asked = match customer.queue.receive() {
                    Ok(None) => break,
                    Ok(Some((record, with))) => {
                        records::decode::<Ask>(&record).map(|ask| self.obey(number, ask, with))
                    }
                    // It has ended.
                    Err(error) if is_end(&error) => {
                        self.remove_customer(number);
                        break;
                    }
                    Err(_) => None,
                };
                if asked.flatten().is_none() {
                    self.refuse(number);
                }
            }
        }
    }

    /// Does what a federate asks for; none if it must not.
    fn obey(&mut self, number: u64, ask: Ask, with: Option<OwnedFd>) -> Option<()> {
        let customer = self.customers.get_mut(&number)?;
        let Some(joined) = customer.joined else {
            let Ask::Join { version: VERSION, federation, federate } = ask else { return None };
            let depots = self.depots.entry(federation);
            let depot = depots.or_insert_with(|| Depot::new(Clock::now()));
            let reader = depot.add_reader(federate)?;
            customer.joined = Some(Joined { federation, federate, reader });
            let machine = self.machine.clone();
            return customer.tell(&Told::Joined { version: VERSION, machine }, None);
        };
        match ask {
            Ask::Join { .. } => return None,
            Ask::Segment { segment, len } => {
                customer.store.attach(joined.federate, segment, len, with?).ok()?;
            }
            Ask::Retired { segments } => {
                segments.iter().for_each(|it| customer.store.detach(joined.federate, *it));
            }
            Ask::Ship { shipment, object, to, compress } => {
                let object = customer.store.open(object).ok()?;
                (object.as_bytes().len() as u64 == shipment.len).then_some(())?;
                let (federation, from) = (joined.federation, self.machine.clone());
                let label = Label { federation, shipment, from, to, compress, lost: None };
                (framed(&label).len() < LABEL_LIMIT).then_some(())?;
                self.send(&label, Some(&Content::whole(object)));
            }
            Ask::Release { serials } => {
                let depot = self.depots.get_mut(&joined.federation)?;
                depot.release(joined.reader, &serials);
            }
            Ask::Expect { shipment, from, link_ended } => {
                let is_known = self.depots.get(&joined.federation)?.remembers(shipment);
                let is_coming = from == self.machine || is_reached(&self.incoming, &from);
                if is_known {
                    // It has come while the federate said so.
                } else if link_ended && !is_coming {
                    customer.lose(shipment, &format!("nothing comes from the agent of {from}"));
                } else {
                    customer.expect(shipment, (from, link_ended), Clock::now());
                }
            }
        }
        Some(())
    }

    /// What a federate says cannot be read. Messages may wait for what it wanted to ship, so it must not go on.
    fn refuse(&mut self, number: u64) {
        if let Some(customer) = self.customers.get_mut(&number) {
            let why = "it cannot read what this federate sends: is it of another version?";
            let _ = customer.tell(&Told::Refused { why: why.to_owned() }, None);
        }
        self.remove_customer(number);
    }

    fn remove_customer(&mut self, number: u64) {
        let Some(customer) = self.customers.remove(&number) else { return };
        if let Some(joined) = customer.joined
            && let Some(depot) = self.depots.get_mut(&joined.federation)
        {
            depot.remove_reader(joined.reader);
            depot.used_at = Clock::now();
        }
    }

    /// Sends a shipment to the machines on its label: once to each that is next on the way to some of them. To federates
    /// of this machine the bytes are copied, as if they had come.
    fn send(&mut self, label: &Label, content: Option<&Content>) {
        let mut hops: BTreeMap<String, Vec<Destination>> = BTreeMap::new();
        for (machine, receivers) in &label.to {
            if *machine == self.machine {
                if let Some(content) = content {
                    self.copy_here(label, content, receivers);
                }
            } else {
                let hop = self.routes.hop(machine);
                hops.entry(hop).or_default().push((machine.clone(), receivers.clone()));
            }
        }
        for (hop, to) in hops {
            self.send_to(hop, &Label { to, ..label.clone() }, content.cloned());
        }
    }

    /// Sends a shipment to one machine.
    fn send_to(&mut self, machine: String, label: &Label, content: Option<Content>) {
        self.outgoing_to(machine).push(label, content, Clock::now());
    }

    fn outgoing_to(&mut self, machine: String) -> &mut Outgoing {
        let outgoing = self.outgoing.entry(machine);
        outgoing.or_insert_with(|| Outgoing::new(&self.machine, Clock::now()))
    }

    fn copy_here(&mut self, label: &Label, content: &Content, receivers: &[(FederateId, u32)]) {
        match self.loan(label) {
            Ok(Some(mut loan)) => {
                content.look(|bytes| crate::copy_value(&mut loan, bytes));
                let copy = Content::full(loan);
                self.deliver(label, &copy, receivers);
            }
            Ok(None) => {}
            Err(why) => self.lose(label, receivers, &why),
        }
    }

    /// Memory for a shipment; none if nothing here needs it.
    fn loan(&mut self, label: &Label) -> Result<Option<WritableLoan>, String> {
        let is_led_on = !self.elsewhere(label).is_empty();
        let depot = match self.depots.get_mut(&label.federation) {
            Some(depot) if !depot.is_unread() || is_led_on => depot,
            None if is_led_on => {
                let depots = self.depots.entry(label.federation);
                depots.or_insert_with(|| Depot::new(Clock::now()))
            }
            _ => return Ok(None),
        };
        if depot.remembers(label.shipment) {
            return Ok(None);
        }
        depot.used_at = Clock::now();
        let here = &self.machine;
        let why = |error| format!("the agent of {here} has no memory for it: {error}");
        depot.loan(label.shipment.len).map(Some).map_err(why)
    }

    /// Hands a shipment to its receivers here.
    fn deliver(&mut self, label: &Label, content: &Content, receivers: &[(FederateId, u32)]) {
        let Some(depot) = self.depots.get_mut(&label.federation) else { return };
        let mut deliveries = Vec::new();
        let object = content.complete(|loan| {
            let (object, all) = depot.deliver(label.shipment, loan, receivers);
            deliveries = all;
            object
        });
        let Some(object) = object else { return };
        for delivery in deliveries {
            let number = self.number_of(label.federation, delivery.reader);
            let customer = number.and_then(|number| self.customers.get_mut(&number));
            let handed = customer.and_then(|it| it.hand(label.shipment, &object, delivery));
            if let (None, Some(number)) = (handed, number) {
                // Without a connection, it knows that it cannot go on.
                self.remove_customer(number);
            }
        }
    }

    /// Tells receivers here that a shipment will not come.
    fn lose(&mut self, label: &Label, receivers: &[(FederateId, u32)], why: &str) {
        let Some(depot) = self.depots.get(&label.federation) else { return };
        for reader in depot.readers_of(receivers) {
            let number = self.number_of(label.federation, reader);
            let customer = number.and_then(|number| self.customers.get_mut(&number));
            if let Some(customer) = customer {
                customer.lose(label.shipment, why);
            }
        }
    }

    fn number_of(&self, federation: FederationId, reader: FederateId) -> Option<u64> {
        let is_meant = |it: &Joined| it.federation == federation && it.reader == reader;
        let mut customers = self.customers.iter();
        customers.find(|(_, it)| it.joined.as_ref().is_some_and(is_meant)).map(|(at, _)| *at)
    }

    /// Reads what other machines send.
    fn read_links(&mut self) {
        let numbers: Vec<u64> = self.incoming.keys().copied().collect();
        for number in numbers {
            if let Err(error) = self.read_link(number) {
                tracing::debug!("a link for shipments has ended: {error}");
                self.link_ended(number);
            }
        }
    }

    /// What a message here waits for does not come over that link any more, nor what others wait for to which it is led. What
    /// has come in part is not led on: it comes again, because it has no receipt.
    fn link_ended(&mut self, number: u64) {
        let Some(link) = self.incoming.remove(&number) else { return };
        let machine = link.machine().map(str::to_owned);
        // If the machine has opened another one, what comes over that is led on.
        let comes = |machine: &String| {
            self.incoming.values().any(|link| link.machine() == Some(machine.as_str()))
        };
        let machine = machine.filter(|machine| !comes(machine));
        let reached = link.into_reached();
        self.led.ended(number);
        for outgoing in self.outgoing.values_mut() {
            outgoing.drop_broken();
            if let Some(machine) = &machine {
                outgoing.lead(machine, false);
            }
        }
        for machine in reached {
            if !is_reached(&self.incoming, &machine) {
                self.gone(&machine);
            }
        }
    }

    /// There is no link from a machine any more.
    fn gone(&mut self, machine: &str) {
        let now = Clock::now();
        self.customers.values_mut().for_each(|customer| customer.gone(machine, now));
    }

    fn read_link(&mut self, number: u64) -> io::Result<()> {
        for _ in 0..READS {
            let Some(link) = self.incoming.get_mut(&number) else { return Ok(()) };
            match link.proceed()? {
                Came::Nothing => return Ok(()),
                Came::Label(label) => self.begins(number, label),
                Came::Gone(machine) => {
                    if !is_reached(&self.incoming, &machine) {
                        self.gone(&machine);
                    }
                }
                Came::Shipment(label, content) => {
                    if !self.led.came(label.shipment, number) {
                        self.acknowledge(number, label.shipment)?;
                    }
                    match content {
                        // Another link may have brought it meanwhile.
                        Some(_) if self.remembers(&label) => {}
                        Some(content) => {
                            self.deliver(&label, &content, &self.receivers_here(&label));
                        }
                        None if label.lost.is_some() => self.lost(label),
                        None => {}
                    }
                }
            }
        }
        Ok(())
    }

    /// A shipment begins to come over a link. What of it goes to other machines leaves as it comes.
    fn begins(&mut self, number: u64, mut label: Label) {
        // A router leads what comes from the sender's machine, and no further: nothing goes round.
        let leads = self.leads.load(Ordering::Relaxed);
        let is_direct = |link: &Incoming| link.machine() == Some(&label.from);
        if !leads || !self.incoming.get(&number).is_some_and(is_direct) {
            label.to.retain(|(machine, _)| *machine == self.machine);
        }
        // A machine has one link here, so one over which it came before has ended.
        let before = self.led.comes_over(label.shipment).filter(|before| *before != number);
        before.into_iter().for_each(|before| self.link_ended(before));
        let elsewhere = self.elsewhere(&label);
        for (machine, _) in &elsewhere {
            self.outgoing_to(machine.clone()).lead(&label.from, true);
        }
        let loan = self.loan(&label).unwrap_or_else(|why| {
            self.lost(Label { lost: Some(why), ..label.clone() });
            None
        });
        let content = loan.map(Content::new);
        if content.is_some() {
            self.led.begins(label.shipment, number, elsewhere.len());
            self.lead_on(&label, content.as_ref());
        }
        if let Some(link) = self.incoming.get_mut(&number) {
            link.read_into(label, content);
        }
    }

    fn remembers(&self, label: &Label) -> bool {
        self.depots.get(&label.federation).is_some_and(|depot| depot.remembers(label.shipment))
    }

    /// One of those to which a shipment is led has it, or never will.
    fn done_elsewhere(&mut self, shipment: Shipment) {
        if let Some(link) = self.led.done(shipment)
            && self.acknowledge(link, shipment).is_err()
        {
            self.link_ended(link);
        }
    }

    fn acknowledge(&mut self, link: u64, shipment: Shipment) -> io::Result<()> {
        self.incoming.get_mut(&link).map_or(Ok(()), |link| link.acknowledge(shipment))
    }

    /// The receivers on this machine.
    fn receivers_here(&self, label: &Label) -> Vec<(FederateId, u32)> {
        let here = label.to.iter().filter(|(machine, _)| *machine == self.machine);
        here.flat_map(|(_, receivers)| receivers.iter().copied()).collect()
    }

    /// The destinations that are other machines.
    fn elsewhere(&self, label: &Label) -> Vec<Destination> {
        label.to.iter().filter(|(machine, _)| *machine != self.machine).cloned().collect()
    }

    /// A shipment will not come.
    fn lost(&mut self, label: Label) {
        let why = label.lost.clone().unwrap_or_default();
        self.lose(&label, &self.receivers_here(&label), &why);
        self.lead_on(&label, None);
    }

    /// Sends a shipment on to the other machines on its label, or tells them that it is lost.
    fn lead_on(&mut self, label: &Label, content: Option<&Content>) {
        for (machine, receivers) in self.elsewhere(label) {
            let to = vec![(machine.clone(), receivers)];
            self.send_to(machine, &Label { to, ..label.clone() }, content.cloned());
        }
    }

    /// Opens links, and writes what leaves.
    fn write_links(&mut self) {
        let (now, mut done) = (Clock::now(), Vec::new());
        for (machine, outgoing) in &mut self.outgoing {
            outgoing.proceed(now);
            done.extend(outgoing.take_done());
            if outgoing.begins_to_open(now) {
                self.harbor.want(machine);
            }
        }
        done.into_iter().for_each(|shipment| self.done_elsewhere(shipment));
    }

    /// Looks for what does not come, and for memory that is not used.
    fn look(&mut self) {
        let now = Clock::now();
        let incoming = &self.incoming;
        let comes = |from: &str| from == self.machine || is_reached(incoming, from);
        for customer in self.customers.values_mut() {
            customer.look(now, PATIENCE, comes);
        }
        self.outgoing.retain(|_, outgoing| !outgoing.is_over());
        let customers = &self.customers;
        self.depots.retain(|federation, depot| {
            let is_read = |it: &Customer| it.joined.is_some_and(|it| it.federation == *federation);
            let is_used = now.since(depot.used_at) < UNUSED || depot.bytes_in_use() > 0;
            customers.values().any(is_read) || is_used
        });
    }

    /// Tells federates which of their objects are not read any more, and writes what waits.
    fn settle_customers(&mut self) {
        let mut gone = Vec::new();
        for (number, customer) in &mut self.customers {
            if customer.settle().is_none() {
                gone.push(*number);
            }
        }
        gone.into_iter().for_each(|number| self.remove_customer(number));
    }
}

/// Whether there is a link over which shipments of a machine come.
fn is_reached(incoming: &BTreeMap<u64, Incoming>, machine: &str) -> bool {
    incoming.values().any(|link| link.reaches(machine))
}

/// Whether the other end of a connection has only ended.
fn is_end(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::ConnectionReset | io::ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests;
