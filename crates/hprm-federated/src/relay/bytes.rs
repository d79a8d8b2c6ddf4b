//! Bytes that several hold without a copy: a frame is long, and until the other end has it, it may leave again.

use std::fmt;
use std::ops::Deref;
use std::sync::Arc;

/// See the module.
#[derive(Clone)]
pub struct Bytes {
    whole: Arc<Vec<u8>>,
    /// What is before them there, a header perhaps.
    from: usize,
}

impl Bytes {
    /// Those after so many others.
    pub(super) fn behind(whole: Vec<u8>, from: usize) -> Self {
        Self { from: from.min(whole.len()), whole: Arc::new(whole) }
    }
}

impl From<Vec<u8>> for Bytes {
    fn from(whole: Vec<u8>) -> Self {
        Self::behind(whole, 0)
    }
}

impl Deref for Bytes {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &self.whole[self.from..]
    }
}

impl AsRef<[u8]> for Bytes {
    fn as_ref(&self) -> &[u8] {
        self
    }
}

impl PartialEq for Bytes {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl Eq for Bytes {}

impl std::hash::Hash for Bytes {
    fn hash<H: std::hash::Hasher>(&self, state: &mut H) {
        (**self).hash(state);
    }
}

impl fmt::Debug for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}
