//! A trace of a run, read back: events by name, with their arguments.

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use hprm::recorder::{InternedData, TracePacket, TrackEvent, packets};

use crate::message::Error;

/// What an event is on its track.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Shape {
    Begin,
    End,
    Instant,
}

/// Something that a trace tells.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Event {
    pub(crate) time: i64,
    pub(crate) track: u64,
    pub(crate) shape: Shape,
    pub(crate) category: String,
    pub(crate) name: String,
    pub(crate) numbers: HashMap<String, i64>,
    pub(crate) texts: HashMap<String, String>,
    /// The arrow that begins here, or leads through here.
    pub(crate) flow: Option<u64>,
    /// The arrow that ends here.
    pub(crate) ending_flow: Option<u64>,
}

/// Names by number, of one sequence of packets.
#[derive(Default)]
struct Known {
    categories: HashMap<u64, String>,
    events: HashMap<u64, String>,
    arguments: HashMap<u64, String>,
}

impl Known {
    fn add(&mut self, data: &InternedData) {
        let put = |to: &mut HashMap<u64, String>, iid: Option<u64>, name: &Option<String>| {
            to.insert(iid.unwrap_or_default(), name.clone().unwrap_or_default());
        };
        data.event_categories.iter().for_each(|it| put(&mut self.categories, it.iid, &it.name));
        data.event_names.iter().for_each(|it| put(&mut self.events, it.iid, &it.name));
        data.debug_annotation_names
            .iter()
            .for_each(|it| put(&mut self.arguments, it.iid, &it.name));
    }
}

/// Reads all events of a trace, in the order of the file.
///
/// # Errors
///
/// If it cannot be read, or is no trace, or is cut short.
pub(crate) fn read(path: &Path) -> Result<Vec<Event>, Error> {
    let shown = path.display();
    let unreadable = |error| Error::new(format!("cannot read {shown}: {error}"));
    let bytes = fs::read(path).map_err(unreadable)?;
    let how = "a trace is written by `hprm run --trace FILE`";
    if bytes.is_empty() {
        return Err(Error::new(format!("{shown} is empty, and no trace")).hint(how));
    }
    let mut events = Vec::new();
    let mut known = HashMap::<u32, Known>::new();
    let mut has_tracks = false;
    for packet in packets(&bytes) {
        let Ok(packet) = packet else {
            return Err(match has_tracks {
                true => Error::new(format!("{shown} is cut short: it ends within a packet"))
                    .hint("copy the file again; Perfetto shows what is there"),
                false => Error::new(format!("{shown} is no trace of a run")).hint(how),
            });
        };
        has_tracks |= packet.track_descriptor.is_some();
        let names = known.entry(packet.trusted_packet_sequence_id.unwrap_or_default()).or_default();
        events.extend(event(&packet, names));
    }
    match has_tracks {
        true => Ok(events),
        false => Err(Error::new(format!("{shown} is no trace of a run")).hint(how)),
    }
}

fn event(packet: &TracePacket, known: &mut Known) -> Option<Event> {
    if packet.sequence_flags.is_some_and(|flags| flags & 1 != 0) {
        *known = Known::default();
    }
    packet.interned_data.iter().for_each(|data| known.add(data));
    let event: &TrackEvent = packet.track_event.as_ref()?;
    let name_of = |names: &HashMap<u64, String>, iid: Option<u64>| {
        iid.and_then(|iid| names.get(&iid).cloned()).unwrap_or_default()
    };
    let (mut numbers, mut texts) = (HashMap::new(), HashMap::new());
    for argument in &event.debug_annotations {
        let name = name_of(&known.arguments, argument.name_iid);
        match (argument.int_value, &argument.string_value) {
            (Some(value), _) => drop(numbers.insert(name, value)),
            (None, Some(text)) => drop(texts.insert(name, text.clone())),
            (None, None) => {}
        }
    }
    Some(Event {
        time: packet.timestamp?.cast_signed(),
        track: event.track_uuid?,
        shape: match event.r#type? {
            1 => Shape::Begin,
            2 => Shape::End,
            _ => Shape::Instant,
        },
        category: name_of(&known.categories, event.category_iids.first().copied()),
        name: name_of(&known.events, event.name_iid),
        numbers,
        texts,
        flow: event.flow_ids.first().copied(),
        ending_flow: event.terminating_flow_ids.first().copied(),
    })
}
