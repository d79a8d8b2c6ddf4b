//! Literals as `.lf` text has them: units of time, and escapes in strings; and times that are texts
//! elsewhere.

use hprm_core::Nanos;

/// Whether a word is a unit of time.
#[must_use]
pub fn is_unit(word: &str) -> bool {
    unit(word).is_some()
}

/// Nanoseconds of a unit of time.
pub(crate) fn unit(name: &str) -> Option<Nanos> {
    const SECOND: Nanos = 1_000_000_000;
    Some(match name {
        "nsec" | "ns" | "nsecs" => 1,
        "usec" | "us" | "usecs" => 1_000,
        "msec" | "ms" | "msecs" => 1_000_000,
        "sec" | "s" | "secs" | "second" | "seconds" => SECOND,
        "minute" | "min" | "mins" | "minutes" => 60 * SECOND,
        "hour" | "h" | "hours" => 3_600 * SECOND,
        "day" | "d" | "days" => 86_400 * SECOND,
        "week" | "wk" | "weeks" => 7 * 86_400 * SECOND,
        _ => return None,
    })
}

/// Why a text is no time.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum WrongTime {
    /// It is not a number with a unit.
    Text,
    /// It has more nanoseconds than a number of 64 bits.
    TooLong,
    /// It has a part of a nanosecond.
    TooFine,
}

/// The nanoseconds of a time: a number, perhaps with a decimal point, and a unit, as in `10 ms`; or
/// `forever`, or zero without a unit.
///
/// ```
/// assert_eq!(hprm_lf::parse_time("10 ms"), Ok(10_000_000));
/// assert_eq!(hprm_lf::parse_time("0.5s"), Ok(500_000_000));
/// ```
///
/// # Errors
///
/// Why it is none.
pub fn parse_time(text: &str) -> Result<Nanos, WrongTime> {
    let text = text.trim();
    match text {
        "forever" => return Ok(Nanos::MAX),
        "0" => return Ok(0),
        _ => {}
    }
    let end = text.find(|c: char| !c.is_ascii_digit() && !"._".contains(c)).unwrap_or(text.len());
    let (number, unit_name) = text.split_at(end);
    let unit = unit(unit_name.trim_start()).ok_or(WrongTime::Text)?;
    let (whole, part) = number.split_once('.').unwrap_or((number, "0"));
    let whole = whole.replace('_', "");
    let is_number = |digits: &str| !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit());
    if !is_number(&whole) || !is_number(part) {
        return Err(WrongTime::Text);
    }
    let too_long = |_| WrongTime::TooLong;
    let whole: Nanos = whole.parse().map_err(too_long)?;
    let part = part.trim_end_matches('0');
    // A week has 604,800,000,000,000 nanoseconds, so that no more digits can matter.
    let scale = u32::try_from(part.len()).ok().filter(|digits| *digits <= 15);
    let scale = 10_i128.pow(scale.ok_or(WrongTime::TooFine)?);
    let part = part.parse::<i128>().unwrap_or(0) * i128::from(unit);
    if part % scale != 0 {
        return Err(WrongTime::TooFine);
    }
    let nanos = i128::from(whole) * i128::from(unit) + part / scale;
    Nanos::try_from(nanos).map_err(|_| WrongTime::TooLong)
}

/// How to write `number` of a unit as a whole number of a smaller one, if it is one.
pub(crate) fn smaller(number: f64, unit_name: &str) -> Option<String> {
    let nanos = number * unit(unit_name)? as f64;
    // Rounding takes away what the multiplication has added: 4.35 s are 4350 ms.
    let whole = |name: &&str| {
        let number = nanos / unit(name)? as f64;
        let error = (number - number.round()).abs();
        (error <= 1e-9 * number).then(|| format!("{} {name}", number.round()))
    };
    ["s", "ms", "us", "ns"].iter().find_map(whole)
}

/// The text that a literal denotes, with Python's escapes. An unknown escape stays as it is, as in
/// Python.
pub(crate) fn unescape(literal: &str) -> String {
    let mut text = String::with_capacity(literal.len());
    let mut rest = literal;
    while let Some(at) = rest.find('\\') {
        text.push_str(&rest[..at]);
        let escape = &rest[at + 1..];
        let Some(first) = escape.chars().next() else {
            rest = &rest[at..];
            break;
        };
        let simple = match first {
            'n' => Some("\n"),
            't' => Some("\t"),
            'r' => Some("\r"),
            '\\' => Some("\\"),
            '\'' => Some("'"),
            '"' => Some("\""),
            '0' => Some("\0"),
            '\n' => Some(""),
            _ => None,
        };
        let digits = match first {
            'x' => 2,
            'u' => 4,
            'U' => 8,
            _ => 0,
        };
        let coded = escape
            .get(1..=digits)
            .filter(|code| !code.is_empty())
            .and_then(|code| u32::from_str_radix(code, 16).ok())
            .and_then(char::from_u32);
        if let Some(simple) = simple {
            text.push_str(simple);
            rest = &escape[1..];
        } else if let Some(coded) = coded {
            text.push(coded);
            rest = &escape[1 + digits..];
        } else {
            text.push('\\');
            rest = escape;
        }
    }
    text.push_str(rest);
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_are_pythons() {
        assert_eq!(unescape(r#"a\n\t\"\\\x41\u00e9"#), "a\n\t\"\\A\u{e9}");
        assert_eq!(unescape(r"\d \xzz \"), r"\d \xzz \");
    }

    #[test]
    fn units() {
        assert_eq!(unit("ms"), Some(1_000_000));
        assert_eq!(unit("weeks"), Some(604_800_000_000_000));
        assert_eq!(unit("parsec"), None);
    }

    #[test]
    fn times_as_texts() {
        for (text, nanos) in [
            ("10 ms", 10_000_000),
            ("10ms", 10_000_000),
            (" 1_000 us ", 1_000_000),
            ("1.5 s", 1_500_000_000),
            ("0.000001 ms", 1),
            ("2.50 min", 150_000_000_000),
            ("1 d", 86_400_000_000_000),
            ("0", 0),
            ("forever", Nanos::MAX),
            ("9223372036854775807 ns", Nanos::MAX),
        ] {
            assert_eq!(parse_time(text), Ok(nanos), "{text}");
        }
        for text in
            ["", "x", "10", "ms", "1 parsec", "-1 s", "1e3 ns", ". s", "1. s", ".5 s", "1.2.3 s"]
        {
            assert_eq!(parse_time(text), Err(WrongTime::Text), "{text}");
        }
        for text in ["9223372036854775808 ns", "99999999999999999999 s", "16000 weeks"] {
            assert_eq!(parse_time(text), Err(WrongTime::TooLong), "{text}");
        }
        for text in ["0.5 ns", "0.0000001 ms", "1.00000000000000001 s"] {
            assert_eq!(parse_time(text), Err(WrongTime::TooFine), "{text}");
        }
    }

    #[test]
    fn a_part_of_a_unit_is_a_number_of_smaller_ones() {
        assert_eq!(smaller(0.5, "ms").as_deref(), Some("500 us"));
        assert_eq!(smaller(4.35, "s").as_deref(), Some("4350 ms"));
        assert_eq!(smaller(1.5, "min").as_deref(), Some("90 s"));
        assert_eq!(smaller(0.3, "ns"), None);
    }
}
