//! A bundle: of each machine on a roster, the certificate that ends last.
//!
//! Each certificate has a signature, so a bundle needs none, and any agent may carry it. Two bundles become one by keeping what ends
//! last of both; so in whatever order they come, all agents end up with the same, and an old one changes nothing. A machine that was
//! taken out of the roster is in no bundle. How bundles travel is the business of `renewal.rs`.

use std::collections::BTreeMap;

use ring::digest::{SHA256, digest};

use super::certificate::{Anchor, Certificate};
use super::roster::{MACHINES, Roster};

/// The most bytes of a bundle: those of the longest certificate for each machine.
pub(crate) const LIMIT: usize = 3 << 20;
const _: () = assert!(LIMIT >= MACHINES * 768);

/// See the module.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Bundle(BTreeMap<String, Certificate>);

impl Bundle {
    /// What of a text of certificates ends later than what is here, of machines on the roster.
    ///
    /// # Errors
    ///
    /// What is wrong with it, if any of it is; then nothing of it counts.
    pub(super) fn news(
        &self,
        text: &[u8],
        roster: &Roster,
        authority: &Anchor,
    ) -> Result<Vec<Certificate>, String> {
        if text.len() > LIMIT {
            return Err("it is too long".to_owned());
        }
        let (mut news, members) = (Certificate::read_all(text)?, roster.subjects());
        news.retain(|one| members.contains(&*one.subject) && self.is_later(one));
        // Only now, because it takes longest.
        news.iter().try_for_each(|one| authority.check(one))?;
        news.retain(|one| self.is_news(one));
        Ok(news)
    }

    fn is_later(&self, one: &Certificate) -> bool {
        self.get(&one.subject).is_none_or(|known| known.ends < one.ends)
    }

    fn is_news(&self, one: &Certificate) -> bool {
        // The key of a machine never changes while it has that subject.
        let is_of_key = self.get(&one.subject).is_none_or(|known| known.key == one.key);
        is_of_key && self.is_later(one)
    }

    /// Takes certificates that were checked. Returns whether that changes anything.
    pub(super) fn take(&mut self, news: impl IntoIterator<Item = Certificate>) -> bool {
        let mut is_changed = false;
        for one in news {
            if self.is_news(&one) {
                self.0.insert(one.subject.clone(), one);
                is_changed = true;
            }
        }
        is_changed
    }

    /// Forgets the certificates of machines that are not on the roster.
    pub(super) fn retain(&mut self, roster: &Roster) {
        let members = roster.subjects();
        self.0.retain(|subject, _| members.contains(&**subject));
    }

    /// The certificate of a subject.
    pub(super) fn get(&self, subject: &str) -> Option<&Certificate> {
        self.0.get(subject)
    }

    /// All of them in PEM, one after the other.
    pub(super) fn text(&self) -> String {
        self.0.values().map(Certificate::pem).collect()
    }

    /// A number that only bundles of the same certificates have.
    pub(super) fn digest(&self) -> String {
        let lines = self.0.values().map(|one| format!("{} {}\n", one.subject, one.ends));
        let digest = digest(&SHA256, lines.collect::<String>().as_bytes());
        digest.as_ref().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}
