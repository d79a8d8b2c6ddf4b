//! The class behind the module `lf`: time, tags, and what a program asks of its runtime.
//!
//! The module itself, with its names and signatures, is made in Python from one of these.

use std::sync::Arc;

use hprm::{Clock, Source};
use hprm_core::{Coordination, Nanos, Scope};
use hprm_store::StoreStats;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::console::tell;
use crate::failure::Described;
use crate::numpy_memory;
use crate::runtime::{DeadlineHandler, Runtime};
use crate::tag::Tag;
use crate::time::nanos;

/// The runtime of one program, for its module `lf`.
#[pyclass(frozen, module = "hprm._hprm")]
pub(crate) struct Api(pub(crate) Arc<Runtime>);

#[pymethods]
impl Api {
    /// The current tag.
    fn tag(&self) -> PyResult<Tag> {
        let (tag, start) = self.0.tag()?;
        Ok(Tag::of(tag, start))
    }

    /// The time of the current tag, in nanoseconds since the Unix epoch.
    fn logical(&self) -> PyResult<i64> {
        Ok(self.tag()?.time())
    }

    /// The time of the current tag, in nanoseconds since the start.
    fn logical_elapsed(&self) -> PyResult<i64> {
        Ok(self.0.tag()?.0.time)
    }

    /// The clock, in nanoseconds since the Unix epoch.
    fn physical(&self) -> i64 {
        self.0.note_physical();
        Clock::now().0
    }

    /// The clock, in nanoseconds since the start.
    fn physical_elapsed(&self) -> PyResult<i64> {
        self.0.note_physical();
        Ok(Clock::now().since(self.0.tag()?.1))
    }

    /// The time of the start, in nanoseconds since the Unix epoch.
    fn start(&self) -> PyResult<i64> {
        Ok(self.0.tag()?.1.0)
    }

    /// Ends the program at its next tag.
    fn request_stop(&self) -> PyResult<()> {
        self.0.request_stop()
    }

    /// Ends the program because a thread of it has raised what is `described`. If the program has ended
    /// already, tells of it here, and returns false.
    fn fail(&self, thread: String, described: Described) -> bool {
        let failure = described.failure(Source::Thread { name: thread });
        let ends = self.0.fail(failure.clone());
        if !ends {
            tell(&failure);
        }
        ends
    }

    /// Ends the federate at its next tag, while the others go on. A program without federates ends.
    fn stop(&self) -> PyResult<()> {
        self.0.depart()
    }

    /// The tag at which this federate started: that of the start, unless it joined late.
    fn tag_start_effective(&self) -> PyResult<Tag> {
        let (tag, start) = self.0.first_tag()?;
        Ok(Tag::of(tag, start))
    }

    /// Whether the deadline of the running reaction has passed; if so, runs its handler.
    #[pyo3(signature = (invoke_deadline_handler = true))]
    fn check_deadline(&self, py: Python<'_>, invoke_deadline_handler: bool) -> PyResult<bool> {
        let Some(late) = self.0.deadline_missed(py)? else { return Ok(false) };
        if let Some(DeadlineHandler { handler, arguments }) =
            late.filter(|_| invoke_deadline_handler)
        {
            handler.bind(py).call1(arguments.fresh(py)?)?;
        }
        Ok(true)
    }

    /// Changes the deadline of the running reaction, from now on.
    fn update_deadline(&self, deadline: &Bound<'_, PyAny>) -> PyResult<()> {
        match nanos(deadline)? {
            deadline if deadline >= 0 => self.0.set_deadline(deadline),
            deadline => Err(PyValueError::new_err(format!(
                "a deadline cannot be negative, and {deadline} is"
            ))),
        }
    }

    /// The name of this federate; None if the whole program runs here.
    fn federate(&self) -> Option<String> {
        self.0.federate_name().map(str::to_owned)
    }

    /// How long this federate waits for its inputs, in nanoseconds.
    fn maxwait(&self) -> PyResult<i64> {
        let program = self.0.program();
        match self.0.scope() {
            Scope::Federate(federate)
                if program.properties.coordination == Coordination::Decentralized =>
            {
                Ok(self.0.maxwait().unwrap_or(program.federates[federate].maxwait))
            }
            _ => Err(PyRuntimeError::new_err(
                "there is a maxwait only in the federates of a program with `coordination: decentralized`",
            )),
        }
    }

    /// Has this federate wait that many nanoseconds for its inputs, from the next tag on.
    fn set_maxwait(&self, maxwait: &Bound<'_, PyAny>) -> PyResult<()> {
        self.maxwait()?;
        match nanos(maxwait)? {
            maxwait if maxwait < 0 => Err(PyValueError::new_err(format!(
                "a maxwait cannot be negative, and {maxwait} is"
            ))),
            // The federates agree before the start which of them may wait for ever.
            Nanos::MAX => Err(PyValueError::new_err(
                "a maxwait that has no end must be stated in the program: @maxwait(forever)",
            )),
            maxwait => self.0.set_maxwait(maxwait),
        }
    }

    /// The number of the tracepoint with this name: 0 if the run is not traced.
    fn tracepoint_name(&self, name: &str) -> u32 {
        self.0.tracepoints().map_or(0, |tracepoints| tracepoints.name(name))
    }

    /// Records that a tracepoint was reached, perhaps with a value.
    #[pyo3(signature = (number, value = None))]
    fn tracepoint(&self, number: u32, value: Option<i64>) {
        if let Some(tracepoints) = self.0.tracepoints() {
            tracepoints.hit(number, value);
        }
    }

    /// What the object store had done when a value was last sent.
    fn store_stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let heap_fallbacks = numpy_memory::refused();
        stats(py, StoreStats { heap_fallbacks, ..self.0.stats() })
    }
}

/// The numbers of a store, by name.
pub(crate) fn stats(py: Python<'_>, stats: StoreStats) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("objects_sealed", stats.objects_sealed)?;
    dict.set_item("objects_passed_on", stats.objects_passed_on)?;
    dict.set_item("bytes_copied", stats.bytes_copied)?;
    dict.set_item("bytes_in_use", stats.bytes_in_use)?;
    dict.set_item("bytes_mapped", stats.bytes_mapped)?;
    dict.set_item("segments", stats.segments)?;
    dict.set_item("inline_fallbacks", stats.inline_fallbacks)?;
    dict.set_item("heap_fallbacks", stats.heap_fallbacks)?;
    dict.set_item("releases", stats.releases)?;
    Ok(dict)
}
