//! The boards of a federation in memory: this federate's own, and those of the others as it reads them.
//!
//! What is on them is a [`Posting`] of the federate's machine, which decides what follows from it. Here is how it gets
//! from one process to another, and how none of them sleeps while its board tells that it need not wait: a federate
//! posts what it waits for, says that it sleeps and heeds the boards, and then looks once more at those of the others; each of
//! these posts, and then looks whether a federate sleeps that heeds that. Whichever of both comes first, the other one
//! sees it.
//!
//! Most federates sleep until a message comes or the clock gets somewhere. They heed no boards, and no other federate
//! looks at what they show.

use std::io;
use std::os::fd::OwnedFd;

use hprm_core::{FederateId, Nanos, PhysicalTime, SortedMap, Tag};
use hprm_federated::{Input, Permission, Posting, Step, Tally};
use hprm_store::{Board, BoardLayout, BoardView};

use super::membership::Membership;
use super::{FederateLoop, Phase};
use crate::notifier::RemoteNotifier;
use crate::{Failure, Host};

/// The name of the memory, as `/proc/PID/fd` shows it after `/memfd:`.
const NAME: &str = "hprm-coordination";

/// The cell with the posting.
const POSTING: usize = 0;

/// The lane that says whether the owner sleeps.
const SLEEP: usize = 0;

/// What is in the lane of a federate that does not sleep, of one that sleeps, and of one that sleeps until a board
/// says that it need not.
const AWAKE: u64 = 0;
const ASLEEP: u64 = 1;
const HEEDFUL: u64 = 2;

/// How many words a posting has before its tallies, and each tally.
const HEAD: usize = 7;
const TALLY: usize = 3;

const WORD: usize = size_of::<u64>();

/// How long a federate that goes on without the boards leaves them unread, in nanoseconds.
const UNREAD: Nanos = 100_000;

/// See the module.
#[derive(Debug)]
pub(crate) struct Boards {
    own: Board,
    others: SortedMap<FederateId, Other>,
    /// Whether this federate has posted since it last looked which federates that releases.
    posted: bool,
    /// When it last read the boards of the others at the beginning of a round.
    read_at: PhysicalTime,
    /// Whether what the others show may let it go on.
    heeds: bool,
    bytes: Vec<u8>,
    /// Room for the tallies of the next posting that is read.
    tallies: Vec<Tally>,
}

/// What this federate has of another one.
#[derive(Debug, Default)]
struct Other {
    board: Option<BoardView>,
    notifier: Option<RemoteNotifier>,
    /// How many postings there were when this federate last read the board.
    read: u64,
}

impl Boards {
    /// The board of this federate, which shows so many tallies.
    pub(super) fn new(tallies: usize) -> Result<Self, Failure> {
        let layout = BoardLayout { lanes: 1, cells: vec![(HEAD + TALLY * tallies) * WORD] };
        let own = Board::named(NAME, layout).map_err(|error| Failure::store(&error))?;
        own.open();
        Ok(Self {
            own,
            others: SortedMap::new(),
            posted: false,
            read_at: PhysicalTime(0),
            heeds: true,
            bytes: Vec::new(),
            tallies: Vec::new(),
        })
    }

    /// The descriptor by which others map the board of this federate.
    pub(super) fn descriptor(&self) -> io::Result<OwnedFd> {
        self.own.descriptor()
    }

    pub(super) fn attach(
        &mut self,
        owner: FederateId,
        notifier: bool,
        descriptor: OwnedFd,
    ) -> Result<(), Failure> {
        let other = self.others.or_default(owner);
        if notifier {
            let remote = RemoteNotifier::new(descriptor);
            let failed = |error| Failure::system("cannot wake up another federate", &error);
            other.notifier = Some(remote.map_err(failed)?);
            return Ok(());
        }
        let view = BoardView::map(&descriptor).map_err(|error| Failure::store(&error))?;
        other.board = Some(view.ok_or_else(|| Failure::store(&"what came is no board"))?);
        // It may be that of a successor.
        other.read = 0;
        Ok(())
    }

    /// Shows something new.
    pub(super) fn post(&mut self, posting: Posting) {
        self.bytes.clear();
        write(&posting, &mut self.bytes);
        self.tallies = posting.tallies;
        let fits = self.own.publish(POSTING, &self.bytes);
        debug_assert!(fits, "a board has room for the tallies of its owner");
        self.posted = true;
    }

    /// Whether this federate has posted since the last call. All that the others have shown before that can be
    /// read then.
    pub(super) fn take_posted(&mut self) -> bool {
        let posted = std::mem::take(&mut self.posted);
        if posted {
            self.own.before_look();
        }
        posted
    }

    /// Whether another federate shows something new that may let this one go on.
    pub(crate) fn have_news(&self) -> bool {
        self.heeds && self.others.values().any(|it| it.publications() != it.read)
    }

    /// Whether another federate sleeps until a board says that it need not.
    fn are_heeded(&self) -> bool {
        self.others.values().any(|it| it.sleep() == Some(HEEDFUL))
    }

    /// What the first of the other federates shows that shows something new, of those that `looked_at` does not count yet.
    pub(super) fn next_news(&mut self, looked_at: &mut usize) -> Option<(FederateId, Posting)> {
        for (federate, other) in self.others.iter_mut().skip(*looked_at) {
            *looked_at += 1;
            let count = other.publications();
            if count == other.read {
                continue;
            }
            let found = other.board.as_ref().filter(|it| it.read_into(POSTING, &mut self.bytes));
            // One that is being written again and again is read in the next round.
            let posting = found.and_then(|_| read(&self.bytes, &mut self.tallies));
            if let Some(posting) = posting {
                other.read = count;
                return Some((*federate, posting));
            }
        }
        None
    }

    /// Wakes up a federate, if it sleeps.
    pub(super) fn wake_up(&self, federate: FederateId) {
        let Some(other) = self.others.get(&federate) else { return };
        let sleeps = other.sleep().is_some_and(|sleep| sleep != AWAKE);
        if sleeps && let Some(notifier) = &other.notifier {
            notifier.notify();
        }
    }

    /// From now on, others wake this federate up. It must look at the boards once more.
    pub(crate) fn announce_sleep(&self) {
        self.own.set_lane(SLEEP, if self.heeds { HEEDFUL } else { ASLEEP });
        self.own.before_look();
    }

    /// This federate is awake.
    pub(crate) fn end_sleep(&self) {
        self.own.set_lane(SLEEP, AWAKE);
    }
}

impl Other {
    fn publications(&self) -> u64 {
        self.board.as_ref().map_or(0, |board| board.publications(POSTING))
    }

    /// Whether it sleeps, and heeds boards.
    fn sleep(&self) -> Option<u64> {
        self.board.as_ref()?.lane(SLEEP)
    }
}

impl<H: Host> FederateLoop<'_, H>
where
    H::Value: Send + Sync,
{
    /// Reads what other federates show, unless this one has no use for it: its next tag is not due, or its messages tell that
    /// that may begin. Memory that a receiver leaves alone stays in the cache of the processor that posts.
    pub(super) fn read_boards_if_needed(&mut self) -> Result<(), Failure> {
        let Some(boards) = self.federation.links.boards() else { return Ok(()) };
        let is_new = (0..UNREAD).contains(&self.now.since(boards.read_at));
        if is_new && !self.has_use_for_boards() {
            return Ok(());
        }
        if let Some(boards) = self.federation.links.boards() {
            boards.read_at = self.now;
        }
        self.read_boards().map(drop)
    }

    /// Whether what others show may let this federate go on at once, or answer the RTI.
    fn has_use_for_boards(&self) -> bool {
        let (tag, machine) = (self.scheduler.next_tag(), &self.federation.machine);
        let is_due = || tag < Tag::FOREVER && self.due(tag) <= self.now;
        self.phase != Phase::Running
            || machine.heeds_boards()
            || is_due() && machine.permission(tag, self.now) != Permission::Granted
    }

    /// Reads what other federates show. Returns whether anything was new.
    pub(super) fn read_boards(&mut self) -> Result<bool, Failure> {
        let (mut looked_at, mut any) = (0, false);
        while let Some(boards) = self.federation.links.boards()
            && let Some((from, posting)) = boards.next_news(&mut looked_at)
        {
            self.handle(Input::Board { from, posting })?;
            any = true;
        }
        Ok(any)
    }

    /// After this federate has shown something new: wakes up those that wait for that. Returns whether it has found
    /// something new itself.
    pub(super) fn wake_up_others(&mut self) -> Result<bool, Failure> {
        let Membership { machine, links, .. } = &mut self.federation;
        let Some(boards) = links.boards() else { return Ok(false) };
        boards.heeds = machine.heeds_boards();
        if !boards.take_posted() || !boards.are_heeded() {
            return Ok(false);
        }
        let any = self.read_boards()?;
        let Membership { machine, links, .. } = &mut self.federation;
        if let Some(boards) = links.boards() {
            machine.released().into_iter().for_each(|federate| boards.wake_up(federate));
        }
        Ok(any)
    }
}

fn write(posting: &Posting, bytes: &mut Vec<u8>) {
    let Posting { next, waits, departs, ended, life, ref tallies } = *posting;
    let mut put = |word: u64| bytes.extend_from_slice(&word.to_le_bytes());
    for step in [next, waits] {
        put(step.tag.time.cast_unsigned());
        put(u64::from(step.tag.microstep));
        put(u64::from(step.level));
    }
    put(u64::from(departs) | u64::from(ended) << 1 | u64::from(life) << 32);
    for Tally { messages, latest, life } in tallies {
        put(*messages);
        put(latest.time.cast_unsigned());
        put(u64::from(latest.microstep) << 32 | u64::from(*life));
    }
}

/// The posting that was written so, in room for its tallies; none, if the bytes are something else.
fn read(bytes: &[u8], room: &mut Vec<Tally>) -> Option<Posting> {
    let (words, []) = bytes.as_chunks::<WORD>() else { return None };
    let mut words = words.iter().map(|word| u64::from_le_bytes(*word));
    let next = step(&mut words)?;
    let waits = step(&mut words)?;
    let word = words.next()?;
    let (flags, life) = (word & u64::from(u32::MAX), u32::try_from(word >> 32).ok()?);
    let mut tallies = std::mem::take(room);
    tallies.clear();
    while words.len() >= TALLY {
        tallies.push(tally(&mut words)?);
    }
    let [departs, ended] = [1, 2].map(|flag| flags & flag > 0);
    Some(Posting { next, waits, departs, ended, life, tallies })
}

/// The microstep and the number of the process share a word.
fn tally(words: &mut impl Iterator<Item = u64>) -> Option<Tally> {
    let (messages, time, word) = (words.next()?, words.next()?.cast_signed(), words.next()?);
    let [microstep, life] = [word >> 32, word & u64::from(u32::MAX)].map(u32::try_from);
    Some(Tally { messages, latest: Tag { time, microstep: microstep.ok()? }, life: life.ok()? })
}

fn step(words: &mut impl Iterator<Item = u64>) -> Option<Step> {
    Some(Step { tag: tag(words)?, level: words.next()?.try_into().ok()? })
}

fn tag(words: &mut impl Iterator<Item = u64>) -> Option<Tag> {
    Some(Tag { time: words.next()?.cast_signed(), microstep: words.next()?.try_into().ok()? })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::notifier::Notifier;

    fn any_tag() -> impl Strategy<Value = Tag> {
        let tag =
            (any::<i64>(), any::<u32>()).prop_map(|(time, microstep)| Tag { time, microstep });
        prop_oneof![Just(Tag::NEVER), Just(Tag::FOREVER), tag]
    }

    fn any_step() -> impl Strategy<Value = Step> {
        (any_tag(), any::<u32>()).prop_map(|(tag, level)| Step { tag, level })
    }

    fn any_posting() -> impl Strategy<Value = Posting> {
        let tally = (any::<u64>(), any_tag(), any::<u32>());
        let tally = tally.prop_map(|(messages, latest, life)| Tally { messages, latest, life });
        let tallies = prop::collection::vec(tally, 0..9);
        let parts = (any_step(), any_step(), any::<(bool, bool, u32)>(), tallies);
        parts.prop_map(|(next, waits, (departs, ended, life), tallies)| Posting {
            next,
            waits,
            departs,
            ended,
            life,
            tallies,
        })
    }

    proptest! {
        #[test]
        fn a_posting_is_read_as_it_was_written(posting in any_posting()) {
            let mut bytes = Vec::new();
            write(&posting, &mut bytes);
            prop_assert_eq!(bytes.len(), (HEAD + TALLY * posting.tallies.len()) * WORD);
            prop_assert_eq!(read(&bytes, &mut Vec::new()), Some(posting));
        }

        #[test]
        fn any_bytes_are_a_posting_or_none(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Some(posting) = read(&bytes, &mut Vec::new()) {
                prop_assert!(posting.tallies.len() * TALLY * WORD <= bytes.len());
            }
        }
    }

    /// Two federates that read each other's boards.
    fn pair() -> [(Boards, Notifier); 2] {
        let mut pair = [0, 1].map(|_| (Boards::new(1).unwrap(), Notifier::new().unwrap()));
        for (me, other) in [(0, 1), (1, 0)] {
            let owner = FederateId(u16::try_from(other).unwrap());
            let board = pair[other].0.descriptor().unwrap();
            let notifier = std::os::fd::AsFd::as_fd(&pair[other].1).try_clone_to_owned().unwrap();
            pair[me].0.attach(owner, false, board).unwrap();
            pair[me].0.attach(owner, true, notifier).unwrap();
        }
        pair
    }

    fn counted(messages: u64) -> Posting {
        let tallies = vec![Tally { messages, latest: Tag::START, life: 0 }];
        let (next, waits) = (Step::begin(Tag::START), Step::NEVER);
        Posting { next, waits, departs: false, ended: false, life: 0, tallies }
    }

    fn news(boards: &mut Boards) -> Option<(FederateId, Posting)> {
        boards.next_news(&mut 0)
    }

    #[test]
    fn what_is_posted_is_news_once() {
        let [(mut a, _), (mut b, _)] = pair();
        assert!(!b.have_news() && news(&mut b).is_none() && !a.take_posted());
        a.post(counted(1));
        a.post(counted(2));
        assert!(b.have_news() && a.take_posted() && !a.take_posted());
        assert_eq!(news(&mut b), Some((FederateId(0), counted(2))));
        assert!(!b.have_news() && news(&mut b).is_none());
    }

    #[test]
    fn only_one_that_sleeps_and_heeds_boards_is_looked_after() {
        let [(mut a, _), (mut b, _)] = pair();
        assert!(!a.are_heeded());
        b.announce_sleep();
        assert!(a.are_heeded());
        b.end_sleep();
        assert!(!a.are_heeded());
        b.heeds = false;
        b.announce_sleep();
        a.post(counted(1));
        assert!(!a.are_heeded() && !b.have_news());
        assert!(news(&mut b).is_some(), "it may be read nevertheless");
    }

    #[test]
    fn what_is_no_board_is_refused() {
        let [(mut a, _), (_, notifier)] = pair();
        let other = std::os::fd::AsFd::as_fd(&notifier).try_clone_to_owned().unwrap();
        assert!(a.attach(FederateId(1), false, other).is_err());
    }

    /// Each federate counts on when the other one has, and sleeps without a limit meanwhile: a wake-up that is lost
    /// would be a test that does not end.
    #[test]
    #[allow(clippy::disallowed_methods, reason = "two federates are two threads")]
    fn no_wake_up_is_lost() {
        const ROUNDS: u64 = 100_000;
        let [a, b] = pair();
        let play = |(mut boards, notifier): (Boards, Notifier), me: u16, first: u64| {
            let other = FederateId(1 - me);
            let mut mine = first;
            while mine < ROUNDS {
                boards.post(counted(mine));
                assert!(boards.take_posted());
                boards.wake_up(other);
                let wanted = mine + 1;
                loop {
                    let theirs = news(&mut boards).map_or(0, |(_, it)| it.tallies[0].messages);
                    if theirs >= wanted {
                        break;
                    }
                    boards.announce_sleep();
                    if !boards.have_news() {
                        let interest = crate::wait::Interest {
                            fd: std::os::fd::AsFd::as_fd(&notifier),
                            write: false,
                        };
                        crate::wait::wait(&[interest], None);
                    }
                    boards.end_sleep();
                    notifier.clear();
                }
                mine += 2;
            }
            boards.post(counted(mine));
            boards.take_posted();
            boards.wake_up(other);
        };
        let other = std::thread::spawn(move || play(b, 1, 2));
        play(a, 0, 1);
        other.join().unwrap();
    }
}
