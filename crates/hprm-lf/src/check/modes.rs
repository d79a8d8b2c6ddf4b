//! Modes: what may be declared in one, who may enter one, and what a reset must reset.

use std::collections::BTreeSet;

use hprm_core::Transition;

use super::Models;
use crate::ast::{Member, Name, ReactorKind, Reference};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::library::ClassId;
use crate::model::{Declarations, Entity, Instance, Model, Trigger};

/// Reports a member that cannot be in a mode.
pub(crate) fn may_contain(member: &Member, report: &mut Report) -> bool {
    let (what, span) = match member {
        Member::Preamble(body) => ("a preamble", body.inner),
        Member::Method(method) => ("a method", method.name.span),
        Member::Port(port) => ("a port", port.name.span),
        Member::Mode(mode) => ("another mode", mode.header),
        _ => return true,
    };
    let message = format!("{what} cannot be declared in a mode");
    report.add(
        Diagnostic::error("LF0909", span, message).hint("declare it in the reactor, outside modes"),
    );
    false
}

/// The name, if an effect that looks like a variable is the name of a mode.
pub(crate) fn bare<'r>(declared: &Declarations<'_>, reference: &'r Reference) -> Option<&'r Name> {
    let name = &reference.variable;
    let taken = matches!(declared.variable(&name.text), Some(Entity::Port(_) | Entity::Action(_)));
    let plain = reference.container.is_none() && !reference.interleaved;
    (plain && !taken && declared.mode(&name.text).is_some()).then_some(name)
}

/// A mode as an effect, without a word on how it is entered.
pub(crate) fn reset_assumed(
    declared: &Declarations<'_>,
    name: &Name,
    place: Option<usize>,
    report: &mut Report,
) -> Option<Entity> {
    let message = format!("it is not said how mode `{}` is entered: by a reset, then", name.text);
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

/// The state variables that are reset with each mode, and with the mode around the reactor (`None`),
/// by index.
pub(crate) fn resets(declared: &Declarations<'_>) -> Vec<(Option<usize>, Vec<usize>)> {
    let places = std::iter::once(None).chain((0..declared.modes.len()).map(Some));
    let states = |place: Option<usize>| -> Vec<usize> {
        let states = declared.states.iter().enumerate();
        let of_place = states.filter(|(_, state)| state.reset.is_some() && state.mode == place);
        of_place.map(|(index, _)| index).collect()
    };
    places.map(|place| (place, states(place))).filter(|(_, states)| !states.is_empty()).collect()
}

/// Checks the modes of a class.
pub(super) fn check(model: &Model<'_>, models: &Models<'_>, report: &mut Report) {
    let declared = &model.declared;
    initial(declared, report);
    for mode in declared.modes.iter().filter(|mode| mode.name.is_none()) {
        report.add(
            Diagnostic::error("LF0902", mode.header, "this mode has no name")
                .hint("name it: a transition needs the name"),
        );
    }
    if declared.decl.kind == ReactorKind::Federated
        && let Some(mode) = declared.modes.first()
    {
        let message = "a federated reactor cannot have modes: its federates run on their own";
        report.add(
            Diagnostic::error("LF0905", mode.header, message)
                .hint("put the modes into the reactors that are its federates"),
        );
    }
    for state in declared.states.iter().filter(|state| state.init.is_none()) {
        if let Some(span) = state.reset {
            let message = format!("`{}` cannot be reset: it has no initial value", state.name.text);
            report.add(
                Diagnostic::error("LF0906", span, message)
                    .hint(format!("write `reset state {} = ...`", state.name.text)),
            );
        }
    }
    kept_state(model, models, report);
}

fn initial(declared: &Declarations<'_>, report: &mut Report) {
    let mut initial = declared.modes.iter().filter(|mode| mode.initial);
    match (initial.next(), declared.modes.first()) {
        (None, Some(first)) => report.add(
            Diagnostic::error("LF0901", first.header, "none of the modes is the initial one")
                .hint("write `initial mode` where the reactor starts"),
        ),
        (Some(first), _) => {
            for other in initial {
                report.add(
                    Diagnostic::error("LF0901", other.header, "a reactor has one initial mode")
                        .label(first.header, "the first one"),
                );
            }
        }
        (None, None) => {}
    }
}

/// A mode that is entered by a reset starts afresh, and so must its state.
fn kept_state(model: &Model<'_>, models: &Models<'_>, report: &mut Report) {
    let declared = &model.declared;
    let entered = |mode: usize| {
        let effect = Entity::Mode(mode, Transition::Reset);
        model.reactions.iter().any(|reaction| reaction.effects.contains(&effect))
    };
    for mode in (0..declared.modes.len()).filter(|mode| entered(*mode)) {
        let place = Some(mode);
        if !resets_itself(model, place) {
            for state in declared.states.iter().filter(|s| s.mode == place && s.reset.is_none()) {
                let name = &state.name;
                let message = format!("`{}` keeps its value when its mode is reset", name.text);
                report.add(Diagnostic::error("LF0907", name.span, message).hint(format!(
                    "write `reset state {}`, or add a `reaction(reset)` to the mode",
                    name.text
                )));
            }
        }
        for instance in declared.instances.iter().filter(|instance| instance.mode == place) {
            if let Some(state) = kept_inside(*instance, models, &mut BTreeSet::new()) {
                let class = &instance.decl.class;
                let message = format!(
                    "`{state}` inside `{}` keeps its value when the mode is reset",
                    class.text
                );
                report.add(Diagnostic::warning("LF0910", class.span, message).hint(format!(
                    "write `reset state {state}` there, or add a `reaction(reset)`"
                )));
            }
        }
    }
}

fn resets_itself(model: &Model<'_>, place: Option<usize>) -> bool {
    let resets = |triggers: &[Trigger]| triggers.contains(&Trigger::Reset);
    model.reactions.iter().any(|reaction| reaction.mode == place && resets(&reaction.triggers))
}

/// A state variable of the instance, or of one inside, that a reset leaves alone.
fn kept_inside(
    instance: Instance<'_>,
    models: &Models<'_>,
    seen: &mut BTreeSet<ClassId>,
) -> Option<String> {
    // Deeper ones are not looked at, and no class twice.
    const MOST: usize = 100;
    let new = seen.len() < MOST && seen.insert(instance.class);
    let model = models[instance.class.0].as_ref().filter(|_| new)?;
    let kept = |state: &&crate::model::Placed<'_, crate::ast::State>| {
        state.mode.is_none() && state.reset.is_none()
    };
    let own = model.declared.states.iter().find(kept).filter(|_| !resets_itself(model, None));
    own.map(|state| state.name.text.clone()).or_else(|| {
        let inside = model.declared.instances.iter().filter(|inside| inside.mode.is_none());
        inside.into_iter().find_map(|inside| kept_inside(*inside, models, seen))
    })
}
