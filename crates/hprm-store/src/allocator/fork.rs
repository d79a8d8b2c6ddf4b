//! What happens to the memory of an allocator when the process forks.
//!
//! The memory of the store is shared, so without this the receivers of this process would see what the
//! forked process writes. The forked process gets copies of its own instead, as of any other memory, and
//! its parent waits for that: otherwise the forked process would see what its parent writes meanwhile. A
//! process that was forked has such copies only, so nothing more is to be done when it forks again.
//!
//! Objects that the forked process has received are held until it ends (`forks`). Nothing here waits for a
//! lock in the forked process, and the functions that the C library calls never panic.

#![forbid(unsafe_code)]

use std::cell::RefCell;
use std::io;
use std::mem;
use std::os::fd::OwnedFd;
use std::sync::{Arc, Mutex, OnceLock, PoisonError, Weak};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pipe::{PipeFlags, pipe_with};

use super::{ForkSnapshot, InheritedMemory, StoreAllocator};
use crate::at_fork::{at_fork, is_forked};

/// The longest that a process waits for the copies of a process that it has forked. They take
/// milliseconds, and the forked process then writes a byte, so this is only for unforeseen failures.
const COPY_TIMEOUT: Timespec = Timespec { tv_sec: 10, tv_nsec: 0 };

/// The allocators of this process whose memory forked processes copy.
static ALLOCATORS: Mutex<Vec<Weak<StoreAllocator>>> = Mutex::new(Vec::new());

/// What a forked process calls if the system has no memory for its copies, before it aborts.
static OUT_OF_MEMORY: OnceLock<fn()> = OnceLock::new();

thread_local! {
    /// The fork that this thread is just doing.
    static FORK: RefCell<Option<Fork>> = const { RefCell::new(None) };
}

/// A fork, from before it until both processes may go on.
struct Fork {
    snapshots: Vec<(Arc<StoreAllocator>, ForkSnapshot)>,
    /// By which the forked process tells that it has its copies; none if there is nothing to copy. Also
    /// none if the process has no descriptors left: then unpublished values may change under it.
    pipe: Option<(OwnedFd, OwnedFd)>,
}

extern "C" fn prepare() {
    if is_forked() {
        return;
    }
    let allocators = ALLOCATORS.lock().unwrap_or_else(PoisonError::into_inner);
    let allocators: Vec<_> = allocators.iter().filter_map(Weak::upgrade).collect();
    let snapshots: Vec<_> = allocators
        .into_iter()
        .map(|allocator| (Arc::clone(&allocator), allocator.begin_fork()))
        .collect();
    let copies = snapshots.iter().any(|(_, snapshot)| snapshot.needs_copies());
    let pipe = if copies { pipe_with(PipeFlags::CLOEXEC).ok() } else { None };
    let _ = FORK.try_with(|fork| fork.replace(Some(Fork { snapshots, pipe })));
}

extern "C" fn in_parent() {
    let Some(Fork { snapshots, pipe }) = take_fork() else { return };
    if let Some((reader, writer)) = pipe {
        drop(writer);
        // If it was interrupted or took too long, there is nothing else to do.
        let _ = poll(&mut [PollFd::new(&reader, PollFlags::IN)], Some(&COPY_TIMEOUT));
    }
    for (allocator, snapshot) in snapshots {
        allocator.end_fork(snapshot);
    }
}

extern "C" fn in_child() {
    // None if the parent was itself a forked process.
    let Some(Fork { snapshots, pipe }) = take_fork() else { return };
    for (allocator, snapshot) in snapshots {
        if !allocator.inherit(snapshot) {
            if let Some(report) = OUT_OF_MEMORY.get() {
                report();
            }
            std::process::abort();
        }
    }
    if let Some((_, writer)) = &pipe {
        // Closing the pipe would tell it as well, unless another process has been forked meanwhile.
        let _ = rustix::io::write(writer, &[0]);
    }
}

fn take_fork() -> Option<Fork> {
    FORK.try_with(RefCell::take).ok().flatten()
}

impl StoreAllocator {
    /// From now on, processes that this one forks get copies of unpublished values. If there is no memory
    /// for that, the forked process calls `out_of_memory` and aborts.
    ///
    /// # Errors
    ///
    /// If the C library cannot register the functions that it calls at forks.
    pub fn watch_forks(self: &Arc<Self>, out_of_memory: fn()) -> io::Result<()> {
        let first = OUT_OF_MEMORY.set(out_of_memory).is_ok();
        let mut allocators = ALLOCATORS.lock().unwrap_or_else(PoisonError::into_inner);
        allocators.retain(|allocator| allocator.strong_count() > 0);
        allocators.push(Arc::downgrade(self));
        drop(allocators);
        if first { at_fork(prepare, in_parent, in_child) } else { Ok(()) }
    }

    /// Before this process forks: what is open here stays open until the forked process has ended, and
    /// unpublished values do not change until it has its copies.
    pub(super) fn begin_fork(&self) -> ForkSnapshot {
        let lock = self.forks.begin();
        let mut unpublished = self.unpublished();
        unpublished.copying += 1;
        let segments = unpublished.segments.values().filter_map(Weak::upgrade).collect();
        let blocks =
            unpublished.loans.iter().map(|(address, loan)| (*address, loan.len())).collect();
        drop(unpublished);
        let cow_objects = self.cow_objects().iter().filter_map(Weak::upgrade).collect();
        ForkSnapshot { inherited: InheritedMemory { segments, blocks }, cow_objects, lock }
    }

    /// In the parent, when the forked process has its copies, or if the fork has failed.
    pub(super) fn end_fork(&self, snapshot: ForkSnapshot) {
        let mut unpublished = self.unpublished();
        unpublished.copying -= 1;
        let all_copied = unpublished.copying == 0;
        let freed = if all_copied { mem::take(&mut unpublished.freed) } else { Vec::new() };
        drop(unpublished);
        // Without holding the lock: a drop adds an entry to the store's queue.
        drop((freed, snapshot));
    }

    /// In the forked process: no other process sees what it writes from now on, and unpublished values and
    /// objects that it may write to keep their content. False if the system has no memory for that; then
    /// the process must end.
    fn inherit(&self, snapshot: ForkSnapshot) -> bool {
        let ForkSnapshot { inherited, cow_objects, lock } = snapshot;
        // The end of this process ends the lock, which tells the parent.
        mem::forget(lock);
        let copied = inherited.copy_now() && cow_objects.iter().all(|cow| cow.copy_now());
        // It was not set: a forked process does not come here again.
        copied && self.inherited.set(inherited).is_ok()
    }
}

impl ForkSnapshot {
    /// Whether there is anything that the forked process has to copy before its parent goes on.
    fn needs_copies(&self) -> bool {
        !self.inherited.blocks.is_empty() || !self.cow_objects.is_empty()
    }
}

impl InheritedMemory {
    fn copy_now(&self) -> bool {
        for segment in &self.segments {
            if !segment.make_private() {
                return false;
            }
            self.blocks.iter().for_each(|(address, len)| segment.copy_now(*address, *len));
        }
        true
    }

    /// Frees the copy of a block. False if the address is not in this memory.
    pub(super) fn free(&self, address: usize) -> bool {
        let Some(segment) = self.segments.iter().find(|segment| segment.contains(address)) else {
            return false;
        };
        if let Some(len) = self.blocks.get(&address) {
            segment.discard_copy(address, *len);
        }
        true
    }
}
