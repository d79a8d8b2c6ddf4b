//! Relayed links, packet by packet; `hprm-sim` runs random ones.

use super::*;

const MS: Nanos = 1_000_000;

fn at(millis: i64) -> PhysicalTime {
    PhysicalTime(millis * MS)
}

/// Two ends, and what they have put out that is no packet.
struct Pair {
    ends: [Relay; 2],
    told: [Vec<Output>; 2],
    now: PhysicalTime,
}

impl Pair {
    fn new() -> Self {
        let ends = [Relay::new(11, at(0)), Relay::new(22, at(0))];
        Self { ends, told: [vec![], vec![]], now: at(0) }
    }

    fn give(&mut self, end: usize, input: Input) {
        self.ends[end].handle(self.now, input).unwrap();
    }

    /// What one end puts out now; packets apart.
    fn drain(&mut self, end: usize) -> Vec<Vec<u8>> {
        let mut packets = vec![];
        while let Some(output) = self.ends[end].poll() {
            match output {
                Output::Packet(packet) => packets.push(packet.into_vec()),
                other => self.told[end].push(other),
            }
        }
        packets
    }

    /// Exchanges packets until none is left; those of an end for which `lost` says so are lost.
    fn settle(&mut self, lost: [bool; 2]) {
        loop {
            let packets = [self.drain(0), self.drain(1)];
            if packets.iter().all(Vec::is_empty) {
                return;
            }
            for (from, packets) in packets.into_iter().enumerate() {
                for packet in packets.into_iter().filter(|_| !lost[from]) {
                    self.give(1 - from, Input::Packet(packet.into()));
                }
            }
        }
    }

    /// Lets time pass, each end being told when it has asked for it.
    fn pass(&mut self, until: PhysicalTime, lost: [bool; 2]) {
        loop {
            let due = self.ends[0].next_wakeup().min(self.ends[1].next_wakeup());
            self.now = due.max(self.now).min(until);
            self.give(0, Input::Wake);
            self.give(1, Input::Wake);
            self.settle(lost);
            if self.now == until {
                return;
            }
        }
    }

    /// Why the link has ended at an end.
    fn ends(&self, end: usize) -> Vec<End> {
        let ended = |output: &'_ Output| match output {
            Output::Ended(end) => Some(end.clone()),
            _ => None,
        };
        self.told[end].iter().filter_map(ended).collect()
    }

    /// Both ends know each other.
    fn acquainted() -> Self {
        let mut pair = Self::new();
        pair.settle([false; 2]);
        pair
    }
}

/// A packet as the first end of a pair would send it.
fn packet(body: Body, edit: impl Fn(&mut Header), bytes: &[u8]) -> Input {
    let mut header = Header::between(11, 22, body);
    (header.frame_limit, header.byte_limit) = (WINDOW_FRAMES, WINDOW_BYTES);
    edit(&mut header);
    Input::Packet([&header.encode(), bytes].concat().into())
}

fn frame(number: u64, bytes: &[u8]) -> Input {
    let len = u32::try_from(bytes.len()).unwrap();
    packet(Body::Frame { number, len }, |_| {}, bytes)
}

#[test]
fn frames_and_the_end_come_in_order_at_both_ends() {
    let mut pair = Pair::new();
    for end in [0, 1] {
        pair.give(end, Input::Frame(vec![1].into()));
        pair.give(end, Input::Frame(vec![].into()));
    }
    pair.give(0, Input::Finish);
    pair.settle([false; 2]);
    // The other direction is open.
    pair.give(1, Input::Frame(vec![3].into()));
    pair.give(1, Input::Finish);
    pair.settle([false; 2]);
    let frame = |bytes: &[u8]| Output::Frame(bytes.to_vec().into());
    let end = Output::Ended(End::Finished);
    assert_eq!(pair.told[0], [frame(&[1]), frame(&[]), frame(&[3]), Output::Finished, end.clone()]);
    assert_eq!(pair.told[1], [frame(&[1]), frame(&[]), Output::Finished, end]);
    assert!(!pair.ends[0].is_over(at(19_000)) && pair.ends[0].is_over(at(20_000)));
}

#[test]
fn what_comes_early_waits_and_what_comes_twice_is_dropped() {
    let mut pair = Pair::acquainted();
    for (number, bytes) in [(2, [2]), (1, [1]), (2, [2]), (0, [0]), (1, [1])] {
        pair.give(1, frame(number, &bytes));
    }
    pair.drain(1);
    let frames = [0, 1, 2].map(|byte| Output::Frame(vec![byte].into()));
    assert_eq!(pair.told[1], frames);
    assert_eq!(pair.ends[1].dropped().duplicates, 2);
}

#[test]
fn more_gaps_than_an_answer_has_room_for_are_filled() {
    let mut pair = Pair::acquainted();
    (0..60).for_each(|number| pair.give(0, Input::Frame(vec![number].into())));
    // They are lost, then every other one is once more, and so are all answers until the frames count as lost.
    pair.drain(0);
    pair.give(0, Input::CarrierDown);
    pair.give(0, Input::CarrierUp);
    for packet in pair.drain(0).into_iter().filter(|it| it.last().is_some_and(|last| last % 2 == 1))
    {
        pair.give(1, Input::Packet(packet.into()));
    }
    pair.drain(1);
    pair.pass(at(250), [true, false]);
    assert!(pair.told[1].is_empty());
    pair.pass(at(10_000), [false, false]);
    let frames: Vec<_> = (0..60).map(|number| Output::Frame(vec![number].into())).collect();
    assert_eq!(pair.told[1], frames);
}

#[test]
fn one_answer_is_enough_for_all_that_has_come() {
    let mut pair = Pair::acquainted();
    for number in 0..20 {
        pair.give(1, frame(number, &[7]));
    }
    let packets = pair.drain(1);
    let [answer] = &packets[..] else { panic!("{} packets", packets.len()) };
    assert_eq!(Header::decode(answer).unwrap().0.next, 20);
    assert_eq!(pair.told[1].len(), 20);
}

#[test]
fn an_answer_to_little_goes_with_the_next_frame_or_leaves_after_a_moment() {
    for speaks in [false, true] {
        let mut pair = Pair::acquainted();
        pair.give(1, frame(0, &[7]));
        pair.give(1, Input::Taken(1));
        assert_eq!((pair.drain(1).len(), pair.ends[1].next_wakeup()), (0, at(1)));
        if speaks {
            pair.give(1, Input::Frame(vec![8].into()));
            assert_eq!(Header::decode(&pair.drain(1)[0]).unwrap().0.next, 1);
        }
        pair.now = at(1);
        pair.give(1, Input::Wake);
        assert_eq!(pair.drain(1).len(), usize::from(!speaks));
        assert!(pair.ends[1].next_wakeup() > at(1));
    }
    // While the carrier is down, it waits for that alone.
    let mut pair = Pair::acquainted();
    pair.give(1, frame(0, &[7]));
    pair.give(1, Input::CarrierDown);
    assert!(pair.ends[1].next_wakeup() > at(1));
    pair.give(1, Input::CarrierUp);
    assert_eq!(pair.drain(1).len(), 1);
}

#[test]
fn an_answer_to_much_and_to_what_is_out_of_order_leaves_at_once() {
    let long = vec![7; 16 << 10];
    let few = (0..4).map(|number| frame(number, &[7])).collect();
    let finish = packet(Body::Finish { number: 0 }, |_| {}, &[]);
    let asks = packet(Body::Nothing, |header| header.asks = true, &[]);
    let twice = vec![frame(0, &[7]), frame(0, &[7])];
    for inputs in
        [few, vec![frame(0, &long)], vec![frame(1, &[7])], twice, vec![finish], vec![asks]]
    {
        let mut pair = Pair::acquainted();
        inputs.into_iter().for_each(|input| pair.give(1, input));
        assert_eq!(pair.drain(1).len(), 1);
    }
}

#[test]
fn the_bytes_of_a_frame_are_not_copied() {
    let mut pair = Pair::acquainted();
    let bytes = vec![7; FRAME_LIMIT];
    let at = bytes.as_ptr();
    pair.give(0, Input::Frame(bytes.into()));
    let Some(Output::Packet(packet)) = pair.ends[0].poll() else { panic!("nothing leaves") };
    assert_eq!(packet.frame.as_ref().map(|frame| frame.as_ptr()), Some(at));
    let whole = packet.into_vec();
    let there = whole.as_ptr_range().end;
    pair.give(1, Input::Packet(whole.into()));
    let Some(Output::Frame(frame)) = pair.ends[1].poll() else { panic!("nothing comes") };
    assert_eq!((frame.len(), frame.as_ptr_range().end), (FRAME_LIMIT, there));
}

#[test]
fn bytes_that_are_no_packet_change_nothing() {
    let mut pair = Pair::acquainted();
    let Input::Packet(good) = frame(0, b"whole") else { unreachable!() };
    let mut other_version = good.to_vec();
    other_version[0] = 9;
    let long = vec![0; FRAME_LIMIT + 1];
    let mut bad = vec![vec![], vec![0xff; 40], other_version, [&good[..], &[0]].concat()];
    bad.extend((0..good.len()).map(|len| good[..len].to_vec()));
    let Input::Packet(longer) = frame(0, &long) else { unreachable!() };
    bad.extend([longer.to_vec(), vec![1; 1 << 20]]);
    let count = bad.len() as u64;
    let before =
        Relay { dropped: Dropped { unreadable: count, duplicates: 0 }, ..pair.ends[1].clone() };
    for bytes in bad {
        pair.give(1, Input::Packet(bytes.into()));
    }
    assert_eq!(pair.ends[1], before);
    pair.give(1, Input::Packet(good));
    pair.drain(1);
    assert_eq!(pair.told[1], [Output::Frame(b"whole".to_vec().into())]);
}

#[test]
fn a_packet_against_the_rules_ends_the_link_at_both_ends() {
    let finish = |number| packet(Body::Finish { number }, |_| {}, &[]);
    let beyond = |next, held: &[(u32, u32)]| {
        let held = held.to_vec();
        packet(Body::Nothing, move |header| (header.next, header.held) = (next, held.clone()), &[])
    };
    let full = vec![7; FRAME_LIMIT];
    let count = WINDOW_BYTES / FRAME_LIMIT as u64;
    let too_much = (0..=count).map(|number| frame(number, &full)).collect();
    let cases: [(Vec<Input>, Violation); 7] = [
        (vec![beyond(1, &[])], Violation::Acknowledged),
        (vec![beyond(0, &[(1, 1)])], Violation::Acknowledged),
        (vec![beyond(u64::MAX, &[(u32::MAX, 1)])], Violation::Acknowledged),
        (vec![frame(WINDOW_FRAMES, &[1])], Violation::Credit),
        (too_much, Violation::Credit),
        (vec![finish(1), frame(2, &[1])], Violation::AfterEnd),
        (vec![frame(2, &[1]), finish(1)], Violation::AfterEnd),
    ];
    for (inputs, violation) in cases {
        let mut pair = Pair::acquainted();
        inputs.into_iter().for_each(|input| pair.give(1, input));
        pair.settle([false; 2]);
        assert_eq!(pair.ends(1), [End::Broken(violation)]);
        assert_eq!(pair.ends(0), [End::Blamed]);
    }
}

#[test]
fn an_end_that_was_started_again_ends_the_link_whichever_speaks_first() {
    for first in [0, 1] {
        let mut pair = Pair::acquainted();
        pair.give(1, Input::Frame(vec![1].into()));
        pair.drain(1);
        pair.ends[1] = Relay::new(33, pair.now);
        pair.now = at(1_000);
        // The other one's packets tell the new life that it had another one before, or its own tell the other one.
        pair.give(first, Input::Wake);
        for packet in pair.drain(first) {
            pair.give(1 - first, Input::Packet(packet.into()));
        }
        pair.settle([false; 2]);
        assert_eq!([pair.ends(0), pair.ends(1)], [[End::Restarted], [End::Restarted]]);
    }
}

#[test]
fn a_link_that_is_not_known_is_refused_and_a_refusal_is_not() {
    let mut pair = Pair::acquainted();
    pair.give(0, Input::Frame(vec![1].into()));
    let packets = pair.drain(0);
    let refusal = Relay::refusal(&packets[0]).unwrap();
    assert_eq!(Relay::refusal(&refusal), None);
    assert_eq!(Relay::refusal(b"garbage"), None);
    pair.give(0, Input::Packet(refusal.into()));
    pair.drain(0);
    assert_eq!(pair.ends(0), [End::Unknown]);
}

#[test]
fn an_end_that_gives_up_says_why_even_if_it_must_say_it_twice() {
    for lost in [false, true] {
        let mut pair = Pair::acquainted();
        let why = "ü".repeat(1_000);
        pair.give(0, Input::Abort(why.clone()));
        pair.settle([lost, false]);
        pair.pass(at(1_500), [false; 2]);
        assert_eq!(pair.ends(0), [End::Aborted(why)]);
        assert_eq!(pair.ends(1), [End::PeerAborted("ü".repeat(128))]);
        assert_eq!(pair.ends[0].room(), 0);
    }
}

#[test]
fn a_frame_without_room_is_refused_and_changes_nothing() {
    let mut pair = Pair::new();
    let mut count = 0;
    while pair.ends[0].room() > 0 {
        pair.give(0, Input::Frame(vec![0; pair.ends[0].room()].into()));
        count += 1;
    }
    assert_eq!(count, WINDOW_BYTES / FRAME_LIMIT as u64);
    let before = pair.ends[0].clone();
    let given = pair.ends[0].handle(pair.now, Input::Frame(vec![1].into()));
    assert_eq!((given, &pair.ends[0]), (Err(NoRoom(1)), &before));
    let mut pair = Pair::new();
    pair.give(0, Input::Finish);
    assert_eq!(pair.ends[0].room(), 0);
}

#[test]
fn a_reader_that_takes_nothing_stops_the_writer_and_its_memory_is_bounded() {
    let mut pair = Pair::acquainted();
    for round in 1..200 {
        while pair.ends[0].room() >= 1_000 {
            pair.give(0, Input::Frame(vec![0; 1_000].into()));
        }
        pair.pass(at(100 * round), [false; 2]);
    }
    assert_eq!(pair.told[1].len() as u64, WINDOW_FRAMES);
    for _ in 0..WINDOW_FRAMES {
        pair.give(1, Input::Taken(1_000));
    }
    pair.settle([false; 2]);
    assert_eq!(pair.told[1].len() as u64, 2 * WINDOW_FRAMES);
}

#[test]
fn silence_ends_the_link_at_both_ends_in_time() {
    for lost in [[true, true], [true, false], [false, true]] {
        let mut pair = Pair::acquainted();
        pair.pass(at(5_000), [false; 2]);
        pair.pass(at(5_000 + 19_900), lost);
        assert!(pair.ends(0).is_empty() && pair.ends(1).is_empty());
        pair.pass(at(5_000 + 22_000), lost);
        let silent = |end: &End| matches!(end, End::Silent(silence) if *silence >= SILENCE);
        let ends = [pair.ends(0), pair.ends(1)];
        assert!(ends.iter().flatten().any(silent), "{ends:?}");
        let fits = |end: &End| silent(end) || *end == End::Unheard;
        assert!(ends.iter().all(|ends| ends.len() == 1 && fits(&ends[0])), "{lost:?}: {ends:?}");
    }
}

#[test]
fn an_end_that_was_paused_itself_asks_before_it_gives_up() {
    let mut pair = Pair::acquainted();
    // A question has just left when the pause begins; its answer waits.
    pair.now = at(1_000);
    pair.give(0, Input::Wake);
    let question = pair.drain(0);
    pair.now = at(60_000);
    pair.give(0, Input::Wake);
    assert!(!question.is_empty() && !pair.drain(0).is_empty());
    assert!(pair.ends(0).is_empty());
    // If it stays silent, that is an end.
    let answer = pair.ends[0].next_wakeup();
    assert!(answer <= at(62_000));
    pair.now = at(61_000);
    pair.give(0, Input::Wake);
    assert!(!pair.drain(0).is_empty());
    pair.now = at(62_000);
    pair.give(0, Input::Wake);
    pair.drain(0);
    assert_eq!(pair.ends(0), [End::Silent(62_000 * MS)]);
}

#[test]
fn a_break_of_the_carrier_is_made_up_for_as_soon_as_it_works() {
    let mut pair = Pair::acquainted();
    pair.give(0, Input::Frame(vec![1].into()));
    pair.drain(0);
    pair.give(0, Input::CarrierDown);
    pair.give(0, Input::Frame(vec![2].into()));
    pair.now = at(10);
    assert!(pair.drain(0).is_empty(), "the carrier is down");
    pair.give(0, Input::CarrierUp);
    pair.settle([false; 2]);
    assert_eq!(pair.told[1], [Output::Frame(vec![1].into()), Output::Frame(vec![2].into())]);
}

#[test]
fn of_what_is_only_late_one_frame_is_sent_again_and_the_next_time_none() {
    let mut pair = Pair::acquainted();
    let mut again = 0;
    for round in 0..2 {
        let began = pair.now;
        (0..40).for_each(|byte| pair.give(0, Input::Frame(vec![byte].into())));
        let late = pair.drain(0);
        assert_eq!(late.len(), 40);
        while pair.now < began.plus(500 * MS) {
            pair.now = pair.ends[0].next_wakeup().min(began.plus(500 * MS));
            pair.give(0, Input::Wake);
            again += pair.drain(0).len();
        }
        for packet in late {
            pair.give(1, Input::Packet(packet.into()));
            let answers = pair.drain(1);
            answers.into_iter().for_each(|answer| pair.give(0, Input::Packet(answer.into())));
            again += pair.drain(0).len();
        }
        assert_eq!((again, pair.told[1].len()), (1, 40 * (round + 1)));
    }
}

#[test]
fn what_is_lost_at_the_end_is_sent_again_once_one_of_it_has_arrived() {
    let mut pair = Pair::acquainted();
    (0..40).for_each(|byte| pair.give(0, Input::Frame(vec![byte].into())));
    assert_eq!(pair.drain(0).len(), 40);
    pair.pass(at(500), [false; 2]);
    let frames: Vec<_> = (0..40).map(|byte| Output::Frame(vec![byte].into())).collect();
    assert_eq!(pair.told[1], frames);
    assert_eq!(pair.ends[1].dropped().duplicates, 0);
}
