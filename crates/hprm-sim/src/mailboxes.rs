//! What must be true of physical connections with a bound, found out beside the scheduler that obeys it: how
//! many messages wait, which are dropped, and that all others are there at their tags.

use std::collections::{BTreeMap, VecDeque};

use hprm_core::{ChannelId, ConnectionId, FederateId, Overflow, Program, Scheduler, Tag};

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(crate) struct Mailboxes {
    by_connection: BTreeMap<ConnectionId, Mailbox>,
    wrong: Option<String>,
}

/// The messages of one connection.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
struct Mailbox {
    /// Those that wait, in the order of their tags.
    waiting: VecDeque<Waiting>,
    dropped: u64,
}

/// A message that waits for its tag.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
struct Waiting {
    tag: Tag,
    /// Whether its sender is still there. A blocked sender waits only for room for its own messages.
    is_senders: bool,
}

impl Mailboxes {
    /// A message has arrived on a physical channel, and the scheduler has given it a tag, or dropped it.
    pub(crate) fn arrived(
        &mut self,
        scheduler: &Scheduler<u64>,
        channel: ChannelId,
        placed: Option<Tag>,
    ) {
        let program = scheduler.program();
        let connection = program.channels[channel].connection;
        let Some(bound) = program.connections[connection].bound else { return };
        let mailbox = self.by_connection.entry(connection).or_default();
        mailbox.waiting.retain(|message| message.tag > scheduler.tag());
        let blocks = bound.overflow == Overflow::Block;
        let counted = mailbox.waiting.iter().filter(|message| !blocks || message.is_senders);
        if counted.count() >= bound.messages as usize {
            mailbox.dropped += u64::from(!blocks);
            match bound.overflow {
                Overflow::Drop if placed.is_none() => return,
                Overflow::Drop => self.note("a message is not dropped", connection),
                Overflow::Replace => drop(mailbox.waiting.pop_front()),
                Overflow::Block => self.note("a sender does not wait", connection),
            }
        }
        let mailbox = self.by_connection.entry(connection).or_default();
        mailbox.waiting.extend(placed.map(|tag| Waiting { tag, is_senders: true }));
    }

    /// A federate has ended. Messages that it has left behind take no room from its successor.
    pub(crate) fn sender_gone(&mut self, program: &Program, federate: FederateId) {
        let from = program.channels.values().filter(|channel| channel.from == federate);
        for connection in from.map(|channel| channel.connection) {
            if let Some(mailbox) = self.by_connection.get_mut(&connection) {
                mailbox.waiting.iter_mut().for_each(|message| message.is_senders = false);
            }
        }
    }

    fn note(&mut self, what: &str, connection: ConnectionId) {
        let wrong = || format!("{what} on {connection:?}, although as many wait as may");
        self.wrong.get_or_insert_with(wrong);
    }

    /// A tag has begun.
    pub(crate) fn began(&mut self, scheduler: &Scheduler<u64>, tag: Tag) {
        for (connection, mailbox) in &self.by_connection {
            let must = mailbox.waiting.iter().any(|message| message.tag == tag);
            let is = scheduler.port(scheduler.program().connections[*connection].to).is_some();
            if must != is {
                let wrong = || {
                    let there = if is { "there" } else { "not there" };
                    format!("a message of {connection:?} is {there} at {tag}")
                };
                self.wrong.get_or_insert_with(wrong);
            }
        }
    }

    /// What has been wrong, if anything.
    pub(crate) fn wrong(&self, scheduler: &Scheduler<u64>) -> Option<String> {
        let told: BTreeMap<_, _> = scheduler.dropped_messages().collect();
        let dropped = self.by_connection.iter().map(|(id, mailbox)| (*id, mailbox.dropped));
        let dropped: BTreeMap<_, _> = dropped.filter(|(_, count)| *count > 0).collect();
        let miscounted =
            (told != dropped).then(|| format!("{told:?} were dropped, but must be {dropped:?}"));
        self.wrong.clone().or(miscounted)
    }
}
