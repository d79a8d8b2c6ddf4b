//! The numbers of a trace, as people read them.

use super::statistics::{Connection, Reaction, Statistics};
use crate::columns::{self, time};
use crate::message::{Error, print_line};

/// Prints a table of reactions, and one of connections if there are some.
pub(crate) fn show(all: &Statistics) {
    let titles =
        ["reaction", "count", "total", "p50", "p99", "max", "lag p50", "lag max", "missed"];
    print(&titles, all.reactions.iter().map(reaction).collect());
    if !all.connections.is_empty() {
        print_line("");
        let titles = ["connection", "messages", "bytes", "copies", "latency p50", "latency p99"];
        print(&titles, all.connections.iter().map(connection).collect());
    }
    let unfinished: u64 = all.reactions.values().map(|it| it.unfinished).sum();
    if unfinished > 0 {
        print_line(&format!("\n{unfinished} runs of reactions have no end in the trace"));
    }
    if all.lost > 0 {
        let what = format!("{} records are missing: numbers are of the others", all.lost);
        Error::new(what).hint("record with a larger --trace-buffer").show_as_warning();
    }
}

fn reaction((name, it): (&String, &Reaction)) -> Vec<String> {
    let Reaction { took, lag, .. } = it;
    vec![
        name.clone(),
        took.count().to_string(),
        time(Some(took.total())),
        time(took.percentile(50)),
        time(took.percentile(99)),
        time(took.max()),
        time(lag.percentile(50)),
        time(lag.max()),
        it.deadlines_missed.to_string(),
    ]
}

fn connection((name, it): (&String, &Connection)) -> Vec<String> {
    vec![
        name.clone(),
        it.messages.to_string(),
        it.bytes.to_string(),
        it.copies.to_string(),
        time(it.latency.percentile(50)),
        time(it.latency.percentile(99)),
    ]
}

fn print(titles: &[&str], rows: Vec<Vec<String>>) {
    print_line(&columns::text(titles, rows));
}
