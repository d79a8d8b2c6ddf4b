//! In which ways a program is run, one after the other.
//!
//! Each run changes several things at once, on cycles of different lengths, so that a few runs cover
//! each value of each thing, and more runs most of their combinations.

use std::fmt;

/// A way to run a program.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Variant {
    /// From one.
    pub(super) number: u32,
    /// Of Python's hashes, which decide on the order of sets.
    pub(super) hash_seed: u32,
    workers: u32,
    /// How many threads keep the machine busy meanwhile.
    pub(super) load: usize,
    coordination: Option<&'static str>,
    /// Whether all federates share one process.
    pub(super) in_one_process: bool,
}

impl Variant {
    /// The way of a run.
    pub(super) fn of(number: u32, federated: bool) -> Self {
        let index = number - 1;
        let at = |values: &[u32]| values[index as usize % values.len()];
        let (coordination, in_one_process) = match (federated, index % 3) {
            (false, _) => (None, false),
            (true, 0) => (Some("centralized"), false),
            (true, 1) => (None, true),
            (true, _) => (Some("decentralized"), false),
        };
        Self {
            number,
            hash_seed: index,
            workers: at(&[1, 2, 8]),
            load: at(&[0, 0, 0, 2]) as usize,
            coordination,
            in_one_process,
        }
    }

    /// The target properties that make it.
    pub(super) fn properties(&self) -> impl Iterator<Item = String> {
        let coordination = self.coordination.map(|kind| format!("coordination={kind}"));
        coordination.into_iter().chain([format!("workers={}", self.workers)])
    }
}

impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "hash seed {}, ", self.hash_seed)?;
        match self.workers {
            1 => f.write_str("1 worker")?,
            workers => write!(f, "{workers} workers")?,
        }
        if let Some(coordination) = self.coordination {
            write!(f, ", {coordination}")?;
        }
        if self.in_one_process {
            f.write_str(", in one process")?;
        }
        if self.load > 0 {
            f.write_str(", on a busy machine")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_number_of_runs_covers_everything() {
        let runs: Vec<_> = (1..=6).map(|number| Variant::of(number, true)).collect();
        for workers in [1, 2, 8] {
            assert!(runs.iter().any(|run| run.workers == workers));
        }
        for coordination in [None, Some("centralized"), Some("decentralized")] {
            assert!(runs.iter().any(|run| run.coordination == coordination));
        }
        assert!(runs.iter().any(|run| run.load > 0) && runs.iter().any(|run| run.in_one_process));
        assert_eq!(runs[3].to_string(), "hash seed 3, 1 worker, centralized, on a busy machine");
    }

    #[test]
    fn a_program_that_is_not_federated_has_no_coordination() {
        let run = Variant::of(3, false);
        assert_eq!(run.properties().collect::<Vec<_>>(), ["workers=8"]);
        assert_eq!(run.to_string(), "hash seed 2, 8 workers");
    }
}
