//! How long a loop busy-polls before it lets the kernel put it to sleep.
//!
//! To wake up a process on an idle processor takes tens of microseconds, and to see a message while
//! busy-polling takes one. But a process that busy-polls takes a processor from those that have work, so
//! by default only a federation busy-polls that leaves one processor free.

use std::thread::available_parallelism;

use hprm_core::{Coordination, Nanos, Program, Spin};

/// The default time of busy-polling: about twice the time of waking up.
const AUTO: Nanos = 50_000;

/// How long a federate of this federation busy-polls, in nanoseconds.
pub(crate) fn time(program: &Program) -> Nanos {
    let processes = program.federates.len() + usize::from(waits_for_rti(program));
    let processors = available_parallelism().map_or(1, usize::from);
    decide(program.properties.spin, processes, processors)
}

/// How long the RTI busy-polls. If no federate waits for it, it sleeps at once: a report comes from time to time, and
/// it would take the processor of a federate to look for the next one.
pub(crate) fn time_of_rti(program: &Program) -> Nanos {
    if waits_for_rti(program) { time(program) } else { 0 }
}

fn waits_for_rti(program: &Program) -> bool {
    program.properties.coordination == Coordination::Centralized
}

fn decide(spin: Spin, processes: usize, processors: usize) -> Nanos {
    match spin {
        Spin::For(time) => time,
        Spin::Auto if processors > processes => AUTO,
        Spin::Auto => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_default_only_a_federation_that_leaves_a_processor_free_busy_polls() {
        assert_eq!(decide(Spin::Auto, 3, 4), AUTO);
        assert_eq!(decide(Spin::Auto, 4, 4), 0);
        assert_eq!(decide(Spin::Auto, 5, 2), 0);
    }

    #[test]
    fn a_time_that_is_set_is_obeyed() {
        assert_eq!(decide(Spin::For(7), 5, 2), 7);
        assert_eq!(decide(Spin::For(0), 1, 64), 0);
    }
}
