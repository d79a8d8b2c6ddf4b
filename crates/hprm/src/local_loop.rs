//! Running a whole program in one process: the loop without a network.

use std::os::fd::AsFd;
use std::sync::Arc;

use hprm_core::{Program, Scheduler, Scope, Tag};

use crate::recorder::{Flags, LoopRecording, Member, Recorder, TraceRequest, Wait, Waiting};
use crate::trace::Trace;
use crate::wait::wait_for;
use crate::workers::Workers;
use crate::{Clock, Failure, Host, Inbox, enter_realtime};

/// Runs an unfederated program, or a federated one whose federates share this process and its
/// scheduler, to its end.
///
/// # Errors
///
/// What a reaction raised, or that the system starts no thread for a worker.
pub fn run_whole<H: Host>(
    program: &Arc<Program>,
    host: &mut H,
    inbox: &Inbox<H::Value>,
) -> Result<(), Failure>
where
    H::Value: Send + Sync,
{
    run_whole_traced(program, host, inbox, None, None)
}

/// As [`run_whole`], and writes the logical trace and the trace if they are wanted.
///
/// # Errors
///
/// What a reaction raised, or else that the trace cannot be written.
pub fn run_whole_traced<H: Host>(
    program: &Arc<Program>,
    host: &mut H,
    inbox: &Inbox<H::Value>,
    trace: Option<Trace>,
    request: Option<&TraceRequest>,
) -> Result<(), Failure>
where
    H::Value: Send + Sync,
{
    // Before this thread has a priority that the collector must not have.
    let recording = LoopRecording::start(request, program, Member::Whole)?;
    enter_realtime(&program.properties, Some(0))?;
    host.set_tracepoints(&recording.tracepoints());
    let traced = trace.is_some();
    let mut workers = Workers::new(program, Scope::Whole, trace, recording.recorder())?;
    let mut scheduler = Scheduler::new(Arc::clone(program), Scope::Whole);
    if traced {
        scheduler.start_recording();
    }
    if recording.recorder().is_on() {
        scheduler.log_schedules();
    }
    scheduler.start(Clock::now().next_multiple(program.properties.start_time_multiple));
    recording.recorder().started(scheduler.start_time());
    let outcome = run(&mut scheduler, &mut workers, &recording.recorder(), host, inbox);
    inbox.close();
    workers.report_dropped(&scheduler, host);
    let traced = workers.end_trace(&scheduler, &outcome);
    let outcome = Failure::with_trace_outcome(outcome, traced);
    recording.end(host, outcome)
}

fn run<H: Host>(
    scheduler: &mut Scheduler<H::Value>,
    workers: &mut Workers<H::Value>,
    recorder: &Recorder,
    host: &mut H,
    inbox: &Inbox<H::Value>,
) -> Result<(), Failure>
where
    H::Value: Send + Sync,
{
    let fast = scheduler.program().properties.fast;
    let mut interrupted = false;
    loop {
        let stop = inbox.take_stop()?;
        if inbox.has_requests() {
            for request in inbox.take_requests() {
                scheduler.schedule(request.action, request.extra, request.value, request.at);
            }
            scheduler.take_scheduled().for_each(|it| recorder.scheduled(it, Flags::OUTSIDE));
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
        let now = if fast && tag != Tag::FOREVER { due } else { Clock::now() };
        if due > now {
            let until = (tag != Tag::FOREVER).then_some(due);
            let fd = inbox.as_fd();
            let what = if tag == Tag::FOREVER { Wait::Events } else { Wait::Time };
            let waiting = Waiting { what, tag, since: now, until };
            let rings = inbox.may_sleep() && host.run_unlocked(|| wait_for(fd, until));
            inbox.waited(rings);
            if recorder.is_on() {
                recorder.waited(waiting, Clock::now());
            }
            continue;
        }
        workers.watch_lag(scheduler, host, (tag, due), now);
        scheduler.begin(tag);
        workers.run_tag(scheduler, host)?;
        // Physical connections have no clock but logical time either.
        if scheduler.end(|| if fast { due } else { Clock::now() }) {
            let signal = host.signal();
            return if interrupted { Err(Failure::Interrupted { signal }) } else { Ok(()) };
        }
    }
}
