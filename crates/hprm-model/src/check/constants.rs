//! Values that must be known before anything runs, as far as the text alone shows them: times and
//! widths. What a parameter stands for is known for each instance only, and checked there.

use crate::declaration::{Expression, ExpressionKind, Width, WidthTerm};
use crate::diagnostic::{Diagnostic, Report};
use crate::environment::Environment;
use crate::model::{Declarations, Model};

use super::{Models, attributes};

/// Checks all classes in use, whether they have instances or not.
pub(crate) fn check(models: &Models<'_>, report: &mut Report) {
    models.iter().flatten().for_each(|model| class(model, report));
}

fn class(model: &Model<'_>, report: &mut Report) {
    let declared = &model.declared;
    let nothing = Environment::of_main(&[], &[]);
    let written = |time: &&Expression| !matches!(time.kind, ExpressionKind::Parameter(_));
    for time in times(declared).into_iter().filter(written) {
        nothing.time(time, report);
    }
    let widths = declared.ports.iter().filter_map(|port| port.width.as_ref());
    let banks = declared.instances.iter().filter_map(|instance| instance.decl.width.as_ref());
    for written in widths.chain(banks) {
        width(written, report);
    }
}

fn times<'a>(declared: &Declarations<'a>) -> Vec<&'a Expression> {
    let mut times: Vec<&Expression> = Vec::new();
    for action in declared.actions.iter().map(|action| action.decl) {
        times.extend(action.min_delay.iter().chain(&action.spacing));
    }
    for timer in declared.timers.iter().map(|timer| timer.decl) {
        times.extend(timer.offset.iter().chain(&timer.period));
    }
    for reaction in declared.reactions.iter().map(|reaction| reaction.decl) {
        times.extend(reaction.deadline.as_ref().map(|deadline| &deadline.delay));
        times.extend(reaction.late.as_ref().and_then(|late| late.wait.as_ref()));
    }
    for connection in declared.connections.iter().map(|connection| connection.decl) {
        times.extend(&connection.delay);
        times.extend(attributes::argument(&connection.attributes, "absent_after"));
    }
    for instance in &declared.instances {
        times.extend(attributes::argument(&instance.decl.attributes, "maxwait"));
    }
    times
}

fn width(width: &Width, report: &mut Report) {
    if width.terms.is_empty() {
        report.add(
            Diagnostic::error("LF0405", width.span, "a width must be given")
                .hint("write `[4]` or `[n]`, with a parameter `n`"),
        );
    }
    let mut whole = !width.terms.is_empty();
    for term in &width.terms {
        match term {
            WidthTerm::WidthOf(span) => {
                report.add(
                    Diagnostic::error("LF0409", *span, "a width cannot be that of another port")
                        .hint("use one parameter for both widths"),
                );
                whole = false;
            }
            WidthTerm::Value(Expression { kind: ExpressionKind::Parameter(_), .. }) => {
                whole = false;
            }
            WidthTerm::Value(_) => {}
        }
    }
    if whole {
        Environment::of_main(&[], &[]).width(width, report);
    }
}
