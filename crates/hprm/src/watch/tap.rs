//! Which messages go to which watchers, what each of them may hold, and what is counted: a machine without a socket.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{ChannelId, Nanos, PhysicalTime, PortId, Tag};
use smallvec::SmallVec;

use super::{Tally, Wish};

/// The most messages whose objects a watcher may hold. So while it looks at one, it can get the next one.
const HELD: usize = 2;

/// A message that the federate sends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Sample {
    pub(crate) channel: ChannelId,
    /// The port at which the federate has set the value.
    pub(crate) port: PortId,
    /// The sender's tag.
    pub(crate) tag: Tag,
    /// The time of tag zero.
    pub(crate) start: PhysicalTime,
    /// When it is sent.
    pub(crate) at: PhysicalTime,
    /// How many bytes its value has.
    pub(crate) bytes: u64,
}

/// What a watcher gets of a message.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Share {
    /// All of it.
    Whole,
    /// What is known of it, without a value, because that is too large.
    WithoutValue,
}

/// The watchers that get a message.
pub(super) type Shares = SmallVec<[(u16, Share); 2]>;

/// All watchers of a federate.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Tap {
    watches: BTreeMap<u16, Watch>,
    /// The most bytes of objects that all watchers together may hold.
    room: u64,
}

/// What a watcher watches, and what it has of it.
#[derive(Clone, PartialEq, Debug)]
struct Watch {
    channels: BTreeSet<ChannelId>,
    wish: Wish,
    /// The tag of the last message from each port: a value that goes to several receivers is one for the watcher.
    seen: BTreeMap<PortId, Tag>,
    /// Messages with objects that it has not released: their serial numbers, and all their bytes.
    held: Vec<(Vec<u64>, u64)>,
    dropped: u64,
    tallies: BTreeMap<ChannelId, Tally>,
    /// Since when messages are counted.
    since: PhysicalTime,
}

impl Tap {
    /// A tap without watchers, which may hold that many bytes of objects together.
    pub(super) fn new(room: u64) -> Self {
        Self { watches: BTreeMap::new(), room }
    }

    /// What a watcher wants to see from now on, instead of what it has wanted before.
    pub(super) fn watch(
        &mut self,
        watcher: u16,
        channels: impl IntoIterator<Item = ChannelId>,
        wish: Wish,
        now: PhysicalTime,
    ) {
        let channels: BTreeSet<_> = channels.into_iter().collect();
        let tallies = match wish {
            Wish::Counts => channels.iter().map(|it| (*it, Tally::default())).collect(),
            Wish::Values => BTreeMap::new(),
        };
        let (held, dropped) =
            self.watches.remove(&watcher).map(|old| (old.held, old.dropped)).unwrap_or_default();
        let seen = BTreeMap::new();
        let watch = Watch { channels, wish, seen, held, dropped, tallies, since: now };
        self.watches.insert(watcher, watch);
    }

    /// A watcher is gone.
    pub(super) fn forget(&mut self, watcher: u16) {
        self.watches.remove(&watcher);
    }

    /// Whether no channel is watched.
    #[inline]
    pub(super) fn is_idle(&self) -> bool {
        self.watches.is_empty()
    }

    /// Whether a watcher wants to see the values of a channel.
    pub(super) fn wants_values(&self, channel: ChannelId) -> bool {
        let wants = |it: &Watch| it.wish == Wish::Values && it.channels.contains(&channel);
        self.watches.values().any(wants)
    }

    /// Counts a message, whose objects have that many bytes, and returns which watchers get it.
    pub(super) fn offer(&mut self, sample: &Sample, objects: u64) -> Shares {
        let mut room = self.room.saturating_sub(self.held());
        let mut shares = Shares::new();
        for (watcher, watch) in &mut self.watches {
            if !watch.channels.contains(&sample.channel) {
                continue;
            }
            if let Some(tally) = watch.tallies.get_mut(&sample.channel) {
                tally.count(sample.bytes, sample.at);
                continue;
            }
            if watch.seen.insert(sample.port, sample.tag) == Some(sample.tag) {
                continue;
            }
            if objects == 0 {
                shares.push((*watcher, Share::Whole));
            } else if objects > self.room {
                shares.push((*watcher, Share::WithoutValue));
            } else if watch.held.len() >= HELD || objects > room {
                watch.dropped += 1;
            } else {
                room -= objects;
                shares.push((*watcher, Share::Whole));
            }
        }
        shares
    }

    /// How many bytes of objects the watchers hold.
    fn held(&self) -> u64 {
        self.watches.values().flat_map(|it| &it.held).map(|(_, bytes)| bytes).sum()
    }

    /// A watcher holds the objects of a message from now on, if there are any.
    pub(super) fn took(&mut self, watcher: u16, objects: impl IntoIterator<Item = (u64, u64)>) {
        let Some(watch) = self.watches.get_mut(&watcher) else { return };
        let (mut serials, mut bytes) = (Vec::new(), 0);
        for (serial, len) in objects {
            serials.push(serial);
            bytes += len;
        }
        if !serials.is_empty() {
            watch.held.push((serials, bytes));
        }
    }

    /// A message did not get through to a watcher.
    pub(super) fn dropped(&mut self, watcher: u16) {
        if let Some(watch) = self.watches.get_mut(&watcher) {
            watch.dropped += 1;
        }
    }

    /// How many messages a watcher has not got.
    pub(super) fn missed(&self, watcher: u16) -> u64 {
        self.watches.get(&watcher).map_or(0, |watch| watch.dropped)
    }

    /// A watcher has released an object once. False if it does not hold it.
    pub(super) fn released(&mut self, watcher: u16, serial: u64) -> bool {
        let Some(watch) = self.watches.get_mut(&watcher) else { return false };
        let position = |serials: &Vec<u64>| serials.iter().position(|held| *held == serial);
        let found =
            watch.held.iter_mut().find_map(|(serials, _)| Some((position(serials)?, serials)));
        let Some((at, serials)) = found else { return false };
        serials.swap_remove(at);
        watch.held.retain(|(serials, _)| !serials.is_empty());
        true
    }

    /// What has been counted for a watcher since it asked before, and how long that is.
    pub(super) fn counts(
        &mut self,
        watcher: u16,
        now: PhysicalTime,
    ) -> (Nanos, Vec<(ChannelId, Tally)>) {
        let Some(watch) = self.watches.get_mut(&watcher) else { return (0, Vec::new()) };
        let span = now.since(std::mem::replace(&mut watch.since, now));
        (span, watch.tallies.iter_mut().map(|(channel, tally)| (*channel, tally.take())).collect())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const ROOM: u64 = 1_000;
    const NOW: PhysicalTime = PhysicalTime(0);

    fn sample(channel: u32, port: u32, time: i64) -> Sample {
        let tag = Tag { time, microstep: 0 };
        let (channel, port) = (ChannelId(channel), PortId(port));
        let at = PhysicalTime(time);
        Sample { channel, port, tag, start: NOW, at, bytes: 8 }
    }

    fn watching(wish: Wish) -> Tap {
        let mut tap = Tap::new(ROOM);
        tap.watch(0, [ChannelId(1), ChannelId(2)], wish, NOW);
        tap
    }

    #[test]
    fn only_watched_channels_are_shown() {
        let mut tap = watching(Wish::Values);
        assert!(tap.offer(&sample(3, 0, 0), 0).is_empty());
        assert_eq!(tap.offer(&sample(1, 0, 0), 0)[..], [(0, Share::Whole)]);
        assert!(tap.wants_values(ChannelId(2)) && !tap.wants_values(ChannelId(3)));
        tap.forget(0);
        assert!(tap.is_idle() && tap.offer(&sample(1, 0, 1), 0).is_empty());
    }

    #[test]
    fn a_value_for_several_receivers_is_shown_once() {
        let mut tap = watching(Wish::Values);
        assert_eq!(tap.offer(&sample(1, 9, 5), 0).len(), 1);
        assert!(tap.offer(&sample(2, 9, 5), 0).is_empty());
        assert_eq!(tap.offer(&sample(2, 9, 6), 0).len(), 1);
        assert_eq!(tap.missed(0), 0);
    }

    #[test]
    fn a_watcher_that_releases_nothing_gets_a_few_objects() {
        let mut tap = watching(Wish::Values);
        for time in 0..10 {
            for (watcher, _) in tap.offer(&sample(1, 0, time), 100) {
                tap.took(watcher, [(time.cast_unsigned(), 100)]);
            }
        }
        assert_eq!(tap.missed(0), 8);
        // What has no objects gets through.
        assert_eq!(tap.offer(&sample(1, 0, 10), 0).len(), 1);
        assert!(tap.released(0, 1) && !tap.released(0, 1));
        assert_eq!(tap.offer(&sample(1, 0, 11), 100)[..], [(0, Share::Whole)]);
    }

    #[test]
    fn a_message_is_held_until_its_last_object_is_released() {
        let mut tap = watching(Wish::Values);
        tap.took(0, [(1, 300), (2, 300)]);
        assert_eq!(tap.held(), 600);
        assert!(tap.released(0, 1));
        assert_eq!(tap.held(), 600);
        assert!(tap.released(0, 2));
        assert_eq!(tap.held(), 0);
    }

    #[test]
    fn a_value_that_watchers_may_never_hold_is_shown_without_it() {
        let mut tap = watching(Wish::Values);
        assert_eq!(tap.offer(&sample(1, 0, 0), ROOM + 1)[..], [(0, Share::WithoutValue)]);
        assert_eq!(tap.missed(0), 0);
    }

    #[test]
    fn counts_are_exact_and_begin_anew() {
        let mut tap = watching(Wish::Counts);
        assert!(tap.offer(&sample(1, 0, 10), 100).is_empty());
        assert!(tap.offer(&sample(1, 0, 30), 100).is_empty());
        let (span, tallies) = tap.counts(0, PhysicalTime(100));
        assert_eq!((span, tallies.len()), (100, 2));
        assert_eq!((tallies[0].1.messages, tallies[0].1.bytes), (2, 16));
        assert_eq!(tap.counts(0, PhysicalTime(150)).1[0].1.messages, 0);
    }

    proptest! {
        /// Whatever watchers do, together they hold no more than they may, none more than a few messages, and each
        /// message is shown or counted as dropped.
        #[test]
        fn holds_are_bounded_and_nothing_is_lost_without_a_word(
            steps in prop::collection::vec((0..3_u16, 1..600_u64, any::<bool>()), 1..100),
        ) {
            let mut tap = Tap::new(ROOM);
            for watcher in 0..3 {
                tap.watch(watcher, [ChannelId(1)], Wish::Values, NOW);
            }
            let mut holds = vec![Vec::new(); 3];
            let mut shown = [0; 3];
            for (step, (watcher, bytes, releases)) in steps.iter().enumerate() {
                let step = step as u64;
                if *releases && let Some(serial) = holds[usize::from(*watcher)].pop() {
                    prop_assert!(tap.released(*watcher, serial));
                }
                for (watcher, share) in tap.offer(&sample(1, 0, step.cast_signed()), *bytes) {
                    prop_assert_eq!(share, Share::Whole);
                    tap.took(watcher, [(step, *bytes)]);
                    holds[usize::from(watcher)].push(step);
                    shown[usize::from(watcher)] += 1;
                }
                prop_assert!(tap.held() <= ROOM);
                prop_assert!(holds.iter().all(|it| it.len() <= HELD));
            }
            for (watcher, shown) in (0..).zip(shown) {
                prop_assert_eq!(shown + tap.missed(watcher), steps.len() as u64);
            }
        }
    }
}
