//! Values of any type in one scheduler.
//!
//! The scheduler of a program has one type of values. So what ports and actions hold is erased, and read back by a
//! handle that knows the type. That the two agree is up to the handles, which the compiler checks.
//!
//! A scheduler moves values often, and its events are as large as its values can be. So a [`Value`] has two words:
//! numbers are in place, other small values in boxes of one size, which are used again, and large ones are shared.

use std::any::{Any, TypeId};
use std::cell::RefCell;
use std::slice;
use std::sync::Arc;

use bytemuck::{Pod, cast_slice, cast_slice_mut};
use smallbox::{SmallBox, smallbox};

/// What a port or an action can hold: any type that can be copied and read by several threads.
///
/// Implemented for all such types. A value of up to eight words needs no memory from the allocator, apart from what it
/// points to; a larger one is stored once, and its readers share it.
///
/// ```
/// use hprm::prelude::*;
///
/// #[derive(Clone)]
/// struct Pose {
///     x: f32,
///     y: f32,
/// }
///
/// fn is_message<T: Message>() {}
/// is_message::<Pose>();
/// is_message::<Vec<Pose>>();
/// ```
pub trait Message: Clone + Send + Sync + 'static {}

impl<T: Clone + Send + Sync + 'static> Message for T {}

/// How many empty boxes a thread keeps.
const SPARE_BOXES: usize = 1024;

thread_local! {
    /// Empty boxes, to be used again.
    #[allow(clippy::vec_box, reason = "the boxes are what is kept")]
    static SPARE: RefCell<Vec<Box<Content>>> = const { RefCell::new(Vec::new()) };
}

/// The room in a box: eight words, which a pose or a twist has at most, and one for the place of an event that another
/// thread has scheduled.
type Space = [usize; 9];

/// What is in a box; nothing while the box is spare.
type Content = Option<SmallBox<dyn Erased, Space>>;

trait Erased: Any + Send + Sync {
    fn duplicate(&self) -> SmallBox<dyn Erased, Space>;
}

impl<T: Message> Erased for T {
    fn duplicate(&self) -> SmallBox<dyn Erased, Space> {
        smallbox!(self.clone())
    }
}

macro_rules! values {
    ($($kind:ident($number:ty))*) => {
        /// A value whose type only its handle knows. All but boxes are bits of one word, so that the processor passes
        /// a value in two registers.
        #[derive(Clone)]
        pub enum Value {
            Nothing,
            Bool(u64),
            $($kind(u64),)*
            Boxed(Boxed),
        }

        impl Value {
            // What looks like a search is none: the compiler knows which type `T` is.
            #[inline]
            pub(super) fn new<T: Message>(value: T) -> Self {
                let any: &dyn Any = &value;
                if any.is::<()>() {
                    return Self::Nothing;
                }
                if let Some(is) = any.downcast_ref::<bool>() {
                    return Self::Bool(u64::from(*is));
                }
                $(if let Some(number) = any.downcast_ref::<$number>() {
                    return Self::$kind(bits(*number));
                })*
                Self::Boxed(Boxed::new(value))
            }

            /// What tells the type of a value that is in a box: [`stored_type`].
            pub(super) fn stored_type(&self) -> Option<TypeId> {
                match self {
                    Self::Boxed(boxed) => boxed.content().map(|content| (&**content as &dyn Any).type_id()),
                    _ => None,
                }
            }

            /// The value, if it has this type.
            #[inline]
            pub(super) fn get<T: Message>(&self) -> Option<&T> {
                match self {
                    Self::Nothing => (&() as &dyn Any).downcast_ref(),
                    Self::Bool(0) => (&false as &dyn Any).downcast_ref(),
                    Self::Bool(_) => (&true as &dyn Any).downcast_ref(),
                    $(Self::$kind(bits) => (number::<$number>(bits) as &dyn Any).downcast_ref(),)*
                    Self::Boxed(boxed) => boxed.get(),
                }
            }
        }
    };
}

values! {
    U8(u8) U16(u16) U32(u32) U64(u64) Usize(usize) I8(i8) I16(i16) I32(i32) I64(i64) Isize(isize) F32(f32) F64(f64)
}

/// A word whose first bytes are those of the number.
#[inline]
fn bits<N: Pod>(number: N) -> u64 {
    let mut bits = 0;
    cast_slice_mut::<u64, N>(slice::from_mut(&mut bits))[0] = number;
    bits
}

/// The number whose bytes are the first of a word.
#[inline]
fn number<N: Pod>(bits: &u64) -> &N {
    &cast_slice::<u64, N>(slice::from_ref(bits))[0]
}

/// A value in a box that is used again; none only while it is dropped.
pub struct Boxed(Option<Box<Content>>);

impl Boxed {
    // The value is written into the box at once. To move it there piece by piece would take longer than all the rest.
    #[inline]
    fn new<T: Message>(value: T) -> Self {
        let mut boxed = spare();
        *boxed = Some(match is_small::<T>() {
            true => smallbox!(value),
            false => smallbox!(Arc::new(value)),
        });
        Self(Some(boxed))
    }

    fn get<T: Message>(&self) -> Option<&T> {
        let any: &dyn Any = &**self.content()?;
        if is_small::<T>() {
            any.downcast_ref()
        } else {
            any.downcast_ref::<Arc<T>>().map(|shared| &**shared)
        }
    }

    fn content(&self) -> Option<&SmallBox<dyn Erased, Space>> {
        self.0.as_deref()?.as_ref()
    }
}

impl Clone for Boxed {
    #[inline(never)]
    fn clone(&self) -> Self {
        let Some(content) = self.content() else { return Self(None) };
        let mut boxed = spare();
        *boxed = Some((**content).duplicate());
        Self(Some(boxed))
    }
}

impl Drop for Boxed {
    // Inline as far as a number goes, which has no box.
    #[inline(always)]
    fn drop(&mut self) {
        if let Some(boxed) = self.0.take() {
            recycle(boxed);
        }
    }
}

/// An empty box.
#[inline(never)]
fn spare() -> Box<Content> {
    let spare = SPARE.try_with(|spare| spare.borrow_mut().pop()).ok().flatten();
    spare.unwrap_or_default()
}

/// Drops what is in a box, and keeps the box.
#[inline(never)]
fn recycle(mut boxed: Box<Content>) {
    *boxed = None;
    // A thread that ends keeps no boxes.
    let _ = SPARE.try_with(|spare| {
        let mut spare = spare.borrow_mut();
        if spare.len() < SPARE_BOXES {
            spare.push(boxed);
        }
    });
}

/// What [`Value::stored_type`] is for values of this type.
pub(super) fn stored_type<T: Message>() -> TypeId {
    if is_small::<T>() { TypeId::of::<T>() } else { TypeId::of::<Arc<T>>() }
}

/// Whether a value has room in a box.
const fn is_small<T>() -> bool {
    size_of::<T>() <= size_of::<Space>() && align_of::<T>() <= align_of::<Space>()
}

#[cfg(test)]
mod tests {
    use allocation_counter::measure;
    use hprm_codec::Array;

    use super::*;

    #[test]
    fn small_values_are_stored_in_boxes_that_are_used_again() {
        assert_eq!(size_of::<Option<Value>>(), 16);
        drop([Value::new(""), Value::new("")]);
        let counted = measure(|| {
            assert_eq!(Value::new(7_i16).clone().get(), Some(&7_i16));
            assert_eq!(Value::new(7_i16).get::<u16>(), None);
            assert_eq!(Value::new(-1.5_f32).get(), Some(&-1.5_f32));
            assert_eq!(Value::new(u64::MAX).get(), Some(&u64::MAX));
            assert_eq!(Value::new(-3_i8).get(), Some(&-3_i8));
            assert_eq!([true, false].map(|b| Value::new(b).get() == Some(&b)), [true, true]);
            assert_eq!(Value::new(()).get(), Some(&()));
            let value = Value::new((1_u64, 2.0_f64, 3_i64));
            assert_eq!(value.clone().get(), Some(&(1_u64, 2.0_f64, 3_i64)));
            assert_eq!(value.get::<u64>(), None);
        });
        assert_eq!(counted.count_total, 0);
        let array = Array::from(vec![1.5_f64; 8]);
        let counted = measure(|| {
            assert_eq!(Value::new(array.clone()).clone().get(), Some(&array));
        });
        assert_eq!(counted.count_total, 0);
    }

    #[test]
    fn large_values_are_stored_once() {
        drop([const { "" }; 10].map(Value::new));
        let counted = measure(|| {
            let value = Value::new([7_u8; 1000]);
            let copies: [Value; 8] = std::array::from_fn(|_| value.clone());
            assert!(copies.iter().all(|copy| copy.get() == Some(&[7_u8; 1000])));
        });
        assert_eq!(counted.count_total, 1);
    }

    #[test]
    fn a_value_is_dropped_once() {
        let alive = Arc::new(());
        let values = [Value::new(Arc::clone(&alive)), Value::new((Arc::clone(&alive), [0; 9]))];
        assert_eq!(Arc::strong_count(&alive), 3);
        drop(values.clone());
        assert_eq!(Arc::strong_count(&alive), 3);
        drop(values);
        assert_eq!(Arc::strong_count(&alive), 1);
    }
}
