//! A control group (cgroups v2) with limits that hold for all processes in it together, and that end together.
//!
//! The agent of a machine makes one for each program that it starts for other machines, and `hprm starter` has the program in it.
//! Which groups there may be is the agent's business (`crates/hprm-agent/src/groups.rs`).

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

/// The group beside those of programs in which the agent is, and what starts them.
pub const GROUP_HOME: &str = "agent";

/// The files of a group that list its processes, end all of them, and count what has happened for want of memory.
const PROCESSES: &str = "cgroup.procs";
const KILL: &str = "cgroup.kill";
const MEMORY_EVENTS: &str = "memory.events";

/// How long it takes at least until a process that was killed has left its group.
const PAUSE: Duration = Duration::from_millis(5);

/// What all processes in a group may use together.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct GroupLimits {
    /// Bytes of memory, shared memory and what files take of it included.
    pub memory: u64,
    /// Processes and threads.
    pub processes: u64,
}

/// See the module. Nothing is removed when it is dropped.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Group {
    path: PathBuf,
}

impl Group {
    /// The one at that place below a file system of cgroups, which the agent makes and removes.
    #[must_use]
    pub fn at(path: PathBuf) -> Self {
        Self { path }
    }

    /// Makes it, with limits, and without processes.
    ///
    /// # Errors
    ///
    /// If the system refuses; nothing is left then.
    pub fn make(path: PathBuf, limits: GroupLimits) -> io::Result<Self> {
        fs::create_dir(&path)?;
        let group = Self { path };
        let limited = group.limit(limits);
        if limited.is_err() {
            // There was nothing in it.
            let _ = group.remove();
        }
        limited.map(|()| group)
    }

    fn limit(&self, GroupLimits { memory, processes }: GroupLimits) -> io::Result<()> {
        self.write("memory.max", &memory.to_string())?;
        self.write("pids.max", &processes.to_string())?;
        // What would be swapped counts as well. Where there is no swapping, there is no such file.
        self.write("memory.swap.max", "0").or_else(none_such)?;
        // A program that has lost some of its processes would only fail for a reason that is hard to find. Linux has that
        // since 4.19.
        self.write("memory.oom.group", "1").or_else(none_such)
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Moves this process into the group.
    ///
    /// # Errors
    ///
    /// If the system refuses.
    pub fn enter(&self) -> io::Result<()> {
        self.write(PROCESSES, "0")
    }

    /// Starts a process in the group. This one, which must have no other thread that starts processes, is in it meanwhile, so that
    /// nothing of the new one is ever outside, and returns into the [`GROUP_HOME`] beside it.
    ///
    /// # Errors
    ///
    /// If the system refuses.
    pub fn start(&self, command: &mut Command) -> io::Result<Child> {
        let home = Self::at(self.path.with_file_name(GROUP_HOME));
        self.enter()?;
        let started = command.spawn();
        let returned = home.enter();
        let mut child = started?;
        if let Err(error) = returned {
            // The program cannot be followed from within.
            let _ = child.kill();
            let _ = child.wait();
            return Err(error);
        }
        Ok(child)
    }

    /// Whether a process was ended because all of them together needed more memory than they may have.
    #[must_use]
    pub fn has_lacked_memory(&self) -> bool {
        let counts = fs::read_to_string(self.path.join(MEMORY_EVENTS)).unwrap_or_default();
        count(&counts, "oom_kill").is_some_and(|times| times > 0)
    }

    /// Ends all processes in it, and below it.
    pub fn kill(&self) {
        // Linux has this since 5.14.
        if self.write(KILL, "1").is_err() {
            kill_each(&self.path);
        }
    }

    /// Removes it, and what is below it. Returns whether it is gone; it is not as long as there are processes in it.
    #[must_use]
    pub fn remove(&self) -> bool {
        remove(&self.path)
    }

    /// Ends all processes in it, and removes it. Returns whether it is gone within that time.
    #[must_use]
    pub fn end(&self, within: Duration) -> bool {
        let until = Instant::now() + within;
        loop {
            // New processes may have come, if they are killed one after the other.
            self.kill();
            if self.remove() {
                return true;
            }
            if Instant::now() >= until {
                return false;
            }
            thread::sleep(PAUSE);
        }
    }

    /// Writes to one of the files that every group has.
    fn write(&self, file: &str, text: &str) -> io::Result<()> {
        File::options().write(true).open(self.path.join(file))?.write_all(text.as_bytes())
    }
}

/// Files that older systems do not have.
fn none_such(error: io::Error) -> io::Result<()> {
    match error.kind() {
        io::ErrorKind::NotFound => Ok(()),
        _ => Err(error),
    }
}

/// The number behind a name, in lines of both.
fn count(text: &str, name: &str) -> Option<u64> {
    let mut lines = text.lines().filter_map(|line| line.split_once(' '));
    lines.find(|(at, _)| *at == name)?.1.trim().parse().ok()
}

/// The groups below one.
fn below(path: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(path).into_iter().flatten().flatten();
    // Links are no folders here.
    let folders = entries.filter(|entry| entry.file_type().is_ok_and(|it| it.is_dir()));
    folders.map(|entry| entry.path()).collect()
}

fn kill_each(path: &Path) {
    below(path).iter().for_each(|path| kill_each(path));
    let listed = fs::read_to_string(path.join(PROCESSES)).unwrap_or_default();
    for pid in listed.lines().filter_map(|line| Pid::from_raw(line.parse().ok()?)) {
        // It may have ended.
        let _ = kill_process(pid, Signal::KILL);
    }
}

fn remove(path: &Path) -> bool {
    for path in below(path) {
        // If it is still there, so is this one.
        let _ = remove(&path);
    }
    match fs::remove_dir(path) {
        Ok(()) => true,
        Err(error) => error.kind() == io::ErrorKind::NotFound,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with files that a group has.
    fn stand_in(folder: &Path, files: &[&str]) -> Group {
        files.iter().for_each(|file| fs::write(folder.join(file), "").unwrap());
        Group::at(folder.to_owned())
    }

    #[test]
    fn limits_are_written_to_the_files_that_there_are() {
        let limits = GroupLimits { memory: 512 << 20, processes: 300 };
        let all = ["memory.max", "pids.max", "memory.swap.max", "memory.oom.group"];
        for count in 2..=4 {
            let folder = tempfile::tempdir().unwrap();
            stand_in(folder.path(), &all[..count]).limit(limits).unwrap();
            let read = |file| fs::read_to_string(folder.path().join(file)).ok();
            let expected = ["536870912", "300", "0", "1"];
            for (at, file) in all.iter().enumerate() {
                assert_eq!(read(file).as_deref(), (at < count).then_some(expected[at]), "{file}");
            }
        }
        let folder = tempfile::tempdir().unwrap();
        assert!(stand_in(folder.path(), &all[1..]).limit(limits).is_err());
    }

    #[test]
    fn a_group_that_cannot_be_limited_is_not_left_behind() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("program-1");
        let limits = GroupLimits { memory: 1, processes: 1 };
        // No file is in a new folder, unlike in a new group.
        assert!(Group::make(path.clone(), limits).is_err());
        assert!(!path.exists());
    }

    #[test]
    fn what_was_ended_for_want_of_memory_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        let group = Group::at(folder.path().to_owned());
        assert!(!group.has_lacked_memory());
        for (kills, lacked) in [("0", false), ("2", true)] {
            let text = format!("low 0\nhigh 0\nmax 7\noom 3\noom_kill {kills}\noom_group_kill 9\n");
            fs::write(folder.path().join(MEMORY_EVENTS), text).unwrap();
            assert_eq!(group.has_lacked_memory(), lacked);
        }
    }

    #[test]
    fn without_a_file_for_it_processes_are_killed_one_by_one_also_in_groups_below() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("a/b");
        fs::create_dir_all(&inner).unwrap();
        let mut children: Vec<_> = [folder.path(), &inner]
            .map(|path| {
                let child = Command::new("sleep").arg("1000").spawn().unwrap();
                fs::write(path.join(PROCESSES), format!("{}\n", child.id())).unwrap();
                child
            })
            .into();
        Group::at(folder.path().to_owned()).kill();
        children.iter_mut().for_each(|child| assert!(!child.wait().unwrap().success()));
    }

    #[test]
    fn groups_are_removed_with_those_below_unless_they_are_in_use() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("program-1");
        fs::create_dir_all(path.join("a/b")).unwrap();
        fs::create_dir_all(path.join("c")).unwrap();
        let group = Group::at(path.clone());
        // As if a process were in it.
        fs::write(path.join("c/busy"), "").unwrap();
        assert!(!group.remove() && path.join("c").exists() && !path.join("a").exists());
        fs::remove_file(path.join("c/busy")).unwrap();
        assert!(group.end(Duration::ZERO) && !path.exists());
        assert!(group.remove());
    }
}
