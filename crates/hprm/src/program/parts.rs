//! Where the parts of a program come from when its reactors are assembled: they are made, or found in a program that
//! is there already.
//!
//! A federate is handed the whole program of its federation. It assembles its reactors again, to get their bodies, and
//! each port, timer, action, mode and reaction is then the one of that name in the handed program. So handles have the
//! ids that all federates mean, whatever else is in the federation.

use hprm_core::{
    ActionId, Connection, Direction, FederateId, ModalElement, ModeId, Nanos, Origin, PortId,
    Program, ProgramBuilder, ProgramError, Properties, ReactionId, ReactionSpec, ReactorId,
    Spacing, TimerId,
};
use std::sync::Arc;

use super::federate::Federate;
use super::handed::Handed;
use crate::Report;

/// What makes or finds the parts of a program.
pub(super) enum Parts {
    /// Makes them.
    New(ProgramBuilder),
    /// Finds them.
    Handed(Handed),
}

macro_rules! parts {
    ($($(#[$doc:meta])* $name:ident($($arg:ident: $kind:ty),*) -> $result:ty;)*) => {$(
        $(#[$doc])*
        pub(super) fn $name(&mut self, $($arg: $kind),*) -> $result {
            match self {
                Self::New(builder) => builder.$name($($arg),*),
                Self::Handed(handed) => handed.$name($($arg),*),
            }
        }
    )*};
}

impl Parts {
    parts! {
        /// A reactor inside another one.
        reactor(parent: ReactorId, name: &str) -> ReactorId;
        /// A channel of a port.
        port(reactor: ReactorId, name: &str, direction: Direction) -> PortId;
        /// An action.
        action(reactor: ReactorId, name: &str, origin: Origin, min_delay: Nanos) -> ActionId;
        /// A minimum spacing.
        space(action: ActionId, spacing: Spacing) -> ();
        /// A timer.
        timer(reactor: ReactorId, name: &str, offset: Nanos, period: Nanos) -> TimerId;
        /// The next reaction of a reactor.
        reaction(reactor: ReactorId, spec: ReactionSpec) -> ReactionId;
        /// A mode.
        mode(reactor: ReactorId, name: &str, initial: bool) -> ModeId;
        /// Puts an element into a mode.
        put_in_mode(element: ModalElement, mode: ModeId) -> ();
    }

    /// The reactor that contains all that is assembled here.
    pub(super) fn root(&self) -> ReactorId {
        match self {
            Self::New(builder) => builder.main(),
            Self::Handed(handed) => handed.root(),
        }
    }

    /// Makes a reactor inside the main reactor a federate, before it gets contents.
    pub(super) fn federate(&mut self, reactor: ReactorId, options: Federate) -> FederateId {
        match self {
            Self::New(builder) => {
                let Federate { name, maxwait, host, transient, restart } = options;
                let federate = builder.federate(reactor, &name, maxwait, host);
                if transient {
                    builder.make_transient(federate);
                }
                if let Some(restart) = restart {
                    builder.restart(federate, restart.stated());
                }
                federate
            }
            Self::Handed(handed) => handed.federate(&options.name),
        }
    }

    /// The name of the program.
    pub(super) fn program_name(&self) -> &str {
        match self {
            Self::New(builder) => builder.reactor_name(builder.main()),
            Self::Handed(handed) => handed.program_name(),
        }
    }

    /// The full name of a reactor.
    pub(super) fn reactor_name(&self, reactor: ReactorId) -> &str {
        match self {
            Self::New(builder) => builder.reactor_name(reactor),
            Self::Handed(handed) => handed.reactor_name(reactor),
        }
    }

    /// The full name of a port.
    pub(super) fn port_name(&self, port: PortId) -> String {
        match self {
            Self::New(builder) => builder.port_name(port),
            Self::Handed(handed) => handed.port_name(port),
        }
    }

    /// The program.
    ///
    /// # Errors
    ///
    /// The first rule that a new program breaks; or how the handed one differs from what was assembled.
    pub(super) fn build(
        self,
        connections: Vec<Connection>,
        properties: Properties,
    ) -> Result<Arc<Program>, Unbuilt> {
        match self {
            Self::New(mut builder) => {
                for connection in connections {
                    builder.connection(connection);
                }
                builder.set_properties(properties);
                builder.build().map(Arc::new).map_err(Unbuilt::Wrong)
            }
            Self::Handed(handed) => handed.program(&connections).map_err(Unbuilt::Differs),
        }
    }
}

/// Why there is no program.
pub(super) enum Unbuilt {
    /// It breaks a rule.
    Wrong(ProgramError),
    /// The handed program is another one.
    Differs(Box<Report>),
}
