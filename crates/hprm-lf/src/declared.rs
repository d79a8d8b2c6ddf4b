//! Programs that another language has declared: the command line is the same for them, and so are the executables
//! that they name.

use hprm_declared::{Declaration, Malformed};
use hprm_model::{CompileFailure, Compiled, Purpose, Report, Syntax, TargetProperties};

use crate::files::check_files;
use crate::overrides::{PARAMETER, overrides};
use crate::source::SourceLoader;

/// Compiles the program that `text` declares, with target properties as `KEY=VALUE`, which override those of
/// the program. Values of parameters, `main.NAME=VALUE`, are left out: the program has used them when it made
/// its main reactor. `loader` asks the executables that it names, and tells whether
/// the files are there that target properties name.
///
/// # Errors
///
/// [`Malformed`] if the text is no declaration; the inner error has everything that is wrong with the program.
pub fn compile_declared(
    text: &str,
    properties: &[String],
    loader: &mut dyn SourceLoader,
    purpose: Purpose,
) -> Result<Result<Compiled, CompileFailure>, Malformed> {
    let declaration = Declaration::read(text)?;
    let mut report = Report::new(Syntax::Python);
    let mut library = declaration.library(&mut report)?;
    let is_property = |stated: &&String| !stated.starts_with(PARAMETER);
    let stated: Vec<String> = properties.iter().filter(is_property).cloned().collect();
    let overrides = overrides(&stated, &mut library, &mut report);
    hprm_declared::describe(&mut library, &overrides, |it| loader.describe(it), &mut report);
    let properties = TargetProperties::read(&library, &overrides, &mut report);
    check_files(&properties, library.sources(), loader, &mut report);
    let compiled = hprm_model::compile(library, properties, &overrides, purpose, report);
    Ok(compiled.map(|mut compiled| {
        if compiled.federated {
            compiled.modules = declaration.facts(&compiled);
        }
        compiled
    }))
}
