//! Effects of reactions that enter modes: which mode they name, and how it is entered.

use hprm_core::Transition;

use crate::declaration::{Name, Reference};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::model::{Declarations, Entity};

/// The name, if an effect that looks like a variable is the name of a mode.
pub(crate) fn bare<'r>(declared: &Declarations<'_>, reference: &'r Reference) -> Option<&'r Name> {
    let name = &reference.variable;
    let taken = matches!(declared.variable(&name.text), Some(Entity::Port(_) | Entity::Action(_)));
    let plain = reference.container.is_none() && !reference.interleaved;
    (plain && !taken && declared.mode(&name.text).is_some()).then_some(name)
}

/// A mode as an effect that does not say how the mode is entered.
pub(crate) fn reset_assumed(
    declared: &Declarations<'_>,
    name: &Name,
    place: Option<usize>,
    report: &mut Report,
) -> Option<Entity> {
    let message =
        format!("the effect does not say how mode `{}` is entered; a reset is assumed", name.text);
    report.add(
        Diagnostic::warning("LF0908", name.span, message)
            .hint(format!("write `reset({0})` or `history({0})`", name.text)),
    );
    transition(declared, Transition::Reset, name, place, report)
}

/// The mode that a reaction in mode `place` enters.
pub(crate) fn transition(
    declared: &Declarations<'_>,
    transition: Transition,
    name: &Name,
    place: Option<usize>,
    report: &mut Report,
) -> Option<Entity> {
    let Some(index) = declared.mode(&name.text) else {
        let message = format!("this reactor has no mode `{}`", name.text);
        let names = declared.modes.iter().filter_map(|mode| mode.name.as_ref());
        let hint = existing(&name.text, "modes", names.map(|name| name.text.as_str()));
        report.add(Diagnostic::error("LF0904", name.span, message).hint(hint));
        return None;
    };
    if place.is_none() {
        let message = "only a reaction inside a mode can enter another one";
        report.add(
            Diagnostic::error("LF0903", name.span, message)
                .hint("move the reaction into the mode from which it leads away"),
        );
    }
    Some(Entity::Mode(index, transition))
}
