//! Values as they travel between federates, without Python: the format, and serde's way in and out of it.
//!
//! [`encode`] makes a head and large buffers of any value that serde can serialize, [`decode`] makes a value of them;
//! Python federates read and write the same bytes, which `docs/reference/codec.md` specifies. An [`Array`] is never copied on
//! the way: its memory is handed to the caller, which may find it in a store already, and one that has arrived is read
//! where it lies. [`Dynamic`] is a value whose type the receiver does not know.
//!
//! ```
//! use hprm_codec::{Array, decode, encode};
//! use serde::{Deserialize, Serialize};
//!
//! #[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
//! struct Scan {
//!     angle: f64,
//!     distances: Array<f32>,
//! }
//!
//! let scan = Scan { angle: 0.5, distances: Array::from(vec![1.0, 2.5]) };
//! let draft = encode(&scan)?;
//! let parts: Vec<_> = draft.parts.into_iter().map(|part| part.into_memory()).collect();
//! assert_eq!(decode::<Scan>(&draft.head, &parts)?, scan);
//! # Ok::<_, Box<dyn std::error::Error>>(())
//! ```
//!
//! This crate is pure: it knows no store, link or file. `format` and `cursor` are the bytes; `encode` and `decode` walk
//! values, `array` and `element` are arrays, `memory` is what the caller places, `slot` is how an array passes
//! through serde in one piece, `alone` is the short way of small arrays, and `place` says where in a value something is
//! wrong.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod alone;
mod array;
pub mod cursor;
mod decode;
mod dynamic;
mod element;
mod encode;
mod error;
pub mod format;
mod memory;
mod pickle;
mod place;
mod slot;
mod transfer;

pub use array::{Array, ShapeError};
pub use decode::{decode, decode_seed, outline};
pub use dynamic::{Dynamic, DynamicArray};
pub use element::{Dtype, Element};
pub use encode::encode;
pub use error::{DecodeError, EncodeError};
pub use memory::{Draft, Memory, Source};
pub use pickle::Pickle;
pub use transfer::{Transfer, receive, send};
