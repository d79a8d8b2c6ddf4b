//! The handshake of a link: both ends prove that they know the federation's secret.
//!
//! ```text
//! opener                                   acceptor
//!   magic, nonce (40 bytes)  ------------>
//!                            <------------  magic, nonce (40 bytes)
//!   proof (32 bytes)         ------------>
//!                            <------------  1, proof (33 bytes), or 0 and nothing more to come
//! ```
//!
//! A proof is an HMAC-SHA256, keyed with the secret, of the role of the end that proves, what the link is
//! for, the channel below (with TLS, what only its two ends know), and both nonces. So a recorded
//! proof is worth nothing, and neither is a proof that is sent back to its sender. The opener proves first:
//! an unauthenticated client learns only that a process listens. All lengths are fixed, and no frame is
//! decoded before this is over.
//!
//! This file is the machine, which reads no socket; a [`StreamLink`](super::stream_link::StreamLink) moves its
//! bytes.

use hmac::{Hmac, Mac};
use hprm_federated::FederationId;
use sha2::Sha256;

/// What each side starts with: the protocol and its version.
const MAGIC: [u8; 8] = *b"HPRM-L01";
const NONCE: usize = 32;
const PROOF: usize = 32;
const HELLO: usize = MAGIC.len() + NONCE;
const VERDICT: usize = 1 + PROOF;

/// The most bytes that one step takes.
pub(crate) const LONGEST: usize = HELLO;

/// A number that is never used again.
pub(crate) type Nonce = [u8; NONCE];

/// What a link is for: a proof for one purpose is none for another.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Purpose {
    /// From a federate to the RTI.
    Coordination,
    /// From a federate to another.
    Messages,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Role {
    /// The end that has connected.
    Opener,
    /// The end that has listened.
    Acceptor,
}

/// Why one of the ends refuses the other.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub(crate) enum Refused {
    /// It does not speak this protocol.
    #[error(
        "the other end does not prove that it belongs to the federation: is `auth` the same everywhere, and the version of hprm?"
    )]
    OtherProtocol,
    /// It speaks TLS, and this end does not.
    #[error(
        "the other end uses TLS, and this process has no certificate: name the files with --tls-cert, \
         --tls-key and --tls-ca"
    )]
    Encrypted,
    /// Its proof is wrong.
    #[error(
        "the other end does not know the secret of this federation: check what --federation-file names \
         at both ends"
    )]
    WrongProof,
    /// It refuses the proof of this end.
    #[error(
        "the other end refuses this process: the secret is that of another federation, so check what \
         --federation-file names"
    )]
    ByOther,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Step {
    Hello,
    /// The acceptor waits for the proof of the opener.
    Proof {
        other: Nonce,
    },
    /// The opener waits for the proof of the acceptor.
    Verdict {
        other: Nonce,
    },
    Done,
    /// What is left to write is a refusal.
    Refusing,
}

/// One side of the handshake.
pub(crate) struct Handshake {
    secret: FederationId,
    role: Role,
    purpose: Purpose,
    nonce: Nonce,
    step: Step,
    inbound: Vec<u8>,
    outbound: Vec<u8>,
}

impl std::fmt::Debug for Handshake {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Handshake({:?}, {:?})", self.role, self.purpose)
    }
}

impl Handshake {
    pub(crate) fn new(secret: FederationId, role: Role, purpose: Purpose, nonce: Nonce) -> Self {
        let mut handshake = Self {
            secret,
            role,
            purpose,
            nonce,
            step: Step::Hello,
            inbound: Vec::with_capacity(LONGEST),
            outbound: Vec::new(),
        };
        if role == Role::Opener {
            handshake.greet();
        }
        handshake
    }

    /// How many bytes the step under way still needs.
    pub(crate) fn wanted(&self) -> usize {
        let whole = match self.step {
            Step::Hello => HELLO,
            Step::Proof { .. } => PROOF,
            Step::Verdict { .. } => VERDICT,
            Step::Done | Step::Refusing => 0,
        };
        whole.saturating_sub(self.inbound.len())
    }

    /// Takes bytes, no more than are wanted. `channel` tells what only the two ends of the channel
    /// below know, if there is such a thing.
    pub(crate) fn take(
        &mut self,
        bytes: &[u8],
        channel: impl FnOnce() -> Vec<u8>,
    ) -> Result<(), Refused> {
        debug_assert!(bytes.len() <= self.wanted(), "no more than the handshake wants");
        self.inbound.extend_from_slice(bytes);
        // A process that does not speak this protocol is refused before the rest arrives.
        let seen = self.inbound.len().min(MAGIC.len());
        if self.step == Step::Hello && self.inbound[..seen] != MAGIC[..seen] {
            self.step = Step::Refusing;
            if !is_tls(&self.inbound) {
                return Err(Refused::OtherProtocol);
            }
            if self.role == Role::Acceptor {
                // The answer tells the other end that this is not TLS; closing the link would not.
                self.outbound.extend_from_slice(&MAGIC);
            }
            return Err(Refused::Encrypted);
        }
        if self.wanted() > 0 {
            return Ok(());
        }
        let inbound = std::mem::take(&mut self.inbound);
        match self.step {
            Step::Hello => {
                let mut other = [0; NONCE];
                other.copy_from_slice(&inbound[MAGIC.len()..]);
                self.step = match self.role {
                    Role::Acceptor => {
                        self.greet();
                        Step::Proof { other }
                    }
                    Role::Opener => {
                        let proof = self.mac(Role::Opener, &other, &channel());
                        self.outbound.extend_from_slice(&proof.finalize().into_bytes());
                        Step::Verdict { other }
                    }
                };
                Ok(())
            }
            Step::Proof { other } => self.judge(&inbound, &other, &channel()),
            Step::Verdict { other } => {
                if inbound[0] != 1 {
                    self.step = Step::Refusing;
                    return Err(Refused::ByOther);
                }
                self.check(Role::Acceptor, &inbound[1..], &other, &channel())?;
                self.step = Step::Done;
                Ok(())
            }
            Step::Done | Step::Refusing => Ok(()),
        }
    }

    /// Whether the other end has begun as this protocol does.
    pub(crate) fn is_greeted(&self) -> bool {
        !matches!(self.step, Step::Hello | Step::Refusing)
    }

    /// What is to be written.
    pub(crate) fn outbound(&self) -> &[u8] {
        &self.outbound
    }

    /// The first `count` of those bytes have left.
    pub(crate) fn sent(&mut self, count: usize) {
        self.outbound.drain(..count);
    }

    /// Whether both ends have proved themselves, and nothing is left to be written.
    pub(crate) fn is_over(&self) -> bool {
        self.step == Step::Done && self.outbound.is_empty()
    }

    fn greet(&mut self) {
        self.outbound.extend_from_slice(&MAGIC);
        self.outbound.extend_from_slice(&self.nonce);
    }

    /// The acceptor's verdict on the opener.
    fn judge(&mut self, proof: &[u8], other: &Nonce, channel: &[u8]) -> Result<(), Refused> {
        if let Err(refused) = self.check(Role::Opener, proof, other, channel) {
            self.outbound.extend_from_slice(&[0; VERDICT]);
            return Err(refused);
        }
        let proof = self.mac(Role::Acceptor, other, channel).finalize().into_bytes();
        self.outbound.push(1);
        self.outbound.extend_from_slice(&proof);
        self.step = Step::Done;
        Ok(())
    }

    /// Compares in a time that does not depend on where the difference is.
    fn check(
        &mut self,
        of: Role,
        proof: &[u8],
        other: &Nonce,
        channel: &[u8],
    ) -> Result<(), Refused> {
        let right = self.mac(of, other, channel).verify_slice(proof).is_ok();
        if !right {
            self.step = Step::Refusing;
            return Err(Refused::WrongProof);
        }
        Ok(())
    }

    fn mac(&self, of: Role, other: &Nonce, channel: &[u8]) -> Hmac<Sha256> {
        let (opener, acceptor) = match self.role {
            Role::Opener => (&self.nonce, other),
            Role::Acceptor => (other, &self.nonce),
        };
        let mut mac = keyed(self.secret);
        mac.update(&MAGIC);
        mac.update(match of {
            Role::Opener => b"opener  ",
            Role::Acceptor => b"acceptor",
        });
        mac.update(match self.purpose {
            Purpose::Coordination => b"rti ",
            Purpose::Messages => b"peer",
        });
        mac.update(&[u8::from(!channel.is_empty())]);
        mac.update(channel);
        mac.update(opener);
        mac.update(acceptor);
        mac
    }
}

/// Whether these bytes begin a record of TLS: a kind, from 20 to 23, and the major version.
fn is_tls(bytes: &[u8]) -> bool {
    bytes.first().is_some_and(|kind| (20..=23).contains(kind))
        && bytes.get(1).is_none_or(|major| *major == 3)
}

/// The name under which members know their federation. It is sent in frames, so it does not tell the
/// secret.
pub(crate) fn name_of(secret: FederationId) -> FederationId {
    let mut mac = keyed(secret);
    mac.update(b"HPRM federation");
    let digest = mac.finalize().into_bytes();
    let mut name = [0; 16];
    name.copy_from_slice(&digest[..16]);
    FederationId(u128::from_be_bytes(name))
}

fn keyed(secret: FederationId) -> Hmac<Sha256> {
    Hmac::new_from_slice(&secret.0.to_be_bytes()).expect("an HMAC takes keys of any length")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SECRET: FederationId = FederationId(0x1234_5678_9abc_def0);

    fn opener(secret: FederationId, purpose: Purpose) -> Handshake {
        Handshake::new(secret, Role::Opener, purpose, [1; NONCE])
    }

    fn acceptor(nonce: u8) -> Handshake {
        Handshake::new(SECRET, Role::Acceptor, Purpose::Coordination, [nonce; NONCE])
    }

    /// Moves the bytes that `from` sends to `to`, in pieces of `size`. Returns the bytes.
    fn hand(
        from: &mut Handshake,
        to: &mut Handshake,
        size: usize,
        channel: &[u8],
    ) -> Result<Vec<u8>, Refused> {
        let bytes = from.outbound().to_vec();
        from.sent(bytes.len());
        for piece in bytes.chunks(size) {
            to.take(piece, || channel.to_vec())?;
        }
        Ok(bytes)
    }

    fn meet(a: &mut Handshake, b: &mut Handshake, size: usize) -> Result<Vec<Vec<u8>>, Refused> {
        let mut said = Vec::new();
        for _ in 0..2 {
            said.push(hand(a, b, size, b"")?);
            said.push(hand(b, a, size, b"")?);
        }
        Ok(said)
    }

    #[test]
    fn a_process_with_the_secret_is_accepted_however_its_bytes_arrive() {
        for size in 1..=LONGEST {
            let (mut a, mut b) = (opener(SECRET, Purpose::Coordination), acceptor(2));
            meet(&mut a, &mut b, size).unwrap();
            assert!(a.is_over() && b.is_over());
        }
    }

    #[test]
    fn another_secret_or_purpose_is_refused_by_the_acceptor_and_said_so() {
        for mut a in
            [opener(FederationId(1), Purpose::Coordination), opener(SECRET, Purpose::Messages)]
        {
            let mut b = acceptor(2);
            assert_eq!(meet(&mut a, &mut b, 9), Err(Refused::WrongProof));
            assert_eq!(hand(&mut b, &mut a, 9, b""), Err(Refused::ByOther));
            assert!(!a.is_over() && !b.is_over());
        }
    }

    #[test]
    fn an_acceptor_that_does_not_know_the_secret_is_not_believed() {
        let mut a = opener(SECRET, Purpose::Coordination);
        let mut b = acceptor(2);
        hand(&mut a, &mut b, 40, b"").unwrap();
        hand(&mut b, &mut a, 40, b"").unwrap();
        let mut verdict = vec![1];
        verdict.extend([7; PROOF]);
        assert_eq!(a.take(&verdict, Vec::new), Err(Refused::WrongProof));
        assert!(!a.is_over());
    }

    #[test]
    fn a_recorded_handshake_is_worth_nothing() {
        let (mut a, mut b) = (opener(SECRET, Purpose::Coordination), acceptor(2));
        let said = meet(&mut a, &mut b, 40).unwrap();
        let mut again = acceptor(3);
        again.take(&said[0], Vec::new).unwrap();
        assert_eq!(again.take(&said[2], Vec::new), Err(Refused::WrongProof));
    }

    #[test]
    fn one_s_own_words_sent_back_prove_nothing() {
        // The opener is its own acceptor: it gets its hello, then its proof.
        let mut a = opener(SECRET, Purpose::Coordination);
        let hello = a.outbound().to_vec();
        a.sent(hello.len());
        a.take(&hello, Vec::new).unwrap();
        let mut verdict = vec![1];
        verdict.extend(a.outbound());
        assert_eq!(a.take(&verdict, Vec::new), Err(Refused::WrongProof));
    }

    #[test]
    fn the_ends_of_two_channels_do_not_meet() {
        let (mut a, mut b) = (opener(SECRET, Purpose::Coordination), acceptor(2));
        hand(&mut a, &mut b, 40, b"").unwrap();
        hand(&mut b, &mut a, 40, b"one channel").unwrap();
        assert_eq!(hand(&mut a, &mut b, 40, b"another"), Err(Refused::WrongProof));
    }

    #[test]
    fn the_name_of_a_federation_does_not_tell_its_secret() {
        assert_ne!(name_of(SECRET), SECRET);
        assert_ne!(name_of(SECRET), name_of(FederationId(1)));
    }

    proptest! {
        #[test]
        fn an_unauthenticated_client_is_refused_whatever_it_sends(
            bytes in prop::collection::vec(any::<u8>(), 0..200),
            greets in any::<bool>(),
        ) {
            let mut b = acceptor(2);
            let bytes = if greets { [MAGIC.to_vec(), bytes].concat() } else { bytes };
            let mut rest = bytes.as_slice();
            while !rest.is_empty() && b.wanted() > 0 {
                let (piece, after) = rest.split_at(b.wanted().min(rest.len()));
                rest = after;
                if b.take(piece, Vec::new).is_err() {
                    break;
                }
            }
            let said = b.outbound().len();
            b.sent(said);
            prop_assert!(!b.is_over());
        }
    }
}
