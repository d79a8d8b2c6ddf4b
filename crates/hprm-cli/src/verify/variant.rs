//! In which ways a program is run, one after the other.
//!
//! Each run changes several things at once, on cycles of different lengths, so that a few runs cover
//! each value of each thing, and more runs most of their combinations.

use std::fmt;

use hprm_model::Compiled;

/// A way to run a program.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Variant {
    /// From one.
    pub(super) number: u32,
    /// Of Python's hashes, which decide on the order of sets.
    pub(super) hash_seed: u32,
    /// None if the user has said how many.
    workers: Option<u32>,
    /// How many threads keep the machine busy meanwhile.
    pub(super) load: usize,
    /// None if there is none, or the user has said which.
    coordination: Option<&'static str>,
    pub(super) deployment: Deployment,
}

/// What a program can be run as.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Kind {
    /// One process.
    Whole,
    /// Processes, threads, or as a whole.
    Federated,
    /// Processes only: some come and go, or are executables.
    Processes,
}

/// What is known of a program before it runs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Subject {
    pub(super) kind: Kind,
    /// It follows no clock, and that rules out decentralized coordination.
    pub(super) fast: bool,
}

impl Subject {
    /// That of a program.
    pub(super) fn of(compiled: &Compiled) -> Self {
        Self { kind: Kind::of(compiled), fast: compiled.program.properties.fast }
    }
}

impl Kind {
    fn of(compiled: &Compiled) -> Self {
        let program = &compiled.program;
        let come_and_go = program.federates.values().any(|federate| federate.transient);
        match come_and_go || !compiled.executables.is_empty() {
            true => Self::Processes,
            false if program.is_federated() => Self::Federated,
            false => Self::Whole,
        }
    }
}

/// Where the federates of a program run.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Deployment {
    /// As the command runs the program.
    Usual,
    /// As threads of one process.
    Threads,
    /// Nowhere: the program is one.
    Whole,
}

impl Variant {
    /// The way of a run.
    pub(super) fn of(number: u32, Subject { kind, fast }: Subject) -> Self {
        let index = number - 1;
        let at = |values: &[u32]| values[index as usize % values.len()];
        let (coordination, deployment) = match (kind, index % 5) {
            (Kind::Whole, _) => (None, Deployment::Usual),
            (_, 0) => (Some("centralized"), Deployment::Usual),
            (Kind::Processes, 2 | 4) => (Some("decentralized"), Deployment::Usual),
            (Kind::Processes, _) => (Some("centralized"), Deployment::Usual),
            (Kind::Federated, 1) => (None, Deployment::Whole),
            (Kind::Federated, 2) => (Some("decentralized"), Deployment::Usual),
            (Kind::Federated, 3) => (Some("centralized"), Deployment::Threads),
            (Kind::Federated, _) => (Some("decentralized"), Deployment::Threads),
        };
        let coordination = coordination.map(|kind| if fast { "centralized" } else { kind });
        Self {
            number,
            hash_seed: index,
            workers: Some(at(&[1, 2, 8])),
            load: at(&[0, 0, 0, 2]) as usize,
            coordination,
            deployment,
        }
    }

    /// The same, but for what the user has chosen: that does not vary. `stated` is as `KEY=VALUE`.
    pub(super) fn keeping(mut self, stated: &[String]) -> Self {
        self.workers = self.workers.filter(|_| !is_stated(stated, "workers"));
        self.coordination = self.coordination.filter(|_| !is_stated(stated, "coordination"));
        self
    }

    /// The target properties that make it.
    pub(super) fn properties(&self) -> impl Iterator<Item = String> {
        let coordination = self.coordination.map(|kind| format!("coordination={kind}"));
        let workers = self.workers.map(|workers| format!("workers={workers}"));
        coordination.into_iter().chain(workers)
    }
}

/// Which ways that a user may expect are left out, and why.
pub(super) fn left_out(
    runs: u32,
    Subject { kind, fast }: Subject,
    stated: &[String],
) -> Option<&'static str> {
    let is_due = |number| {
        let usual = Variant::of(number, Subject { kind, fast: false });
        usual.coordination == Some("decentralized")
    };
    let is_missed = fast && !is_stated(stated, "coordination") && (1..=runs).any(is_due);
    is_missed.then_some("no run is decentralized, as `fast` does not go together with that")
}

fn is_stated(stated: &[String], name: &str) -> bool {
    stated.iter().any(|property| property.split('=').next().map(str::trim) == Some(name))
}

impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "hash seed {}", self.hash_seed)?;
        match self.workers {
            None => {}
            Some(1) => f.write_str(", 1 worker")?,
            Some(workers) => write!(f, ", {workers} workers")?,
        }
        if let Some(coordination) = self.coordination {
            write!(f, ", {coordination}")?;
        }
        f.write_str(match self.deployment {
            Deployment::Usual => "",
            Deployment::Threads => ", as threads",
            Deployment::Whole => ", in one process",
        })?;
        if self.load > 0 {
            f.write_str(", on a busy machine")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FEDERATED: Subject = Subject { kind: Kind::Federated, fast: false };

    #[test]
    fn the_default_number_of_runs_covers_everything() {
        let runs: Vec<_> = (1..=6).map(|number| Variant::of(number, FEDERATED)).collect();
        for workers in [1, 2, 8] {
            assert!(runs.iter().any(|run| run.workers == Some(workers)));
        }
        for coordination in [None, Some("centralized"), Some("decentralized")] {
            assert!(runs.iter().any(|run| run.coordination == coordination));
        }
        assert!(runs.iter().any(|run| run.load > 0));
        for deployment in [Deployment::Usual, Deployment::Threads, Deployment::Whole] {
            assert!(runs.iter().any(|run| run.deployment == deployment));
        }
        let way = "hash seed 3, 1 worker, centralized, as threads, on a busy machine";
        assert_eq!(runs[3].to_string(), way);
    }

    #[test]
    fn what_the_user_has_chosen_does_not_vary() {
        let stated = ["coordination = decentralized", "workers=3"].map(str::to_owned);
        let run = Variant::of(4, FEDERATED);
        assert_eq!(run.clone().keeping(&[]), run);
        let run = run.keeping(&stated);
        assert_eq!(run.properties().next(), None);
        assert_eq!(run.to_string(), "hash seed 3, as threads, on a busy machine");
    }

    #[test]
    fn a_program_that_is_not_federated_has_no_coordination() {
        let run = Variant::of(3, Subject { kind: Kind::Whole, fast: true });
        assert_eq!(run.properties().collect::<Vec<_>>(), ["workers=8"]);
        assert_eq!(run.to_string(), "hash seed 2, 8 workers");
    }

    #[test]
    fn a_program_that_follows_no_clock_is_never_decentralized_and_that_is_told() {
        for kind in [Kind::Federated, Kind::Processes] {
            let fast = Subject { kind, fast: true };
            let runs: Vec<_> = (1..=6).map(|number| Variant::of(number, fast)).collect();
            assert!(runs.iter().all(|run| run.coordination != Some("decentralized")), "{runs:?}");
            let told = left_out(6, fast, &[]).unwrap();
            assert!(told.contains("`fast`"), "{told}");
            assert_eq!(left_out(2, fast, &[]), None, "no run would have been");
            assert_eq!(left_out(6, fast, &["coordination=centralized".to_owned()]), None);
            assert_eq!(left_out(6, Subject { kind, fast: false }, &[]), None);
        }
        assert_eq!(left_out(6, Subject { kind: Kind::Whole, fast: true }, &[]), None);
    }
}
