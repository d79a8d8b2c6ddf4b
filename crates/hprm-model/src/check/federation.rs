//! What a federated reactor may hold: instances and the connections between them.

use crate::declaration::ReactorKind;
use crate::diagnostic::{Diagnostic, Report};
use crate::executable::is_executable;
use crate::library::Library;
use crate::model::Model;

pub(super) fn check(library: &Library, model: &Model<'_>, report: &mut Report) {
    let declared = &model.declared;
    if declared.decl.kind != ReactorKind::Federated {
        for instance in &declared.instances {
            if instance.classes().any(|class| is_executable(library.reactor(class))) {
                let name = &instance.decl.class.text;
                let message =
                    format!("`{name}` is an executable, and here it would be no federate");
                report.add(
                    Diagnostic::error("LF1104", instance.decl.name.span, message)
                        .hint(report.syntax().federated_for_executables()),
                );
            }
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
