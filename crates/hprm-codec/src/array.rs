//! Arrays of any number of dimensions: what Python knows as those of NumPy.
//!
//! An array is a shape and elements in the order of C: the last index varies fastest. The elements are in a vector,
//! or in memory that is shared, where they are read in place. All of that is in one place that clones share, so that an
//! array is one word wherever it is moved. How an array is encoded is decided in `encode` and
//! `decode`; what it is for serde is in `array/transfer.rs`.

mod transfer;

use std::fmt;
use std::ops::Deref;
use std::sync::Arc;

use crate::element::Element;
use crate::memory::Memory;
use crate::slot::{IncomingArray, Shape};

/// An array of any number of dimensions. To clone it costs nothing: clones share the elements.
///
/// It dereferences to the slice of its elements, in the order of C: of two dimensions, row by row.
///
/// ```
/// use hprm_codec::Array;
///
/// let image = Array::from_shape_vec(&[2, 3], vec![1_u8, 2, 3, 4, 5, 6])?;
/// assert_eq!(image.get(&[1, 0]), Some(&4));
/// assert_eq!(image.iter().copied().max(), Some(6));
/// # Ok::<_, hprm_codec::ShapeError>(())
/// ```
#[derive(Clone)]
pub struct Array<T: Element>(Arc<Content<T>>);

/// What clones share.
#[derive(Clone)]
struct Content<T: Element> {
    shape: Shape,
    storage: Storage<T>,
}

#[derive(Clone)]
enum Storage<T: Element> {
    Heap(Vec<T>),
    /// Those of an array of another shape, which has them in a vector.
    Reshaped(Arc<Content<T>>),
    /// Bytes that have been seen to be elements in place.
    Memory(Arc<dyn Memory>),
}

impl<T: Element> Memory for Content<T> {
    fn bytes(&self) -> &[u8] {
        match &self.storage {
            Storage::Heap(elements) => bytemuck::cast_slice(elements),
            Storage::Reshaped(other) => other.bytes(),
            Storage::Memory(memory) => memory.bytes(),
        }
    }
}

impl<T: Element> Content<T> {
    fn elements(&self) -> &[T] {
        match &self.storage {
            Storage::Heap(elements) => elements,
            Storage::Reshaped(other) => other.elements(),
            Storage::Memory(memory) => {
                T::view(memory.bytes()).expect("the memory stays where it is")
            }
        }
    }
}

/// An array cannot have that shape, because it has another number of elements.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("the shape {shape:?} of elements of {size} bytes each does not fit {found}")]
pub struct ShapeError {
    shape: Vec<usize>,
    size: usize,
    found: String,
}

impl ShapeError {
    fn new<T>(shape: &[usize], found: String) -> Self {
        Self { shape: shape.to_vec(), size: size_of::<T>(), found }
    }
}

/// How many elements an array of that shape has; none if they cannot be counted.
pub(crate) fn elements_in(shape: &[usize]) -> Option<usize> {
    if shape.contains(&0) {
        return Some(0);
    }
    shape.iter().try_fold(1_usize, |product, length| product.checked_mul(*length))
}

impl<T: Element> Array<T> {
    /// The elements in that shape.
    ///
    /// # Errors
    ///
    /// If the shape has another number of elements.
    pub fn from_shape_vec(shape: &[usize], elements: Vec<T>) -> Result<Self, ShapeError> {
        if elements_in(shape) != Some(elements.len()) {
            return Err(ShapeError::new::<T>(shape, format!("{} elements", elements.len())));
        }
        Ok(Self::of(Shape::from_slice(shape), elements))
    }

    /// The elements in a shape that has as many.
    pub(crate) fn of(shape: Shape, elements: Vec<T>) -> Self {
        Self::new(shape, Storage::Heap(elements))
    }

    fn new(shape: Shape, storage: Storage<T>) -> Self {
        Self(Arc::new(Content { shape, storage }))
    }

    /// The elements that all bytes of `memory` are, in that shape and in the order of C. They are read in place; only
    /// if they are not aligned, or may be no elements as they are (`bool`), they are copied.
    ///
    /// # Errors
    ///
    /// If the shape needs another number of bytes.
    pub fn from_memory(memory: Arc<dyn Memory>, shape: &[usize]) -> Result<Self, ShapeError> {
        let len = memory.bytes().len();
        if elements_in(shape).and_then(|count| count.checked_mul(size_of::<T>())) != Some(len) {
            return Err(ShapeError::new::<T>(shape, format!("{len} bytes")));
        }
        let storage = match T::view(memory.bytes()) {
            Some(_) => Storage::Memory(memory),
            None => Storage::Heap(T::copy(memory.bytes())),
        };
        Ok(Self::new(Shape::from_slice(shape), storage))
    }

    /// An array of that shape whose elements are all the same.
    ///
    /// # Panics
    ///
    /// If the elements are more than there are addresses.
    #[must_use]
    pub fn filled(shape: &[usize], element: T) -> Self {
        let count = elements_in(shape).expect("an array is not larger than all memory");
        Self::of(Shape::from_slice(shape), vec![element; count])
    }

    /// The length of each dimension.
    #[must_use]
    pub fn shape(&self) -> &[usize] {
        &self.0.shape
    }

    /// The elements, in the order of C.
    ///
    /// # Panics
    ///
    /// If the memory under it has changed its address, which [`Memory`] forbids.
    #[must_use]
    pub fn as_slice(&self) -> &[T] {
        self.0.elements()
    }

    /// The element at that index, which has a number for each dimension.
    #[must_use]
    pub fn get(&self, index: &[usize]) -> Option<&T> {
        let shape = self.shape();
        if index.len() != shape.len() {
            return None;
        }
        let mut at = 0;
        for (index, length) in index.iter().zip(shape) {
            if index >= length {
                return None;
            }
            at = at * length + index;
        }
        self.as_slice().get(at)
    }

    /// The elements, to change them. They are copied first if something else refers to them, or if they lie in shared
    /// memory.
    #[must_use]
    pub fn to_mut(&mut self) -> &mut [T] {
        if !matches!(self.0.storage, Storage::Heap(_)) {
            let shape = self.0.shape.clone();
            *self = Self::of(shape, std::mem::take(self).into_vec());
        }
        match &mut Arc::make_mut(&mut self.0).storage {
            Storage::Heap(elements) => elements,
            _ => unreachable!("the elements are in a vector now"),
        }
    }

    /// The elements as a vector. They are copied if something else refers to them, or if they lie in shared memory.
    #[must_use]
    pub fn into_vec(self) -> Vec<T> {
        match Arc::try_unwrap(self.0) {
            Ok(Content { storage: Storage::Heap(elements), .. }) => elements,
            Ok(Content { storage: Storage::Reshaped(other), .. }) => Self(other).into_vec(),
            Ok(content) => content.elements().to_vec(),
            Err(shared) => shared.elements().to_vec(),
        }
    }

    /// The same elements in another shape.
    ///
    /// # Errors
    ///
    /// If the shape has another number of elements.
    pub fn reshape(&self, shape: &[usize]) -> Result<Self, ShapeError> {
        if elements_in(shape) != Some(self.len()) {
            return Err(ShapeError::new::<T>(shape, format!("{} elements", self.len())));
        }
        let storage = match &self.0.storage {
            Storage::Heap(_) => Storage::Reshaped(Arc::clone(&self.0)),
            other => other.clone(),
        };
        Ok(Self::new(Shape::from_slice(shape), storage))
    }

    /// The bytes of the elements.
    pub(crate) fn bytes(&self) -> &[u8] {
        self.0.bytes()
    }

    /// The memory of the elements.
    #[must_use]
    pub fn memory(&self) -> Arc<dyn Memory> {
        match &self.0.storage {
            Storage::Heap(_) => Arc::clone(&self.0) as Arc<dyn Memory>,
            Storage::Reshaped(other) => Arc::clone(other) as Arc<dyn Memory>,
            Storage::Memory(memory) => Arc::clone(memory),
        }
    }

    /// What has arrived; its bytes are `inline` if it has no memory.
    pub(crate) fn received(array: IncomingArray, inline: &[u8]) -> Result<Self, ShapeError> {
        let IncomingArray { shape, fortran, memory, .. } = array;
        let made = match memory {
            Some(memory) => Self::from_memory(memory, &shape)?,
            None => Self::from_shape_vec(&shape, T::copy(inline))?,
        };
        if fortran {
            let elements = in_order_of_c(made.as_slice(), &shape);
            return Ok(Self::of(shape, elements));
        }
        Ok(made)
    }
}

/// A copy of elements that lie in the order of Fortran.
fn in_order_of_c<T: Copy>(elements: &[T], shape: &[usize]) -> Vec<T> {
    if elements.is_empty() {
        // Its lengths need not have a product.
        return Vec::new();
    }
    let mut steps = Shape::new();
    let mut step = 1;
    for length in shape {
        steps.push(step);
        step *= length;
    }
    let mut index = Shape::from_elem(0, shape.len());
    let mut at = 0;
    let mut copied = Vec::with_capacity(elements.len());
    while copied.len() < elements.len() {
        copied.push(elements[at]);
        for dimension in (0..shape.len()).rev() {
            index[dimension] += 1;
            at += steps[dimension];
            if index[dimension] < shape[dimension] {
                break;
            }
            at -= steps[dimension] * shape[dimension];
            index[dimension] = 0;
        }
    }
    copied
}

impl<T: Element> Deref for Array<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        self.as_slice()
    }
}

impl<T: Element> AsRef<[T]> for Array<T> {
    fn as_ref(&self) -> &[T] {
        self
    }
}

impl<T: Element> From<Vec<T>> for Array<T> {
    /// An array of one dimension.
    fn from(elements: Vec<T>) -> Self {
        Self::of(Shape::from_slice(&[elements.len()]), elements)
    }
}

impl<T: Element> FromIterator<T> for Array<T> {
    fn from_iter<I: IntoIterator<Item = T>>(elements: I) -> Self {
        Self::from(Vec::from_iter(elements))
    }
}

impl<T: Element> Default for Array<T> {
    /// An array of one dimension without any element.
    fn default() -> Self {
        Self::from(Vec::new())
    }
}

impl<T: Element> PartialEq for Array<T> {
    fn eq(&self, other: &Self) -> bool {
        self.shape() == other.shape() && self.as_slice() == other.as_slice()
    }
}

/// How many elements of an array are shown.
const SHOWN: usize = 8;

impl<T: Element + fmt::Debug> fmt::Debug for Array<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Array<{}>{:?} ", T::DTYPE, self.shape())?;
        let mut list = formatter.debug_list();
        list.entries(self.iter().take(SHOWN));
        if self.len() > SHOWN { list.finish_non_exhaustive() } else { list.finish() }
    }
}
