//! Inputs that nothing is connected to, where that keeps a reaction from ever running.
//!
//! An input that is left open is often meant to be optional, and an output that is not used is no
//! mistake. A reaction that only such inputs trigger is one.

use std::collections::BTreeMap;

use hprm_core::PortId;

use crate::connections::PortConnection;
use crate::declaration::PortKind;
use crate::diagnostic::{Diagnostic, Report};
use crate::instance::Node;
use crate::model::{Entity, ResolvedTrigger};
use crate::source::Span;

/// Warns about instances with such inputs. `written` are the ports that reactions set.
pub(crate) fn check(
    nodes: &[Node<'_>],
    connections: &[PortConnection],
    written: impl Iterator<Item = PortId>,
    report: &mut Report,
) {
    let open = Open::new(nodes, connections, written);
    for node in nodes {
        for (instance, members) in node.children.iter().enumerate() {
            let decl = node.model.declared.instances[instance].decl;
            if let Some((names, reaction)) = open.of_bank(nodes, members) {
                let inputs: Vec<_> =
                    names.iter().map(|name| format!("`{}.{name}`", decl.name.text)).collect();
                let message = format!("nothing is connected to {}", inputs.join(" and "));
                let hint =
                    report.syntax().connection_to(&format!("{}.{}", decl.name.text, names[0]));
                report.add(
                    Diagnostic::warning("LF0505", decl.name.span, message)
                        .label(reaction, "so this reaction never runs")
                        .hint(hint),
                );
            }
        }
    }
}

/// Which channels stay absent because the input that they begin at is connected to nothing.
struct Open {
    /// By channel: the input at which its connections begin, if nothing sets that.
    root: Vec<Option<PortId>>,
}

impl Open {
    fn new(
        nodes: &[Node<'_>],
        connections: &[PortConnection],
        written: impl Iterator<Item = PortId>,
    ) -> Self {
        let ports = nodes.iter().flat_map(|node| &node.ports);
        let count = ports.map(|ports| ports.channels().count()).sum();
        let mut root: Vec<Option<PortId>> = vec![None; count];
        for node in nodes {
            let all = node.model.declared.ports.iter().zip(&node.ports);
            for (_, ports) in all.filter(|(port, _)| port.kind != PortKind::Output) {
                ports.channels().for_each(|channel| root[channel.index()] = Some(channel));
            }
        }
        for port in written {
            root[port.index()] = None;
        }
        for it in connections {
            root[it.connection.to.index()] = None;
        }
        // What such an input is connected to is open as well. Containers come before their contents, so
        // their connections to them do, too.
        for it in connections {
            let from = root[it.connection.from.index()];
            let to = &mut root[it.connection.to.index()];
            *to = from.or(*to);
        }
        Self { root }
    }

    /// The open inputs of a bank, if all its members have the same and one of its reactions never
    /// runs because of that, with the reaction.
    fn of_bank(&self, nodes: &[Node<'_>], members: &[usize]) -> Option<(Vec<String>, Span)> {
        let first = &nodes[*members.first()?];
        // Members of one class are alike.
        let mut unlike: Vec<&Node<'_>> = members.iter().map(|member| &nodes[*member]).collect();
        unlike.dedup_by(|one, other| std::ptr::eq(one.model, other.model));
        let open = |node: &Node<'_>, port: usize| {
            node.ports[port].channels().all(|channel| self.root[channel.index()] == Some(channel))
        };
        let everywhere = |port: &usize| members.iter().all(|member| open(&nodes[*member], *port));
        let inputs: Vec<usize> = (0..first.ports.len())
            .filter(|port| first.model.declared.ports[*port].kind != PortKind::Output)
            .filter(everywhere)
            .collect();
        if inputs.is_empty() {
            return None;
        }
        let (reaction, guilty) = unlike.into_iter().find_map(|member| {
            let of = |port: &usize| {
                let port = *port;
                member.ports[port].channels().map(move |channel| (channel, port))
            };
            let roots: BTreeMap<PortId, usize> = inputs.iter().flat_map(of).collect();
            self.silenced(nodes, member, &roots)
        })?;
        let name = |port: &usize| first.model.declared.ports[*port].name.text.clone();
        Some((guilty.iter().map(name).collect(), reaction))
    }

    /// A reaction of `node`, or of what it contains, that only ports which begin at these roots
    /// trigger; and which of the inputs those are.
    fn silenced(
        &self,
        nodes: &[Node<'_>],
        node: &Node<'_>,
        roots: &BTreeMap<PortId, usize>,
    ) -> Option<(Span, Vec<usize>)> {
        for reaction in &node.model.reactions {
            let mut guilty = Vec::new();
            let silent = !reaction.triggers.is_empty()
                && reaction.triggers.iter().all(|trigger| {
                    let ResolvedTrigger::Variable(Entity::Port(port)) = trigger else {
                        return false;
                    };
                    let begins = |channel: PortId| {
                        self.root[channel.index()].and_then(|root| roots.get(&root))
                    };
                    let inputs: Option<Vec<_>> = node.ports[*port].channels().map(begins).collect();
                    guilty.extend(inputs.iter().flatten().map(|input| **input));
                    inputs.is_some()
                });
            if silent {
                guilty.sort_unstable();
                guilty.dedup();
                return Some((reaction.decl.header, guilty));
            }
        }
        let contents = node.children.iter().flatten();
        contents.filter_map(|child| self.silenced(nodes, &nodes[*child], roots)).next()
    }
}
