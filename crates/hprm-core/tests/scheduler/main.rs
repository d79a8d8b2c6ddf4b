//! The scheduler, as programs see it. They are one program: each of several would
//! compile the scheduler again.

mod bounds;
mod common;
mod deadlines;
mod departures;
mod effects;
mod ending;
mod modes;
mod persistent_inputs;
mod record;
mod semantics;
mod spacing;
