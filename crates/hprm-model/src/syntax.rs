//! What a program is written in, for the hints that show how something is written.
//!
//! Rules do not depend on it: only these words do.

/// The language of a program, as far as diagnostics show it.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Syntax {
    /// Lingua Franca.
    #[default]
    Lf,
    /// Classes in Python.
    Python,
}

/// Target properties that a class statement in Python has as keywords; others are in `properties={...}`.
const KEYWORDS: [&str; 5] = ["coordination", "timeout", "fast", "keepalive", "workers"];

impl Syntax {
    fn either<'t>(self, lf: &'t str, python: &'t str) -> &'t str {
        match self {
            Self::Lf => lf,
            Self::Python => python,
        }
    }

    /// An option of an instance or a connection, by its name, between backquotes.
    #[must_use]
    pub fn option(self, name: &str) -> String {
        match self {
            Self::Lf => format!("`@{name}`"),
            Self::Python => format!("`{name}=`"),
        }
    }

    /// An option with a value that shows what is expected, between backquotes.
    #[must_use]
    pub fn option_with(self, name: &str, value: &str) -> String {
        match self {
            Self::Lf => format!("`@{name}({value})`"),
            Self::Python if value.contains(',') => format!("`{name}=({value})`"),
            Self::Python if value.contains(' ') => format!("`{name}=\"{value}\"`"),
            Self::Python => format!("`{name}={value}`"),
        }
    }

    /// A target property with a value.
    pub(crate) fn property(self, name: &str, value: &str) -> String {
        match self {
            Self::Lf => format!("`{name}: {value}`"),
            Self::Python => {
                let value = match value {
                    "true" => "True".to_owned(),
                    "false" => "False".to_owned(),
                    _ if value.parse::<f64>().is_ok() => value.to_owned(),
                    _ => format!("\"{value}\""),
                };
                match KEYWORDS.contains(&name) {
                    true => format!("`{name}={value}`"),
                    false => format!("`\"{name}\": {value}`"),
                }
            }
        }
    }

    /// What the value of a target property must be, which is said in the words of `.lf` files.
    pub(crate) fn value(self, expected: &str) -> String {
        const WORDS: [(&str, &str); 3] = [
            ("`true`", "`True`"),
            ("`false`", "`False`"),
            ("`{ name: value, ... }`", "`{\"name\": value, ...}`"),
        ];
        match self {
            Self::Lf => expected.to_owned(),
            Self::Python => WORDS
                .into_iter()
                .fold(expected.to_owned(), |text, (lf, python)| text.replace(lf, python)),
        }
    }

    /// A connection of two ports.
    pub(crate) fn connection(self, from: &str, to: &str) -> String {
        match self {
            Self::Lf => format!("write `{from} -> {to}`"),
            Self::Python => format!("write `hprm.connect(self.{from}, self.{to})`"),
        }
    }

    /// A connection to an input that lacks one.
    pub(crate) fn connection_to(self, input: &str) -> String {
        match self {
            Self::Lf => format!("connect an output to it: `... -> {input}`"),
            Self::Python => format!("connect an output to it: `hprm.connect(..., self.{input})`"),
        }
    }

    /// How a connection repeats its left side.
    pub(crate) fn repeated(self) -> &'static str {
        self.either("`(...)+` repeats the left side", "`repeated=True` repeats the left side")
    }

    /// A connection with the shortest delay.
    pub(crate) fn shortest_delay(self) -> &'static str {
        self.either("`after 0`", "`after=0`")
    }

    /// What makes a connection physical.
    pub(crate) fn physical(self) -> &'static str {
        self.either("`~>`", "`physical=True`")
    }

    /// What sets an output that nothing sets yet.
    pub(crate) fn set_output(self, output: &str) -> String {
        match self {
            Self::Lf => format!(
                "name it as the effect of a reaction that calls `{output}.set(value)`, or connect \
                 an output of a contained reactor to it"
            ),
            Self::Python => format!(
                "name it in `effects=[...]` of a reaction that calls `self.{output}.set(value)`, \
                 or connect an output of a contained reactor to it"
            ),
        }
    }

    /// What to do about a host that only a federation can have.
    pub(crate) fn federated_or_no_host(self) -> &'static str {
        self.either(
            "write `federated reactor`, or remove `at`",
            "extend `hprm.Federation`, or remove `host=`",
        )
    }

    /// Why a reactor of this name cannot be part of another one.
    pub(crate) fn is_main(self, reactor: &str) -> String {
        match self {
            Self::Lf => format!("`{reactor}` is a main reactor: it cannot be instantiated"),
            Self::Python => {
                format!("`{reactor}` is a federation: no other reactor can contain it")
            }
        }
    }

    /// How a federated reactor gets a federate.
    pub(crate) fn make_federate(self) -> &'static str {
        self.either(
            "make one in it: `camera = new Camera()`",
            "make reactors in its constructor, `def __init__(self)`: `self.camera = Camera()`",
        )
    }

    /// What to do about what is in no federate.
    pub(crate) fn move_into_federate(self) -> &'static str {
        self.either(
            "move it into a reactor that the federated reactor instantiates",
            "move it into a reactor that the federation contains",
        )
    }

    /// Where an option of a federation belongs.
    pub(crate) fn home(self, on_connection: bool) -> &'static str {
        match (self, on_connection) {
            (Self::Lf, true) => "it belongs to a connection of a federated reactor",
            (Self::Lf, false) => "it belongs to an instance of a federated reactor",
            (Self::Python, true) => "it belongs to a connection of a federation",
            (Self::Python, false) => "it belongs to a reactor that a federation contains",
        }
    }

    /// A reactor that is an executable.
    pub(crate) fn executable(self) -> &'static str {
        self.either(
            "write `@executable(\"path\")`, or `@executable(\"path\", \"argument\")`",
            "write `executable=\"path\"`, or `executable=[\"path\", \"argument\"]`",
        )
    }

    /// A federate that is started again.
    pub(crate) fn restart(self) -> &'static str {
        self.either(
            "write `@restart(\"on-failure\", sec=100 ms, burst=5, interval=10 s)`, without what is to be as systemd \
             has it",
            "write `restart=hprm.Restart(\"on-failure\", sec=\"100 ms\", burst=5, interval=\"10 s\")`, without what \
             is to be as systemd has it",
        )
    }

    /// What makes a federate transient.
    pub(crate) fn transient(self) -> &'static str {
        self.either(
            "write `@transient`, too, if the others are to go on while it is away",
            "write `transient=True`, too, if the others are to go on while it is away",
        )
    }

    /// Where instances of executables belong.
    pub(crate) fn federated_for_executables(self) -> &'static str {
        self.either(
            "instantiate it in a `federated reactor`: an executable is a process of its own",
            "let a `hprm.Federation` contain it: an executable is a process of its own",
        )
    }

    /// What can trigger a reaction.
    pub(crate) fn triggers(self) -> &'static str {
        self.either(
            "name a trigger: an input, an action, a timer, `startup`",
            "name a trigger: an input, an action, a timer, `hprm.startup`",
        )
    }

    /// What makes a mode the initial one.
    pub(crate) fn initial_mode(self) -> &'static str {
        self.either(
            "write `initial mode` where the reactor starts",
            "write `hprm.Mode(initial=True)` for the one where the reactor starts",
        )
    }
}
