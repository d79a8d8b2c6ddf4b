//! Programs that are declared without a parser: what they compile to, and what is wrong with them.

mod by_hand;

use by_hand::{CAUSALITY_LOOP, RIGHT, TWO_SOURCES};
use hprm_model::CompileFailure;
use hprm_model::declaration::{
    Body, EffectNode, Instantiation, Member, Name, PortKind, PortNode, ReactionNode, ReactorKind,
    ReactorNode, Reference, TriggerNode,
};
use hprm_model::{
    Compiled, FileId, Library, Overrides, Purpose, Report, Severity, Span, TargetProperties,
    compile,
};
use insta::assert_snapshot;

#[test]
fn a_program_needs_no_parser() {
    let compiled = by_hand::compiled(&RIGHT).unwrap();
    let program = &compiled.program;
    assert_eq!(program.name, "Main");
    let reactors: Vec<_> = compiled.instances.values().map(|it| it.name.as_str()).collect();
    assert_eq!(reactors, ["Main", "Main.source", "Main.sink"]);
    let [connection] = program.connections.values().collect::<Vec<_>>()[..] else {
        panic!("one connection")
    };
    assert_eq!(program.port_name(connection.from), "Main.source.out");
    assert_eq!(program.port_name(connection.to), "Main.sink.inp");
    let bodies: Vec<_> = compiled
        .classes
        .iter()
        .flat_map(|class| &class.reactions)
        .map(|reaction| (reaction.line, reaction.code.as_ref().unwrap().text.as_str()))
        .collect();
    assert_eq!(bodies, [(5, "out.set(1)"), (9, "print(inp.value)")]);
    assert!(compiled.warnings.is_empty(), "{:?}", compiled.warnings);
}

#[test]
fn a_port_with_two_sources_is_reported_where_it_is_declared() {
    assert_snapshot!(by_hand::compiled(&TWO_SOURCES).unwrap_err(), @r"
    error[LF0502]: the port `Main.sink.inp` has two sources
      --> Main.lf:21:3
       |
    20 |   source.out -> sink.inp
       |   ---------------------- it is also set here
    21 |   other.out -> sink.inp
       |   ^^^^^^^^^^^^^^^^^^^^^
       |
       = help: a port is set by one connection, or by the reactions of one reactor
    ");
}

#[test]
fn a_causality_loop_is_reported_where_it_is_declared() {
    assert_snapshot!(by_hand::compiled(&CAUSALITY_LOOP).unwrap_err(), @r"
    error[LF0503]: reactions wait for one another in a cycle: Main.one.1 -> Main.two.1
      --> Main.lf:14:3
       |
    14 |   reaction(inp) -> out {= out.set(inp.value) =}
       |   ^^^^^^^^^^^^^^^^^^^^
       |
       = help: give one of the connections a delay, such as `after 0`, or reorder the reactions
    ");
}

/// Text of two files, as another language has it.
const ROBOT: &str = "from parts import Wheel as Left\n\nclass Robot(Main):\n    left = Left()\n";
const PARTS: &str = "class Wheel(Reactor):\n    speed = Output()\n    unset = Output()\n\n    def turn(self): ...\n";

fn place(file: FileId, text: &str, word: &str) -> Span {
    let start = text.find(word).expect("the text has the word");
    Span::new(file, start..start + word.len())
}

/// A main reactor with a wheel, whose reaction is a function of the front end. The main file imports the
/// class under a name of its own.
fn robot(purpose: Purpose) -> Result<Compiled, CompileFailure> {
    let mut report = Report::default();
    let mut library = Library::new("Robot.py", ROBOT.to_owned());
    let parts = library.add_file("parts.py", PARTS.to_owned());
    let name = |word: &str| Name::new(word, place(parts, PARTS, word));
    let mut wheel =
        ReactorNode::new(ReactorKind::Plain, Some(name("Wheel")), place(parts, PARTS, "class"));
    let mut turn = ReactionNode::new(Body::Bound, place(parts, PARTS, "def turn"));
    turn.triggers.push(TriggerNode::Startup);
    turn.effects.push(EffectNode::Variable(Reference::own(name("speed"))));
    wheel.members = vec![
        Member::Port(PortNode::new(PortKind::Output, name("speed"))),
        Member::Port(PortNode::new(PortKind::Output, name("unset"))),
        Member::Reaction(turn),
    ];
    let here = |word: &str| place(FileId::MAIN, ROBOT, word);
    let mut main = ReactorNode::new(ReactorKind::Main, None, here("class Robot(Main)"));
    let left =
        Instantiation::new(Name::new("left", here("left")), Name::new("Left", here("Left()")));
    main.members = vec![Member::Instantiation(left)];
    let wheel = library.add_reactor(parts, wheel, &mut report);
    library.add_reactor(FileId::MAIN, main, &mut report);
    library.import(FileId::MAIN, Name::new("Left", here("Left")), wheel, &mut report);
    library.add_preamble(parts, place(parts, PARTS, "..."));
    library.add_preamble(FileId::MAIN, here("from parts import Wheel as Left"));
    let overrides = Overrides::default();
    let properties = TargetProperties::read(&library, &overrides, &mut report);
    compile(library, properties, &overrides, purpose, report)
}

#[test]
fn a_body_may_be_a_function_of_the_front_end() {
    let compiled = robot(Purpose::Run).unwrap();
    assert_eq!(compiled.program.name, "Robot");
    let wheel = compiled.classes.iter().find(|class| class.name == "Wheel").unwrap();
    assert_eq!(wheel.reactions[0].code, None);
    assert_eq!((wheel.reactions[0].file, wheel.reactions[0].line), (wheel.file, 5));
    assert_eq!(wheel.reactions[0].args, ["speed"]);
    assert_eq!(compiled.bodies.len(), 1);
    // Processes compare what it is called with.
    let facts = compiled.fingerprint().report();
    assert!(facts.iter().any(|fact| fact.subject == "the body of reaction 1 of reactor Wheel"));
    // It may set what it names as an effect, and nothing else.
    let [warning] = &compiled.warnings[..] else { panic!("{:?}", compiled.warnings) };
    assert_eq!((warning.code, warning.severity), ("LF0506", Severity::Warning));
    assert_eq!(warning.message, "nothing sets the output `unset`");
}

#[test]
fn preambles_of_imported_files_run_first() {
    let compiled = robot(Purpose::Check).unwrap();
    let files: Vec<_> =
        compiled.preambles.iter().map(|code| compiled.sources.path(code.file)).collect();
    assert_eq!(files, ["parts.py", "Robot.py"]);
}

#[test]
fn two_reactors_of_one_name_are_reported() {
    let mut report = Report::default();
    let mut library = Library::new("Two.py", "class A: ...\nclass A: ...\n".to_owned());
    for start in [6, 19] {
        let span = Span::new(FileId::MAIN, start..start + 1);
        let reactor = ReactorNode::new(ReactorKind::Plain, Some(Name::new("A", span)), span);
        library.add_reactor(FileId::MAIN, reactor, &mut report);
    }
    let found = report.into_sorted();
    assert_eq!((found[0].code, library.sources().position(found[0].span).line), ("LF0201", 2));
}
