//! The minimum spacing of actions, as it is written: `(min_delay, min_spacing, "policy")`.

use hprm_core::{Policy, Spacing};

use crate::declaration::{ActionNode, Expression, ExpressionKind};
use crate::diagnostic::{Diagnostic, Report, did_you_mean};
use crate::environment::Environment;

const POLICIES: [(&str, Policy); 4] = [
    ("defer", Policy::Defer),
    ("drop", Policy::Drop),
    ("replace", Policy::Replace),
    ("update", Policy::Update),
];

/// Reports a policy that there is not.
pub(crate) fn check(action: &ActionNode, report: &mut Report) {
    let Some(written) = &action.policy else { return };
    if named(written).is_some() {
        return;
    }
    let diagnostic = match &written.kind {
        ExpressionKind::String(name) => {
            let message = format!("there is no spacing policy `{name}`");
            let guess = did_you_mean(name, POLICIES.iter().map(|(name, _)| *name));
            Diagnostic::error("LF0408", written.span, message).hint(all()).maybe_hint(guess)
        }
        _ => Diagnostic::error("LF0408", written.span, "a spacing policy is a string").hint(all()),
    };
    report.add(diagnostic);
}

/// The spacing of an action in one instance, if it declares any.
pub(crate) fn of<'a>(
    action: &'a ActionNode,
    environment: &Environment<'a>,
    report: &mut Report,
) -> Option<Spacing> {
    let min = environment.time(action.spacing.as_ref()?, report)?;
    let policy = action.policy.as_ref().and_then(named).unwrap_or_default();
    Some(Spacing { min, policy })
}

fn named(written: &Expression) -> Option<Policy> {
    let ExpressionKind::String(text) = &written.kind else { return None };
    POLICIES.iter().find(|(name, _)| name == text).map(|(_, policy)| *policy)
}

fn all() -> String {
    "write \"defer\", \"drop\", \"replace\" or \"update\"".to_owned()
}
