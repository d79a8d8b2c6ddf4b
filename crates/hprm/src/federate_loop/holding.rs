//! Messages that wait for shipments.
//!
//! A message that names a shipment is not complete before that is here, and all that comes after it on its link waits
//! behind it, as it waits for the bytes of a message. So the machine sees frames in the order of their link.

use std::collections::{BTreeMap, VecDeque};

use hprm_core::{ChannelId, Payload};
use hprm_federated::{Frame, Input, machine_in};

use super::links::LinkSerial;
use super::membership::Membership;
use crate::Failure;

/// What waits, of each link on which a message is not complete: that first.
#[derive(Debug, Default)]
pub(super) struct Held(BTreeMap<LinkSerial, VecDeque<Input>>);

/// What has come over links.
type Inputs = Vec<(LinkSerial, Input)>;

impl Held {
    /// Takes the inputs that wait for something out, and adds those that do not any more. `complete` completes an input
    /// if it can, and says whether it has. Each message that has just begun to wait is given to `begins`, and once more if its
    /// link has ended, of which that is told.
    fn pass<E>(
        &mut self,
        inputs: &mut Inputs,
        mut complete: impl FnMut(&mut Input) -> Result<bool, E>,
        mut begins: impl FnMut(&mut Input, bool),
    ) -> Result<(), E> {
        let mut passed = Vec::new();
        for (serial, waiting) in &mut self.0 {
            while let Some(first) = waiting.front_mut() {
                if !complete(first)? {
                    break;
                }
                passed.extend(waiting.pop_front().map(|input| (*serial, input)));
                let link_ended = waiting.iter().any(is_end);
                if let Some(next) = waiting.front_mut()
                    && !complete(next)?
                {
                    begins(next, link_ended);
                }
            }
        }
        self.0.retain(|_, waiting| !waiting.is_empty());
        for (serial, mut input) in std::mem::take(inputs) {
            if let Some(waiting) = self.0.get_mut(&serial)
                && !passes_others(&input)
            {
                let link_ended = is_end(&input);
                waiting.push_back(input);
                if let Some(first) = waiting.front_mut().filter(|_| link_ended) {
                    begins(first, true);
                }
            } else if complete(&mut input)? {
                passed.push((serial, input));
            } else {
                begins(&mut input, false);
                self.0.insert(serial, VecDeque::from([input]));
            }
        }
        *inputs = passed;
        Ok(())
    }
}

impl Membership {
    /// Holds back what has come after a message whose shipments have not, and adds what waits no longer.
    ///
    /// # Errors
    ///
    /// If a shipment will not come.
    pub(super) fn await_shipments(&mut self, inputs: &mut Inputs) -> Result<(), Failure> {
        let Self { links, objects, held, machine, .. } = self;
        let Some(shipping) = links.shipping() else { return Ok(()) };
        let mut store = objects.store();
        if shipping.is_ready() {
            shipping.serve(&mut store).map_err(|error| Failure::store(&error))?;
        }
        if let Some(why) = shipping.refused() {
            let text = format!("the agent of this machine takes no large values: {why}");
            return Err(Failure::Link(text));
        }
        let (is_open, mut begun) = (shipping.is_open(), Vec::new());
        let complete = |input: &mut Input| match message(input) {
            Some((_, payload)) if payload.shipments().next().is_some() => {
                let is_complete = shipping.claim(payload, &mut store).map_err(|why| lost(&why))?;
                let why = "the agent of this machine has ended";
                if is_complete || is_open { Ok(is_complete) } else { Err(lost(why)) }
            }
            _ => Ok(true),
        };
        let begins = |input: &mut Input, link_ended| {
            if let Some((channel, payload)) = message(input) {
                begun.push((*channel, payload.shipments().collect::<Vec<_>>(), link_ended));
            }
        };
        held.pass(inputs, complete, begins)?;
        for (channel, shipments, link_ended) in begun {
            let listens = machine.sender(channel).and_then(|sender| machine.listens_at(sender));
            let from = listens.as_deref().and_then(machine_in).unwrap_or_default();
            shipping.expect(&shipments, from, link_ended);
        }
        Ok(())
    }
}

fn lost(why: &str) -> Failure {
    Failure::Link(format!("a large value has not come through agents: {why}"))
}

/// Whether nothing comes after an input on its link.
fn is_end(input: &Input) -> bool {
    matches!(input, Input::RtiLost | Input::PeerLost(_))
}

/// Whether an input need not wait for those before it on its link: what the RTI's clock shows is of no use later, it
/// asks whether this federate is there, and after a failure all end.
fn passes_others(input: &Input) -> bool {
    use Frame::{ClockReply, Failed, Ping};
    matches!(input, Input::FromRti(ClockReply { .. } | Ping | Failed { .. }))
}

/// The message that an input brings, if it brings one.
fn message(input: &mut Input) -> Option<(&ChannelId, &mut Payload)> {
    match input {
        Input::FromRti(Frame::Message { channel, payload, .. })
        | Input::FromPeer { frame: Frame::Message { channel, payload, .. }, .. } => {
            Some((channel, payload))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use hprm_core::{Part, Shipment, Tag};
    use proptest::prelude::*;

    use super::*;

    fn arrives(number: u32, shipment: Option<u64>) -> Input {
        let shipment = shipment.map(|number| Shipment { stream: 1, number, len: 1 });
        let parts = shipment.into_iter().map(Part::Shipped).collect();
        let payload = Payload { parts, ..Payload::default() };
        Input::FromRti(Frame::Message { channel: ChannelId(number), tag: Tag::START, payload })
    }

    fn is_here(there: &BTreeSet<u64>, input: &mut Input) -> bool {
        message(input).is_none_or(|(_, it)| it.shipments().all(|it| there.contains(&it.number)))
    }

    proptest! {
        /// Whenever shipments come, each link keeps its order, nothing is lost, and a message passes once its own and
        /// those before it have come.
        #[test]
        fn links_keep_their_order(
            steps in prop::collection::vec((0..3_u64, prop::option::of(0..8_u64), 0..8_u64), 1..60),
        ) {
            let (mut held, mut there) = (Held::default(), BTreeSet::new());
            let mut sent: BTreeMap<LinkSerial, Vec<Input>> = BTreeMap::new();
            let mut passed = sent.clone();
            let mut waits = BTreeSet::new();
            let whole = (0..8).map(|it| (3, None, it));
            for (number, (link, shipment, comes)) in (0..).zip(steps.into_iter().chain(whole)) {
                let serial = LinkSerial::of(link);
                let input = arrives(number, shipment);
                sent.entry(serial).or_default().push(input.clone());
                there.insert(comes);
                let mut inputs = vec![(serial, input)];
                let complete = |input: &mut Input| Ok::<_, ()>(is_here(&there, input));
                held.pass(&mut inputs, complete, |it, _| {
                    waits.extend(message(it).map(|(channel, _)| *channel));
                }).unwrap();
                for (serial, mut input) in inputs {
                    prop_assert!(is_here(&there, &mut input));
                    passed.entry(serial).or_default().push(input);
                }
                for (serial, waiting) in &mut held.0 {
                    // What waits first is known to be waited for.
                    let first = waiting.front_mut().unwrap();
                    prop_assert!(!is_here(&there, first));
                    prop_assert!(waits.contains(message(first).unwrap().0), "{serial:?}");
                }
            }
            prop_assert!(held.0.is_empty());
            prop_assert_eq!(sent, passed);
        }
    }
}
