//! Rings: bytes from one process to another through memory, and who has to be woken for them.
//!
//! A [pair](ring_pair) of rings joins two processes, one ring for each direction. A ring carries a
//! stream of bytes, as a socket does; what they mean, and how a side is woken, is its user's business.
//! Each side has the number of bytes that it has written or read in its own memory, and tells the
//! other by a word of the ring. The other side is not trusted: what it tells is compared with what can
//! be, and bytes are copied out before anybody looks at them.
//!
//! **Who sleeps says so.** A reader that is about to sleep says so in the ring and then looks at it once
//! more; a writer writes and then looks whether the reader sleeps. Between the two steps each has a
//! barrier, so one of them sees the other, and no byte waits for a reader that sleeps. A writer for
//! whom the ring is full waits in the same way.

use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering, fence};

use crate::SegmentError;
use crate::shm::SharedWords;

/// How many bytes a ring holds: more than the largest frame that is usual, so that nobody waits in
/// the middle of one.
pub const RING_CAPACITY: usize = 1 << 17;

/// How many words a line of the cache has, and the one that is fetched with it: words that
/// different sides write lie so far apart.
const LINE: usize = 16;

/// Where in a ring the words are by which its sides talk.
const WRITTEN: usize = 0;
const READ: usize = LINE;
const READER_SLEEPS: usize = 2 * LINE;
const WRITER_WAITS: usize = 3 * LINE;
const OPENED: usize = 4 * LINE;
const DATA: usize = 5 * LINE;

const WORD: usize = size_of::<u64>();
const RING_WORDS: usize = DATA + RING_CAPACITY / WORD;

/// The other side says something that cannot be.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "the other process has written more into a ring than it holds, or read more than was written"
)]
pub struct RingError;

/// One ring in a memory.
#[derive(Debug)]
#[cfg_attr(test, derive(Clone))]
struct Ring<M> {
    memory: Arc<M>,
    start: usize,
}

impl<M: AsRef<[AtomicU64]>> Ring<M> {
    fn word(&self, at: usize) -> &AtomicU64 {
        &(*self.memory).as_ref()[self.start + at]
    }

    fn data(&self) -> &[AtomicU64] {
        &(*self.memory).as_ref()[self.start + DATA..self.start + RING_WORDS]
    }

    /// What the other side has told, after which everything it did before is to be seen.
    fn heard(&self, at: usize) -> u64 {
        self.word(at).load(Ordering::Acquire)
    }

    /// Tells the other side, which then sees everything done before.
    fn tell(&self, at: usize, value: u64) {
        self.word(at).store(value, Ordering::Release);
    }

    /// Says that this side is about to sleep. It must look once more after that.
    fn announce(&self, at: usize) {
        self.tell(at, 1);
        fence(Ordering::SeqCst);
    }

    /// Whether the other side sleeps and is to be woken, which is said once. Comes after what it is to
    /// be woken for.
    fn take_sleeper(&self, at: usize) -> bool {
        fence(Ordering::SeqCst);
        self.heard(at) != 0 && self.word(at).swap(0, Ordering::AcqRel) != 0
    }
}

/// The end of a ring that writes.
#[derive(Debug)]
pub struct RingWriter(Writer<SharedWords>);

/// The end of a ring that reads.
#[derive(Debug)]
pub struct RingReader(Reader<SharedWords>);

/// Creates two rings, and what the other side needs to [map](map_ring_pair) them.
///
/// # Errors
///
/// If the system does not give the memory.
pub fn ring_pair() -> Result<(RingWriter, RingReader, OwnedFd), SegmentError> {
    let (memory, file) = SharedWords::create(2 * RING_WORDS)?;
    let (there, back) = ends(memory);
    Ok((RingWriter(Writer::new(there)), RingReader(Reader::new(back)), file))
}

/// The other end of what [`ring_pair`] has created.
///
/// # Errors
///
/// If the file is something else, or the system does not map it.
pub fn map_ring_pair(file: &OwnedFd) -> Result<(RingWriter, RingReader), SegmentError> {
    let (there, back) = ends(SharedWords::map(file, 2 * RING_WORDS)?);
    Ok((RingWriter(Writer::new(back)), RingReader(Reader::new(there))))
}

fn ends<M>(memory: M) -> (Ring<M>, Ring<M>) {
    let memory = Arc::new(memory);
    (Ring { memory: Arc::clone(&memory), start: 0 }, Ring { memory, start: RING_WORDS })
}

impl RingWriter {
    /// Says that from now on bytes come by this ring, after `position` bytes that have gone another
    /// way.
    pub fn open(&mut self, position: u64) {
        self.0.ring.tell(OPENED, position.wrapping_add(1));
    }

    /// Writes as many of the bytes as there is room for.
    ///
    /// # Errors
    ///
    /// If the reader lies.
    pub fn write(&mut self, bytes: &[u8]) -> Result<usize, RingError> {
        self.0.write(bytes)
    }

    /// Whether there is room. If not, the reader will be asked to wake this side once it has read.
    ///
    /// # Errors
    ///
    /// If the reader lies.
    pub fn has_room_or_waits(&mut self) -> Result<bool, RingError> {
        self.0.has_room_or_waits()
    }

    /// Whether the reader is to be woken for what has been written. It is said once for each sleep.
    pub fn take_sleeper(&mut self) -> bool {
        self.0.ring.take_sleeper(READER_SLEEPS)
    }
}

impl RingReader {
    /// After how many bytes that go another way the first one comes by this ring, if the writer has
    /// said so by now.
    pub fn opened(&self) -> Option<u64> {
        self.0.ring.heard(OPENED).checked_sub(1)
    }

    /// Whether nothing is in it.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Copies as many bytes out as are there and fit.
    ///
    /// # Errors
    ///
    /// If the writer lies.
    pub fn read(&mut self, buffer: &mut [u8]) -> Result<usize, RingError> {
        self.0.read(buffer)
    }

    /// Whether the writer is to be woken for what has been read. It is said once for each wait.
    pub fn take_waiter(&mut self) -> bool {
        self.0.ring.take_sleeper(WRITER_WAITS)
    }

    /// Says that this side is about to sleep. It must look once more after that.
    pub fn fall_asleep(&mut self) {
        self.0.ring.announce(READER_SLEEPS);
    }

    /// Says that this side does not sleep any more.
    pub fn wake_up(&mut self) {
        self.0.ring.tell(READER_SLEEPS, 0);
    }
}

#[derive(Debug)]
#[cfg_attr(test, derive(Clone))]
struct Writer<M> {
    ring: Ring<M>,
    /// How many bytes have been written.
    written: u64,
    /// How many of them had been read when this side last looked.
    read: u64,
}

impl<M: AsRef<[AtomicU64]>> Writer<M> {
    fn new(ring: Ring<M>) -> Self {
        Self { ring, written: 0, read: 0 }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, RingError> {
        if self.room() < bytes.len() {
            self.look()?;
        }
        let count = bytes.len().min(self.room());
        self.put(&bytes[..count]);
        self.written += count as u64;
        self.ring.tell(WRITTEN, self.written);
        Ok(count)
    }

    fn has_room_or_waits(&mut self) -> Result<bool, RingError> {
        self.look()?;
        if self.room() == 0 {
            self.ring.announce(WRITER_WAITS);
            self.look()?;
        }
        Ok(self.room() > 0)
    }

    fn room(&self) -> usize {
        RING_CAPACITY - (self.written - self.read) as usize
    }

    /// Learns how much the reader has read.
    fn look(&mut self) -> Result<(), RingError> {
        let read = self.ring.heard(READ);
        if read < self.read || read > self.written {
            return Err(RingError);
        }
        self.read = read;
        Ok(())
    }

    /// Copies bytes for which there is room.
    fn put(&mut self, bytes: &[u8]) {
        let at = position(self.written);
        let (now, later) = bytes.split_at(bytes.len().min(RING_CAPACITY - at));
        put(self.ring.data(), at, now);
        put(self.ring.data(), 0, later);
    }
}

#[derive(Debug)]
#[cfg_attr(test, derive(Clone))]
struct Reader<M> {
    ring: Ring<M>,
    /// How many bytes have been read.
    read: u64,
}

impl<M: AsRef<[AtomicU64]>> Reader<M> {
    fn new(ring: Ring<M>) -> Self {
        Self { ring, read: 0 }
    }

    fn is_empty(&self) -> bool {
        self.ring.heard(WRITTEN) == self.read
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, RingError> {
        let there = self.ring.heard(WRITTEN).checked_sub(self.read).ok_or(RingError)?;
        let there = usize::try_from(there).map_err(|_| RingError)?;
        if there > RING_CAPACITY {
            return Err(RingError);
        }
        let count = there.min(buffer.len());
        if count > 0 {
            self.take(&mut buffer[..count]);
            self.read += count as u64;
            self.ring.tell(READ, self.read);
        }
        Ok(count)
    }

    /// Copies bytes that are there.
    fn take(&self, buffer: &mut [u8]) {
        let at = position(self.read);
        let (now, later) = buffer.split_at_mut(buffer.len().min(RING_CAPACITY - at));
        take(self.ring.data(), at, now);
        take(self.ring.data(), 0, later);
    }
}

/// Copies bytes into memory, from byte `at` on.
fn put(memory: &[AtomicU64], at: usize, bytes: &[u8]) {
    let (head, rest) = bytes.split_at(bytes.len().min(up_to_word(at)));
    put_part(memory, at, head);
    let at = at + head.len();
    let words = rest.chunks_exact(WORD);
    let tail = words.remainder();
    for (word, chunk) in memory[at / WORD..].iter().zip(words) {
        let chunk = chunk.try_into().expect("each has the length of a word");
        word.store(u64::from_ne_bytes(chunk), Ordering::Relaxed);
    }
    put_part(memory, at + rest.len() - tail.len(), tail);
}

/// Copies a part of one word. What else is in it may not be read yet.
fn put_part(memory: &[AtomicU64], at: usize, bytes: &[u8]) {
    if bytes.is_empty() {
        return;
    }
    let word = &memory[at / WORD];
    let mut changed = word.load(Ordering::Relaxed).to_ne_bytes();
    changed[at % WORD..][..bytes.len()].copy_from_slice(bytes);
    word.store(u64::from_ne_bytes(changed), Ordering::Relaxed);
}

/// Copies bytes out of memory, from byte `at` on.
fn take(memory: &[AtomicU64], at: usize, buffer: &mut [u8]) {
    let (head, rest) = buffer.split_at_mut(buffer.len().min(up_to_word(at)));
    take_part(memory, at, head);
    let (at, len) = (at + head.len(), rest.len());
    let mut words = rest.chunks_exact_mut(WORD);
    for (word, chunk) in memory[at / WORD..].iter().zip(&mut words) {
        chunk.copy_from_slice(&word.load(Ordering::Relaxed).to_ne_bytes());
    }
    let tail = words.into_remainder();
    take_part(memory, at + len - tail.len(), tail);
}

/// Copies a part of one word.
fn take_part(memory: &[AtomicU64], at: usize, buffer: &mut [u8]) {
    if !buffer.is_empty() {
        let word = memory[at / WORD].load(Ordering::Relaxed).to_ne_bytes();
        buffer.copy_from_slice(&word[at % WORD..][..buffer.len()]);
    }
}

/// How many bytes a word has left from byte `at` on; none if a whole one begins there.
fn up_to_word(at: usize) -> usize {
    at.next_multiple_of(WORD) - at
}

/// Where in a ring the byte of this number lies.
fn position(number: u64) -> usize {
    (number % RING_CAPACITY as u64) as usize
}

#[cfg(test)]
mod tests;
