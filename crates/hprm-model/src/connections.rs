//! Connections between instances, channel by channel.
//!
//! The channels of `bank.port` are the bank's members one after the other, each with all its
//! channels; `interleaved` turns that around. Both sides are laid out in a row and joined in order.

use hprm_core::{Connection, Delay, PortId};

use crate::check::attributes;
use crate::compiled::Ports;
use crate::diagnostic::{Diagnostic, Report};
use crate::instance::{MAX, Node, Tree};
use crate::legacy::Waits;
use crate::model::{self, End, Entity};
use crate::source::Span;

/// A connection between two channels, its place in the text, and whether the text says how long the
/// receiver waits.
pub(crate) struct PortConnection {
    pub(crate) connection: Connection,
    pub(crate) span: Span,
    states_wait: bool,
}

/// All connections of the program, in the order of their containers.
pub(crate) fn connections(
    tree: &Tree<'_>,
    mut waits: Waits,
    report: &mut Report,
) -> Vec<PortConnection> {
    let mut connections = Vec::new();
    let mut left = MAX;
    for (container, node) in tree.nodes.iter().enumerate() {
        for connection in &node.model.connections {
            if join(tree, container, connection, (&mut connections, &mut left), report).is_none() {
                let message = format!("the connections join more than {MAX} channels");
                report.add(
                    Diagnostic::error("LF0406", connection.decl.span, message)
                        .hint("reduce the widths of banks, or name fewer ports"),
                );
                return connections;
            }
        }
    }
    waits.spread(connections.iter().map(|it| &it.connection));
    for it in connections.iter_mut().filter(|it| !it.states_wait) {
        it.connection.absent_after = waits.of(it.connection.to);
    }
    cycles(tree, &connections, report);
    connections
}

/// The channels of one end of a connection in `node`, or those that a reaction of it names. A member or a channel that
/// there is not is reported.
pub(crate) fn channels(
    tree: &Tree<'_>,
    node: &Node<'_>,
    end: End,
    report: &mut Report,
) -> Vec<PortId> {
    match end.entity {
        Entity::Port(port) => some_of(end, node.ports[port], report),
        Entity::Contained { instance, port } => {
            let bank = &node.children[instance];
            let members = match end.member {
                None => &bank[..],
                Some(member) => match bank.get(member as usize) {
                    Some(node) => std::slice::from_ref(node),
                    None => {
                        report.add(beyond(end.span, ("member", "members"), member, bank.len()));
                        &[]
                    }
                },
            };
            let ports = members.iter().map(|member| tree.nodes[*member].ports[port]);
            let rows: Vec<_> = ports.map(|ports| some_of(end, ports, report)).collect();
            if end.interleaved { transposed(&rows) } else { rows.concat() }
        }
        // A connection to one of these has been refused.
        Entity::Timer(_) | Entity::Action(_) | Entity::Mode(..) => Vec::new(),
    }
}

/// The channels of one port, or the only one that is meant.
fn some_of(end: End, ports: Ports, report: &mut Report) -> Vec<PortId> {
    let mut channels = ports.channels();
    let Some(channel) = end.channel else { return channels.collect() };
    let only = channels.nth(channel as usize);
    if only.is_none() {
        let count = ports.width.unwrap_or(1) as usize;
        report.add(beyond(end.span, ("channel", "channels"), channel, count));
    }
    only.into_iter().collect()
}

/// The error for a member or a channel that there is not.
fn beyond(span: Span, (one, several): (&str, &str), index: u32, count: usize) -> Diagnostic {
    let message = format!("there is no {one} {index} here");
    let hint = match count {
        1 => format!("there is only {one} 0"),
        _ => format!("there are {count} {several}, from 0 to {}", count.saturating_sub(1)),
    };
    Diagnostic::error("LF0312", span, message).hint(hint)
}

fn transposed(rows: &[Vec<PortId>]) -> Vec<PortId> {
    let longest = rows.iter().map(Vec::len).max().unwrap_or(0);
    (0..longest).flat_map(|i| rows.iter().filter_map(move |row| row.get(i)).copied()).collect()
}

/// Adds the connections between channels of one declaration; `None` if it names more channels than are
/// still allowed.
fn join(
    tree: &Tree<'_>,
    container: usize,
    connection: &model::ResolvedConnection<'_>,
    (connections, budget): (&mut Vec<PortConnection>, &mut usize),
    report: &mut Report,
) -> Option<()> {
    let decl = connection.decl;
    let environment = &tree.nodes[container].environment;
    let mut row = |ends: &[End], report: &mut Report| -> Option<Vec<PortId>> {
        let mut row = Vec::new();
        for end in ends {
            row.extend(channels(tree, &tree.nodes[container], *end, report));
            *budget = budget.checked_sub(1)?;
            if row.len() > *budget {
                return None;
            }
        }
        *budget -= row.len();
        Some(row)
    };
    let mode = connection.mode.map(|mode| tree.nodes[container].modes[mode]);
    let known = report.errors();
    let (left, right) = (row(&connection.left, report)?, row(&connection.right, report)?);
    if report.errors() > known {
        return Some(());
    }
    check_widths(decl, left.len(), right.len(), report);
    let delay = decl
        .delay
        .as_ref()
        .map_or(Some(Delay::None), |written| environment.time(written, report).map(Delay::after));
    let wait = attributes::argument(&decl.attributes, "absent_after");
    let absent_after = wait.and_then(|written| environment.time(written, report));
    let bound = attributes::bound(&decl.attributes).filter(|_| decl.physical);
    // A wrong delay has been reported; a microstep keeps it from looking like a causality loop too.
    let delay = delay.unwrap_or(Delay::Microstep);
    let repeats = if decl.iterated { usize::MAX } else { 1 };
    let sources = left.iter().cycle().take(left.len().saturating_mul(repeats));
    for (from, to) in sources.zip(right) {
        let connection = Connection {
            from: *from,
            to,
            delay,
            physical: decl.physical,
            serializer: decl.serializer.as_ref().map(|name| name.text.clone()),
            absent_after: absent_after.unwrap_or_default(),
            compress: attributes::is_there(&decl.attributes, "compress"),
            bound,
            mode,
        };
        let states_wait = absent_after.is_some_and(|wait| wait > 0);
        connections.push(PortConnection { connection, span: decl.span, states_wait });
    }
    Some(())
}

fn check_widths(
    decl: &crate::declaration::ConnectionNode,
    left: usize,
    right: usize,
    report: &mut Report,
) {
    let repeated = report.syntax().repeated();
    let mut warn = |message: String, hint: &str| {
        report.add(Diagnostic::warning("LF0501", decl.span, message).hint(hint));
    };
    let channels = |n: usize| if n == 1 { "1 channel".to_owned() } else { format!("{n} channels") };
    let sides = format!("{} to {}", channels(left), channels(right));
    if decl.iterated {
        if left > right {
            warn(format!("this broadcast joins {sides}"), "the rest on the left is not connected");
        } else if left > 0 && !right.is_multiple_of(left) {
            let hint = "the last round on the left is not complete";
            warn(format!("this broadcast joins {sides}, which does not divide"), hint);
        }
    } else if left > right {
        warn(format!("this connection joins {sides}"), "the rest on the left is not connected");
    } else if left < right {
        let hint = format!("the rest on the right stays absent; {repeated}");
        warn(format!("this connection joins {sides}"), &hint);
    }
}

/// Plain connections in a cycle have no source, and the runtime would search for it for ever.
fn cycles(tree: &Tree<'_>, connections: &[PortConnection], report: &mut Report) {
    let ports = tree.nodes.iter().flat_map(|node| &node.ports);
    let count = ports.map(|ports| ports.channels().count()).sum();
    let mut upstream: Vec<Option<(PortId, Span)>> = vec![None; count];
    for PortConnection { connection, span, .. } in
        connections.iter().filter(|it| it.connection.is_direct())
    {
        upstream[connection.to.index()] = Some((connection.from, *span));
    }
    // Each port gets the number of the walk that first reached it; a walk that reaches a port with its own
    // number has found a cycle.
    let mut walked = vec![usize::MAX; count];
    for start in 0..count {
        let mut here = PortId(u32::try_from(start).expect("ports are counted in u32"));
        while walked[here.index()] == usize::MAX {
            walked[here.index()] = start;
            let Some((next, span)) = upstream[here.index()] else { break };
            if walked[next.index()] == start {
                let message = "connections form a cycle without a delay and without a reaction";
                report
                    .add(Diagnostic::error("LF0503", span, message).hint(
                        "no reaction sets any of these ports; remove one of the connections",
                    ));
                break;
            }
            here = next;
        }
    }
}
