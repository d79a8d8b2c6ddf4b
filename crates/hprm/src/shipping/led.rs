//! Shipments that a router leads to other machines, and that are not there yet: when their sender gets the receipt.
//!
//! The sender keeps a shipment until all behind the router have it, or are given up, because the router may end at any time.

use std::collections::BTreeMap;

use hprm_core::Shipment;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Led(BTreeMap<(u64, u64), Way>);

#[derive(Clone, Copy, Debug)]
struct Way {
    /// The link on which it came last.
    link: u64,
    /// How many machines may still get it.
    left: usize,
}

impl Led {
    /// A shipment has come over a link; if it is new, it is led to so many machines. Returns whether its receipt has to
    /// wait.
    pub(super) fn came(&mut self, shipment: Shipment, link: u64, machines: usize) -> bool {
        if let Some(way) = self.0.get_mut(&shipment.key()) {
            // The link on which it came before has ended.
            way.link = link;
            return true;
        }
        if machines > 0 {
            self.0.insert(shipment.key(), Way { link, left: machines });
        }
        machines > 0
    }

    /// One of these machines has it, or never will. If it was the last one, returns the link on which the receipt leaves.
    pub(super) fn done(&mut self, shipment: Shipment) -> Option<u64> {
        let way = self.0.get_mut(&shipment.key())?;
        way.left -= 1;
        if way.left > 0 {
            return None;
        }
        self.0.remove(&shipment.key()).map(|way| way.link)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_receipt_leaves_when_all_have_it_on_the_link_that_is_there() {
        let (one, other) = (1, 2);
        let shipment = |number| Shipment { stream: 5, number, len: 7 };
        let mut led = Led::default();
        assert!(!led.came(shipment(1), one, 0));
        assert!(led.came(shipment(2), one, 2) && led.came(shipment(3), one, 1));
        assert_eq!((led.done(shipment(1)), led.done(shipment(2))), (None, None));
        // It comes again, because the link has ended; it is not new.
        assert!(led.came(shipment(2), other, 0));
        assert_eq!(led.done(shipment(2)), Some(other));
        assert_eq!(led.done(shipment(3)), Some(one));
        assert_eq!((led.done(shipment(3)), led.came(shipment(3), other, 0)), (None, false));
    }
}
