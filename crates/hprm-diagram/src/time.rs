//! Times as programs write them.

use hprm_core::Nanos;

/// A time in the largest unit in which it is a whole number.
pub(crate) fn time(nanos: Nanos) -> String {
    const UNITS: [(Nanos, &str); 6] = [
        (3_600_000_000_000, "h"),
        (60_000_000_000, "min"),
        (1_000_000_000, "s"),
        (1_000_000, "ms"),
        (1_000, "us"),
        (1, "ns"),
    ];
    if nanos == Nanos::MAX {
        return "forever".to_owned();
    }
    if nanos == 0 {
        return "0".to_owned();
    }
    let (size, unit) =
        UNITS.into_iter().find(|(size, _)| nanos % size == 0).expect("the last one is 1");
    format!("{} {unit}", nanos / size)
}

#[cfg(test)]
mod tests {
    use super::time;

    #[test]
    fn times_have_the_largest_unit_that_fits() {
        let times = [0, 1, 1_500, 20_000_000, 1_000_000_000, 90_000_000_000, 3_600_000_000_000];
        let texts = times.map(time);
        assert_eq!(texts, ["0", "1 ns", "1500 ns", "20 ms", "1 s", "90 s", "1 h"]);
        assert_eq!(time(i64::MAX), "forever");
    }
}
