//! From text to a checked program: the files become a library, which `hprm-model` compiles.

use hprm_model::{
    CompileFailure, Compiled, Diagnostic, FileId, Purpose, Report, Span, TargetProperties,
};

use crate::files::check_files;
use crate::load::{self, Loaded};
use crate::modules;
use crate::overrides::overrides;
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
/// let body = compiled.classes[0].reactions[0].code.as_ref().unwrap();
/// assert_eq!(body.text, "print(\"hello\")");
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

/// Like [`compile_with`], for a diagram: there is an [outline](hprm_model::outline), also of a program that is
/// refused because of a causality loop.
///
/// # Errors
///
/// Everything that is wrong with the program or the properties.
pub fn draw(
    path: &str,
    properties: &[String],
    loader: &mut dyn SourceLoader,
) -> Result<Compiled, CompileFailure> {
    all_stages(path, properties, loader, Purpose::Draw)
}

fn all_stages(
    path: &str,
    stated: &[String],
    loader: &mut dyn SourceLoader,
    purpose: Purpose,
) -> Result<Compiled, CompileFailure> {
    let mut report = Report::default();
    let Loaded { mut library, states_target } = load::load(path, loader, &mut report);
    let overrides = overrides(stated, &mut library, &mut report);
    hprm_declared::describe(&mut library, &overrides, |it| loader.describe(it), &mut report);
    let properties = TargetProperties::read(&library, &overrides, &mut report);
    if !states_target && !report.has_errors() {
        let message = "the file does not say what its target is";
        report.add(
            Diagnostic::error("LF0601", Span::new(FileId::MAIN, 0..0), message)
                .hint("start it with `target Python`"),
        );
    }
    check_files(&properties, library.sources(), loader, &mut report);
    let mut compiled = hprm_model::compile(library, properties, &overrides, purpose, report)?;
    if compiled.federated && purpose == Purpose::Run {
        compiled.modules = modules::facts(&compiled, loader);
    }
    Ok(compiled)
}
