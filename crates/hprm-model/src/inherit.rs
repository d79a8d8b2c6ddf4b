//! Inheritance: of which classes a class is made, and in which order.
//!
//! [`model`](crate::model) merges the declarations of the classes; the other rules on names check that
//! they do not contradict one another.

use std::collections::{BTreeMap, BTreeSet};

use crate::declaration::{Name, ReactorKind, ReactorNode};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::library::{ClassId, Library};

/// The most classes that one class may inherit from, counted once for each path to them.
const MAX: usize = 100;

/// How many names are looked up to find the first class with too many.
const MAX_LOOKUPS: usize = 1_000_000;

/// The classes whose members make up `class`.
pub(crate) struct Lineage {
    /// Superclasses before those that extend them, each once; the class itself is the last.
    pub(crate) classes: Vec<ClassId>,
    /// Whether a superclass is missing, which has been reported.
    pub(crate) incomplete: bool,
}

/// Follows what `class` extends, and what that extends, in the order in which it is written.
pub(crate) fn lineage(library: &Library, class: ClassId, report: &mut Report) -> Lineage {
    let mut lineage = Lineage { classes: Vec::new(), incomplete: false };
    let mut entered = BTreeSet::from([class]);
    // Each entry is a class on the path down and the superclass of it to look at next.
    let mut path = vec![(class, 0)];
    while let Some((below, next)) = path.pop() {
        let Some(name) = library.reactor(below).extends.get(next) else {
            lineage.classes.push(below);
            continue;
        };
        path.push((below, next + 1));
        if next >= MAX || entered.len() > MAX {
            report_excess(library, class, report);
            return Lineage { classes: vec![class], incomplete: true };
        }
        match superclass(library, below, name) {
            Err(diagnostic) => {
                report.add(*diagnostic);
                lineage.incomplete = true;
            }
            Ok(found) if path.iter().any(|(open, _)| *open == found) => {
                report.add(cycle(library, &path, found));
                lineage.incomplete = true;
            }
            Ok(found) => {
                if entered.insert(found) {
                    path.push((found, 0));
                }
            }
        }
    }
    lineage
}

/// The error for a cycle: the path of classes ends in one that extends `again`, which is on the path. It is
/// the same error for each class of the cycle at which the search began.
fn cycle(library: &Library, path: &[(ClassId, usize)], again: ClassId) -> Diagnostic {
    let start = path.iter().position(|(open, _)| *open == again).unwrap_or_default();
    let (first, next) = path[start..].iter().min().copied().unwrap_or((again, 1));
    let reactor = library.reactor(first);
    let name =
        |reactor: &ReactorNode| reactor.name.as_ref().map_or("main", |it| &it.text).to_owned();
    // The entry counts the `extends` that it has taken already.
    let span = reactor.extends.get(next - 1).map_or(reactor.header, |name| name.span);
    Diagnostic::error("LF0216", span, format!("`{}` inherits from itself", name(reactor)))
        .hint("remove one `extends` of the cycle")
}

/// Reports the first class that inherits from too many: the one above `class`, or itself, whose own
/// superclasses do not. All others follow from it.
fn report_excess(library: &Library, class: ClassId, report: &mut Report) {
    if report.has("LF0406") {
        return;
    }
    let mut first = class;
    let mut above: Vec<ClassId> = superclasses(library, first).collect();
    let mut lookups = MAX_LOOKUPS;
    while let Some(next) = above.pop() {
        if exceeds(library, next, &mut lookups) {
            first = next;
            above = superclasses(library, first).collect();
        }
    }
    let reactor = library.reactor(first);
    let span = reactor.extends.first().map_or(reactor.header, |name| name.span);
    let message = format!("a reactor inherits from at most {MAX} others");
    report.add(Diagnostic::error("LF0406", span, message));
}

/// Whether a class inherits from too many others, as far as some `lookups` tell.
fn exceeds(library: &Library, class: ClassId, lookups: &mut usize) -> bool {
    let mut entered = BTreeSet::from([class]);
    let mut pending = vec![class];
    while let Some(below) = pending.pop() {
        let count = library.reactor(below).extends.len();
        let Some(left) = lookups.checked_sub(count.max(1)) else { return false };
        *lookups = left;
        if entered.len() > MAX + 1 || count > MAX {
            return true;
        }
        pending.extend(superclasses(library, below).filter(|above| entered.insert(*above)));
    }
    false
}

fn superclasses(library: &Library, class: ClassId) -> impl Iterator<Item = ClassId> {
    let file = library.file_of(class);
    library.reactor(class).extends.iter().filter_map(move |name| library.find(file, &name.text))
}

/// The class that `class` extends under `name`.
fn superclass(library: &Library, class: ClassId, name: &Name) -> Result<ClassId, Box<Diagnostic>> {
    let file = library.file_of(class);
    let Some(found) = library.find(file, &name.text) else {
        let message = format!("there is no reactor `{}`", name.text);
        let hint = existing(&name.text, "reactors", library.names(file));
        return Err(Box::new(Diagnostic::error("LF0301", name.span, message).hint(hint)));
    };
    if library.reactor(found).kind != ReactorKind::Plain {
        let message = format!("`{}` is a main reactor: it cannot be extended", name.text);
        return Err(Box::new(
            Diagnostic::error("LF0307", name.span, message)
                .hint("put what both share into a reactor of its own"),
        ));
    }
    Ok(found)
}

/// Things of several classes by name, in the order of the first one; a later class takes the place
/// of an earlier one's thing of the same name, but what one class declares twice stays.
#[derive(Debug)]
pub(crate) struct Overriding<'a, T> {
    pub(crate) all: Vec<&'a T>,
    earlier: BTreeMap<&'a str, usize>,
}

// Derived, this would ask the same of `T`.
impl<T> Default for Overriding<'_, T> {
    fn default() -> Self {
        Self { all: Vec::new(), earlier: BTreeMap::new() }
    }
}

impl<'a, T> Overriding<'a, T> {
    /// Adds what one class declares.
    pub(crate) fn extend(&mut self, things: &'a [T], name: impl Fn(&'a T) -> &'a Name) {
        let mut added = Vec::new();
        for thing in things {
            let text = name(thing).text.as_str();
            // Taken out, so that a second one of this class finds nothing to take the place of.
            if let Some(place) = self.earlier.remove(text) {
                self.all[place] = thing;
                added.push((text, place));
            } else {
                added.push((text, self.all.len()));
                self.all.push(thing);
            }
        }
        self.earlier.extend(added);
    }
}
