//! What agents tell one another of their machines, for `hprm machines`: a query to each agent, on
//!
//! ```text
//! hprm/agents/2/about/AGENT
//! ```
//!
//! Nothing here has a part in what federations do. It runs on threads of its own, so that links do not wait for it.

use std::collections::BTreeSet;
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use hprm::Clock;
use hprm::agent::{About, Answer, ClockReading, Limited, Machine};
use hprm::board::federations;
use serde::{Deserialize, Serialize};
use zenoh::Wait;
use zenoh::query::Queryable;

use crate::carrier::{AgentId, ROOT, asking};
use crate::credentials::lifetime_of;
use crate::local::answer;
use crate::options::Options;
use crate::others::Reached;
use crate::replies::Replies;
use crate::router;

/// How long an agent may take to answer.
const ANSWER: Duration = Duration::from_secs(1);

/// How often each agent is asked: of its clock, the quickest answer says most.
const ROUNDS: usize = 4;

/// How many processes may ask at the same time.
const ASKING: usize = 8;

/// How long a process may take to read what it has asked for.
const READING: Duration = Duration::from_secs(5);

/// How long it is true which federations run, so that those who ask often cost little.
const FRESH: Duration = Duration::from_millis(500);

/// The most bytes of an answer, and the most federations in it.
const REPLY_LIMIT: usize = 64 << 10;
const FEDERATIONS: usize = 256;

/// An answer: what is asked for, and what the clock shows at that moment, in nanoseconds.
#[derive(Serialize, Deserialize)]
struct Reply {
    about: About,
    clock: i64,
}

/// What is known of this machine.
pub(crate) struct Here {
    name: String,
    fixed: About,
    running: Mutex<Option<(Instant, Vec<String>)>>,
}

impl Here {
    /// What does not change, and no federations yet.
    pub(crate) fn new(options: &Options, limited: Option<Limited>) -> Self {
        let system = rustix::system::sysinfo();
        let ends = options.tls.as_ref().and_then(|tls| lifetime_of(&options.name, tls));
        let fixed = About {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            addresses: options.listen.clone(),
            processors: thread::available_parallelism().map_or(1, |count| count.get() as u64),
            memory: (system.totalram as u64).saturating_mul(u64::from(system.mem_unit)),
            federations: Vec::new(),
            certificate_ends: ends.map(|it| it.ends),
            limits: limited,
        };
        Self { name: options.name.clone(), fixed, running: Mutex::new(None) }
    }

    /// For what the limits of programs count.
    pub(crate) fn limited(&self) -> Option<Limited> {
        self.fixed.limits
    }

    fn about(&self) -> About {
        About { federations: self.federations(), ..self.fixed.clone() }
    }

    fn federations(&self) -> Vec<String> {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((since, names)) = &*running
            && since.elapsed() < FRESH
        {
            return names.clone();
        }
        // Without sight of other processes, none can be named.
        let found = federations().unwrap_or_default();
        let names = found.iter().take(FEDERATIONS).map(|it| it.name().to_owned());
        let names: Vec<_> = names.collect();
        *running = Some((Instant::now(), names.clone()));
        names
    }
}

/// Answers other agents.
pub(crate) fn declare(
    session: &zenoh::Session,
    me: &AgentId,
    here: &Arc<Here>,
    replies: &Replies,
) -> Result<[Queryable<()>; 2], zenoh::Error> {
    let declare = |key: String| {
        let (here, replies) = (Arc::clone(here), replies.clone());
        let declared = session.declare_queryable(key).callback(move |query| {
            let here = Arc::clone(&here);
            replies.give(query, move |query| {
                let reply = Reply { about: here.about(), clock: Clock::of_new_processes().0 };
                let reply = serde_json::to_vec(&reply).expect("it has texts and numbers only");
                // If it does not arrive, the other agent does not wait for ever.
                let _ = query.reply(query.key_expr().clone(), reply).wait();
            });
        });
        declared.wait()
    };
    Ok([declare(format!("{ROOT}/about/{me}"))?, declare(format!("{ROOT}/by/*/about/{me}"))?])
}

/// Asks other agents, and tells a process of this machine what they answer.
pub(crate) fn tell(
    session: zenoh::Session,
    here: Arc<Here>,
    others: Vec<Reached>,
    stream: UnixStream,
) {
    // Three are the agent's own, one is for this process, and the rest for others that ask.
    if Arc::strong_count(&here) > ASKING + 3 {
        let text = format!("{ASKING} others ask the agent for machines already");
        return answer(&stream, &Answer::Refused(text));
    }
    let process = stream.try_clone();
    let thread = thread::Builder::new().name("machines".to_owned()).spawn(move || {
        let mut machines = gather(&session, &others);
        let (name, about) = (here.name.clone(), Some(here.about()));
        machines.insert(0, Machine { name, is_here: true, about, clock: None, through: None });
        answer(&stream, &Answer::Done(here.name.clone()));
        let text = serde_json::to_vec(&machines).expect("it has texts and numbers only");
        // The process may have ended, or not read.
        let _ = stream.set_nonblocking(false);
        let _ = stream.set_write_timeout(Some(READING));
        let _ = (&stream).write_all(&text);
    });
    if let (Err(error), Ok(process)) = (thread, process) {
        answer(&process, &Answer::Refused(format!("the agent cannot ask others: {error}")));
    }
}

/// What other agents say, in their order.
fn gather(session: &zenoh::Session, others: &[Reached]) -> Vec<Machine> {
    let unknown = |other: &Reached| {
        let (name, through) = (other.agent.machine.clone(), other.router.clone());
        Machine { name, is_here: false, about: None, clock: None, through }
    };
    let mut machines: Vec<_> = others.iter().map(unknown).collect();
    for round in 0..ROUNDS {
        let (answers_in, answers) = channel();
        let mut waiting = BTreeSet::new();
        for (number, Reached { agent, router }) in others.iter().enumerate() {
            if round > 0 && machines[number].about.is_none() {
                // It has not answered, and does not hold up the others again.
                continue;
            }
            let answers = answers_in.clone();
            // What programs have that start now: the time of either machine may have been set since its agent has started.
            let (sent, began) = (Clock::of_new_processes().0, Clock::local());
            let key = router::key(router.as_deref(), &format!("about/{agent}"));
            let asked = asking(session, key)
                .timeout(ANSWER)
                .callback(move |reply| {
                    let answered = sent.saturating_add(Clock::local().since(began));
                    let Ok(sample) = reply.result() else { return };
                    let text = sample.payload().to_bytes();
                    if text.len() <= REPLY_LIMIT
                        && let Ok(Reply { about, clock }) = serde_json::from_slice(&text)
                    {
                        let reading = ClockReading::of(sent, clock, answered);
                        // The one who asks does not end before this.
                        let _ = answers.send((number, about, reading));
                    }
                })
                .wait();
            // If it fails, there is no answer.
            waiting.extend(asked.is_ok().then_some(number));
        }
        drop(answers_in);
        // It ends when all have answered, or nothing waits for an answer any more.
        while !waiting.is_empty()
            && let Ok((number, about, reading)) = answers.recv()
        {
            waiting.remove(&number);
            let machine = &mut machines[number];
            machine.about = Some(about);
            let best = machine.clock.filter(|best| best.bound <= reading.bound);
            machine.clock = Some(best.unwrap_or(reading));
        }
    }
    machines
}
