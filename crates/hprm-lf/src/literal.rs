//! Literals as `.lf` text has them: units of time, and escapes in strings.

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
    fn a_part_of_a_unit_is_a_number_of_smaller_ones() {
        assert_eq!(smaller(0.5, "ms").as_deref(), Some("500 us"));
        assert_eq!(smaller(4.35, "s").as_deref(), Some("4350 ms"));
        assert_eq!(smaller(1.5, "min").as_deref(), Some("90 s"));
        assert_eq!(smaller(0.3, "ns"), None);
    }
}
