//! The files of a program, loaded and parsed, and which reactor each name means in each file.

use std::collections::{BTreeMap, BTreeSet};

use crate::ast::{Import, ImportSource, ImportedReactor, Model, Reactor, ReactorKind};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::parser;
use crate::source::{FileId, MAX_FILE, SourceLoader, Sources, Span, sibling};

/// The most files in one program; a loader that answers every path must not keep us for ever.
const MOST_FILES: usize = 1_000;

/// A reactor class among all that the files declare.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) struct ClassId(pub(crate) usize);

/// All files and the classes in them.
#[derive(Debug, Default)]
pub(crate) struct Library {
    pub(crate) sources: Sources,
    /// By file.
    models: Vec<Model>,
    /// By file: what a name means there.
    scopes: Vec<BTreeMap<String, ClassId>>,
    classes: Vec<(FileId, usize)>,
    /// Files with what they import first, so the main file is last.
    pub(crate) order: Vec<FileId>,
}

impl Library {
    /// The main file.
    pub(crate) const MAIN: FileId = FileId(0);

    pub(crate) fn load(path: &str, loader: &mut dyn SourceLoader, report: &mut Report) -> Self {
        let mut library = Self::default();
        let path = sibling("", path);
        let file = match read(&path, loader) {
            Ok(text) => library.parse(&path, text, report),
            Err(reason) => {
                let file = library.parse(&path, String::new(), report);
                let message = format!("cannot read `{path}`: {reason}");
                report.add(Diagnostic::error("LF0101", Span::new(file, 0..0), message));
                file
            }
        };
        library.load_imports(file, loader, report);
        library.index_classes();
        for file in library.files() {
            library.fill_scope(file, report);
        }
        library.order = library.post_order(file);
        library
    }

    pub(crate) fn files(&self) -> impl Iterator<Item = FileId> + use<> {
        (0..u32::try_from(self.models.len()).expect("fewer files than u32 counts")).map(FileId)
    }

    pub(crate) fn model(&self, file: FileId) -> &Model {
        &self.models[file.index()]
    }

    pub(crate) fn classes(&self) -> impl Iterator<Item = ClassId> + use<> {
        (0..self.classes.len()).map(ClassId)
    }

    pub(crate) fn reactor(&self, class: ClassId) -> &Reactor {
        let (file, index) = self.classes[class.0];
        &self.models[file.index()].reactors[index]
    }

    pub(crate) fn file_of(&self, class: ClassId) -> FileId {
        self.classes[class.0].0
    }

    /// The class that `name` means in `file`.
    pub(crate) fn find(&self, file: FileId, name: &str) -> Option<ClassId> {
        self.scopes[file.index()].get(name).copied()
    }

    /// What a file can instantiate.
    pub(crate) fn names(&self, file: FileId) -> impl Iterator<Item = &str> + Clone {
        self.scopes[file.index()].keys().map(String::as_str)
    }

    fn parse(&mut self, path: &str, text: String, report: &mut Report) -> FileId {
        let file = self.sources.add(path, text);
        self.models.push(parser::parse(file, self.sources.text(file), report));
        file
    }

    fn imported_path(&self, file: FileId, import: &Import) -> Option<String> {
        match &import.from {
            ImportSource::File(path) => Some(sibling(self.sources.path(file), &path.text)),
            ImportSource::Package(_) => None,
        }
    }

    fn load_imports(&mut self, main: FileId, loader: &mut dyn SourceLoader, report: &mut Report) {
        let mut pending = vec![main];
        while let Some(file) = pending.pop() {
            for import in self.models[file.index()].imports.clone() {
                let name = match &import.from {
                    ImportSource::File(name) => name,
                    ImportSource::Package(span) => {
                        let instead = "import the file by its path: `from \"lib/Name.lf\"`";
                        report.add(Diagnostic::unsupported(*span, "package imports are", instead));
                        continue;
                    }
                };
                let path = sibling(self.sources.path(file), &name.text);
                if self.sources.find(&path).is_some() {
                    continue;
                }
                if self.models.len() >= MOST_FILES {
                    let message = format!("more than {MOST_FILES} files in one program");
                    report.add(Diagnostic::error("LF0103", name.span, message));
                    return;
                }
                match read(&path, loader) {
                    Ok(text) => pending.push(self.parse(&path, text, report)),
                    Err(reason) => {
                        let message = format!("cannot read `{path}`: {reason}");
                        report.add(
                            Diagnostic::error("LF0101", name.span, message)
                                .hint("the path is relative to the file that imports"),
                        );
                    }
                }
            }
        }
    }

    fn index_classes(&mut self) {
        for file in self.files() {
            let count = self.models[file.index()].reactors.len();
            self.classes.extend((0..count).map(|index| (file, index)));
        }
    }

    fn declared_in(&self, file: FileId) -> impl Iterator<Item = ClassId> + Clone {
        self.classes
            .iter()
            .enumerate()
            .filter(move |(_, (home, _))| *home == file)
            .map(|(index, _)| ClassId(index))
    }

    fn fill_scope(&mut self, file: FileId, report: &mut Report) {
        let mut scope = BTreeMap::new();
        let mut spans: BTreeMap<String, Span> = BTreeMap::new();
        let mut declare = |name: &crate::ast::Name, class, report: &mut Report| {
            if let Some(first) = spans.insert(name.text.clone(), name.span) {
                let message = format!("`{}` is already a reactor of this file", name.text);
                report.add(
                    Diagnostic::error("LF0201", name.span, message).label(first, "first here"),
                );
            }
            scope.insert(name.text.clone(), class);
        };
        for class in self.declared_in(file) {
            if let Some(name) = &self.reactor(class).name {
                declare(name, class, report);
            }
        }
        for import in &self.models[file.index()].imports {
            let path = self.imported_path(file, import);
            let Some(from) = path.and_then(|path| self.sources.find(&path)) else { continue };
            for imported in &import.reactors {
                match self.exported(from, imported) {
                    Ok(class) => {
                        declare(imported.alias.as_ref().unwrap_or(&imported.name), class, report);
                    }
                    Err(diagnostic) => report.add(*diagnostic),
                }
            }
        }
        self.scopes.push(scope);
    }

    fn exported(
        &self,
        from: FileId,
        imported: &ImportedReactor,
    ) -> Result<ClassId, Box<Diagnostic>> {
        let ImportedReactor { name, .. } = imported;
        let plain = self
            .declared_in(from)
            .filter(|class| self.reactor(*class).kind == ReactorKind::Plain)
            .filter_map(|class| Some((class, self.reactor(class).name.as_ref()?.text.as_str())));
        let found = plain.clone().find(|(_, text)| *text == name.text);
        found.map(|(class, _)| class).ok_or_else(|| {
            let path = self.sources.path(from);
            let message = format!("`{path}` has no reactor `{}` to import", name.text);
            let hint = existing(&name.text, "its reactors", plain.map(|(_, text)| text));
            Box::new(Diagnostic::error("LF0102", name.span, message).hint(hint))
        })
    }

    fn post_order(&self, main: FileId) -> Vec<FileId> {
        let mut order = Vec::new();
        let mut entered = BTreeSet::from([main]);
        let mut stack = vec![(main, 0)];
        while let Some((file, next)) = stack.pop() {
            let imports = &self.models[file.index()].imports;
            let Some(import) = imports.get(next) else {
                order.push(file);
                continue;
            };
            stack.push((file, next + 1));
            let path = self.imported_path(file, import);
            if let Some(imported) = path.and_then(|path| self.sources.find(&path))
                && entered.insert(imported)
            {
                stack.push((imported, 0));
            }
        }
        order
    }
}

fn read(path: &str, loader: &mut dyn SourceLoader) -> Result<String, String> {
    let text = loader.load(path)?;
    if text.len() > MAX_FILE {
        return Err(format!("it is larger than {} MiB", MAX_FILE >> 20));
    }
    Ok(text.strip_prefix('\u{feff}').map_or(text.clone(), str::to_owned))
}
