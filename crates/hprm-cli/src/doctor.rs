//! `hprm doctor`: whether this machine has what HPRM needs.
//!
//! What is looked at is [`probe`](crate::probe)'s business; this shows it.

use std::io;
use std::process::ExitCode;

use serde_json::json;

use crate::args::Doctor;
use crate::message::{self, Error};
use crate::probe::{self, Finding, Health};

/// Looks at the machine and shows what it finds.
///
/// # Errors
///
/// None; what is missing is a finding.
pub(crate) fn doctor(arguments: &Doctor) -> Result<ExitCode, Error> {
    let findings = probe::all(&arguments.interpreter);
    let color = message::color(&io::stdout());
    for finding in &findings {
        let line = if arguments.json { as_json(finding) } else { as_text(finding, color) };
        message::print_line(&line);
    }
    let bad = findings.iter().any(|finding| finding.health == Health::Bad);
    Ok(if bad { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn as_json(finding: &Finding) -> String {
    let health = match finding.health {
        Health::Good => "good",
        Health::Poor => "poor",
        Health::Bad => "bad",
    };
    let Finding { subject, text, hint, .. } = finding;
    json!({ "subject": subject, "health": health, "text": text, "hint": hint }).to_string()
}

fn as_text(finding: &Finding, color: bool) -> String {
    let (mark, paint) = match finding.health {
        Health::Good => ("ok  ", "\x1b[32m"),
        Health::Poor => ("poor", "\x1b[33m"),
        Health::Bad => ("bad ", "\x1b[31m"),
    };
    let mark = if color { format!("{paint}{mark}\x1b[0m") } else { mark.to_owned() };
    let Finding { subject, text, hint, .. } = finding;
    let hint = hint.map(|hint| format!("\n      hint: {hint}")).unwrap_or_default();
    format!("{mark}  {subject:<14} {text}{hint}")
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    #[test]
    fn a_finding_is_a_line_and_perhaps_a_hint() {
        let mut finding = Finding {
            subject: "numpy",
            health: Health::Poor,
            text: "missing".to_owned(),
            hint: Some("install it"),
        };
        assert_eq!(
            as_text(&finding, false),
            "poor  numpy          missing\n      hint: install it"
        );
        // In which order the members are written is up to how serde_json was built.
        let json: Value = serde_json::from_str(&as_json(&finding)).unwrap();
        let expected =
            json!({"health": "poor", "hint": "install it", "subject": "numpy", "text": "missing"});
        assert_eq!(json, expected);
        (finding.health, finding.hint) = (Health::Good, None);
        assert_eq!(as_text(&finding, true), "\x1b[32mok  \x1b[0m  numpy          missing");
    }
}
