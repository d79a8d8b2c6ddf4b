//! Physical actions from other threads, with a bound on how many of their events may wait.
//!
//! An event waits from the call that schedules it until its tag has been processed, or it is dropped for another
//! reason. It carries its place, which is free again when the event is dropped; so nothing else has to count.

use std::cell::Cell;
use std::io;
use std::marker::PhantomData;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use hprm_core::ActionId;

use super::value::{Message, Value};
use crate::{EventLimit, Failure, Inbox, nanoseconds};

/// How many events of a physical action may wait, if nothing else is stated.
const DEFAULT_EVENTS: usize = 100_000;

thread_local! {
    /// Whether the thread runs reactions: then it must not wait for reactions.
    static RUNS_REACTIONS: Cell<bool> = const { Cell::new(false) };
}

/// What [`Sender::schedule`] does when as many events wait as may. [`Sender`] has an example.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum WhenFull {
    /// It returns [`ScheduleError::Full`] at once.
    #[default]
    Refuse,
    /// It waits until there is room. In a reaction, which must not wait for reactions, it refuses.
    Wait,
}

/// Why an event was not scheduled. [`Sender`] has an example.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum ScheduleError {
    /// As many events of the action wait as may.
    #[error(
        "action {action} cannot be scheduled: {events} events wait, and no more may\n  hint: schedule less often, \
         give the action a larger bound or `WhenFull::Wait` (`ReactorBuilder::bound`), or a minimum spacing \
         (`ReactorBuilder::space`)"
    )]
    Full {
        /// The full name of the action.
        action: Arc<str>,
        /// How many may wait.
        events: usize,
    },
    /// The program has ended.
    #[error("action {action} cannot be scheduled: the program has ended")]
    Ended {
        /// The full name of the action.
        action: Arc<str>,
    },
}

/// Schedules a physical action from any thread. Clones schedule the same action.
///
/// A program that waits for threads needs [`Program::keepalive`](crate::Program::keepalive): without it, a program
/// ends when no event waits.
///
/// ```
/// use std::thread;
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Keys").keepalive();
/// let key = program.reactor("keys", (), |keys| {
///     let key = keys.physical_action::<char>("key", Duration::ZERO);
///     keys.bound(key, 8, WhenFull::Wait);
///     keys.reaction().on(key).run(move |(), ctx| {
///         if ctx.get(key) == Some(&'q') {
///             ctx.request_stop();
///         }
///     });
///     key
/// });
/// let sender = program.sender(key);
/// let thread = thread::spawn(move || {
///     "abcdefghijklmnopq".chars().try_for_each(|key| sender.schedule(Duration::ZERO, key))
/// });
/// program.run()?;
/// assert!(thread.join().is_ok_and(|scheduled| scheduled.is_ok()));
/// # Ok::<(), Failure>(())
/// ```
pub struct Sender<T> {
    /// None if the system has none for the program, which therefore does not run.
    inbox: Option<Inbox<Value>>,
    action: ActionId,
    places: Arc<Places>,
    values: PhantomData<fn(T)>,
}

/// The value of an event of a physical action.
pub(super) struct Sent<T> {
    value: T,
    /// None if a reaction has scheduled it: such events are as many as the reactions are.
    _place: Option<Place>,
}

/// Where the events of one physical action wait.
pub(super) struct Places {
    action: Arc<str>,
    state: Mutex<State>,
    /// Told when a place is free, or the program has ended.
    freed: Condvar,
}

struct State {
    waiting: usize,
    bound: (usize, WhenFull),
    ended: bool,
}

/// The place of one event, until it is dropped.
struct Place(Arc<Places>);

/// All ways into a program from other threads. They are closed when this is dropped.
#[derive(Default)]
pub(super) struct Entrances {
    inbox: Option<Inbox<Value>>,
    failed: Option<Failure>,
    places: Vec<(ActionId, Arc<Places>)>,
}

impl<T: Message> Sender<T> {
    /// Schedules the action by the clock, `extra` after its minimum delay.
    ///
    /// # Errors
    ///
    /// If as many events wait as may, or the program has ended.
    pub fn schedule(&self, extra: Duration, value: T) -> Result<(), ScheduleError> {
        let ended = || ScheduleError::Ended { action: Arc::clone(&self.places.action) };
        let Some(inbox) = &self.inbox else { return Err(ended()) };
        let place = Place::take(&self.places)?;
        let value = Value::new(Sent { value, _place: Some(place) });
        match inbox.schedule(self.action, nanoseconds(extra), Some(value)) {
            true => Ok(()),
            false => Err(ended()),
        }
    }
}

impl<T> Sender<T> {
    /// A sender for an action of another program: this one has a mistake, and never runs.
    pub(super) fn to_nothing(action: ActionId) -> Self {
        let places = Places::new("of another program".to_owned());
        places.state().ended = true;
        Self { inbox: None, action, places: Arc::new(places), values: PhantomData }
    }

    /// Asks the program to stop at its next tag.
    pub fn request_stop(&self) {
        if let Some(inbox) = &self.inbox {
            inbox.request_stop();
        }
    }
}

impl<T> Clone for Sender<T> {
    fn clone(&self) -> Self {
        let Self { inbox, action, places, values } = self;
        Self { inbox: inbox.clone(), action: *action, places: Arc::clone(places), values: *values }
    }
}

impl<T> Sent<T> {
    pub(super) fn by_reaction(value: T) -> Self {
        Self { value, _place: None }
    }

    pub(super) fn value(&self) -> &T {
        &self.value
    }
}

impl<T: Clone> Clone for Sent<T> {
    /// A copy that is no event, and waits for nothing.
    fn clone(&self) -> Self {
        Self::by_reaction(self.value.clone())
    }
}

impl Places {
    fn new(action: String) -> Self {
        let state = State { waiting: 0, bound: default_bound(), ended: false };
        Self { action: action.into(), state: Mutex::new(state), freed: Condvar::new() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Place {
    fn take(places: &Arc<Places>) -> Result<Self, ScheduleError> {
        let mut state = places.state();
        loop {
            let (events, when_full) = state.bound;
            if state.ended {
                return Err(ScheduleError::Ended { action: Arc::clone(&places.action) });
            }
            if state.waiting < events {
                state.waiting += 1;
                return Ok(Self(Arc::clone(places)));
            }
            if when_full == WhenFull::Refuse || RUNS_REACTIONS.get() {
                return Err(ScheduleError::Full { action: Arc::clone(&places.action), events });
            }
            state = places.freed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.state().waiting -= 1;
        self.0.freed.notify_one();
    }
}

impl Entrances {
    /// Makes room for the events of an action of that full name.
    pub(super) fn add(&mut self, action: ActionId, name: String) {
        self.places.push((action, Arc::new(Places::new(name))));
    }

    /// States how many events of the action may wait; at least one may.
    pub(super) fn bound(&self, action: ActionId, events: usize, when_full: WhenFull) {
        self.of(action).state().bound = (events.max(1), when_full);
    }

    /// A sender for the action.
    pub(super) fn sender<T>(&mut self, action: ActionId) -> Sender<T> {
        let places = Arc::clone(self.of(action));
        if self.inbox.is_none() {
            self.open();
        }
        Sender { inbox: self.inbox.clone(), action, places, values: PhantomData }
    }

    /// The inbox of the program.
    ///
    /// # Errors
    ///
    /// If the system has no descriptor for it, or what the environment states is no limit.
    pub(super) fn ready(&mut self) -> Result<Inbox<Value>, Failure> {
        EventLimit::from_environment()?;
        if self.inbox.is_none() {
            self.open();
        }
        match (&self.inbox, self.failed.take()) {
            (Some(inbox), None) => Ok(inbox.clone()),
            (_, failed) => Err(failed.unwrap_or_else(|| no_inbox(&io::ErrorKind::Other.into()))),
        }
    }

    fn open(&mut self) {
        match Inbox::new() {
            Ok(inbox) => self.inbox = Some(inbox),
            Err(error) => self.failed = Some(no_inbox(&error)),
        }
    }

    fn of(&self, action: ActionId) -> &Arc<Places> {
        let found = self.places.iter().find(|(other, _)| *other == action);
        &found.expect("each physical action of the program was added").1
    }
}

impl Drop for Entrances {
    fn drop(&mut self) {
        if let Some(inbox) = &self.inbox {
            inbox.close();
        }
        for (_, places) in &self.places {
            places.state().ended = true;
            places.freed.notify_all();
        }
    }
}

/// The bound that holds if a program states none. A wrong one in the environment is reported when the program runs.
fn default_bound() -> (usize, WhenFull) {
    let events = match EventLimit::from_environment() {
        Ok(Some(EventLimit::Events(events))) => events.max(1),
        _ => DEFAULT_EVENTS,
    };
    (events, WhenFull::default())
}

/// Notes that this thread runs reactions while `run` runs.
pub(super) fn running_reactions<R>(run: impl FnOnce() -> R) -> R {
    let before = RUNS_REACTIONS.replace(true);
    let result = run();
    RUNS_REACTIONS.set(before);
    result
}

fn no_inbox(error: &io::Error) -> Failure {
    Failure::system("other threads cannot reach the program", error)
}
