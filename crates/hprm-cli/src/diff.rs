//! `hprm diff`: where two logical traces part.

use std::process::ExitCode;

use hprm::trace::line::{End, RunEnding};
use hprm::trace::{Digest, Reader};
use serde_json::{Value, json};

use crate::args;
use crate::message::{self, Error, print_line};
use crate::trace::{Comparison, Judge, clocks, digest, hint, moment, processes, sentence, share};

/// The exit code for traces that differ.
pub(crate) const DIVERGENCE: u8 = 3;

/// Compares two traces.
///
/// # Errors
///
/// If one cannot be read, or they are of different programs.
pub(crate) fn diff(arguments: &args::Diff) -> Result<ExitCode, Error> {
    message::or_json(arguments.verdict.json, compare(arguments))
}

fn compare(arguments: &args::Diff) -> Result<ExitCode, Error> {
    let judge = Judge { physical: arguments.verdict.physical };
    let (mut a, mut b) = (Reader::open(&arguments.a)?, Reader::open(&arguments.b)?);
    let comparison = judge.compare(&mut a, &mut b)?;
    let names = [a.name.as_str(), b.name.as_str()];
    let ends = [(&a.name, &a.end, a.whole), (&b.name, &b.end, b.whole)];
    let ends = ends.map(|(name, end, whole)| (name.as_str(), end, whole));
    let cut = ends.iter().filter(|(_, _, whole)| !whole);
    // One that breaks off does not say how its run ended.
    let has_failed = |end: &End, whole| whole && end.outcome == RunEnding::Failed;
    let failed = ends.iter().filter(|(_, end, whole)| has_failed(end, *whole));
    let marked = ends.iter().filter(|(_, end, _)| end.physical);
    let incomplete = ends.iter().filter(|(_, end, _)| !end.missing.is_empty());
    if arguments.verdict.json {
        let mut verdict = as_json(&comparison, names);
        verdict["clocks"] = marked.map(|(name, ..)| json!(name)).collect();
        let missing = incomplete.map(|(name, end, _)| ((*name).to_owned(), json!(end.missing)));
        verdict["missing"] = missing.collect();
        verdict["cut"] = cut.map(|(name, ..)| json!(name)).collect();
        verdict["failed"] = failed.map(|(name, ..)| json!(name)).collect();
        print_line(&verdict.to_string());
    } else {
        for (name, end, _) in cut {
            let end = moment(end.end);
            let what = format!("{name} breaks off at {end}: what came then is not compared");
            Error::new(what).show_as_warning();
        }
        for (name, end, _) in failed {
            let end = moment(end.end);
            let what =
                format!("the run of {name} has failed at {end}: later tags are not compared");
            Error::new(what).show_as_warning();
        }
        for (name, end, _) in incomplete {
            let what = format!("{name} has nothing of {}", processes(&end.missing));
            Error::new(what).show_as_warning();
        }
        let marked: Vec<&str> = marked.map(|(name, ..)| *name).collect();
        if let Some(line) = clocks(&marked) {
            print_line(&line);
        }
        match &comparison.divergence {
            Some(divergence) => {
                print_line(&sentence(divergence, names));
                print_more(&comparison, names);
            }
            None => print_line(&format!("equal: {}", share(&comparison))),
        }
    }
    Ok(exit_code(&comparison))
}

/// Zero if there is no divergence.
pub(crate) fn exit_code(comparison: &Comparison) -> ExitCode {
    match comparison.divergence {
        Some(_) => ExitCode::from(DIVERGENCE),
        None => ExitCode::SUCCESS,
    }
}

/// Prints what else is of use about a difference.
pub(crate) fn print_more(comparison: &Comparison, names: [&str; 2]) {
    if let Some(consequence) = &comparison.consequence {
        print_line(&format!("  then: {}", sentence(consequence, names)));
    }
    if let Some(hint) = comparison.divergence.as_ref().and_then(hint) {
        print_line(&format!("  hint: {hint}"));
    }
}

/// A comparison for machines.
pub(crate) fn as_json(comparison: &Comparison, names: [&str; 2]) -> Value {
    let divergence = comparison.divergence.as_ref().map(|divergence| {
        json!({
            "tag": [divergence.tag.0, divergence.tag.1],
            "reaction": divergence.reaction,
            "name": divergence.name,
            "message": sentence(divergence, names),
            "consequence": comparison.consequence.as_ref().map(|then| sentence(then, names)),
            "hint": hint(divergence),
        })
    });
    json!({
        "equal": divergence.is_none(),
        "reactions": comparison.equal,
        "left_out": comparison.left_out,
        "opaque_values": comparison.opaque,
        "before": comparison.limit.map(|limit| json!([limit.0, limit.1])),
        "divergence": divergence,
    })
}

/// One number for what was compared of a trace.
///
/// # Errors
///
/// If it cannot be read.
pub(crate) fn hash(
    path: &std::path::Path,
    judge: Judge,
    comparison: &Comparison,
) -> Result<Digest, Error> {
    digest(judge, &mut Reader::open(path)?, comparison.limit)
}

/// What was compared, in words, and up to where.
pub(crate) fn extent(comparison: &Comparison) -> String {
    match comparison.limit {
        Some(limit) if comparison.equal == 0 => format!("nothing before {}", moment(limit)),
        _ => share(comparison),
    }
}
