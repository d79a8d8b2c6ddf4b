//! What the tests share: a program in plain Python with its declaration, and how a graph reads as text.

#![allow(dead_code, reason = "each test file uses its share")]

use hprm_core::{Effect, Program, Trigger};
use hprm_model::{CompileFailure, Compiled, Purpose, render_all};
use serde_json::{Value, json};

/// The text of the program; places are looked for in it.
pub(crate) const TEXT: &str = r#"import hprm


class Camera(hprm.Reactor):
    image = hprm.Output()
    tick = hprm.Timer(offset=0, period="10 ms")

    @hprm.reaction(tick, effects=[image])
    def shoot(self): ...


class Detector(hprm.Reactor):
    image = hprm.Input()
    boxes = hprm.Output()

    @hprm.reaction(image, effects=[boxes], deadline="5 ms")
    def detect(self): ...


class Vision(hprm.Reactor):
    def __init__(self):
        self.cameras = [Camera() for _ in range(2)]
        self.detector = Detector()
        hprm.connect(self.cameras[1].image, self.detector.image)
        hprm.connect(self.cameras[0].image, self.detector.image)

    @hprm.reaction(detector.boxes)
    def plan(self): ...
"#;

/// Files, whose existence no test asks for.
pub(crate) fn no_files() -> impl FnMut(&str) -> Result<String, String> {
    |_: &str| Err("no such file".to_owned())
}

/// The place of the first occurrence of a word.
pub(crate) fn at(word: &str) -> Value {
    let start = TEXT.find(word).unwrap_or_else(|| panic!("the text has no {word}"));
    let before = &TEXT[..start];
    let line = before.matches('\n').count() + 1;
    let column = start - before.rfind('\n').map_or(0, |at| at + 1);
    json!([0, line, column, column + word.len()])
}

/// What is named in a declaration.
pub(crate) fn own(name: &str, word: &str) -> Value {
    json!({"at": at(word), "child": null, "member": null, "name": name, "channel": null})
}

/// A port of a child.
pub(crate) fn of(child: &str, member: Value, name: &str, word: &str) -> Value {
    json!({"at": at(word), "child": child, "member": member, "name": name, "channel": null})
}

fn camera() -> Value {
    json!({
        "name": "Camera", "at": at("class Camera"), "federated": false,
        "ports": [{"name": "image", "at": at("image"), "kind": "output", "width": null}],
        "timers": [{"name": "tick", "at": at("tick"), "offset": 0, "period": 10_000_000, "mode": null}],
        "actions": [], "modes": [], "children": [], "connections": [],
        "reactions": [{
            "name": "shoot", "at": at("def shoot"), "triggers": [own("tick", "tick, ")], "sources": [],
            "effects": [own("image", "image]")], "deadline": null, "tardy": false, "mode": null
        }],
        "facts": [["parameter rate", "100"]]
    })
}

fn detector() -> Value {
    json!({
        "name": "Detector", "at": at("class Detector"), "federated": false,
        "ports": [
            {"name": "image", "at": at("image = hprm.Input"), "kind": "input", "width": null},
            {"name": "boxes", "at": at("boxes"), "kind": "output", "width": null}
        ],
        "timers": [], "actions": [], "modes": [], "children": [], "connections": [],
        "reactions": [{
            "name": "detect", "at": at("def detect"), "triggers": [own("image", "image, effects")],
            "sources": [], "effects": [own("boxes", "boxes]")], "deadline": 5_000_000, "tardy": true,
            "mode": null
        }],
        "facts": []
    })
}

/// The whole declaration.
pub(crate) fn vision() -> Value {
    let connect = "hprm.connect(self.cameras[1].image, self.detector.image)";
    json!({
        "files": [{"path": "app.py", "text": TEXT}],
        "properties": [
            {"name": "timeout", "at": at("class Vision"), "value": {"time": 1_000_000_000}},
            {"name": "coordination", "at": at("class Vision"), "value": {"word": "decentralized"}},
            {"name": "cpus", "at": at("class Vision"), "value": {"list": [0, 1]}},
            {"name": "clock-sync-options", "at": at("class Vision"), "value":
                {"dictionary": [{"name": "period", "at": at("class Vision"), "value": {"time": 5}}]}}
        ],
        "main": 2,
        "reactors": [camera(), detector(), {
            "name": "Vision", "at": at("class Vision"), "federated": false,
            "ports": [], "timers": [], "actions": [], "modes": [],
            "children": [
                {"name": "cameras", "at": at("self.cameras"), "members": [0, 0], "bank": true,
                 "mode": null, "host": null, "maxwait": null, "transient": false},
                {"name": "detector", "at": at("self.detector"), "members": [1], "bank": false,
                 "mode": null, "host": null, "maxwait": null, "transient": false}
            ],
            "connections": [{
                "at": at(connect), "from": [of("cameras", json!(1), "image", "self.cameras[1].image")],
                "to": [of("detector", Value::Null, "image", "self.detector.image")],
                "repeated": false, "after": null, "physical": false, "serializer": null,
                "absent_after": null, "bound": null, "mode": null
            }],
            "reactions": [{
                "name": "plan", "at": at("def plan"),
                "triggers": [of("detector", Value::Null, "boxes", "detector.boxes")],
                "sources": [], "effects": [], "deadline": null, "tardy": false, "mode": null
            }],
            "facts": [["parameter rate", "10"]]
        }],
        "modules": [["module app", "import hprm"]]
    })
}

/// Compiles a declaration of ours.
pub(crate) fn compiled(document: &Value) -> Result<Compiled, CompileFailure> {
    let compiled =
        hprm_lf::compile_declared(&document.to_string(), &[], &mut no_files(), Purpose::Run);
    compiled.unwrap_or_else(|malformed| panic!("{malformed}"))
}

/// What is wrong with a declared program.
pub(crate) fn errors(document: &Value) -> String {
    match compiled(document) {
        Ok(_) => panic!("the program has no errors"),
        Err(failure) => failure.to_string(),
    }
}

/// The warnings about a program.
pub(crate) fn warnings(document: &Value) -> String {
    let compiled = compiled(document).unwrap_or_else(|failure| panic!("{failure}"));
    render_all(&compiled.warnings, &compiled.sources, false)
}

/// The graph of a program, one thing a line.
pub(crate) fn graph(compiled: &Compiled) -> String {
    let program: &Program = &compiled.program;
    let mut lines = Vec::new();
    for instance in compiled.instances.values() {
        lines.push(format!("{}: {}", instance.name, compiled.classes[instance.class].name));
    }
    for timer in program.timers.values() {
        let reactor = &program.reactors[timer.reactor].name;
        lines.push(format!("timer {reactor}.{} ({}, {})", timer.name, timer.offset, timer.period));
    }
    for connection in program.connections.values() {
        let [from, to] = [connection.from, connection.to].map(|port| program.port_name(port));
        lines.push(format!("{from} -> {to} {:?}", connection.delay));
    }
    for reaction in program.reactions.values() {
        let trigger = |trigger: &Trigger| match trigger {
            Trigger::Port(port) => program.port_name(*port),
            Trigger::Timer(timer) => program.timers[*timer].name.clone(),
            Trigger::Action(action) => program.actions[*action].name.clone(),
            other => format!("{other:?}"),
        };
        let effect = |effect: &Effect| match effect {
            Effect::Port(port) => program.port_name(*port),
            other => format!("{other:?}"),
        };
        let triggers: Vec<_> = reaction.triggers.iter().map(trigger).collect();
        let effects: Vec<_> = reaction.effects.iter().map(effect).collect();
        let reactor = &program.reactors[reaction.reactor].name;
        let number = reaction.number;
        let deadline = reaction.deadline.map_or(String::new(), |it| format!(" within {it}"));
        let tardy = if reaction.handles_tardy { " tardy" } else { "" };
        lines.push(format!("{reactor}.{number}: {triggers:?} -> {effects:?}{deadline}{tardy}"));
    }
    lines.join("\n")
}
