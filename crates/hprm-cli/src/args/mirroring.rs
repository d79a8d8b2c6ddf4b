//! What can be typed after `hprm mirror`.

use clap::{Args, ValueEnum};

use super::{Interpreter, Of};

/// Send the values that pass a connection of a running federation to a key of Zenoh, or to a topic of ROS 2.
///
/// Any program that uses Zenoh can subscribe to the key: values arrive as bytes, with their tags as attachments. The
/// federation does not wait for it, and its tags and messages are the same as without it.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  hprm mirror camera.image --key robot/image            the bytes of arrays; type and shape are in the encoding
  hprm mirror planner.goal --key robot/goal --as json
  hprm mirror planner.speed --topic /speed --type std_msgs/msg/Float64    for nodes of ROS 2 with rmw_zenoh

It ends with Ctrl-C, or when the federation has ended, with exit code 0. Needs the Python package eclipse-zenoh.")]
pub(crate) struct Mirror {
    /// A federate and its output or input, which is connected to another federate. Without an index, all
    /// members of a bank or channels of a multiport.
    #[arg(value_name = "FED.PORT")]
    pub(crate) port: String,
    /// The key of Zenoh.
    #[arg(long, required_unless_present = "topic", conflicts_with = "topic")]
    pub(crate) key: Option<String>,
    /// A topic of ROS 2 instead, as nodes see it that run with rmw_zenoh.
    #[arg(long, value_name = "NAME", requires = "type_", conflicts_with = "form")]
    pub(crate) topic: Option<String>,
    /// As what values are sent: raw, the bytes of bytes, texts and arrays; json; or cdr, as ROS 2 writes messages of
    /// --type.
    #[arg(long = "as", value_name = "FORM", default_value = "raw", requires_if("cdr", "type_"))]
    pub(crate) form: Form,
    /// The type of messages of ROS 2 that values become: dicts and objects of classes by their fields, other values as
    /// the only field.
    #[arg(long = "type", value_name = "PACKAGE/msg/NAME")]
    pub(crate) type_: Option<String>,
    /// The router of Zenoh. If it is on this machine and nothing listens there, this command is the router.
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/localhost:7447")]
    pub(crate) zenoh: String,
    /// The domain of ROS 2 for --topic. Without it: that of ROS_DOMAIN_ID, or 0.
    #[arg(long, value_name = "NUMBER", requires = "topic")]
    pub(crate) domain_id: Option<String>,
    #[command(flatten)]
    pub(crate) of: Of,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
}

/// As what values are sent.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Form {
    Raw,
    Json,
    Cdr,
}
