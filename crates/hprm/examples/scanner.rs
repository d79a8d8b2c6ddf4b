//! A federate with parameters of many types, of a program in Lingua Franca or Python, which names this executable.
//!
//! It sends, every period, what it was given, and which of how many scans this is.

use std::collections::BTreeMap;
use std::time::Duration;

use hprm::prelude::*;
use serde::Deserialize;

/// What the program states.
#[derive(Debug, Deserialize)]
struct Settings {
    /// Not zero: a value that is no period is told when the program is checked.
    period: Period,
    name: String,
    #[serde(default)]
    bank_index: usize,
    #[serde(default)]
    gains: Vec<f64>,
    corner: Option<(i32, i32)>,
    #[serde(default)]
    labels: BTreeMap<String, u8>,
    #[serde(default)]
    is_fine: bool,
}

/// A time that is not zero.
#[derive(Debug, Deserialize)]
#[serde(try_from = "Duration")]
struct Period(Duration);

impl TryFrom<Duration> for Period {
    type Error = &'static str;

    fn try_from(period: Duration) -> Result<Self, Self::Error> {
        if period.is_zero() { Err("a period is not zero") } else { Ok(Self(period)) }
    }
}

struct Scanner(Settings);

impl Reactor for Scanner {
    type Ports = OutputPort<String>;

    fn assemble(&mut self, scanner: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let scan = scanner.output("scan");
        let tick = scanner.timer("tick", Duration::ZERO, self.0.period.0);
        let mut count = 0;
        scanner.reaction().on(tick).sets(scan).run(move |Self(given), ctx| {
            count += 1;
            let Settings { name, bank_index, gains, corner, labels, is_fine, .. } = given;
            let text =
                format!("{name} {bank_index} {count} {gains:?} {corner:?} {labels:?} {is_fine}");
            ctx.set(scan, text);
        });
        scan
    }
}

fn main() -> Result<(), Failure> {
    run_as_federate_with("Scanner", Scanner)
}
