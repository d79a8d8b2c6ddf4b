//! Running a whole program in one process: the loop without a network.

use std::os::fd::AsFd;
use std::sync::Arc;

use hprm_core::{Program, ReactionId, Scheduler, Scope, Tag};

use crate::wait::wait_for;
use crate::{Clock, Failure, Host, Inbox};

/// Runs an unfederated program, or a federated one whose federates share this process and its
/// scheduler, to its end.
///
/// # Errors
///
/// What a reaction raised.
pub fn run_whole<H: Host>(
    program: &Arc<Program>,
    host: &mut H,
    inbox: &Inbox<H::Value>,
) -> Result<(), Failure>
where
    H::Value: Send,
{
    let mut scheduler = Scheduler::new(Arc::clone(program), Scope::Whole);
    scheduler.start(Clock::now());
    let outcome = run(program, &mut scheduler, host, inbox);
    inbox.close();
    outcome
}

fn run<H: Host>(
    program: &Program,
    scheduler: &mut Scheduler<H::Value>,
    host: &mut H,
    inbox: &Inbox<H::Value>,
) -> Result<(), Failure>
where
    H::Value: Send,
{
    let mut interrupted = false;
    loop {
        let stop = inbox.take_stop();
        for request in inbox.take_requests() {
            scheduler.schedule(request.action, request.extra, request.value, request.at);
        }
        if stop {
            scheduler.request_stop();
        }
        if !interrupted && host.interrupted() {
            interrupted = true;
            scheduler.request_stop();
        }
        let tag = scheduler.next_tag();
        let due = tag.due(scheduler.start_time());
        let ready = program.properties.fast && tag != Tag::FOREVER || due <= Clock::now();
        if !ready {
            let until = (tag != Tag::FOREVER).then_some(due);
            let fd = inbox.as_fd();
            host.idle(|| wait_for(fd, until));
            inbox.waited();
            continue;
        }
        scheduler.begin(tag);
        run_tag(scheduler, host)?;
        if scheduler.end(Clock::now) {
            return if interrupted {
                Err(Failure { message: String::new(), code: 130 })
            } else {
                Ok(())
            };
        }
    }
}

/// Runs the reactions of the current tag.
pub(crate) fn run_tag<H: Host>(
    scheduler: &mut Scheduler<H::Value>,
    host: &mut H,
) -> Result<(), Failure> {
    while run_next(scheduler, host)? {}
    Ok(())
}

/// Runs those of one level.
pub(crate) fn run_level<H: Host>(
    scheduler: &mut Scheduler<H::Value>,
    host: &mut H,
    level: u32,
) -> Result<(), Failure> {
    while scheduler.ready_level() == Some(level) && run_next(scheduler, host)? {}
    Ok(())
}

fn run_next<H: Host>(scheduler: &mut Scheduler<H::Value>, host: &mut H) -> Result<bool, Failure> {
    let Some((reaction, body)) = scheduler.next_reaction(Clock::now) else {
        return Ok(false);
    };
    if let Some(intended) = scheduler.unhandled_tardy() {
        host.warn(&tardy_warning(scheduler, reaction, intended));
    }
    host.react(scheduler, reaction, body)?;
    scheduler.finish(reaction);
    Ok(true)
}

fn tardy_warning<V: Clone>(
    scheduler: &Scheduler<V>,
    reaction: ReactionId,
    intended: Tag,
) -> String {
    let start = scheduler.start_time();
    let lag = Clock::now().since(intended.due(start));
    format!(
        "reaction {} runs at {} for an input that was meant for {intended} and came {lag} ns after \
         that time. Give the federate a longer maxwait, or the reaction a `tardy` handler",
        scheduler.program().reaction_name(reaction),
        scheduler.tag(),
    )
}
