//! What the RTI records for the trace: frames and messages that pass it, by federate.

use std::collections::BTreeMap;

use hprm_core::{FederateId, PhysicalTime, Program};
use hprm_federated::{Frame, LinkId};

use crate::recorder::{Flags, Kind, LoopRecording, Member, Recorder, Size, TraceRequest};
use crate::{Failure, Label, console};

/// The recording of the RTI, if the run is traced.
#[derive(Default, Debug)]
pub(super) struct RtiRecording {
    recording: LoopRecording,
    recorder: Recorder,
    federates: BTreeMap<LinkId, FederateId>,
}

impl RtiRecording {
    pub(super) fn start(
        request: Option<&TraceRequest>,
        program: &Program,
    ) -> Result<Self, Failure> {
        let recording = LoopRecording::start(request, program, Member::Rti)?;
        let recorder = recording.recorder();
        Ok(Self { recording, recorder, federates: BTreeMap::new() })
    }

    /// From now on, the link is that of the federate.
    pub(super) fn joined(&mut self, federate: FederateId, link: LinkId) {
        self.federates.insert(link, federate);
    }

    pub(super) fn started(&self, at: PhysicalTime) {
        self.recorder.started(at);
    }

    #[inline]
    pub(super) fn received(&self, link: LinkId, frame: &Frame) {
        if self.recorder.is_on()
            && let Some(federate) = self.federates.get(&link)
        {
            self.recorder.frame(Kind::FrameReceived, *federate, frame);
        }
    }

    #[inline]
    pub(super) fn sent(&self, link: LinkId, frame: &Frame) {
        if !self.recorder.is_on() {
            return;
        }
        if let Frame::Message { channel, tag, payload } = frame {
            let size = Size::of(payload, Flags::NONE);
            self.recorder.forwarded((*channel, *tag), size);
        } else if let Some(federate) = self.federates.get(&link) {
            self.recorder.frame(Kind::FrameSent, *federate, frame);
        }
    }

    /// Ends the recording, and makes the trace if this process makes it alone.
    pub(super) fn finish(&self) -> Result<(), Failure> {
        if let Some(report) = self.recording.finish()? {
            console::show(Label::Warning, &report);
        }
        Ok(())
    }
}
