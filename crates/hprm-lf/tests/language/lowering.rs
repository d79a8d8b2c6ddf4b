//! From text to the instance graph: names, channel orders, parameters, levels.

use crate::common::{compile_files, compile_text, connections};
use hprm_core::{Delay, Direction, Effect, Origin, Policy, PortId, ReactionId, Spacing, Trigger};
use hprm_model::Compiled;

const BANK: &str = "
reactor Source { output[2] out }
reactor Sink { input[2] inp }
";

fn joined(connection: &str) -> Vec<String> {
    connections(&compile_text(&format!(
        "{BANK} main reactor {{ a = new[2] Source() b = new[2] Sink() {connection} }}"
    )))
}

#[test]
fn channels_of_a_bank_go_member_by_member() {
    assert_eq!(
        joined("a.out -> b.inp"),
        [
            "a[0].out[0] -> b[0].inp[0]",
            "a[0].out[1] -> b[0].inp[1]",
            "a[1].out[0] -> b[1].inp[0]",
            "a[1].out[1] -> b[1].inp[1]",
        ]
    );
}

#[test]
fn interleaved_channels_go_channel_by_channel() {
    assert_eq!(
        joined("interleaved(a.out) -> b.inp"),
        [
            "a[0].out[0] -> b[0].inp[0]",
            "a[1].out[0] -> b[0].inp[1]",
            "a[0].out[1] -> b[1].inp[0]",
            "a[1].out[1] -> b[1].inp[1]",
        ]
    );
    assert_eq!(joined("a.out -> interleaved(b.inp)")[1], "a[0].out[1] -> b[1].inp[0]");
}

#[test]
fn several_references_are_one_row() {
    let text = format!(
        "{BANK} reactor One {{ output o }} main reactor {{
            a = new Source() o = new One() b = new[2] Sink() o.o, a.out, o.o -> b.inp }}"
    );
    assert_eq!(
        connections(&compile_text(&text)),
        [
            "o.o -> b[0].inp[0]",
            "a.out[0] -> b[0].inp[1]",
            "a.out[1] -> b[1].inp[0]",
            "o.o -> b[1].inp[1]",
        ]
    );
}

#[test]
fn a_broadcast_repeats_its_left_side() {
    let text = format!(
        "{BANK} reactor One {{ output o }} main reactor {{
            o = new One() p = new One() b = new[2] Sink() (o.o, p.o)+ -> b.inp }}"
    );
    assert_eq!(
        connections(&compile_text(&text)),
        ["o.o -> b[0].inp[0]", "p.o -> b[0].inp[1]", "o.o -> b[1].inp[0]", "p.o -> b[1].inp[1]",]
    );
}

#[test]
fn connections_pass_through_nested_banks() {
    let compiled = compile_text(
        "
reactor Leaf { input[2] inp output out }
reactor Box(n = 2) {
  input[4] inp
  output[n] out
  leaf = new[n] Leaf()
  inp -> leaf.inp
  leaf.out -> out
}
main reactor { boxes = new[2] Box() }",
    );
    let all = connections(&compiled);
    assert_eq!(
        all[6..],
        [
            "boxes[1].inp[0] -> boxes[1].leaf[0].inp[0]",
            "boxes[1].inp[1] -> boxes[1].leaf[0].inp[1]",
            "boxes[1].inp[2] -> boxes[1].leaf[1].inp[0]",
            "boxes[1].inp[3] -> boxes[1].leaf[1].inp[1]",
            "boxes[1].leaf[0].out -> boxes[1].out[0]",
            "boxes[1].leaf[1].out -> boxes[1].out[1]",
        ]
    );
}

#[test]
fn parameters_are_found_up_the_hierarchy() {
    let compiled = compile_text(
        "
reactor Inner(width = 1, period = 1 s, late = 5 ms) {
  input[width] inp
  timer t(late, period)
  logical action a(period)
  physical action b
  reaction(t) {= pass =} deadline(late) {= pass =}
}
reactor Outer(n = 7, every = 2 s) { inner = new[n + 1] Inner(width = n, period = every) }
main reactor(m = 2) { outer = new Outer(n = m) }",
    );
    let program = &compiled.program;
    let name = |index: usize| program.reactors.values().nth(index).map(|r| r.name.clone());
    assert_eq!(program.reactors.len(), 5);
    assert_eq!(name(4).as_deref(), Some("Main.outer.inner[2]"));
    let widths = program.ports.values().filter(|port| port.direction == Direction::Input).count();
    assert_eq!(widths, 3 * 2);
    let second = 1_000_000_000;
    let timer = program.timers.values().next().unwrap();
    assert_eq!((timer.offset, timer.period), (5_000_000, 2 * second));
    let actions: Vec<_> = program.actions.values().take(2).collect();
    assert_eq!((actions[0].origin, actions[0].min_delay), (Origin::Logical, 2 * second));
    assert_eq!((actions[1].origin, actions[1].min_delay), (Origin::Physical, 0));
    assert_eq!(program.reactions[ReactionId(0)].deadline, Some(5_000_000));
    assert!(program.properties.keepalive, "a physical action keeps the program alive");
}

#[test]
fn a_minimum_spacing_is_what_is_written() {
    let compiled = compile_text(
        "
reactor Inner(gap = 2 s) {
  logical action none(1 s)
  logical action zero(0, 0)
  physical action named(0, gap, \"update\")
}
main reactor { inner = new Inner(gap = 3 s) }",
    );
    let spacings: Vec<_> = compiled.program.actions.values().map(|a| a.spacing).collect();
    let spacing = |min, policy| Some(Spacing { min, policy });
    assert_eq!(
        spacings,
        [None, spacing(0, Policy::Defer), spacing(3_000_000_000, Policy::Update)],
        "an action without spacing is not one with a spacing of zero"
    );
}

#[test]
fn the_place_in_a_bank_is_a_parameter_if_declared() {
    let compiled = compile_text(
        "
reactor Inner { }
reactor Outer(bank_index = 5) { inner = new[bank_index + 1] Inner() }
main reactor {
  a = new[3] Outer()
  b = new[2] Outer(bank_index = 3)
}",
    );
    let inner = compiled.program.reactors.values().filter(|r| r.name.contains(".inner["));
    assert_eq!(inner.count(), 1 + 2 + 3 + 4 + 4);
}

#[test]
fn delays() {
    let compiled = compile_text(
        "
reactor A { output out input inp }
main reactor(d = 3 ms) {
  a = new A()
  b = new[2] A()
  a.out, a.out -> b.inp after d
  c = new A()
  c.out -> a.inp after 0 s
}",
    );
    let delays: Vec<_> = compiled.program.connections.values().map(|c| c.delay).collect();
    assert_eq!(delays, [Delay::Time(3_000_000), Delay::Time(3_000_000), Delay::Microstep]);
}

fn levels(compiled: &Compiled) -> Vec<(String, u32)> {
    let program = &compiled.program;
    program.reactions.iter().map(|(id, r)| (program.reaction_name(id), r.level)).collect()
}

#[test]
fn levels_follow_connections_through_the_hierarchy() {
    let compiled = compile_text(
        "
reactor A { output out reaction(startup) -> out {= out.set(1) =} }
reactor Relay { input inp output out inp -> out }
reactor B { input inp reaction(startup) {= pass =} reaction(inp) {= pass =} }
main reactor {
  a = new A() r = new Relay() b = new B() late = new B()
  a.out -> r.inp
  r.out -> b.inp
  a.out -> late.inp after 1 ms
}",
    );
    assert_eq!(
        levels(&compiled),
        [
            ("Main.a.1".to_owned(), 0),
            ("Main.b.1".to_owned(), 0),
            ("Main.b.2".to_owned(), 1),
            ("Main.late.1".to_owned(), 0),
            ("Main.late.2".to_owned(), 1),
        ]
    );
}

#[test]
fn a_reaction_comes_before_those_that_it_triggers_inside() {
    let compiled = compile_text(
        "
reactor A { input inp output out reaction(inp) -> out {= pass =} }
main reactor {
  a = new A()
  reaction(startup) -> a.inp {= pass =}
}",
    );
    assert_eq!(levels(&compiled), [("Main.1".to_owned(), 0), ("Main.a.1".to_owned(), 1)]);
}

#[test]
fn a_reaction_without_triggers_reacts_to_all_inputs() {
    let compiled = compile_text(
        "reactor A { input a input[2] b output c reaction() -> c {= pass =} }
         main reactor { a = new A() }",
    );
    let reaction = &compiled.program.reactions[ReactionId(0)];
    let ports: Vec<_> = (0..3).map(|port| Trigger::Port(PortId(port))).collect();
    assert_eq!(reaction.triggers, ports);
    assert_eq!(reaction.effects, [Effect::Port(PortId(3))]);
    assert_eq!(compiled.classes[1].reactions[0].args, ["a", "b", "c"]);
}

#[test]
fn federates_have_names_hosts_and_waits() {
    let compiled = compile_text(
        "
reactor A(sta = 5 ms) { input inp output out reaction(inp) -> out {= pass =} }
reactor B { input inp output out inner = new Inner() inp -> inner.inp
  reaction(startup) -> out {= pass =} }
reactor Inner { input inp reaction(inp) {= pass =} STAA(7 ms) {= pass =} }
federated reactor at rti.example.org {
  @maxwait(1 s)
  a = new[2] A(sta = 6 ms) at user@10.0.0.1:1234;
  @maxwait(2 s)
  b = new B() at [::1];
  c = new B()
  @absent_after(3 ms)
  b.out -> c.inp
  @Compress
  c.out ~> b.inp
}",
    );
    let program = &compiled.program;
    let federates: Vec<_> = program
        .federates
        .values()
        .map(|f| (f.name.as_str(), f.maxwait, f.host.as_deref()))
        .collect();
    assert_eq!(
        federates,
        [
            ("a__0", 6_000_000, Some("user@10.0.0.1:1234")),
            ("a__1", 6_000_000, Some("user@10.0.0.1:1234")),
            ("b", 2_000_000_000, Some("[::1]")),
            ("c", i64::MAX, None),
        ]
    );
    assert_eq!(compiled.rti_host.as_deref(), Some("rti.example.org"));
    let top: Vec<_> = program.connections.values().map(|c| (c.physical, c.absent_after)).collect();
    assert_eq!(top[..2], [(false, 3_000_000), (true, 7_000_000)]);
    let compressed: Vec<_> = program.connections.values().map(|c| c.compress).collect();
    assert_eq!(compressed[..2], [false, true]);
    let inside = program.reactors.values().find(|r| r.name == "Main.b.inner").unwrap();
    assert_eq!(inside.federate, program.federate_named("b"));
}

#[test]
fn files_and_settings_come_from_the_targets() {
    let main = "target Python { files: [agent.py, \"lib/a b.py\"], logging: DEBUG, workers: 2,
        tracing: true, docker: false, Timeout: 2 min, DNET: false }
        import A from \"lib/A.lf\" main reactor { a = new A() }";
    let library = "target Python { files: gui/tool-kit.py, timeout: 1 s } reactor A { }";
    let compiled = compile_files(&[("Main.lf", main), ("lib/A.lf", library)])
        .unwrap_or_else(|failure| panic!("{failure}"));
    let path = |file| compiled.sources.path(file);
    let files: Vec<_> =
        compiled.files.iter().map(|(name, file)| (name.as_str(), path(*file))).collect();
    assert_eq!(
        files,
        [("gui/tool-kit.py", "lib/A.lf"), ("agent.py", "Main.lf"), ("lib/a b.py", "Main.lf"),]
    );
    assert_eq!(compiled.settings.logging.as_deref(), Some("debug"));
    assert_eq!((compiled.program.properties.workers, compiled.settings.tracing), (Some(2), true));
    assert_eq!(compiled.program.properties.timeout, Some(120_000_000_000));
    assert!(compiled.program.properties.reports_all, "without DNET everything is reported");
    let codes: Vec<_> = compiled.warnings.iter().map(|warning| warning.code).collect();
    assert_eq!(codes, ["LF0606"], "of `logging`");
}
