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
    /// Whether all of it is here.
    is_here: bool,
}

impl Led {
    /// A shipment begins to come over a link, and is led to so many machines.
    pub(super) fn begins(&mut self, shipment: Shipment, link: u64, machines: usize) {
        if machines > 0 {
            let way = Way { link, left: machines, is_here: false };
            self.0.insert(shipment.key(), way);
        }
    }

    /// The link over which a shipment comes, as long as not all of it is here.
    pub(super) fn comes_over(&self, shipment: Shipment) -> Option<u64> {
        self.0.get(&shipment.key()).filter(|way| !way.is_here).map(|way| way.link)
    }

    /// All of a shipment has come over a link. Returns whether its receipt has to wait.
    pub(super) fn came(&mut self, shipment: Shipment, link: u64) -> bool {
        let Some(way) = self.0.get_mut(&shipment.key()) else { return false };
        // The link on which it came before has ended, if it is another one.
        (way.link, way.is_here) = (link, true);
        if way.left == 0 {
            self.0.remove(&shipment.key());
            return false;
        }
        true
    }

    /// One of these machines has it, or never will. If it was the last one, returns the link on which the receipt leaves.
    pub(super) fn done(&mut self, shipment: Shipment) -> Option<u64> {
        let way = self.0.get_mut(&shipment.key())?;
        way.left = way.left.saturating_sub(1);
        if way.left > 0 || !way.is_here {
            return None;
        }
        self.0.remove(&shipment.key()).map(|way| way.link)
    }

    /// A link has ended: what has not come completely over it begins anew, if it comes again.
    pub(super) fn ended(&mut self, link: u64) {
        self.0.retain(|_, way| way.is_here || way.link != link);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shipment(number: u64) -> Shipment {
        Shipment { stream: 5, number, len: 7 }
    }

    #[test]
    fn the_receipt_leaves_when_all_have_it_on_the_link_that_is_there() {
        let (one, other) = (1, 2);
        let mut led = Led::default();
        for (number, machines) in [(1, 0), (2, 2), (3, 1)] {
            led.begins(shipment(number), one, machines);
            assert_eq!(led.came(shipment(number), one), machines > 0);
        }
        assert_eq!((led.done(shipment(1)), led.done(shipment(2))), (None, None));
        // It comes again, because the link has ended; it is not new.
        led.ended(one);
        assert!(led.came(shipment(2), other));
        assert_eq!(led.done(shipment(2)), Some(other));
        assert_eq!(led.done(shipment(3)), Some(one));
        assert_eq!((led.done(shipment(3)), led.came(shipment(3), other)), (None, false));
    }

    #[test]
    fn what_has_come_in_part_begins_anew_and_has_no_receipt_before_it_is_here() {
        let (one, other) = (1, 2);
        let mut led = Led::default();
        led.begins(shipment(1), one, 2);
        assert_eq!((led.comes_over(shipment(1)), led.done(shipment(1))), (Some(one), None));
        led.ended(one);
        assert_eq!(led.comes_over(shipment(1)), None);
        led.begins(shipment(1), other, 2);
        // Both are given up before all of it has come.
        assert_eq!((led.done(shipment(1)), led.done(shipment(1))), (None, None));
        assert_eq!(led.comes_over(shipment(1)), Some(other));
        assert!(!led.came(shipment(1), other));
        assert_eq!(led.comes_over(shipment(1)), None);
    }
}
