//! A connection within this process: bytes in both directions, in pieces that nothing copies on their way.
//!
//! It is to its ends what a pair of sockets would be. What is given before an end is dropped can still be taken at the
//! other one, and its end comes after it. There is a descriptor for each of what an end can wait for, which can be read as
//! long as that is so: that there is something to take, and that there is room to give.

use std::collections::VecDeque;
use std::io::{self, Read};
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use hprm_federated::relay::Bytes;

use crate::notifier::Notifier;

/// How much may wait for an end before there is no more room, and when there is again. The last piece may exceed it.
const FULL: usize = 1 << 20;
const AGAIN: usize = FULL / 2;

/// What a piece counts in addition to its bytes, so that not too many short ones wait either.
const PIECE: usize = 256;

/// One end of such a connection.
#[derive(Debug)]
pub struct Pipe {
    takes: Arc<Lane>,
    gives: Arc<Lane>,
}

/// One direction.
#[derive(Debug)]
struct Lane {
    state: Mutex<State>,
    /// What can be read as long as there is something to take, and as long as there is room.
    is_there: Notifier,
    has_room: Notifier,
}

#[derive(Debug, Default)]
struct State {
    pieces: VecDeque<Bytes>,
    /// What they count.
    held: usize,
    is_full: bool,
    /// Whether nothing more is given, and whether nothing more is taken.
    is_finished: bool,
    is_deaf: bool,
}

impl Pipe {
    /// Both ends of a new connection.
    ///
    /// # Errors
    ///
    /// If there are no descriptors.
    pub fn pair() -> io::Result<(Self, Self)> {
        let (one, other) = (Arc::new(Lane::new()?), Arc::new(Lane::new()?));
        let back = Self { takes: Arc::clone(&other), gives: Arc::clone(&one) };
        Ok((Self { takes: one, gives: other }, back))
    }

    /// Takes the next bytes, and at most so many of them. None if there is an end behind what has been taken.
    ///
    /// # Errors
    ///
    /// [`io::ErrorKind::WouldBlock`] if nothing is there.
    pub fn take(&self, most: usize) -> io::Result<Option<Bytes>> {
        let mut state = self.takes.state();
        let Some(first) = state.pieces.pop_front() else {
            return if state.is_finished {
                Ok(None)
            } else {
                Err(io::ErrorKind::WouldBlock.into())
            };
        };
        let (piece, rest) = match first.len() <= most {
            true => (first, None),
            false => (first.part(0..most), Some(first.part(most..first.len()))),
        };
        state.held -= piece.len() + if rest.is_none() { PIECE } else { 0 };
        if let Some(rest) = rest {
            state.pieces.push_front(rest);
        }
        if state.pieces.is_empty() && !state.is_finished {
            self.takes.is_there.clear();
        }
        if state.is_full && state.held <= AGAIN {
            state.is_full = false;
            self.takes.has_room.notify();
        }
        Ok(Some(piece))
    }

    /// Gives bytes to the other end: all of them, if there is room.
    ///
    /// # Errors
    ///
    /// [`io::ErrorKind::WouldBlock`] if there is none now, and [`io::ErrorKind::BrokenPipe`] if there is no other end.
    pub fn give(&self, piece: &Bytes) -> io::Result<()> {
        let mut state = self.gives.state();
        if state.is_deaf || state.is_finished {
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        if state.is_full {
            return Err(io::ErrorKind::WouldBlock.into());
        }
        if piece.is_empty() {
            return Ok(());
        }
        if state.pieces.is_empty() {
            self.gives.is_there.notify();
        }
        state.held += piece.len() + PIECE;
        state.pieces.push_back(piece.clone());
        if state.held >= FULL {
            state.is_full = true;
            self.gives.has_room.clear();
        }
        Ok(())
    }

    /// Gives nothing more.
    pub fn finish(&self) {
        let mut state = self.gives.state();
        if !state.is_finished {
            state.is_finished = true;
            self.gives.is_there.notify();
        }
    }

    /// What can be read as long as there is something to take, perhaps the end.
    #[must_use]
    pub fn to_take(&self) -> BorrowedFd<'_> {
        self.takes.is_there.as_fd()
    }

    /// What can be read as long as there is room to give, or no other end.
    #[must_use]
    pub fn to_give(&self) -> BorrowedFd<'_> {
        self.gives.has_room.as_fd()
    }
}

impl Drop for Pipe {
    fn drop(&mut self) {
        self.finish();
        let mut state = self.takes.state();
        state.is_deaf = true;
        let pieces = std::mem::take(&mut state.pieces);
        if std::mem::take(&mut state.is_full) {
            self.takes.has_room.notify();
        }
        drop(state);
        // Memory is freed while the other end may go on.
        drop(pieces);
    }
}

/// Copies what it takes, at most the rest of one piece.
impl Read for &Pipe {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        if into.is_empty() {
            return Ok(0);
        }
        let Some(piece) = Pipe::take(self, into.len())? else { return Ok(0) };
        into[..piece.len()].copy_from_slice(&piece);
        Ok(piece.len())
    }
}

impl Lane {
    fn new() -> io::Result<Self> {
        let lane = Self {
            state: Mutex::default(),
            is_there: Notifier::new()?,
            has_room: Notifier::new()?,
        };
        lane.has_room.notify();
        Ok(lane)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::wait::{Interest, wait};
    use hprm_core::PhysicalTime;

    fn is_marked(fd: BorrowedFd<'_>) -> bool {
        let ready = wait(&[Interest { fd, write: false }], Some(PhysicalTime(0)));
        ready[0].is_ready()
    }

    fn kind<T: std::fmt::Debug>(result: io::Result<T>) -> io::ErrorKind {
        result.unwrap_err().kind()
    }

    #[test]
    fn bytes_are_taken_where_they_were_given_however_many_are_taken_at_a_time() {
        let (one, other) = Pipe::pair().unwrap();
        let piece = Bytes::from(vec![1, 2, 3]);
        one.give(&piece).unwrap();
        let taken = [2, 2].map(|most| other.take(most).unwrap().unwrap());
        assert_eq!(taken.each_ref().map(|it| it.len()), [2, 1]);
        assert_eq!(
            taken.each_ref().map(|it| it.as_ptr()),
            [&piece[0], &piece[2]].map(|it| it as *const u8)
        );
    }

    #[test]
    fn what_was_given_can_be_taken_after_its_end_is_dropped_and_then_the_end_comes() {
        let (one, other) = Pipe::pair().unwrap();
        one.give(&vec![1, 2, 3].into()).unwrap();
        one.give(&vec![].into()).unwrap();
        drop(one);
        assert_eq!(other.take(2).unwrap().as_deref(), Some(&[1, 2][..]));
        assert_eq!(other.take(2).unwrap().as_deref(), Some(&[3][..]));
        assert_eq!((other.take(2).unwrap(), other.take(2).unwrap()), (None, None));
        assert!(is_marked(other.to_take()) && is_marked(other.to_give()));
        assert_eq!(kind(other.give(&vec![1].into())), io::ErrorKind::BrokenPipe);
    }

    #[test]
    fn an_end_that_finishes_still_takes() {
        let (one, other) = Pipe::pair().unwrap();
        one.finish();
        assert_eq!(other.take(1).unwrap(), None);
        other.give(&vec![7].into()).unwrap();
        assert_eq!((&one).read(&mut [0; 4]).unwrap(), 1);
        assert_eq!(kind((&one).read(&mut [0; 4])), io::ErrorKind::WouldBlock);
        assert_eq!(kind(one.give(&vec![1].into())), io::ErrorKind::BrokenPipe);
    }

    #[test]
    fn an_end_that_waits_for_room_learns_that_there_is_no_other_one_and_nothing_is_held() {
        let (one, other) = Pipe::pair().unwrap();
        let piece = Arc::new(vec![0; FULL]);
        let bytes = Bytes::of(Held(Arc::clone(&piece)));
        one.give(&bytes).unwrap();
        drop(bytes);
        assert_eq!(kind(one.give(&vec![1].into())), io::ErrorKind::WouldBlock);
        assert!(!is_marked(one.to_give()));
        drop(other);
        assert!(is_marked(one.to_give()));
        assert_eq!(kind(one.give(&vec![1].into())), io::ErrorKind::BrokenPipe);
        assert_eq!(Arc::strong_count(&piece), 1);
    }

    struct Held(Arc<Vec<u8>>);

    impl AsRef<[u8]> for Held {
        fn as_ref(&self) -> &[u8] {
            &self.0
        }
    }

    /// Bytes of which each place can be told from those near it.
    fn pattern() -> Bytes {
        (0..400_251_u32).map(|at| (at % 251) as u8).collect::<Vec<u8>>().into()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn bytes_come_in_order_marks_say_what_is_so_and_memory_is_bounded(
            steps in prop::collection::vec((any::<bool>(), 0..400_000_usize), 1..60)
        ) {
            let (one, other) = Pipe::pair().unwrap();
            let (mut given, mut taken, pattern) = (0_usize, 0_usize, pattern());
            for (gives, len) in steps {
                if gives {
                    let has_room = is_marked(one.to_give());
                    match one.give(&pattern.part(given % 251..given % 251 + len)) {
                        Ok(()) => given += len,
                        Err(error) => prop_assert_eq!(error.kind(), io::ErrorKind::WouldBlock),
                    }
                    prop_assert!(has_room || given - taken > AGAIN - PIECE * 60);
                } else {
                    match other.take(len.max(1)) {
                        Ok(Some(piece)) => {
                            prop_assert!(piece.len() <= len.max(1));
                            prop_assert!(*piece == pattern[taken % 251..][..piece.len()]);
                            taken += piece.len();
                        }
                        end => prop_assert_eq!(end.unwrap_err().kind(), io::ErrorKind::WouldBlock),
                    }
                }
                prop_assert!(given - taken < FULL + 400_000);
                prop_assert_eq!(is_marked(other.to_take()), given > taken);
                prop_assert_eq!(is_marked(one.to_give()), !one.gives.state().is_full);
                prop_assert!(given > taken || one.gives.state().held == 0);
            }
        }
    }
}
