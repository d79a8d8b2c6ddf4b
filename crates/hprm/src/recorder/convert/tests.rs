//! What the packets of a share say: arrows, nesting, names.

use std::collections::{HashMap, HashSet};

use proptest::prelude::*;

use super::super::comparisons::Comparisons;
use super::super::times::ClockSet;
use super::*;
use crate::recorder::perfetto::packets;
use crate::recorder::share::tests::names;

/// What is in a trace, as far as these tests ask: shape, track and name of each event, and its arrows.
struct Seen {
    events: Vec<(i32, u64, String)>,
    flows: Vec<u64>,
    ends: Vec<u64>,
}

fn seen(member: Member, records: &[Record]) -> Seen {
    seen_from(Source::default(), member, records)
}

fn seen_from(source: Source, member: Member, records: &[Record]) -> Seen {
    let mut converter = Converter::new(names(member), source);
    converter.describe_process();
    records.iter().for_each(|record| converter.add(0, record));
    let mut known = HashMap::new();
    let mut seen = Seen { events: Vec::new(), flows: Vec::new(), ends: Vec::new() };
    for packet in packets(&converter.out).map(Result::unwrap) {
        for name in packet.interned_data.iter().flat_map(|data| &data.event_names) {
            known.insert(name.iid, name.name.clone().unwrap());
        }
        let Some(event) = packet.track_event else { continue };
        let name = event.name_iid.map_or_else(String::new, |iid| known[&Some(iid)].clone());
        seen.events.push((event.r#type.unwrap(), event.track_uuid.unwrap(), name));
        seen.flows.extend(event.flow_ids);
        seen.ends.extend(event.terminating_flow_ids);
    }
    seen
}

fn at(time: i64, kind: Kind, subject: u32, tag: Tag) -> Record {
    Record { time: PhysicalTime(time), ..Record::new(kind, Flags::NONE, subject, tag) }
}

#[test]
fn an_arrow_leads_from_the_sender_through_the_rti_to_the_receiver() {
    let tags = [Tag::new(5, 0), Tag::new(5, 1)];
    let of = |member, kind| seen(member, &tags.map(|tag| at(9, kind, 0, tag)));
    let sent = of(Member::Federate(0), Kind::Sent);
    let forwarded = of(Member::Rti, Kind::Forwarded);
    let received = of(Member::Federate(1), Kind::Received);
    assert_eq!((&sent.flows, &sent.ends), (&received.ends, &received.flows.clone()));
    assert_eq!(sent.flows, forwarded.flows);
    assert_eq!(sent.flows.iter().collect::<HashSet<_>>().len(), 2);
}

#[test]
fn a_frame_and_the_next_one_like_it_have_an_arrow_each() {
    let frames = |member, kind| {
        let record = at(9, kind, 1, Tag::new(7, 0)).with_detail(FrameKind::Tag as u8);
        seen(member, &[record, record])
    };
    let sent = frames(Member::Rti, Kind::FrameSent);
    let received = frames(Member::Federate(1), Kind::FrameReceived);
    assert_eq!(sent.flows, received.ends);
    assert_ne!(sent.flows[0], sent.flows[1]);
    assert_eq!([&sent.events[0].2, &received.events[0].2], ["TAG to b", "TAG from RTI"]);
}

#[test]
fn a_missed_deadline_stands_on_its_reaction() {
    let start = Record { flags: Flags::DEADLINE, ..at(5, Kind::ReactionStart, 1, Tag::START) };
    let all = seen(Member::Whole, &[start, at(6, Kind::ReactionEnd, 1, Tag::START)]);
    let names: Vec<_> = all.events.iter().map(|(_, _, name)| name.as_str()).collect();
    assert_eq!(names, ["Main.b.1", "deadline missed: Main.b.1", ""]);
}

#[test]
fn two_members_share_no_track() {
    let record = at(5, Kind::ReactionStart, 0, Tag::START);
    let members = [Member::Rti, Member::Federate(0), Member::Federate(1)];
    let tracks: HashSet<_> = members.map(|it| seen(it, &[record]).events[0].1).into();
    assert_eq!(tracks.len(), 3);
}

/// The times of all events, and the labels of the process.
fn times(source: Source, records: &[Record], cut: Option<Cut>) -> (Vec<u64>, Vec<String>) {
    let mut converter = Converter::new(names(Member::Federate(0)), source);
    converter.describe_process();
    records.iter().for_each(|record| converter.add(0, record));
    cut.into_iter().for_each(|cut| converter.note_cut(cut));
    let (mut times, mut labels) = (Vec::new(), Vec::new());
    for packet in packets(&converter.out).map(Result::unwrap) {
        times.extend(packet.timestamp);
        let process = packet.track_descriptor.and_then(|track| track.process);
        labels.extend(process.into_iter().flat_map(|process| process.process_labels));
    }
    (times, labels)
}

#[test]
fn what_another_machine_has_recorded_is_named_and_moved_to_the_clock_here() {
    let mut comparisons = Comparisons::default();
    // Its clock is ahead by 1,000 ns.
    assert!(comparisons.add([100, 1_110, 120]));
    let source = Source {
        machine: Some("robot2".to_owned()),
        times: Times::new(None, comparisons),
        cut: Cut::Link,
    };
    let wait = at(2_000, Kind::Waited, 0, Tag::START).with_values([0, 2_500]);
    let records = [wait, at(3_000, Kind::Scheduled, 0, Tag::START)];
    let (times, labels) = times(source, &records, Some(Cut::Link));
    assert_eq!(times, [1_000, 1_500, 2_000, 2_000]);
    assert_eq!(labels, ["process 7", "on robot2", "clock \u{b1}10 ns"]);
}

#[test]
fn what_was_recorded_before_the_clock_was_set_is_moved_as_far() {
    let set = at(200, Kind::ClockSet, 0, Tag::NEVER).with_values([(-700_i64).cast_unsigned(), 8]);
    let times_of = Times::new(ClockSet::of(&set), Comparisons::default());
    let source = Source { times: times_of, ..Source::default() };
    let wait = at(880, Kind::Waited, 0, Tag::NEVER).with_values([0, 890]);
    let (times, labels) =
        times(source, &[wait, set, at(210, Kind::Scheduled, 0, Tag::START)], None);
    assert_eq!(times, [180, 190, 200, 210]);
    assert_eq!(labels, ["process 7", "clock \u{b1}8 ns"]);
}

#[test]
fn the_end_of_a_share_is_behind_all_that_is_in_it() {
    let wait = at(20, Kind::Waited, 0, Tag::START).with_values([0, 50]);
    for cut in [Cut::Killed, Cut::Link, Cut::Limit] {
        assert_eq!(times(Source::default(), &[wait], Some(cut)).0, [20, 50, 50]);
    }
}

#[test]
fn a_bound_is_told_in_three_digits_and_not_as_less_than_it_is() {
    for (time, told) in [(0, "0"), (7, "7 ns"), (123_456, "124 us"), (9_991_001, "10 ms")] {
        assert_eq!(rounded(time), told);
    }
    assert!(rounded(i64::MAX).ends_with('s'));
}

fn record() -> impl Strategy<Value = Record> {
    let kinds = [
        Kind::ReactionStart,
        Kind::ReactionEnd,
        Kind::Waited,
        Kind::Lost,
        Kind::Sent,
        Kind::Scheduled,
        Kind::Tracepoint,
        Kind::FrameSent,
        Kind::ClockSet,
    ];
    (prop::sample::select(kinds.to_vec()), any::<(u8, u8)>(), 0..3_u32, any::<[u64; 2]>()).prop_map(
        |(kind, (flags, detail), subject, values)| Record {
            flags: Flags(flags),
            detail,
            // Counts of lost records are added up.
            values: values.map(|value| value >> 16),
            ..at(5, kind, subject, Tag::START)
        },
    )
}

proptest! {
    /// Whatever records there are, slices nest: no end without a beginning.
    #[test]
    fn slices_nest_whatever_is_missing(records in prop::collection::vec(record(), 0..60)) {
        let mut depth = HashMap::<u64, i32>::new();
        for (shape, track, _) in seen(Member::Federate(0), &records).events {
            let depth = depth.entry(track).or_default();
            *depth += match shape {
                SLICE_BEGIN => 1,
                SLICE_END => -1,
                _ => 0,
            };
            prop_assert!(*depth >= 0);
        }
    }
}
