//! The federations that run on this machine, by their boards, and which of them a user means.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;

use rustix::process::geteuid;

use super::{Role, Running, running};
use crate::{Kind, Report};

/// The loops of one federation that run on this machine: one at least, the RTI's first.
#[derive(Debug)]
pub struct RunningFederation(Vec<Running>);

impl RunningFederation {
    /// All of its loops.
    #[must_use]
    pub fn loops(&self) -> &[Running] {
        &self.0
    }

    /// A text that no other run has.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.0[0].identity.id
    }

    /// Its name: that of its program.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0[0].identity.federation
    }

    /// Its RTI, if that runs here.
    #[must_use]
    pub fn rti(&self) -> Option<&Running> {
        self.0.iter().find(|it| it.identity.role == Role::Rti)
    }

    /// Its federates that run here, by their names. Of two processes of one transient federate, the one that was
    /// started last.
    #[must_use]
    pub fn federates(&self) -> BTreeMap<&str, &Running> {
        let named = self.0.iter().filter_map(|it| match &it.identity.role {
            Role::Federate(name) => Some((name.as_str(), it)),
            Role::Rti => None,
        });
        named.collect()
    }

    /// Its process that users know: that of the RTI, which is the launcher's, or else of a federate.
    fn first(&self) -> &Running {
        self.rti().unwrap_or(&self.0[0])
    }

    /// A line for users that have to choose.
    fn line(&self) -> String {
        let Running { identity, pid, .. } = self.first();
        let federates = self.0.len() - usize::from(self.rti().is_some());
        let s = if federates == 1 { "" } else { "s" };
        let seconds = identity.since.div_euclid(1_000_000_000).rem_euclid(86_400);
        let (hours, minutes, seconds) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
        format!(
            "{}, process {pid}: {federates} federate{s}, since {hours:02}:{minutes:02}:{seconds:02} UTC",
            self.name()
        )
    }
}

/// The federations of this user that run on this machine. Programs in one process are none.
///
/// # Errors
///
/// If this process cannot see others.
pub fn federations() -> io::Result<Vec<RunningFederation>> {
    let mut federations: Vec<RunningFederation> = Vec::new();
    for running in running()? {
        match federations.iter_mut().find(|it| it.id() == running.identity.id) {
            Some(federation) => federation.0.push(running),
            None => federations.push(RunningFederation(vec![running])),
        }
    }
    Ok(federations)
}

/// Why it is not known which federation is meant.
#[derive(Debug)]
pub enum NotChosen {
    /// This process cannot see others.
    Blind(io::Error),
    /// None runs, and none was named.
    None,
    /// None of those that run is called that.
    Unknown(String),
    /// Several run, of that name if one was named.
    Several(Option<String>, Vec<RunningFederation>),
}

impl RunningFederation {
    /// The federation that a user means: by the name of its program, by the number of one of its processes or of what
    /// has started them, or the only one.
    ///
    /// # Errors
    ///
    /// If there is no such federation, or several.
    pub fn choose(wanted: Option<&str>) -> Result<Self, NotChosen> {
        let all = federations().map_err(NotChosen::Blind)?;
        let Some(wanted) = wanted else { return the_one(all, None) };
        let pid: Option<u32> = wanted.parse().ok();
        let of = |it: &Self| it.name() == wanted || it.0.iter().any(|it| Some(it.pid) == pid);
        let (meant, others): (Vec<_>, Vec<_>) = all.into_iter().partition(of);
        if pid.is_none() || !meant.is_empty() {
            return the_one(meant, Some(wanted));
        }
        // A command that waits for a process which hosts all federates has no board.
        let started = |it: &Self| it.0.iter().any(|it| parent(it.pid) == pid);
        the_one(others.into_iter().filter(started).collect(), Some(wanted))
    }
}

fn the_one(
    mut meant: Vec<RunningFederation>,
    wanted: Option<&str>,
) -> Result<RunningFederation, NotChosen> {
    match meant.len() {
        0 => Err(wanted.map_or(NotChosen::None, |name| NotChosen::Unknown(name.to_owned()))),
        1 => Ok(meant.swap_remove(0)),
        _ => Err(NotChosen::Several(wanted.map(str::to_owned), meant)),
    }
}

/// The process that has started another one, if that still runs.
fn parent(pid: u32) -> Option<u32> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    status.lines().find_map(|line| line.strip_prefix("PPid:"))?.trim().parse().ok()
}

impl NotChosen {
    /// Whether there may be such a federation later.
    #[must_use]
    pub fn may_come(&self) -> bool {
        matches!(self, Self::None | Self::Unknown(_))
    }

    /// What users are told. `name_it` says how a federation is named, as in `hprm top 4711`, from the number of a process.
    #[must_use]
    pub fn report(&self, name_it: impl Fn(u32) -> String) -> Report {
        let report = |message: String| Report::new(Kind::Command, message);
        match self {
            Self::Blind(error) => report(format!("cannot see processes: {error}")),
            Self::None => report("no federation of this user runs on this machine".to_owned())
                .hint("hprm run starts one; programs in one process, and federations of other users, are not shown"),
            Self::Unknown(wanted) => unknown(wanted),
            Self::Several(wanted, federations) => {
                let of = wanted.as_ref().map(|name| format!(" of {name}")).unwrap_or_default();
                let lines = federations.iter().map(|it| format!("\n  {}", it.line()));
                let lines: String = lines.collect();
                let example = name_it(federations[0].first().pid);
                report(format!("several federations{of} run:{lines}"))
                    .hint(format!("name one, or one of its processes: {example}"))
            }
        }
    }
}

fn unknown(wanted: &str) -> Report {
    let report = |message: String| Report::new(Kind::Command, message);
    let owner = fs::metadata(format!("/proc/{wanted}")).map(|it| it.uid());
    let shown = "`hprm top` shows the federation that runs";
    match (wanted.parse::<u32>(), owner) {
        (Ok(pid), Ok(owner)) if owner != geteuid().as_raw() => {
            report(format!("process {pid} belongs to another user"))
                .hint("only that user can watch its federation")
        }
        (Ok(pid), Ok(_)) => report(format!("process {pid} belongs to no federation"))
            .hint(format!("{shown}; a program in one process is none")),
        (Ok(pid), Err(_)) => report(format!("there is no process {pid}")).hint(shown),
        _ => report(format!("no federation {wanted} of this user runs on this machine"))
            .hint("the name is that of the program; `hprm top` shows what runs"),
    }
}
