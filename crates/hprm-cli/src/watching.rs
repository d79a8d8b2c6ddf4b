//! `hprm echo` and `hprm rate`: watching connections of a running federation, from outside.
//!
//! `federation.rs` finds the federation and connects to its federates, `target.rs` says which channels a port has.
//! `echo.rs` and `rate.rs` are the commands, `value.rs` shows values as text and `json.rs` as JSON.

mod echo;
mod federation;
mod json;
mod rate;
mod summary;
mod target;
mod value;

pub(crate) use echo::echo;
pub(crate) use rate::rate;

use std::sync::mpsc::SyncSender;

use hprm_core::{ChannelId, Program};

use crate::message::Error;
use crate::signals;

/// What the thread of a federate tells the command, or a signal does.
#[derive(Debug)]
enum News<T> {
    /// Something to print.
    Of(T),
    /// A federate has ended, or why it cannot be watched any more; and its name.
    Ended(String, hprm::watch::WatchError),
    /// The user wants no more.
    Stop,
}

/// Tells of the first signal that asks this process to stop.
fn tell_of_signals<T: Send + 'static>(news: SyncSender<News<T>>) -> Result<(), Error> {
    signals::watch(move |_| news.send(News::Stop).is_ok())
        .map_err(|error| Error::new(format!("cannot watch for Ctrl-C: {error}")))
}

/// The name of a port, without that of the main reactor.
fn short(name: &str) -> &str {
    name.split_once('.').map_or(name, |(_, rest)| rest)
}

/// Both ends of a channel: `camera.image -> planner.image`.
fn ends(program: &Program, channel: ChannelId) -> [String; 2] {
    let connection = &program.connections[program.channels[channel].connection];
    [connection.from, connection.to].map(|port| short(&program.port_name(port)).to_owned())
}
