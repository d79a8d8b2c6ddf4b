//! Which reactions may use a port, an action or a mode, and what the others are told.
//!
//! An argument of a reaction has one user. What is an attribute of its reactor has as many as declare it:
//! reactions of that reactor, and, for a port, those of its container. Only a reaction that runs may use
//! any of them, which [`Runtime`](crate::runtime::Runtime) checks.

use hprm_core::{ActionId, Direction, ModeId, PortId, Program, ReactionId, ReactorId};
use pyo3::exceptions::{PyRuntimeError, PyTypeError};
use pyo3::prelude::*;

/// The reactions that may use something, each with what it may do.
#[derive(Clone, Debug)]
pub(crate) enum Users<A> {
    /// The reaction of which it is an argument.
    Argument(ReactionId, A),
    /// Those that declare it, of an attribute of a reactor.
    Declared(Box<[(ReactionId, A)]>),
}

impl<A: Copy> Users<A> {
    /// What `reaction` may do.
    #[inline]
    pub(crate) fn access(&self, reaction: ReactionId) -> Option<A> {
        match self {
            Self::Argument(owner, access) => (reaction == *owner).then_some(*access),
            Self::Declared(users) => {
                users.iter().find(|(user, _)| *user == reaction).map(|(_, access)| *access)
            }
        }
    }
}

/// What a reaction may do with a port or an action.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Access {
    /// Read it.
    Read,
    /// Read it, and give it a first value to remember: an input of the reactor itself.
    Remember,
    /// Set it, and read what was set; or schedule it.
    Write,
}

/// What a reaction wants to do.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Use {
    Read,
    Set,
}

/// A port as a reaction of `reactor` calls it: `image`, or `camera.image` of a reactor that it contains.
pub(crate) fn port_as_seen(program: &Program, reactor: ReactorId, port: PortId) -> String {
    let full = program.port_name(port);
    let own = full.strip_prefix(program.reactors[reactor].name.as_str());
    own.and_then(|rest| rest.strip_prefix('.')).map_or_else(|| full.clone(), str::to_owned)
}

/// The error of a reaction that uses a port which is an attribute of a reactor, and which it has not declared.
pub(crate) fn undeclared_port(
    program: &Program,
    reaction: ReactionId,
    port: PortId,
    wanted: Use,
) -> PyErr {
    let reactor = program.reactions[reaction].reactor;
    let spec = &program.ports[port];
    let name = port_as_seen(program, reactor, port);
    let verb = match wanted {
        Use::Read => "reads",
        Use::Set => "sets",
    };
    let said = format!("reaction {} {verb} port {name}", program.reaction_label(reaction));
    let is_own = spec.reactor == reactor;
    if !is_own && program.reactors[spec.reactor].parent != Some(reactor) {
        return PyRuntimeError::new_err(format!(
            "{said}, which is a port neither of its own reactor nor of one that this contains: connect \
             the port with one of those"
        ));
    }
    // From inside its reactor, an input is read; from outside, it is set.
    let is_written = (spec.direction == Direction::Output) == is_own;
    match (wanted, is_written) {
        (Use::Read, false) => PyRuntimeError::new_err(format!(
            "{said}, which it does not declare: add it to its triggers or to sources=[...]"
        )),
        (_, true) => PyRuntimeError::new_err(format!(
            "{said}, which it does not declare: add it to effects=[...]"
        )),
        (Use::Set, false) => PyTypeError::new_err(match is_own {
            true => {
                format!("{said}, which is an input: only a connection or its container sets it")
            }
            false => format!("{said}, which is an output of {}: only that sets it", {
                let full = &program.reactors[spec.reactor].name;
                full.rsplit('.').next().unwrap_or(full)
            }),
        }),
    }
}

/// The error of a reaction that uses an action which it has not declared.
pub(crate) fn undeclared_action(
    program: &Program,
    reaction: ReactionId,
    action: ActionId,
    wanted: Use,
) -> PyErr {
    let name = program.reaction_label(reaction);
    let action = &program.actions[action].name;
    PyRuntimeError::new_err(match wanted {
        Use::Read => format!(
            "reaction {name} reads action {action}, which it does not declare: add it to its triggers or \
             to sources=[...]"
        ),
        Use::Set => format!(
            "reaction {name} schedules action {action}, which it does not declare as an effect: add it to \
             effects=[...]"
        ),
    })
}

/// The error of a reaction that enters a mode which it has not declared.
pub(crate) fn undeclared_mode(program: &Program, reaction: ReactionId, mode: ModeId) -> PyErr {
    PyRuntimeError::new_err(format!(
        "reaction {} enters mode {}, which it does not declare: add it to effects=[...]",
        program.reaction_label(reaction),
        program.modes[mode].name
    ))
}
