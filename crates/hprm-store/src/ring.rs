//! Ring buffers: streams of bytes from one process to another through shared memory.
//!
//! A [pair](ring_pair) of ring buffers joins two processes, one for each direction. Each carries a stream
//! of bytes, as a socket does. The link that uses it knows what the bytes mean, and wakes up the other
//! side. Each side counts the bytes that it has written or read in its own memory, and tells the other
//! side by a word of the ring. The other side is not trusted: what it tells is checked against what is
//! possible, and bytes are copied out before they are used.
//!
//! **A ring uses no more memory than it needs.** Whenever the writer has written some pages and finds that the reader has
//! read everything, it begins again at the first byte of the ring: the *origin* is the byte of the stream that lies
//! there. The system gives memory to pages that were written, and those that are written again and again stay in the
//! processor's cache. Both sides agree on the origin, although the reader learns of it later: it is a byte that the reader
//! had not read when the writer chose it, and everything before it was read.
//!
//! **A side announces that it will sleep.** A reader that is about to sleep announces it in the ring and
//! then looks for bytes once more; a writer writes and then looks whether the reader sleeps. Both exchange the word
//! of the announcement, so one of them comes second: it gets what the other one has put there, and sees all that
//! this one did before. So no byte waits for a reader that sleeps. A writer that finds the ring full waits in the same
//! way; a reader need not look for that after each read ([`Reader::take_waiting_writer`]).

use std::ops::Range;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::SegmentError;
use crate::shm::SharedWords;
use crate::word::Word;

/// How many bytes a ring holds: more than a usual frame has, so that a writer seldom waits in the middle
/// of one.
pub const RING_CAPACITY: usize = 1 << 17;

/// How many words two cache lines have: processors fetch lines in pairs, so words that different sides
/// write lie this far apart.
const LINE: usize = 16;

/// How many bytes one line of a cache has.
const LINE_BYTES: usize = 64;

/// How many bytes a side has the processor fetch before it reads or writes them: those of a small message.
const FETCHED: u64 = 192;

/// How many bytes are written before the writer looks whether it can begin again at the start of the ring: about a page.
const SPAN: u64 = 1 << 12;

/// The positions of the words by which the sides of a ring tell each other their state.
const WRITTEN: usize = 0;
/// Beside the count that the reader loads anyway, in one line of the cache.
const ORIGIN: usize = 1;
const READ: usize = LINE;
const READER_SLEEPS: usize = 2 * LINE;
const WRITER_WAITS: usize = 3 * LINE;
const OPENED: usize = 4 * LINE;
const DATA: usize = 5 * LINE;

const WORD: usize = size_of::<u64>();
const RING_WORDS: usize = DATA + RING_CAPACITY / WORD;

/// What is used at once of two rings: their first words and some pages, in which the longest messages fit. The system gives
/// memory to the rest where a reader falls behind.
const SOON: [Range<usize>; 2] = {
    let words = DATA + 4 * SPAN as usize / WORD;
    [0..words, RING_WORDS..RING_WORDS + words]
};

/// The other side tells something that is not possible.
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

/// Memory that both sides have; in tests, a small one in which words are as old as the language permits.
trait Memory {
    type Word: Word;

    /// How many bytes a ring holds: whole words.
    const CAPACITY: usize;

    /// After how many bytes its writer looks whether everything was read.
    const SPAN: u64;

    fn words(&self) -> &[Self::Word];
}

impl<M: AsRef<[AtomicU64]>> Memory for M {
    type Word = AtomicU64;

    const CAPACITY: usize = RING_CAPACITY;

    const SPAN: u64 = SPAN;

    fn words(&self) -> &[AtomicU64] {
        self.as_ref()
    }
}

impl<M: Memory> Ring<M> {
    fn word(&self, at: usize) -> &M::Word {
        &self.memory.words()[self.start + at]
    }

    fn data(&self) -> &[M::Word] {
        &self.memory.words()[self.start + DATA..][..M::CAPACITY / WORD]
    }

    /// The position in the ring of a byte, by its number in the stream, from the byte that lies at the start.
    fn position(origin: u64, number: u64) -> usize {
        ((number - origin) % M::CAPACITY as u64) as usize
    }

    /// Fetches a word of each line of the cache in which the next `count` bytes lie, or the first of them: those of a small
    /// message.
    fn fetch_lines(&self, first: usize, count: u64, fetch: impl Fn(&M::Word)) {
        let data = self.data();
        let first = first / LINE_BYTES;
        let lines = (count.min(FETCHED) as usize).div_ceil(LINE_BYTES) + 1;
        for line in first..first + lines {
            data.get(line * (LINE_BYTES / WORD)).into_iter().for_each(&fetch);
        }
    }

    /// Loads a word of the other side; everything that it did before is visible afterwards.
    fn load(&self, at: usize) -> u64 {
        self.word(at).load(Ordering::Acquire)
    }

    /// Stores a word for the other side, which then sees everything done before.
    fn store(&self, at: usize, value: u64) {
        self.word(at).store(value, Ordering::Release);
    }

    /// Announces that this side is about to sleep. It must look once more after that.
    fn announce_sleep(&self, at: usize) {
        self.word(at).swap(1, Ordering::AcqRel);
    }

    /// Withdraws the announcement. A mere store would break the chain of exchanges.
    fn end_sleep(&self, at: usize) {
        self.word(at).swap(0, Ordering::AcqRel);
    }

    /// Whether the other side sleeps and has to be woken up, which is true once for each sleep. To be called
    /// after the change for which it has to wake up.
    fn take_sleeping(&self, at: usize) -> bool {
        self.word(at).swap(0, Ordering::AcqRel) != 0
    }
}

/// The end of a ring that writes.
#[derive(Debug)]
pub struct RingWriter(Writer<SharedWords>);

/// The end of a ring that reads.
#[derive(Debug)]
pub struct RingReader(Reader<SharedWords>);

/// Creates two rings, and the descriptor by which the other side [maps](map_ring_pair) them.
///
/// # Errors
///
/// If the system does not give the memory.
pub fn ring_pair() -> Result<(RingWriter, RingReader, OwnedFd), SegmentError> {
    let (memory, file) = SharedWords::create(2 * RING_WORDS, &SOON)?;
    let (outbound, inbound) = ends(memory);
    Ok((RingWriter(Writer::new(outbound)), RingReader(Reader::new(inbound)), file))
}

/// Maps the rings that [`ring_pair`] has created in the other process.
///
/// # Errors
///
/// If the file is something else, or the system does not map it.
pub fn map_ring_pair(file: &OwnedFd) -> Result<(RingWriter, RingReader), SegmentError> {
    let (inbound, outbound) = ends(SharedWords::map(file, 2 * RING_WORDS, &SOON)?);
    Ok((RingWriter(Writer::new(outbound)), RingReader(Reader::new(inbound))))
}

fn ends<M>(memory: M) -> (Ring<M>, Ring<M>) {
    let memory = Arc::new(memory);
    (Ring { memory: Arc::clone(&memory), start: 0 }, Ring { memory, start: RING_WORDS })
}

impl RingWriter {
    /// Tells the reader that all bytes come through this ring from now on, after `position` bytes that were
    /// sent by another transport.
    pub fn open(&mut self, position: u64) {
        self.0.ring.store(OPENED, position.wrapping_add(1));
    }

    /// Has the processor fetch what so many bytes, or the first of them, will be written to: the reader has it in its
    /// cache, from the last time that it lay there.
    pub fn fetch(&self, count: usize) {
        self.0.fetch(count);
    }

    /// Writes as many of the bytes as there is room for.
    ///
    /// # Errors
    ///
    /// If the reader tells something that is not possible.
    pub fn write(&mut self, bytes: &[u8]) -> Result<usize, RingError> {
        self.0.write(bytes)
    }

    /// Whether there is room. If not, the ring asks the reader to wake up this side once it has read.
    ///
    /// # Errors
    ///
    /// If the reader tells something that is not possible.
    pub fn has_room_or_waits(&mut self) -> Result<bool, RingError> {
        self.0.has_room_or_waits()
    }

    /// Whether the reader sleeps and has to be woken up for what was written. True once for each sleep.
    pub fn take_sleeping_reader(&mut self) -> bool {
        self.0.ring.take_sleeping(READER_SLEEPS)
    }

    /// Whether the reader sleeps, or is about to. What it does next, this does not tell: whatever was written since has to
    /// be followed by [`take_sleeping_reader`](Self::take_sleeping_reader) nevertheless.
    pub fn reader_sleeps(&self) -> bool {
        self.0.ring.load(READER_SLEEPS) != 0
    }
}

impl RingReader {
    /// After how many bytes of the other transport the first one comes through this ring, if the writer has
    /// told so by now.
    #[inline]
    pub fn opened(&self) -> Option<u64> {
        self.0.ring.load(OPENED).checked_sub(1)
    }

    /// Whether there is nothing to read. If there is, this side should read it soon.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Copies out as many bytes as were written and fit into the buffer.
    ///
    /// # Errors
    ///
    /// If the writer tells something that is not possible.
    pub fn read(&mut self, buffer: &mut [u8]) -> Result<usize, RingError> {
        self.0.read(buffer)
    }

    /// Whether the writer waits and has to be woken up because bytes were read. True once for each wait. To be called
    /// after each read.
    pub fn take_waiting_writer(&mut self) -> bool {
        self.0.take_waiting_writer()
    }

    /// Announces that this side is about to sleep. It must look once more after that.
    pub fn announce_sleep(&mut self) {
        self.0.ring.announce_sleep(READER_SLEEPS);
    }

    /// Withdraws the announcement: this side does not sleep any more.
    pub fn end_sleep(&mut self) {
        self.0.ring.end_sleep(READER_SLEEPS);
    }
}

#[derive(Debug)]
#[cfg_attr(test, derive(Clone))]
struct Writer<M> {
    ring: Ring<M>,
    /// How many bytes have been written.
    written: u64,
    /// How many of them had been read when this side last loaded that.
    read: u64,
    /// Which of them lies, or lay, at the start of the ring.
    origin: u64,
    /// How many are written when this side looks whether everything was read.
    looks_at: u64,
}

impl<M: Memory> Writer<M> {
    fn new(ring: Ring<M>) -> Self {
        Self { ring, written: 0, read: 0, origin: 0, looks_at: M::SPAN }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, RingError> {
        if self.written >= self.looks_at {
            self.begin_again_if_empty()?;
        }
        if self.room() < bytes.len() {
            self.load_read()?;
        }
        let count = bytes.len().min(self.room());
        self.put(&bytes[..count]);
        self.written += count as u64;
        self.ring.store(WRITTEN, self.written);
        Ok(count)
    }

    fn fetch(&self, count: usize) {
        let first = Ring::<M>::position(self.origin, self.written);
        self.ring.fetch_lines(first, count as u64, Word::fetch_to_store);
    }

    fn has_room_or_waits(&mut self) -> Result<bool, RingError> {
        self.load_read()?;
        if self.room() == 0 {
            self.ring.announce_sleep(WRITER_WAITS);
            self.load_read()?;
        }
        Ok(self.room() > 0)
    }

    /// The next byte lies at the start of the ring, if all before it were read.
    fn begin_again_if_empty(&mut self) -> Result<(), RingError> {
        self.load_read()?;
        if self.read == self.written {
            self.origin = self.written;
            // The reader sees it with the count of what is written next.
            self.ring.word(ORIGIN).store(self.origin, Ordering::Relaxed);
        }
        self.looks_at = self.written + M::SPAN;
        Ok(())
    }

    fn room(&self) -> usize {
        M::CAPACITY - (self.written - self.read) as usize
    }

    /// Loads how many bytes the reader has read.
    fn load_read(&mut self) -> Result<(), RingError> {
        let read = self.ring.load(READ);
        if read < self.read || read > self.written {
            return Err(RingError);
        }
        self.read = read;
        Ok(())
    }

    /// Copies bytes for which there is room.
    fn put(&mut self, bytes: &[u8]) {
        let at = Ring::<M>::position(self.origin, self.written);
        let (now, later) = bytes.split_at(bytes.len().min(M::CAPACITY - at));
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
    /// Which of them lies, or lay, at the start of the ring.
    origin: u64,
    /// How many had been written when this side last read.
    written: u64,
    /// How many had been read when this side last looked whether the writer waits.
    looked: u64,
}

impl<M: Memory> Reader<M> {
    fn new(ring: Ring<M>) -> Self {
        Self { ring, read: 0, origin: 0, written: 0, looked: 0 }
    }

    #[inline]
    fn is_empty(&self) -> bool {
        let written = self.ring.load(WRITTEN);
        if written == self.read {
            return true;
        }
        self.fetch(written.wrapping_sub(self.read));
        false
    }

    /// Has the processor fetch the next `count` bytes, or the first of them: the other side has them in its cache, and
    /// this one has other things to do before it reads them.
    // Apart, so that a look at an empty ring is short.
    #[inline(never)]
    fn fetch(&self, count: u64) {
        let begins_again = self.ring.word(ORIGIN).load(Ordering::Relaxed) == self.read;
        let origin = if begins_again { self.read } else { self.origin };
        self.ring.fetch_lines(Ring::<M>::position(origin, self.read), count, Word::fetch);
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, RingError> {
        let written = self.ring.load(WRITTEN);
        let available = written.checked_sub(self.read).ok_or(RingError)?;
        let available = usize::try_from(available).map_err(|_| RingError)?;
        if available > M::CAPACITY {
            return Err(RingError);
        }
        self.written = written;
        let count = available.min(buffer.len());
        if count > 0 {
            // An earlier origin is an earlier byte: the writer chooses one when everything before it was read. So one that
            // is the next byte to read is the latest.
            if self.ring.word(ORIGIN).load(Ordering::Relaxed) == self.read {
                self.origin = self.read;
            }
            self.take(&mut buffer[..count]);
            self.read += count as u64;
            self.ring.store(READ, self.read);
        }
        Ok(count)
    }

    /// Whether the writer waits. It waits only if it has filled the ring, as far as it knows, and it knows of everything
    /// that had been read when this side last looked. So this side must look once it reads when so many bytes have been
    /// written, and may save the exchange before that.
    fn take_waiting_writer(&mut self) -> bool {
        if self.written - self.looked < M::CAPACITY as u64 {
            return false;
        }
        self.looked = self.read;
        self.ring.take_sleeping(WRITER_WAITS)
    }

    /// Copies out bytes that were written.
    fn take(&self, buffer: &mut [u8]) {
        let at = Ring::<M>::position(self.origin, self.read);
        let (now, later) = buffer.split_at_mut(buffer.len().min(M::CAPACITY - at));
        take(self.ring.data(), at, now);
        take(self.ring.data(), 0, later);
    }
}

/// Copies bytes into memory, from byte `at` on. The first byte of a word is the lowest one, on every machine.
fn put(memory: &[impl Word], at: usize, bytes: &[u8]) {
    let (head, rest) = bytes.split_at(bytes.len().min(up_to_word(at)));
    put_part(memory, at, head);
    let at = at + head.len();
    let (words, tail) = rest.as_chunks::<WORD>();
    for (word, chunk) in memory[at / WORD..].iter().zip(words) {
        word.store(u64::from_le_bytes(*chunk), Ordering::Relaxed);
    }
    put_part(memory, at + rest.len() - tail.len(), tail);
}

/// Copies a part of one word. The rest of it may not have been read yet, and stays.
// By shifts, not by way of bytes in memory: a processor that loads a word of which it has just stored parts waits until
// all stores before have arrived in the cache, and lines that the other side had come late.
#[inline]
fn put_part(memory: &[impl Word], at: usize, bytes: &[u8]) {
    if bytes.is_empty() {
        return;
    }
    let (word, shift) = (&memory[at / WORD], at % WORD * 8);
    let stays = !(((1 << (bytes.len() * 8)) - 1) << shift);
    word.store(word.load(Ordering::Relaxed) & stays | part(bytes) << shift, Ordering::Relaxed);
}

/// The number that less than a word of bytes are, the lowest first.
#[inline]
fn part(bytes: &[u8]) -> u64 {
    let len = bytes.len();
    if let (Some(low), Some(high)) = (bytes.first_chunk(), bytes.last_chunk()) {
        let [low, high] = [low, high].map(|half| u64::from(u32::from_le_bytes(*half)));
        return low | high << ((len - 4) * 8);
    }
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte))
}

/// Copies bytes out of memory, from byte `at` on.
fn take(memory: &[impl Word], at: usize, buffer: &mut [u8]) {
    let (head, rest) = buffer.split_at_mut(buffer.len().min(up_to_word(at)));
    take_part(memory, at, head);
    let at = at + head.len();
    let len = rest.len();
    let (words, tail) = rest.as_chunks_mut::<WORD>();
    for (word, chunk) in memory[at / WORD..].iter().zip(words) {
        *chunk = word.load(Ordering::Relaxed).to_le_bytes();
    }
    take_part(memory, at + len - tail.len(), tail);
}

/// Copies a part of one word.
#[inline]
fn take_part(memory: &[impl Word], at: usize, buffer: &mut [u8]) {
    if buffer.is_empty() {
        return;
    }
    let number = memory[at / WORD].load(Ordering::Relaxed) >> (at % WORD * 8);
    let len = buffer.len();
    if let Some(low) = buffer.first_chunk_mut() {
        *low = (number as u32).to_le_bytes();
        if let Some(high) = buffer.last_chunk_mut() {
            *high = ((number >> ((len - 4) * 8)) as u32).to_le_bytes();
        }
        return;
    }
    for (at, byte) in buffer.iter_mut().enumerate() {
        *byte = (number >> (at * 8)) as u8;
    }
}

/// How many bytes a word has left from byte `at` on; zero if a word begins there.
fn up_to_word(at: usize) -> usize {
    at.next_multiple_of(WORD) - at
}

#[cfg(test)]
mod before_board;
#[cfg(test)]
mod sleeping;
#[cfg(test)]
mod tests;
