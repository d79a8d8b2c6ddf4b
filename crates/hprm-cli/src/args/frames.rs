//! What can be typed about the frame log.

use std::path::PathBuf;

use clap::Args;
use clap::builder::NonEmptyStringValueParser;

/// Whether frames are logged.
#[derive(Args, Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct LogFrames {
    /// Write a line for each frame that federates and the RTI send and receive. FILTER names federates, rti and
    /// kinds of frames such as Message or TagAdvanceGrant, with commas between them; without it, all are written.
    #[arg(long, value_name = "FILTER", num_args = 0..=1, require_equals = true, default_missing_value = "all",
        value_parser = NonEmptyStringValueParser::new())]
    pub(crate) log_frames: Option<String>,
    /// The file for these lines, instead of the standard error. What was in it is gone.
    #[arg(long, value_name = "FILE")]
    pub(crate) log_frames_to: Option<PathBuf>,
}

impl LogFrames {
    /// Whether the user has asked for them here.
    pub(crate) fn are_asked_for(&self) -> bool {
        self.log_frames.is_some() || self.log_frames_to.is_some()
    }
}
