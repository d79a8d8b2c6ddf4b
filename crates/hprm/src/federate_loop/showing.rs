//! What the loop shows of itself on its board. Nothing here decides anything.

use hprm_core::{ChannelId, Payload, PhysicalTime, Tag};

use super::{FederateLoop, Phase};
use crate::board::{
    BoardWriter, ChannelCount, FederateState, Identity, Moment, Names, Role, Stage, StoreState,
};
use crate::link::name_of;
use crate::workers;
use crate::{FederateOptions, Host};

/// The board of a federate that is about to look for the RTI.
pub(super) fn board(options: &FederateOptions) -> BoardWriter {
    let FederateOptions { program, federate, federation, .. } = options;
    let role = Role::Federate(program.federates[*federate].name.clone());
    let identity = Identity::new(program, name_of(*federation), role);
    let names = Names::of_federate(program, *federate, |_| None);
    let size = FederateState::size(names.channels.len(), program.federates.len());
    let mut board = BoardWriter::new(&identity, &names, workers::count(program), size);
    board.show(&FederateState::before(Stage::Connecting));
    board
}

/// Shows where the reactions of a federate are, now that it is loaded.
pub(super) fn name_places(board: &BoardWriter, options: &FederateOptions, host: &impl Host) {
    if board.is_on() {
        let FederateOptions { program, federate, .. } = options;
        board.rename(&Names::of_federate(program, *federate, |it| host.source_location(it)));
    }
}

/// What the loop counts for its board.
pub(super) struct Counts {
    /// By channel; empty, if there is no board.
    channels: Vec<ChannelCount>,
    /// Whether messages are references to values of this process, which have no size.
    in_process: bool,
    tags: u64,
    tardy: u64,
}

impl Counts {
    /// Counts what goes over so many channels, in one process or between several.
    pub(super) fn new(board: &BoardWriter, channels: usize, in_process: bool) -> Self {
        let shown = if board.is_on() { channels } else { 0 };
        let count = |channel: usize| ChannelCount {
            channel: u32::try_from(channel).unwrap_or(u32::MAX),
            messages: 0,
            bytes: 0,
            last: None,
        };
        Self { channels: (0..shown).map(count).collect(), in_process, tags: 0, tardy: 0 }
    }

    /// A message leaves or has come.
    #[inline]
    pub(super) fn message(&mut self, channel: ChannelId, tag: Tag, payload: &Payload) {
        if let Some(count) = self.channels.get_mut(channel.index()) {
            count.messages += 1;
            count.bytes += if self.in_process { 0 } else { payload.byte_count() };
            count.last = Some(tag);
        }
    }

    /// Notes at which tag a message was delivered, if at any; it was meant for `tag`, and the loop is at `current`.
    #[inline]
    pub(super) fn delivered(&mut self, taken: Option<Tag>, tag: Tag, current: Tag) {
        let late = taken.map_or(tag <= current, |taken| taken != tag);
        self.tardy += u64::from(late);
    }
}

impl<H: Host> FederateLoop<'_, H>
where
    H::Value: Send + Sync,
{
    /// A tag begins.
    #[inline]
    pub(super) fn note_tag(&mut self, tag: Tag) {
        self.counts.tags += 1;
        self.board.begins(tag, self.now);
    }

    /// Shows that the program has a start time: the first reaction may run for ever.
    pub(super) fn show_start(&mut self) {
        if self.board.is_on() {
            self.show_state(false);
        }
    }

    /// Shows the state of a loop that does not wait, if it is time to.
    #[inline]
    pub(super) fn show_busy(&mut self) {
        if self.board.is_due(self.now) {
            self.show_state(false);
        }
    }

    /// Shows the state of a loop that is about to wait. If it was shown a short time ago, the loop wakes up
    /// once to show it: returns until when it may wait.
    pub(super) fn show_waiting(&mut self, until: Option<PhysicalTime>) -> Option<PhysicalTime> {
        let Some(due) = self.board.due() else { return until };
        if self.now < due {
            return Some(until.map_or(due, |until| until.min(due)));
        }
        self.show_state(true);
        until
    }

    /// Shows that the loop has ended.
    pub(super) fn show_end(&mut self) {
        if self.board.is_on() {
            let state = FederateState { stage: Stage::Ending, ..self.state(false) };
            self.board.show(&state);
        }
    }

    #[cold]
    fn show_state(&mut self, waits: bool) {
        let state = self.state(waits);
        self.board.show(&state);
    }

    fn state(&self, waits: bool) -> FederateState {
        let machine = &self.federation.machine;
        let within = self.phase == Phase::Processing;
        let blockers = match (waits, within) {
            (false, _) => Vec::new(),
            (true, true) => machine.level_blockers(self.scheduler.next_level(), self.now),
            (true, false) => machine.blockers(self.scheduler.next_tag(), self.now),
        };
        let (stage, start) = match self.phase {
            Phase::Joining => (Stage::Joining, None),
            Phase::Running | Phase::Processing => {
                (Stage::Running, Some(self.scheduler.start_time()))
            }
            Phase::Done => (Stage::Ending, Some(self.scheduler.start_time())),
        };
        let begun = (self.counts.tags > 0).then(|| self.scheduler.tag());
        let dropped = self.scheduler.dropped_messages().map(|(_, dropped)| dropped).sum();
        let me = machine.me();
        let channels = &self.scheduler.program().channels;
        let own = self.counts.channels.iter().zip(channels.values());
        let own = own.filter(|(_, channel)| channel.from == me || channel.to == me);
        FederateState {
            moment: Moment::now(),
            notes: self.board.notes(),
            stage,
            start,
            current: begun,
            complete: !within,
            next: if stage == Stage::Running { self.scheduler.next_tag() } else { Tag::START },
            waits,
            blockers,
            tags: self.counts.tags,
            channels: own.map(|(count, _)| *count).collect(),
            store: self.store_state(),
            tardy: self.counts.tardy,
            dropped,
        }
    }

    fn store_state(&self) -> StoreState {
        let mut store = self.federation.objects.store();
        let stats = store.stats();
        StoreState {
            in_use: stats.bytes_in_use,
            mapped: stats.bytes_mapped,
            limit: store.capacity(),
            held: store.held().into_iter().map(|(reader, bytes)| (reader.0, bytes)).collect(),
            fallbacks: stats.inline_fallbacks,
        }
    }
}
