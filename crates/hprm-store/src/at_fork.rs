//! Functions that the C library calls at each fork, however the process forks: by Python's `os.fork`, by
//! a library in C, on any thread.
//!
//! Calls that start another program at once (`posix_spawn`, `vfork`) need nothing, and the C library
//! calls nothing for them. What the functions do is decided by the modules that register them.
//!
//! A forked process has one thread, and a copy of the memory of all others as they were. A lock that
//! another thread held stays locked for ever. So code that may run in a forked process asks
//! [`is_forked`] before it takes a lock that other threads of the parent may have held.

#![allow(unsafe_code)]

use std::io;
use std::os::fd::{AsRawFd, RawFd};
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::fs::{self, Mode, OFlags};

static FORKED: AtomicBool = AtomicBool::new(false);
static WATCHING: Once = Once::new();

/// A function that the C library calls at a fork.
type ForkHook = extern "C" fn();

extern "C" fn nothing() {}

extern "C" fn note_fork() {
    FORKED.store(true, Ordering::Release);
}

/// Whether this process was forked from one that had begun to [`watch_forks`].
#[must_use]
#[inline]
pub fn is_forked() -> bool {
    FORKED.load(Ordering::Acquire)
}

/// From now on, [`is_forked`] is true in processes that this one forks.
pub fn watch_forks() {
    WATCHING.call_once(|| {
        // Fails only if there is no memory for three pointers.
        let _ = register(nothing, nothing, note_fork);
    });
}

/// Registers `prepare`, which the C library calls before each fork, and the two functions of which it
/// calls one after the fork, all three on the thread that forks. They must not panic.
///
/// # Errors
///
/// If the system has no memory.
pub fn at_fork(prepare: ForkHook, in_parent: ForkHook, in_child: ForkHook) -> io::Result<()> {
    // First: the functions may call `is_forked`.
    watch_forks();
    register(prepare, in_parent, in_child)
}

fn register(prepare: ForkHook, in_parent: ForkHook, in_child: ForkHook) -> io::Result<()> {
    // SAFETY: the functions are safe to call at any time and on any thread, and are there as long as
    // the process: neither a program nor an extension module of Python is ever unloaded. In the child
    // the C library has made its own locks usable again before it calls them, that of its allocator
    // included.
    match unsafe { libc::pthread_atfork(Some(prepare), Some(in_parent), Some(in_child)) } {
        0 => Ok(()),
        code => Err(io::Error::from_raw_os_error(code)),
    }
}

/// In a forked process: closes the file of a descriptor and puts `/dev/null` in its place. The number
/// stays in use, so no file that the program opens later gets it.
///
/// # Errors
///
/// If `/dev/null` cannot be opened.
pub fn replace_with_null(descriptor: RawFd) -> io::Result<()> {
    if !is_forked() {
        return Ok(());
    }
    let null = fs::open("/dev/null", OFlags::RDWR | OFlags::CLOEXEC, Mode::empty())?;
    // SAFETY: the owner of the descriptor in this process still owns an open descriptor afterwards. The
    // file stays open in the parent, for which this changes nothing.
    match unsafe { libc::dup3(null.as_raw_fd(), descriptor, libc::O_CLOEXEC) } {
        -1 => Err(io::Error::last_os_error()),
        _ => Ok(()),
    }
}
