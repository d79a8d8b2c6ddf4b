//! The members of one reactor: what it declares, as the model has it.

use hprm_model::Span;
use hprm_model::declaration::{
    ActionNode, Attribute, AttributeArgument, Body, ConnectionNode, Deadline, Expression,
    ExpressionKind, Late, Member, ModeNode, Name, PortKind, PortNode, ReactionNode, TimerNode,
    Width, WidthTerm,
};

use crate::Malformed;
use crate::document::{self, Action, Child, Connection, Port, Reaction, Reactor, Timer};
use crate::places::Places;
use crate::references::{effect, no_mode, references, trigger};

/// All members but instances, in an order in which reactions and connections keep theirs.
/// `body` is what its reactions run.
pub(crate) fn members(
    reactor: &Reactor,
    body: Body,
    places: &Places,
) -> Result<Vec<Member>, Malformed> {
    let mut members = Vec::new();
    for port in &reactor.ports {
        members.push(Member::Port(self::port(port, places)?));
    }
    for mode in &reactor.modes {
        let header = places.span(mode.at)?;
        let name = Some(Name::new(mode.name.as_str(), header));
        let (initial, members_of_mode) = (mode.initial, Vec::new());
        members.push(Member::Mode(ModeNode { initial, name, members: members_of_mode, header }));
    }
    let mut add = |member, mode| {
        members.push(in_mode(member, mode, reactor)?);
        Ok::<_, Malformed>(())
    };
    for timer in &reactor.timers {
        add(Member::Timer(self::timer(timer, places)?), timer.mode)?;
    }
    for action in &reactor.actions {
        add(Member::Action(self::action(action, places)?), action.mode)?;
    }
    for connection in &reactor.connections {
        add(Member::Connection(self::connection(connection, places)?), connection.mode)?;
    }
    for reaction in &reactor.reactions {
        add(Member::Reaction(self::reaction(reaction, (reactor, body), places)?), reaction.mode)?;
    }
    Ok(members)
}

/// The member, in a mode of the reactor if it is in one.
pub(crate) fn in_mode(
    member: Member,
    mode: Option<usize>,
    reactor: &Reactor,
) -> Result<Member, Malformed> {
    match mode {
        None => Ok(member),
        Some(index) if index < reactor.modes.len() => Ok(Member::InMode(index, Box::new(member))),
        Some(index) => Err(no_mode(index)),
    }
}

/// What is stated of an instance beside its class.
pub(crate) fn attributes(child: &Child, span: Span) -> Vec<Attribute> {
    let maxwait = child.maxwait.map(|wait| attribute("maxwait", vec![time(wait, span)], span));
    let transient = child.transient.then(|| attribute("transient", Vec::new(), span));
    let restart = child.restart.as_ref().map(|stated| restart(stated, span));
    maxwait.into_iter().chain(transient).chain(restart).collect()
}

fn restart(stated: &document::Restart, span: Span) -> Attribute {
    let condition = literal(ExpressionKind::String(stated.condition.clone()), span);
    let others = [
        ("sec", stated.sec.map(|nanos| time(nanos, span))),
        ("burst", stated.burst.map(|number| literal(ExpressionKind::Integer(number), span))),
        ("interval", stated.interval.map(|nanos| time(nanos, span))),
    ];
    let argument = |(name, value): (&str, Option<Expression>)| {
        Some(AttributeArgument { name: Some(Name::new(name, span)), value: value? })
    };
    let mut attribute = attribute("restart", vec![condition], span);
    attribute.arguments.extend(others.into_iter().filter_map(argument));
    attribute
}

/// A width.
pub(crate) fn width(number: i64, span: Span) -> Width {
    Width { terms: vec![WidthTerm::Value(literal(ExpressionKind::Integer(number), span))], span }
}

fn literal(kind: ExpressionKind, span: Span) -> Expression {
    Expression { kind, span }
}

fn time(nanos: i64, span: Span) -> Expression {
    Expression::time(nanos, span)
}

/// An attribute with values that have no names.
pub(crate) fn attribute(name: &str, values: Vec<Expression>, span: Span) -> Attribute {
    let argument = |value| AttributeArgument { name: None, value };
    let arguments = values.into_iter().map(argument).collect();
    Attribute { name: Name::new(name, span), arguments, span }
}

fn port(port: &Port, places: &Places) -> Result<PortNode, Malformed> {
    let span = places.span(port.at)?;
    let kind = match port.kind {
        document::PortKind::Input => PortKind::Input { mutable: false },
        document::PortKind::Mutable => PortKind::Input { mutable: true },
        document::PortKind::Output => PortKind::Output,
    };
    let width = port.width.map(|number| width(number, span));
    Ok(PortNode { width, ..PortNode::new(kind, Name::new(port.name.as_str(), span)) })
}

fn timer(timer: &Timer, places: &Places) -> Result<TimerNode, Malformed> {
    let span = places.span(timer.at)?;
    Ok(TimerNode {
        attributes: Vec::new(),
        name: Name::new(timer.name.as_str(), span),
        offset: Some(time(timer.offset, span)),
        period: timer.period.map(|period| time(period, span)),
    })
}

fn action(action: &Action, places: &Places) -> Result<ActionNode, Malformed> {
    let span = places.span(action.at)?;
    let policy = action.policy.clone().map(ExpressionKind::String);
    Ok(ActionNode {
        attributes: Vec::new(),
        physical: Some(action.physical),
        name: Name::new(action.name.as_str(), span),
        min_delay: Some(time(action.min_delay, span)),
        spacing: action.spacing.map(|spacing| time(spacing, span)),
        policy: policy.map(|policy| literal(policy, span)),
        ty: None,
    })
}

fn connection(connection: &Connection, places: &Places) -> Result<ConnectionNode, Malformed> {
    let span = places.span(connection.at)?;
    let left = references(&connection.from, places)?;
    let right = references(&connection.to, places)?;
    let wait = connection.absent_after;
    let wait = wait.map(|wait| attribute("absent_after", vec![time(wait, span)], span));
    let bound = connection.bound.as_ref().map(|(messages, policy)| {
        let values = [ExpressionKind::Integer(*messages), ExpressionKind::String(policy.clone())];
        attribute("bound", values.map(|kind| literal(kind, span)).into(), span)
    });
    let compress = connection.compress.then(|| attribute("compress", Vec::new(), span));
    Ok(ConnectionNode {
        attributes: wait.into_iter().chain(bound).chain(compress).collect(),
        iterated: connection.repeated,
        physical: connection.physical,
        delay: connection.after.map(|after| time(after, span)),
        serializer: connection.serializer.as_ref().map(|name| Name::new(name.as_str(), span)),
        ..ConnectionNode::new(left, right, span)
    })
}

fn reaction(
    reaction: &Reaction,
    (reactor, body): (&Reactor, Body),
    places: &Places,
) -> Result<ReactionNode, Malformed> {
    let span = places.span(reaction.at)?;
    let triggers = reaction.triggers.iter().map(|it| trigger(it, span, places));
    let effects = reaction.effects.iter().map(|it| effect(it, &reactor.modes, places));
    Ok(ReactionNode {
        name: Some(Name::new(reaction.name.as_str(), span)),
        triggers: triggers.collect::<Result<_, _>>()?,
        sources: references(&reaction.sources, places)?,
        effects: effects.collect::<Result<_, _>>()?,
        late: reaction.tardy.then_some(Late { wait: None, body: Some(body) }),
        deadline: reaction.deadline.map(|delay| Deadline { delay: time(delay, span), body }),
        ..ReactionNode::new(body, span)
    })
}
