//! Which types can travel from one federate to another.

use std::sync::Arc;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{DecodeError, EncodeError};
use crate::memory::{Draft, Memory};
use crate::{alone, decode, encode};

/// A value that can travel to another process.
///
/// Every type is one that can be cloned, borrows nothing, and derives `serde::Serialize` and
/// `serde::Deserialize`:
///
/// ```
/// #[derive(Clone, serde::Serialize, serde::Deserialize)]
/// struct Pose {
///     x: f64,
///     labels: Vec<String>,
/// }
///
/// fn travels<T: hprm_codec::Transfer>() {}
/// travels::<Pose>();
/// ```
///
/// ```compile_fail,E0277
/// #[derive(Clone)]
/// struct Pose;
///
/// fn travels<T: hprm_codec::Transfer>() {}
/// travels::<Pose>();
/// ```
#[diagnostic::on_unimplemented(
    message = "values of the type `{Self}` cannot travel to another federate",
    label = "this type cannot be encoded and decoded",
    note = "put `#[derive(Clone, serde::Serialize, serde::Deserialize)]` above `{Self}`, or above the types that it \
            holds; it must hold no reference, and nothing that belongs to one thread, such as `Rc`",
    note = "large data is best an `hprm::Array`, which is not copied"
)]
pub trait Transfer: Clone + Send + Sync + 'static + Serialize + DeserializeOwned {}

#[diagnostic::do_not_recommend]
impl<T: Clone + Send + Sync + 'static + Serialize + DeserializeOwned> Transfer for T {}

/// Encodes a whole value, as [`encode`] does; small arrays take less time.
///
/// # Errors
///
/// As [`encode`].
pub fn send<T: Transfer>(value: &T) -> Result<Draft, EncodeError> {
    alone::encode(value).map_or_else(|| encode(value), Ok)
}

/// Decodes a whole value, as [`decode`] does; small arrays take less time.
///
/// # Errors
///
/// As [`decode`].
pub fn receive<T: Transfer>(head: &[u8], parts: &[Arc<dyn Memory>]) -> Result<T, DecodeError> {
    let made = if parts.is_empty() { alone::decode(head) } else { None };
    made.map_or_else(|| decode(head, parts), Ok)
}
