//! The part of Perfetto's format that traces of runs use: messages of its `trace.proto`, field for field.
//!
//! The format is Protocol Buffers, so traces of one run that were made on several machines are one if they are put one
//! behind the other (`cat`).

use prost::Message;
use prost::encoding::{WireType, decode_key, decode_varint};

/// One packet of a trace.
#[derive(Clone, PartialEq, Message)]
pub struct TracePacket {
    /// Nanoseconds since the Unix epoch.
    #[prost(uint64, optional, tag = "8")]
    pub timestamp: Option<u64>,
    /// Which sequence of packets shares interned data.
    #[prost(uint32, optional, tag = "10")]
    pub trusted_packet_sequence_id: Option<u32>,
    /// Something happened.
    #[prost(message, optional, tag = "11")]
    pub track_event: Option<TrackEvent>,
    /// Names that later packets of the sequence use.
    #[prost(message, optional, tag = "12")]
    pub interned_data: Option<InternedData>,
    /// 1: names so far are void; 2: names are used.
    #[prost(uint32, optional, tag = "13")]
    pub sequence_flags: Option<u32>,
    /// A track.
    #[prost(message, optional, tag = "60")]
    pub track_descriptor: Option<TrackDescriptor>,
}

/// A track.
#[derive(Clone, PartialEq, Message)]
pub struct TrackDescriptor {
    /// Its id.
    #[prost(uint64, optional, tag = "1")]
    pub uuid: Option<u64>,
    /// Its name.
    #[prost(string, optional, tag = "2")]
    pub name: Option<String>,
    /// It is the track of a process.
    #[prost(message, optional, tag = "3")]
    pub process: Option<ProcessDescriptor>,
    /// It is the track of a thread.
    #[prost(message, optional, tag = "4")]
    pub thread: Option<ThreadDescriptor>,
    /// The track that it belongs to.
    #[prost(uint64, optional, tag = "5")]
    pub parent_uuid: Option<u64>,
}

/// What a process is.
#[derive(Clone, PartialEq, Message)]
pub struct ProcessDescriptor {
    /// Its number.
    #[prost(int32, optional, tag = "1")]
    pub pid: Option<i32>,
    /// Its name.
    #[prost(string, optional, tag = "6")]
    pub process_name: Option<String>,
    /// What is shown behind the name.
    #[prost(string, repeated, tag = "8")]
    pub process_labels: Vec<String>,
}

/// What a thread is.
#[derive(Clone, PartialEq, Message)]
pub struct ThreadDescriptor {
    /// The number of its process.
    #[prost(int32, optional, tag = "1")]
    pub pid: Option<i32>,
    /// Its number.
    #[prost(int32, optional, tag = "2")]
    pub tid: Option<i32>,
    /// Its name.
    #[prost(string, optional, tag = "5")]
    pub thread_name: Option<String>,
}

/// Something that happened on a track.
#[derive(Clone, PartialEq, Message)]
pub struct TrackEvent {
    /// Categories, by number.
    #[prost(uint64, repeated, packed = "false", tag = "3")]
    pub category_iids: Vec<u64>,
    /// Arguments.
    #[prost(message, repeated, tag = "4")]
    pub debug_annotations: Vec<DebugAnnotation>,
    /// 1: a slice begins, 2: it ends, 3: an instant.
    #[prost(int32, optional, tag = "9")]
    pub r#type: Option<i32>,
    /// The name, by number.
    #[prost(uint64, optional, tag = "10")]
    pub name_iid: Option<u64>,
    /// The track.
    #[prost(uint64, optional, tag = "11")]
    pub track_uuid: Option<u64>,
    /// Arrows that begin here, or lead through here.
    #[prost(fixed64, repeated, packed = "false", tag = "47")]
    pub flow_ids: Vec<u64>,
    /// Arrows that end here.
    #[prost(fixed64, repeated, packed = "false", tag = "48")]
    pub terminating_flow_ids: Vec<u64>,
}

/// An argument.
#[derive(Clone, PartialEq, Message)]
pub struct DebugAnnotation {
    /// Its name, by number.
    #[prost(uint64, optional, tag = "1")]
    pub name_iid: Option<u64>,
    /// A number.
    #[prost(int64, optional, tag = "4")]
    pub int_value: Option<i64>,
    /// A text.
    #[prost(string, optional, tag = "6")]
    pub string_value: Option<String>,
}

/// Names by number.
#[derive(Clone, PartialEq, Message)]
pub struct InternedData {
    /// Of categories.
    #[prost(message, repeated, tag = "1")]
    pub event_categories: Vec<EventCategory>,
    /// Of events.
    #[prost(message, repeated, tag = "2")]
    pub event_names: Vec<EventName>,
    /// Of arguments.
    #[prost(message, repeated, tag = "3")]
    pub debug_annotation_names: Vec<DebugAnnotationName>,
}

macro_rules! interned {
    ($($(#[$doc:meta])* $name:ident;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, PartialEq, Message)]
        pub struct $name {
            /// The number.
            #[prost(uint64, optional, tag = "1")]
            pub iid: Option<u64>,
            /// The name.
            #[prost(string, optional, tag = "2")]
            pub name: Option<String>,
        }
    )*};
}

interned! {
    /// The name of a category.
    EventCategory;
    /// The name of an event.
    EventName;
    /// The name of an argument.
    DebugAnnotationName;
}

/// The field of `Trace` that has the packets.
const PACKET: u32 = 1;

/// Appends a packet to a trace.
pub(super) fn append(packet: &TracePacket, out: &mut Vec<u8>) {
    prost::encoding::message::encode(PACKET, packet, out);
}

/// A trace that ends within a packet, or has something else there.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Broken;

/// The packets of a trace. The last one is an error if the trace is broken there.
pub fn packets(mut trace: &[u8]) -> impl Iterator<Item = Result<TracePacket, Broken>> + '_ {
    std::iter::from_fn(move || {
        if trace.is_empty() {
            return None;
        }
        let packet = packet(&mut trace);
        if packet.is_none() {
            trace = &[];
        }
        Some(packet.ok_or(Broken))
    })
}

fn packet(trace: &mut &[u8]) -> Option<TracePacket> {
    let (field, encoding) = decode_key(trace).ok()?;
    if (field, encoding) != (PACKET, WireType::LengthDelimited) {
        return None;
    }
    let len = usize::try_from(decode_varint(trace).ok()?).ok()?;
    let (packet, rest) = trace.split_at_checked(len)?;
    *trace = rest;
    TracePacket::decode(packet).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trace_cut_short_says_so_once() {
        let packet = TracePacket { timestamp: Some(7), ..TracePacket::default() };
        let mut trace = Vec::new();
        append(&packet, &mut trace);
        append(&packet, &mut trace);
        assert!(packets(&trace).all(|it| it.as_ref() == Ok(&packet)));
        for end in 1..trace.len() {
            let read: Vec<_> = packets(&trace[..end]).collect();
            let is_cut = end != trace.len() / 2;
            assert_eq!(read.iter().filter(|it| it.is_err()).count(), usize::from(is_cut), "{end}");
        }
    }
}
