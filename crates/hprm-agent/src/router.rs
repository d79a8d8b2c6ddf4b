//! What an agent does for others that reach it, and not one another: it says which agents it reaches, and leads packets
//! and queries to them.
//!
//! ```text
//! hprm/agents/2/routes/ROUTER/AGENT  a liveliness token: the agent of the machine ROUTER reaches AGENT
//! hprm/agents/2/to/ROUTER/KEY        what another agent would say with a KEY, if it reached the one that is meant
//! hprm/agents/2/by/ROUTER/KEY        the same, as that one hears it
//! ```
//!
//! Zenoh's own routers do not do this: those of version 1.10 lead nothing from one peer to another one, and if all agents
//! were routers, any machine would be in the middle of others, where access control takes what it leads for lies. Here both
//! ends know that a router is between them, and which one, and believe it no more than that (`access.rs`, `agent.rs`).
//!
//! A router keeps nothing of what it leads, so links outlive that it is started again. It leads only to agents that it
//! reaches itself, so there is no loop, and one router on the way at most.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use zenoh::Wait;
use zenoh::bytes::ZBytes;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{Query, Queryable};

use crate::carrier::{AgentId, LAST, OPENING, PACKET_LIMIT, PACKETS, ROOT, asking};
use crate::replies::Replies;

/// How many queries may wait for their answers; more are dropped.
const QUERIES: usize = 256;

/// See the module.
pub(crate) struct Router {
    machine: String,
    /// For each agent that is reached.
    tokens: BTreeMap<AgentId, LivelinessToken>,
    _packets: Subscriber<()>,
    _queries: [Queryable<()>; 2],
}

/// What is to be led.
enum Led {
    Packet { key: String, packet: ZBytes, priority: Priority },
    Query(Query),
}

impl Router {
    /// Leads what comes, on a thread that ends with the session.
    pub(crate) fn open(
        session: &zenoh::Session,
        machine: &str,
        replies: &Replies,
    ) -> Result<Self, zenoh::Error> {
        let (led_in, led) = sync_channel(PACKETS);
        let packets = take_packets(session, machine, led_in.clone())?;
        let queries = ["open", "about"].map(|what| {
            let led_in = led_in.clone();
            let declared = session.declare_queryable(format!("{ROOT}/to/{machine}/{what}/**"));
            // What finds no room is dropped, as everywhere.
            declared.callback(move |query| drop(led_in.try_send(Led::Query(query)))).wait()
        });
        let [open, about] = queries;
        let (session, replies) = (session.clone(), replies.clone());
        let lead = move || lead(&session, &led, &replies);
        thread::Builder::new().name("router".to_owned()).spawn(lead)?;
        Ok(Self {
            machine: machine.to_owned(),
            tokens: BTreeMap::new(),
            _packets: packets,
            _queries: [open?, about?],
        })
    }

    /// Says that an agent is reached, or not any more.
    pub(crate) fn reaches(&mut self, session: &zenoh::Session, agent: &AgentId, is_there: bool) {
        if !is_there {
            self.tokens.remove(agent);
            return;
        }
        let key = format!("{ROOT}/routes/{}/{agent}", self.machine);
        // Without a token, the others do not find it.
        if let Ok(token) = session.liveliness().declare_token(key).wait() {
            self.tokens.insert(agent.clone(), token);
        }
    }
}

/// The key of what is meant for another agent: it hears it itself, or a router leads it there.
pub(crate) fn key(router: Option<&str>, rest: &str) -> String {
    match router {
        Some(router) => format!("{ROOT}/to/{router}/{rest}"),
        None => format!("{ROOT}/{rest}"),
    }
}

/// How this agent hears what another one says with a key to a router.
pub(crate) fn key_from(router: &str, rest: &str) -> String {
    format!("{ROOT}/by/{router}/{rest}")
}

/// The router that has led what is said with a key.
pub(crate) fn of(key: &str) -> Option<String> {
    let rest = key.strip_prefix(ROOT)?.strip_prefix("/by/")?;
    rest.split('/').next().map(str::to_owned)
}

/// How the agent that is meant hears what has come to a router.
fn onward(key: &str) -> Option<String> {
    let rest = key.strip_prefix(ROOT)?.strip_prefix("/to/")?;
    Some(format!("{ROOT}/by/{rest}"))
}

fn take_packets(
    session: &zenoh::Session,
    machine: &str,
    into: SyncSender<Led>,
) -> Result<Subscriber<()>, zenoh::Error> {
    let declared = session.declare_subscriber(format!("{ROOT}/to/{machine}/links/**"));
    let declared = declared.callback(move |sample| {
        if let Some(key) = onward(sample.key_expr().as_str())
            && sample.payload().len() <= PACKET_LIMIT
        {
            // The last packets of a link have room of their own from here on, too.
            let is_last = sample.priority() == LAST;
            let priority = if is_last { LAST } else { Priority::DEFAULT };
            let packet = sample.payload().clone();
            // Without room it is dropped, and sent again.
            drop(into.try_send(Led::Packet { key, packet, priority }));
        }
    });
    declared.wait()
}

/// Leads what comes, until nothing can come any more.
fn lead(session: &zenoh::Session, led: &Receiver<Led>, replies: &Replies) {
    let waiting = Arc::new(AtomicUsize::new(0));
    for one in led {
        match one {
            Led::Packet { key, packet, priority } => {
                let put = session.put(key, packet).priority(priority);
                // A session that has ended carries nothing.
                drop(put.congestion_control(CongestionControl::Drop).wait());
            }
            Led::Query(query) => ask(session, query, &waiting, replies.clone()),
        }
    }
}

/// Asks the agent that is meant, and answers with what it answers.
fn ask(session: &zenoh::Session, query: Query, waiting: &Arc<AtomicUsize>, replies: Replies) {
    let Some(key) = onward(query.key_expr().as_str()) else { return };
    let Some(place) = Place::take(waiting) else { return };
    let text = query.payload().filter(|text| text.len() <= PACKET_LIMIT).cloned();
    let asked = asking(session, key).payload(text.unwrap_or_default()).timeout(OPENING);
    let mut asked_for = AskedFor { query: Some(query), replies, place: Some(place) };
    let asked = asked.callback_mut(move |reply| {
        if let Ok(sample) = reply.result()
            && sample.payload().len() <= PACKET_LIMIT
        {
            asked_for.answer(Some(sample.payload().clone()));
        }
    });
    // If it fails, the query is gone, which is an answer.
    drop(asked.wait());
}

/// A query that waits for the answer of another agent.
struct AskedFor {
    query: Option<Query>,
    replies: Replies,
    place: Option<Place>,
}

impl AskedFor {
    /// Answers it, or says that there is no answer.
    fn answer(&mut self, payload: Option<ZBytes>) {
        let Some(query) = self.query.take() else { return };
        self.place = None;
        self.replies.give(query, move |query| {
            let key = query.key_expr().clone();
            // If it does not arrive, the one that asks does not wait for ever.
            drop(payload.map(|payload| query.reply(key, payload).wait()));
        });
    }
}

impl Drop for AskedFor {
    fn drop(&mut self) {
        self.answer(None);
    }
}

/// One of those that may wait.
struct Place(Arc<AtomicUsize>);

impl Place {
    fn take(waiting: &Arc<AtomicUsize>) -> Option<Self> {
        let place = Self(Arc::clone(waiting));
        (waiting.fetch_add(1, Ordering::Relaxed) < QUERIES).then_some(place)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_to_a_router_is_heard_as_led_by_it() {
        let direct = key(None, "links/a/1/b/2");
        let there = key(Some("hub"), "links/a/1/b/2");
        let heard = onward(&there).unwrap();
        assert_eq!(heard, "hprm/agents/2/by/hub/links/a/1/b/2");
        assert_eq!(heard, key_from("hub", "links/a/1/b/2"));
        assert_eq!(direct, "hprm/agents/2/links/a/1/b/2");
        assert_eq!((of(&direct), of(&there), of(&heard).as_deref()), (None, None, Some("hub")));
        assert_eq!((onward(&direct), onward(&heard)), (None, None));
    }

    #[test]
    fn no_more_queries_wait_than_may() {
        let waiting = Arc::new(AtomicUsize::new(0));
        let taken: Vec<_> = (0..QUERIES).map(|_| Place::take(&waiting).unwrap()).collect();
        assert!(Place::take(&waiting).is_none() && Place::take(&waiting).is_none());
        drop(taken);
        assert!(Place::take(&waiting).is_some());
    }
}
