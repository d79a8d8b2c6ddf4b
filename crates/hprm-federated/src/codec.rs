//! Frames as bytes: a length, then the body.
//!
//! ```text
//! frame    = length:u32 (little endian, of the body)  body
//! body     = 0  postcard(Frame)                       every frame but a message
//!          | 1  postcard(Envelope)  head  part*       a message with parts; the bytes of its payload as they are
//!          | 2  postcard(Envelope)                    a long message; its chunks follow
//!          | 3  bytes                                 a chunk of a long message
//!          | 4  channel, tag, physical  head          a message without parts
//! ```
//!
//! A long message is an envelope and then, with nothing in between, chunks: frames with its bytes in order.
//! Decoding any bytes gives a frame, an error, or the number of bytes that are missing; it never panics
//! and allocates no more than the bytes at hand justify. Where there is no memory for a message, that is
//! an error, at both ends. The driver reads and writes links.

mod chunks;
mod plain;

use hprm_core::limits::FRAME_LIMIT;
use hprm_core::{
    ChannelId, FederateId, NoMemory, ObjectRef, Part, Payload, Shipment, Tag, copy_of,
};
use serde::{Deserialize, Serialize};

use crate::FederationId;
use crate::frame::{Attempt, Frame, HostId, PROTOCOL};
pub use chunks::Outgoing;
use chunks::{CHUNK_LIMIT, Incoming};

/// Bytes of the length field.
const LENGTH: usize = 4;

/// The longest body of a frame that is no message, in bytes: room for the largest federation's
/// list of peers.
const CONTROL_LIMIT: usize = 16 << 20;

/// The most bytes of an envelope without its part headers, the length of its frame included.
const ENVELOPE_BASE: usize = 64;

/// The most bytes of a [`PartHeader`].
const PART_HEADER: usize = 48;

/// The most parts of a payload.
pub const PARTS_LIMIT: usize = (FRAME_LIMIT - CHUNK_LIMIT - ENVELOPE_BASE) / PART_HEADER;

const CONTROL: u8 = 0;
const MESSAGE: u8 = 1;
const LONG_MESSAGE: u8 = 2;
const MESSAGE_CHUNK: u8 = 3;
const PLAIN_MESSAGE: u8 = 4;

/// Why bytes cannot be decoded as a frame. What follows them on the link is meaningless.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CodecError {
    /// The frame claims to be longer than any frame may be.
    #[error("a frame of {len} bytes is longer than the limit of {limit}")]
    TooLong {
        /// Its length.
        len: usize,
        /// The limit for its kind.
        limit: usize,
    },
    /// The body is no frame of this protocol.
    #[error("the bytes are not a frame: is the other side another program or version?")]
    Malformed,
    /// The body goes on after the frame.
    #[error("{0} bytes too many in a frame")]
    Trailing(usize),
    /// The frame is valid, but there is no memory for it here.
    #[error("no memory is left for {0} bytes of a message")]
    NoMemory(usize),
}

/// What the decoder has found at the start of a buffer.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Decoded {
    /// A whole frame, and its length in bytes.
    Frame(Frame, usize),
    /// A chunk of a long message, or its envelope. The decoder keeps it until the message is complete.
    Chunk {
        /// The length of the frame that holds the chunk, in bytes.
        taken: usize,
        /// The length of the payload of the whole message.
        message_len: usize,
    },
    /// The start of a frame, and how many more bytes are needed at least.
    Missing(usize),
}

/// Reads the frames of a link, in order.
#[derive(Debug, Default)]
pub struct Decoder {
    /// The message whose chunks come now.
    incoming: Option<Box<Incoming>>,
}

/// A message without the bytes of its payload: those follow it.
#[derive(Debug, Serialize, Deserialize)]
struct Envelope {
    channel: ChannelId,
    tag: Tag,
    head: u64,
    parts: Vec<PartHeader>,
    physical: bool,
}

/// What the envelope says of a part of a payload: the length of an inline part, the reference to an object, or the name
/// of a shipment.
#[derive(Debug, Serialize, Deserialize)]
enum PartHeader {
    Inline(u64),
    Object(ObjectRef),
    Shipped(Shipment),
}

/// Whether a message with this payload can be sent: its envelope has to fit into a frame.
#[must_use]
pub fn fits(payload: &Payload) -> bool {
    payload.parts.len() <= PARTS_LIMIT
}

/// Whether a message with this payload travels in chunks.
fn is_long(payload: &Payload) -> bool {
    inline_len(payload) > CHUNK_LIMIT
}

/// The most bytes of an envelope with that many part headers, the length of its frame included.
fn max_envelope_len(parts: usize) -> usize {
    ENVELOPE_BASE.saturating_add(parts.saturating_mul(PART_HEADER))
}

/// Appends `frame` to `out`, with all of its chunks if it is a long message.
///
/// # Errors
///
/// If there is no memory for it; `out` has not changed.
///
/// # Panics
///
/// If the frame is longer than a frame may be: ask [`fits`] before making a message.
pub fn encode(frame: &Frame, out: &mut Vec<u8>) -> Result<(), CodecError> {
    let Frame::Message { channel, tag, payload } = frame else {
        let start = begin(CONTROL, out);
        append(frame, out);
        let len = end(start, out);
        assert!(len <= CONTROL_LIMIT, "a {} of {len} bytes exceeds its limit", frame.name());
        return Ok(());
    };
    if plain::is_plain(payload) {
        return plain::append(*channel, *tag, payload, out);
    }
    assert!(fits(payload), "the envelope of a message exceeds the limit of a frame");
    let envelope = Envelope::of(*channel, *tag, payload);
    // Each frame adds its length and its kind. A chunk ends at the limit, or where a buffer ends.
    let len = inline_len(payload);
    let max_frames = payload.parts.len() + 1 + len / CHUNK_LIMIT;
    reserve(out, envelope.max_len() + len + max_frames * (LENGTH + 1))?;
    let is_long = len > CHUNK_LIMIT;
    let start = begin(if is_long { LONG_MESSAGE } else { MESSAGE }, out);
    append(&envelope, out);
    if is_long {
        end(start, out);
        let chunks = buffers_of(payload).flat_map(|bytes| bytes.chunks(CHUNK_LIMIT));
        return chunks.into_iter().try_for_each(|bytes| chunks::append_chunk(bytes, out));
    }
    buffers_of(payload).for_each(|bytes| out.extend_from_slice(bytes));
    end(start, out);
    Ok(())
}

/// Begins a frame, whose length is not known yet. Returns where it begins.
fn begin(kind: u8, out: &mut Vec<u8>) -> usize {
    let start = out.len();
    out.extend_from_slice(&[0; LENGTH]);
    out.push(kind);
    start
}

/// Ends the frame that was begun there. Returns the length of its body.
fn end(start: usize, out: &mut [u8]) -> usize {
    let len = out.len() - start - LENGTH;
    let length = u32::try_from(len).expect("the limit of a frame is below 4 GiB");
    out[start..start + LENGTH].copy_from_slice(&length.to_le_bytes());
    len
}

fn reserve(out: &mut Vec<u8>, more: usize) -> Result<(), CodecError> {
    out.try_reserve(more).map_err(|_| CodecError::NoMemory(more))
}

/// The bytes of a payload that travel in its frame, in order.
pub fn buffers_of(payload: &Payload) -> impl Iterator<Item = &[u8]> {
    let parts = payload.parts.iter().filter_map(|part| match part {
        Part::Inline(bytes) => Some(bytes.as_slice()),
        Part::Object(_) | Part::Shipped(_) => None,
    });
    std::iter::once(payload.head.as_slice()).chain(parts)
}

/// The frame at the start of `buffer` and the number of its bytes, or none if it is incomplete.
///
/// # Errors
///
/// If no continuation of these bytes is a frame; the link must be closed.
pub fn decode(buffer: &[u8]) -> Result<Option<(Frame, usize)>, CodecError> {
    let mut decoder = Decoder::default();
    let mut before = 0;
    loop {
        match decoder.next(&buffer[before..])? {
            Decoded::Frame(frame, len) => return Ok(Some((frame, before + len))),
            Decoded::Chunk { taken, .. } => before += taken,
            Decoded::Missing(_) => return Ok(None),
        }
    }
}

impl Decoder {
    /// The plain message at the start of `buffer`, which most frames are, and the length of its frame. If that is anything
    /// else, or not all of it is there, or wrong, [`next`](Self::next) tells what it is.
    #[inline]
    pub fn next_plain(&self, buffer: &[u8]) -> Option<(Frame, usize)> {
        let (length, rest) = buffer.split_first_chunk::<LENGTH>()?;
        let len = u32::from_le_bytes(*length) as usize;
        if rest.first() != Some(&PLAIN_MESSAGE) || len > FRAME_LIMIT || self.incoming.is_some() {
            return None;
        }
        Some((plain::message(rest.get(1..len)?).ok()?, LENGTH + len))
    }

    /// Decodes the next frame, or the next chunk of a long message. `buffer` has the next bytes of the link. The
    /// caller removes the decoded bytes from it, and appends what is missing.
    ///
    /// # Errors
    ///
    /// If no continuation of these bytes is a frame, or if there is no memory for it; the link must be
    /// closed.
    pub fn next(&mut self, buffer: &[u8]) -> Result<Decoded, CodecError> {
        let body = match body(buffer)? {
            Ok(body) => body,
            Err(missing) => return Ok(Decoded::Missing(missing)),
        };
        let taken = LENGTH + body.len();
        let (frame, trailing) = match (body, &mut self.incoming) {
            ([MESSAGE_CHUNK, bytes @ ..], Some(incoming)) if !bytes.is_empty() => {
                let message_len = incoming.len();
                if !incoming.take(bytes)? {
                    return Ok(Decoded::Chunk { taken, message_len });
                }
                let complete = self.incoming.take().map(|incoming| incoming.finish());
                (complete.ok_or(CodecError::Malformed)?, 0)
            }
            // Nothing else comes before the message is complete.
            (_, Some(_)) => return Err(CodecError::Malformed),
            ([CONTROL, body @ ..], None) => control(body)?,
            ([PLAIN_MESSAGE, body @ ..], None) => {
                return plain::message(body).map(|frame| Decoded::Frame(frame, taken));
            }
            ([MESSAGE, body @ ..], None) => message(body)?,
            ([LONG_MESSAGE, body @ ..], None) => {
                let (envelope, rest) = envelope(body)?;
                if !rest.is_empty() {
                    return Err(CodecError::Trailing(rest.len()));
                }
                let incoming = Incoming::new(envelope)?;
                let message_len = incoming.len();
                self.incoming = Some(Box::new(incoming));
                return Ok(Decoded::Chunk { taken, message_len });
            }
            _ => return Err(CodecError::Malformed),
        };
        if trailing > 0 {
            return Err(CodecError::Trailing(trailing));
        }
        Ok(Decoded::Frame(frame, taken))
    }
}

/// The body of the frame at the start of a buffer, or how many bytes it lacks.
fn body(buffer: &[u8]) -> Result<Result<&[u8], usize>, CodecError> {
    let Some((length, rest)) = buffer.split_first_chunk::<LENGTH>() else {
        return Ok(Err(LENGTH + 1 - buffer.len()));
    };
    let len = u32::from_le_bytes(*length) as usize;
    let limit = match rest.first() {
        Some(&CONTROL) => CONTROL_LIMIT,
        Some(&(MESSAGE | LONG_MESSAGE | MESSAGE_CHUNK | PLAIN_MESSAGE)) | None => FRAME_LIMIT,
        Some(_) => return Err(CodecError::Malformed),
    };
    if len > limit {
        return Err(CodecError::TooLong { len, limit });
    }
    if len == 0 {
        return Err(CodecError::Malformed);
    }
    Ok(rest.get(..len).ok_or(len - rest.len().min(len)))
}

fn control(body: &[u8]) -> Result<(Frame, usize), CodecError> {
    match postcard::take_from_bytes(body) {
        // A message has a body of its own kind.
        Ok((Frame::Message { .. }, _)) => Err(CodecError::Malformed),
        Ok((frame, [])) => Ok((frame, 0)),
        other => match hello_of_another_version(body) {
            Some(hello) => Ok((hello, 0)),
            None => {
                other.map(|(frame, rest)| (frame, rest.len())).map_err(|_| CodecError::Malformed)
            }
        },
    }
}

/// The first frame of a federate of another version, whose form may differ behind what all versions begin with. The RTI
/// refuses it because of its protocol, and needs no more of it.
fn hello_of_another_version(body: &[u8]) -> Option<Frame> {
    #[derive(Deserialize)]
    enum First {
        Hello { protocol: u32, federation: FederationId, fingerprint: u64, federate: FederateId },
    }
    let (First::Hello { protocol, federation, fingerprint, federate }, _) =
        postcard::take_from_bytes(body).ok()?;
    (protocol != PROTOCOL).then_some(Frame::Hello {
        protocol,
        federation,
        fingerprint,
        federate,
        host: HostId(0),
        listen: None,
        attempt: Attempt { process: 0, number: 0 },
        launched: false,
    })
}

fn message(body: &[u8]) -> Result<(Frame, usize), CodecError> {
    let (envelope, mut rest) = envelope(body)?;
    let mut take = |len: u64| {
        let len = usize::try_from(len).map_err(|_| CodecError::Malformed)?;
        let (bytes, after) = rest.split_at_checked(len).ok_or(CodecError::Malformed)?;
        rest = after;
        copy_of(bytes).map_err(|NoMemory(len)| CodecError::NoMemory(len))
    };
    let head = take(envelope.head)?;
    let parts = envelope
        .parts
        .into_iter()
        .map(|header| match header {
            PartHeader::Inline(len) => take(len).map(Part::Inline),
            PartHeader::Object(object) => Ok(Part::Object(object)),
            PartHeader::Shipped(shipment) => Ok(Part::Shipped(shipment)),
        })
        .collect::<Result<_, _>>()?;
    let payload = Payload { head, parts, physical: envelope.physical };
    Ok((Frame::Message { channel: envelope.channel, tag: envelope.tag, payload }, rest.len()))
}

fn envelope(body: &[u8]) -> Result<(Envelope, &[u8]), CodecError> {
    postcard::take_from_bytes(body).map_err(|_| CodecError::Malformed)
}

impl Envelope {
    fn of(channel: ChannelId, tag: Tag, payload: &Payload) -> Self {
        let parts = payload.parts.iter().map(PartHeader::of).collect();
        let (head, physical) = (payload.head.len() as u64, payload.physical);
        Self { channel, tag, head, parts, physical }
    }

    /// The most bytes that it takes, the length of its frame included.
    fn max_len(&self) -> usize {
        max_envelope_len(self.parts.len())
    }
}

impl PartHeader {
    fn of(part: &Part) -> Self {
        match part {
            Part::Inline(bytes) => Self::Inline(bytes.len() as u64),
            Part::Object(object) => Self::Object(*object),
            Part::Shipped(shipment) => Self::Shipped(*shipment),
        }
    }
}

fn inline_len(payload: &Payload) -> usize {
    buffers_of(payload).fold(0, |sum, bytes| sum.saturating_add(bytes.len()))
}

fn append(value: &impl Serialize, out: &mut Vec<u8>) {
    let bytes = postcard::to_extend(value, std::mem::take(out));
    *out = bytes.expect("a frame has no part that postcard cannot write");
}

#[cfg(test)]
mod tests {
    use hprm_core::{Content, Fact, FederateId, PhysicalTime};
    use proptest::prelude::*;

    use super::*;
    use crate::{Attempt, Count, FederationId, HostId, Peer, Posting, Refusal, Step, Tally};

    fn tag() -> impl Strategy<Value = Tag> {
        (any::<i64>(), any::<u32>()).prop_map(|(time, microstep)| Tag::new(time, microstep))
    }

    fn part() -> impl Strategy<Value = Part> {
        let object = any::<(u16, u64, u32, u64, u64)>();
        let object = object.prop_map(|(owner, serial, segment, offset, len)| {
            let owner = FederateId(owner);
            Part::Object(ObjectRef { owner, serial, segment, offset, len })
        });
        let shipment = any::<(u64, u64, u64)>();
        let shipment = shipment
            .prop_map(|(stream, number, len)| Part::Shipped(Shipment { stream, number, len }));
        let inline = prop::collection::vec(any::<u8>(), 0..300).prop_map(Part::Inline);
        prop_oneof![inline, object, shipment]
    }

    fn message() -> impl Strategy<Value = Frame> {
        let head = prop::collection::vec(any::<u8>(), 0..300);
        let parts = prop::collection::vec(part(), 0..4);
        (any::<u32>(), tag(), head, parts, any::<bool>()).prop_map(
            |(channel, tag, head, parts, physical)| {
                let payload = Payload { head, parts, physical };
                Frame::Message { channel: ChannelId(channel), tag, payload }
            },
        )
    }

    fn step() -> impl Strategy<Value = Step> {
        (tag(), any::<u32>()).prop_map(|(tag, level)| Step { tag, level })
    }

    fn fact() -> impl Strategy<Value = Fact> {
        let content = prop_oneof![
            any::<String>().prop_map(Content::Text),
            any::<u64>().prop_map(Content::Digest),
            any::<u64>().prop_map(Content::Order),
        ];
        let fact = (any::<String>(), any::<String>(), any::<bool>(), content);
        fact.prop_map(|(subject, place, optional, content)| Fact {
            subject,
            place,
            optional,
            content,
        })
    }

    fn posting() -> impl Strategy<Value = Frame> {
        let tally = (any::<u64>(), tag(), any::<u32>());
        let tally = tally.prop_map(|(messages, latest, life)| Tally { messages, latest, life });
        let parts =
            (step(), step(), any::<(bool, bool, u32)>(), prop::collection::vec(tally, 0..4));
        parts.prop_map(|(next, waits, (departs, ended, life), tallies)| Frame::Posting {
            owner: FederateId(1),
            reader: FederateId(2),
            posting: Posting { next, waits, departs, ended, life, tallies },
        })
    }

    fn frame() -> impl Strategy<Value = Frame> {
        let peer = (any::<u16>(), any::<u32>(), any::<u128>(), any::<Option<String>>());
        let peer = peer.prop_map(|(federate, incarnation, host, listen)| Peer {
            federate: FederateId(federate),
            incarnation,
            life: 3,
            host: HostId(host),
            listen,
        });
        let attempt = any::<(u64, u32)>();
        let attempt = attempt.prop_map(|(process, number)| Attempt { process, number });
        let hello = (any::<(u128, u64, u16)>(), any::<Option<String>>(), attempt);
        let hello = hello.prop_map(|(ids, listen, attempt)| Frame::Hello {
            protocol: 1,
            federation: FederationId(ids.0),
            fingerprint: ids.1,
            federate: FederateId(ids.2),
            host: HostId(3),
            launched: listen.is_none(),
            listen,
            attempt,
        });
        let count = any::<(u32, u64)>()
            .prop_map(|(channel, messages)| Count { channel: ChannelId(channel), messages });
        let release = (any::<u16>(), prop::collection::vec(any::<u64>(), 0..9));
        prop_oneof![
            4 => message(),
            1 => hello,
            1 => prop::collection::vec(peer, 0..4).prop_map(|peers| Frame::Peers { boards: peers.len() > 2, peers }),
            1 => any::<i64>().prop_map(|now| Frame::Ready { now: PhysicalTime(now) }),
            1 => tag().prop_map(|tag| Frame::NextEventTag { tag }),
            1 => (step(), any::<u64>())
                .prop_map(|(step, received)| Frame::NextEventLevel { step, received }),
            1 => step().prop_map(|through| Frame::ProvisionalTagAdvanceGrant { through }),
            1 => (any::<u32>(), tag()).prop_map(|(channel, tag)| Frame::PortAbsent {
                channel: ChannelId(channel),
                tag,
            }),
            1 => (step(), prop::collection::vec(count, 0..4))
                .prop_map(|(next, counts)| Frame::Progress { next, counts }),
            1 => posting(),
            1 => release.prop_map(|(id, serials)| Frame::Release {
                owner: FederateId(id),
                reader: FederateId(1),
                serials,
            }),
            1 => any::<(u16, String, i32)>().prop_map(|(id, message, code)| Frame::Failed {
                federate: FederateId(id),
                message,
                code,
            }),
            1 => any::<[i64; 3]>().prop_map(|[asked, received, sent]| Frame::ClockReply {
                asked: PhysicalTime(asked),
                received: PhysicalTime(received),
                sent: PhysicalTime(sent),
            }),
            1 => any::<(u32, u64, u64)>().prop_map(|(channel, messages, bytes)| {
                Frame::Processed { channel: ChannelId(channel), messages, bytes }
            }),
            1 => Just(Frame::Resign),
            1 => Just(Frame::Refused { reason: Refusal::TooLate }),
            1 => any::<Vec<String>>().prop_map(|differences| Frame::Refused {
                reason: Refusal::WrongProgram { differences },
            }),
            1 => Just(Frame::ProgramRequest),
            1 => (any::<String>(), prop::collection::vec(fact(), 0..4))
                .prop_map(|(name, facts)| Frame::ProgramReply { name, facts }),
        ]
    }

    #[test]
    fn a_federate_of_an_older_version_is_told_apart_by_its_first_frame() {
        // As it was before an attempt had a number: the form ends with the address.
        #[derive(Serialize)]
        enum Older {
            Hello(u32, FederationId, u64, FederateId, HostId, Option<String>),
        }
        let hello = |protocol| {
            let hello = Older::Hello(protocol, FederationId(7), 8, FederateId(1), HostId(9), None);
            let mut bytes = Vec::new();
            let start = begin(CONTROL, &mut bytes);
            append(&hello, &mut bytes);
            end(start, &mut bytes);
            decode(&bytes)
        };
        let Ok(Some((Frame::Hello { protocol, federate, .. }, _))) = hello(PROTOCOL - 1) else {
            panic!("it is no first frame: {:?}", hello(PROTOCOL - 1));
        };
        assert_eq!((protocol, federate), (PROTOCOL - 1, FederateId(1)));
        // One of this version is as it should be, or no frame.
        assert_eq!(hello(PROTOCOL), Err(CodecError::Malformed));
    }

    proptest! {
        #[test]
        fn frames_are_read_as_they_are_written(frames in prop::collection::vec(frame(), 1..5)) {
            let mut bytes = Vec::new();
            frames.iter().for_each(|frame| encode(frame, &mut bytes).unwrap());
            let mut rest = bytes.as_slice();
            for frame in frames {
                let (read, len) = decode(rest).unwrap().unwrap();
                let parts = match &frame {
                    Frame::Message { payload, .. } => Some(payload.parts.len()),
                    _ => None,
                };
                let plain = (parts == Some(0)).then(|| (frame.clone(), len));
                prop_assert_eq!(Decoder::default().next_plain(rest), plain);
                prop_assert_eq!(read, frame);
                rest = &rest[len..];
            }
            prop_assert!(rest.is_empty());
        }

        #[test]
        fn what_is_missing_leads_to_the_frame(frame in frame()) {
            let mut bytes = Vec::new();
            encode(&frame, &mut bytes).unwrap();
            let mut have = 0;
            loop {
                match Decoder::default().next(&bytes[..have]).unwrap() {
                    Decoded::Chunk { .. } => unreachable!("it is short"),
                    Decoded::Missing(more) => {
                        prop_assert!(more > 0 && have + more <= bytes.len());
                        have += more;
                    }
                    Decoded::Frame(read, len) => {
                        prop_assert_eq!((read, len), (frame, bytes.len()));
                        break;
                    }
                }
            }
        }

        #[test]
        fn any_bytes_are_a_frame_or_an_error_or_too_few(
            bytes in prop::collection::vec(any::<u8>(), 0..200),
            kind in 0_u8..5,
        ) {
            let _ = decode(&bytes);
            let mut body = u32::try_from(bytes.len() + 1).unwrap().to_le_bytes().to_vec();
            body.push(kind);
            body.extend(&bytes);
            if let Ok(found) = decode(&body) {
                let (frame, len) = found.expect("all bytes are there");
                prop_assert_eq!(len, body.len());
                let mut again = Vec::new();
                encode(&frame, &mut again).unwrap();
                prop_assert_eq!(decode(&again).unwrap(), Some((frame, again.len())));
            }
        }
    }

    #[test]
    fn lengths_beyond_the_limits_are_errors_at_once() {
        let too_long = |len: usize, kind| {
            let mut bytes = u32::try_from(len).unwrap().to_le_bytes().to_vec();
            bytes.push(kind);
            matches!(decode(&bytes), Err(CodecError::TooLong { .. }))
        };
        assert!(too_long(FRAME_LIMIT + 1, MESSAGE));
        assert!(too_long(CONTROL_LIMIT + 1, CONTROL));
        assert!(
            too_long(FRAME_LIMIT + 1, LONG_MESSAGE) && too_long(FRAME_LIMIT + 1, MESSAGE_CHUNK)
        );
    }

    #[test]
    fn bytes_after_the_frame_in_its_body_are_an_error() {
        let mut bytes = Vec::new();
        encode(&Frame::Resign, &mut bytes).unwrap();
        bytes.push(0);
        bytes[0] += 1;
        assert_eq!(decode(&bytes), Err(CodecError::Trailing(1)));
    }
}
