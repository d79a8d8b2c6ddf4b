//! The target declaration: which properties the runtime obeys, which have no effect, which are wrong.
//!
//! The properties of the main file count; only `files` and `protobufs` are collected from imported
//! files as well.

use hprm_core::{Coordination, Nanos, Properties, Spin, StoreOptions, WhenFull};

use crate::clock_property;
use crate::container_property::{self, Containers};
use crate::declaration::{Element, ElementKind, Property};
use crate::diagnostic::{Diagnostic, Report, did_you_mean};
use crate::library::Library;
use crate::overrides::Overrides;
use crate::property_rules;
use crate::property_values::{Read, boolean, integer, size, time, word};
use crate::source::{FileId, Span};
use crate::syntax::Syntax;

/// Target properties for the driver of the program, as far as they are stated.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Settings {
    /// `logging`, in lower case: `error`, `warn`, `info`, `log` or `debug`.
    pub logging: Option<String>,
    /// `single-threaded`: one worker, whatever `workers` is.
    pub single_threaded: bool,
    /// `tracing`: whether runs write a trace.
    pub tracing: bool,
    /// Into which file, if `tracing` says that.
    pub trace_file: Option<String>,
    /// `auth`: links within one machine prove the secret of the federation too.
    pub auth: bool,
    /// `comm-type: TLS`: links between machines are encrypted.
    pub encrypt: bool,
    /// `store-limit` and `store-full`: how much memory an object store may take, and what then.
    pub store: StoreOptions,
    /// `docker`: what the containers of the federation are made of, if it is to have some.
    pub containers: Option<Containers>,
}

/// A file that a target property names.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct StatedFile<'a> {
    /// Its path, as it is stated.
    pub path: &'a str,
    /// The file that states it, from which a relative path leads on.
    pub stated_in: FileId,
    /// Where it is stated.
    pub span: Span,
    /// Whether the program cannot run without it: the property is `protobufs`.
    pub is_needed: bool,
}

/// Known, and without effect where nothing is generated or compiled; a warning says so.
const IGNORED: [&str; 10] = [
    "build",
    "build-type",
    "cmake-args",
    "cmake-include",
    "compile-definitions",
    "no-compile",
    "no-source-mapping",
    "python-version",
    "threading",
    "verify",
];

/// Known, and not obeyed yet: a warning tells the user.
const NOT_YET: [&str; 3] = ["coordination-options", "sst", "trace-plugin"];

const OBEYED: [&str; 23] = [
    "auth",
    "clock-sync",
    "clock-sync-options",
    "comm-type",
    "coordination",
    "cpus",
    "dnet",
    "docker",
    "fast",
    "files",
    "keepalive",
    "logging",
    "protobufs",
    "realtime",
    "scheduler",
    "single-threaded",
    "spin",
    "start-time-multiple",
    "store-full",
    "store-limit",
    "timeout",
    "tracing",
    "workers",
];

/// The target properties of a program, read and checked one by one.
///
/// A front end reads them before it compiles a program, so that it can look for the
/// [files](TargetProperties::files) that they name: this crate opens none.
#[derive(Clone, Debug, Default)]
pub struct TargetProperties {
    pub(crate) properties: Properties,
    pub(crate) settings: Settings,
    pub(crate) files: Vec<(String, FileId)>,
    pub(crate) protobufs: Vec<(String, FileId)>,
    /// Of the files that are stated, in this order: `files`, and then `protobufs`.
    places: [Vec<Span>; 2],
    keepalive: Option<bool>,
    fast: Option<Span>,
}

impl TargetProperties {
    /// Reads the properties of the files, and then the `overrides`, which replace them. Of files that are
    /// imported, only `files` and `protobufs` count.
    #[must_use]
    pub fn read(library: &Library, overrides: &Overrides, report: &mut Report) -> Self {
        let mut stated = Self::default();
        for file in library.order() {
            for property in library.properties(file) {
                if stated.collect(property, file, report) {
                    continue;
                }
                if file == FileId::MAIN {
                    stated.property(property, report.syntax(), report);
                }
            }
        }
        for property in &overrides.properties {
            if !stated.collect(property, property.name.span.file, report) {
                // A command line has values as `.lf` files have them.
                stated.property(property, Syntax::Lf, report);
            }
        }
        if stated.settings.single_threaded {
            stated.properties.workers = Some(1);
        }
        stated
    }

    /// Reads a property, whose value is written in a `syntax`.
    fn property(&mut self, property: &Property, syntax: Syntax, report: &mut Report) {
        let name = property.name.text.to_ascii_lowercase();
        let value = &property.value;
        let known = match name.as_str() {
            "timeout" => time(value).map(|time| self.properties.timeout = Some(time)),
            "start-time-multiple" => {
                time(value).map(|time| self.properties.start_time_multiple = time)
            }
            "fast" => boolean(value).map(|fast| {
                self.properties.fast = fast;
                self.fast = fast.then_some(value.span);
            }),
            "keepalive" => boolean(value).map(|keepalive| {
                self.properties.keepalive = keepalive;
                self.keepalive = Some(keepalive);
            }),
            "single-threaded" => boolean(value).map(|single| {
                self.settings.single_threaded = single;
                self.properties.deadlines_first |= single;
            }),
            "scheduler" => scheduler(value).map(|gedf| self.properties.deadlines_first |= gedf),
            "coordination" => coordination(value).map(|c| self.properties.coordination = c),
            "logging" => logging(value).map(|level| self.settings.logging = Some(level)),
            "realtime" => realtime(value).map(|priority| self.properties.realtime = priority),
            "cpus" => cpus(value).map(|cpus| self.properties.cpus = cpus),
            "spin" => spin(value).map(|spin| self.properties.spin = spin),
            "workers" => workers(value).map(|workers| self.properties.workers = Some(workers)),
            "auth" => boolean(value).map(|auth| self.settings.auth = auth),
            "dnet" => boolean(value).map(|dnet| self.properties.reports_all = !dnet),
            "clock-sync" => {
                clock_property::mode(value).map(|mode| self.properties.clock_sync.mode = mode)
            }
            "clock-sync-options" => {
                let options = &mut self.properties.clock_sync;
                clock_property::options(value, options, syntax, report)
            }
            "docker" => container_property::read(value, syntax, report)
                .map(|containers| self.settings.containers = containers),
            // SST is not supported.
            "comm-type" if !property_rules::is_sst(value) => {
                comm_type(value).map(|tls| self.settings.encrypt = tls)
            }
            "store-limit" => size(value).map(|limit| self.settings.store.limit = Some(limit)),
            "store-full" => when_full(value).map(|full| self.settings.store.when_full = full),
            "tracing" => tracing(value).map(|(is_on, file)| {
                self.settings.tracing = is_on;
                self.settings.trace_file = file;
            }),
            name if IGNORED.contains(&name) => {
                property_rules::ignored(property, name, syntax, report);
                Ok(())
            }
            "comm-type" => {
                not_yet(property, report);
                Ok(())
            }
            name if NOT_YET.contains(&name) => {
                property_rules::check_value(name, value, syntax, report);
                if !property_rules::is_no_change(name, value) {
                    not_yet(property, report);
                }
                Ok(())
            }
            _ => {
                unknown(property, report);
                Ok(())
            }
        };
        match known {
            Ok(()) => property_rules::unheeded(property, &name, syntax, report),
            Err(expected) => wrong(&name, value, &syntax.value(expected), report),
        }
    }

    /// Collects the paths of a property that every file may state. Returns whether it is one.
    fn collect(&mut self, property: &Property, file: FileId, report: &mut Report) -> bool {
        let name = property.name.text.to_ascii_lowercase();
        let [files, protobufs] = &mut self.places;
        let (paths, places) = match name.as_str() {
            "files" => (&mut self.files, files),
            "protobufs" => (&mut self.protobufs, protobufs),
            _ => return false,
        };
        if report.syntax() == Syntax::Python {
            property_rules::ignored(property, &name, Syntax::Python, report);
        }
        let elements = match &property.value.kind {
            ElementKind::List(elements) => elements.as_slice(),
            _ => std::slice::from_ref(&property.value),
        };
        for element in elements {
            match word(element) {
                Some(path) => {
                    paths.push((path.to_owned(), file));
                    places.push(element.span);
                }
                None => {
                    let message = format!("`{name}` must be a path or a list of paths");
                    report.add(Diagnostic::error("LF0603", element.span, message));
                }
            }
        }
        true
    }

    /// The files that the properties name: `files`, then `protobufs`, and then those of `docker`.
    pub fn files(&self) -> impl Iterator<Item = StatedFile<'_>> {
        let [files, protobufs] = &self.places;
        let files = self.files.iter().zip(files).map(|it| (it, false));
        let protobufs = self.protobufs.iter().zip(protobufs).map(|it| (it, true));
        let copied = files.chain(protobufs).map(|(((path, stated_in), span), is_needed)| {
            StatedFile { path, stated_in: *stated_in, span: *span, is_needed }
        });
        let containers = self.settings.containers.iter().flat_map(|it| &it.files);
        copied.chain(containers.map(|(path, span)| StatedFile {
            path,
            // Also if a command line states it.
            stated_in: FileId::MAIN,
            span: *span,
            is_needed: false,
        }))
    }

    /// Properties that follow from the program, and those that contradict it.
    pub(crate) fn settle(&mut self, federated: bool, physical: Physical, report: &mut Report) {
        let decentralized = self.properties.coordination == Coordination::Decentralized;
        let obstacles = [
            (physical.actions, "physical actions"),
            (federated && decentralized, "decentralized coordination"),
            (federated && physical.connections, "physical connections between federates"),
            (federated && physical.transients, "transient federates"),
        ];
        let obstacle = obstacles.into_iter().find(|(is_there, _)| *is_there);
        if let (Some(span), Some((_, with))) = (self.fast, obstacle) {
            let message = format!("`fast` does not go together with {with}");
            let hint = format!("remove {}", report.syntax().property("fast", "true"));
            report.add(Diagnostic::error("LF0605", span, message).hint(hint));
        }
        self.properties.keepalive = self.keepalive.unwrap_or(physical.actions);
    }
}

/// What a program has that follows the physical time.
#[derive(Clone, Copy)]
pub(crate) struct Physical {
    pub(crate) actions: bool,
    pub(crate) connections: bool,
    pub(crate) transients: bool,
}

/// Properties of other targets of Lingua Franca: never taken for misspelled ones.
const OF_OTHER_TARGETS: [&str; 16] = [
    "cargo-dependencies",
    "cargo-features",
    "cmake",
    "compiler",
    "export-dependency-graph",
    "export-to-yaml",
    "external-runtime-path",
    "flags",
    "hierarchical-bin",
    "no-runtime-validation",
    "platform",
    "print-statistics",
    "ros2",
    "runtime-version",
    "rust-include",
    "single-file-project",
];

/// A misspelled property is an error, because the program would run without it; other unknown properties
/// cause a warning, as in Lingua Franca.
fn unknown(property: &Property, report: &mut Report) {
    let name = &property.name;
    let known = OBEYED.into_iter().chain(NOT_YET).chain(IGNORED);
    let foreign = OF_OTHER_TARGETS.iter().any(|other| name.text.eq_ignore_ascii_case(other));
    match did_you_mean(&name.text, known).filter(|_| !foreign) {
        Some(hint) => {
            let message = format!("there is no target property `{}`", name.text);
            report.add(Diagnostic::error("LF0609", name.span, message).hint(hint));
        }
        None => {
            let message = format!("there is no target property `{}`; it is ignored", name.text);
            report.add(Diagnostic::warning("LF0602", name.span, message));
        }
    }
}

fn not_yet(property: &Property, report: &mut Report) {
    let name = &property.name;
    let message = format!("`{}` has no effect yet", name.text);
    report.add(Diagnostic::warning("LF0606", name.span, message));
}

fn coordination(value: &Element) -> Read<Coordination> {
    match word(value).map(str::to_ascii_lowercase).as_deref() {
        Some("centralized") => Ok(Coordination::Centralized),
        Some("decentralized") => Ok(Coordination::Decentralized),
        _ => Err("`centralized` or `decentralized`"),
    }
}

fn comm_type(value: &Element) -> Read<bool> {
    match word(value).map(str::to_ascii_lowercase).as_deref() {
        Some("tcp") => Ok(false),
        Some("tls") => Ok(true),
        _ => Err("one of `TCP`, `TLS`, `SST`"),
    }
}

fn wrong(name: &str, value: &Element, expected: &str, report: &mut Report) {
    let message = format!("`{name}` must be {expected}");
    // The valid words are between backquotes.
    let words = expected.split('`').skip(1).step_by(2);
    let hint = word(value).and_then(|word| did_you_mean(word, words));
    report.add(Diagnostic::error("LF0603", value.span, message).maybe_hint(hint));
}

fn logging(value: &Element) -> Read<String> {
    let level = word(value).map(str::to_ascii_lowercase);
    level
        .filter(|level| ["error", "warn", "info", "log", "debug"].contains(&level.as_str()))
        .ok_or("`error`, `warn`, `info`, `log` or `debug`")
}

/// Whether the scheduler orders reactions by their deadlines ("global earliest deadline first").
fn scheduler(value: &Element) -> Read<bool> {
    match word(value).map(str::to_ascii_uppercase).as_deref() {
        Some("NP" | "ADAPTIVE" | "DYNAMIC" | "STATIC") => Ok(false),
        Some("GEDF_NP" | "GEDF_NP_CI") => Ok(true),
        _ => Err("`NP`, `ADAPTIVE`, `GEDF_NP` or `GEDF_NP_CI`"),
    }
}

/// A priority above that of ordinary threads, and below that of the system's own.
const REALTIME: u8 = 50;

fn realtime(value: &Element) -> Read<Option<u8>> {
    if let Ok(wanted) = boolean(value) {
        return Ok(wanted.then_some(REALTIME));
    }
    integer(value)
        .and_then(|priority| u8::try_from(priority).ok())
        .filter(|priority| (1..=99).contains(priority))
        .map(Some)
        .ok_or("`true`, `false`, or a priority from 1 to 99")
}

fn cpus(value: &Element) -> Read<Vec<u32>> {
    let elements = match &value.kind {
        ElementKind::List(elements) => elements.as_slice(),
        _ => std::slice::from_ref(value),
    };
    let cpu = |element| integer(element).and_then(|cpu| u32::try_from(cpu).ok());
    let cpus: Option<Vec<_>> = elements.iter().map(cpu).collect();
    let cpus = cpus.filter(|cpus| !cpus.is_empty());
    cpus.ok_or("the number of a processor, or a list of such numbers: `[2, 3]`")
}

/// The longest time of busy-polling; a longer one is a mistake.
const LONGEST_SPIN: Nanos = 1_000_000_000;

/// Reads the value of `spin`.
///
/// # Errors
///
/// What it must be, if it is not that.
pub fn spin(value: &Element) -> Read<Spin> {
    const EXPECTED: &str = "`auto`, `off`, or a time up to a second, such as `100 us`";
    match word(value).map(str::to_ascii_lowercase).as_deref() {
        Some("auto") => Ok(Spin::Auto),
        Some("off") => Ok(Spin::For(0)),
        Some(_) => Err(EXPECTED),
        None => match time(value) {
            Ok(time) if time <= LONGEST_SPIN => Ok(Spin::For(time)),
            _ => Err(EXPECTED),
        },
    }
}

/// The most workers; each is a thread, and more of them than processors gain little.
const MAX_WORKERS: u32 = 1_000;

fn workers(value: &Element) -> Read<u32> {
    integer(value)
        .and_then(|number| u32::try_from(number).ok())
        .filter(|number| *number <= MAX_WORKERS)
        .ok_or("a whole number from 0 to 1000")
}

fn when_full(value: &Element) -> Read<WhenFull> {
    word(value).and_then(WhenFull::read).ok_or("`inline` or `error`")
}

/// Whether there is a trace, and the name of its file if that is stated.
fn tracing(value: &Element) -> Read<(bool, Option<String>)> {
    let ElementKind::Dictionary(stated) = &value.kind else {
        return boolean(value).map(|is_on| (is_on, None));
    };
    let file = stated.iter().find(|it| it.name.text == "trace-file-name");
    let name = file.map(|it| word(&it.value).ok_or("{ trace-file-name: \"NAME\" }"));
    Ok((true, name.transpose()?.map(str::to_owned)))
}
