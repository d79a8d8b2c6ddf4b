//! The roster: the machines that belong together, as their authority has signed it.
//!
//! Each change has a higher number, and an agent takes no roster with a lower one. A machine is known by the subject of
//! its certificate, `robot1#4`: its name, and the number of the roster in which that certificate came first. So a machine
//! that is taken out is refused, and so is the old certificate of one that was enrolled again.
//!
//! How rosters travel is the business of `membership.rs`.

use std::collections::BTreeSet;

use ring::rand::SystemRandom;
use ring::signature::EcdsaKeyPair;
use ring::signature::{ECDSA_P256_SHA256_ASN1, ECDSA_P256_SHA256_ASN1_SIGNING, UnparsedPublicKey};
use serde::{Deserialize, Serialize};

use hprm::agent::is_name;

/// The most machines, and the most bytes of a signed roster.
pub(super) const MACHINES: usize = 4096;
const LIMIT: usize = 1 << 20;

/// A machine that belongs to the others.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(crate) struct Member {
    pub(crate) name: String,
    /// The common name in its certificate.
    pub(crate) subject: String,
    /// Whether it is a router, which leads what others send.
    #[serde(default)]
    pub(crate) is_router: bool,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Roster {
    pub(crate) number: u64,
    pub(crate) machines: Vec<Member>,
}

/// A roster as it travels and as it is kept.
#[derive(Serialize, Deserialize)]
struct Signed {
    roster: String,
    signature: String,
}

impl Roster {
    /// The member with a name, if there is one.
    pub(crate) fn member(&self, name: &str) -> Option<&Member> {
        self.machines.iter().find(|member| member.name == name)
    }

    /// Whether a machine has been taken out since an earlier roster. One that neither has may have come later than both:
    /// this need not be the latest, and a router leads what such a machine says.
    pub(crate) fn has_taken_out(&self, earlier: &Self, name: &str) -> bool {
        earlier.member(name).is_some() && self.member(name).is_none()
    }

    /// The subjects of all certificates that count.
    pub(super) fn subjects(&self) -> BTreeSet<&str> {
        self.machines.iter().map(|member| &*member.subject).collect()
    }

    /// Whether a machine is a member and a router.
    pub(crate) fn is_router(&self, name: &str) -> bool {
        self.member(name).is_some_and(|member| member.is_router)
    }

    /// With a machine that has a new certificate; an old one of that name counts no more. Returns the subject.
    pub(super) fn admit(&mut self, name: &str, is_router: bool) -> String {
        self.number += 1;
        let subject = format!("{name}#{}", self.number);
        self.machines.retain(|member| member.name != name);
        let member = Member { name: name.to_owned(), subject: subject.clone(), is_router };
        self.machines.push(member);
        subject
    }

    /// Without a machine. Returns whether it was there.
    pub(super) fn revoke(&mut self, name: &str) -> bool {
        let before = self.machines.len();
        self.machines.retain(|member| member.name != name);
        let is_changed = self.machines.len() < before;
        self.number += u64::from(is_changed);
        is_changed
    }

    /// Signs it.
    pub(super) fn sign(&self, key: &EcdsaKeyPair) -> Result<String, String> {
        let roster = serde_json::to_string(self).expect("it has texts and numbers only");
        let signature = key.sign(&SystemRandom::new(), &message(&roster));
        let signature = signature.map_err(|_| "the roster cannot be signed".to_owned())?;
        let signature = signature.as_ref().iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(serde_json::to_string(&Signed { roster, signature }).expect("it has texts only"))
    }

    /// Reads a roster that the authority with this key has signed.
    ///
    /// # Errors
    ///
    /// Why it is none.
    pub(crate) fn read(text: &[u8], authority: &[u8]) -> Result<Self, String> {
        let wrong = |_| "it is no roster".to_owned();
        if text.len() > LIMIT {
            return Err("it is too long".to_owned());
        }
        let Signed { roster, signature } = serde_json::from_slice(text).map_err(wrong)?;
        let signature = bytes(&signature).ok_or("its signature is none")?;
        UnparsedPublicKey::new(&ECDSA_P256_SHA256_ASN1, authority)
            .verify(&message(&roster), &signature)
            .map_err(|_| "the authority has not signed it".to_owned())?;
        let roster: Self = serde_json::from_str(&roster).map_err(wrong)?;
        let is_well_formed = roster.machines.len() <= MACHINES
            && roster.machines.iter().all(|it| is_name(&it.name) && it.is_named_by_subject());
        is_well_formed.then_some(roster).ok_or_else(|| "it has names that are none".to_owned())
    }
}

impl Member {
    fn is_named_by_subject(&self) -> bool {
        name_of(&self.subject) == Some(&self.name)
    }
}

/// The machine that the subject of a certificate names.
pub(super) fn name_of(subject: &str) -> Option<&str> {
    let (name, number) = subject.split_once('#')?;
    (is_name(name) && number.parse::<u64>().is_ok()).then_some(name)
}

/// What is signed: nothing that the authority signs for another purpose begins so.
fn message(roster: &str) -> Vec<u8> {
    [b"hprm roster 1\n", roster.as_bytes()].concat()
}

fn bytes(hex: &str) -> Option<Vec<u8>> {
    let pairs = (0..hex.len()).step_by(2).map(|at| hex.get(at..at + 2));
    pairs.map(|pair| u8::from_str_radix(pair?, 16).ok()).collect()
}

/// The key with which an authority signs rosters.
pub(super) fn key(pkcs8: &[u8]) -> Result<EcdsaKeyPair, String> {
    let random = SystemRandom::new();
    let key = EcdsaKeyPair::from_pkcs8(&ECDSA_P256_SHA256_ASN1_SIGNING, pkcs8, &random);
    key.map_err(|error| format!("the key of the authority is none: {error}"))
}

#[cfg(test)]
mod tests {
    use ring::signature::KeyPair;

    use super::*;

    fn authority() -> EcdsaKeyPair {
        let random = SystemRandom::new();
        let pkcs8 = EcdsaKeyPair::generate_pkcs8(&ECDSA_P256_SHA256_ASN1_SIGNING, &random);
        key(pkcs8.unwrap().as_ref()).unwrap()
    }

    #[test]
    fn only_what_the_authority_has_signed_is_read() {
        let (ours, other) = (authority(), authority());
        let mut roster = Roster::default();
        assert_eq!(roster.admit("robot1", false), "robot1#1");
        roster.admit("relay", true);
        let text = roster.sign(&ours).unwrap();
        let mine = ours.public_key().as_ref();
        assert_eq!(Roster::read(text.as_bytes(), mine), Ok(roster.clone()));
        assert!(Roster::read(text.as_bytes(), other.public_key().as_ref()).is_err());
        for place in 0..text.len() {
            let mut changed = text.clone().into_bytes();
            changed[place] ^= 1;
            let read = Roster::read(&changed, mine);
            assert!(read.is_err() || read == Ok(roster.clone()), "{place}");
        }
        for strange in ["", "{}", "[]", r#"{"roster": "{}", "signature": "ü"}"#] {
            assert!(Roster::read(strange.as_bytes(), mine).is_err());
        }
        assert!(Roster::read(&vec![b' '; LIMIT + 1], mine).is_err());
    }

    #[test]
    fn names_in_a_roster_are_names_and_those_of_their_subjects() {
        let key = authority();
        for (name, subject) in
            [("a/b", "a/b#1"), ("a", "b#1"), ("a", "a"), ("a", "a#x"), ("", "#1")]
        {
            let member =
                Member { name: name.to_owned(), subject: subject.to_owned(), is_router: false };
            let text = Roster { number: 1, machines: vec![member] }.sign(&key).unwrap();
            assert!(Roster::read(text.as_bytes(), key.public_key().as_ref()).is_err(), "{subject}");
        }
    }

    #[test]
    fn a_machine_that_is_enrolled_again_has_another_subject_and_one_that_is_revoked_none() {
        let mut roster = Roster::default();
        roster.admit("robot1", false);
        roster.admit("robot2", false);
        assert_eq!(roster.admit("robot1", false), "robot1#3");
        assert_eq!(roster.machines.len(), 2);
        assert!(roster.revoke("robot1"));
        assert!(!roster.revoke("robot1"));
        assert_eq!((roster.number, roster.member("robot1")), (4, None));
        assert_eq!(roster.admit("robot1", false), "robot1#5");
    }

    #[test]
    fn a_machine_is_taken_out_if_it_was_there_and_is_not_any_more() {
        let mut roster = Roster::default();
        roster.admit("robot1", false);
        let first = roster.clone();
        roster.admit("robot2", false);
        let second = roster.clone();
        roster.admit("robot3", false);
        roster.revoke("robot1");
        let taken = |later: &Roster, earlier: &Roster| {
            ["robot1", "robot2", "robot3"].map(|name| later.has_taken_out(earlier, name))
        };
        assert_eq!(taken(&roster, &first), [true, false, false]);
        // The second roster is not the latest: of the third machine it knows nothing.
        assert_eq!(taken(&second, &first), [false; 3]);
        roster.admit("robot1", false);
        assert_eq!(taken(&roster, &first), [false; 3]);
    }
}
