//! How an array passes through serde in one piece.
//!
//! Serde knows no arrays. So [`Array`](crate::Array) is a newtype of a name that only this crate uses, as the
//! dates of `toml` are: right before it shows itself to a serializer it lays a handle of its memory here, and
//! this crate's serializer takes that instead of the elements. Decoding goes the other way. Any other serializer sees
//! a struct of shape and elements, and what lies here is removed again.

use std::cell::Cell;
use std::sync::Arc;

use smallvec::SmallVec;

use crate::element::Dtype;
use crate::memory::Memory;

/// The name of an array's newtype.
pub(crate) const ARRAY: &str = "$hprm::Array";
/// The name of the newtype of a value whose type is not known.
pub(crate) const DYNAMIC: &str = "$hprm::Dynamic";

/// The lengths of an array's dimensions.
pub(crate) type Shape = SmallVec<[usize; 4]>;

/// An array that is being encoded.
#[derive(Debug)]
pub(crate) struct Outgoing {
    pub(crate) dtype: Dtype,
    pub(crate) shape: Shape,
    pub(crate) memory: Arc<dyn Memory>,
}

/// What kind of value is being decoded.
#[derive(Debug)]
pub(crate) enum Incoming {
    Array(IncomingArray),
    List,
    Tuple,
}

/// An array that is being decoded.
#[derive(Debug)]
pub(crate) struct IncomingArray {
    pub(crate) dtype: Dtype,
    pub(crate) shape: Shape,
    /// Whether the first index varies fastest.
    pub(crate) fortran: bool,
    /// Its memory; none if its bytes come through serde.
    pub(crate) memory: Option<Arc<dyn Memory>>,
}

thread_local! {
    static OUTGOING: Cell<Option<Outgoing>> = const { Cell::new(None) };
    static INCOMING: Cell<Option<Incoming>> = const { Cell::new(None) };
}

/// Runs `serialize` while `array` lies in the slot.
pub(crate) fn offer<R>(array: Outgoing, serialize: impl FnOnce() -> R) -> R {
    OUTGOING.set(Some(array));
    let result = serialize();
    OUTGOING.set(None);
    result
}

/// The array that lies in the slot.
pub(crate) fn accept() -> Option<Outgoing> {
    OUTGOING.take()
}

/// Runs `deserialize` while the slot tells what kind of value comes.
pub(crate) fn announce<R>(incoming: Option<Incoming>, deserialize: impl FnOnce() -> R) -> R {
    INCOMING.set(incoming);
    let result = deserialize();
    INCOMING.set(None);
    result
}

/// What kind of value comes; none if that was not announced.
pub(crate) fn announced() -> Option<Incoming> {
    INCOMING.take()
}
