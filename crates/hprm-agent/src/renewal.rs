//! How renewed certificates get around, and what an agent does so that certificates do not end unnoticed.
//!
//! ```text
//! hprm/agents/2/certificates/AGENT?DIGEST   a query for the certificates that AGENT knows, unless they have that digest
//! ```
//!
//! Each agent keeps the certificates of all machines, and now and then compares them with one other agent, which it takes at
//! random among those that it reaches. So a renewed certificate gets around in a number of rounds that grows as the logarithm of
//! the number of machines, also past machines that were off, and each agent gets all certificates once or twice, not from all
//! others. An agent that carries a certificate cannot change it: the authority has signed it.
//!
//! What is kept, and when an agent takes its own one, is in `credentials.rs`; what follows, in `agent/belonging.rs`.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use hprm::random_bytes;
use hprm_core::{Nanos, PhysicalTime};
use zenoh::Wait;
use zenoh::query::{QueryTarget, Queryable};

use crate::carrier::{AgentId, ROOT, asking};
use crate::credentials::{self, BUNDLE_LIMIT, Certificate, Credentials, Lifetime, Notice};
use crate::replies::Replies;
use crate::telling::tell;

/// How often another agent is asked, and how soon after one has come.
const ASKING: Nanos = 10_000_000_000;
const SOON: Nanos = 500_000_000;

/// How long it may take.
const ANSWER: Duration = Duration::from_secs(5);

const SECOND: Nanos = 1_000_000_000;
const DAY: Nanos = 24 * 60 * 60 * SECOND;

/// When another agent is asked.
pub(crate) struct Rounds {
    ask_at: PhysicalTime,
}

impl Rounds {
    pub(crate) fn new(now: PhysicalTime) -> Self {
        Self { ask_at: now.plus(SOON) }
    }

    pub(crate) fn next_wakeup(&self) -> PhysicalTime {
        self.ask_at
    }

    /// Another agent has come.
    pub(crate) fn hurry(&mut self, now: PhysicalTime) {
        self.ask_at = self.ask_at.min(now.plus(SOON));
    }

    /// Which of the agents that are reached is to be asked now, if one is. It is taken as done.
    pub(crate) fn partner(&mut self, now: PhysicalTime, reached: &[AgentId]) -> Option<AgentId> {
        if now < self.ask_at {
            return None;
        }
        self.ask_at = now.plus(ASKING);
        // Without random numbers, the first one does.
        let number = random_bytes().map_or(0, u64::from_le_bytes);
        let place = number.checked_rem(reached.len() as u64)?;
        reached.get(usize::try_from(place).ok()?).cloned()
    }
}

/// Answers agents that ask for certificates.
pub(crate) fn declare(
    session: &zenoh::Session,
    me: &AgentId,
    credentials: &Credentials,
    replies: &Replies,
) -> Result<Queryable<()>, zenoh::Error> {
    let (credentials, replies) = (credentials.clone(), replies.clone());
    let key = format!("{ROOT}/certificates/{me}");
    let declared = session.declare_queryable(key).callback(move |query| {
        let credentials = credentials.clone();
        replies.give(query, move |query| {
            if let Some(text) = credentials.certificates_beside(query.parameters().as_str()) {
                // If it does not arrive, the other agent asks again.
                let _ = query.reply(query.key_expr().clone(), text).wait();
            }
        });
    });
    declared.wait()
}

/// Asks another agent for certificates.
pub(crate) fn ask(
    session: &zenoh::Session,
    partner: &AgentId,
    credentials: &Credentials,
    tell: impl Fn(Vec<Certificate>) + Send + Sync + 'static,
) {
    let (known, is_answered) = (credentials.clone(), AtomicBool::new(false));
    let asked = asking(session, format!("{ROOT}/certificates/{partner}?{}", known.digest()))
        .target(QueryTarget::All)
        .timeout(ANSWER)
        .callback(move |reply| {
            let Ok(sample) = reply.result() else { return };
            // One answer is enough: to read it takes a while.
            if sample.payload().len() > BUNDLE_LIMIT || is_answered.swap(true, Ordering::Relaxed) {
                return;
            }
            // What other machines send must not wait for the loop, and what is wrong fills no log.
            let news = known.news(&sample.payload().to_bytes()).unwrap_or_default();
            if !news.is_empty() {
                tell(news);
            }
        })
        .wait();
    // If it fails, it is done again.
    drop(asked);
}

/// When a user is told of a certificate that ends, and when an authority looks for some that do: once a day.
pub(crate) struct Daily {
    look_at: PhysicalTime,
}

impl Daily {
    pub(crate) fn new(now: PhysicalTime) -> Self {
        Self { look_at: now }
    }

    pub(crate) fn next_wakeup(&self) -> PhysicalTime {
        self.look_at
    }

    /// Tells what is to be told.
    pub(crate) fn look(&mut self, now: PhysicalTime, lifetime: Option<&Lifetime>) {
        let seconds = credentials::now();
        self.look_at = now.plus(until_next(lifetime.map(|it| it.ends - seconds)));
        match lifetime.and_then(|it| it.notice(seconds)) {
            Some(Notice::Soon(text, hint)) => tell(&format!("warning: {text}\n  hint: {hint}")),
            Some(Notice::Ended(text, hint)) => tell(&format!("error: {text}\n  hint: {hint}")),
            None => {}
        }
    }
}

/// How long it is until the next look at a certificate that ends in some seconds: a day, or until it has ended.
fn until_next(left: Option<i64>) -> Nanos {
    let left = left.filter(|left| *left >= 0);
    left.map_or(DAY, |left| left.saturating_add(1).saturating_mul(SECOND).min(DAY))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn agents(count: u64) -> Vec<AgentId> {
        (0..count).map(|epoch| AgentId { machine: "robot".to_owned(), epoch }).collect()
    }

    #[test]
    fn each_round_asks_one_agent_and_all_have_their_turn() {
        let (mut now, all) = (PhysicalTime(0), agents(3));
        let mut rounds = Rounds::new(now);
        assert_eq!(rounds.partner(now, &all), None);
        let mut asked: Vec<_> = (0..100)
            .map(|_| {
                now = rounds.next_wakeup();
                let partner = rounds.partner(now, &all).unwrap();
                assert_eq!(rounds.partner(now, &all), None);
                partner
            })
            .collect();
        asked.sort();
        asked.dedup();
        assert_eq!(asked, all);
        rounds.hurry(now);
        assert_eq!(rounds.next_wakeup(), now.plus(SOON));
        assert_eq!(rounds.partner(now.plus(SOON), &[]), None);
    }

    #[test]
    fn a_certificate_is_looked_at_once_a_day_and_when_it_has_ended() {
        assert_eq!([None, Some(-1), Some(1 << 40)].map(until_next), [DAY; 3]);
        assert_eq!(until_next(Some(59)), 60 * SECOND);
        assert_eq!(until_next(Some(i64::MAX)), DAY);
    }
}
