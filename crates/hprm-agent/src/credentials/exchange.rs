//! What a machine that is being enrolled and its authority say to one another, over TCP.
//!
//! ```text
//! machine                                     authority
//!                          <----------------  magic, nonce (40 bytes)
//!   nonce, request, proof  ---------------->
//!                          <----------------  0, admission, proof; or the number of a refusal
//! ```
//!
//! Request and admission have a length of four bytes before them. A proof is of all that was said before, both nonces
//! too: what was recorded of one enrolment is worth nothing in another. Only a refusal has no proof, and is told by its
//! number, so that nobody else puts words into the mouth of the authority.
//!
//! This file is what is decided, and how it is written; `invite.rs` and `enroll.rs` move the bytes.

use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::authority::Admission;
use super::code::{Code, PROOF, Side};

pub(super) const MAGIC: [u8; 8] = *b"HPRM-E01";
const NONCE: usize = 32;
pub(super) const GREETING: usize = MAGIC.len() + NONCE;

/// The most bytes of a request, and of an admission: the roster is most of it.
pub(super) const REQUEST_LIMIT: usize = 8 << 10;
pub(super) const ADMISSION_LIMIT: usize = 2 << 20;

/// How many wrong proofs an invitation outlives.
pub(super) const ATTEMPTS: u32 = 5;

pub(super) type Nonce = [u8; NONCE];

/// What a machine asks for.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct Request {
    pub(super) name: String,
    /// The request for a certificate, in PEM.
    pub(super) request: String,
}

/// Why a machine is refused.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub(super) enum Refusal {
    #[error("the code is wrong")]
    WrongCode,
    #[error("the code is for a machine of another name")]
    OtherName,
    #[error("the code has expired")]
    Expired,
    #[error("the code has been used")]
    Used,
    #[error("too many wrong codes have come")]
    TooMany,
    #[error(
        "the authority cannot read what this machine asks for: is the version of hprm the same?"
    )]
    Unreadable,
    #[error("the authority cannot sign the certificate: it says why")]
    Failed,
}

const REFUSALS: [Refusal; 7] = [
    Refusal::WrongCode,
    Refusal::OtherName,
    Refusal::Expired,
    Refusal::Used,
    Refusal::TooMany,
    Refusal::Unreadable,
    Refusal::Failed,
];

impl Refusal {
    /// As it travels.
    pub(super) fn number(self) -> u8 {
        let place = REFUSALS.iter().position(|refusal| *refusal == self);
        u8::try_from(place.unwrap_or_default() + 1).expect("there are few")
    }

    pub(super) fn of_number(number: u8) -> Option<Self> {
        REFUSALS.get(usize::from(number).checked_sub(1)?).copied()
    }
}

/// A machine that may enroll, once.
pub(super) struct Invitation {
    name: String,
    code: Code,
    until: Instant,
    attempts: u32,
    is_used: bool,
}

impl Invitation {
    pub(super) fn new(name: &str, code: Code, until: Instant) -> Self {
        Self { name: name.to_owned(), code, until, attempts: ATTEMPTS, is_used: false }
    }

    /// Whether nobody can use it any more.
    pub(super) fn is_void(&self) -> bool {
        self.attempts == 0
    }

    /// Whether what a machine says admits it. It is used then.
    pub(super) fn judge(
        &mut self,
        now: Instant,
        nonce: &Nonce,
        said: &Said,
    ) -> Result<Request, Refusal> {
        if self.is_void() {
            return Err(Refusal::TooMany);
        }
        if now >= self.until {
            return Err(Refusal::Expired);
        }
        if !self.code.is_proved(Side::Machine, &[nonce, &said.nonce, &said.request], &said.proof) {
            self.attempts -= 1;
            return Err(Refusal::WrongCode);
        }
        if self.is_used {
            return Err(Refusal::Used);
        }
        let request: Request =
            serde_json::from_slice(&said.request).map_err(|_| Refusal::Unreadable)?;
        if request.name != self.name {
            return Err(Refusal::OtherName);
        }
        self.is_used = true;
        Ok(request)
    }

    /// What the machine is answered that was admitted.
    pub(super) fn answer(&self, nonce: &Nonce, said: &Said, admission: &Admission) -> Vec<u8> {
        let admission = serde_json::to_vec(admission).expect("it has texts only");
        let parts: [&[u8]; 4] = [nonce, &said.nonce, &said.request, &admission];
        let proof = self.code.prove(Side::Authority, &parts);
        [&[0], &*framed(&admission), &proof].concat()
    }
}

/// What a machine has said, before anything of it is believed.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Said {
    pub(super) nonce: Nonce,
    pub(super) request: Vec<u8>,
    pub(super) proof: Vec<u8>,
}

impl Said {
    /// What a machine says to an authority that has greeted it with a nonce.
    pub(super) fn new(code: &Code, authority: &Nonce, nonce: Nonce, request: &Request) -> Self {
        let request = serde_json::to_vec(request).expect("it has texts only");
        let proof = code.prove(Side::Machine, &[authority, &nonce, &request]).to_vec();
        Self { nonce, request, proof }
    }

    pub(super) fn bytes(&self) -> Vec<u8> {
        [&self.nonce, &*framed(&self.request), &*self.proof].concat()
    }

    /// Reads what has come; nothing if more must come.
    ///
    /// # Errors
    ///
    /// If it is longer than a request may be.
    pub(super) fn read(bytes: &[u8]) -> Result<Option<Self>, Refusal> {
        let Some((nonce, rest)) = bytes.split_first_chunk::<NONCE>() else { return Ok(None) };
        let Some((len, rest)) = rest.split_first_chunk::<4>() else { return Ok(None) };
        let len = u32::from_be_bytes(*len) as usize;
        if len > REQUEST_LIMIT || rest.len() > len + PROOF {
            return Err(Refusal::Unreadable);
        }
        if rest.len() < len + PROOF {
            return Ok(None);
        }
        let (request, proof) = rest.split_at(len);
        Ok(Some(Self { nonce: *nonce, request: request.to_vec(), proof: proof.to_vec() }))
    }

    /// The admission, if the authority has the code.
    pub(super) fn admitted(
        &self,
        code: &Code,
        authority: &Nonce,
        admission: &[u8],
        proof: &[u8],
    ) -> Result<Admission, String> {
        let parts: [&[u8]; 4] = [authority, &self.nonce, &self.request, admission];
        if !code.is_proved(Side::Authority, &parts, proof) {
            return Err(
                "whoever answers does not know the code, and is not the authority".to_owned()
            );
        }
        serde_json::from_slice(admission)
            .map_err(|_| "the authority answers what this version does not know".to_owned())
    }
}

/// With its length before it.
fn framed(bytes: &[u8]) -> Vec<u8> {
    let len = u32::try_from(bytes.len()).expect("limits are below");
    [&len.to_be_bytes(), bytes].concat()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    const OURS: Nonce = [1; NONCE];

    fn code(byte: u8) -> Code {
        Code::new([byte; 10])
    }

    fn invitation() -> (Invitation, Instant) {
        let now = Instant::now();
        (Invitation::new("robot2", code(7), now + Duration::from_secs(600)), now)
    }

    fn request(name: &str) -> Request {
        Request { name: name.to_owned(), request: "a request".to_owned() }
    }

    fn said(code: &Code, name: &str) -> Said {
        Said::new(code, &OURS, [2; NONCE], &request(name))
    }

    #[test]
    fn a_code_works_once_for_one_name_until_it_expires() {
        let (mut one, now) = invitation();
        assert_eq!(one.judge(now, &OURS, &said(&code(7), "robot3")), Err(Refusal::OtherName));
        let right = said(&code(7), "robot2");
        assert_eq!(one.judge(now, &OURS, &right), Ok(request("robot2")));
        assert_eq!(one.judge(now, &OURS, &right), Err(Refusal::Used));
        let (mut late, now) = invitation();
        let later = now + Duration::from_secs(600);
        assert_eq!(late.judge(later, &OURS, &right), Err(Refusal::Expired));
        assert_eq!(late.judge(now, &OURS, &right), Ok(request("robot2")));
    }

    #[test]
    fn wrong_codes_are_counted_and_the_right_one_is_void_after_too_many() {
        let (mut one, now) = invitation();
        let (wrong, right) = (said(&code(8), "robot2"), said(&code(7), "robot2"));
        for _ in 0..ATTEMPTS {
            assert!(!one.is_void());
            assert_eq!(one.judge(now, &OURS, &wrong), Err(Refusal::WrongCode));
        }
        assert!(one.is_void());
        assert_eq!(one.judge(now, &OURS, &right), Err(Refusal::TooMany));
    }

    #[test]
    fn what_was_recorded_or_changed_is_worth_nothing() {
        let (mut one, now) = invitation();
        let right = said(&code(7), "robot2");
        assert_eq!(one.judge(now, &[9; NONCE], &right), Err(Refusal::WrongCode));
        let other =
            Said { request: br#"{"name":"robot2","request":"b"}"#.to_vec(), ..right.clone() };
        assert_eq!(one.judge(now, &OURS, &other), Err(Refusal::WrongCode));
        let mirrored = Said { proof: code(7).prove(Side::Authority, &[&OURS]).to_vec(), ..right };
        assert_eq!(one.judge(now, &OURS, &mirrored), Err(Refusal::WrongCode));
    }

    #[test]
    fn an_admission_is_believed_only_from_who_knows_the_code() {
        let (one, _) = invitation();
        let text = || "x".to_owned();
        let admission = Admission { certificate: text(), authority: text(), roster: text() };
        let right = said(&code(7), "robot2");
        let answer = one.answer(&OURS, &right, &admission);
        let (body, proof) = answer[5..].split_at(answer.len() - 5 - PROOF);
        assert_eq!(right.admitted(&code(7), &OURS, body, proof), Ok(admission));
        assert!(right.admitted(&code(8), &OURS, body, proof).is_err());
        assert!(right.admitted(&code(7), &[9; NONCE], body, proof).is_err());
        let mut changed = body.to_vec();
        changed[0] ^= 1;
        assert!(right.admitted(&code(7), &OURS, &changed, proof).is_err());
    }

    #[test]
    fn what_is_said_is_read_however_it_arrives_and_no_longer_than_it_may_be() {
        let right = said(&code(7), "robot2");
        let bytes = right.bytes();
        for count in 0..bytes.len() {
            assert_eq!(Said::read(&bytes[..count]), Ok(None));
        }
        assert_eq!(Said::read(&bytes), Ok(Some(right)));
        assert_eq!(Said::read(&[&*bytes, &[0]].concat()), Err(Refusal::Unreadable));
        assert_eq!(Said::read(&[255; 36]), Err(Refusal::Unreadable));
        for refusal in REFUSALS {
            assert_eq!(Refusal::of_number(refusal.number()), Some(refusal));
        }
        assert_eq!((Refusal::of_number(0), Refusal::of_number(99)), (None, None));
    }
}
