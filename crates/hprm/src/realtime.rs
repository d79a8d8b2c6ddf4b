//! Asking the system for real-time treatment: a priority before ordinary threads, memory that is never
//! swapped out, and a processor for the process alone.
//!
//! A program gets all that it asks for, or an error that says what the system requires for it. Whether the
//! program gains by that depends on its author: a thread of this kind that never sleeps keeps the other threads
//! of its processor from running.

use hprm_core::Properties;
use rustix::io::Errno;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use thread_priority::{
    Error, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

use crate::Failure;

/// Gives the calling thread, and those that it starts, what a program asks for. `index` is the place of
/// the federate among those of the program; the RTI has none, and no processor of its own either.
///
/// # Errors
///
/// If the system forbids it.
pub fn enter_realtime(properties: &Properties, index: Option<usize>) -> Result<(), Failure> {
    check(&properties.cpus)?;
    if let Some(cpu) = index.and_then(|index| properties.cpus.iter().cycle().nth(index)) {
        pin(*cpu)?;
    }
    let Some(priority) = properties.realtime else { return Ok(()) };
    lock_memory()?;
    schedule(priority)
}

/// All of them, so that the RTI finds a mistake before any federate is started.
fn check(cpus: &[u32]) -> Result<(), Failure> {
    if cpus.is_empty() {
        return Ok(());
    }
    let allowed = sched_getaffinity(None).map_err(|error| not_known(&error))?;
    let allowed: Vec<_> = (0..CpuSet::MAX_CPU).filter(|cpu| allowed.is_set(*cpu)).collect();
    match cpus.iter().find(|cpu| !allowed.contains(&(**cpu as usize))) {
        None => Ok(()),
        Some(cpu) => Err(refused(
            &format!("this process may not run on processor {cpu}"),
            &format!("change --cpus; it may run on {}", ranges(&allowed)),
        )),
    }
}

fn pin(cpu: u32) -> Result<(), Failure> {
    let mut cpus = CpuSet::new();
    cpus.set(cpu as usize);
    sched_setaffinity(None, &cpus).map_err(|error| not_known(&error))
}

fn not_known(error: &Errno) -> Failure {
    let what = format!("the system does not say or change which processors to use ({error})");
    refused(&what, "run without --cpus")
}

/// As in `0-3, 8`.
fn ranges(sorted: &[usize]) -> String {
    let runs = sorted.chunk_by(|one, next| one + 1 == *next);
    let words = runs.map(|run| match run {
        [one] => one.to_string(),
        run => format!("{}-{}", run[0], run[run.len() - 1]),
    });
    words.collect::<Vec<_>>().join(", ")
}

fn lock_memory() -> Result<(), Failure> {
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(|error| {
        let what = format!("real-time treatment needs memory that is locked ({error})");
        let hint = match error {
            Errno::PERM | Errno::NOMEM | Errno::AGAIN => {
                "raise the limit: `ulimit -l unlimited`, or memlock in /etc/security/limits.conf"
            }
            _ => "run without --realtime",
        };
        refused(&what, hint)
    })
}

fn schedule(priority: u8) -> Result<(), Failure> {
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let value = ThreadPriorityValue::try_from(priority).map_err(|error| {
        refused(&format!("{priority} is no priority ({error})"), "take one from 1 to 99")
    })?;
    let priority = ThreadPriority::Crossplatform(value);
    set_thread_priority_and_policy(thread_native_id(), priority, policy).map_err(|error| {
        let reason = match error {
            Error::OS(code) => std::io::Error::from_raw_os_error(code).to_string(),
            other => other.to_string(),
        };
        refused(
            &format!("the system gives this user no real-time priority ({reason})"),
            "allow it: rtprio in /etc/security/limits.conf, or the capability CAP_SYS_NICE",
        )
    })
}

fn refused(what: &str, hint: &str) -> Failure {
    Failure::System { message: what.to_owned(), hint: Some(hint.to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processors_are_named_in_runs() {
        assert_eq!(ranges(&[0, 1, 2, 3, 8, 10, 11]), "0-3, 8, 10-11");
    }

    #[test]
    fn a_processor_that_does_not_exist_is_found_by_the_first_that_asks() {
        let properties = Properties { cpus: vec![0, 4_000_000], ..Properties::default() };
        let failure = enter_realtime(&properties, None).unwrap_err();
        assert!(failure.to_string().contains("processor 4000000"), "{failure}");
        let hint = failure.report().hint.unwrap_or_default();
        assert!(hint.contains("change --cpus; it may run on "), "{hint}");
    }
}
