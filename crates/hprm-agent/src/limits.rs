//! What a program may use that the agent starts for somebody else.
//!
//! This is what is asked for. `hprm starter` sees to it, by limits of each process, and a control group, where there are some (`groups.rs`), for
//! all processes together.

use clap::Args;
use hprm::launch::GroupLimits;

/// How many processes and threads there may be while a program starts more, and how many files a process
/// may have open: more than robots need, and far less than what stops a machine.
const PROCESSES: u64 = 4096;
const FILES: u64 = 4096;

/// See the module.
#[derive(Args, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Limits {
    /// How much memory a program may use, as in 4G; by default as much as the machine has. Where there are no cgroups, each
    /// process of a program may allocate that much
    #[arg(long = "program-memory", value_name = "BYTES", requires = "fleet_keys", value_parser = bytes)]
    memory: Option<u64>,
    /// How many processes and threads a program may have, and the user of the agent may have for a program to start another one
    #[arg(long = "program-processes", value_name = "NUMBER", requires = "fleet_keys", default_value_t = PROCESSES)]
    processes: u64,
    /// How many files each process of a program may have open
    #[arg(long = "program-files", value_name = "NUMBER", requires = "fleet_keys", default_value_t = FILES)]
    files: u64,
}

impl Limits {
    /// What `hprm starter` is told.
    pub(crate) fn arguments(&self) -> [String; 3] {
        [
            format!("--memory={}", self.memory()),
            format!("--processes={}", self.processes),
            format!("--files={}", self.files),
        ]
    }

    /// What all processes of a program may use together, where there are cgroups.
    pub(crate) fn of_group(&self) -> GroupLimits {
        GroupLimits { memory: self.memory(), processes: self.processes }
    }

    fn memory(&self) -> u64 {
        self.memory.unwrap_or_else(|| {
            let system = rustix::system::sysinfo();
            (system.totalram as u64).saturating_mul(u64::from(system.mem_unit))
        })
    }
}

/// Reads a number of bytes, perhaps with K, M, G or T behind it.
fn bytes(text: &str) -> Result<u64, String> {
    let (number, unit) = match text.char_indices().next_back() {
        Some((at, unit)) if unit.is_ascii_alphabetic() => (&text[..at], unit.to_ascii_uppercase()),
        _ => (text, ' '),
    };
    let shift = match unit {
        ' ' => 0,
        'K' => 10,
        'M' => 20,
        'G' => 30,
        'T' => 40,
        _ => 64,
    };
    let number =
        number.parse::<u64>().ok().and_then(|number| number.checked_mul(1 << (shift % 64)));
    number
        .filter(|number| shift < 64 && *number > 0)
        .ok_or_else(|| "write bytes, perhaps with K, M, G or T, as in 4G".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_numbers_with_a_unit_behind() {
        let sizes =
            [("512", 512), ("4G", 4 << 30), ("3m", 3 << 20), ("1T", 1 << 40), ("2k", 2 << 10)];
        for (text, size) in sizes {
            assert_eq!(bytes(text), Ok(size));
        }
        for wrong in ["", "G", "0", "4X", "-1", "4GG", "1.5G", "99999999999T", "ü"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
        }
    }
}
