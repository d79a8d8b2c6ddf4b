//! What is wrong with modes, and how it is said.

use crate::common::errors;
use insta::assert_snapshot;

#[test]
fn transitions() {
    assert_snapshot!(errors("
reactor Modal {
  timer t(0, 1 s)
  initial mode One {
    reaction(t) -> reset(Too), Two, history(Two) {= pass =}
  }
  mode Two { }
  reaction(t) -> reset(Two) {= Two.set() =}
}
main reactor {
  m = new Modal()
}
"), @r#"
    error[LF0215]: two things are called `Two` in this reaction
     --> Main.lf:5:5
      |
    5 |     reaction(t) -> reset(Too), Two, history(Two) {= pass =}
      |     ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      |
      = help: rename the instance, the port, the action or the mode

    error[LF0904]: this reactor has no mode `Too`
     --> Main.lf:5:26
      |
    5 |     reaction(t) -> reset(Too), Two, history(Two) {= pass =}
      |                          ^^^
      |
      = help: did you mean `Two`?

    warning[LF0908]: the effect does not say how mode `Two` is entered; a reset is assumed
     --> Main.lf:5:32
      |
    5 |     reaction(t) -> reset(Too), Two, history(Two) {= pass =}
      |                                ^^^
      |
      = help: write `reset(Two)` or `history(Two)`

    error[LF0903]: only a reaction inside a mode can enter another one
     --> Main.lf:8:24
      |
    8 |   reaction(t) -> reset(Two) {= Two.set() =}
      |                        ^^^
      |
      = help: move the reaction into the mode from which it leads away
    "#);
}

#[test]
fn members() {
    assert_snapshot!(errors("
reactor Modal {
  initial mode One {
    input inp
    mode Two { }
    method f() {= pass =}
    timer t
  }
  initial mode { }
  mode One { timer t }
}
main reactor {
  m = new Modal()
}
"), @r#"
    error[LF0909]: a port cannot be declared in a mode
     --> Main.lf:4:11
      |
    4 |     input inp
      |           ^^^
      |
      = help: declare it in the reactor, outside modes

    error[LF0909]: another mode cannot be declared in a mode
     --> Main.lf:5:5
      |
    5 |     mode Two { }
      |     ^^^^^^^^
      |
      = help: declare it in the reactor, outside modes

    error[LF0909]: a method cannot be declared in a mode
     --> Main.lf:6:12
      |
    6 |     method f() {= pass =}
      |            ^
      |
      = help: declare it in the reactor, outside modes
    "#);
}

#[test]
fn no_initial_mode() {
    assert_snapshot!(errors("
main reactor {
  mode One { }
  mode Two { }
}
"), @r#"
    error[LF0901]: none of the modes is the initial one
     --> Main.lf:3:3
      |
    3 |   mode One { }
      |   ^^^^^^^^
      |
      = help: write `initial mode` where the reactor starts
    "#);
}

#[test]
fn a_federation_has_no_modes() {
    assert_snapshot!(errors("
reactor A { }
federated reactor {
  initial mode One { a = new A() }
}
"), @r#"
    error[LF0905]: a federated reactor cannot have modes: its federates run on their own
     --> Main.lf:4:3
      |
    4 |   initial mode One { a = new A() }
      |   ^^^^^^^^^^^^^^^^
      |
      = help: put the modes into the reactors that are its federates
    "#);
}

#[test]
fn state_that_a_reset_leaves_alone() {
    assert_snapshot!(errors("
reactor Keeps {
  state kept = 1
}
main reactor {
  timer t(0, 1 s)
  initial mode One {
    state forgotten = 1
    reset state nothing
    keeps = new Keeps()
    reaction(t) -> reset(Two) {= Two.set() =}
  }
  mode Two {
    state handled = 1
    reaction(reset) {= self.handled = 2 =}
    reaction(t) -> reset(One) {= One.set() =}
  }
}
"), @r#"
    error[LF0907]: `forgotten` keeps its value when its mode is reset
     --> Main.lf:8:11
      |
    8 |     state forgotten = 1
      |           ^^^^^^^^^
      |
      = help: write `reset state forgotten`, or add a `reaction(reset)` to the mode

    error[LF0906]: `nothing` cannot be reset: it has no initial value
     --> Main.lf:9:5
      |
    9 |     reset state nothing
      |     ^^^^^
      |
      = help: write `reset state nothing = ...`

    warning[LF0910]: `kept` inside `Keeps` keeps its value when the mode is reset
      --> Main.lf:10:17
       |
    10 |     keeps = new Keeps()
       |                 ^^^^^
       |
       = help: write `reset state kept` there, or add a `reaction(reset)`
    "#);
}

#[test]
fn only_one_source_in_a_mode() {
    assert_snapshot!(errors("
reactor Source {
  output out
  reaction(startup) -> out {= out.set(1) =}
}
main reactor {
  initial mode One {
    a = new Source()
    b = new Source()
    a.out -> sink.inp
    b.out -> sink.inp
  }
  mode Two {
    c = new Source()
    c.out -> sink.inp
  }
  sink = new Sink()
}
reactor Sink {
  input inp
  reaction(inp) {= pass =}
}
"), @r#"
    error[LF0502]: the port `Main.sink.inp` has two sources
      --> Main.lf:11:5
       |
    10 |     a.out -> sink.inp
       |     ----------------- it is also set here
    11 |     b.out -> sink.inp
       |     ^^^^^^^^^^^^^^^^^
       |
       = help: a port is set by one connection, or by the reactions of one reactor
    "#);
}
