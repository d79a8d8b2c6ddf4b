//! The class `port_capsule`: a port, as an argument of a reaction.

use std::sync::Arc;

use hprm_core::{PortId, ReactionId};
use pyo3::exceptions::{PyAttributeError, PyIndexError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyIterator, PyTuple};

use crate::action::kind;
use crate::runtime::{Access, Runtime};
use crate::tag::Tag;
use crate::value::Value;

/// What `width` is for a port that is not a multiport (handbook, "multiports").
const NOT_A_MULTIPORT: i64 = -2;

/// What `physical_time_of_arrival` is for a value that did not arrive from elsewhere.
const NEVER: i64 = i64::MIN;

/// A port or one channel of it; a multiport is a sequence of these.
#[pyclass(frozen, name = "port_capsule", module = "hprm")]
pub(crate) struct Port {
    runtime: Arc<Runtime>,
    reaction: ReactionId,
    access: Access,
    name: String,
    channels: Channels,
}

/// The channels of a port.
enum Channels {
    One(PortId),
    Multiport(Py<PyTuple>),
}

impl Port {
    /// The port that begins at `first`, for an argument of `reaction`.
    pub(crate) fn build<'py>(
        py: Python<'py>,
        runtime: &Arc<Runtime>,
        (reaction, access): (ReactionId, Access),
        name: &str,
        (first, width): (PortId, Option<u32>),
    ) -> PyResult<Bound<'py, Self>> {
        let port = |name: String, channels| {
            let runtime = Arc::clone(runtime);
            Bound::new(py, Self { runtime, reaction, access, name, channels })
        };
        let Some(width) = width else { return port(name.to_owned(), Channels::One(first)) };
        let channels = (0..width)
            .map(|i| port(format!("{name}[{i}]"), Channels::One(PortId(first.0 + i))))
            .collect::<PyResult<Vec<_>>>()?;
        port(name.to_owned(), Channels::Multiport(PyTuple::new(py, channels)?.unbind()))
    }

    fn channel(&self, verb: &str) -> PyResult<PortId> {
        match self.channels {
            Channels::One(port) => Ok(port),
            Channels::Multiport(_) => Err(PyTypeError::new_err(format!(
                "multiport {0} has no value of its own; {verb} one of its channels, as {0}[0]",
                self.name
            ))),
        }
    }

    fn channels<'py>(&self, py: Python<'py>) -> PyResult<&Bound<'py, PyTuple>> {
        match &self.channels {
            Channels::Multiport(channels) => Ok(channels.bind(py)),
            Channels::One(_) => Err(PyTypeError::new_err(format!(
                "port {} is not a multiport, so it has neither a length nor channels",
                self.name
            ))),
        }
    }

    fn present(&self) -> PyResult<Option<Value>> {
        self.runtime.read((self.reaction, self.access), self.channel("read")?)
    }
}

#[pymethods]
impl Port {
    /// The value; None if the port is absent.
    #[getter]
    fn value<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.present()?.map(|value| value.object(py)).transpose()
    }

    #[setter(value)]
    fn refuse_value(&self, _value: &Bound<'_, PyAny>) -> PyResult<()> {
        Err(PyAttributeError::new_err(format!(
            "a port is set by its method: {}.set(...)",
            self.name
        )))
    }

    /// Whether the port has a value at this tag; for a multiport, whether any channel has.
    #[getter]
    fn is_present(&self, py: Python<'_>) -> PyResult<bool> {
        match &self.channels {
            Channels::One(port) => self.runtime.is_present((self.reaction, self.access), *port),
            Channels::Multiport(channels) => {
                for channel in channels.bind(py) {
                    if channel.cast::<Self>()?.get().is_present(py)? {
                        return Ok(true);
                    }
                }
                Ok(false)
            }
        }
    }

    /// The number of channels; -2 if the port is not a multiport.
    #[getter]
    fn width(&self, py: Python<'_>) -> i64 {
        match &self.channels {
            Channels::One(_) => NOT_A_MULTIPORT,
            Channels::Multiport(channels) => channels.bind(py).len() as i64,
        }
    }

    /// The tag that the value was meant for: an earlier one if it came too late.
    #[getter]
    fn intended_tag(&self) -> PyResult<Tag> {
        let tag = self.runtime.intended_tag(self.reaction, self.channel("read")?)?;
        let (_, start) = self.runtime.tag()?;
        Ok(Tag::of(tag, start))
    }

    /// When the value arrived from another federate, in nanoseconds since the Unix epoch.
    #[getter]
    fn physical_time_of_arrival(&self) -> PyResult<i64> {
        self.runtime.note_physical();
        let arrival = self.present()?.and_then(|value| value.arrival());
        Ok(arrival.map_or(NEVER, |time| time.0))
    }

    /// Sets the port at this tag. The last value that is set wins.
    ///
    /// An input that the reaction names as a source does not become present. It remembers the value,
    /// and from then on the last one that was received, for reads while the port is absent.
    #[pyo3(signature = (value, /))]
    fn set(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let port = self.channel("set")?;
        match self.access {
            Access::Write => self.runtime.set(self.reaction, port, Value::new(value)),
            Access::Remember => self.runtime.remember(self.reaction, port, Value::new(value)),
            Access::Read => Err(PyTypeError::new_err(format!(
                "port {0} cannot be set here; only the effects of a reaction can, so name it after \
                 the arrow: reaction(...) -> {0}",
                self.name
            ))),
        }
    }

    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.channels(py)?.len())
    }

    fn __bool__(&self) -> bool {
        true
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyIterator>> {
        self.channels(py)?.try_iter()
    }

    fn __reversed__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyIterator>> {
        let channels = self.channels(py)?.to_list();
        channels.reverse()?;
        channels.try_iter()
    }

    fn __setitem__(&self, index: &Bound<'_, PyAny>, _value: &Bound<'_, PyAny>) -> PyResult<()> {
        Err(PyTypeError::new_err(format!(
            "a channel is set by its method: {}[{index}].set(...)",
            self.name
        )))
    }

    fn __getitem__<'py>(
        slf: &Bound<'py, Self>,
        index: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (py, port) = (slf.py(), slf.get());
        let Channels::Multiport(channels) = &port.channels else {
            return Ok(slf.clone().into_any());
        };
        let channels = channels.bind(py);
        channels.as_any().get_item(index).map_err(|error| {
            let name = &port.name;
            if error.is_instance_of::<PyIndexError>(py) {
                let width = channels.len();
                PyIndexError::new_err(format!("{name} has {width} channels; there is no {index}"))
            } else if error.is_instance_of::<PyTypeError>(py) {
                let kind = kind(index);
                PyTypeError::new_err(format!(
                    "the channels of {name} have whole numbers, and this is a {kind}"
                ))
            } else {
                error
            }
        })
    }

    fn __repr__(&self) -> String {
        format!("<port {}>", self.name)
    }
}
