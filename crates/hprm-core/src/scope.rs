//! Which share of a program a scheduler runs: all of it, or one federate.

use crate::{FederateId, Program, ReactorId};

/// Which share of a program a scheduler runs.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Scope {
    /// All of it, in one process, with no network.
    Whole,
    /// The reactors of one federate.
    Federate(FederateId),
}

impl Scope {
    /// Whether `reactor` runs in this scope.
    pub(crate) fn contains(self, program: &Program, reactor: ReactorId) -> bool {
        match self {
            Self::Whole => true,
            Self::Federate(federate) => program.reactors[reactor].federate == Some(federate),
        }
    }
}
