//! How much goes over each connection: counts, and rates between two moments.

use std::collections::BTreeMap;

use hprm::board::{ChannelCount, ChannelName};
use hprm_core::Tag;

use super::federation::{Board, Federation};

/// A connection between two federates.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Flow {
    pub(crate) name: ChannelName,
    /// The names of the federates at its ends.
    pub(crate) from: String,
    pub(crate) to: String,
    /// Counted by the receiver, or by the sender if the receiver has no board here.
    pub(crate) messages: u64,
    pub(crate) bytes: u64,
    pub(crate) last: Option<Tag>,
    /// In a second; none, if there was no other moment.
    pub(crate) message_rate: Option<f64>,
    pub(crate) byte_rate: Option<f64>,
    /// How many messages the sender has counted and the receiver has not, if both have boards here.
    pub(crate) in_transit: Option<u64>,
}

/// How often a federate begins a tag in a second.
pub(crate) fn tag_rate(before: &Federation, now: &Federation, number: usize) -> Option<f64> {
    let [before, now] = [before, now].map(|it| it.members.get(number)?.board.as_ref());
    let (before, now) = (before?, now?);
    per_second((before.state.tags, now.state.tags), seconds(before, now))
}

/// All connections, in the order of the program, with rates since `before`.
pub(crate) fn flows(before: Option<&Federation>, now: &Federation) -> Vec<Flow> {
    let mut names = BTreeMap::new();
    for member in &now.members {
        let channels = member.board.iter().flat_map(|board| &board.names.channels);
        names.extend(channels.map(|(channel, name)| (*channel, name)));
    }
    names.into_iter().map(|(channel, name)| flow(before, now, (channel, name))).collect()
}

fn flow(
    before: Option<&Federation>,
    now: &Federation,
    (channel, name): (u32, &ChannelName),
) -> Flow {
    let end = |federation: &Federation, end: u16| {
        let board = federation.members.get(usize::from(end))?.board.clone()?;
        count(&board, channel).map(|count| (board, count))
    };
    let (sent, received) = (end(now, name.from), end(now, name.to));
    let in_transit = sent.as_ref().zip(received.as_ref()).filter(|_| name.from != name.to);
    let in_transit = in_transit.map(|((_, s), (_, r))| s.messages.saturating_sub(r.messages));
    let by = if received.is_some() { name.to } else { name.from };
    let counted = received.or(sent);
    let earlier = before.and_then(|before| end(before, by));
    let rate = |of: fn(&ChannelCount) -> u64| {
        let ((then, was), (now, is)) = earlier.as_ref().zip(counted.as_ref())?;
        per_second((of(was), of(is)), seconds(then, now))
    };
    let (message_rate, byte_rate) = (rate(|it| it.messages), rate(|it| it.bytes));
    let title = |number: u16| {
        now.members.get(usize::from(number)).map_or_else(String::new, |it| it.name.clone())
    };
    let count = counted.map(|(_, count)| count);
    Flow {
        name: name.clone(),
        from: title(name.from),
        to: title(name.to),
        messages: count.map_or(0, |it| it.messages),
        bytes: count.map_or(0, |it| it.bytes),
        last: count.and_then(|it| it.last).filter(|last| *last > Tag::NEVER),
        message_rate,
        byte_rate,
        in_transit,
    }
}

fn count(board: &Board, channel: u32) -> Option<ChannelCount> {
    board.state.channels.iter().find(|count| count.channel == channel).copied()
}

/// How much later the second state was shown. Nothing has happened if it is the same.
fn seconds(before: &Board, now: &Board) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "it is for people")]
    let nanos = now.state.moment.at.since(before.state.moment.at) as f64;
    nanos / 1e9
}

fn per_second((before, now): (u64, u64), seconds: f64) -> Option<f64> {
    #[expect(clippy::cast_precision_loss, reason = "it is for people")]
    let more = now.checked_sub(before)? as f64;
    Some(if seconds > 0.0 { more / seconds } else { 0.0 })
}
