//! What the coordination needs to know of a program: which federates send to which, and with what delay.
//!
//! Physical channels are here as channels, but no federate waits for them: they are not edges.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{Hash, Hasher};

use hprm_core::{
    Channel, ChannelId, Coordination, Delay, FederateId, Nanos, Origin, Overflow, PhysicalTime,
    Program, Table, Tag,
};

use crate::{Edge, Fault};

/// The federates of a program and the channels between them.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Topology {
    coordination: Coordination,
    names: Table<FederateId, String>,
    channels: Table<ChannelId, Channel>,
    /// How many messages may wait on channels that block their sender.
    bounds: BTreeMap<ChannelId, u32>,
    upstream: Table<FederateId, Vec<Edge>>,
    downstream: Table<FederateId, Vec<Edge>>,
    neighbours: Table<FederateId, BTreeSet<FederateId>>,
    by_clock: Table<FederateId, Option<Nanos>>,
    patient: bool,
    stepwise: Table<FederateId, bool>,
    starves: bool,
    transient: Table<FederateId, bool>,
    has_transients: bool,
    /// Whether a message can lead there from a transient federate.
    after_transient: Table<FederateId, bool>,
    /// The last tag that the program states.
    timeout: Tag,
    start_time_multiple: Nanos,
    reports_all: bool,
}

/// A federation has one topology, which never changes: what is told apart by its hash need not hash it.
impl Hash for Topology {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.names.len().hash(state);
    }
}

/// A channel that blocks its sender, and how many messages may wait.
fn bound(program: &Program, id: ChannelId, channel: &Channel) -> Option<(ChannelId, u32)> {
    let bound = program.connections[channel.connection].bound?;
    (bound.overflow == Overflow::Block).then_some((id, bound.messages.max(1)))
}

impl Topology {
    /// The topology of a program.
    #[must_use]
    pub fn new(program: &Program) -> Self {
        let federates = program.federates.len();
        let mut topology = Self {
            coordination: program.properties.coordination,
            names: program.federates.values().map(|federate| federate.name.clone()).collect(),
            channels: program.channels.values().copied().collect(),
            bounds: program.channels.iter().filter_map(|(id, it)| bound(program, id, it)).collect(),
            upstream: Table::filled(federates, Vec::new()),
            downstream: Table::filled(federates, Vec::new()),
            neighbours: Table::filled(federates, BTreeSet::new()),
            by_clock: Table::filled(federates, None),
            patient: false,
            stepwise: Table::filled(federates, false),
            starves: false,
            transient: program.federates.values().map(|federate| federate.transient).collect(),
            has_transients: program.federates.values().any(|federate| federate.transient),
            after_transient: Table::filled(federates, false),
            start_time_multiple: program.properties.start_time_multiple,
            timeout: match program.properties.timeout {
                Some(timeout) => Tag::new(timeout.max(0), 0),
                None => Tag::FOREVER,
            },
            reports_all: program.properties.reports_all,
        };
        for Channel { from, to, .. } in program.channels.values().filter(|c| c.from != c.to) {
            topology.neighbours[*from].insert(*to);
            topology.neighbours[*to].insert(*from);
        }
        for channel in program.channels.values().filter(|channel| !channel.physical) {
            let Channel { from, to, .. } = *channel;
            note(&mut topology.upstream[to], from, channel);
            note(&mut topology.downstream[from], to, channel);
            let wait = program.connections[channel.connection].absent_after;
            let wait = wait.saturating_add(program.federates[to].maxwait);
            topology.patient |= wait == Nanos::MAX;
        }
        for federate in topology.federates() {
            for edges in [&mut topology.upstream, &mut topology.downstream] {
                edges[federate].sort_unstable_by_key(|edge| edge.federate);
            }
        }
        topology.find_clocks(program);
        let clocked = topology.by_clock.values().any(Option::is_some);
        topology.starves = !program.properties.keepalive && !clocked && !topology.has_transients();
        for federate in topology.zero_delay_cycles().into_iter().flatten() {
            topology.stepwise[federate] = true;
        }
        let transients = topology.federates().filter(|f| topology.transient[*f]);
        let after: Vec<_> = transients.flat_map(|f| topology.reachable(f)).collect();
        after.into_iter().for_each(|federate| topology.after_transient[federate] = true);
        topology
    }

    fn find_clocks(&mut self, program: &Program) {
        let actions = program.actions.values().filter(|action| action.origin == Origin::Physical);
        let actions = actions
            .filter_map(|a| Some((program.reactors[a.reactor].federate?, a.min_delay.max(0))));
        let arrivals = program.connections.values().filter(|connection| connection.physical);
        let arrivals = arrivals.filter_map(|connection| {
            let reactor = program.ports[connection.to].reactor;
            let delay = match connection.delay {
                Delay::Time(delay) => delay,
                Delay::None | Delay::Microstep => 0,
            };
            Some((program.reactors[reactor].federate?, delay))
        });
        for (federate, delay) in actions.chain(arrivals) {
            let least = &mut self.by_clock[federate];
            *least = Some(least.map_or(delay, |least| least.min(delay)));
        }
    }

    /// How the federates are coordinated.
    #[must_use]
    pub fn coordination(&self) -> Coordination {
        self.coordination
    }

    /// All federates, in order.
    pub fn federates(&self) -> impl Iterator<Item = FederateId> + use<> {
        self.names.ids()
    }

    /// The name of a federate, for people; of one that the program lacks, its number.
    #[must_use]
    pub fn name(&self, federate: FederateId) -> String {
        self.names.get(federate).cloned().unwrap_or_else(|| format!("number {}", federate.0))
    }

    /// Whether the program has this federate.
    #[must_use]
    pub fn has(&self, federate: FederateId) -> bool {
        self.names.get(federate).is_some()
    }

    /// All channels, in order.
    #[must_use]
    pub fn channels(&self) -> &Table<ChannelId, Channel> {
        &self.channels
    }

    /// How many messages may wait on a channel that blocks its sender; none, if it does not.
    pub(crate) fn bound(&self, channel: ChannelId) -> Option<u32> {
        self.bounds.get(&channel).copied()
    }

    /// The channel `id`, if it leads from and to the given federates, where they are given.
    ///
    /// # Errors
    ///
    /// If there is no such channel, or it leads elsewhere.
    pub(crate) fn channel(
        &self,
        id: ChannelId,
        from: Option<FederateId>,
        to: Option<FederateId>,
    ) -> Result<Channel, Fault> {
        let leads = |channel: &&Channel| {
            from.is_none_or(|from| from == channel.from) && to.is_none_or(|to| to == channel.to)
        };
        self.channels.get(id).filter(leads).copied().ok_or(Fault::UnknownChannel(id))
    }

    /// The federates that send logical messages to this one.
    #[must_use]
    pub fn upstream(&self, federate: FederateId) -> &[Edge] {
        &self.upstream[federate]
    }

    /// The federates to which this one sends logical messages.
    #[must_use]
    pub fn downstream(&self, federate: FederateId) -> &[Edge] {
        &self.downstream[federate]
    }

    /// The least delay of what one federate sends directly to another, if it sends anything.
    #[must_use]
    pub fn delay(&self, from: FederateId, to: FederateId) -> Option<Delay> {
        let edges = &self.upstream[to];
        let at = edges.binary_search_by_key(&from, |edge| edge.federate).ok()?;
        Some(edges[at].delay)
    }

    /// If a clock can cause events at this federate: by how much, at least, their tags exceed it.
    #[must_use]
    pub fn by_clock(&self, federate: FederateId) -> Option<Nanos> {
        self.by_clock[federate]
    }

    /// Whether some federate waits for some input for ever.
    #[must_use]
    pub fn is_patient(&self) -> bool {
        self.patient
    }

    /// Whether a federate is on a cycle without a delay: it sends to itself, perhaps by way of others. So
    /// it goes through a tag level by level.
    #[must_use]
    pub fn is_stepwise(&self, federate: FederateId) -> bool {
        self.stepwise[federate]
    }

    /// Whether a federate is transient: it may join late, leave, and join again.
    #[must_use]
    pub fn is_transient(&self, federate: FederateId) -> bool {
        self.transient.get(federate).is_some_and(|transient| *transient)
    }

    /// Whether any federate is transient.
    #[must_use]
    pub fn has_transients(&self) -> bool {
        self.has_transients
    }

    /// Whether a federate is downstream of a transient one, perhaps by way of others.
    #[must_use]
    pub fn is_after_transient(&self, federate: FederateId) -> bool {
        self.after_transient[federate]
    }

    /// The federates downstream of a federate, also those by way of others.
    #[must_use]
    pub fn reachable(&self, federate: FederateId) -> Vec<FederateId> {
        let reached = self.reached(federate, &self.downstream, |_| true);
        self.names.ids().filter(|federate| reached[*federate]).collect()
    }

    /// The federates that a channel of any kind connects with this one.
    #[must_use]
    pub fn neighbours(&self, federate: FederateId) -> &BTreeSet<FederateId> {
        &self.neighbours[federate]
    }

    /// The last tag that the program states; `FOREVER` if it states none.
    #[must_use]
    pub fn timeout(&self) -> Tag {
        self.timeout
    }

    /// The physical time of tag zero, for a federation that can start at `earliest`.
    #[must_use]
    pub fn start_time(&self, earliest: PhysicalTime) -> PhysicalTime {
        earliest.next_multiple(self.start_time_multiple)
    }

    /// Whether federates report every next event to the RTI, even if no other federate needs it.
    #[must_use]
    pub fn reports_all(&self) -> bool {
        self.reports_all
    }

    /// For each federate, whether it is on a cycle without a delay, or upstream of one, perhaps by way of
    /// others.
    pub(crate) fn is_before_cycle(&self) -> Table<FederateId, bool> {
        let mut before = self.stepwise.clone();
        let mut pending: Vec<_> = self.names.ids().filter(|federate| before[*federate]).collect();
        while let Some(federate) = pending.pop() {
            for edge in &self.upstream[federate] {
                if !std::mem::replace(&mut before[edge.federate], true) {
                    pending.push(edge.federate);
                }
            }
        }
        before
    }

    /// Whether the program ends when no federate has anything left to do.
    #[must_use]
    pub fn starves(&self) -> bool {
        self.starves
    }

    /// Groups of federates that send to one another on a cycle without any delay.
    #[must_use]
    pub fn zero_delay_cycles(&self) -> Vec<Vec<FederateId>> {
        // Most federates are not on a cycle, and to find that out takes no search.
        let mut grouped = self.outside_cycles();
        let mut cycles = Vec::new();
        for federate in self.names.ids() {
            if grouped[federate] {
                continue;
            }
            let undelayed = |edge: &Edge| edge.delay == Delay::None;
            let after = self.reached(federate, &self.downstream, undelayed);
            let before = self.reached(federate, &self.upstream, undelayed);
            let cycle: Vec<_> = self.names.ids().filter(|f| after[*f] && before[*f]).collect();
            for member in &cycle {
                grouped[*member] = true;
            }
            if !cycle.is_empty() {
                cycles.push(cycle);
            }
        }
        cycles
    }

    /// Federates that cannot be on a cycle without a delay: all undelayed edges that lead to them, or
    /// from them, connect them with other federates of this kind.
    fn outside_cycles(&self) -> Table<FederateId, bool> {
        let mut outside = Table::filled(self.names.len(), false);
        for (before, after) in
            [(&self.upstream, &self.downstream), (&self.downstream, &self.upstream)]
        {
            let is_open = |edge: &&Edge, outside: &Table<FederateId, bool>| {
                edge.delay == Delay::None && !outside[edge.federate]
            };
            let mut open: Table<FederateId, usize> = before
                .values()
                .map(|edges| edges.iter().filter(|edge| is_open(edge, &outside)).count())
                .collect();
            let ends = self.names.ids().filter(|f| open[*f] == 0 && !outside[*f]);
            let mut pending: Vec<_> = ends.collect();
            while let Some(federate) = pending.pop() {
                outside[federate] = true;
                for edge in after[federate].iter().filter(|edge| is_open(edge, &outside)) {
                    open[edge.federate] -= 1;
                    if open[edge.federate] == 0 {
                        pending.push(edge.federate);
                    }
                }
            }
        }
        outside
    }

    /// The federates that can be reached from `federate` by one or more of the edges that count.
    fn reached(
        &self,
        federate: FederateId,
        edges: &Table<FederateId, Vec<Edge>>,
        counts: impl Fn(&Edge) -> bool,
    ) -> Table<FederateId, bool> {
        let mut reached = Table::filled(self.names.len(), false);
        let mut pending = vec![federate];
        while let Some(here) = pending.pop() {
            for edge in edges[here].iter().filter(|edge| counts(edge)) {
                if !std::mem::replace(&mut reached[edge.federate], true) {
                    pending.push(edge.federate);
                }
            }
        }
        reached
    }
}

fn note(edges: &mut Vec<Edge>, federate: FederateId, channel: &Channel) {
    match edges.iter_mut().find(|known| known.federate == federate) {
        Some(known) => known.add(channel),
        None => edges.push(Edge::new(federate, channel)),
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::{Delay, FederateId};

    use super::{Edge, Topology};
    use crate::fixture::program;

    #[test]
    fn the_least_delay_between_two_counts() {
        let topology = Topology::new(&program("a -> b after 5\na -> b after 0\na -> c after 7"));
        let ends = |edges: &[Edge]| -> Vec<_> {
            edges.iter().map(|edge| (edge.federate.0, edge.delay)).collect()
        };
        let expected = [(1, Delay::Microstep), (2, Delay::Time(7))];
        assert_eq!(ends(topology.downstream(FederateId(0))), expected);
        assert_eq!(ends(topology.upstream(FederateId(1))), [(0, Delay::Microstep)]);
    }

    #[test]
    fn a_federation_ends_by_itself_if_no_clock_and_no_other_process_can_cause_an_event() {
        let starves = |text, keepalive| {
            let mut program = program(text);
            program.properties.keepalive = keepalive;
            Topology::new(&program).starves()
        };
        assert!(starves("a -> b\nb -> c after 5", false));
        for text in ["a ~> b", "a -> b\nb ~> c", "transient a\na -> b"] {
            assert!(!starves(text, false), "{text}");
        }
        assert!(!starves("a -> b", true));
    }

    #[test]
    fn federates_on_a_cycle_without_delay_go_level_by_level() {
        let topology = Topology::new(&program("x -> a\na -> b\nb -> c\nc -> a\nc -> y"));
        assert_eq!(topology.zero_delay_cycles(), [[1, 2, 3].map(FederateId)]);
        let stepwise: Vec<_> = topology.federates().map(|f| topology.is_stepwise(f)).collect();
        assert_eq!(stepwise, [false, true, true, true, false]);
    }

    #[test]
    fn cycles_are_found_between_chains() {
        let text = "x -> a\na -> b\nb -> a\nb -> y\ny -> c\nc -> d\nd -> c\nd -> z\nz -> x after 1";
        let topology = Topology::new(&program(text));
        let found: Vec<Vec<_>> = topology
            .zero_delay_cycles()
            .iter()
            .map(|cycle| cycle.iter().map(|federate| topology.name(*federate)).collect())
            .collect();
        assert_eq!(found, [["a", "b"], ["c", "d"]]);
    }

    #[test]
    fn a_delay_or_a_physical_connection_breaks_a_cycle() {
        for last in ["b -> a after 0", "b ~> a"] {
            let topology = Topology::new(&program(&format!("a -> b\n{last}")));
            assert!(topology.zero_delay_cycles().is_empty(), "{last}");
        }
    }

    #[test]
    fn a_physical_input_wakes_a_federate_by_the_clock() {
        let topology = Topology::new(&program("a ~> b after 5\na -> b"));
        assert_eq!(topology.by_clock(FederateId(0)), None);
        assert_eq!(topology.by_clock(FederateId(1)), Some(5));
    }
}
