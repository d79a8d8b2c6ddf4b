//! The extension module `hprm._hprm`: Python bodies for the reactors of a program.
//!
//! [`run`] takes a file to its end; [`load`](mod@load) makes a [`host`] of it, with the ports, actions
//! and time that bodies see; [`serialize`](mod@serialize) carries their values to other processes.
//! What runs when, and what travels where, is decided in the crates below.

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "this is where programs meet the world"
)]

mod accepts;
mod action;
mod api;
mod backlog;
mod bodies;
mod bound;
mod buffer;
mod checked;
mod codec;
mod console;
mod digest;
mod embedded;
mod failure;
mod forced_end;
mod fork;
mod host;
mod interrupt;
mod load;
mod measuring;
mod member;
mod mode;
mod numpy_memory;
mod parcel;
mod parts;
mod places;
mod port;
mod program;
mod run;
mod runtime;
mod serialize;
mod signals;
mod stage;
mod stalls;
mod tag;
mod testing;
mod thread;
mod threads;
mod time;
mod turn;
mod users;
mod value;
mod watching;

use pyo3::prelude::*;

/// The native half of the package `hprm`.
#[pymodule(gil_used = false)]
mod _hprm {
    /// Signals within so many seconds count as one.
    #[pymodule_export]
    const ONE_SIGNAL_S: f64 = hprm::supervisor::SIGNAL_DEBOUNCE.as_secs_f64();

    #[pymodule_export]
    use crate::action::Action;
    #[pymodule_export]
    use crate::api::Api;
    #[pymodule_export]
    use crate::buffer::{Frozen, Memory, shaped};
    #[pymodule_export]
    use crate::checked::{check_declared, named_program};
    #[pymodule_export]
    use crate::console::{output_failed, tell_programs};
    #[pymodule_export]
    use crate::interrupt::Interrupt;
    #[pymodule_export]
    use crate::measuring::{ArrivedValue, describe_value};
    #[pymodule_export]
    use crate::member::{LocalRti, run_member, start_rti};
    #[pymodule_export]
    use crate::mode::Mode;
    #[pymodule_export]
    use crate::numpy_memory::{enter, freeze, in_store};
    #[pymodule_export]
    use crate::port::Port;
    #[pymodule_export]
    use crate::run::{
        describe_program, die_with_parent, loading_failed, read_descriptions, run_declared,
        run_federate, run_program, tell_mistake,
    };
    #[pymodule_export]
    use crate::serialize::array::own;
    #[pymodule_export]
    use crate::stage::{Stage, is_stage_of, stage_files};
    #[pymodule_export]
    use crate::stalls::leave_out_long_reactions;
    #[pymodule_export]
    use crate::tag::Tag;
    #[pymodule_export]
    use crate::testing::{decode, digest, encode, store_round_trip};
    #[pymodule_export]
    use crate::thread::{belong_to_federate, current_federate, runs_bodies};
    #[pymodule_export]
    use crate::threads::run_in_process;
    #[pymodule_export]
    use crate::time::stated_nanos;
    #[pymodule_export]
    use crate::turn::Turn;
    #[pymodule_export]
    use crate::watching::{Watch, WatchedMessage, watch_ports};
}
