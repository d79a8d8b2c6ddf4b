//! Tracepoints: events of the program itself, which its bodies record.

use std::sync::Arc;

use hprm_core::Tag;

use super::lanes::Lanes;
use super::record::{Flags, Kind, Record};

/// Where the bodies of a process record tracepoints, from any thread; of no use if the run is not traced.
#[derive(Clone, Debug, Default)]
pub struct Tracepoints(Option<Arc<Lanes>>);

impl Tracepoints {
    pub(super) fn on(lanes: Arc<Lanes>) -> Self {
        Self(Some(lanes))
    }

    /// The number of the tracepoint of this name: 1 or more, or 0 if the run is not traced.
    #[must_use]
    pub fn name(&self, name: &str) -> u32 {
        self.0.as_ref().map_or(0, |lanes| lanes.name(name))
    }

    /// Records that a tracepoint was reached, perhaps with a value.
    pub fn hit(&self, number: u32, value: Option<i64>) {
        let Some(lanes) = self.0.as_ref().filter(|_| number != 0) else { return };
        let flags = if value.is_some() { Flags::VALUE } else { Flags::NONE };
        let value = value.unwrap_or_default().cast_unsigned();
        let record = Record::new(Kind::Tracepoint, flags, number, Tag::NEVER);
        lanes.push_tracepoint(record.with_values([value, 0]));
    }
}
