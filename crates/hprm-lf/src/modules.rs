//! The Python modules beside a program: those that its Python imports by an `import` statement, those
//! that they import in turn, and files of the target property `protobufs`.
//!
//! They decide what the program does as its bodies do, so federates compare them. A module that is
//! installed, or imported in another way, is not looked at; nor is one that only a transient federate
//! needs.

use std::collections::BTreeSet;

use hprm_core::Fact;

use hprm_model::python::{Token, canonical, tokens};
use hprm_model::{Class, Code, Compiled, FileId};

use crate::source::{SourceLoader, sibling};

/// The most modules that are looked for.
const MAX: usize = 1_000;

/// The facts about the modules of a program.
pub(crate) fn facts(compiled: &Compiled, loader: &mut dyn SourceLoader) -> Vec<Fact> {
    let mut search = Search {
        folders: folders(compiled, loader),
        loader,
        seen: BTreeSet::new(),
        facts: Vec::new(),
    };
    for (name, file) in &compiled.protobufs {
        if let Ok(text) = search.loader.load(&sibling(compiled.sources.path(*file), name)) {
            search.facts.push(Fact::digest(format!("file {name}"), [text.as_bytes()]).if_present());
        }
    }
    let mut pending = Vec::new();
    let classes = compiled.shared_classes().into_iter().map(|index| &compiled.classes[index]);
    let bodies = compiled.preambles.iter().chain(classes.flat_map(codes));
    for code in bodies {
        pending.extend(imports(&code.text, &[]));
    }
    let serializers = compiled.program.connections.values();
    let serializers = serializers.filter_map(|connection| connection.serializer.as_deref());
    pending.extend(serializers.map(|name| name.split('.').map(str::to_owned).collect()));
    while let Some(module) = pending.pop() {
        for end in 1..=module.len() {
            pending.extend(search.look_at(&module[..end]));
        }
    }
    search.facts.sort_by(|one, other| one.subject.cmp(&other.subject));
    search.facts
}

fn codes(class: &Class) -> impl Iterator<Item = &Code> {
    let reactions = class
        .reactions
        .iter()
        .flat_map(|reaction| reaction.code.iter().chain(&reaction.deadline).chain(&reaction.tardy));
    let methods = class.methods.iter().filter_map(|method| method.code.as_ref());
    class.preambles.iter().chain(methods).chain(reactions)
}

/// Where the program's Python looks for modules, each with a `/` at its end.
fn folders(compiled: &Compiled, loader: &mut dyn SourceLoader) -> Vec<String> {
    let mut folders = vec![sibling(compiled.sources.path(FileId::MAIN), "")];
    for (name, file) in &compiled.files {
        let path = sibling(compiled.sources.path(*file), name);
        let is_folder = !loader.list(&path).is_empty();
        folders.push(if is_folder { path } else { sibling(&path, "") });
    }
    for folder in folders.iter_mut().filter(|folder| !folder.is_empty()) {
        if !folder.ends_with('/') {
            folder.push('/');
        }
    }
    folders
}

/// The name of a module, by its parts.
type Name = Vec<String>;

struct Search<'l> {
    folders: Vec<String>,
    loader: &'l mut dyn SourceLoader,
    seen: BTreeSet<Name>,
    facts: Vec<Fact>,
}

impl Search<'_> {
    /// Looks for a module, and returns what it imports.
    fn look_at(&mut self, module: &[String]) -> Vec<Name> {
        if self.seen.len() >= MAX || !self.seen.insert(module.to_vec()) {
            return Vec::new();
        }
        let path = module.join("/");
        for folder in &self.folders {
            for (end, is_package) in [("/__init__.py", true), (".py", false)] {
                let Ok(text) = self.loader.load(&format!("{folder}{path}{end}")) else { continue };
                let subject = format!("module {}", module.join("."));
                let tokens = canonical(&text);
                self.facts.push(Fact::digest(subject, [tokens.as_bytes()]).if_present());
                let package = if is_package { module } else { &module[..module.len() - 1] };
                return imports(&text, package);
            }
        }
        Vec::new()
    }
}

/// The modules that some Python imports, which is in `package`. What is imported from a module may be
/// a module, too.
fn imports(text: &str, package: &[String]) -> Vec<Name> {
    let mut modules = Vec::new();
    let tokens = tokens(text);
    let starts = |at: usize| match at.checked_sub(1).map(|before| tokens[before]) {
        None | Some(Token::Line(_)) => true,
        Some(Token::Text(text)) => text == ";" || text == ":",
    };
    for at in (0..tokens.len()).filter(|at| starts(*at)) {
        let statement = tokens[at..].iter().skip(1).map_while(|token| match token {
            Token::Line(_) | Token::Text(";") => None,
            Token::Text(text) => Some(*text),
        });
        match tokens[at] {
            Token::Text("import") => modules.extend(names(statement)),
            Token::Text("from") => {
                let words: Vec<&str> = statement.collect();
                let Some(middle) = words.iter().position(|word| *word == "import") else {
                    continue;
                };
                let Some(base) = base(&words[..middle], package) else { continue };
                let within = |name: Name| [base.as_slice(), &name].concat();
                modules.push(base.clone());
                modules.extend(names(words[middle + 1..].iter().copied()).into_iter().map(within));
            }
            _ => {}
        }
    }
    modules.retain(|module| !module.is_empty());
    modules
}

/// What is between `from` and `import`: a name, or dots that lead upwards from the package and a name.
fn base(words: &[&str], package: &[String]) -> Option<Name> {
    let dots = words.iter().take_while(|word| **word == ".").count();
    let rest = names(words[dots..].iter().copied()).into_iter().next().unwrap_or_default();
    if dots == 0 {
        return Some(rest);
    }
    let above = package.len().checked_sub(dots - 1)?;
    Some([&package[..above], &rest].concat())
}

/// `a.b as c, d` names `a.b` and `d`.
fn names<'t>(words: impl IntoIterator<Item = &'t str>) -> Vec<Name> {
    let (mut names, mut name, mut renamed) = (Vec::new(), Name::new(), false);
    for word in words {
        match word {
            "," => {
                names.push(std::mem::take(&mut name));
                renamed = false;
            }
            "as" => renamed = true,
            "." | "(" | ")" | "*" => {}
            word if !renamed => name.push(word.to_owned()),
            _ => {}
        }
    }
    names.push(name);
    names.retain(|name| !name.is_empty());
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn import_statements_are_found() {
        let text = "import a.b as c, d; from e import (f as g,\n h)\ntry: import i\nexcept: pass\n\
                    x = 'import j'  # import k\nimported = 1\n\
                    from . import l\nfrom ..m.n import *\nfrom ....o import p";
        let package = ["q".to_owned(), "r".to_owned()];
        let found: Vec<_> = imports(text, &package).iter().map(|name| name.join(".")).collect();
        assert_eq!(found, ["a.b", "d", "e", "e.f", "e.h", "i", "q.r", "q.r.l", "q.m.n"]);
    }
}
