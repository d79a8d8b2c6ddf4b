//! The numbers of a trace: of each reaction and each connection.

use std::collections::{BTreeMap, HashMap};

use serde_json::{Value, json};

use super::read::{Event, Shape};

/// What is told of a trace.
#[derive(Clone, PartialEq, Default, Debug)]
pub(crate) struct Statistics {
    pub(crate) reactions: BTreeMap<String, Reaction>,
    pub(crate) connections: BTreeMap<String, Connection>,
    /// How many records are missing.
    pub(crate) lost: u64,
}

/// A reaction.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub(crate) struct Reaction {
    /// How long each of its runs took, in nanoseconds.
    pub(crate) took: Samples,
    /// By how much physical time was after logical time when each began.
    pub(crate) lag: Samples,
    pub(crate) deadlines_missed: u64,
    /// Runs of which the beginning or the end is missing.
    pub(crate) unfinished: u64,
}

/// A connection between federates.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub(crate) struct Connection {
    pub(crate) messages: u64,
    pub(crate) bytes: u64,
    /// Messages whose bytes were copied into the message or into shared memory.
    pub(crate) copies: u64,
    /// From the sender to the receiver, of those that have both.
    pub(crate) latency: Samples,
}

/// Numbers, of which some say what is typical.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub(crate) struct Samples(Vec<i64>);

impl Samples {
    fn add(&mut self, sample: i64) {
        self.0.push(sample);
    }

    fn sort(&mut self) {
        self.0.sort_unstable();
    }

    pub(crate) fn count(&self) -> usize {
        self.0.len()
    }

    pub(crate) fn total(&self) -> i64 {
        self.0.iter().sum()
    }

    /// The smallest sample that is not below so many percent of them; they are sorted.
    pub(crate) fn percentile(&self, percent: usize) -> Option<i64> {
        let rank = (self.0.len() * percent).div_ceil(100);
        self.0.get(rank.saturating_sub(1)).copied()
    }

    pub(crate) fn max(&self) -> Option<i64> {
        self.0.last().copied()
    }

    fn as_json(&self) -> Value {
        json!({"p50": self.percentile(50), "p99": self.percentile(99), "max": self.max()})
    }
}

impl Statistics {
    pub(crate) fn of(events: &[Event]) -> Self {
        let mut all = Self::default();
        // The slices that are open on each track, and the messages that are on their way.
        let (mut open, mut sent) = (HashMap::<u64, Vec<&Event>>::new(), HashMap::new());
        for event in events {
            match event.shape {
                Shape::Begin => {
                    open.entry(event.track).or_default().push(event);
                }
                Shape::End => {
                    let began = open.get_mut(&event.track).and_then(Vec::pop);
                    if let Some(began) = began.filter(|it| it.category == "reaction") {
                        all.ran(began, event.time);
                    }
                }
                Shape::Instant => all.instant(event, &mut sent),
            }
        }
        for event in events.iter().filter(|event| event.category == "message") {
            if let Some(began) = event.ending_flow.and_then(|flow| sent.get(&flow)) {
                let connection = event.texts.get("connection").cloned().unwrap_or_default();
                all.connections.entry(connection).or_default().latency.add(event.time - began);
            }
        }
        for event in open.into_values().flatten().filter(|event| event.category == "reaction") {
            all.reactions.entry(event.name.clone()).or_default().unfinished += 1;
        }
        all.sort();
        all
    }

    fn ran(&mut self, began: &Event, ended: i64) {
        let reaction = self.reactions.entry(began.name.clone()).or_default();
        reaction.took.add(ended - began.time);
        if let Some(lag) = began.numbers.get("lag_ns") {
            reaction.lag.add(*lag);
        }
        let late = began.texts.get("body").is_some_and(|body| body == "deadline handler");
        reaction.deadlines_missed += u64::from(late);
    }

    fn instant(&mut self, event: &Event, sent: &mut HashMap<u64, i64>) {
        let number = |name: &str| event.numbers.get(name).copied().unwrap_or_default();
        let unsigned = |name: &str| u64::try_from(number(name)).unwrap_or_default();
        if event.category == "trace" {
            self.lost += unsigned("lost");
        }
        if event.category != "message" || !event.name.starts_with("send ") {
            return;
        }
        let connection = event.texts.get("connection").cloned().unwrap_or_default();
        let connection = self.connections.entry(connection).or_default();
        connection.messages += 1;
        connection.bytes += unsigned("bytes");
        let transfer = event.texts.get("transfer").map_or("", String::as_str);
        connection.copies +=
            u64::from(transfer.starts_with("copied") || transfer.starts_with("inside"));
        if let Some(flow) = event.flow {
            sent.insert(flow, event.time);
        }
    }

    fn sort(&mut self) {
        for Reaction { took, lag, .. } in self.reactions.values_mut() {
            took.sort();
            lag.sort();
        }
        self.connections.values_mut().for_each(|it| it.latency.sort());
    }

    pub(crate) fn as_json(&self) -> Value {
        let reactions: Vec<_> = self
            .reactions
            .iter()
            .map(|(name, it)| {
                json!({
                    "reaction": name, "count": it.took.count(), "total_ns": it.took.total(),
                    "took_ns": it.took.as_json(), "lag_ns": it.lag.as_json(),
                    "deadlines_missed": it.deadlines_missed, "unfinished": it.unfinished,
                })
            })
            .collect();
        let connections: Vec<_> = self
            .connections
            .iter()
            .map(|(name, it)| {
                json!({
                    "connection": name, "messages": it.messages, "bytes": it.bytes,
                    "copies": it.copies, "latency_ns": it.latency.as_json(),
                })
            })
            .collect();
        json!({"reactions": reactions, "connections": connections, "lost": self.lost})
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_samples() {
        let samples = Samples((1..=200).collect());
        assert_eq!(
            [50, 99, 100].map(|it| samples.percentile(it)),
            [Some(100), Some(198), Some(200)]
        );
        assert_eq!(Samples(vec![7]).percentile(50), Some(7));
        assert_eq!(Samples::default().percentile(99), None);
    }

    fn event(time: i64, shape: Shape, category: &str, name: &str) -> Event {
        Event {
            time,
            track: 1,
            shape,
            category: category.to_owned(),
            name: name.to_owned(),
            numbers: HashMap::new(),
            texts: HashMap::new(),
            flow: None,
            ending_flow: None,
        }
    }

    #[test]
    fn slices_nest_and_messages_have_two_ends() {
        let message = |time, name: &str, flow, ending_flow| Event {
            texts: HashMap::from([("connection".to_owned(), "a -> b".to_owned())]),
            flow,
            ending_flow,
            ..event(time, Shape::Instant, "message", name)
        };
        let all = Statistics::of(&[
            event(10, Shape::Begin, "reaction", "r"),
            event(12, Shape::Begin, "wait", "w"),
            event(13, Shape::End, "", ""),
            event(15, Shape::End, "", ""),
            event(20, Shape::Begin, "reaction", "r"),
            // The receiver may stand before its sender in the file.
            message(33, "receive b", None, Some(9)),
            message(30, "send a", Some(9), None),
            message(31, "send a", Some(8), None),
        ]);
        let reaction = &all.reactions["r"];
        assert_eq!((&reaction.took, reaction.unfinished), (&Samples(vec![5]), 1));
        let connection = &all.connections["a -> b"];
        assert_eq!((connection.messages, &connection.latency), (2, &Samples(vec![3])));
    }
}
