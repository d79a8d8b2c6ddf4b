//! What a federate has started and left behind when it failed.
//!
//! It is asked to end, so that it can tidy up: Python has a process that removes the semaphores of
//! those which cannot do that any more. What takes too long is killed.

use std::os::fd::OwnedFd;
use std::process::Child;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, Signal, kill_process_group, pidfd_open};

use crate::supervisor::AFTER_SIGNAL;

/// How long they may take, all together: as long as any process may take to obey SIGTERM.
const PATIENCE: Duration = AFTER_SIGNAL;

/// Ends all that is left in the group that `leader` leads, which has ended, and reaps that.
pub(super) fn end(mut leader: Child) {
    // A process that has not been reaped keeps its number, so the signals reach no other process.
    let group = Pid::from_child(&leader);
    let others = members(group);
    if !others.is_empty() {
        // They may end this moment.
        let _ = kill_process_group(group, Signal::TERM);
        let until = Instant::now() + PATIENCE;
        others.iter().for_each(|process| wait(process, until));
    }
    let _ = kill_process_group(group, Signal::KILL);
    // Its status is known already.
    let _ = leader.wait();
}

/// The processes of a group, without the one that leads it.
fn members(group: Pid) -> Vec<OwnedFd> {
    let Ok(entries) = std::fs::read_dir("/proc") else { return Vec::new() };
    let pids = entries.flatten().filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    pids.filter_map(Pid::from_raw)
        .filter(|pid| *pid != group && group_of(*pid) == Some(group))
        .filter_map(|pid| pidfd_open(pid, PidfdFlags::empty()).ok())
        .collect()
}

/// The group of a process. The kernel counts a group of another container as zero.
fn group_of(pid: Pid) -> Option<Pid> {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", pid.as_raw_nonzero())).ok()?;
    // The name of the program stands in parentheses and may contain anything.
    let (_, fields) = stat.rsplit_once(')')?;
    Pid::from_raw(fields.split_whitespace().nth(2)?.parse().ok()?)
}

/// Waits for the end of a process, but not beyond `until`.
fn wait(process: &OwnedFd, until: Instant) {
    loop {
        let left = until.saturating_duration_since(Instant::now());
        let timeout = Timespec::try_from(left).ok();
        match poll(&mut [PollFd::new(process, PollFlags::IN)], timeout.as_ref()) {
            Err(rustix::io::Errno::INTR) => {}
            _ => return,
        }
    }
}
