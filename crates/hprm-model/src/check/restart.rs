//! The attribute that has a federate started again: what it may say, and what that means.
//!
//! Its words are systemd's: a condition (`Restart=`), `sec` (`RestartSec=`), `burst` (`StartLimitBurst=`) and
//! `interval` (`StartLimitIntervalSec=`). The launcher obeys it.

use hprm_core::{Nanos, Restart, RestartCondition};

use super::attributes::{Wrong, find, is_there, value_of};
use crate::declaration::{Attribute, Expression, ExpressionKind};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::syntax::Syntax;

/// The name of the attribute.
pub(super) const ATTRIBUTE: &str = "restart";

/// The names of its arguments, in their order.
pub(super) const ARGUMENTS: [&str; 4] = ["condition", "sec", "burst", "interval"];

/// The condition that nothing fulfils.
const NEVER: &str = "no";

/// Reports what is wrong with its arguments.
pub(super) fn check(attribute: &Attribute, report: &mut Report) {
    if let Err(Wrong { message, hint }) = read(attribute, report.syntax()) {
        report.add(Diagnostic::error("LF0212", attribute.span, message).hint(hint));
    }
}

/// Reports that a federate without which the others do not go on is to be started again.
pub(super) fn needs_transient(attributes: &[Attribute], report: &mut Report) {
    let Some(attribute) = find(attributes, ATTRIBUTE) else { return };
    let never =
        value_of(attribute, "condition").is_some_and(|it| text(it).is_some_and(|it| it == NEVER));
    if never || is_there(attributes, "transient") {
        return;
    }
    let name = report.syntax().option(ATTRIBUTE);
    let message = format!("{name} belongs to a transient federate, and this one is not");
    report.add(
        Diagnostic::error("LF0212", attribute.span, message).hint(report.syntax().transient()),
    );
}

/// When a federate with these attributes is started again, if it is and they are right.
pub(crate) fn of(attributes: &[Attribute]) -> Option<Restart> {
    read(find(attributes, ATTRIBUTE)?, Syntax::default()).ok().flatten()
}

fn text(value: &Expression) -> Option<&str> {
    match &value.kind {
        ExpressionKind::String(text) => Some(text),
        _ => None,
    }
}

/// What the attribute says; none, if nothing is to be done.
fn read(attribute: &Attribute, syntax: Syntax) -> Result<Option<Restart>, Wrong> {
    let name = syntax.option(ATTRIBUTE);
    let wrong = |message: String| Wrong { message, hint: syntax.restart().to_owned() };
    if attribute.arguments.len() > ARGUMENTS.len() {
        return Err(wrong(format!("{name} takes a condition, a pause and a limit")));
    }
    let condition = condition(attribute, syntax)?;
    let mut restart = Restart::new(condition.unwrap_or_default());
    let ends = |nanos: &Nanos| *nanos < Nanos::MAX;
    if let Some(value) = value_of(attribute, "sec") {
        restart.pause = time(value).filter(ends).ok_or_else(|| {
            wrong(format!("the pause of {name}, `sec`, must be a time that is not negative"))
        })?;
    }
    if let Some(value) = value_of(attribute, "interval") {
        restart.interval = time(value).ok_or_else(|| {
            wrong(format!("the `interval` of {name} must be a time that is not negative"))
        })?;
    }
    if let Some(value) = value_of(attribute, "burst") {
        let number = match &value.kind {
            ExpressionKind::Integer(number) => u32::try_from(*number).ok(),
            _ => None,
        };
        restart.burst = number.filter(|number| *number > 0).ok_or_else(|| {
            wrong(format!("the `burst` of {name} must be a number from 1 to {}", u32::MAX))
        })?;
    }
    Ok(condition.map(|_| restart))
}

/// After which ends; none, if after none.
fn condition(attribute: &Attribute, syntax: Syntax) -> Result<Option<RestartCondition>, Wrong> {
    let name = syntax.option(ATTRIBUTE);
    let Some(stated) = value_of(attribute, "condition").and_then(text) else {
        let message = format!("{name} needs a condition, in double quotes");
        return Err(Wrong { message, hint: syntax.restart().to_owned() });
    };
    if stated == NEVER {
        return Ok(None);
    }
    let found = RestartCondition::NAMES.iter().find(|(name, _)| *name == stated);
    let Some((_, condition)) = found else {
        let message = format!("{name} has no condition `{stated}`");
        let names = RestartCondition::NAMES.iter().map(|(name, _)| *name);
        let hint = existing(stated, "its conditions", names.chain([NEVER]));
        return Err(Wrong { message, hint });
    };
    Ok(Some(*condition))
}

/// A time that is written down and not negative.
fn time(value: &Expression) -> Option<Nanos> {
    match value.kind {
        ExpressionKind::Time(nanos) if nanos >= 0 => Some(nanos),
        ExpressionKind::Integer(0) => Some(0),
        _ => None,
    }
}
