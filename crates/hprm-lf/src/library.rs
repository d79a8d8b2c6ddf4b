//! The files of a program, loaded and parsed, and which reactor each name means in each file.

use std::collections::{BTreeMap, BTreeSet};

use crate::ast::{FileNode, Import, ImportSource, ImportedReactor, Name, ReactorKind, ReactorNode};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::package;
use crate::parser;
use crate::source::{FileId, MAX_FILE, SourceLoader, Sources, Span, sibling};

/// The most files in one program; a loader that has a file for every path must not keep the compiler busy for ever.
const MAX_FILES: usize = 1_000;

/// The most imports in one program.
const MAX_IMPORTS: usize = 10_000;

/// The most text in one program, in bytes.
const MAX_TEXT: usize = 64 << 20;

/// A reactor class among all that the files declare.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) struct ClassId(pub(crate) usize);

/// All files and the classes in them.
#[derive(Debug, Default)]
pub(crate) struct Library {
    pub(crate) sources: Sources,
    /// The bytes of all files.
    size: usize,
    /// By file.
    models: Vec<FileNode>,
    /// Files that were not understood as a whole, which has been reported.
    broken: BTreeSet<FileId>,
    /// By file and import, the file that is imported.
    imported: Vec<Vec<Option<FileId>>>,
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
        library.scopes = library.scopes(report);
        library.order = library.post_order(file);
        library
    }

    pub(crate) fn files(&self) -> impl Iterator<Item = FileId> + use<> {
        (0..u32::try_from(self.models.len()).expect("fewer files than u32 counts")).map(FileId)
    }

    pub(crate) fn model(&self, file: FileId) -> &FileNode {
        &self.models[file.index()]
    }

    pub(crate) fn classes(&self) -> impl Iterator<Item = ClassId> + use<> {
        (0..self.classes.len()).map(ClassId)
    }

    pub(crate) fn reactor(&self, class: ClassId) -> &ReactorNode {
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
        self.size += text.len();
        let file = self.sources.add(path, text);
        self.imported.push(Vec::new());
        let known = report.errors();
        self.models.push(parser::parse(file, self.sources.text(file), report));
        if report.errors() > known {
            self.broken.insert(file);
        }
        file
    }

    /// Loads what `main` imports, and what that imports.
    fn load_imports(&mut self, main: FileId, loader: &mut dyn SourceLoader, report: &mut Report) {
        let mut pending = vec![main];
        let mut count = 0;
        while let Some(file) = pending.pop() {
            for import in self.models[file.index()].imports.clone() {
                count += 1;
                let (ImportSource::File(name) | ImportSource::Package(name)) = &import.from;
                if count > MAX_IMPORTS {
                    let message = format!("more than {MAX_IMPORTS} imports in one program");
                    report.add(Diagnostic::error("LF0103", name.span, message));
                    return;
                }
                let known = self.models.len();
                let found = match &import.from {
                    ImportSource::File(name) => self.file(file, name, loader, report),
                    ImportSource::Package(_) => self.package(file, &import, loader, report),
                };
                let found = found.map_err(|diagnostic| report.add(*diagnostic)).ok();
                pending.extend(found.filter(|found| found.index() >= known));
                self.imported[file.index()].push(found);
            }
        }
    }

    /// The file that `file` imports by its path.
    fn file(
        &mut self,
        file: FileId,
        name: &Name,
        loader: &mut dyn SourceLoader,
        report: &mut Report,
    ) -> Result<FileId, Box<Diagnostic>> {
        let path = sibling(self.sources.path(file), &name.text);
        self.load_file(&path, loader, report).map_err(|reason| {
            let message = format!("cannot read `{path}`: {reason}");
            let missing = reason.to_ascii_lowercase().starts_with("no such file");
            let hint = missing.then(|| "the path is relative to the file that imports".to_owned());
            Box::new(Diagnostic::error("LF0101", name.span, message).maybe_hint(hint))
        })
    }

    /// The file that `file` imports from a package.
    fn package(
        &mut self,
        file: FileId,
        import: &Import,
        loader: &mut dyn SourceLoader,
        report: &mut Report,
    ) -> Result<FileId, Box<Diagnostic>> {
        let (ImportSource::File(name) | ImportSource::Package(name)) = &import.from;
        let wanted = package::Wanted::new(&name.text);
        if let Some(second) = import.reactors.get(1)
            && !wanted.names_a_file()
        {
            let message = "without the name of a file, an import is of one reactor";
            return Err(Box::new(
                Diagnostic::error("LF0106", second.name.span, message)
                    .hint("name the file, `<package/File.lf>`, or write two imports"),
            ));
        }
        let reactor = import.reactors.first().map_or("", |first| first.name.text.as_str());
        let main = self.sources.path(Self::MAIN).to_owned();
        let folders = package::folders(self.sources.path(file), &main, loader);
        let candidates = wanted.candidates(&folders, reactor);
        let found = candidates.iter().find_map(|path| self.load_file(path, loader, report).ok());
        if let Some(found) = found {
            return Ok(found);
        }
        if !wanted.names_a_file()
            && let Some(path) = wanted.search(&folders, reactor, loader)
            && let Ok(found) = self.load_file(&path, loader, report)
        {
            return Ok(found);
        }
        let message = format!("cannot find `<{}>` among the packages", name.text);
        let hint = format!(
            "looked for `{}` in {}; the environment variable LF_PACKAGES names more folders",
            wanted.path_in_shelf(reactor),
            folders.join(", ")
        );
        Err(Box::new(Diagnostic::error("LF0105", name.span, message).hint(hint)))
    }

    /// The file at `path`, which is read unless it has been.
    fn load_file(
        &mut self,
        path: &str,
        loader: &mut dyn SourceLoader,
        report: &mut Report,
    ) -> Result<FileId, String> {
        if let Some(known) = self.sources.find(path) {
            return Ok(known);
        }
        if self.models.len() >= MAX_FILES {
            return Err(format!("the program has more than {MAX_FILES} files already"));
        }
        let text = read(path, loader)?;
        if self.size + text.len() > MAX_TEXT {
            return Err(format!("the program has more than {} MiB already", MAX_TEXT >> 20));
        }
        Ok(self.parse(path, text, report))
    }

    /// The file behind each import of `file`, none where it could not be loaded.
    fn imports(&self, file: FileId) -> impl Iterator<Item = (&Import, Option<FileId>)> {
        let found = self.imported[file.index()].iter().copied();
        self.models[file.index()].imports.iter().zip(found)
    }

    fn index_classes(&mut self) {
        for file in self.files() {
            let count = self.models[file.index()].reactors.len();
            self.classes.extend((0..count).map(|index| (file, index)));
        }
    }

    fn declared_in(&self, file: FileId) -> impl Iterator<Item = ClassId> {
        // Classes are numbered file by file.
        let first = self.classes.partition_point(|(home, _)| *home < file);
        let end = self.classes.partition_point(|(home, _)| *home <= file);
        (first..end).map(ClassId)
    }

    /// By file, what its own reactors and those that it imports are called there.
    fn scopes(&self, report: &mut Report) -> Vec<BTreeMap<String, ClassId>> {
        let exports: Vec<_> = self.files().map(|file| self.exports(file)).collect();
        self.files().map(|file| self.scope(file, &exports, report)).collect()
    }

    fn scope(
        &self,
        file: FileId,
        exports: &[BTreeMap<&str, ClassId>],
        report: &mut Report,
    ) -> BTreeMap<String, ClassId> {
        let mut scope = BTreeMap::new();
        let mut spans: BTreeMap<String, Span> = BTreeMap::new();
        let mut declare = |name: &Name, class, report: &mut Report| {
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
        for (import, from) in self.imports(file) {
            let Some(from) = from else { continue };
            let exports = &exports[from.index()];
            for ImportedReactor { name, alias } in &import.reactors {
                match exports.get(name.text.as_str()) {
                    Some(class) => declare(alias.as_ref().unwrap_or(name), *class, report),
                    None if report.is_full() || self.broken.contains(&from) => {}
                    None => report.add(self.no_export(from, name, exports)),
                }
            }
        }
        scope
    }

    /// What a file lets others import.
    fn exports(&self, file: FileId) -> BTreeMap<&str, ClassId> {
        let mut exports = BTreeMap::new();
        for class in self.declared_in(file) {
            let ReactorNode { kind, name, .. } = self.reactor(class);
            if let (ReactorKind::Plain, Some(name)) = (kind, name) {
                exports.entry(name.text.as_str()).or_insert(class);
            }
        }
        exports
    }

    fn no_export(
        &self,
        from: FileId,
        name: &Name,
        exports: &BTreeMap<&str, ClassId>,
    ) -> Diagnostic {
        let path = self.sources.path(from);
        let message = format!("`{path}` has no reactor `{}` to import", name.text);
        let hint = existing(&name.text, "its reactors", exports.keys().copied());
        Diagnostic::error("LF0102", name.span, message).hint(hint)
    }

    fn post_order(&self, main: FileId) -> Vec<FileId> {
        let mut order = Vec::new();
        let mut entered = BTreeSet::from([main]);
        let mut stack = vec![(main, 0)];
        while let Some((file, next)) = stack.pop() {
            let Some(imported) = self.imported[file.index()].get(next) else {
                order.push(file);
                continue;
            };
            stack.push((file, next + 1));
            stack.extend(imported.filter(|file| entered.insert(*file)).map(|file| (file, 0)));
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
