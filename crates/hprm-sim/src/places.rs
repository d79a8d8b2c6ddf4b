//! Which processes are a federate, as the outputs of the RTI tell it. Supervisors believe that, so it is compared here with
//! what has happened to the processes.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::FederateId;
use hprm_federated::{LinkId, RtiOutput};

use crate::network::Instance;

/// See the module.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places {
    has_started: bool,
    members: BTreeMap<FederateId, LinkId>,
    joining: BTreeMap<FederateId, LinkId>,
    /// How many processes did not take part, while the one ran whose place they would have taken.
    pub(crate) withdrawn: usize,
}

impl Places {
    /// The RTI tells something. Returns what is wrong with that, if anything. A process `is_well` that runs, and that the RTI
    /// can reach over that link.
    pub(crate) fn told(
        &mut self,
        output: &RtiOutput,
        by_hand: &BTreeSet<Instance>,
        is_well: impl Fn(LinkId) -> bool,
    ) -> Option<String> {
        let is_by_hand = |link: LinkId| by_hand.contains(&Instance::of_link(link));
        let gone = |link: Option<LinkId>, what: &str| match link {
            None => Some(format!("the RTI says that none {what}")),
            Some(link) if is_well(link) => {
                Some(format!("the RTI says that {:?} {what}", Instance::of_link(link)))
            }
            Some(_) => None,
        };
        match output {
            RtiOutput::Joined { federate, link, launched } => {
                let member = self.members.get(federate).copied();
                let place = match self.has_started || member.is_some() {
                    true => &mut self.joining,
                    false => &mut self.members,
                };
                place.insert(*federate, *link);
                let me = Instance::of_link(*link);
                if *launched == is_by_hand(*link) {
                    return Some(format!("the RTI takes {me:?} for launched: {launched}"));
                }
                let ousted = member.filter(|it| *launched && is_by_hand(*it) && is_well(*it));
                ousted
                    .map(|it| format!("{me:?} is to take the place of {:?}", Instance::of_link(it)))
            }
            RtiOutput::Started { .. } => {
                self.has_started = true;
                None
            }
            RtiOutput::Left { federate } => {
                self.members.remove(federate);
                None
            }
            RtiOutput::Entered { federate } => match self.joining.remove(federate) {
                Some(link) => {
                    self.members.insert(*federate, link);
                    None
                }
                // It has joined just before the start.
                None if self.members.contains_key(federate) => None,
                None => Some(format!(
                    "the RTI says that {federate:?} takes part, which was not joining"
                )),
            },
            RtiOutput::Withdrawn { federate, .. } => {
                let link = self.joining.remove(federate);
                let member = self.members.get(federate).copied();
                self.withdrawn += usize::from(link.is_some() && member.is_some_and(&is_well));
                gone(link.or_else(|| self.members.remove(federate)), "does not join")
            }
            RtiOutput::Dropped { federate, .. } => {
                gone(self.members.remove(federate), "has failed")
            }
            _ => None,
        }
    }
}
