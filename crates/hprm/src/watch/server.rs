//! A federate's end of the connections with watchers: it accepts them, and shows them what the federate sends.
//!
//! It never waits. The tap decides which watcher gets what; this file moves it, and keeps the ledger of the store in step: a
//! watcher holds an object from the moment its message is in the socket.

use std::collections::BTreeMap;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;

use hprm_core::{ChannelId, FederateId, Payload, Program, Tag};
use hprm_store::Store;

use super::records::{Ask, Content, Introduction, Seen, Told, encode_first};
use super::tap::{Sample, Share, Tap};
use super::{WATCHERS, reader, socket_name};
use crate::Clock;
use crate::agent::Rest;
use crate::records::{self, RecordListener, RecordQueue, RecordSocket, SHORT, may_be_tried_again};
use crate::wait::{Interest, Ready, Source, SourceId};

/// The part of the store's capacity that all watchers together may hold: a watcher that stands still must not be the
/// reason why a program has no room.
const SHARE_OF_STORE: u64 = 8;

/// How many connections are accepted in one round.
const ACCEPTS: usize = 4;

/// How many records of a watcher are read in one round.
const READS: usize = 16;

/// The most records that wait for room in the socket of a watcher, which are not messages.
const MOST_OWED: usize = 64;

/// The numbers of long records begin here, far above those of objects.
const TICKETS: u64 = 1 << 63;

/// See the module.
#[derive(Debug)]
pub(crate) struct WatchServer {
    listener: RecordListener,
    rest: Rest,
    id: SourceId,
    program: Arc<Program>,
    me: FederateId,
    watchers: BTreeMap<u16, Connection>,
    tap: Tap,
    /// Whether there may be something to accept or to read.
    is_ready: bool,
    /// The number of the next long record.
    next_ticket: u64,
}

#[derive(Debug)]
struct Connection {
    id: SourceId,
    /// What must not be lost waits in it, if there is no room.
    queue: RecordQueue,
}

/// A watcher cannot get a record now, or never any more.
enum Unsent {
    Now,
    Ever,
}

impl WatchServer {
    /// Listens for watchers of a federate, whose store has that capacity; `id` is the name of the federation in
    /// frames. None if the system does not allow that: then the federate runs, and cannot be watched.
    pub(crate) fn listen(
        program: &Arc<Program>,
        me: FederateId,
        id: &str,
        capacity: u64,
    ) -> Option<Self> {
        if program.federates.len() > usize::from(u16::MAX - WATCHERS) {
            return None;
        }
        let name = socket_name(id, &program.federates[me].name, std::process::id());
        let listener = RecordListener::bind(&name);
        let listener = listener.inspect_err(|error| tracing::debug!("cannot be watched: {error}"));
        Some(Self {
            listener: listener.ok()?,
            id: SourceId::new(),
            program: Arc::clone(program),
            me,
            watchers: BTreeMap::new(),
            tap: Tap::new(capacity / SHARE_OF_STORE),
            rest: Rest::default(),
            is_ready: true,
            next_ticket: TICKETS,
        })
    }

    /// What to wait for, always in the same order.
    pub(crate) fn sources(&self) -> impl Iterator<Item = Source<'_>> {
        let to_read = |fd| Interest { fd, write: false };
        let listener = Source::new(self.id, to_read(self.listener.as_fd()));
        let listener = self.rest.until().is_none().then_some(listener);
        let watchers = self.watchers.values();
        let watchers = watchers.map(move |it| Source::new(it.id, to_read(it.queue.as_fd())));
        listener.into_iter().chain(watchers)
    }

    /// Takes as many as there are sources, and notes whether one of them is ready.
    pub(crate) fn note(&mut self, ready: &mut impl Iterator<Item = Ready>) {
        let listens = self.rest.until().is_none();
        for ready in ready.take(usize::from(listens) + self.watchers.len()) {
            self.is_ready |= ready.is_ready();
        }
        // No wait ends for that: watchers may wait for as long as the federate does.
        self.is_ready |= !listens && self.rest.is_over(Clock::local());
    }

    /// Whether no channel is watched.
    #[inline]
    pub(crate) fn is_idle(&self) -> bool {
        self.tap.is_idle()
    }

    /// Whether a watcher wants to see the values of a channel.
    pub(crate) fn wants_values(&self, channel: ChannelId) -> bool {
        self.tap.wants_values(channel)
    }

    /// Whether there may be something to accept or to read.
    #[inline]
    pub(crate) fn is_ready(&self) -> bool {
        self.is_ready
    }

    /// Accepts watchers, and does what they ask for.
    pub(crate) fn serve(&mut self, store: &mut Store) {
        // If there are more connections than that, some of them are of another user, and must not keep the loop busy.
        let accepted: Vec<_> = (0..ACCEPTS).map_while(|_| self.accept()).collect();
        self.is_ready = accepted.len() == ACCEPTS;
        accepted.into_iter().flatten().for_each(|socket| self.admit(socket));
        let watchers: Vec<u16> = self.watchers.keys().copied().collect();
        for watcher in watchers {
            if self.read(watcher, store).is_err() {
                self.remove(watcher, store);
            }
        }
    }

    /// The next connection, if one waits and there is a descriptor for it.
    fn accept(&mut self) -> Option<io::Result<RecordSocket>> {
        let accepted = self.listener.accept()?;
        let rests = |error| self.rest.begins_after(error, Clock::local());
        (!accepted.as_ref().is_err_and(rests)).then_some(accepted)
    }

    /// Introduces this federate to a watcher. One that cannot be told now, at first, is none.
    fn admit(&mut self, socket: RecordSocket) {
        let Some(watcher) = (0..WATCHERS).find(|it| !self.watchers.contains_key(it)) else {
            let _ = socket.send(&encode_first(&Told::Full), None);
            return;
        };
        let introduction = Introduction { program: (*self.program).clone(), federate: self.me };
        let first = encode_first(&Told::Federate(Box::new(introduction)));
        if socket.send(&first, None).is_ok() {
            let connection = Connection { id: SourceId::new(), queue: RecordQueue::new(socket) };
            self.watchers.insert(watcher, connection);
        }
    }

    /// Reads what a watcher asks for. Fails if the watcher is gone, or is none.
    fn read(&mut self, watcher: u16, store: &mut Store) -> Result<(), Unsent> {
        for _ in 0..READS {
            let Some(connection) = self.watchers.get_mut(&watcher) else { return Ok(()) };
            connection.settle()?;
            match connection.queue.receive() {
                Ok(Some((record, _))) => {
                    let ask = records::decode(&record).ok_or(Unsent::Ever)?;
                    self.obey(watcher, ask, store)?;
                }
                Ok(None) => return Ok(()),
                Err(_) => return Err(Unsent::Ever),
            }
        }
        self.is_ready = true;
        Ok(())
    }

    fn obey(&mut self, watcher: u16, ask: Ask, store: &mut Store) -> Result<(), Unsent> {
        match ask {
            Ask::Watch { channels, wish } => {
                let sends = |channel: &ChannelId| {
                    self.program.channels.get(*channel).is_some_and(|it| it.from == self.me)
                };
                let channels: Vec<_> = channels.into_iter().filter(sends).collect();
                self.tap.watch(watcher, channels, wish, Clock::now());
                self.tell(watcher, &Told::Watching, None)
            }
            Ask::Release { serials } => {
                for serial in serials {
                    self.tap.released(watcher, serial);
                    if serial < TICKETS {
                        // A hold that the store does not know is an error of the watcher, and harmless.
                        let _ = store.release(serial, reader(watcher));
                    }
                }
                Ok(())
            }
            Ask::Counts => {
                let (span, tallies) = self.tap.counts(watcher, Clock::now());
                self.tell(watcher, &Told::Counts { span, tallies }, None)
            }
        }
    }

    /// Shows a message to those that watch its channel. Its tag at the receiver is `arrives`, unless that is the time
    /// of arrival. `value` says why it is not encoded, if it is not.
    #[cold]
    pub(crate) fn show(
        &mut self,
        sample: &Sample,
        arrives: Option<Tag>,
        value: Result<&Payload, String>,
        store: &mut Store,
    ) {
        let held = value.as_ref().map_or(0, |payload| held_bytes(payload));
        for (watcher, share) in self.tap.offer(sample, held) {
            let value = match (&value, share) {
                (Err(reason), _) => Content::Unencodable(reason.clone()),
                (Ok(_), Share::WithoutValue) => Content::TooLarge,
                (Ok(payload), Share::Whole) => match payload.try_clone() {
                    Ok(payload) => Content::Payload(payload),
                    Err(_) => Content::TooLarge,
                },
            };
            let seen = Seen {
                channel: sample.channel,
                tag: sample.tag,
                arrives,
                start: sample.start,
                at: sample.at,
                bytes: sample.bytes,
                dropped: self.tap.missed(watcher),
                ticket: None,
                value,
            };
            match self.send(watcher, seen, store) {
                Ok(()) => {}
                Err(Unsent::Now) => self.tap.dropped(watcher),
                Err(Unsent::Ever) => self.remove(watcher, store),
            }
        }
    }

    /// Sends a message to a watcher, which holds its objects from then on.
    fn send(&mut self, watcher: u16, mut seen: Seen, store: &mut Store) -> Result<(), Unsent> {
        let mut holds: Vec<(u64, u64)> = Vec::new();
        if let Content::Payload(payload) = &seen.value {
            if inline_bytes(payload) > SHORT as u64 {
                seen.ticket = Some(self.next_ticket);
                holds.push((self.next_ticket, inline_bytes(payload)));
                self.next_ticket += 1;
            }
            for object in payload.objects() {
                if store.add_reader(object.serial, reader(watcher)).is_ok() {
                    holds.push((object.serial, object.len));
                }
            }
        }
        let sent = self.send_held(watcher, seen, store);
        match sent {
            Ok(()) => self.tap.took(watcher, holds),
            Err(_) => {
                for (serial, _) in holds.into_iter().filter(|(serial, _)| *serial < TICKETS) {
                    let _ = store.release(serial, reader(watcher));
                }
            }
        }
        sent
    }

    /// Sends a message whose objects the watcher holds already, and what it needs to map them before that.
    fn send_held(&mut self, watcher: u16, seen: Seen, store: &mut Store) -> Result<(), Unsent> {
        for announcement in store.unannounced(reader(watcher)) {
            let told = Told::Segment { segment: announcement.segment, len: announcement.len };
            let descriptor = announcement.as_fd().try_clone_to_owned().map_err(|_| Unsent::Ever)?;
            self.tell(watcher, &told, Some(descriptor))?;
        }
        let segments = store.retired(reader(watcher));
        if !segments.is_empty() {
            self.tell(watcher, &Told::Retired { segments }, None)?;
        }
        let Some(connection) = self.watchers.get_mut(&watcher) else { return Err(Unsent::Ever) };
        connection.settle()?;
        if connection.queue.waiting() > 0 {
            return Err(Unsent::Now);
        }
        unsent(connection.queue.socket().send(&records::encode(&Told::Message(seen)), None))
    }

    /// Tells a watcher something that must not be lost: if there is no room now, it is sent later.
    fn tell(&mut self, watcher: u16, told: &Told, with: Option<OwnedFd>) -> Result<(), Unsent> {
        let Some(connection) = self.watchers.get_mut(&watcher) else { return Err(Unsent::Ever) };
        connection.queue.push(records::encode(told), with).map_err(|_| Unsent::Ever)?;
        if connection.queue.waiting() > MOST_OWED { Err(Unsent::Ever) } else { Ok(()) }
    }

    /// A watcher is gone: it holds nothing any more.
    fn remove(&mut self, watcher: u16, store: &mut Store) {
        self.watchers.remove(&watcher);
        self.tap.forget(watcher);
        store.reader_lost(reader(watcher));
    }
}

impl Connection {
    /// Sends what is owed, as far as there is room.
    fn settle(&mut self) -> Result<(), Unsent> {
        self.queue.settle().map_err(|_| Unsent::Ever)
    }
}

fn unsent(sent: io::Result<()>) -> Result<(), Unsent> {
    sent.map_err(|error| match may_be_tried_again(&error) {
        true => Unsent::Now,
        false => Unsent::Ever,
    })
}

/// How many bytes a record has at least that contains a payload.
fn inline_bytes(payload: &Payload) -> u64 {
    payload.byte_count() - payload.objects().map(|object| object.len).sum::<u64>()
}

/// How many bytes a watcher holds once it has got a payload, until it releases them.
fn held_bytes(payload: &Payload) -> u64 {
    let (all, inline) = (payload.byte_count(), inline_bytes(payload));
    if inline > SHORT as u64 { all } else { all - inline }
}
