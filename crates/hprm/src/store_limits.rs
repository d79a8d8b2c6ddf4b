//! How much memory an object store may take on this machine, as far as it is not set.
//!
//! A container that runs out of memory gets no error: the system kills a process in it. So where there is a
//! limit, a store stays below it and reports itself when it is full.

use hprm_core::StoreOptions;
use hprm_store::StoreLimits;

/// Where a container finds the limit of its memory, in either version of control groups.
const GROUP_LIMITS: [&str; 2] =
    ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"];

/// From this value on, a limit means none: no machine has that many bytes.
const NO_LIMIT: u64 = 1 << 60;

/// The limits of one federate's store: what has been said, and otherwise what suits this machine.
#[must_use]
pub fn store_limits(options: StoreOptions) -> StoreLimits {
    let default = StoreLimits::default();
    let capacity_bytes =
        options.limit.unwrap_or_else(|| suitable(default.capacity_bytes, container_memory()));
    StoreLimits { capacity_bytes, when_full: options.when_full, ..default }
}

/// The most bytes of memory that this container may use, if there is such a limit.
#[must_use]
pub fn container_memory() -> Option<u64> {
    let limit = GROUP_LIMITS.iter().find_map(|path| std::fs::read_to_string(path).ok())?;
    limit.trim().parse().ok().filter(|limit| *limit < NO_LIMIT)
}

/// Half of a container is for everything else in it.
fn suitable(usual: u64, container: Option<u64>) -> u64 {
    container.map_or(usual, |limit| usual.min(limit / 2))
}

#[cfg(test)]
mod tests {
    use hprm_core::WhenFull;

    use super::*;

    #[test]
    fn what_has_been_said_counts() {
        let options = StoreOptions { limit: Some(123), when_full: WhenFull::Error };
        let limits = store_limits(options);
        assert_eq!((limits.capacity_bytes, limits.when_full), (123, WhenFull::Error));
    }

    #[test]
    fn a_small_container_has_a_small_store() {
        assert_eq!(suitable(2_000, None), 2_000);
        assert_eq!(suitable(2_000, Some(1_000)), 500);
        assert_eq!(suitable(2_000, Some(1 << 40)), 2_000);
    }
}
