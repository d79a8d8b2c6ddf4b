//! Ports, actions, timers and modes that reactions and connections name.

use hprm_core::Transition;
use hprm_model::Span;
use hprm_model::declaration::{EffectNode, Name, Reference, TriggerNode};

use crate::Malformed;
use crate::document::{self, Effect, Event, Mode, Trigger};
use crate::places::Places;

/// What is named; all of it has one place.
pub(crate) fn reference(
    named: &document::Reference,
    places: &Places,
) -> Result<Reference, Malformed> {
    let span = places.span(named.at)?;
    let container = named.child.as_ref().map(|child| Name::new(child.as_str(), span));
    Ok(Reference {
        container,
        member: named.member,
        channel: named.channel,
        ..Reference::own(Name::new(named.name.as_str(), span))
    })
}

/// All that are named, in their order.
pub(crate) fn references(
    named: &[document::Reference],
    places: &Places,
) -> Result<Vec<Reference>, Malformed> {
    named.iter().map(|named| reference(named, places)).collect()
}

/// The trigger of a reaction at `span`.
pub(crate) fn trigger(
    trigger: &Trigger,
    span: Span,
    places: &Places,
) -> Result<TriggerNode, Malformed> {
    Ok(match trigger {
        Trigger::Event(Event::Startup) => TriggerNode::Startup,
        Trigger::Event(Event::Shutdown) => TriggerNode::Shutdown,
        Trigger::Event(Event::Reset) => TriggerNode::Reset(span),
        Trigger::Variable(named) => TriggerNode::Variable(reference(named, places)?),
    })
}

/// The effect of a reaction of a reactor with these modes.
pub(crate) fn effect(
    effect: &Effect,
    modes: &[Mode],
    places: &Places,
) -> Result<EffectNode, Malformed> {
    Ok(match effect {
        Effect::Variable(named) => EffectNode::Variable(reference(named, places)?),
        Effect::Mode(entered) => {
            let Some(mode) = modes.get(entered.mode) else {
                return Err(no_mode(entered.mode));
            };
            let transition = if entered.history { Transition::History } else { Transition::Reset };
            EffectNode::Mode(transition, Name::new(mode.name.as_str(), places.span(entered.at)?))
        }
    })
}

/// The error for a mode that there is not.
pub(crate) fn no_mode(index: usize) -> Malformed {
    Malformed::new(format!("a reactor has no mode {index}"))
}
