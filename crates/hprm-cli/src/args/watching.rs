//! What can be typed to look at connections of a running federation.

use std::time::Duration;

use clap::Args;

use super::numbers::at_least;
use super::{Interpreter, seconds};

/// Which federation is meant.
#[derive(Args, Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Of {
    /// The federation, if several run: its name, that is the name of its program's main reactor, or the number of one of
    /// its processes.
    #[arg(long = "of", value_name = "FEDERATION")]
    pub(crate) federation: Option<String>,
    /// Wait so many seconds until it runs, if it does not run yet.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = seconds)]
    pub(crate) wait: Option<Duration>,
}

/// Print the values that pass connections of a running federation, or show them in a viewer.
///
/// From each message that is sent from now on, it prints the tag and the value; arrays are summarized. The federation
/// does not wait for it, and its tags and messages are the same as without it.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  hprm echo camera.image              what the output image of the federate camera sends
  hprm echo planner.goal --once       the next value that the input goal gets
  hprm echo 'camera[1].image[0]'      a member of a bank, a channel of a multiport
  hprm echo camera.image planner.goal several ports
  hprm echo camera.image --json | jq .value
  hprm echo --foxglove                all connections, in Foxglove: open ws://127.0.0.1:8765 there

It ends with Ctrl-C, or when the federate has ended, with exit code 0.")]
pub(crate) struct Echo {
    /// A federate and its output or input, which is connected to another federate. Without an index, all
    /// members of a bank or channels of a multiport.
    #[arg(value_name = "FED.PORT", required_unless_present = "foxglove")]
    pub(crate) ports: Vec<String>,
    /// Stop after the first value.
    #[arg(long, conflicts_with = "count")]
    pub(crate) once: bool,
    /// Stop after so many values.
    #[arg(short = 'n', long, value_name = "N", value_parser = at_least::<u64>(1))]
    pub(crate) count: Option<u64>,
    /// Show long texts, lists and arrays whole.
    #[arg(long)]
    pub(crate) full: bool,
    /// Print one JSON object a line.
    #[arg(long)]
    pub(crate) json: bool,
    /// Instead of printing them, show values in Foxglove: images, point clouds, numbers over the time of tags, texts.
    /// It listens for viewers at HOST:PORT; without ports, all connections are shown. Needs the Python package
    /// foxglove-sdk.
    #[arg(
        long,
        value_name = "HOST:PORT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "127.0.0.1:8765",
        value_parser = listen,
        conflicts_with_all = ["once", "count", "full", "json"],
    )]
    pub(crate) foxglove: Option<Listen>,
    #[command(flatten)]
    pub(crate) of: Of,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
}

/// Where to listen for viewers.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Listen {
    pub(crate) host: String,
    pub(crate) port: u16,
}

fn listen(text: &str) -> Result<Listen, String> {
    let parsed = text.rsplit_once(':').and_then(|(host, port)| {
        let host = host.strip_prefix('[').and_then(|it| it.strip_suffix(']')).unwrap_or(host);
        let port = port.parse().ok()?;
        (!host.is_empty()).then(|| Listen { host: host.to_owned(), port })
    });
    parsed.ok_or_else(|| "not an address, such as 127.0.0.1:8765".to_owned())
}

impl Echo {
    /// After how many values to stop.
    pub(crate) fn limit(&self) -> u64 {
        if self.once { 1 } else { self.count.unwrap_or(u64::MAX) }
    }
}

/// Print how many messages and bytes pass the connections of a running federation, and how regularly.
///
/// The federates count, so no message is missed, and no value is looked at.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  hprm rate                           all connections between federates, every second
  hprm rate camera.image --window 10
  hprm rate --once --json

It ends with Ctrl-C, or when the federation has ended, with exit code 0.")]
pub(crate) struct Rate {
    /// A federate and its output or input; without it, all connections between federates.
    #[arg(value_name = "FED.PORT")]
    pub(crate) port: Option<String>,
    /// Seconds over which messages are counted.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, default_value = "1", value_parser = seconds)]
    pub(crate) window: Duration,
    /// Stop after the first window.
    #[arg(long)]
    pub(crate) once: bool,
    /// Print one JSON object a line.
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) of: Of,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_has_a_host_and_a_port() {
        let parsed = |text: &str| listen(text).ok().map(|it| (it.host, it.port));
        assert_eq!(parsed("127.0.0.1:0"), Some(("127.0.0.1".to_owned(), 0)));
        assert_eq!(parsed("[::1]:8765"), Some(("::1".to_owned(), 8765)));
        for wrong in ["", "8765", ":8765", "localhost", "localhost:", "localhost:70000", "a:b"] {
            assert_eq!(parsed(wrong), None, "{wrong}");
        }
    }
}
