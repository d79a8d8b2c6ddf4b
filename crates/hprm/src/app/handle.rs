//! What names a part of an app: small, copied into the bodies that use it.

use hprm_core::{ActionId, Effect, PortId, TimerId, Trigger};

macro_rules! handles {
    ($($(#[$doc:meta])* $name:ident($id:ident) = $trigger:ident;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        pub struct $name(pub(super) $id);

        impl From<$name> for $id {
            fn from(handle: $name) -> Self {
                handle.0
            }
        }

        impl From<$name> for Trigger {
            fn from(handle: $name) -> Self {
                Self::$trigger(handle.0)
            }
        }
    )*};
}

handles! {
    /// An input port of a reactor.
    InputPort(PortId) = Port;
    /// An output port of a reactor.
    OutputPort(PortId) = Port;
    /// A timer of a reactor.
    Timer(TimerId) = Timer;
    /// An action that is scheduled relative to the current tag.
    LogicalAction(ActionId) = Action;
    /// An action that is scheduled by the clock, also from other threads.
    PhysicalAction(ActionId) = Action;
}

/// What can hold a value: a port or an action.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Readable {
    /// A port.
    Port(PortId),
    /// An action.
    Action(ActionId),
}

/// A [`Readable`] that can be compared at once.
pub(super) type Key = u64;

impl Readable {
    #[inline]
    pub(super) fn key(self) -> Key {
        match self {
            Self::Port(port) => Key::from(port.0) << 1,
            Self::Action(action) => Key::from(action.0) << 1 | 1,
        }
    }
}

macro_rules! readable {
    ($($name:ident = $kind:ident;)*) => {$(
        impl From<$name> for Readable {
            fn from(handle: $name) -> Self {
                Self::$kind(handle.0)
            }
        }

        impl From<$name> for Effect {
            fn from(handle: $name) -> Self {
                Self::$kind(handle.0)
            }
        }
    )*};
}

readable! {
    InputPort = Port;
    OutputPort = Port;
    LogicalAction = Action;
    PhysicalAction = Action;
}
