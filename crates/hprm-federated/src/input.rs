//! What goes into a federate's machine and what comes out.
//!
//! The vocabulary between [`Federate`](crate::Federate) and its driver.

use hprm_core::{ChannelId, FederateId, Nanos, Payload, PhysicalTime, Tag};

use crate::{Frame, Posting, Refusal};

/// What has happened.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub enum Input {
    /// A frame from the RTI.
    FromRti(Frame),
    /// The link to the RTI has ended.
    RtiLost,
    /// There is another link to the RTI, after [`Output::Rejoin`].
    Rejoins,
    /// A frame on a direct link, after its handshake.
    FromPeer {
        /// The other end.
        from: FederateId,
        /// The frame.
        frame: Frame,
    },
    /// A direct link has ended.
    PeerLost(FederateId),
    /// A direct link cannot be opened.
    Unreachable {
        /// The federate that should be at its other end.
        peer: FederateId,
        /// Why, for people.
        reason: String,
    },
    /// A direct link is established, by either side.
    PeerUp(FederateId),
    /// The program is ready to run.
    Loaded,
    /// The scheduler's next event, after whatever may have changed it and never while a tag is being
    /// processed; `FOREVER` if nothing is left to do but to end.
    NextEvent(Tag),
    /// The scheduler processes this tag now.
    Begun(Tag),
    /// A federate that goes through tags level by level has passed all levels of the current tag
    /// before this one, and sent what cannot change any more; with none, nothing is left to do
    /// unless a message arrives.
    Reached(Option<u32>),
    /// It has completed this tag, and everything sent at it has been handed over.
    Completed(Tag),
    /// From now on the federate waits that long for its inputs. A centralized one ignores this.
    Maxwait(Nanos),
    /// The scheduler sends a value.
    Send {
        /// The connection that it takes.
        channel: ChannelId,
        /// Its tag at the receiver.
        tag: Tag,
        /// The value.
        payload: Payload,
    },
    /// Objects of another federate's store that are no longer used here.
    Release {
        /// The federate that owns the objects.
        owner: FederateId,
        /// The owner's numbers for them.
        serials: Vec<u64>,
    },
    /// A segment of the own store for a reader to map.
    Segment {
        /// The federate that is to map it.
        reader: FederateId,
        /// Its number.
        segment: u32,
        /// Its length in bytes.
        len: u64,
    },
    /// Segments of the own store that a reader may unmap.
    Retired {
        /// The federate that has mapped them.
        reader: FederateId,
        /// Their numbers.
        segments: Vec<u32>,
    },
    /// A reaction, or the user, asks the federation to stop.
    RequestStop,
    /// A reaction of the tag that has just been completed asks that this federate alone stops; the
    /// others go on.
    Depart,
    /// The same from elsewhere, such as another thread.
    RequestDeparture,
    /// The last tag is complete.
    Finished,
    /// The federate leaves before the last tag, and all is well.
    Leave,
    /// The federate cannot go on.
    Failed {
        /// Why, for people.
        message: String,
        /// The exit code of its process.
        code: i32,
    },
    /// What another federate shows on its board.
    Board {
        /// That federate.
        from: FederateId,
        /// What it shows.
        posting: Posting,
    },
    /// Time has passed: [`Federate::next_wakeup`](crate::Federate::next_wakeup) has come.
    Wake,
}

/// What is to be done.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub enum Output {
    /// Send a frame to the RTI. The descriptor of a segment goes with its frame.
    ToRti(Frame),
    /// Send a frame on a direct link. The descriptor of a segment goes with its frame.
    ToPeer {
        /// The other end.
        to: FederateId,
        /// The frame.
        frame: Frame,
    },
    /// Open a direct link.
    Connect {
        /// The federate at its other end.
        peer: FederateId,
        /// Where it listens.
        listen: String,
    },
    /// Tag zero is at this time.
    Start {
        /// The physical time of tag zero.
        at: PhysicalTime,
        /// The tag at which this federate starts: zero, unless it joins late.
        first: Tag,
    },
    /// A message for the time before this federate has joined: the driver releases what it holds.
    Discard {
        /// The value.
        payload: Payload,
    },
    /// A message for the scheduler.
    Deliver {
        /// The connection that it took.
        channel: ChannelId,
        /// Its tag.
        tag: Tag,
        /// The value.
        payload: Payload,
    },
    /// A message for the scheduler to tag with the time of its arrival.
    DeliverPhysical {
        /// The connection that it took.
        channel: ChannelId,
        /// Of no meaning.
        tag: Tag,
        /// The value.
        payload: Payload,
    },
    /// Read the board of another federate from now on, or wake it up with that `notifier`; the descriptor came with the
    /// frame.
    Board {
        /// The federate that shows itself there.
        owner: FederateId,
        /// Whether the descriptor wakes it up.
        notifier: bool,
    },
    /// Show this on the board of this federate. Then wake up those of [`Federate::released`](crate::Federate::released),
    /// as far as they sleep.
    Post(Posting),
    /// Close the direct links to a federate. What still comes on them means nothing.
    Disconnect(FederateId),
    /// Messages that are read at this level of the current tag, or at an earlier one, are tardy from now on: others
    /// have been told that nothing comes of them.
    Passed(u32),
    /// The federation ends at this tag.
    SetStop(Tag),
    /// This federate ends at this tag, or at the next one if that has passed, and the federation may
    /// go on.
    LeaveAt(Tag),
    /// A segment to map; its descriptor came with the frame.
    Segment {
        /// The federate that owns the segment.
        owner: FederateId,
        /// The owner's number for it.
        segment: u32,
        /// Its length in bytes.
        len: u64,
    },
    /// Segments of another federate's store to unmap.
    Retired {
        /// The federate that owns the segments.
        owner: FederateId,
        /// The owner's numbers for them.
        segments: Vec<u32>,
    },
    /// A reader no longer uses objects of the own store.
    Released {
        /// The federate that used them.
        reader: FederateId,
        /// Their numbers.
        serials: Vec<u64>,
    },
    /// A federate has ended: drop its holds on the own store.
    ReaderGone(FederateId),
    /// A federate has ended and everything that it sent has arrived: nothing new will refer to its
    /// store.
    OwnerGone(FederateId),
    /// The link to the RTI has ended, or is of no use, before the federation has met: open another one,
    /// and tell by [`Input::Rejoins`].
    Rejoin,
    /// The federate must end now; there is no output after this.
    Ended {
        /// Why.
        reason: End,
    },
}

impl Output {
    /// Whether it may change which event of the scheduler is the next one.
    #[must_use]
    #[inline]
    pub fn is_for_scheduler(&self) -> bool {
        matches!(
            self,
            Self::Start { .. }
                | Self::Deliver { .. }
                | Self::DeliverPhysical { .. }
                | Self::Passed(_)
                | Self::SetStop(_)
                | Self::LeaveAt(_)
        )
    }
}

/// Why a federate must end before its last tag.
#[derive(Clone, PartialEq, Eq, Hash, Debug, thiserror::Error)]
pub enum End {
    /// It may not join.
    #[error("the federation refused this federate: {0}")]
    Refused(Refusal),
    /// Another federate could not go on.
    #[error("federate {federate:?} failed: {message}")]
    Failed {
        /// That federate.
        federate: FederateId,
        /// Why, for people.
        message: String,
        /// The exit code of its process.
        code: i32,
    },
    /// The link to the RTI has ended.
    #[error("the link to the RTI is lost")]
    RtiLost,
}

/// Whether a tag may begin, as far as other federates are concerned.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Permission {
    /// It may.
    Granted,
    /// It may at that time, if nothing arrives before.
    WaitUntil(PhysicalTime),
    /// Not before something arrives.
    Wait,
}
