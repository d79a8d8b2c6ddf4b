//! What a federated reactor may hold: instances and the connections between them.

use crate::declaration::ReactorKind;
use crate::diagnostic::{Diagnostic, Report};
use crate::model::Model;

pub(super) fn check(model: &Model<'_>, report: &mut Report) {
    let declared = &model.declared;
    if declared.decl.kind != ReactorKind::Federated {
        for instance in &declared.instances {
            if let Some(host) = &instance.decl.host {
                let message = "only an instance in a federated reactor has a host";
                report.add(
                    Diagnostic::error("LF0802", host.span, message)
                        .hint(report.syntax().federated_or_no_host()),
                );
            }
        }
        return;
    }
    let reactions = declared.reactions.iter().map(|reaction| reaction.header);
    let actions = declared.actions.iter().map(|action| action.name.span);
    let timers = declared.timers.iter().map(|timer| timer.name.span);
    for span in reactions.chain(actions).chain(timers) {
        report.add(
            Diagnostic::error("LF0801", span, "this belongs to no federate")
                .hint(report.syntax().move_into_federate()),
        );
    }
}
