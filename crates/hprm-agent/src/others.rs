//! The other agents: those that this one reaches, and those that only routers reach.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{Nanos, PhysicalTime};

use crate::carrier::AgentId;

/// The most agents that are reached, and the most ways through routers to others.
const AGENTS: usize = 1024;
const WAYS: usize = 4096;

/// For how long an agent must be behind a router before that is a way: two that have just come meet directly within this
/// time, if they can.
const SETTLING: Nanos = 1_000_000_000;

/// An agent, and how it is reached: directly, or through the agent of another machine.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Reached {
    pub(crate) agent: AgentId,
    pub(crate) router: Option<String>,
}

/// See the module.
#[derive(Default)]
pub(crate) struct Others {
    direct: BTreeSet<AgentId>,
    /// By agent and router, since when.
    behind: BTreeMap<(AgentId, String), PhysicalTime>,
}

impl Others {
    /// Takes note that an agent is reached, or not any more.
    pub(crate) fn set(&mut self, agent: AgentId, is_there: bool) {
        if !is_there {
            self.direct.remove(&agent);
        } else if self.direct.len() < AGENTS {
            self.direct.insert(agent);
        }
    }

    /// The same, of an agent that a router reaches.
    pub(crate) fn set_behind(
        &mut self,
        now: PhysicalTime,
        router: String,
        agent: AgentId,
        is_there: bool,
    ) {
        if !is_there {
            self.behind.remove(&(agent, router));
        } else if self.behind.len() < WAYS {
            self.behind.entry((agent, router)).or_insert(now);
        }
    }

    /// Forgets all of them.
    pub(crate) fn clear(&mut self) {
        *self = Self::default();
    }

    /// The agents that are reached without a router.
    pub(crate) fn direct(&self) -> Vec<AgentId> {
        self.direct.iter().cloned().collect()
    }

    /// Whether this agent is reached without a router.
    pub(crate) fn are_direct(&self, agent: &AgentId) -> bool {
        self.direct.contains(agent)
    }

    /// Whether the agent of a machine is reached without a router.
    pub(crate) fn reaches(&self, machine: &str) -> bool {
        self.direct.iter().any(|agent| agent.machine == machine)
    }

    /// How the agent of a machine is reached.
    pub(crate) fn find(&self, machine: &str, now: PhysicalTime) -> Option<Reached> {
        self.all(now).into_iter().find(|other| other.agent.machine == machine)
    }

    /// All other machines, by name. Of several agents of one name, the oldest counts.
    pub(crate) fn all(&self, now: PhysicalTime) -> Vec<Reached> {
        let direct = self.direct.iter();
        let direct = direct.map(|agent| Reached { agent: agent.clone(), router: None });
        let settled = self.behind.iter().filter(|(_, since)| now >= since.plus(SETTLING));
        let behind = settled.map(|((agent, router), _)| Reached {
            agent: agent.clone(),
            router: Some(router.clone()),
        });
        let mut all: Vec<_> = direct.chain(behind).collect();
        // Those that are reached directly first; the rest is in order already.
        all.sort_by(|one, other| {
            let key = |it: &Reached| (it.agent.machine.clone(), it.router.is_some());
            key(one).cmp(&key(other))
        });
        all.dedup_by(|later, earlier| later.agent.machine == earlier.agent.machine);
        all
    }

    /// Whether an agent is there that is older than another one, and has its name.
    pub(crate) fn have_older(&self, me: &AgentId, and_behind: bool) -> bool {
        let behind = self.behind.keys().map(|(agent, _)| agent).filter(|_| and_behind);
        let mut known = self.direct.iter().chain(behind);
        known.any(|other| other.machine == me.machine && other < me)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn agent(machine: &str, epoch: u64) -> AgentId {
        AgentId { machine: machine.to_owned(), epoch }
    }

    fn shown(others: &Others, now: i64) -> Vec<String> {
        let show = |it: Reached| {
            format!("{} {} {}", it.agent.machine, it.agent.epoch, it.router.unwrap_or_default())
        };
        others.all(PhysicalTime(now)).into_iter().map(show).collect()
    }

    #[test]
    fn an_agent_is_reached_directly_if_it_can_be_and_else_through_the_first_router() {
        let mut others = Others::default();
        for (router, agent) in [("r2", agent("b", 2)), ("r1", agent("b", 2)), ("r1", agent("a", 9))]
        {
            others.set_behind(PhysicalTime(5), router.to_owned(), agent, true);
        }
        assert_eq!(shown(&others, 5), Vec::<String>::new());
        let now = 5 + SETTLING;
        assert_eq!(shown(&others, now), ["a 9 r1", "b 2 r1"]);
        others.set(agent("b", 7), true);
        assert!(others.reaches("b") && !others.reaches("a"));
        assert_eq!(shown(&others, now), ["a 9 r1", "b 7 "]);
        others.set(agent("b", 7), false);
        others.set_behind(PhysicalTime(now), "r1".to_owned(), agent("b", 2), false);
        assert_eq!(shown(&others, now), ["a 9 r1", "b 2 r2"]);
        assert_eq!(others.find("b", PhysicalTime(now)).unwrap().router.unwrap(), "r2");
    }

    #[test]
    fn the_older_agent_of_a_name_counts() {
        let mut others = Others::default();
        for epoch in [3, 2] {
            others.set_behind(PhysicalTime(0), "r".to_owned(), agent("a", epoch), true);
        }
        assert_eq!(shown(&others, SETTLING), ["a 2 r"]);
        assert!(others.have_older(&agent("a", 3), true));
        assert!(!others.have_older(&agent("a", 3), false));
        assert!(!others.have_older(&agent("a", 2), true));
        others.set(agent("a", 1), true);
        assert!(others.have_older(&agent("a", 2), false));
    }
}
