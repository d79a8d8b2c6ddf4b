//! What Python gets: bodies with their lines, values, preambles in order, arguments of reactions.

use crate::common::{compile_files, compile_text};
use hprm_core::{PortId, ReactionId};
use hprm_model::{Access, Argument, Class, Code, Compiled, ContainedPort, Ports, Value};

fn class<'a>(compiled: &'a Compiled, name: &str) -> &'a Class {
    compiled.classes.iter().find(|class| class.name == name).expect("the class has an instance")
}

#[test]
fn bodies_know_their_lines() {
    let compiled = compile_text(
        "
main reactor {
  reaction(startup) {=
      x = f'{1=}'
      if x:
          print({'a': '=}'})
  =} STP(1 s) {==} deadline(10 ms) {= print(\"late\") =}
  reaction(shutdown) {= pass =} tardy
}",
    );
    let [first, second] = &compiled.classes[0].reactions[..] else { panic!("two reactions") };
    let body = first.code.as_ref().unwrap();
    assert_eq!(body.text, "x = f'{1=}'\nif x:\n    print({'a': '=}'})");
    assert_eq!((first.line, body.line, body.column), (3, 4, 6));
    assert!(first.tardy.as_ref().is_some_and(Code::is_empty));
    let deadline = first.deadline.as_ref().unwrap();
    assert_eq!(
        (deadline.text.as_str(), deadline.line, deadline.column),
        ("print(\"late\")", 7, 38)
    );
    assert_eq!((&second.code.as_ref().unwrap().text[..], &second.tardy), ("pass", &None));
    assert!(compiled.program.reactions.values().all(|reaction| reaction.handles_tardy));
}

#[test]
fn values_keep_their_kinds() {
    let compiled = compile_text(
        "
reactor A(p = 1, q = -2.5, r = true, s = \"a\\n\\\"b\\\"\", t = 'c', u = 2 min, v = forever) {
  state a = p
  state b = [1, [p, 3 ms], \"x\"]
  state c = (1, .5)
  state d = {= self.p + 1 =}
  state e
  method f(x, y) {= return x =}
  preamble {= import math =}
}
main reactor(n = 4) { a = new[2] A(p = n, q = {= bank_index =}) }",
    );
    let a = class(&compiled, "A");
    let defaults: Vec<_> = a.parameters.iter().map(|parameter| parameter.default.clone()).collect();
    assert_eq!(
        defaults,
        [
            Value::Int(1),
            Value::Float(-2.5),
            Value::Bool(true),
            Value::Str("a\n\"b\"".to_owned()),
            Value::Char('c'),
            Value::Time(120_000_000_000),
            Value::Time(i64::MAX),
        ]
    );
    let p = Value::Parameter("p".to_owned());
    assert_eq!(a.state[0].init, Some(p.clone()));
    let inner = Value::List(vec![p, Value::Time(3_000_000)]);
    let list = Value::List(vec![Value::Int(1), inner, Value::Str("x".to_owned())]);
    assert_eq!(a.state[1].init, Some(list));
    assert_eq!(a.state[2].init, Some(Value::Tuple(vec![Value::Int(1), Value::Float(0.5)])));
    assert!(matches!(&a.state[3].init, Some(Value::Code(code)) if code.text == "self.p + 1"));
    assert_eq!(a.state[4].init, None);
    assert_eq!(a.methods[0].args, ["x", "y"]);
    assert_eq!(a.preambles[0].text, "import math");
    let second = compiled.instances.values().nth(2).unwrap();
    assert_eq!((second.name.as_str(), second.bank_index), ("Main.a[1]", Some(1)));
    assert_eq!(second.assignments[0], ("p".to_owned(), Value::Parameter("n".to_owned())));
    assert!(matches!(&second.assignments[1].1, Value::Code(code) if code.text == "bank_index"));
}

#[test]
fn a_number_may_end_a_line_before_a_name() {
    let compiled = compile_text(
        "
reactor A { output out input inp }
main reactor {
  state x = 1
  a = new A()
  state y = 2
  a.out -> a.inp after 0
  state z = 3
  reaction(startup) {= pass =}
}",
    );
    let values: Vec<_> =
        compiled.classes[0].state.iter().map(|s| s.init.clone().unwrap()).collect();
    assert_eq!(values, [Value::Int(1), Value::Int(2), Value::Int(3)]);
}

#[test]
fn preambles_of_imported_files_come_first() {
    let main = "target Python\nimport A from \"lib/A.lf\"\n  preamble {=\n      import main\n  =}\n\
        main reactor { a = new A() }";
    let a = "target Python\nimport B as Base from \"B.lf\"\npreamble {= import a =}\n\
        reactor A { b = new Base() }\nmain reactor { missing = new A() }";
    let b = "target Python\nimport A from \"A.lf\"\nprivate preamble {= import b =}\nreactor B { }";
    let compiled = compile_files(&[("Main.lf", main), ("lib/A.lf", a), ("lib/B.lf", b)])
        .unwrap_or_else(|failure| panic!("{failure}"));
    let preambles: Vec<_> = compiled
        .preambles
        .iter()
        .map(|code| (code.text.as_str(), compiled.sources.path(code.file), code.line))
        .collect();
    assert_eq!(
        preambles,
        [("import b", "lib/B.lf", 3), ("import a", "lib/A.lf", 3), ("import main", "Main.lf", 4),]
    );
    let names: Vec<_> = compiled.classes.iter().map(|class| class.name.as_str()).collect();
    assert_eq!(names, ["Main", "A", "B"]);
}

fn single(first: u32) -> Ports {
    Ports { first: PortId(first), width: None }
}

#[test]
fn arguments_are_triggers_then_sources_then_effects() {
    let compiled = compile_text(
        "
reactor A {
  input first
  mutable input[3] second
  output out
  logical action act
  timer t
  reaction(t, act, second, startup) first -> out, act {= pass =}
}
main reactor { a = new A() }",
    );
    let names = &class(&compiled, "A").reactions[0].args;
    assert_eq!(names[..], ["act", "second", "first", "out"]);
    let code = &compiled.bodies[ReactionId(0)];
    assert!(code.arguments.iter().map(Argument::name).eq(names));
    let port = |name: &str, ports, access, mutable| Argument::Port {
        name: name.to_owned(),
        ports,
        access,
        mutable,
    };
    let wide = Ports { first: PortId(1), width: Some(3) };
    assert_eq!(
        code.arguments[1..],
        [
            port("second", wide, Access::Read, true),
            port("first", single(0), Access::Read, false),
            port("out", single(4), Access::Write, false),
        ]
    );
    assert_eq!(wide.channels().collect::<Vec<_>>(), [PortId(1), PortId(2), PortId(3)]);
}

#[test]
fn contained_ports_are_one_argument_and_an_alias_each() {
    let compiled = compile_text(
        "
reactor A { input inp output out }
main reactor {
  a = new A()
  bank = new[2] A()
  reaction(a.out, bank.out) -> a.inp, bank.inp {= pass =}
}",
    );
    let port = |name: &str, first, access| ContainedPort {
        name: name.to_owned(),
        ports: single(first),
        access,
    };
    let alias = |port: &str| Argument::Alias {
        name: format!("a_{port}"),
        instance: "a".to_owned(),
        port: port.to_owned(),
    };
    let ports = |inp, out| vec![port("out", out, Access::Read), port("inp", inp, Access::Write)];
    assert_eq!(class(&compiled, "Main").reactions[0].args, ["a", "a_out", "bank", "a_inp"]);
    assert_eq!(
        compiled.bodies[ReactionId(0)].arguments,
        [
            Argument::Contained { name: "a".to_owned(), bank: false, members: vec![ports(0, 1)] },
            alias("out"),
            Argument::Contained {
                name: "bank".to_owned(),
                bank: true,
                members: vec![ports(2, 3), ports(4, 5)],
            },
            alias("inp"),
        ]
    );
}

#[test]
fn an_alias_gives_way_to_a_port_of_that_name() {
    let compiled = compile_text(
        "
reactor A { output out }
main reactor {
  a = new A()
  logical action a_out
  reaction(a.out, a_out) {= pass =}
}",
    );
    assert_eq!(class(&compiled, "Main").reactions[0].args, ["a", "a_out"]);
    let last = compiled.bodies[ReactionId(0)].arguments.last().unwrap();
    assert!(matches!(last, Argument::Action { .. }));
}
