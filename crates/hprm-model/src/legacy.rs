//! The old spellings of how long to wait for inputs, in one place.
//!
//! Before `@maxwait` there was a parameter of the federate's reactor, `STP_offset` or `STA`; before
//! `@absent_after` there was the time in a reaction's `STP(t)` or `STAA(t)`. Programs that use them
//! keep their meaning.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use hprm_core::{Connection, Nanos, PortId};

use crate::declaration::Expression;
use crate::environment::Environment;

/// The value of `STP_offset` or `STA`, in any case, if the federate's reactor has it.
pub(crate) fn maxwait<'a>(environment: &Environment<'a>) -> Option<&'a Expression> {
    environment.parameter(|name| {
        name.eq_ignore_ascii_case("STP_offset") || name.eq_ignore_ascii_case("STA")
    })
}

/// How long reactions say to wait for each port, the longest of them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Waits {
    longest: BTreeMap<PortId, Nanos>,
}

impl Waits {
    pub(crate) fn add(&mut self, port: PortId, wait: Nanos) {
        let longest = self.longest.entry(port).or_default();
        *longest = wait.max(*longest);
    }

    pub(crate) fn of(&self, port: PortId) -> Nanos {
        self.longest.get(&port).copied().unwrap_or_default()
    }

    /// A port that plain connections lead on from is waited for as long as the ports behind it.
    pub(crate) fn spread<'c>(&mut self, connections: impl Iterator<Item = &'c Connection>) {
        let upstream: BTreeMap<PortId, PortId> =
            connections.filter(|c| c.is_direct()).map(|c| (c.to, c.from)).collect();
        let mut waits: Vec<_> = self.longest.iter().map(|(port, wait)| (*port, *wait)).collect();
        // The longest first, so that no port is raised twice.
        waits.sort_by_key(|(_, wait)| Reverse(*wait));
        for (port, wait) in waits {
            let mut here = port;
            // Ends: each step raises a port to `wait` that had less.
            while let Some(next) = upstream.get(&here) {
                if self.of(*next) >= wait {
                    break;
                }
                self.add(*next, wait);
                here = *next;
            }
        }
    }
}
