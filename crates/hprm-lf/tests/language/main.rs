//! The front end, as users of the crate see it. They are one program: each of several would link
//! the same crates again.

mod answers;
mod bodies;
mod by_hand;
mod common;
mod diagnostics_classes;
mod diagnostics_instances;
mod diagnostics_modes;
mod diagnostics_text;
mod executables;
mod explanations;
mod fingerprint;
mod fuzz;
mod imports;
mod inheritance;
mod lowering;
mod mutations;
mod parameters;
mod programs;
mod rules;

#[path = "../../../hprm-model/tests/by_hand/mod.rs"]
mod two_doors;
