//! `hprm echo`: the values that pass a connection.

use std::collections::BTreeSet;
use std::io;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread;

use hprm::console;
use hprm::watch::{Opened, Sight, WatchError, Watched, Wish};
use hprm_core::Program;

use super::{News, json, open, tell_of_signals, value};
use crate::args::Echo;
use crate::message::{self, Error};

/// How many lines wait until they are printed. If there are more, values are dropped where they are sent.
const LINES: usize = 8;

/// How a message is shown.
#[derive(Clone, Debug)]
struct Form {
    program: Arc<Program>,
    /// Whether lines need the name of the port.
    is_several: bool,
    limits: value::Limits,
    json: bool,
}

/// Prints the values that pass a connection.
///
/// # Errors
///
/// If there is none.
pub(crate) fn echo(arguments: &Echo) -> Result<ExitCode, Error> {
    message::or_json(arguments.json, show(arguments))
}

fn show(arguments: &Echo) -> Result<ExitCode, Error> {
    if let Some(listen) = &arguments.foxglove {
        return Err(super::viewer::become_viewer(arguments, listen));
    }
    let opened = open(&arguments.of, &arguments.ports, Wish::Values)?;
    let Opened { program, is_several, watched } = opened;
    let limits = if arguments.full { value::Limits::NONE } else { value::Limits::SHORT };
    let form = Form { program, is_several, limits, json: arguments.json };
    let (news, arrivals) = sync_channel(LINES);
    tell_of_signals(news.clone())?;
    let mut alive = watched.len();
    for watched in watched {
        let (news, form) = (news.clone(), form.clone());
        thread::Builder::new()
            .name(watched.federate.clone())
            .spawn(move || follow(watched, &form, &news))
            .map_err(|error| Error::new(format!("cannot start a thread: {error}")))?;
    }
    let (mut left, mut ended) = (arguments.limit(), BTreeSet::new());
    while alive > 0 && left > 0 {
        match arrivals.recv().expect("this thread has a sender, too") {
            News::Of(line) => {
                match console::print(line.as_bytes()) {
                    Ok(()) => {}
                    Err(error) if error.kind() == io::ErrorKind::BrokenPipe => break,
                    Err(error) => return Err(message::unwritable(&error)),
                }
                left -= 1;
            }
            News::Ended(name, WatchError::Ended) => {
                // One that is watched at several ports may end more than once.
                if ended.insert(name.clone()) {
                    console::print_error(format!("{name} has ended\n").as_bytes());
                }
                alive -= 1;
            }
            News::Ended(name, error) => {
                return Err(Error::new(format!("{name} cannot be watched any more: {error}")));
            }
            News::Stop => break,
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Makes lines of what a federate sends, until it ends or nothing reads them any more.
fn follow(mut watched: Watched, form: &Form, news: &SyncSender<News<String>>) {
    let mut missed = 0;
    loop {
        // A sight is dropped before the next one is asked for: the federate holds its objects as long.
        let told = match watched.watching.next_sight() {
            Ok(sight) => {
                let since = sight.dropped - missed;
                missed = sight.dropped;
                News::Of(form.line(&watched, &sight, since))
            }
            Err(error) => {
                drop(news.send(News::Ended(watched.federate, error)));
                return;
            }
        };
        // The next call tells of an error, too.
        let _ = watched.watching.release();
        if news.send(told).is_err() {
            return;
        }
    }
}

impl Form {
    /// A line for a message, before which so many were missed.
    fn line(&self, watched: &Watched, sight: &Sight, missed: u64) -> String {
        let (port, tag) = watched.place(&self.program, sight);
        if self.json {
            return format!("{}\n", json::message(&port, tag, sight, missed));
        }
        let tag =
            tag.map_or_else(|| format!("physical, sent at {}", sight.tag), |it| it.to_string());
        let value = value::text(&sight.value, self.limits);
        let port = if self.is_several { format!("{port}  ") } else { String::new() };
        let missed = match missed {
            0 => String::new(),
            1 => "... one message missed\n".to_owned(),
            count => format!("... {count} messages missed\n"),
        };
        format!("{missed}{tag}  {port}{value}\n")
    }
}
