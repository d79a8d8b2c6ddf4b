//! What people read when a file cannot be understood: its text, its imports, its target, and what
//! is not supported.

use crate::common::{errors, errors_in};
use insta::assert_snapshot;

#[test]
fn several_syntax_errors_in_one_go() {
    assert_snapshot!(errors("
reactor A {
  input
  output out
  timer t(0, 1 s
  reaction(t) -> out {= out.set(1) =}
}
main reactor {
  a = new A(
  b = new A()
  a.out b.out
}
"), @r#"
    error[LF0003]: expected the name of a port, found `output`
     --> Main.lf:4:3
      |
    4 |   output out
      |   ^^^^^^

    error[LF0003]: expected `)`, found `reaction`
     --> Main.lf:6:3
      |
    6 |   reaction(t) -> out {= out.set(1) =}
      |   ^^^^^^^^

    error[LF0003]: expected `)`, found `A`
      --> Main.lf:10:11
       |
    10 |   b = new A()
       |           ^
    "#);
}

#[test]
fn misspelled_keywords() {
    assert_snapshot!(errors("
raector A { }
main reactor {
  timr t(0, 1 s)
  recation(startup) {= pass =}
}
"), @r#"
    error[LF0003]: expected `target`, `import`, `preamble` or `reactor`, found `raector`
     --> Main.lf:2:1
      |
    2 | raector A { }
      | ^^^^^^^
      |
      = help: did you mean `reactor`?

    error[LF0003]: expected `->` or `~>`, found `t`
     --> Main.lf:4:8
      |
    4 |   timr t(0, 1 s)
      |        ^
      |
      = help: did you mean `timer`?
    "#);
}

#[test]
fn text_outside_the_language() {
    assert_snapshot!(errors("
main reactor {
  print(§)
}
"), @r#"
    error[LF0003]: expected `->` or `~>`, found `(`
     --> Main.lf:3:8
      |
    3 |   print(§)
      |        ^
      |
      = help: Python code belongs into the body of a reaction: `reaction(startup) {= ... =}`

    error[LF0001]: `§` means nothing here
     --> Main.lf:3:9
      |
    3 |   print(§)
      |         ^
      |
      = help: Python code belongs between `{=` and `=}`
    "#);
}

#[test]
fn a_body_without_end() {
    assert_snapshot!(errors("
main reactor {
  reaction(startup) {=
    print(1)
}
"), @r#"
    error[LF0002]: this code body has no end
     --> Main.lf:3:21
      |
    3 |   reaction(startup) {=
      |                     ^^
      |
      = help: close it with `=}`
    "#);
}

/// Everything around such a body is understood, whatever was written in place of its end.
#[test]
fn a_body_without_end_among_others() {
    let text = |end: &str| {
        format!(
            "
reactor Source {{
  output out
  timer t(0, 1 s)
  reaction(t) -> out {{=
    values = {{
      1: 2,
    }}
    out.set(f\"{{values=}}\")
  {end}
  reaction(startup) {{= pass =}}
}}
main reactor {{
  source = new Source()
  x = new Missing()
}}
"
        )
    };
    let first = errors(&text(""));
    assert_snapshot!(first, @r#"
    error[LF0002]: this code body has no end
      --> Main.lf:5:22
       |
     5 |   reaction(t) -> out {=
       |                      ^^
    ...
    11 |   reaction(startup) {= pass =}
       |                     -- the next one begins before that
       |
       = help: close it with `=}`
    "#);
    for other in ["}", "= }"] {
        let found = errors(&text(other));
        let title = |text: &str| text.lines().next().map(str::to_owned);
        assert_eq!(title(&found), title(&first), "{other}");
        assert_eq!(found.matches("error[").count(), 1, "{other}: {found}");
    }
}

#[test]
fn the_last_body_of_a_reactor_without_end() {
    assert_snapshot!(errors("
reactor Source {
  output out
  reaction(startup) -> out {=
    out.set(1)
}
reactor Sink { input inp }
main reactor {
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
  reaction(sink.nothing) {= pass =}
}
"), @r#"
    error[LF0002]: this code body has no end
      --> Main.lf:4:28
       |
     4 |   reaction(startup) -> out {=
       |                            ^^
    ...
    12 |   reaction(sink.nothing) {= pass =}
       |                          -- the next one begins before that
       |
       = help: close it with `=}`
    "#);
}

#[test]
fn a_reactor_without_end() {
    assert_snapshot!(errors("
main reactor {
  state x = 1
"), @r#"
    error[LF0003]: expected `}`, found the end of the file
     --> Main.lf:3:15
      |
    2 | main reactor {
      |              - to close this brace
    3 |   state x = 1
      |              ^
    "#);
}

#[test]
fn a_missing_import() {
    assert_snapshot!(errors("
import Gain from \"lib/Gain.lf\"
main reactor { g = new Gain() }
"), @r#"
    error[LF0101]: cannot read `lib/Gain.lf`: no such file
     --> Main.lf:2:18
      |
    2 | import Gain from "lib/Gain.lf"
      |                  ^^^^^^^^^^^^^
      |
      = help: the path is relative to the file that imports
    "#);
}

#[test]
fn a_reactor_that_the_imported_file_lacks() {
    let library = "target Python\nreactor Gain { } reactor Sum { }";
    let main = "target Python\nimport Gian from \"lib/Gain.lf\"\nmain reactor { }";
    assert_snapshot!(errors_in(&[("Main.lf", main), ("lib/Gain.lf", library)]), @r#"
    error[LF0102]: `lib/Gain.lf` has no reactor `Gian` to import
     --> Main.lf:2:8
      |
    2 | import Gian from "lib/Gain.lf"
      |        ^^^^
      |
      = help: did you mean `Gain`?
    "#);
}

#[test]
fn errors_in_an_imported_file_name_it() {
    let library = "target Python\nreactor Gain { input }";
    let main = "target Python\nimport Gain from \"lib/Gain.lf\"\nmain reactor { g = new Gain() }";
    assert_snapshot!(errors_in(&[("Main.lf", main), ("lib/Gain.lf", library)]), @r#"
    error[LF0003]: expected the name of a port, found `}`
     --> lib/Gain.lf:2:22
      |
    2 | reactor Gain { input }
      |                      ^
    "#);
}

#[test]
fn a_wrong_unit_of_time() {
    assert_snapshot!(errors("
main reactor {
  timer t(0, 10 millis)
}
"), @r#"
    error[LF0401]: `millis` is not a unit of time
     --> Main.lf:3:17
      |
    3 |   timer t(0, 10 millis)
      |                 ^^^^^^
      |
      = help: units: ns, us, ms, s, min, hour, day, week
    "#);
}

#[test]
fn watchdogs_are_not_supported() {
    assert_snapshot!(errors("
reactor Base { output out }
reactor Modal {
  watchdog w(1 s) {= pass =}
}
main reactor {
  d = new Base()
  m = new Modal()
  reaction(d.out) {= pass =}
}
"), @r#"
    error[LF0701]: watchdogs are not supported yet
     --> Main.lf:4:12
      |
    4 |   watchdog w(1 s) {= pass =}
      |            ^
      |
      = help: use a physical action, or a deadline
    "#);
}

#[test]
fn mutations_are_not_supported() {
    assert_snapshot!(errors("
main reactor {
  logical action a
  action b
  mutation(a) {= pass =}
}
"), @r#"
    error[LF0209]: the action `b` is neither logical nor physical
     --> Main.lf:4:10
      |
    4 |   action b
      |          ^
      |
      = help: write `logical action` or `physical action`
    "#);
}

/// The messages and hints for a federation in which attributes stand before its connection and its instance.
fn of_attributes(connection: &str, instance: &str) -> String {
    let text = format!(
        "reactor A {{ input i output o }}\nfederated reactor {{\n{instance} a = new A()\nb = new A()\n\
         {connection}\na.o ~> b.i\n}}"
    );
    let text = format!("target Python\n{text}");
    let said = match hprm_lf::check("Main.lf", &mut |_: &str| Ok(text.clone())) {
        Ok(_) => return String::new(),
        Err(failure) => hprm_model::render_all(&failure.diagnostics, &failure.sources, false),
    };
    let told = |line: &&str| line.starts_with("error") || line.contains("= help");
    let lines: Vec<_> = said.lines().filter(told).map(str::trim).collect();
    lines.join("\n")
}

#[test]
fn a_federate_is_started_again_in_the_words_of_systemd() {
    for right in
        ["\"on-failure\"", "\"on-abnormal\", 0, 1, 0", "condition=\"always\", interval=1 h"]
    {
        assert_eq!(of_attributes("", &format!("@transient @restart({right})")), "", "{right}");
    }
    assert_eq!(of_attributes("", "@restart(\"no\")"), "");
    assert_eq!(
        of_attributes("", "@restart(\"on-failure\")"),
        "error[LF0212]: `@restart` belongs to a transient federate, and this one is not\n\
         = help: write `@transient`, too, if the others are to go on while it is away"
    );
    let said = |arguments: &str| of_attributes("", &format!("@transient @restart{arguments}"));
    let hint = "\n= help: write `@restart(\"on-failure\", sec=100 ms, burst=5, interval=10 s)`, without what is to be \
                as systemd has it";
    for (wrong, message) in [
        ("", "`@restart` needs a condition, in double quotes"),
        ("(5)", "`@restart` needs a condition, in double quotes"),
        ("(sec=1 s)", "`@restart` needs a condition, in double quotes"),
        (
            "(\"always\", sec=-1 s)",
            "the pause of `@restart`, `sec`, must be a time that is not negative",
        ),
        (
            "(\"always\", sec=5)",
            "the pause of `@restart`, `sec`, must be a time that is not negative",
        ),
        (
            "(\"always\", sec=forever)",
            "the pause of `@restart`, `sec`, must be a time that is not negative",
        ),
        (
            "(\"always\", interval=-1 s)",
            "the `interval` of `@restart` must be a time that is not negative",
        ),
        (
            "(\"always\", burst=0)",
            "the `burst` of `@restart` must be a number from 1 to 4294967295",
        ),
    ] {
        assert_eq!(said(wrong), format!("error[LF0212]: {message}{hint}"), "{wrong}");
    }
    let unknown = "error[LF0212]: `@restart` has no condition `on-failre`\n= help: did you mean `on-failure`?";
    assert_eq!(said("(\"on-failre\")"), unknown);
    assert!(said("(\"always\", pause=1 s)").contains("`@restart` has no argument `pause`"));
    assert!(said("(\"always\", 0, 1, 0, 0)").contains("takes a condition, a pause and a limit"));
}

#[test]
fn the_arguments_of_attributes_have_names_and_limits() {
    let none = [
        ("@bound(3)", ""),
        ("@bound(n=3, policy=\"replace\")", ""),
        ("@bound(policy=\"drop\", n=3)", ""),
        (
            "@bound(3, policy=\"drop\")",
            "@maxwait(value=1 s) @layout(option=\"a\", value=\"b\") @layout(option=\"c\", value=\"d\")",
        ),
        ("@absent_after(value=1 s)", "@transient @side(value=\"east\")"),
    ];
    for (connection, instance) in none {
        assert_eq!(of_attributes(connection, instance), "", "{connection} {instance}");
    }
    assert_snapshot!(of_attributes("@bound(n=2, polcy=\"drop\")", "@maxwait(time=1 s)"), @r"
    error[LF0212]: `@maxwait` has no argument `time`
    = help: its arguments: `value`
    error[LF0212]: `@bound` has no argument `polcy`
    = help: did you mean `policy`?
    ");
    assert_snapshot!(of_attributes("@bound(2, \"replac\")", "@transient(value=1)"), @r"
    error[LF0212]: `@transient` has no argument `value`
    = help: its arguments: there are none
    error[LF0212]: `@bound` has no policy `replac`
    = help: did you mean `replace`?
    ");
    assert_snapshot!(of_attributes("@bound(9999999999)", "@side(sid=\"east\")"), @r#"
    error[LF0212]: `@side` has no argument `sid`
    = help: its arguments: `value`
    error[LF0212]: the number of messages of `@bound` must be from 1 to 4294967295
    = help: write `@bound(10, "replace")`, "drop" to keep the first 10, or "block" to make the sender wait
    "#);
    assert_snapshot!(of_attributes("@bound(99999999999999999999)", ""), @r"
    error[LF0005]: this number is too large
    = help: whole numbers have 64 bits; the value of a parameter or state variable may be larger, as `{= ... =}`
    ");
    assert_snapshot!(of_attributes("@bound(2, n=3)", "@layout(option=\"a\", option=\"b\")"), @r"
    error[LF0212]: the argument `option` is stated twice
    error[LF0212]: the argument `n` is stated twice
    ");
    assert_snapshot!(of_attributes("@bound(2) @Bound(3)", "@maxwait(1 s) @maxwait(1 s)"), @r"
    error[LF0212]: `@maxwait` is stated twice
    = help: remove one of the two
    error[LF0212]: `@bound` is stated twice
    = help: remove one of the two
    ");
    assert_snapshot!(of_attributes("@absent_after(1 s) @absent_after(2 s)", "@transient @transient"), @r"
    error[LF0212]: `@transient` is stated twice
    = help: remove one of the two
    error[LF0212]: `@absent_after` is stated twice
    = help: remove one of the two
    ");
}

#[test]
fn attributes() {
    assert_snapshot!(errors("
@label(\"fine\")
reactor A {
  @maxwait(1 s)
  input inp
  @lable(\"wrong\")
  output out
}
main reactor {
  @transient
  a = new A()
}
"), @r#"
    error[LF0212]: `@maxwait` does not belong here
     --> Main.lf:4:3
      |
    4 |   @maxwait(1 s)
      |   ^^^^^^^^^^^^^
      |
      = help: it belongs to an instance of a federated reactor

    error[LF0211]: there is no attribute `@lable`
     --> Main.lf:6:3
      |
    6 |   @lable("wrong")
      |   ^^^^^^^^^^^^^^^
      |
      = help: did you mean `label`?

    error[LF0212]: `@transient` does not belong here
      --> Main.lf:10:3
       |
    10 |   @transient
       |   ^^^^^^^^^^
       |
       = help: it belongs to an instance of a federated reactor
    "#);
}

#[test]
fn federations() {
    assert_snapshot!(errors("
reactor A { }
federated reactor at localhost {
  timer t
  a = new A() at robot.local;
  reaction(t) {= pass =}
}
"), @r#"
    error[LF0801]: this belongs to no federate
     --> Main.lf:4:9
      |
    4 |   timer t
      |         ^
      |
      = help: move it into a reactor that the federated reactor instantiates

    error[LF0801]: this belongs to no federate
     --> Main.lf:6:3
      |
    6 |   reaction(t) {= pass =}
      |   ^^^^^^^^^^^
      |
      = help: move it into a reactor that the federated reactor instantiates
    "#);
    assert_snapshot!(errors("
reactor A { }
main reactor { a = new A() at robot.local; }
"), @r#"
    error[LF0802]: only an instance in a federated reactor has a host
     --> Main.lf:3:31
      |
    3 | main reactor { a = new A() at robot.local; }
      |                               ^^^^^^^^^^^
      |
      = help: write `federated reactor`, or remove `at`
    "#);
}

#[test]
fn targets() {
    assert_snapshot!(errors_in(&[("Main.lf", "target C\nmain reactor { }")]), @r#"
    error[LF0601]: the target `C` is not supported
     --> Main.lf:1:8
      |
    1 | target C
      |        ^
      |
      = help: write `target Python`
    "#);
    assert_snapshot!(errors_in(&[("Main.lf", "main reactor { }")]), @r#"
    error[LF0601]: the file does not say what its target is
     --> Main.lf:1:1
      |
    1 | main reactor { }
      | ^
      |
      = help: start it with `target Python`
    "#);
    let text = "target Python { timeout: -1 s, workers: 1001 }\nmain reactor { }";
    assert_snapshot!(errors_in(&[("Main.lf", text)]), @r#"
    error[LF0603]: `timeout` must be a time that is not negative, such as `10 s`
     --> Main.lf:1:26
      |
    1 | target Python { timeout: -1 s, workers: 1001 }
      |                          ^^^^

    error[LF0603]: `workers` must be a whole number from 0 to 1000
     --> Main.lf:1:41
      |
    1 | target Python { timeout: -1 s, workers: 1001 }
      |                                         ^^^^
    "#);
    let text = "target Python { timeout: 3, fast: yes, coordination: none }\nmain reactor { }";
    assert_snapshot!(errors_in(&[("Main.lf", text)]), @r#"
    error[LF0603]: `timeout` must be a time, such as `10 s`
     --> Main.lf:1:26
      |
    1 | target Python { timeout: 3, fast: yes, coordination: none }
      |                          ^

    error[LF0603]: `fast` must be `true` or `false`
     --> Main.lf:1:35
      |
    1 | target Python { timeout: 3, fast: yes, coordination: none }
      |                                   ^^^

    error[LF0603]: `coordination` must be `centralized` or `decentralized`
     --> Main.lf:1:54
      |
    1 | target Python { timeout: 3, fast: yes, coordination: none }
      |                                                      ^^^^
    "#);
    let text = "target Python { fast: true }\nmain reactor { physical action a }";
    assert_snapshot!(errors_in(&[("Main.lf", text)]), @r#"
    error[LF0605]: `fast` does not go together with physical actions
     --> Main.lf:1:23
      |
    1 | target Python { fast: true }
      |                       ^^^^
      |
      = help: remove `fast: true`
    "#);
}

#[test]
fn a_missing_main_file() {
    assert_snapshot!(errors_in(&[]), @r#"
    error[LF0101]: cannot read `Main.lf`: no such file
     --> Main.lf:1:1
      |
    1 |
      | ^
    "#);
}

#[test]
fn values_that_only_python_understands() {
    assert_snapshot!(errors("
main reactor {
  state names = {}
  state both = [1, {2, 3}]
  state pi = np.pi
  state made = dict()
  timer t(0, 0.5 ms)
}
"), @r"
    error[LF0006]: braces alone make no value in Python
     --> Main.lf:3:17
      |
    3 |   state names = {}
      |                 ^
      |
      = help: write a dict or a set as `{= {...} =}`, and a list as `[...]`

    error[LF0006]: braces alone make no value in Python
     --> Main.lf:4:20
      |
    4 |   state both = [1, {2, 3}]
      |                    ^
      |
      = help: write a dict or a set as `{= {...} =}`, and a list as `[...]`

    error[LF0006]: `np` begins what only Python understands
     --> Main.lf:5:14
      |
    5 |   state pi = np.pi
      |              ^^
      |
      = help: write it between `{=` and `=}`

    error[LF0006]: `dict` begins what only Python understands
     --> Main.lf:6:16
      |
    6 |   state made = dict()
      |                ^^^^
      |
      = help: write it between `{=` and `=}`

    error[LF0401]: a time is a whole number of a unit
     --> Main.lf:7:14
      |
    7 |   timer t(0, 0.5 ms)
      |              ^^^^^^
      |
      = help: write `500 us`
    ");
    assert_snapshot!(errors("
reactor A(start = None) { state nothing = None }
main reactor { a = new A() }
"), @r"
    error[LF0203]: a default cannot be a parameter, `None`
     --> Main.lf:2:19
      |
    2 | reactor A(start = None) { state nothing = None }
      |                   ^^^^
      |
      = help: a value of Python is written `{= None =}`

    error[LF0306]: there is no parameter `None`
     --> Main.lf:2:43
      |
    2 | reactor A(start = None) { state nothing = None }
      |                                           ^^^^
      |
      = help: a value of Python is written `{= None =}`
    ");
}

#[test]
fn an_attribute_before_a_broadcast_has_parentheses_of_its_own() {
    assert_snapshot!(errors("
reactor A { output out }
reactor B { input inp }
federated reactor {
  a = new A()
  b = new[2] B()
  @compress (a.out)+ -> b.inp
  @absent_after(1 s) @compress(
    a.out)+ -> b.inp
  @compress() (a.out)+ -> b.inp
}
"), @r"
    error[LF0003]: these parentheses belong to `@compress`, so no broadcast begins here
     --> Main.lf:7:13
      |
    7 |   @compress (a.out)+ -> b.inp
      |             ^^^^^^^^
      |
      = help: write `@compress() (a.out)+`

    error[LF0003]: these parentheses belong to `@compress`, so no broadcast begins here
     --> Main.lf:8:31
      |
    8 |   @absent_after(1 s) @compress(
      |                               ^
      |
      = help: write `@compress() (...)+`
    ");
}
