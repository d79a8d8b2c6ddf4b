//! `hprm rate`: how many messages and bytes pass connections, and how regularly.

use std::collections::BTreeMap;
use std::io;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use hprm::console;
use hprm::watch::{Counts, Opened, Tally, WatchError, Watched, Wish, ends};
use hprm_core::{ChannelId, Program};
use serde_json::json;

use super::{News, open, tell_of_signals};
use crate::args::Rate;
use crate::columns::{self, time};
use crate::message::{self, Error};
use crate::top;

/// What federates have counted, and which federate.
type Reports = News<(String, Counts)>;

/// Prints rates until the federation ends.
///
/// # Errors
///
/// If there is no such connection.
pub(crate) fn rate(arguments: &Rate) -> Result<ExitCode, Error> {
    message::or_json(arguments.json, show(arguments))
}

fn show(arguments: &Rate) -> Result<ExitCode, Error> {
    let opened = open(&arguments.of, arguments.port.as_slice(), Wish::Counts)?;
    let Opened { program, watched, .. } = opened;
    let alive = watched.len();
    let (news, arrivals) = sync_channel(alive);
    tell_of_signals(news.clone())?;
    for watched in watched {
        let (news, window) = (news.clone(), arguments.window);
        thread::Builder::new()
            .name(watched.federate.clone())
            .spawn(move || follow(watched, window, &news))
            .map_err(|error| Error::new(format!("cannot start a thread: {error}")))?;
    }
    print_all(arguments, &program, &arrivals, alive)?;
    Ok(ExitCode::SUCCESS)
}

/// Tells again and again what a federate has counted, until it ends or nothing reads that any more.
fn follow(mut watched: Watched, window: Duration, news: &SyncSender<Reports>) {
    loop {
        let told = match watched.watching.counts(window) {
            Ok(counts) => News::Of((watched.federate.clone(), counts)),
            Err(error) => News::Ended(watched.federate.clone(), error),
        };
        let is_last = matches!(told, News::Ended(..));
        if news.send(told).is_err() || is_last {
            return;
        }
    }
}

/// Prints what all federates have told, again and again.
fn print_all(
    arguments: &Rate,
    program: &Arc<Program>,
    arrivals: &Receiver<Reports>,
    mut alive: usize,
) -> Result<(), Error> {
    let mut pending = BTreeMap::new();
    while alive > 0 {
        match arrivals.recv().expect("the thread that watches signals has a sender") {
            News::Of((name, counts)) => {
                pending.insert(name, counts);
            }
            News::Ended(name, WatchError::Ended) => {
                console::print_error(format!("{name} has ended\n").as_bytes());
                alive -= 1;
            }
            News::Ended(name, error) => {
                return Err(Error::new(format!("{name} cannot be watched any more: {error}")));
            }
            News::Stop => return Ok(()),
        }
        if pending.is_empty() || pending.len() < alive {
            continue;
        }
        let text = shown(program, &std::mem::take(&mut pending), arguments.json);
        match console::print(text.as_bytes()) {
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(()),
            Err(error) => return Err(message::unwritable(&error)),
        }
        if arguments.once {
            return Ok(());
        }
    }
    Ok(())
}

/// A table, or an object for each channel.
fn shown(program: &Program, reports: &BTreeMap<String, Counts>, as_json: bool) -> String {
    let mut rates: Vec<Rates<'_>> = Vec::new();
    for counts in reports.values() {
        let span = counts.span;
        let all = counts.tallies.iter();
        rates.extend(all.map(|(channel, tally)| Rates { channel: *channel, tally, span }));
    }
    rates.sort_by_key(|rates| rates.channel);
    if as_json {
        return rates.iter().map(|rates| format!("{}\n", rates.json(program))).collect();
    }
    let titles =
        ["connection", "messages/s", "bytes/s", "interval", "shortest", "longest", "deviation"];
    let rows = rates.iter().map(|rates| rates.row(program)).collect();
    columns::text(&titles, rows) + "\n"
}

/// What passed a channel in some time.
struct Rates<'a> {
    channel: ChannelId,
    tally: &'a Tally,
    /// In nanoseconds.
    span: i64,
}

impl Rates<'_> {
    #[expect(clippy::cast_precision_loss, reason = "it is for people")]
    fn per_second(&self, count: u64) -> f64 {
        if self.span > 0 { count as f64 * 1e9 / self.span as f64 } else { 0.0 }
    }

    fn row(&self, program: &Program) -> Vec<String> {
        let Tally { messages, bytes, intervals, shortest, longest, .. } = self.tally;
        let some = |nanoseconds| time((*intervals > 0).then_some(nanoseconds));
        #[expect(clippy::cast_possible_truncation, reason = "nanoseconds have no fractions")]
        let rounded = |nanoseconds: Option<f64>| time(nanoseconds.map(|it| it.round() as i64));
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "it is for people"
        )]
        let size = |bytes| top::bytes(self.per_second(bytes).round() as u64);
        let bytes = match top::are_sized(*messages, *bytes) {
            true => size(*bytes),
            false => "-".to_owned(),
        };
        vec![
            ends(program, self.channel).join(" -> "),
            format!("{:.1}", self.per_second(*messages)),
            bytes,
            rounded(self.tally.mean()),
            some(*shortest),
            some(*longest),
            rounded(self.tally.deviation()),
        ]
    }

    fn json(&self, program: &Program) -> serde_json::Value {
        let [from, to] = ends(program, self.channel);
        let Tally { messages, bytes, intervals, shortest, longest, .. } = self.tally;
        let interval = (*intervals > 0).then(|| {
            json!({
                "mean": self.tally.mean(),
                "min": shortest,
                "max": longest,
                "stddev": self.tally.deviation(),
            })
        });
        json!({
            "from": from,
            "to": to,
            "window": self.span,
            "messages": messages,
            "bytes": bytes,
            "messages_per_second": self.per_second(*messages),
            "bytes_per_second": self.per_second(*bytes),
            "interval": interval,
        })
    }
}
