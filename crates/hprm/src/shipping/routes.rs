//! Which machine is next on the way to another one, as the agent says.

use std::collections::BTreeMap;
use std::time::Duration;

use hprm_core::{Nanos, PhysicalTime};

use crate::Clock;
use crate::link::route_through_agent;

/// How long the agent may take to say so.
const ASKING: Duration = Duration::from_secs(20);

/// How long a way counts as known.
const KNOWN: Nanos = 5_000_000_000;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Routes(BTreeMap<String, (String, PhysicalTime)>);

impl Routes {
    /// The machine to which what is for another one goes first. If the agent does not say, that is the other one: then
    /// opening a link fails, too.
    pub(super) fn hop(&mut self, machine: &str) -> String {
        let now = Clock::now();
        if let Some((hop, said_at)) = self.0.get(machine)
            && now.since(*said_at) < KNOWN
        {
            return hop.clone();
        }
        let hop = route_through_agent(machine, ASKING).unwrap_or_else(|_| machine.to_owned());
        self.0.insert(machine.to_owned(), (hop.clone(), now));
        hop
    }

    /// Asks the agent again for the way to a machine.
    pub(super) fn hop_now(&mut self, machine: &str) -> String {
        self.0.remove(machine);
        self.hop(machine)
    }
}
