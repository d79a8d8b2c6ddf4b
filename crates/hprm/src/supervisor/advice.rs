//! What the supervisor advises, in the words of those that the user knows: options of the command, or calls of
//! a program.

/// The hints that depend on what the user has started.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Advice {
    /// Federates have not joined or loaded in time.
    pub late_start: &'static str,
    /// A federate does not answer.
    pub silent: &'static str,
    /// A federate has ended before it joined, without a word to the RTI.
    pub unexplained: &'static str,
    /// A transient federate has been started too often to be started again.
    pub too_often: &'static str,
}

impl Advice {
    /// For a user of the command `hprm`.
    pub const COMMAND: Self = Self {
        late_start: "programs that take long to load need a longer --join-timeout",
        silent: "one of its reactions takes long or hangs; to end the federation in this case, set \
                 --hang-timeout",
        unexplained: "if its own output does not say why, see what hprm doctor says",
        too_often: "the others go on without it; `hprm federate` starts it by hand, and `@restart` (in Python, \
                    `restart=`) states how often it may be started",
    };

    /// For a user of a program in Rust.
    pub const PROGRAM: Self = Self {
        late_start: "federates that take long to begin need a longer join timeout",
        silent: "one of its reactions takes long or hangs; to end the federation in this case, set a hang \
                 timeout",
        unexplained: "its own output may say why; `main` has to come to the `run` of this federation, by the same \
                      name, in each process",
        too_often: "the others go on without it; `Restart::limit` states how often it may be started",
    };
}
