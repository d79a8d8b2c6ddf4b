//! A program that is declared without a parser: a timer, a sink, and a main reactor that connects them.
//!
//! Its text is only where its places are. The tests of the front end for `.lf` declare it too, and compare
//! it with what they parse.

#![allow(dead_code, reason = "each test file uses its share")]

use hprm_model::declaration::{
    Body, ConnectionNode, EffectNode, Expression, ExpressionKind, Instantiation, Member, Name,
    PortKind, PortNode, ReactionNode, ReactorKind, ReactorNode, Reference, TimerNode, TriggerNode,
};
use hprm_model::{
    CompileFailure, Compiled, FileId, Library, Overrides, Purpose, Report, Span, TargetProperties,
    compile,
};

/// The reactors of all programs here, as text.
pub(crate) const REACTORS: &str = "target Python
reactor Source {
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {= out.set(1) =}
}
reactor Sink {
  input inp
  reaction(inp) {= print(inp.value) =}
}
reactor Relay {
  input inp
  output out
  reaction(inp) -> out {= out.set(inp.value) =}
}
";

/// What the main reactor instantiates and connects.
pub(crate) struct Main {
    pub(crate) instances: &'static [(&'static str, &'static str)],
    pub(crate) connections: &'static [[&'static str; 4]],
}

/// A program without mistakes.
pub(crate) const RIGHT: Main = Main {
    instances: &[("source", "Source"), ("sink", "Sink")],
    connections: &[["source", "out", "sink", "inp"]],
};

/// The input of the sink has two sources.
pub(crate) const TWO_SOURCES: Main = Main {
    instances: &[("source", "Source"), ("other", "Source"), ("sink", "Sink")],
    connections: &[["source", "out", "sink", "inp"], ["other", "out", "sink", "inp"]],
};

/// Two relays wait for one another.
pub(crate) const CAUSALITY_LOOP: Main = Main {
    instances: &[("one", "Relay"), ("two", "Relay")],
    connections: &[["one", "out", "two", "inp"], ["two", "out", "one", "inp"]],
};

/// The whole text of a program.
pub(crate) fn text(main: &Main) -> String {
    let mut text = format!("{REACTORS}main reactor {{\n");
    for (name, class) in main.instances {
        text += &format!("  {name} = new {class}()\n");
    }
    for [from, out, to, inp] in main.connections {
        text += &format!("  {from}.{out} -> {to}.{inp}\n");
    }
    text + "}\n"
}

/// Finds places in a text, each behind the start of the one before.
struct Places<'t> {
    text: &'t str,
    at: usize,
}

impl Places<'_> {
    fn span(&mut self, word: &str) -> Span {
        self.at += self.text[self.at..].find(word).expect("the text has the word");
        Span::new(FileId::MAIN, self.at..self.at + word.len())
    }

    fn name(&mut self, word: &str) -> Name {
        let span = self.span(word);
        // The same word again is another place.
        self.at += word.len();
        Name::new(word, span)
    }

    fn reactor(&mut self, name: &str) -> ReactorNode {
        let header = self.span(&format!("reactor {name}"));
        let name = self.name(name);
        ReactorNode::new(ReactorKind::Plain, Some(name), header)
    }

    fn input(&mut self) -> Member {
        self.span("input");
        Member::Port(PortNode::new(PortKind::Input { mutable: false }, self.name("inp")))
    }

    fn output(&mut self) -> Member {
        self.span("output");
        Member::Port(PortNode::new(PortKind::Output, self.name("out")))
    }

    fn timer(&mut self) -> Member {
        self.span("timer");
        let name = self.name("t(");
        let name =
            Name { text: "t".to_owned(), span: Span { end: name.span.end - 1, ..name.span } };
        let offset = Expression { kind: ExpressionKind::Integer(0), span: self.span("0") };
        let period = Expression::time(10_000_000, self.span("10 ms"));
        let (offset, period) = (Some(offset), Some(period));
        Member::Timer(TimerNode { attributes: Vec::new(), name, offset, period })
    }

    /// The reaction with this text as its header, its trigger, its effect, and this body.
    fn reaction(
        &mut self,
        header: &str,
        (trigger, effect): (&str, Option<&str>),
        body: &str,
    ) -> Member {
        let header = self.span(header);
        self.span("(");
        let trigger = TriggerNode::Variable(Reference::own(self.name(trigger)));
        let effect = effect.map(|name| EffectNode::Variable(Reference::own(self.name(name))));
        self.span("{=");
        let mut reaction = ReactionNode::new(Body::Text(self.span(body)), header);
        reaction.triggers.push(trigger);
        reaction.effects.extend(effect);
        Member::Reaction(reaction)
    }

    fn main(&mut self, main: &Main) -> ReactorNode {
        let mut reactor = ReactorNode::new(ReactorKind::Main, None, self.span("main reactor"));
        for (name, class) in main.instances {
            let instance = Instantiation::new(self.name(name), self.name(class));
            reactor.members.push(Member::Instantiation(instance));
        }
        for [from, out, to, inp] in main.connections {
            let span = self.span(&format!("{from}.{out} -> {to}.{inp}"));
            let left = Reference::contained(self.name(from), self.name(out));
            let right = Reference::contained(self.name(to), self.name(inp));
            let connection = ConnectionNode::new(vec![left], vec![right], span);
            reactor.members.push(Member::Connection(connection));
        }
        reactor
    }
}

/// Declares a program and compiles it.
pub(crate) fn compiled(main: &Main) -> Result<Compiled, CompileFailure> {
    let text = text(main);
    let mut places = Places { text: &text, at: 0 };
    let mut source = places.reactor("Source");
    source.members = vec![
        places.output(),
        places.timer(),
        places.reaction("reaction(t) -> out", ("t", Some("out")), " out.set(1) "),
    ];
    let mut sink = places.reactor("Sink");
    sink.members =
        vec![places.input(), places.reaction("reaction(inp)", ("inp", None), " print(inp.value) ")];
    let mut relay = places.reactor("Relay");
    let header = "reaction(inp) -> out";
    relay.members = vec![
        places.input(),
        places.output(),
        places.reaction(header, ("inp", Some("out")), " out.set(inp.value) "),
    ];
    let main = places.main(main);
    let mut report = Report::default();
    let mut library = Library::new("Main.lf", text.clone());
    for reactor in [source, sink, relay, main] {
        library.add_reactor(FileId::MAIN, reactor, &mut report);
    }
    let overrides = Overrides::default();
    let properties = TargetProperties::read(&library, &overrides, &mut report);
    compile(library, properties, &overrides, Purpose::Run, report)
}
