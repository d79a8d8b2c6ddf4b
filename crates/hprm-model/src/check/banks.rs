//! Banks whose members have classes of their own: all have the same ports.

use super::Models;
use crate::declaration::PortNode;
use crate::diagnostic::{Diagnostic, Report};
use crate::library::ClassId;
use crate::model::Model;

pub(super) fn check(model: &Model<'_>, models: &Models<'_>, report: &mut Report) {
    for instance in &model.declared.instances {
        let ports = ports(models, instance.class);
        for (index, member) in instance.classes().enumerate().skip(1) {
            if member == instance.class || same(ports, self::ports(models, member)) {
                continue;
            }
            let name = &instance.decl.name;
            let message = format!("`{0}[{index}]` has other ports than `{0}[0]`", name.text);
            report.add(
                Diagnostic::error("LF0313", name.span, message)
                    .hint("all members of a bank have the same ports, in the same order"),
            );
            break;
        }
    }
}

fn ports<'a>(models: &'a Models<'a>, class: ClassId) -> &'a [&'a PortNode] {
    models[class.0].as_ref().map_or(&[], |model| &model.declared.ports)
}

fn same(ports: &[&PortNode], others: &[&PortNode]) -> bool {
    let alike = |(port, other): (&&PortNode, &&PortNode)| {
        let names = (&port.name.text, &other.name.text);
        names.0 == names.1
            && port.kind == other.kind
            && port.width.is_some() == other.width.is_some()
    };
    ports.len() == others.len() && ports.iter().zip(others).all(alike)
}
