//! What can be typed to look at recordings of ROS 2.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use super::Interpreter;

/// Look at bags of ROS 2, which are recordings of topics, convert, play and record them. No installation of ROS is needed.
///
/// A bag is a folder with metadata.yaml, or one file of the format MCAP or SQLite 3. Needs the Python package rosbags,
/// which the extra hprm[ros] installs.
#[derive(Args, Debug)]
pub(crate) struct Bag {
    #[command(subcommand)]
    pub(crate) command: BagCommand,
}

#[derive(Subcommand, Debug)]
pub(crate) enum BagCommand {
    Info(Info),
    Convert(Convert),
    Play(Play),
    Record(Record),
}

/// Print what is in bags: topics, types, numbers of messages, when they begin and how long they are.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  hprm bag info drive                 a bag that is a folder
  hprm bag info drive/drive_0.mcap    one file
  hprm bag info drive --json | jq .topics")]
pub(crate) struct Info {
    /// The bags.
    #[arg(value_name = "BAG", required = true)]
    pub(crate) bags: Vec<PathBuf>,
    /// Print one JSON object a line.
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
}

/// Write a copy of a bag in the other format: MCAP for SQLite 3, and SQLite 3 for MCAP.
///
/// The copy has the same topics, messages and times. It has its name only when it is whole; where it cannot be written,
/// nothing is left.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  hprm bag convert drive drive_sqlite
  hprm bag convert old.db3 new --storage mcap")]
pub(crate) struct Convert {
    /// The bag.
    #[arg(value_name = "BAG")]
    pub(crate) source: PathBuf,
    /// The folder that the copy will be; it must not be there.
    #[arg(value_name = "COPY")]
    pub(crate) destination: PathBuf,
    /// The format of the copy, instead of the one that the bag does not have.
    #[arg(long, value_name = "FORMAT")]
    pub(crate) storage: Option<Storage>,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
}

/// Publish the messages of a bag, at the tags of their times.
///
/// The first message leaves at once. Scripts behind a + run in one federation with it, as those of hprm ros run. It ends
/// with the last message; scripts go on until they end, or Ctrl-C.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  hprm bag play drive + listener.py
  hprm bag play drive --rate 2 --topic /image --remap /image:=/camera/image + detector.py")]
pub(crate) struct Play {
    /// The bag.
    #[arg(value_name = "BAG")]
    pub(crate) bag: PathBuf,
    /// How many times as fast as it was recorded.
    #[arg(long, value_name = "FACTOR")]
    pub(crate) rate: Option<f64>,
    /// Begin again at the end, until Ctrl-C.
    #[arg(long = "loop")]
    pub(crate) is_loop: bool,
    /// Leave out so many seconds at the beginning.
    #[arg(long, value_name = "SECONDS")]
    pub(crate) start_offset: Option<f64>,
    /// Play this topic only. May be repeated.
    #[arg(long, value_name = "NAME")]
    pub(crate) topic: Vec<String>,
    /// Publish a topic under another name. May be repeated.
    #[arg(long, value_name = "OLD:=NEW")]
    pub(crate) remap: Vec<String>,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
    /// + and a script with its arguments, perhaps several times.
    #[arg(value_name = "+ SCRIPT", trailing_var_arg = true, allow_hyphen_values = true)]
    pub(crate) scripts: Vec<OsString>,
}

/// Write the messages of topics into a bag, with the times of their tags, until Ctrl-C.
///
/// Scripts behind a + run in one federation with it, as those of hprm ros run. A topic whose type is stated is recorded from
/// the first message on, others from when they are found. Where the disk does not keep up, messages are lost and counted.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  hprm bag record + talker.py                                     all topics
  hprm bag record --output drive /chatter=std_msgs/msg/String + talker.py
  hprm bag record --wait /image + camera.py                       lose nothing")]
pub(crate) struct Record {
    /// The bag; without it, its name is the time.
    #[arg(short, long, value_name = "BAG")]
    pub(crate) output: Option<PathBuf>,
    /// The format of the bag; mcap if there is none.
    #[arg(long, value_name = "FORMAT")]
    pub(crate) storage: Option<Storage>,
    /// Let publishers wait for the disk, and lose nothing.
    #[arg(long)]
    pub(crate) wait: bool,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
    /// The topics, all if there are none; then perhaps + and a script with its arguments.
    #[arg(value_name = "TOPIC[=TYPE]", trailing_var_arg = true, allow_hyphen_values = true)]
    pub(crate) words: Vec<OsString>,
}

/// The formats of bags.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub(crate) enum Storage {
    Mcap,
    Sqlite3,
}
