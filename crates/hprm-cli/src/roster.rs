//! The federates for which an RTI that was started by hand waits: printed after a moment, and whenever they
//! change then.

use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use hprm::RtiEvent;
use hprm_core::{FederateId, Program};

use crate::message;

/// How long federates that are started together may take without a word about them.
const MOMENT: Duration = Duration::from_secs(1);

/// See the module.
#[derive(Clone, Debug)]
pub(crate) struct Roster {
    shared: Arc<(Mutex<Waiting>, Condvar)>,
}

#[derive(Clone, PartialEq, Eq, Debug)]
struct Waiting {
    /// Federates without which the federation does not start, and whether they are there.
    needed: BTreeMap<FederateId, (String, bool)>,
    /// Whether the first moment is over.
    speaks: bool,
    /// The federation has started, or never will.
    over: bool,
}

impl Roster {
    /// Starts to wait for the federates of a program.
    pub(crate) fn new(program: &Program) -> Self {
        let roster = Self { shared: Arc::new((Mutex::new(Waiting::new(program)), Condvar::new())) };
        let watch = roster.clone();
        let moment = move || {
            let (_, changed) = &*watch.shared;
            let waiting = changed.wait_timeout_while(watch.waiting(), MOMENT, |now| !now.over);
            let (mut waiting, _) = waiting.unwrap_or_else(PoisonError::into_inner);
            waiting.speaks = true;
            print(&waiting);
        };
        // Without that thread, the RTI is as good as with it.
        let _ = thread::Builder::new().name("roster".to_owned()).spawn(moment);
        roster
    }

    /// Takes note of an event that the RTI reports.
    pub(crate) fn observe(&self, event: &RtiEvent) {
        let mut waiting = self.waiting();
        if waiting.observe(event) {
            print(&waiting);
        }
    }

    /// The federation has ended.
    pub(crate) fn close(&self) {
        self.waiting().over = true;
        self.shared.1.notify_all();
    }

    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn print(waiting: &Waiting) {
    if let Some(line) = waiting.line() {
        message::print_line(&line);
    }
}

impl Waiting {
    fn new(program: &Program) -> Self {
        let needed = program.federates.iter().filter(|(_, federate)| !federate.transient);
        let needed = needed.map(|(id, federate)| (id, (federate.name.clone(), false)));
        Self { needed: needed.collect(), speaks: false, over: false }
    }

    /// Returns whether it has changed.
    fn observe(&mut self, event: &RtiEvent) -> bool {
        match event {
            RtiEvent::Joined { federate, .. } => self.note(*federate, true),
            RtiEvent::Left(federate) => self.note(*federate, false),
            RtiEvent::Started(_) | RtiEvent::Failed { .. } => {
                self.over = true;
                false
            }
            _ => false,
        }
    }

    fn note(&mut self, federate: FederateId, joined: bool) -> bool {
        let Some((_, is_there)) = self.needed.get_mut(&federate) else { return false };
        std::mem::replace(is_there, joined) != joined
    }

    /// The line to print, if any.
    fn line(&self) -> Option<String> {
        let absent = self.needed.values().filter(|(_, joined)| !joined);
        let names: Vec<_> = absent.map(|(name, _)| name.as_str()).collect();
        let plural = if names.len() == 1 { "" } else { "s" };
        let speaks = self.speaks && !self.over && !names.is_empty();
        speaks.then(|| format!("waiting for federate{plural} {}", names.join(", ")))
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::{PhysicalTime, ProgramBuilder, Properties};

    use super::*;

    #[test]
    fn missing_federates_are_printed_after_a_moment() {
        let mut b = ProgramBuilder::new("Main", Properties::default());
        let ids = ["a", "b", "c"].map(|name| {
            let reactor = b.reactor(b.main(), name);
            b.federate(reactor, name, 0, None)
        });
        b.make_transient(ids[2]);
        let mut waiting = Waiting::new(&b.build().unwrap());
        assert_eq!(waiting.line(), None);
        waiting.speaks = true;
        assert_eq!(waiting.line().as_deref(), Some("waiting for federates a, b"));
        assert!(!waiting.observe(&RtiEvent::Joined { federate: ids[2], launched: true }));
        assert!(waiting.observe(&RtiEvent::Joined { federate: ids[1], launched: true }));
        assert_eq!(waiting.line().as_deref(), Some("waiting for federate a"));
        assert!(waiting.observe(&RtiEvent::Left(ids[1])));
        assert_eq!(waiting.line().as_deref(), Some("waiting for federates a, b"));
        assert!(waiting.observe(&RtiEvent::Joined { federate: ids[1], launched: true }));
        assert!(waiting.observe(&RtiEvent::Joined { federate: ids[0], launched: true }));
        assert_eq!(waiting.line(), None);
        let mut started = Waiting { over: false, ..waiting.clone() };
        started.note(ids[0], false);
        assert!(started.line().is_some());
        assert!(!started.observe(&RtiEvent::Started(PhysicalTime(0))));
        assert_eq!(started.line(), None);
    }
}
