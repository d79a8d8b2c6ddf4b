//! What a reactor inherits, in which order, and what people read when that cannot be.

use crate::common::{compile_files, compile_text, errors, errors_in};
use insta::assert_snapshot;

/// The reactions of the class `name`, by their text.
fn reactions(compiled: &hprm_model::Compiled, name: &str) -> Vec<String> {
    let class = compiled.classes.iter().find(|class| class.name == name).expect("it is used");
    class.reactions.iter().map(|reaction| reaction.code.as_ref().unwrap().text.clone()).collect()
}

#[test]
fn superclasses_come_first_each_once() {
    let compiled = compile_text(
        "
reactor D { reaction(startup) {= d =} }
reactor C extends D { reaction(startup) {= c =} }
reactor B extends D { reaction(startup) {= b =} }
reactor A extends B, C { reaction(startup) {= a =} }
main reactor { x = new A() }
",
    );
    assert_eq!(reactions(&compiled, "A"), ["d", "b", "c", "a"]);
    assert_eq!(compiled.classes.len(), 2, "superclasses have no instances");
}

#[test]
fn every_kind_of_member_is_inherited() {
    let compiled = compile_text(
        "
reactor Inner { output out  reaction(startup) -> out {= 0 =} }
reactor Base(n = 2) {
  preamble {= import math =}
  state count = n
  method f(x) {= return x =}
  input[n] inp
  output out
  timer t(1 s)
  logical action a
  inner = new Inner()
  inner.out -> out
  initial mode One { reaction(t) -> a, reset(Two) {= 1 =} }
  mode Two { reaction(a) -> history(One) {= 2 =} }
}
reactor Derived(m = 1) extends Base { reaction(inp, a) {= 3 =} }
main reactor { d = new Derived(n = 3)  e = new[3] Inner()  e.out -> d.inp }
",
    );
    let class = compiled.classes.iter().find(|class| class.name == "Derived").expect("used");
    let parameters: Vec<_> = class.parameters.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(parameters, ["n", "m"]);
    assert_eq!(class.preambles[0].text, "import math");
    assert_eq!((class.state[0].name.as_str(), class.methods[0].name.as_str()), ("count", "f"));
    assert_eq!(reactions(&compiled, "Derived"), ["1", "2", "3"]);
    let program = &compiled.program;
    let named = |port| program.port_name(port);
    let connections: Vec<_> = program
        .connections
        .values()
        .map(|c| format!("{} {}", named(c.from), named(c.to)))
        .collect();
    assert!(connections.contains(&"Main.d.inner.out Main.d.out".to_owned()), "{connections:?}");
    assert!(connections.contains(&"Main.e[2].out Main.d.inp[2]".to_owned()), "{connections:?}");
    assert_eq!((program.modes.len(), program.timers.len(), program.actions.len()), (2, 1, 1));
}

#[test]
fn the_most_derived_default_wins() {
    let compiled = compile_text(
        "
reactor A(x = 0, y = 1) { input[x] inp  state z = 5  method f() {= return 1 =} }
reactor B(x = 1) extends A { }
reactor C(w = 7, x = 3) extends B { state z = 6  method f() {= return 2 =} }
main reactor { c = new C() }
",
    );
    let class = compiled.classes.iter().find(|class| class.name == "C").expect("used");
    let parameters: Vec<_> =
        class.parameters.iter().map(|p| (p.name.as_str(), p.default.clone())).collect();
    let int = hprm_model::Value::Int;
    assert_eq!(parameters, [("x", int(3)), ("y", int(1)), ("w", int(7))]);
    // Python sets and defines them in this order, so the last one counts.
    assert_eq!(class.state.last().and_then(|state| state.init.clone()), Some(int(6)));
    assert_eq!(class.methods.last().unwrap().code.as_ref().unwrap().text, "return 2");
    assert_eq!(compiled.program.ports.len(), 3);
}

#[test]
fn inherited_bodies_keep_their_file_and_names_their_meaning() {
    let files = [
        (
            "Main.lf",
            "target Python
import Base as Root from \"lib/Base.lf\"
reactor Part { }
reactor Derived extends Root { reaction(startup) {= own =} }
main reactor { d = new Derived()  p = new Part() }",
        ),
        (
            "lib/Base.lf",
            "target Python
preamble {= at_file_level =}
reactor Part { output out }
reactor Base { part = new Part()
  reaction(part.out) {= inherited =} }",
        ),
    ];
    let compiled = compile_files(&files).unwrap_or_else(|failure| panic!("{failure}"));
    let class = compiled.classes.iter().find(|class| class.name == "Derived").expect("used");
    let place = |index: usize| {
        let reaction = &class.reactions[index];
        assert_eq!(reaction.file, reaction.code.as_ref().unwrap().file);
        (compiled.sources.path(reaction.file), reaction.line)
    };
    assert_eq!(place(0), ("lib/Base.lf", 5));
    assert_eq!(place(1), ("Main.lf", 4));
    assert_eq!(compiled.preambles[0].text, "at_file_level");
    assert_eq!(compiled.program.ports.len(), 1, "`Part` is that of the file that says so");
    assert!(compiled.warnings.is_empty(), "extending is using");
}

#[test]
fn cycles_and_unknown_superclasses() {
    assert_snapshot!(errors("
reactor A extends B { }
reactor B extends A { }
reactor C extends Missing { }
reactor D extends Program { reaction(nothing) {= pass =} }
main reactor Program extends D { }
"), @r#"
    error[LF0216]: `A` inherits from itself
     --> Main.lf:2:19
      |
    2 | reactor A extends B { }
      |                   ^
      |
      = help: remove one `extends` of the cycle

    error[LF0301]: there is no reactor `Missing`
     --> Main.lf:4:19
      |
    4 | reactor C extends Missing { }
      |                   ^^^^^^^
      |
      = help: reactors: `A`, `B`, `C`, `D`, `Program`

    error[LF0307]: `Program` is a main reactor: it cannot be extended
     --> Main.lf:5:19
      |
    5 | reactor D extends Program { reaction(nothing) {= pass =} }
      |                   ^^^^^^^
      |
      = help: put what both share into a reactor of its own

    error[LF0213]: the main reactor `Program` does not have the name of its file
     --> Main.lf:6:14
      |
    6 | main reactor Program extends D { }
      |              ^^^^^^^
      |
      = help: remove the name, or change it to `Main`
    "#);
}

#[test]
fn a_name_that_is_inherited_already() {
    assert_snapshot!(errors("
reactor A { input x  logical action go  method f() {= pass =} }
reactor B extends A { output x  timer go  state f = 0 }
reactor C { input y }
reactor D { output y }
reactor E extends C, D { }
main reactor { }
"), @r#"
    error[LF0217]: the name `x` is inherited already
     --> Main.lf:3:30
      |
    2 | reactor A { input x  logical action go  method f() {= pass =} }
      |                   - declared here
    3 | reactor B extends A { output x  timer go  state f = 0 }
      |                              ^
      |
      = help: choose another name; only parameters, state variables and methods can be declared again, as the same kind of thing

    error[LF0217]: the name `go` is inherited already
     --> Main.lf:3:39
      |
    2 | reactor A { input x  logical action go  method f() {= pass =} }
      |                                     -- declared here
    3 | reactor B extends A { output x  timer go  state f = 0 }
      |                                       ^^
      |
      = help: choose another name; only parameters, state variables and methods can be declared again, as the same kind of thing

    error[LF0217]: the name `f` is inherited already
     --> Main.lf:3:49
      |
    2 | reactor A { input x  logical action go  method f() {= pass =} }
      |                                                - declared here
    3 | reactor B extends A { output x  timer go  state f = 0 }
      |                                                 ^
      |
      = help: choose another name; only parameters, state variables and methods can be declared again, as the same kind of thing

    error[LF0217]: two superclasses of this reactor declare `y`
     --> Main.lf:6:1
      |
    4 | reactor C { input y }
      |                   - declared here
    5 | reactor D { output y }
      |                    - and here
    6 | reactor E extends C, D { }
      | ^^^^^^^^^^^^^^^^^^^^^^
      |
      = help: choose another name; only parameters, state variables and methods can be declared again, as the same kind of thing
    "#);
}

#[test]
fn what_is_wrong_inside_is_said_once_where_it_stands() {
    let base = "target Python
reactor Base { reaction(nothing) {= pass =} }";
    let main = "target Python
import Base from \"Base.lf\"
reactor A extends Base { }
reactor B extends Base { }
main reactor { a = new A()  b = new B() }";
    assert_snapshot!(errors_in(&[("Main.lf", main), ("Base.lf", base)]), @r#"
    error[LF0303]: there is no `nothing` in this reactor
     --> Base.lf:2:25
      |
    2 | reactor Base { reaction(nothing) {= pass =} }
      |                         ^^^^^^^
      |
      = help: names that fit here: `startup`, `shutdown`
    "#);
}

#[test]
fn a_subclass_may_not_contain_itself_through_its_superclass() {
    assert_snapshot!(errors("
reactor A { b = new B() }
reactor B extends A { }
main reactor { b = new B() }
"), @r#"
    error[LF0308]: `B` contains itself, without end
     --> Main.lf:2:21
      |
    2 | reactor A { b = new B() }
      |                     ^
    "#);
}

#[test]
fn a_cycle_is_reported_once_however_many_classes_are_in_it_or_below() {
    assert_snapshot!(errors("
reactor D extends C { }
reactor C extends B { }
reactor A extends C { }
reactor B extends A { }
main reactor { d = new D() }
"), @r#"
    error[LF0216]: `C` inherits from itself
     --> Main.lf:3:19
      |
    3 | reactor C extends B { }
      |                   ^
      |
      = help: remove one `extends` of the cycle
    "#);
}

#[test]
fn a_long_line_of_ancestors_is_refused() {
    let storey = |i: usize| format!("reactor A{} extends A{i} {{ }}\n", i + 1);
    let storeys: String = (0..2_000).map(storey).collect();
    let text = format!("target Python reactor A0 {{ }} {storeys} main reactor {{ }}");
    let failure = compile_files(&[("Main.lf", &text)]).expect_err("too long");
    let [diagnostic] = failure.diagnostics.as_slice() else { panic!("{failure}") };
    assert_eq!(diagnostic.code, "LF0406");
    let line = failure.sources.position(diagnostic.span).line;
    assert_eq!(line, 101, "A101 is the first one with more than a hundred ancestors");
    // A class that does so directly, and in a cycle.
    let many = "A, ".repeat(200);
    let text = format!("target Python reactor A extends {many} A {{ }} main reactor {{ }}");
    let failure = compile_files(&[("Main.lf", &text)]).expect_err("too many");
    assert!(failure.diagnostics.iter().any(|diagnostic| diagnostic.code == "LF0406"));
}
