//! Which direct links a federate's driver has: the machine knows federates, a link leads to a process.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::FederateId;

use crate::network::Instance;

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(crate) struct DirectLinks {
    /// Links that this process has opened.
    outgoing: BTreeMap<FederateId, Instance>,
    /// Links that others have opened.
    incoming: BTreeMap<FederateId, Instance>,
}

impl DirectLinks {
    /// Opens a link. Returns the process at the other end of the former link to the same federate, which this
    /// ends. That may be the same process: if it has joined again, the former link may still be being opened.
    pub(crate) fn open(&mut self, to: Instance) -> Option<Instance> {
        self.outgoing.insert(to.federate, to)
    }

    /// Takes a link that another process has opened.
    pub(crate) fn accept(&mut self, from: Instance) {
        self.incoming.insert(from.federate, from);
    }

    /// Whether this process has opened a link to that one.
    pub(crate) fn has_opened(&self, to: Instance) -> bool {
        self.outgoing.get(&to.federate) == Some(&to)
    }

    /// Whether there is a link with that process.
    pub(crate) fn has(&self, peer: Instance) -> bool {
        self.has_opened(peer) || self.incoming.get(&peer.federate) == Some(&peer)
    }

    /// The process to which a frame for a federate goes.
    pub(crate) fn to(&self, federate: FederateId) -> Option<Instance> {
        self.outgoing.get(&federate).or_else(|| self.incoming.get(&federate)).copied()
    }

    /// The processes with which there are links.
    pub(crate) fn all(&self) -> BTreeSet<Instance> {
        self.outgoing.values().chain(self.incoming.values()).copied().collect()
    }

    /// The links with a process have ended.
    pub(crate) fn forget(&mut self, peer: Instance) {
        self.outgoing.retain(|_, known| *known != peer);
        self.incoming.retain(|_, known| *known != peer);
    }
}
