//! The control groups (cgroups v2) of the agent, if the system lets it have some: one for itself, and one for each program.
//!
//! ```text
//! G                      where the agent was started; it has no processes of its own then
//! └ hprm-agent-PID       of this agent, locked as long as it lives
//!   ├ agent              the agent, and what starts programs
//!   └ program-1 ...      a program: what it may use is with `hprm::launch::Group`
//! ```
//!
//! A group whose controllers work for the groups below it must have no processes. So the agent moves into a group of its own,
//! and never moves another process: if there are others, it does without. A group without a lock is one of an agent
//! that was killed; the next agent of the same user ends what is in it, and removes it.

use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use hprm::console::reason;
use hprm::launch::{GROUP_HOME, Group, GroupLimits};
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

/// What the groups of agents are called, before a number.
const NAME: &str = "hprm-agent-";

/// What those of programs are called.
const PROGRAM: &str = "program-";

/// What the groups of programs need.
const CONTROLLERS: [&str; 2] = ["memory", "pids"];

/// How long processes may take to be gone that were killed.
const GONE: Duration = Duration::from_secs(2);

/// How many names are tried for a group, which may belong to an agent in another container.
const NAMES: u32 = 8;

/// See the module.
#[derive(Debug)]
pub(crate) struct Groups {
    /// Where the agent was started.
    origin: PathBuf,
    own: PathBuf,
    /// What was not to be had below the origin before.
    enabled: String,
    programs: u64,
    _lock: File,
}

impl Groups {
    /// Moves the agent into a group of its own, and removes what former agents have left.
    ///
    /// # Errors
    ///
    /// Why there can be no groups. The agent is where it was then.
    pub(crate) fn open() -> Result<Self, String> {
        let read = |path: &str| {
            fs::read_to_string(path)
                .map_err(|error| format!("cannot read {path}: {}", reason(&error)))
        };
        let place = Place::find(&read("/proc/self/mountinfo")?, &read("/proc/self/cgroup")?)?;
        let user = rustix::process::geteuid().as_raw();
        clean(&place.mount, &|path| !place.group.starts_with(path), user);
        Self::below(place.group)
    }

    fn below(origin: PathBuf) -> Result<Self, String> {
        let missing = missing(&listed(&origin.join("cgroup.controllers")));
        if !missing.is_empty() {
            let missing = missing.join(" and ");
            return Err(format!("{} has no controller for {missing}", origin.display()));
        }
        let (own, lock) = make_own(&origin).map_err(|error| {
            format!("no group can be made in {}: {}", origin.display(), reason(&error))
        })?;
        let enabled = switch('+', &not_enabled(&origin));
        let groups = Self { origin, own, enabled, programs: 0, _lock: lock };
        groups.settle().map_err(|error| {
            let origin = groups.origin.display();
            match error.raw_os_error() == Some(Errno::BUSY.raw_os_error()) {
                true => format!("other processes are in {origin}"),
                false => format!("no limits can be set in {origin}: {}", reason(&error)),
            }
        })?;
        Ok(groups)
    }

    /// Moves the agent away from where it was started, and has the controllers work below.
    fn settle(&self) -> io::Result<()> {
        let home = self.own.join(GROUP_HOME);
        fs::create_dir(&home)?;
        Group::at(home).enter()?;
        if !self.enabled.is_empty() {
            control(&self.origin, &self.enabled)?;
        }
        control(&self.own, &switch('+', &CONTROLLERS))
    }

    /// Makes a group for a program.
    ///
    /// # Errors
    ///
    /// If the system refuses.
    pub(crate) fn make(&mut self, limits: GroupLimits) -> io::Result<Group> {
        self.programs += 1;
        Group::make(self.own.join(format!("{PROGRAM}{}", self.programs)), limits)
    }
}

impl Drop for Groups {
    /// Takes the agent back to where it was started, if nothing has to be there that hinders it, and leaves no groups behind. Where
    /// that fails, the next agent finds them.
    fn drop(&mut self) {
        let origin = Group::at(self.origin.clone());
        if origin.enter().is_err() {
            // No controllers may work below a group with processes, but for the first one of the system.
            let _ = control(&self.own, &switch('-', &CONTROLLERS));
            let _ = control(&self.origin, &self.enabled.replace('+', "-"));
            let _ = origin.enter();
        }
        let _ = Group::at(self.own.clone()).remove();
    }
}

/// Where the file system of cgroups is, and the group of this process in it.
#[derive(PartialEq, Eq, Debug)]
struct Place {
    mount: PathBuf,
    group: PathBuf,
}

impl Place {
    /// From what the kernel says in `/proc/self/mountinfo` and `/proc/self/cgroup`.
    fn find(mounts: &str, groups: &str) -> Result<Self, String> {
        let none = || "this system has no cgroups of version 2".to_owned();
        let group = groups.lines().find_map(|line| line.strip_prefix("0::")).ok_or_else(none)?;
        let mut mounted = mounts.lines().filter_map(mounted).peekable();
        mounted.peek().ok_or_else(none)?;
        // A container may see a part of them only.
        let found = mounted.find_map(|(root, mount)| {
            let rest = Path::new(group).strip_prefix(root).ok()?;
            let is_below =
                rest.components().all(|it| matches!(it, std::path::Component::Normal(_)));
            // The root itself gets no slash behind it.
            let group = mount.components().chain(rest.components()).collect();
            is_below.then_some(Self { group, mount })
        });
        found.ok_or_else(|| format!("the cgroup of the agent, {group}, cannot be seen"))
    }
}

/// What part of the cgroups a line of `mountinfo` mounts, and where; none if it is about another file system.
fn mounted(line: &str) -> Option<(PathBuf, PathBuf)> {
    let (fields, system) = line.split_once(" - ")?;
    let mut fields = fields.split(' ').skip(3).map(unescaped);
    let (root, mount) = (fields.next()?, fields.next()?);
    (system.split(' ').next() == Some("cgroup2")).then(|| (root.into(), mount.into()))
}

/// A path as the kernel lists it, which writes blanks and some other characters as octal numbers.
fn unescaped(text: &str) -> String {
    [(r"\040", " "), (r"\011", "\t"), (r"\012", "\n"), (r"\134", r"\")]
        .iter()
        .fold(text.to_owned(), |text, (from, to)| text.replace(from, to))
}

/// The words in a file of a group.
fn listed(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_default()
}

fn missing(listed: &str) -> Vec<&'static str> {
    let is_listed = |name: &&str| listed.split_whitespace().any(|word| word == *name);
    CONTROLLERS.into_iter().filter(|name| !is_listed(name)).collect()
}

/// What does not work below a group yet.
fn not_enabled(group: &Path) -> Vec<&'static str> {
    missing(&listed(&group.join("cgroup.subtree_control")))
}

/// How controllers are switched on or off.
fn switch(sign: char, controllers: &[&str]) -> String {
    controllers.iter().map(|name| format!("{sign}{name}")).collect::<Vec<_>>().join(" ")
}

fn control(group: &Path, switches: &str) -> io::Result<()> {
    let file = File::options().write(true).open(group.join("cgroup.subtree_control"));
    file?.write_all(switches.as_bytes())
}

/// Makes the group of this agent, and locks it.
fn make_own(origin: &Path) -> io::Result<(PathBuf, File)> {
    let mut tried = 0;
    loop {
        let process = std::process::id();
        let name = match tried {
            0 => format!("{NAME}{process}"),
            _ => format!("{NAME}{process}-{tried}"),
        };
        let own = origin.join(name);
        let made = fs::create_dir(&own).and_then(|()| lock(&own));
        tried += 1;
        match made {
            Ok(lock) => return Ok((own, lock)),
            // Another agent may have taken it for one that was left behind, as it was not locked yet.
            Err(error) if tried == NAMES || !is_taken(&error) => return Err(error),
            Err(_) => {}
        }
    }
}

fn is_taken(error: &io::Error) -> bool {
    let kinds = [io::ErrorKind::AlreadyExists, io::ErrorKind::NotFound, io::ErrorKind::WouldBlock];
    kinds.contains(&error.kind())
}

/// Locks a group, unless another process has.
fn lock(group: &Path) -> io::Result<File> {
    let folder = File::open(group)?;
    flock(&folder, FlockOperation::NonBlockingLockExclusive)?;
    Ok(folder)
}

/// Ends and removes what agents of a user have left behind that were killed, anywhere below a group. `may` says of which groups
/// that may be.
fn clean(group: &Path, may: &dyn Fn(&Path) -> bool, user: u32) {
    for entry in fs::read_dir(group).into_iter().flatten().flatten() {
        if !entry.file_type().is_ok_and(|it| it.is_dir()) {
            continue;
        }
        let path = entry.path();
        let is_agent = entry.file_name().to_str().is_some_and(|name| name.starts_with(NAME));
        if !is_agent {
            clean(&path, may, user);
        } else if may(&path)
            && entry.metadata().is_ok_and(|it| it.uid() == user)
            && let Ok(_lock) = lock(&path)
            && !Group::at(path.clone()).end(GONE)
        {
            eprintln!(
                "warning: what a former agent has left cannot be removed: {}",
                path.display()
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOUNTS: &str = "\
25 30 0:23 / /proc rw,nosuid shared:12 - proc proc rw
29 30 0:26 / /sys/fs/cgroup ro,nosuid shared:4 - tmpfs tmpfs ro,mode=755
30 29 0:27 / /sys/fs/cgroup/with\\040blank rw shared:5 - cgroup2 cgroup2 rw,nsdelegate
";

    #[test]
    fn the_group_of_the_agent_is_found_where_it_is_mounted() {
        let found = |mounts: &str, groups: &str| {
            Place::find(mounts, groups).map(|it| it.group.display().to_string())
        };
        let own = "12:pids:/elsewhere\n0::/system.slice/hprm.service\n";
        let expected = "/sys/fs/cgroup/with blank/system.slice/hprm.service";
        assert_eq!(found(MOUNTS, own).as_deref(), Ok(expected));
        // A container that sees its own part only.
        let part = MOUNTS.replace("0:27 / ", "0:27 /system.slice ");
        let expected = "/sys/fs/cgroup/with blank/hprm.service";
        assert_eq!(found(&part, own).as_deref(), Ok(expected));
        assert_eq!(found(MOUNTS, "0::/\n").as_deref(), Ok("/sys/fs/cgroup/with blank"));
        let unseen = found(MOUNTS, "0::/../other\n").unwrap_err();
        assert_eq!(unseen, "the cgroup of the agent, /../other, cannot be seen");
        assert!(found(&part, "0::/user.slice\n").is_err());
        let none = Err("this system has no cgroups of version 2".to_owned());
        assert_eq!(found("", own), none);
        assert_eq!(found(&MOUNTS.replace("cgroup2 cgroup2", "cgroup cgroup"), own), none);
        assert_eq!(found(MOUNTS, "4:memory:/a\n"), none);
    }

    #[test]
    fn without_controllers_there_are_no_groups_and_none_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let why = |controllers: &str| {
            fs::write(folder.path().join("cgroup.controllers"), controllers).unwrap();
            Groups::below(folder.path().to_owned()).unwrap_err()
        };
        let group = folder.path().display();
        assert_eq!(why("hugetlb\n"), format!("{group} has no controller for memory and pids"));
        assert_eq!(why("cpu memory\n"), format!("{group} has no controller for pids"));
        // A folder is no group: there is nothing to write to.
        assert!(why("cpu io memory pids\n").starts_with("no limits can be set in "));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_works_below_a_group_already_is_not_switched_on() {
        let folder = tempfile::tempdir().unwrap();
        for (works, switched) in [
            ("", "+memory +pids"),
            ("cpu memory\n", "+pids"),
            ("pids memory", ""),
            ("memory_recursive", "+memory +pids"),
        ] {
            fs::write(folder.path().join("cgroup.subtree_control"), works).unwrap();
            assert_eq!(switch('+', &not_enabled(folder.path())), switched);
        }
    }

    #[test]
    fn groups_of_killed_agents_are_removed_and_those_of_others_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let user = rustix::process::geteuid().as_raw();
        let at = |path: &str| folder.path().join(path);
        for path in ["a/hprm-agent-7/program-1", "a/hprm-agent-8/agent", "a/other/program-1"] {
            fs::create_dir_all(at(path)).unwrap();
        }
        let living = lock(&at("a/hprm-agent-8")).unwrap();
        let all = |_: &Path| true;
        clean(folder.path(), &all, user + 1);
        // It may hold the agent that asks.
        clean(folder.path(), &|path| path != at("a/hprm-agent-7"), user);
        assert!(at("a/hprm-agent-7/program-1").exists());
        clean(folder.path(), &all, user);
        assert!(!at("a/hprm-agent-7").exists());
        assert!(at("a/hprm-agent-8/agent").exists() && at("a/other/program-1").exists());
        drop(living);
        clean(folder.path(), &all, user);
        assert!(!at("a/hprm-agent-8").exists());
    }

    #[test]
    fn a_name_that_is_taken_is_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let (first, _lock) = make_own(folder.path()).unwrap();
        let (second, _lock) = make_own(folder.path()).unwrap();
        assert_ne!(first, second);
        assert!(make_own(&folder.path().join("absent")).is_err());
    }
}
