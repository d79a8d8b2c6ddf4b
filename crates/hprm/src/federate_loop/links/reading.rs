//! Reading the links with peers: which frames have come, and which links have ended. What that means for a federate, the
//! machine decides.

use std::io;
use std::os::fd::OwnedFd;

use hprm_core::FederateId;
use hprm_federated::codec::CodecError;
use hprm_federated::{Frame, Input};

use super::{Descriptors, FederateLinks, LinkSerial, PolledLinks, failure, keep_descriptor};
use crate::frame_log::{FrameLog, Party};
use crate::poller::{Arrivals, Broken, PolledLink};
use crate::{Clock, Failure};

impl FederateLinks {
    /// Reads the links with peers. A peer whose link is broken counts as lost, unless the link is opened
    /// again.
    pub(super) fn read_peers(
        &mut self,
        inputs: &mut Vec<(LinkSerial, Input)>,
    ) -> Result<(), Failure> {
        let Self {
            polled: PolledLinks { outgoing, incoming, .. },
            descriptors,
            serials,
            openings,
            log,
            ..
        } = self;
        let mut arriving = Arriving { descriptors, log, inputs };
        // A peer has two links with this federate if both opened one. When the outgoing link ends, messages of
        // the peer may still come over the incoming link, so the peer is lost only when that has ended too.
        let mut ended = Vec::new();
        for (&peer, polled) in outgoing.iter_mut().filter(|(_, it)| it.may_be_read()) {
            let serial = serials.outgoing(peer);
            let begun = arriving.inputs.len();
            let end = arriving.read_peer(polled, (peer, serial))?;
            let is_up = |(_, input): &(LinkSerial, Input)| matches!(input, Input::PeerUp(_));
            if openings.contains(peer) && arriving.inputs[begun..].iter().any(is_up) {
                openings.end(peer);
            }
            let Some(error) = end else { continue };
            ended.push(peer);
            if openings.contains(peer) {
                if let Some(reason) = openings.failed(peer, &error, Clock::local()) {
                    arriving.inputs.push((serial, Input::Unreachable { peer, reason }));
                }
            } else if !incoming.contains_key(&peer) {
                arriving.inputs.push((serial, Input::PeerLost(peer)));
            }
        }
        ended.drain(..).for_each(|peer| _ = outgoing.remove(&peer));
        for (&peer, polled) in incoming.iter_mut().filter(|(_, it)| it.may_be_read()) {
            let serial = serials.incoming(peer);
            if arriving.read_peer(polled, (peer, serial))?.is_some() {
                ended.push(peer);
                arriving.inputs.push((serial, Input::PeerLost(peer)));
            }
        }
        ended.drain(..).for_each(|peer| _ = incoming.remove(&peer));
        Ok(())
    }
}

/// Where what comes over the links with peers goes.
struct Arriving<'a> {
    descriptors: &'a mut Descriptors,
    log: &'a mut FrameLog,
    inputs: &'a mut Vec<(LinkSerial, Input)>,
}

impl Arriving<'_> {
    /// Reads a link with a peer, if it is ready. Returns the error with which the link has ended, if it has
    /// ended. The function fails only if this process lacks memory or descriptors, because then the link itself is
    /// intact.
    fn read_peer(
        &mut self,
        polled: &mut PolledLink,
        (from, serial): (FederateId, LinkSerial),
    ) -> Result<Option<io::Error>, Failure> {
        match polled.read(FromPeer { from, serial, arriving: self }) {
            Ok(true) => Ok(None),
            Ok(false) => Ok(Some(io::ErrorKind::ConnectionReset.into())),
            Err(broken @ (Broken::Shortage(_) | Broken::Frame(CodecError::NoMemory(_)))) => {
                Err(failure(broken))
            }
            Err(Broken::Link(error)) => Ok(Some(error)),
            Err(Broken::Frame(error)) => {
                Ok(Some(io::Error::new(io::ErrorKind::InvalidData, error)))
            }
        }
    }
}

/// Takes the frames of a link with a peer.
struct FromPeer<'a, 'b> {
    from: FederateId,
    serial: LinkSerial,
    arriving: &'b mut Arriving<'a>,
}

impl Arrivals for FromPeer<'_, '_> {
    #[inline(never)]
    fn frame(&mut self, frame: Frame, descriptor: Option<OwnedFd>) {
        let Arriving { descriptors, log, inputs } = &mut self.arriving;
        log.received(Party::Federate(self.from), &frame);
        if let Frame::PeerWelcome { .. } = frame {
            inputs.push((self.serial, Input::PeerUp(self.from)));
            return;
        }
        keep_descriptor(descriptors, &frame, descriptor);
        inputs.push((self.serial, Input::FromPeer { from: self.from, frame }));
    }

    // Nothing looks at a message before it is where it goes: then the compiler makes it there.
    #[inline(always)]
    fn message(&mut self, message: Frame) {
        let Arriving { log, inputs, .. } = &mut self.arriving;
        inputs.push((self.serial, Input::FromPeer { from: self.from, frame: message }));
        if let Some((_, Input::FromPeer { frame, .. })) = inputs.last() {
            log.received(Party::Federate(self.from), frame);
        }
    }
}
