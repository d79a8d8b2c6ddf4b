//! What carries packets between agents: a Zenoh session, and all that this program knows of Zenoh.
//!
//! ```text
//! hprm/agents/2/machines/AGENT        a liveliness token: that agent is there
//! hprm/agents/2/open/TO/FROM          a query that opens a link to a listener there
//! hprm/agents/2/links/TO/FROM         packets of links, from one agent to another: the number of the link, and the packet
//! hprm/agents/2/about/AGENT           a query for what `hprm machines` shows: see `about.rs`
//! hprm/agents/2/roster                a query for a newer roster: see `membership.rs`
//! hprm/agents/2/certificates/AGENT    a query for newer certificates of machines: see `renewal.rs`
//! hprm/agents/2/to/ROUTER/...         packets and queries for agents that only a router reaches, and
//! hprm/agents/2/by/ROUTER/...         what that makes of them: see `router.rs`
//! ```
//!
//! An agent is named by its machine and its epoch, `robot1/18ac55e2f6a0b1c2`, so an agent that was started again, or
//! another one that was given the same name, gets nothing that was meant for the first.
//!
//! Packets may be dropped: where Zenoh has no room, and where this program is too slow. A relayed link makes up for it.
//! All calls return at once, or soon; what happens elsewhere comes as an [`Event`].

use std::fmt;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread;
use std::time::Duration;

use hprm::agent::{Answer, Limited, is_name};
use hprm_federated::relay::{Bytes, FRAME_LIMIT, Packet};
use serde::{Deserialize, Serialize};
use zenoh::Wait;
use zenoh::bytes::ZBytes;
use zenoh::handlers::DefaultHandler;
use zenoh::key_expr::KeyExpr;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{ConsolidationMode, Query, Queryable};
use zenoh::sample::SampleKind;
use zenoh::session::SessionGetBuilder;

use crate::Failure;
use crate::about::{self, Here};
use crate::access;
use crate::credentials::Credentials;
use crate::door::Door;
use crate::hearing::Hearing;
use crate::membership::{self, News};
use crate::options::Options;
use crate::others::Reached;
use crate::renewal;
use crate::replies::Replies;
use crate::router::{self, Router};
use crate::waiting::{Mark, may_block};

pub(crate) const ROOT: &str = "hprm/agents/2";

/// How many packets and requests of other agents may wait for this program; more are dropped.
pub(crate) const PACKETS: usize = 1024;

/// The most bytes of what comes as a packet: a frame, and room for what else is in one. Others are dropped at once, so that
/// not too much waits.
pub(crate) const PACKET_LIMIT: usize = 68 << 10;
const _: () = assert!(PACKET_LIMIT >= FRAME_LIMIT + 1024);

/// The most bytes of a frame that an agent sends: as many as fit into one batch of Zenoh, with what stands before them. Zenoh
/// would cut a longer packet into two, the second one being short, and put it together at the other end.
pub(crate) const FRAME: usize = 63 << 10;
const _: () = assert!(FRAME <= FRAME_LIMIT);

/// The most bytes of a frame that is copied behind its header. A longer one is handed to Zenoh as it is.
const COPIED: usize = 4 << 10;

/// The most bytes of a packet that is copied out of the batch in which it has come.
const HELD: usize = 32 << 10;

/// The most bytes of what Zenoh puts together from pieces, from each of those that send; more is dropped. A roster is the
/// longest.
const MESSAGE_LIMIT: usize = 4 << 20;

/// The priority of the last packets of a link: no other ones have it, so they find room.
pub(crate) const LAST: Priority = Priority::InteractiveLow;

/// How many batches of 64 KiB wait for a connection at most: as many as Zenoh permits. A packet that finds no room within a
/// millisecond is dropped. With two batches, as is usual, and one for each packet (`express`), no more than two packets of many had room
/// while the thread that writes was not scheduled. Now packets share batches while others are written; where nothing waits, they leave at once.
pub(crate) const BATCHES: u32 = 16;

/// How long an agent may take to open a link.
pub(crate) const OPENING: Duration = Duration::from_secs(20);

/// An agent: its machine, and when it was started, which tells it from others of that name.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug, Serialize, Deserialize)]
pub(crate) struct AgentId {
    pub(crate) machine: String,
    pub(crate) epoch: u64,
}

/// Which link it is, for both of its ends.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) struct LinkId {
    /// The other agent.
    pub(crate) agent: AgentId,
    /// A random number.
    pub(crate) number: u64,
    /// The machine whose agent leads it, if the two do not reach one another. What comes another way is not of this link.
    pub(crate) router: Option<String>,
}

/// What has happened elsewhere.
#[derive(Debug)]
pub(crate) enum Event {
    /// A packet of a link has come.
    Packet { link: LinkId, packet: Bytes },
    /// Another agent wants to open a link.
    Opening(Opening),
    /// A link that this agent wanted to open is open, or is not.
    Opened { link: LinkId, answer: Answer },
    /// An agent is there, or is not.
    Agent { agent: AgentId, is_there: bool },
    /// A router reaches an agent, or does not.
    Route { router: String, agent: AgentId, is_there: bool },
    /// Another agent says something of rosters or certificates.
    News(News),
}

impl Event {
    /// Whether it is not about what a link carries.
    fn is_rare(&self) -> bool {
        !matches!(self, Self::Packet { .. })
    }
}

/// A link that another agent wants to open.
#[derive(Debug)]
pub(crate) struct Opening {
    pub(crate) link: LinkId,
    pub(crate) name: String,
    query: Query,
}

/// What an agent says to open a link.
#[derive(Serialize, Deserialize)]
struct OpeningText {
    number: u64,
    name: String,
}

/// See the module.
pub(crate) struct Carrier {
    session: zenoh::Session,
    /// Where the session finds the credentials, if this machine was enrolled.
    door: Option<Door>,
    me: AgentId,
    inbox: Arc<Inbox>,
    packets: Receiver<Event>,
    events: Receiver<Event>,
    hearing: Hearing,
    here: Arc<Here>,
    replies: Replies,
    router: Option<Router>,
    _declared: Declared,
    _about: [Queryable<()>; 2],
    _rosters: Option<[Queryable<()>; 2]>,
}

/// What makes the machine known, and where what comes to it goes.
struct Declared {
    _token: LivelinessToken,
    /// Those that routers lead here; for others see `hearing.rs`.
    _packets: Subscriber<()>,
    _openings: [Queryable<()>; 2],
    _machines: Subscriber<()>,
    _routes: Subscriber<()>,
}

/// Where the threads of Zenoh put what has happened.
pub(crate) struct Inbox {
    packets: SyncSender<Event>,
    events: Sender<Event>,
    /// How many events wait that are no packets.
    rare: AtomicUsize,
    ready: Mark,
}

/// One direction of a link: packets for its other end.
///
/// Nothing is declared to others for it: each such declaration is told to all other agents, and answered, and Zenoh 1.10 does
/// not bear it well if many come and go.
pub(crate) struct Way {
    to: Named,
    /// What comes back through a router.
    _from: Option<Named>,
    /// The link.
    number: u64,
    /// What becomes of a packet for which there is no room, and which room it has.
    congestion: CongestionControl,
    priority: Priority,
}

/// A key that Zenoh knows within this process as long as a link has it. Of such a key it remembers where packets go, and whose
/// they are that come; of others it finds that out for each packet.
struct Named {
    session: zenoh::Session,
    /// None only while it is dropped.
    key: Option<KeyExpr<'static>>,
}

impl Carrier {
    /// Opens a session, and makes this machine known.
    pub(crate) fn open(
        options: &Options,
        credentials: Option<&Credentials>,
        me: AgentId,
        limited: Option<Limited>,
        ready: Mark,
    ) -> Result<Self, Failure> {
        let door = credentials.map(|it| Door::open(it.folder())).transpose();
        let door = door.map_err(|error| {
            Failure::new(format!("the agent cannot open the folder of its credentials: {error}"))
        })?;
        let config = config(options, credentials, door.as_ref())?;
        let session = zenoh::open(config).wait().map_err(|error| {
            let listen = options.listen.join(" and ");
            // What follows are places in Zenoh's sources.
            let error = error.to_string();
            let error = error.split(" at /").next().unwrap_or_default();
            Failure::new(format!("the agent cannot listen at {listen}: {error}"))
                .hint("name another port: --listen HOST:PORT")
        })?;
        let (packets_in, packets) = sync_channel(PACKETS);
        let (events_in, events) = channel();
        let rare = AtomicUsize::new(0);
        let inbox = Arc::new(Inbox { packets: packets_in, events: events_in, rare, ready });
        let failed = |error| Failure::new(format!("Zenoh fails: {error}"));
        let here = Arc::new(Here::new(options, limited));
        let replies = Replies::open()
            .map_err(|error| Failure::new(format!("the agent has no thread left: {error}")))?;
        let about = about::declare(&session, &me, &here, &replies).map_err(failed)?;
        let rosters = credentials.map(|it| {
            let rosters = membership::declare(&session, it, &replies, news(&inbox))?;
            Ok([rosters, renewal::declare(&session, &me, it, &replies)?])
        });
        let rosters = rosters.transpose().map_err(failed)?;
        let is_router = options.is_router(credentials);
        let router = is_router.then(|| Router::open(&session, &me.machine, &replies));
        let router = router.transpose().map_err(failed)?;
        let declared = declare(&session, &me, &inbox).map_err(failed)?;
        Ok(Self {
            hearing: Hearing::new(&me, &session, &inbox),
            session,
            door,
            me,
            inbox,
            packets,
            events,
            here,
            replies,
            router,
            _declared: declared,
            _about: about,
            _rosters: rosters,
        })
    }

    /// Opens another session, for another roster. What has not arrived in the old one is lost.
    pub(crate) fn reopen(
        &mut self,
        options: &Options,
        credentials: &Credentials,
    ) -> Result<(), Failure> {
        // A session that cannot be closed does not listen any more, or the next one says so.
        self.end();
        let (limited, ready) = (self.here.limited(), self.inbox.ready.clone());
        *self = Self::open(options, Some(credentials), self.me.clone(), limited, ready)?;
        Ok(())
    }

    /// Asks other agents for a newer roster; [`Event::News`] is the answer, if there is one.
    pub(crate) fn ask_for_roster(&self, credentials: &Credentials) {
        membership::ask(&self.session, credentials, news(&self.inbox));
    }

    /// Asks another agent for newer certificates; [`Event::News`] is the answer, if there are some.
    pub(crate) fn ask_for_certificates(&self, partner: &AgentId, credentials: &Credentials) {
        let tell = news(&self.inbox);
        let tell = move |certificates| tell(News::Certificates(certificates));
        renewal::ask(&self.session, partner, credentials, tell);
    }

    /// What has happened, if anything has.
    pub(crate) fn next(&self) -> Option<Event> {
        let event = self.events.try_recv().or_else(|_| self.packets.try_recv()).ok()?;
        self.inbox.rare.fetch_sub(usize::from(event.is_rare()), Ordering::Relaxed);
        Some(event)
    }

    /// Whether events have come that are no packets.
    pub(crate) fn has_rare_events(&self) -> bool {
        self.inbox.rare.load(Ordering::Relaxed) > 0
    }

    /// Marks that there is more to do.
    pub(crate) fn mark(&self) {
        self.inbox.ready.set();
    }

    /// Asks the agent of a machine to open a link; [`Event::Opened`] is the answer.
    pub(crate) fn open_link(&self, link: &LinkId, name: &str) {
        let LinkId { agent, number, router } = link;
        let text = OpeningText { number: *number, name: name.to_owned() };
        let payload = serde_json::to_vec(&text).expect("it has names only");
        let inbox = Arc::clone(&self.inbox);
        let absent = format!("the agent of {} does not answer", agent.machine);
        let mut asked =
            Asked { inbox, link: link.clone(), otherwise: Some(Answer::Absent(absent)) };
        let key = router::key(router.as_deref(), &format!("open/{agent}/{}", self.me));
        let got = asking(&self.session, key)
            .payload(payload)
            .timeout(OPENING)
            .callback_mut(move |reply| {
                if let Ok(sample) = reply.result() {
                    let text = sample.payload().to_bytes();
                    asked.answer(Answer::read(String::from_utf8_lossy(&text).trim_end()));
                }
            })
            .wait();
        // If it fails, the callback is gone, which is an answer.
        drop(got);
    }

    /// Answers an agent that wants to open a link.
    pub(crate) fn answer(&self, opening: Opening, answer: Answer) {
        self.replies.give(opening.query, move |query| {
            // If it does not arrive, the other agent does not wait for ever.
            let _ = query.reply(query.key_expr().clone(), answer.to_string()).wait();
        });
    }

    /// Says whether this agent reaches another one, to those that it leads to it, if it is a router.
    pub(crate) fn reaches(&mut self, agent: &AgentId, is_there: bool) {
        if let Some(router) = &mut self.router {
            router.reaches(&self.session, agent, is_there);
        }
    }

    /// Tells a process what other agents, of different names, say of their machines.
    pub(crate) fn tell_machines(&self, others: Vec<Reached>, stream: UnixStream) {
        about::tell(self.session.clone(), Arc::clone(&self.here), others, stream);
    }

    /// The way to the other end of a link, and from there.
    pub(crate) fn way(&mut self, link: &LinkId) -> Result<Way, String> {
        let session = self.session.clone();
        let named = |key| Named::new(&session, key);
        let from = match &link.router {
            Some(router) => {
                let from = format!("links/{}/{}", self.me, link.agent);
                Some(named(router::key_from(router, &from))?)
            }
            None => {
                self.hear(&link.agent)?;
                None
            }
        };
        let (congestion, priority) = (CongestionControl::Drop, Priority::DEFAULT);
        Ok(Way {
            to: named(self.key_to(link))?,
            _from: from,
            number: link.number,
            congestion,
            priority,
        })
    }

    /// Hears the packets of an agent that reaches this one directly.
    pub(crate) fn hear(&mut self, agent: &AgentId) -> Result<(), String> {
        self.hearing.hear(agent).map_err(|error| error.to_string())
    }

    /// Hears of packets only those agents further on that reach this one directly.
    pub(crate) fn hear_only(&mut self, is_meant: impl Fn(&AgentId) -> bool) {
        self.hearing.keep(is_meant);
    }

    fn key_to(&self, link: &LinkId) -> String {
        router::key(link.router.as_deref(), &format!("links/{}/{}", link.agent, self.me))
    }

    /// Sends one packet of a link for which there is no way.
    pub(crate) fn send_once(&self, link: &LinkId, packet: &[u8]) {
        let packet = [&link.number.to_le_bytes(), packet].concat();
        let put = self.session.put(self.key_to(link), packet);
        drop(put.congestion_control(CongestionControl::Drop).wait());
    }

    /// Ends the session; what was sent leaves first.
    pub(crate) fn close(mut self) {
        // A session that cannot be closed ends with the process.
        self.end();
    }

    fn end(&mut self) {
        // Without a descriptor for that, the session ends as well, and seldom comes back.
        let _ = self.door.as_mut().map(Door::shut);
        let _ = self.session.close().wait();
    }
}

impl Way {
    /// From now on, packets wait until there is room: they are the last ones, and nothing sends them again. They have room of
    /// their own, also at a router, which waits for none.
    pub(crate) fn insist(&mut self) {
        (self.congestion, self.priority) = (CongestionControl::Block, LAST);
    }

    /// Sends a packet, or drops it.
    pub(crate) fn send(&self, packet: Packet) {
        let (number, head) = (self.number.to_le_bytes(), packet.head.as_slice());
        match packet.frame {
            Some(frame) if frame.len() > COPIED => {
                let mut whole = ZBytes::writer();
                whole.append([&number, head].concat().into());
                whole.append(bytes::Bytes::from_owner(frame).into());
                self.put(whole.finish());
            }
            frame => {
                let frame = frame.as_deref().unwrap_or_default();
                self.put([&number, head, frame].concat().into());
            }
        }
    }

    fn put(&self, packet: ZBytes) {
        let Named { session, key: Some(key) } = &self.to else { return };
        let put = session.put(key, packet).priority(self.priority);
        let put = put.congestion_control(self.congestion);
        // A session that has ended carries nothing; the link notices the silence.
        let _ = match self.congestion {
            CongestionControl::Drop => put.wait(),
            _ => may_block(|| put.wait()),
        };
    }
}

impl Named {
    fn new(session: &zenoh::Session, key: String) -> Result<Self, String> {
        let declared = session.declare_keyexpr(key).wait();
        let key = declared.map_err(|error| error.to_string())?;
        Ok(Self { session: session.clone(), key: Some(key) })
    }
}

impl Drop for Named {
    fn drop(&mut self) {
        let Some(key) = self.key.take() else { return };
        if thread::panicking() {
            // Of Zenoh perhaps, which would panic again.
            return std::mem::forget(key);
        }
        // A session that has ended knows nothing any more.
        let _ = may_block(|| self.session.undeclare(key).wait());
    }
}

/// A query to other agents. It does not wait behind packets of links, and neither does its answer, which
/// counts as soon as it comes: Zenoh may learn much later that no other one follows (`replies.rs`).
pub(crate) fn asking<'a>(
    session: &'a zenoh::Session,
    key: String,
) -> SessionGetBuilder<'a, 'a, DefaultHandler> {
    session.get(key).priority(Priority::InteractiveHigh).consolidation(ConsolidationMode::None)
}

/// An answer that comes, or does not; then another one is taken for it.
struct Asked {
    inbox: Arc<Inbox>,
    link: LinkId,
    otherwise: Option<Answer>,
}

impl Asked {
    fn answer(&mut self, answer: Answer) {
        if self.otherwise.take().is_some() {
            self.inbox.put(Event::Opened { link: self.link.clone(), answer });
        }
    }
}

impl Drop for Asked {
    fn drop(&mut self) {
        if let Some(answer) = self.otherwise.clone() {
            self.answer(answer);
        }
    }
}

impl Inbox {
    /// Takes what has come as a packet from an agent, and perhaps by a router.
    pub(crate) fn put_packet(
        &self,
        from: impl FnOnce() -> Option<(AgentId, Option<String>)>,
        payload: &ZBytes,
    ) {
        if payload.len() <= PACKET_LIMIT
            && let Some((agent, router)) = from()
            && let Some((number, packet)) = packet(payload)
        {
            self.put(Event::Packet { link: LinkId { agent, number, router }, packet });
        }
    }

    fn put(&self, event: Event) {
        // What others send may be any number, and is dropped where there is no room: a packet is sent again, and so is
        // what opens a link. Without a receiver, the program ends.
        let is_sent = matches!(event, Event::Packet { .. } | Event::Opening(_) | Event::News(_));
        let is_rare = usize::from(event.is_rare());
        self.rare.fetch_add(is_rare, Ordering::Relaxed);
        let put = match is_sent {
            true => self.packets.try_send(event).is_ok(),
            false => self.events.send(event).is_ok(),
        };
        if !put {
            self.rare.fetch_sub(is_rare, Ordering::Relaxed);
        }
        self.ready.set();
    }
}

/// Where news of rosters and certificates go.
fn news(inbox: &Arc<Inbox>) -> impl Fn(News) + Send + Sync + 'static {
    let inbox = Arc::clone(inbox);
    move |news| inbox.put(Event::News(news))
}

impl fmt::Display for AgentId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{:016x}", self.machine, self.epoch)
    }
}

impl AgentId {
    /// Reads the last two parts of a key.
    fn read<'a>(parts: &mut impl Iterator<Item = &'a str>) -> Option<Self> {
        let epoch = u64::from_str_radix(parts.next()?, 16).ok()?;
        let machine = parts.next().filter(|machine| is_name(machine))?.to_owned();
        Some(Self { machine, epoch })
    }
}

/// Makes the machine known, after what comes to it has somewhere to go.
fn declare(
    session: &zenoh::Session,
    me: &AgentId,
    inbox: &Arc<Inbox>,
) -> Result<Declared, zenoh::Error> {
    let packets = |key: String| {
        let into = Arc::clone(inbox);
        let declared = session.declare_subscriber(key).callback(move |sample| {
            into.put_packet(|| sender(sample.key_expr().as_str()), sample.payload());
        });
        declared.wait()
    };
    let openings = |key: String| {
        let into = Arc::clone(inbox);
        let declared = session.declare_queryable(key).callback(move |query| {
            if let Some(opening) = opening(query) {
                into.put(Event::Opening(opening));
            }
        });
        declared.wait()
    };
    let tokens = |key: &str, event: fn(&str, bool) -> Option<Event>| {
        let into = Arc::clone(inbox);
        let declared = session.liveliness().declare_subscriber(format!("{ROOT}/{key}"));
        let declared = declared.history(true).callback(move |sample| {
            let is_there = sample.kind() == SampleKind::Put;
            if let Some(event) = event(sample.key_expr().as_str(), is_there) {
                into.put(event);
            }
        });
        declared.wait()
    };
    Ok(Declared {
        _packets: packets(format!("{ROOT}/by/*/links/{me}/*/*"))?,
        _openings: [
            openings(format!("{ROOT}/open/{me}/*/*"))?,
            openings(format!("{ROOT}/by/*/open/{me}/*/*"))?,
        ],
        _machines: tokens("machines/*/*", |key, is_there| {
            Some(Event::Agent { agent: AgentId::read(&mut key.rsplit('/'))?, is_there })
        })?,
        _routes: tokens("routes/*/*/*", |key, is_there| {
            let mut parts = key.rsplit('/');
            let agent = AgentId::read(&mut parts)?;
            let router = parts.next().filter(|router| is_name(router))?.to_owned();
            Some(Event::Route { router, agent, is_there })
        })?,
        _token: session.liveliness().declare_token(format!("{ROOT}/machines/{me}")).wait()?,
    })
}

/// The bytes of what comes. Of a long one, they stay in the buffer into which the session has read a batch: it is most of that. A
/// short one is copied, so that it does not hold a buffer in which there may be little else.
fn bytes_of(payload: &ZBytes) -> Bytes {
    let mut slices = payload.slices();
    match (slices.next(), slices.next()) {
        (Some(only), None) if only.len() > HELD => Bytes::of(Whole(payload.clone())),
        _ => payload.to_bytes().into_owned().into(),
    }
}

/// What is in one piece.
struct Whole(ZBytes);

impl AsRef<[u8]> for Whole {
    fn as_ref(&self) -> &[u8] {
        self.0.slices().next().unwrap_or_default()
    }
}

/// What another agent asks for, if it is well-formed.
fn opening(query: Query) -> Option<Opening> {
    let payload = query.payload()?.to_bytes();
    let OpeningText { number, name } = serde_json::from_slice(&payload).ok()?;
    // Of who asks, only the key can be believed: access control looks at it.
    let key = query.key_expr().as_str();
    let agent = AgentId::read(&mut key.rsplit('/'))?;
    let link = LinkId { agent, number, router: router::of(key) };
    is_name(&name).then_some(Opening { link, name, query })
}

/// The agent that has sent a packet, and the router that has led it, as its key tells.
fn sender(key: &str) -> Option<(AgentId, Option<String>)> {
    Some((AgentId::read(&mut key.rsplit('/'))?, router::of(key)))
}

/// The number of the link to which a packet belongs, and the packet, if it is one.
fn packet(payload: &ZBytes) -> Option<(u64, Bytes)> {
    let bytes = bytes_of(payload);
    let number = u64::from_le_bytes(*bytes.first_chunk()?);
    Some((number, bytes.part(size_of_val(&number)..bytes.len())))
}

fn config(
    options: &Options,
    credentials: Option<&Credentials>,
    door: Option<&Door>,
) -> Result<zenoh::Config, Failure> {
    let protocol = if options.tls.is_some() { "tls" } else { "tcp" };
    let endpoints = |places: &[String]| {
        let places: Vec<_> = places.iter().map(|place| format!("{protocol}/{place}")).collect();
        serde_json::to_string(&places).expect("texts are JSON")
    };
    let text = |text: &str| serde_json::to_string(text).expect("a text is JSON");
    let mut settings = vec![
        ("mode", text("peer")),
        ("listen/endpoints", endpoints(&options.listen)),
        ("connect/endpoints", endpoints(&options.connect)),
        // Machines are named, so that no other one in the network is met by chance.
        ("scouting/multicast/enabled", "false".to_owned()),
        ("transport/link/rx/max_message_size", MESSAGE_LIMIT.to_string()),
        ("transport/link/tx/queue/size/data", BATCHES.to_string()),
        (
            "connect/retry",
            r#"{"period_init_ms": 200, "period_max_ms": 2000, "period_increase_factor": 2}"#
                .to_owned(),
        ),
    ];
    if options.connect_only {
        settings.push(("scouting/gossip/autoconnect", "[]".to_owned()));
    }
    let behind = door.map(Door::tls);
    if let Some(tls) = behind.as_ref().or(options.tls.as_ref()) {
        let path = |path: &std::path::Path| text(&path.to_string_lossy());
        settings.extend([
            ("transport/link/tls/root_ca_certificate", path(&tls.ca)),
            ("transport/link/tls/listen_certificate", path(&tls.cert)),
            ("transport/link/tls/listen_private_key", path(&tls.key)),
            ("transport/link/tls/connect_certificate", path(&tls.cert)),
            ("transport/link/tls/connect_private_key", path(&tls.key)),
            ("transport/link/tls/enable_mtls", "true".to_owned()),
            // As for links over TCP: what counts is the signature.
            ("transport/link/tls/verify_name_on_connect", "false".to_owned()),
            ("transport/link/tls/close_link_on_expiration", "true".to_owned()),
        ]);
    }
    let access = credentials.map(|it| access::control(it.roster()).to_string());
    settings.extend(access.map(|access| ("access_control", access)));
    let mut config = zenoh::Config::default();
    for (key, value) in settings {
        config.insert_json5(key, &value).map_err(|error| {
            Failure::new(format!("Zenoh does not take {key} = {value}: {error}"))
        })?;
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_packet_only_long_ones_in_one_piece_stay_where_they_are() {
        let place = |payload: &ZBytes| payload.slices().next().map(<[u8]>::as_ptr);
        for (len, stays) in [(0, false), (HELD, false), (HELD + 1, true)] {
            let payload = ZBytes::from(vec![7; len]);
            let bytes = bytes_of(&payload);
            assert_eq!(*bytes, vec![7; len]);
            assert_eq!(Some(bytes.as_ptr()) == place(&payload), stays, "of {len}");
            drop(payload);
            assert_eq!(*bytes, vec![7; len]);
        }
        let mut pieces = ZBytes::writer();
        pieces.append(vec![1; HELD + 1].into());
        pieces.append(vec![2; HELD + 1].into());
        assert_eq!(*bytes_of(&pieces.finish()), [[1; HELD + 1], [2; HELD + 1]].concat());
    }
}
