//! Reactors that are executables: a program states their ports and parameters, and the executable declares the rest.
//!
//! Such a reactor names a command, by the attribute `executable`. A front end has it asked what it declares, and
//! puts that into the [`Library`]; from then on it is a reactor like all others. Asking is up to the front end,
//! and what the command may be is up to what asks. Which values the parameters have is found by [`variants`].

use std::collections::BTreeSet;

use crate::check::attributes;
use crate::compiled::ExecutableFederate;
use crate::declaration::{
    Attribute, Expression, ExpressionKind, Member, Name, PortKind, PortNode, ReactorKind,
    ReactorNode, Width, WidthTerm,
};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::given::Given;
use crate::library::{ClassId, Library};
use crate::overrides::Overrides;
use crate::source::Span;
use crate::variants;

/// The attribute.
pub(crate) const ATTRIBUTE: &str = "executable";

/// A reactor that is an executable.
#[derive(Clone, PartialEq, Debug)]
pub struct Executable {
    /// The reactor.
    pub class: ClassId,
    /// The path of the executable, as the program states it, and the arguments that it gets.
    pub command: Vec<String>,
    /// The path of the file that states it.
    pub file: String,
    /// Where that is stated.
    pub span: Span,
    /// The values of its parameters.
    pub parameters: Vec<GivenParameter>,
    /// The first of its instances, if it has one.
    pub instance: Option<Span>,
}

impl Executable {
    /// The names and the values of its parameters.
    #[must_use]
    pub fn given(&self) -> Vec<(String, Given)> {
        self.parameters.iter().map(|it| (it.name.clone(), it.value.clone())).collect()
    }
}

/// A parameter of an executable, and its value.
#[derive(Clone, PartialEq, Debug)]
pub struct GivenParameter {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: Given,
    /// Where the reactor has it.
    pub declared: Span,
    /// Where the value is stated.
    pub stated: Span,
}

/// Why an executable does not take the parameters that it is given.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Refusal {
    /// The parameter, if it is because of one.
    pub parameter: Option<String>,
    /// What is wrong.
    pub refused: Refused,
    /// The names of the parameters that it has, and their types.
    pub known: Vec<(String, String)>,
}

/// What is wrong with a parameter of an executable.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Refused {
    /// The executable has it, and the program does not.
    Missing,
    /// The program has it, and the executable does not.
    Unknown,
    /// The value does not fit: why.
    Wrong(String),
}

impl Library {
    /// The executables that the main file needs; those in which something is wrong are reported instead. Instances
    /// whose parameters have other values are reactors of their own from then on.
    #[must_use]
    pub fn executables(&mut self, overrides: &Overrides, report: &mut Report) -> Vec<Executable> {
        let executables = self.named_executables(report);
        match report.has_errors() {
            true => executables,
            false => variants::split(self, executables, overrides, report),
        }
    }

    fn named_executables(&self, report: &mut Report) -> Vec<Executable> {
        let mut executables = Vec::new();
        let mut seen = BTreeSet::new();
        let mut pending: Vec<_> = self.classes_of_main().collect();
        pending.reverse();
        while let Some(class) = pending.pop() {
            if !seen.insert(class) {
                continue;
            }
            let node = self.reactor(class);
            let superclasses = || node.extends.iter().map(|name| self.meant(class, name));
            for (name, known) in node.extends.iter().zip(superclasses()) {
                if known.is_some_and(|known| attribute_of(self.reactor(known)).is_some()) {
                    let message = format!("`{}` is an executable: nothing extends it", name.text);
                    report.add(Diagnostic::error("LF1101", name.span, message));
                }
            }
            pending.extend(superclasses().flatten());
            self.contents(class, &node.members, &mut pending);
            let Some(attribute) = attribute_of(node) else { continue };
            let known = report.errors();
            has_ports_only(node, report);
            let command = command(attribute, report);
            if report.errors() == known {
                let file = self.sources.path(self.file_of(class)).to_owned();
                let (span, parameters) = (attribute.span, Vec::new());
                executables.push(Executable {
                    class,
                    command,
                    file,
                    span,
                    parameters,
                    instance: None,
                });
            }
        }
        executables
    }

    /// States what an executable has declared: that becomes the reactor, with the ports that the program states.
    /// Ports that differ are reported.
    pub fn fill(
        &mut self,
        executable: &Executable,
        declared: ReactorNode,
        how: ExecutableFederate,
        report: &mut Report,
    ) {
        self.compare_ports(executable, &declared, &how.command, report);
        let others = declared.members.into_iter().filter(|it| !matches!(it, Member::Port(_)));
        self.reactor_mut(executable.class).members.extend(others);
        self.executables.insert(executable.class, how);
    }

    /// Reports that an executable does not take its parameters.
    pub fn refuse(
        &self,
        executable: &Executable,
        refusal: &Refusal,
        command: &[String],
        report: &mut Report,
    ) {
        let node = self.reactor(executable.class);
        let reactor = self.shown_reactor(executable);
        let path = command.first().map_or("", String::as_str);
        let named = refusal.parameter.as_deref();
        let name = named.unwrap_or_default();
        let given = executable.parameters.iter().find(|it| it.name == name);
        let of = |name: &str| refusal.known.iter().find(|(known, _)| known == name);
        let names = refusal.known.iter().map(|(name, _)| name.as_str());
        report.add(match (&refusal.refused, given) {
            (Refused::Missing, _) => {
                let shown = of(name).map_or_else(|| name.to_owned(), shown_parameter);
                let message = format!(
                    "the executable {path} needs the parameter `{shown}`, and {reactor} has none of \
                     that name"
                );
                let known: Vec<_> = refusal.known.iter().map(shown_parameter).collect();
                let hint = format!("the executable has `{}`", known.join("`, `"));
                Diagnostic::error("LF1105", node.header, message).hint(hint)
            }
            (Refused::Unknown, given) => {
                let span = given.map_or(node.header, |it| it.declared);
                let message = format!(
                    "the executable {path} has no parameter `{name}`, and {reactor} has one"
                );
                let hint = existing(name, "its parameters", names);
                Diagnostic::error("LF1105", span, message).hint(hint)
            }
            (Refused::Wrong(why), given) => {
                let what = named.map_or("the parameters".to_owned(), |name| format!("`{name}`"));
                let message =
                    format!("the executable {path} does not take {what} of {reactor}: {why}");
                let instance = executable.instance.unwrap_or(node.header);
                let stated = given.map_or(instance, |it| it.stated);
                let declared = given.map(|it| it.declared).filter(|span| *span != stated);
                let hint = of(name).map(shown_parameter);
                let hint = hint.map(|shown| format!("it has the parameter `{shown}`"));
                let error = Diagnostic::error("LF1106", stated, message).maybe_hint(hint);
                match declared {
                    Some(span) => error.label(span, "the program declares it here"),
                    None => error,
                }
            }
        });
    }

    /// A reactor as messages show it: its name, and where it is.
    fn shown_reactor(&self, executable: &Executable) -> String {
        let node = self.reactor(executable.class);
        let place = self.sources.position(node.header).line;
        let name = node.name.as_ref().map_or("the reactor", |name| &name.text);
        format!("{name} in {}:{place}", executable.file)
    }

    fn compare_ports(
        &self,
        executable: &Executable,
        declared: &ReactorNode,
        command: &[String],
        report: &mut Report,
    ) {
        let node = self.reactor(executable.class);
        let reactor = self.shown_reactor(executable);
        let path = command.first().map_or("", String::as_str);
        let shown = |port: &PortNode| shown(port, &executable.parameters);
        let theirs: Vec<_> = ports(declared).collect();
        let differ = |theirs: String, ours: String| {
            format!("the executable {path} declares {theirs}, and {reactor} has {ours}")
        };
        let hint = "the ports of both must have the same names, directions and widths";
        for port in ports(node) {
            let Some(ours) = shown(port) else { continue };
            let other = theirs.iter().find(|other| other.name.text == port.name.text);
            let other = match other {
                Some(other) => shown(other).unwrap_or_default(),
                None => format!("no port `{}`", port.name.text),
            };
            if ours != other {
                let message = differ(other, ours);
                report.add(Diagnostic::error("LF1103", port.name.span, message).hint(hint));
            }
        }
        let missing = theirs.iter().filter(|it| ports(node).all(|o| o.name.text != it.name.text));
        let missing: Vec<_> = missing.filter_map(|port| shown(port)).collect();
        if !missing.is_empty() {
            let ours = if missing.len() == 1 { "no such port" } else { "no such ports" };
            let message = differ(missing.join(" and "), ours.to_owned());
            report.add(Diagnostic::error("LF1103", node.header, message).hint(hint));
        }
    }

    /// Adds the classes of what is inside.
    fn contents(&self, class: ClassId, members: &[Member], found: &mut Vec<ClassId>) {
        for member in members {
            match member {
                Member::Instantiation(instance) => match &instance.members {
                    Some(members) => found.extend(members),
                    None => found.extend(self.meant(class, &instance.class)),
                },
                Member::Mode(mode) => self.contents(class, &mode.members, found),
                Member::InMode(_, member) => {
                    self.contents(class, std::slice::from_ref(&**member), found);
                }
                _ => {}
            }
        }
    }

    /// The class that a name means in the file of another one.
    fn meant(&self, class: ClassId, name: &Name) -> Option<ClassId> {
        self.find(self.file_of(class), &name.text)
    }
}

/// Whether a reactor is an executable.
pub(crate) fn is_executable(node: &ReactorNode) -> bool {
    attribute_of(node).is_some()
}

fn attribute_of(node: &ReactorNode) -> Option<&Attribute> {
    attributes::find(&node.attributes, ATTRIBUTE)
}

/// The path and the arguments that the attribute states.
fn command(attribute: &Attribute, report: &mut Report) -> Vec<String> {
    let mut command = Vec::new();
    for argument in &attribute.arguments {
        match (&argument.name, &argument.value.kind) {
            (None, ExpressionKind::String(text)) if !text.contains('\0') => {
                command.push(text.clone());
            }
            _ => report.add(malformed(argument.value.span, report)),
        }
    }
    if command.first().is_none_or(String::is_empty) {
        report.add(malformed(attribute.span, report));
    }
    command
}

fn malformed(span: Span, report: &Report) -> Diagnostic {
    let syntax = report.syntax();
    let message = format!(
        "{} takes the path of a file, and perhaps arguments: texts",
        syntax.option(ATTRIBUTE)
    );
    Diagnostic::error("LF0212", span, message).hint(syntax.executable())
}

/// Reports everything that an executable declares itself.
fn has_ports_only(node: &ReactorNode, report: &mut Report) {
    const HINT: &str =
        "the program states its ports and parameters, and the executable declares the rest";
    let mut refuse = |span, message: &str| {
        report.add(Diagnostic::error("LF1101", span, message).hint(HINT));
    };
    if node.kind != ReactorKind::Plain {
        refuse(node.header, "the main reactor of a program is no executable");
    }
    if let Some(name) = node.extends.first() {
        refuse(name.span, "an executable extends no reactor");
    }
    for member in &node.members {
        if let Some((span, what)) = beyond_ports(member) {
            refuse(span, &format!("{what} cannot be declared here: the reactor is an executable"));
        }
    }
}

/// The place of a member that is no port, and what it is.
fn beyond_ports(member: &Member) -> Option<(Span, &'static str)> {
    Some(match member {
        Member::Port(_) => return None,
        Member::Preamble(span) => (*span, "a preamble"),
        Member::State(state) => (state.name.span, "a state variable"),
        Member::Method(method) => (method.name.span, "a method"),
        Member::Timer(timer) => (timer.name.span, "a timer"),
        Member::Action(action) => (action.name.span, "an action"),
        Member::Watchdog(watchdog) => (watchdog.name.span, "a watchdog"),
        Member::Instantiation(instance) => (instance.name.span, "a contained reactor"),
        Member::Connection(connection) => (connection.span, "a connection"),
        Member::Reaction(reaction) => (reaction.header, "a reaction"),
        Member::Mode(mode) => (mode.header, "a mode"),
        Member::InMode(_, member) => return beyond_ports(member),
    })
}

fn ports(node: &ReactorNode) -> impl Iterator<Item = &PortNode> {
    node.members.iter().filter_map(|member| match member {
        Member::Port(port) => Some(port),
        _ => None,
    })
}

/// A port as messages show it; none if its width is wrong, which is reported elsewhere.
fn shown(port: &PortNode, parameters: &[GivenParameter]) -> Option<String> {
    let kind = match port.kind {
        PortKind::Input { .. } => "input",
        PortKind::Output => "output",
    };
    let name = &port.name.text;
    match &port.width {
        None => Some(format!("{kind} `{name}`")),
        Some(width) => Some(format!("{kind} `{name}[{}]`", number(width, parameters)?)),
    }
}

/// A width, in which parameters of the executable may stand.
fn number(width: &Width, parameters: &[GivenParameter]) -> Option<i64> {
    let term = |term: &WidthTerm| match term {
        WidthTerm::Value(Expression { kind: ExpressionKind::Integer(number), .. }) => Some(*number),
        WidthTerm::Value(Expression { kind: ExpressionKind::Parameter(name), .. }) => {
            match parameters.iter().find(|it| it.name == *name)?.value {
                Given::Integer(number) => Some(number),
                _ => None,
            }
        }
        _ => None,
    };
    width.terms.iter().map(term).sum()
}

/// A parameter of an executable as messages show it.
fn shown_parameter((name, ty): &(String, String)) -> String {
    match ty.as_str() {
        "" => name.clone(),
        ty => format!("{name}: {ty}"),
    }
}
