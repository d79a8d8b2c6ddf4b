//! `hprm echo` and `hprm rate`: watching connections of a running federation, from outside.
//!
//! `hprm::watch` finds the federation and connects to its federates. `echo.rs` and `rate.rs` are the commands, `value.rs`
//! shows values as text and `json.rs` as JSON, and `viewer.rs` leaves that to a viewer, or to Zenoh: `hprm mirror`.

mod echo;
mod json;
mod rate;
mod summary;
mod value;
mod viewer;

pub(crate) use echo::echo;
pub(crate) use rate::rate;
pub(crate) use viewer::become_mirror;

use std::sync::mpsc::SyncSender;
use std::thread;

use hprm::watch::{Opened, Search, WatchError, Wish, Words};

use crate::args::Of;
use crate::message::Error;
use crate::signals;

/// What the thread of a federate tells the command, or a signal does.
#[derive(Debug)]
enum News<T> {
    /// Something to print.
    Of(T),
    /// A federate has ended, or why it cannot be watched any more; and its name.
    Ended(String, WatchError),
    /// The user wants no more.
    Stop,
}

/// Tells of the first signal that asks this process to stop.
fn tell_of_signals<T: Send + 'static>(news: SyncSender<News<T>>) -> Result<(), Error> {
    signals::watch(move |_| news.send(News::Stop).is_ok())
        .map_err(|error| Error::new(format!("cannot watch for Ctrl-C: {error}")))
}

/// Watches ports, or all connections, of the federation that is meant.
///
/// # Errors
///
/// If there is no such port or federation, or none of the federates that send there can be watched in time.
fn open(of: &Of, ports: &[String], wish: Wish) -> Result<Opened, Error> {
    let (federation, ports) = (of.federation.clone(), ports.to_vec());
    let search = Search { federation, ports, wish, words: Words::Options };
    search.open(of.wait.unwrap_or_default(), |pause| {
        thread::sleep(pause);
        Ok(())
    })
}
