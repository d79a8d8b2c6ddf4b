//! One-time codes: how a machine and the authority prove to one another, once, that a person has told both the same.
//!
//! A code has 80 random bits, as 16 characters that are hard to mix up. Both ends prove it by an HMAC-SHA256 over all
//! that has been said, so whoever stands between them can change nothing, and can only guess: with 10^13 guesses a
//! second, for ten minutes, one in a hundred million. Nothing that travels is secret, so nothing is encrypted.

use std::fmt;

use ring::hmac::{self, HMAC_SHA256};

/// Letters and digits without those that look like others (Crockford's base 32).
const SYMBOLS: &[u8; 32] = b"0123456789ABCDEFGHJKMNPQRSTVWXYZ";

const BYTES: usize = 10;
const LENGTH: usize = 16;

/// Bytes of a proof.
pub(super) const PROOF: usize = 32;

pub(super) type Proof = [u8; PROOF];

/// Which end proves: no proof of one end is one of the other.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Side {
    Machine,
    Authority,
}

/// See the module.
#[derive(Clone, PartialEq, Eq)]
pub(super) struct Code([u8; BYTES]);

impl Code {
    /// A code of these random bytes.
    pub(super) fn new(random: [u8; BYTES]) -> Self {
        Self(random)
    }

    /// Reads what a person has typed: case, hyphens and spaces do not matter, and neither do the letters O, I and L in
    /// the place of digits.
    pub(super) fn read(text: &str) -> Option<Self> {
        let symbols = text.chars().filter(|c| !c.is_whitespace() && *c != '-');
        let value = |c: char| {
            let c = match c.to_ascii_uppercase() {
                'O' => '0',
                'I' | 'L' => '1',
                c => c,
            };
            let place = SYMBOLS.iter().position(|symbol| char::from(*symbol) == c)?;
            Some(place as u128)
        };
        let values = symbols.map(value).collect::<Option<Vec<_>>>()?;
        if values.len() != LENGTH {
            return None;
        }
        let number = values.iter().fold(0, |number: u128, value| number << 5 | value);
        let bytes = number.to_be_bytes();
        bytes[bytes.len() - BYTES..].try_into().ok().map(Self)
    }

    /// The proof of one end that it knows the code, over what both ends have said. No two lists of parts have one
    /// proof.
    pub(super) fn prove(&self, side: Side, said: &[&[u8]]) -> Proof {
        let tag = self.sign(side, said);
        tag.as_ref().try_into().expect("SHA-256 has 32 bytes")
    }

    /// Whether a proof is that of one end; compared in a time that does not depend on where the difference is.
    pub(super) fn is_proved(&self, side: Side, said: &[&[u8]], proof: &[u8]) -> bool {
        hmac::verify(&self.key(), &message(side, said), proof).is_ok()
    }

    fn sign(&self, side: Side, said: &[&[u8]]) -> hmac::Tag {
        hmac::sign(&self.key(), &message(side, said))
    }

    fn key(&self) -> hmac::Key {
        hmac::Key::new(HMAC_SHA256, &self.0)
    }
}

fn message(side: Side, said: &[&[u8]]) -> Vec<u8> {
    let mut message = match side {
        Side::Machine => b"hprm enroll machine  ".to_vec(),
        Side::Authority => b"hprm enroll authority".to_vec(),
    };
    for part in said {
        message.extend((part.len() as u64).to_be_bytes());
        message.extend(*part);
    }
    message
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = self.0.iter().fold(0, |number: u128, byte| number << 8 | u128::from(*byte));
        for place in (0..LENGTH).rev() {
            let value = (number >> (5 * place)) & 31;
            write!(f, "{}", char::from(SYMBOLS[value as usize]))?;
            if place > 0 && place % 4 == 0 {
                write!(f, "-")?;
            }
        }
        Ok(())
    }
}

impl fmt::Debug for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Code")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANDOM: [u8; BYTES] = [0xff, 0, 1, 2, 3, 4, 5, 6, 7, 0xfe];

    #[test]
    fn codes_are_read_as_they_are_printed_and_as_people_type_them() {
        let code = Code::new(RANDOM);
        let text = code.to_string();
        assert_eq!((text.len(), text.split('-').count()), (19, 4));
        assert_eq!(Code::read(&text), Some(code.clone()));
        let typed = text.to_lowercase().replace('-', " ").replace('0', "o").replace('1', "l");
        assert_eq!(Code::read(&format!(" {typed}\n")), Some(code));
        for wrong in ["", "7K2Q", "U".repeat(16).as_str(), "0".repeat(17).as_str(), "ü"] {
            assert_eq!(Code::read(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_proof_is_of_one_code_one_side_and_what_was_said() {
        let code = Code::new(RANDOM);
        let proof = code.prove(Side::Machine, &[b"ab", b"c"]);
        assert!(code.is_proved(Side::Machine, &[b"ab", b"c"], &proof));
        assert!(!code.is_proved(Side::Authority, &[b"ab", b"c"], &proof));
        assert!(!code.is_proved(Side::Machine, &[b"a", b"bc"], &proof));
        assert!(!code.is_proved(Side::Machine, &[b"ab", b"c"], &proof[..31]));
        assert!(!Code::new([0; BYTES]).is_proved(Side::Machine, &[b"ab", b"c"], &proof));
    }
}
