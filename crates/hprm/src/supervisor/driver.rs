//! The loop that drives a supervisor, for federates of any kind: it reads the clock, waits for events and for
//! the limits of the supervisor, and hands its orders to the driver.

use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use super::{Observation, Order, Supervisor};
use crate::Kind;

/// What handles the federates: it has launched them as processes or as threads.
pub trait Driver {
    /// Does what an event needs before the supervisor gets it, and returns it, perhaps corrected. `has_not_failed`:
    /// whether neither a failure nor a signal came before.
    fn observe(&mut self, event: Observation, has_not_failed: bool) -> Observation;

    /// Carries out an order.
    fn carry_out(&mut self, order: Order);
}

/// How a federation has ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Outcome {
    /// The exit code that follows.
    pub code: i32,
    /// Whether no federate has failed because it could not write its share of the logical trace.
    pub is_traced: bool,
}

impl Supervisor {
    /// Supervises the federates, which have just been launched, until all have ended or must.
    ///
    /// # Panics
    ///
    /// If all senders of `events` are gone. The caller keeps one.
    pub fn run(&mut self, driver: &mut impl Driver, events: &Receiver<Observation>) -> Outcome {
        let launched = Instant::now();
        let mut is_traced = true;
        loop {
            let now = launched.elapsed();
            self.tick(now);
            while let Some(order) = self.poll() {
                is_traced &= !matches!(&order, Order::Report(report) if report.kind == Kind::Trace);
                driver.carry_out(order);
            }
            if let Some(code) = self.outcome(now) {
                return Outcome { code, is_traced };
            }
            let left = |at: Duration| at.saturating_sub(launched.elapsed());
            match events.recv_timeout(self.next_wakeup().map_or(Duration::MAX, left)) {
                Ok(event) => {
                    let event = driver.observe(event, self.has_not_failed());
                    self.handle(launched.elapsed(), event);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    unreachable!("the caller keeps a sender")
                }
            }
        }
    }
}
