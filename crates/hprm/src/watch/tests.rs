//! Both ends of the connection, in one process.

use std::sync::Arc;
use std::thread;
use std::time::Duration;

use hprm_codec::{Array, Dynamic, encode};
use hprm_core::{
    ChannelId, Delay, Direction, Effect, FederateId, Nanos, Part, Payload, PhysicalTime, PortId,
    Program, ProgramBuilder, Properties, ReactionSpec, Tag, Trigger,
};
use hprm_store::{Store, StoreLimits};

use super::connecting::{Watcher, connect};
use super::{
    ArrivedPart, Sample, Sight, Unseen, WatchError, WatchServer, Watching, Wish, socket_name,
};

const ME: FederateId = FederateId(0);
const CHANNEL: ChannelId = ChannelId(0);
const CAPACITY: u64 = 64 << 20;
const START: PhysicalTime = PhysicalTime(7);
const LIMIT: Duration = Duration::from_secs(10);

/// `camera.image -> detector.image`.
fn program() -> Arc<Program> {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let [camera, detector] = ["camera", "detector"].map(|name| {
        let reactor = b.reactor(b.main(), name);
        b.federate(reactor, name, Nanos::MAX, None);
        reactor
    });
    let out = b.port(camera, "image", Direction::Output);
    let input = b.port(detector, "image", Direction::Input);
    b.connect(out, input, Delay::None);
    let effects = vec![Effect::Port(out)];
    let triggers = vec![Trigger::Startup];
    b.reaction(camera, ReactionSpec { triggers, effects, ..ReactionSpec::default() });
    let triggers = vec![Trigger::Port(input)];
    b.reaction(detector, ReactionSpec { triggers, ..ReactionSpec::default() });
    Arc::new(b.build().expect("a program"))
}

/// A federate that can be watched, and what it sends.
struct Camera {
    /// The name of its socket.
    id: String,
    server: WatchServer,
    store: Store,
    sent: i64,
}

impl Camera {
    fn new(id: &str) -> Self {
        let id = format!("{id}-{}", std::process::id());
        let server = WatchServer::listen(&program(), ME, &id, CAPACITY).expect("it listens");
        let limits = StoreLimits { capacity_bytes: CAPACITY, ..StoreLimits::default() };
        let id = socket_name(&id, "camera", std::process::id());
        Self { id, server, store: Store::new(ME, limits), sent: 0 }
    }

    /// A watcher that has asked for its channel. The server answers while the watcher waits.
    fn watched(&mut self, wish: Wish) -> Watching {
        let id = self.id.clone();
        let watcher = thread::spawn(move || {
            let watcher =
                Watcher::new(connect(&id).expect("it listens"), LIMIT).expect("it connects");
            assert_eq!((watcher.federate, watcher.program.name.as_str()), (ME, "Main"));
            watcher.watch(vec![CHANNEL, ChannelId(9)], wish).expect("it watches")
        });
        while !watcher.is_finished() {
            self.server.serve(&mut self.store);
        }
        watcher.join().expect("no panic")
    }

    /// Sends a value, large parts of it as objects.
    fn send(&mut self, value: &Dynamic) {
        let draft = encode(value).expect("it has an encoding");
        let mut payload = Payload { head: draft.head, ..Payload::default() };
        let mut held = Vec::new();
        for part in draft.parts {
            let object = self.store.put(part.bytes(), &[ME]).expect("there is room");
            held.push(self.store.open(object).expect("it is its own"));
            payload.parts.push(Part::Object(object));
        }
        self.show(Ok(&payload));
    }

    fn show(&mut self, value: Result<&Payload, String>) {
        let tag = Tag { time: self.sent, microstep: 0 };
        let bytes = value.as_ref().map_or(0, |payload| payload.byte_count());
        let at = PhysicalTime(self.sent);
        let sample = Sample { channel: CHANNEL, port: PortId(0), tag, start: START, at, bytes };
        self.sent += 1;
        self.server.show(&sample, Some(tag), value, &mut self.store);
    }

    fn in_use(&mut self) -> u64 {
        self.server.serve(&mut self.store);
        self.store.stats().bytes_in_use
    }
}

fn image(bytes: usize) -> Dynamic {
    Dynamic::Array(Array::from(vec![7_u8; bytes]).into())
}

fn shape(sight: &Sight) -> Vec<usize> {
    match &sight.value {
        Ok(Dynamic::Array(array)) => array.shape().to_vec(),
        other => panic!("no array: {other:?}"),
    }
}

#[test]
fn a_large_array_is_held_until_the_watcher_drops_it() {
    let mut camera = Camera::new("held");
    let mut watching = camera.watched(Wish::Values);
    camera.send(&image(1 << 20));
    assert!(camera.in_use() >= 1 << 20, "the watcher is its only reader");
    let sight = watching.next_sight().unwrap();
    assert_eq!((sight.tag, sight.dropped, shape(&sight)), (Tag::START, 0, vec![1 << 20]));
    assert!(camera.in_use() >= 1 << 20);
    drop(sight);
    watching.release().unwrap();
    assert_eq!(camera.in_use(), 0);
}

#[test]
fn what_a_watcher_holds_is_released_by_its_end() {
    let mut camera = Camera::new("end");
    for _ in 0..3 {
        let mut watching = camera.watched(Wish::Values);
        camera.send(&image(1 << 20));
        let sight = watching.next_sight().unwrap();
        drop((sight, watching));
        assert_eq!(camera.in_use(), 0);
    }
    assert!(camera.server.is_idle());
}

#[test]
fn what_is_held_does_not_change_when_nothing_is_watched_any_more() {
    let mut camera = Camera::new("kept");
    let mut watching = camera.watched(Wish::Values);
    camera.send(&image(1 << 20));
    let sight = watching.sight_by(None).unwrap().expect("it has come");
    assert_eq!((sight.start, sight.at), (START, PhysicalTime(0)));
    drop(watching);
    assert!(camera.in_use() >= 1 << 20);
    let arrived = sight.value.unwrap();
    let [ArrivedPart::Object(held)] = &arrived.parts[..] else { panic!("{arrived:?}") };
    assert_eq!(held.as_bytes()[0], 7);
    drop(arrived);
    assert_eq!(camera.in_use(), 0);
}

#[test]
fn a_slow_watcher_misses_values_and_learns_how_many() {
    let mut camera = Camera::new("slow");
    let mut watching = camera.watched(Wish::Values);
    for _ in 0..10 {
        camera.send(&image(1 << 20));
    }
    for _ in 0..2 {
        assert_eq!(watching.next_sight().unwrap().dropped, 0);
    }
    watching.release().unwrap();
    assert_eq!(camera.in_use(), 0);
    camera.send(&image(1 << 20));
    let sight = watching.next_sight().unwrap();
    assert_eq!((sight.tag.time, sight.dropped), (10, 8));
    drop(sight);
    // Small values fill the socket.
    while camera.sent < 5_000 {
        camera.send(&Dynamic::Int(1));
    }
    let mut last = watching.next_sight().unwrap();
    camera.send(&Dynamic::Int(2));
    while last.dropped == 8 {
        last = watching.next_sight().unwrap();
    }
    assert_eq!(last.tag.time, 5_000);
    assert!(last.dropped > 1_000, "{last:?}");
}

#[test]
fn a_long_head_arrives_whole_and_is_bounded_too() {
    let mut camera = Camera::new("long");
    let mut watching = camera.watched(Wish::Values);
    let text = Dynamic::List(vec![Dynamic::Str("x".repeat(10_000)); 5]);
    // HPRM itself sends a head of that length as a part, but need not.
    let head = encode(&text).unwrap().parts.pop().unwrap().bytes().to_vec();
    let inline = Payload { head, ..Payload::default() };
    assert!(inline.head.len() > 40_000, "all is in the head");
    for _ in 0..5 {
        camera.show(Ok(&inline));
    }
    for _ in 0..2 {
        assert_eq!(watching.next_sight().unwrap().value, Ok(text.clone()));
    }
    watching.release().unwrap();
    camera.server.serve(&mut camera.store);
    camera.show(Ok(&inline));
    let sight = watching.next_sight().unwrap();
    assert_eq!((sight.dropped, sight.value), (3, Ok(text)));
}

#[test]
fn a_value_beyond_the_share_of_watchers_is_told_without_it() {
    let mut camera = Camera::new("large");
    let mut watching = camera.watched(Wish::Values);
    camera.send(&image(CAPACITY as usize / 4));
    let sight = watching.next_sight().unwrap();
    assert!(sight.bytes > CAPACITY / 4);
    assert_eq!(sight.value.unwrap_err(), Unseen::TooLarge);
    assert_eq!(camera.in_use(), 0);
    camera.show(Err("it is a lock".to_owned()));
    let sight = watching.next_sight().unwrap();
    assert_eq!(sight.value.unwrap_err(), Unseen::Unencodable("it is a lock".to_owned()));
}

#[test]
fn counts_come_when_asked() {
    let mut camera = Camera::new("counts");
    let mut watching = camera.watched(Wish::Counts);
    for _ in 0..3 {
        camera.send(&image(1 << 20));
    }
    assert_eq!(camera.in_use(), 0, "a watcher that counts holds nothing");
    let counting = thread::spawn(move || watching.counts(Duration::ZERO).unwrap());
    while !counting.is_finished() {
        camera.server.serve(&mut camera.store);
    }
    let counts = counting.join().unwrap();
    let [(channel, tally)] = &counts.tallies[..] else { panic!("{counts:?}") };
    // A channel that is none of the federate's is not watched.
    assert_eq!((*channel, tally.messages, tally.shortest), (CHANNEL, 3, 1));
    assert!(tally.bytes > 3 << 20);
}

#[test]
fn the_end_of_the_federate_is_told() {
    let mut camera = Camera::new("over");
    let mut watching = camera.watched(Wish::Values);
    let id = camera.id.clone();
    drop(camera);
    assert!(matches!(watching.next_sight(), Err(WatchError::Ended)));
    assert!(matches!(connect(&id), Err(WatchError::NotListening)));
}

#[test]
fn one_watcher_too_many_is_told() {
    let mut camera = Camera::new("many");
    let watching: Vec<_> = (0..16).map(|_| camera.watched(Wish::Counts)).collect();
    let id = camera.id.clone();
    let one_more = thread::spawn(move || Watcher::new(connect(&id).expect("it listens"), LIMIT));
    while !one_more.is_finished() {
        camera.server.serve(&mut camera.store);
    }
    assert!(matches!(one_more.join().unwrap(), Err(WatchError::Full)));
    drop(watching);
    camera.server.serve(&mut camera.store);
    camera.watched(Wish::Counts);
}

#[test]
fn a_flood_of_connections_is_accepted_a_few_at_a_time() {
    let mut camera = Camera::new("flood");
    let sockets: Vec<_> = (0..10).map(|_| connect(&camera.id).expect("it listens")).collect();
    for accepted in [4, 8, 10] {
        camera.server.serve(&mut camera.store);
        assert_eq!(camera.server.sources().count(), 1 + accepted);
        assert_eq!(camera.server.is_ready(), accepted < 10);
    }
    drop(sockets);
    camera.server.serve(&mut camera.store);
    assert_eq!(camera.server.sources().count(), 1);
}
