//! The target properties `clock-sync` and `clock-sync-options`.

use hprm_core::{ClockSyncMode, ClockSyncOptions, Nanos};

use crate::declaration::{Element, ElementKind, ExpressionKind, Property};
use crate::diagnostic::{Diagnostic, Report, did_you_mean};
use crate::property_values::word;
use crate::syntax::Syntax;

const OPTIONS: [&str; 6] =
    ["attenuation", "collect-stats", "local-federates-on", "period", "test-offset", "trials"];

/// Reads `clock-sync`.
pub(crate) fn mode(value: &Element) -> Result<ClockSyncMode, &'static str> {
    match word(value).map(str::to_ascii_lowercase).as_deref() {
        Some("off") => Ok(ClockSyncMode::Off),
        Some("init" | "initial") => Ok(ClockSyncMode::Init),
        Some("on") => Ok(ClockSyncMode::On),
        _ => Err("one of `off`, `init`, `initial`, `on`"),
    }
}

/// Reads `clock-sync-options`, written in a `syntax`. What is not stated stays as it is.
pub(crate) fn options(
    value: &Element,
    options: &mut ClockSyncOptions,
    syntax: Syntax,
    report: &mut Report,
) -> Result<(), &'static str> {
    let ElementKind::Dictionary(stated) = &value.kind else {
        return Err("`{ name: value, ... }`");
    };
    for option in stated {
        if let Err(expected) = set(option, options, report) {
            let message = format!("`{}` must be {}", option.name.text, syntax.value(expected));
            report.add(Diagnostic::error("LF0603", option.value.span, message));
        }
    }
    Ok(())
}

fn set(
    option: &Property,
    options: &mut ClockSyncOptions,
    report: &mut Report,
) -> Result<(), &'static str> {
    let (name, value) = (option.name.text.to_ascii_lowercase(), &option.value);
    match name.as_str() {
        "attenuation" => options.attenuation = count(value)?,
        "trials" => options.trials = count(value)?,
        "period" => match time(value) {
            Some(period) if period > 0 => options.period = period,
            _ => return Err("a time, such as `5 ms`"),
        },
        "test-offset" => options.test_offset = time(value).ok_or("a time, such as `200 ms`")?,
        "local-federates-on" => options.local_federates = boolean(value)?,
        "collect-stats" => {
            if boolean(value)? {
                let message = "`collect-stats` has no effect here";
                report.add(Diagnostic::warning("LF0607", option.name.span, message));
            }
        }
        _ => {
            let message = format!("`clock-sync-options` has no `{}`", option.name.text);
            let hint = did_you_mean(&name, OPTIONS);
            report.add(Diagnostic::error("LF0603", option.name.span, message).maybe_hint(hint));
        }
    }
    Ok(())
}

fn time(value: &Element) -> Option<Nanos> {
    match &value.kind {
        ElementKind::Value(expression) => match expression.kind {
            ExpressionKind::Time(nanos) => Some(nanos),
            ExpressionKind::Integer(0) => Some(0),
            _ => None,
        },
        _ => None,
    }
}

fn count(value: &Element) -> Result<u32, &'static str> {
    let number = match &value.kind {
        ElementKind::Value(expression) => match expression.kind {
            ExpressionKind::Integer(number) => u32::try_from(number).ok(),
            _ => None,
        },
        _ => None,
    };
    number.filter(|number| *number > 0).ok_or("a whole number, at least 1")
}

fn boolean(value: &Element) -> Result<bool, &'static str> {
    match &value.kind {
        ElementKind::Value(expression) => match expression.kind {
            ExpressionKind::Bool(truth) => Ok(truth),
            _ => Err("`true` or `false`"),
        },
        _ => Err("`true` or `false`"),
    }
}
