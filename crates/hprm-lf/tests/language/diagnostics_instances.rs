//! What people read when instances do not fit together: widths, times, connections, loops.

use crate::common::{errors, errors_in, warnings};
use hprm_core::{ClockSyncMode, ClockSyncOptions, StoreOptions, WhenFull};
use insta::assert_snapshot;

#[test]
fn two_connections_into_one_port() {
    assert_snapshot!(errors("
reactor A { output out }
reactor B { input inp }
main reactor {
  a1 = new A()
  a2 = new A()
  b = new B()
  a1.out -> b.inp
  a2.out -> b.inp after 1 s
}
"), @r#"
    error[LF0502]: the port `Main.b.inp` has two sources
     --> Main.lf:9:3
      |
    8 |   a1.out -> b.inp
      |   --------------- it is also set here
    9 |   a2.out -> b.inp after 1 s
      |   ^^^^^^^^^^^^^^^^^^^^^^^^^
      |
      = help: a port is set by one connection, or by the reactions of one reactor
    "#);
}

#[test]
fn a_federate_that_is_called_as_a_member_of_a_bank() {
    assert_snapshot!(errors("
reactor A { }
federated reactor {
  a = new[2] A()
  a__1 = new A()
}
"), @r#"
    error[LF0201]: two federates are called `a__1`
     --> Main.lf:5:3
      |
    4 |   a = new[2] A()
      |   - the first one
    5 |   a__1 = new A()
      |   ^^^^
      |
      = help: the members of a bank are federates that have its name with `__` and their index
    "#);
}

#[test]
fn a_connection_and_a_reaction_into_one_port() {
    assert_snapshot!(errors("
reactor A { output out }
reactor B { input inp }
main reactor {
  a = new A()
  b = new B()
  a.out -> b.inp
  reaction(startup) -> b.inp {= b.inp.set(1) =}
}
"), @r#"
    error[LF0502]: the port `Main.b.inp` has two sources
     --> Main.lf:7:3
      |
    7 |   a.out -> b.inp
      |   ^^^^^^^^^^^^^^
    8 |   reaction(startup) -> b.inp {= b.inp.set(1) =}
      |   -------------------------- this reaction sets it too
      |
      = help: a port is set by one connection, or by the reactions of one reactor
    "#);
}

#[test]
fn a_causality_loop() {
    assert_snapshot!(errors("
reactor A {
  input inp
  output out
  reaction(inp) -> out {= out.set(inp.value) =}
}
reactor B {
  input inp
  output out
  reaction(startup) {= pass =}
  reaction(inp) -> out {= out.set(inp.value) =}
}
main reactor {
  a = new A()
  b = new B()
  a.out -> b.inp
  b.out -> a.inp
}
"), @r#"
    error[LF0503]: reactions wait for one another in a cycle: Main.a.1 -> Main.b.2
      --> Main.lf:5:3
       |
     5 |   reaction(inp) -> out {= out.set(inp.value) =}
       |   ^^^^^^^^^^^^^^^^^^^^
    ...
    11 |   reaction(inp) -> out {= out.set(inp.value) =}
       |   -------------------- this reaction is in the cycle
       |
       = help: give one of the connections a delay, such as `after 0`, or reorder the reactions
    "#);
}

#[test]
fn a_cycle_of_connections_alone() {
    assert_snapshot!(errors("
reactor Loop {
  input inp
  output out
  inp -> out
}
main reactor {
  a = new Loop()
  b = new Loop()
  a.out -> b.inp
  b.out -> a.inp
}
"), @r#"
    error[LF0503]: connections form a cycle without a delay and without a reaction
     --> Main.lf:5:3
      |
    5 |   inp -> out
      |   ^^^^^^^^^^
      |
      = help: no reaction sets any of these ports; remove one of the connections
    "#);
}

#[test]
fn times_that_are_not() {
    assert_snapshot!(errors("
reactor A(period = 100, name = \"x\", delay = {= 5 =}) {
  timer t(0, period)
  logical action a(name)
  timer u(-1 s)
  reaction(t) {= pass =} deadline(delay) {= pass =}
}
main reactor { a = new A() }
"), @r#"
    error[LF0403]: a time needs a unit
     --> Main.lf:3:14
      |
    2 | reactor A(period = 100, name = "x", delay = {= 5 =}) {
      |                    --- the value is stated here
    3 |   timer t(0, period)
      |              ^^^^^^
      |
      = help: write `100 ms`, for example; only `0` needs none

    error[LF0403]: this is not a time
     --> Main.lf:4:20
      |
    2 | reactor A(period = 100, name = "x", delay = {= 5 =}) {
      |                                --- the value is stated here
    3 |   timer t(0, period)
    4 |   logical action a(name)
      |                    ^^^^
      |
      = help: write a number and a unit: `10 ms`

    error[LF0407]: this time is negative
     --> Main.lf:5:11
      |
    5 |   timer u(-1 s)
      |           ^^^^
      |
      = help: times count forward; use `0` or more

    error[LF0404]: a time cannot be computed in Python: it is needed before anything runs
     --> Main.lf:6:35
      |
    2 | reactor A(period = 100, name = "x", delay = {= 5 =}) {
      |                                             ------- the value is stated here
    ...
    6 |   reaction(t) {= pass =} deadline(delay) {= pass =}
      |                                   ^^^^^
      |
      = help: write the value, or a parameter whose value is written
    "#);
}

#[test]
fn widths_that_are_not() {
    assert_snapshot!(errors("
reactor A(n = 0, m = 1 s) {
  input[n] p
  input[m] q
}
main reactor(k = {= 3 =}) { a = new[k] A() b = new[1000000] A() }
"), @r#"
    error[LF0405]: a width is at least 1; this one is 0
     --> Main.lf:3:8
      |
    3 |   input[n] p
      |        ^^^

    error[LF0405]: a width is a whole number
     --> Main.lf:4:9
      |
    2 | reactor A(n = 0, m = 1 s) {
      |                      --- the value is stated here
    3 |   input[n] p
    4 |   input[m] q
      |         ^

    error[LF0404]: a width cannot be computed in Python: it is needed before anything runs
     --> Main.lf:6:37
      |
    6 | main reactor(k = {= 3 =}) { a = new[k] A() b = new[1000000] A() }
      |                  -------            ^
      |                  |
      |                  the value is stated here
      |
      = help: write the value, or a parameter whose value is written

    error[LF0405]: a width is at most 100000; this one is 1000000
     --> Main.lf:6:51
      |
    6 | main reactor(k = {= 3 =}) { a = new[k] A() b = new[1000000] A() }
      |                                                   ^^^^^^^^^
    "#);
    assert_snapshot!(errors("
reactor A(n = 0, m = 1 s) { input[] r input[widthof(r)] s }
main reactor { a = new A() }
"), @r#"
    error[LF0405]: a width must be given
     --> Main.lf:2:34
      |
    2 | reactor A(n = 0, m = 1 s) { input[] r input[widthof(r)] s }
      |                                  ^^
      |
      = help: write `[4]` or `[n]`, with a parameter `n`

    error[LF0409]: a width cannot be that of another port
     --> Main.lf:2:45
      |
    2 | reactor A(n = 0, m = 1 s) { input[] r input[widthof(r)] s }
      |                                             ^^^^^^^^^^
      |
      = help: use one parameter for both widths
    "#);
}

#[test]
fn a_reactor_that_contains_itself() {
    assert_snapshot!(errors("
reactor A { b = new B() }
reactor B { a = new A() }
main reactor { a = new A() }
"), @r#"
    error[LF0308]: `A` contains itself, without end
     --> Main.lf:3:21
      |
    3 | reactor B { a = new A() }
      |                     ^
    "#);
}

#[test]
fn unmatched_widths_and_other_warnings() {
    assert_snapshot!(warnings("{ lingering: 1 s }
reactor A { output[3] out reaction() {= pass =} }
reactor B { input inp }
main reactor {
  a = new A()
  b = new[2] B()
  c = new[5] B()
  a.out -> b.inp
  (a.out)+ -> c.inp
}
"), @r#"
    warning[LF0602]: there is no target property `lingering`; it is ignored
     --> Main.lf:1:17
      |
    1 | target Python { lingering: 1 s }
      |                 ^^^^^^^^^

    warning[LF0506]: nothing sets the output `out`
     --> Main.lf:2:23
      |
    2 | reactor A { output[3] out reaction() {= pass =} }
      |                       ^^^
      |
      = help: name it as the effect of a reaction that calls `out.set(value)`, or connect an output of a contained reactor to it

    warning[LF0214]: this reaction has no trigger, so it never runs
     --> Main.lf:2:27
      |
    2 | reactor A { output[3] out reaction() {= pass =} }
      |                           ^^^^^^^^^^
      |
      = help: name a trigger: an input, an action, a timer, `startup`

    warning[LF0501]: this connection joins 3 channels to 2 channels
     --> Main.lf:8:3
      |
    8 |   a.out -> b.inp
      |   ^^^^^^^^^^^^^^
      |
      = help: the rest on the left is not connected

    warning[LF0501]: this broadcast joins 3 channels to 5 channels, which does not divide
     --> Main.lf:9:3
      |
    9 |   (a.out)+ -> c.inp
      |   ^^^^^^^^^^^^^^^^^
      |
      = help: the last round on the left is not complete
    "#);
}

#[test]
fn a_property_that_is_not_obeyed_yet_is_not_passed_over_in_silence() {
    assert_snapshot!(warnings("{ sst: {}, build-type: Debug }
main reactor { reaction(startup) {= pass =} }
"), @r#"
    warning[LF0606]: `sst` has no effect yet
     --> Main.lf:1:17
      |
    1 | target Python { sst: {}, build-type: Debug }
      |                 ^^^

    warning[LF0607]: `build-type` has no effect here
     --> Main.lf:1:26
      |
    1 | target Python { sst: {}, build-type: Debug }
      |                          ^^^^^^^^^^
      |
      = help: nothing is generated and nothing compiled
    "#);
}

#[test]
fn properties_from_elsewhere_have_the_last_word() {
    let text = "target Python { timeout: 1 s, workers: 3 }\nmain reactor {}\n";
    let compile = |properties: &[&str]| {
        let properties: Vec<_> = properties.iter().map(|&stated| stated.to_owned()).collect();
        hprm_lf::compile_with("Main.lf", &properties, &mut |_: &str| Ok(text.to_owned()))
    };
    let compiled = compile(&["timeout=2 s", "Single-Threaded=true"]).unwrap();
    assert_eq!(compiled.program.properties.timeout, Some(2_000_000_000));
    assert!(compiled.program.properties.deadlines_first && compiled.settings.single_threaded);
    assert_eq!(compiled.program.properties.workers, Some(1));
    assert!(!compiled.settings.encrypt && compile(&["comm-type=TLS"]).unwrap().settings.encrypt);
    assert!(!compiled.settings.auth && compile(&["auth=true"]).unwrap().settings.auth);

    assert_eq!(compiled.settings.store, StoreOptions::default());
    let store = compile(&["store-limit=\"2 GB\"", "store-full=error"]).unwrap().settings.store;
    assert_eq!(store, StoreOptions { limit: Some(2_000_000_000), when_full: WhenFull::Error });
    let store = compile(&["store-limit=4096"]).unwrap().settings.store;
    assert_eq!(store.limit, Some(4096));

    let failure = compile(&["timeout=soon", "fast"]).unwrap_err();
    assert_snapshot!(hprm_model::render_all(&failure.diagnostics, &failure.sources, false), @r"
    error[LF0603]: `timeout` must be a time, such as `10 s`
    --> --property timeout=soon

    error[LF0608]: `fast` is no target property with a value
    --> --property fast
     = help: write it as KEY=VALUE, such as --property 'timeout=10 s'
    ");
}

#[test]
fn a_time_on_its_own_is_read_as_in_a_program() {
    for text in ["5 s", "5 sec", "0", "0 s", "100us"] {
        assert_eq!(hprm_lf::expected_time(text), None, "{text}");
    }
    for text in ["5", "soon", "", "5 s, fast: true", "{=5=}", "}", "'5 s'"] {
        assert_eq!(hprm_lf::expected_time(text), Some("a time, such as `10 s`"), "{text}");
    }
    let negative = Some("a time that is not negative, such as `10 s`");
    assert_eq!(hprm_lf::expected_time("-1 s"), negative);
    assert_eq!(hprm_lf::expected_spin("auto").or(hprm_lf::expected_spin("20 us")), None);
    assert!(hprm_lf::expected_spin("2 s").is_some() && hprm_lf::expected_spin("zz").is_some());
}

#[test]
fn clock_sync_options_are_read_and_checked() {
    let read = |options: &str| {
        let text = format!("target Python {{ {options} }}\nfederated reactor {{}}\n");
        let compiled = hprm_lf::compile_with("Main.lf", &[], &mut |_: &str| Ok(text.clone()));
        compiled.unwrap().program.properties.clock_sync
    };
    let standard = ClockSyncOptions::default();
    assert_eq!(read(""), standard);
    assert_eq!(read("clock-sync: off").mode, ClockSyncMode::Off);
    assert_eq!(read("clock-sync: initial").mode, ClockSyncMode::Init);
    assert_eq!(
        read(
            "clock-sync: on, clock-sync-options: { local-federates-on: true, test-offset: -2 ms, \
              period: 10 ms, trials: 3, attenuation: 4, collect-stats: false }"
        ),
        ClockSyncOptions {
            mode: ClockSyncMode::On,
            local_federates: true,
            test_offset: -2_000_000,
            period: 10_000_000,
            trials: 3,
            attenuation: 4,
        }
    );
    assert_snapshot!(errors("{ clock-sync-options: { period: 0, trails: 3, attenuation: 0 } }
main reactor {}
"), @r"
    error[LF0603]: `period` must be a time, such as `5 ms`
     --> Main.lf:2:33
      |
    2 | { clock-sync-options: { period: 0, trails: 3, attenuation: 0 } }
      |                                 ^

    error[LF0603]: `clock-sync-options` has no `trails`
     --> Main.lf:2:36
      |
    2 | { clock-sync-options: { period: 0, trails: 3, attenuation: 0 } }
      |                                    ^^^^^^
      |
      = help: did you mean `trials`?

    error[LF0603]: `attenuation` must be a whole number, at least 1
     --> Main.lf:2:60
      |
    2 | { clock-sync-options: { period: 0, trails: 3, attenuation: 0 } }
      |                                                            ^
    ");
}

#[test]
fn spacing_policies() {
    assert_snapshot!(errors("
main reactor {
  logical action a(0, 1 s, \"dorp\")
  logical action b(0, 1 s, \"latest\")
  logical action c(0, 1 s, drop)
}
"), @r#"
    error[LF0408]: there is no spacing policy `dorp`
     --> Main.lf:3:28
      |
    3 |   logical action a(0, 1 s, "dorp")
      |                            ^^^^^^
      |
      = help: did you mean `drop`?

    error[LF0408]: there is no spacing policy `latest`
     --> Main.lf:4:28
      |
    4 |   logical action b(0, 1 s, "latest")
      |                            ^^^^^^^^
      |
      = help: write "defer", "drop", "replace" or "update"

    error[LF0408]: a spacing policy is a string
     --> Main.lf:5:28
      |
    5 |   logical action c(0, 1 s, drop)
      |                            ^^^^
      |
      = help: write "defer", "drop", "replace" or "update"
    "#);
}

#[test]
fn inputs_that_nothing_is_connected_to() {
    assert_snapshot!(warnings("
reactor Inner { input near reaction(near) {= pass =} }
reactor Detector(threshold = 1) {
  input image
  input[2] hints
  inner = new Inner()
  image -> inner.near
  reaction(image, hints) {= pass =}
}
reactor Part { input a input b reaction(a) {= pass =} reaction(b) {= pass =} }
main reactor {
  detectors = new[2] Detector()
  part = new Part()
  reaction(startup) -> part.a {= part.a.set(1) =}
}
"), @r#"
    warning[LF0505]: nothing is connected to `detectors.image` and `detectors.hints`
      --> Main.lf:12:3
       |
     8 |   reaction(image, hints) {= pass =}
       |   ---------------------- so this reaction never runs
    ...
    12 |   detectors = new[2] Detector()
       |   ^^^^^^^^^
       |
       = help: connect an output to it: `... -> detectors.image`

    warning[LF0505]: nothing is connected to `part.b`
      --> Main.lf:13:3
       |
    10 | reactor Part { input a input b reaction(a) {= pass =} reaction(b) {= pass =} }
       |                                                       ----------- so this reaction never runs
    ...
    13 |   part = new Part()
       |   ^^^^
       |
       = help: connect an output to it: `... -> part.b`
    "#);
}

#[test]
fn outputs_that_nothing_sets() {
    assert_snapshot!(warnings("
reactor Camera {
  output image
  output depth
  timer t(0, 1 s)
  reaction(t) -> image {= image = 1 =}
  reaction(t) -> depth as meters {= print(1) =} deadline(1 ms) {= print(2) =}
}
main reactor { camera = new Camera() }
"), @r#"
    warning[LF0506]: nothing sets the output `depth`
     --> Main.lf:4:10
      |
    4 |   output depth
      |          ^^^^^
    ...
    7 |   reaction(t) -> depth as meters {= print(1) =} deadline(1 ms) {= print(2) =}
      |   ------------------------------ this names it as an effect
      |
      = help: call `meters.set(value)` in its body
    "#);
}

#[test]
fn what_has_no_effect_says_so() {
    assert_snapshot!(warnings("{ logging: debug, scheduler: STATIC }
main reactor { reaction(startup) {= pass =} }
"), @r#"
    warning[LF0606]: `logging: debug` has no effect yet
     --> Main.lf:1:17
      |
    1 | target Python { logging: debug, scheduler: STATIC }
      |                 ^^^^^^^
      |
      = help: warnings and errors are always shown, and nothing else is

    warning[LF0606]: `scheduler: STATIC` has no effect here
     --> Main.lf:1:33
      |
    1 | target Python { logging: debug, scheduler: STATIC }
      |                                 ^^^^^^^^^
      |
      = help: there is one scheduler; `GEDF_NP` lets it prefer reactions with earlier deadlines
    "#);
}

#[test]
fn a_slip_in_a_property() {
    assert_snapshot!(errors_in(&[("Main.lf", "target Python { timout: 300 ms }\nmain reactor { }")]), @r#"
    error[LF0609]: there is no target property `timout`
     --> Main.lf:1:17
      |
    1 | target Python { timout: 300 ms }
      |                 ^^^^^^
      |
      = help: did you mean `timeout`?
    "#);
}

/// Of these files, one is there besides the program.
struct Folder(&'static str);

impl hprm_lf::SourceLoader for Folder {
    fn load(&mut self, _path: &str) -> Result<String, String> {
        Ok(self.0.to_owned())
    }

    fn list(&mut self, folder: &str) -> Vec<String> {
        assert_eq!(folder, "src/lib");
        vec!["helper.py".to_owned()]
    }

    fn exists(&mut self, path: &str) -> bool {
        path == "src/lib/helper.py"
    }
}

#[test]
fn files_that_are_not_there() {
    let text = "target Python {
  files: [lib/helper.py, \"lib/helpr.py\"],
  protobufs: \"lib/message.proto\"
}
main reactor { }";
    let failure =
        hprm_lf::compile("src/Main.lf", &mut Folder(text)).expect_err("a file is missing");
    assert_snapshot!(failure.to_string(), @r#"
    warning[LF0610]: there is no file `src/lib/helpr.py`
     --> src/Main.lf:2:26
      |
    2 |   files: [lib/helper.py, "lib/helpr.py"],
      |                          ^^^^^^^^^^^^^^
      |
      = help: did you mean `helper.py`?

    error[LF0611]: there is no file `src/lib/message.proto`
     --> src/Main.lf:3:14
      |
    3 |   protobufs: "lib/message.proto"
      |              ^^^^^^^^^^^^^^^^^^^
      |
      = help: the path is relative to the file that states it
    "#);
}
