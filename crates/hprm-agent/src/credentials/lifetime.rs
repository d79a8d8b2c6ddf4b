//! How long certificates are valid, when they are renewed, and what a user is told before one ends and after that.
//!
//! All of it follows from a given moment, in seconds since 1970. Who signs is in `authority.rs`.

use time::OffsetDateTime;

use crate::Failure;

/// For how many days the certificates of machines and of an authority are valid.
pub(super) const MACHINE_DAYS: i64 = 365;
pub(super) const AUTHORITY_DAYS: i64 = 3650;

/// How many days before its end an agent warns of it.
const WARNING_DAYS: i64 = 30;

pub(super) const DAY: i64 = 24 * 60 * 60;

/// Until when a certificate is valid, and what can be done about that.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Lifetime {
    /// The name of the machine.
    pub(super) name: String,
    /// The end, in seconds since 1970.
    pub(crate) ends: i64,
    /// The end of the authority's certificate; none if the authority is not one of `hprm agent authority`.
    pub(super) authority_ends: Option<i64>,
}

/// What is to be said of a certificate, and what to do about it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) enum Notice {
    /// It ends soon.
    Soon(String, String),
    /// It has ended.
    Ended(String, String),
}

impl Lifetime {
    /// Refuses a certificate that has ended.
    ///
    /// # Errors
    ///
    /// If it has.
    pub(crate) fn check(&self, now: i64) -> Result<(), Failure> {
        match self.notice(now) {
            Some(Notice::Ended(text, hint)) => Err(Failure::new(text).hint(hint)),
            _ => Ok(()),
        }
    }

    /// What is to be said at a moment, if anything is.
    pub(crate) fn notice(&self, now: i64) -> Option<Notice> {
        let (name, date) = (&self.name, date(self.ends));
        let is_renewable = self.authority_ends.is_none_or(|ends| ends > self.ends);
        let advice = |renewable: String| {
            match (is_renewable, self.authority_ends) {
            (true, Some(_)) => renewable,
            (true, None) => "its authority signs another one; put it in the place of that of --tls-cert".to_owned(),
            (false, _) => "that of the authority ends then, too: move its folder away on its machine, make another \
                authority there, and enroll all machines again"
                .to_owned(),
        }
        };
        if now >= self.ends {
            let text = format!(
                "the certificate of {name} has ended on {date}, so no other machine accepts it"
            );
            let hint = format!(
                "`hprm agent renew {name}` on the authority's machine signs another one; if that is not this machine, \
                 copy ~/.config/hprm/authority/certificates.pem from there to ~/.config/hprm/agent here"
            );
            return Some(Notice::Ended(text, advice(hint)));
        }
        let text = format!("the certificate of {name} ends on {date}");
        let hint = format!(
            "`hprm agent renew {name}` on the authority's machine renews it; it comes here by itself"
        );
        (now >= self.ends - WARNING_DAYS * DAY).then(|| Notice::Soon(text, advice(hint)))
    }
}

/// Whether an authority renews a certificate by itself: less than a third of its life is left. One that has ended is left to a
/// person: the clock may be wrong.
pub(super) fn is_due(ends: i64, now: i64) -> bool {
    (1..MACHINE_DAYS * DAY / 3).contains(&(ends - now))
}

/// Until when a certificate is valid that is signed now: none outlasts that of the authority.
pub(super) fn new_end(now: i64, authority_ends: i64) -> i64 {
    (now + MACHINE_DAYS * DAY).min(authority_ends)
}

/// The moment, in seconds since 1970.
pub(crate) fn now() -> i64 {
    OffsetDateTime::now_utc().unix_timestamp()
}

/// The day of a moment, for people: `2027-11-27`.
pub(super) fn date(seconds: i64) -> String {
    OffsetDateTime::from_unix_timestamp(seconds)
        .map_or_else(|_| seconds.to_string(), |moment| moment.date().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2027-11-27, at noon.
    const END: i64 = 1_827_316_800;

    fn lifetime(authority_ends: Option<i64>) -> Lifetime {
        Lifetime { name: "robot2".to_owned(), ends: END, authority_ends }
    }

    #[test]
    fn an_end_is_told_thirty_days_before_it_and_after_it() {
        let one = lifetime(Some(END + DAY));
        assert_eq!(one.notice(END - 30 * DAY - 1), None);
        for now in [END - 30 * DAY, END - 1] {
            let Some(Notice::Soon(text, hint)) = one.notice(now) else { panic!("{now}") };
            assert_eq!(text, "the certificate of robot2 ends on 2027-11-27");
            assert!(hint.contains("`hprm agent renew robot2`"), "{hint}");
        }
        for now in [END, END + 1000 * DAY] {
            let Some(Notice::Ended(text, hint)) = one.notice(now) else { panic!("{now}") };
            assert!(text.starts_with("the certificate of robot2 has ended on 2027-11-27"));
            assert!(hint.contains("certificates.pem"), "{hint}");
        }
    }

    #[test]
    fn what_to_do_depends_on_whose_certificate_it_is() {
        let hint = |ends| match lifetime(ends).notice(END) {
            Some(Notice::Ended(_, hint)) => hint,
            other => panic!("{other:?}"),
        };
        assert!(hint(Some(END)).contains("make another authority"));
        assert!(hint(None).contains("--tls-cert"));
    }

    #[test]
    fn a_certificate_is_due_in_its_last_third_and_ends_with_its_authority() {
        let third = MACHINE_DAYS * DAY / 3;
        assert!(!is_due(END, END - third));
        assert!(is_due(END, END - third + 1) && is_due(END, END - 1) && !is_due(END, END));
        assert_eq!(new_end(END, END + 400 * DAY), END + 365 * DAY);
        assert_eq!(new_end(END, END + 4 * DAY), END + 4 * DAY);
    }
}
