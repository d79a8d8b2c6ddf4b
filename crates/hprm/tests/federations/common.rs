//! Federations with real sockets and real memory, but in one process and without Python: what
//! several tests need.
//!
//! Each federate is a thread with its own loop, store and links, exactly as in a process.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

use hprm::{
    Address, Failure, FederateOptions, Host, Inbox, Reach, Rti, RtiEvent, RtiOptions, Security,
    ValueExchange,
};
use hprm::{FederationId, HangTimeout};
use hprm_core::limits::INLINE_LIMIT;
use hprm_core::{
    Body, ChannelId, Coordination, Delay, Direction, Effect, FederateId, Nanos, Part, Payload,
    PortId, Program, ProgramBuilder, Properties, ReactionId, ReactionSpec, Reading, Scheduler,
    Trigger,
};
use hprm_store::{Object, StoreAllocator, StoreLimits};

/// Bytes, wherever they are.
#[derive(Clone)]
pub(crate) enum Bytes {
    Own(Arc<Vec<u8>>),
    Remote(Object),
}

impl Bytes {
    pub(crate) fn as_slice(&self) -> &[u8] {
        match self {
            Self::Own(bytes) => bytes,
            Self::Remote(object) => object.as_bytes(),
        }
    }
}

pub(crate) type React =
    dyn Fn(&mut Scheduler<Bytes>, ReactionId, Body) -> Result<(), Failure> + Send + Sync;

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
        store: &StoreAllocator,
        _: ChannelId,
        value: &Bytes,
        _: bool,
    ) -> Result<Payload, Failure> {
        let bytes = value.as_slice();
        if bytes.len() <= INLINE_LIMIT {
            return Ok(Payload { head: bytes.to_vec(), ..Payload::default() });
        }
        let key = bytes.as_ptr() as usize;
        if let Some((payload, _)) = self.encoded.get(&key) {
            return Ok(payload.clone());
        }
        let mut store = store.store();
        let object = store.put(bytes, &[self.me]).map_err(|e| Failure::Store(e.to_string()))?;
        let hold = store.open(object).map_err(|e| Failure::Store(e.to_string()))?;
        let payload = Payload { parts: vec![Part::Object(object)], ..Payload::default() };
        self.encoded.insert(key, (payload.clone(), hold));
        Ok(payload)
    }

    fn receive(
        &mut self,
        _: ChannelId,
        payload: Payload,
        mut objects: Vec<Object>,
        _: impl Reading,
        _: bool,
    ) -> Result<Bytes, Failure> {
        Ok(match (objects.pop(), payload.parts.into_iter().next()) {
            (Some(object), _) => Bytes::Remote(object),
            (None, Some(Part::Inline(bytes))) => Bytes::Own(Arc::new(bytes)),
            (None, _) => Bytes::Own(Arc::new(payload.head)),
        })
    }

    fn warn(&mut self, message: &str) {
        self.warnings.lock().unwrap().push(message.to_owned());
    }
}

pub(crate) struct Federation {
    pub(crate) outcomes: Vec<Result<(), Failure>>,
    pub(crate) rti: Result<(), Failure>,
    pub(crate) events: Vec<RtiEvent>,
    pub(crate) warnings: Vec<String>,
}

pub(crate) const SECRET: FederationId = FederationId(7);

/// Runs a federation to its end.
pub(crate) fn federation(program: Program, address: &str, react: Arc<React>) -> Federation {
    federation_beside(program, address, &Security::default(), react, |_| ())
}

/// The same, beside something that is made once the RTI listens, and kept until the end.
pub(crate) fn federation_beside<T>(
    program: Program,
    address: &str,
    security: &Security,
    react: Arc<React>,
    beside: impl FnOnce(&Address) -> T,
) -> Federation {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let program = Arc::new(program);
    let unique = format!("{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    let listen: Address = address.replace("UNIQUE", &unique).parse().unwrap();
    let rti = bind(&program, listen, security);
    let beside = beside(rti.address());
    let federation = run(rti, &program, security, &react, None);
    drop(beside);
    federation
}

/// The same for threads that share an exchange.
pub(crate) fn federation_in(
    exchange: &ValueExchange<Bytes>,
    program: Program,
    react: &Arc<React>,
) -> Federation {
    let (program, security) = (Arc::new(program), Security::default());
    let rti =
        exchange.rti(&rti_options(&program, "unix:@room".parse().unwrap(), &security)).unwrap();
    run(rti, &program, &security, react, Some(exchange))
}

fn run(
    rti: Rti,
    program: &Arc<Program>,
    security: &Security,
    react: &Arc<React>,
    exchange: Option<&ValueExchange<Bytes>>,
) -> Federation {
    let address = rti.address().clone();
    let warnings = Arc::new(Mutex::new(Vec::new()));
    let events = Arc::new(Mutex::new(Vec::new()));
    let report = Arc::clone(&events);
    let rti = thread::spawn(move || rti.run(|event| report.lock().unwrap().push(event)));
    let federates: Vec<_> = program
        .federates
        .ids()
        .map(|federate| {
            let options = options(program, federate, &address, security);
            let (react, warnings) = (Arc::clone(react), Arc::clone(&warnings));
            let exchange = exchange.cloned();
            thread::spawn(move || federate_of(&options, react, warnings, exchange.as_ref()))
        })
        .collect();
    let outcomes = federates.into_iter().map(|federate| federate.join().unwrap()).collect();
    let rti = rti.join().unwrap();
    let events = std::mem::take(&mut *events.lock().unwrap());
    let warnings = std::mem::take(&mut *warnings.lock().unwrap());
    Federation { outcomes, rti, events, warnings }
}

/// An RTI that listens.
pub(crate) fn bind(program: &Arc<Program>, listen: Address, security: &Security) -> Rti {
    Rti::bind(&rti_options(program, listen, security)).unwrap()
}

pub(crate) fn rti_options(
    program: &Arc<Program>,
    listen: Address,
    security: &Security,
) -> RtiOptions {
    RtiOptions {
        program: Arc::clone(program),
        fingerprint: Arc::new(program.fingerprint()),
        federation: SECRET,
        listen,
        also_listen: Vec::new(),
        security: security.clone(),
        hang_timeout: HangTimeout::default(),
    }
}

/// What a federate is started with.
pub(crate) fn options(
    program: &Arc<Program>,
    federate: FederateId,
    rti: &Address,
    security: &Security,
) -> FederateOptions {
    FederateOptions {
        program: Arc::clone(program),
        fingerprint: Arc::new(program.fingerprint()),
        federate,
        rti: rti.clone(),
        federation: SECRET,
        security: security.clone(),
        reach: Reach::default(),
        store: StoreLimits::default(),
        trace: None,
        record: None,
        launched: false,
        end_process: None,
    }
}

/// Runs a federate, in this thread.
pub(crate) fn federate_with(
    options: &FederateOptions,
    react: Arc<React>,
    warnings: Arc<Mutex<Vec<String>>>,
) -> Result<(), Failure> {
    federate_of(options, react, warnings, None)
}

fn federate_of(
    options: &FederateOptions,
    react: Arc<React>,
    warnings: Arc<Mutex<Vec<String>>>,
    exchange: Option<&ValueExchange<Bytes>>,
) -> Result<(), Failure> {
    let inbox = Inbox::new().unwrap();
    let load = || {
        let (me, encoded) = (options.federate, BTreeMap::new());
        Ok(Closures { me, react, warnings, encoded, _not_send: OnceCell::new() })
    };
    match exchange {
        Some(exchange) => hprm::run_federate_in(options, exchange, &inbox, load),
        None => hprm::run_federate(options, &inbox, load),
    }
}

/// A server sends to `clients` clients, each answers, and the server starts the next round when it
/// has all answers: the shape of the paper's broadcast and gather.
pub(crate) struct Gather {
    pub(crate) program: Program,
    pub(crate) out: PortId,
    pub(crate) answers: Vec<PortId>,
    pub(crate) requests: Vec<PortId>,
    pub(crate) replies: Vec<PortId>,
    pub(crate) start: ReactionId,
    pub(crate) round: ReactionId,
}

pub(crate) fn gather(coordination: Coordination, clients: usize) -> Gather {
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
pub(crate) fn run_rounds(
    coordination: Coordination,
    address: &str,
    len: usize,
    rounds: u32,
) -> Federation {
    let (program, react) = rounds_of(coordination, len, rounds);
    well(federation(program, address, react))
}

/// A federation that has ended well.
pub(crate) fn well(federation: Federation) -> Federation {
    assert_eq!(federation.rti, Ok(()));
    assert!(federation.outcomes.iter().all(Result::is_ok), "{:?}", federation.outcomes);
    // A busy machine may keep no federation in time.
    let warnings = federation.warnings.iter().filter(|warning| !warning.contains(" lags "));
    assert_eq!(warnings.collect::<Vec<_>>(), [""; 0]);
    federation
}

/// A program of some rounds of `len` bytes, and what its reactions do; they check every byte.
pub(crate) fn rounds_of(
    coordination: Coordination,
    len: usize,
    rounds: u32,
) -> (Program, Arc<React>) {
    const CLIENTS: usize = 3;
    let Gather { program, out, answers, requests, replies, start, round } =
        gather(coordination, CLIENTS);
    let seen = AtomicU32::new(0);
    let message = move |round: u32, sender: usize| -> Bytes {
        let byte = u8::try_from((round as usize * 7 + sender) % 251).unwrap();
        Bytes::Own(Arc::new(vec![byte; len]))
    };
    let react = move |scheduler: &mut Scheduler<Bytes>, id: ReactionId, _: Body| {
        if id == start {
            scheduler.set(out, message(0, 0));
        } else if id == round {
            let done = seen.fetch_add(1, Ordering::Relaxed) + 1;
            for (sender, port) in answers.iter().enumerate() {
                let answer = scheduler.port(*port).expect("all answers have one tag");
                assert!(answer.as_slice() == message(done - 1, sender + 1).as_slice());
            }
            if done == rounds {
                scheduler.request_stop();
            } else {
                scheduler.set(out, message(done, 0));
            }
        } else {
            let sender = requests.iter().position(|port| scheduler.port(*port).is_some()).unwrap();
            let request = scheduler.port(requests[sender]).unwrap().as_slice();
            let answer: Vec<u8> = request.iter().map(|b| (b + 1 + sender as u8) % 251).collect();
            scheduler.set(replies[sender], Bytes::Own(Arc::new(answer)));
        }
        Ok(())
    };
    (program, Arc::new(react))
}

/// Both coordinations.
pub(crate) const BOTH: [Coordination; 2] = [Coordination::Centralized, Coordination::Decentralized];
