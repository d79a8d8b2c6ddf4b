//! What people read when reactors are wrong: names, references, parameters.

use crate::common::errors;
use insta::assert_snapshot;

#[test]
fn an_unknown_reactor() {
    assert_snapshot!(errors("
reactor Camera { output frame }
main reactor {
  c = new Camara()
  c.frame -> c.other
}
"), @r#"
    error[LF0301]: there is no reactor `Camara`
     --> Main.lf:4:11
      |
    4 |   c = new Camara()
      |           ^^^^^^
      |
      = help: did you mean `Camera`?
    "#);
}

#[test]
fn an_unknown_port_and_an_unknown_instance() {
    assert_snapshot!(errors("
reactor A { input inp output out }
main reactor {
  a = new A()
  b = new A()
  a.out -> b.imp
  a.out -> c.inp
}
"), @r#"
    error[LF0304]: `A` has no port `imp`
     --> Main.lf:6:14
      |
    6 |   a.out -> b.imp
      |              ^^^
      |
      = help: did you mean `inp`?

    error[LF0302]: there is no instance `c` in this reactor
     --> Main.lf:7:12
      |
    7 |   a.out -> c.inp
      |            ^
      |
      = help: instances: `a`, `b`
    "#);
}

#[test]
fn an_unknown_trigger() {
    assert_snapshot!(errors("
reactor A {
  input frame
  logical action retry
  reaction(frmae) {= pass =}
  reaction(nothing_like_it) {= pass =}
}
main reactor { a = new A() reaction(a) {= pass =} }
"), @r#"
    error[LF0303]: there is no `frmae` in this reactor
     --> Main.lf:5:12
      |
    5 |   reaction(frmae) {= pass =}
      |            ^^^^^
      |
      = help: did you mean `frame`?

    error[LF0303]: there is no `nothing_like_it` in this reactor
     --> Main.lf:6:12
      |
    6 |   reaction(nothing_like_it) {= pass =}
      |            ^^^^^^^^^^^^^^^
      |
      = help: names that fit here: `frame`, `retry`, `startup`, `shutdown`

    error[LF0303]: the instance `a` cannot be a trigger
     --> Main.lf:8:37
      |
    8 | main reactor { a = new A() reaction(a) {= pass =} }
      |                                     ^
      |
      = help: only a port of it could, and it has none that fits
    "#);
}

#[test]
fn the_wrong_direction() {
    assert_snapshot!(errors("
reactor A {
  input inp
  output out
  timer t
  reaction(out) -> inp {= pass =}
  reaction(inp) t {= pass =}
}
main reactor {
  a = new A()
  reaction(a.inp) -> a.out {= pass =}
  a.inp -> a.out
}
"), @r#"
    error[LF0305]: the output `out` cannot be a trigger
     --> Main.lf:6:12
      |
    6 |   reaction(out) -> inp {= pass =}
      |            ^^^
      |
      = help: a reactor reads its own inputs and the outputs of its instances

    error[LF0305]: the input `inp` cannot be an effect
     --> Main.lf:6:20
      |
    6 |   reaction(out) -> inp {= pass =}
      |                    ^^^
      |
      = help: a reactor sets its own outputs and the inputs of its instances

    error[LF0305]: the timer `t` cannot be a source
     --> Main.lf:7:17
      |
    7 |   reaction(inp) t {= pass =}
      |                 ^
      |
      = help: a timer can only trigger a reaction

    error[LF0305]: the contained input `a.inp` cannot be a trigger
      --> Main.lf:11:12
       |
    11 |   reaction(a.inp) -> a.out {= pass =}
       |            ^^^^^
       |
       = help: a reactor reads its own inputs and the outputs of its instances

    error[LF0305]: the contained output `a.out` cannot be an effect
      --> Main.lf:11:22
       |
    11 |   reaction(a.inp) -> a.out {= pass =}
       |                      ^^^^^
       |
       = help: a reactor sets its own outputs and the inputs of its instances

    error[LF0305]: this connection is the wrong way round
      --> Main.lf:12:3
       |
    12 |   a.inp -> a.out
       |   ^^^^^^^^^^^^^^
       |
       = help: write `a.out -> a.inp`
    "#);
}

#[test]
fn a_missing_body() {
    assert_snapshot!(errors("
reactor A { input inp output out }
main reactor {
  a = new A()
  reaction(startup);
  a.out -> a.inp
}
"), @r#"
    error[LF0210]: this reaction has no body
     --> Main.lf:5:3
      |
    5 |   reaction(startup);
      |   ^^^^^^^^^^^^^^^^^
      |
      = help: write `{= ... =}` behind it; `{= pass =}` does nothing
    "#);
}

#[test]
fn duplicate_names() {
    assert_snapshot!(errors("
reactor A(x = 1) {
  state x = 2
  input p
  output p
}
reactor A { }
main reactor { }
"), @r#"
    error[LF0201]: `A` is already a reactor of this file
     --> Main.lf:7:9
      |
    2 | reactor A(x = 1) {
      |         - first here
    ...
    7 | reactor A { }
      |         ^
    "#);
    assert_snapshot!(errors("
reactor A(x = 1) {
  state x = 2
  input p
  logical action p
}
main reactor {
  a = new A()
  a = new A()
}
"), @r#"
    error[LF0201]: the name `x` is already taken
     --> Main.lf:3:9
      |
    2 | reactor A(x = 1) {
      |           - taken here
    3 |   state x = 2
      |         ^

    error[LF0201]: the name `p` is already taken
     --> Main.lf:5:18
      |
    4 |   input p
      |         - taken here
    5 |   logical action p
      |                  ^

    error[LF0201]: the name `a` is already taken
     --> Main.lf:9:3
      |
    8 |   a = new A()
      |   - taken here
    9 |   a = new A()
      |   ^
    "#);
}

#[test]
fn types_and_names_that_python_does_not_bear() {
    assert_snapshot!(errors("
reactor A(x: int = 1) {
  input inp: int
  state lambda: float[3] = 0
}
main reactor { a = new A() }
"), @r#"
    error[LF0202]: types are not allowed in the Python target
     --> Main.lf:2:12
      |
    2 | reactor A(x: int = 1) {
      |            ^^^^^
      |
      = help: remove the type: every value is a Python object

    error[LF0202]: types are not allowed in the Python target
     --> Main.lf:3:12
      |
    3 |   input inp: int
      |            ^^^^^
      |
      = help: remove the type: every value is a Python object

    error[LF0208]: `lambda` is a keyword of Python
     --> Main.lf:4:9
      |
    4 |   state lambda: float[3] = 0
      |         ^^^^^^
      |
      = help: choose another name

    error[LF0202]: types are not allowed in the Python target
     --> Main.lf:4:15
      |
    4 |   state lambda: float[3] = 0
      |               ^^^^^^^^^^
      |
      = help: remove the type: every value is a Python object
    "#);
}

#[test]
fn parameters() {
    assert_snapshot!(errors("
reactor A(gain = 1, offset, other = gain) { state s = gian }
main reactor { a = new A(gani = 2, gain = 1, gain = 3) }
"), @r#"
    error[LF0203]: the parameter `offset` has no default value
     --> Main.lf:2:21
      |
    2 | reactor A(gain = 1, offset, other = gain) { state s = gian }
      |                     ^^^^^^
      |
      = help: write `offset = value`

    error[LF0203]: a default cannot be a parameter, `gain`
     --> Main.lf:2:37
      |
    2 | reactor A(gain = 1, offset, other = gain) { state s = gian }
      |                                     ^^^^
      |
      = help: write the value; where instances are made, parameters may be used

    error[LF0306]: there is no parameter `gian`
     --> Main.lf:2:55
      |
    2 | reactor A(gain = 1, offset, other = gain) { state s = gian }
      |                                                       ^^^^
      |
      = help: did you mean `gain`?

    error[LF0306]: `A` has no parameter `gani`
     --> Main.lf:3:26
      |
    3 | main reactor { a = new A(gani = 2, gain = 1, gain = 3) }
      |                          ^^^^
      |
      = help: did you mean `gain`?

    error[LF0201]: `gain` is assigned twice
     --> Main.lf:3:46
      |
    3 | main reactor { a = new A(gani = 2, gain = 1, gain = 3) }
      |                                              ^^^^
    "#);
}

#[test]
fn main_reactors() {
    assert_snapshot!(errors("
main reactor { }
main reactor Other { }
"), @r#"
    error[LF0205]: a file has one main or federated reactor
     --> Main.lf:3:1
      |
    2 | main reactor { }
      | ------------ the first one
    3 | main reactor Other { }
      | ^^^^^^^^^^^^^^^^^^
      |
      = help: make one of the two a plain reactor
    "#);
    assert_snapshot!(errors("
main reactor { input inp }
"), @r#"
    error[LF0207]: the main reactor cannot have ports: nothing contains it
     --> Main.lf:2:22
      |
    2 | main reactor { input inp }
      |                      ^^^
      |
      = help: what comes from outside of the program is a physical action
    "#);
    assert_snapshot!(errors("
reactor A { }
"), @r#"
    error[LF0206]: this file has no main reactor
     --> Main.lf:1:1
      |
    1 | target Python
      | ^
      |
      = help: write `main reactor { ... }` or `federated reactor { ... }`
    "#);
    assert_snapshot!(errors("
main reactor Main { m = new Main() }
"), @r#"
    error[LF0307]: `Main` is a main reactor: it cannot be instantiated
     --> Main.lf:2:29
      |
    2 | main reactor Main { m = new Main() }
      |                             ^^^^
      |
      = help: put what both need into a plain reactor
    "#);
    assert_snapshot!(errors("
reactor { }
main reactor { }
"), @r#"
    error[LF0204]: only a main reactor can do without a name
     --> Main.lf:2:1
      |
    2 | reactor { }
      | ^^^^^^^
      |
      = help: name it, or write `main reactor` or `federated reactor`
    "#);
}

#[test]
fn reactions_name_a_thing_once() {
    assert_snapshot!(errors("
reactor A { output out input b }
main reactor {
  a = new A()
  logical action b
  reaction(a.out) a.out -> b {= pass =}
  reaction(interleaved(a.out)) {= pass =}
}
"), @r#"
    error[LF0309]: `a.out` is already a trigger
     --> Main.lf:6:19
      |
    6 |   reaction(a.out) a.out -> b {= pass =}
      |                   ^^^^^
      |
      = help: remove it here: a trigger can be read as well

    error[LF0310]: `interleaved` belongs to connections
     --> Main.lf:7:12
      |
    7 |   reaction(interleaved(a.out)) {= pass =}
      |            ^^^^^^^^^^^^^^^^^^
      |
      = help: `interleaved` orders the channels of `bank.multiport` in a connection
    "#);
    assert_snapshot!(errors("
reactor A { output out }
main reactor {
  a = new A()
  logical action a
  reaction(a, a.out) {= pass =}
}
"), @r#"
    error[LF0215]: two things are called `a` in this reaction
     --> Main.lf:6:3
      |
    6 |   reaction(a, a.out) {= pass =}
      |   ^^^^^^^^^^^^^^^^^^
      |
      = help: rename the instance, the port, the action or the mode
    "#);
}
