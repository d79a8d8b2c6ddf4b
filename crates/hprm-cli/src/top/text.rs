//! The state of a federation as lines of text.

use hprm::board::FederateState;
use hprm_core::Tag;

use super::federation::{Federation, Member};
use super::rates::{Flow, flows, tag_rate};
use super::why::Part;
use super::words::{are_sized, bytes, rate, tag, time};

/// The titles of the columns of federates.
pub(crate) const TITLES: [&str; 8] =
    ["federate", "process", "state", "tag", "lag", "tags/s", "store", "tardy"];

/// A row of the table of federates.
pub(crate) fn row(before: Option<&Federation>, now: &Federation, number: usize) -> Vec<String> {
    let member = &now.members[number];
    let none = || "-".to_owned();
    let state = now.doing(Part::Federate(number)).kind.word().to_owned();
    let process = member.process.as_ref().map_or_else(none, |it| it.pid.to_string());
    let Some(board) = &member.board else {
        let known = member.known.as_ref().map(|known| known.completed);
        let at = known.filter(|at| *at > Tag::NEVER).map_or_else(none, tag);
        return vec![member.name.clone(), process, state, at, none(), none(), none(), none()];
    };
    let tags = before.and_then(|before| tag_rate(before, now, number));
    vec![
        member.name.clone(),
        process,
        state,
        board.tag().map_or_else(none, tag),
        board.lag().map_or_else(none, time),
        tags.map_or_else(none, rate),
        bytes(board.state.store.in_use),
        board.state.tardy.to_string(),
    ]
}

/// The line above all others.
pub(crate) fn title(federation: &Federation) -> String {
    let coordination = if federation.centralized { "centralized" } else { "decentralized" };
    let ran = match federation.elapsed() {
        Some(elapsed) => format!("running for {}", time(elapsed.max(0))),
        None => "not started".to_owned(),
    };
    let count = federation.members.len();
    let rti = match &federation.rti {
        Some(rti) => format!("the RTI is in process {}", rti.process.pid),
        None => "the RTI is not seen here".to_owned(),
    };
    format!("{}: {count} federates, {coordination}, {ran}; {rti}", federation.name)
}

/// Everything.
pub(crate) fn lines(
    before: Option<&Federation>,
    now: &Federation,
    only: Option<usize>,
) -> Vec<String> {
    let mut lines = vec![title(now), String::new()];
    let shown = (0..now.members.len()).filter(|number| only.is_none_or(|only| only == *number));
    let shown: Vec<_> = shown.collect();
    let rows = shown.iter().map(|number| row(before, now, *number)).collect();
    lines.extend(table(&TITLES, rows));
    lines.push(String::new());
    lines.extend(why(now, only));
    let flows = flows(before, now);
    let member = only.map(|only| now.members[only].name.as_str());
    let flows: Vec<_> = flows
        .iter()
        .filter(|flow| member.is_none_or(|name| flow.from == name || flow.to == name))
        .collect();
    if !flows.is_empty() {
        lines.push(String::new());
        let titles = ["connection", "messages", "messages/s", "bytes", "bytes/s", "last tag"];
        lines.extend(table(&titles, flows.into_iter().map(connection).collect()));
    }
    let notes: Vec<_> = shown.iter().filter_map(|it| notes(now, &now.members[*it])).collect();
    if !notes.is_empty() {
        lines.push(String::new());
        lines.extend(notes);
    }
    if now.has_foreign {
        lines.push(String::new());
        lines.push("another version of HPRM runs some of these; they show nothing here".to_owned());
    }
    lines
}

/// What each federate does, and why: those that wait are below the one they wait for.
pub(crate) fn why(federation: &Federation, only: Option<usize>) -> Vec<String> {
    let line = |depth: usize, part| {
        let doing = federation.doing(part);
        format!("{}{} {}", "  ".repeat(depth), federation.title(part), doing.text)
    };
    match only {
        Some(only) => {
            let chain = federation.chain(Part::Federate(only));
            chain.into_iter().enumerate().map(|(depth, part)| line(depth, part)).collect()
        }
        None => {
            let tree = federation.tree();
            let is_worth = |part: &Part| match part {
                Part::Federate(number) => !federation.members[*number].is_absent_rightly(),
                Part::Rti => true,
            };
            let shown = tree.into_iter().filter(|(_, part)| is_worth(part));
            shown.map(|(depth, part)| line(depth, part)).collect()
        }
    }
}

/// A row of the table of connections.
pub(crate) fn connection(flow: &Flow) -> Vec<String> {
    let arrow = if flow.name.physical { "~>" } else { "->" };
    let none = || "-".to_owned();
    let is_sized = are_sized(flow.messages, flow.bytes);
    vec![
        format!("{} {arrow} {}", flow.name.from_port, flow.name.to_port),
        flow.messages.to_string(),
        flow.message_rate.map_or_else(none, rate),
        Some(flow.bytes).filter(|_| is_sized).map_or_else(none, bytes),
        flow.byte_rate.filter(|_| is_sized).map_or_else(none, |it| bytes(it as u64)),
        flow.last.map_or_else(none, tag),
    ]
}

/// What there is to say of how often a federate was started again, of the memory of its store, and of messages that
/// were dropped.
pub(crate) fn notes(federation: &Federation, member: &Member) -> Option<String> {
    let again = match member.restarts {
        0 => None,
        1 => Some("was started again once".to_owned()),
        count => Some(format!("was started again {count} times")),
    };
    let state = member.board.as_ref().map(|board| &board.state);
    let of_board = state.into_iter().flat_map(|state| memory(federation, state));
    let parts: Vec<_> = again.into_iter().chain(of_board).collect();
    (!parts.is_empty()).then(|| format!("{}: {}", member.name, parts.join("; ")))
}

fn memory(federation: &Federation, state: &FederateState) -> Vec<String> {
    let mut parts = Vec::new();
    if state.store.in_use > 0 {
        let (used, limit) = (bytes(state.store.in_use), bytes(state.store.limit));
        let name = |number: u16| {
            let member = federation.members.get(usize::from(number));
            member.map_or_else(|| "a watcher".to_owned(), |it| it.name.clone())
        };
        let held = state.store.held.iter();
        let held: Vec<_> = held.map(|(by, it)| format!("{} {}", name(*by), bytes(*it))).collect();
        let held =
            if held.is_empty() { String::new() } else { format!("; held by {}", held.join(", ")) };
        parts.push(format!("{used} of {limit} are in use{held}"));
    }
    if state.store.fallbacks > 0 {
        parts.push(format!("{} messages found no room in the store", state.store.fallbacks));
    }
    if state.dropped > 0 {
        parts.push(format!("{} messages were dropped on physical connections", state.dropped));
    }
    parts
}

/// The first column begins at the left, and all others end at the right.
fn table(titles: &[&str], rows: Vec<Vec<String>>) -> Vec<String> {
    let titles: Vec<_> = titles.iter().map(|&title| title.to_owned()).collect();
    let lines: Vec<_> = std::iter::once(titles).chain(rows).collect();
    let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max();
    let widths: Vec<_> = (0..lines[0].len()).map(|it| width(it).unwrap_or_default()).collect();
    let line = |line: &Vec<String>| {
        let mut cells = line.iter().zip(&widths);
        let first = cells.next().map(|(cell, width)| format!("{cell:width$}"));
        let others = cells.map(|(cell, width)| format!("  {cell:>width$}"));
        first.into_iter().chain(others).collect::<String>().trim_end().to_owned()
    };
    lines.iter().map(line).collect()
}
