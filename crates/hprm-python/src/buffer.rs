//! Bytes of this crate as Python buffers.
//!
//! Five classes give their memory to Python through the buffer protocol: [`Memory`] for reading what
//! has arrived, [`Shaped`] for reading it as elements of some format, [`CowMemory`] for writing to it
//! in a copy-on-write mapping, [`Frozen`] for reading what threads share, [`Staging`] for writing what will be sent. What
//! the bytes mean is not known here.

#![allow(unsafe_code)]

use std::ffi::{CString, c_int};
use std::ptr;
use std::sync::{Arc, Mutex, PoisonError};

use hprm_store::{CowObject, Object, WritableLoan};
use pyo3::buffer::{PyBuffer, PyUntypedBuffer};
use pyo3::exceptions::{PyBufferError, PyRuntimeError, PyValueError};
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::PyMemoryView;

use crate::numpy_memory::count;

/// A buffer of a payload that has arrived.
#[derive(Clone, Debug)]
pub(crate) enum ReceivedPart {
    /// Bytes that came inside the message.
    Inline(Arc<Vec<u8>>),
    /// Bytes in the sender's store.
    Object(Object),
}

impl ReceivedPart {
    /// The bytes.
    pub(crate) fn as_bytes(&self) -> &[u8] {
        match self {
            Self::Inline(bytes) => bytes,
            Self::Object(object) => object.as_bytes(),
        }
    }
}

/// Bytes that Python may read, and that stay where they are until no reference to them is left.
#[pyclass(frozen, module = "hprm._hprm")]
pub(crate) struct Memory(pub(crate) ReceivedPart);

#[pymethods]
impl Memory {
    fn __len__(&self) -> usize {
        self.0.as_bytes().len()
    }

    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        if flags & ffi::PyBUF_WRITABLE != 0 {
            // NumPy asks for this first, for every array: no detour to find that out.
            return Err(PyBufferError::new_err("what has arrived is read-only"));
        }
        let bytes = slf.get().0.as_bytes();
        // Benefit: arrays read the sender's memory in place.
        // SAFETY: `view` comes from the interpreter, and we are attached to it. The bytes belong to
        // `slf`, to which the view keeps a reference; the class is frozen and has no method that
        // changes or drops them, so they neither move nor change before `slf` is dropped. The view
        // is marked as read-only, so the pointer is not used for writing.
        unsafe { fill(&slf, view, bytes.as_ptr().cast_mut(), bytes.len(), true, flags) }
    }
}

/// Received bytes that Python may write to: no other process sees it.
#[pyclass(frozen, module = "hprm._hprm")]
pub(crate) struct CowMemory(pub(crate) Arc<CowObject>);

#[pymethods]
impl CowMemory {
    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        let (start, len) = (slf.get().0.start(), slf.get().0.len());
        // Benefit: libraries without read-only memory read the sender's memory in place.
        // SAFETY: `view` comes from the interpreter, and we are attached to it. There are `len` bytes
        // from `start` on, for reading and writing, as long as the object lives, which belongs to
        // `slf`, to which the view keeps a reference; Rust does not touch them.
        unsafe { fill(&slf, view, start, len, false, flags) }
    }
}

/// The memory of an array that is shared by threads: for reading, for ever.
#[pyclass(frozen, module = "hprm._hprm")]
pub(crate) struct Frozen {
    /// The array that owns the memory. Python code cannot reach it.
    _keeper: Py<PyAny>,
    start: usize,
    len: usize,
}

impl Frozen {
    /// Gives `len` bytes at `start` to readers.
    ///
    /// # Safety
    ///
    /// The bytes are valid, and do not change, as long as `keeper` lives.
    pub(crate) unsafe fn new(keeper: Py<PyAny>, start: *const u8, len: usize) -> Self {
        Self { _keeper: keeper, start: start as usize, len }
    }
}

#[pymethods]
impl Frozen {
    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        if flags & ffi::PyBUF_WRITABLE != 0 {
            return Err(PyBufferError::new_err("what several federates read is read-only"));
        }
        let (start, len) = (slf.get().start as *mut u8, slf.get().len);
        // Benefit: federates that are threads share an array, and none of them can change it.
        // SAFETY: `view` comes from the interpreter, and we are attached to it. By the contract of
        // `new` the bytes are valid and constant as long as `slf` lives, to which the view keeps a
        // reference; the view is marked as read-only.
        unsafe { fill(&slf, view, start, len, true, flags) }
    }
}

/// Bytes that have arrived, for reading as elements of any format and shape.
///
/// `memoryview.cast` makes only views of the few formats of which Python itself knows the elements.
#[pyclass(frozen, module = "hprm._hprm")]
pub(crate) struct Shaped {
    bytes: PyBuffer<u8>,
    format: CString,
    itemsize: isize,
    shape: Vec<isize>,
    strides: Vec<isize>,
    fortran: bool,
}

/// The most dimensions that a buffer may have.
const MOST_DIMENSIONS: usize = 64;

impl Shaped {
    fn of(
        data: &Bound<'_, PyAny>,
        format: &str,
        shape: Vec<isize>,
        itemsize: isize,
        fortran: bool,
    ) -> PyResult<Self> {
        let bytes = PyBuffer::<u8>::get(data)?;
        let malformed = || PyValueError::new_err("malformed payload: a buffer of another shape");
        let format = CString::new(format).map_err(|_| malformed())?;
        if itemsize < 1 || shape.len() > MOST_DIMENSIONS || shape.iter().any(|len| *len < 0) {
            return Err(malformed());
        }
        let mut strides = vec![0; shape.len()];
        let mut stride = itemsize;
        for at in 0..shape.len() {
            let at = if fortran { at } else { shape.len() - 1 - at };
            strides[at] = stride;
            stride = stride.checked_mul(shape[at].max(1)).ok_or_else(malformed)?;
        }
        let len = if shape.contains(&0) { 0 } else { stride };
        if !bytes.is_c_contiguous() || usize::try_from(len) != Ok(bytes.len_bytes()) {
            return Err(malformed());
        }
        Ok(Self { bytes, format, itemsize, shape, strides, fortran })
    }

    /// Whether a consumer that asks with these flags can be given the bytes as they lie.
    fn serves(&self, flags: c_int) -> bool {
        let asks = |flag| flags & flag == flag;
        // With at most one dimension, all orders are one.
        let (c, fortran) = match self.shape.iter().filter(|len| **len != 1).count() {
            0 | 1 => (true, true),
            _ if self.shape.contains(&0) => (true, true),
            _ => (!self.fortran, self.fortran),
        };
        !asks(ffi::PyBUF_WRITABLE)
            && (c || asks(ffi::PyBUF_STRIDES) && !asks(ffi::PyBUF_C_CONTIGUOUS))
            && (fortran || !asks(ffi::PyBUF_F_CONTIGUOUS))
    }
}

#[pymethods]
impl Shaped {
    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        let it = slf.get();
        if !it.serves(flags) {
            return Err(PyBufferError::new_err(
                "what has arrived is read-only and lies as it does",
            ));
        }
        let asks = |flag| flags & flag == flag;
        let list = |wanted, list: &[isize]| match wanted && !list.is_empty() {
            true => list.as_ptr().cast_mut(),
            false => ptr::null_mut(),
        };
        let shaped = asks(ffi::PyBUF_ND);
        let format =
            if asks(ffi::PyBUF_FORMAT) { it.format.as_ptr().cast_mut() } else { ptr::null_mut() };
        let filled = ffi::Py_buffer {
            buf: it.bytes.buf_ptr(),
            obj: slf.clone().into_any().into_ptr(),
            len: isize::try_from(it.bytes.len_bytes()).expect("a buffer has a length"),
            itemsize: it.itemsize,
            readonly: 1,
            ndim: if shaped { it.shape.len() as c_int } else { 1 },
            format,
            shape: list(shaped, &it.shape),
            strides: list(asks(ffi::PyBUF_STRIDES), &it.strides),
            suboffsets: ptr::null_mut(),
            internal: ptr::null_mut(),
        };
        // Benefit: buffers of every format are read in the sender's memory, in place.
        // SAFETY: `view` comes from the interpreter, which wants it to be filled. The bytes stay where
        // they are as long as `slf` has its own view of them, and so do the lists, because the class is
        // frozen; `slf` lives as long as the view, which has a reference to it. That format, shape and
        // strides stay within the bytes was checked when it was made, and the view is read-only.
        unsafe { view.write(filled) };
        Ok(())
    }
}

/// A read-only view of what has arrived: elements of `itemsize` bytes, in the order of C or of Fortran.
/// Whether elements of that format have that size is for the caller to check.
///
/// # Errors
///
/// If there are not exactly as many bytes.
#[pyfunction]
pub(crate) fn shaped<'py>(
    data: &Bound<'py, PyAny>,
    format: &str,
    shape: Vec<isize>,
    itemsize: isize,
    fortran: bool,
) -> PyResult<Bound<'py, PyMemoryView>> {
    let shaped = Bound::new(data.py(), Shaped::of(data, format, shape, itemsize, fortran)?)?;
    PyMemoryView::from(shaped.as_any())
}

/// Copies the bytes of an object that lie in a row, in whatever order of dimensions. Other threads run meanwhile, as while
/// NumPy copies. Returns whether the object has a buffer of as many bytes; if not, nothing was copied.
pub(crate) fn copy_in_a_row(from: &Bound<'_, PyAny>, to: &mut [u8]) -> bool {
    // NumPy gives no buffer of some arrays, as of times.
    let Ok(buffer) = PyUntypedBuffer::get(from) else { return false };
    let in_a_row = buffer.is_c_contiguous() || buffer.is_fortran_contiguous();
    if !in_a_row || buffer.len_bytes() != to.len() || to.is_empty() {
        return false;
    }
    // SAFETY: by the protocol, the bytes stay where they are as long as there is the buffer, which ends after the copy. A
    // thread that writes to an array while it is sent gets a mixture, as it does where NumPy copies: bytes of any value.
    let bytes = unsafe { std::slice::from_raw_parts(buffer.buf_ptr().cast::<u8>(), to.len()) };
    from.py().detach(|| hprm::copy_value(to, bytes));
    true
}

/// Memory for the bytes of a value that is being encoded.
pub(crate) enum Draft {
    /// In the own store.
    Loan(WritableLoan),
    /// In the message.
    Inline(Vec<u8>),
}

impl Draft {
    /// The bytes.
    pub(crate) fn bytes_mut(&mut self) -> &mut [u8] {
        match self {
            Self::Loan(loan) => loan,
            Self::Inline(bytes) => bytes,
        }
    }
}

/// Lends a [`Draft`] to Python, which writes into it, and takes it back.
#[pyclass(frozen, module = "hprm._hprm")]
pub(crate) struct Staging(Mutex<Option<Draft>>);

impl Staging {
    /// Lends `draft` to `write`, as an object with a writable buffer.
    ///
    /// # Errors
    ///
    /// What `write` returns; or if it keeps a reference to the object or to a view of it, because
    /// then the bytes could still change.
    pub(crate) fn lend<'py>(
        py: Python<'py>,
        draft: Draft,
        write: impl FnOnce(&Bound<'py, PyAny>) -> PyResult<()>,
    ) -> PyResult<Draft> {
        let staging = Bound::new(py, Self(Mutex::new(Some(draft))))?;
        write(staging.as_any())?;
        // Code with a pointer to the memory has a reference to this object: a view by the rules
        // of the protocol, an array because it keeps the object as its base.
        if count(&staging) != 1 {
            return Err(PyRuntimeError::new_err("the memory of a message is still being written"));
        }
        let draft = staging.get().0.lock().unwrap_or_else(PoisonError::into_inner).take();
        Ok(draft.expect("only this function takes the draft"))
    }
}

#[pymethods]
impl Staging {
    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        let mut draft = slf.get().0.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(draft) = draft.as_mut() else {
            return Err(PyBufferError::new_err("the memory of a message was sent and is closed"));
        };
        let bytes = draft.bytes_mut();
        let (start, len) = (bytes.as_mut_ptr(), bytes.len());
        // Benefit: an array of any layout is gathered straight into the store, in one copy.
        // SAFETY: `view` comes from the interpreter, and we are attached to it. The bytes lie on
        // the heap or in a segment, so they do not move with the draft, and `slf`, to which the view
        // keeps a reference, owns them. `lend` takes them out only when it has the only reference to
        // `slf`, so no view outlives the draft; and Rust does not touch them before that.
        unsafe { fill(&slf, view, start, len, false, flags) }
    }
}

/// Describes `len` bytes at `start` to the interpreter, as owned by `owner`.
///
/// # Safety
///
/// Attached to the interpreter; `view` is valid to write; the bytes are valid, and if writable then
/// only accessed through views, as long as there is a reference to `owner`.
unsafe fn fill<T>(
    owner: &Bound<'_, T>,
    view: *mut ffi::Py_buffer,
    start: *mut u8,
    len: usize,
    readonly: bool,
    flags: c_int,
) -> PyResult<()> {
    let len = ffi::Py_ssize_t::try_from(len)
        .map_err(|_| PyBufferError::new_err("more bytes than an address space holds"))?;
    // SAFETY: by the contract above; the function checks `flags` itself, and takes a reference to
    // the owner.
    let status = unsafe {
        ffi::PyBuffer_FillInfo(
            view,
            owner.as_ptr(),
            start.cast(),
            len,
            c_int::from(readonly),
            flags,
        )
    };
    if status == 0 { Ok(()) } else { Err(PyErr::fetch(owner.py())) }
}
