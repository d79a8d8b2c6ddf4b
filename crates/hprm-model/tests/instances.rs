//! Programs that are declared instance by instance: classes that no name means, members of a bank that have
//! classes of their own, connections to single members and channels.

use hprm_model::declaration::{
    Body, ConnectionNode, Expression, ExpressionKind, Instantiation, Member, ModeNode, Name,
    PortKind, PortNode, ReactionNode, ReactorKind, ReactorNode, Reference, TriggerNode, Width,
    WidthTerm,
};
use hprm_model::{
    ClassId, CompileFailure, Compiled, FileId, Library, Overrides, Purpose, Report, Runs, Span,
    TargetProperties, compile,
};
use insta::assert_snapshot;

const TEXT: &str = "class Robot(Reactor):
    class Wheel(Reactor): ...
    wheels = [Wheel(width) for width in (1, 2)]
    sink = Sink()
    connect(wheels[0].speed, sink.a)
";

fn at(word: &str) -> Span {
    let start = TEXT.find(word).expect("the text has the word");
    Span::new(FileId::MAIN, start..start + word.len())
}

fn name(text: &str) -> Name {
    Name::new(text, at(text.trim_end_matches(char::is_numeric)))
}

fn width(number: i64, span: Span) -> Option<Width> {
    let kind = ExpressionKind::Integer(number);
    Some(Width { terms: vec![WidthTerm::Value(Expression { kind, span })], span })
}

fn port(kind: PortKind, word: &str, channels: Option<i64>) -> Member {
    let width = channels.and_then(|channels| width(channels, at("width")));
    Member::Port(PortNode { width, ..PortNode::new(kind, Name::new(word, at("sink"))) })
}

fn wheel(ports: Vec<Member>) -> ReactorNode {
    let mut wheel = ReactorNode::new(ReactorKind::Plain, Some(name("Wheel")), at("class Wheel"));
    wheel.members = ports;
    wheel
}

/// A robot with two wheels, whose `speed` has one channel and two, and a sink.
struct Robot {
    library: Library,
    main: ReactorNode,
}

impl Robot {
    fn new() -> Self {
        let speed = |channels| wheel(vec![port(PortKind::Output, "speed", Some(channels))]);
        Self::with(vec![speed(1), speed(2)])
    }

    fn with(wheels: Vec<ReactorNode>) -> Self {
        let mut library = Library::new("app.py", TEXT.to_owned());
        let count = wheels.len() as i64;
        let wheels = wheels.into_iter().map(|it| library.add_unlisted(FileId::MAIN, it));
        let wheels: Vec<ClassId> = wheels.collect();
        let mut sink = ReactorNode::new(ReactorKind::Plain, Some(name("Sink")), at("Sink"));
        sink.members = vec![
            port(PortKind::Input { mutable: false }, "a", None),
            port(PortKind::Input { mutable: false }, "b", None),
        ];
        let sink = library.add_unlisted(FileId::MAIN, sink);
        let mut main =
            ReactorNode::new(ReactorKind::Main, Some(name("Robot")), at("class Robot(Reactor)"));
        main.members = vec![
            Member::Instantiation(Instantiation {
                width: width(count, at("wheels")),
                members: Some(wheels),
                ..Instantiation::new(name("wheels"), name("Wheel"))
            }),
            Member::Instantiation(Instantiation {
                members: Some(vec![sink]),
                ..Instantiation::new(name("sink"), name("Sink"))
            }),
        ];
        Self { library, main }
    }

    fn connect(mut self, left: Reference, right: &str) -> Self {
        let right = Reference::contained(name("sink"), Name::new(right, at("sink.a")));
        let span = at("connect(wheels[0].speed, sink.a)");
        let connection = ConnectionNode::new(vec![left], vec![right], span);
        self.main.members.push(Member::Connection(connection));
        self
    }

    fn compiled(self) -> Result<Compiled, CompileFailure> {
        let Self { mut library, main } = self;
        let mut report = Report::default();
        let main = library.add_reactor(FileId::MAIN, main, &mut report);
        library.set_main(main);
        let overrides = Overrides::default();
        let properties = TargetProperties::read(&library, &overrides, &mut report);
        compile(library, properties, &overrides, Purpose::Run, report)
    }
}

fn speed(member: Option<u32>, channel: Option<u32>) -> Reference {
    let span = at("wheels[0].speed");
    let port = Name::new("speed", span);
    Reference { member, channel, span, ..Reference::contained(name("wheels"), port) }
}

#[test]
fn members_of_a_bank_have_classes_of_their_own() {
    let robot = Robot::new().connect(speed(Some(0), None), "a");
    let compiled = robot.connect(speed(Some(1), Some(1)), "b").compiled().unwrap();
    let program = &compiled.program;
    // Not the name of the file.
    assert_eq!(program.name, "Robot");
    let ports: Vec<_> = program.ports.iter().map(|(id, _)| program.port_name(id)).collect();
    assert_eq!(
        ports,
        [
            "Robot.wheels[0].speed[0]",
            "Robot.wheels[1].speed[0]",
            "Robot.wheels[1].speed[1]",
            "Robot.sink.a",
            "Robot.sink.b",
        ]
    );
    let ends = |connection: &hprm_core::Connection| {
        format!("{} -> {}", program.port_name(connection.from), program.port_name(connection.to))
    };
    let connections: Vec<_> = program.connections.values().map(ends).collect();
    assert_eq!(
        connections,
        ["Robot.wheels[0].speed[0] -> Robot.sink.a", "Robot.wheels[1].speed[1] -> Robot.sink.b",]
    );
    let names: Vec<_> = compiled.classes.iter().map(|class| class.name.as_str()).collect();
    assert_eq!(names, ["Robot", "Wheel", "Wheel", "Sink"]);
}

#[test]
fn a_member_that_there_is_not_is_reported_where_it_is_named() {
    let robot = Robot::new().connect(speed(Some(2), None), "a");
    assert_snapshot!(robot.compiled().unwrap_err(), @r"
    error[LF0312]: there is no member 2 here
     --> app.py:5:13
      |
    5 |     connect(wheels[0].speed, sink.a)
      |             ^^^^^^^^^^^^^^^
      |
      = help: there are 2 members, from 0 to 1
    ");
}

#[test]
fn a_channel_that_there_is_not_is_reported_where_it_is_named() {
    let robot = Robot::new().connect(speed(Some(0), Some(1)), "a");
    assert_snapshot!(robot.compiled().unwrap_err(), @r"
    error[LF0312]: there is no channel 1 here
     --> app.py:5:13
      |
    5 |     connect(wheels[0].speed, sink.a)
      |             ^^^^^^^^^^^^^^^
      |
      = help: there is only channel 0
    ");
}

#[test]
fn only_banks_have_members_and_only_multiports_channels() {
    let speed = || wheel(vec![port(PortKind::Output, "speed", None)]);
    let one_channel = Robot::with(vec![speed()]).connect(self::speed(Some(0), Some(0)), "a");
    let error = one_channel.compiled().unwrap_err();
    assert_eq!(error.diagnostics[0].code, "LF0312");
    assert_eq!(error.diagnostics[0].message, "`wheels[0].speed` is no multiport");
    let mut left = self::speed(Some(0), None);
    left.container = Some(name("sink"));
    left.variable = Name::new("a", at("sink.a"));
    let mut robot = Robot::with(vec![speed()]);
    let right = Reference { member: Some(0), ..left };
    let connection = ConnectionNode::new(vec![self::speed(None, None)], vec![right], at("connect"));
    robot.main.members.push(Member::Connection(connection));
    let error = robot.compiled().unwrap_err();
    assert_eq!(error.diagnostics[0].message, "`sink` is no bank");
}

#[test]
fn members_of_a_bank_have_the_same_ports() {
    let wheels = ["speed", "torque"].map(|it| wheel(vec![port(PortKind::Output, it, None)]));
    assert_snapshot!(Robot::with(wheels.into()).compiled().unwrap_err(), @r"
    error[LF0313]: `wheels[1]` has other ports than `wheels[0]`
     --> app.py:3:5
      |
    3 |     wheels = [Wheel(width) for width in (1, 2)]
      |     ^^^^^^
      |
      = help: all members of a bank have the same ports, in the same order
    ");
    let error = Robot::with(Vec::new()).compiled().unwrap_err();
    assert_eq!(error.diagnostics[0].message, "the bank `wheels` has no members");
}

#[test]
fn classes_without_names_nest() {
    let mut robot = Robot::with(vec![wheel(Vec::new())]);
    let inner = robot.library.add_unlisted(FileId::MAIN, wheel(Vec::new()));
    let instance = |word: &str, class| {
        let instance = Instantiation::new(name(word), name("Wheel"));
        Member::Instantiation(Instantiation { members: Some(vec![class]), ..instance })
    };
    let outer = robot.library.add_unlisted(FileId::MAIN, wheel(vec![instance("speed", inner)]));
    robot.main.members.push(instance("width", outer));
    let compiled = robot.compiled().unwrap();
    assert_eq!(compiled.instances.values().last().unwrap().name, "Robot.width.speed");
}

#[test]
fn reactions_keep_their_order_whatever_their_modes() {
    let mut robot = Robot::with(Vec::new());
    let reaction = |word: &str| {
        let mut reaction = ReactionNode::new(Body::Bound, at(word));
        reaction.name = Some(name(word));
        reaction.triggers.push(TriggerNode::Startup);
        Member::Reaction(reaction)
    };
    let mode = |word: &str, initial| {
        let members = Vec::new();
        Member::Mode(ModeNode { initial, name: Some(name(word)), members, header: at(word) })
    };
    robot.main.members = vec![
        mode("Robot", true),
        mode("Wheel", false),
        Member::InMode(1, Box::new(reaction("width"))),
        reaction("sink"),
        Member::InMode(0, Box::new(reaction("speed"))),
    ];
    let compiled = robot.compiled().unwrap();
    let modes = compiled.program.reactions.values().map(|reaction| reaction.mode.map(|m| m.0));
    assert_eq!(modes.collect::<Vec<_>>(), [Some(1), None, Some(0)]);
    let names = compiled.classes[0].reactions.iter().map(|reaction| reaction.name.as_deref());
    assert_eq!(names.collect::<Vec<_>>(), [Some("width"), Some("sink"), Some("speed")]);
    let runs: Vec<_> = compiled.bodies.values().map(|body| body.runs.clone()).collect();
    assert_eq!(runs, [Runs::Reaction(0), Runs::Reaction(1), Runs::Reaction(2)]);
}
