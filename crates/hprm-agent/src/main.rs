//! The command `hprm-agent`: one process on each machine that leads links between federations' processes of different
//! machines, through Zenoh.
//!
//! This file has the command line. `agent.rs` is the loop, `carrier.rs`, `hearing.rs` and `about.rs` all that knows Zenoh, `local.rs` what processes
//! of this machine want, `link.rs` one link, `starters.rs` what starts programs for other machines, `limits.rs` and `groups.rs` what these may use, `credentials.rs` how machines
//! come to belong together, `membership.rs` how they learn that this has changed, `renewal.rs` how they get certificates that end later, `access.rs` what each
//! of them may say, `door.rs` how long a session connects,
//! `lingering.rs` how connections are closed at once, `waiting.rs` what the loop waits for, `threads.rs` on which thread,
//! `replies.rs` where queries of others are answered, `telling.rs` what the user is told.

#![forbid(unsafe_code)]

mod about;
mod access;
mod agent;
mod carrier;
mod credentials;
mod door;
mod groups;
mod hearing;
mod limits;
mod lingering;
mod link;
mod local;
mod membership;
mod near;
mod options;
mod others;
mod renewal;
mod replies;
mod router;
mod starters;
mod telling;
mod threads;
mod waiting;

use std::process::ExitCode;

use clap::Parser;

use options::Arguments;
use telling::Telling;

/// What the user is told, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
struct Failure {
    message: String,
    hint: Option<String>,
}

impl Failure {
    fn new(message: impl Into<String>) -> Self {
        Self { message: message.into(), hint: None }
    }

    fn hint(self, hint: impl Into<String>) -> Self {
        Self { hint: Some(hint.into()), ..self }
    }

    /// Tells the user.
    fn tell(&self) {
        let hint = self.hint.iter().map(|hint| format!("\n  hint: {hint}"));
        telling::tell(&format!("error: {self}{}", hint.collect::<String>()));
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let mut telling = None;
    let done = match &arguments.word {
        Some(word) => credentials::run(word),
        None => arguments.check().and_then(|options| {
            threads::share()?;
            telling = Some(Telling::begin()?);
            agent::run(options)
        }),
    };
    let code = match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.tell();
            ExitCode::FAILURE
        }
    };
    drop(telling);
    code
}
