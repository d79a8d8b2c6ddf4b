//! How a process learns that its run is traced, and where its share goes.
//!
//! A launcher says it in the environment of the processes that it starts, and a command in that of the process that
//! it becomes. Processes that those start inherit the environment, so it names the process that has set it.

use std::env;
use std::ffi::OsString;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use hprm_core::Program;

use super::collector::Recording;
use super::lanes::{DEFAULT_CAPACITY, Lanes};
use super::names::{Member, Names};
use super::share::{ShareWriter, file_of};
use super::shares::Shares;
use super::{Recorder, Tracepoints};
use crate::workers;
use crate::{Failure, Host, Label, Report};

/// The environment variable.
pub const TRACE: &str = "HPRM_TRACE";

/// What is to be traced into which file.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct TraceRequest {
    /// The trace of a process that makes it alone, or the folder of the shares, to which it adds one.
    pub path: PathBuf,
    /// How many records wait for each thread at most.
    pub capacity: usize,
    /// Whether the process only writes a share.
    pub is_share: bool,
}

impl TraceRequest {
    /// A request for a trace of its own.
    #[must_use]
    pub fn file(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), capacity: DEFAULT_CAPACITY, is_share: false }
    }

    /// What the environment of a process must have, as `TRACE=…`. A share is asked of a process that this one starts,
    /// a trace of a program that replaces this one.
    #[must_use]
    pub fn variable(&self) -> OsString {
        let kind = if self.is_share { "share" } else { "file" };
        let mut text = format!("{}:{kind}:{}:", std::process::id(), self.capacity).into_bytes();
        text.extend(self.path.as_os_str().as_bytes());
        OsString::from_vec(text)
    }

    /// What this process is asked for.
    #[must_use]
    pub fn of_this_process() -> Option<Self> {
        let given = env::var_os(TRACE)?;
        let mut parts = given.as_bytes().splitn(4, |byte| *byte == b':');
        let mut word = || parts.next().and_then(|part| std::str::from_utf8(part).ok());
        let process: u32 = word()?.parse().ok()?;
        let is_share = word()? == "share";
        let capacity = word()?.parse().ok()?;
        let path = PathBuf::from(OsString::from_vec(parts.next()?.to_vec()));
        let is_meant = match is_share {
            true => {
                let parent = rustix::process::getppid();
                parent.is_some_and(|it| it.as_raw_nonzero().get().cast_unsigned() == process)
            }
            false => std::process::id() == process,
        };
        is_meant.then_some(Self { path, capacity, is_share })
    }
}

/// The recordings of this process.
static OPEN: Mutex<Vec<Weak<Inner>>> = Mutex::new(Vec::new());

/// What records a loop, from before its start to its end.
#[derive(Clone, Debug, Default)]
pub(crate) struct LoopRecording(Option<Arc<Inner>>);

#[derive(Debug)]
struct Inner {
    recording: Recording,
    /// The trace, as the user calls it, and what is still to be made of the shares.
    path: PathBuf,
    shares: Mutex<Option<Shares>>,
}

impl LoopRecording {
    /// Starts the recording of a member of a federation, or of a whole program, if it is wanted.
    pub(crate) fn start(
        request: Option<&TraceRequest>,
        program: &Program,
        member: Member,
    ) -> Result<Self, Failure> {
        let Some(request) = request else { return Ok(Self::default()) };
        let threads = workers::count(program);
        let shares = if request.is_share {
            None
        } else {
            Some(Shares::of(&request.path)?.with_capacity(request.capacity))
        };
        let folder = shares.as_ref().map_or(request.path.as_path(), Shares::folder);
        let names = Names::of(program, member);
        let recording = open(folder, &names, threads, request.capacity)
            .map_err(|error| Failure::trace(&request.path, &error))?;
        let inner = Inner { recording, path: request.path.clone(), shares: Mutex::new(shares) };
        let inner = Arc::new(inner);
        let mut others = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        others.retain(|inner| inner.strong_count() > 0);
        others.push(Arc::downgrade(&inner));
        drop(others);
        Ok(Self(Some(inner)))
    }

    pub(crate) fn recorder(&self) -> Recorder {
        self.0.as_ref().map_or_else(Recorder::default, |inner| inner.recording.recorder())
    }

    pub(crate) fn tracepoints(&self) -> Tracepoints {
        self.0.as_ref().map_or_else(Tracepoints::default, |inner| inner.recording.tracepoints())
    }

    /// Ends the recording of a loop that has ended with `outcome`, which counts more than what is wrong with the
    /// trace.
    pub(crate) fn end<H: Host>(
        &self,
        host: &mut H,
        outcome: Result<(), Failure>,
    ) -> Result<(), Failure> {
        match self.finish() {
            Ok(None) => outcome,
            Ok(Some(report)) => {
                let hint = report.hint.iter().map(|hint| format!("\n  hint: {hint}"));
                host.warn(&format!("{}{}", report.message, hint.collect::<String>()));
                outcome
            }
            Err(failure) => outcome.and(Err(failure)),
        }
    }

    /// Ends the recording, and makes the trace if this process makes it alone. Returns what the user should know of
    /// it.
    pub(crate) fn finish(&self) -> Result<Option<Report>, Failure> {
        self.0.as_ref().map_or(Ok(None), |inner| inner.finish())
    }
}

impl Inner {
    fn finish(&self) -> Result<Option<Report>, Failure> {
        let collected = self.recording.finish();
        collected.map_err(|error| Failure::trace(&self.path, &error))?;
        let shares = self.shares.lock().unwrap_or_else(PoisonError::into_inner).take();
        shares.map_or(Ok(None), Shares::merge)
    }
}

/// Starts a recording whose share is in `folder`.
fn open(
    folder: &Path,
    names: &Names,
    threads: usize,
    capacity: usize,
) -> std::io::Result<Recording> {
    let writer = ShareWriter::create(&folder.join(file_of(names.member)), names)?;
    let lanes = Arc::new(Lanes::new(threads, capacity));
    Recording::start(lanes, vec![Box::new(writer)])
}

/// Ends all recordings of this process, because it is about to be ended by force while reactions run.
pub fn cut_recordings() {
    let open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
    for inner in open.iter().filter_map(Weak::upgrade) {
        match inner.finish() {
            Ok(None) => {}
            Ok(Some(report)) => crate::console::show(Label::Warning, &report),
            Err(failure) => crate::console::show(Label::Warning, &failure.report()),
        }
    }
}
