//! Which bytes of a mapped segment are borrowed in this process, and how.
//!
//! Plain data: the borrow checker of a segment at run time. `shm/segment.rs` relies on it for the
//! soundness of its slices, so that no mistake in the ledger or the store can make two of them overlap.

#![forbid(unsafe_code)]

use std::collections::BTreeMap;
use std::ops::Range;

#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum ClaimKind {
    Exclusive,
    /// The number of readers of exactly this range.
    Shared(usize),
}

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Claim {
    end: usize,
    kind: ClaimKind,
}

/// The claims on one segment, by their first byte. No two of them overlap.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(crate) struct Claims(BTreeMap<usize, Claim>);

impl Claims {
    /// Claims `range` for one writer; false, and nothing has changed, if any of it is claimed.
    pub(crate) fn claim_exclusive(&mut self, range: &Range<usize>) -> bool {
        let free = !self.overlaps(range);
        if free {
            self.0.insert(range.start, Claim { end: range.end, kind: ClaimKind::Exclusive });
        }
        free
    }

    /// Claims `range` for one more reader; false, and nothing has changed, if any of it is claimed
    /// otherwise than for readers of exactly this range.
    pub(crate) fn claim_shared(&mut self, range: &Range<usize>) -> bool {
        if let Some(Claim { end, kind: ClaimKind::Shared(readers) }) = self.0.get_mut(&range.start)
            && *end == range.end
        {
            *readers += 1;
            return true;
        }
        let free = !self.overlaps(range);
        if free {
            self.0.insert(range.start, Claim { end: range.end, kind: ClaimKind::Shared(1) });
        }
        free
    }

    /// Ends one claim that starts at `start`.
    ///
    /// # Panics
    ///
    /// If there is none.
    pub(crate) fn end(&mut self, start: usize) {
        let claim = self.0.get_mut(&start).expect("a claim ends once");
        match &mut claim.kind {
            ClaimKind::Shared(readers) if *readers > 1 => *readers -= 1,
            ClaimKind::Shared(_) | ClaimKind::Exclusive => {
                self.0.remove(&start);
            }
        }
    }

    /// Whether a claim overlaps `range`, or starts where it does: an empty range needs a place too.
    fn overlaps(&self, range: &Range<usize>) -> bool {
        let before = self.0.range(..range.start).next_back();
        before.is_some_and(|(_, claim)| claim.end > range.start)
            || self.0.range(range.start..range.end.max(range.start + 1)).next().is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_writer_is_alone() {
        let mut claims = Claims::default();
        assert!(claims.claim_exclusive(&(64..128)));
        for range in [64..128, 0..65, 127..200, 80..90, 0..300, 64..64] {
            let before = claims.clone();
            assert!(!claims.claim_exclusive(&range), "{range:?}");
            assert!(!claims.claim_shared(&range), "{range:?}");
            assert_eq!(claims, before);
        }
        assert!(claims.claim_exclusive(&(0..64)));
        assert!(claims.claim_exclusive(&(128..129)));
        claims.end(64);
        assert!(claims.claim_shared(&(64..128)));
    }

    #[test]
    fn readers_share_a_range_until_the_last_is_gone() {
        let mut claims = Claims::default();
        assert!(claims.claim_shared(&(64..128)));
        assert!(claims.claim_shared(&(64..128)));
        assert!(!claims.claim_shared(&(64..100)));
        claims.end(64);
        assert!(!claims.claim_exclusive(&(64..128)));
        claims.end(64);
        assert!(claims.claim_exclusive(&(64..128)));
    }
}
