//! Reactors that are executables: what they declare becomes part of the program, and is checked with it.

use std::collections::BTreeMap;

use crate::common::connections;
use hprm_core::{Effect, PortId, Trigger};
use hprm_declared::Described;
use hprm_lf::{SourceLoader, compile, compile_declared, compile_with};
use hprm_model::{CompileFailure, Compiled, Executable, Given, Purpose};
use insta::assert_snapshot;
use serde_json::{Value, json};

/// Files, and what executables declare; all that they were asked.
#[derive(Default)]
struct World {
    files: BTreeMap<&'static str, String>,
    declared: BTreeMap<&'static str, Value>,
    asked: Vec<Vec<String>>,
    /// The parameters with which they were asked, each time.
    given: Vec<Vec<(String, Given)>>,
    /// What they declare instead, each time.
    answers: Vec<Value>,
}

impl SourceLoader for World {
    fn load(&mut self, path: &str) -> Result<String, String> {
        self.files.get(path).cloned().ok_or_else(|| "no such file".to_owned())
    }

    fn describe(&mut self, executable: &Executable) -> Result<Described, String> {
        let Executable { command, file, .. } = executable;
        self.asked.push(command.clone());
        let path = command[0].as_str();
        let given = executable.parameters.iter().map(|it| (it.name.clone(), it.value.clone()));
        self.given.push(given.collect());
        let declared = self.declared.get(path).ok_or(format!("there is no executable {path}"))?;
        let mut declared = declared.clone();
        if !self.answers.is_empty() {
            declared["reactors"] = self.answers.remove(0);
            fill(&mut declared["reactors"], &json!([0, 1, 0, -1]));
        }
        let folder = file.rsplit_once('/').map_or("", |(folder, _)| folder);
        let mut started = vec![format!("/{folder}/{path}").replace("//", "/")];
        started.extend(command[1..].iter().cloned());
        Ok(Described { command: started, text: declared.to_string() })
    }
}

impl World {
    fn new(main: &str) -> Self {
        let files = BTreeMap::from([("Main.lf", format!("target Python\n{main}"))]);
        Self { files, ..Self::default() }
    }

    fn file(mut self, path: &'static str, text: &str) -> Self {
        self.files.insert(path, format!("target Python\n{text}"));
        self
    }

    fn executable(mut self, path: &'static str, reactors: Value) -> Self {
        let at = [0, 1, 0, -1];
        let files = json!([{"path": format!("/{path}"), "text": ""}]);
        let mut document = json!({"files": files, "main": 0, "reactors": reactors});
        for reactor in document["reactors"].as_array_mut().unwrap() {
            fill(reactor, &json!(at));
        }
        self.declared.insert(path, document);
        self
    }

    /// States the parameters of an executable.
    fn takes(&mut self, path: &str, names: &[&str]) {
        let names: Vec<_> = names.iter().map(|name| (*name, "u32")).collect();
        self.declared.get_mut(path).unwrap()["parameters"] = json!(names);
    }

    fn compiled(&mut self) -> Result<Compiled, CompileFailure> {
        compile("Main.lf", self)
    }

    fn errors(mut self) -> String {
        self.compiled().map(drop).unwrap_err().to_string()
    }
}

/// Gives everything that is a part of a program a place.
fn fill(value: &mut Value, at: &Value) {
    match value {
        Value::Object(object) => {
            object.values_mut().for_each(|inner| fill(inner, at));
            object.entry("at").or_insert_with(|| at.clone());
        }
        Value::Array(array) => array.iter_mut().for_each(|inner| fill(inner, at)),
        _ => {}
    }
}

/// A camera with a reactor inside.
fn camera() -> Value {
    json!([
        {
            "name": "Camera",
            "ports": [{"name": "image", "kind": "output"}, {"name": "rate", "kind": "input"}],
            "timers": [{"name": "tick", "period": 10_000_000}],
            "children": [{"name": "lens", "members": [1]}],
            "reactions": [
                {"name": "reaction_1", "triggers": [{"name": "tick"}], "effects": [{"name": "image"}]},
                {"name": "reaction_2", "triggers": [{"name": "rate"}],
                 "effects": [{"child": "lens", "name": "focus"}], "deadline": 1_000},
            ],
        },
        {
            "name": "Lens",
            "ports": [{"name": "focus", "kind": "input"}],
            "reactions": [{"name": "reaction_1", "triggers": [{"name": "focus"}]}],
        },
    ])
}

const VISION: &str = r#"
    @executable("bin/camera", "--fast")
    reactor Camera { input rate; output image }
    reactor Detector {
        input image
        output rate
        reaction(startup) -> rate {= rate.set(1) =}
        reaction(image) {= pass =}
    }
    federated reactor {
        camera = new Camera()
        detector = new Detector()
        camera.image -> detector.image
        detector.rate -> camera.rate
    }
"#;

#[test]
fn what_an_executable_declares_is_part_of_the_program() {
    let mut world = World::new(VISION).executable("bin/camera", camera());
    let compiled = world.compiled().unwrap();
    let program = &compiled.program;
    let names: Vec<_> = program.reactors.values().map(|reactor| reactor.name.as_str()).collect();
    assert_eq!(names, ["Main", "Main.camera", "Main.camera.lens", "Main.detector"]);
    assert_eq!(
        connections(&compiled),
        ["camera.image -> detector.image", "detector.rate -> camera.rate"]
    );
    let camera = program.federate_named("camera").unwrap();
    let known: Vec<_> = compiled.executables.keys().copied().collect();
    assert_eq!(known, [camera]);
    assert_eq!(compiled.executables[&camera].command, ["/bin/camera", "--fast"]);
    assert_eq!(world.asked, [["bin/camera", "--fast"]]);
    let timer = program.timers.values().next().unwrap();
    assert_eq!((timer.name.as_str(), timer.period), ("tick", 10_000_000));
    assert!(compiled.warnings.is_empty(), "{:?}", compiled.warnings);
}

/// The ports that each reaction of a federate names, by their full names, sorted.
fn named_ports(compiled: &Compiled) -> Vec<String> {
    let program = &compiled.program;
    let names = |ports: Vec<PortId>| {
        let mut names: Vec<_> = ports.into_iter().map(|port| program.port_name(port)).collect();
        names.sort_unstable();
        names.join(" ")
    };
    let reactions = program.reactions.values().map(|reaction| {
        let triggers = reaction.triggers.iter().filter_map(|trigger| match trigger {
            Trigger::Port(port) => Some(*port),
            _ => None,
        });
        let effects = reaction.effects.iter().filter_map(|effect| match effect {
            Effect::Port(port) => Some(*port),
            _ => None,
        });
        let sources = reaction.sources.to_vec();
        format!(
            "[{}] [{}] [{}]",
            names(triggers.collect()),
            names(sources),
            names(effects.collect())
        )
    });
    reactions.collect()
}

#[test]
fn reactions_of_executables_name_single_channels_and_members() {
    let mixer = json!([
        {
            "name": "Mixer",
            "ports": [{"name": "inp", "kind": "input", "width": 3}, {"name": "out", "kind": "output", "width": 2}],
            "children": [{"name": "part", "members": [1, 1], "bank": true}],
            "reactions": [
                {"name": "reaction_1", "triggers": [{"name": "inp", "channel": 2}],
                 "sources": [{"name": "inp", "channel": 0}, {"child": "part", "member": 1, "name": "y"}],
                 "effects": [{"name": "out", "channel": 1}, {"child": "part", "member": 0, "name": "x"}]},
                {"name": "reaction_2", "triggers": [{"name": "inp"}], "effects": [{"name": "out"}]},
                {"name": "reaction_3", "sources": [{"name": "inp", "channel": 1}]},
            ],
        },
        {"name": "Part", "ports": [{"name": "x", "kind": "input"}, {"name": "y", "kind": "output"}]},
    ]);
    let main = r#"
        @executable("bin/mixer")
        reactor Mixer { input[3] inp; output[2] out }
        reactor Source { output[3] out; reaction(startup) -> out {= out[0].set(1) =} }
        federated reactor {
            source = new Source()
            mixer = new Mixer()
            source.out -> mixer.inp
        }
    "#;
    let mut world = World::new(main).executable("bin/mixer", mixer);
    // One that says nothing of itself is as a program in Python, whose bodies get all channels.
    let refused = world.compiled().unwrap_err().to_string();
    assert!(
        refused.contains("error[LF0312]: a reaction cannot name one member of a bank"),
        "{refused}"
    );
    world.declared.get_mut("bin/mixer").unwrap()["executable"] = json!("federate");
    assert_snapshot!(named_ports(&world.compiled().unwrap())[1..].join("\n"), @"
    [Main.mixer.inp[2]] [Main.mixer.inp[0] Main.mixer.part[1].y] [Main.mixer.out[1] Main.mixer.part[0].x]
    [Main.mixer.inp[0] Main.mixer.inp[1] Main.mixer.inp[2]] [] [Main.mixer.out[0] Main.mixer.out[1]]
    [] [Main.mixer.inp[1]] []
    ");
    let reactions = &mut world.declared.get_mut("bin/mixer").unwrap()["reactors"][0]["reactions"];
    reactions[0]["effects"][0]["channel"] = json!(7);
    assert_snapshot!(world.errors(), @"
    error[LF0312]: there is no channel 7 here
     --> /bin/mixer:1:1
      |
    1 |
      | ^
      |
      = help: there are 2 channels, from 0 to 1
    ");
}

#[test]
fn an_executable_that_declares_something_else_is_another_program() {
    let facts = |period: i64| {
        let mut declared = camera();
        declared[0]["timers"][0]["period"] = json!(period);
        let mut world = World::new(VISION).executable("bin/camera", declared);
        world.compiled().unwrap().fingerprint().report()
    };
    assert_eq!(facts(10_000_000), facts(10_000_000));
    assert_ne!(facts(10_000_000), facts(20_000_000));
}

#[test]
fn each_executable_is_asked_once_for_all_its_instances() {
    let text = VISION.replace("camera = new Camera()", "camera = new[3] Camera()");
    let text = text
        .replace("input image", "input[3] image")
        .replace("detector.rate ->", "(detector.rate)+ ->");
    let mut world = World::new(&text).executable("bin/camera", camera());
    let compiled = world.compiled().unwrap();
    assert_eq!(compiled.executables.len(), 3);
    assert_eq!(world.asked.len(), 1);
}

#[test]
fn the_path_is_relative_to_the_file_that_states_it_and_what_is_not_needed_is_not_asked() {
    let library = r#"
        @executable("camera") reactor Camera { input rate; output image }
        @executable("missing") reactor Other { output image }
    "#;
    let (_, rest) = VISION.split_once("reactor Detector").unwrap();
    let main = format!("import Camera from \"lib/Camera.lf\"\nreactor Detector{rest}");
    let mut world = World::new(&main).file("lib/Camera.lf", library).executable("camera", camera());
    let compiled = world.compiled().unwrap();
    let command = &compiled.executables.values().next().unwrap().command;
    assert_eq!(*command, ["/lib/camera"]);
    assert_eq!(world.asked, [["camera"]]);
}

#[test]
fn ports_that_differ_are_errors_that_name_both_ends() {
    let mut declared = camera();
    declared[0]["ports"] = json!([
        {"name": "image", "kind": "output", "width": 3},
        {"name": "rate", "kind": "output"},
        {"name": "depth", "kind": "output"},
    ]);
    declared[0]["timers"] = json!([]);
    declared[0]["reactions"] = json!([]);
    let text = VISION.replace("output image }", "output image; input gain }");
    assert_snapshot!(World::new(&text).executable("bin/camera", declared).errors(), @r#"
    error[LF1103]: the executable /bin/camera declares output `depth`, and Camera in Main.lf:4 has no such port
     --> Main.lf:4:5
      |
    4 |     reactor Camera { input rate; output image; input gain }
      |     ^^^^^^^^^^^^^^
      |
      = help: the ports of both must have the same names, directions and widths

    error[LF1103]: the executable /bin/camera declares output `rate`, and Camera in Main.lf:4 has input `rate`
     --> Main.lf:4:28
      |
    4 |     reactor Camera { input rate; output image; input gain }
      |                            ^^^^
      |
      = help: the ports of both must have the same names, directions and widths

    error[LF1103]: the executable /bin/camera declares output `image[3]`, and Camera in Main.lf:4 has output `image`
     --> Main.lf:4:41
      |
    4 |     reactor Camera { input rate; output image; input gain }
      |                                         ^^^^^
      |
      = help: the ports of both must have the same names, directions and widths

    error[LF1103]: the executable /bin/camera declares no port `gain`, and Camera in Main.lf:4 has input `gain`
     --> Main.lf:4:54
      |
    4 |     reactor Camera { input rate; output image; input gain }
      |                                                      ^^^^
      |
      = help: the ports of both must have the same names, directions and widths
    "#);
}

#[test]
fn an_executable_has_ports_only() {
    let text = r#"
        @executable("a")
        reactor A extends B {
            output out
            timer tick
            state count = 0
            reaction(tick) -> out {= out.set(1) =}
        }
        reactor B { }
        main reactor { }
    "#;
    assert_snapshot!(World::new(text).errors(), @r#"
    error[LF1101]: an executable extends no reactor
     --> Main.lf:4:27
      |
    4 |         reactor A extends B {
      |                           ^
      |
      = help: the program states its ports and parameters, and the executable declares the rest

    error[LF1101]: a timer cannot be declared here: the reactor is an executable
     --> Main.lf:6:19
      |
    6 |             timer tick
      |                   ^^^^
      |
      = help: the program states its ports and parameters, and the executable declares the rest

    error[LF1101]: a state variable cannot be declared here: the reactor is an executable
     --> Main.lf:7:19
      |
    7 |             state count = 0
      |                   ^^^^^
      |
      = help: the program states its ports and parameters, and the executable declares the rest

    error[LF1101]: a reaction cannot be declared here: the reactor is an executable
     --> Main.lf:8:13
      |
    8 |             reaction(tick) -> out {= out.set(1) =}
      |             ^^^^^^^^^^^^^^^^^^^^^
      |
      = help: the program states its ports and parameters, and the executable declares the rest
    "#);
}

#[test]
fn an_executable_is_no_main_reactor_and_nothing_extends_it() {
    let text = r#"
        @executable("c") reactor C { output out }
        reactor D extends C { }
        @executable main reactor { c = new C() }
        @executable(3) reactor E { output out }
    "#;
    assert_snapshot!(World::new(text).errors(), @r#"
    error[LF1101]: `C` is an executable: nothing extends it
     --> Main.lf:4:27
      |
    4 |         reactor D extends C { }
      |                           ^

    error[LF0212]: `@executable` takes the path of a file, and perhaps arguments: texts
     --> Main.lf:5:9
      |
    5 |         @executable main reactor { c = new C() }
      |         ^^^^^^^^^^^
      |
      = help: write `@executable("path")`, or `@executable("path", "argument")`

    error[LF1101]: the main reactor of a program is no executable
     --> Main.lf:5:21
      |
    5 |         @executable main reactor { c = new C() }
      |                     ^^^^^^^^^^^^
      |
      = help: the program states its ports and parameters, and the executable declares the rest

    error[LF1101]: a contained reactor cannot be declared here: the reactor is an executable
     --> Main.lf:5:36
      |
    5 |         @executable main reactor { c = new C() }
      |                                    ^
      |
      = help: the program states its ports and parameters, and the executable declares the rest

    error[LF0212]: `@executable` takes the path of a file, and perhaps arguments: texts
     --> Main.lf:6:9
      |
    6 |         @executable(3) reactor E { output out }
      |         ^^^^^^^^^^^^^^
      |
      = help: write `@executable("path")`, or `@executable("path", "argument")`

    error[LF0212]: `@executable` takes the path of a file, and perhaps arguments: texts
     --> Main.lf:6:21
      |
    6 |         @executable(3) reactor E { output out }
      |                     ^
      |
      = help: write `@executable("path")`, or `@executable("path", "argument")`
    "#);
}

#[test]
fn an_executable_is_a_federate() {
    let text = r#"
        @executable("c") reactor C { output out }
        reactor D { @executable("x") c = new C() }
        federated reactor { d = new D() }
    "#;
    let declared = json!([{"name": "C", "ports": [{"name": "out", "kind": "output"}]}]);
    assert_snapshot!(World::new(text).executable("c", declared).errors(), @r#"
    error[LF0212]: `@executable` does not belong here
     --> Main.lf:4:21
      |
    4 |         reactor D { @executable("x") c = new C() }
      |                     ^^^^^^^^^^^^^^^^
      |
      = help: it belongs to a reactor, which states its ports only

    error[LF1104]: `C` is an executable, and here it would be no federate
     --> Main.lf:4:38
      |
    4 |         reactor D { @executable("x") c = new C() }
      |                                      ^
      |
      = help: instantiate it in a `federated reactor`: an executable is a process of its own
    "#);
}

#[test]
fn what_is_no_declaration_of_a_reactor_is_an_error_at_the_attribute() {
    assert_snapshot!(World::new(VISION).errors(), @r#"
    error[LF1102]: there is no executable bin/camera
     --> Main.lf:3:5
      |
    3 |     @executable("bin/camera", "--fast")
      |     ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    "#);
    let mut world = World::new(VISION);
    world.declared.insert("bin/camera", json!({"version": 7}));
    assert_snapshot!(world.errors(), @r#"
    error[LF1102]: the declaration of the executable /bin/camera cannot be read: unknown field `version`, expected one of `files`, `properties`, `main`, `reactors`, `modules`, `parameters`, `executable`, `refused` at line 1 column 10
     --> Main.lf:3:5
      |
    3 |     @executable("bin/camera", "--fast")
      |     ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      |
      = help: it and this command may be of different versions of HPRM
    "#);
    let mut declared = camera();
    declared[0]["federated"] = json!(true);
    assert_snapshot!(World::new(VISION).executable("bin/camera", declared).errors(), @r#"
    error[LF1102]: the executable /bin/camera declares a federation of its own
     --> Main.lf:3:5
      |
    3 |     @executable("bin/camera", "--fast")
      |     ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      |
      = help: a federate is one reactor: in Rust, what `run_as_federate` is given
    "#);
    let mut declared = camera();
    declared[1]["executable"] = json!(["other"]);
    assert_snapshot!(World::new(VISION).executable("bin/camera", declared).errors(), @r#"
    error[LF1102]: the executable /bin/camera declares a reactor that is another executable
     --> Main.lf:3:5
      |
    3 |     @executable("bin/camera", "--fast")
      |     ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      |
      = help: a federate is one reactor: in Rust, what `run_as_federate` is given
    "#);
    let mut declared = camera();
    declared[0]["children"][0]["members"] = json!([9]);
    assert_snapshot!(World::new(VISION).executable("bin/camera", declared).errors(), @r#"
    error[LF1102]: the declaration of the executable /bin/camera cannot be read: it has no reactor 9
     --> Main.lf:3:5
      |
    3 |     @executable("bin/camera", "--fast")
      |     ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      |
      = help: it and this command may be of different versions of HPRM
    "#);
}

#[test]
fn a_cycle_through_an_executable_is_found_with_names() {
    let mut declared = camera();
    declared[0]["reactions"] = json!([{"name": "reaction_1", "triggers": [{"name": "rate"}], "effects": [{"name": "image"}]}]);
    let text = VISION.replace("reaction(startup) -> rate {= rate.set(1) =}", "");
    let text =
        text.replace("reaction(image) {= pass =}", "reaction(image) -> rate {= rate.set(1) =}");
    assert_snapshot!(World::new(&text).executable("bin/camera", declared).errors(), @r#"
    error[LF0503]: reactions wait for one another in a cycle: Main.camera.1 -> Main.detector.1
     --> /bin/camera:1:1
      |
    1 |
      | ^
      |
     ::: Main.lf:9:9
      |
    9 |         reaction(image) -> rate {= rate.set(1) =}
      |         ----------------------- this reaction is in the cycle
      |
      = help: give one of the connections a delay, such as `after 0`, or reorder the reactions
    "#);
}

/// A federation in Python whose first federate is an executable.
fn python() -> Value {
    let at = [0, 1, 0, -1];
    let end = |child: &str, name: &str| json!({"child": child, "name": name});
    let mut document = json!({
        "files": [{"path": "src/app.py", "text": "import hprm\nclass Camera: ...\nclass Vision: ...\n"}],
        "main": 2,
        "reactors": [
            {"name": "Camera", "at": [0, 2, 6, 12], "executable": ["camera"], "ports": [
                {"name": "image", "kind": "output"}, {"name": "rate", "kind": "input"}]},
            {"name": "Detector", "ports": [{"name": "image", "kind": "input"}],
             "reactions": [{"name": "detect", "triggers": [{"name": "image"}]}],
             "facts": [["parameter size", "3"]]},
            {"name": "Vision", "federated": true,
             "children": [{"name": "camera", "members": [0]}, {"name": "detector", "members": [1]}],
             "connections": [{"from": [end("camera", "image")], "to": [end("detector", "image")]}]},
        ],
    });
    for reactor in document["reactors"].as_array_mut().unwrap() {
        fill(reactor, &json!(at));
    }
    document
}

#[test]
fn programs_in_python_name_executables_too() {
    let mut world = World::default().executable("camera", camera());
    let compile = |document: &Value, world: &mut World| {
        compile_declared(&document.to_string(), &[], world, Purpose::Run).unwrap()
    };
    let compiled = compile(&python(), &mut world).unwrap();
    assert_eq!(compiled.executables.values().next().unwrap().command, ["/src/camera"]);
    // What federates compare of each instance is of the one that it is stated for.
    let subjects: Vec<_> = compiled.modules.iter().map(|fact| fact.subject.as_str()).collect();
    assert_eq!(subjects, ["parameter size of detector"]);
    let mut given = python();
    given["reactors"][0]["parameters"] = json!([["rate", 20], ["size", {"float": "0.5"}]]);
    assert_snapshot!(compile(&given, &mut world).unwrap_err(), @r#"
    error[LF1105]: the executable /src/camera has no parameter `rate`, and Camera in src/app.py:2 has one
     --> src/app.py:2:7
      |
    2 | class Camera: ...
      |       ^^^^^^
      |
      = help: its parameters: there are none
    "#);
    world.takes("camera", &["rate", "size"]);
    let compiled = compile(&given, &mut world).unwrap();
    let executable = compiled.executables.values().next().unwrap();
    let names: Vec<_> = executable.parameters.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["rate", "size"]);
    assert_eq!(world.given.last().unwrap()[0].1, Given::Integer(20));
    let mut wrong = python();
    wrong["reactors"][0]["ports"][0]["width"] = json!(2);
    assert_snapshot!(compile(&wrong, &mut world).unwrap_err(), @r#"
    error[LF1103]: the executable /src/camera declares output `image`, and Camera in src/app.py:2 has output `image[2]`
     --> src/app.py:1:1
      |
    1 | import hprm
      | ^^^^^^^^^^^
      |
      = help: the ports of both must have the same names, directions and widths
    "#);
}

/// A camera with parameters: it has a timer with this period.
fn paced(period: i64) -> Value {
    let mut declared = camera();
    declared[0]["timers"][0]["period"] = json!(period);
    declared
}

#[test]
fn an_executable_is_asked_with_the_values_of_its_parameters() {
    let text = r#"
        @executable("bin/camera")
        reactor Camera(rate = 10, name = "front", times = [1 ms, 0], bank_index = 0) { input rate_in; output image }
        federated reactor(pace = 0.5, label = "left") {
            a = new Camera()
            b = new Camera(rate = pace, name = label, times = (label, 2))
            c = new[2] Camera(name = "back")
            d = new Camera()
        }
    "#;
    let mut declared = camera();
    declared[0]["ports"][1]["name"] = json!("rate_in");
    declared[0]["reactions"][1]["triggers"][0]["name"] = json!("rate_in");
    let mut world = World::new(text).executable("bin/camera", declared);
    world.takes("bin/camera", &["rate", "name", "times", "bank_index"]);
    let stated = ["main.label=right".to_owned()];
    let compiled = compile_with("Main.lf", &stated, &mut world).unwrap();
    let given: Vec<_> = world.given.iter().map(|it| serde_json::to_string(it).unwrap()).collect();
    let c = |index| {
        format!(
            r#"[["rate",10],["name","back"],["times",[{{"time":1000000}},0]],["bank_index",{index}]]"#
        )
    };
    let b = r#"[["rate",{"float":"0.5"}],["name","right"],["times",{"tuple":["right",2]}],["bank_index",0]]"#;
    let a = c(0).replace("back", "front");
    // Instances with equal values are asked once.
    assert_eq!(given, [a.clone(), b.to_owned(), c(0), c(1)]);
    let values = compiled.executables.values();
    let values: Vec<_> = values.map(|it| serde_json::to_string(&it.parameters).unwrap()).collect();
    assert_eq!(values, [a.clone(), b.to_owned(), c(0), c(1), a]);
}

#[test]
fn what_an_executable_declares_may_follow_from_its_parameters() {
    let text = r#"
        @executable("bin/camera")
        reactor Camera(period = 10 ms) { input rate; output image }
        federated reactor { a = new Camera(); b = new[2] Camera(period = 5 ms); c = new Camera() }
    "#;
    let mut world = World::new(text).executable("bin/camera", paced(10_000_000));
    world.takes("bin/camera", &["period"]);
    world.answers = vec![paced(10_000_000), paced(5_000_000)];
    let program = world.compiled().unwrap().program.clone();
    let periods: Vec<_> = program.timers.values().map(|timer| timer.period).collect();
    assert_eq!(periods, [10_000_000, 5_000_000, 5_000_000, 10_000_000]);
}

#[test]
fn parameters_of_one_end_are_errors_that_name_both() {
    let text = VISION.replace("reactor Camera {", "reactor Camera(speed = 10, depth = 2) {");
    let refused = |refused: Value| {
        let mut world = World::new(&text).executable("bin/camera", camera());
        world.takes("bin/camera", &["speed_max", "depth"]);
        world.declared.get_mut("bin/camera").unwrap()["refused"] = refused;
        world.errors()
    };
    assert_snapshot!(refused(json!({"missing": "speed_max"})), @r#"
    error[LF1105]: the executable /bin/camera needs the parameter `speed_max: u32`, and Camera in Main.lf:4 has none of that name
     --> Main.lf:4:5
      |
    4 |     reactor Camera(speed = 10, depth = 2) { input rate; output image }
      |     ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      |
      = help: the executable has `speed_max: u32`, `depth: u32`
    "#);
    assert_snapshot!(refused(json!({"unknown": "speed"})), @r#"
    error[LF1105]: the executable /bin/camera has no parameter `speed`, and Camera in Main.lf:4 has one
     --> Main.lf:4:20
      |
    4 |     reactor Camera(speed = 10, depth = 2) { input rate; output image }
      |                    ^^^^^
      |
      = help: its parameters: `speed_max`, `depth`
    "#);
    assert_snapshot!(refused(json!({"wrong": ["depth", "`value`: expected String, found the int 2"]})), @r#"
    error[LF1106]: the executable /bin/camera does not take `depth` of Camera in Main.lf:4: `value`: expected String, found the int 2
     --> Main.lf:4:40
      |
    4 |     reactor Camera(speed = 10, depth = 2) { input rate; output image }
      |                                -----   ^
      |                                |
      |                                the program declares it here
      |
      = help: it has the parameter `depth: u32`
    "#);
    assert_snapshot!(refused(json!({"wrong": [null, "too much"]})), @r#"
    error[LF1106]: the executable /bin/camera does not take the parameters of Camera in Main.lf:4: too much
      --> Main.lf:12:9
       |
    12 |         camera = new Camera()
       |         ^^^^^^
    "#);
    // An executable that says nothing of parameters has none.
    assert_snapshot!(World::new(&text).executable("bin/camera", camera()).errors(), @r#"
    error[LF1105]: the executable /bin/camera has no parameter `speed`, and Camera in Main.lf:4 has one
     --> Main.lf:4:20
      |
    4 |     reactor Camera(speed = 10, depth = 2) { input rate; output image }
      |                    ^^^^^
      |
      = help: its parameters: there are none
    "#);
}

#[test]
fn a_wrong_value_is_an_error_where_it_is_stated_once() {
    let text = VISION
        .replace("reactor Camera {", "reactor Camera(depth = 2, bank_index = 0) {")
        .replace("new Camera()", "new[3] Camera(depth = 3)")
        .replace("input image", "input[3] image")
        .replace("detector.rate ->", "(detector.rate)+ ->");
    let mut world = World::new(&text).executable("bin/camera", camera());
    world.takes("bin/camera", &["depth", "bank_index"]);
    let why = "`value`: expected String, found the int 3";
    world.declared.get_mut("bin/camera").unwrap()["refused"] = json!({"wrong": ["depth", why]});
    assert_snapshot!(world.errors(), @r#"
    error[LF1106]: the executable /bin/camera does not take `depth` of Camera in Main.lf:4: `value`: expected String, found the int 3
      --> Main.lf:12:40
       |
     4 |     reactor Camera(depth = 2, bank_index = 0) { input rate; output image }
       |                    ----- the program declares it here
    ...
    12 |         camera = new[3] Camera(depth = 3)
       |                                        ^
       |
       = help: it has the parameter `depth: u32`
    "#);
}

#[test]
fn a_value_that_is_not_known_before_the_program_runs_is_an_error() {
    let text = VISION.replace("reactor Camera {", "reactor Camera(depth = {= 1 + 1 =}) {");
    let mut world = World::new(&text).executable("bin/camera", camera());
    world.takes("bin/camera", &["depth"]);
    assert_snapshot!(world.errors(), @r#"
    error[LF1107]: a parameter of an executable cannot be computed in Python: it is needed before anything runs
     --> Main.lf:4:28
      |
    4 |     reactor Camera(depth = {= 1 + 1 =}) { input rate; output image }
      |                            ^^^^^^^^^^^
      |
      = help: write the value, or a parameter whose value is written
    "#);
    // Errors of other rules come once, and no executable is asked.
    let text = VISION.replace("new Camera()", "new Camera(depth = [nothing])");
    let text = text.replace("reactor Camera {", "reactor Camera(depth = 1) {");
    let mut world = World::new(&text).executable("bin/camera", camera());
    world.takes("bin/camera", &["depth"]);
    assert_snapshot!(world.errors(), @r#"
    error[LF0306]: there is no parameter `nothing`
      --> Main.lf:12:38
       |
    12 |         camera = new Camera(depth = [nothing])
       |                                      ^^^^^^^
       |
       = help: a value of Python is written `{= nothing =}`
    "#);
}

#[test]
fn a_width_may_be_a_parameter_of_the_executable() {
    let text = r#"
        @executable("c") reactor C(n = 2) { output[n + 1] out }
        federated reactor { a = new C(n = 3) }
    "#;
    let declared = |width: i64| {
        let port = json!({"name": "out", "kind": "output", "width": width});
        let mut world = World::new(text).executable("c", json!([{"name": "C", "ports": [port]}]));
        world.takes("c", &["n"]);
        world
    };
    assert_eq!(declared(4).compiled().unwrap().program.ports.len(), 4);
    assert!(
        declared(3)
            .errors()
            .contains("declares output `out[3]`, and C in Main.lf:3 has output `out[4]`")
    );
}
