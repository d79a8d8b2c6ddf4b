//! The first difference between two traces.
//!
//! Compared is what reactions did, up to where both runs are complete: if one of them ended earlier,
//! then up to there, because its deployment and the time of a request to stop may decide on its
//! end, but not on what comes before. What depends on the physical world is left out, unless asked for:
//! also all that comes after a federate has left at a tag of the clock, since what is not there has no mark.
//!
//! Whether a deadline is met is for the clock to say, and what follows may look like another fault. So
//! a deadline that was missed in one run only is a difference, and it is the first one, even if its
//! handler has read the clock and nothing else would be compared.

use std::collections::BTreeMap;
use std::io::{BufRead, Seek};

use hprm::trace::line::{
    At, End, Enter, Entry, Read, Reason, RunEnding, Schedule, ScheduleOutcome, Set, Which,
};
use hprm::trace::{Digest, Digester, Group, Reader};

use crate::message::Error;

/// How two traces are compared.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct Judge {
    /// Also what stems from the physical world.
    pub(crate) physical: bool,
}

/// What came out of a comparison.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Comparison {
    /// Reactions that ran in both and did the same.
    pub(crate) equal: usize,
    /// Reactions that were left out, because they stem from the physical world.
    pub(crate) left_out: usize,
    /// Values that could not be looked into; of those, only the types were compared.
    pub(crate) opaque: usize,
    /// Whether a reaction asked the program to stop.
    pub(crate) stops: bool,
    /// The first tag that was not compared, if the ends differ.
    pub(crate) limit: Option<At>,
    /// Where the traces part, if they do.
    pub(crate) divergence: Option<Divergence>,
    /// If that is a deadline whose handler has read the clock, what it has led to.
    pub(crate) consequence: Option<Divergence>,
    /// Such a deadline, as long as nothing has come of it.
    pub(crate) missed: Option<Divergence>,
}

/// The first difference.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Divergence {
    pub(crate) tag: At,
    /// Empty if it is the end that differs.
    pub(crate) reaction: String,
    /// What messages call it.
    pub(crate) name: String,
    pub(crate) what: Difference,
}

/// What differs; first what the first trace has.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) enum Difference {
    /// The reaction ran in one trace only: in the second one, if this is true.
    Ran(bool),
    Body(Which, Which),
    Tardy(Option<At>, Option<At>),
    /// What it found at an input or action.
    Read(String, [Option<Read>; 2]),
    Port(String, [Option<Set>; 2]),
    /// The action that a call scheduled; calls are counted from one.
    Action(usize, [Option<Schedule>; 2]),
    Mode(usize, [Option<Enter>; 2]),
    /// Only one asked for the end: the second one, if this is true.
    Stops(bool),
    /// Only one asked for the end of its federate: the second one, if this is true.
    Leaves(bool),
    End([At; 2]),
}

impl Judge {
    /// Compares two traces from their beginnings.
    ///
    /// # Errors
    ///
    /// If one cannot be read, or they are of different programs.
    pub(crate) fn compare<A, B>(
        self,
        a: &mut Reader<A>,
        b: &mut Reader<B>,
    ) -> Result<Comparison, Error>
    where
        A: BufRead + Seek,
        B: BufRead + Seek,
    {
        if a.header.program != b.header.program {
            let programs = [&a.header, &b.header].map(|header| header.program.as_str());
            return Err(Error::new(format!(
                "{} is a trace of {}, and {} one of {}",
                a.name, programs[0], b.name, programs[1]
            )));
        }
        let mut found = self.compare_all(a, b)?;
        let Comparison { divergence, consequence, missed, .. } = &mut found;
        for parted in [divergence, consequence, missed].into_iter().flatten() {
            // One of the two may have been written in another way, without names.
            let name = b.header.name_of(&parted.reaction);
            a.header
                .names
                .get(&parted.reaction)
                .map_or(name, String::as_str)
                .clone_into(&mut parted.name);
        }
        Ok(found)
    }

    fn compare_all<A, B>(self, a: &mut Reader<A>, b: &mut Reader<B>) -> Result<Comparison, Error>
    where
        A: BufRead + Seek,
        B: BufRead + Seek,
    {
        let mut found = Comparison { limit: limit(&a.end, &b.end), ..Comparison::default() };
        loop {
            let next = [a.next_tag(), b.next_tag()].into_iter().flatten().min();
            let Some(tag) = next.filter(|tag| found.limit.is_none_or(|limit| *tag < limit)) else {
                break;
            };
            let at_tag = |at: Option<At>| at == Some(tag);
            let from_a = if at_tag(a.next_tag()) { a.group()? } else { None };
            let from_b = if at_tag(b.next_tag()) { b.group()? } else { None };
            let one_leaves = !self.physical && one_leaves(from_a.as_ref(), from_b.as_ref());
            self.compare_groups(from_a, from_b, &mut found);
            if found.divergence.is_some() {
                return Ok(found);
            }
            if one_leaves {
                found.limit = Some((tag.0, tag.1 + 1));
            }
        }
        // At which tag federates agree to stop is not decided by the program.
        let agreed = found.stops && (a.header.federated || b.header.federated);
        let by_chance = agreed
            || found.left_out > 0
            || [&a.end, &b.end].iter().any(|end| end.physical || end.outcome != RunEnding::Done);
        if a.end.end != b.end.end && (!by_chance || self.physical) {
            let (tag, what) = (a.end.end.min(b.end.end), Difference::End([a.end.end, b.end.end]));
            found.diverge(Divergence { tag, reaction: String::new(), name: String::new(), what });
        }
        Ok(found)
    }

    fn compare_groups(self, a: Option<Group>, b: Option<Group>, found: &mut Comparison) {
        let [a, b] = [a, b].map(|group| group.map_or(Vec::new(), |group| group.entries));
        for pair in pairs(&a, &b) {
            let ([Some(entry), _] | [None, Some(entry)]) = pair else { continue };
            if !self.physical && pair.into_iter().flatten().any(|entry| entry.physical) {
                found.left_out += 1;
                let missed = missed_once(pair);
                let certain = pair.into_iter().flatten().any(|entry| !entry.physical);
                match missed.map(|what| Divergence::of(entry, what)) {
                    Some(missed) if certain => return found.diverge(missed),
                    Some(missed) if found.missed.is_none() => found.missed = Some(missed),
                    _ => {}
                }
                continue;
            }
            let different = match pair {
                [Some(entry), Some(other)] => self.difference(entry, other, found.limit),
                [in_a, _] => Some(Difference::Ran(in_a.is_none())),
            };
            if let Some(what) = different {
                return found.diverge(Divergence::of(entry, what));
            }
            found.equal += 1;
            found.stops |= entry.stops;
            found.opaque += opaque(entry);
        }
    }

    /// The first difference between what one reaction did in two runs.
    fn difference(self, a: &Entry, b: &Entry, limit: Option<At>) -> Option<Difference> {
        if a.body != b.body {
            return Some(Difference::Body(a.body, b.body));
        }
        if a.tardy != b.tardy {
            return Some(Difference::Tardy(a.tardy, b.tardy));
        }
        if let Some(read) = reads(a, b) {
            return Some(read);
        }
        if let Some(port) = ports(a, b) {
            return Some(port);
        }
        for index in 0..a.schedules.len().max(b.schedules.len()) {
            let pair = [a, b].map(|entry| entry.schedules.get(index));
            if pair[0].map(|call| self.seen(call, limit))
                != pair[1].map(|call| self.seen(call, limit))
            {
                return Some(Difference::Action(index + 1, pair.map(Option::<&_>::cloned)));
            }
        }
        for index in 0..a.enters.len().max(b.enters.len()) {
            let pair = [a, b].map(|entry| entry.enters.get(index));
            if pair[0] != pair[1] {
                return Some(Difference::Mode(index + 1, pair.map(Option::<&_>::cloned)));
            }
        }
        if a.leaves != b.leaves {
            return Some(Difference::Leaves(b.leaves));
        }
        (a.stops != b.stops).then_some(Difference::Stops(b.stops))
    }

    /// A call as far as it can be compared: what happens after the limit depends on the end, and the
    /// tag of a physical action on the clock.
    fn seen(
        self,
        call: &Schedule,
        limit: Option<At>,
    ) -> (&str, Option<ScheduleOutcome>, Option<Digest>) {
        let at = match call.at {
            ScheduleOutcome::At(at) if limit.is_some_and(|limit| at >= limit) => {
                ScheduleOutcome::Not(Reason::AfterStop)
            }
            other => other,
        };
        let known = self.physical || !call.physical;
        (&call.action, known.then_some(at), call.value.as_ref().map(|value| value.digest))
    }
}

impl Comparison {
    fn diverge(&mut self, divergence: Divergence) {
        match self.missed.take() {
            Some(missed) => {
                self.divergence = Some(missed);
                self.consequence = Some(divergence);
            }
            None => self.divergence = Some(divergence),
        }
    }
}

impl Divergence {
    fn of(entry: &Entry, what: Difference) -> Self {
        let reaction = entry.reaction.clone();
        Self { tag: entry.tag, name: reaction.clone(), reaction, what }
    }
}

/// What ran at a tag in two runs, side by side. Before a reaction that ran in both come those that ran
/// in one only and stand before it there: they may be why it did something else.
fn pairs<'a>(a: &'a [Entry], b: &'a [Entry]) -> Vec<[Option<&'a Entry>; 2]> {
    let by_name = |entries: &'a [Entry]| -> BTreeMap<&'a str, &'a Entry> {
        entries.iter().map(|entry| (entry.reaction.as_str(), entry)).collect()
    };
    let (of_a, of_b) = (by_name(a), by_name(b));
    let mut only_b = b.iter().peekable();
    let mut pairs = Vec::new();
    for entry in a {
        let other = of_b.get(entry.reaction.as_str()).copied();
        if other.is_some() {
            while let Some(next) = only_b.next_if(|next| next.reaction != entry.reaction) {
                if !of_a.contains_key(next.reaction.as_str()) {
                    pairs.push([None, Some(next)]);
                }
            }
        }
        pairs.push([Some(entry), other]);
    }
    let rest = only_b.filter(|next| !of_a.contains_key(next.reaction.as_str()));
    pairs.extend(rest.map(|next| [None, Some(next)]));
    pairs
}

/// Whether the clock has a federate leave in one run, and it goes on in the other one.
fn one_leaves(a: Option<&Group>, b: Option<&Group>) -> bool {
    let [of_a, of_b] = [a, b].map(|group| {
        let entries = group.into_iter().flat_map(|group| &group.entries);
        let leaving = entries.filter(|entry| entry.leaves);
        leaving.map(|entry| (entry.reaction.as_str(), entry.physical)).collect::<BTreeMap<_, _>>()
    });
    let only = |here: &BTreeMap<&str, bool>, there: &BTreeMap<&str, bool>| {
        here.iter().any(|(reaction, physical)| *physical && !there.contains_key(reaction))
    };
    only(&of_a, &of_b) || only(&of_b, &of_a)
}

/// The difference, if a reaction missed its deadline in one of two runs.
fn missed_once(pair: [Option<&Entry>; 2]) -> Option<Difference> {
    let [Some(a), Some(b)] = pair else { return None };
    let missed = [a, b].map(|entry| entry.body == Which::Deadline);
    (missed[0] != missed[1]).then_some(Difference::Body(a.body, b.body))
}

/// One number for all that is compared of a trace, up to `limit`.
///
/// # Errors
///
/// If it cannot be read.
pub(crate) fn digest<R: BufRead + Seek>(
    judge: Judge,
    trace: &mut Reader<R>,
    limit: Option<At>,
) -> Result<Digest, Error> {
    let mut digester = Digester::new();
    while let Some(group) = trace.group()? {
        if limit.is_some_and(|limit| group.tag >= limit) {
            break;
        }
        for entry in group.entries.iter().filter(|entry| judge.physical || !entry.physical) {
            let calls = entry.schedules.iter().map(|call| judge.seen(call, limit));
            let sets = entry.sets.iter().map(|set| (&set.port, set.value.digest));
            let (calls, sets): (Vec<_>, Vec<_>) = (calls.collect(), sets.collect());
            let which = (entry.tag, &entry.reaction, entry.body, entry.tardy);
            let reads = entry.reads.iter().map(|read| {
                (&read.from, read.value.as_ref().map(|value| value.digest), read.remembered)
            });
            let reads: Vec<_> = reads.collect();
            let all = (which, reads, sets, calls, &entry.enters, entry.stops, entry.leaves);
            let text = serde_json::to_vec(&all).expect("what was read can be written");
            digester.write(&text);
        }
    }
    Ok(digester.finish())
}

/// The first tag that cannot be compared, if the runs ended differently.
fn limit(a: &End, b: &End) -> Option<At> {
    let in_order = |end: &End| matches!(end.outcome, RunEnding::Done | RunEnding::Interrupted);
    let same = a.end == b.end && in_order(a) && in_order(b);
    (!same).then_some(a.end.min(b.end))
}

/// The first input or action at which a reaction found something else.
fn reads(a: &Entry, b: &Entry) -> Option<Difference> {
    let known = |entry: &Entry| {
        let known = entry.reads.iter().map(|read| {
            let digest = read.value.as_ref().map(|value| value.digest);
            (read.from.clone(), (digest, read.remembered))
        });
        known.collect::<BTreeMap<_, _>>()
    };
    let (in_a, in_b) = (known(a), known(b));
    let from = a.reads.iter().chain(&b.reads).map(|read| &read.from);
    let from = from.into_iter().find(|from| in_a.get(*from) != in_b.get(*from))?;
    let of = |entry: &Entry| entry.reads.iter().find(|read| read.from == *from).cloned();
    Some(Difference::Read(from.clone(), [of(a), of(b)]))
}

/// The first port whose value differs.
fn ports(a: &Entry, b: &Entry) -> Option<Difference> {
    let values = |entry: &Entry| {
        let digests = entry.sets.iter().map(|set| (set.port.clone(), set.value.digest));
        digests.collect::<BTreeMap<_, _>>()
    };
    let (in_a, in_b) = (values(a), values(b));
    let ports = a.sets.iter().chain(&b.sets).map(|set| &set.port);
    let port = ports.into_iter().find(|port| in_a.get(*port) != in_b.get(*port))?;
    let of = |entry: &Entry| entry.sets.iter().find(|set| set.port == *port).cloned();
    Some(Difference::Port(port.clone(), [of(a), of(b)]))
}

/// How many values of an entry could not be looked into.
fn opaque(entry: &Entry) -> usize {
    let values = entry.sets.iter().map(|set| &set.value);
    let values = values.chain(entry.schedules.iter().filter_map(|call| call.value.as_ref()));
    let values = values.chain(entry.reads.iter().filter_map(|read| read.value.as_ref()));
    values.filter(|value| value.opaque).count()
}

#[cfg(test)]
mod tests;
