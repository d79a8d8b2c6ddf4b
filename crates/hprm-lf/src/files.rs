//! The files that target properties name: whether they are there.

use hprm_model::{Diagnostic, Report, Sources, TargetProperties, did_you_mean};

use crate::source::{SourceLoader, sibling};

/// Reports files that are stated and not there.
pub fn check_files(
    properties: &TargetProperties,
    sources: &Sources,
    loader: &mut dyn SourceLoader,
    report: &mut Report,
) {
    for stated in properties.files() {
        let path = sibling(sources.path(stated.stated_in), stated.path);
        if loader.exists(&path) {
            continue;
        }
        let (folder, file) = path.rsplit_once('/').unwrap_or((".", &path));
        let others = loader.list(folder);
        let others = others.iter().map(|other| other.trim_end_matches('/'));
        let relative = "the path is relative to the file that states it";
        let hint = did_you_mean(file, others).unwrap_or_else(|| relative.to_owned());
        let message = format!("there is no file `{path}`");
        report.add(match stated.is_needed {
            true => Diagnostic::error("LF0611", stated.span, message).hint(hint),
            false => Diagnostic::warning("LF0610", stated.span, message).hint(hint),
        });
    }
}
