//! Numbers as people read them.

use hprm_core::{Nanos, PhysicalTime, Tag, show_time};

/// A tag, exactly.
pub(crate) fn tag(tag: Tag) -> String {
    match tag {
        Tag::NEVER => "never".to_owned(),
        Tag::FOREVER => "forever".to_owned(),
        Tag { time, microstep } => format!("({}, {microstep})", show_time(time)),
    }
}

/// A length of time with two or three digits and a unit.
pub(crate) fn time(nanoseconds: Nanos) -> String {
    #[expect(clippy::cast_precision_loss, reason = "it is for people")]
    let value = nanoseconds as f64;
    match nanoseconds.unsigned_abs() {
        0 => "0".to_owned(),
        1..1_000 => format!("{nanoseconds} ns"),
        1_000..1_000_000 => format!("{:.0} us", value / 1e3),
        1_000_000..1_000_000_000 => format!("{:.0} ms", value / 1e6),
        1_000_000_000..120_000_000_000 => format!("{:.1} s", value / 1e9),
        120_000_000_000..7_200_000_000_000 => format!("{:.0} min", value / 60e9),
        _ => format!("{:.1} h", value / 3600e9),
    }
}

/// The time of day in UTC, to the second.
pub(crate) fn clock(at: PhysicalTime) -> String {
    let seconds = at.0.div_euclid(1_000_000_000).rem_euclid(86_400);
    format!("{:02}:{:02}:{:02} UTC", seconds / 3600, seconds / 60 % 60, seconds % 60)
}

/// A number of bytes with three digits and a unit.
pub(crate) fn bytes(bytes: u64) -> String {
    scaled(bytes, &["B", "KB", "MB", "GB", "TB"], 1000.0)
}

/// Whether messages have a size: between threads of one process, values go as they are.
pub(crate) fn are_sized(messages: u64, bytes: u64) -> bool {
    messages == 0 || bytes > 0
}

/// A number in a second, with three digits.
pub(crate) fn rate(rate: f64) -> String {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it is for people")]
    match rate {
        ..0.05 => "0".to_owned(),
        ..10.0 => format!("{rate:.1}"),
        ..10_000.0 => format!("{rate:.0}"),
        _ => scaled(rate as u64, &["", "k", "M", "G"], 1000.0).replace(' ', ""),
    }
}

fn scaled(number: u64, units: &[&str], step: f64) -> String {
    #[expect(clippy::cast_precision_loss, reason = "it is for people")]
    let mut value = number as f64;
    let mut units = units.iter();
    let mut unit = units.next().copied().unwrap_or_default();
    while value >= step
        && let Some(next) = units.next()
    {
        value /= step;
        unit = next;
    }
    match value {
        _ if number < 1000 => format!("{number} {unit}"),
        0.0..10.0 => format!("{value:.2} {unit}"),
        10.0..100.0 => format!("{value:.1} {unit}"),
        _ => format!("{value:.0} {unit}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_of_time_are_short() {
        let shown = [0, 999, 12_345, 5_000_000, 3_210_000_000, 600_000_000_000, 7_200_000_000_000];
        let expected = ["0", "999 ns", "12 us", "5 ms", "3.2 s", "10 min", "2.0 h"];
        assert_eq!(shown.map(time), expected);
    }

    #[test]
    fn tags_are_exact_and_times_of_day_are_utc() {
        assert_eq!(tag(Tag::new(1_234_567_000, 2)), "(1234567 us, 2)");
        assert_eq!([tag(Tag::NEVER), tag(Tag::FOREVER)], ["never", "forever"]);
        assert_eq!(clock(PhysicalTime(86_400_000_000_000 + 3_723_900_000_000)), "01:02:03 UTC");
    }

    #[test]
    fn numbers_have_three_digits() {
        assert_eq!([0, 999, 1_500, 50_000_000].map(bytes), ["0 B", "999 B", "1.50 KB", "50.0 MB"]);
        assert_eq!([0.0, 9.96, 1234.5, 434_000.0].map(rate), ["0", "10.0", "1234", "434k"]);
    }
}
