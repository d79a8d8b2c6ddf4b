//! Arrays that are written where they will be read: in the object store of this federate.

use std::ops::{Deref, DerefMut};
use std::sync::Arc;

use bytemuck::Pod;
use hprm_codec::{Array, Element};
use hprm_core::limits::INLINE_LIMIT;
use hprm_store::{LoanOf, StoreAllocator};

use super::transport::InStore;

/// An array that is being written, and is sent without a copy: see [`Context::loan`](crate::Context::loan).
///
/// It dereferences to the slice of its elements, in the order of C. [`Array::from`] makes a value of it, which cannot be
/// written any more. If it is dropped instead, its memory is free again.
///
/// ```
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Camera");
/// program.reactor("camera", (), |camera| {
///     let image = camera.output("image");
///     camera.reaction().on(Startup).sets(image).run(move |(), ctx| {
///         let mut pixels: Loan<u8> = ctx.loan(&[1080, 1920, 3]);
///         pixels.fill(7);
///         ctx.set(image, Array::from(pixels));
///     });
/// });
/// # program.run().unwrap();
/// ```
#[must_use = "dropping a loan gives its memory back"]
pub struct Loan<T: Element + Pod> {
    memory: Memory<T>,
    shape: Box<[usize]>,
}

enum Memory<T: Element + Pod> {
    Store(LoanOf<T>, Arc<StoreAllocator>),
    /// If it is small, if there is no other federate, or if the store has no room.
    Heap(Vec<T>),
}

impl<T: Element + Pod> Loan<T> {
    pub(super) fn new(allocator: Option<&Arc<StoreAllocator>>, shape: &[usize]) -> Self {
        let count = count_of::<T>(shape);
        let large = count.saturating_mul(size_of::<T>()) > INLINE_LIMIT;
        let loaned = allocator.filter(|_| large).and_then(|allocator| {
            let loan = allocator.store().loan_of::<T>(count).ok()?;
            Some(Memory::Store(loan, Arc::clone(allocator)))
        });
        let memory = loaned.unwrap_or_else(|| Memory::Heap(on_heap(count, shape)));
        Self { memory, shape: shape.into() }
    }

    /// The length of each dimension.
    #[must_use]
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }
}

/// How many elements an array of that shape has.
fn count_of<T>(shape: &[usize]) -> usize {
    if shape.contains(&0) {
        return 0;
    }
    let count = shape.iter().try_fold(1_usize, |product, length| product.checked_mul(*length));
    let bytes = count.and_then(|count| count.checked_mul(size_of::<T>()));
    match (count, bytes.and_then(|bytes| isize::try_from(bytes).ok())) {
        (Some(count), Some(_)) => count,
        _ => panic!("an array of the shape {shape:?} is larger than all memory"),
    }
}

/// Elements of an array of that shape, in memory of this process.
fn on_heap<T: Pod>(count: usize, shape: &[usize]) -> Vec<T> {
    match bytemuck::allocation::try_zeroed_slice_box(count) {
        Ok(elements) => elements.into_vec(),
        Err(()) => panic!(
            "there is no memory for an array of the shape {shape:?}, which has {} bytes",
            count * size_of::<T>()
        ),
    }
}

impl<T: Element + Pod> Deref for Loan<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match &self.memory {
            Memory::Store(loan, _) => loan,
            Memory::Heap(elements) => elements,
        }
    }
}

impl<T: Element + Pod> DerefMut for Loan<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.memory {
            Memory::Store(loan, _) => loan,
            Memory::Heap(elements) => elements,
        }
    }
}

impl<T: Element + Pod> From<Loan<T>> for Array<T> {
    fn from(loan: Loan<T>) -> Self {
        let Loan { memory, shape } = loan;
        let array = match memory {
            Memory::Store(loan, allocator) => {
                let object = allocator.store().publish(loan);
                Self::from_memory(Arc::new(InStore(object)), &shape)
            }
            Memory::Heap(elements) => Self::from_shape_vec(&shape, elements),
        };
        array.expect("a loan has as many elements as its shape")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_array_without_elements_may_be_long_in_other_dimensions() {
        assert_eq!(count_of::<u64>(&[usize::MAX, 2, 0]), 0);
        assert_eq!(count_of::<u64>(&[]), 1);
    }

    #[test]
    #[should_panic(
        expected = "there is no memory for an array of the shape [70368744177664, 2], which has 140737488355328 bytes"
    )]
    fn an_array_for_which_there_is_no_memory_is_named_by_its_shape() {
        let _ = Loan::<u8>::new(None, &[1 << 46, 2]);
    }

    #[test]
    #[should_panic(
        expected = "an array of the shape [4611686018427387904] is larger than all memory"
    )]
    fn an_array_is_not_larger_than_all_memory() {
        count_of::<u64>(&[1 << 62]);
    }
}
