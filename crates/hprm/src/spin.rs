//! How long a loop looks for news before it lets the kernel put it to sleep.
//!
//! To wake up a process on an idle processor takes tens of microseconds, and to see a message while
//! looking one. But whoever looks keeps a processor from those who have something to do, so without
//! being told to, only a federation looks that leaves one free.

use std::thread::available_parallelism;

use hprm_core::{Coordination, Nanos, Program, Spin};

/// How long is worth it when nobody has said so: about twice the time of waking up.
const AUTO: Nanos = 50_000;

/// How long a process of this federation looks, in nanoseconds.
pub(crate) fn time(program: &Program) -> Nanos {
    let rti = program.properties.coordination == Coordination::Centralized;
    let processes = program.federates.len() + usize::from(rti);
    let processors = available_parallelism().map_or(1, usize::from);
    decide(program.properties.spin, processes, processors)
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
    fn only_who_leaves_a_processor_free_looks_without_being_told() {
        assert_eq!(decide(Spin::Auto, 3, 4), AUTO);
        assert_eq!(decide(Spin::Auto, 4, 4), 0);
        assert_eq!(decide(Spin::Auto, 5, 2), 0);
    }

    #[test]
    fn who_is_told_how_long_to_look_does_so() {
        assert_eq!(decide(Spin::For(7), 5, 2), 7);
        assert_eq!(decide(Spin::For(0), 1, 64), 0);
    }
}
