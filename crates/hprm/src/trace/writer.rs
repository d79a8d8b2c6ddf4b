//! Writing the trace of a running program, or of one federate's share of it.
//!
//! The entries of one tag wait until it is over, because workers may finish in another order than
//! the one in which entries stand in the file.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use hprm_core::{
    ActionId, InputId, InputValue, Program, ReactionId, ReactionRecord, ScheduleRequest, Scheduler,
    Tag,
};

use super::line::{End, Enter, Entry, Header, Line, Read, RunEnding, Schedule, Set, at};
use super::{Described, Draft};
use crate::{Failure, Host};

/// The file of a trace that is being written.
#[derive(Debug)]
struct Output {
    /// None once the trace has ended.
    draft: Option<Draft>,
    /// The last tag whose entries have been written.
    through: Tag,
    /// How many inputs came too late until then.
    tardy: u64,
}

/// The traces that this process is writing.
static OPEN: Mutex<Vec<Weak<Mutex<Output>>>> = Mutex::new(Vec::new());

/// What a federate writes of the trace of its federation.
#[derive(Clone, Debug)]
pub struct TraceShare {
    /// The file that it writes.
    pub file: PathBuf,
    /// The trace that will be made of all shares, as the user calls it; messages name it.
    pub trace: PathBuf,
}

impl TraceShare {
    /// A share of `trace`; without that, the user knows it by the name of its own `file`.
    #[must_use]
    pub fn new(file: PathBuf, trace: Option<PathBuf>) -> Self {
        Self { trace: trace.unwrap_or_else(|| file.clone()), file }
    }
}

/// The trace of a run.
#[derive(Debug)]
pub struct Trace {
    program: Arc<Program>,
    /// What the user calls it.
    name: PathBuf,
    output: Arc<Mutex<Output>>,
    /// The tag whose entries wait.
    tag: Tag,
    waiting: Vec<((u32, ReactionId), Entry)>,
    /// What reactions have found that have begun and not finished.
    begun: Vec<(ReactionId, Vec<Read>)>,
    tardy: u64,
}

impl Trace {
    /// Starts a trace that will be called `path`.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub fn create(path: &Path, program: &Arc<Program>) -> Result<Self, Failure> {
        Self::create_share(&TraceShare::new(path.to_owned(), None), program)
    }

    /// Starts what a federate writes of a trace.
    ///
    /// # Errors
    ///
    /// If the file cannot be written. The failure names the trace, as the user knows no other file.
    pub fn create_share(share: &TraceShare, program: &Arc<Program>) -> Result<Self, Failure> {
        let unwritten = |error| Failure::trace(&share.trace, &error);
        let mut draft = Draft::create(&share.file).map_err(unwritten)?;
        draft.write(&Line::Header(Header::of(program))).map_err(unwritten)?;
        let program = Arc::clone(program);
        let output = Output { draft: Some(draft), through: Tag::START, tardy: 0 };
        let output = Arc::new(Mutex::new(output));
        let mut open = locked(&OPEN);
        open.retain(|output| output.strong_count() > 0);
        open.push(Arc::downgrade(&output));
        drop(open);
        Ok(Self {
            program,
            name: share.trace.clone(),
            output,
            tag: Tag::NEVER,
            waiting: Vec::new(),
            begun: Vec::new(),
            tardy: 0,
        })
    }

    /// Notes what a reaction has found at its inputs: see [`reads`].
    pub fn begin(&mut self, reaction: ReactionId, reads: Vec<Read>) {
        self.begun.push((reaction, reads));
    }

    /// Adds what a reaction did.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub fn add<H: Host>(
        &mut self,
        host: &mut H,
        record: ReactionRecord<H::Value>,
    ) -> Result<(), Failure> {
        let spec = &self.program.reactions[record.reaction];
        // The front end has added those with number zero; they are no reactions of the program.
        if spec.number == 0 {
            return Ok(());
        }
        let place = (spec.level, record.reaction);
        if record.tag != self.tag {
            self.flush()?;
            self.tag = record.tag;
        }
        self.tardy += u64::from(record.tardy.is_some());
        let entry = self.entry(host, record);
        self.waiting.push((place, entry));
        Ok(())
    }

    /// Ends the trace with what became of the run, and gives the file its name. A trace that could not be
    /// written so far leaves no file.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub fn end<V: Clone>(
        mut self,
        scheduler: &Scheduler<V>,
        outcome: &Result<(), Failure>,
    ) -> Result<(), Failure> {
        let (ending, message) = match outcome {
            Ok(()) => (RunEnding::Done, None),
            Err(Failure::LeftFederation) => (RunEnding::Left, None),
            Err(Failure::Interrupted { .. }) => (RunEnding::Interrupted, None),
            // Some of it is missing, in the middle.
            Err(Failure::Trace { .. }) => return Ok(()),
            Err(failure) => (RunEnding::Failed, Some(failure.to_string())),
        };
        let end = End {
            end: at(scheduler.tag().max(Tag::START)),
            outcome: ending,
            message: message.and_then(|message| message.lines().next().map(str::to_owned)),
            physical: scheduler.stops_physically(),
            tardy: self.tardy,
            early: scheduler.leaves_early(),
            missing: BTreeMap::new(),
        };
        self.flush()?;
        locked(&self.output).end(end).map_err(|error| Failure::trace(&self.name, &error))
    }

    /// Writes the entries of a tag that is over, and hands them to the system.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub(crate) fn flush(&mut self) -> Result<(), Failure> {
        self.waiting.sort_unstable_by_key(|(place, _)| *place);
        let mut output = locked(&self.output);
        for (_, entry) in self.waiting.drain(..) {
            let written = output.write(&Line::Entry(entry));
            written.map_err(|error| Failure::trace(&self.name, &error))?;
            output.through = self.tag;
        }
        output.tardy = self.tardy;
        output.flush().map_err(|error| Failure::trace(&self.name, &error))
    }

    fn entry<H: Host>(&mut self, host: &mut H, record: ReactionRecord<H::Value>) -> Entry {
        let at_start = self.begun.iter().position(|(reaction, _)| *reaction == record.reaction);
        let reads = at_start.map(|place| self.begun.swap_remove(place).1).unwrap_or_default();
        let program = &self.program;
        let set =
            |(port, value)| Set { port: program.port_name(port), value: host.describe(&value) };
        let sets = record.ports.into_iter().map(set).collect();
        let schedule = |ScheduleRequest { action, value, outcome }| Schedule {
            action: action_name(program, action),
            at: outcome.into(),
            physical: program.actions[action].origin == hprm_core::Origin::Physical,
            value: value.map(|value: H::Value| host.describe(&value)),
        };
        let schedules = record.actions.into_iter().map(schedule).collect();
        let enter = |(mode, transition): (hprm_core::ModeId, hprm_core::Transition)| {
            let mode = &program.modes[mode];
            let reactor = &program.reactors[mode.reactor].name;
            Enter { mode: format!("{reactor}.{}", mode.name), how: transition.into() }
        };
        Entry {
            tag: at(record.tag),
            reaction: program.reaction_name(record.reaction),
            body: record.body.into(),
            reads,
            sets,
            schedules,
            enters: record.modes.into_iter().map(enter).collect(),
            stops: record.stops,
            leaves: record.leaves,
            tardy: record.tardy.map(at),
            physical: record.physical,
        }
    }
}

impl Output {
    fn write(&mut self, line: &Line) -> io::Result<()> {
        self.draft.as_mut().map_or(Ok(()), |draft| draft.write(line))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.draft.as_mut().map_or(Ok(()), Draft::flush)
    }

    fn end(&mut self, end: End) -> io::Result<()> {
        self.write(&Line::End(end))?;
        self.draft.take().map_or(Ok(()), Draft::publish)
    }
}

/// Ends all traces of this process behind the last tag that they have, because the process is about to be
/// ended by force while reactions run. What cannot be written is left out.
pub fn cut_traces() {
    for output in locked(&OPEN).iter().filter_map(Weak::upgrade) {
        // One that is being written to this moment may wait for its reader.
        let Ok(mut output) = output.try_lock() else { continue };
        let end = End {
            end: at(output.through),
            outcome: RunEnding::Interrupted,
            message: None,
            physical: true,
            tardy: output.tardy,
            early: false,
            missing: BTreeMap::new(),
        };
        let _ = output.end(end);
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What a reaction finds at its inputs. To be called when its body begins, not before: code that has a
/// value may change it at any time, and what counts is what this reaction reads.
pub fn reads<V: Clone>(
    scheduler: &Scheduler<V>,
    reaction: ReactionId,
    mut describe: impl FnMut(&V) -> Described,
) -> Vec<Read> {
    let program = scheduler.program();
    let read = |InputValue { input, value, remembered }: InputValue<'_, V>| Read {
        from: match input {
            InputId::Port(port) => program.port_name(port),
            InputId::Action(action) => action_name(program, action),
        },
        value: value.map(&mut describe),
        remembered,
    };
    scheduler.inputs(reaction).into_iter().map(read).collect()
}

fn action_name(program: &Program, action: ActionId) -> String {
    let spec = &program.actions[action];
    format!("{}.{}", program.reactors[spec.reactor].name, spec.name)
}
