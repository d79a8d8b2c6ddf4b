//! The boards of a federation, as memory that processes of one machine share: what is posted can be read at once, but a
//! federate may read it later, each board on its own. It reads those that it has got; the board of a successor takes
//! the place of its predecessor's.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{FederateId, PhysicalTime};
use hprm_federated::{Fault, Input, Posting};

use crate::network::Instance;
use crate::node::Node;

/// See the module.
#[derive(Clone, Debug, Default)]
pub(crate) struct Boards {
    /// What each process shows, and how often it has posted.
    shown: BTreeMap<Instance, (u64, Posting)>,
    /// Processes that have posted since they last woke up others.
    posted: BTreeSet<Instance>,
    /// For each process and each other federate: whose board it reads, and how many postings it has read there.
    read: BTreeMap<(Instance, FederateId), (Instance, u64)>,
}

impl Boards {
    /// A process shows something else.
    pub(crate) fn post(&mut self, me: Instance, posting: Posting) {
        let count = self.shown.get(&me).map_or(0, |(count, _)| *count);
        self.shown.insert(me, (count + 1, posting));
        self.posted.insert(me);
    }

    /// A process gets the board of another one.
    pub(crate) fn attach(&mut self, me: Instance, owner: Instance) {
        self.read.insert((me, owner.federate), (owner, 0));
    }

    /// The process whose board another one reads as that of a federate.
    pub(crate) fn owner(&self, me: Instance, federate: FederateId) -> Option<Instance> {
        self.read.get(&(me, federate)).map(|(owner, _)| *owner)
    }

    /// Whether a process has posted since the last call.
    pub(crate) fn take_posted(&mut self, me: Instance) -> bool {
        self.posted.remove(&me)
    }

    /// A process reads those boards that it does not know yet and that are `chosen`. Returns whether there were any.
    pub(crate) fn read(
        &mut self,
        node: &mut Node,
        now: PhysicalTime,
        mut chosen: impl FnMut() -> bool,
    ) -> Result<bool, Fault> {
        let me = node.me;
        let mut any = false;
        let boards = self.read.iter_mut().filter(|((reader, _), _)| *reader == me);
        for ((_, from), (owner, read)) in boards {
            let Some((count, posting)) = self.shown.get(owner).filter(|(count, _)| *read < *count)
            else {
                continue;
            };
            if chosen() {
                *read = *count;
                any = true;
                node.input(now, Input::Board { from: *from, posting: posting.clone() })?;
            }
        }
        Ok(any)
    }
}
