//! The files of a program: the main file and what it imports are read, parsed, and become a library.

use std::collections::{BTreeMap, BTreeSet};

use hprm_model::declaration::{Name, ReactorKind};
use hprm_model::{ClassId, Diagnostic, FileId, Library, Report, Span, existing};

use crate::ast::{FileNode, Import, ImportSource, ImportedReactor, Target};
use crate::package;
use crate::parser;
use crate::source::{MAX_FILE, SourceLoader, sibling};

/// The most files in one program; a loader that has a file for every path must not keep the compiler busy for ever.
const MAX_FILES: usize = 1_000;

/// The most imports in one program.
const MAX_IMPORTS: usize = 10_000;

/// The most text in one program, in bytes.
const MAX_TEXT: usize = 64 << 20;

/// A program whose files have been read.
pub(crate) struct Loaded {
    pub(crate) library: Library,
    /// Whether the main file states its target.
    pub(crate) states_target: bool,
}

/// Reads and parses the file at `path`, and what it imports.
pub(crate) fn load(path: &str, loader: &mut dyn SourceLoader, report: &mut Report) -> Loaded {
    let path = sibling("", path);
    let text = read(&path, loader).unwrap_or_else(|reason| {
        let message = format!("cannot read `{path}`: {reason}");
        report.add(Diagnostic::error("LF0101", Span::new(FileId::MAIN, 0..0), message));
        String::new()
    });
    let mut files = Files {
        loader,
        library: Library::new(&path, text),
        size: 0,
        nodes: Vec::new(),
        broken: BTreeSet::new(),
        imported: Vec::new(),
    };
    files.parse(FileId::MAIN, report);
    files.load_imports(report);
    files.into_library(report)
}

/// The files of a program, as far as they have been read.
struct Files<'l> {
    loader: &'l mut dyn SourceLoader,
    /// The text of the files; what they declare is added when all have been parsed.
    library: Library,
    /// The bytes of all files.
    size: usize,
    /// By file.
    nodes: Vec<FileNode>,
    /// Files that were not understood as a whole, which has been reported.
    broken: BTreeSet<FileId>,
    /// By file and import, the file that is imported.
    imported: Vec<Vec<Option<FileId>>>,
}

impl Files<'_> {
    /// Parses a file that the library has got, the next one in their order.
    fn parse(&mut self, file: FileId, report: &mut Report) {
        let text = self.library.sources().text(file);
        self.size += text.len();
        self.imported.push(Vec::new());
        let known = report.errors();
        self.nodes.push(parser::parse(file, text, report));
        if report.errors() > known {
            self.broken.insert(file);
        }
    }

    /// Loads what the main file imports, and what that imports.
    fn load_imports(&mut self, report: &mut Report) {
        let mut pending = vec![FileId::MAIN];
        let mut count = 0;
        while let Some(file) = pending.pop() {
            for import in self.nodes[file.index()].imports.clone() {
                count += 1;
                let (ImportSource::File(name) | ImportSource::Package(name)) = &import.from;
                if count > MAX_IMPORTS {
                    let message = format!("more than {MAX_IMPORTS} imports in one program");
                    report.add(Diagnostic::error("LF0103", name.span, message));
                    return;
                }
                let known = self.nodes.len();
                let found = match &import.from {
                    ImportSource::File(name) => self.file(file, name, report),
                    ImportSource::Package(_) => self.package(file, &import, report),
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
        report: &mut Report,
    ) -> Result<FileId, Box<Diagnostic>> {
        let path = sibling(self.library.sources().path(file), &name.text);
        self.load_file(&path, report).map_err(|reason| {
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
        report: &mut Report,
    ) -> Result<FileId, Box<Diagnostic>> {
        let (ImportSource::File(name) | ImportSource::Package(name)) = &import.from;
        let wanted = package::Wanted::new(&name.text);
        if let Some(second) = import.reactors.get(1)
            && !wanted.names_a_file()
        {
            let message = "an import from a package names one reactor, unless it names the file";
            return Err(Box::new(
                Diagnostic::error("LF0106", second.name.span, message)
                    .hint("name the file, `<package/File.lf>`, or write two imports"),
            ));
        }
        let reactor = import.reactors.first().map_or("", |first| first.name.text.as_str());
        let main = self.library.sources().path(FileId::MAIN).to_owned();
        let folders = package::folders(self.library.sources().path(file), &main, self.loader);
        let candidates = wanted.candidates(&folders, reactor);
        let found = candidates.iter().find_map(|path| self.load_file(path, report).ok());
        if let Some(found) = found {
            return Ok(found);
        }
        if !wanted.names_a_file()
            && let Some(path) = wanted.search(&folders, reactor, self.loader)
            && let Ok(found) = self.load_file(&path, report)
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
    fn load_file(&mut self, path: &str, report: &mut Report) -> Result<FileId, String> {
        if let Some(known) = self.library.sources().find(path) {
            return Ok(known);
        }
        if self.nodes.len() >= MAX_FILES {
            return Err(format!("the program has more than {MAX_FILES} files already"));
        }
        let text = read(path, self.loader)?;
        if self.size + text.len() > MAX_TEXT {
            return Err(format!("the program has more than {} MiB already", MAX_TEXT >> 20));
        }
        let file = self.library.add_file(path, text);
        self.parse(file, report);
        Ok(file)
    }

    /// Adds to the library what the files declare, and then what they import.
    fn into_library(mut self, report: &mut Report) -> Loaded {
        let states_target = self.nodes[FileId::MAIN.index()].target.is_some();
        let mut exports: Vec<Exports> = Vec::new();
        let mut imports: Vec<(FileId, Vec<Import>)> = Vec::new();
        for (file, node) in (0..).map(FileId).zip(std::mem::take(&mut self.nodes)) {
            let FileNode { target, imports: stated, preambles, reactors } = node;
            if let Some(Target { name, properties }) = target {
                check_target(&name, report);
                self.library.set_properties(file, properties);
            }
            for preamble in preambles {
                self.library.add_preamble(file, preamble);
            }
            let mut exported = Exports::new();
            for reactor in reactors {
                let name = reactor.name.clone().filter(|_| reactor.kind == ReactorKind::Plain);
                let class = self.library.add_reactor(file, reactor, report);
                if let Some(name) = name {
                    exported.entry(name.text).or_insert(class);
                }
            }
            exports.push(exported);
            imports.push((file, stated));
        }
        for (file, stated) in imports {
            for (import, from) in stated.into_iter().zip(self.imported[file.index()].clone()) {
                if let Some(from) = from {
                    self.library.uses(file, from);
                    self.import(file, import.reactors, (from, &exports[from.index()]), report);
                }
            }
        }
        Loaded { library: self.library, states_target }
    }

    /// Lets `file` see reactors that the file `from` exports.
    fn import(
        &mut self,
        file: FileId,
        reactors: Vec<ImportedReactor>,
        (from, exports): (FileId, &Exports),
        report: &mut Report,
    ) {
        for ImportedReactor { name, alias } in reactors {
            match exports.get(name.text.as_str()) {
                Some(class) => {
                    self.library.import(file, alias.unwrap_or(name), *class, report);
                }
                None if report.is_full() || self.broken.contains(&from) => {}
                None => {
                    let path = self.library.sources().path(from);
                    let message = format!("`{path}` has no reactor `{}` to import", name.text);
                    let all = exports.keys().map(String::as_str);
                    let hint = existing(&name.text, "its reactors", all);
                    report.add(Diagnostic::error("LF0102", name.span, message).hint(hint));
                }
            }
        }
    }
}

/// What a file lets others import, by name.
type Exports = BTreeMap<String, ClassId>;

fn check_target(name: &Name, report: &mut Report) {
    if name.text != "Python" {
        let message = format!("the target `{}` is not supported", name.text);
        report.add(Diagnostic::error("LF0601", name.span, message).hint("write `target Python`"));
    }
}

fn read(path: &str, loader: &mut dyn SourceLoader) -> Result<String, String> {
    let text = loader.load(path)?;
    if text.len() > MAX_FILE {
        return Err(format!("it is larger than {} MiB", MAX_FILE >> 20));
    }
    Ok(text.strip_prefix('\u{feff}').map_or(text.clone(), str::to_owned))
}
