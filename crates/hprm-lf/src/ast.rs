//! The tree of a `.lf` file: what stands at its top, as written. The reactors in it are
//! [declarations](hprm_model::declaration).

use hprm_model::Span;
use hprm_model::declaration::{Name, Property, ReactorNode};

/// A file.
#[derive(Clone, PartialEq, Debug, Default)]
pub(crate) struct FileNode {
    pub(crate) target: Option<Target>,
    pub(crate) imports: Vec<Import>,
    pub(crate) preambles: Vec<Span>,
    pub(crate) reactors: Vec<ReactorNode>,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Target {
    pub(crate) name: Name,
    pub(crate) properties: Vec<Property>,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Import {
    pub(crate) reactors: Vec<ImportedReactor>,
    pub(crate) from: ImportSource,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct ImportedReactor {
    pub(crate) name: Name,
    pub(crate) alias: Option<Name>,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) enum ImportSource {
    File(Name),
    /// The text between `<` and `>`.
    Package(Name),
}
