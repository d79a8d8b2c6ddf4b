//! Which values the parameters of executables have: what an executable declares may follow from them, so instances
//! with other values are reactors of their own.
//!
//! What is wrong with a value for other reasons than that it is one of an executable is reported by the checks.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::limits;

use crate::check;
use crate::declaration::{Instantiation, Member, Parameter, ReactorKind};
use crate::diagnostic::Report;
use crate::environment::Environment;
use crate::executable::{Executable, GivenParameter};
use crate::library::{ClassId, Library};
use crate::model::Declarations;
use crate::overrides::Overrides;
use crate::source::Span;

/// A federate that is an executable with parameters.
struct Use {
    class: ClassId,
    /// The name of the instance, or of the bank, and the number of the member.
    instance: Span,
    member: usize,
    /// None if something is wrong with one.
    parameters: Option<Vec<GivenParameter>>,
}

/// The classes of the members of each instance or bank.
type Members = BTreeMap<Span, Vec<ClassId>>;

/// Finds the values of the parameters of all executables. One that has instances with different values becomes
/// several.
pub(crate) fn split(
    library: &mut Library,
    executables: Vec<Executable>,
    overrides: &Overrides,
    report: &mut Report,
) -> Vec<Executable> {
    let with: BTreeSet<ClassId> = executables.iter().map(|it| it.class).collect();
    let has_parameters = |class: &ClassId| !library.reactor(*class).parameters.is_empty();
    let with: BTreeSet<ClassId> = with.into_iter().filter(has_parameters).collect();
    if with.is_empty() {
        return executables;
    }
    let (uses, mut members, lineage) = uses(library, &with, overrides, report);
    let mut all = Vec::new();
    for executable in executables {
        if !with.contains(&executable.class) {
            all.push(executable);
            continue;
        }
        let own: Vec<_> = uses.iter().filter(|it| it.class == executable.class).collect();
        match own.is_empty() {
            true => all.extend(by_default(library, executable)),
            false => all.extend(variants(library, &executable, &own, &mut members)),
        }
    }
    for home in lineage {
        for member in &mut library.reactor_mut(home).members {
            if let Member::Instantiation(instance) = member
                && let Some(classes) = members.remove(&instance.name.span)
            {
                instance.members = Some(classes);
            }
        }
    }
    all
}

/// The executables of one reactor, one for each set of values.
fn variants(
    library: &mut Library,
    executable: &Executable,
    uses: &[&Use],
    members: &mut Members,
) -> Vec<Executable> {
    let mut known = BTreeMap::<String, ClassId>::new();
    let mut all = Vec::new();
    for used in uses {
        let Some(parameters) = &used.parameters else { continue };
        let values: Vec<_> = parameters.iter().map(|it| &it.value).collect();
        let class = *known.entry(format!("{values:?}")).or_insert_with(|| {
            let class = match all.is_empty() {
                true => executable.class,
                false => {
                    let node = library.reactor(executable.class).clone();
                    library.add_unlisted(library.file_of(executable.class), node)
                }
            };
            all.push(Executable {
                class,
                parameters: parameters.clone(),
                instance: Some(used.instance),
                ..executable.clone()
            });
            class
        });
        if let Some(classes) = members.get_mut(&used.instance) {
            classes[used.member] = class;
        }
    }
    all
}

/// An executable that has no instances yet, with the defaults of its parameters; none if these are not known.
fn by_default(library: &Library, executable: Executable) -> Option<Executable> {
    let parameters: Vec<_> = library.reactor(executable.class).parameters.iter().collect();
    let environment = Environment::of_main(&parameters, &[]);
    let outer = Environment::default();
    let parameters = values((&environment, &outer), &parameters, None, &mut Report::default())?;
    Some(Executable { parameters, ..executable })
}

/// All federates that are executables with parameters; the classes of all members where there are such, and the
/// classes whose instances they are.
fn uses(
    library: &Library,
    with: &BTreeSet<ClassId>,
    overrides: &Overrides,
    report: &mut Report,
) -> (Vec<Use>, Members, Vec<ClassId>) {
    let mut unreported = Report::default();
    let (mut uses, mut members) = (Vec::new(), Members::new());
    let main = check::main_class(library, &mut unreported)
        .filter(|main| library.reactor(*main).kind == ReactorKind::Federated);
    let Some(main) = main else { return (uses, members, Vec::new()) };
    let declared = Declarations::new(library, main, &mut unreported);
    let assigned = overrides.assign(&declared.parameters, &library.sources, &mut unreported);
    let container = Environment::of_main(&declared.parameters, &assigned);
    for instance in &declared.instances {
        let decl = instance.decl;
        let Some(width) = width(&container, decl) else { continue };
        let classes: Vec<_> = (0..width).map(|member| instance.class_of(member)).collect();
        for (member, class) in classes.iter().enumerate().filter(|(_, class)| with.contains(class))
        {
            let parameters: Vec<_> = library.reactor(*class).parameters.iter().collect();
            let index = decl.width.as_ref().and_then(|_| u32::try_from(member).ok());
            let inner = container.of_instance(decl, &parameters, index);
            let span = decl.name.span;
            let parameters = values((&inner, &container), &parameters, Some(decl), report);
            uses.push(Use { class: *class, instance: span, member, parameters });
        }
        // A front end that knows the classes of members has no two with different values in one class.
        if decl.members.is_none() && classes.iter().any(|class| with.contains(class)) {
            members.insert(decl.name.span, classes);
        }
    }
    (uses, members, declared.lineage)
}

/// How many instances there are; none if that is not known, or too many.
fn width(container: &Environment<'_>, decl: &Instantiation) -> Option<u32> {
    let count = match (&decl.members, &decl.width) {
        (Some(members), _) => u32::try_from(members.len()).ok(),
        (None, Some(width)) => container.width(width, &mut Report::default()),
        (None, None) => Some(1),
    };
    count.filter(|count| *count as usize <= limits::FEDERATES)
}

/// The values of the parameters of an instance in an environment; none if one of them is not known.
fn values(
    (inner, outer): (&Environment<'_>, &Environment<'_>),
    parameters: &[&Parameter],
    decl: Option<&Instantiation>,
    report: &mut Report,
) -> Option<Vec<GivenParameter>> {
    let instance = decl.map(|decl| decl.name.span);
    let mut all = Vec::new();
    for parameter in parameters {
        let (name, declared) = (parameter.name.text.clone(), parameter.name.span);
        let (value, written) = match &parameter.given {
            Some(given) => (given.clone(), instance),
            None => inner.given(&name, outer, report)?,
        };
        // Where the instance states it, rather than where a parameter of its container has its value from.
        let assigned = decl.iter().flat_map(|decl| &decl.assignments);
        let assigned = assigned.filter(|it| it.name.text == name).map(|it| it.value.span).next();
        let stated = assigned.or(written).unwrap_or(declared);
        all.push(GivenParameter { name, value, declared, stated });
    }
    Some(all)
}
