//! Tables of numbers, as people read them.

/// The lines of a table. The first column begins at the left, and all others end at the right.
pub(crate) fn text(titles: &[&str], rows: Vec<Vec<String>>) -> String {
    let titles: Vec<_> = titles.iter().map(|&title| title.to_owned()).collect();
    let lines: Vec<_> = std::iter::once(titles).chain(rows).collect();
    let columns = lines[0].len();
    let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max();
    let widths: Vec<_> = (0..columns).map(|column| width(column).unwrap_or_default()).collect();
    let lines = lines.iter().map(|line| {
        let mut cells = line.iter().zip(&widths);
        let first = cells.next().map(|(cell, width)| format!("{cell:width$}"));
        let others = cells.map(|(cell, width)| format!("  {cell:>width$}"));
        first.into_iter().chain(others).collect::<String>().trim_end().to_owned()
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// A length of time with three digits and a unit; `-` if there is none.
pub(crate) fn time(nanoseconds: Option<i64>) -> String {
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
