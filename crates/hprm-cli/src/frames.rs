//! The frame log, as options ask for it.
//!
//! Each process of a federation learns of the log from its environment, which processes inherit. So a command with these
//! options becomes itself once more, with the variables that they stand for.

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::path;
use std::process::Command;

use hprm::{FRAMES, FRAMES_TO};
use hprm_core::Program;

use crate::args::{self, LogFrames};
use crate::message::Error;

/// Makes sure that this process and those that it starts have the variables for which the options stand.
///
/// # Errors
///
/// If the command cannot be started again.
pub(crate) fn put_into_environment(chosen: &args::Command) -> Result<(), Error> {
    let frames = match chosen {
        args::Command::Run(run) => &run.frames,
        args::Command::Rti(rti) => &rti.frames,
        args::Command::Federate(federate) => &federate.frames,
        _ => return Ok(()),
    };
    let wanted = variables(frames)?;
    if wanted.iter().all(|(name, value)| std::env::var_os(name).as_ref() == Some(value)) {
        return Ok(());
    }
    let this = std::env::current_exe();
    let this = this.map_err(|error| Error::new(format!("cannot find this command: {error}")))?;
    let mut command = Command::new(this);
    let error = command.args(std::env::args_os().skip(1)).envs(wanted).exec();
    Err(Error::new(format!("cannot start this command again: {error}")))
}

/// Begins the log that the options ask for: its file is empty from now on.
///
/// # Errors
///
/// If the filter names nothing of the program, if that is known, or the file cannot be written.
pub(crate) fn begin(frames: &LogFrames, program: Option<&Program>) -> Result<(), Error> {
    if !frames.are_asked_for() {
        return Ok(());
    }
    let option = frames.log_frames.is_some().then_some("--log-frames");
    Ok(hprm::begin_frame_log(program, option)?)
}

/// The variables for which the options stand.
fn variables(frames: &LogFrames) -> Result<Vec<(&'static str, OsString)>, Error> {
    let mut wanted = Vec::new();
    if frames.are_asked_for() {
        let filter = frames.log_frames.clone().unwrap_or_else(|| "all".to_owned());
        wanted.push((FRAMES, filter.into()));
    }
    if let Some(path) = &frames.log_frames_to {
        let path = path::absolute(path).map_err(|error| {
            Error::new(format!("cannot write the frame log {}: {error}", path.display()))
        })?;
        wanted.push((FRAMES_TO, path.into()));
    }
    Ok(wanted)
}
