//! The class `port_capsule`: a port, as an argument of a reaction or as an attribute of its reactor.

use std::sync::Arc;

use hprm_core::{Direction, PortId};
use pyo3::exceptions::{PyAttributeError, PyIndexError, PyTypeError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyIterator, PyTuple};

use crate::accepts::Accepts;
use crate::runtime::Runtime;
use crate::tag::Tag;
use crate::time::kind;
use crate::users::{self, Access, Users};
use crate::value::Value;

/// What `width` is for a port that is not a multiport (handbook, "multiports").
const NOT_A_MULTIPORT: i64 = -2;

/// What `physical_time_of_arrival` is for a value that did not arrive from elsewhere.
const NEVER: i64 = i64::MIN;

/// A port or one channel of it; a multiport is a sequence of these.
#[pyclass(frozen, name = "port_capsule", module = "hprm")]
pub(crate) struct Port {
    runtime: Arc<Runtime>,
    users: Users<Access>,
    name: String,
    channels: Channels,
    /// None of an argument.
    attribute: Option<Attribute>,
}

/// The channels of a port.
enum Channels {
    One(PortId),
    Multiport(Py<PyTuple>),
}

/// What is different about a port that is an attribute of its reactor.
pub(crate) struct Attribute {
    /// The values that it accepts, if not all.
    pub(crate) accepts: Option<Accepts>,
    /// Whether its readers may change the value, so that each of them gets a copy.
    pub(crate) mutable: bool,
}

impl Port {
    /// The port that begins at `first`. Of each channel, `users` says which reactions may use it, and `attribute`
    /// what it is as an attribute of its reactor.
    pub(crate) fn build<'py>(
        py: Python<'py>,
        runtime: &Arc<Runtime>,
        name: &str,
        (first, width): (PortId, Option<u32>),
        users: impl Fn(PortId) -> Users<Access>,
        attribute: impl Fn() -> Option<Attribute>,
    ) -> PyResult<Bound<'py, Self>> {
        let port = |name: String, id, channels| {
            let (runtime, users, attribute) = (Arc::clone(runtime), users(id), attribute());
            Bound::new(py, Self { runtime, users, name, channels, attribute })
        };
        let Some(width) = width else {
            return port(name.to_owned(), first, Channels::One(first));
        };
        let channels = (0..width)
            .map(|i| {
                let id = PortId(first.0 + i);
                port(format!("{name}[{i}]"), id, Channels::One(id))
            })
            .collect::<PyResult<Vec<_>>>()?;
        port(name.to_owned(), first, Channels::Multiport(PyTuple::new(py, channels)?.unbind()))
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

    /// The value, which was decoded, and for an attribute that is mutable copied.
    fn read<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let port = self.channel("read")?;
        let is_mutable = self.attribute.as_ref().is_some_and(|attribute| attribute.mutable);
        if is_mutable && let Some(copy) = self.runtime.copy(py, &self.users, port)? {
            return Ok(Some(copy.into_bound(py)));
        }
        let Some(value) = self.runtime.read(&self.users, port)? else { return Ok(None) };
        let object = value.object(py)?;
        if !is_mutable {
            return Ok(Some(object));
        }
        let copied = py.import(intern!(py, "hprm._ports"))?.getattr(intern!(py, "_copied"))?;
        let copy = copied.call1((object,))?;
        self.runtime.keep_copy(&self.users, port, copy.clone().unbind())?;
        Ok(Some(copy))
    }

    /// The error of a reaction that reads the value of an attribute while there is none.
    fn absent(&self, port: PortId) -> PyErr {
        let program = self.runtime.program();
        let Some(reaction) = self.runtime.running_reaction() else {
            return PyValueError::new_err(format!("port {} is absent", self.name));
        };
        let reactor = program.reactions[reaction].reactor;
        let name = users::port_as_seen(program, reactor, port);
        let spec = &program.ports[port];
        let advice = if spec.reactor == reactor && spec.direction == Direction::Output {
            "an output has a value only at the tag at which it is set; keep what the next tag needs in an attribute"
                .to_owned()
        } else {
            format!("ask {name}.is_present first, or read {name}.get(default)")
        };
        PyValueError::new_err(format!(
            "port {name} is absent at this tag, so reaction {} cannot read its value: {advice}",
            program.reaction_label(reaction)
        ))
    }
}

#[pymethods]
impl Port {
    /// The value at this tag.
    ///
    /// While the port is absent, that is None in the body of an `.lf` file, where the port is an argument, and
    /// a `ValueError` in plain Python, where it is an attribute of `self`.
    #[getter]
    fn value<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        match self.read(py)? {
            None if self.attribute.is_some() => Err(self.absent(self.channel("read")?)),
            value => Ok(value),
        }
    }

    /// Returns the value, or the default while the port is absent.
    #[pyo3(signature = (default = None))]
    fn get<'py>(
        &self,
        py: Python<'py>,
        default: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        Ok(self.read(py)?.or(default))
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
            Channels::One(port) => self.runtime.is_present(&self.users, *port),
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
        let tag = self.runtime.intended_tag(&self.users, self.channel("read")?)?;
        let (_, start) = self.runtime.tag()?;
        Ok(Tag::of(tag, start))
    }

    /// When the value arrived from another federate, in nanoseconds since the Unix epoch.
    #[getter]
    fn physical_time_of_arrival(&self) -> PyResult<i64> {
        self.runtime.note_physical();
        let value = self.runtime.read(&self.users, self.channel("read")?)?;
        let arrival = value.and_then(|value| value.arrival());
        Ok(arrival.map_or(NEVER, |time| time.0))
    }

    /// Sets the port at this tag. The last value that is set wins.
    ///
    /// An input that the reaction names as a source does not become present. It remembers the value,
    /// and from then on the last one that was received, for reads while the port is absent.
    #[pyo3(signature = (value, /))]
    fn set(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let port = self.channel("set")?;
        if let Users::Argument(_, Access::Read) = self.users {
            return Err(PyTypeError::new_err(format!(
                "port {0} cannot be set here; only the effects of a reaction can, so name it after \
                 the arrow: reaction(...) -> {0}",
                self.name
            )));
        }
        if let Some(Attribute { accepts: Some(accepts), .. }) = &self.attribute {
            accepts.check(value, || {
                let (program, setter) = (self.runtime.program(), self.runtime.running_reaction());
                let seen = setter.map_or_else(
                    || program.port_name(port),
                    |it| users::port_as_seen(program, program.reactions[it].reactor, port),
                );
                (format!("port {seen}"), setter.map(|it| program.reaction_label(it)))
            })?;
        }
        self.runtime.set(&self.users, port, Value::new(value))
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
                PyIndexError::new_err(format!(
                    "{name} has {width} channels, from 0 to {}; there is no channel {index}",
                    width.saturating_sub(1)
                ))
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
