//! The process on this machine that stands for a federate on another one.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use hprm::agent::{self, Place, STARTERS};
use hprm::launch::{Membership, die_with_parent};
use hprm::{FederationId, Kind, Report, printable_lines};
use hprm_model::Compiled;
use rustix::fs::{MemfdFlags, memfd_create};
use rustix::process::{Resource, Rlimit, Signal, setrlimit};
use serde::{Deserialize, Serialize};

use super::Places;
use super::key::{self, Occasion, Side};
use super::notes::{self, Note, Why};
use super::program::{self, Files};
use super::protocol::{self, Asked, CHUNK, Ended, Manifest, Told};
use super::recording::Writing;
use crate::launch::Plan;
use crate::message::{self, Error, print_error};
use crate::{declare, signals};

/// How long a machine may take to be reached, with pauses between two attempts from the first to the last of these, and to
/// answer before the federate runs.
const CONNECTING: Duration = Duration::from_secs(20);
const PAUSES: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(1));
const ANSWERING: Duration = Duration::from_secs(60);

/// What a launcher has a stand-in do. It travels as the standard input of that process, where no other user reads it.
#[derive(Serialize, Deserialize)]
struct Errand {
    launcher: i32,
    /// The number of the federate in the program.
    number: u16,
    machine: String,
    key: PathBuf,
    manifest: Manifest,
    /// Where the files of the manifest lie here.
    paths: Vec<PathBuf>,
    /// Where the share of the logical trace is to be.
    share: Option<PathBuf>,
}

/// What a launcher knows that starts stand-ins.
pub(crate) struct Errands {
    files: Files,
    rti: String,
    /// Where stand-ins write why a federate has ended, by the names of federates.
    notes: RefCell<BTreeMap<String, Note>>,
}

impl Errands {
    /// For a program, and an RTI that other machines reach at `rti`.
    ///
    /// # Errors
    ///
    /// If a file of the program cannot be read.
    pub(crate) fn new(compiled: &Compiled, file: &Path, rti: String) -> Result<Self, Error> {
        let notes = RefCell::default();
        Ok(Self { files: program::files(compiled, file)?, rti, notes })
    }

    /// The command of the stand-in of a federate.
    ///
    /// # Errors
    ///
    /// If it cannot be told what to do.
    pub(crate) fn command(
        &self,
        (plan, places): (&Plan, &Places),
        (membership, machine): (&Membership<'_>, &str),
        federation: FederationId,
    ) -> Result<Command, Error> {
        let arguments = plan.arguments.iter().map(|argument| argument.to_str().map(str::to_owned));
        let arguments: Option<Vec<_>> = arguments.collect();
        let share = membership.share.as_ref();
        let manifest = Manifest {
            main: self.files.main.clone(),
            reactor: declare::reactor_of(&plan.file).map(str::to_owned),
            federate: membership.name.to_owned(),
            rti: self.rti.clone(),
            federation: federation.to_string(),
            properties: plan.properties.stated(),
            arguments: arguments.ok_or_else(|| {
                Error::option("arguments of a program on another machine have to be UTF-8 text")
            })?,
            trace: share.map(|share| share.trace.display().to_string()),
            record: None,
            files: self.files.listed.clone(),
        };
        let errand = Errand {
            launcher: i32::try_from(std::process::id()).unwrap_or_default(),
            number: membership.federate.0,
            machine: machine.to_owned(),
            key: places.key().to_owned(),
            manifest,
            paths: self.files.paths.clone(),
            share: share.map(|share| share.file.clone()),
        };
        let unable = |error: io::Error| {
            Error::new(format!("cannot start federate {} on {machine}: {error}", membership.name))
        };
        let this = std::env::current_exe().map_err(unable)?;
        let file = errand.file().map_err(unable)?;
        let note = Note::behind(&file).map_err(unable)?;
        self.notes.borrow_mut().insert(membership.name.to_owned(), note);
        let mut command = Command::new(this);
        command.arg("stand-in").stdin(Stdio::from(file));
        Ok(command)
    }

    /// What is told of a federate that has ended, and why if its stand-in knows more than that.
    pub(crate) fn explained(&self, report: Report) -> Report {
        let notes = self.notes.borrow();
        let note = report.federate.as_ref().and_then(|federate| notes.get(federate)?.read());
        match note {
            Some(note) if report.kind == Kind::Killed => note.explain(report),
            _ => report,
        }
    }
}

impl Errand {
    fn file(&self) -> io::Result<File> {
        let mut file = File::from(memfd_create("hprm-errand", MemfdFlags::CLOEXEC)?);
        file.write_all(&postcard::to_allocvec(self).map_err(io::Error::other)?)?;
        io::Seek::rewind(&mut file)?;
        Ok(file)
    }

    fn read() -> Result<Self, Error> {
        let mut text = Vec::new();
        let read = io::stdin().lock().read_to_end(&mut text);
        let errand = read.ok().and_then(|_| postcard::from_bytes(&text).ok());
        errand.ok_or_else(|| {
            Error::option("`hprm run` starts stand-ins, for federates that run on other machines")
        })
    }
}

/// Stands for a federate, as the launcher says.
///
/// # Errors
///
/// If the federate cannot be started, or the link to its machine ends before it does.
pub(crate) fn stand_in() -> Result<ExitCode, Error> {
    let errand = Errand::read()?;
    let failed = |error: io::Error| Error::new(format!("cannot stand for a federate: {error}"));
    if !die_with_parent(errand.launcher).map_err(failed)? {
        return Ok(ExitCode::FAILURE);
    }
    let forward = Arc::new(Mutex::new(Forward::default()));
    let forwarded = Arc::clone(&forward);
    signals::watch(move |signal| {
        locked(&forwarded).take(signal.0);
        true
    })
    .map_err(failed)?;
    let stream = admitted(&errand.machine, &errand.key)?;
    let federate = (errand.number, &*errand.manifest.federate);
    let mut writing = Writing::wanted(federate, &errand.machine);
    let followed = errand.follow(&stream, &forward, writing.as_mut());
    let is_cut = matches!(followed, Err(Lost::Link(_)));
    writing.iter_mut().for_each(|writing| writing.end(!is_cut));
    match followed {
        Ok(ended) => {
            if let Ended::Memory(bytes) = ended {
                errand.on_memory(bytes).leave().map_err(failed)?;
            }
            Ok(end(ended))
        }
        // The launcher tells that the federate has ended, and this is why.
        Err(Lost::Link(error)) => {
            errand.lost(&error).show_as_warning();
            Ok(ExitCode::FAILURE)
        }
        Err(Lost::Told(error)) => Err(error),
    }
}

/// Whether the agent of a machine starts programs for users with a key, before anything is started.
///
/// # Errors
///
/// Why not.
pub(super) fn probe(machine: &str, key: &Path) -> Result<(), Error> {
    admitted(machine, key).map(drop)
}

/// A link to a starter that knows the key. Nothing has been started before there is one, so what may be an accident is
/// tried again: agents connect again when the roster changes, and drop what they have no room for.
fn admitted(machine: &str, key: &Path) -> Result<UnixStream, Error> {
    let (until, mut pause) = (Instant::now() + CONNECTING, PAUSES.0);
    loop {
        let left = until.saturating_duration_since(Instant::now());
        let proved = connect(machine, left).map_err(Lost::Link);
        let proved = proved.and_then(|stream| prove(&stream, machine, key).map(|()| stream));
        match proved {
            Ok(stream) => return Ok(stream),
            Err(Lost::Told(error)) => return Err(error),
            Err(Lost::Link(error)) if is_final(&error) || left <= pause => {
                let why = message::reason(&error);
                return Err(Error::new(format!("no program can be started on {machine}: {why}")));
            }
            Err(Lost::Link(_)) => thread::sleep(pause),
        }
        pause = (2 * pause).min(PAUSES.1);
    }
}

/// Whether an error will be the same again: an agent refuses, for a reason.
fn is_final(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::PermissionDenied)
}

/// Asks the agent of this machine for a link to a starter.
fn connect(machine: &str, within: Duration) -> io::Result<UnixStream> {
    let place = Place { machine: machine.to_owned(), name: STARTERS.to_owned() };
    let stream = agent::connect(&place, within)?;
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(ANSWERING))?;
    Ok(stream)
}

/// Shows the starter that this process may have something started, and has the starter show the same.
fn prove(stream: &UnixStream, machine: &str, key: &Path) -> Result<(), Lost> {
    let keys = key::read(key)?;
    let key = &keys[0];
    let Told::Challenge { version: protocol::VERSION, nonce: theirs } = next(stream)? else {
        let error = Error::new(format!("{machine} has another version of HPRM than this machine"));
        return Err(Lost::Told(error.hint("install the same version on both")));
    };
    let mine = key::nonce()?;
    let occasion = Occasion { machine, nonces: [theirs, mine] };
    let proof = key.prove(Side::StandIn, &occasion);
    protocol::write(stream, &Asked::Proof { nonce: mine, proof })?;
    match next(stream)? {
        Told::Proved(proof) if key.is_proved(Side::Starter, &occasion, &proof) => Ok(()),
        _ => Err(told(format!("{machine} does not prove that it has the fleet key"))),
    }
}

impl Errand {
    /// Has the federate started, and does as it does.
    fn follow(
        &self,
        stream: &UnixStream,
        forward: &Mutex<Forward>,
        mut writing: Option<&mut Writing>,
    ) -> Result<Ended, Lost> {
        if let Some(writing) = &mut writing {
            writing.begin(|asked| ask_for_time(stream, asked))?;
        }
        let record = writing.as_ref().map(|writing| writing.capacity());
        let manifest = Manifest { record, ..self.manifest.clone() };
        protocol::write(stream, &Asked::Program(Box::new(manifest)))?;
        let mut share = None;
        loop {
            match next(stream)? {
                Told::Missing(places) => self.send(stream, &places)?,
                Told::Started => {
                    stream.set_read_timeout(None)?;
                    locked(forward).begin(stream.try_clone()?);
                }
                Told::Recorded(bytes) => writing.iter_mut().for_each(|it| it.take(&bytes)),
                Told::Clock { asked, shown } => {
                    writing.iter_mut().for_each(|it| it.answered(asked, shown));
                }
                Told::Output { is_error: true, bytes } => print_error(&bytes),
                Told::Output { is_error: false, bytes } => {
                    // Without a reader, the launcher ends all of it.
                    let _ = message::print(&bytes);
                }
                Told::Trace(bytes) => self.keep_trace(&mut share, &bytes)?,
                Told::Ended(ended) => {
                    // The starter reads nothing more.
                    let _ = stream.shutdown(Shutdown::Both);
                    return Ok(ended);
                }
                _ => return Err(told(format!("{} says what is not expected", self.machine))),
            }
            if let Some(asked) = writing.as_mut().and_then(|writing| writing.question()) {
                locked(forward).say(&Asked::Clock(asked));
            }
        }
    }

    /// Sends files, one after the other. One that has changed since it was listed is refused by the starter.
    fn send(&self, stream: &UnixStream, places: &[u32]) -> Result<(), Lost> {
        for place in places {
            let place = *place as usize;
            let known = self.paths.get(place).zip(self.manifest.files.get(place));
            let Some((path, listed)) = known else {
                return Err(told(format!("{} asks for a file that is not listed", self.machine)));
            };
            let failed = |why: String| told(format!("cannot send {}: {why}", path.display()));
            let file = File::open(path).map_err(|error| failed(message::reason(&error)))?;
            let (mut file, mut left) = (file.take(listed.len), listed.len);
            while left > 0 {
                let mut bytes = Vec::new();
                let chunk = file.by_ref().take(CHUNK as u64).read_to_end(&mut bytes);
                let count = chunk.map_err(|error| failed(message::reason(&error)))? as u64;
                if count == 0 {
                    return Err(failed("it has become shorter".to_owned()));
                }
                left -= count;
                protocol::write(stream, &Asked::Bytes(bytes))?;
            }
        }
        Ok(())
    }

    fn keep_trace(&self, share: &mut Option<File>, bytes: &[u8]) -> Result<(), Lost> {
        let Some(path) = &self.share else { return Ok(()) };
        let kept = match share {
            Some(file) => file.write_all(bytes),
            None => File::create(path).and_then(|file| share.insert(file).write_all(bytes)),
        };
        kept.map_err(|error| {
            told(format!("cannot write {}: {}", path.display(), message::reason(&error)))
        })
    }

    fn on_memory(&self, bytes: u64) -> Why {
        let Self { machine, manifest, .. } = self;
        let (federate, memory) = (&manifest.federate, notes::size(bytes));
        Why {
            message: format!(
                "federate {federate} was ended on {machine}, as all of its processes together needed more than {memory} of memory"
            ),
            hint: format!(
                "let it have more, by --program-memory of the agent of {machine}; or give it less to do"
            ),
        }
    }

    fn lost(&self, error: &io::Error) -> Error {
        let Self { machine, manifest, .. } = self;
        let federate = &manifest.federate;
        let why = match error.kind() {
            io::ErrorKind::UnexpectedEof => "it has ended".to_owned(),
            io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => "nothing comes".to_owned(),
            _ => message::reason(error),
        };
        Error::new(format!("the link to federate {federate} on {machine}: {why}"))
            .hint(format!("what the agent of {machine} writes says more"))
    }
}

fn told(text: String) -> Lost {
    Lost::Told(Error::new(text))
}

/// What the clock of the other machine shows, before anything is started there.
fn ask_for_time(stream: &UnixStream, asked: i64) -> Result<i64, Lost> {
    protocol::write(stream, &Asked::Clock(asked))?;
    match next(stream)? {
        Told::Clock { shown, .. } => Ok(shown),
        _ => Err(told("the other machine does not tell the time".to_owned())),
    }
}

/// What the starter says next.
fn next(stream: &UnixStream) -> Result<Told, Lost> {
    match protocol::read(stream)? {
        None => Err(Lost::Link(io::ErrorKind::UnexpectedEof.into())),
        Some(Told::Failed { message, hint }) => {
            // The other machine may say anything.
            let error = Error::new(printable_lines(&message));
            Err(Lost::Told(match hint {
                Some(hint) => error.hint(printable_lines(&hint)),
                None => error,
            }))
        }
        Some(told) => Ok(told),
    }
}

/// Ends as the federate has.
fn end(ended: Ended) -> ExitCode {
    match ended {
        Ended::Code(code) => u8::try_from(code).map_or(ExitCode::FAILURE, ExitCode::from),
        Ended::Memory(_) => end(Ended::Signal(Signal::KILL.as_raw())),
        Ended::Signal(signal) => {
            let none = Rlimit { current: Some(0), maximum: Some(0) };
            // What it has left in its memory is of no interest; this ends the process.
            let _ = setrlimit(Resource::Core, none);
            let _ = signal_hook::low_level::emulate_default_handler(signal);
            ExitCode::FAILURE
        }
    }
}

/// Where signals go, and all else that is said while the federate runs.
#[derive(Default)]
struct Forward {
    /// Once the federate runs.
    stream: Option<UnixStream>,
    /// Those that came before.
    early: Vec<i32>,
}

impl Forward {
    fn take(&mut self, signal: i32) {
        match &self.stream {
            Some(_) => self.say(&Asked::Signal(signal)),
            None => self.early.push(signal),
        }
    }

    /// Says something once the federate runs, apart from all else that is said.
    fn say(&self, asked: &Asked) {
        // Without a link, the process is about to end.
        let _ = self.stream.as_ref().map(|stream| protocol::write(stream, asked));
    }

    fn begin(&mut self, stream: UnixStream) {
        self.stream = Some(stream);
        for signal in std::mem::take(&mut self.early) {
            self.take(signal);
        }
    }
}

fn locked(forward: &Mutex<Forward>) -> MutexGuard<'_, Forward> {
    forward.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Why a stand-in cannot go on.
enum Lost {
    /// What the starter, or this process, says.
    Told(Error),
    Link(io::Error),
}

impl From<io::Error> for Lost {
    fn from(error: io::Error) -> Self {
        Self::Link(error)
    }
}

impl From<Error> for Lost {
    fn from(error: Error) -> Self {
        Self::Told(error)
    }
}
