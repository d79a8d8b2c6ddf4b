//! What a program in Rust needs: `use hprm::prelude::*`. It begins with [`Program`].

/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// # let mut program = Federation::new("Viewing").timeout(Duration::ZERO);
/// # let frames: OutputPort<u32> = program.reactor("camera", (), |camera| camera.output("frame"));
/// # let shown: InputPort<u32> = program.reactor("viewer", (), |viewer| viewer.input("frame"));
/// // Of the frames that wait for a slow viewer, only the newest counts.
/// program.connect(frames, shown).physical().bound(1, Overflow::Replace);
/// ```
pub use crate::Overflow;

/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Button").fast();
/// let mut main = program.main();
/// let pressed = main.logical_action("pressed", Duration::ZERO);
/// // Of two events within 20 ms, the second one is dropped: the button bounces.
/// main.space(pressed, Spacing { min: 20_000_000, policy: Policy::Drop });
/// main.reaction().on(Startup).schedules(pressed).run(move |(), ctx| {
///     ctx.schedule(pressed, Duration::from_millis(1), "first");
///     ctx.schedule(pressed, Duration::from_millis(2), "second");
/// });
/// main.reaction().on(pressed).run(move |(), ctx| assert_eq!(ctx.get(pressed), Some(&"first")));
/// program.run()?;
/// # Ok::<(), Failure>(())
/// ```
pub use crate::{Policy, Spacing};

/// ```
/// use hprm::prelude::*;
///
/// let properties = Properties { fast: true, timeout: Some(5_000_000), ..Properties::default() };
/// let mut program = Program::new("Stated").properties(properties);
/// program.main().reaction().on(Startup).run(|(), _| println!("it runs"));
/// program.run()?;
/// # Ok::<(), Failure>(())
/// ```
pub use crate::Properties;

/// ```
/// use hprm::prelude::*;
///
/// let tag = Tag::new(5_000_000, 0);
/// assert!(Tag::START < tag && tag < tag.succ());
/// assert_eq!(tag.succ(), Tag::new(5_000_000, 1));
/// ```
pub use crate::Tag;

pub use crate::{
    Action, Array, Connections, Context, Dynamic, Element, Entry, Failure, Federate, Federation,
    InputPort, Interface, Loan, LogicalAction, Message, Mode, Outcome, OutputPort, PhysicalAction,
    Port, Ports, Program, ReactionBuilder, Reactor, ReactorBuilder, Readable, Reset, Restart,
    Runnable, ScheduleError, Sender, Shutdown, Startup, Timer, Transfer, Triggers, WhenFull,
    run_as_federate, run_as_federate_with,
};
