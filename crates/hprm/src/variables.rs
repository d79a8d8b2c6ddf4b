//! The environment variables that every process of a program reads: what they may say.
//!
//! Each process reads them for itself. [`check_variables`] is for a command that starts processes, so that a
//! wrong one is told once, before any of them starts.

use std::env;
use std::ffi::{OsStr, OsString};
use std::time::Duration;

use hprm_core::read_size;

use crate::link::Network;
use crate::{Failure, Pickling};

/// How many events that threads have scheduled may wait for reactions.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum EventLimit {
    /// A number of events.
    Events(usize),
    /// The bytes of their values.
    Bytes(usize),
}

impl EventLimit {
    /// The name of the environment variable.
    pub const NAME: &'static str = "HPRM_EVENT_LIMIT";

    /// The limit that the environment names, if it names one.
    ///
    /// # Errors
    ///
    /// If it names something else.
    pub fn from_environment() -> Result<Option<Self>, Failure> {
        value_of(Self::NAME).map(|text| Self::of(&text)).transpose().map_err(Failure::option)
    }

    fn of(text: &OsStr) -> Result<Self, String> {
        let read = |text: &str| match text.trim().parse() {
            Ok(events) => Some(Self::Events(events)),
            Err(_) => Some(Self::Bytes(read_size(text)?.try_into().ok()?)),
        };
        text.to_str().and_then(read).ok_or_else(|| {
            let why = "not a number of events, as in 1000, or a size with a unit, as in \"200 MB\"";
            wrong(Self::NAME, text, why)
        })
    }
}

/// After which time a reaction that has not returned is reported.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct LongReaction(pub Option<Duration>);

impl LongReaction {
    /// The name of the environment variable.
    pub const NAME: &'static str = "HPRM_LONG_REACTION";
    /// The time if the environment does not say.
    pub const DEFAULT: Self = Self(Some(Duration::from_secs(5)));

    /// What the environment says.
    ///
    /// # Errors
    ///
    /// If that is no time.
    pub fn from_environment() -> Result<Self, Failure> {
        value_of(Self::NAME)
            .map_or(Ok(Self::DEFAULT), |text| Self::of(&text))
            .map_err(Failure::option)
    }

    fn of(text: &OsStr) -> Result<Self, String> {
        if text == "off" {
            return Ok(Self(None));
        }
        let seconds = text.to_str().and_then(|text| text.parse().ok());
        let limit = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        limit.filter(|limit| !limit.is_zero()).map(|limit| Self(Some(limit))).ok_or_else(|| {
            wrong(Self::NAME, text, "not a positive number of seconds, as in 30, or off")
        })
    }
}

/// Reads the variables that every process of a program reads when it loads.
///
/// # Errors
///
/// What is wrong with the first wrong one.
pub fn check_variables() -> Result<(), Failure> {
    Pickling::of(env::var_os(Pickling::NAME).as_deref()).map_err(Failure::option)?;
    EventLimit::from_environment()?;
    LongReaction::from_environment()?;
    boards()?;
    Ok(())
}

/// The value of a variable; an empty one is as good as none.
pub(crate) fn value_of(name: &str) -> Option<OsString> {
    env::var_os(name).filter(|text| !text.is_empty())
}

/// What to say of a variable with a wrong value.
pub(crate) fn wrong(name: &str, value: &OsStr, why: &str) -> String {
    format!("the environment variable {name}={} is wrong: {why}", value.to_string_lossy())
}

/// Whether federates of one machine, under centralized coordination, find out for themselves how far they may
/// advance, which they do unless the environment forbids it. Federates that are threads of one process do not.
///
/// # Errors
///
/// If the environment says it wrongly.
pub(crate) fn may_use_boards(network: &Network) -> Result<bool, Failure> {
    Ok(boards()? && network.notifier().is_some())
}

fn boards() -> Result<bool, Failure> {
    const NAME: &str = "HPRM_BOARDS";
    let Some(text) = value_of(NAME) else { return Ok(true) };
    match text.to_str() {
        Some("on") => Ok(true),
        Some("off") => Ok(false),
        _ => Err(Failure::option(wrong(NAME, &text, "neither on nor off"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_of_events_is_a_number_or_a_size() {
        let of = |text: &str| EventLimit::of(OsStr::new(text));
        assert_eq!(of("1000"), Ok(EventLimit::Events(1000)));
        assert_eq!(of("2 MB"), Ok(EventLimit::Bytes(2_000_000)));
        for text in ["plenty", "-1", "1.5 MB"] {
            let said = of(text).unwrap_err();
            assert!(said.contains(&format!("HPRM_EVENT_LIMIT={text} is wrong: not a")), "{said}");
        }
    }

    #[test]
    fn a_long_reaction_takes_seconds_or_is_not_reported() {
        let of = |text: &str| LongReaction::of(OsStr::new(text));
        assert_eq!(of("off"), Ok(LongReaction(None)));
        assert_eq!(of("0.5"), Ok(LongReaction(Some(Duration::from_millis(500)))));
        for text in ["soon", "0", "-1", "inf", "nan"] {
            let said = of(text).unwrap_err();
            assert!(said.contains(&format!("HPRM_LONG_REACTION={text} is wrong: not a")), "{said}");
        }
    }
}
