//! The boards of a federation, as memory that all processes share: what is posted can be read at once, but a federate
//! may read it later, each board on its own.

use std::collections::BTreeSet;

use hprm_core::{FederateId, PhysicalTime, Table};
use hprm_federated::{Fault, Input, Posting};

use crate::Machines;
use crate::node::Node;

/// See the module.
#[derive(Clone, Debug)]
pub(crate) struct Boards {
    /// What each federate shows, and how often it has posted.
    shown: Table<FederateId, (u64, Option<Posting>)>,
    /// Federates that have posted since they last woke up others.
    posted: BTreeSet<FederateId>,
    /// For each federate, how many postings of the others it has read.
    read: Table<FederateId, Table<FederateId, u64>>,
}

impl Boards {
    pub(crate) fn new(federates: usize) -> Self {
        let read = Table::filled(federates, Table::filled(federates, 0));
        Self { shown: Table::filled(federates, (0, None)), posted: BTreeSet::new(), read }
    }

    /// A federate shows something else.
    pub(crate) fn post(&mut self, me: FederateId, posting: Posting) {
        let (count, shown) = &mut self.shown[me];
        *count += 1;
        *shown = Some(posting);
        self.posted.insert(me);
    }

    /// Whether a federate has posted since the last call.
    pub(crate) fn take_posted(&mut self, me: FederateId) -> bool {
        self.posted.remove(&me)
    }

    /// A federate reads those boards of its machine that it does not know yet and that are `chosen`. Returns whether there were any.
    pub(crate) fn read(
        &mut self,
        node: &mut Node,
        now: PhysicalTime,
        machines: Option<&Machines>,
        mut chosen: impl FnMut(FederateId) -> bool,
    ) -> Result<bool, Fault> {
        let me = node.me.federate;
        let is_near = |other| machines.is_none_or(|machines| machines.share_boards(me, other));
        let mut any = false;
        let others = self.shown.iter().filter(|(from, _)| *from != me && is_near(*from));
        for (from, (count, shown)) in others {
            let Some(posting) = shown.as_ref().filter(|_| self.read[me][from] < *count) else {
                continue;
            };
            if chosen(from) {
                self.read[me][from] = *count;
                any = true;
                node.input(now, Input::Board { from, posting: posting.clone() })?;
            }
        }
        Ok(any)
    }
}
