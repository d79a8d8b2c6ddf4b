//! The service with federates of its machine, and links whose other ends are written out.

use std::io::Read;
use std::thread;

use hprm_core::Shipment;

use super::*;
use crate::shipping::client::Shipping;
use crate::shipping::label::{Hello, Item, RECEIPT, VERSION as LINK_VERSION, receipt};
use crate::shipping::pipe::Pipe;

const FEDERATION: FederationId = FederationId(7);

fn service(name: &str) -> (ShippingService, String) {
    let name = format!("hprm-test-service-{name}-{}", std::process::id());
    let listener = RecordListener::bind(&name).unwrap();
    (ShippingService::with("here", listener, |_| {}).unwrap().0, name)
}

/// A federate of this machine that has joined.
fn join(service: &mut ShippingService, name: &str, federate: u16) -> Shipping {
    let name = name.to_owned();
    let joining =
        thread::spawn(move || Shipping::join_at(&name, FEDERATION, FederateId(federate)).unwrap());
    while !joining.is_finished() {
        service.admit();
        service.serve_customers();
        service.settle_customers();
        thread::yield_now();
    }
    joining.join().unwrap()
}

/// A link from another machine, of which that has said what comes first.
fn link(service: &mut ShippingService, machine: &str) -> (u64, Pipe) {
    let (there, here) = Pipe::pair().unwrap();
    let number = service.number();
    service.incoming.insert(number, Incoming::new(here));
    let (version, machine) = (LINK_VERSION, machine.to_owned());
    there.give(&framed(&Hello { version, machine, leads: Vec::new() }).into()).unwrap();
    (number, there)
}

fn label(number: u64, len: u64, to: &[(&str, u16)]) -> Label {
    let to = to.iter().map(|(machine, it)| ((*machine).to_owned(), vec![(FederateId(*it), 1)]));
    Label {
        federation: FEDERATION,
        shipment: Shipment { stream: 1, number, len },
        from: "there".to_owned(),
        to: to.collect(),
        compress: false,
        lost: None,
    }
}

/// Sends bytes of a shipment, perhaps its first ones.
fn write_piece(there: &Pipe, label: &Label, is_first: bool, len: u32) {
    if is_first {
        there.give(&framed(&Item::Shipment(label.clone())).into()).unwrap();
    }
    let piece = Item::Piece { of: label.shipment.key(), len, packed: None };
    there.give(&framed(&piece).into()).unwrap();
    there.give(&vec![5; len as usize].into()).unwrap();
}

/// The other end of a link to a machine to which the service wants one.
fn behind(service: &mut ShippingService, machine: &str) -> Pipe {
    let (behind, here) = Pipe::pair().unwrap();
    let outgoing = service.outgoing.get_mut(machine).unwrap();
    assert!(outgoing.begins_to_open(Clock::now()));
    outgoing.opened(Ok(here), Clock::now());
    behind
}

/// Why a shipment is lost, as the federate is told.
fn why(shipping: &mut Shipping, shipment: Shipment) -> Option<String> {
    let mut store = hprm_store::Store::new(FederateId(3), hprm_store::StoreLimits::default());
    shipping.serve(&mut store).unwrap();
    let parts = vec![hprm_core::Part::Shipped(shipment)];
    let mut payload = hprm_core::Payload { parts, ..hprm_core::Payload::default() };
    shipping.claim(&mut payload, &mut store).err()
}

#[test]
fn a_value_for_which_there_is_no_memory_is_told_at_once() {
    let (mut service, name) = service("memory");
    let mut reader = join(&mut service, &name, 3);
    let (_, there) = link(&mut service, "there");
    let label = label(1, 1 << 40, &[("here", 3)]);
    let shipment = label.shipment;
    there.give(&framed(&Item::Shipment(label)).into()).unwrap();
    service.read_links();
    let why = why(&mut reader, shipment).unwrap();
    assert!(why.starts_with("the agent of here has no memory for it: "), "{why}");
}

#[test]
fn a_message_whose_link_has_ended_waits_only_for_a_machine_that_is_there() {
    let (mut service, name) = service("ended");
    let mut reader = join(&mut service, &name, 3);
    let (number, there) = link(&mut service, "there");
    service.read_links();
    let shipments = [1, 2, 3].map(|number| label(number, 1000, &[("here", 3)]).shipment);
    reader.expect(&shipments[..1], "there", true);
    reader.expect(&shipments[1..2], "there", false);
    service.serve_customers();
    assert_eq!(shipments.map(|it| why(&mut reader, it)), [None, None, None]);
    drop(there);
    service.read_links();
    assert!(!service.incoming.contains_key(&number));
    let ended = Some("the link from the agent of there has ended".to_owned());
    // The other one may come over the next link.
    assert_eq!(shipments.map(|it| why(&mut reader, it)), [ended, None, None]);
    reader.expect(&shipments[2..], "there", true);
    service.serve_customers();
    let nothing = Some("nothing comes from the agent of there".to_owned());
    assert_eq!(why(&mut reader, shipments[2]), nothing);
    let customer = service.customers.values_mut().next().unwrap();
    customer.look(Clock::now().plus(PATIENCE + LOOK), PATIENCE, |_| false);
    assert_eq!(why(&mut reader, shipments[1]), nothing);
}

#[test]
fn a_router_gives_the_receipt_when_those_behind_it_have_the_value() {
    let (mut service, _) = service("router");
    service.leads.store(true, Ordering::Relaxed);
    let (_, there) = link(&mut service, "there");
    let label = label(1, 1000, &[("one", 3), ("other", 4)]);
    let expected = receipt(label.shipment);
    write_piece(&there, &label, true, 1000);
    service.read_links();
    let mut buffer = [0; RECEIPT];
    let behind = ["one", "other"].map(|machine| behind(&mut service, machine));
    service.write_links();
    for behind in &behind {
        assert_eq!((&there).read(&mut buffer).unwrap_err().kind(), io::ErrorKind::WouldBlock);
        behind.give(&expected.to_vec().into()).unwrap();
        service.write_links();
    }
    (&there).read_exact(&mut buffer).unwrap();
    assert_eq!(buffer, expected);
}

#[test]
fn a_router_leads_on_what_is_here_and_begins_anew_when_it_comes_again() {
    let (mut service, _) = service("through");
    service.leads.store(true, Ordering::Relaxed);
    let (_, there) = link(&mut service, "there");
    let label = label(1, 1000, &[("one", 3)]);
    write_piece(&there, &label, true, 600);
    service.read_links();
    let mut one = Incoming::new(behind(&mut service, "one"));
    service.write_links();
    let Came::Label(begun) = one.proceed().unwrap() else { panic!("nothing has begun") };
    assert_eq!(begun.shipment, label.shipment);
    let content = Content::new(service.loan(&begun).unwrap().unwrap());
    one.read_into(begun, Some(content.clone()));
    assert!(matches!(one.proceed().unwrap(), Came::Nothing));
    assert_eq!(content.there(), 600);
    // The sender opens another link before the end of the first one is known.
    let (again, there_again) = link(&mut service, "there");
    write_piece(&there_again, &label, true, 1000);
    service.read_links();
    service.write_links();
    assert_eq!(service.incoming.keys().copied().collect::<Vec<_>>(), [again]);
    let Came::Label(begun) = one.proceed().unwrap() else { panic!("it has not begun anew") };
    assert!(content.is_broken());
    one.read_into(begun, None);
    let Came::Shipment(came, None) = one.proceed().unwrap() else { panic!("it is not whole") };
    one.acknowledge(came.shipment).unwrap();
    service.write_links();
    let mut buffer = [0; RECEIPT];
    (&there_again).read_exact(&mut buffer).unwrap();
    assert_eq!(buffer, receipt(label.shipment));
}

#[test]
fn a_machine_that_is_no_router_leads_nothing() {
    let (mut service, _) = service("none");
    let (_, there) = link(&mut service, "there");
    write_piece(&there, &label(1, 1000, &[("one", 3)]), true, 1000);
    service.read_links();
    assert!(service.outgoing.is_empty() && service.depots.is_empty());
    // It need not be sent again, either.
    (&there).read_exact(&mut [0; RECEIPT]).unwrap();
}

#[test]
fn what_a_federate_has_sent_before_it_ended_is_shipped() {
    let (mut service, name) = service("sent");
    let mut sender = join(&mut service, &name, 3);
    let me = FederateId(3);
    let mut store = hprm_store::Store::new(me, hprm_store::StoreLimits::default());
    for _ in 0..2 {
        let object = store.put(&vec![5; 1 << 20], &[me]).unwrap();
        let parts = vec![hprm_core::Part::Object(object)];
        let mut payload = hprm_core::Payload { parts, ..hprm_core::Payload::default() };
        let (machine, receiver) = ("there", FederateId(4));
        let way = crate::shipping::Way { machine, receiver, is_physical: false, compress: false };
        sender.load(&mut payload, way, &mut store).unwrap();
        sender.leave(&mut store);
    }
    // The sender has not read that.
    for customer in service.customers.values_mut() {
        customer.tell(&Told::Retired { segments: vec![] }, None).unwrap();
    }
    drop(sender);
    // That it takes nothing any more is noticed first.
    service
        .customers
        .values_mut()
        .for_each(|it| assert!(it.tell(&Told::Retired { segments: vec![] }, None).is_some()));
    service.settle_customers();
    service.serve_customers();
    assert!(service.customers.is_empty());
    let there = &service.outgoing["there"];
    assert_eq!(there.len(), 2);
}

#[test]
fn a_federate_that_says_what_cannot_be_read_is_told() {
    let (mut service, name) = service("nonsense");
    let mut other = join(&mut service, &name, 3);
    let mut reader = join(&mut service, &name, 4);
    // No segment has that object.
    reader.ask_to_ship_nothing();
    service.serve_customers();
    let mut store = hprm_store::Store::new(FederateId(4), hprm_store::StoreLimits::default());
    for shipping in [&mut other, &mut reader] {
        shipping.serve(&mut store).unwrap();
    }
    assert_eq!((other.refused(), other.is_open()), (None, true));
    assert!(reader.refused().unwrap().starts_with("it cannot read what this federate sends"));
    assert_eq!(service.customers.len(), 1);
}
