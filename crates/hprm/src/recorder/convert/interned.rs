//! Names that packets refer to by number.

use std::collections::HashMap;

use crate::recorder::perfetto::{DebugAnnotationName, EventCategory, EventName, InternedData};

/// What an event is about.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Category {
    Reaction,
    Message,
    Coordination,
    Wait,
    Schedule,
    Deadline,
    Tracepoint,
    /// The trace itself.
    Trace,
}

impl Category {
    fn name(self) -> &'static str {
        match self {
            Self::Reaction => "reaction",
            Self::Message => "message",
            Self::Coordination => "coordination",
            Self::Wait => "wait",
            Self::Schedule => "schedule",
            Self::Deadline => "deadline",
            Self::Tracepoint => "tracepoint",
            Self::Trace => "trace",
        }
    }
}

/// The names that have numbers, and those that the next packet must define.
#[derive(Default)]
pub(super) struct Interned {
    categories: HashMap<&'static str, u64>,
    events: HashMap<String, u64>,
    arguments: HashMap<&'static str, u64>,
    new: InternedData,
}

impl Interned {
    pub(super) fn category(&mut self, category: Category) -> u64 {
        let (name, next) = (category.name(), self.categories.len() as u64 + 1);
        let new = &mut self.new.event_categories;
        *self.categories.entry(name).or_insert_with(|| {
            new.push(EventCategory { iid: Some(next), name: Some(name.to_owned()) });
            next
        })
    }

    pub(super) fn event(&mut self, name: &str) -> u64 {
        if let Some(known) = self.events.get(name) {
            return *known;
        }
        let next = self.events.len() as u64 + 1;
        self.events.insert(name.to_owned(), next);
        self.new.event_names.push(EventName { iid: Some(next), name: Some(name.to_owned()) });
        next
    }

    pub(super) fn argument(&mut self, name: &'static str) -> u64 {
        let next = self.arguments.len() as u64 + 1;
        let new = &mut self.new.debug_annotation_names;
        *self.arguments.entry(name).or_insert_with(|| {
            new.push(DebugAnnotationName { iid: Some(next), name: Some(name.to_owned()) });
            next
        })
    }

    /// What the next packet must define.
    pub(super) fn take_new(&mut self) -> Option<InternedData> {
        let new = std::mem::take(&mut self.new);
        (new != InternedData::default()).then_some(new)
    }
}
