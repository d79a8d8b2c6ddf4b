//! How an agent learns of changes to the roster: from a file that changes in its folder, and from other agents.
//!
//! ```text
//! hprm/agents/2/roster?NUMBER   a query for a roster with a higher number than that of the agent that asks
//! ```
//!
//! Each agent asks all that it reaches, now and then, and at once when another one asks that has a newer roster. So a
//! change gets around like a rumour, and whoever carries it cannot change it: it is signed. Agents whose certificates
//! are not on the roster ask and answer as well; otherwise nobody would tell an agent that it knows too little.

use std::io;
use std::os::fd::OwnedFd;
use std::time::Duration;

use hprm_core::{Nanos, PhysicalTime};
use rustix::fs::inotify::{CreateFlags, WatchFlags, add_watch, init};
use zenoh::Wait;
use zenoh::bytes::ZBytes;
use zenoh::query::{QueryTarget, Queryable};

use crate::Failure;
use crate::access::ROSTER;
use crate::carrier::asking;
use crate::credentials::{Certificate, Credentials};
use crate::renewal::Rounds;
use crate::replies::Replies;
use crate::telling::tell;
use crate::waiting::{Watch, Watched};

/// How often other agents are asked, and how often at most.
const ASKING: Nanos = 10_000_000_000;
const AT_MOST: Nanos = 500_000_000;

/// How long they may take.
const ANSWER: Duration = Duration::from_secs(5);

/// What others say of rosters and certificates.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) enum News {
    /// One of them has a newer roster.
    IsOld,
    /// A newer roster.
    Roster(Vec<u8>),
    /// Certificates of machines that end later than those that are known.
    Certificates(Vec<Certificate>),
}

/// See the module.
pub(crate) struct Membership {
    pub(crate) credentials: Credentials,
    changes: Watched<OwnedFd>,
    asked: PhysicalTime,
    ask_at: PhysicalTime,
    /// When others are asked for certificates.
    pub(crate) rounds: Rounds,
}

impl Membership {
    /// Watches the folder of the credentials.
    pub(crate) fn new(
        credentials: Credentials,
        now: PhysicalTime,
        watch: &Watch,
    ) -> Result<Self, Failure> {
        let folder = credentials.folder();
        let watched = init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC).and_then(|changes| {
            add_watch(&changes, folder, WatchFlags::MOVED_TO | WatchFlags::CLOSE_WRITE)?;
            Ok(changes)
        });
        let watched = watched.map_err(io::Error::from).and_then(|it| watch.until_readable(it));
        let changes = watched.map_err(|error| {
            Failure::new(format!("the agent cannot watch {}: {error}", folder.display()))
        })?;
        // Only now, because it may change meanwhile.
        look_at_bundle(&credentials);
        let rounds = Rounds::new(now);
        Ok(Self { credentials, changes, asked: now, ask_at: now.plus(AT_MOST), rounds })
    }

    /// When others are to be asked.
    pub(crate) fn next_wakeup(&self) -> PhysicalTime {
        self.ask_at.min(self.rounds.next_wakeup())
    }

    /// Whether others are to be asked now. It is taken as done.
    pub(crate) fn is_to_ask(&mut self, now: PhysicalTime) -> bool {
        let is_due = now >= self.ask_at;
        if is_due {
            self.asked = now;
            self.ask_at = now.plus(ASKING);
        }
        is_due
    }

    /// Takes what others say. Who says it may be anybody with a certificate.
    pub(crate) fn hear(&mut self, news: &News) -> Result<(), Failure> {
        match news {
            News::IsOld => self.ask_at = self.ask_at.min(self.asked.plus(AT_MOST)),
            News::Roster(text) => self.credentials.learn(text)?,
            News::Certificates(news) => self.credentials.keep_certificates(news.clone())?,
        }
        Ok(())
    }

    /// The credentials before, if the roster or the certificate of this machine has changed since the last look.
    ///
    /// # Errors
    ///
    /// If this machine does not belong to the others any more.
    pub(crate) fn look(&mut self) -> Result<Option<Credentials>, Failure> {
        let mut has_changed = false;
        // It ends when nothing more has changed.
        while rustix::io::read(self.changes.get(), &mut [0; 4096]).is_ok_and(|count| count > 0) {
            has_changed = true;
        }
        if has_changed {
            look_at_bundle(&self.credentials);
        }
        if !has_changed || !self.credentials.is_stale() {
            return Ok(None);
        }
        match self.credentials.read_again() {
            Ok(Some(credentials)) => {
                credentials.check_membership()?;
                if let Some(date) = credentials.renewed_since(&self.credentials) {
                    let name = credentials.name();
                    tell(&format!("the certificate of {name} is renewed until {date}"));
                }
                Ok(Some(std::mem::replace(&mut self.credentials, credentials)))
            }
            Ok(None) => Err(Failure::new("the credentials of this machine have been removed")),
            Err(failure) => {
                // Whatever was put there, the old roster holds.
                failure.tell();
                Ok(None)
            }
        }
    }
}

/// Takes the certificates in the folder, of which one may be for this machine.
fn look_at_bundle(credentials: &Credentials) {
    let looked = credentials.look_at_bundle();
    // Whatever was put there, what was known holds.
    for failure in
        [looked, credentials.keep_certificates(Vec::new())].into_iter().filter_map(Result::err)
    {
        failure.tell();
    }
}

/// Answers agents that ask for a newer roster.
pub(crate) fn declare(
    session: &zenoh::Session,
    credentials: &Credentials,
    replies: &Replies,
    tell: impl Fn(News) + Send + Sync + 'static,
) -> Result<Queryable<()>, zenoh::Error> {
    let number = credentials.roster().number;
    // Shared by all answers that wait.
    let text = ZBytes::from(credentials.signed_roster().to_vec());
    let replies = replies.clone();
    session
        .declare_queryable(ROSTER)
        .callback(move |query| {
            let theirs = query.parameters().as_str().parse::<u64>().unwrap_or(number);
            if theirs > number {
                tell(News::IsOld);
            }
            let text = (theirs < number).then(|| text.clone());
            replies.give(query, move |query| {
                // If it does not arrive, the other agent asks again.
                drop(text.map(|text| query.reply(ROSTER, text).wait()));
            });
        })
        .wait()
}

/// Asks all other agents for a newer roster.
pub(crate) fn ask(
    session: &zenoh::Session,
    credentials: &Credentials,
    tell: impl Fn(News) + Send + Sync + 'static,
) {
    let known = credentials.clone();
    let asked = asking(session, format!("{ROSTER}?{}", credentials.roster().number))
        .target(QueryTarget::All)
        .timeout(ANSWER)
        .callback(move |reply| {
            let Ok(sample) = reply.result() else { return };
            let text = sample.payload().to_bytes();
            // What anybody may send, many times, must not wait for the loop.
            if known.is_newer(&text) {
                tell(News::Roster(text.into_owned()));
            }
        })
        .wait();
    // If it fails, it is done again.
    drop(asked);
}
