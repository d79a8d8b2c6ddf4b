//! The stages of a compilation, one after the other; each starts only if the one before reported
//! no error, so that an error is not reported together with its consequences.

use std::collections::BTreeMap;

use hprm_core::{Federate, FederateId};

use crate::check::attributes;
use crate::check::{self, Models};
use crate::code;
use crate::compiled::{CompileFailure, Compiled, ExecutableFederate, PlacedAt};
use crate::declaration::{Member, Name, ReactorKind, ReactorNode};
use crate::diagnostic::{Diagnostic, Report};
use crate::library::{ClassId, Library};
use crate::lower::{self, Lowered, Wanted};
use crate::model::{Declarations, MAX_MEMBERS, Model, ResolvedInstance};
use crate::overrides::Overrides;
use crate::properties::{Physical, TargetProperties};
use crate::property_rules;
use crate::resolve;

/// What a program is compiled for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Purpose {
    /// To run it: it needs a main reactor.
    Run,
    /// To find what is wrong in a file, which need not have a main reactor; without one, the program is
    /// empty. The classes are not only those that have instances, but all that have been looked at.
    Check,
    /// To test a reactor in virtual time: only reactions schedule its physical actions, which follow logical time.
    Test,
    /// To draw it: as to run it, and there is an outline, also of a program whose reactions or connections do not fit
    /// together.
    Draw,
}

/// Checks a program that a front end has declared, and makes the instance graph of it.
///
/// `properties` have been read from `library` and `overrides`. If `report` has errors already, they are
/// the answer.
///
/// # Errors
///
/// Everything that is wrong with the program, as far as it could be understood, with what has been reported
/// before.
pub fn compile(
    library: Library,
    properties: TargetProperties,
    overrides: &Overrides,
    purpose: Purpose,
    mut report: Report,
) -> Result<Compiled, CompileFailure> {
    let mut outline = (purpose == Purpose::Draw).then(Wanted::default);
    match stages(&library, overrides, properties, (purpose, outline.as_mut()), &mut report) {
        Some(parts) if !report.has_errors() => {
            let outline = outline.and_then(|wanted| wanted.outline);
            Ok(Compiled { outline, ..assemble(library, parts, report) })
        }
        _ => Err(CompileFailure {
            diagnostics: report.into_sorted(),
            sources: library.sources,
            outline: outline.and_then(|wanted| wanted.outline).map(Box::new),
        }),
    }
}

struct Parts {
    lowered: Lowered,
    stated: TargetProperties,
    main: Option<ClassId>,
}

fn stages(
    library: &Library,
    overrides: &Overrides,
    mut stated: TargetProperties,
    (purpose, wanted): (Purpose, Option<&mut Wanted>),
    report: &mut Report,
) -> Option<Parts> {
    if report.has_errors() {
        return None;
    }
    let main = match purpose {
        Purpose::Check if check::is_for_import(library) => None,
        _ => Some(check::main_class(library, report)?),
    };
    let known = report.errors();
    let models = models(library, report);
    if report.errors() == known {
        check::check(library, &models, report);
    }
    let federated = main.is_some_and(|main| is_federated(library, main));
    property_rules::contradictions(library, federated, report);
    let mut physical = Physical::of(&models);
    if purpose == Purpose::Test {
        // So they go together with `fast`, and nothing comes once no event is left.
        physical.actions = false;
    }
    stated.settle(federated, physical, report);
    if report.has_errors() {
        return None;
    }
    // Errors here do not prevent the checks of instances.
    check::constants::check(&models, report);
    let properties = stated.properties.clone();
    let mut lowered = match main {
        Some(main) => {
            let declared = &models[main.0].as_ref()?.declared.parameters;
            let assigned = overrides.assign(declared, &library.sources, report);
            lower::lower(library, &models, (main, &assigned), (properties, wanted), report)?
        }
        None => lower::nothing(properties),
    };
    if purpose == Purpose::Check {
        lower::add_classes(library, &models, &mut lowered);
    }
    Some(Parts { lowered, stated, main })
}

fn is_federated(library: &Library, main: ClassId) -> bool {
    library.reactor(main).kind == ReactorKind::Federated
}

impl Physical {
    fn of(models: &Models<'_>) -> Self {
        let has = |is: fn(&Declarations<'_>) -> bool| {
            models.iter().flatten().any(|model| is(&model.declared))
        };
        Self {
            actions: has(|it| it.actions.iter().any(|action| action.physical == Some(true))),
            connections: has(|it| it.connections.iter().any(|connection| connection.physical)),
            transients: has(|it| {
                it.instances.iter().any(|it| attributes::is_there(&it.decl.attributes, "transient"))
            }),
        }
    }
}

/// The classes of the main file, and those that they contain or extend, resolved.
fn models<'a>(library: &'a Library, report: &mut Report) -> Vec<Option<Model<'a>>> {
    let mut classes: Vec<Option<Declarations<'a>>> = library.classes().map(|_| None).collect();
    let mut pending: Vec<ClassId> = library.classes_of_main().collect();
    let mut size = 0;
    while let Some(class) = pending.pop() {
        if classes[class.0].is_none() {
            let declared = Declarations::new(library, class, report);
            pending.extend(declared.instances.iter().flat_map(ResolvedInstance::classes));
            pending.extend(&declared.lineage);
            size += declared.size();
            let header = declared.decl.header;
            classes[class.0] = Some(declared);
            if size > MAX_MEMBERS {
                let message = format!("the reactors have more than {MAX_MEMBERS} members");
                report.add(
                    Diagnostic::error("LF0406", header, message)
                        .hint("inherited members count for each reactor that inherits them"),
                );
                return Vec::new();
            }
        }
    }
    let mut resolved = Vec::new();
    for declared in &classes {
        let parts = declared.as_ref().map(|d| resolve::resolve(d, &classes, report));
        resolved.push(parts);
    }
    let model = |(declared, parts)| {
        let (reactions, connections) = parts?;
        Some(Model { declared: declared?, reactions, connections })
    };
    classes.into_iter().zip(resolved).map(model).collect()
}

/// Where a federated reactor wants itself and its federates to run.
fn hosts(main: &ReactorNode) -> Vec<PlacedAt> {
    let instances = main.members.iter().filter_map(|member| match member {
        Member::Instantiation(instance) => Some((Some(&instance.name), instance.host.as_ref()?)),
        _ => None,
    });
    let all = main.host.iter().map(|host| (None, host)).chain(instances);
    let placed = |(federate, host): (Option<&Name>, &Name)| PlacedAt {
        federate: federate.map(|name| name.text.clone()),
        host: host.text.clone(),
        span: host.span,
    };
    all.map(placed).collect()
}

/// The federates that are executables.
fn executables(library: &Library, lowered: &Lowered) -> BTreeMap<FederateId, ExecutableFederate> {
    let federates = lowered.program.federates.iter();
    let command = |(id, federate): (FederateId, &Federate)| {
        let class = lowered.used[lowered.instances[federate.reactor].class];
        Some((id, library.executables.get(&class)?.clone()))
    };
    federates.filter_map(command).collect()
}

fn assemble(library: Library, parts: Parts, report: Report) -> Compiled {
    let Parts { lowered, stated, main } = parts;
    let federated = main.is_some_and(|main| is_federated(&library, main));
    let host = main.and_then(|main| library.reactor(main).host.as_ref());
    let rti_host = host.map(|host| host.text.clone());
    let hosts = main.map(|main| hosts(library.reactor(main))).unwrap_or_default();
    let order = library.order();
    let preambles = order.iter().flat_map(|file| library.preambles(*file));
    let preambles = preambles.map(|text| code::dedent(&library.sources, *text)).collect();
    let executables = executables(&library, &lowered);
    let Lowered { program, classes, instances, bodies, connections, .. } = lowered;
    Compiled {
        program,
        federated,
        syntax: report.syntax(),
        sources: library.sources,
        classes,
        instances,
        bodies,
        connections,
        preambles,
        files: stated.files,
        protobufs: stated.protobufs,
        modules: Vec::new(),
        settings: stated.settings,
        rti_host,
        hosts,
        executables,
        outline: None,
        warnings: report.into_sorted(),
    }
}
