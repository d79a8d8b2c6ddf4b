//! The numbers of a trace, as people read them.

use super::statistics::{Connection, Reaction, Statistics};
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

/// The first column begins at the left, and all others end at the right.
fn print(titles: &[&str], rows: Vec<Vec<String>>) {
    let titles: Vec<_> = titles.iter().map(|&title| title.to_owned()).collect();
    let lines: Vec<_> = std::iter::once(titles).chain(rows).collect();
    let columns = lines[0].len();
    let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max();
    let widths: Vec<_> = (0..columns).map(|column| width(column).unwrap_or_default()).collect();
    for line in &lines {
        let mut cells = line.iter().zip(&widths);
        let first = cells.next().map(|(cell, width)| format!("{cell:width$}"));
        let others = cells.map(|(cell, width)| format!("  {cell:>width$}"));
        print_line(first.into_iter().chain(others).collect::<String>().trim_end());
    }
}

/// A length of time with three digits and a unit; `-` if there is none.
fn time(nanoseconds: Option<i64>) -> String {
    let Some(nanoseconds) = nanoseconds else { return "-".to_owned() };
    #[expect(clippy::cast_precision_loss, reason = "it is for people")]
    let value = nanoseconds as f64;
    match nanoseconds.unsigned_abs() {
        0..1_000 => format!("{nanoseconds} ns"),
        1_000..1_000_000 => format!("{} us", digits(value / 1e3)),
        1_000_000..1_000_000_000 => format!("{} ms", digits(value / 1e6)),
        _ => format!("{} s", digits(value / 1e9)),
    }
}

fn digits(value: f64) -> String {
    match value.abs() {
        0.0..10.0 => format!("{value:.2}"),
        10.0..100.0 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

#[cfg(test)]
mod tests {
    use super::time;

    #[test]
    fn times_have_three_digits() {
        let shown = [0, 999, 1_000, 12_345, 999_499, 5_000_000, -2_500, 61_000_000_000];
        let expected =
            ["0 ns", "999 ns", "1.00 us", "12.3 us", "999 us", "5.00 ms", "-2.50 us", "61.0 s"];
        assert_eq!(shown.map(|it| time(Some(it))), expected);
    }
}
