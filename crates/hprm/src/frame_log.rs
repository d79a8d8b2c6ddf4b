//! The frame log: a line for each frame that a federate or the RTI sends or receives, for debugging.
//!
//! Links and the RTI's loop tell it every frame; it decides nothing. The environment of the process says whether there
//! is one, which frames it has, and where it goes ([`FRAMES`], [`FRAMES_TO`]). Under this module: `filter.rs` is what the
//! variable may name, `line.rs` is what a line says.

mod filter;
mod line;

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;

use hprm_core::{FederateId, PhysicalTime, Program};
use hprm_federated::Frame;

use self::filter::Filter;
use self::line::{Line, Way};
use crate::{Clock, Failure, Label, Report, console, variables};

/// The environment variable that names the frames to log: `all`, or federates and kinds of frames.
pub const FRAMES: &str = "HPRM_LOG_FRAMES";

/// The environment variable that names the file to which they are appended, if that is not the standard error stream.
pub const FRAMES_TO: &str = "HPRM_LOG_FRAMES_TO";

/// One end of a link, as the log calls it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Party {
    Rti,
    Federate(FederateId),
    /// The other end of a link to the RTI has not told yet which federate it is.
    Unknown,
}

/// The frame log of one federate or of the RTI; mostly there is none.
#[derive(Debug, Default)]
pub(crate) struct FrameLog(Option<Box<Open>>);

#[derive(Debug)]
struct Open {
    program: Arc<Program>,
    me: Party,
    /// Whether federates are threads: then a message refers to a value of this process, and has no size.
    in_process: bool,
    filter: Filter,
    /// None if lines go to the standard error stream.
    file: Option<File>,
    /// Tag zero is at this time, which both ends of a link learn from a frame.
    start: Option<PhysicalTime>,
}

impl FrameLog {
    /// The log of `me`, if the environment asks for one.
    ///
    /// # Errors
    ///
    /// If a word of the variable names no federate of the program and no kind of frames, or if the file cannot be
    /// written.
    pub(crate) fn of_this_process(
        program: &Arc<Program>,
        me: Party,
        in_process: bool,
    ) -> Result<Self, Failure> {
        let Some(filter) = asked(program, None)? else { return Ok(Self::default()) };
        let path = variables::value_of(FRAMES_TO);
        let file = path.as_deref().map(|path| open(Path::new(path))).transpose()?;
        let program = Arc::clone(program);
        Ok(Self(Some(Box::new(Open { program, me, in_process, filter, file, start: None }))))
    }

    /// Whether there is a log. Without one, a caller need not find out which frames there are.
    #[inline]
    pub(crate) fn is_on(&self) -> bool {
        self.0.is_some()
    }

    /// A frame is sent.
    #[inline]
    pub(crate) fn sent(&mut self, to: Party, frame: &Frame) {
        if self.0.is_some() {
            self.write(Way::To(to), frame);
        }
    }

    /// A frame has been received.
    #[inline]
    pub(crate) fn received(&mut self, from: Party, frame: &Frame) {
        if self.0.is_some() {
            self.write(Way::From(from), frame);
        }
    }

    #[cold]
    fn write(&mut self, way: Way, frame: &Frame) {
        let Some(open) = &mut self.0 else { return };
        if let Frame::Start { at, .. } = frame {
            open.start = Some(*at);
        }
        if !open.filter.takes(&[open.me, way.party()], frame) {
            return;
        }
        let Open { program, me, in_process, file, start, .. } = &mut **open;
        let (me, in_process) = (*me, *in_process);
        let line = Line { at: Clock::now(), start: *start, me, way, frame, program, in_process };
        let text = format!("{line}\n");
        let Some(file) = file else {
            return console::print_error(text.as_bytes());
        };
        // In one piece, so that lines of several processes do not mix.
        if let Err(error) = file.write_all(text.as_bytes()) {
            console::show(Label::Warning, &unwritten(&error));
            self.0 = None;
        }
    }
}

/// Begins a frame log for which the environment asks: its file is empty from now on.
///
/// # Errors
///
/// If a word of the filter names no federate of the program, if that is known, and no kind of frames; or if the file
/// cannot be written. The message says that the filter is that of an `option`, if the variable comes from one.
pub fn begin_frame_log(program: Option<&Program>, option: Option<&str>) -> Result<(), Failure> {
    program.map_or(Ok(None), |program| asked(program, option))?;
    let Some(path) = variables::value_of(FRAMES_TO) else { return Ok(()) };
    let path = Path::new(&path);
    File::create(path).map(drop).map_err(|error| unopened(path, &error))
}

/// The frames that the environment asks for, if it does.
fn asked(program: &Program, option: Option<&str>) -> Result<Option<Filter>, Failure> {
    let Some(text) = variables::value_of(FRAMES) else { return Ok(None) };
    let filter = Filter::of(&text.to_string_lossy(), program).map_err(|word| {
        let why = format!("`{word}` is no federate of {} and no kind of frames", program.name);
        let hint = "name federates, rti, and kinds such as Message or TagAdvanceGrant, with commas between them; or all";
        let message = match option {
            Some(option) => format!("{option}={} is wrong: {why}", text.to_string_lossy()),
            None => variables::wrong(FRAMES, &text, &why),
        };
        Failure::Option { message, hint: Some(hint) }
    })?;
    Ok(Some(filter))
}

fn open(path: &Path) -> Result<File, Failure> {
    let opened = OpenOptions::new().create(true).append(true).open(path);
    opened.map_err(|error| unopened(path, &error))
}

fn unopened(path: &Path, error: &io::Error) -> Failure {
    let reason = console::reason(error);
    Failure::command(format!("cannot write the frame log {}: {reason}", path.display()))
}

fn unwritten(error: &io::Error) -> Report {
    let reason = console::reason(error);
    Failure::command(format!("the frame log ends here, because it cannot be written: {reason}"))
        .report()
}
