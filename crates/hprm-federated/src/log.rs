//! What the machines write to the log, for debugging: their inputs and outputs, as they happen.
//!
//! Coordination is at the level `debug`: joining, grants, next event tags, stopping. What moves data,
//! and what a driver repeats in each round, is at `trace`. A log has no values: a message shows its
//! channel, tag and size. Without a subscriber an event costs one comparison. The driver decides where
//! lines go.

use std::collections::BTreeMap;
use std::fmt;

use hprm_core::FederateId;
use tracing::level_filters::LevelFilter;

use crate::{Frame, Input, LinkId, Output, RtiInput, RtiOutput};

/// What filters call the events of a federate's machine, and of the RTI's.
const FEDERATE: &str = "hprm_federated::federate";
const RTI: &str = "hprm_federated::rti";

/// Whether a line may be written. If not, a machine does not look at what it would show.
#[inline]
pub(crate) fn is_on() -> bool {
    LevelFilter::current() >= LevelFilter::DEBUG
}

/// Writes a line, at the level `debug` or `trace`.
macro_rules! write_line {
    ($target:expr, $is_data:expr, $($line:tt)+) => {
        if $is_data {
            tracing::trace!(target: $target, $($line)+);
        } else {
            tracing::debug!(target: $target, $($line)+);
        }
    };
}

/// An input of a federate's machine.
pub(crate) fn federate_input(input: &Input) {
    match input {
        Input::FromRti(frame) => {
            write_line!(FEDERATE, is_data(frame), "from the RTI: {}", Shown(frame));
        }
        Input::FromPeer { from, frame } => {
            write_line!(FEDERATE, is_data(frame), "from {from:?}: {}", Shown(frame));
        }
        Input::Send { channel, tag, payload } => {
            tracing::trace!(target: FEDERATE, "sends on {channel:?} for {tag}, {} bytes", payload.byte_count());
        }
        // Each round of a driver has them.
        Input::Wake => {}
        Input::NextEvent(_) | Input::Begun(_) | Input::Reached(_) | Input::Completed(_) => {
            tracing::trace!(target: FEDERATE, "{input:?}");
        }
        Input::Release { .. } => tracing::trace!(target: FEDERATE, "{input:?}"),
        _ => tracing::debug!(target: FEDERATE, "{input:?}"),
    }
}

/// An output of a federate's machine.
pub(crate) fn federate_output(output: &Output) {
    match output {
        Output::ToRti(frame) => {
            write_line!(FEDERATE, is_data(frame), "to the RTI: {}", Shown(frame));
        }
        Output::ToPeer { to, frame } => {
            write_line!(FEDERATE, is_data(frame), "to {to:?}: {}", Shown(frame));
        }
        Output::Deliver { channel, tag, payload } => {
            tracing::trace!(target: FEDERATE, "delivers from {channel:?} at {tag}, {} bytes", payload.byte_count());
        }
        Output::DeliverPhysical { channel, payload, .. } => {
            tracing::trace!(target: FEDERATE, "delivers from {channel:?} at its arrival, {} bytes", payload.byte_count());
        }
        Output::Discard { payload } => {
            tracing::debug!(target: FEDERATE, "discards {} bytes", payload.byte_count());
        }
        Output::Released { .. } => tracing::trace!(target: FEDERATE, "{output:?}"),
        _ => tracing::debug!(target: FEDERATE, "{output:?}"),
    }
}

/// An input of the RTI's machine, on one of these links.
pub(crate) fn rti_input(links: &Links, input: &RtiInput) {
    match input {
        RtiInput::Frame { link, frame } => {
            let from = OtherEnd { links, link: *link };
            write_line!(RTI, is_data(frame), "from {from}: {}", Shown(frame));
        }
        RtiInput::Wake | RtiInput::ChunksMoved { .. } => {}
        RtiInput::Closed { link } => {
            tracing::debug!(target: RTI, "{} is closed", OtherEnd { links, link: *link });
        }
        RtiInput::Broken { link, message } => {
            tracing::debug!(target: RTI, "{} is broken: {message}", OtherEnd { links, link: *link });
        }
        RtiInput::RequestStop => tracing::debug!(target: RTI, "{input:?}"),
    }
}

/// An output of the RTI's machine, on one of these links.
pub(crate) fn rti_output(links: &Links, output: &RtiOutput) {
    match output {
        RtiOutput::Send { link, frame } => {
            let to = OtherEnd { links, link: *link };
            write_line!(RTI, is_data(frame), "to {to}: {}", Shown(frame));
        }
        _ => tracing::debug!(target: RTI, "{output:?}"),
    }
}

/// The links of the RTI, with the federates at their other ends, once these have sent their ids.
type Links = BTreeMap<LinkId, FederateId>;

/// The other end of a link. It is looked up only if a line is written.
struct OtherEnd<'a> {
    links: &'a Links,
    link: LinkId,
}

impl fmt::Display for OtherEnd<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.links.get(&self.link) {
            Some(federate) => write!(f, "{federate:?}"),
            None => write!(f, "{:?}", self.link),
        }
    }
}

/// Whether a frame moves data, and coordinates nothing.
fn is_data(frame: &Frame) -> bool {
    matches!(
        frame,
        Frame::Message { .. }
            | Frame::Release { .. }
            | Frame::Processed { .. }
            | Frame::ClockRequest { .. }
            | Frame::ClockReply { .. }
    )
}

/// A frame as a line shows it.
struct Shown<'a>(&'a Frame);

impl fmt::Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Frame::Message { channel, tag, payload } => {
                write!(f, "Message on {channel:?} for {tag}, {} bytes", payload.byte_count())
            }
            Frame::ProgramReply { name, facts } => {
                write!(f, "ProgramReply of {name} with {} facts", facts.len())
            }
            frame => write!(f, "{frame:?}"),
        }
    }
}
