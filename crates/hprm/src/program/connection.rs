//! Connections that are being declared.

use std::time::Duration;

use hprm_core::{Bound, Delay, Overflow};

use crate::nanoseconds;

/// Connections that were just made, to say more about them: see [`Program::connect`](crate::Program::connect) and
/// [`Program::connect_each`](crate::Program::connect_each).
///
/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Delayed").fast();
/// let out = program.reactor("source", (), |source| {
///     let out = source.output::<&str>("out");
///     source.reaction().on(Startup).sets(out).run(move |(), ctx| ctx.set(out, "hello"));
///     out
/// });
/// let inp = program.reactor("sink", (), |sink| {
///     let inp = sink.input("inp");
///     sink.reaction().on(inp).run(move |(), ctx| {
///         assert_eq!((ctx.get(inp), ctx.elapsed()), (Some(&"hello"), Duration::from_millis(5)));
///     });
///     inp
/// });
/// program.connect(out, inp).after(Duration::from_millis(5));
/// program.run()?;
/// # Ok::<(), Failure>(())
/// ```
pub struct Connections<'a>(pub(super) &'a mut [hprm_core::Connection]);

impl Connections<'_> {
    /// A value appears at the other end so much later; one microstep later, if that is zero.
    pub fn after(self, delay: Duration) -> Self {
        self.each(|connection| connection.delay = Delay::after(nanoseconds(delay)))
    }

    /// A value appears at the other end at the tag that the clock gives it.
    pub fn physical(self) -> Self {
        self.each(|connection| connection.physical = true)
    }

    /// Makes the connections physical and limits how many values of each may wait for the receiver: `overflow` is what
    /// happens to one more. In one process, [`Overflow::Block`] is no limit, because there a sender cannot wait.
    pub fn bound(self, values: u32, overflow: Overflow) -> Self {
        self.each(|connection| {
            connection.physical = true;
            connection.bound = Some(Bound { messages: values, overflow });
        })
    }

    /// Under decentralized coordination: how much longer the receiver waits for these values than its maxwait.
    pub fn absent_after(self, wait: Duration) -> Self {
        self.each(|connection| connection.absent_after = nanoseconds(wait))
    }

    /// Agents compress large values on their way to another machine.
    pub fn compress(self) -> Self {
        self.each(|connection| connection.compress = true)
    }

    fn each(self, change: impl Fn(&mut hprm_core::Connection)) -> Self {
        self.0.iter_mut().for_each(change);
        self
    }
}
