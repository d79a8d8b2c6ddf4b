//! Large buffers: what the caller places when it sends a value, and where a received value reads them.
//!
//! The codec knows only that there are bytes that stay where they are. Whether these are memory of a process, an
//! object of a store or a loan of one is known to the caller, which implements [`Memory`] for them.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

/// Bytes that can be read for as long as they are shared.
pub trait Memory: Any + Send + Sync {
    /// The bytes: always the same ones, at the same address.
    fn bytes(&self) -> &[u8];
}

impl Memory for Vec<u8> {
    fn bytes(&self) -> &[u8] {
        self
    }
}

impl dyn Memory {
    /// The memory itself, if it is of that type.
    #[must_use]
    pub fn downcast_ref<M: Memory>(&self) -> Option<&M> {
        (self as &dyn Any).downcast_ref()
    }

    /// The memory itself, if it is of that type; otherwise the same handle again.
    ///
    /// # Errors
    ///
    /// If it is of another type.
    pub fn downcast<M: Memory>(self: Arc<Self>) -> Result<Arc<M>, Arc<Self>> {
        if self.downcast_ref::<M>().is_none() {
            return Err(self);
        }
        let any: Arc<dyn Any + Send + Sync> = self;
        Ok(any.downcast().expect("the type has just been compared"))
    }
}

impl fmt::Debug for dyn Memory {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Memory({} bytes)", self.bytes().len())
    }
}

/// A large buffer of an encoded value, which the caller places.
#[derive(Clone, Debug)]
pub enum Source {
    /// Bytes that are the value's own: text, bytes, or a head that is too large to travel in a message.
    Bytes(Vec<u8>),
    /// The memory of an array. It may be in a store already, and then needs no copy.
    Memory(Arc<dyn Memory>),
}

impl Source {
    /// The bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        match self {
            Self::Bytes(bytes) => bytes,
            Self::Memory(memory) => memory.bytes(),
        }
    }

    /// The bytes as memory, which a receiver in the same process can read where it is.
    #[must_use]
    pub fn into_memory(self) -> Arc<dyn Memory> {
        match self {
            Self::Bytes(bytes) => Arc::new(bytes),
            Self::Memory(memory) => memory,
        }
    }
}

/// A value as a head and large buffers that are not copied yet.
#[derive(Clone, Debug)]
pub struct Draft {
    /// The structure of the value, and the small things in it.
    pub head: Vec<u8>,
    /// The large buffers, in the order of the payload's parts.
    pub parts: Vec<Source>,
}
