//! Running a small program to its end, without waiting, with one function as the body of everything.

use std::sync::Arc;

use hprm_core::{
    Body, Nanos, PhysicalTime, Program, ReactionId, ReactionSpec, Scheduler, Scope, Trigger,
};

/// The physical time of tag zero.
pub(crate) const START: PhysicalTime = PhysicalTime(1_000_000);

/// Runs a program to its end and logs `(time, microstep, reaction)`. `body` is every reaction.
pub(crate) fn run(
    program: Program,
    mut body: impl FnMut(&mut Scheduler<i64>, ReactionId),
) -> Vec<(Nanos, u32, String)> {
    let mut scheduler = Scheduler::new(Arc::new(program), Scope::Whole);
    scheduler.start(START);
    let mut log = Vec::new();
    for _ in 0..1_000 {
        let tag = scheduler.next_tag();
        scheduler.begin(tag);
        let now = tag.due(START);
        while let Some((reaction, which)) = scheduler.next_reaction(now) {
            let name = scheduler.program().reaction_name(reaction);
            let suffix = match which {
                Body::Main => "",
                Body::Deadline => " deadline",
                Body::Tardy => " tardy",
            };
            log.push((tag.time, tag.microstep, format!("{name}{suffix}")));
            body(&mut scheduler, reaction);
            scheduler.finish(reaction);
        }
        if scheduler.end(now) {
            return log;
        }
    }
    panic!("the program does not end");
}

/// An entry of the log.
pub(crate) fn at(time: Nanos, microstep: u32, reaction: &str) -> (Nanos, u32, String) {
    (time, microstep, reaction.to_owned())
}

/// A reaction that has triggers and nothing else.
pub(crate) fn on(triggers: &[Trigger]) -> ReactionSpec {
    ReactionSpec { triggers: triggers.to_vec(), ..ReactionSpec::default() }
}
