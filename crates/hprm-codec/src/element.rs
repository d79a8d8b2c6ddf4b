//! What the elements of an array may be, and NumPy's names of their types.

use std::fmt;

use bytemuck::NoUninit;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The type of an array's elements.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Dtype {
    /// `bool`.
    Bool,
    /// `i8`.
    I8,
    /// `i16`.
    I16,
    /// `i32`.
    I32,
    /// `i64`.
    I64,
    /// `u8`.
    U8,
    /// `u16`.
    U16,
    /// `u32`.
    U32,
    /// `u64`.
    U64,
    /// `f32`.
    F32,
    /// `f64`.
    F64,
    /// `[f32; 2]`: a complex number.
    C32,
    /// `[f64; 2]`: a complex number.
    C64,
}

/// All of them.
const DTYPES: [Dtype; 13] = [
    Dtype::Bool,
    Dtype::I8,
    Dtype::I16,
    Dtype::I32,
    Dtype::I64,
    Dtype::U8,
    Dtype::U16,
    Dtype::U32,
    Dtype::U64,
    Dtype::F32,
    Dtype::F64,
    Dtype::C32,
    Dtype::C64,
];

/// Picks the name for the byte order of this machine.
macro_rules! native {
    ($name:literal) => {
        if cfg!(target_endian = "little") { concat!("<", $name) } else { concat!(">", $name) }
    };
}

impl Dtype {
    /// NumPy's short name of it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bool => "|b1",
            Self::I8 => "|i1",
            Self::I16 => native!("i2"),
            Self::I32 => native!("i4"),
            Self::I64 => native!("i8"),
            Self::U8 => "|u1",
            Self::U16 => native!("u2"),
            Self::U32 => native!("u4"),
            Self::U64 => native!("u8"),
            Self::F32 => native!("f4"),
            Self::F64 => native!("f8"),
            Self::C32 => native!("c8"),
            Self::C64 => native!("c16"),
        }
    }

    /// The type of that name, in the byte order of this machine.
    #[must_use]
    pub fn of(name: &[u8]) -> Option<Self> {
        DTYPES.into_iter().find(|dtype| dtype.name().as_bytes() == name)
    }

    /// The length of an element in bytes.
    #[must_use]
    pub fn size(self) -> usize {
        match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 | Self::C32 => 8,
            Self::C64 => 16,
        }
    }
}

impl fmt::Display for Dtype {
    /// As Rust calls it.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Bool => "bool",
            Self::I8 => "i8",
            Self::I16 => "i16",
            Self::I32 => "i32",
            Self::I64 => "i64",
            Self::U8 => "u8",
            Self::U16 => "u16",
            Self::U32 => "u32",
            Self::U64 => "u64",
            Self::F32 => "f32",
            Self::F64 => "f64",
            Self::C32 => "[f32; 2]",
            Self::C64 => "[f64; 2]",
        })
    }
}

mod sealed {
    pub trait Sealed {}
}

/// What the elements of an [`Array`](crate::Array) may be: `bool`, the integers from `i8` to `u64`, `f32`, `f64`,
/// and `[f32; 2]` and `[f64; 2]` for complex numbers. [`Array`](crate::Array) has an example.
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot be an element of an `Array`",
    note = "elements are bool, i8 to i64, u8 to u64, f32, f64, and [f32; 2] or [f64; 2] for complex numbers; \
            send a `Vec` of anything else"
)]
pub trait Element:
    Copy + PartialEq + Send + Sync + 'static + NoUninit + Serialize + DeserializeOwned + sealed::Sealed
{
    /// Its type.
    const DTYPE: Dtype;

    /// The elements that these bytes are, in place; none if the bytes are not aligned, or may be none.
    #[doc(hidden)]
    fn view(bytes: &[u8]) -> Option<&[Self]>;

    /// A copy of the elements that these bytes are. What does not fill an element is left out.
    #[doc(hidden)]
    fn copy(bytes: &[u8]) -> Vec<Self>;
}

macro_rules! elements {
    ($($element:ty => $dtype:ident),* $(,)?) => {
        $(
            impl sealed::Sealed for $element {}

            impl Element for $element {
                const DTYPE: Dtype = Dtype::$dtype;

                fn view(bytes: &[u8]) -> Option<&[Self]> {
                    bytemuck::try_cast_slice(bytes).ok()
                }

                fn copy(bytes: &[u8]) -> Vec<Self> {
                    // Nothing is zeroed first: most allocators keep less memory at hand for that.
                    match Self::view(bytes) {
                        Some(elements) => elements.to_vec(),
                        None => {
                            let elements = bytes.chunks_exact(size_of::<Self>());
                            elements.map(bytemuck::pod_read_unaligned).collect()
                        }
                    }
                }
            }
        )*
    };
}

elements! {
    i8 => I8, i16 => I16, i32 => I32, i64 => I64,
    u8 => U8, u16 => U16, u32 => U32, u64 => U64,
    f32 => F32, f64 => F64, [f32; 2] => C32, [f64; 2] => C64,
}

impl sealed::Sealed for bool {}

impl Element for bool {
    const DTYPE: Dtype = Dtype::Bool;

    /// Not every byte is a `bool`, so these are always copied.
    fn view(_: &[u8]) -> Option<&[Self]> {
        None
    }

    fn copy(bytes: &[u8]) -> Vec<Self> {
        bytes.iter().map(|byte| *byte != 0).collect()
    }
}
