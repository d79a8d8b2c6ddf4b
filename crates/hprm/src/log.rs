//! The log for debugging: where its lines go, and which are written.
//!
//! The crates emit `tracing` events; a program of the user's may have a subscriber of its own, which
//! gets them. For the command and the Python package, [`log_to_stderr`] writes those that the
//! environment variable `HPRM_LOG` names. What the events are is up to the modules that emit them.

use hprm_core::{Connection, Program};
use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt;
use tracing_subscriber::prelude::*;

use crate::{Failure, variables};

/// Names the events to write: `hprm_federated=debug,hprm=trace`, or a level for all of them.
const VARIABLE: &str = "HPRM_LOG";

/// What the events are called by.
const PARTS: [&str; 4] =
    ["hprm", "hprm_federated", "hprm_federated::federate", "hprm_federated::rti"];

/// What may stand behind the name of a part, or alone.
const LEVELS: [&str; 6] = ["off", "error", "warn", "info", "debug", "trace"];

/// Writes the events that `HPRM_LOG` names to the standard error stream; without it, none. Lines name
/// the thread if federates are `threads` of this process. It does nothing if the process has a
/// subscriber already.
///
/// # Errors
///
/// If the variable does not name events.
pub fn log_to_stderr(threads: bool) -> Result<(), Failure> {
    let Some(text) = variables::value_of(VARIABLE) else {
        return Ok(());
    };
    let targets = targets(&text.to_string_lossy()).map_err(|word| Failure::Option {
        message: variables::wrong(VARIABLE, &text, &format!("`{word}` names no events")),
        hint: Some(
            "give a level (error, warn, info, debug, trace, off), or one for each part, as in \
             hprm_federated=debug,hprm=trace; the parts are hprm, hprm_federated, \
             hprm_federated::federate and hprm_federated::rti",
        ),
    })?;
    let lines = fmt::layer().with_writer(std::io::stderr).with_ansi(false);
    let lines = lines.with_thread_names(threads).with_filter(targets);
    // A host with a subscriber of its own keeps it.
    drop(tracing_subscriber::registry().with(lines).try_init());
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

/// Which events a text names; or else the word that names none.
fn targets(text: &str) -> Result<Targets, String> {
    let mut targets = Targets::new();
    for word in text.split(',').map(str::trim) {
        let level = |name: &str| match LEVELS.contains(&name.trim().to_lowercase().as_str()) {
            true => name.trim().parse::<LevelFilter>().map_err(|_| word.to_owned()),
            false => Err(word.to_owned()),
        };
        targets = match word.split_once('=') {
            None => targets.with_default(level(word)?),
            Some((part, name)) if PARTS.contains(&part.trim()) => {
                targets.with_target(part.trim(), level(name)?)
            }
            Some(_) => return Err(word.to_owned()),
        };
    }
    Ok(targets)
}

#[cfg(test)]
mod tests {
    use tracing::Level;

    use super::*;

    #[test]
    fn a_text_names_parts_and_levels() {
        let named = targets("hprm_federated=debug, hprm=trace").expect("it names events");
        assert!(named.would_enable("hprm_federated::rti", &Level::DEBUG));
        assert!(!named.would_enable("hprm_federated::rti", &Level::TRACE));
        assert!(named.would_enable("hprm::federate_loop", &Level::TRACE));
        let rti = targets("hprm_federated::rti=debug").expect("it names events");
        assert!(!rti.would_enable("hprm_federated::federate", &Level::DEBUG));
        assert!(targets(" Debug ").is_ok_and(|it| it.would_enable("hprm", &Level::DEBUG)));
        assert!(targets("off").is_ok_and(|it| !it.would_enable("hprm", &Level::ERROR)));
    }

    #[test]
    fn the_word_that_names_none_is_told() {
        let slips = [
            ("debgu", "debgu"),
            ("3", "3"),
            ("debug,,", ""),
            (",", ""),
            ("hprm=", "hprm="),
            ("hprm=debug, federated=debug", "federated=debug"),
            ("hprm_federated::rit=debug", "hprm_federated::rit=debug"),
            ("hprm=debug=trace", "hprm=debug=trace"),
        ];
        for (text, word) in slips {
            assert_eq!(targets(text).expect_err(text), word);
        }
    }
}
