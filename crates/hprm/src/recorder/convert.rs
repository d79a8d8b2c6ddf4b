//! From the share of a process to packets of Perfetto.
//!
//! A member of the federation is a process there, each of its threads a thread, and the coordination another one. The
//! numbers of processes are made from those of federates: processes on several machines, and federates that are
//! threads of one, may have equal ones. Slices and instants have the names of reactions and ports; both ends of a
//! message have one number for the arrow between them, which follows from channel and tag alone. Where times lie that are of
//! another machine's clock is up to `times`.

mod flows;
mod interned;
mod slices;

use std::io::{self, Write};

use hprm_core::{Nanos, PhysicalTime, Tag, show_time};

use self::flows::Flows;
use self::interned::{Category, Interned};
use self::slices::Slices;
use super::names::Member;
use super::perfetto::{
    DebugAnnotation, ProcessDescriptor, ThreadDescriptor, TracePacket, TrackDescriptor, TrackEvent,
    append,
};
use super::record::{Flags, FrameKind, Kind, Record, Wait};
use super::remote::SHARE_LIMIT;
use super::share::{Content, ShareReader};
use super::times::Times;

const SLICE_BEGIN: i32 = 1;
const SLICE_END: i32 = 2;
const INSTANT: i32 = 3;

/// The track of frames of the coordination, behind those of threads.
const COORDINATION: u32 = 900;
/// The track of tracepoints.
const TRACEPOINTS: u32 = 901;

/// Where the records of a share are from.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(super) struct Source {
    /// The machine, if it is another one.
    pub(super) machine: Option<String>,
    pub(super) times: Times,
    /// Why the share ends early, if it does.
    pub(super) cut: Cut,
}

/// Why a share ends before its process does.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Default)]
pub(super) enum Cut {
    /// The process was killed.
    #[default]
    Killed,
    /// The link to its machine has ended.
    Link,
    /// There is more than a share from another machine may be.
    Limit,
}

impl Cut {
    /// Where the records end, in the trace and in what is told of it.
    pub(super) fn place(self) -> String {
        match self {
            Self::Killed => "where the process was killed".to_owned(),
            Self::Link => "where the link to its machine ended".to_owned(),
            Self::Limit => format!("after {} GiB", SHARE_LIMIT >> 30),
        }
    }
}

/// What is missing in a trace.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Lost {
    /// Whose records they are.
    pub(super) title: String,
    /// How many records were lost.
    pub(super) records: u64,
    /// Why the others end early, if they do.
    pub(super) cut: Option<Cut>,
}

/// Writes what is in a share as packets.
///
/// # Errors
///
/// If the share cannot be read, or the packets cannot be written.
pub(super) fn convert<R: io::Read>(
    mut share: ShareReader<R>,
    source: Source,
    out: &mut impl Write,
) -> io::Result<Lost> {
    let mut converter = Converter::new(share.names.clone(), source);
    converter.describe_process();
    let mut is_cut = true;
    while let Some(content) = share.next_content()? {
        match content {
            Content::Name(number, name) => converter.tracepoints.push((number, name)),
            Content::Records(lane, records) => {
                for record in records {
                    converter.add(lane, &record);
                }
            }
            Content::End => is_cut = false,
        }
        out.write_all(&converter.out)?;
        converter.out.clear();
    }
    let cut = is_cut.then_some(converter.source.cut);
    if let Some(cut) = cut {
        converter.note_cut(cut);
    }
    out.write_all(&converter.out)?;
    Ok(Lost { title: converter.title(), records: converter.lost, cut })
}

struct Converter {
    names: super::Names,
    source: Source,
    process: i32,
    interned: Interned,
    /// The names of tracepoints.
    tracepoints: Vec<(u32, String)>,
    flows: Flows,
    slices: Slices,
    /// The tracks that have been described.
    tracks: Vec<u32>,
    /// The physical time of tag zero.
    start: Option<PhysicalTime>,
    /// When the latest record was made.
    latest: PhysicalTime,
    lost: u64,
    /// Packets that are to be written.
    out: Vec<u8>,
}

/// A slice or an instant.
struct Event<'a> {
    track: u32,
    time: PhysicalTime,
    shape: i32,
    category: Category,
    name: &'a str,
    arguments: Vec<(&'static str, i64)>,
    texts: Vec<(&'static str, String)>,
    flow: Option<u64>,
    /// Whether the arrow ends here.
    is_end: bool,
}

impl Converter {
    fn new(names: super::Names, source: Source) -> Self {
        let process = match names.member {
            Member::Rti | Member::Whole => 1,
            Member::Federate(number) => i32::from(number) + 2,
        };
        Self {
            names,
            source,
            process,
            interned: Interned::default(),
            tracepoints: Vec::new(),
            flows: Flows::default(),
            slices: Slices::default(),
            tracks: Vec::new(),
            start: None,
            latest: PhysicalTime(0),
            lost: 0,
            out: Vec::new(),
        }
    }

    fn packet(&mut self, packet: TracePacket) {
        let sequence = Some(self.process.cast_unsigned());
        append(&TracePacket { trusted_packet_sequence_id: sequence, ..packet }, &mut self.out);
    }

    /// The number of a track, which no other process of the run has.
    fn uuid(&self, track: u32) -> u64 {
        flows::mix(&[self.process.cast_unsigned().into(), u64::from(track) + 1])
    }

    /// What people call the member, with its machine if that is another one.
    fn title(&self) -> String {
        let title = self.names.title();
        match &self.source.machine {
            Some(machine) => format!("{title} on {machine}"),
            None => title,
        }
    }

    fn describe_process(&mut self) {
        let Source { machine, times, .. } = &self.source;
        let mut labels = vec![format!("process {}", self.names.process)];
        labels.extend(machine.iter().map(|machine| format!("on {machine}")));
        labels.extend(times.within().map(|within| format!("clock \u{b1}{}", rounded(within))));
        let process = ProcessDescriptor {
            pid: Some(self.process),
            process_name: Some(self.names.title()),
            process_labels: labels,
        };
        let track = TrackDescriptor {
            uuid: Some(flows::mix(&[self.process.cast_unsigned().into(), 0])),
            process: Some(process),
            ..TrackDescriptor::default()
        };
        self.packet(TracePacket {
            // The names of an earlier trace, if this one stands behind it, are void.
            sequence_flags: Some(1),
            track_descriptor: Some(track),
            ..TracePacket::default()
        });
    }

    fn describe_track(&mut self, track: u32) {
        if self.tracks.contains(&track) {
            return;
        }
        self.tracks.push(track);
        let name = match track {
            COORDINATION => "coordination".to_owned(),
            TRACEPOINTS => "tracepoints".to_owned(),
            0 if self.names.member == Member::Rti => "messages".to_owned(),
            worker => format!("worker {worker}"),
        };
        let number = i32::try_from(track).unwrap_or(i32::MAX);
        let thread = ThreadDescriptor {
            pid: Some(self.process),
            tid: Some(self.process * 1000 + number + 1),
            thread_name: Some(name),
        };
        let track = TrackDescriptor {
            uuid: Some(self.uuid(track)),
            parent_uuid: Some(flows::mix(&[self.process.cast_unsigned().into(), 0])),
            thread: Some(thread),
            ..TrackDescriptor::default()
        };
        self.packet(TracePacket { track_descriptor: Some(track), ..TracePacket::default() });
    }

    fn emit(&mut self, event: Event<'_>) {
        self.describe_track(event.track);
        let is_named = event.shape != SLICE_END;
        let category = is_named.then(|| self.interned.category(event.category));
        let name_iid = is_named.then(|| self.interned.event(event.name));
        let number =
            |(name, value): (&'static str, i64), interned: &mut Interned| DebugAnnotation {
                name_iid: Some(interned.argument(name)),
                int_value: Some(value),
                string_value: None,
            };
        let mut debug_annotations: Vec<_> =
            event.arguments.into_iter().map(|it| number(it, &mut self.interned)).collect();
        debug_annotations.extend(event.texts.into_iter().map(|(name, text)| DebugAnnotation {
            name_iid: Some(self.interned.argument(name)),
            int_value: None,
            string_value: Some(text),
        }));
        let flow = event.flow.into_iter().collect();
        let (flow_ids, terminating_flow_ids) =
            if event.is_end { (Vec::new(), flow) } else { (flow, Vec::new()) };
        let track_event = TrackEvent {
            category_iids: category.into_iter().collect(),
            debug_annotations,
            r#type: Some(event.shape),
            name_iid,
            track_uuid: Some(self.uuid(event.track)),
            flow_ids,
            terminating_flow_ids,
        };
        let packet = TracePacket {
            timestamp: Some(event.time.0.cast_unsigned()),
            sequence_flags: Some(2),
            interned_data: self.interned.take_new(),
            track_event: Some(track_event),
            ..TracePacket::default()
        };
        self.packet(packet);
    }

    /// Adds what a record says. All that it calls with a record sees the launcher's time.
    fn add(&mut self, lane: u32, record: &Record) {
        if record.kind == Kind::ClockSet {
            self.source.times.note_set();
        }
        let times = &self.source.times;
        let lag = self.start.map(|start| record.time.since(record.tag.due(start)));
        let at_most = until(record);
        let end = times.shown(PhysicalTime(record.values[1].cast_signed()));
        let record = &Record { time: times.shown(record.time), ..*record };
        self.latest = self.latest.max(record.time);
        match record.kind {
            Kind::ReactionStart => self.reaction(lane, record, lag),
            Kind::Waited => {
                let name = Wait::name(record.detail);
                let mut event = self.event(lane, record, SLICE_BEGIN, Category::Wait, name);
                event.arguments.extend(at_most);
                self.emit(event);
                self.end_slice(lane, end);
                self.latest = self.latest.max(end);
            }
            Kind::ReactionEnd => self.end(lane, record),
            Kind::Sent | Kind::Received | Kind::Forwarded => self.message(lane, record),
            Kind::FrameSent | Kind::FrameReceived => self.frame(record),
            Kind::Scheduled => {
                let name = name_of(&self.names.actions, record.subject);
                let outside = record.flags.has(Flags::OUTSIDE);
                let by = if outside { "another thread" } else { "a reaction" };
                let name = format!("schedule {name}");
                let mut event = self.event(lane, record, INSTANT, Category::Schedule, &name);
                event.texts.push(("by", by.to_owned()));
                self.emit(event);
            }
            Kind::Tracepoint => self.tracepoint(record),
            Kind::Started => {
                self.start = Some(PhysicalTime(record.values[0].cast_signed()));
                let event = self.event(lane, record, INSTANT, Category::Trace, "start");
                self.emit(event);
            }
            Kind::Lost => self.note_lost(lane, record),
            Kind::ClockSet => {
                let mut event =
                    self.event(COORDINATION, record, INSTANT, Category::Trace, "clock set");
                let [offset, error] = record.values.map(u64::cast_signed);
                event.arguments.extend([("offset_ns", offset), ("within_ns", error)]);
                self.emit(event);
            }
        }
    }

    fn event<'a>(
        &self,
        track: u32,
        record: &Record,
        shape: i32,
        category: Category,
        name: &'a str,
    ) -> Event<'a> {
        let arguments = match record.tag {
            Tag::NEVER | Tag::FOREVER => Vec::new(),
            tag => vec![("tag", tag.time), ("microstep", tag.microstep.into())],
        };
        let time = record.time;
        Event {
            track,
            time,
            shape,
            category,
            name,
            arguments,
            texts: Vec::new(),
            flow: None,
            is_end: false,
        }
    }

    /// The lag is what the federate has seen: that of its own clock.
    fn reaction(&mut self, lane: u32, record: &Record, lag: Option<i64>) {
        let name = name_of(&self.names.reactions, record.subject);
        let mut event = self.event(lane, record, SLICE_BEGIN, Category::Reaction, &name);
        event.arguments.extend(lag.map(|lag| ("lag_ns", lag)));
        let is_late = record.flags.has(Flags::DEADLINE);
        if is_late {
            event.texts.push(("body", "deadline handler".to_owned()));
        } else if record.flags.has(Flags::TARDY) {
            event.texts.push(("body", "tardy handler".to_owned()));
        }
        self.slices.begin(lane, record.subject);
        self.emit(event);
        if is_late {
            let missed = format!("deadline missed: {name}");
            let event = self.event(lane, record, INSTANT, Category::Deadline, &missed);
            self.emit(event);
        }
    }

    /// Ends the slice of a reaction, unless its beginning is missing. Those inside whose end is missing end, too.
    fn end(&mut self, lane: u32, record: &Record) {
        for _ in 0..self.slices.end(lane, record.subject) {
            self.end_slice(lane, record.time);
        }
    }

    fn end_slice(&mut self, lane: u32, time: PhysicalTime) {
        self.emit(Event {
            track: lane,
            time,
            shape: SLICE_END,
            category: Category::Trace,
            name: "",
            arguments: Vec::new(),
            texts: Vec::new(),
            flow: None,
            is_end: false,
        });
    }

    fn message(&mut self, lane: u32, record: &Record) {
        let Some(channel) = self.names.channels.get(record.subject as usize).cloned() else {
            return;
        };
        let (verb, port) = match record.kind {
            Kind::Sent => ("send", &channel.from),
            Kind::Received => ("receive", &channel.to),
            _ => ("forward", &channel.to),
        };
        let name = format!("{verb} {port}");
        let mut event = self.event(lane, record, INSTANT, Category::Message, &name);
        let [inside, shared] = record.values.map(|bytes| i64::try_from(bytes).unwrap_or(i64::MAX));
        let how = match record.flags {
            flags if flags.has(Flags::IN_PROCESS) => "by reference",
            _ if shared == 0 => "inside the message",
            flags if flags.has(Flags::COPIED) => "copied into shared memory",
            _ => "in shared memory, in place",
        };
        event
            .arguments
            .extend([("bytes", inside.saturating_add(shared)), ("bytes_shared", shared)]);
        let connection = format!("{} -> {}", channel.from, channel.to);
        event.texts.extend([("connection", connection), ("transfer", how.to_owned())]);
        event.flow = Some(self.flows.message(record, channel.physical));
        event.is_end = record.kind == Kind::Received;
        self.emit(event);
    }

    fn frame(&mut self, record: &Record) {
        let Some(kind) = FrameKind::of_detail(record.detail) else { return };
        let federate = name_of(&self.names.federates, record.subject);
        let is_rti = self.names.member == Member::Rti;
        let name = match (is_rti, record.kind) {
            (true, Kind::FrameSent) => format!("{} to {federate}", kind.name()),
            (true, _) => format!("{} from {federate}", kind.name()),
            (false, Kind::FrameSent) => format!("{} to RTI", kind.name()),
            (false, _) => format!("{} from RTI", kind.name()),
        };
        let mut event = self.event(COORDINATION, record, INSTANT, Category::Coordination, &name);
        event.flow = Some(self.flows.frame(record, is_rti));
        event.is_end = record.kind == Kind::FrameReceived;
        self.emit(event);
    }

    fn tracepoint(&mut self, record: &Record) {
        let name = self.tracepoints.iter().find(|(number, _)| *number == record.subject);
        let name = name.map_or_else(|| record.subject.to_string(), |(_, name)| name.clone());
        let mut event = self.event(TRACEPOINTS, record, INSTANT, Category::Tracepoint, &name);
        if record.flags.has(Flags::VALUE) {
            event.arguments.push(("value", record.values[0].cast_signed()));
        }
        self.emit(event);
    }

    /// Slices whose end is among the lost records would contain all that follows.
    fn note_lost(&mut self, lane: u32, record: &Record) {
        for _ in 0..self.slices.end_all(lane) {
            self.end_slice(lane, record.time);
        }
        let count = record.values[0];
        self.lost = self.lost.saturating_add(count);
        let name = format!("{count} records are missing before this");
        let mut event = self.event(lane, record, INSTANT, Category::Trace, &name);
        event.arguments.push(("lost", i64::try_from(count).unwrap_or(i64::MAX)));
        self.emit(event);
    }

    fn note_cut(&mut self, cut: Cut) {
        let record = Record::new(Kind::Lost, Flags::NONE, 0, Tag::NEVER);
        let record = Record { time: self.latest, ..record };
        if self.latest > PhysicalTime(0) {
            let name = match cut {
                Cut::Killed => "the process was killed: its records end here".to_owned(),
                cut => format!("its records end here, {}", cut.place()),
            };
            let event = self.event(0, &record, INSTANT, Category::Trace, &name);
            self.emit(event);
        }
    }
}

fn name_of(names: &[String], number: u32) -> String {
    names.get(number as usize).cloned().unwrap_or_else(|| number.to_string())
}

/// A length of time in three digits, not less than it is.
fn rounded(time: Nanos) -> String {
    let digits = time.checked_ilog10().unwrap_or_default();
    let unit = 10_i64.pow(digits.saturating_sub(2));
    show_time(time.saturating_add(unit - 1) / unit * unit)
}

/// Until when a loop waits, if that is known.
fn until(record: &Record) -> Option<(&'static str, i64)> {
    let until = record.values[0].cast_signed();
    (until > 0).then(|| ("at_most_ns", until.saturating_sub(record.time.0).max(0)))
}

#[cfg(test)]
mod tests;
