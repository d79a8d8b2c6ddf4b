//! The files of a program with what they declare, and which reactor each name means in each file.
//!
//! Front ends fill a [`Library`]; the stages of [`compile()`](crate::compile()) only read it.

use std::collections::{BTreeMap, BTreeSet};

use crate::compiled::ExecutableFederate;
use crate::declaration::{Name, Property, ReactorNode};
use crate::diagnostic::{Diagnostic, Report};
use crate::source::{FileId, Sources, Span};

/// A reactor class of a [`Library`].
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct ClassId(pub(crate) usize);

/// What one file declares.
#[derive(Clone, Debug, Default)]
struct File {
    properties: Vec<Property>,
    preambles: Vec<Span>,
    /// What a name means here.
    scope: BTreeMap<String, Meaning>,
    /// The names of what is imported, in their order.
    imported: Vec<Name>,
    /// The files that are imported, in their order.
    uses: Vec<FileId>,
}

/// What a name means in a file, and where that is stated.
#[derive(Clone, Copy, Debug)]
struct Meaning {
    class: ClassId,
    span: Span,
}

/// All files of a program, and the reactor classes in them.
///
/// A front end adds the files, what each declares, and then what each imports. All files, classes and places
/// that it states are in this library; others are a bug of the front end, and a panic.
#[derive(Clone, Debug)]
pub struct Library {
    pub(crate) sources: Sources,
    /// By source.
    files: Vec<File>,
    classes: Vec<(FileId, ReactorNode)>,
    /// The main reactor, if the front end states it.
    main: Option<ClassId>,
    /// The reactors that are executables.
    pub(crate) executables: BTreeMap<ClassId, ExecutableFederate>,
    /// Whether other programs connect what the main reactor contains.
    pub(crate) is_part: bool,
}

impl Library {
    /// The library of a program whose main file, [`FileId::MAIN`], is at `path` and has this text.
    ///
    /// The main file has the main reactor, and its target properties count. A path is what diagnostics
    /// show; nothing opens it.
    #[must_use]
    pub fn new(path: &str, text: String) -> Self {
        let (sources, files, classes) = (Sources::new(), Vec::new(), Vec::new());
        let (main, executables) = (None, BTreeMap::new());
        let mut library = Self { sources, files, classes, main, executables, is_part: false };
        library.add_file(path, text);
        library
    }

    /// Adds a file that declares something. Its text is what diagnostics show, and where bodies are.
    pub fn add_file(&mut self, path: &str, text: String) -> FileId {
        self.files.push(File::default());
        self.sources.add(path, text)
    }

    /// Adds a text that an option on the command line states. Diagnostics show the option, as it is
    /// `typed`, and no places in the text.
    pub fn add_stated(&mut self, typed: &str, text: String) -> FileId {
        self.files.push(File::default());
        self.sources.add_stated(typed, text)
    }

    /// Sets the target properties that a file states.
    pub fn set_properties(&mut self, file: FileId, properties: Vec<Property>) {
        self.files[file.index()].properties = properties;
    }

    /// Adds a preamble of a file: Python, which is text of a source.
    pub fn add_preamble(&mut self, file: FileId, text: Span) {
        self.files[file.index()].preambles.push(text);
    }

    /// Adds a reactor that a file declares. The file sees it under its name; two of one name are
    /// reported.
    pub fn add_reactor(
        &mut self,
        file: FileId,
        reactor: ReactorNode,
        report: &mut Report,
    ) -> ClassId {
        if let Some(name) = &reactor.name {
            self.declare(file, name, ClassId(self.classes.len()), report);
        }
        self.add_unlisted(file, reactor)
    }

    /// Adds a reactor that a file declares, without a name by which the file sees it: there may be others of
    /// its name. Instantiations know it by what this returns.
    pub fn add_unlisted(&mut self, file: FileId, reactor: ReactorNode) -> ClassId {
        let class = ClassId(self.classes.len());
        self.classes.push((file, reactor));
        class
    }

    /// States which reactor of the main file is the main reactor. Without that, it is the one that is not
    /// plain, and its name, if it has one, is that of the file.
    pub fn set_main(&mut self, main: ClassId) {
        self.main = Some(main);
    }

    /// States that what the main reactor contains is a part of other programs, which connect it. Its inputs may be open.
    pub fn set_part(&mut self) {
        self.is_part = true;
    }

    /// States that a file imports `class`, and sees it as `name`. A name that has a meaning there already
    /// is reported.
    pub fn import(&mut self, file: FileId, name: Name, class: ClassId, report: &mut Report) {
        self.declare(file, &name, class, report);
        self.uses(file, self.file_of(class));
        self.files[file.index()].imported.push(name);
    }

    /// States that a file imports another one, as [`import`](Self::import) does: the preambles of the
    /// other one run before its own.
    pub fn uses(&mut self, file: FileId, other: FileId) {
        self.files[file.index()].uses.push(other);
    }

    /// All texts.
    #[must_use]
    pub fn sources(&self) -> &Sources {
        &self.sources
    }

    fn declare(&mut self, file: FileId, name: &Name, class: ClassId, report: &mut Report) {
        let meaning = Meaning { class, span: name.span };
        let scope = &mut self.files[file.index()].scope;
        if let Some(first) = scope.insert(name.text.clone(), meaning) {
            let message = format!("`{}` is already a reactor of this file", name.text);
            report.add(
                Diagnostic::error("LF0201", name.span, message).label(first.span, "first here"),
            );
        }
    }

    pub(crate) fn properties(&self, file: FileId) -> &[Property] {
        &self.files[file.index()].properties
    }

    pub(crate) fn preambles(&self, file: FileId) -> &[Span] {
        &self.files[file.index()].preambles
    }

    /// The names of the classes that a file imports, in their order.
    pub(crate) fn imported(&self, file: FileId) -> &[Name] {
        &self.files[file.index()].imported
    }

    pub(crate) fn classes(&self) -> impl Iterator<Item = ClassId> + use<> {
        (0..self.classes.len()).map(ClassId)
    }

    /// What the main file declares.
    pub(crate) fn classes_of_main(&self) -> impl Iterator<Item = ClassId> {
        self.classes().filter(|class| self.file_of(*class) == FileId::MAIN)
    }

    /// The main reactor, if the front end has stated it.
    pub(crate) fn stated_main(&self) -> Option<ClassId> {
        self.main
    }

    pub(crate) fn reactor(&self, class: ClassId) -> &ReactorNode {
        &self.classes[class.0].1
    }

    pub(crate) fn reactor_mut(&mut self, class: ClassId) -> &mut ReactorNode {
        &mut self.classes[class.0].1
    }

    pub(crate) fn file_of(&self, class: ClassId) -> FileId {
        self.classes[class.0].0
    }

    /// The class that `name` means in `file`.
    pub(crate) fn find(&self, file: FileId, name: &str) -> Option<ClassId> {
        self.files[file.index()].scope.get(name).map(|meaning| meaning.class)
    }

    /// What a file can instantiate.
    pub(crate) fn names(&self, file: FileId) -> impl Iterator<Item = &str> + Clone {
        self.files[file.index()].scope.keys().map(String::as_str)
    }

    /// The files that the main file needs, each after what it imports, so the main file is last.
    pub(crate) fn order(&self) -> Vec<FileId> {
        let mut order = Vec::new();
        let mut entered = BTreeSet::from([FileId::MAIN]);
        let mut stack = vec![(FileId::MAIN, 0)];
        while let Some((file, next)) = stack.pop() {
            let Some(other) = self.files[file.index()].uses.get(next) else {
                order.push(file);
                continue;
            };
            stack.push((file, next + 1));
            if entered.insert(*other) {
                stack.push((*other, 0));
            }
        }
        order
    }
}
