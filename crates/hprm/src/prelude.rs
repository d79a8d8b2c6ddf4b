//! What a program in Rust needs: `use hprm::prelude::*`. It begins with [`Program`].

pub use crate::{
    Action, Array, Connections, Context, Element, Entry, Failure, Federate, Federation, InputPort,
    Interface, Loan, LogicalAction, Message, Mode, Outcome, OutputPort, Overflow, PhysicalAction,
    Policy, Port, Ports, Program, Properties, ReactionBuilder, Reactor, ReactorBuilder, Readable,
    Reset, Runnable, ScheduleError, Sender, Shutdown, Spacing, Startup, Tag, Timer, Transfer,
    Triggers, WhenFull, run_as_federate,
};
