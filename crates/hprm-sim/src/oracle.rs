//! What a program must do: the run of all of it in one scheduler, which needs no coordination.

use std::sync::Arc;

use hprm_core::{FederateId, PhysicalTime, Program, Scheduler, Scope, Tag};

use crate::behaviour::run;
use crate::node::schedule;
use crate::{Entry, Log};

/// What the program does if it runs as one.
#[must_use]
pub fn reference(program: &Arc<Program>) -> Log {
    reference_until(program, Tag::FOREVER, None, &[])
}

/// The same if it stops at `stop`, a federate's physical action is scheduled for a tag, and federates
/// leave, each at its first reaction at a tag or later.
#[must_use]
pub fn reference_until(
    program: &Arc<Program>,
    stop: Tag,
    mut event: Option<(FederateId, Tag)>,
    leaves: &[(FederateId, Tag)],
) -> Log {
    let mut scheduler = Scheduler::new(Arc::clone(program), Scope::Whole);
    let mut log = Log::new(program);
    let start = PhysicalTime(0);
    scheduler.start(start);
    if stop < Tag::FOREVER {
        scheduler.set_stop(stop);
    }
    loop {
        let next = scheduler.next_tag();
        if let Some((federate, at)) = event.take_if(|(_, at)| *at <= next) {
            schedule(&mut scheduler, federate, at.due(start));
            continue;
        }
        scheduler.begin(next);
        run(&mut scheduler, next.due(start), leaves, &mut log);
        if scheduler.end(next.due(start)) {
            return log;
        }
    }
}

/// The first execution, by reaction, that is not as it must be, before `end`.
#[must_use]
pub fn difference(program: &Program, is: &Log, must: &Log, end: Tag) -> Option<String> {
    let before = |entries: &[Entry]| -> Vec<Entry> {
        entries.iter().filter(|entry| entry.tag < end).cloned().collect()
    };
    program.reactions.ids().find_map(|reaction| {
        let (is, must) = (before(&is.entries[reaction]), before(&must.entries[reaction]));
        let at = (0..is.len().max(must.len())).find(|at| is.get(*at) != must.get(*at))?;
        let name = program.reaction_name(reaction);
        let show = |entry: Option<&Entry>| {
            entry.map_or("nothing".to_owned(), |Entry { tag, seen }| format!("{tag} {seen:?}"))
        };
        Some(format!(
            "execution {at} of {name}: {}, but must be {}",
            show(is.get(at)),
            show(must.get(at))
        ))
    })
}
