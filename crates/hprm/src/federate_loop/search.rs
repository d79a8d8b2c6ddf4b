//! The search for the RTI: it may not run yet, be busy with unauthenticated clients, or have lost this
//! federate before all federates have joined.

use std::io;

use hprm_core::{Nanos, PhysicalTime};

use super::{FederateOptions, Reach};
use crate::link::descriptors::is_shortage;
use crate::link::{Keys, Link, Network, Purpose};
use crate::wait::{Breaker, Deadline, wait};
use crate::{Address, Clock, Failure, nanoseconds};

/// How long one attempt to connect may take; through agents, which say themselves what is not there, and may have much to
/// do while a large federation starts.
const ATTEMPT: Nanos = 5_000_000_000;
const ATTEMPT_THROUGH_AGENTS: Nanos = 20_000_000_000;

/// Between two attempts; it doubles from the first to the last of these.
pub(super) const PAUSES: (Nanos, Nanos) = (20_000_000, 1_000_000_000);

/// How often a link to a Unix socket may break while it is being opened; after that, it is not by chance,
/// because no other processes connect there. Over TCP, the user gets a message with the possible cause after
/// this many times.
const BREAKS: u32 = 5;

/// See the module.
#[derive(Debug)]
pub(super) struct Search {
    rti: Address,
    reach: Reach,
    give_up: PhysicalTime,
    pause: Nanos,
    /// When to try again.
    next: PhysicalTime,
    breaks: u32,
    notice_given: bool,
    /// Whether there has been a link before.
    had_link: bool,
}

/// Why an attempt has brought no link.
enum NoLink {
    /// A signal has ended the attempt.
    Interrupted,
    /// It has failed, and may be repeated later.
    Failed,
}

impl Search {
    pub(super) fn new(options: &FederateOptions) -> Self {
        let reach = options.reach.clone();
        let give_up = Clock::now().plus(nanoseconds(reach.connect_timeout));
        let (rti, (pause, _), next) = (options.rti.clone(), PAUSES, PhysicalTime(0));
        Self { rti, reach, give_up, pause, next, breaks: 0, notice_given: false, had_link: false }
    }

    /// Connects to the RTI. If it is not there yet, waits for it.
    pub(super) fn find(&mut self, keys: &Keys, network: &Network) -> Result<Link, Failure> {
        keys.check_for(&self.rti)?;
        let is_over = self.reach.interrupted.unwrap_or(|| false);
        loop {
            match self.attempt(keys, network, Breaker::Asked(is_over))? {
                Ok(link) => return Ok(link),
                Err(NoLink::Interrupted) => return Err(Failure::interrupted()),
                Err(NoLink::Failed) if is_over() => return Err(Failure::interrupted()),
                Err(NoLink::Failed) => drop(wait(&[], Some(self.next))),
            }
        }
    }

    /// Notes that the link to the RTI has ended before all federates have joined. The time to find the RTI
    /// again counts from the first such end.
    pub(super) fn lost(&mut self) -> Result<(), Failure> {
        if !std::mem::replace(&mut self.had_link, true) {
            (self.pause, self.notice_given) = (PAUSES.0, false);
            self.give_up = Clock::now().plus(nanoseconds(self.reach.connect_timeout));
        }
        self.failed(&io::ErrorKind::ConnectionReset.into())
    }

    /// When to try again.
    pub(super) fn next_attempt(&self) -> PhysicalTime {
        self.next
    }

    /// Tries again if it is time. Any signal ends the attempt: the caller decides what a signal means, and
    /// a later call repeats the attempt, as long as there is time to find the RTI.
    pub(super) fn try_if_due(
        &mut self,
        keys: &Keys,
        network: &Network,
    ) -> Result<Option<Link>, Failure> {
        if Clock::now() < self.next {
            return Ok(None);
        }
        match self.attempt(keys, network, Breaker::Signals)? {
            Ok(link) => Ok(Some(link)),
            Err(NoLink::Interrupted) if Clock::now() >= self.give_up => {
                Err(self.no_rti(&io::ErrorKind::TimedOut.into()))
            }
            Err(NoLink::Interrupted | NoLink::Failed) => Ok(None),
        }
    }

    /// Tries once.
    fn attempt(
        &mut self,
        keys: &Keys,
        network: &Network,
        breaker: Breaker,
    ) -> Result<Result<Link, NoLink>, Failure> {
        let time = match self.rti {
            Address::Agent(_) => ATTEMPT_THROUGH_AGENTS,
            _ => ATTEMPT,
        };
        let deadline = Deadline { until: Clock::now().plus(time), breaker };
        let link = network.connect(&self.rti, Purpose::Coordination, keys, deadline);
        match link.and_then(|mut link| link.establish(deadline).map(|()| link)) {
            Ok(link) => Ok(Ok(link)),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {
                Ok(Err(NoLink::Interrupted))
            }
            Err(error) => self.failed(&error).map(|()| Err(NoLink::Failed)),
        }
    }

    /// Decides whether to try again, and when.
    fn failed(&mut self, error: &io::Error) -> Result<(), Failure> {
        self.breaks += u32::from(is_break(error));
        let in_vain = self.rti.is_unix() && self.breaks > BREAKS;
        let now = Clock::now();
        if in_vain || now >= self.give_up || !is_transient_error(error) {
            return Err(self.no_rti(error));
        }
        if self.breaks == BREAKS {
            self.tell(&format!("the RTI at {} still {CLOSES}", self.rti));
        } else if !std::mem::replace(&mut self.notice_given, true) {
            let text = match self.had_link {
                true => format!("the RTI at {} has closed the link: joining again", self.rti),
                false => format!("waiting for the RTI at {}: {error}", self.rti),
            };
            self.tell(&text);
        }
        self.next = now.plus(self.pause).min(self.give_up);
        self.pause = (2 * self.pause).min(PAUSES.1);
        Ok(())
    }

    fn tell(&self, text: &str) {
        if let Some(notice) = self.reach.notice {
            notice(text);
        }
    }

    fn no_rti(&self, error: &io::Error) -> Failure {
        let (address, reason) = (self.rti.clone(), error.to_string());
        let hint = match error.kind() {
            io::ErrorKind::PermissionDenied | io::ErrorKind::InvalidData => {
                return Failure::Unauthenticated { address, reason };
            }
            _ if is_break(error) => format!("it {CLOSES}"),
            _ if is_shortage(error) => {
                return Failure::system(
                    format!("cannot open a link to the RTI at {address}"),
                    error,
                );
            }
            _ if address.is_open() => {
                "start the RTI with `hprm rti`, and see whether a firewall is between the machines"
                    .to_owned()
            }
            _ => "start the federation with `hprm run`, or the RTI with `hprm rti`".to_owned(),
        };
        Failure::NoRti { address, reason, hint }
    }
}

/// What is wrong with an RTI that closes links, and possible causes.
const CLOSES: &str = "closes links at once: is it the RTI, of the same version of hprm, are `auth` \
                      and TLS the same everywhere, and do other processes flood it with connections?";

/// Whether the process that listens has closed the link.
fn is_break(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::ConnectionReset | io::ErrorKind::BrokenPipe)
}

/// Whether an error is transient: a later attempt may succeed.
pub(super) fn is_transient_error(error: &io::Error) -> bool {
    use io::ErrorKind;
    !matches!(
        error.kind(),
        ErrorKind::PermissionDenied | ErrorKind::InvalidData | ErrorKind::InvalidInput
    )
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::thread;

    use hprm_federated::FederationId;

    use super::*;
    use crate::link::{LinkAcceptor, Security};

    fn search(rti: Address) -> Search {
        let (reach, pause) = (Reach::default(), PAUSES.0);
        let give_up = Clock::now().plus(nanoseconds(reach.connect_timeout));
        let next = PhysicalTime(0);
        Search { rti, reach, give_up, pause, next, breaks: 0, notice_given: false, had_link: true }
    }

    /// Over TCP, both ends prove that they know the secret, which takes more than one step.
    #[test]
    fn a_link_to_the_rti_is_found_again_in_one_attempt() {
        let network = Network::sockets().unwrap();
        let keys = Keys::new(FederationId(7), Security::default()).unwrap();
        let listener = network.listen(&"127.0.0.1:0".parse().unwrap()).unwrap();
        let mut search = search(listener.address().clone());
        let mut acceptor =
            LinkAcceptor::new(vec![listener], Purpose::Coordination, keys.clone(), 2);
        let is_over = AtomicBool::new(false);
        thread::scope(|scope| {
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    assert!(acceptor.admit(Clock::local()).unwrap().is_empty());
                    thread::yield_now();
                }
            });
            let link = search.try_if_due(&keys, &network);
            is_over.store(true, Ordering::Relaxed);
            assert!(link.unwrap().is_some());
        });
    }
}
