//! Modes: one is initial, each has a name, and a reset must reset the state.

use std::collections::BTreeSet;

use hprm_core::Transition;

use super::Models;
use crate::declaration::ReactorKind;
use crate::diagnostic::{Diagnostic, Report};
use crate::library::ClassId;
use crate::model::{Declarations, Entity, Model, ResolvedInstance, ResolvedTrigger};

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
                .hint(report.syntax().initial_mode()),
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

/// A mode that is entered by a reset starts again, so its state must be reset too.
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
    let resets = |triggers: &[ResolvedTrigger]| triggers.contains(&ResolvedTrigger::Reset);
    model.reactions.iter().any(|reaction| reaction.mode == place && resets(&reaction.triggers))
}

/// A state variable of the instance, or of an instance inside, that a reset does not change.
fn kept_inside(
    instance: ResolvedInstance<'_>,
    models: &Models<'_>,
    seen: &mut BTreeSet<ClassId>,
) -> Option<String> {
    instance.classes().find_map(|class| kept_in_class(class, models, seen))
}

fn kept_in_class(
    class: ClassId,
    models: &Models<'_>,
    seen: &mut BTreeSet<ClassId>,
) -> Option<String> {
    // Instances at a greater depth are not checked, and no class is checked twice.
    const MAX: usize = 100;
    let new = seen.len() < MAX && seen.insert(class);
    let model = models[class.0].as_ref().filter(|_| new)?;
    let kept = |state: &&crate::model::Placed<'_, crate::declaration::StateNode>| {
        state.mode.is_none() && state.reset.is_none()
    };
    let own = model.declared.states.iter().find(kept).filter(|_| !resets_itself(model, None));
    own.map(|state| state.name.text.clone()).or_else(|| {
        let inside = model.declared.instances.iter().filter(|inside| inside.mode.is_none());
        inside.into_iter().find_map(|inside| kept_inside(*inside, models, seen))
    })
}
