//! What happens to a yard when the process forks.
//!
//! The memory of the store is shared, so without this a write in the new process would be seen by
//! the receivers of this one. The new process gets copies of its own instead, as of any other memory,
//! and this one waits for that: else the new one would see how this one goes on writing. A process that
//! was forked has such copies only, so when it forks again there is nothing more to do.
//!
//! What the new process has received is held until it ends (`forks`). Nothing here waits for a lock in
//! the new process, and what is called here never panics.

#![forbid(unsafe_code)]

use std::cell::RefCell;
use std::io;
use std::mem;
use std::os::fd::OwnedFd;
use std::sync::{Arc, Mutex, OnceLock, PoisonError, Weak};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pipe::{PipeFlags, pipe_with};

use super::{Estate, Inherited, Yard};
use crate::at_fork::{at_fork, is_forked};

/// The longest that a process waits until one that it has forked has its copies. That takes
/// milliseconds, and is told by a byte, so this is for what cannot be foreseen.
const PATIENCE: Timespec = Timespec { tv_sec: 10, tv_nsec: 0 };

/// The yards of this process whose memory forked processes copy.
static YARDS: Mutex<Vec<Weak<Yard>>> = Mutex::new(Vec::new());

/// What a forked process does that the system gives no memory for its copies; it ends then.
static LACK: OnceLock<fn()> = OnceLock::new();

thread_local! {
    /// The fork that this thread is about, if it is.
    static FORK: RefCell<Option<Fork>> = const { RefCell::new(None) };
}

/// A fork, from before it until both processes may go on.
struct Fork {
    estates: Vec<(Arc<Yard>, Estate)>,
    /// Tells this process that the new one has its copies; none if there is nothing to copy. Without
    /// descriptors nothing tells it: then what is being made may change for the new process.
    pipe: Option<(OwnedFd, OwnedFd)>,
}

extern "C" fn prepare() {
    if is_forked() {
        return;
    }
    let yards = YARDS.lock().unwrap_or_else(PoisonError::into_inner);
    let yards: Vec<_> = yards.iter().filter_map(Weak::upgrade).collect();
    let estates: Vec<_> =
        yards.into_iter().map(|yard| (Arc::clone(&yard), yard.begin_fork())).collect();
    let copies = estates.iter().any(|(_, estate)| estate.needs_copies());
    let pipe = if copies { pipe_with(PipeFlags::CLOEXEC).ok() } else { None };
    let _ = FORK.try_with(|fork| fork.replace(Some(Fork { estates, pipe })));
}

extern "C" fn in_parent() {
    let Some(Fork { estates, pipe }) = taken() else { return };
    if let Some((told, tell)) = pipe {
        drop(tell);
        // Whether it was interrupted or took too long: there is nothing else to be done.
        let _ = poll(&mut [PollFd::new(&told, PollFlags::IN)], Some(&PATIENCE));
    }
    for (yard, estate) in estates {
        yard.end_fork(estate);
    }
}

extern "C" fn in_child() {
    // It is the parent's, if this process was forked by one that was itself.
    let Some(Fork { estates, pipe }) = taken() else { return };
    for (yard, estate) in estates {
        if !yard.inherit(estate) {
            if let Some(say) = LACK.get() {
                say();
            }
            std::process::abort();
        }
    }
    if let Some((_, tell)) = &pipe {
        // The end of the pipe tells it as well, unless another process has been forked meanwhile.
        let _ = rustix::io::write(tell, &[0]);
    }
}

fn taken() -> Option<Fork> {
    FORK.try_with(RefCell::take).ok().flatten()
}

impl Yard {
    /// Has processes that are forked from now on get copies of what is being made here. If there is no
    /// memory for that, `lack` is called there, and the process ends.
    ///
    /// # Errors
    ///
    /// If the system does not tell of forks.
    pub fn watch_forks(self: &Arc<Self>, lack: fn()) -> io::Result<()> {
        let first = LACK.set(lack).is_ok();
        let mut yards = YARDS.lock().unwrap_or_else(PoisonError::into_inner);
        yards.retain(|yard| yard.strong_count() > 0);
        yards.push(Arc::downgrade(self));
        drop(yards);
        if first { at_fork(prepare, in_parent, in_child) } else { Ok(()) }
    }

    /// Before this process forks: what is open here stays open until the new one has ended, and what is
    /// being made does not change until it has its copies.
    pub(super) fn begin_fork(&self) -> Estate {
        let tether = self.forks.begin();
        let mut making = self.making();
        making.forking += 1;
        let segments = making.segments.values().filter_map(Weak::upgrade).collect();
        let blocks = making.loans.iter().map(|(address, loan)| (*address, loan.len())).collect();
        drop(making);
        let owned = self.owned().iter().filter_map(Weak::upgrade).collect();
        Estate { inherited: Inherited { segments, blocks }, owned, tether }
    }

    /// In the process that forked, when the other one has what it needs, or there is none after all.
    pub(super) fn end_fork(&self, estate: Estate) {
        let mut making = self.making();
        making.forking -= 1;
        let freed = if making.forking == 0 { mem::take(&mut making.freed) } else { Vec::new() };
        drop(making);
        // Not under the lock: what ends here tells its owner.
        drop((freed, estate));
    }

    /// In the process that was forked: what it writes is seen by no other one from now on, and what was
    /// being made or was received to be written to stays as it is for it. False if the system has no
    /// memory for that; then the process must end.
    fn inherit(&self, estate: Estate) -> bool {
        let Estate { inherited, owned, tether } = estate;
        // It tells the parent of the end of this process.
        mem::forget(tether);
        let copied = inherited.copy_now() && owned.iter().all(|own| own.copy_now());
        // It was not set: who was forked does not come here again.
        copied && self.inherited.set(inherited).is_ok()
    }
}

impl Estate {
    /// Whether there is anything that the new process has to copy before the old one goes on.
    fn needs_copies(&self) -> bool {
        !self.inherited.blocks.is_empty() || !self.owned.is_empty()
    }
}

impl Inherited {
    fn copy_now(&self) -> bool {
        for segment in &self.segments {
            if !segment.make_private() {
                return false;
            }
            self.blocks.iter().for_each(|(address, len)| segment.own(*address, *len));
        }
        true
    }

    /// Gives up the copy of a block. False if the address is not in this memory.
    pub(super) fn free(&self, address: usize) -> bool {
        let Some(segment) = self.segments.iter().find(|segment| segment.contains(address)) else {
            return false;
        };
        if let Some(len) = self.blocks.get(&address) {
            segment.disown(address, *len);
        }
        true
    }
}
