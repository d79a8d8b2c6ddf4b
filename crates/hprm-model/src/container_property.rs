//! The target property `docker`: what the containers of a federation are made of.
//!
//! `hprm compose` writes their files; a program runs without containers whatever is stated here.

use crate::declaration::{Element, ElementKind};
use crate::diagnostic::{Diagnostic, Report, did_you_mean};
use crate::property_values::{Read, boolean, word};
use crate::source::Span;
use crate::syntax::Syntax;

/// What the program says of its containers.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Containers {
    /// `runner-base`: the image that federates start from.
    pub runner_base: Option<String>,
    /// `rti-image`: the image that the RTI starts from.
    pub rti_image: Option<String>,
    /// `env-file`: a file of environment variables for all containers.
    pub env_file: Option<String>,
    /// `pre-build-script`: what runs before anything is installed into an image.
    pub pre_build_script: Option<String>,
    /// `post-build-script`: what runs after everything has been installed into an image.
    pub post_build_script: Option<String>,
    /// `pre-run-script`: what runs in a container before its federate.
    pub pre_run_script: Option<String>,
    /// `docker-compose-override`: a file that replaces parts of the one that is written.
    pub compose_override: Option<String>,
    /// Where the paths of files are stated.
    pub(crate) files: Vec<(String, Span)>,
}

/// The keys of the dictionary. Those for a compilation say nothing here.
const KEYS: [&str; 9] = [
    "builder-base",
    "docker-compose-override",
    "env-file",
    "no-build",
    "post-build-script",
    "pre-build-script",
    "pre-run-script",
    "rti-image",
    "runner-base",
];

/// Those that name a file of this machine, beside the file that states it.
const FILES: [&str; 2] = ["docker-compose-override", "env-file"];

/// Reads the property; none is `false`.
pub(crate) fn read(
    value: &Element,
    syntax: Syntax,
    report: &mut Report,
) -> Read<Option<Containers>> {
    let ElementKind::Dictionary(entries) = &value.kind else {
        return match boolean(value) {
            Ok(wanted) => Ok(wanted.then(Containers::default)),
            Err(_) => Err("`true`, `false` or `{ name: value, ... }`"),
        };
    };
    let mut containers = Containers::default();
    for entry in entries {
        let key = entry.name.text.to_ascii_lowercase();
        let text = word(&entry.value).filter(|text| !text.is_empty()).map(str::to_owned);
        // Nothing is compiled in a container.
        let mut unused = None;
        let place = match key.as_str() {
            "runner-base" => &mut containers.runner_base,
            "rti-image" => &mut containers.rti_image,
            "env-file" => &mut containers.env_file,
            "pre-build-script" => &mut containers.pre_build_script,
            "post-build-script" => &mut containers.post_build_script,
            "pre-run-script" => &mut containers.pre_run_script,
            "docker-compose-override" => &mut containers.compose_override,
            "builder-base" => &mut unused,
            "no-build" => {
                if let Err(expected) = boolean(&entry.value) {
                    wrong(&key, &entry.value, &syntax.value(expected), report);
                }
                continue;
            }
            _ => {
                let message = format!("`docker` has no option `{}`", entry.name.text);
                let hint = did_you_mean(&entry.name.text, KEYS);
                report.add(Diagnostic::error("LF0603", entry.name.span, message).maybe_hint(hint));
                continue;
            }
        };
        match text {
            // It would end its line of a Dockerfile.
            Some(text) if text.contains(char::is_control) => {
                wrong(&key, &entry.value, "a text in one line", report);
            }
            Some(text) => {
                if FILES.contains(&key.as_str()) {
                    containers.files.push((text.clone(), entry.value.span));
                }
                *place = Some(text);
            }
            None => wrong(&key, &entry.value, "a text", report),
        }
    }
    Ok(Some(containers))
}

fn wrong(key: &str, value: &Element, expected: &str, report: &mut Report) {
    let message = format!("`{key}` must be {expected}");
    report.add(Diagnostic::error("LF0603", value.span, message));
}
