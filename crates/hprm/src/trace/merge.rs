//! One trace of the shares of federates: the one that the program would have written in one process.

use std::collections::BTreeMap;
use std::io::{BufRead, Seek};
use std::path::Path;

use hprm_core::{Program, ReactionId};

use super::line::{End, Entry, Header, Line, RunEnding};
use super::{Draft, Reader};
use crate::Failure;

/// What is known of a run apart from its shares.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(super) struct Known<'a> {
    /// A federate of which there is no share at all.
    pub(super) absent: Option<&'a str>,
    /// How many processes of which federates have left no share.
    pub(super) missing: BTreeMap<String, u32>,
    /// Whether the user has stopped the run, which federates do not know of.
    pub(super) interrupted: bool,
}

/// Merges shares by tag, level and place in the program into the file `path`.
///
/// # Errors
///
/// If a share is no trace, or the file cannot be written.
pub(super) fn merge<R: BufRead + Seek>(
    program: &Program,
    mut shares: Vec<Reader<R>>,
    known: Known<'_>,
    path: &Path,
) -> Result<(), Failure> {
    let unwritten = |error| Failure::trace(path, &error);
    let places: BTreeMap<String, (u32, ReactionId)> = program
        .reactions
        .iter()
        .map(|(id, reaction)| (program.reaction_name(id), (reaction.level, id)))
        .collect();
    let mut draft = Draft::create(path).map_err(unwritten)?;
    draft.write(&Line::Header(Header::of(program))).map_err(unwritten)?;
    while let Some(tag) = shares.iter().filter_map(Reader::next_tag).min() {
        let mut entries: Vec<Entry> = Vec::new();
        for share in shares.iter_mut().filter(|share| share.next_tag() == Some(tag)) {
            entries.extend(share.group()?.into_iter().flat_map(|group| group.entries));
        }
        entries.sort_by_key(|entry| places.get(&entry.reaction).copied());
        for entry in entries {
            draft.write(&Line::Entry(entry)).map_err(unwritten)?;
        }
    }
    let mut end = common_end(shares.iter().map(|share| &share.end), known.absent);
    if known.interrupted && end.outcome == RunEnding::Done {
        end.outcome = RunEnding::Interrupted;
    }
    // At which tag one process takes the place of another one depends on clocks.
    end.physical |= !known.missing.is_empty();
    end.missing = known.missing;
    draft.write(&Line::End(end)).and_then(|()| draft.publish()).map_err(unwritten)
}

/// The end of all: as early as that of the first, but for those that left before the others, and as
/// bad as that of the worst.
fn common_end<'a>(ends: impl Iterator<Item = &'a End>, absent: Option<&str>) -> End {
    let absent = absent.map(|name| End {
        end: (0, 0),
        outcome: RunEnding::Failed,
        message: Some(format!("federate {name} has left no trace")),
        physical: false,
        tardy: 0,
        early: false,
        missing: BTreeMap::new(),
    });
    let all = ends.cloned().chain(absent);
    let merged = all.reduce(|a, b| End {
        end: match (a.early, b.early) {
            (false, true) => a.end,
            (true, false) => b.end,
            (true, true) => a.end.max(b.end),
            (false, false) => a.end.min(b.end),
        },
        early: a.early && b.early,
        outcome: a.outcome.max(b.outcome),
        message: match b.message {
            // What the others were told is less than what the one that failed has to say.
            Some(said) if a.message.as_ref().is_none_or(String::is_empty) => Some(said),
            _ => a.message,
        },
        physical: a.physical || b.physical,
        tardy: a.tardy + b.tardy,
        missing: BTreeMap::new(),
    });
    let merged = merged.expect("a federation has a federate");
    End { early: false, ..merged }
}

#[cfg(test)]
mod tests {
    use super::super::reader::tests::{HEADER, trace};
    use super::*;

    use hprm_core::{
        Delay, Direction, Effect, Nanos, ProgramBuilder, Properties, ReactionSpec, Trigger,
    };

    /// A sink that stands before its source.
    fn program() -> Program {
        let mut b = ProgramBuilder::new("M", Properties::default());
        let [sink, source] = ["sink", "source"].map(|name| b.reactor(b.main(), name));
        let input = b.port(sink, "in", Direction::Input);
        let output = b.port(source, "out", Direction::Output);
        b.connect(output, input, Delay::None);
        let on = |trigger| ReactionSpec { triggers: vec![trigger], ..ReactionSpec::default() };
        b.reaction(sink, on(Trigger::Port(input)));
        b.reaction(
            source,
            ReactionSpec { effects: vec![Effect::Port(output)], ..on(Trigger::Startup) },
        );
        for (reactor, name) in [(sink, "sink"), (source, "source")] {
            b.federate(reactor, name, Nanos::MAX, None);
        }
        b.build().unwrap()
    }

    fn merged(shares: [&str; 2], known: Known<'_>) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("all");
        let shares = shares.map(|lines| trace("share", lines)).into();
        merge(&program(), shares, known, &path).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let header = HEADER.replace("false", "true");
        text.strip_prefix(&header).unwrap().lines().map(str::to_owned).collect()
    }

    const SINK: &str = "{\"tag\":[0,0],\"reaction\":\"M.sink.1\"}\n";
    const SOURCE: &str = "{\"tag\":[0,0],\"reaction\":\"M.source.1\"}\n";
    const LATER: &str = "{\"tag\":[3,0],\"reaction\":\"M.source.1\"}\n";
    const DONE: &str = "{\"end\":[9,0],\"outcome\":\"done\",\"tardy\":1}\n";

    #[test]
    fn entries_stand_by_tag_and_level() {
        let shares = [&*format!("{SINK}{DONE}"), &format!("{SOURCE}{LATER}{DONE}")];
        let all = merged(shares, Known::default());
        let end = "{\"end\":[9,0],\"outcome\":\"done\",\"tardy\":2}\n";
        assert_eq!(all, [SOURCE, SINK, LATER, end].map(str::trim_end));
    }

    #[test]
    fn the_end_is_that_of_the_worst() {
        let known = Known { interrupted: true, ..Known::default() };
        let shares = [&*format!("{SINK}{DONE}"), &format!("{SOURCE}{LATER}")];
        let broken = merged(shares, known.clone());
        assert_eq!(broken.len(), 4);
        assert!(broken[3].starts_with("{\"end\":[3,0],\"outcome\":\"failed\""), "{}", broken[3]);
        let shares = [&*format!("{SINK}{DONE}"), DONE];
        let absent = merged(shares, Known { absent: Some("x"), ..Known::default() });
        assert!(absent[1].contains("federate x has left no trace"), "{}", absent[1]);
        let stopped = merged(shares, known);
        assert!(stopped[1].contains("interrupted"), "{}", stopped[1]);
    }

    #[test]
    fn the_end_tells_which_processes_have_left_nothing() {
        let missing = BTreeMap::from([("sink".to_owned(), 2)]);
        let told = merged([DONE, DONE], Known { missing, ..Known::default() });
        assert!(
            told[0].ends_with("\"physical\":true,\"tardy\":2,\"missing\":{\"sink\":2}}"),
            "{}",
            told[0]
        );
    }
}
