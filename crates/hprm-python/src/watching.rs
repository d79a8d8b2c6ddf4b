//! Watching a running federation: what `hprm.watch` returns, and the messages that it gives.
//!
//! Which messages there are is decided in `hprm::watch`; here values become objects, when they are asked for. What is
//! wrong is raised as `hprm.WatchError`.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread;
use std::time::Duration;

use hprm::watch::{
    Arrived, ArrivedPart, Next, Search, Shown, Sight, Sights, Unseen, WatchError, Wish, Words,
};
use hprm::{Kind, Pickling, Report};
use hprm_core::copy_of;
use pyo3::exceptions::PyMemoryError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyBytes;

use crate::buffer::ReceivedPart;
use crate::serialize::{self, Trust};
use crate::tag::Tag;

/// How long a wait goes on before Python looks for signals, which may have come to another thread.
const PATIENCE: Duration = Duration::from_millis(100);

/// What federates send, from now on: an iterator over messages, which ends when the federates have ended.
#[pyclass(frozen, module = "hprm._hprm")]
pub(crate) struct Watch {
    /// None once it is closed.
    seen: Mutex<Option<Seen>>,
    /// Whether it is being closed: a thread that waits lets another one have the lock then.
    is_closed: AtomicBool,
    pickles: bool,
}

/// What is watched, and what came last.
struct Seen {
    sights: Sights,
    last: Weak<Mutex<Content>>,
}

/// What a wait has brought.
enum Came {
    Message(Box<WatchedMessage>),
    Nothing,
    End,
}

/// Why a search ends before its time.
enum Stopped {
    Report(Box<Report>),
    Raised(PyErr),
}

impl From<Report> for Stopped {
    fn from(report: Report) -> Self {
        Self::Report(Box::new(report))
    }
}

impl From<PyErr> for Stopped {
    fn from(error: PyErr) -> Self {
        Self::Raised(error)
    }
}

/// Watches ports of a running federation, or all connections between its federates if there are none. Waits so many
/// nanoseconds until there is such a federation. Hints tell users of `options` of the command, or of arguments.
#[pyfunction]
#[pyo3(signature = (ports, federation, wait, pickles, *, options = false))]
pub(crate) fn watch_ports(
    py: Python<'_>,
    ports: Vec<String>,
    federation: Option<String>,
    wait: u64,
    pickles: bool,
    options: bool,
) -> PyResult<Watch> {
    let words = if options { Words::Options } else { Words::Arguments };
    let search = Search { federation, ports, wish: Wish::Values, words };
    let opened = py.detach(|| {
        search.open(Duration::from_nanos(wait), |pause| {
            thread::sleep(pause);
            Python::attach(|py| py.check_signals()).map_err(Stopped::Raised)
        })
    });
    match opened {
        Ok(opened) => {
            let seen = Seen { sights: Sights::new(opened), last: Weak::new() };
            Ok(Watch { seen: Mutex::new(Some(seen)), is_closed: AtomicBool::new(false), pickles })
        }
        Err(Stopped::Report(report)) => Err(raised(py, *report)?),
        Err(Stopped::Raised(error)) => Err(error),
    }
}

#[pymethods]
impl Watch {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<WatchedMessage>> {
        while !self.is_closed.load(Ordering::Acquire) {
            let next = py.detach(|| {
                let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
                seen.as_mut().map(|seen| seen.next(self.pickles))
            });
            match next {
                None | Some(Ok(Came::End)) => break,
                Some(Ok(Came::Message(message))) => return Ok(Some(*message)),
                Some(Ok(Came::Nothing)) => py.check_signals()?,
                Some(Err(error)) => return Err(not_any_more(py, &error)?),
            }
        }
        Ok(None)
    }

    /// Watches no longer.
    fn close(&self, py: Python<'_>) {
        self.is_closed.store(true, Ordering::Release);
        py.detach(|| *self.seen.lock().unwrap_or_else(PoisonError::into_inner) = None);
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __exit__(
        &self,
        py: Python<'_>,
        _kind: &Bound<'_, PyAny>,
        _error: &Bound<'_, PyAny>,
        _traceback: &Bound<'_, PyAny>,
    ) {
        self.close(py);
    }
}

impl Seen {
    /// Waits a while for the next message. The last one holds memory of the federate no longer: one that is kept would
    /// keep others from coming.
    fn next(&mut self, pickles: bool) -> Result<Came, WatchError> {
        if let Some(last) = std::mem::take(&mut self.last).upgrade() {
            let mut last = last.lock().unwrap_or_else(PoisonError::into_inner);
            if last.is_held() {
                *last = Content::Over;
            }
        }
        Ok(match self.sights.next(PATIENCE)? {
            Next::Ended => Came::End,
            Next::Nothing => Came::Nothing,
            Next::Shown(shown) => {
                let message = WatchedMessage::new(*shown, pickles);
                self.last = Arc::downgrade(&message.content);
                Came::Message(Box::new(message))
            }
        })
    }
}

/// A message that a federate has sent.
#[pyclass(frozen, module = "hprm._hprm")]
pub(crate) struct WatchedMessage {
    /// The port at which it is seen: `camera.image`.
    #[pyo3(get)]
    port: String,
    /// Its tag there; None at the input of a physical connection, where that is the time of arrival.
    #[pyo3(get)]
    tag: Option<Tag>,
    /// The logical time since the start, in nanoseconds: that of the tag, or of the sender if there is no tag.
    #[pyo3(get)]
    elapsed: i64,
    /// The physical time at which it was sent, in nanoseconds since the Unix epoch.
    #[pyo3(get)]
    sent: i64,
    /// How many bytes its value has.
    #[pyo3(get)]
    size: u64,
    /// How many messages were missed before it.
    #[pyo3(get)]
    missed: u64,
    content: Arc<Mutex<Content>>,
    /// The package that has made the bytes of its value, if the connection names one.
    serializer: Option<String>,
    pickles: bool,
    value: PyOnceLock<Py<PyAny>>,
}

/// What there is of a value.
enum Content {
    /// As it has come.
    Arrived(Arrived),
    /// Nothing, for this reason.
    Unseen(Unseen),
    /// Nothing any more.
    Over,
}

impl Content {
    /// Whether it holds memory of the federate.
    fn is_held(&self) -> bool {
        let is_object = |part: &ArrivedPart| matches!(part, ArrivedPart::Object(_));
        matches!(self, Self::Arrived(arrived) if arrived.parts.iter().any(is_object))
    }
}

impl WatchedMessage {
    fn new(shown: Shown, pickles: bool) -> Self {
        let Shown { port, tag, missed, serializer, sight } = shown;
        let Sight { tag: sent_at, start, at, bytes, value, .. } = sight;
        let content = value.map_or_else(Content::Unseen, Content::Arrived);
        Self {
            port,
            tag: tag.map(|tag| Tag::of(tag, start)),
            elapsed: tag.unwrap_or(sent_at).time,
            sent: at.0,
            size: bytes,
            missed,
            content: Arc::new(Mutex::new(content)),
            serializer: serializer.filter(|name| !name.eq_ignore_ascii_case("native")),
            pickles,
            value: PyOnceLock::new(),
        }
    }

    fn decoded(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let arrived = {
            let content = self.content.lock().unwrap_or_else(PoisonError::into_inner);
            match &*content {
                Content::Arrived(arrived) => arrived.clone(),
                Content::Unseen(unseen) => return Err(self.unseen(py, unseen)?),
                Content::Over => return Err(self.over(py)?),
            }
        };
        if let Some(names) = arrived.pickle()
            && !self.pickles
            && self.serializer.is_none()
        {
            return Err(self.unseen(py, &Unseen::Pickle { names })?);
        }
        let parts = arrived.parts.iter().map(own).collect::<PyResult<Vec<_>>>()?;
        let value = if self.serializer.is_some() {
            PyBytes::new(py, serialize::unwrap(&arrived.head, &parts)).into_any()
        } else {
            let looking = Trust::looking();
            let trust = if self.pickles { Trust::new(Pickling::Allow, true) } else { looking };
            serialize::decode(py, &arrived.head, &parts, trust)?
        };
        // The federate may use its memory again.
        *self.content.lock().unwrap_or_else(PoisonError::into_inner) = Content::Over;
        Ok(value.unbind())
    }

    /// The exception for a value that is asked for too late.
    fn over(&self, py: Python<'_>) -> PyResult<PyErr> {
        let said = format!("the value at {} is not held any more", self.port);
        let hint = "ask for the value of a message before the next message";
        raised(py, Report::new(Kind::Code, said).hint(hint))
    }

    /// The exception for a value that cannot be seen.
    fn unseen(&self, py: Python<'_>, unseen: &Unseen) -> PyResult<PyErr> {
        let report =
            |said: String| Report::new(Kind::Code, format!("the value at {} {said}", self.port));
        raised(
            py,
            match unseen {
                Unseen::TooLarge => report(
                    "is larger than what watchers may hold: an eighth of store-limit".to_owned(),
                )
                .hint("a program whose store-limit is larger shows it"),
                Unseen::Unencodable(reason) => report(format!("has no encoding: {reason}")),
                Unseen::Unreadable(reason) => report(format!("cannot be read: {reason}")),
                Unseen::Pickle { names } => {
                    let of = names.as_ref().map(|it| format!(" of {it}")).unwrap_or_default();
                    report(format!("is a pickle{of}, and pickles are not read")).hint(
                        "watch(..., pickles=True) reads them: then the program that is watched can run code here",
                    )
                }
            },
        )
    }
}

/// A copy of what has come: the federate has room for few messages that are held.
fn own(part: &ArrivedPart) -> PyResult<ReceivedPart> {
    Ok(ReceivedPart::Inline(match part {
        ArrivedPart::Inline(bytes) => Arc::clone(bytes),
        ArrivedPart::Object(held) => {
            let copy = copy_of(held.as_bytes()).map_err(|_| PyMemoryError::new_err(()))?;
            Arc::new(copy)
        }
    }))
}

#[pymethods]
impl WatchedMessage {
    /// The value, decoded when it is asked for first: before the next message is.
    #[getter]
    fn value(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let value = self.value.get_or_try_init(py, || self.decoded(py))?;
        Ok(value.clone_ref(py))
    }

    fn __repr__(&self) -> String {
        format!(
            "<message at {}, {} ns after the start, {} bytes>",
            self.port, self.elapsed, self.size
        )
    }
}

/// A federate cannot be watched any more.
fn not_any_more(py: Python<'_>, error: &WatchError) -> PyResult<PyErr> {
    raised(
        py,
        Report::new(Kind::Command, format!("a federate cannot be watched any more: {error}")),
    )
}

/// The exception that says what a report says.
fn raised(py: Python<'_>, report: Report) -> PyResult<PyErr> {
    let class = py.import(intern!(py, "hprm._watching"))?.getattr(intern!(py, "WatchError"))?;
    Ok(PyErr::from_value(class.call1((report.message, report.hint))?))
}
