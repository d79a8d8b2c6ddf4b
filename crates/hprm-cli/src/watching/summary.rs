//! What an array is like: its type, its shape, its range, and its first elements.

use hprm::DynamicArray;

use super::value::float;

/// What is told of an array.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Summary<'a> {
    /// As NumPy calls it.
    pub(super) dtype: &'static str,
    pub(super) shape: &'a [usize],
    /// None if no element is a number, or if they have no order.
    pub(super) range: Option<Range>,
    /// How many elements are not a number.
    pub(super) not_numbers: usize,
    /// The first elements, as text.
    pub(super) first: Vec<String>,
    /// How many elements there are.
    pub(super) len: usize,
}

/// The range of the elements that are numbers.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Range {
    pub(super) min: String,
    pub(super) max: String,
    pub(super) mean: f64,
}

/// An element of an array that has an order.
trait Number: Copy + PartialOrd {
    fn as_f64(self) -> f64;
    fn text(self) -> String;
}

macro_rules! integers {
    ($($type:ty),*) => {$(
        impl Number for $type {
            #[allow(clippy::cast_precision_loss, clippy::cast_lossless, reason = "for a mean")]
            fn as_f64(self) -> f64 {
                self as f64
            }
            fn text(self) -> String {
                self.to_string()
            }
        }
    )*};
}

integers!(i8, i16, i32, i64, u8, u16, u32, u64);

impl Number for f32 {
    fn as_f64(self) -> f64 {
        self.into()
    }
    fn text(self) -> String {
        // Not as a number of more digits, which it would be as an f64.
        if self.is_finite() { format!("{self:?}") } else { float(self.into()) }
    }
}

impl Number for f64 {
    fn as_f64(self) -> f64 {
        self
    }
    fn text(self) -> String {
        float(self)
    }
}

impl Number for bool {
    fn as_f64(self) -> f64 {
        f64::from(u8::from(self))
    }
    fn text(self) -> String {
        if self { "True" } else { "False" }.to_owned()
    }
}

impl<'a> Summary<'a> {
    /// The summary of an array, with so many elements.
    pub(super) fn of(array: &'a DynamicArray, elements: usize) -> Self {
        macro_rules! of {
            ($($kind:ident $name:literal),*; $($complex:ident $complex_name:literal),*) => {
                match array {
                    $(DynamicArray::$kind(it) => ($name, numbers(it.as_slice(), elements)),)*
                    $(DynamicArray::$complex(it) => {
                        let text = |[re, im]: &[_; 2]| complex(f64::from(*re), f64::from(*im));
                        let first = it.as_slice().iter().take(elements).map(text).collect();
                        ($complex_name, (None, 0, first, it.as_slice().len()))
                    })*
                    _ => ("?", (None, 0, Vec::new(), array.shape().iter().product())),
                }
            };
        }
        let (dtype, (range, not_numbers, first, len)) = of!(
            Bool "bool", I8 "int8", I16 "int16", I32 "int32", I64 "int64", U8 "uint8", U16 "uint16",
            U32 "uint32", U64 "uint64", F32 "float32", F64 "float64";
            C32 "complex64", C64 "complex128"
        );
        Self { dtype, shape: array.shape(), range, not_numbers, first, len }
    }
}

/// The range, how many are not a number, the first ones as text, and how many there are.
fn numbers<T: Number>(all: &[T], elements: usize) -> (Option<Range>, usize, Vec<String>, usize) {
    let (mut range, mut sum, mut count) = (None::<(T, T)>, 0.0, 0_usize);
    for number in all {
        // What does not equal itself is not a number.
        if number.partial_cmp(number).is_none() {
            continue;
        }
        let (min, max) = range.get_or_insert((*number, *number));
        *min = if *number < *min { *number } else { *min };
        *max = if *number > *max { *number } else { *max };
        sum += number.as_f64();
        count += 1;
    }
    #[expect(clippy::cast_precision_loss, reason = "no array is so large")]
    let range = range.map(|(min, max)| Range {
        min: min.text(),
        max: max.text(),
        mean: sum / count as f64,
    });
    (range, all.len() - count, all.iter().take(elements).map(|it| it.text()).collect(), all.len())
}

fn complex(re: f64, im: f64) -> String {
    let sign = if im.is_sign_negative() { "" } else { "+" };
    format!("({}{sign}{}j)", float(re), float(im))
}
