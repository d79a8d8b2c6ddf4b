//! The command `hprm`.
fn main() {}
