//! What has happened in a run, as text: each event is a line.
//!
//! A run that goes on for ever has so many events that its text would be of no use. Of such a run the text has the
//! beginning and the last events, and says how many are not there.

use std::collections::VecDeque;
use std::fmt;

/// The longest history that is shown as a whole, in events: longer than that of any run that ends.
const WHOLE: usize = 50_000;

/// How many events of a longer history are shown, at its beginning and at its end.
const FIRST: usize = 200;
const LAST: usize = 100;

/// See the module.
#[derive(Debug, Default)]
pub(crate) struct History {
    /// The first [`WHOLE`] events.
    lines: Vec<String>,
    /// The last events, of those that follow.
    last: VecDeque<String>,
    count: usize,
}

impl History {
    /// One more event.
    pub(crate) fn add(&mut self, event: &dyn fmt::Display) {
        self.count += 1;
        if self.lines.len() < WHOLE {
            self.lines.push(event.to_string());
            return;
        }
        if self.last.len() == LAST {
            self.last.pop_front();
        }
        self.last.push_back(event.to_string());
    }
}

impl fmt::Display for History {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { lines, last, count } = self;
        let whole = last.is_empty();
        let first = if whole { lines.len() } else { FIRST };
        lines[..first].iter().try_for_each(|line| writeln!(f, "{line}"))?;
        if !whole {
            writeln!(f, "      ... {} events are left out here ...", count - first - last.len())?;
        }
        last.iter().try_for_each(|line| writeln!(f, "{line}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(events: usize) -> Vec<String> {
        let mut history = History::default();
        (0..events).for_each(|event| history.add(&event));
        history.to_string().lines().map(str::to_owned).collect()
    }

    #[test]
    fn a_history_that_ends_is_shown_as_a_whole() {
        assert!(text(0).is_empty());
        assert_eq!(text(3), ["0", "1", "2"]);
        assert_eq!(text(WHOLE).len(), WHOLE);
    }

    #[test]
    fn of_a_long_history_the_beginning_and_the_end_are_shown() {
        for events in [WHOLE + 1, 10 * WHOLE] {
            let text = text(events);
            assert!(text.len() <= FIRST + 1 + LAST);
            assert_eq!(text[FIRST - 1], (FIRST - 1).to_string());
            let shown = text.len() - 1;
            assert_eq!(
                text[FIRST],
                format!("      ... {} events are left out here ...", events - shown)
            );
            assert_eq!(text.last(), Some(&(events - 1).to_string()));
        }
    }
}
