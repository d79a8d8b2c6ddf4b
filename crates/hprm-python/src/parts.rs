//! The ports, actions and modes of a reactor as its attributes: shared by all reactions that declare them.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use hprm_core::{
    ActionId, Direction, Effect, ModeId, PortId, Program, ReactionId, ReactorId, Transition,
    Trigger,
};
use hprm_model::{Argument, Compiled};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::accepts::Accepts;
use crate::action::Action;
use crate::mode::Mode;
use crate::port::{Attribute, Port};
use crate::runtime::Runtime;
use crate::users::{Access, Users};

/// What each reaction of a program declares, by what it declares.
pub(crate) struct Parts<'a> {
    runtime: &'a Arc<Runtime>,
    ports: Declared<PortId, Access>,
    actions: Declared<ActionId, Access>,
    modes: Declared<ModeId, Transition>,
    mutable: BTreeSet<PortId>,
    /// The ports of each reactor.
    named: BTreeMap<ReactorId, Vec<NamedPort<'a>>>,
    /// The actions of each reactor.
    actions_of: BTreeMap<ReactorId, Vec<ActionId>>,
    /// The modes of each reactor.
    modes_of: BTreeMap<ReactorId, Vec<ModeId>>,
}

/// A port with all its channels.
struct NamedPort<'a> {
    name: &'a str,
    first: PortId,
    /// None if it is not a multiport.
    width: Option<u32>,
}

/// Which reactions declare something, and what they may do with it.
struct Declared<K, A>(BTreeMap<K, Vec<(ReactionId, A)>>);

impl<K: Ord, A: Copy> Declared<K, A> {
    /// Notes that a reaction declares something, unless that is known.
    fn add(&mut self, what: K, reaction: ReactionId, access: A) {
        let users = self.0.entry(what).or_default();
        if users.last().is_none_or(|(last, _)| *last != reaction) {
            users.push((reaction, access));
        }
    }

    fn users(&self, what: &K) -> Users<A> {
        let users = self.0.get(what).map(Vec::as_slice).unwrap_or_default();
        Users::Declared(users.into())
    }
}

impl<'a> Parts<'a> {
    /// Those of a program.
    pub(crate) fn of(compiled: &'a Compiled, runtime: &'a Arc<Runtime>) -> Self {
        let (ports, actions, modes) =
            (Declared(BTreeMap::new()), Declared(BTreeMap::new()), Declared(BTreeMap::new()));
        let program = &compiled.program;
        let actions_of = by_reactor(program.actions.iter().map(|(id, it)| (it.reactor, id)));
        let modes_of = by_reactor(program.modes.iter().map(|(id, it)| (it.reactor, id)));
        let (mutable, named) = (BTreeSet::new(), named(program));
        let mut parts =
            Self { runtime, ports, actions, modes, mutable, named, actions_of, modes_of };
        for id in program.reactions.ids() {
            parts.add_effects(program, id);
            parts.add_reads(program, id);
            for argument in &compiled.bodies[id].arguments {
                match argument {
                    Argument::Port { ports, mutable: true, .. } => {
                        parts.mutable.extend(ports.channels());
                    }
                    // As a trigger or as a source: the program itself does not know the latter.
                    Argument::Action { action, .. } => parts.actions.add(*action, id, Access::Read),
                    _ => {}
                }
            }
        }
        parts
    }

    /// Before what the reaction reads: it may read what it sets.
    fn add_effects(&mut self, program: &Program, id: ReactionId) {
        for effect in &program.reactions[id].effects {
            match *effect {
                Effect::Port(port) => self.ports.add(port, id, Access::Write),
                Effect::Action(action) => self.actions.add(action, id, Access::Write),
                Effect::Mode(mode, transition) => self.modes.add(mode, id, transition),
            }
        }
    }

    fn add_reads(&mut self, program: &Program, id: ReactionId) {
        let reaction = &program.reactions[id];
        for trigger in &reaction.triggers {
            match *trigger {
                Trigger::Port(port) => self.ports.add(port, id, Access::Read),
                Trigger::Action(action) => self.actions.add(action, id, Access::Read),
                Trigger::Startup | Trigger::Shutdown | Trigger::Reset | Trigger::Timer(_) => {}
            }
        }
        for port in &reaction.sources {
            let spec = &program.ports[*port];
            let is_own_input =
                spec.reactor == reaction.reactor && spec.direction == Direction::Input;
            let access = if is_own_input { Access::Remember } else { Access::Read };
            self.ports.add(*port, id, access);
        }
    }

    /// The parts of a reactor by name. Values that are set must be of the `types` that these names have there.
    ///
    /// # Errors
    ///
    /// What Python raises.
    pub(crate) fn of_reactor<'py>(
        &self,
        reactor: ReactorId,
        types: &Bound<'py, PyDict>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (py, program) = (types.py(), self.runtime.program());
        let made = PyDict::new(py);
        let accepts = |name: &str| -> PyResult<Option<Accepts>> {
            Ok(types.get_item(name)?.map(|types| Accepts::new(&types)))
        };
        for NamedPort { name, first, width } in self.named.get(&reactor).into_iter().flatten() {
            let (accepts, mutable) = (accepts(name)?, self.mutable.contains(first));
            let attribute = || {
                let accepts = accepts.as_ref().map(|accepts| accepts.clone_ref(py));
                Some(Attribute { accepts, mutable })
            };
            let users = |port| self.ports.users(&port);
            let channels = (*first, *width);
            made.set_item(name, Port::build(py, self.runtime, name, channels, users, attribute)?)?;
        }
        for id in self.actions_of.get(&reactor).into_iter().flatten() {
            let name = &program.actions[*id].name;
            let users = self.actions.users(id);
            let attribute = Action::attribute(self.runtime, *id, users, accepts(name)?);
            made.set_item(name, Bound::new(py, attribute)?)?;
        }
        for id in self.modes_of.get(&reactor).into_iter().flatten() {
            let attribute = Mode::new(self.runtime, *id, self.modes.users(id));
            made.set_item(&program.modes[*id].name, Bound::new(py, attribute)?)?;
        }
        Ok(made)
    }
}

/// What belongs to each reactor, in its order.
fn by_reactor<T>(parts: impl Iterator<Item = (ReactorId, T)>) -> BTreeMap<ReactorId, Vec<T>> {
    let mut found: BTreeMap<ReactorId, Vec<T>> = BTreeMap::new();
    for (reactor, part) in parts {
        found.entry(reactor).or_default().push(part);
    }
    found
}

/// The ports of all reactors, whose channels follow one another.
fn named(program: &Program) -> BTreeMap<ReactorId, Vec<NamedPort<'_>>> {
    let mut named: BTreeMap<ReactorId, Vec<NamedPort<'_>>> = BTreeMap::new();
    for (id, port) in program.ports.iter() {
        let of_reactor = named.entry(port.reactor).or_default();
        let (name, channel) = match port.name.split_once('[') {
            Some((name, channel)) => (name, Some(channel)),
            None => (port.name.as_str(), None),
        };
        match of_reactor.last_mut() {
            Some(NamedPort { name: before, width: Some(width), .. })
                if *before == name && channel.is_some() =>
            {
                *width += 1;
            }
            _ => {
                let width = channel.map(|_| 1);
                of_reactor.push(NamedPort { name, first: id, width });
            }
        }
    }
    named
}
