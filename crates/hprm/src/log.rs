//! The log for debugging: where its lines go, and which are written.
//!
//! The crates emit `tracing` events; a program of the user's may have a subscriber of its own, which
//! gets them. For the command and the Python package, [`log_to_stderr`] writes those that the
//! environment variable `HPRM_LOG` names. What the events are is up to the modules that emit them.

use std::env;

use hprm_core::{Connection, Program};
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt;
use tracing_subscriber::prelude::*;

use crate::Failure;

/// Names the events to write: `hprm_federated=debug,hprm=trace`, or a level for all of them.
const VARIABLE: &str = "HPRM_LOG";

/// Writes the events that `HPRM_LOG` names to the standard error stream; without it, none. It does
/// nothing if the process has a subscriber already.
///
/// # Errors
///
/// If the variable does not name events.
pub fn log_to_stderr() -> Result<(), Failure> {
    let Some(text) = env::var_os(VARIABLE).filter(|text| !text.is_empty()) else {
        return Ok(());
    };
    let targets = text.to_str().and_then(targets).ok_or_else(|| Failure::Option {
        message: format!("{VARIABLE}={} names no events", text.display()),
        hint: Some(
            "give a level (error, warn, info, debug, trace), or one for each part, as in \
             hprm_federated=debug,hprm=trace",
        ),
    })?;
    let lines = fmt::layer().with_writer(std::io::stderr).with_ansi(false).with_thread_names(true);
    // A host with a subscriber of its own keeps it.
    drop(tracing_subscriber::registry().with(lines.with_filter(targets)).try_init());
    Ok(())
}

/// Writes the names of what other events have numbers for.
pub(crate) fn log_names(program: &Program) {
    for (id, federate) in program.federates.iter() {
        tracing::debug!("{id:?} is {}", federate.name);
    }
    for (id, channel) in program.channels.iter() {
        let Connection { from, to, .. } = &program.connections[channel.connection];
        let (from, to) = (program.port_name(*from), program.port_name(*to));
        tracing::debug!("{id:?} is {from} -> {to}");
    }
}

/// Which events a text names. A word that is no level would name a crate; ours begin with `hprm`.
fn targets(text: &str) -> Option<Targets> {
    let targets: Targets = text.parse().ok()?;
    targets.iter().all(|(name, _)| name.starts_with("hprm")).then_some(targets)
}

#[cfg(test)]
mod tests {
    use tracing::Level;

    use super::*;

    #[test]
    fn a_text_names_crates_and_levels() {
        let named = targets("hprm_federated=debug,hprm=trace").expect("it names events");
        assert!(named.would_enable("hprm_federated::log", &Level::DEBUG));
        assert!(!named.would_enable("hprm_federated::log", &Level::TRACE));
        assert!(named.would_enable("hprm::federate_loop", &Level::TRACE));
        assert!(targets("debug").is_some_and(|it| it.would_enable("hprm", &Level::DEBUG)));
        assert!(targets("off").is_some_and(|it| !it.would_enable("hprm", &Level::ERROR)));
    }

    #[test]
    fn a_slip_is_no_name() {
        for text in ["debgu", "federated=debug", "hprm=loud", "=", "hprm=debug=trace"] {
            assert!(targets(text).is_none(), "{text}");
        }
    }
}
