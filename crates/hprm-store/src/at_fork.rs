//! Hearing of forks, however the process forks: Python's `os.fork`, a library in C, any thread.
//!
//! The C library calls what is registered here around each `fork`. What starts another program at
//! once (`posix_spawn`, `vfork`) needs nothing and is not told. What is done at a fork is decided
//! elsewhere.
//!
//! A forked process has one thread, and a copy of the memory of all others as they were. A lock that
//! one of them held stays locked for ever. So code that may run in a forked process asks
//! [`is_forked`] before it takes a lock that other threads of the parent may have held.

#![allow(unsafe_code)]

use std::io;
use std::os::fd::{AsRawFd, RawFd};
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::fs::{self, Mode, OFlags};

static FORKED: AtomicBool = AtomicBool::new(false);
static WATCHING: Once = Once::new();

/// What the C library calls at a fork.
type Call = extern "C" fn();

extern "C" fn nothing() {}

extern "C" fn note() {
    FORKED.store(true, Ordering::Release);
}

/// Whether this process was forked from one that had begun to [`watch_forks`].
#[must_use]
pub fn is_forked() -> bool {
    FORKED.load(Ordering::Acquire)
}

/// From now on, a process that is forked from this one knows that it is one.
pub fn watch_forks() {
    WATCHING.call_once(|| {
        // Fails only if there is no memory for three pointers.
        let _ = register(nothing, nothing, note);
    });
}

/// Has `prepare` called before each fork, and afterwards one of the others, all three on the thread
/// that forks. They must not panic.
///
/// # Errors
///
/// If the system has no memory.
pub fn at_fork(prepare: Call, in_parent: Call, in_child: Call) -> io::Result<()> {
    // First: the others may ask.
    watch_forks();
    register(prepare, in_parent, in_child)
}

fn register(prepare: Call, in_parent: Call, in_child: Call) -> io::Result<()> {
    // SAFETY: the functions are safe to call at any time and on any thread, and are there as long as
    // the process: neither a program nor an extension module of Python is ever unloaded. In the child
    // the C library has made its own locks usable again before it calls them, that of its allocator
    // included.
    match unsafe { libc::pthread_atfork(Some(prepare), Some(in_parent), Some(in_child)) } {
        0 => Ok(()),
        code => Err(io::Error::from_raw_os_error(code)),
    }
}

/// In a forked process: has it let go of what lies behind a descriptor. The number stays taken, so no
/// file that the program opens later gets it.
///
/// # Errors
///
/// If there is nothing to put in its place.
pub fn let_go(descriptor: RawFd) -> io::Result<()> {
    if !is_forked() {
        return Ok(());
    }
    let null = fs::open("/dev/null", OFlags::RDWR | OFlags::CLOEXEC, Mode::empty())?;
    // SAFETY: whatever owns the number in this process still owns an open descriptor afterwards. What
    // was behind it stays open in the parent, for which this changes nothing.
    match unsafe { libc::dup3(null.as_raw_fd(), descriptor, libc::O_CLOEXEC) } {
        -1 => Err(io::Error::last_os_error()),
        _ => Ok(()),
    }
}
