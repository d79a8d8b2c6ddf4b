//! What a NumPy array is made of, and making one.
//!
//! NumPy is reached through its Python names, and only if the program has imported it or a payload
//! holds an array. Which bytes go where is decided elsewhere.

use hprm_codec::format::{FIELDS, Order, SIMPLE};
use hprm_store::Object;
use pyo3::exceptions::PyValueError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBytes, PyDict, PyTuple, PyType};

use crate::buffer::{CowMemory, Memory, ReceivedPart};
use crate::numpy_memory;

/// The names of NumPy that encoding needs.
pub(super) struct Numpy {
    ndarray: Py<PyType>,
    dtype: Py<PyAny>,
    copyto: Py<PyAny>,
    /// From the dtypes seen so far to their descriptions, and back.
    descriptions: Py<PyDict>,
    dtypes: Py<PyDict>,
}

/// More dtypes than a program uses: forget all, rather than grow.
const CACHE_LIMIT: usize = 256;

static NUMPY: PyOnceLock<Numpy> = PyOnceLock::new();

impl Numpy {
    /// NumPy, if the program has imported it. If not, no value is an array.
    pub(super) fn if_imported(py: Python<'_>) -> PyResult<Option<&'static Self>> {
        if let Some(numpy) = NUMPY.get(py) {
            return Ok(Some(numpy));
        }
        match numpy_memory::is_imported(py)? {
            true => Self::imported(py).map(Some),
            false => Ok(None),
        }
    }

    /// NumPy, imported now if need be.
    pub(super) fn imported(py: Python<'_>) -> PyResult<&'static Self> {
        NUMPY.get_or_try_init(py, || {
            let numpy = py.import(intern!(py, "numpy"))?;
            Ok(Self {
                ndarray: numpy.getattr(intern!(py, "ndarray"))?.cast_into::<PyType>()?.unbind(),
                dtype: numpy.getattr(intern!(py, "dtype"))?.unbind(),
                copyto: numpy.getattr(intern!(py, "copyto"))?.unbind(),
                descriptions: PyDict::new(py).unbind(),
                dtypes: PyDict::new(py).unbind(),
            })
        })
    }

    /// Whether `value` is an array and not of a subclass, which has a state of its own.
    pub(super) fn is_array(&self, value: &Bound<'_, PyAny>) -> bool {
        value.get_type().is(&self.ndarray)
    }

    /// What `array` is made of; none if its elements are not plain bytes.
    pub(super) fn layout<'py>(&self, array: &Bound<'py, PyAny>) -> PyResult<Option<Layout<'py>>> {
        let py = array.py();
        let dtype = array.getattr(intern!(py, "dtype"))?;
        let Some(description) = self.description(&dtype)? else { return Ok(None) };
        let flags = array.getattr(intern!(py, "flags"))?;
        let flag = |name| flags.getattr(name)?.is_truthy();
        let fortran = flag(intern!(py, "f_contiguous"))? && !flag(intern!(py, "c_contiguous"))?;
        Ok(Some(Layout {
            dtype,
            description,
            shape: array.getattr(intern!(py, "shape"))?.cast_into::<PyTuple>()?,
            order: if fortran { Order::Fortran } else { Order::C },
            len: array.getattr(intern!(py, "nbytes"))?.extract()?,
        }))
    }

    /// The bytes of an array, in its order.
    pub(super) fn bytes<'py>(
        array: &Bound<'py, PyAny>,
        layout: &Layout<'py>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let py = array.py();
        let elements = layout.elements(array)?;
        let bytes = elements.call_method1(intern!(py, "tobytes"), (name_of(layout.order),))?;
        Ok(bytes.cast_into::<PyBytes>()?)
    }

    /// Copies an array into a buffer of its length, in its order.
    pub(super) fn gather<'py>(
        &self,
        array: &Bound<'py, PyAny>,
        layout: &Layout<'py>,
        buffer: &Bound<'py, PyAny>,
    ) -> PyResult<()> {
        let py = array.py();
        let elements = layout.elements(array)?;
        let dtype = elements.getattr(intern!(py, "dtype"))?;
        let target = self.over(layout.shape.as_any(), &dtype, buffer, layout.order)?;
        self.copyto.bind(py).call1((target, elements))?;
        Ok(())
    }

    /// An array over a buffer; read-only if the buffer is.
    pub(super) fn over<'py>(
        &self,
        shape: &Bound<'py, PyAny>,
        dtype: &Bound<'py, PyAny>,
        buffer: &Bound<'py, PyAny>,
        order: Order,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = shape.py();
        match order {
            Order::C => self.ndarray.bind(py).call1((shape, dtype, buffer)),
            Order::Fortran => {
                let strides = py.None();
                self.ndarray.bind(py).call1((shape, dtype, buffer, 0, strides, name_of(order)))
            }
        }
    }

    /// The dtype of that description.
    pub(super) fn dtype<'py>(
        &self,
        description: &Bound<'py, PyBytes>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = description.py();
        let known = self.dtypes.bind(py);
        // The fields of a dtype can be given other names: each receiver gets its own dtype.
        let lasts = description.as_bytes().first() != Some(&FIELDS);
        if let Some(dtype) = known.get_item(description)? {
            return Ok(dtype);
        }
        let dtype = match description.as_bytes().split_first() {
            Some((&SIMPLE, name)) => {
                let name = std::str::from_utf8(name)
                    .map_err(|_| PyValueError::new_err("malformed payload: a dtype is no text"))?;
                self.dtype.bind(py).call1((name,))?
            }
            Some((&FIELDS, text)) => {
                let text = PyBytes::new(py, text);
                arrays(py)?.call_method1(intern!(py, "dtype_of"), (text,))?
            }
            _ => return Err(PyValueError::new_err("malformed payload: unknown form of a dtype")),
        };
        if !is_plain(&dtype)? {
            return Err(PyValueError::new_err("malformed payload: elements are not plain bytes"));
        }
        if lasts {
            remember(known, description.as_any(), &dtype)?;
        }
        Ok(dtype)
    }

    fn description<'py>(&self, dtype: &Bound<'py, PyAny>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let py = dtype.py();
        let known = self.descriptions.bind(py);
        if let Some(description) = known.get_item(dtype)? {
            return Ok(Some(description.cast_into::<PyBytes>()?));
        }
        if !is_plain(dtype)? {
            return Ok(None);
        }
        let Some(description) = self.describe(dtype)? else { return Ok(None) };
        remember(known, dtype, description.as_any())?;
        Ok(Some(description))
    }

    /// By its short name where that says it all; one with fields needs more. None if it is one that
    /// a package has added to NumPy.
    fn describe<'py>(&self, dtype: &Bound<'py, PyAny>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let py = dtype.py();
        let name: String = dtype.getattr(intern!(py, "str"))?.extract()?;
        let plain = dtype.getattr(intern!(py, "names"))?.is_none()
            && self.dtype.bind(py).call1((&name,))?.eq(dtype)?;
        let mut description = vec![if plain { SIMPLE } else { FIELDS }];
        if plain {
            description.extend_from_slice(name.as_bytes());
        } else {
            let text = arrays(py)?.call_method1(intern!(py, "description_of"), (dtype,))?;
            if text.is_none() {
                return Ok(None);
            }
            description.extend_from_slice(text.cast::<PyBytes>()?.as_bytes());
        }
        Ok(Some(PyBytes::new(py, &description)))
    }
}

/// How many bytes the elements of an array take; none if the value is no array.
pub(crate) fn len_of(value: &Bound<'_, PyAny>) -> PyResult<Option<usize>> {
    let py = value.py();
    if !Numpy::if_imported(py)?.is_some_and(|numpy| numpy.is_array(value)) {
        return Ok(None);
    }
    value.getattr(intern!(py, "nbytes"))?.extract().map(Some)
}

/// What an array is made of.
pub(super) struct Layout<'py> {
    pub(super) dtype: Bound<'py, PyAny>,
    pub(super) description: Bound<'py, PyBytes>,
    pub(super) shape: Bound<'py, PyTuple>,
    pub(super) order: Order,
    /// The length of its elements in bytes.
    pub(super) len: usize,
}

impl<'py> Layout<'py> {
    /// Whether all bytes of an element belong to its value.
    pub(super) fn has_plain_elements(&self) -> bool {
        self.description.as_bytes().first() != Some(&FIELDS)
    }

    /// The array with elements of which NumPy copies every byte. Of those with fields it copies only the
    /// fields: in the gaps would be whatever was in the memory before.
    fn elements(&self, array: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        if self.has_plain_elements() {
            return Ok(array.clone());
        }
        let py = array.py();
        arrays(py)?.call_method1(intern!(py, "raw"), (array,))
    }
}

/// The object of a store that has the elements of an array, all of them and nothing else, in the order
/// of the layout.
pub(super) fn object_under(
    array: &Bound<'_, PyAny>,
    layout: &Layout<'_>,
) -> PyResult<Option<Object>> {
    let py = array.py();
    let mut base = array.getattr(intern!(py, "base"))?;
    while base.get_type().is(array.get_type()) {
        base = base.getattr(intern!(py, "base"))?;
    }
    let Ok(memory) = base.cast_exact::<Memory>() else { return Ok(None) };
    let ReceivedPart::Object(object) = &memory.get().0 else { return Ok(None) };
    let bytes = object.as_bytes();
    let flags = array.getattr(intern!(py, "flags"))?;
    let in_a_row = match layout.order {
        Order::C => intern!(py, "c_contiguous"),
        Order::Fortran => intern!(py, "f_contiguous"),
    };
    let interface = array.getattr(intern!(py, "__array_interface__"))?;
    let start: usize = interface.get_item(intern!(py, "data"))?.get_item(0)?.extract()?;
    let whole = flags.getattr(in_a_row)?.is_truthy()?
        && start == bytes.as_ptr() as usize
        && layout.len == bytes.len();
    Ok(whole.then(|| object.clone()))
}

/// From how many bytes on mapping an array costs less than copying it.
const OWN_LIMIT: usize = 1 << 20;

/// A writeable array of a received one, for the caller alone: over the same memory, in a copy-on-write
/// mapping, or else a copy.
#[pyfunction]
pub(crate) fn own<'py>(array: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let py = array.py();
    let numpy = Numpy::imported(py)?;
    if numpy.is_array(array)
        && let Some(layout) = numpy.layout(array)?.filter(|layout| layout.len >= OWN_LIMIT)
        && let Some(object) = object_under(array, &layout)?
        && let Some(own) = numpy_memory::map_copy_on_write(py, &object)
    {
        let memory = Bound::new(py, CowMemory(own))?;
        return numpy.over(layout.shape.as_any(), &layout.dtype, memory.as_any(), layout.order);
    }
    let keep_order = PyDict::new(py);
    keep_order.set_item(intern!(py, "order"), "K")?;
    array.call_method(intern!(py, "copy"), (), Some(&keep_order))
}

/// As NumPy calls it.
fn name_of(order: Order) -> &'static str {
    match order {
        Order::C => "C",
        Order::Fortran => "F",
    }
}

fn is_plain(dtype: &Bound<'_, PyAny>) -> PyResult<bool> {
    let py = dtype.py();
    let refers = dtype.getattr(intern!(py, "hasobject"))?.is_truthy()?;
    let itemsize: usize = dtype.getattr(intern!(py, "itemsize"))?.extract()?;
    // An element of no bytes is widened by NumPy when an array is made over a buffer.
    Ok(!refers && itemsize > 0)
}

fn arrays(py: Python<'_>) -> PyResult<Bound<'_, PyModule>> {
    py.import(intern!(py, "hprm._kinds.arrays"))
}

fn remember(
    cache: &Bound<'_, PyDict>,
    key: &Bound<'_, PyAny>,
    entry: &Bound<'_, PyAny>,
) -> PyResult<()> {
    if cache.len() >= CACHE_LIMIT {
        cache.clear();
    }
    cache.set_item(key, entry)
}
