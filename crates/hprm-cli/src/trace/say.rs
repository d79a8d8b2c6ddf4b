//! Differences in sentences for people, and how much was compared.

use std::collections::BTreeMap;

use hprm::trace::Described;
use hprm::trace::line::{At, How, Read, Reason, Schedule, ScheduleOutcome, Set, Which};

use super::compare::{Comparison, Difference, Divergence};

/// A tag: `(10000000 ns, 0)`.
pub(crate) fn moment((time, microstep): At) -> String {
    format!("({time} ns, {microstep})")
}

/// That clocks decided on these runs, which say so at their ends.
pub(crate) fn clocks(marked: &[&str]) -> Option<String> {
    let runs = match marked {
        [] => return None,
        [run] => format!("{run} depends"),
        [a, b] => format!("{a} and {b} both depend"),
        more => format!("{} runs depend", more.len()),
    };
    Some(format!("{runs} on clocks: they decided when a federate came or went, or when all ended"))
}

/// Processes of federates, by how many of each.
pub(crate) fn processes(missing: &BTreeMap<String, u32>) -> String {
    let of_each = missing.iter().map(|(federate, count)| {
        let processes = if *count == 1 { "process" } else { "processes" };
        format!("{count} {processes} of federate {federate}")
    });
    of_each.collect::<Vec<_>>().join(" and ")
}

/// Where two traces part, and what each has there.
pub(crate) fn sentence(divergence: &Divergence, [a, b]: [&str; 2]) -> String {
    let Divergence { tag, name, what, .. } = divergence;
    let only = |second: bool| if second { [b, a] } else { [a, b] };
    let both = |subject: &str, [x, y]: [String; 2]| format!("{subject} {x} in {a}, and {y} in {b}");
    let subject = format!("at {}, reaction {name}", moment(*tag));
    match what {
        Difference::Ran(second) => {
            let [does, not] = only(*second);
            format!("{subject} runs in {does}, but not in {not}")
        }
        Difference::Body(Which::Deadline, Which::Main) => missed(&subject, [a, b]),
        Difference::Body(Which::Main, Which::Deadline) => missed(&subject, [b, a]),
        Difference::Body(x, y) => both(&format!("{subject} runs"), [body(*x), body(*y)]),
        Difference::Tardy(x, y) => both(&format!("{subject} has"), [tardy(*x), tardy(*y)]),
        Difference::Read(from, reads) => both(&subject, finds(from, reads)),
        Difference::Port(port, sets) => {
            let values = sets.each_ref().map(|set| set.as_ref().map(|set: &Set| &set.value));
            both(
                &subject,
                values_of(values, &format!("sets {port} to"), &format!("does not set {port}")),
            )
        }
        Difference::Action(number, calls) => action(&subject, *number, calls, [a, b]),
        Difference::Mode(number, modes) => {
            let enters = modes.each_ref().map(|mode| match mode {
                Some(mode) => {
                    let how = if mode.how == How::Reset { "a reset" } else { "its history" };
                    format!("asks for mode {} with {how}", mode.mode)
                }
                None => format!("changes modes only {} times", number - 1),
            });
            both(&subject, enters)
        }
        Difference::Stops(second) => {
            let [does, not] = only(*second);
            format!("{subject} asks for the end in {does}, but not in {not}")
        }
        Difference::Leaves(second) => {
            let [does, not] = only(*second);
            format!("{subject} asks for the end of its federate in {does}, but not in {not}")
        }
        Difference::End([x, y]) => {
            both("the program ends", [x, y].map(|end| format!("at {}", moment(*end))))
        }
    }
}

/// What a user may want to know about a difference besides where it is.
pub(crate) fn hint(divergence: &Divergence) -> Option<&'static str> {
    match &divergence.what {
        Difference::Body(Which::Deadline, _) | Difference::Body(_, Which::Deadline) => Some(
            "whether a deadline is met depends on physical time; with a longer one, the rest can be \
             compared",
        ),
        Difference::Read(_, [Some(a), Some(b)]) if a.remembered == b.remembered => Some(
            "the value may have been changed after it was set: reactions of one process share it, \
             and federates have copies. Set a copy of what you go on changing, and declare an input \
             that you change as mutable",
        ),
        _ => None,
    }
}

/// How much was compared, and why not all.
pub(crate) fn share(comparison: &Comparison) -> String {
    let Comparison { equal, left_out, opaque, limit, .. } = comparison;
    let mut text = format!("{equal} {} compared", plural(*equal, "reaction"));
    if *left_out > 0 {
        text.push_str(&format!(", {left_out} left out that the physical world has a part in"));
    }
    if *opaque > 0 {
        text.push_str(&format!(", {opaque} {} by type alone", plural(*opaque, "value")));
    }
    if let Some(limit) = limit {
        text.push_str(&format!(", before {}", moment(*limit)));
    }
    text
}

fn action(
    subject: &str,
    number: usize,
    calls: &[Option<Schedule>; 2],
    [a, b]: [&str; 2],
) -> String {
    let [x, y] = match calls {
        [Some(x), Some(y)] if x.action == y.action && x.at == y.at => {
            let values = [x.value.as_ref(), y.value.as_ref()];
            let with = format!("schedules {} with", x.action);
            values_of(values, &with, &format!("{with}out a value"))
        }
        calls => calls.each_ref().map(|call| match call {
            Some(call) => format!("schedules {} {}", call.action, outcome(call.at)),
            None => format!("schedules only {} {}", number - 1, plural(number - 1, "action")),
        }),
    };
    format!("{subject} {x} in {a}, and {y} in {b}")
}

/// A reaction has missed its deadline in one run only.
fn missed(subject: &str, [does, not]: [&str; 2]) -> String {
    format!("{subject} misses its deadline in {does}, but not in {not}")
}

/// What a reaction finds at one of its inputs or actions.
fn finds(from: &str, reads: &[Option<Read>; 2]) -> [String; 2] {
    let values = reads.each_ref().map(|read| read.as_ref().and_then(|read| read.value.as_ref()));
    let mut texts = values_of(values, "as", "without a value").into_iter();
    reads.each_ref().map(|read| {
        let text = texts.next().unwrap_or_default();
        match read {
            Some(Read { remembered: false, .. }) => format!("reads {from} {text}"),
            Some(_) => format!("remembers {from} {text}"),
            None => format!("finds {from} absent"),
        }
    })
}

/// Two values that differ, though their texts may not.
fn values_of(values: [Option<&Described>; 2], does: &str, does_not: &str) -> [String; 2] {
    let same = matches!(values, [Some(x), Some(y)] if x.text == y.text && x.digest != y.digest);
    let mut other = ["", if same { "another " } else { "" }].into_iter();
    values.map(|value| {
        let other = other.next().unwrap_or_default();
        value.map_or(does_not.to_owned(), |value| format!("{does} {other}{}", value.text))
    })
}

fn outcome(outcome: ScheduleOutcome) -> String {
    match outcome {
        ScheduleOutcome::At(at) => format!("for {}", moment(at)),
        ScheduleOutcome::Not(Reason::Dropped) => {
            "in vain, too close to the event before".to_owned()
        }
        ScheduleOutcome::Not(Reason::AfterStop) => "for after the end".to_owned(),
        ScheduleOutcome::Not(Reason::Suspended) => "for when its mode is active".to_owned(),
    }
}

fn body(which: Which) -> String {
    match which {
        Which::Main => "its body".to_owned(),
        Which::Deadline => "its deadline handler".to_owned(),
        Which::Tardy => "its tardy handler".to_owned(),
    }
}

fn tardy(intended: Option<At>) -> String {
    match intended {
        Some(tag) => format!("an input that came too late for {}", moment(tag)),
        None => "its inputs in time".to_owned(),
    }
}

fn plural(count: usize, noun: &str) -> String {
    if count == 1 { noun.to_owned() } else { format!("{noun}s") }
}
