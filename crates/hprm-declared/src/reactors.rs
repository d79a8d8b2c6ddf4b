//! The declarations of a document as a library: each reactor after those that it contains.

use hprm_model::declaration::{Instantiation, Member, Name, ReactorKind, ReactorNode};
use hprm_model::{ClassId, Diagnostic, FileId, Library, Report};

use crate::Malformed;
use crate::document::{At, Child, Document, Reactor};
use crate::members::{attributes, in_mode, members, width};
use crate::places::Places;
use crate::properties;

/// The longest name, in characters.
const LONGEST_NAME: usize = 255;

/// A document that becomes a library.
pub(crate) struct Reactors<'d> {
    document: &'d Document,
    places: Places,
    library: Library,
    /// By reactor, its class.
    classes: Vec<Option<ClassId>>,
}

impl<'d> Reactors<'d> {
    /// Begins a library, and reports names that are too long.
    pub(crate) fn new(document: &'d Document, report: &mut Report) -> Result<Self, Malformed> {
        let names = names(document);
        let connections = document.reactors.iter().flat_map(|reactor| &reactor.connections);
        let mut last = vec![1; document.files.len()];
        for (file, line, ..) in names.iter().map(|(at, _)| *at).chain(connections.map(|it| it.at)) {
            if let Some(last) = last.get_mut(file) {
                *last = line.max(*last);
            }
        }
        let (places, library) = Places::new(&document.files, |file| last[file])?;
        for (at, name) in names {
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

    /// The library, with all reactors that the main reactor needs.
    pub(crate) fn into_library(mut self) -> Result<Library, Malformed> {
        let Document { properties, main, .. } = self.document;
        for index in self.order()? {
            let node = self.reactor(index)?;
            self.classes[index] = Some(self.library.add_unlisted(node.header.file, node));
        }
        let reactor = self.known(*main)?;
        if reactor.at.0 != FileId::MAIN.index() {
            return Err(Malformed::new("the main reactor is not in the first file"));
        }
        self.library.set_main(self.class(*main)?);
        let properties = properties::properties(properties, &self.places)?;
        self.library.set_properties(FileId::MAIN, properties);
        Ok(self.library)
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
        let kind = match (reactor.federated, index == self.document.main) {
            (true, _) => ReactorKind::Federated,
            (false, true) => ReactorKind::Main,
            (false, false) => ReactorKind::Plain,
        };
        let name = Some(Name::new(reactor.name.as_str(), header));
        let mut node = ReactorNode::new(kind, name, header);
        node.members = members(reactor, &self.places)?;
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

/// Everything that is declared under a name, and its place.
fn names(document: &Document) -> Vec<(At, &str)> {
    let mut names = Vec::new();
    for reactor in &document.reactors {
        names.push((reactor.at, reactor.name.as_str()));
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
