//! The declarations of a document as a library: each reactor after those that it contains.

use hprm_model::declaration::{
    Attribute, Body, Expression, ExpressionKind, Instantiation, Member, Name, Parameter,
    ReactorKind, ReactorNode,
};
use hprm_model::{ClassId, Diagnostic, FileId, Given, Library, Report, Span};

use crate::Malformed;
use crate::document::{At, Child, Document, Executable, Reactor};
use crate::members::{attribute, attributes, in_mode, members, width};
use crate::places::Places;
use crate::properties;

/// The longest name, in characters.
const LONGEST_NAME: usize = 255;

/// The library of a document, with all reactors that its main reactor needs. Reports names that are too long.
pub(crate) fn library(document: &Document, report: &mut Report) -> Result<Library, Malformed> {
    let (places, mut library) = Places::new(&document.files, last_lines(document))?;
    let mut reactors = Reactors::new(document, places, &mut library, report)?;
    let Document { properties, main, .. } = document;
    for index in reactors.order()? {
        reactors.add(index)?;
    }
    let reactor = reactors.known(*main)?;
    if reactor.at.0 != FileId::MAIN.index() {
        return Err(Malformed::new("the main reactor is not in the first file"));
    }
    let class = match document.executable {
        Some(Executable::Federate) => reactors.alone(reactor)?,
        _ => reactors.class(*main)?,
    };
    let properties = properties::properties(properties, &reactors.places)?;
    library.set_main(class);
    library.set_properties(FileId::MAIN, properties);
    Ok(library)
}

/// The main reactor of a document that is part of another program, whose library gets what it contains. Reports
/// names that are too long.
pub(crate) fn part(
    document: &Document,
    library: &mut Library,
    report: &mut Report,
) -> Result<ReactorNode, Malformed> {
    let places = Places::within(&document.files, last_lines(document), library);
    let mut reactors = Reactors::new(document, places, library, report)?;
    let order = reactors.order()?;
    for index in order.into_iter().filter(|index| *index != document.main) {
        reactors.add(index)?;
    }
    reactors.reactor(document.main)
}

/// By file, the last line that has a part of the program.
fn last_lines(document: &Document) -> impl Fn(usize) -> u32 {
    let connections = document.reactors.iter().flat_map(|reactor| &reactor.connections);
    let mut last = vec![1; document.files.len()];
    let places = names(document).into_iter().map(|(at, _)| at);
    for (file, line, ..) in places.chain(connections.map(|it| it.at)) {
        if let Some(last) = last.get_mut(file) {
            *last = line.max(*last);
        }
    }
    move |file| last[file]
}

/// A document whose reactors are put into a library.
struct Reactors<'d> {
    document: &'d Document,
    places: Places,
    library: &'d mut Library,
    /// By reactor, its class.
    classes: Vec<Option<ClassId>>,
}

impl<'d> Reactors<'d> {
    fn new(
        document: &'d Document,
        places: Places,
        library: &'d mut Library,
        report: &mut Report,
    ) -> Result<Self, Malformed> {
        for (at, name) in names(document) {
            if !is_name(name) {
                return Err(Malformed::new(format!("{name:?} is no name")));
            }
            if name.chars().count() > LONGEST_NAME {
                let message = format!("a name has at most {LONGEST_NAME} characters");
                report.add(Diagnostic::error("LF0007", places.span(at)?, message));
            }
        }
        let classes = vec![None; document.reactors.len()];
        Ok(Self { document, places, library, classes })
    }

    fn add(&mut self, index: usize) -> Result<(), Malformed> {
        let node = self.reactor(index)?;
        self.classes[index] = Some(self.library.add_unlisted(node.header.file, node));
        Ok(())
    }

    /// A program that has nothing but the main reactor of this document, which is a part of other programs.
    fn alone(&mut self, main: &Reactor) -> Result<ClassId, Malformed> {
        let header = self.places.span(main.at)?;
        let name = || Name::new(main.name.as_str(), header);
        let class = self.class(self.document.main)?;
        let instance =
            Instantiation { members: Some(vec![class]), ..Instantiation::new(name(), name()) };
        let mut node = ReactorNode::new(ReactorKind::Main, None, header);
        node.members.push(Member::Instantiation(instance));
        self.library.set_part();
        Ok(self.library.add_unlisted(header.file, node))
    }

    /// The reactors that the main reactor needs, each after those that it contains.
    fn order(&self) -> Result<Vec<usize>, Malformed> {
        #[derive(Clone, Copy)]
        enum Visit {
            Not,
            Open,
            Done,
        }
        let mut visits = vec![Visit::Not; self.document.reactors.len()];
        let mut order = Vec::new();
        let contents = |index| {
            let children = &self.known(index)?.children;
            Ok(children.iter().flat_map(|child| child.members.iter().copied()))
        };
        let mut path = vec![(self.document.main, contents(self.document.main)?)];
        visits[self.document.main] = Visit::Open;
        while let Some((index, inside)) = path.last_mut() {
            let Some(next) = inside.next() else {
                visits[*index] = Visit::Done;
                order.push(*index);
                path.pop();
                continue;
            };
            let inside = contents(next)?;
            match visits[next] {
                Visit::Done => {}
                Visit::Open => {
                    return Err(Malformed::new(format!("reactor {next} contains itself")));
                }
                Visit::Not => {
                    visits[next] = Visit::Open;
                    path.push((next, inside));
                }
            }
        }
        Ok(order)
    }

    fn known(&self, index: usize) -> Result<&'d Reactor, Malformed> {
        let known = self.document.reactors.get(index);
        known.ok_or_else(|| Malformed::new(format!("it has no reactor {index}")))
    }

    /// The class of a reactor that has been added.
    fn class(&self, index: usize) -> Result<ClassId, Malformed> {
        let class = self.classes.get(index).copied().flatten();
        class.ok_or_else(|| Malformed::new(format!("it has no reactor {index}")))
    }

    fn reactor(&self, index: usize) -> Result<ReactorNode, Malformed> {
        let reactor = self.known(index)?;
        let header = self.places.span(reactor.at)?;
        let is_part = self.document.executable == Some(Executable::Federate);
        let kind = match (reactor.federated, index == self.document.main && !is_part) {
            (true, _) => ReactorKind::Federated,
            (false, true) => ReactorKind::Main,
            (false, false) => ReactorKind::Plain,
        };
        let name = Some(Name::new(reactor.name.as_str(), header));
        let mut node = ReactorNode::new(kind, name, header);
        node.attributes = executable(reactor, header).into_iter().collect();
        node.parameters = parameters(reactor, header);
        let body = self.document.executable.map_or(Body::Bound, |_| Body::OfExecutable);
        node.members = members(reactor, body, &self.places)?;
        for child in &reactor.children {
            let instance = Member::Instantiation(self.instance(child)?);
            node.members.push(in_mode(instance, child.mode, reactor)?);
        }
        Ok(node)
    }

    fn instance(&self, child: &Child) -> Result<Instantiation, Malformed> {
        let span = self.places.span(child.at)?;
        let members = child.members.iter().map(|index| self.class(*index));
        let members: Vec<ClassId> = members.collect::<Result<_, _>>()?;
        let class = match child.members.first() {
            Some(first) => self.known(*first)?.name.as_str(),
            None => child.name.as_str(),
        };
        if !child.bank && members.len() != 1 {
            let message = format!("`{}` has {} members and is no bank", child.name, members.len());
            return Err(Malformed::new(message));
        }
        let count = i64::try_from(members.len()).unwrap_or(i64::MAX);
        let host = child.host.as_ref().map(|host| Name::new(host.as_str(), span));
        Ok(Instantiation {
            attributes: attributes(child, span),
            width: child.bank.then(|| width(count, span)),
            members: Some(members),
            host,
            ..Instantiation::new(Name::new(child.name.as_str(), span), Name::new(class, span))
        })
    }
}

/// What says that a reactor is an executable.
fn executable(reactor: &Reactor, span: Span) -> Option<Attribute> {
    let (path, arguments) = reactor.executable.split_first()?;
    let texts = [path].into_iter().chain(arguments);
    let literal = |text: &String| Expression { kind: ExpressionKind::String(text.clone()), span };
    Some(attribute("executable", texts.map(literal).collect(), span))
}

/// The parameters of an executable. Those of other reactors the program has used itself.
fn parameters(reactor: &Reactor, span: Span) -> Vec<Parameter> {
    let parameter = |(name, value): &(String, Given)| Parameter {
        attributes: Vec::new(),
        name: Name::new(name.as_str(), span),
        ty: None,
        default: None,
        given: Some(value.clone()),
    };
    reactor.parameters.iter().map(parameter).collect()
}

/// Everything that is declared under a name, and its place.
fn names(document: &Document) -> Vec<(At, &str)> {
    let mut names = Vec::new();
    for reactor in &document.reactors {
        names.push((reactor.at, reactor.name.as_str()));
        names.extend(reactor.parameters.iter().map(|(name, _)| (reactor.at, name.as_str())));
        names.extend(reactor.ports.iter().map(|it| (it.at, it.name.as_str())));
        names.extend(reactor.timers.iter().map(|it| (it.at, it.name.as_str())));
        names.extend(reactor.actions.iter().map(|it| (it.at, it.name.as_str())));
        names.extend(reactor.modes.iter().map(|it| (it.at, it.name.as_str())));
        names.extend(reactor.children.iter().map(|it| (it.at, it.name.as_str())));
        names.extend(reactor.reactions.iter().map(|it| (it.at, it.name.as_str())));
    }
    names
}

/// Whether it is an identifier, as far as that matters here: names of parts are put together with dots.
fn is_name(text: &str) -> bool {
    let fits = |c: char| match c.is_ascii() {
        true => c.is_ascii_alphanumeric() || c == '_',
        false => !c.is_whitespace() && !c.is_control(),
    };
    !text.is_empty() && text.chars().all(fits) && !text.starts_with(|c: char| c.is_ascii_digit())
}
