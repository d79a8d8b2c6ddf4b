//! What can be typed after `hprm top`.

use std::time::Duration;

use clap::Args;

use crate::args::{federate, seconds};

/// Show a running federation: where each federate is, and what it waits for.
///
/// All federations of this user on this machine can be watched, however they were started. Nothing has to be
/// prepared, and watching does not disturb them. Without a terminal, or with --once, the state is printed once.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
#[command(after_help = "\
Examples:
  hprm top                            the federation that runs, or a list of those that do
  hprm top Vision                     the federation of this program
  hprm top 4711                       the federation of a process
  hprm top --once                     print the state, and why each federate waits
  hprm top --once --federate planner  the same, of one federate
  hprm top --once --json | jq '.federates[] | {name, state, cause}'

Keys: arrows choose a federate, p pauses, q ends.")]
pub(crate) struct Top {
    /// The federation: the name of its program, or the number of one of its processes. Without it, the one that
    /// runs.
    #[arg(value_name = "FEDERATION")]
    pub(crate) federation: Option<String>,
    /// Print the state once, and end.
    #[arg(long)]
    pub(crate) once: bool,
    /// Print the state as one JSON object, once.
    #[arg(long)]
    pub(crate) json: bool,
    /// Print only what concerns this federate; on the screen, choose it at first.
    #[arg(long, value_name = "FEDERATE", value_parser = federate)]
    pub(crate) federate: Option<String>,
    /// Over how many seconds rates are measured, and how often the screen changes.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, default_value = "1", value_parser = seconds)]
    pub(crate) interval: Duration,
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        top: Top,
    }

    #[test]
    fn a_member_of_a_bank_is_named_in_two_ways() {
        for text in ["camera[1]", "camera__1"] {
            let line = Line::try_parse_from(["hprm", "--federate", text]).unwrap();
            assert_eq!(line.top.federate.as_deref(), Some("camera__1"));
        }
    }
}
