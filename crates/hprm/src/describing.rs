//! Asking executables what they declare, for programs that name them.
//!
//! An executable is started with the environment variable `HPRM_DESCRIBE`, which names a file: it writes its
//! declaration there, as the JSON that `hprm-declared` reads, and ends. `HPRM_PARAMETERS` names a file with the
//! parameters of the federate that it would be, if it has any, as JSON: a list of names and values.
//!
//! A launcher hands what it was told to the processes that it starts, by the environment variable
//! `HPRM_DESCRIPTIONS`, so that each executable is asked once for each set of parameters.

use std::collections::BTreeMap;
use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use hprm_declared::Described;
use hprm_model::{Compiled, Executable, Given};
use nix::sys::signal::{SigSet, Signal, kill, killpg};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use nix::unistd::Pid;

use crate::Failure;
use crate::answer::Answer;
use crate::console::reason;

/// The environment variable that asks an executable what it declares: the file that it writes.
pub(crate) const DESCRIBE: &str = "HPRM_DESCRIBE";

/// Where an executable that is asked what it declares finds its parameters.
const PARAMETERS: &str = "HPRM_PARAMETERS";

/// Where the processes of a program find what its executables have declared.
pub const DESCRIPTIONS: &str = "HPRM_DESCRIPTIONS";

/// For how long an executable may declare itself. It opens nothing meanwhile.
const PATIENCE: Duration = Duration::from_secs(10);

/// How often to look whether it has ended.
const GLANCE: Duration = Duration::from_millis(2);

/// What to do about an executable that does not declare itself.
const HINT: &str = "asked by HPRM_DESCRIBE=FILE, an executable writes what it declares into that file and exits with \
                    0; in Rust, `hprm::run_as_federate` does that";

/// What an executable declares.
///
/// # Errors
///
/// Why that is not known; a second line says what to do.
pub(crate) fn describe(executable: &Executable) -> Result<Described, String> {
    let command = find(executable)?;
    let text = declaration_of(&command, &executable.given())?;
    Ok(Described { command, text })
}

/// What an executable declares that has these parameters: its absolute path, and its arguments.
///
/// # Errors
///
/// Why that is not known; a second line says what to do.
pub fn declaration_of(
    command: &[String],
    parameters: &[(String, Given)],
) -> Result<String, String> {
    let key = key(command, parameters);
    let known = handed(&key).or_else(|| answered(&key, command));
    known.map_or_else(|| ask_and_remember(key, command, parameters), Ok)
}

/// The names and the values of the parameters of an executable.
type Parameters = [(String, Given)];

/// The parameters with which this process is asked what it declares.
///
/// # Errors
///
/// If they cannot be read.
pub(crate) fn given() -> Result<Vec<(String, Given)>, Failure> {
    let file = std::env::var_os(PARAMETERS).filter(|_| std::env::var_os(DESCRIBE).is_some());
    let Some(file) = file else { return Ok(Vec::new()) };
    let text = std::fs::read(&file);
    let text = text.map_err(|error| Failure::system("the parameters cannot be read", &error))?;
    serde_json::from_slice(&text)
        .map_err(|error| Failure::option(format!("{PARAMETERS}: no parameters: {error}")))
}

/// What executables have answered in this process, and which file each was then.
static ANSWERS: Mutex<BTreeMap<String, (FileState, String)>> = Mutex::new(BTreeMap::new());

/// What changes when an executable is built again.
type FileState = (u64, u64, i64, i64, u64);

fn file_state(path: &str) -> Option<FileState> {
    let found = Path::new(path).metadata().ok()?;
    Some((found.dev(), found.ino(), found.mtime(), found.mtime_nsec(), found.size()))
}

/// What the same executable has answered before.
fn answered(key: &str, command: &[String]) -> Option<String> {
    let answers = ANSWERS.lock().unwrap_or_else(PoisonError::into_inner);
    let (state, text) = answers.get(key)?;
    (Some(*state) == file_state(command.first()?)).then(|| text.clone())
}

fn ask_and_remember(
    key: String,
    command: &[String],
    parameters: &Parameters,
) -> Result<String, String> {
    let state = command.first().and_then(|path| file_state(path));
    let text = ask(command, parameters, PATIENCE)?;
    if let Some(state) = state {
        let mut answers = ANSWERS.lock().unwrap_or_else(PoisonError::into_inner);
        answers.insert(key, (state, text.clone()));
    }
    Ok(text)
}

/// What the executables of a program have declared, for the processes that are started while this exists.
#[derive(Debug)]
pub struct Descriptions(Answer);

impl Descriptions {
    /// Those of a program; none if it has no executables.
    ///
    /// # Errors
    ///
    /// If the system has no memory for them.
    pub fn of(compiled: &Compiled) -> io::Result<Option<Self>> {
        if compiled.executables.is_empty() {
            return Ok(None);
        }
        let known = compiled.executables.values();
        let known = known.map(|it| (key(&it.command, &it.parameters), it.declaration.as_str()));
        Self::with(&known.collect()).map(Some)
    }

    /// All that this process knows.
    ///
    /// # Errors
    ///
    /// If the system has no memory for them.
    pub fn known() -> io::Result<Self> {
        let answers = ANSWERS.lock().unwrap_or_else(PoisonError::into_inner);
        let answers = answers.iter().map(|(key, (_, text))| (key.clone(), text.as_str()));
        let handed = HANDED.get().into_iter().flatten();
        Self::with(&handed.map(|(key, text)| (key.clone(), text.as_str())).chain(answers).collect())
    }

    fn with(known: &BTreeMap<String, &str>) -> io::Result<Self> {
        Answer::with(&serde_json::to_vec(known).map_err(io::Error::other)?).map(Self)
    }

    /// Lets a process that this one starts have them.
    pub fn hand_to(&self, command: &mut Command) {
        command.env(DESCRIPTIONS, self.0.path());
    }
}

/// What executables have declared to the launcher of this process; empty if there is none.
static HANDED: OnceLock<BTreeMap<String, String>> = OnceLock::new();

/// Reads what the launcher hands to this process, so that the environment variable can be removed: programs that this
/// process starts are none of the launcher's.
pub fn read_descriptions() {
    HANDED.get_or_init(|| {
        let text = std::env::var_os(DESCRIPTIONS).and_then(|file| std::fs::read(file).ok());
        text.and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default()
    });
}

/// What a launcher was told by the executable; none if there is no launcher.
fn handed(key: &str) -> Option<String> {
    read_descriptions();
    HANDED.get()?.get(key).cloned()
}

fn key(command: &[String], parameters: &Parameters) -> String {
    let command = command.join("\0");
    match parameters {
        [] => command,
        // Nothing in them cannot be written.
        given => format!("{command}\0\0{}", serde_json::to_string(given).unwrap_or_default()),
    }
}

/// The command of an executable, by which it is started from anywhere.
///
/// A path is relative to the file that names it. What is only a name is looked up beside that file, and then in the
/// folders of `PATH`.
fn find(executable: &Executable) -> Result<Vec<String>, String> {
    let Executable { command, file, .. } = executable;
    let (stated, arguments) = command.split_first().ok_or("there is no executable")?;
    let folder = Path::new(file).parent().unwrap_or(Path::new(""));
    let beside = folder.join(stated);
    let found = match stated.contains('/') {
        true => beside.clone(),
        false => beside_or_on_path(&beside, stated),
    };
    let absolute = std::path::absolute(&found)
        .map_err(|error| format!("the executable {stated} cannot be found: {error}"))?;
    let path = absolute.to_str().ok_or("the path of the executable is not UTF-8 text")?;
    is_executable(path, stated.contains('/'))?;
    Ok([path.to_owned()].into_iter().chain(arguments.iter().cloned()).collect())
}

fn beside_or_on_path(beside: &Path, name: &str) -> PathBuf {
    if beside.is_file() {
        return beside.to_owned();
    }
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let mut places = std::env::split_paths(&folders).map(|folder| folder.join(name));
    places.find(|place| is_executable_file(place)).unwrap_or_else(|| beside.to_owned())
}

fn is_executable_file(path: &Path) -> bool {
    path.metadata().is_ok_and(|found| found.is_file() && found.permissions().mode() & 0o111 != 0)
}

/// Sees to it that there is a file that can be executed, so that a wrong path is one plain error.
fn is_executable(path: &str, is_path: bool) -> Result<(), String> {
    let at = Path::new(path);
    match at.metadata() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Err(format!(
            "there is no executable {path}\n{}",
            match is_path {
                true => "the path is relative to the file that names it; has it been built?",
                false =>
                    "a name without a slash is looked up beside the file that names it, then on PATH",
            }
        )),
        Err(error) => Err(format!("the executable {path} cannot be read: {}", reason(&error))),
        Ok(found) if found.is_dir() => Err(format!("{path} is a folder, not an executable")),
        Ok(_) if is_executable_file(at) => Ok(()),
        Ok(_) => Err(format!("{path} is not executable\nchmod +x makes a script executable")),
    }
}

/// Has an executable declare itself.
///
/// # Errors
///
/// Why it has not; a second line says what to do.
pub(crate) fn ask(
    command: &[String],
    parameters: &Parameters,
    patience: Duration,
) -> Result<String, String> {
    let path = &command[0];
    let unable = |error: io::Error| format!("the executable {path} cannot run: {}", reason(&error));
    let mut answer = Answer::new().map_err(unable)?;
    let stderr = io::stderr().as_fd().try_clone_to_owned().map_err(unable)?;
    let mut process = Command::new(path);
    process.args(&command[1..]).env(DESCRIBE, answer.path()).env_remove(DESCRIPTIONS);
    let given = serde_json::to_vec(parameters).map_err(|error| unable(error.into()))?;
    let given = Answer::with(&given).map_err(unable)?;
    process.env(PARAMETERS, given.path());
    // A group of its own, so that nothing of it is left if it takes too long.
    process.stdin(Stdio::null()).stdout(stderr).process_group(0);
    let status = run(process, patience).map_err(unable)?;
    let Some(status) = status else {
        let seconds = patience.as_secs_f64();
        return Err(format!(
            "the executable {path} does not say within {seconds} s what it declares\n{HINT}"
        ));
    };
    let read = answer.read();
    let text = read
        .map_err(|error| format!("the declaration of the executable {path}: {}", reason(&error)))?;
    let how = match (status.success(), status.code(), status.signal()) {
        (true, ..) if text.is_empty() => "has ended without saying what it declares".to_owned(),
        (true, ..) => return Ok(text),
        (false, Some(code), _) => {
            format!("has exited with {code} when it was asked what it declares")
        }
        (false, None, signal) => format!(
            "was killed by signal {} when it was asked what it declares",
            signal.unwrap_or_default()
        ),
    };
    Err(format!("the executable {path} {how}\n{HINT}"))
}

/// Runs a process to its end; if it takes too long, it is killed, and there is no status. A signal that asks this
/// process to stop kills that one first.
fn run(mut command: Command, patience: Duration) -> io::Result<Option<ExitStatus>> {
    let mut asking = SigSet::empty();
    for signal in [Signal::SIGHUP, Signal::SIGINT, Signal::SIGTERM] {
        asking.add(signal);
    }
    let mut process = command.spawn()?;
    // Only now, because a process inherits what is blocked.
    let before = asking.thread_swap_mask(nix::sys::signal::SigmaskHow::SIG_BLOCK)?;
    let ended = wait(&mut process, patience, &asking);
    if !matches!(ended, Ok(Waited::Ended(_))) {
        if let Ok(group) = i32::try_from(process.id()) {
            // It may be about to end.
            let _ = killpg(Pid::from_raw(group), Signal::SIGKILL);
        }
        let _ = process.wait();
    }
    before.thread_set_mask()?;
    match ended? {
        Waited::Ended(status) => Ok(Some(status)),
        Waited::TooLong => Ok(None),
        Waited::Asked(signal) => {
            // What the signal does here, it does now.
            kill(Pid::this(), signal)?;
            Err(io::ErrorKind::Interrupted.into())
        }
    }
}

enum Waited {
    Ended(ExitStatus),
    TooLong,
    Asked(Signal),
}

fn wait(process: &mut Child, patience: Duration, asking: &SigSet) -> io::Result<Waited> {
    let signals = SignalFd::with_flags(asking, SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC)?;
    let deadline = Instant::now() + patience;
    loop {
        if let Some(status) = process.try_wait()? {
            return Ok(Waited::Ended(status));
        }
        if let Some(came) = signals.read_signal()? {
            let number = i32::try_from(came.ssi_signo).unwrap_or_default();
            return Ok(Waited::Asked(Signal::try_from(number)?));
        }
        if Instant::now() >= deadline {
            return Ok(Waited::TooLong);
        }
        thread::sleep(GLANCE);
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use hprm_model::{FileId, Library, Report, Span};

    use super::*;

    /// A script in a folder of its own.
    fn script(text: &str) -> (tempfile::TempDir, Vec<String>) {
        let folder = tempfile::tempdir().unwrap();
        let [path, source] = ["camera", "source"].map(|name| folder.path().join(name));
        fs::write(&source, format!("#!/bin/sh\n{text}\n")).unwrap();
        // Another process writes what is executed: this one's descriptor could be inherited by a process that another
        // test starts in that moment, and the system executes no file that is open for writing.
        let install = Command::new("install").args(["-m", "755"]).args([&source, &path]).status();
        assert!(install.unwrap().success());
        let command = vec![path.to_str().unwrap().to_owned(), "one two".to_owned()];
        (folder, command)
    }

    fn asked(text: &str) -> Result<String, String> {
        let (folder, command) = script(text);
        let answer = ask(&command, &[], Duration::from_secs(30));
        answer.map_err(|why| why.replace(folder.path().to_str().unwrap(), ""))
    }

    fn first_line(answer: Result<String, String>) -> String {
        answer.unwrap_err().lines().next().unwrap().to_owned()
    }

    #[test]
    fn an_executable_writes_what_it_declares_into_the_file_that_it_is_told() {
        assert_eq!(asked(r#"printf %s "$1: {}" > "$HPRM_DESCRIBE""#).unwrap(), "one two: {}");
        // It reads nothing, and what it prints is no declaration.
        assert_eq!(asked(r#"cat; echo noise; echo '{}' > "$HPRM_DESCRIBE""#).unwrap(), "{}\n");
    }

    #[test]
    fn an_executable_is_given_its_parameters_in_a_file() {
        let (_folder, command) = script(r#"cat "$HPRM_PARAMETERS" > "$HPRM_DESCRIBE""#);
        let rate = [("rate".to_owned(), Given::Integer(20))];
        assert_eq!(ask(&command, &rate, Duration::from_secs(30)).unwrap(), r#"[["rate",20]]"#);
        // Of each set of parameters the answer is remembered.
        assert_eq!(declaration_of(&command, &rate).unwrap(), r#"[["rate",20]]"#);
        assert_eq!(declaration_of(&command, &[]).unwrap(), "[]");
    }

    #[test]
    fn an_executable_that_declares_nothing_is_one_error_that_says_what_it_has_to_do() {
        let silent = asked("exit 0").unwrap_err();
        assert_eq!(
            silent.lines().collect::<Vec<_>>(),
            ["the executable /camera has ended without saying what it declares", HINT]
        );
        assert_eq!(
            first_line(asked("echo '{}' > \"$HPRM_DESCRIBE\"; exit 3")),
            "the executable /camera has exited with 3 when it was asked what it declares"
        );
        assert_eq!(
            first_line(asked("kill -9 $$")),
            "the executable /camera was killed by signal 9 when it was asked what it declares"
        );
    }

    #[test]
    fn an_executable_that_hangs_is_killed_with_what_it_has_started() {
        let (folder, command) = script("sleep 1000 & echo $! > \"$0.pid\"; wait");
        let pid = folder.path().join("camera.pid");
        let answer = ask(&command, &[], Duration::from_secs(1));
        assert!(answer.unwrap_err().contains("does not say within 1 s"));
        let child = fs::read_to_string(pid).unwrap();
        let status = format!("/proc/{}/stat", child.trim());
        // It may not have been reaped yet.
        let is_over = || fs::read_to_string(&status).map_or(true, |text| text.contains(") Z"));
        while !is_over() {
            thread::yield_now();
        }
    }

    fn executable(stated: &str, file: &str) -> Executable {
        let mut report = Report::default();
        let mut library = Library::new("Main.lf", String::new());
        let span = Span::new(FileId::MAIN, 0..0);
        let kind = hprm_model::declaration::ReactorKind::Plain;
        let node = hprm_model::declaration::ReactorNode::new(kind, None, span);
        let class = library.add_reactor(FileId::MAIN, node, &mut report);
        let (command, file) = (vec![stated.to_owned()], file.to_owned());
        Executable { class, command, file, span, parameters: Vec::new(), instance: None }
    }

    #[test]
    fn a_path_is_relative_to_its_file_and_a_name_is_beside_it_or_on_the_path() {
        let (folder, command) = script("exit 0");
        let file = folder.path().join("Main.lf");
        let file = file.to_str().unwrap();
        let name = folder.path().file_name().unwrap().to_str().unwrap();
        let found = |stated: &str| find(&executable(stated, file));
        assert_eq!(found("camera").unwrap(), command[..1]);
        assert_eq!(found("./camera").unwrap(), command[..1]);
        assert!(found(&format!("../{name}/camera")).is_ok());
        assert_eq!(found(&command[0]).unwrap(), command[..1]);
        assert!(found("sh").unwrap()[0].ends_with("/sh"));
        assert!(found("./sh").is_err());
    }

    #[test]
    fn a_file_that_cannot_be_executed_is_one_plain_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("Main.lf");
        fs::write(folder.path().join("notes"), "").unwrap();
        let why = |stated: &str| {
            let why = find(&executable(stated, file.to_str().unwrap())).unwrap_err();
            why.replace(folder.path().to_str().unwrap(), "")
        };
        assert_eq!(
            why("./missing"),
            "there is no executable /missing\nthe path is relative to the file that names it; has it been built?"
        );
        assert_eq!(
            why("missing"),
            "there is no executable /missing\na name without a slash is looked up beside the file that names it, then \
             on PATH"
        );
        assert_eq!(why("./notes"), "/notes is not executable\nchmod +x makes a script executable");
        assert_eq!(why("./"), "/ is a folder, not an executable");
        let (_folder, command) = script("");
        fs::write(&command[0], "\x7fELF").unwrap();
        assert!(
            ask(&command, &[], PATIENCE).unwrap_err().contains("cannot run: Exec format error")
        );
    }
}
