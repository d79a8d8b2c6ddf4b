//! Inheritance: of which classes a class is made, and in which order.
//!
//! What the classes declare is put together by [`model`](crate::model); that they do not contradict
//! one another is checked with the other rules on names.

use std::collections::{BTreeMap, BTreeSet};

use crate::ast::{Name, ReactorKind};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::library::{ClassId, Library};

/// The most classes that one class may inherit from, on all ways together.
const MOST: usize = 100;

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
    // Each entry is a class on the way down and the superclass of it to look at next.
    let mut way = vec![(class, 0)];
    while let Some((below, next)) = way.pop() {
        let Some(name) = library.reactor(below).extends.get(next) else {
            lineage.classes.push(below);
            continue;
        };
        way.push((below, next + 1));
        let found = if next < MOST && entered.len() <= MOST {
            superclass(library, below, name)
        } else {
            let message = format!("a reactor inherits from at most {MOST} others");
            Err(Box::new(Diagnostic::error("LF0406", name.span, message)))
        };
        match found {
            Err(diagnostic) => {
                report.add(*diagnostic);
                lineage.incomplete = true;
                if next >= MOST || entered.len() > MOST {
                    lineage.classes.push(class);
                    return lineage;
                }
            }
            Ok(found) if way.iter().any(|(open, _)| *open == found) => {
                let message = format!("`{}` inherits from itself", name.text);
                report.add(
                    Diagnostic::error("LF0216", name.span, message)
                        .hint("remove one `extends` of the circle"),
                );
                lineage.incomplete = true;
            }
            Ok(found) => {
                if entered.insert(found) {
                    way.push((found, 0));
                }
            }
        }
    }
    lineage
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
