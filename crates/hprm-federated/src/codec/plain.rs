//! Messages whose value is its head alone, as small ones are: a fixed layout, because most frames are of this kind.
//!
//! ```text
//! channel:u32  time:i64  microstep:u32  physical:u8  head        all little endian
//! ```

use hprm_core::{ChannelId, NoMemory, Payload, Tag, copy_of};

use super::chunks::CHUNK_LIMIT;
use super::{CodecError, LENGTH, PLAIN_MESSAGE, reserve};
use crate::Frame;

/// The bytes before the head, from the length of the frame on.
const BEFORE: usize = LENGTH + 1 + FIXED;

/// The bytes between the kind of the frame and the head.
const FIXED: usize = size_of::<u32>() + size_of::<i64>() + size_of::<u32>() + 1;

/// Whether a message with this payload is a plain one.
pub(super) fn is_plain(payload: &Payload) -> bool {
    payload.parts.is_empty() && payload.head.len() <= CHUNK_LIMIT
}

/// Appends the frame of a plain message to `out`.
pub(super) fn append(
    channel: ChannelId,
    tag: Tag,
    payload: &Payload,
    out: &mut Vec<u8>,
) -> Result<(), CodecError> {
    reserve(out, BEFORE + payload.head.len())?;
    let body = u32::try_from(1 + FIXED + payload.head.len()).expect("it is no long message");
    let mut before = [0; BEFORE];
    before[..4].copy_from_slice(&body.to_le_bytes());
    before[4] = PLAIN_MESSAGE;
    before[5..9].copy_from_slice(&channel.0.to_le_bytes());
    before[9..17].copy_from_slice(&tag.time.to_le_bytes());
    before[17..21].copy_from_slice(&tag.microstep.to_le_bytes());
    before[21] = u8::from(payload.physical);
    out.extend_from_slice(&before);
    out.extend_from_slice(&payload.head);
    Ok(())
}

/// The message of a body, without the kind of the frame.
#[inline]
pub(super) fn message(body: &[u8]) -> Result<Frame, CodecError> {
    let (fixed, head) = body.split_first_chunk::<FIXED>().ok_or(CodecError::Malformed)?;
    let (channel, rest) = fixed.split_first_chunk::<4>().ok_or(CodecError::Malformed)?;
    let (time, rest) = rest.split_first_chunk::<8>().ok_or(CodecError::Malformed)?;
    let (microstep, physical) = rest.split_first_chunk::<4>().ok_or(CodecError::Malformed)?;
    let physical = match physical {
        [0] => false,
        [1] => true,
        _ => return Err(CodecError::Malformed),
    };
    let head = copy_of(head).map_err(|NoMemory(len)| CodecError::NoMemory(len))?;
    Ok(Frame::Message {
        channel: ChannelId(u32::from_le_bytes(*channel)),
        tag: Tag::new(i64::from_le_bytes(*time), u32::from_le_bytes(*microstep)),
        payload: Payload { head, parts: Vec::new(), physical },
    })
}
