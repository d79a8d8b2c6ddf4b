//! The board of one loop, as the loop sees it.
//!
//! What changes at each tag is a note of a few words. The state is shown at most every [`PAUSE`], so that it costs nothing
//! that can be measured: by a loop that has been busy for that long, and by one that has slept for that long since it
//! was last shown. So a board is never further behind than that, unless a reaction runs: then the note says since
//! when.

use std::sync::Arc;

use hprm_core::{Nanos, PhysicalTime, ReactionId, Tag};
use hprm_store::{Board, BoardLayout};
use serde::Serialize;

use super::{Cell, Identity, Names};
use crate::Clock;

/// The least time between two states of one loop.
const PAUSE: Nanos = 50_000_000;

/// A loop spends no more than one in so many parts of its time on its board.
const SHARE: Nanos = 500;

/// How many bytes of a board's names are kept for what is not known yet: where a reaction is.
const PLACE: usize = 160;

/// The board of a loop; without one, if the system has no memory for it, and then nothing is shown.
#[derive(Debug)]
pub(crate) struct BoardWriter {
    board: Option<Arc<Board>>,
    /// When the state may be shown again.
    due: PhysicalTime,
}

/// Where the threads of a loop show which reactions they run.
#[derive(Clone, Debug, Default)]
pub(crate) struct BoardLanes(Option<Arc<Board>>);

impl BoardWriter {
    /// A board with this identity, which others find from now on. `state` is how many bytes a state may have.
    pub(crate) fn new(identity: &Identity, names: &Names, lanes: usize, state: usize) -> Self {
        let due = PhysicalTime(0);
        let (identity, words) = (text(identity), text(names));
        let later = names.reactions.len() * PLACE;
        let layout = BoardLayout { lanes, cells: vec![identity.len(), words.len() + later, state] };
        let Ok(board) = Board::create(layout) else { return Self { board: None, due } };
        board.publish(Cell::Identity.number(), &identity);
        board.publish(Cell::Names.number(), &words);
        board.open();
        Self { board: Some(Arc::new(board)), due }
    }

    /// Shows other names than at first. If they are too long, the first ones stay.
    pub(crate) fn rename(&self, names: &Names) {
        if let Some(board) = &self.board {
            board.publish(Cell::Names.number(), &text(names));
        }
    }

    pub(crate) fn is_on(&self) -> bool {
        self.board.is_some()
    }

    pub(crate) fn lanes(&self) -> BoardLanes {
        BoardLanes(self.board.clone())
    }

    /// From when on the state should be shown again, for a loop that is about to wait; none, if nothing is shown.
    pub(crate) fn due(&self) -> Option<PhysicalTime> {
        self.board.is_some().then_some(self.due)
    }

    /// Whether it is time to show the state again.
    #[inline]
    pub(crate) fn is_due(&self, now: PhysicalTime) -> bool {
        now >= self.due && self.board.is_some()
    }

    /// Notes that a tag begins, or goes on after a wait.
    #[inline]
    pub(crate) fn begins(&self, tag: Tag, now: PhysicalTime) {
        if let Some(board) = &self.board {
            board.note([1, tag.time.cast_unsigned(), tag.microstep.into(), now.0.cast_unsigned()]);
        }
    }

    /// How many notes there have been.
    pub(crate) fn notes(&self) -> u64 {
        self.board.as_ref().map_or(0, |board| board.notes())
    }

    /// Shows a state. One that is longer than any is left out.
    pub(crate) fn show(&mut self, state: &impl Serialize) {
        let Some(board) = &self.board else { return };
        let began = Clock::now();
        let bytes = postcard::to_allocvec(state).expect("a state is plain data");
        board.publish(Cell::State.number(), &bytes);
        let now = Clock::now();
        self.due = now.plus(PAUSE.max(now.since(began).saturating_mul(SHARE)));
    }
}

impl BoardLanes {
    #[inline]
    pub(crate) fn is_on(&self) -> bool {
        self.0.is_some()
    }

    /// A thread begins to run a reaction.
    #[inline]
    pub(crate) fn begins(&self, lane: usize, reaction: ReactionId) {
        if let Some(board) = &self.0 {
            let run = board.lane(lane) >> 32;
            board.set_lane(lane, run.wrapping_add(1) << 32 | (u64::from(reaction.0) + 1));
        }
    }

    /// The reaction ends that the thread has begun last.
    #[inline]
    pub(crate) fn ends(&self, lane: usize) {
        if let Some(board) = &self.0 {
            board.set_lane(lane, board.lane(lane) >> 32 << 32);
        }
    }
}

fn text(value: &impl Serialize) -> Vec<u8> {
    serde_json::to_vec(value).expect("names are plain data")
}
