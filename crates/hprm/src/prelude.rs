//! What a program in Rust needs: `use hprm::prelude::*`. It begins with [`Program`].

pub use crate::{
    Action, Connections, Context, Entry, Failure, InputPort, LogicalAction, Message, Mode, Outcome,
    OutputPort, Overflow, PhysicalAction, Policy, Port, Ports, Program, Properties,
    ReactionBuilder, Reactor, ReactorBuilder, Readable, Reset, Runnable, ScheduleError, Sender,
    Shutdown, Spacing, Startup, Tag, Timer, Triggers, WhenFull,
};
