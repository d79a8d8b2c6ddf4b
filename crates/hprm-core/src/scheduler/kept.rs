//! Persistent inputs: ports whose last value can be read while they are absent.
//!
//! A port becomes one when a driver or a reaction gives it a first value to remember; other ports remember
//! nothing. Presence, and what it triggers, is the same for both.

use super::Scheduler;
use crate::PortId;

impl<V: Clone> Scheduler<V> {
    /// Has a port remember `value`, and from now on each value that it gets. Returns what it
    /// remembered before.
    pub fn keep(&mut self, port: PortId, value: V) -> Option<V> {
        self.kept.insert(port, value)
    }

    /// The value at a port; while it is absent, the one that it remembers.
    #[must_use]
    pub fn latest(&self, port: PortId) -> Option<&V> {
        self.port(port).or_else(|| self.kept.get(&port))
    }

    /// Has persistent ports remember what is present, before it is made absent.
    #[inline]
    pub(super) fn remember(&mut self) {
        if !self.kept.is_empty() {
            self.remember_present();
        }
    }

    fn remember_present(&mut self) {
        let mut kept = core::mem::take(&mut self.kept);
        for (port, value) in &mut kept {
            if let Some(present) = self.port(*port) {
                *value = present.clone();
            }
        }
        self.kept = kept;
    }
}
