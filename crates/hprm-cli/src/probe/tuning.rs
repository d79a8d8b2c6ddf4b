//! What of the system decides how fast and how evenly programs run, and how far they may go.
//!
//! Nothing here keeps a program from running: findings are good or poor.

use hprm_core::{StoreOptions, WhenFull, read_size};
use rustix::process::{Resource, getrlimit};

use super::Finding;
use crate::args::{STORE_FULL, STORE_LIMIT};

/// All of them, in the order in which they matter.
pub(super) fn all() -> Vec<Finding> {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let variable = |name| std::env::var(name).ok();
    vec![
        object_store(variable(STORE_LIMIT), variable(STORE_FULL)),
        huge_pages(&read("/sys/kernel/mm/transparent_hugepage/shmem_enabled")),
        clock(&read("/sys/devices/system/clocksource/clocksource0/current_clocksource")),
        locked_memory(),
        real_time(),
        network_namespaces(&read("/proc/sys/user/max_net_namespaces")),
    ]
}

/// How much memory each federate's store may take.
fn object_store(limit: Option<String>, full: Option<String>) -> Finding {
    const SUBJECT: &str = "object store";
    let mut options = StoreOptions::default();
    if let Some(text) = limit {
        let Some(bytes) = read_size(&text) else {
            let text = format!("{STORE_LIMIT} is `{text}`, which is no size");
            return Finding::poor(SUBJECT, text, "write a size such as 2GB");
        };
        options.limit = Some(bytes);
    }
    if let Some(text) = full {
        let Some(policy) = WhenFull::read(&text) else {
            let text = format!("{STORE_FULL} is `{text}`");
            return Finding::poor(SUBJECT, text, "write inline or error");
        };
        options.when_full = policy;
    }
    let limits = hprm::store_limits(options);
    let policy = limits.when_full.word();
    let text = format!("at most {} a federate, then: {policy}", size(limits.capacity_bytes));
    match hprm::container_memory() {
        Some(memory) if limits.capacity_bytes > memory => Finding::poor(
            SUBJECT,
            format!("{text}, but this container may use only {}", size(memory)),
            "the system kills what takes more: lower --store-limit",
        ),
        _ => Finding::good(SUBJECT, text),
    }
}

fn size(bytes: u64) -> String {
    format!("{} MB", bytes / 1_000_000)
}

/// The chosen one of the words that a switch of the kernel may have.
fn chosen(text: &str) -> Option<&str> {
    text.split_once('[')?.1.split_once(']').map(|(word, _)| word)
}

fn huge_pages(text: &str) -> Finding {
    const SUBJECT: &str = "huge pages";
    match chosen(text) {
        Some(word @ ("always" | "within_size" | "advise" | "force")) => {
            Finding::good(SUBJECT, format!("{word}, for shared memory"))
        }
        Some(word) => Finding::poor(
            SUBJECT,
            format!("{word}, for shared memory"),
            "large arrays are faster with them: \
             echo advise > /sys/kernel/mm/transparent_hugepage/shmem_enabled",
        ),
        None => Finding::poor(SUBJECT, "the system has none", "large arrays are faster with them"),
    }
}

fn clock(text: &str) -> Finding {
    const SUBJECT: &str = "clock";
    match text.trim() {
        source @ ("tsc" | "kvm-clock" | "arch_sys_counter" | "hyperv_clocksource_tsc_page") => {
            Finding::good(SUBJECT, source)
        }
        "" => {
            Finding::poor(SUBJECT, "the system does not tell", "nothing can be said of its speed")
        }
        source => Finding::poor(
            SUBJECT,
            format!("{source}, which is slow to read"),
            "every tag reads it; some kernels offer a faster one, see dmesg",
        ),
    }
}

fn locked_memory() -> Finding {
    const SUBJECT: &str = "locked memory";
    match getrlimit(Resource::Memlock).current {
        None => Finding::good(SUBJECT, "no limit"),
        Some(limit) => Finding::good(SUBJECT, format!("at most {} KB", limit / 1_000)),
    }
}

fn real_time() -> Finding {
    const SUBJECT: &str = "priorities";
    let root = rustix::process::geteuid().is_root();
    match getrlimit(Resource::Rtprio).current {
        Some(0) if !root => Finding::poor(
            SUBJECT,
            "this user may not ask for real-time scheduling",
            "where that matters, give the user an rtprio in /etc/security/limits.conf",
        ),
        _ => Finding::good(SUBJECT, "this user may ask for real-time scheduling"),
    }
}

fn network_namespaces(text: &str) -> Finding {
    const SUBJECT: &str = "namespaces";
    const HINT: &str = "only tests of federations across machines need them";
    match text.trim().parse::<u64>() {
        Ok(0) => Finding::poor(SUBJECT, "the system allows no network namespaces", HINT),
        Ok(_) => Finding::good(SUBJECT, "networks can be tried on one machine"),
        Err(_) => Finding::poor(SUBJECT, "the system does not know network namespaces", HINT),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Health;
    use super::*;

    #[test]
    fn the_store_is_told_with_its_limit_and_its_policy() {
        let finding = object_store(Some("512 MB".to_owned()), Some("error".to_owned()));
        assert!(finding.text.starts_with("at most 512 MB a federate, then: error"), "{finding:?}");
        for (limit, full) in [("much", "inline"), ("1GB", "explode")] {
            let finding = object_store(Some(limit.to_owned()), Some(full.to_owned()));
            assert_eq!(finding.health, Health::Poor, "{finding:?}");
        }
    }

    #[test]
    fn huge_pages_are_told_by_the_word_in_brackets() {
        let text = "always within_size [advise] never deny force\n";
        assert_eq!(huge_pages(text).health, Health::Good);
        let text = "always within_size advise [never] deny force\n";
        assert_eq!(huge_pages(text).text, "never, for shared memory");
        assert_eq!(huge_pages("").health, Health::Poor);
    }

    #[test]
    fn clocks_and_namespaces_are_judged() {
        assert_eq!(clock("tsc\n").health, Health::Good);
        assert_eq!(clock("hpet\n").text, "hpet, which is slow to read");
        assert_eq!(clock("").health, Health::Poor);
        assert_eq!(network_namespaces("63000\n").health, Health::Good);
        assert_eq!(network_namespaces("0\n").health, Health::Poor);
        assert_eq!(network_namespaces("").health, Health::Poor);
    }
}
