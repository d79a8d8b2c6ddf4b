//! Frames with changes: the same ones on each run. They are frames or errors, and reading them takes
//! memory in proportion to the bytes that are there.
//!
//! `fuzz/` looks for more with the same function, for as long as it runs.

#[path = "common/frames.rs"]
mod common;

use allocation_counter::measure;
use hprm_core::{ChannelId, FederateId, ObjectRef, Part, Payload, PhysicalTime, Tag};
use hprm_federated::codec::{self, CodecError, Decoded, Decoder};
use hprm_federated::{
    Attempt, Count, FederationId, Frame, HostId, PROTOCOL, Peer, Posting, Refusal, Step, Tally,
};

/// How many texts are made.
const ROUNDS: usize = 60_000;

/// How much memory a byte may take while frames are read, and how much they take in any case.
const PER_BYTE: u64 = 64;
const IN_ANY_CASE: u64 = 16 * 1024;

/// Numbers that are the same on each run (xorshift).
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        usize::try_from(self.0 >> 33).unwrap_or(0) % end.max(1)
    }

    fn byte(&mut self) -> u8 {
        // What means something to lengths is more frequent than other values.
        const EXTREMES: [u8; 6] = [0, 1, 0x7f, 0x80, 0xfe, 0xff];
        match self.below(3) {
            0 => EXTREMES[self.below(EXTREMES.len())],
            _ => u8::try_from(self.below(256)).unwrap_or(0),
        }
    }
}

fn message(parts: Vec<Part>) -> Frame {
    let payload = Payload { head: vec![1, 2, 3], parts, physical: false };
    Frame::Message { channel: ChannelId(0), tag: Tag::new(5, 0), payload }
}

/// One frame of each kind that carries something of a variable length, and some others.
fn samples() -> Vec<Frame> {
    let (owner, reader, federate) = (FederateId(0), FederateId(1), FederateId(1));
    let tag = Tag::new(1_000, 1);
    let next = Step { tag, level: 3 };
    let tallies = vec![Tally { messages: 4, latest: tag, life: 0 }; 5];
    let posting =
        Posting { next, waits: Step::NEVER, departs: false, ended: false, life: 0, tallies };
    let object = ObjectRef { owner, serial: 3, segment: 1, offset: 4096, len: 100_000 };
    let peer = |id| Peer {
        federate: FederateId(id),
        incarnation: 1,
        life: 1,
        host: HostId(7),
        listen: Some("unix:@here".to_owned()),
    };
    vec![
        Frame::Hello {
            protocol: PROTOCOL,
            federation: FederationId(1),
            fingerprint: 9,
            federate,
            host: HostId(1),
            listen: Some("tcp:127.0.0.1:1".to_owned()),
            attempt: Attempt { process: 1 << 40, number: 2 },
            launched: true,
        },
        Frame::Refused { reason: Refusal::TooLate },
        Frame::Refused {
            reason: Refusal::WrongProgram { differences: vec!["timer a.t differs".to_owned(); 3] },
        },
        Frame::ProgramRequest,
        Frame::ProgramReply {
            name: "a".to_owned(),
            facts: common::program().fingerprint().report(),
        },
        Frame::Peers { peers: (0..3).map(peer).collect(), boards: true },
        Frame::PeerHello { protocol: PROTOCOL, federation: FederationId(1), from: owner },
        Frame::Posting { owner, reader, posting },
        Frame::Start { at: PhysicalTime(50), first: Tag::START },
        Frame::NextEventTag { tag },
        Frame::NextEventLevel { step: next, received: 9 },
        Frame::TagAdvanceGrant { tag },
        Frame::DownstreamNextEventTag { tag, sent: 7 },
        Frame::LatestTagConfirmed { tag },
        message(vec![]),
        // It travels in chunks.
        message(vec![Part::Inline(vec![7; 300]), Part::Inline(vec![8; 300_000])]),
        message(vec![Part::Inline(vec![7; 300]), Part::Object(object), Part::Inline(vec![])]),
        Frame::Segment { owner, reader, segment: 1, len: 1 << 24 },
        Frame::Retired { owner, reader, segments: vec![1, 2, 3] },
        Frame::Release { owner, reader, serials: (0..40).collect() },
        Frame::Processed { channel: ChannelId(0), messages: 3, bytes: 4_000 },
        Frame::StopRequest { tag },
        Frame::Progress {
            next: Step { tag, level: 0 },
            counts: vec![Count { channel: ChannelId(0), messages: 4 }; 5],
        },
        Frame::Failed { federate, message: "it could not".to_owned(), code: 3 },
        Frame::Ping,
    ]
}

/// Some frames in a row, with changes.
fn mutated(numbers: &mut Numbers, samples: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for _ in 0..=numbers.below(4) {
        bytes.extend_from_slice(&samples[numbers.below(samples.len())]);
    }
    for _ in 0..numbers.below(5) {
        let at = numbers.below(bytes.len());
        match numbers.below(4) {
            0 | 1 => bytes[at] = numbers.byte(),
            2 => drop(bytes.drain(at..(at + 1 + numbers.below(9)).min(bytes.len()))),
            _ => drop(bytes.splice(at..at, (0..=numbers.below(9)).map(|_| numbers.byte()))),
        }
        if bytes.is_empty() {
            bytes.push(numbers.byte());
        }
    }
    bytes
}

fn encoded(frame: &Frame) -> Vec<u8> {
    let mut bytes = Vec::new();
    codec::encode(frame, &mut bytes).unwrap();
    bytes
}

#[test]
fn bytes_with_changes_are_frames_or_errors() {
    let samples: Vec<_> = samples().iter().map(encoded).collect();
    let program = common::program();
    let mut numbers = Numbers(0x9E37_79B9_7F4A_7C15);
    let mut read = 0;
    for _ in 0..ROUNDS {
        let frames = common::frames(&mutated(&mut numbers, &samples));
        read += frames.len();
        common::tell(&program, frames);
    }
    // Otherwise this would be about errors alone.
    assert!(read > ROUNDS / 2, "only {read} frames in {ROUNDS} texts");
}

#[test]
fn reading_takes_no_more_memory_than_there_are_bytes() {
    let samples: Vec<_> = samples().iter().map(encoded).collect();
    let mut numbers = Numbers(0x2545_F491_4F6C_DD1D);
    for _ in 0..ROUNDS / 4 {
        let bytes = mutated(&mut numbers, &samples);
        let taken = measure(|| drop(codec::decode(&bytes))).bytes_max;
        let limit = IN_ANY_CASE + PER_BYTE * bytes.len() as u64;
        assert!(taken <= limit, "{} bytes took {taken}: {bytes:?}", bytes.len());
    }
}

#[test]
fn a_sender_that_claims_much_and_sends_little_gets_no_memory() {
    for kind in 0..5 {
        for claimed in [1_u32 << 10, 1 << 20, 16 << 20, 1 << 30] {
            let mut bytes = claimed.to_le_bytes().to_vec();
            bytes.push(kind);
            bytes.extend([0xff; 64]);
            let mut found = None;
            let taken = measure(|| found = Some(Decoder::default().next(&bytes))).bytes_max;
            assert_eq!(taken, 0, "{claimed} bytes were claimed");
            let answered =
                matches!(found, Some(Ok(Decoded::Missing(_)) | Err(CodecError::TooLong { .. })));
            assert!(answered, "{found:?}");
        }
    }
}

/// The frames with which a message in chunks begins, with its chunks missing.
#[test]
fn a_sender_that_announces_a_long_message_and_sends_none_gets_no_memory() {
    let bytes = encoded(&message(vec![Part::Inline(vec![0; 1 << 20])]));
    let envelope = u32::from_le_bytes(*bytes.first_chunk().unwrap()) as usize + 4;
    for sent in [envelope, envelope + 100, bytes.len() - 1] {
        let taken = measure(|| assert_eq!(codec::decode(&bytes[..sent]), Ok(None))).bytes_max;
        assert!(taken <= 2 * sent as u64 + IN_ANY_CASE, "{sent} bytes took {taken}");
    }
}
