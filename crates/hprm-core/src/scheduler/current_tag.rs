//! The state of the current tag: what is present, and what was sent. All of it is cleared when the tag is
//! complete.

use crate::{ActionId, PortId, Table, Tag};
use alloc::vec::Vec;

/// What is present at the current tag, and how far its processing has got.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct CurrentTag<V> {
    /// The values of present ports, at their roots.
    pub(super) ports: Table<PortId, Option<V>>,
    /// The roots that have a value.
    pub(super) present_ports: Vec<PortId>,
    /// Of those, the ones whose values are sent when the tag is complete.
    pub(super) outbound_ports: Vec<PortId>,
    /// Of the present ports, those with a tardy value, and the tag that it was meant for.
    pub(super) tardy_ports: Vec<(PortId, Tag)>,
    /// The values of present actions; an action may be present without a value.
    pub(super) actions: Table<ActionId, Option<Option<V>>>,
    /// The actions that are present.
    pub(super) present_actions: Vec<ActionId>,
    /// Present ports whose values were sent on undelayed channels already.
    pub(super) sent_ports: Vec<PortId>,
    /// While a tag is processed: the lowest level that has not been passed.
    pub(super) level: Option<u32>,
}

impl<V: Clone> CurrentTag<V> {
    /// A state in which nothing is present, for so many ports and actions.
    pub(super) fn new(ports: usize, actions: usize) -> Self {
        Self {
            ports: Table::filled(ports, None),
            present_ports: Vec::new(),
            outbound_ports: Vec::new(),
            tardy_ports: Vec::new(),
            actions: Table::filled(actions, None),
            present_actions: Vec::new(),
            sent_ports: Vec::new(),
            level: None,
        }
    }
}

impl<V> CurrentTag<V> {
    /// Makes everything absent: the tag is complete.
    #[inline]
    pub(super) fn clear(&mut self) {
        for root in self.present_ports.drain(..) {
            self.ports[root] = None;
        }
        for action in self.present_actions.drain(..) {
            self.actions[action] = None;
        }
        self.outbound_ports.clear();
        self.tardy_ports.clear();
        self.sent_ports.clear();
        self.level = None;
    }
}
