//! What federates compare beyond what the model knows: parameters of instances, and code.

use hprm_core::{Fact, ReactorId};
use hprm_model::Compiled;

use crate::document::Document;

/// The facts of all instances but those in transient federates, and those about code.
pub(crate) fn facts(document: &Document, compiled: &Compiled) -> Vec<Fact> {
    let program = &compiled.program;
    let mut facts = Vec::new();
    // The instances are in this order, and not more than the model allows.
    let mut instances = program.reactors.ids();
    let mut pending = vec![document.main];
    while let Some(index) = pending.pop() {
        let reactor = &document.reactors[index];
        let known = |instance: &ReactorId| !is_inside_executable(compiled, *instance);
        let Some(instance) = instances.find(known) else { break };
        if !program.is_transient(instance) {
            let name = program.name_within(instance);
            let fact = |(what, text): &(String, String)| {
                Fact::text(format!("{what} of {name}"), text.clone())
            };
            facts.extend(reactor.facts.iter().map(fact));
        }
        let inside = reactor.children.iter().flat_map(|child| &child.members);
        pending.extend(inside.rev().copied());
    }
    let module = |(subject, text): &(String, String)| {
        Fact::digest(subject.clone(), [text.as_bytes()]).if_present()
    };
    facts.extend(document.modules.iter().map(module));
    facts
}

/// Whether an executable has declared an instance, and not the document.
fn is_inside_executable(compiled: &Compiled, instance: ReactorId) -> bool {
    let federate = compiled.program.reactors[instance].federate;
    let is_root = |federate| compiled.program.federates[federate].reactor == instance;
    federate.is_some_and(|it| compiled.executables.contains_key(&it) && !is_root(it))
}
