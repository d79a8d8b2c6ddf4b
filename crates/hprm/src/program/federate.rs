//! What a program states about one of its federates, beside the reactor that it is.

use std::time::Duration;

use hprm_core::Nanos;

use super::restart::Restart;
use crate::nanoseconds;

/// A federate that is being added to a [`Federation`](crate::Federation): its name, and what else is stated about it.
/// Where nothing else is, its name alone will do.
///
/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// let mut federation = Federation::new("Vision").decentralized();
/// federation.reactor("camera", (), |_| ());
/// // Waits so long for its inputs, and may come and go while the others run.
/// let viewer = Federate::new("viewer").maxwait(Duration::from_millis(20)).transient();
/// federation.reactor(viewer, (), |_| ());
/// ```
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Federate {
    pub(super) name: String,
    pub(super) maxwait: Nanos,
    pub(super) host: Option<String>,
    pub(super) transient: bool,
    pub(super) restart: Option<Restart>,
}

impl Federate {
    /// A federate of that name.
    #[must_use]
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), maxwait: Nanos::MAX, host: None, transient: false, restart: None }
    }

    /// Under decentralized coordination: how long it waits for its inputs beyond the time of a tag, before it takes
    /// them to be absent. Without this, it waits until it knows.
    #[must_use]
    pub fn maxwait(mut self, wait: Duration) -> Self {
        self.maxwait = nanoseconds(wait);
        self
    }

    /// The host that it is meant for. [`Federation::run`](crate::Federation::run) starts all federates on this one.
    #[must_use]
    pub fn at(mut self, host: impl Into<String>) -> Self {
        self.host = Some(host.into());
        self
    }

    /// It may join while the others run, leave, and join again.
    #[must_use]
    pub fn transient(mut self) -> Self {
        self.transient = true;
        self
    }

    /// The launcher of the federation starts it again when it has ended. It is transient, too.
    #[must_use]
    pub fn restart(mut self, restart: Restart) -> Self {
        self.restart = Some(restart);
        self.transient()
    }

    /// The same for one member of a bank.
    pub(super) fn member(&self, index: usize) -> Self {
        Self { name: format!("{}__{index}", self.name), ..self.clone() }
    }
}

impl From<&str> for Federate {
    fn from(name: &str) -> Self {
        Self::new(name)
    }
}

impl From<String> for Federate {
    fn from(name: String) -> Self {
        Self::new(name)
    }
}
