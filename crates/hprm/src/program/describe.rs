//! What an executable declares, as the JSON that `hprm-declared` reads: so that a launcher can check it together with
//! the rest of its program, which may be in another language.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use hprm_core::{
    Connection, Coordination, Delay, Direction, Effect, ModeId, Nanos, Origin, Overflow, Policy,
    PortId, Program, Properties, ReactionId, ReactorId, Restart, RestartCondition, Spin,
    StoreOptions, Transition, Trigger, WhenFull,
};
use serde_json::{Value, json};

use super::parameters::Mistake;
use super::running::end;
use crate::Failure;
use crate::describing::DESCRIBE;

/// The names and the types of the parameters that an executable takes.
pub(super) type Known = [(String, String)];

/// Writes what `program` declares, and ends this process, if it was asked for that. `parameters` are those that it takes.
///
/// # Errors
///
/// If the file cannot be written.
pub(super) fn answer(
    program: &Program,
    store: StoreOptions,
    parameters: &Known,
) -> Result<(), Failure> {
    let kind = if program.is_federated() { "federation" } else { "federate" };
    write(|| {
        let mut document = Describe::new(program).document(kind, store);
        if !parameters.is_empty() {
            document["parameters"] = json!(parameters);
        }
        document
    })
}

/// Writes what a program in one process declares, and ends this process, if it was asked for that.
///
/// # Errors
///
/// If the file cannot be written.
pub(super) fn answer_in_one(program: &Program) -> Result<(), Failure> {
    write(|| Describe::new(program).document("program", StoreOptions::default()))
}

/// Writes that the parameters do not fit with which this process was asked what it declares, and ends it, if it was asked.
///
/// # Errors
///
/// If the file cannot be written.
pub(super) fn refuse(mistake: &Mistake, parameters: &Known) -> Result<(), Failure> {
    let refused = match mistake {
        Mistake::Missing(name) => json!({"missing": name}),
        Mistake::Unknown(name) => json!({"unknown": name}),
        Mistake::Wrong(name, why) => json!({"wrong": (name, why)}),
    };
    write(|| {
        json!({
            "files": [], "main": 0, "reactors": [], "parameters": parameters, "refused": refused,
        })
    })
}

/// Makes the document only if it was asked for: a program that merely starts need not describe itself.
fn write(document: impl FnOnce() -> Value) -> Result<(), Failure> {
    let Some(file) = std::env::var_os(DESCRIBE).map(PathBuf::from) else { return Ok(()) };
    fs::write(&file, document().to_string()).map_err(|error| {
        Failure::system(format!("cannot write the declaration {}", file.display()), &error)
    })?;
    end(0)
}

/// All parts of a program have one place: executables do not tell where in their source a part is.
const AT: (usize, u32, u32, i64) = (0, 1, 0, -1);

struct Describe<'p> {
    program: &'p Program,
    /// By reactor, what is in it.
    children: BTreeMap<ReactorId, Vec<ReactorId>>,
    ports: BTreeMap<ReactorId, Vec<PortId>>,
    modes: BTreeMap<ReactorId, Vec<ModeId>>,
    reactions: BTreeMap<ReactorId, Vec<ReactionId>>,
}

impl<'p> Describe<'p> {
    fn new(program: &'p Program) -> Self {
        fn by<I>(pairs: impl Iterator<Item = (ReactorId, I)>) -> BTreeMap<ReactorId, Vec<I>> {
            let mut all = BTreeMap::<_, Vec<I>>::new();
            for (reactor, id) in pairs {
                all.entry(reactor).or_default().push(id);
            }
            all
        }
        let p = program;
        Self {
            program,
            children: by(p.reactors.iter().filter_map(|(id, it)| Some((it.parent?, id)))),
            ports: by(p.ports.iter().map(|(id, it)| (it.reactor, id))),
            modes: by(p.modes.iter().map(|(id, it)| (it.reactor, id))),
            reactions: by(p.reactions.iter().map(|(id, it)| (it.reactor, id))),
        }
    }

    /// `kind` is what this executable is.
    fn document(&self, kind: &str, store: StoreOptions) -> Value {
        let path = std::env::current_exe().unwrap_or_default();
        let reactors: Vec<_> = self.program.reactors.ids().map(|id| self.reactor(id)).collect();
        json!({
            "files": [{"path": path.display().to_string(), "text": ""}],
            "properties": properties(&self.program.properties, store),
            "main": 0,
            "reactors": reactors,
            "executable": kind,
        })
    }

    fn reactor(&self, id: ReactorId) -> Value {
        let p = self.program;
        let is_main = p.reactors[id].parent.is_none();
        let timers = p.timers.values().filter(|it| it.reactor == id).map(|it| {
            json!({"name": it.name, "at": AT, "offset": it.offset, "period": positive(it.period),
                   "mode": self.mode(it.mode)})
        });
        let actions = p.actions.values().filter(|it| it.reactor == id).map(|it| {
            let spacing = it.spacing;
            json!({"name": it.name, "at": AT, "physical": it.origin == Origin::Physical,
                   "min_delay": it.min_delay, "spacing": spacing.map(|it| it.min),
                   "policy": spacing.map(|it| policy(it.policy)), "mode": self.mode(it.mode)})
        });
        let modes = list(&self.modes, id).iter().map(|mode| {
            let mode = &p.modes[*mode];
            json!({"name": mode.name, "at": AT, "initial": mode.initial})
        });
        let connections = p.connections.values().filter(|it| self.place(it) == Some(id));
        json!({
            "name": class(&p.reactors[id].name),
            "at": AT,
            "federated": is_main && p.is_federated(),
            "ports": self.ports(id),
            "timers": timers.collect::<Vec<_>>(),
            "actions": actions.collect::<Vec<_>>(),
            "modes": modes.collect::<Vec<_>>(),
            "children": self.children(id),
            "connections": connections.map(|it| self.connection(it, id)).collect::<Vec<_>>(),
            "reactions": list(&self.reactions, id).iter().map(|it| self.reaction(*it, id)).collect::<Vec<_>>(),
        })
    }

    /// Ports, those of a multiport as one.
    fn ports(&self, reactor: ReactorId) -> Vec<Value> {
        let names =
            list(&self.ports, reactor).iter().map(|id| self.program.ports[*id].name.as_str());
        let directions =
            list(&self.ports, reactor).iter().map(|id| self.program.ports[*id].direction);
        let mut ports = Vec::new();
        let mut widths: BTreeMap<&str, usize> = BTreeMap::new();
        for (name, direction) in names.zip(directions) {
            let (base, index) = indexed(name);
            let kind = match direction {
                Direction::Input => "input",
                Direction::Output => "output",
            };
            if index.is_none() {
                ports.push(json!({"name": base, "at": AT, "kind": kind}));
            } else {
                let width = widths.entry(base).or_default();
                *width += 1;
                if *width == 1 {
                    ports.push(json!({"name": base, "at": AT, "kind": kind, "width": 1}));
                }
            }
        }
        for port in &mut ports {
            let width = port["name"].as_str().and_then(|name| widths.get(name));
            if let (Some(width), true) = (width, port.get("width").is_some()) {
                port["width"] = json!(width);
            }
        }
        ports
    }

    /// Reactors inside, those of a bank as one.
    fn children(&self, parent: ReactorId) -> Vec<Value> {
        let mut banks: BTreeMap<&str, Vec<ReactorId>> = BTreeMap::new();
        let mut order = Vec::new();
        for id in list(&self.children, parent) {
            let (base, index) = indexed(last(&self.program.reactors[*id].name));
            if index.is_some() && banks.contains_key(base) {
                banks.entry(base).or_default().push(*id);
            } else {
                banks.insert(base, vec![*id]);
                order.push((base, index.is_some()));
            }
        }
        let child = |(name, is_bank): (&str, bool)| {
            let members = &banks[name];
            let reactor = &self.program.reactors[members[0]];
            let mut child = json!({
                "name": name, "at": AT, "bank": is_bank, "mode": self.mode(reactor.mode),
                "members": members.iter().map(|id| id.index()).collect::<Vec<_>>(),
            });
            let is_federate = self.program.reactors[parent].parent.is_none();
            if let (Some(federate), true) = (reactor.federate, is_federate) {
                let federate = &self.program.federates[federate];
                child["host"] = json!(federate.host);
                child["maxwait"] = json!(limited(federate.maxwait));
                child["transient"] = json!(federate.transient);
                child["restart"] = json!(federate.restart.map(restart));
            }
            child
        };
        order.into_iter().map(child).collect()
    }

    fn connection(&self, it: &Connection, place: ReactorId) -> Value {
        let after = match it.delay {
            Delay::None => None,
            Delay::Microstep => Some(0),
            Delay::Time(nanos) => Some(nanos),
        };
        let overflow = |overflow| match overflow {
            Overflow::Drop => "drop",
            Overflow::Replace => "replace",
            Overflow::Block => "block",
        };
        json!({
            "at": AT,
            "from": [self.reference(it.from, place)],
            "to": [self.reference(it.to, place)],
            "after": after,
            "physical": it.physical,
            "bound": it.bound.map(|bound| (bound.messages, overflow(bound.overflow))),
            "mode": self.mode(it.mode),
        })
    }

    fn reaction(&self, id: ReactionId, place: ReactorId) -> Value {
        let p = self.program;
        let it = &p.reactions[id];
        let named = |name: &str| json!({"at": AT, "name": name});
        let triggers = it.triggers.iter().map(|trigger| match *trigger {
            Trigger::Startup => json!("startup"),
            Trigger::Shutdown => json!("shutdown"),
            Trigger::Reset => json!("reset"),
            Trigger::Timer(timer) => named(&p.timers[timer].name),
            Trigger::Action(action) => named(&p.actions[action].name),
            Trigger::Port(port) => self.reference(port, place),
        });
        let effects = it.effects.iter().map(|effect| match *effect {
            Effect::Port(port) => self.reference(port, place),
            Effect::Action(action) => named(&p.actions[action].name),
            Effect::Mode(mode, transition) => json!({
                "at": AT, "mode": self.mode(Some(mode)), "history": transition == Transition::History,
            }),
        });
        json!({
            "name": format!("reaction_{}", it.number),
            "at": AT,
            "triggers": triggers.collect::<Vec<_>>(),
            "sources": it.sources.iter().map(|port| self.reference(*port, place)).collect::<Vec<_>>(),
            "effects": effects.collect::<Vec<_>>(),
            "deadline": it.deadline,
            "tardy": it.handles_tardy,
            "mode": self.mode(it.mode),
        })
    }

    /// The reactor in which a connection lies.
    fn place(&self, connection: &Connection) -> Option<ReactorId> {
        let port = &self.program.ports[connection.from];
        match port.direction {
            Direction::Input => Some(port.reactor),
            Direction::Output => self.program.reactors[port.reactor].parent,
        }
    }

    /// A port as the reactor `place` names it.
    fn reference(&self, port: PortId, place: ReactorId) -> Value {
        let port = &self.program.ports[port];
        let (name, channel) = indexed(&port.name);
        let (child, member) = match port.reactor == place {
            true => (None, None),
            false => {
                let (child, member) = indexed(last(&self.program.reactors[port.reactor].name));
                (Some(child), member)
            }
        };
        json!({"at": AT, "child": child, "member": member, "name": name, "channel": channel})
    }

    /// The place of a mode among those of its reactor.
    fn mode(&self, mode: Option<ModeId>) -> Option<usize> {
        let mode = mode?;
        list(&self.modes, self.program.modes[mode].reactor).iter().position(|other| *other == mode)
    }
}

fn list<I>(by: &BTreeMap<ReactorId, Vec<I>>, reactor: ReactorId) -> &[I] {
    by.get(&reactor).map_or(&[], Vec::as_slice)
}

/// The name of a reactor within the one that contains it.
fn last(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(_, last)| last)
}

/// A name for the class of a reactor, of which there is no other instance.
fn class(name: &str) -> String {
    indexed(last(name)).0.to_owned()
}

/// A name and the index of a bank or a multiport: `out[2]`.
fn indexed(name: &str) -> (&str, Option<u32>) {
    let split = name.strip_suffix(']').and_then(|name| name.rsplit_once('['));
    let parsed = split.and_then(|(base, index)| Some((base, index.parse().ok()?)));
    parsed.map_or((name, None), |(base, index)| (base, Some(index)))
}

fn positive(nanos: Nanos) -> Option<Nanos> {
    Some(nanos).filter(|nanos| *nanos > 0)
}

fn limited(nanos: Nanos) -> Option<Nanos> {
    Some(nanos).filter(|nanos| *nanos < Nanos::MAX)
}

fn restart(restart: Restart) -> Value {
    let named = RestartCondition::NAMES.iter().find(|(_, it)| *it == restart.condition);
    json!({
        "condition": named.map(|(name, _)| *name), "sec": restart.pause, "burst": restart.burst,
        "interval": restart.interval,
    })
}

fn policy(policy: Policy) -> &'static str {
    match policy {
        Policy::Defer => "defer",
        Policy::Drop => "drop",
        Policy::Replace => "replace",
        Policy::Update => "update",
    }
}

/// The target properties that the Rust API states.
fn properties(properties: &Properties, store: StoreOptions) -> Vec<Value> {
    let mut all = Vec::new();
    let mut add =
        |name: &str, value: Value| all.push(json!({"name": name, "at": AT, "value": value}));
    if let Some(timeout) = properties.timeout {
        add("timeout", json!({"time": timeout}));
    }
    if properties.fast {
        add("fast", json!(true));
    }
    if properties.keepalive {
        add("keepalive", json!(true));
    }
    if let Some(workers) = properties.workers {
        add("workers", json!(workers));
    }
    if properties.coordination == Coordination::Decentralized {
        add("coordination", json!({"word": "decentralized"}));
    }
    if let Spin::For(time) = properties.spin {
        add("spin", json!({"time": time}));
    }
    if let Some(limit) = store.limit {
        add("store-limit", json!(limit));
    }
    if store.when_full == WhenFull::Error {
        add("store-full", json!({"word": WhenFull::Error.word()}));
    }
    all
}
