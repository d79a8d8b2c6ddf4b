//! The numbers of arrows: equal at both ends, without that either knows the other.

use std::collections::HashMap;

use crate::recorder::record::{Kind, Record};

/// Counts what has no tag that tells it from others.
#[derive(Default)]
pub(super) struct Flows {
    /// Messages of physical connections, at this end: nothing but their order says which is which.
    messages: HashMap<(u8, u32), u64>,
    /// Frames with equal contents, of which there may be several.
    frames: HashMap<(u64, u8), u64>,
}

/// Makes one number of several, by a function that is the same in every process.
pub(super) fn mix(numbers: &[u64]) -> u64 {
    numbers.iter().fold(0, |sum, number| scatter(sum ^ number).wrapping_add(1))
}

/// The function with which `SplitMix64` ends: numbers that are close give numbers that are far apart.
fn scatter(number: u64) -> u64 {
    let number = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let number = (number ^ number >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let number = (number ^ number >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    number ^ number >> 31
}

impl Flows {
    /// The arrow of a message.
    pub(super) fn message(&mut self, record: &Record, physical: bool) -> u64 {
        let channel = u64::from(record.subject);
        if physical {
            let count = self.messages.entry((record.kind as u8, record.subject)).or_default();
            *count += 1;
            return mix(&[1, channel, *count]);
        }
        mix(&[2, channel, record.tag.time.cast_unsigned(), record.tag.microstep.into()])
    }

    /// The arrow of a frame between a federate and the RTI.
    pub(super) fn frame(&mut self, record: &Record, is_rti: bool) -> u64 {
        let to_rti = is_rti != (record.kind == Kind::FrameSent);
        let tag = [record.tag.time.cast_unsigned(), record.tag.microstep.into()];
        let same =
            mix(&[3, record.detail.into(), record.subject.into(), to_rti.into(), tag[0], tag[1]]);
        let count = self.frames.entry((same, record.kind as u8)).or_default();
        *count += 1;
        mix(&[same, *count])
    }
}
