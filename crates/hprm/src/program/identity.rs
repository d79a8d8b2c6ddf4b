//! Which program a handle belongs to, and what the part that it names is called there.
//!
//! Handles are copied freely, also into another program, where their numbers would mean other parts. So each program
//! has a number of its own, which its handles carry. The names are kept beside the programs, because the program in
//! which a wrong handle is found does not know them.

use std::collections::BTreeMap;
use std::panic::Location;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use hprm_core::{ActionId, ModeId, PortId, ReactorId, TimerId, Trigger};

use crate::Report;

/// How many bits of a number a key has room for: see `Key`.
const BITS: u32 = 29;

/// The number of a program, while it is put together and while it runs.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct GraphNumber(u32);

/// A part of a program, and which program that is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Of<I> {
    pub(super) id: I,
    pub(super) graph: GraphNumber,
}

/// What a handle names.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Part {
    Port(PortId),
    Action(ActionId),
    Timer(TimerId),
    Mode(ModeId),
}

/// What a part is called, and the reactor that has it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Named {
    pub(super) name: String,
    pub(super) reactor: ReactorId,
}

/// The parts of one program.
type Names = BTreeMap<Part, Named>;

static NUMBERS: AtomicU32 = AtomicU32::new(0);

static NAMES: Mutex<BTreeMap<GraphNumber, Names>> = Mutex::new(BTreeMap::new());

/// The number of a program and the names of its parts, which are forgotten when this is dropped.
pub(super) struct Identity(GraphNumber);

impl GraphNumber {
    pub(super) fn get(self) -> u32 {
        self.0
    }
}

impl Identity {
    pub(super) fn new() -> Self {
        let number = GraphNumber(NUMBERS.fetch_add(1, Ordering::Relaxed) & ((1 << BITS) - 1));
        names().insert(number, Names::new());
        Self(number)
    }

    pub(super) fn number(&self) -> GraphNumber {
        self.0
    }

    /// A handle for a part, of that full name.
    pub(super) fn of<I: Copy + Into<Part>>(
        &self,
        id: I,
        reactor: ReactorId,
        name: String,
    ) -> Of<I> {
        if let Some(names) = names().get_mut(&self.0) {
            names.insert(id.into(), Named { name, reactor });
        }
        Of { id, graph: self.0 }
    }
}

impl Drop for Identity {
    fn drop(&mut self) {
        names().remove(&self.0);
    }
}

impl<I: Copy + Into<Part>> Of<I> {
    /// What its program calls it; none if the program has ended.
    pub(super) fn named(self) -> Option<Named> {
        names().get(&self.graph)?.get(&self.id.into()).cloned()
    }

    /// What is said of it in another program.
    pub(super) fn told_elsewhere(self) -> String {
        let part = self.id.into();
        match self.named() {
            Some(Named { name, .. }) => {
                format!("{} {name}, which belongs to another program", part.kind())
            }
            None => format!("a {} of a program that has ended", part.kind()),
        }
    }
}

impl Part {
    pub(super) fn kind(self) -> &'static str {
        match self {
            Self::Port(_) => "port",
            Self::Action(_) => "action",
            Self::Timer(_) => "timer",
            Self::Mode(_) => "mode",
        }
    }

    /// The part that triggers a reaction; none if that is no part of a reactor.
    pub(super) fn of_trigger(trigger: Trigger) -> Option<Self> {
        match trigger {
            Trigger::Port(port) => Some(Self::Port(port)),
            Trigger::Action(action) => Some(Self::Action(action)),
            Trigger::Timer(timer) => Some(Self::Timer(timer)),
            Trigger::Startup | Trigger::Shutdown | Trigger::Reset => None,
        }
    }
}

macro_rules! parts {
    ($($kind:ident($id:ident))*) => {$(
        impl From<$id> for Part {
            fn from(id: $id) -> Self {
                Self::$kind(id)
            }
        }
    )*};
}

parts! { Port(PortId) Action(ActionId) Timer(TimerId) Mode(ModeId) }

/// A report that says where in the source of the program it is.
pub(super) fn located(report: Report, at: &Location<'_>) -> Report {
    Report {
        file: Some(at.file().to_owned()),
        line: Some(at.line()),
        column: Some(at.column()),
        ..report
    }
}

fn names() -> MutexGuard<'static, BTreeMap<GraphNumber, Names>> {
    NAMES.lock().unwrap_or_else(PoisonError::into_inner)
}
