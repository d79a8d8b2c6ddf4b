//! What must be equal in all processes that run the program, as far as the front end knows it:
//! bodies, methods, state, parameters, preambles, and the modules that they import.
//!
//! Python counts without comments and spaces. A class that only transient federates are made of is
//! left out, as the instance graph inside of them is.

use std::collections::BTreeSet;

use hprm_core::{Fact, Fingerprint, ReactorId, show_time};

use crate::code::Code;
use crate::compiled::{Argument, Class, Compiled, ReactionBody, ReactionCode, Runs};
use crate::python::canonical;
use crate::source::FileId;
use crate::value::Value;

impl Compiled {
    /// What must be equal in all processes that run this program.
    #[must_use]
    pub fn fingerprint(&self) -> Fingerprint {
        let mut facts = self.program.general_facts();
        facts.extend(self.instance_facts());
        facts.extend(self.program.graph_facts());
        facts.extend(self.reaction_facts());
        for (index, code) in self.preambles.iter().enumerate() {
            let subject = format!("preamble {} of the program", index + 1);
            facts.push(self.code_fact(subject, &[], Some(code)));
        }
        for index in self.shared_classes() {
            facts.extend(self.class_facts(index));
        }
        facts.extend(self.modules.iter().cloned());
        Fingerprint::new(facts)
    }

    /// The classes of which not only transient federates are made, in their order.
    #[must_use]
    pub fn shared_classes(&self) -> BTreeSet<usize> {
        let lasting = self.instances.iter().filter(|(id, _)| !self.program.is_transient(*id));
        lasting.map(|(_, instance)| instance.class).collect()
    }

    fn instance_facts(&self) -> Vec<Fact> {
        let mut facts = Vec::new();
        let lasting = || self.instances.iter().filter(|(id, _)| !self.program.is_transient(*id));
        for (id, instance) in lasting() {
            let name = self.program.name_within(id);
            if id == ReactorId(0) {
                continue;
            }
            let class = self.classes[instance.class].name.clone();
            facts.push(Fact::text(format!("the class of {name}"), class));
            for (parameter, value) in &instance.assignments {
                facts.push(Fact::text(format!("parameter {parameter} of {name}"), show(value)));
            }
        }
        facts
    }

    fn reaction_facts(&self) -> Vec<Fact> {
        let mut facts = Vec::new();
        for (id, code) in self.bodies.iter() {
            let reaction = &self.program.reactions[id];
            if !self.program.is_transient(reaction.reactor) {
                let name = self.program.name_within(reaction.reactor);
                facts.extend(self.reaction_fact(name, reaction.number, code));
            }
        }
        facts
    }

    /// What the instance graph does not tell of a reaction.
    fn reaction_fact(&self, reactor: &str, number: u32, code: &ReactionCode) -> Option<Fact> {
        let (subject, names): (_, Vec<&str>) = match &code.runs {
            Runs::ResetState(state) => {
                let names = state.iter().map(|index| &*self.classes[code.class].state[*index].name);
                (format!("the state that is reset in {reactor}"), names.collect())
            }
            Runs::Reaction(_) => {
                let mutable = code.arguments.iter().filter_map(|argument| match argument {
                    Argument::Port { name, mutable: true, .. } => Some(name.as_str()),
                    _ => None,
                });
                (format!("the mutable inputs of reaction {number} of {reactor}"), mutable.collect())
            }
        };
        (!names.is_empty()).then(|| Fact::text(subject, names.join(", ")))
    }

    fn class_facts(&self, index: usize) -> Vec<Fact> {
        let class = &self.classes[index];
        let is_main = self.instances.get(ReactorId(0)).is_some_and(|main| main.class == index);
        let of = match is_main {
            true => "of the main reactor".to_owned(),
            false => format!("of reactor {}", class.name),
        };
        let mut facts = Vec::new();
        for (index, code) in class.preambles.iter().enumerate() {
            facts.push(self.code_fact(format!("preamble {} {of}", index + 1), &[], Some(code)));
        }
        for parameter in &class.parameters {
            let subject = format!("parameter {} {of}", parameter.name);
            // The user may have stated another value for one of the main reactor.
            let main = self.instances.values().next().filter(|_| is_main);
            let stated = main.iter().flat_map(|main| &main.assignments);
            let stated = stated.rev().find(|(name, _)| *name == parameter.name);
            let value = stated.map_or(&parameter.default, |(_, value)| value);
            facts.push(Fact::text(subject, show(value)));
        }
        for state in &class.state {
            let init = state.init.as_ref().map_or_else(|| "not set".to_owned(), show);
            facts.push(Fact::text(format!("state {} {of}", state.name), init));
        }
        for method in &class.methods {
            let defaults: Vec<_> = method.defaults.iter().map(show).collect();
            let signature = [method.args.join(", "), defaults.join(", ")];
            let subject = format!("method {} {of}", method.name);
            facts.push(self.code_fact(subject, &signature, method.code.as_ref()));
        }
        for (index, reaction) in class.reactions.iter().enumerate() {
            facts.extend(self.body_facts(&format!("reaction {} {of}", index + 1), reaction));
        }
        facts.push(order(class, &of));
        facts
    }

    fn body_facts(&self, reaction: &str, body: &ReactionBody) -> Vec<Fact> {
        let arguments = [body.args.join(", ")];
        let place = self.place(body.file, body.line);
        let fact = |what: &str, code: Option<&Code>| {
            self.code_fact(format!("{what} of {reaction}"), &arguments, code).at(place.clone())
        };
        let mut facts = vec![fact("the body", body.code.as_ref())];
        facts.extend(body.deadline.as_ref().map(|code| fact("the deadline handler", Some(code))));
        facts.extend(body.tardy.as_ref().map(|code| fact("the tardy handler", Some(code))));
        facts
    }

    /// Of a body that the front end has, only the signature is known.
    fn code_fact(&self, subject: String, signature: &[String], code: Option<&Code>) -> Fact {
        let text = code.map(|code| canonical(&code.text));
        let pieces = signature.iter().chain(&text).map(String::as_bytes);
        let fact = Fact::digest(subject, pieces);
        match code {
            Some(code) => fact.at(self.place(code.file, code.line)),
            None => fact,
        }
    }

    /// `Main.lf:7`. Folders may have other names on other machines.
    fn place(&self, file: FileId, line: u32) -> String {
        let path = self.sources.path(file);
        format!("{}:{line}", path.rsplit(['/', '\\']).next().unwrap_or(path))
    }
}

/// The order in which an instance gets its parameters and its state.
fn order(class: &Class, of: &str) -> Fact {
    let parameters = class.parameters.iter().map(|parameter| parameter.name.as_str());
    let state = class.state.iter().map(|state| state.name.as_str());
    Fact::order(format!("the order of the parameters and the state {of}"), parameters.chain(state))
}

/// A value as the program states it.
fn show(value: &Value) -> String {
    let all = |values: &[Value]| values.iter().map(show).collect::<Vec<_>>().join(", ");
    match value {
        Value::Int(number) => number.to_string(),
        Value::Float(number) => format!("{number:?}"),
        Value::Bool(truth) => truth.to_string(),
        Value::Str(text) => format!("{text:?}"),
        Value::Char(character) => format!("{character:?}"),
        Value::Time(time) => show_time(*time),
        Value::Parameter(name) => name.clone(),
        Value::List(values) => format!("[{}]", all(values)),
        Value::Tuple(values) => format!("({})", all(values)),
        Value::Code(code) => format!("{{={} =}}", canonical(&code.text).replace("\n1", "")),
    }
}
