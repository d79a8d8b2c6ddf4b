//! Bytes that several hold without a copy, wherever they lie: a frame is long, and until the other end has it, it may leave again.

use std::fmt;
use std::ops::{Deref, Range};
use std::sync::Arc;

/// See the module.
#[derive(Clone)]
pub struct Bytes {
    whole: Arc<dyn AsRef<[u8]> + Send + Sync>,
    /// Which of its bytes these are: before them may be a header, and behind them other frames.
    range: Range<usize>,
}

impl Bytes {
    /// All bytes of a value, wherever they lie. It must show the same ones as long as it lives.
    pub fn of(whole: impl AsRef<[u8]> + Send + Sync + 'static) -> Self {
        Self { range: 0..whole.as_ref().len(), whole: Arc::new(whole) }
    }

    /// Some of these bytes.
    ///
    /// # Panics
    ///
    /// If there are not so many.
    #[must_use]
    pub fn part(&self, range: Range<usize>) -> Self {
        assert!(range.start <= range.end && range.end <= self.len(), "a part is within the whole");
        let (start, end) = (self.range.start + range.start, self.range.start + range.end);
        Self { whole: Arc::clone(&self.whole), range: start..end }
    }
}

impl From<Vec<u8>> for Bytes {
    fn from(whole: Vec<u8>) -> Self {
        Self::of(whole)
    }
}

impl Deref for Bytes {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &(*self.whole).as_ref()[self.range.clone()]
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
