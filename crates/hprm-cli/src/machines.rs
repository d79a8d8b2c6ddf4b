//! `hprm machines` and `hprm agent`: what this command has to do with agents, which are programs of their own.

use std::env;
use std::io::ErrorKind;
use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode};
use std::time::{SystemTime, UNIX_EPOCH};

use hprm::agent::{About, ClockReading, Limited, Machine, machines as ask};
use serde_json::json;

use crate::args::{Agent, Machines};
use crate::columns;
use crate::message::{self, Error, print_line};
use crate::top::bytes;

/// The program of an agent.
const PROGRAM: &str = "hprm-agent";

/// Lists the machines whose agents see one another.
///
/// # Errors
///
/// If no agent runs on this machine, or it does not answer.
pub(crate) fn machines(wanted: &Machines) -> Result<ExitCode, Error> {
    message::or_json(wanted.json, show(wanted.json))
}

fn show(json: bool) -> Result<ExitCode, Error> {
    let machines = ask().map_err(|error| Error::new(message::reason(&error)))?;
    match json {
        true => print_line(&json!({ "machines": machines }).to_string()),
        false => print_line(&table(&machines, now())),
    }
    Ok(ExitCode::SUCCESS)
}

const TITLES: [&str; 7] =
    ["machine", "version", "processors", "memory", "clock", "federations", "listens at"];

/// The column that is there when an agent starts programs.
const LIMITS: &str = "limits";

/// The column that is there when a certificate ends soon.
const CERTIFICATE: &str = "certificate";

const DAY: i64 = 24 * 60 * 60;

/// From how many days before its end on a certificate is shown.
const SHOWN_DAYS: i64 = 30;

/// The machines at a moment, in seconds since 1970.
fn table(machines: &[Machine], now: i64) -> String {
    let ends: Vec<_> = machines.iter().map(|machine| certificate(machine, now)).collect();
    let mut rows: Vec<_> = machines.iter().map(row).collect();
    let mut titles = TITLES.to_vec();
    let limits: Vec<_> = machines.iter().map(limits).collect();
    for (title, cells) in [(LIMITS, limits), (CERTIFICATE, ends)] {
        if cells.iter().any(Option::is_some) {
            titles.push(title);
            for (row, cell) in rows.iter_mut().zip(cells) {
                row.push(cell.unwrap_or_else(|| "-".to_owned()));
            }
        }
    }
    columns::text(&titles, rows)
}

/// For what the limits of programs count that an agent starts.
fn limits(machine: &Machine) -> Option<String> {
    let text = match machine.about.as_ref()?.limits? {
        Limited::Program => "per program",
        Limited::Process => "per process",
    };
    Some(text.to_owned())
}

/// When the certificate of a machine ends, if that is soon.
fn certificate(machine: &Machine, now: i64) -> Option<String> {
    let left = machine.about.as_ref()?.certificate_ends? - now;
    match left / DAY {
        _ if left <= 0 => Some("has ended".to_owned()),
        0 => Some("ends within a day".to_owned()),
        1 => Some("ends in 1 day".to_owned()),
        days if left <= SHOWN_DAYS * DAY => Some(format!("ends in {days} days")),
        _ => None,
    }
}

/// In seconds since 1970.
fn now() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_secs()).unwrap_or(i64::MAX)
}

fn row(machine: &Machine) -> Vec<String> {
    let name = match (machine.is_here, &machine.about) {
        (true, _) => format!("{} (this machine)", machine.name),
        (false, Some(_)) => machine.name.clone(),
        (false, None) => format!("{} (does not answer)", machine.name),
    };
    let way = machine.through.as_ref().map(|router| format!(" (through {router})"));
    let mut cells = vec![name + &way.unwrap_or_default()];
    match &machine.about {
        Some(About { version, addresses, processors, memory, federations, .. }) => cells.extend([
            version.clone(),
            processors.to_string(),
            bytes(*memory),
            clock(machine.clock),
            or_none(federations),
            or_none(addresses),
        ]),
        None => cells.resize(TITLES.len(), "-".to_owned()),
    }
    cells
}

/// By how much a clock is ahead of this machine's.
fn clock(reading: Option<ClockReading>) -> String {
    let Some(ClockReading { offset, bound }) = reading else { return "-".to_owned() };
    let sign = if offset > 0 { "+" } else { "" };
    format!("{sign}{} ±{}", columns::time(Some(offset)), columns::time(Some(bound)))
}

fn or_none(texts: &[String]) -> String {
    if texts.is_empty() { "-".to_owned() } else { texts.join(", ") }
}

/// Becomes the agent of this machine. Returns only if that fails.
///
/// # Errors
///
/// If there is no such program, or it cannot be started.
pub(crate) fn agent(wanted: &Agent) -> Result<ExitCode, Error> {
    let beside = env::current_exe().ok().map(|hprm| hprm.with_file_name(PROGRAM));
    let beside = beside.filter(|path| path.is_file());
    let mut command = match &beside {
        Some(path) => Command::new(path),
        None => Command::new(PROGRAM),
    };
    command.args(&wanted.options);
    let error = command.exec();
    Err(match error.kind() {
        ErrorKind::NotFound => {
            Error::new(format!("{PROGRAM} is neither beside this command nor on the PATH"))
                .hint("it is a program of its own; a clone of HPRM builds it: make agent")
        }
        _ => Error::new(format!("cannot run {}: {error}", command.get_program().display())),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn machines_are_lines_of_a_table() {
        let about = About {
            version: "0.1.0".to_owned(),
            addresses: vec!["192.0.2.1:7650".to_owned()],
            processors: 4,
            memory: 8_000_000_000,
            federations: vec!["Vision".to_owned(), "Arm".to_owned()],
            certificate_ends: Some(1_000 * DAY),
            limits: None,
        };
        let machine = |name: &str, about, clock| Machine {
            name: name.to_owned(),
            is_here: name == "robot1",
            about,
            clock,
            through: (name == "robot4").then(|| "robot2".to_owned()),
        };
        let clock = ClockReading { offset: 1_500_000, bound: 200_000 };
        let alone = About { federations: Vec::new(), ..about.clone() };
        let machines = [
            machine("robot1", Some(alone), None),
            machine("robot2", Some(about.clone()), Some(clock)),
            machine("robot3", None, None),
            machine("robot4", Some(about), Some(clock)),
        ];
        let expected = "\
machine                   version  processors   memory             clock  federations      listens at
robot1 (this machine)       0.1.0           4  8.00 GB                 -            -  192.0.2.1:7650
robot2                      0.1.0           4  8.00 GB  +1.50 ms ±200 us  Vision, Arm  192.0.2.1:7650
robot3 (does not answer)        -           -        -                 -            -               -
robot4 (through robot2)     0.1.0           4  8.00 GB  +1.50 ms ±200 us  Vision, Arm  192.0.2.1:7650";
        assert_eq!(table(&machines, 0), expected);
        let mut limited = machines.clone();
        for (machine, limits) in limited.iter_mut().zip([Limited::Program, Limited::Process]) {
            machine.about.as_mut().unwrap().limits = Some(limits);
        }
        let lines = table(&limited, 0);
        let cells: Vec<_> = lines.lines().map(|line| line[line.len() - 11..].trim()).collect();
        assert_eq!(cells, ["limits", "per program", "per process", "-", "-"]);
        let lines = table(&machines, 970 * DAY);
        let ends: Vec<_> = lines.lines().map(|line| line[line.len() - 15..].trim()).collect();
        let soon = "ends in 30 days";
        assert_eq!(ends, ["certificate", soon, soon, "-", soon]);
        for (now, expected) in [
            (970 * DAY - 1, None),
            (998 * DAY + 1, Some("ends in 1 day")),
            (999 * DAY + 1, Some("ends within a day")),
            (1_000 * DAY, Some("has ended")),
        ] {
            assert_eq!(certificate(&machines[0], now).as_deref(), expected);
        }
    }
}
