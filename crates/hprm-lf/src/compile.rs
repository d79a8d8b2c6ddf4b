//! The stages of the front end, one after the other; each starts only if the one before reported
//! no error, so that an error is not reported together with its consequences.

use crate::ast::{Member, Name, ReactorKind, ReactorNode};
use crate::check::{self, Models};
use crate::code;
use crate::compiled::{CompileFailure, Compiled, PlacedAt};
use crate::diagnostic::{Diagnostic, Report};
use crate::library::{ClassId, Library};
use crate::lower::{self, Lowered};
use crate::model::{Declarations, MAX_MEMBERS, Model};
use crate::modules;
use crate::overrides::{self, Overrides};
use crate::properties::Stated;
use crate::property_rules;
use crate::resolve;
use crate::source::SourceLoader;

/// Compiles the program in the file at `path`, which `loader` reads, together with what it imports.
///
/// ```
/// let mut files = |path: &str| match path {
///     "Hello.lf" => Ok("target Python\n\
///         main reactor { reaction(startup) {= print(\"hello\") =} }".to_owned()),
///     _ => Err("no such file".to_owned()),
/// };
/// let compiled = hprm_lf::compile("Hello.lf", &mut files).unwrap();
/// assert_eq!(compiled.program.name, "Hello");
/// assert_eq!(compiled.classes[0].reactions[0].code.text, "print(\"hello\")");
/// ```
///
/// # Errors
///
/// Everything that is wrong with the program, as far as it could be understood.
pub fn compile(path: &str, loader: &mut dyn SourceLoader) -> Result<Compiled, CompileFailure> {
    compile_with(path, &[], loader)
}

/// Like [`compile()`], with target properties as `KEY=VALUE`, which override those of the file, and
/// parameters of the main reactor as `main.NAME=VALUE` (see [`PARAMETER`](crate::PARAMETER)).
///
/// # Errors
///
/// Everything that is wrong with the program or the properties.
pub fn compile_with(
    path: &str,
    properties: &[String],
    loader: &mut dyn SourceLoader,
) -> Result<Compiled, CompileFailure> {
    all_stages(path, properties, loader, Purpose::Run)
}

/// Finds what is wrong in a file, which need not have a main reactor; without one, the program is
/// empty. The classes are not only those that have instances, but all that have been looked at.
///
/// # Errors
///
/// Everything that is wrong with the file and what it needs of others.
pub fn check(path: &str, loader: &mut dyn SourceLoader) -> Result<Compiled, CompileFailure> {
    all_stages(path, &[], loader, Purpose::Check)
}

/// What a program is compiled for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Purpose {
    Run,
    Check,
}

fn all_stages(
    path: &str,
    properties: &[String],
    loader: &mut dyn SourceLoader,
    purpose: Purpose,
) -> Result<Compiled, CompileFailure> {
    let mut report = Report::default();
    let mut library = Library::load(path, loader, &mut report);
    let overrides = overrides::parse(properties, &mut library.sources, &mut report);
    let stated = Stated::read(&library, &overrides.properties, &mut report);
    stated.check_files(&library.sources, loader, &mut report);
    match stages(&library, &overrides, stated, purpose, &mut report) {
        Some(parts) if !report.has_errors() => {
            let mut compiled = assemble(library, parts, report);
            if compiled.federated && purpose == Purpose::Run {
                compiled.modules = modules::facts(&compiled, loader);
            }
            Ok(compiled)
        }
        _ => Err(CompileFailure { diagnostics: report.into_sorted(), sources: library.sources }),
    }
}

struct Parts {
    lowered: Lowered,
    stated: Stated,
    main: Option<ClassId>,
}

fn stages(
    library: &Library,
    overrides: &Overrides,
    mut stated: Stated,
    purpose: Purpose,
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
    stated.settle(federated, has_physical_action(&models), report);
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
            lower::lower(library, &models, (main, &assigned), properties, report)?
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

fn has_physical_action(models: &Models<'_>) -> bool {
    let physical = |model: &Model<'_>| {
        model.declared.actions.iter().any(|action| action.physical == Some(true))
    };
    models.iter().flatten().any(physical)
}

/// The classes of the main file, and those that they contain or extend, resolved.
fn models<'a>(library: &'a Library, report: &mut Report) -> Vec<Option<Model<'a>>> {
    let mut classes: Vec<Option<Declarations<'a>>> = library.classes().map(|_| None).collect();
    let in_main = |class: &ClassId| library.file_of(*class) == Library::MAIN;
    let mut pending: Vec<ClassId> = library.classes().filter(in_main).collect();
    let mut size = 0;
    while let Some(class) = pending.pop() {
        if classes[class.0].is_none() {
            let declared = Declarations::new(library, class, report);
            pending.extend(declared.instances.iter().map(|instance| instance.class));
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

fn assemble(library: Library, parts: Parts, report: Report) -> Compiled {
    let Parts { lowered, stated, main } = parts;
    let federated = main.is_some_and(|main| is_federated(&library, main));
    let host = main.and_then(|main| library.reactor(main).host.as_ref());
    let rti_host = host.map(|host| host.text.clone());
    let hosts = main.map(|main| hosts(library.reactor(main))).unwrap_or_default();
    let bodies = library.order.iter().flat_map(|file| &library.model(*file).preambles);
    let preambles = bodies.map(|body| code::dedent(&library.sources, body.inner)).collect();
    let Lowered { program, classes, instances, bodies, connections, .. } = lowered;
    Compiled {
        program,
        federated,
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
        warnings: report.into_sorted(),
    }
}
