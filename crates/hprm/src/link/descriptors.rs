//! How many descriptors this process may still open: unauthenticated clients must not take the last ones.

use std::io;

use rustix::io::Errno;
use rustix::process::{Resource, getrlimit};

use crate::Failure;

/// How many descriptors this process may have (`ulimit -n`).
pub(crate) fn limit() -> usize {
    let limit = getrlimit(Resource::Nofile).current;
    limit.and_then(|limit| usize::try_from(limit).ok()).unwrap_or(usize::MAX)
}

/// How many it may open now, as far as the system tells. Other threads of the program may open some meanwhile.
pub(crate) fn left() -> usize {
    match std::fs::read_dir("/proc/self/fd") {
        // The descriptor of the folder itself is one of them.
        Ok(open) => limit().saturating_sub(open.count().saturating_sub(1)),
        Err(error) if is_shortage(&error) => 0,
        Err(_) => limit() / 2,
    }
}

/// Whether an operation failed because no descriptor is left, or no memory for one.
pub(crate) fn is_shortage(error: &io::Error) -> bool {
    Errno::from_io_error(error).is_some_and(|error| {
        matches!(error, Errno::MFILE | Errno::NFILE | Errno::NOBUFS | Errno::NOMEM)
    })
}

/// Without a notifier a process can join no federation.
pub(crate) fn no_notifier(error: &io::Error) -> Failure {
    Failure::system("cannot make an eventfd to wake up its loop", error)
}

/// What to do about an error, if a limit of this process or of the system is its cause.
pub(crate) fn advice(error: &io::Error) -> Option<&'static str> {
    match Errno::from_io_error(error)? {
        Errno::MFILE => Some("let a process open more files: ulimit -n 1024"),
        Errno::NFILE => Some("too many files are open on this machine: fs.file-max limits them"),
        Errno::NOBUFS | Errno::NOMEM => Some(
            "free memory on this machine, or let this process have more (ulimit -v, the limit of its \
             container)",
        ),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::*;

    #[test]
    fn what_is_open_is_not_left() {
        // Other tests of this process open and close files, too.
        let open: Vec<_> = (0..200).map(|_| File::open("/dev/null").unwrap()).collect();
        assert!(left() + 100 < limit(), "{} of {}", left(), limit());
        drop(open);
        assert!(left() > 0);
    }

    #[test]
    fn a_shortage_is_told_from_other_errors() {
        assert!(is_shortage(&Errno::MFILE.into()) && is_shortage(&Errno::NFILE.into()));
        assert!(!is_shortage(&Errno::CONNREFUSED.into()));
        assert!(!is_shortage(&io::ErrorKind::OutOfMemory.into()));
    }
}
