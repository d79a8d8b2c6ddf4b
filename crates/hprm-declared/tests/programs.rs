//! Declarations as JSON in, graphs and diagnostics out.

mod common;

use common::{TEXT, at, compiled, errors, graph, no_files, of, own, vision, warnings};
use hprm_core::Coordination;
use hprm_declared::Declaration;
use hprm_lf::SourceLoader;
use hprm_model::Purpose;
use insta::assert_snapshot;
use serde_json::{Value, json};

#[test]
fn what_is_declared_is_what_runs() {
    let compiled = compiled(&vision()).unwrap();
    assert_snapshot!(graph(&compiled), @r#"
    Vision: Vision
    Vision.cameras[0]: Camera
    Vision.cameras[1]: Camera
    Vision.detector: Detector
    timer Vision.cameras[0].tick (0, 10000000)
    timer Vision.cameras[1].tick (0, 10000000)
    Vision.cameras[1].image -> Vision.detector.image None
    Vision.1: ["Vision.detector.boxes"] -> []
    Vision.cameras[0].1: ["tick"] -> ["Vision.cameras[0].image"]
    Vision.cameras[1].1: ["tick"] -> ["Vision.cameras[1].image"]
    Vision.detector.1: ["Vision.detector.image"] -> ["Vision.detector.boxes"] within 5000000 tardy
    "#);
    let properties = &compiled.program.properties;
    assert_eq!(properties.timeout, Some(1_000_000_000));
    assert_eq!(properties.coordination, Coordination::Decentralized);
    assert_eq!(properties.cpus, [0, 1]);
    assert_eq!(properties.clock_sync.period, 5);
    assert!(compiled.warnings.is_empty(), "{:?}", compiled.warnings);
    // Bodies are elsewhere, and in the order in which they are declared.
    let detector = compiled.classes.iter().find(|class| class.name == "Detector").unwrap();
    assert_eq!(detector.reactions[0].name.as_deref(), Some("detect"));
    assert_eq!(detector.reactions[0].code, None);
    let line = TEXT[..TEXT.find("def detect").unwrap()].matches('\n').count() + 1;
    assert_eq!(detector.reactions[0].line as usize, line);
}

#[test]
fn options_override_what_the_program_states_and_leave_its_parameters() {
    let stated = ["timeout=2 s".to_owned(), "main.rate=3".to_owned()];
    let text = vision().to_string();
    let compiled =
        hprm_lf::compile_declared(&text, &stated, &mut no_files(), Purpose::Run).unwrap().unwrap();
    assert_eq!(compiled.program.properties.timeout, Some(2_000_000_000));
    let parameters = Declaration::read(&text).unwrap().parameters();
    assert_eq!(parameters, [("rate".to_owned(), "10".to_owned())]);
    let wrong = ["timeout=soon".to_owned()];
    let failure = hprm_lf::compile_declared(&text, &wrong, &mut no_files(), Purpose::Run)
        .unwrap()
        .unwrap_err();
    assert_snapshot!(failure, @r"
    error[LF0603]: `timeout` must be a time, such as `10 s`
    --> --property timeout=soon
    ");
}

/// The program with the second connection, whose input has a source already.
fn two_sources() -> Value {
    let mut vision = vision();
    let connect = "hprm.connect(self.cameras[0].image, self.detector.image)";
    let from = of("cameras", json!(0), "image", "self.cameras[0].image");
    let to = of("detector", Value::Null, "image", "self.detector.image");
    let second = json!({"at": at(connect), "from": [from], "to": [to]});
    vision["reactors"][2]["connections"].as_array_mut().unwrap().push(second);
    vision
}

#[test]
fn two_sources_are_shown_where_they_are_connected() {
    assert_snapshot!(errors(&two_sources()), @r"
    error[LF0502]: the port `Vision.detector.image` has two sources
      --> app.py:25:9
       |
    24 |         hprm.connect(self.cameras[1].image, self.detector.image)
       |         -------------------------------------------------------- it is also set here
    25 |         hprm.connect(self.cameras[0].image, self.detector.image)
       |         ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
       |
       = help: a port is set by one connection, or by the reactions of one reactor
    ");
}

#[test]
fn two_sources_of_one_line_are_said_to_be() {
    let mut vision = two_sources();
    let first = vision["reactors"][2]["connections"][0]["at"].clone();
    vision["reactors"][2]["connections"][1]["at"] = first;
    assert_snapshot!(errors(&vision), @r"
    error[LF0502]: the port `Vision.detector.image` has two sources
      --> app.py:24:9
       |
    24 |         hprm.connect(self.cameras[1].image, self.detector.image)
       |         ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
       |
       = help: it is connected 2 times here; a port is set by one connection, or by the reactions of one reactor
    ");
}

#[test]
fn names_that_there_are_not_are_shown_where_they_are_named() {
    let mut vision = vision();
    vision["reactors"][2]["reactions"][0]["triggers"] =
        json!([of("detector", Value::Null, "box", "detector.boxes")]);
    vision["reactors"][0]["reactions"][0]["effects"] = json!([own("picture", "image]")]);
    assert_snapshot!(errors(&vision), @r"
    error[LF0303]: there is no `picture` in this reactor
     --> app.py:8:35
      |
    8 |     @hprm.reaction(tick, effects=[image])
      |                                   ^^^^^^
      |
      = help: names that fit here: `image`

    error[LF0304]: `Detector` has no port `box`
      --> app.py:27:20
       |
    27 |     @hprm.reaction(detector.boxes)
       |                    ^^^^^^^^^^^^^^
       |
       = help: its outputs: `boxes`
    ");
}

#[test]
fn times_and_widths_are_checked() {
    let mut vision = vision();
    vision["reactors"][0]["timers"][0]["period"] = json!(-1);
    vision["reactors"][1]["ports"][0]["width"] = json!(1_000_000_000);
    vision["reactors"][1]["ports"][1]["width"] = json!(0);
    assert_snapshot!(errors(&vision), @r#"
    error[LF0407]: this time is negative
     --> app.py:6:5
      |
    6 |     tick = hprm.Timer(offset=0, period="10 ms")
      |     ^^^^
      |
      = help: times count forward; use `0` or more

    error[LF0405]: a width is at most 100000; this one is 1000000000
      --> app.py:13:5
       |
    13 |     image = hprm.Input()
       |     ^^^^^^^^^^^^^^^^^^

    error[LF0405]: a width is at least 1; this one is 0
      --> app.py:14:5
       |
    14 |     boxes = hprm.Output()
       |     ^^^^^
    "#);
}

#[test]
fn a_member_that_there_is_not() {
    let mut vision = vision();
    vision["reactors"][2]["connections"][0]["from"][0]["member"] = json!(2);
    assert_snapshot!(errors(&vision), @r"
    error[LF0312]: there is no member 2 here
      --> app.py:24:22
       |
    24 |         hprm.connect(self.cameras[1].image, self.detector.image)
       |                      ^^^^^^^^^^^^^^^^^^^^^
       |
       = help: there are 2 members, from 0 to 1
    ");
}

#[test]
fn an_input_without_a_connection() {
    let mut vision = vision();
    vision["reactors"][2]["connections"] = json!([]);
    assert_snapshot!(warnings(&vision), @r"
    warning[LF0505]: nothing is connected to `detector.image`
      --> app.py:23:9
       |
    17 |     def detect(self): ...
       |     ---------- so this reaction never runs
    ...
    23 |         self.detector = Detector()
       |         ^^^^^^^^^^^^^
       |
       = help: connect an output to it: `hprm.connect(..., self.detector.image)`
    ");
}

#[test]
fn an_output_that_no_reaction_sets() {
    let mut vision = vision();
    vision["reactors"][1]["reactions"][0]["effects"] = json!([]);
    assert_snapshot!(warnings(&vision), @r"
    warning[LF0506]: nothing sets the output `boxes`
      --> app.py:14:5
       |
    14 |     boxes = hprm.Output()
       |     ^^^^^
       |
       = help: name it in `effects=[...]` of a reaction that calls `self.boxes.set(value)`, or connect an output of a contained reactor to it
    ");
}

#[test]
fn a_federation_has_federates_and_facts() {
    let mut vision = vision();
    vision["reactors"][2]["federated"] = json!(true);
    assert_snapshot!(errors(&vision), @r"
    error[LF0801]: this belongs to no federate
      --> app.py:28:5
       |
    28 |     def plan(self): ...
       |     ^^^^^^^^
       |
       = help: move it into a reactor that the federation contains
    ");
    vision["reactors"][2]["reactions"] = json!([]);
    let cameras = &mut vision["reactors"][2]["children"][0];
    (cameras["host"], cameras["maxwait"]) = (json!("robot.local"), json!(20));
    cameras["transient"] = json!(true);
    let compiled = compiled(&vision).unwrap();
    let program = &compiled.program;
    let federates: Vec<_> = program
        .federates
        .values()
        .map(|it| (it.name.as_str(), it.maxwait, it.host.as_deref(), it.transient))
        .collect();
    assert_eq!(
        federates,
        [
            ("cameras__0", 20, Some("robot.local"), true),
            ("cameras__1", 20, Some("robot.local"), true),
            ("detector", i64::MAX, None, false),
        ]
    );
    let facts: Vec<_> = compiled.modules.iter().map(|fact| fact.subject.as_str()).collect();
    // Not those of transient federates.
    assert_eq!(facts, ["parameter rate of the main reactor", "module app"]);
    vision["reactors"][2]["children"][0]["transient"] = json!(false);
    let facts = self::compiled(&vision).unwrap().modules;
    let facts: Vec<_> = facts.iter().map(|fact| fact.subject.as_str()).collect();
    assert_eq!(
        facts,
        [
            "parameter rate of the main reactor",
            "parameter rate of cameras[0]",
            "parameter rate of cameras[1]",
            "module app",
        ]
    );
}

#[test]
fn modes_have_the_members_that_name_them() {
    let mut vision = vision();
    let detector = &mut vision["reactors"][1];
    detector["modes"] = json!([
        {"name": "day", "at": at("image = hprm.Input"), "initial": true},
        {"name": "night", "at": at("boxes = hprm"), "initial": false}
    ]);
    detector["actions"] = json!([{"name": "dusk", "at": at("boxes = hprm"), "physical": true,
        "min_delay": 0, "spacing": 5, "policy": "replace", "mode": 0}]);
    detector["reactions"] = json!([
        {"name": "a", "at": at("def detect"), "triggers": [own("dusk", "image, effects")], "mode": 1},
        {"name": "b", "at": at("def detect"), "triggers": ["reset", own("image", "image, effects")],
         "effects": [{"at": at("boxes]"), "mode": 1, "history": true}, own("boxes", "boxes]")],
         "mode": 0}
    ]);
    let compiled = compiled(&vision).unwrap();
    assert_snapshot!(graph(&compiled), @r#"
    Vision: Vision
    Vision.cameras[0]: Camera
    Vision.cameras[1]: Camera
    Vision.detector: Detector
    timer Vision.cameras[0].tick (0, 10000000)
    timer Vision.cameras[1].tick (0, 10000000)
    Vision.cameras[1].image -> Vision.detector.image None
    Vision.1: ["Vision.detector.boxes"] -> []
    Vision.cameras[0].1: ["tick"] -> ["Vision.cameras[0].image"]
    Vision.cameras[1].1: ["tick"] -> ["Vision.cameras[1].image"]
    Vision.detector.1: ["dusk"] -> []
    Vision.detector.2: ["Reset", "Vision.detector.image"] -> ["Mode(ModeId(1), History)", "Vision.detector.boxes"]
    "#);
    let modes = compiled.program.reactions.values().map(|reaction| reaction.mode.map(|it| it.0));
    assert_eq!(modes.collect::<Vec<_>>(), [None, None, None, Some(1), Some(0)]);
}

#[test]
fn a_text_that_is_not_known_keeps_its_lines() {
    let mut vision = two_sources();
    vision["files"][0]["text"] = json!("");
    vision["files"][0]["path"] = json!("<notebook cell 3>");
    assert_snapshot!(errors(&vision), @r"
    error[LF0502]: the port `Vision.detector.image` has two sources
    --> <notebook cell 3>:25:1
     = help: a port is set by one connection, or by the reactions of one reactor
    ");
}

#[test]
fn what_is_no_declaration_is_one_error() {
    let mut cyclic = vision();
    cyclic["reactors"][1]["children"] =
        json!([{"name": "x", "at": at("boxes"), "members": [1], "bank": false}]);
    let mut elsewhere = vision();
    elsewhere["files"].as_array_mut().unwrap().push(json!({"path": "b.py", "text": ""}));
    elsewhere["reactors"][2]["at"][0] = json!(1);
    let mut unknown = vision();
    unknown["reactors"][0]["watchdogs"] = json!([]);
    let mut no_bank = vision();
    no_bank["reactors"][2]["children"][0]["bank"] = json!(false);
    let mut mode = vision();
    mode["reactors"][0]["reactions"][0]["mode"] = json!(0);
    let mut name = vision();
    name["reactors"][0]["name"] = json!("a.b");
    let mut main = vision();
    main["main"] = json!(3);
    let texts = [cyclic, elsewhere, unknown, no_bank, mode, name, main].map(|it| it.to_string());
    let deep = r#"{"properties": [{"name": "x", "at": [0, 1, 0, 0], "value": "#.to_owned()
        + &r#"{"list": ["#.repeat(100_000);
    let all = texts.iter().map(String::as_str).chain(["", "[]", "{\"files\": []}", &deep]);
    let wrong = |text| {
        let compiled = hprm_lf::compile_declared(text, &[], &mut no_files(), Purpose::Run);
        let error = compiled.unwrap_err().to_string();
        // Where in the text of a whole program, depends on the order of members, and that on how serde_json was built.
        match error.split_once(" at line 1 column ") {
            Some((what, column)) if column.len() > 3 => what.to_owned(),
            _ => error,
        }
    };
    let found: Vec<_> = all.map(wrong).collect();
    assert_snapshot!(found.join("\n"), @r#"
    the declaration of the program cannot be read: reactor 1 contains itself
    the declaration of the program cannot be read: the main reactor is not in the first file
    the declaration of the program cannot be read: unknown field `watchdogs`, expected one of `name`, `at`, `federated`, `executable`, `parameters`, `ports`, `timers`, `actions`, `modes`, `children`, `connections`, `reactions`, `facts`
    the declaration of the program cannot be read: `cameras` has 2 members and is no bank
    the declaration of the program cannot be read: a reactor has no mode 0
    the declaration of the program cannot be read: "a.b" is no name
    the declaration of the program cannot be read: it has no reactor 3
    the declaration of the program cannot be read: EOF while parsing a value at line 1 column 0
    the declaration of the program cannot be read: invalid length 0, expected struct Document with 8 elements at line 1 column 2
    the declaration of the program cannot be read: missing field `main` at line 1 column 13
    the declaration of the program cannot be read: recursion limit exceeded at line 1 column 680
    "#);
}

/// The first diagnostic of a changed program.
fn hint(changes: &[(&str, Value)]) -> String {
    let mut vision = vision();
    for (place, value) in changes {
        let (parent, key) = place.rsplit_once('/').unwrap();
        vision.pointer_mut(parent).unwrap()[key] = value.clone();
    }
    let diagnostics = match compiled(&vision) {
        Ok(compiled) => compiled.warnings,
        Err(failure) => failure.diagnostics,
    };
    let first = &diagnostics[0];
    format!("{} {}\n  {}", first.code, first.message, first.hint.as_deref().unwrap_or("-"))
}

#[test]
fn hints_have_the_words_of_python() {
    let main = "/reactors/2";
    let connection = "/reactors/2/connections/0";
    let to = of("detector", Value::Null, "image", "self.detector.image");
    let from = of("cameras", json!(1), "image", "self.cameras[1].image");
    let of_main = |key: &str| format!("{main}/{key}");
    let of_connection = |key: &str| format!("{connection}/{key}");
    let day = json!([{"name": "day", "at": at("image"), "initial": false}]);
    let all: &[&[(&str, Value)]] = &[
        // The wrong way round, to more than there is, and physical only in part.
        &[(&of_connection("from"), json!([to])), (&of_connection("to"), json!([from]))],
        &[("/reactors/1/ports/0/width", json!(2))],
        &[(&of_connection("bound"), json!([10, "drop"]))],
        &[(&of_connection("physical"), json!(true)), (&of_connection("bound"), json!([0, "drop"]))],
        &[(&of_connection("physical"), json!(true)), (&of_connection("bound"), json!([1, "drip"]))],
        &[(&of_connection("absent_after"), json!(5))],
        &[(&of_connection("compress"), json!(true))],
        &[(&of_main("children/1/maxwait"), json!(5))],
        &[(&of_main("children/1/transient"), json!(true))],
        &[(&of_main("children/1/restart"), json!({"condition": "always", "sec": -1}))],
        &[(&of_main("children/1/host"), json!("robot"))],
        &[("/reactors/1/federated", json!(true))],
        &[("/reactors/1/modes", day)],
        &[("/reactors/1/reactions/0/effects", json!([]))],
        &[("/reactors/0/reactions/0/triggers", json!([]))],
    ];
    let hints: Vec<_> = all.iter().map(|changes| hint(changes)).collect();
    assert_snapshot!(hints.join("\n"), @r#"
    LF0305 this connection is the wrong way round
      write `hprm.connect(self.cameras[1].image, self.detector.image)`
    LF0501 this connection joins 1 channel to 2 channels
      the rest on the right stays absent; `repeated=True` repeats the left side
    LF0212 `bound=` does not belong here
      it belongs to a physical connection: `physical=True`
    LF0212 the number of messages of `bound=` must be from 1 to 4294967295
      write `bound=(10, "replace")`, "drop" to keep the first 10, or "block" to make the sender wait
    LF0212 `bound=` has no policy `drip`
      did you mean `drop`?
    LF0212 `absent_after=` does not belong here
      it belongs to a connection of a federation
    LF0212 `compress=` does not belong here
      it belongs to a connection of a federation
    LF0212 `maxwait=` does not belong here
      it belongs to a reactor that a federation contains
    LF0212 `transient=` does not belong here
      it belongs to a reactor that a federation contains
    LF0212 `restart=` does not belong here
      it belongs to a reactor that a federation contains
    LF0802 only an instance in a federated reactor has a host
      extend `hprm.Federation`, or remove `host=`
    LF0307 `Detector` is a federation: no other reactor can contain it
      put what both need into a plain reactor
    LF0901 none of the modes is the initial one
      write `hprm.Mode(initial=True)` for the one where the reactor starts
    LF0506 nothing sets the output `boxes`
      name it in `effects=[...]` of a reaction that calls `self.boxes.set(value)`, or connect an output of a contained reactor to it
    LF0214 this reaction has no trigger, so it never runs
      name a trigger: an input, an action, a timer, `hprm.startup`
    "#);
}

#[test]
fn hints_on_properties_have_the_words_of_python() {
    let all: &[&[(&str, Value)]] = &[
        &[
            ("/reactors/2/federated", json!(true)),
            ("/reactors/2/reactions", json!([])),
            (
                "/properties",
                json!([{"name": "fast", "at": at("class Vision"), "value": true},
                       {"name": "coordination", "at": at("class Vision"), "value": {"text": "decentralized"}}]),
            ),
        ],
        &[(
            "/properties",
            json!([{"name": "workers", "at": at("class Vision"), "value": 2},
                   {"name": "single-threaded", "at": at("class Vision"), "value": true}]),
        )],
    ];
    let hints: Vec<_> = all.iter().map(|changes| hint(changes)).collect();
    assert_snapshot!(hints.join("\n"), @r"
    LF0605 `fast` does not go together with decentralized coordination
      remove `fast=True`
    LF0605 `single-threaded` does not go together with `workers`
      remove one of them; `workers=1` has one worker
    ");
}

#[test]
fn values_of_properties_have_the_words_of_python() {
    let stated = |name: &str, value: Value| {
        let mut vision = vision();
        let property = json!({"name": name, "at": at("class Vision"), "value": value});
        vision["properties"] = json!([property]);
        vision
    };
    for (name, value, expected) in [
        ("fast", json!(1), "`fast` must be `True` or `False`"),
        ("realtime", json!({"text": "much"}), "`realtime` must be `True`, `False`, or a priority"),
        ("clock-sync-options", json!(1), "must be `{\"name\": value, ...}`"),
        (
            "clock-sync-options",
            json!({"dictionary": [{"name": "collect-stats", "at": at("class Vision"), "value": 1}]}),
            "`collect-stats` must be `True` or `False`",
        ),
        ("verify", json!(1), "`verify` must be `True` or `False`"),
    ] {
        let said = errors(&stated(name, value));
        assert!(said.contains(expected), "{said}");
    }
    let said = warnings(&stated("logging", json!({"text": "debug"})));
    assert!(said.contains("`\"logging\": \"debug\"` has no effect yet"), "{said}");
    // On a command line they are as in `.lf` files.
    let text = vision().to_string();
    let overrides = ["fast=1".to_owned()];
    let said = hprm_lf::compile_declared(&text, &overrides, &mut no_files(), Purpose::Run);
    let said = said.unwrap().unwrap_err().to_string();
    assert!(said.contains("`fast` must be `true` or `false`"), "{said}");
}

/// A disk with one file.
struct OneFile;

impl SourceLoader for OneFile {
    fn load(&mut self, _: &str) -> Result<String, String> {
        Err("no such file".to_owned())
    }

    fn list(&mut self, _: &str) -> Vec<String> {
        vec!["image.proto".to_owned()]
    }

    fn exists(&mut self, path: &str) -> bool {
        path == "image.proto"
    }
}

#[test]
fn files_that_properties_name_are_looked_for() {
    let compile = |name: &str, path: &str| {
        let mut vision = vision();
        let value = json!({"text": path});
        vision["properties"] = json!([{"name": name, "at": at("class Vision"), "value": value}]);
        hprm_lf::compile_declared(&vision.to_string(), &[], &mut OneFile, Purpose::Run).unwrap()
    };
    let said = compile("protobufs", "imag.proto").unwrap_err().to_string();
    assert!(said.contains("error[LF0611]: there is no file `imag.proto`"), "{said}");
    assert!(said.contains("did you mean `image.proto`?"), "{said}");
    let codes = |name, path| -> Vec<_> {
        compile(name, path).unwrap().warnings.iter().map(|warning| warning.code).collect()
    };
    // What the properties do for `.lf` files, Python does by itself.
    assert!(codes("protobufs", "image.proto").contains(&"LF0607"));
    assert!(!codes("files", "image.proto").contains(&"LF0610"));
    assert!(codes("files", "nowhere").contains(&"LF0610"));
}

#[test]
fn a_cycle_of_reactions_is_shown_with_the_words_of_python() {
    let mut vision = vision();
    let detector = &mut vision["reactors"][1];
    detector["reactions"][0]["triggers"].as_array_mut().unwrap().push(own("loop", "boxes]"));
    let port = json!({"name": "loop", "at": at("boxes"), "kind": "input", "width": null});
    detector["ports"].as_array_mut().unwrap().push(port);
    let from = of("detector", Value::Null, "boxes", "detector.boxes");
    let to = of("detector", Value::Null, "loop", "self.detector.image");
    let connect = "hprm.connect(self.cameras[0].image, self.detector.image)";
    let back = json!({"at": at(connect), "from": [from], "to": [to]});
    vision["reactors"][2]["connections"].as_array_mut().unwrap().push(back);
    assert_snapshot!(errors(&vision), @r"
    error[LF0503]: the reaction Vision.detector.detect waits for itself: it reads what it sets
      --> app.py:17:5
       |
    17 |     def detect(self): ...
       |     ^^^^^^^^^^
       |
       = help: give one of the connections a delay, such as `after=0`, or reorder the reactions
    ");
}
