//! What one process publishes in words of memory, and others read whole.
//!
//! There are a count and two buffers. The owner writes the buffer that is not current, and then counts; a reader looks at
//! the count before and after, and reads again if it has changed. What the words mean is up to the board.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::shm::WordsView;
use crate::word::Word;

/// How often a reader reads again what has changed meanwhile. Owners publish cells some times in a second.
const ATTEMPTS: usize = 100;

/// Words as a reader has them. Only [`Ordering::Relaxed`] loads are sure to work on memory that cannot be written.
pub(crate) trait Loads {
    type Word: Word;

    fn load(&self, at: usize) -> u64;
}

impl Loads for WordsView {
    type Word = AtomicU64;

    #[inline]
    fn load(&self, at: usize) -> u64 {
        self.load(at)
    }
}

/// Writes the buffer that is not current, and makes it current. The first word is the count; two buffers of `len` words
/// follow.
#[inline]
pub(crate) fn publish<W: Word>(words: &[W], len: usize, values: impl IntoIterator<Item = u64>) {
    let count = words[0].load(Ordering::Relaxed).wrapping_add(1);
    let buffer = &words[1 + (count % 2) as usize * len..][..len];
    // A reader that sees any of the following words also sees that the buffer has not been current for long.
    W::fence(Ordering::Release);
    for (word, value) in buffer.iter().zip(values) {
        word.store(value, Ordering::Relaxed);
    }
    words[0].store(count, Ordering::Release);
}

/// What `read` finds in the current buffer, which begins where it is told, and the number of the publication; none, if
/// nothing was published, or it changes again and again.
pub(crate) fn current<M: Loads, T>(
    memory: &M,
    start: usize,
    len: usize,
    mut read: impl FnMut(usize) -> T,
) -> Option<(u64, T)> {
    for _ in 0..ATTEMPTS {
        let count = memory.load(start);
        if count == 0 {
            return None;
        }
        M::Word::fence(Ordering::Acquire);
        let found = read(start + 1 + (count % 2) as usize * len);
        M::Word::fence(Ordering::Acquire);
        if memory.load(start) == count {
            return Some((count, found));
        }
    }
    None
}

/// Comes between what a process shows and its look at what others show. Of two that do both, at least one sees what the
/// other one has shown.
#[inline]
pub(crate) fn before_look<W: Word>() {
    W::fence(Ordering::SeqCst);
}

#[cfg(test)]
mod tests;
