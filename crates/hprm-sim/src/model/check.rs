//! What must be true in every state, and at the end.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use hprm_core::{Coordination, FederateId, Program, ReactionId, Tag};
use hprm_federated::{Frame, Input, RtiInput, Step, Topology};

use super::state::{Seat, State};
use crate::lives::wrong;
use crate::network::{Event, LinkEvent, Place};
use crate::node::Node;
use crate::{Log, difference, reference_until};

/// The judge, which remembers what programs must do.
pub(super) struct Judge {
    program: Arc<Program>,
    topology: Topology,
    references: BTreeMap<Ending, Arc<Log>>,
}

/// What a run depends on: the last tag, and when whose physical action is scheduled.
type Ending = (Tag, Option<(FederateId, Tag)>);

impl Judge {
    pub(super) fn new(program: &Arc<Program>) -> Self {
        Self {
            program: Arc::clone(program),
            topology: Topology::new(program),
            references: BTreeMap::new(),
        }
    }

    /// What is wrong with a state, if anything.
    pub(super) fn state(&self, state: &State) -> Option<String> {
        self.topology.federates().find_map(|me| {
            let seat = state.seats[me].get();
            if seat.node.is_over() {
                return None;
            }
            self.beyond_grant(state, me).or_else(|| self.overtaken(state, me))
        })
    }

    /// Whether a federate has gone beyond its grant.
    fn beyond_grant(&self, state: &State, me: FederateId) -> Option<String> {
        let seat = state.seats[me].get();
        let tag = seat.node.last_tag();
        let waits = self.topology.coordination() == Coordination::Centralized
            && !seat.node.machine.reads_boards()
            && !self.topology.upstream(me).is_empty();
        let needed = match self.topology.is_stepwise(me) {
            true => Step::begin(tag),
            false => Step::end(tag),
        };
        let name = self.topology.name(me);
        (waits && tag > Tag::NEVER && needed > seat.granted)
            .then(|| format!("{name} processes {tag}, but was granted {:?}", seat.granted))
    }

    /// Whether a message is in transit to a federate although a frame that has arrived, or that arrives
    /// before the message, says that there is none.
    fn overtaken(&self, state: &State, me: FederateId) -> Option<String> {
        let Seat { node, granted } = state.seats[me].get();
        let mut granted = node.machine.known_by_boards().unwrap_or(*granted);
        let here = state.place(me);
        for event in state.links.on((Place::Rti, here)) {
            let Event::Federate(_, Input::FromRti(frame)) = event else { continue };
            match frame {
                Frame::TagAdvanceGrant { tag } => granted = granted.max(Step::end(*tag)),
                Frame::ProvisionalTagAdvanceGrant { through } | Frame::Safe { through } => {
                    granted = granted.max(*through);
                }
                Frame::StopGranted { tag } => granted = granted.min(Step::end(tag.pred())),
                frame => {
                    if let Some(wrong) = self.early(frame, node, granted) {
                        return Some(wrong);
                    }
                }
            }
        }
        let elsewhere = state.links.all().filter(|((from, _), _)| *from != Place::Rti);
        elsewhere.flat_map(|(_, events)| frames(events)).find_map(|f| self.early(f, node, granted))
    }

    /// Whether a frame is a message to that federate, for a tag within its grant.
    fn early(&self, frame: &Frame, node: &Node, granted: Step) -> Option<String> {
        let me = node.me.federate;
        let Frame::Message { channel, tag, .. } = frame else { return None };
        let channel = self.program.channels[*channel];
        let read = Step { tag: *tag, level: channel.first_reader };
        let name = self.topology.name(me);
        let means_something = !channel.physical && *tag >= node.first_tag();
        (channel.to == me && means_something && read <= granted)
            .then(|| format!("a message for {read:?} is in transit to {name}, granted {granted:?}"))
    }

    /// What is wrong with a state after which nothing happens, if anything.
    pub(super) fn end(&mut self, state: &State) -> Option<String> {
        let nodes: Vec<_> = state.seats.values().map(|seat| &seat.get().node).collect();
        if !state.finished {
            let at: Vec<_> = nodes.iter().map(|node| node.last_tag()).collect();
            return Some(format!("nothing happens any more, with the federates at {at:?}"));
        }
        if let Some(me) = state.seats.ids().find(|me| !state.seats[*me].get().node.is_over()) {
            return Some(format!("{} waits for ever", self.topology.name(me)));
        }
        let tardy: usize = nodes.iter().map(|node| node.tardy).sum();
        if tardy > 0 {
            return Some(format!("{tardy} messages were tardy"));
        }
        if self.topology.has_transients() && state.failed.is_none() && state.left.is_empty() {
            return self.end_with_transients(state);
        }
        let left = nodes.iter().filter(|node| node.has_left()).map(|node| node.me.federate);
        let left: BTreeSet<_> = state.left.iter().copied().chain(left).collect();
        if state.failed.is_some() || !left.is_empty() {
            return self.early_end(state, &left).or_else(|| self.missed(state));
        }
        let last = nodes.iter().map(|node| node.last_tag()).max().unwrap_or(Tag::NEVER);
        if let Some(node) = nodes.iter().find(|node| !node.finished || node.last_tag() < last) {
            return Some(format!("one ends at {last}, another one at {}", node.last_tag()));
        }
        let must = self.reference(last, state.event);
        difference(&self.program, &merged(&self.program, &nodes), &must, Tag::FOREVER)
    }

    /// What is wrong with the end of a federation with transient federates.
    fn end_with_transients(&self, state: &State) -> Option<String> {
        let nodes: Vec<_> = state.seats.values().map(|seat| &seat.get().node).collect();
        let stop = nodes.iter().map(|node| node.stop_tag()).min().unwrap_or(Tag::FOREVER);
        let early = |node: &&&Node| {
            !self.topology.is_transient(node.me.federate) && node.last_tag() != stop
        };
        if let Some(node) = nodes.iter().find(early) {
            let name = self.topology.name(node.me.federate);
            return Some(format!("{name} ends at {}, but must at {stop}", node.last_tag()));
        }
        let lives = nodes.into_iter().filter_map(|node| node.clone().life());
        let lives: Vec<_> = state.past.get().iter().cloned().chain(lives).collect();
        wrong(&self.program, &lives, (stop, state.lost_from), true)
    }

    /// What is wrong with an end that not all federates have reached in order. Those have left before the others.
    fn early_end(&mut self, state: &State, left: &BTreeSet<FederateId>) -> Option<String> {
        let reachable = left.iter().flat_map(|me| self.topology.reachable(*me));
        let concerned: BTreeSet<_> = reachable.collect();
        let program = Arc::clone(&self.program);
        let must = self.reference(Tag::FOREVER, state.event);
        program.reactions.ids().find_map(|reaction| {
            let me = home(&program, reaction)?;
            let node = &state.seats[me].get().node;
            let (is, must) = (&node.log.entries[reaction], &must.entries[reaction]);
            // What it did because it left, others do at the end.
            let before = if node.has_left() { node.last_tag() } else { Tag::FOREVER };
            let is: Vec<_> = is.iter().filter(|entry| entry.tag < before).cloned().collect();
            let right = if state.failed.is_some() || left.contains(&me) {
                must.starts_with(&is) || concerned.contains(&me)
            } else {
                is == *must || concerned.contains(&me)
            };
            let name = program.reaction_name(reaction);
            (!right).then(|| format!("{name} did {is:?}, but must do {must:?}"))
        })
    }

    /// Whether federates that left in order missed what the others sent them until then.
    fn missed(&self, state: &State) -> Option<String> {
        if state.failed.is_some() || !state.left.is_empty() {
            return None;
        }
        let nodes = || state.seats.values().map(|seat| &seat.get().node);
        let deprived = nodes().find(|node| node.has_left() && node.missed_of(nodes()) > 0)?;
        let name = self.topology.name(deprived.me.federate);
        Some(format!("{name} left at {}, and a message for it came later", deprived.last_tag()))
    }

    fn reference(&mut self, stop: Tag, event: Option<(FederateId, Tag)>) -> Arc<Log> {
        let program = &self.program;
        let reference = || Arc::new(reference_until(program, stop, event, &[]));
        Arc::clone(self.references.entry((stop, event)).or_insert_with(reference))
    }
}

fn frames(events: &VecDeque<Event>) -> impl Iterator<Item = &Frame> {
    events.iter().filter_map(|event| match event {
        Event::Rti(RtiInput::Frame { frame, .. })
        | Event::Peer { link_event: LinkEvent::Frame(frame), .. } => Some(frame),
        _ => None,
    })
}

fn merged(program: &Program, nodes: &[&Node]) -> Log {
    let mut log = Log::new(program);
    for node in nodes {
        for (reaction, entries) in node.log.entries.iter() {
            log.entries[reaction].extend(entries.iter().cloned());
        }
    }
    log
}

fn home(program: &Program, reaction: ReactionId) -> Option<FederateId> {
    program.reactors[program.reactions[reaction].reactor].federate
}
