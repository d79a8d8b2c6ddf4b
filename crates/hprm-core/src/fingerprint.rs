//! What must be equal in all processes of a federation, and how two programs differ.
//!
//! A fingerprint is a list of facts. Its digest tells whether two programs agree; the facts tell the user
//! how they differ. Which facts a program has is in `program`; a front end adds its own facts, for
//! example about the bodies of reactions.

use alloc::borrow::ToOwned;
use alloc::format;
use alloc::string::String;
use alloc::vec;
use alloc::vec::Vec;

mod program;
#[cfg(test)]
mod tests;

use alloc::collections::{BTreeMap, BTreeSet};
use core::hash::{Hash, Hasher};

use serde::{Deserialize, Serialize};
use twox_hash::XxHash3_128;

pub use program::show_time;

/// The longest text that is compared as text, in bytes. A longer one has a digest.
const LONGEST_TEXT: usize = 160;

/// The longest report, in bytes.
const LONGEST_REPORT: usize = 4 << 20;

/// The most differences that are listed one by one.
const MOST_DIFFERENCES: usize = 5;

/// One fact about a program.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Fact {
    /// What it is about: `timer camera.t`. No two facts of a program have the same subject.
    pub subject: String,
    /// Where that is written, for the user: `Main.lf:7`. It may differ.
    pub place: String,
    /// Whether a process may lack it, such as a module that only another federate imports: then it is
    /// compared where both have it.
    pub optional: bool,
    /// The content of the fact.
    pub content: Content,
}

/// What a fact says of its subject.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum Content {
    /// A short text: `1 s`.
    Text(String),
    /// The digest of something longer.
    Digest(u64),
    /// The digest of an order. It differs also if there are more or fewer elements, so the difference is
    /// reported only if no other fact differs.
    Order(u64),
}

impl Fact {
    /// A fact with a text. If the text is long, its digest is compared.
    #[must_use]
    pub fn text(subject: String, text: String) -> Self {
        let content = match text.len() {
            0..=LONGEST_TEXT => Content::Text(text),
            _ => Content::Digest(digest([text.as_bytes()])),
        };
        Self::new(subject, content)
    }

    /// A fact with a long content, in pieces; the boundaries between pieces matter.
    #[must_use]
    pub fn digest<'a>(subject: String, pieces: impl IntoIterator<Item = &'a [u8]>) -> Self {
        Self::new(subject, Content::Digest(digest(pieces)))
    }

    /// A fact about the order of elements that have names.
    #[must_use]
    pub fn order<'a>(subject: String, names: impl IntoIterator<Item = &'a str>) -> Self {
        let names = names.into_iter().map(str::as_bytes);
        Self::new(subject, Content::Order(digest(names)))
    }

    fn new(subject: String, content: Content) -> Self {
        Self { subject, place: String::new(), optional: false, content }
    }

    /// The same fact, marked as one that a process may lack.
    #[must_use]
    pub fn if_present(self) -> Self {
        Self { optional: true, ..self }
    }

    /// The same, with the place where its subject is written.
    #[must_use]
    pub fn at(self, place: String) -> Self {
        Self { place, ..self }
    }

    /// The subject and its place: `reaction 2 of reactor Camera (Main.lf:7)`.
    fn name(&self) -> String {
        match self.place.as_str() {
            "" => self.subject.clone(),
            place => format!("{} ({place})", self.subject),
        }
    }
}

/// A digest that is the same on every machine and in every version of the compiler. It does not protect
/// against a process that forges it: only members of the federation are compared.
fn digest<'a>(pieces: impl IntoIterator<Item = &'a [u8]>) -> u64 {
    let mut hash = XxHash3_128::new();
    for piece in pieces {
        hash.write(&(piece.len() as u64).to_le_bytes());
        hash.write(piece);
    }
    (hash.finish_128() >> 64) as u64
}

/// What must be equal in all processes of a federation.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Fingerprint {
    facts: Vec<Fact>,
    digest: u64,
}

impl Hash for Fingerprint {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.digest.hash(state);
    }
}

impl Fingerprint {
    /// A fingerprint of these facts, in the order in which differences are reported. Of facts with
    /// one subject the later ones are numbered.
    #[must_use]
    pub fn new(mut facts: Vec<Fact>) -> Self {
        let mut seen = BTreeMap::<String, u32>::new();
        for fact in &mut facts {
            let count = seen.entry(fact.subject.clone()).or_default();
            *count += 1;
            if *count > 1 {
                fact.subject = format!("{} [{count}]", fact.subject);
            }
        }
        let digest = digest_of(&facts);
        Self { facts, digest }
    }

    /// The facts, from which [`Self::new`] makes it again.
    #[must_use]
    pub fn facts(&self) -> &[Fact] {
        &self.facts
    }

    /// A number that is equal if all facts are. If it is not, [`Self::differences`] decides.
    #[must_use]
    pub fn digest(&self) -> u64 {
        self.digest
    }

    /// All facts, to be compared by another process. If they are very many, several become one.
    #[must_use]
    pub fn report(&self) -> Vec<Fact> {
        if is_short(&self.facts) {
            return self.facts.clone();
        }
        let summary = summary(&self.facts);
        if is_short(&summary) { summary } else { whole(&self.facts) }
    }

    /// How the program with these reported facts, which `other` runs, differs from this one, which `this`
    /// runs: sentences for the user, the most important first. None if they agree.
    #[must_use]
    pub fn differences(&self, this: &str, reported: &[Fact], other: &str) -> Vec<String> {
        let own = match reported {
            [Fact { subject, .. }, ..] if subject == PROGRAM => whole(&self.facts),
            [Fact { subject, .. }, ..] if subject.ends_with(ELLIPSIS) => summary(&self.facts),
            _ => self.facts.clone(),
        };
        let theirs: BTreeMap<_, _> = reported.iter().map(|fact| (&fact.subject, fact)).collect();
        let ours: BTreeSet<_> = own.iter().map(|fact| &fact.subject).collect();
        let (mut sentences, mut orders) = (Vec::new(), Vec::new());
        for fact in &own {
            match theirs.get(&fact.subject) {
                Some(their) => {
                    let into = if is_order(fact) { &mut orders } else { &mut sentences };
                    into.extend(difference((fact, this), (their, other)));
                }
                None => sentences.extend(only(fact, this, other)),
            }
        }
        let missing = reported.iter().filter(|fact| !ours.contains(&fact.subject));
        sentences.extend(missing.filter_map(|fact| only(fact, other, this)));
        if sentences.is_empty() { shortened(orders) } else { shortened(sentences) }
    }
}

/// Whether so many facts can be sent.
fn is_short(facts: &[Fact]) -> bool {
    let size = |fact: &Fact| fact.subject.len() + fact.place.len() + LONGEST_TEXT;
    facts.iter().map(size).sum::<usize>() <= LONGEST_REPORT
}

fn digest_of<'a>(facts: impl IntoIterator<Item = &'a Fact>) -> u64 {
    let pieces = facts.into_iter().flat_map(|fact| {
        let (kind, content) = match &fact.content {
            Content::Text(text) => ("text", text.as_bytes().to_vec()),
            Content::Digest(digest) => ("digest", digest.to_le_bytes().to_vec()),
            Content::Order(digest) => ("order", digest.to_le_bytes().to_vec()),
        };
        [fact.subject.as_bytes().to_vec(), kind.as_bytes().to_vec(), content]
    });
    let pieces: Vec<_> = pieces.collect();
    digest(pieces.iter().map(Vec::as_slice))
}

/// What the subject of several facts ends with.
const ELLIPSIS: &str = "...";

/// One fact for all whose subjects begin alike: `timer camera....` for the timers in `camera`.
fn summary(facts: &[Fact]) -> Vec<Fact> {
    let mut groups = BTreeMap::<&str, Vec<&Fact>>::new();
    for fact in facts.iter().filter(|fact| !fact.optional) {
        let start = fact.subject.split('.').next().unwrap_or_default();
        groups.entry(start).or_default().push(fact);
    }
    let facts = groups.into_iter().map(|(start, facts)| {
        Fact::new(format!("{start}{ELLIPSIS}"), Content::Digest(digest_of(facts)))
    });
    facts.collect()
}

/// What one fact about everything is about.
const PROGRAM: &str = "the program";

fn whole(facts: &[Fact]) -> Vec<Fact> {
    let compared = facts.iter().filter(|fact| !fact.optional);
    vec![Fact::new(PROGRAM.to_owned(), Content::Digest(digest_of(compared)))]
}

fn is_order(fact: &Fact) -> bool {
    matches!(fact.content, Content::Order(_))
}

fn difference((own, this): (&Fact, &str), (their, other): (&Fact, &str)) -> Option<String> {
    if own.content == their.content {
        return None;
    }
    Some(match (&own.content, &their.content) {
        (Content::Text(ours), Content::Text(theirs)) => {
            format!("{} is {theirs} at {other} and {ours} at {this}", own.name())
        }
        _ => format!("{} differs", own.name()),
    })
}

/// The sentence about a fact that only one of two processes has.
fn only(fact: &Fact, here: &str, elsewhere: &str) -> Option<String> {
    let tells = !fact.optional && !is_order(fact);
    tells
        .then(|| format!("{} is in the program of {here}, not in that of {elsewhere}", fact.name()))
}

fn shortened(mut sentences: Vec<String>) -> Vec<String> {
    let more = sentences.len().saturating_sub(MOST_DIFFERENCES);
    if more > 1 {
        sentences.truncate(MOST_DIFFERENCES);
        sentences.push(format!("{more} more differences"));
    }
    sentences
}
