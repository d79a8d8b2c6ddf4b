//! What can be typed after `hprm ros` and `hprm launch`.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Subcommand};

use super::{Interpreter, duration};

/// Run programs of ROS 2 that are written for rclpy, without a ROS installation.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
pub(crate) struct Ros {
    #[command(subcommand)]
    pub(crate) command: RosCommand,
}

#[derive(Subcommand, Clone, PartialEq, Eq, Debug)]
pub(crate) enum RosCommand {
    Run(RosRun),
}

/// What is said of the bridge to nodes of ROS 2 that run elsewhere.
#[derive(Args, Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Bridging {
    /// Connect the scripts with nodes of ROS 2 that run elsewhere, over rmw_zenoh and the router at this endpoint. If
    /// it is on this machine and nothing listens there, this run is the router.
    #[arg(
        long,
        value_name = "ENDPOINT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "tcp/localhost:7447"
    )]
    pub(crate) zenoh: Option<String>,
    /// The domain of ROS 2 for --zenoh. Without it: that of ROS_DOMAIN_ID, or 0.
    #[arg(long, value_name = "NUMBER", requires = "zenoh")]
    pub(crate) domain_id: Option<String>,
    /// Connect only this topic, service or action with --zenoh. May be repeated.
    #[arg(long, value_name = "NAME", requires = "zenoh")]
    pub(crate) zenoh_only: Vec<String>,
    /// With --zenoh, let messages from elsewhere have as tag the stamp of their header plus this time in seconds, if they
    /// arrive by then. Without it, and for those that have no stamp or come later: the time of their arrival.
    #[arg(long, value_name = "SECONDS", requires = "zenoh", value_parser = wait)]
    pub(crate) zenoh_align_stamp: Option<Duration>,
}

/// How programs of rclpy run, one or several.
#[derive(Args, Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Running {
    /// Write down what the callbacks took and published, at which tags, as one trace; hprm diff compares two.
    #[arg(long, value_name = "FILE")]
    pub(crate) logical_trace: Option<PathBuf>,
    /// What clocks show at the start, in seconds since 1970, so that times in messages are the same in each run. Without
    /// it: the time.
    #[arg(long, value_name = "SECONDS", value_parser = start_time)]
    pub(crate) start_time: Option<Duration>,
    #[command(flatten)]
    pub(crate) bridging: Bridging,
    /// Do not wait for physical time.
    #[arg(short, long, value_name = "true|false", hide_possible_values = true, value_parser = clap::value_parser!(bool))]
    pub(crate) fast: Option<bool>,
}

/// A time since 1970 that nanoseconds in 64 bits can state.
fn start_time(text: &str) -> Result<Duration, String> {
    let found = duration(text).filter(|it| it.as_secs() < 9_000_000_000);
    found.ok_or_else(|| "it has to be a number of seconds, from 0".to_owned())
}

/// How long a message may take to come, which delays all of them.
fn wait(text: &str) -> Result<Duration, String> {
    let found = duration(text).filter(|it| it.as_secs_f64() <= 60.0);
    found.ok_or_else(|| "it has to be a number of seconds, from 0 to 60".to_owned())
}

/// Run scripts that import rclpy, as they are.
///
/// Several scripts, with a + between them, are one federation: their callbacks run in the order of tags, the same on
/// every run. Each script is a process.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
#[command(after_help = "\
Examples:
  hprm ros run talker.py
  hprm ros run talker.py + listener.py
  hprm ros run talker.py --ros-args -r chatter:=news -p period:=0.1
  hprm ros run --fast true simulator.py + robot.py
  hprm ros run --zenoh talker.py")]
pub(crate) struct RosRun {
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
    #[command(flatten)]
    pub(crate) running: Running,
    /// A Python file and its arguments; then perhaps + and another one.
    #[arg(
        value_name = "SCRIPT",
        required = true,
        num_args = 1..,
        trailing_var_arg = true,
        allow_hyphen_values = true
    )]
    pub(crate) scripts: Vec<OsString>,
}

/// Start the nodes of a ROS 2 launch file as one federation, without a ROS installation.
///
/// It is a file in Python, XML or YAML. Each node is a process, and callbacks run in the order of tags.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
#[command(after_help = "\
Examples:
  hprm launch robot.launch.py
  hprm launch robot.launch.yaml camera:=front rate:=10
  hprm launch --show-args robot.launch.py
  hprm launch --print-description robot.launch.py
  hprm launch robot_bringup robot.launch.py

A package is a folder of its name: beside the launch file, in a folder above or in the src of one, or in
HPRM_ROS_PACKAGES.")]
pub(crate) struct Launch {
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
    #[command(flatten)]
    pub(crate) running: Running,
    /// Show the arguments that the file takes, and start nothing.
    #[arg(long, short = 's')]
    pub(crate) show_args: bool,
    /// Show the actions of the file as a tree, and start nothing.
    #[arg(long, short = 'p', conflicts_with = "show_args")]
    pub(crate) print_description: bool,
    /// The launch file; or the package that has it, with its name behind that.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// An argument of the launch file.
    #[arg(value_name = "NAME:=VALUE")]
    pub(crate) arguments: Vec<OsString>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_start_is_a_time_since_1970_that_nanoseconds_can_state() {
        assert_eq!(start_time("0"), Ok(Duration::ZERO));
        assert_eq!(start_time("1.5"), Ok(Duration::from_millis(1500)));
        for wrong in ["-1", "9e9", "NaN", "inf", "soon"] {
            assert!(start_time(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_wait_for_messages_has_a_limit() {
        assert_eq!(wait("0.05"), Ok(Duration::from_millis(50)));
        for wrong in ["-1", "61", "NaN", "50ms"] {
            assert!(wait(wrong).is_err(), "{wrong}");
        }
    }
}
