//! Messages that are too long for one frame: their bytes travel in chunks.
//!
//! The envelope says what follows; each chunk is a frame of its own, and nothing comes between them. So
//! neither end needs more memory than the payload itself, and a chunk. The receiver gets memory as
//! bytes arrive: a sender that only claims a long message costs it nothing.

use std::collections::VecDeque;

use hprm_core::limits::FRAME_LIMIT;
use hprm_core::{ChannelId, Part, Payload, Tag};

use super::{
    CodecError, Envelope, LENGTH, LONG_MESSAGE, MESSAGE_CHUNK, PartHeader, append, begin, end,
    reserve,
};
use crate::Frame;

/// The most bytes of a payload in one frame; a message with more of them travels in chunks.
pub(super) const CHUNK_LIMIT: usize = 256 << 10;

/// A message that leaves in chunks.
#[derive(Debug)]
pub struct Outgoing {
    /// Until it is written.
    envelope: Option<Envelope>,
    /// The buffers that have not been written completely, and how many bytes of the first one have.
    buffers: VecDeque<Vec<u8>>,
    written: usize,
}

impl Outgoing {
    /// Whether a frame is a long message, which [`Self::cut`] cuts.
    #[must_use]
    pub fn is_for(frame: &Frame) -> bool {
        matches!(frame, Frame::Message { payload, .. } if super::is_long(payload))
    }

    /// Cuts a long message into chunks.
    ///
    /// # Errors
    ///
    /// The frame as it was, if it is no long message.
    pub fn cut(frame: Frame) -> Result<Self, Frame> {
        match frame {
            Frame::Message { channel, tag, payload } if super::is_long(&payload) => {
                let envelope = Some(Envelope::of(channel, tag, &payload));
                let parts = payload.parts.into_iter().filter_map(|part| match part {
                    Part::Inline(bytes) => Some(bytes),
                    Part::Object(_) | Part::Shipped(_) => None,
                });
                let buffers = std::iter::once(payload.head).chain(parts);
                let buffers = buffers.filter(|bytes| !bytes.is_empty()).collect();
                Ok(Self { envelope, buffers, written: 0 })
            }
            frame => Err(frame),
        }
    }

    /// Appends the next frame to `out`. Returns whether there are more. What has been written is not
    /// kept.
    ///
    /// # Errors
    ///
    /// If there is no memory for it; nothing has changed.
    pub fn write(&mut self, out: &mut Vec<u8>) -> Result<bool, CodecError> {
        if let Some(envelope) = &self.envelope {
            reserve(out, envelope.max_len())?;
            let start = begin(LONG_MESSAGE, out);
            append(envelope, out);
            end(start, out);
            self.envelope = None;
            return Ok(!self.buffers.is_empty());
        }
        if let Some(buffer) = self.buffers.front() {
            let rest = &buffer[self.written..];
            let bytes = &rest[..rest.len().min(CHUNK_LIMIT)];
            append_chunk(bytes, out)?;
            self.written += bytes.len();
            if self.written == buffer.len() {
                self.buffers.pop_front();
                self.written = 0;
            }
        }
        Ok(!self.buffers.is_empty())
    }
}

/// Appends a chunk to `out`: a frame with bytes of a payload.
pub(super) fn append_chunk(bytes: &[u8], out: &mut Vec<u8>) -> Result<(), CodecError> {
    reserve(out, LENGTH + 1 + bytes.len())?;
    let start = begin(MESSAGE_CHUNK, out);
    out.extend_from_slice(bytes);
    end(start, out);
    Ok(())
}

/// A message of which the envelope has come, and not all chunks.
#[derive(Debug)]
pub(super) struct Incoming {
    channel: ChannelId,
    tag: Tag,
    /// The bytes of the whole message.
    len: usize,
    /// Those that are missing.
    missing: usize,
    payload: Payload,
    /// The length of the head, until the first byte of it comes. The bytes fill the head first, then one part
    /// of the payload after the other.
    head: usize,
    /// The parts that have not begun, and how many bytes are missing of the one that has.
    headers: std::vec::IntoIter<PartHeader>,
    rest: usize,
}

impl Incoming {
    /// The message that an envelope announces. The announcement alone costs no memory.
    pub(super) fn new(envelope: Envelope) -> Result<Self, CodecError> {
        let head = usize::try_from(envelope.head).map_err(|_| CodecError::Malformed)?;
        let mut len = head;
        for header in &envelope.parts {
            if let PartHeader::Inline(more) = header {
                let more = usize::try_from(*more).map_err(|_| CodecError::Malformed)?;
                len = len.checked_add(more).ok_or(CodecError::Malformed)?;
            }
        }
        // A sender puts shorter messages into one frame.
        if len <= CHUNK_LIMIT {
            return Err(CodecError::Malformed);
        }
        let payload = Payload { physical: envelope.physical, ..Payload::default() };
        let Envelope { channel, tag, parts, .. } = envelope;
        let headers = parts.into_iter();
        Ok(Self { channel, tag, len, missing: len, payload, head, headers, rest: 0 })
    }

    /// The bytes of the whole message.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Takes a chunk. Returns whether the message is complete.
    pub(super) fn take(&mut self, mut bytes: &[u8]) -> Result<bool, CodecError> {
        if bytes.len() > self.missing {
            return Err(CodecError::Trailing(bytes.len() - self.missing));
        }
        self.missing -= bytes.len();
        while !bytes.is_empty() {
            let len = self.len;
            let (buffer, rest) = self.buffer();
            let (now, later) = bytes.split_at(bytes.len().min(*rest));
            grow(buffer, now.len(), *rest).map_err(|()| CodecError::NoMemory(len))?;
            buffer.extend_from_slice(now);
            *rest -= now.len();
            bytes = later;
        }
        Ok(self.missing == 0)
    }

    /// The buffer that gets the next byte, and how many it still gets. There is a byte to come.
    fn buffer(&mut self) -> (&mut Vec<u8>, &mut usize) {
        if self.head > 0 {
            self.rest = std::mem::take(&mut self.head);
        }
        while self.rest == 0 {
            self.begin_part();
        }
        match self.payload.parts.last_mut() {
            Some(Part::Inline(bytes)) => (bytes, &mut self.rest),
            _ => (&mut self.payload.head, &mut self.rest),
        }
    }

    fn begin_part(&mut self) {
        match self.headers.next() {
            Some(PartHeader::Inline(len)) => {
                self.rest = usize::try_from(len).expect("it was added to the others");
                self.payload.parts.push(Part::Inline(Vec::new()));
            }
            Some(PartHeader::Object(object)) => self.payload.parts.push(Part::Object(object)),
            Some(PartHeader::Shipped(it)) => self.payload.parts.push(Part::Shipped(it)),
            None => unreachable!("the bytes that are missing belong to a header"),
        }
    }

    /// The message, once it is complete.
    pub(super) fn finish(mut self) -> Frame {
        // Parts without bytes may follow the last one with some.
        while !self.headers.as_slice().is_empty() {
            self.begin_part();
        }
        Frame::Message { channel: self.channel, tag: self.tag, payload: self.payload }
    }
}

/// Makes room for `more` bytes in a buffer that will get `rest` of them: no more than it has already,
/// but at once if the whole is little.
fn grow(buffer: &mut Vec<u8>, more: usize, rest: usize) -> Result<(), ()> {
    if buffer.capacity() - buffer.len() >= more {
        return Ok(());
    }
    let ample = rest.min(buffer.len().max(more));
    // Where memory is short, as little as possible.
    let reserved = buffer.try_reserve_exact(ample).or_else(|_| buffer.try_reserve_exact(more));
    reserved.map_err(|_| ())
}

const _: () = assert!(CHUNK_LIMIT + LENGTH < FRAME_LIMIT);

#[cfg(test)]
mod tests {
    use hprm_core::{FederateId, ObjectRef};

    use super::super::{Decoded, Decoder, decode, encode};
    use super::*;

    fn frame(head: usize, parts: &[Option<usize>]) -> Frame {
        let object = ObjectRef { owner: FederateId(1), serial: 2, segment: 3, offset: 4, len: 5 };
        let bytes = |len: usize| (0..len).map(|at| (at % 251).to_le_bytes()[0]).collect();
        let parts = parts.iter().map(|part| match part {
            Some(len) => Part::Inline(bytes(*len)),
            None => Part::Object(object),
        });
        let payload = Payload { head: bytes(head), parts: parts.collect(), physical: true };
        Frame::Message { channel: ChannelId(7), tag: Tag::new(8, 9), payload }
    }

    fn long() -> Vec<Frame> {
        vec![
            frame(CHUNK_LIMIT + 1, &[]),
            frame(0, &[Some(3 * CHUNK_LIMIT), None, Some(0)]),
            frame(1, &[None, Some(0), Some(CHUNK_LIMIT), Some(1), Some(0), None]),
            frame(CHUNK_LIMIT, &[Some(1), Some(2 * CHUNK_LIMIT + 5), Some(CHUNK_LIMIT)]),
        ]
    }

    #[test]
    fn a_long_message_is_whole_again_at_the_other_end() {
        for frame in long() {
            let mut bytes = Vec::new();
            encode(&frame, &mut bytes).unwrap();
            assert_eq!(decode(&bytes), Ok(Some((frame.clone(), bytes.len()))));
            assert_eq!(decode(&bytes[..bytes.len() - 1]), Ok(None));
            // Written one at a time it is the same, and no frame is long.
            let mut outgoing = Outgoing::cut(frame).unwrap();
            let mut headers = Vec::new();
            loop {
                let before = headers.len();
                let more = outgoing.write(&mut headers).unwrap();
                assert!(headers.len() - before <= CHUNK_LIMIT + LENGTH + 1);
                if !more {
                    break;
                }
            }
            assert_eq!(headers, bytes);
        }
        let short = frame(CHUNK_LIMIT, &[None]);
        assert_eq!(Outgoing::cut(short.clone()).unwrap_err(), short);
    }

    /// The frames of a long message, each by itself.
    fn frames() -> Vec<Vec<u8>> {
        let mut outgoing = Outgoing::cut(frame(3, &[Some(2 * CHUNK_LIMIT)])).unwrap();
        let mut frames = vec![];
        loop {
            let mut bytes = Vec::new();
            let more = outgoing.write(&mut bytes).unwrap();
            frames.push(bytes);
            if !more {
                return frames;
            }
        }
    }

    fn read(frames: &[Vec<u8>]) -> Result<usize, CodecError> {
        let mut decoder = Decoder::default();
        let mut whole = 0;
        for frame in frames {
            match decoder.next(frame)? {
                Decoded::Frame(..) => whole += 1,
                Decoded::Chunk { .. } => {}
                Decoded::Missing(_) => panic!("the frame is there"),
            }
        }
        Ok(whole)
    }

    #[test]
    fn nothing_comes_between_the_chunks_and_no_chunk_is_without_a_message() {
        let all = frames();
        assert_eq!((all.len(), read(&all)), (4, Ok(1)));
        let mut ping = Vec::new();
        encode(&Frame::Ping, &mut ping).unwrap();
        let with = |at: usize, other: &Vec<u8>| {
            let mut frames = all.clone();
            frames.insert(at, other.clone());
            read(&frames)
        };
        assert_eq!((with(0, &ping), with(4, &ping)), (Ok(2), Ok(2)));
        for at in 1..4 {
            assert_eq!(with(at, &ping), Err(CodecError::Malformed));
            assert_eq!(with(at, &all[0]), Err(CodecError::Malformed));
        }
        assert_eq!(read(&all[1..]), Err(CodecError::Malformed));
        assert!(matches!(with(2, &all[1]), Err(CodecError::Trailing(_))));
    }

    #[test]
    fn what_is_only_claimed_takes_no_memory() {
        let envelope = |head, parts: Vec<PartHeader>| {
            let (channel, tag) = (ChannelId(0), Tag::START);
            Incoming::new(Envelope { channel, tag, head, parts, physical: false })
        };
        let mut incoming = envelope(1 << 60, vec![PartHeader::Inline(1 << 61)]).unwrap();
        assert_eq!(incoming.take(&[1; 1000]), Ok(false));
        assert!(incoming.payload.head.capacity() <= 2000);
        assert!(matches!(
            envelope(u64::MAX, vec![PartHeader::Inline(1)]),
            Err(CodecError::Malformed)
        ));
        assert!(matches!(envelope(5, vec![PartHeader::Inline(1)]), Err(CodecError::Malformed)));
    }
}
