//! Flow control: a federate does not get so far ahead of its receivers that messages pile up.
//!
//! A sender counts what it has sent and its receivers have not processed; a receiver reports from time
//! to time how much it has processed. A federate does not begin a tag while more than a limit of what
//! it sent to one receiver, *at earlier tags than that one*, is unprocessed.
//!
//! The restriction in italics is why no federate waits for ever. A receiver waits for its senders only
//! up to the tag that it wants to process. So a cycle of federates that wait for one another, some for
//! messages and some because their receivers lag, would lead from each tag to an earlier one or the
//! same, and to an earlier one wherever a receiver lags: it cannot close. Messages for later tags, on a
//! connection with a delay, are what the program asks for, and do not count.
//!
//! A message on a physical channel counts until its receiver has read it: it gets its tag there, and no
//! federate knows how that tag compares with the sender's. If the channel blocks its sender (`@bound`), the
//! messages are counted too, until the receiver has processed them, and the sender begins no tag while as many
//! as the bound are unprocessed: at a tag it sends no more than one on each channel. That this makes no
//! cycle of federates that wait is checked before the program runs.

use std::collections::VecDeque;

use hprm_core::{Channel, ChannelId, FederateId, Payload, SortedMap, Tag};

use crate::{Blocker, Frame, Topology, codec};

/// How many bytes a message counts for besides its own: the memory that it takes in queues.
const OVERHEAD: u64 = 128;

/// The length of an object in the store counts divided by this number: the object is there once for all of its
/// readers, and the store has a limit of its own.
const OBJECT_DIVISOR: u64 = 16;

/// How many groups a limit is divided into, at least. Messages are counted in groups, so that a long
/// queue of small ones is a short list.
const GROUPS: u64 = 64;

/// A receiver may leave the limit divided by this number unreported, in all its channels from one sender
/// together. As much again may be in groups that the receiver has processed in part.
const UNREPORTED: u64 = 4;

/// Messages of one channel that follow one another.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
struct Group {
    /// The tag of the last of them, and the latest.
    last: Tag,
    messages: u64,
    bytes: u64,
}

/// The messages of one channel that are in transit, oldest first.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
struct Backlog(VecDeque<Group>);

impl Backlog {
    /// Adds a message to the last group, unless that has `group_bytes` bytes already.
    fn push(&mut self, tag: Tag, bytes: u64, group_bytes: u64) {
        match self.0.back_mut() {
            Some(group) if group.bytes < group_bytes => {
                group.last = group.last.max(tag);
                group.messages += 1;
                group.bytes = group.bytes.saturating_add(bytes);
            }
            _ => self.0.push_back(Group { last: tag, messages: 1, bytes }),
        }
    }

    /// Removes messages, oldest first. Returns how many bytes they were.
    fn take(&mut self, mut messages: u64, mut bytes: u64) -> u64 {
        let mut taken = 0;
        while messages > 0
            && let Some(group) = self.0.front_mut()
        {
            if messages >= group.messages {
                messages -= group.messages;
                bytes = bytes.saturating_sub(group.bytes);
                taken = group.bytes.saturating_add(taken);
                self.0.pop_front();
            } else {
                // A part of the group is left; the receiver has reported how many bytes it has processed.
                let part = bytes.min(group.bytes);
                group.messages -= messages;
                group.bytes -= part;
                return part.saturating_add(taken);
            }
        }
        taken
    }

    /// The bytes of groups that are wholly before `tag`.
    fn before(&self, tag: Tag) -> u64 {
        self.0
            .iter()
            .take_while(|group| group.last < tag)
            .map(|group| group.bytes)
            .fold(0, u64::saturating_add)
    }
}

/// What was sent to one receiver, and is not known to be processed.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
struct Receiver {
    channels: SortedMap<ChannelId, Backlog>,
    /// Bytes in all of them.
    bytes: u64,
}

impl Receiver {
    /// The bytes that were sent at tags before this one.
    fn before(&self, tag: Tag) -> u64 {
        self.channels.values().map(|backlog| backlog.before(tag)).fold(0, u64::saturating_add)
    }
}

/// A channel that blocks its sender: the state at the sender.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
struct BoundedOutgoing {
    to: FederateId,
    /// How many messages may be unprocessed.
    bound: u64,
    /// How many were sent and are not known to be processed.
    unprocessed: u64,
}

/// A channel that blocks its sender: the state at the receiver, which is for how many bytes each unprocessed
/// message counts.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
struct BoundedIncoming {
    /// Messages that have not got a tag at the receiver yet.
    untagged: VecDeque<u64>,
    /// Messages that wait for their tags.
    tagged: VecDeque<(Tag, u64)>,
}

/// The messages of a channel that have arrived, and that the receiver has not reported as processed.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Incoming {
    from: FederateId,
    physical: bool,
    /// From how many bytes on the receiver sends a report.
    report_threshold: u64,
    backlog: Backlog,
    /// Present if the channel blocks its sender. Then `backlog` stays empty.
    bounded: Option<BoundedIncoming>,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Flow {
    limit: u64,
    receivers: SortedMap<FederateId, Receiver>,
    /// Whether more than the limit is in transit to some receiver, at whatever tags.
    is_over: bool,
    incoming: SortedMap<ChannelId, Incoming>,
    /// How many groups of messages that have arrived are large enough for a report.
    reportable_groups: usize,
    bounded: SortedMap<ChannelId, BoundedOutgoing>,
    /// How many messages on channels that block their senders wait at this receiver for their tags.
    waiting: usize,
    has_references: bool,
}

impl Flow {
    /// Nothing has been sent or received. At most `limit` bytes are to be in transit to a receiver.
    pub(crate) fn new(topology: &Topology, me: FederateId, limit: u64) -> Self {
        let channels = || topology.channels().iter();
        let incoming = channels().filter(|(_, channel)| channel.to == me).map(|(id, channel)| {
            let Channel { from, physical, .. } = *channel;
            let parallel = channels().filter(|(_, other)| other.from == from && other.to == me);
            let report_threshold = limit / UNREPORTED / (parallel.count() as u64).max(1);
            let (report_threshold, backlog) = (report_threshold.max(1), Backlog::default());
            let bounded = topology.bound(id).map(|_| BoundedIncoming::default());
            (id, Incoming { from, physical, report_threshold, backlog, bounded })
        });
        let bounded =
            channels().filter(|(_, channel)| channel.from == me).filter_map(|(id, it)| {
                let bound = topology.bound(id)?.into();
                Some((id, BoundedOutgoing { to: it.to, bound, unprocessed: 0 }))
            });
        Self {
            limit,
            receivers: SortedMap::new(),
            is_over: false,
            incoming: incoming.collect(),
            reportable_groups: 0,
            bounded: bounded.collect(),
            waiting: 0,
            has_references: false,
        }
    }

    /// Messages are references to values of this process.
    pub(crate) fn count_references(&mut self) {
        self.has_references = true;
    }

    /// How many bytes a message counts for.
    fn weight(&self, payload: &Payload) -> u64 {
        match payload.referred().filter(|_| self.has_references) {
            Some((_, bytes)) => OVERHEAD.saturating_add(bytes / OBJECT_DIVISOR),
            None => weight(payload),
        }
    }

    // As a sender.

    /// A message leaves on a channel. One on a physical channel has the tag at which it was sent.
    pub(crate) fn sent(&mut self, to: FederateId, channel: ChannelId, tag: Tag, payload: &Payload) {
        let bytes = self.weight(payload);
        let receiver = self.receivers.or_default(to);
        receiver.bytes = receiver.bytes.saturating_add(bytes);
        self.is_over |= receiver.bytes > self.limit;
        receiver.channels.or_default(channel).push(tag, bytes, self.limit / GROUPS);
        if let Some(bounded) = self.bounded.get_mut(&channel) {
            bounded.unprocessed += 1;
        }
    }

    /// A receiver has processed that many more messages of a channel.
    pub(crate) fn processed(
        &mut self,
        reader: FederateId,
        channel: ChannelId,
        messages: u64,
        bytes: u64,
    ) {
        if let Some(bounded) = self.bounded.get_mut(&channel) {
            bounded.unprocessed = bounded.unprocessed.saturating_sub(messages);
        }
        // The report may be about messages to an earlier incarnation of the receiver.
        let Some(receiver) = self.receivers.get_mut(&reader) else { return };
        let Some(backlog) = receiver.channels.get_mut(&channel) else { return };
        receiver.bytes = receiver.bytes.saturating_sub(backlog.take(messages, bytes));
        self.look_at_receivers();
    }

    /// After less is in transit than before.
    fn look_at_receivers(&mut self) {
        self.is_over &= self.receivers.values().any(|receiver| receiver.bytes > self.limit);
    }

    /// Whether this federate is too far ahead of a receiver to begin `tag`.
    pub(crate) fn is_ahead(&self, tag: Tag) -> bool {
        self.is_over
            && self
                .receivers
                .values()
                .any(|receiver| receiver.bytes > self.limit && receiver.before(tag) > self.limit)
    }

    /// Whether a message of the next tag might find no room at a receiver.
    pub(crate) fn is_full(&self) -> bool {
        self.bounded.values().any(|bounded| bounded.unprocessed >= bounded.bound)
    }

    /// The receivers that keep this federate from beginning `tag`.
    pub(crate) fn blockers(&self, tag: Tag) -> impl Iterator<Item = Blocker> {
        let limit = self.limit;
        let ahead = self.receivers.iter().filter_map(move |(receiver, it)| {
            let bytes = it.before(tag);
            let blocker = Blocker::Unprocessed { receiver: *receiver, bytes, limit };
            (bytes > limit).then_some(blocker)
        });
        let full = self.bounded.iter().filter(|(_, it)| it.unprocessed >= it.bound);
        ahead.chain(full.map(|(channel, it)| Blocker::Bound {
            channel: *channel,
            receiver: it.to,
            messages: it.unprocessed,
        }))
    }

    // As a receiver.

    /// A message has arrived.
    pub(crate) fn arrived(&mut self, channel: ChannelId, tag: Tag, payload: &Payload) {
        let bytes = self.weight(payload);
        let Some(incoming) = self.incoming.get_mut(&channel) else { return };
        if let Some(bounded) = &mut incoming.bounded {
            bounded.untagged.push_back(bytes);
            return;
        }
        let tag = if incoming.physical { Tag::NEVER } else { tag };
        incoming.backlog.push(tag, bytes, incoming.report_threshold);
        let is_reportable =
            incoming.backlog.0.back().is_some_and(|group| group.bytes >= incoming.report_threshold);
        self.reportable_groups += usize::from(is_reportable);
    }

    /// This federate has processed everything before `tag`, and read every physical message. Returns the
    /// reports to the senders.
    pub(crate) fn reached(&mut self, tag: Tag) -> Vec<(FederateId, Frame)> {
        let mut reports = Vec::new();
        if self.reportable_groups == 0 {
            return reports;
        }
        for (id, incoming) in self.incoming.iter_mut() {
            let (groups, report) = incoming.report(*id, tag);
            self.reportable_groups -= groups;
            reports.extend(report);
        }
        reports
    }

    /// The oldest message without a tag on a physical channel gets this `tag`, at which it will be processed. It
    /// gets none if it will never be processed.
    pub(crate) fn assign_tag(&mut self, channel: ChannelId, tag: Option<Tag>) {
        let incoming = self.incoming.get_mut(&channel);
        if let Some(bounded) = incoming.and_then(|incoming| incoming.bounded.as_mut())
            && let Some(bytes) = bounded.untagged.pop_front()
        {
            bounded.tagged.push_back((tag.unwrap_or(Tag::NEVER), bytes));
            self.waiting += 1;
        }
    }

    /// This federate has processed everything through `tag`. Returns the reports to senders that may wait.
    pub(crate) fn completed(&mut self, tag: Tag) -> Vec<(FederateId, Frame)> {
        let mut reports = Vec::new();
        if self.waiting == 0 {
            return reports;
        }
        for (id, incoming) in self.incoming.iter_mut() {
            let Some(bounded) = &mut incoming.bounded else { continue };
            let (mut messages, mut bytes) = (0, 0_u64);
            while let Some((at, taken)) = bounded.tagged.front().copied()
                && at <= tag
            {
                bounded.tagged.pop_front();
                messages += 1;
                bytes = bytes.saturating_add(taken);
            }
            if messages > 0 {
                self.waiting -= usize::try_from(messages).unwrap_or(usize::MAX);
                let frame = Frame::Processed { channel: *id, messages, bytes };
                reports.push((incoming.from, frame));
            }
        }
        reports
    }

    /// A federate has ended, or joins again: what was in transit to it or from it does not count.
    pub(crate) fn forget(&mut self, peer: FederateId) {
        self.receivers.remove(&peer);
        self.look_at_receivers();
        for bounded in self.bounded.values_mut().filter(|bounded| bounded.to == peer) {
            bounded.unprocessed = 0;
        }
        for incoming in self.incoming.values_mut().filter(|incoming| incoming.from == peer) {
            let groups = std::mem::take(&mut incoming.backlog).0;
            self.reportable_groups -=
                groups.iter().filter(|group| group.bytes >= incoming.report_threshold).count();
            if let Some(bounded) = &mut incoming.bounded {
                self.waiting -= std::mem::take(bounded).tagged.len();
            }
        }
    }
}

impl Incoming {
    /// The report on the messages that have been processed before `tag`, if they are enough for one, and how
    /// many groups they are.
    fn report(&mut self, channel: ChannelId, tag: Tag) -> (usize, Option<(FederateId, Frame)>) {
        let (mut groups, mut messages, mut bytes) = (0, 0, 0);
        while let Some(group) = self.backlog.0.front()
            && group.bytes >= self.report_threshold
            && group.last < tag
        {
            groups += 1;
            messages += group.messages;
            bytes = group.bytes.saturating_add(bytes);
            self.backlog.0.pop_front();
        }
        let frame = Frame::Processed { channel, messages, bytes };
        (groups, (groups > 0).then_some((self.from, frame)))
    }
}

/// How many bytes a message counts for.
fn weight(payload: &Payload) -> u64 {
    if payload.parts.is_empty() {
        return OVERHEAD.saturating_add(payload.head.len() as u64);
    }
    let inline = codec::buffers_of(payload).map(|bytes| bytes.len() as u64);
    // The length of an object comes from a peer, so it may be any number.
    let stored = payload.objects().map(|object| object.len / OBJECT_DIVISOR);
    inline.chain(stored).fold(OVERHEAD, u64::saturating_add)
}

#[cfg(test)]
mod tests {
    use hprm_core::{ObjectRef, Part};
    use proptest::prelude::*;

    use super::*;
    use crate::fixture::{federate, program};

    const A_B: &str = "a -> b";

    fn flow(text: &str, name: &str, limit: u64) -> Flow {
        let program = program(text);
        Flow::new(&Topology::new(&program), federate(&program, name), limit)
    }

    fn payload(bytes: usize) -> Payload {
        Payload { head: vec![0; bytes], ..Payload::default() }
    }

    fn at(time: i64) -> Tag {
        Tag::new(time, 0)
    }

    const CHANNEL: ChannelId = ChannelId(0);
    const A: FederateId = FederateId(0);
    const B: FederateId = FederateId(1);

    /// Delivers the reports of the receiver to the sender.
    fn deliver(reports: Vec<(FederateId, Frame)>, sender: &mut Flow) -> u64 {
        let mut delivered = 0;
        for (to, frame) in reports {
            let Frame::Processed { channel, messages, bytes } = frame else {
                panic!("{frame:?} is no report");
            };
            assert_eq!(to, A);
            sender.processed(B, channel, messages, bytes);
            delivered += messages;
        }
        delivered
    }

    #[test]
    fn a_sender_waits_when_it_is_ahead_and_goes_on_when_it_is_not() {
        let (mut a, mut b) = (flow(A_B, "a", 10_000), flow(A_B, "b", 10_000));
        let mut sent = 0;
        while !a.is_ahead(at(sent)) {
            a.sent(B, CHANNEL, at(sent), &payload(1_000));
            b.arrived(CHANNEL, at(sent), &payload(1_000));
            sent += 1;
        }
        assert_eq!(sent, 9, "that is 10,152 bytes");
        // The receiver sends no report before it has processed enough.
        assert_eq!(b.reached(at(1)), []);
        let reports = b.reached(at(3));
        assert_eq!(deliver(reports, &mut a), 3);
        assert!(!a.is_ahead(at(sent)));
    }

    #[test]
    fn messages_for_later_tags_do_not_count() {
        let mut a = flow(A_B, "a", 1_000);
        for time in 0..100 {
            a.sent(B, CHANNEL, at(1_000 + time), &payload(500));
        }
        assert!(!a.is_ahead(at(1_000)));
        assert!(a.is_ahead(at(1_050)));
        assert!(a.is_ahead(Tag::FOREVER));
    }

    #[test]
    fn a_physical_message_counts_until_it_is_read() {
        let mut b = flow("a ~> b", "b", 400);
        b.arrived(CHANNEL, at(7), &payload(100));
        let frame = Frame::Processed { channel: CHANNEL, messages: 1, bytes: 228 };
        assert_eq!(b.reached(Tag::START), [(A, frame)]);
        assert_eq!(b.reached(Tag::FOREVER), []);
    }

    #[test]
    fn a_sender_that_is_blocked_waits_until_a_message_is_processed() {
        let text = "a ~> b bound 2";
        let (mut a, mut b) = (flow(text, "a", 1 << 20), flow(text, "b", 1 << 20));
        for time in 1..3 {
            assert!(!a.is_full());
            a.sent(B, CHANNEL, at(time), &payload(1));
            b.arrived(CHANNEL, at(time), &payload(1));
            b.assign_tag(CHANNEL, Some(at(100 + time)));
        }
        assert!(a.is_full() && !a.is_ahead(at(3)));
        // The receiver has read them, but has not processed them.
        assert_eq!(b.reached(Tag::FOREVER), []);
        assert_eq!(b.completed(at(100)), []);
        let reports = b.completed(at(101));
        assert_eq!(deliver(reports, &mut a), 1);
        assert!(!a.is_full());
        a.sent(B, CHANNEL, at(3), &payload(1));
        assert!(a.is_full());
        // A message that never gets a tag does not wait; the next report includes it.
        b.arrived(CHANNEL, at(3), &payload(1));
        b.assign_tag(CHANNEL, None);
        let reports = b.completed(at(102));
        assert_eq!(deliver(reports, &mut a), 2);
        assert_eq!((a.bounded[&CHANNEL].unprocessed, b.waiting), (0, 0));
        assert_eq!(a.receivers[&B].bytes, 0);
    }

    #[test]
    fn a_receiver_that_has_ended_frees_a_sender_that_is_blocked() {
        let text = "a ~> b bound 1";
        let (mut a, mut b) = (flow(text, "a", 1 << 20), flow(text, "b", 1 << 20));
        a.sent(B, CHANNEL, at(0), &payload(1));
        assert!(a.is_full());
        a.forget(B);
        assert!(!a.is_full());
        // The receiver does not report the messages of one incarnation to the next one.
        b.arrived(CHANNEL, at(0), &payload(1));
        b.assign_tag(CHANNEL, Some(at(1)));
        b.forget(A);
        assert_eq!(b.completed(at(1)), []);
    }

    #[test]
    fn an_object_in_the_store_counts_a_sixteenth() {
        let mut a = flow(A_B, "a", 1_000_000);
        let object = ObjectRef { owner: A, serial: 0, segment: 0, offset: 0, len: 10_000_000 };
        let payload = Payload { parts: vec![Part::Object(object)], ..Payload::default() };
        a.sent(B, CHANNEL, at(0), &payload);
        assert_eq!(a.receivers[&B].bytes, 128 + 625_000);
        assert!(!a.is_ahead(at(1)));
        let all = ObjectRef { len: u64::MAX, ..object };
        let payload = Payload { parts: vec![Part::Object(all); 20], ..Payload::default() };
        (1..20).for_each(|time| a.sent(B, CHANNEL, at(time), &payload));
        assert!(a.is_ahead(at(20)));
    }

    #[test]
    fn a_receiver_that_has_ended_blocks_no_sender() {
        let mut a = flow(A_B, "a", 100);
        a.sent(B, CHANNEL, at(0), &payload(1_000));
        assert!(a.is_ahead(at(1)));
        a.forget(B);
        assert!(!a.is_ahead(at(1)));
        // A report of the receiver may still arrive.
        a.processed(B, CHANNEL, 1, 1_128);
        a.sent(B, CHANNEL, at(1), &payload(0));
        a.processed(B, CHANNEL, 99, 1_128);
        assert_eq!(a.receivers[&B].bytes, 0);
    }

    #[test]
    fn many_small_messages_are_few_groups() {
        let mut a = flow(A_B, "a", 1 << 20);
        for time in 0..100_000 {
            a.sent(B, CHANNEL, at(time), &payload(8));
        }
        let groups = a.receivers[&B].channels[&CHANNEL].0.len() as u64;
        assert!(groups < 100_000 * 136 * GROUPS / (1 << 20) + 2, "{groups}");
    }

    proptest! {
        /// Whatever is sent on several channels, with whatever limit: a receiver that has processed
        /// everything before a tag lets its sender begin that tag.
        #[test]
        fn a_receiver_that_has_processed_everything_blocks_no_sender(
            limit in 0_u64..5_000,
            messages in prop::collection::vec((0_u32..3, 0_i64..4, 0_usize..3_000), 0..60),
        ) {
            let text = "a -> b\na -> b after 1\na -> b after 2";
            let (mut a, mut b) = (flow(text, "a", limit), flow(text, "b", limit));
            let mut latest = [0; 3];
            for (channel, later, bytes) in messages {
                // Tags on a channel increase.
                latest[channel as usize] += later + 1;
                let (channel, tag) = (ChannelId(channel), at(latest[channel as usize]));
                a.sent(B, channel, tag, &payload(bytes));
                b.arrived(channel, tag, &payload(bytes));
            }
            for time in 0..300 {
                let reports = b.reached(at(time));
                deliver(reports, &mut a);
                prop_assert!(!a.is_ahead(at(time)), "at {time}");
            }
            // Both ends agree on what is in transit.
            let in_transit: u64 = a.receivers.values().map(|receiver| receiver.bytes).sum();
            let known = b.incoming.values().flat_map(|incoming| &incoming.backlog.0);
            prop_assert_eq!(in_transit, known.map(|group| group.bytes).sum::<u64>());
        }
    }
}
