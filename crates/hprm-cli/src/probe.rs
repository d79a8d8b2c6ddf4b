//! Looking at the machine: what HPRM needs, tried rather than guessed.
//!
//! Each probe is one finding. How findings are shown is [`doctor`](crate::doctor)'s business.

mod tuning;

use std::fmt::Display;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};
use std::process::Command;

use hprm::Pickling;
use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, ftruncate, memfd_create};
use rustix::process::{PidfdFlags, Resource, getpid, getrlimit, pidfd_open};
use serde_json::Value;

use crate::args::Interpreter;
use crate::python;

const VERSION: &str = env!("CARGO_PKG_VERSION");

/// How well something serves.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Health {
    /// As it should be.
    Good,
    /// Programs run, with a drawback.
    Poor,
    /// Programs do not run.
    Bad,
}

/// What a probe has found.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Finding {
    pub(crate) subject: &'static str,
    pub(crate) health: Health,
    pub(crate) text: String,
    pub(crate) hint: Option<&'static str>,
}

impl Finding {
    fn good(subject: &'static str, text: impl Into<String>) -> Self {
        Self { subject, health: Health::Good, text: text.into(), hint: None }
    }

    fn poor(subject: &'static str, text: impl Into<String>, hint: &'static str) -> Self {
        Self { subject, health: Health::Poor, text: text.into(), hint: Some(hint) }
    }

    fn bad(subject: &'static str, text: impl Into<String>, hint: &'static str) -> Self {
        Self { subject, health: Health::Bad, text: text.into(), hint: Some(hint) }
    }

    fn of(subject: &'static str, outcome: Result<(), impl Display>, hint: &'static str) -> Self {
        match outcome {
            Ok(()) => Self::good(subject, "works"),
            Err(error) => Self::bad(subject, error.to_string(), hint),
        }
    }
}

/// All findings, in the order in which they matter.
pub(crate) fn all(chosen: &Interpreter) -> Vec<Finding> {
    let mut findings = vec![Finding::good("hprm", VERSION)];
    findings.extend(interpreter(chosen));
    findings.extend([
        Finding::of("sealed memory", sealed_memory(), "large arrays need Linux 5.1 or later"),
        Finding::of(
            "local sockets",
            abstract_socket(),
            "federates need Linux, and unix(7) sockets",
        ),
        Finding::of("process watch", process_watch(), "federations need Linux 5.3 or later"),
        processors(),
        descriptors(),
        memory(),
        file_size(),
        pickles(),
    ]);
    findings.extend(tuning::all());
    findings
}

/// Asks the interpreter about itself, in one start.
const QUESTIONS: &str = r#"
import importlib, importlib.metadata, json, sys
def version(name):
    try:
        importlib.import_module(name)
        return importlib.metadata.version(name)
    except Exception as error:
        return {"error": f"{type(error).__name__}: {error}"}
print(json.dumps({
    "executable": sys.executable,
    "version": list(sys.version_info[:3]),
    "hprm": version("hprm"),
    "numpy": version("numpy"),
}))
"#;

fn interpreter(chosen: &Interpreter) -> Vec<Finding> {
    const INSTALL: &str = "install Python 3.10 or later, then HPRM into it: `pip install` with its wheel, or with . in a checkout";
    let Ok(python) = python::find_any(chosen) else {
        return vec![Finding::bad("python", "not found", INSTALL)];
    };
    let answer = Command::new(&python).args(["-c", QUESTIONS]).output();
    let answers: Option<Value> =
        answer.ok().and_then(|output| serde_json::from_slice(&output.stdout).ok());
    match answers {
        Some(answers) => interpreted(&answers),
        None => {
            vec![Finding::bad("python", format!("{} does not run", python.display()), INSTALL)]
        }
    }
}

/// What the interpreter's answers mean.
fn interpreted(answers: &Value) -> Vec<Finding> {
    let numbers: Vec<u64> =
        answers["version"].as_array().into_iter().flatten().filter_map(Value::as_u64).collect();
    let version: Vec<_> = numbers.iter().map(ToString::to_string).collect();
    let executable = answers["executable"].as_str().unwrap_or("an interpreter without a name");
    let text = format!("{} at {executable}", version.join("."));
    let python = if numbers >= vec![3, 10] {
        Finding::good("python", text)
    } else {
        Finding::bad("python", text, "HPRM needs Python 3.10 or later")
    };
    let module = match answers["hprm"].as_str() {
        Some(VERSION) => Finding::good("python module", VERSION),
        Some(other) => Finding::bad(
            "python module",
            format!("version {other}, but this command is {VERSION}"),
            "install both from the same release: `pip install` with its wheel, or with . in its checkout",
        ),
        None => Finding::bad(
            "python module",
            reason(&answers["hprm"]),
            "install HPRM into this interpreter: `pip install` with its wheel, or with . in a checkout",
        ),
    };
    let numpy = match answers["numpy"].as_str() {
        Some(version) => Finding::good("numpy", version),
        None => {
            Finding::poor("numpy", reason(&answers["numpy"]), "arrays need it: pip install numpy")
        }
    };
    vec![python, module, numpy]
}

fn reason(answer: &Value) -> String {
    answer["error"].as_str().unwrap_or("it does not tell its version").to_owned()
}

/// The memory of the object store: without a name, and closed to writers other than its owner.
fn sealed_memory() -> rustix::io::Result<()> {
    let memory = memfd_create("hprm-doctor", MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING)?;
    ftruncate(&memory, 4096)?;
    fcntl_add_seals(&memory, SealFlags::SHRINK | SealFlags::GROW | SealFlags::FUTURE_WRITE)
}

fn abstract_socket() -> std::io::Result<()> {
    let name = format!("hprm-doctor-{}", std::process::id());
    UnixListener::bind_addr(&SocketAddr::from_abstract_name(name)?).map(drop)
}

fn process_watch() -> rustix::io::Result<()> {
    pidfd_open(getpid(), PidfdFlags::empty()).map(drop)
}

fn processors() -> Finding {
    match std::thread::available_parallelism() {
        Ok(count) => Finding::good("processors", count.to_string()),
        Err(error) => {
            Finding::poor("processors", error.to_string(), "nothing can be said of speed")
        }
    }
}

fn descriptors() -> Finding {
    const FEW: u64 = 256;
    match getrlimit(Resource::Nofile).current {
        Some(limit) if limit < FEW => Finding::poor(
            "open files",
            format!("at most {limit} in a process"),
            "federations of many federates need more: ulimit -n 4096",
        ),
        Some(limit) => Finding::good("open files", format!("at most {limit} in a process")),
        None => Finding::good("open files", "no limit"),
    }
}

/// Arrays live in shared memory, which counts like any other.
fn memory() -> Finding {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let Some(available) = available_memory(&text) else {
        return Finding::poor("memory", "/proc/meminfo does not tell", "is /proc mounted?");
    };
    let text = format!("{} MB available", available / 1_000_000);
    match hprm::container_memory() {
        Some(limit) => Finding::good(
            "memory",
            format!("{text}, this container may use {} MB", limit / 1_000_000),
        ),
        None => Finding::good("memory", text),
    }
}

/// In bytes.
fn available_memory(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

/// Shared memory is a file to the system, and as large as a file may be.
fn file_size() -> Finding {
    match getrlimit(Resource::Fsize).current {
        Some(limit) => Finding::poor(
            "shared memory",
            format!("at most {} MB in one piece", limit / 1_000_000),
            "large arrays need more: ulimit -f unlimited",
        ),
        None => Finding::good("shared memory", "no limit to one piece"),
    }
}

fn pickles() -> Finding {
    let subject = "pickle";
    match Pickling::of(std::env::var_os(Pickling::NAME).as_deref()) {
        Ok(Pickling::Deny) => Finding::good(subject, "never, by HPRM_PICKLE=deny"),
        Ok(Pickling::Local) => Finding::good(subject, "only between federates on this machine"),
        Ok(Pickling::Allow) => Finding::poor(
            subject,
            "also from other machines, by HPRM_PICKLE=allow",
            "every member of a federation can run code in this user's name",
        ),
        Err(reason) => {
            Finding::bad(subject, reason, "see the handbook page concepts/serialization")
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn healths(answers: &Value) -> Vec<Health> {
        interpreted(answers).into_iter().map(|finding| finding.health).collect()
    }

    #[test]
    fn an_interpreter_is_judged_by_its_answers() {
        let good = json!({
            "executable": "/v/bin/python3", "version": [3, 11, 7], "hprm": VERSION, "numpy": "2.4.0",
        });
        assert_eq!(healths(&good), [Health::Good; 3]);
        assert_eq!(interpreted(&good)[0].text, "3.11.7 at /v/bin/python3");

        let missing = json!({ "error": "ModuleNotFoundError: No module named 'hprm'" });
        let bare = json!({ "version": [3, 9, 2], "hprm": missing, "numpy": missing });
        assert_eq!(healths(&bare), [Health::Bad, Health::Bad, Health::Poor]);
        assert_eq!(interpreted(&bare)[1].text, "ModuleNotFoundError: No module named 'hprm'");
    }

    #[test]
    fn another_release_of_the_module_is_bad() {
        let other = json!({ "version": [3, 12, 0], "hprm": "0.0.1", "numpy": "2.0" });
        assert_eq!(healths(&other), [Health::Good, Health::Bad, Health::Good]);
    }

    #[test]
    fn available_memory_is_read_in_bytes() {
        let text = "MemTotal:       100 kB\nMemAvailable:    3 kB\n";
        assert_eq!(available_memory(text), Some(3072));
        assert_eq!(available_memory("MemTotal: 100 kB\n"), None);
    }
}
