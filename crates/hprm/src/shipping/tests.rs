//! Shipments between two machines, over pipes that end at any moment; and what a federate makes of what comes.

use hprm_core::{FederateId, ObjectRef, Part, Payload, PhysicalTime, Shipment};
use hprm_federated::FederationId;
use hprm_store::{Store, StoreLimits};
use proptest::prelude::*;

use super::SERVICE;
use super::content::Content;
use super::depot::Depot;
use super::incoming::{Came, Incoming};
use super::label::{Label, receipt};
use super::outgoing::{IN_VAIN, Outgoing};
use super::pipe::Pipe;

const NOW: PhysicalTime = PhysicalTime(0);
const FEDERATION: FederationId = FederationId(7);

fn shipment(number: u64, len: usize) -> Shipment {
    Shipment { stream: 1, number, len: len as u64 }
}

fn label(shipment: Shipment, receivers: &[(u16, u32)]) -> Label {
    let receivers = receivers.iter().map(|(it, uses)| (FederateId(*it), *uses)).collect();
    let to = vec![("there".to_owned(), receivers)];
    let (federation, from) = (FEDERATION, "here".to_owned());
    Label { federation, shipment, from, to, compress: false, lost: None }
}

fn bytes(number: u64, len: usize) -> Vec<u8> {
    (0..len as u64).map(|at| (at * 31 + number).to_le_bytes()[0]).collect()
}

/// The other machine: one reader, which holds what is delivered.
struct Receiver {
    depot: Depot,
    link: Option<Incoming>,
    delivered: Vec<(u64, Vec<u8>, u32)>,
    /// How many more bytes may be read before the link ends.
    budget: usize,
}

impl Receiver {
    fn new() -> Self {
        let mut depot = Depot::new(NOW);
        assert_eq!(depot.add_reader(FederateId(3)), Some(FederateId(0)));
        Self { depot, link: None, delivered: Vec::new(), budget: usize::MAX }
    }

    /// Takes what has come; false if the link has ended.
    fn proceed(&mut self) -> bool {
        loop {
            let Some(link) = &mut self.link else { return false };
            match link.proceed() {
                Err(_) => {
                    self.link = None;
                    return false;
                }
                Ok(Came::Nothing) => return true,
                Ok(Came::Gone(machine)) => panic!("{machine} is gone"),
                Ok(Came::Label(label)) => {
                    let known = self.depot.remembers(label.shipment);
                    let loan = (!known).then(|| self.depot.loan(label.shipment.len).unwrap());
                    link.read_into(label, loan.map(Content::new));
                }
                Ok(Came::Shipment(label, content)) => {
                    // The receipt may be lost.
                    let ended = link.acknowledge(label.shipment).is_err() || self.budget == 0;
                    self.budget = self.budget.saturating_sub(1);
                    if let Some(content) = content {
                        self.deliver(&label, &content);
                    }
                    if ended {
                        self.link = None;
                        return false;
                    }
                }
            }
        }
    }

    fn deliver(&mut self, label: &Label, content: &Content) {
        let receivers = &label.to[0].1;
        let mut deliveries = Vec::new();
        let object = content.complete(|loan| {
            let (object, all) = self.depot.deliver(label.shipment, loan, receivers);
            deliveries = all;
            object
        });
        let object = object.unwrap();
        assert_eq!(deliveries.len(), 1);
        let got = (label.shipment.number, object.as_bytes().to_vec(), deliveries[0].uses);
        self.delivered.push(got);
        let serial = object.object_ref().serial;
        let released = vec![serial; deliveries[0].uses as usize];
        self.depot.release(deliveries[0].reader, &released);
    }
}

/// Both ends of a new link.
fn connect(outgoing: &mut Outgoing, receiver: &mut Receiver, now: PhysicalTime) {
    let (one, other) = Pipe::pair().unwrap();
    receiver.link = Some(Incoming::new(other));
    outgoing.opened(Ok(one), now);
}

fn send_all(lens: &[usize], compress: bool, breaks: &[usize]) -> Vec<(u64, Vec<u8>, u32)> {
    let me = FederateId(0);
    let mut store = Store::new(me, StoreLimits::default());
    let mut outgoing = Outgoing::new("here", NOW);
    let mut receiver = Receiver::new();
    for (number, len) in (0..).zip(lens) {
        let object = store.put(&bytes(number, *len), &[me]).unwrap();
        let object = store.open(object).unwrap();
        let label = Label { compress, ..label(shipment(number, *len), &[(3, 2), (9, 1)]) };
        outgoing.push(&label, Some(Content::whole(object)), NOW);
    }
    let mut now = NOW;
    for rest in breaks.iter().map(Some).chain([None]) {
        now = now.plus(1_000_000_000);
        assert!(outgoing.begins_to_open(now) || outgoing.next_wakeup().is_none());
        receiver.budget = rest.copied().unwrap_or(usize::MAX);
        connect(&mut outgoing, &mut receiver, now);
        for turn in 0..10_000 {
            outgoing.proceed(now);
            if rest == Some(&turn) {
                // The link ends in the middle of something.
                receiver.link = None;
            }
            if !receiver.proceed() {
                break;
            }
            if outgoing.is_empty() {
                break;
            }
        }
        receiver.link = None;
        outgoing.proceed(now);
    }
    assert!(outgoing.is_empty());
    assert_eq!(outgoing.take_done().len(), lens.len());
    receiver.delivered
}

/// A router between a sender and a receiver, and how many bytes it takes on its links with both.
struct Hub {
    depot: Depot,
    link: Option<Incoming>,
    onward: Outgoing,
    /// What comes, or waits for its receipt from the other end.
    led: std::collections::BTreeSet<u64>,
}

impl Hub {
    fn new() -> Self {
        let (depot, onward) = (Depot::new(NOW), Outgoing::new("hub", NOW));
        Self { depot, link: None, onward, led: std::collections::BTreeSet::new() }
    }

    /// Takes what has come, as the service does.
    fn proceed(&mut self) {
        loop {
            let Some(link) = &mut self.link else { return };
            match link.proceed() {
                Err(_) => return self.breaks(),
                Ok(Came::Nothing) => return,
                Ok(Came::Gone(machine)) => panic!("{machine} is gone"),
                Ok(Came::Label(label)) => {
                    let known = self.depot.remembers(label.shipment);
                    let loan = (!known).then(|| self.depot.loan(label.shipment.len).unwrap());
                    let content = loan.map(Content::new);
                    if content.is_some() {
                        self.led.insert(label.shipment.number);
                        self.onward.push(&label, content.clone(), NOW);
                    }
                    link.read_into(label, content);
                }
                Ok(Came::Shipment(label, content)) => {
                    if let Some(content) = content {
                        let depot = &mut self.depot;
                        let made =
                            content.complete(|loan| depot.deliver(label.shipment, loan, &[]).0);
                        assert!(made.is_some());
                    }
                    if !self.led.contains(&label.shipment.number) {
                        drop(link.acknowledge(label.shipment));
                    }
                }
            }
        }
    }

    /// The link of the sender ends.
    fn breaks(&mut self) {
        drop(self.link.take().map(Incoming::into_reached));
        self.onward.drop_broken();
    }

    /// Gives the sender the receipts for what the receiver has.
    fn settle(&mut self) {
        for shipment in self.onward.take_done() {
            self.led.remove(&shipment.number);
            if let Some(link) = &mut self.link {
                drop(link.acknowledge(shipment));
            }
        }
    }
}

/// Leads shipments through a router. Each turn says which end acts, and a link ends now and then.
fn lead_all(lens: &[usize], compress: bool, turns: &[(usize, u8)]) -> Vec<(u64, Vec<u8>, u32)> {
    let me = FederateId(0);
    let mut store = Store::new(me, StoreLimits::default());
    let (mut sender, mut hub, mut receiver) =
        (Outgoing::new("here", NOW), Hub::new(), Receiver::new());
    for (number, len) in (0..).zip(lens) {
        let object = store.put(&bytes(number, *len), &[me]).unwrap();
        let label = Label { compress, ..label(shipment(number, *len), &[(3, 2)]) };
        sender.push(&label, Some(Content::whole(store.open(object).unwrap())), NOW);
    }
    let mut now = NOW;
    let all = turns.iter().copied().chain((0..3_000).map(|turn| (turn % 3, 9)));
    // After more links without a receipt, a shipment would count as lost.
    let mut ends = [3, 3, 0];
    for (actor, fate) in all {
        now = now.plus(1_000_000_000);
        if sender.begins_to_open(now) {
            hub.breaks();
            let (one, other) = Pipe::pair().unwrap();
            hub.link = Some(Incoming::new(other));
            sender.opened(Ok(one), now);
        }
        if hub.onward.begins_to_open(now) {
            connect(&mut hub.onward, &mut receiver, now);
        }
        let breaks = fate < 4 && ends[actor] > 0;
        ends[actor] -= usize::from(breaks);
        match (actor, breaks) {
            (0, true) => hub.breaks(),
            (1, true) => receiver.link = None,
            (0, _) => sender.proceed(now),
            (1, _) => {
                hub.proceed();
                hub.onward.proceed(now);
                hub.settle();
            }
            _ => drop(receiver.proceed()),
        }
        if sender.is_empty() {
            break;
        }
    }
    assert!(sender.is_empty() && hub.onward.is_empty() && hub.led.is_empty());
    assert_eq!(hub.depot.bytes_in_use(), 0);
    receiver.delivered
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// Whenever links end, each shipment comes once, whole and in order.
    #[test]
    fn shipments_come_once_and_whole(
        lens in prop::collection::vec(1..600_000_usize, 1..6),
        compress in any::<bool>(),
        // After so many without a receipt, a shipment would count as lost.
        breaks in prop::collection::vec(0..12_usize, 0..IN_VAIN as usize),
    ) {
        let delivered = send_all(&lens, compress, &breaks);
        prop_assert_eq!(delivered.len(), lens.len());
        for ((number, len), got) in (0..).zip(&lens).zip(delivered) {
            // The receiver is named twice, and gets it with two messages.
            prop_assert!(got == (number, bytes(number, *len), 2), "{number}");
        }
    }

    /// What is sent on while it comes is what was sent, whenever either link ends, and comes once.
    #[test]
    fn what_is_led_on_while_it_comes_is_whole(
        lens in prop::collection::vec(1..600_000_usize, 1..4),
        compress in any::<bool>(),
        turns in prop::collection::vec((0..3_usize, 0..30_u8), 0..60),
    ) {
        let delivered = lead_all(&lens, compress, &turns);
        prop_assert_eq!(delivered.len(), lens.len());
        for (number, got, uses) in delivered {
            prop_assert!(got == bytes(number, lens[number as usize]) && uses == 2, "{number}");
        }
    }

    /// Whatever comes over a link, it is a label, or the end of the link.
    #[test]
    fn any_bytes_end_a_link_or_wait(sent in prop::collection::vec(any::<u8>(), 0..300)) {
        let (one, other) = Pipe::pair().unwrap();
        let mut link = Incoming::new(other);
        one.give(&sent.into()).unwrap();
        drop(one);
        while let Ok(came) = link.proceed() {
            match came {
                Came::Nothing => break,
                Came::Label(label) => link.read_into(label, None),
                Came::Gone(_) | Came::Shipment(..) => {}
            }
        }
    }
}

#[test]
fn what_cannot_be_sent_for_long_is_dropped() {
    let me = FederateId(0);
    let mut store = Store::new(me, StoreLimits::default());
    let object = store.put(&[1; 1000], &[me]).unwrap();
    let object = store.open(object).unwrap();
    let mut outgoing = Outgoing::new("here", NOW);
    outgoing.push(&label(shipment(1, 1000), &[(3, 1)]), Some(Content::whole(object)), NOW);
    let mut now = NOW;
    let mut freed = None;
    while !outgoing.is_empty() {
        now = outgoing.next_wakeup().unwrap().max(now);
        assert!(outgoing.begins_to_open(now) && !outgoing.begins_to_open(now));
        outgoing.opened(Err(std::io::ErrorKind::NotFound.into()), now);
        store.loan(1).map(drop).unwrap();
        if freed.is_none() && store.stats().bytes_in_use == 0 {
            freed = Some(now);
        }
    }
    // It is given up once.
    assert_eq!(outgoing.take_done(), [shipment(1, 1000)]);
    // The object is free after a minute. For another one, its receivers could be told that it is lost.
    let minutes = [freed.unwrap(), now].map(|it| it.since(NOW) / 60_000_000_000);
    assert_eq!(minutes, [1, 2]);
}

#[test]
fn what_ends_links_again_and_again_lets_others_pass() {
    let me = FederateId(0);
    let mut store = Store::new(me, StoreLimits::default());
    let mut outgoing = Outgoing::new("here", NOW);
    for number in 1..=2 {
        let object = store.put(&[1; 1000], &[me]).unwrap();
        let label = label(shipment(number, 1000), &[(3, 1)]);
        let content = Content::whole(store.open(object).unwrap());
        outgoing.push(&label, Some(content), NOW);
    }
    let mut receiver = Receiver::new();
    let mut now = NOW;
    for _ in 0..4 {
        now = now.plus(1_000_000_000);
        assert!(outgoing.begins_to_open(now));
        connect(&mut outgoing, &mut receiver, now);
        // The other end does not understand what comes first.
        receiver.link = None;
        outgoing.proceed(now);
    }
    now = now.plus(1_000_000_000);
    assert!(outgoing.begins_to_open(now));
    connect(&mut outgoing, &mut receiver, now);
    outgoing.proceed(now);
    let link = receiver.link.as_mut().unwrap();
    let Came::Shipment(first, None) = link.proceed().unwrap() else { panic!("it has bytes") };
    assert!(first.lost.is_some() && first.shipment.number == 1);
    receiver.proceed();
    let numbers: Vec<_> = receiver.delivered.iter().map(|(number, ..)| *number).collect();
    assert_eq!(numbers, [2]);
}

#[test]
fn a_lost_shipment_has_no_bytes() {
    let mut outgoing = Outgoing::new("here", NOW);
    let mut receiver = Receiver::new();
    let lost = Some("no memory".to_owned());
    outgoing.push(&Label { lost, ..label(shipment(1, 1 << 40), &[(3, 1)]) }, None, NOW);
    assert!(outgoing.begins_to_open(NOW));
    connect(&mut outgoing, &mut receiver, NOW);
    outgoing.proceed(NOW);
    let link = receiver.link.as_mut().unwrap();
    let Came::Shipment(label, None) = link.proceed().unwrap() else { panic!("it has bytes") };
    assert_eq!(label.lost.as_deref(), Some("no memory"));
    assert_eq!((link.machine(), link.reaches("here")), (Some("here"), true));
    assert_eq!(receipt(label.shipment)[0], 1);
}

/// A router that has the beginning of a shipment, the link that brought it, and a receiver behind it.
fn begun(filled: usize) -> (Outgoing, Content, Receiver) {
    let mut receiver = Receiver::new();
    let mut onward = Outgoing::new("hub", NOW);
    let content = Content::new(Depot::new(NOW).loan(1000).unwrap());
    content.read_from(&mut &bytes(1, 1000)[..filled], filled).unwrap();
    onward.push(&label(shipment(1, 1000), &[(3, 1)]), Some(content.clone()), NOW);
    assert!(onward.begins_to_open(NOW));
    connect(&mut onward, &mut receiver, NOW);
    onward.proceed(NOW);
    assert!(receiver.proceed());
    (onward, content, receiver)
}

#[test]
fn what_is_here_of_a_shipment_leaves_before_the_rest_has_come() {
    let (mut onward, content, mut receiver) = begun(600);
    let waits = |onward: &Outgoing| onward.interests().count() == 1;
    // All that was here has left.
    assert!(waits(&onward) && receiver.delivered.is_empty());
    // While nothing comes, others pass it.
    let me = FederateId(0);
    let mut store = Store::new(me, StoreLimits::default());
    let object = store.put(&bytes(2, 500), &[me]).unwrap();
    let other = Content::whole(store.open(object).unwrap());
    onward.push(&label(shipment(2, 500), &[(3, 1)]), Some(other), NOW);
    assert!(!waits(&onward));
    onward.proceed(NOW);
    receiver.proceed();
    content.read_from(&mut &bytes(1, 1000)[600..], 400).unwrap();
    onward.proceed(NOW);
    receiver.proceed();
    let expected = vec![(2, bytes(2, 500), 1), (1, bytes(1, 1000), 1)];
    assert!(receiver.delivered == expected);
    onward.proceed(NOW);
    assert_eq!(onward.take_done(), [shipment(2, 500), shipment(1, 1000)]);
    assert!(onward.is_empty() && waits(&onward));
}

#[test]
fn a_piece_of_an_object_stays_where_it_is_and_one_of_what_comes_is_a_copy() {
    let me = FederateId(0);
    let mut store = Store::new(me, StoreLimits::default());
    let object = store.put(&bytes(1, 1000), &[me]).unwrap();
    let object = store.open(object).unwrap();
    let whole = Content::whole(object.clone()).piece(100..600);
    assert_eq!(whole.as_ptr_range(), object.as_bytes()[100..600].as_ptr_range());
    drop(object);
    assert!(store.stats().bytes_in_use > 0, "the piece holds it");
    assert!(*whole == bytes(1, 1000)[100..600]);
    drop(whole);
    assert_eq!(store.stats().bytes_in_use, 0);
    let (_, content, _) = begun(600);
    let begins = content.piece(100..600);
    let is_there = content.look(|it| it[100..600].as_ptr_range().contains(&begins.as_ptr()));
    assert!(*begins == bytes(1, 1000)[100..600] && !is_there);
}

#[test]
fn what_breaks_off_is_forgotten_and_may_begin_anew() {
    let (mut onward, content, mut receiver) = begun(600);
    content.break_off();
    onward.drop_broken();
    let again = Content::new(Depot::new(NOW).loan(1000).unwrap());
    onward.push(&label(shipment(1, 1000), &[(3, 1)]), Some(again.clone()), NOW);
    onward.proceed(NOW);
    assert!(receiver.proceed());
    again.read_from(&mut &bytes(1, 1000)[..], 1000).unwrap();
    onward.proceed(NOW);
    assert!(receiver.proceed() && receiver.delivered == [(1, bytes(1, 1000), 1)]);
    // What has not begun there leaves no trace.
    onward.proceed(NOW);
    assert!(onward.is_empty());
    let (mut onward, content, _) = begun(0);
    receiver.link = None;
    onward.opened(Err(std::io::ErrorKind::NotFound.into()), NOW);
    content.break_off();
    onward.drop_broken();
    assert!(onward.is_empty());
}

#[test]
fn a_receiver_knows_which_machines_still_reach_the_one_in_the_middle() {
    let mut outgoing = Outgoing::new("hub", NOW);
    let mut receiver = Receiver::new();
    for machine in ["a", "b"] {
        outgoing.lead(machine, true);
    }
    outgoing.lead("a", false);
    outgoing.push(
        &Label { lost: Some(String::new()), ..label(shipment(1, 5), &[(3, 1)]) },
        None,
        NOW,
    );
    assert!(outgoing.begins_to_open(NOW));
    connect(&mut outgoing, &mut receiver, NOW);
    outgoing.proceed(NOW);
    let link = receiver.link.as_mut().unwrap();
    assert!(matches!(link.proceed().unwrap(), Came::Shipment(..)));
    let reached = |link: &Incoming| ["hub", "a", "b"].map(|it| link.reaches(it));
    assert_eq!(reached(link), [true, false, true]);
    // What is told between shipments comes after those before it.
    outgoing.lead("a", true);
    outgoing.lead("b", false);
    outgoing.lead("b", false);
    outgoing.proceed(NOW);
    let Came::Gone(gone) = link.proceed().unwrap() else { panic!("b is there") };
    assert_eq!((gone.as_str(), reached(link)), ("b", [true, true, false]));
    assert!(matches!(link.proceed().unwrap(), Came::Nothing));
}

#[test]
fn a_depot_gives_a_shipment_to_all_processes_of_a_federate() {
    let mut depot = Depot::new(NOW);
    let old = depot.add_reader(FederateId(3)).unwrap();
    let new = depot.add_reader(FederateId(3)).unwrap();
    let other = depot.add_reader(FederateId(4)).unwrap();
    let loan = depot.loan(1000).unwrap();
    let (object, deliveries) = depot.deliver(shipment(1, 1000), loan, &[(FederateId(3), 1)]);
    let readers: Vec<_> = deliveries.iter().map(|it| (it.reader, it.uses)).collect();
    assert_eq!(readers, [(old, 1), (new, 1)]);
    assert!(depot.remembers(shipment(1, 1000)) && !depot.remembers(shipment(2, 1000)));
    let serial = object.object_ref().serial;
    drop(object);
    depot.release(old, &[serial]);
    assert!(depot.bytes_in_use() >= 1000);
    depot.remove_reader(new);
    assert_eq!(depot.bytes_in_use(), 0);
    assert!(!depot.is_unread());
    depot.remove_reader(old);
    depot.remove_reader(other);
    assert!(depot.is_unread());
}

mod at_a_federate {
    use super::*;
    use crate::records::{self, RecordListener, RecordQueue};
    use crate::shipping::client::{Shipping, Way};
    use crate::shipping::records::{Ask, Told, VERSION};

    /// A federate's end, and the service's.
    fn joined(name: &str) -> (Shipping, RecordQueue) {
        let name = format!("hprm-test-shipping-{name}-{}", std::process::id());
        let listener = RecordListener::bind(&name).unwrap();
        let joining = std::thread::spawn(move || {
            Shipping::join_at(&name, FEDERATION, FederateId(3)).unwrap()
        });
        let socket = loop {
            if let Some(socket) = listener.accept() {
                break RecordQueue::new(socket.unwrap());
            }
        };
        let ask = loop {
            if let Some((record, _)) = socket.receive().unwrap() {
                break records::decode::<Ask>(&record).unwrap();
            }
        };
        let (federation, federate) = (FEDERATION, FederateId(3));
        assert_eq!(ask, Ask::Join { version: VERSION, federation, federate });
        let mut socket = socket;
        let machine = "there".to_owned();
        let answer = Told::Joined { version: VERSION, machine };
        socket.push(records::encode(&answer), None).unwrap();
        (joining.join().unwrap(), socket)
    }

    fn arrive(service: &mut RecordQueue, number: u64, uses: u32) {
        let object = object(number);
        let arrived = Told::Arrived { shipment: shipment(number, 1000), object, uses };
        service.push(records::encode(&arrived), None).unwrap();
    }

    fn object(number: u64) -> ObjectRef {
        ObjectRef { owner: SERVICE, serial: number, segment: 0, offset: 0, len: 1000 }
    }

    fn message(numbers: &[u64]) -> Payload {
        let parts = numbers.iter().map(|it| Part::Shipped(shipment(*it, 1000))).collect();
        Payload { parts, ..Payload::default() }
    }

    #[test]
    fn a_message_is_complete_when_all_its_shipments_are_there() {
        let (mut shipping, mut service) = joined("complete");
        let mut store = Store::new(FederateId(3), StoreLimits::default());
        let mut first = message(&[1, 2]);
        assert_eq!(shipping.claim(&mut first, &mut store), Ok(false));
        arrive(&mut service, 2, 2);
        shipping.serve(&mut store).unwrap();
        assert_eq!(shipping.claim(&mut first, &mut store), Ok(false));
        assert_eq!(first, message(&[1, 2]));
        arrive(&mut service, 1, 1);
        shipping.serve(&mut store).unwrap();
        assert_eq!(shipping.claim(&mut first, &mut store), Ok(true));
        assert_eq!(first.objects().map(|it| it.serial).collect::<Vec<_>>(), [1, 2]);
        // The second one is for another message, too; and then it is used up.
        assert_eq!(shipping.claim(&mut message(&[2]), &mut store), Ok(true));
        assert_eq!(shipping.claim(&mut message(&[2]), &mut store), Ok(false));
    }

    #[test]
    fn what_no_message_names_is_released_when_later_ones_have_come() {
        let (mut shipping, mut service) = joined("released");
        let mut store = Store::new(FederateId(3), StoreLimits::default());
        let batch = 1 << 20;
        for number in [1, 2, batch + 1, batch + 2] {
            arrive(&mut service, number, 1);
        }
        shipping.serve(&mut store).unwrap();
        // Within a batch, messages come in any order.
        assert_eq!(shipping.claim(&mut message(&[2]), &mut store), Ok(true));
        assert_eq!(store.drain_releases(), []);
        assert_eq!(shipping.claim(&mut message(&[batch + 2]), &mut store), Ok(true));
        assert_eq!(store.drain_releases(), [object(1)]);
        assert_eq!(shipping.claim(&mut message(&[batch + 1]), &mut store), Ok(true));
    }

    #[test]
    fn a_service_that_refuses_a_federate_says_why() {
        let (mut shipping, mut service) = joined("refused");
        let mut store = Store::new(FederateId(3), StoreLimits::default());
        shipping.serve(&mut store).unwrap();
        assert_eq!(shipping.refused(), None);
        service.push(records::encode(&Told::Refused { why: "so".to_owned() }), None).unwrap();
        drop(service);
        shipping.serve(&mut store).unwrap();
        assert_eq!((shipping.refused(), shipping.is_open()), (Some("so"), false));
    }

    #[test]
    fn what_is_lost_or_wrong_is_an_error() {
        let (mut shipping, mut service) = joined("lost");
        let mut store = Store::new(FederateId(3), StoreLimits::default());
        let why = "no memory".to_owned();
        let lost = Told::Lost { shipment: shipment(1, 1000), why: why.clone() };
        service.push(records::encode(&lost), None).unwrap();
        arrive(&mut service, 2, 1);
        shipping.serve(&mut store).unwrap();
        assert_eq!(shipping.claim(&mut message(&[1]), &mut store), Err(why));
        let mut longer = message(&[]);
        longer.parts.push(Part::Shipped(shipment(2, 1001)));
        let said = shipping.claim(&mut longer, &mut store).unwrap_err();
        assert_eq!(said, "1000 bytes have come instead of 1001");
    }

    #[test]
    fn an_object_leaves_once_for_all_receivers_and_is_held_until_it_has_left() {
        let (mut shipping, service) = joined("leaves");
        let mut store = Store::new(FederateId(3), StoreLimits::default());
        let large = store.put(&vec![5; 1 << 20], &[FederateId(3)]).unwrap();
        let small = store.put(&[5; 1000], &[FederateId(3)]).unwrap();
        let parts = vec![Part::Object(large), Part::Object(small)];
        let mut payload = Payload { parts, ..Payload::default() };
        let whole = payload.clone();
        for (machine, receiver, is_physical) in
            [("a", 1, false), ("b", 2, false), ("a", 4, false), ("a", 1, true)]
        {
            payload = whole.clone();
            let receiver = FederateId(receiver);
            let way = Way { machine, receiver, is_physical, compress: false };
            shipping.load(&mut payload, way, &mut store).unwrap();
            assert!(matches!(payload.parts[..], [Part::Shipped(_), Part::Object(_)]));
        }
        shipping.leave(&mut store);
        let mut shipped = Vec::new();
        let mut segments = 0;
        while let Some((record, with)) = service.receive().unwrap() {
            match records::decode::<Ask>(&record).unwrap() {
                Ask::Segment { .. } => segments += usize::from(with.is_some()),
                Ask::Ship { object, to, .. } => {
                    assert_eq!(object, large);
                    shipped.push(to);
                }
                other => panic!("{other:?}"),
            }
        }
        let to = |machine: &str, federates: &[u16]| {
            let once = federates.iter().map(|it| (FederateId(*it), 1));
            (machine.to_owned(), once.collect::<Vec<_>>())
        };
        let logical = vec![to("a", &[1, 4]), to("b", &[2])];
        assert_eq!((segments, shipped), (1, vec![logical, vec![to("a", &[1])]]));
        // However often a message names it, its receiver is named once.
        let mut often = Payload { parts: vec![Part::Object(large); 5000], ..Payload::default() };
        let (machine, receiver) = ("a", FederateId(1));
        let way = Way { machine, receiver, is_physical: false, compress: true };
        shipping.load(&mut often, way, &mut store).unwrap();
        shipping.leave(&mut store);
        let (record, _) = service.receive().unwrap().unwrap();
        let Some(Ask::Ship { to, compress: true, .. }) = records::decode(&record) else {
            panic!("{record:?}")
        };
        assert_eq!(to, [("a".to_owned(), vec![(receiver, 5000)])]);
        // The federate itself does not hold it any more; the service does, until it says so or is gone.
        store.release(large.serial, FederateId(3)).unwrap();
        store.release(small.serial, FederateId(3)).unwrap();
        assert!(store.stats().bytes_in_use >= 1 << 20);
        drop(service);
        shipping.serve(&mut store).unwrap();
        assert!(!shipping.is_open());
        assert_eq!(store.stats().bytes_in_use, 0);
        // From now on, values travel in their messages.
        let again = store.put(&vec![5; 1 << 20], &[FederateId(3)]).unwrap();
        let mut payload = Payload { parts: vec![Part::Object(again)], ..Payload::default() };
        let (machine, receiver) = ("a", FederateId(1));
        let way = Way { machine, receiver, is_physical: false, compress: false };
        shipping.load(&mut payload, way, &mut store).unwrap();
        assert_eq!(payload.parts, [Part::Object(again)]);
    }
}
