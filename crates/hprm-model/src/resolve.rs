//! Resolution of names: what the triggers, sources, effects and connections of a class refer to, and
//! whether that is allowed.

use std::collections::{BTreeMap, BTreeSet};

use crate::declaration::{self, Body, PortKind, Reference};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::model::{
    Declarations, End, Entity, Placed, ResolvedConnection, ResolvedInstance, ResolvedReaction,
    ResolvedTrigger, Role,
};
use crate::slots;
use crate::transitions;

/// The declarations of all classes in use, by class.
pub(crate) type Classes<'a> = [Option<Declarations<'a>>];

/// Without a diagnostic, the failure follows from one that has been reported.
type Resolved<T> = Result<T, Option<Box<Diagnostic>>>;

fn refuse<T>(why: Diagnostic) -> Resolved<T> {
    Err(Some(Box::new(why)))
}

/// Resolves what the reactions and connections of `declared` name.
pub(crate) fn resolve<'a>(
    declared: &Declarations<'a>,
    classes: &Classes<'a>,
    report: &mut Report,
) -> (Vec<ResolvedReaction<'a>>, Vec<ResolvedConnection<'a>>) {
    let resolver = |names_parts| Resolver { declared, classes, names_parts };
    let reaction = |placed: &Placed<'a, declaration::ReactionNode>| {
        resolver(placed.body == Some(Body::OfExecutable)).reaction(*placed, report)
    };
    let reactions = declared.reactions.iter().map(reaction).collect();
    let resolver = resolver(true);
    let connections =
        declared.connections.iter().map(|placed| resolver.connection(*placed, report)).collect();
    (reactions, connections)
}

struct Resolver<'r, 'a> {
    declared: &'r Declarations<'a>,
    classes: &'r Classes<'a>,
    /// Whether one member of a bank, or one channel, can be named.
    names_parts: bool,
}

impl<'a> Resolver<'_, 'a> {
    fn reaction(
        &self,
        placed: Placed<'a, declaration::ReactionNode>,
        report: &mut Report,
    ) -> ResolvedReaction<'a> {
        let Placed { decl, mode } = placed;
        let mut reaction = ResolvedReaction {
            decl,
            mode,
            triggers: Vec::new(),
            sources: Vec::new(),
            effects: Vec::new(),
            ends: BTreeMap::new(),
            aliases: Vec::new(),
            slots: Vec::new(),
        };
        for trigger in &decl.triggers {
            let trigger = match trigger {
                declaration::TriggerNode::Startup => ResolvedTrigger::Startup,
                declaration::TriggerNode::Shutdown => ResolvedTrigger::Shutdown,
                declaration::TriggerNode::Reset(_) => ResolvedTrigger::Reset,
                declaration::TriggerNode::Variable(reference) => {
                    let entity = self.variable(&mut reaction, reference, Role::Trigger, report);
                    let Some(entity) = entity else { continue };
                    ResolvedTrigger::Variable(entity)
                }
            };
            reaction.triggers.push(trigger);
        }
        self.sources(&mut reaction, report);
        for effect in &decl.effects {
            let effect = match effect {
                declaration::EffectNode::Variable(reference) => {
                    match transitions::bare(self.declared, reference) {
                        Some(name) => transitions::reset_assumed(self.declared, name, mode, report),
                        None => self.variable(&mut reaction, reference, Role::Effect, report),
                    }
                }
                declaration::EffectNode::Mode(transition, name) => {
                    transitions::transition(self.declared, *transition, name, mode, report)
                }
            };
            reaction.effects.extend(effect);
        }
        once_each(&mut reaction.triggers);
        once_each(&mut reaction.sources);
        once_each(&mut reaction.effects);
        reaction.slots =
            slots::slots(self.declared, |instance| self.ports_of(instance), &reaction, report);
        reaction
    }

    fn sources(&self, reaction: &mut ResolvedReaction<'a>, report: &mut Report) {
        let decl = reaction.decl;
        // In Lingua Franca, no trigger stands for all inputs.
        if decl.triggers.is_empty() && decl.body != Some(Body::OfExecutable) {
            let inputs = self.declared.ports.iter().enumerate();
            reaction.triggers = inputs
                .filter(|(_, port)| port.kind != PortKind::Output)
                .map(|(index, _)| ResolvedTrigger::Variable(Entity::Port(index)))
                .collect();
            if reaction.triggers.is_empty() {
                let message = "this reaction has no trigger, so it never runs";
                report.add(
                    Diagnostic::warning("LF0214", decl.header, message)
                        .hint(report.syntax().triggers()),
                );
            }
        }
        let triggers: BTreeSet<Entity> = reaction.variables().collect();
        for reference in &decl.sources {
            let entity = self.variable(reaction, reference, Role::Source, report);
            let Some(entity) = entity else { continue };
            if !decl.triggers.is_empty() && triggers.contains(&entity) && !self.names_parts {
                let message = format!("`{}` is already a trigger", as_written(reference));
                report.add(
                    Diagnostic::error("LF0309", reference.span, message)
                        .hint("remove it here: a trigger can be read as well"),
                );
            }
            reaction.sources.push(entity);
        }
    }

    /// What a reaction names, which is noted with its other name and, where that may be only a part of it, that part.
    fn variable(
        &self,
        reaction: &mut ResolvedReaction<'a>,
        reference: &'a Reference,
        role: Role,
        report: &mut Report,
    ) -> Option<Entity> {
        let entity = self.find(reference, role, report)?;
        reaction.aliases.extend(reference.alias.iter().map(|name| (entity, name)));
        if self.names_parts {
            let part = (reference.member, reference.channel);
            let ends = reaction.ends.entry((role, entity)).or_default();
            ends.entry(part).or_insert_with(|| End::new(entity, reference));
        }
        Some(entity)
    }

    fn connection(
        &self,
        Placed { decl, mode }: Placed<'a, declaration::ConnectionNode>,
        report: &mut Report,
    ) -> ResolvedConnection<'a> {
        let mut ends = |references: &[Reference], role| -> Vec<End> {
            let end = |reference: &Reference| {
                Some(End::new(self.find(reference, role, report)?, reference))
            };
            references.iter().filter_map(end).collect()
        };
        if let [left] = decl.left.as_slice()
            && let [right] = decl.right.as_slice()
            && self.is_backwards(left, right)
        {
            let message = "this connection is the wrong way round";
            let hint = report.syntax().connection(&as_written(right), &as_written(left));
            report.add(Diagnostic::error("LF0305", decl.span, message).hint(hint));
            return ResolvedConnection { decl, mode, left: Vec::new(), right: Vec::new() };
        }
        let left = ends(&decl.left, Role::From);
        let right = ends(&decl.right, Role::To);
        ResolvedConnection { decl, mode, left, right }
    }

    /// Whether each end of a connection is allowed only as the other end.
    fn is_backwards(&self, left: &Reference, right: &Reference) -> bool {
        let fits = |reference: &Reference, role| {
            let entity = self.entity(reference, role).ok();
            entity.map(|entity| self.check_role(reference, entity, role).is_ok())
        };
        fits(left, Role::From) == Some(false)
            && fits(right, Role::To) == Some(false)
            && fits(left, Role::To) == Some(true)
            && fits(right, Role::From) == Some(true)
    }

    fn find(&self, reference: &Reference, role: Role, report: &mut Report) -> Option<Entity> {
        if report.is_full() {
            // No more errors are kept, and the search for similar names takes long.
            return None;
        }
        let checked = self.entity(reference, role).and_then(|entity| {
            self.check_role(reference, entity, role)?;
            self.check_form(reference, entity, role)?;
            Ok(entity)
        });
        checked.map_err(|why| why.into_iter().for_each(|diagnostic| report.add(*diagnostic))).ok()
    }

    fn entity(&self, reference: &Reference, role: Role) -> Resolved<Entity> {
        match &reference.container {
            Some(container) => self.contained(container, &reference.variable, role),
            None => self.own(&reference.variable, role),
        }
    }

    fn own(&self, name: &declaration::Name, role: Role) -> Resolved<Entity> {
        if let Some(entity) = self.declared.variable(&name.text) {
            return Ok(entity);
        }
        let Declarations { ports, actions, timers, modes, .. } = self.declared;
        if self.declared.incomplete {
            return Err(None);
        }
        // Only what fits: a reactor reads its inputs, and sets its outputs.
        let fits = ports.iter().filter(|port| (port.kind == PortKind::Output) == role.writes());
        let mut names: Vec<&str> = fits.map(|port| port.name.text.as_str()).collect();
        if !matches!(role, Role::From | Role::To) {
            names.extend(actions.iter().map(|action| action.name.text.as_str()));
        }
        match role {
            Role::Trigger => {
                names.extend(timers.iter().map(|timer| timer.name.text.as_str()));
                names.extend(["startup", "shutdown"]);
            }
            Role::Effect => {
                let modes = modes.iter().filter_map(|mode| mode.name.as_ref());
                names.extend(modes.map(|mode| mode.text.as_str()));
            }
            Role::Source | Role::From | Role::To => {}
        }
        if let Some(instance) = self.declared.instance(&name.text) {
            let message = format!("the instance `{}` cannot be {}", name.text, role.name());
            let ports = self.ports_of(instance).iter();
            let fits = ports.filter(|port| (port.kind == PortKind::Output) != role.writes());
            let ports: Vec<_> =
                fits.map(|port| format!("`{}.{}`", name.text, port.name.text)).collect();
            let hint = match ports.as_slice() {
                [] => "only a port of it could, and it has none that fits".to_owned(),
                ports => format!("name one of its ports: {}", ports.join(", ")),
            };
            return refuse(Diagnostic::error("LF0303", name.span, message).hint(hint));
        }
        let hint = existing(&name.text, "names that fit here", names.iter().copied());
        let message = format!("there is no `{}` in this reactor", name.text);
        refuse(Diagnostic::error("LF0303", name.span, message).hint(hint))
    }

    fn contained(
        &self,
        container: &declaration::Name,
        port: &declaration::Name,
        role: Role,
    ) -> Resolved<Entity> {
        let instances = &self.declared.instances;
        let Some(instance) = self.declared.instance(&container.text) else {
            if self.declared.incomplete {
                return Err(None);
            }
            let message = format!("there is no instance `{}` in this reactor", container.text);
            let names = instances.iter().map(|instance| instance.decl.name.text.as_str());
            let hint = existing(&container.text, "instances", names);
            return refuse(Diagnostic::error("LF0302", container.span, message).hint(hint));
        };
        let ResolvedInstance { decl, class, .. } = instances[instance];
        let Some(inner) = &self.classes[class.0] else { return Err(None) };
        if let Some(port) = inner.port(&port.text) {
            return Ok(Entity::Contained { instance, port });
        }
        if inner.incomplete {
            return Err(None);
        }
        let ports = &inner.ports;
        let class = &decl.class;
        let message = format!("`{}` has no port `{}`", class.text, port.text);
        let fits = ports.iter().filter(|port| (port.kind == PortKind::Output) != role.writes());
        let names = fits.map(|port| port.name.text.as_str());
        let what = if role.writes() { "its inputs" } else { "its outputs" };
        let hint = existing(&port.text, what, names);
        refuse(Diagnostic::error("LF0304", port.span, message).hint(hint))
    }

    fn ports_of(&self, instance: usize) -> &[&'a declaration::PortNode] {
        let class = self.declared.instances[instance].class;
        self.classes[class.0].as_ref().map_or(&[], |declared| &declared.ports)
    }

    /// A reactor reads its inputs and its contents' outputs, and writes the others.
    fn check_role(&self, reference: &Reference, entity: Entity, role: Role) -> Resolved<()> {
        let wrong = |what: &str, hint: &str| {
            let message = format!("{what} `{}` cannot be {}", as_written(reference), role.name());
            refuse(Diagnostic::error("LF0305", reference.span, message).hint(hint))
        };
        const READ: &str = "a reactor reads its own inputs and the outputs of its instances";
        const SET: &str = "a reactor sets its own outputs and the inputs of its instances";
        let connects = matches!(role, Role::From | Role::To);
        match entity {
            Entity::Port(index) => match (self.declared.ports[index].kind, role.writes()) {
                (PortKind::Output, false) => wrong("the output", READ),
                (PortKind::Input { .. }, true) => wrong("the input", SET),
                _ => Ok(()),
            },
            Entity::Contained { instance, port } => {
                match (self.ports_of(instance)[port].kind, role.writes()) {
                    (PortKind::Input { .. }, false) => wrong("the contained input", READ),
                    (PortKind::Output, true) => wrong("the contained output", SET),
                    _ => Ok(()),
                }
            }
            Entity::Timer(_) if role != Role::Trigger => {
                wrong("the timer", "a timer can only trigger a reaction")
            }
            Entity::Action(_) if connects => wrong(
                "the action",
                "a connection joins ports; a reaction can forward the value of an action",
            ),
            Entity::Timer(_) | Entity::Action(_) | Entity::Mode(..) => Ok(()),
        }
    }

    /// Whether what a reaction names can be called `alias` in its body.
    fn check_alias(
        &self,
        alias: &declaration::Name,
        entity: Entity,
        connects: bool,
    ) -> Resolved<()> {
        let hint = match entity {
            _ if connects => "a connection has no body in which the name could be used",
            Entity::Timer(_) => "the body of a reaction does not get its timers",
            Entity::Contained { instance, .. }
                if self.declared.instances[instance].decl.width.is_some() =>
            {
                "the ports of a bank have no name of their own: write `for member in bank:`"
            }
            _ => return Ok(()),
        };
        let message = format!("`as {}` has no meaning here", alias.text);
        refuse(Diagnostic::error("LF0311", alias.span, message).hint(hint))
    }

    /// Whether one member of a bank, or one channel of a multiport, can be meant here.
    fn check_part(&self, reference: &Reference, entity: Entity) -> Resolved<()> {
        if (reference.member, reference.channel) == (None, None) {
            return Ok(());
        }
        let (bank, port) = match entity {
            Entity::Port(port) => (None, Some(self.declared.ports[port])),
            Entity::Contained { instance, port } => {
                let bank = self.declared.instances[instance].decl;
                (bank.width.as_ref(), Some(self.ports_of(instance)[port]))
            }
            Entity::Timer(_) | Entity::Action(_) | Entity::Mode(..) => (None, None),
        };
        let is_multiport = port.is_some_and(|port| port.width.is_some());
        let (message, hint) = if !self.names_parts {
            let message = "a reaction cannot name one member of a bank, or one channel";
            (message.to_owned(), "name the port: the reaction gets all of it".to_owned())
        } else if let (Some(member), None) = (reference.member, bank) {
            let name = reference.container.as_ref().map_or("", |container| &container.text);
            let hint = format!("it has no member {member}: leave out the number");
            (format!("`{name}` is no bank"), hint)
        } else if let (Some(channel), false) = (reference.channel, is_multiport) {
            let hint = format!("it has no channel {channel}: leave out the number");
            let port = Reference { channel: None, ..reference.clone() };
            (format!("`{}` is no multiport", as_written(&port)), hint)
        } else {
            return Ok(());
        };
        refuse(Diagnostic::error("LF0312", reference.span, message).hint(hint))
    }

    fn check_form(&self, reference: &Reference, entity: Entity, role: Role) -> Resolved<()> {
        let connects = matches!(role, Role::From | Role::To);
        if let Some(alias) = &reference.alias {
            self.check_alias(alias, entity, connects)?;
        }
        self.check_part(reference, entity)?;
        if !reference.interleaved {
            return Ok(());
        }
        let error = |message: &str| {
            refuse(
                Diagnostic::error("LF0310", reference.span, message)
                    .hint("`interleaved` orders the channels of `bank.multiport` in a connection"),
            )
        };
        if !connects {
            return error("`interleaved` belongs to connections");
        }
        match entity {
            Entity::Contained { instance, port }
                if self.declared.instances[instance].decl.width.is_some()
                    && self.ports_of(instance)[port].width.is_some()
                    && (reference.member, reference.channel) == (None, None) =>
            {
                Ok(())
            }
            _ => error("`interleaved` needs a bank and a multiport"),
        }
    }
}

/// What is named twice counts once.
fn once_each<T: Copy + Ord>(all: &mut Vec<T>) {
    let mut seen = BTreeSet::new();
    all.retain(|one| seen.insert(*one));
}

/// The reference as written.
fn as_written(reference: &Reference) -> String {
    let index = |number: Option<u32>| number.map_or(String::new(), |number| format!("[{number}]"));
    let port = format!("{}{}", reference.variable.text, index(reference.channel));
    match &reference.container {
        Some(container) => format!("{}{}.{port}", container.text, index(reference.member)),
        None => port,
    }
}
