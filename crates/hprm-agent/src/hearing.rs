//! The other agents whose packets come here directly: for each, a subscription to its key.
//!
//! The keys have no wildcard. Zenoh then agrees with the other end upon a number for each of them, and remembers what access
//! control says of it: a packet brings the number, where it would bring a text that is looked up in a tree and compared with
//! all rules, at both ends. Access control has only the one agent know of a subscription that is meant by it (`access.rs`), so
//! many machines do not tell one another of all their pairs.

use std::collections::BTreeMap;
use std::sync::Arc;

use zenoh::Wait;
use zenoh::pubsub::Subscriber;

use crate::carrier::{AgentId, Inbox, ROOT};

/// See the module.
pub(crate) struct Hearing {
    me: AgentId,
    session: zenoh::Session,
    inbox: Arc<Inbox>,
    heard: BTreeMap<AgentId, Subscriber<()>>,
}

impl Hearing {
    /// Hears none yet.
    pub(crate) fn new(me: &AgentId, session: &zenoh::Session, inbox: &Arc<Inbox>) -> Self {
        let (session, inbox) = (session.clone(), Arc::clone(inbox));
        Self { me: me.clone(), session, inbox, heard: BTreeMap::new() }
    }

    /// Hears an agent from now on.
    pub(crate) fn hear(&mut self, agent: &AgentId) -> Result<(), zenoh::Error> {
        if self.heard.contains_key(agent) {
            return Ok(());
        }
        let key = format!("{ROOT}/links/{}/{agent}", self.me);
        let (from, inbox) = (agent.clone(), Arc::clone(&self.inbox));
        let declared = self.session.declare_subscriber(key).callback(move |sample| {
            inbox.put_packet(|| Some((from.clone(), None)), sample.payload());
        });
        self.heard.insert(agent.clone(), declared.wait()?);
        Ok(())
    }

    /// Hears only those agents further on.
    pub(crate) fn keep(&mut self, is_meant: impl Fn(&AgentId) -> bool) {
        self.heard.retain(|agent, _| is_meant(agent));
    }
}
