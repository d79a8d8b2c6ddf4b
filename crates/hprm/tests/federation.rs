//! Federations with real sockets and real memory, or in a room, but in one process and without Python.
//!
//! Each federate is a thread with its own loop, store and links, exactly as in a process.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

use hprm::federated::{FederationId, Patience};
use hprm::store::{Object, Store, StoreLimits};
use hprm::{Address, Failure, FederateOptions, Host, Inbox, Room, Rti, RtiEvent, RtiOptions};
use hprm_core::limits::INLINE_LIMIT;
use hprm_core::{
    Body, ChannelId, Coordination, Delay, Direction, Effect, FederateId, Nanos, Part, Payload,
    PhysicalTime, PortId, Program, ProgramBuilder, Properties, ReactionId, ReactionSpec, Scheduler,
    Trigger,
};

/// Bytes, wherever they are.
#[derive(Clone)]
enum Bytes {
    Own(Arc<Vec<u8>>),
    Remote(Object),
}

impl Bytes {
    fn as_slice(&self) -> &[u8] {
        match self {
            Self::Own(bytes) => bytes,
            Self::Remote(object) => object.as_bytes(),
        }
    }
}

type React = dyn Fn(&mut Scheduler<Bytes>, ReactionId, Body) -> Result<(), Failure> + Send + Sync;

struct Closures {
    me: FederateId,
    react: Arc<React>,
    warnings: Arc<Mutex<Vec<String>>>,
    /// Encodings of this tag's values, by address, with what keeps their objects.
    encoded: BTreeMap<usize, (Payload, Object)>,
    _not_send: OnceCell<Rc<()>>,
}

impl Host for Closures {
    type Value = Bytes;

    fn react(
        &mut self,
        scheduler: &mut Scheduler<Bytes>,
        reaction: ReactionId,
        body: Body,
    ) -> Result<(), Failure> {
        self.encoded.clear();
        (self.react)(scheduler, reaction, body)
    }

    fn encode(
        &mut self,
        store: &mut Store,
        _: ChannelId,
        value: &Bytes,
    ) -> Result<Payload, Failure> {
        let bytes = value.as_slice();
        if bytes.len() <= INLINE_LIMIT {
            return Ok(Payload { head: bytes.to_vec(), ..Payload::default() });
        }
        let key = bytes.as_ptr() as usize;
        if let Some((payload, _)) = self.encoded.get(&key) {
            return Ok(payload.clone());
        }
        let object = store.put(bytes, &[self.me]).map_err(|e| Failure::new(e.to_string()))?;
        let hold = store.open(object).map_err(|e| Failure::new(e.to_string()))?;
        let payload = Payload { parts: vec![Part::Object(object)], ..Payload::default() };
        self.encoded.insert(key, (payload.clone(), hold));
        Ok(payload)
    }

    fn receive(
        &mut self,
        _: ChannelId,
        payload: Payload,
        mut objects: Vec<Object>,
        _: PhysicalTime,
    ) -> Bytes {
        match (objects.pop(), payload.parts.into_iter().next()) {
            (Some(object), _) => Bytes::Remote(object),
            (None, Some(Part::Inline(bytes))) => Bytes::Own(Arc::new(bytes)),
            (None, _) => Bytes::Own(Arc::new(payload.head)),
        }
    }

    fn warn(&mut self, message: &str) {
        self.warnings.lock().unwrap().push(message.to_owned());
    }
}

struct Federation {
    outcomes: Vec<Result<(), Failure>>,
    rti: Result<(), Failure>,
    events: Vec<RtiEvent>,
    warnings: Vec<String>,
}

fn federation(program: Program, address: &str, react: Arc<React>) -> Federation {
    federation_in(None, program, address, react)
}

fn federation_in(
    room: Option<&Room<Bytes>>,
    program: Program,
    address: &str,
    react: Arc<React>,
) -> Federation {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let program = Arc::new(program);
    let unique = format!("{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    let listen: Address = address.replace("UNIQUE", &unique).parse().unwrap();
    let federation = FederationId(7);
    let options = RtiOptions {
        program: Arc::clone(&program),
        federation,
        listen,
        patience: Patience::default(),
    };
    let rti = room.map_or_else(|| Rti::bind(&options), |room| room.rti(&options)).unwrap();
    let address = rti.address().clone();
    let warnings = Arc::new(Mutex::new(Vec::new()));
    let events = Arc::new(Mutex::new(Vec::new()));
    let report = Arc::clone(&events);
    let rti = thread::spawn(move || rti.run(|event| report.lock().unwrap().push(event)));
    let federates: Vec<_> = program
        .federates
        .ids()
        .map(|federate| {
            let options = FederateOptions {
                program: Arc::clone(&program),
                federate,
                rti: address.clone(),
                federation,
                store: StoreLimits::default(),
                trace: None,
            };
            let (react, warnings) = (Arc::clone(&react), Arc::clone(&warnings));
            let room = room.cloned();
            thread::spawn(move || {
                let inbox = Inbox::new().unwrap();
                let load = || {
                    let encoded = BTreeMap::new();
                    let _not_send = OnceCell::new();
                    Ok(Closures { me: federate, react, warnings, encoded, _not_send })
                };
                match room {
                    Some(room) => hprm::run_federate_in(&options, &room, &inbox, load),
                    None => hprm::run_federate(&options, &inbox, load),
                }
            })
        })
        .collect();
    let outcomes = federates.into_iter().map(|federate| federate.join().unwrap()).collect();
    let rti = rti.join().unwrap();
    let events = std::mem::take(&mut *events.lock().unwrap());
    let warnings = std::mem::take(&mut *warnings.lock().unwrap());
    Federation { outcomes, rti, events, warnings }
}

/// A server sends to `clients` clients, each answers, and the server starts the next round when it
/// has all answers: the shape of the paper's broadcast and gather.
struct Gather {
    program: Program,
    out: PortId,
    answers: Vec<PortId>,
    requests: Vec<PortId>,
    replies: Vec<PortId>,
    start: ReactionId,
    round: ReactionId,
}

fn gather(coordination: Coordination, clients: usize) -> Gather {
    let properties = Properties { keepalive: true, coordination, ..Properties::default() };
    let mut b = ProgramBuilder::new("Gather", properties);
    let server = b.reactor(b.main(), "server");
    b.federate(server, "server", Nanos::MAX, None);
    let out = b.port(server, "out", Direction::Output);
    let answers: Vec<_> =
        (0..clients).map(|i| b.port(server, &format!("answers[{i}]"), Direction::Input)).collect();
    let send = |triggers| ReactionSpec {
        triggers,
        effects: vec![Effect::Port(out)],
        ..ReactionSpec::default()
    };
    let start = b.reaction(server, send(vec![Trigger::Startup]));
    let round = b.reaction(server, send(answers.iter().copied().map(Trigger::Port).collect()));
    let (mut requests, mut replies) = (Vec::new(), Vec::new());
    for (i, answer) in answers.iter().enumerate() {
        let client = b.reactor(b.main(), &format!("client[{i}]"));
        b.federate(client, &format!("client__{i}"), Nanos::MAX, None);
        let request = b.port(client, "request", Direction::Input);
        let reply = b.port(client, "reply", Direction::Output);
        b.connect(out, request, Delay::None);
        b.connect(reply, *answer, Delay::Microstep);
        b.reaction(
            client,
            ReactionSpec {
                triggers: vec![Trigger::Port(request)],
                effects: vec![Effect::Port(reply)],
                ..ReactionSpec::default()
            },
        );
        requests.push(request);
        replies.push(reply);
    }
    Gather { program: b.build().unwrap(), out, answers, requests, replies, start, round }
}

/// Runs some rounds of `len` bytes; every round checks every byte.
fn run_rounds(coordination: Coordination, address: &str, len: usize, rounds: u32) -> Federation {
    run_rounds_in(None, coordination, address, (len, rounds))
}

fn run_rounds_in(
    room: Option<&Room<Bytes>>,
    coordination: Coordination,
    address: &str,
    (len, rounds): (usize, u32),
) -> Federation {
    const CLIENTS: usize = 3;
    let Gather { program, out, answers, requests, replies, start, round } =
        gather(coordination, CLIENTS);
    let seen = AtomicU32::new(0);
    let message = move |round: u32, who: usize| -> Bytes {
        let byte = u8::try_from((round as usize * 7 + who) % 251).unwrap();
        Bytes::Own(Arc::new(vec![byte; len]))
    };
    let react = move |scheduler: &mut Scheduler<Bytes>, id: ReactionId, _: Body| {
        if id == start {
            scheduler.set(out, message(0, 0));
        } else if id == round {
            let done = seen.fetch_add(1, Ordering::Relaxed) + 1;
            for (who, port) in answers.iter().enumerate() {
                let answer = scheduler.port(*port).expect("all answers have one tag");
                assert!(answer.as_slice() == message(done - 1, who + 1).as_slice());
            }
            if done == rounds {
                scheduler.request_stop();
            } else {
                scheduler.set(out, message(done, 0));
            }
        } else {
            let who = requests.iter().position(|port| scheduler.port(*port).is_some()).unwrap();
            let request = scheduler.port(requests[who]).unwrap().as_slice();
            let answer: Vec<u8> = request.iter().map(|b| (b + 1 + who as u8) % 251).collect();
            scheduler.set(replies[who], Bytes::Own(Arc::new(answer)));
        }
        Ok(())
    };
    let federation = federation_in(room, program, address, Arc::new(react));
    assert_eq!(federation.rti, Ok(()));
    assert!(federation.outcomes.iter().all(Result::is_ok), "{:?}", federation.outcomes);
    assert_eq!(federation.warnings, [""; 0]);
    federation
}

const BOTH: [Coordination; 2] = [Coordination::Centralized, Coordination::Decentralized];

#[test]
fn small_messages_over_unix_sockets() {
    for coordination in BOTH {
        let federation = run_rounds(coordination, "unix:@hprm-test-UNIQUE", 64, 200);
        assert!(federation.events.iter().any(|event| matches!(event, RtiEvent::Started(_))));
    }
}

#[test]
fn large_messages_through_the_object_store() {
    for coordination in BOTH {
        run_rounds(coordination, "unix:@hprm-test-UNIQUE", 3_000_000, 20);
    }
}

#[test]
fn any_messages_over_tcp() {
    for coordination in BOTH {
        run_rounds(coordination, "tcp:127.0.0.1:0", 64, 50);
        run_rounds(coordination, "tcp:127.0.0.1:0", 1_000_000, 5);
    }
}

#[test]
fn any_messages_in_a_room() {
    for coordination in BOTH {
        for size in [(64, 200), (3_000_000, 20)] {
            run_rounds_in(Some(&Room::new()), coordination, "unix:@room", size);
        }
    }
}

#[test]
fn in_a_room_the_value_itself_arrives() {
    for coordination in BOTH {
        let Gather { program, out, start, requests, .. } = gather(coordination, 2);
        let sent: Arc<Vec<u8>> = Arc::new(vec![7; 3_000_000]);
        let (value, arrived) = (Arc::clone(&sent), Arc::new(AtomicU32::new(0)));
        let count = Arc::clone(&arrived);
        let react = move |scheduler: &mut Scheduler<Bytes>, id: ReactionId, _: Body| {
            if id == start {
                scheduler.set(out, Bytes::Own(Arc::clone(&value)));
                return Ok(());
            }
            let request = requests.iter().find_map(|port| scheduler.port(*port)).unwrap();
            let Bytes::Own(request) = request else { panic!("it went through a store") };
            assert!(Arc::ptr_eq(request, &value));
            if count.fetch_add(1, Ordering::Relaxed) == 1 {
                scheduler.request_stop();
            }
            Ok(())
        };
        let room = Room::new();
        let federation = federation_in(Some(&room), program, "unix:@room", Arc::new(react));
        assert!(federation.outcomes.iter().all(Result::is_ok), "{:?}", federation.outcomes);
        assert_eq!(arrived.load(Ordering::Relaxed), 2);
        assert_eq!(Arc::strong_count(&sent), 1, "the room keeps nothing");
    }
}

#[test]
fn a_reaction_that_fails_ends_the_federation_and_is_reported_once() {
    for coordination in BOTH {
        let Gather { program, out, round, start, requests, replies, .. } = gather(coordination, 2);
        let react = move |scheduler: &mut Scheduler<Bytes>, id: ReactionId, _: Body| {
            let hello = Bytes::Own(Arc::new(b"hello".to_vec()));
            if id == round {
                return Err(Failure { message: "error: no more".to_owned(), code: 3 });
            }
            if id == start {
                scheduler.set(out, hello);
            } else {
                let who = requests.iter().position(|p| scheduler.port(*p).is_some()).unwrap();
                scheduler.set(replies[who], hello);
            }
            Ok(())
        };
        let federation = federation(program, "unix:@hprm-test-UNIQUE", Arc::new(react));
        let failure = Failure { message: "error: no more".to_owned(), code: 3 };
        assert_eq!(federation.rti, Err(failure.clone()));
        assert_eq!(federation.outcomes[0], Err(failure));
        for outcome in &federation.outcomes[1..] {
            assert_eq!(outcome, &Err(Failure { message: String::new(), code: 1 }));
        }
        let failed = federation.events.iter().filter(|e| matches!(e, RtiEvent::Failed { .. }));
        assert_eq!(failed.count(), 1);
    }
}

#[test]
fn a_timeout_ends_every_federate_at_its_tag() {
    for coordination in BOTH {
        let Gather { mut program, .. } = gather(coordination, 2);
        program.properties.timeout = Some(20_000_000);
        let federation =
            federation(program, "unix:@hprm-test-UNIQUE", Arc::new(|_: &mut _, _, _| Ok(())));
        assert_eq!(federation.rti, Ok(()));
        assert!(federation.outcomes.iter().all(Result::is_ok), "{:?}", federation.outcomes);
    }
}

#[test]
fn a_stranger_who_claims_to_send_much_is_hung_up_on() {
    use std::io::{Read, Write};

    let program = Arc::new(gather(Coordination::Centralized, 1).program);
    let listen = "tcp:127.0.0.1:0".parse().unwrap();
    let rti = Rti::bind(&RtiOptions {
        program,
        federation: FederationId(7),
        listen,
        patience: Patience::default(),
    })
    .unwrap();
    let Address::Tcp(address) = rti.address().clone() else { unreachable!("it is TCP") };
    let handle = rti.handle();
    let rti = thread::spawn(move || rti.run(|_| {}));
    let mut stranger = std::net::TcpStream::connect(address).unwrap();
    // A message of a gigabyte, or so it says.
    stranger.write_all(&[0, 0, 0, 64, 1]).unwrap();
    assert_eq!(stranger.read(&mut [0]).unwrap(), 0);
    handle.abort();
    assert_eq!(rti.join().unwrap(), Ok(()));
}
