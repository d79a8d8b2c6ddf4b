//! Whole numbers of a range, and what is told of words that are none.

/// A parser of whole numbers from `least` to `most`.
pub(super) fn whole<T: TryFrom<u64>>(
    least: u64,
    most: u64,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync {
    move |text| {
        let number = text.parse().ok().filter(|number| (least..=most).contains(number));
        number.and_then(|number| T::try_from(number).ok()).ok_or_else(|| match most {
            u64::MAX => format!("not a whole number, or less than {least}"),
            _ => format!("not a whole number from {least} to {most}"),
        })
    }
}

/// A parser of whole numbers that are not less than `least`.
pub(super) fn at_least<T: TryFrom<u64>>(
    least: u64,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync {
    whole(least, u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_outside_of_the_range_and_other_words_are_refused() {
        assert_eq!(whole::<u32>(0, 1000)("1000"), Ok(1000));
        for text in ["1001", "-1", "many", "", "1.5"] {
            let told = whole::<u32>(0, 1000)(text).unwrap_err();
            assert_eq!(told, "not a whole number from 0 to 1000");
        }
        assert_eq!(at_least::<u32>(1)("0").unwrap_err(), "not a whole number, or less than 1");
        assert!(at_least::<u32>(1)("4294967296").is_err(), "it is too large");
    }
}
