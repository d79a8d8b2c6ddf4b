//! Why each federate does not go on: a chain from one federate to the one it waits for, and so on, to the one that
//! causes it.
//!
//! Pure: the machines have said what each federate waits for, and this puts it together and into words.

use std::collections::BTreeSet;

use hprm::board::{Blocker, FederationPhase, Hold, Stage, Standing};
use hprm_core::{FederateId, Nanos, Tag};

use super::federation::{Board, Federation, Member, Process, ProcessState};
use super::words::{bytes, clock, tag, time};

/// A part of a federation: a federate, or the RTI.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) enum Part {
    Federate(usize),
    Rti,
}

/// After how long a reaction, or a silence of a loop, is worth to be told with its length.
const LONG: Nanos = 200_000_000;

/// What a part does.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Kind {
    /// It goes through its tags.
    Runs,
    /// It has been within one reaction, or tag, for a while.
    Reacts,
    /// It waits for another part.
    Waits,
    /// It waits for its clock, or has nothing to do.
    Idle,
    /// It does not take part yet.
    Starts,
    /// A signal has stopped its process.
    Stopped,
    /// It has not joined.
    Absent,
    /// Nothing is known of what it does.
    Unseen,
    /// It has ended, or is about to.
    Ended,
}

impl Kind {
    /// What it is called in JSON.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Runs => "running",
            Self::Reacts => "reacting",
            Self::Waits => "waiting",
            Self::Idle => "idle",
            Self::Starts => "starting",
            Self::Stopped => "stopped",
            Self::Absent => "absent",
            Self::Unseen => "unseen",
            Self::Ended => "ended",
        }
    }
}

/// One thing that a part waits for.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Wait {
    /// What it is called in JSON.
    pub(crate) kind: &'static str,
    /// What follows "waits for".
    pub(crate) text: String,
    /// The parts that can end the wait.
    pub(crate) on: Vec<Part>,
}

/// What a part does, in words and as data.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Doing {
    pub(crate) kind: Kind,
    /// What follows the name of the part.
    pub(crate) text: String,
    pub(crate) waits: Vec<Wait>,
}

impl Doing {
    fn new(kind: Kind, text: impl Into<String>) -> Self {
        Self { kind, text: text.into(), waits: Vec::new() }
    }

    /// The parts that it waits for.
    pub(crate) fn on(&self) -> impl Iterator<Item = Part> {
        self.waits.iter().flat_map(|wait| wait.on.iter().copied())
    }
}

impl Federation {
    /// What people call a part.
    pub(crate) fn title(&self, part: Part) -> &str {
        match part {
            Part::Federate(number) => &self.members[number].name,
            Part::Rti => "the RTI",
        }
    }

    /// What a part does.
    pub(crate) fn doing(&self, part: Part) -> Doing {
        match part {
            Part::Federate(number) => self.federate_doing(number),
            Part::Rti => self.rti_doing(),
        }
    }

    /// From a part to the one it waits for, and so on. The last one waits for no other, or for one that is in the
    /// chain already.
    pub(crate) fn chain(&self, part: Part) -> Vec<Part> {
        let mut chain = vec![part];
        let mut here = part;
        loop {
            let doing = self.doing(here);
            let next = doing.on().find(|next| !chain.contains(next));
            match next {
                Some(next) => chain.push(next),
                None => return chain,
            }
            here = chain[chain.len() - 1];
        }
    }

    /// All parts, each after the one it waits for and one step deeper; the federates that wait for no other come
    /// first.
    pub(crate) fn tree(&self) -> Vec<(usize, Part)> {
        let parts: Vec<_> = (0..self.members.len()).map(Part::Federate).collect();
        let mut parents = parts.iter().map(|part| (*part, self.chain(*part).get(1).copied()));
        let parents: Vec<(Part, Option<Part>)> =
            parents.by_ref().chain([(Part::Rti, None)]).collect();
        let mut shown = BTreeSet::new();
        let mut tree = Vec::new();
        let roots = parents.iter().filter(|(_, parent)| parent.is_none());
        for (root, _) in roots {
            add(&parents, (*root, 0), &mut shown, &mut tree);
        }
        // Federates that wait for one another in a cycle.
        for part in parts {
            add(&parents, (part, 0), &mut shown, &mut tree);
        }
        let rti_is_needed = tree.iter().any(|(depth, _)| *depth > 0)
            && parents.iter().any(|(_, parent)| *parent == Some(Part::Rti));
        tree.retain(|(_, part)| *part != Part::Rti || rti_is_needed);
        tree
    }

    fn rti_doing(&self) -> Doing {
        let Some(rti) = &self.rti else {
            return Doing::new(Kind::Unseen, "runs on another machine, or as another user");
        };
        if let Some(stopped) = stopped(&rti.process) {
            return stopped;
        }
        let phase = rti.state.as_ref().map(|state| state.phase);
        Doing::new(
            Kind::Runs,
            match phase {
                None => "begins",
                Some(FederationPhase::Joining) => "waits until all federates have joined",
                Some(FederationPhase::Loading) => {
                    "waits until all federates have loaded their programs"
                }
                Some(FederationPhase::Running) => "runs",
                Some(FederationPhase::Stopping) => "asks all federates for their last tag",
                Some(FederationPhase::Ending) => "waits for the end of all federates",
                Some(FederationPhase::Failed) => {
                    "has told all federates to end, because one has failed"
                }
            },
        )
    }

    fn federate_doing(&self, number: usize) -> Doing {
        let member = &self.members[number];
        let Member { process: Some(process), board: Some(board), .. } = member else {
            return self.unseen(member);
        };
        if let Some(stopped) = stopped(process) {
            return stopped;
        }
        let state = &board.state;
        let since = time(board.ago(state.moment.at));
        match state.stage {
            Stage::Connecting => {
                let on = Vec::from_iter(self.rti.as_ref().map(|_| Part::Rti));
                let text = format!("the RTI, for which it has looked for {since}");
                return waiting(vec![Wait { kind: "rti", text, on }]);
            }
            Stage::Loading => {
                return Doing::new(
                    Kind::Starts,
                    format!("has been loading its program for {since}"),
                );
            }
            Stage::Ending => {
                let text = "has processed its last tag, and sends its last frames";
                return Doing::new(Kind::Ended, text);
            }
            Stage::Joining | Stage::Running => {}
        }
        match (board.begun, state.waits) {
            (Some((at, since)), _) => processing(board, at, board.ago(since)),
            (None, true) => self.waiting(number, board),
            (None, false) => Doing::new(Kind::Runs, runs(board)),
        }
    }

    /// A federate without a board.
    fn unseen(&self, member: &Member) -> Doing {
        match member.known.as_ref().map(|known| (known.standing, known.transient)) {
            Some((Standing::Absent, false)) => Doing::new(Kind::Absent, "has not joined"),
            Some((Standing::Absent, true)) => {
                Doing::new(Kind::Ended, "is transient, and has not joined")
            }
            Some((Standing::Gone, _)) => Doing::new(Kind::Ended, "has ended"),
            Some((Standing::Joined, _)) => {
                Doing::new(Kind::Starts, "loads its program, on another machine or as another user")
            }
            Some((Standing::Ready, _)) | None => {
                Doing::new(Kind::Unseen, "runs on another machine, or as another user")
            }
        }
    }

    fn waiting(&self, number: usize, board: &Board) -> Doing {
        let waits: Vec<_> = board.state.blockers.iter().collect();
        // What else it would wait for when its tag is due makes no difference before.
        if let Some(Blocker::Time { until }) =
            waits.iter().find(|it| matches!(it, Blocker::Time { .. }))
        {
            let next = tag(board.state.next);
            let left = until.since(board.now);
            let text = match left {
                i64::MIN..=-1_000_000_000 => {
                    format!("has not woken up, although its tag {next} was due {} ago", time(-left))
                }
                -999_999_999..=0 => format!("is about to begin its tag {next}"),
                left => format!("waits for its clock: its tag {next} is due in {}", time(left)),
            };
            return Doing::new(Kind::Idle, text);
        }
        let waits: Vec<_> = waits.into_iter().map(|it| self.wait(number, board, it)).collect();
        match waits.is_empty() {
            true => Doing::new(Kind::Runs, runs(board)),
            false => waiting(waits),
        }
    }

    /// What a blocker means.
    fn wait(&self, number: usize, board: &Board, blocker: &Blocker) -> Wait {
        let wait = |kind, text: String, on| Wait { kind, text, on };
        let part = |federate: &FederateId| vec![Part::Federate(federate.index())];
        let rti = || Vec::from_iter(self.rti.as_ref().map(|_| Part::Rti));
        let name = |federate: &FederateId| self.name(*federate);
        match blocker {
            Blocker::RtiLink => wait("rti", "a new link to the RTI".into(), rti()),
            Blocker::Joining => self.joining(),
            Blocker::Loading => {
                wait("loading", "its clock to be compared with the RTI's".into(), rti())
            }
            Blocker::Link { peer } => {
                wait("link", format!("its link to {}", name(peer)), part(peer))
            }
            Blocker::Start => self.start(),
            Blocker::BrokenLink { peer } => {
                let text = format!("the RTI to say why its link to {} has broken", name(peer));
                wait("link", text, part(peer))
            }
            Blocker::Events { from } => events(from, |federate| self.name(federate)),
            Blocker::Time { until } => {
                wait("time", format!("its clock to show {}", clock(*until)), Vec::new())
            }
            Blocker::Stop { tag: held } => self.stop(*held),
            Blocker::Starvation => {
                let text = "the RTI to find out whether other federates have events".into();
                wait("end", text, self.others(number))
            }
            Blocker::Grant { through } => self.grant(number, through.tag),
            Blocker::Message { channel, from, through, until } => {
                let connection = connection(board, channel.0);
                let limit = until.map(|until| time(until.since(board.now).max(0)));
                let limit = limit.map_or_else(String::new, |left| format!(", for {left} more"));
                let text =
                    format!("{} to send on {connection} at {}{limit}", name(from), tag(*through));
                wait("message", text, part(from))
            }
            Blocker::Unprocessed { receiver, bytes: sent, limit } => {
                let (receiver_name, sent, limit) = (name(receiver), bytes(*sent), bytes(*limit));
                let text = format!(
                    "{receiver_name} to process what it has been sent: {sent}, of which {limit} may wait"
                );
                wait("flow-control", text, part(receiver))
            }
            Blocker::Bound { channel, receiver, messages } => {
                let connection = connection(board, channel.0);
                let text = format!(
                    "{} to process a message: {messages} wait on {connection}, which has a bound",
                    name(receiver)
                );
                wait("bound", text, part(receiver))
            }
        }
    }

    /// Centralized coordination: what the RTI waits for before it makes a grant.
    fn grant(&self, number: usize, through: Tag) -> Wait {
        let grant = format!("a grant through {}", tag(through));
        let known = self.members[number].known.as_ref();
        let holds = known.map(|known| known.holds.as_slice()).unwrap_or_default();
        let rti_stands =
            self.rti.as_ref().is_none_or(|rti| rti.process.state != ProcessState::Alive);
        if rti_stands || holds.is_empty() {
            let on = Vec::from_iter(self.rti.as_ref().map(|_| Part::Rti));
            return Wait { kind: "grant", text: format!("{grant} from the RTI"), on };
        }
        let mut on = Vec::new();
        let mut reasons = Vec::new();
        for hold in holds {
            match hold {
                Hold::Upstream { source, .. } if source.index() == number => {
                    reasons.push("it has not reported its next event".to_owned());
                }
                Hold::Upstream { federate, source, arrival } => {
                    let (sender, at) = (self.name(*federate), tag(*arrival));
                    let by = match source == federate {
                        true => String::new(),
                        false => format!(", because of {}", self.name(*source)),
                    };
                    reasons.push(format!("{sender} may still send at {at}{by}"));
                    on.push(Part::Federate(source.index()));
                }
                Hold::Due { tag: at } => {
                    reasons
                        .push(format!("a transient federate may join before {} is due", tag(*at)));
                }
                Hold::InTransit { receiver, .. } => {
                    reasons.push(format!("{} has not reported all messages", self.name(*receiver)));
                    on.push(Part::Federate(receiver.index()));
                }
            }
        }
        on.dedup();
        Wait { kind: "grant", text: format!("{grant}: {}", reasons.join(", and ")), on }
    }

    fn joining(&self) -> Wait {
        let missing = self.members.iter().enumerate().filter(|(_, member)| {
            let known = member.known.as_ref();
            known.is_some_and(|it| it.standing == Standing::Absent && !it.transient)
        });
        self.start_wait("joining", "all federates to join", missing.map(|(number, _)| number))
    }

    fn start(&self) -> Wait {
        let late = self.members.iter().enumerate().filter(|(_, member)| {
            member.known.as_ref().is_some_and(|it| it.standing == Standing::Joined)
        });
        self.start_wait(
            "start",
            "all federates to load their programs",
            late.map(|(number, _)| number),
        )
    }

    fn start_wait(
        &self,
        kind: &'static str,
        all: &str,
        missing: impl Iterator<Item = usize>,
    ) -> Wait {
        let missing: Vec<_> = missing.collect();
        if missing.is_empty() {
            let on = Vec::from_iter(self.rti.as_ref().map(|_| Part::Rti));
            return Wait { kind, text: all.to_owned(), on };
        }
        let names: Vec<_> = missing.iter().map(|it| self.members[*it].name.as_str()).collect();
        let on = missing.iter().copied().map(Part::Federate).collect();
        Wait { kind, text: format!("{all}; missing: {}", names.join(", ")), on }
    }

    fn stop(&self, held: Tag) -> Wait {
        let owes = |member: &Member| member.known.as_ref().is_some_and(|it| it.owes_stop_reply);
        let late = self.members.iter().enumerate().filter(|(_, member)| owes(member));
        let mut on: Vec<_> = late.map(|(number, _)| Part::Federate(number)).collect();
        if on.is_empty() {
            on.extend(self.rti.as_ref().map(|_| Part::Rti));
        }
        let text = format!("the federates to agree on the last tag; it stays before {}", tag(held));
        Wait { kind: "stop", text, on }
    }

    /// The federates but one that have not ended.
    fn others(&self, number: usize) -> Vec<Part> {
        let members = self.members.iter().enumerate();
        let live = members.filter(|(other, it)| *other != number && it.board.is_some());
        live.map(|(other, _)| Part::Federate(other)).collect()
    }

    fn name(&self, federate: FederateId) -> &str {
        self.member(federate).map_or("?", |member| &member.name)
    }
}

/// Adds a part and those that wait for it.
fn add(
    parents: &[(Part, Option<Part>)],
    (part, depth): (Part, usize),
    shown: &mut BTreeSet<Part>,
    tree: &mut Vec<(usize, Part)>,
) {
    if !shown.insert(part) {
        return;
    }
    tree.push((depth, part));
    for (child, _) in parents.iter().filter(|(_, parent)| *parent == Some(part)) {
        add(parents, (*child, depth + 1), shown, tree);
    }
}

fn stopped(process: &Process) -> Option<Doing> {
    let Process { pid, state, .. } = process;
    match state {
        ProcessState::Alive => None,
        ProcessState::Stopped => {
            let text =
                format!("is stopped by a signal or a debugger; kill -CONT {pid} lets it go on");
            Some(Doing::new(Kind::Stopped, text))
        }
        ProcessState::Ended => Some(Doing::new(Kind::Ended, "has just ended")),
    }
}

fn waiting(waits: Vec<Wait>) -> Doing {
    let texts: Vec<_> = waits.iter().map(|wait| wait.text.as_str()).collect();
    let text = format!("waits for {}", texts.join("; and for "));
    let idle = waits.iter().all(|wait| wait.kind == "events");
    Doing { kind: if idle { Kind::Idle } else { Kind::Waits }, text, waits }
}

fn events<'a>(from: &[FederateId], name: impl Fn(FederateId) -> &'a str) -> Wait {
    let on: Vec<_> = from.iter().map(|it| Part::Federate(it.index())).collect();
    let names: Vec<_> = from.iter().map(|it| name(*it)).collect();
    let text = match names.is_empty() {
        true => "an event: it has none, and no federate sends to it".to_owned(),
        false => format!("a message from {}: it has no event of its own", names.join(" or ")),
    };
    Wait { kind: "events", text, on }
}

fn processing(board: &Board, at: Tag, lasts: Nanos) -> Doing {
    if lasts < LONG {
        return Doing::new(Kind::Runs, runs(board));
    }
    let reactions: Vec<_> = board
        .reactions
        .iter()
        .map(|it| match &it.place {
            Some(place) => format!("{} ({place})", it.label),
            None => it.label.clone(),
        })
        .collect();
    let within = match reactions.is_empty() {
        true => String::new(),
        false => format!(", in reaction {}", reactions.join(" and ")),
    };
    let text = format!("has been at tag {} for {}{within}", tag(at), time(lasts));
    Doing::new(Kind::Reacts, text)
}

fn runs(board: &Board) -> String {
    match board.tag() {
        None => "is about to begin its first tag".to_owned(),
        Some(at) => format!("runs; it has come to tag {}", tag(at)),
    }
}

fn connection(board: &Board, channel: u32) -> String {
    match board.channel(channel) {
        Some(it) if it.physical => format!("{} ~> {}", it.from_port, it.to_port),
        Some(it) => format!("{} -> {}", it.from_port, it.to_port),
        None => format!("channel {channel}"),
    }
}

#[cfg(test)]
mod tests;
