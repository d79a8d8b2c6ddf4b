//! A controller that is a federate of a program in Lingua Franca or Python, which names this executable: it gets what a
//! detector in Python has found, and answers.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::collections::BTreeMap;

use hprm::prelude::*;
use serde::{Deserialize, Serialize};

/// A dictionary in Python.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Found {
    label: String,
    boxes: Vec<(i32, i32)>,
    mean: f64,
}

/// Likewise.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Command {
    text: String,
    speeds: Vec<f64>,
    limits: BTreeMap<String, bool>,
    mask: Option<u8>,
}

struct Controller;

impl Reactor for Controller {
    type Ports = (InputPort<Found>, OutputPort<Command>);

    fn assemble(&mut self, controller: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (found, command) = (controller.input::<Found>("found"), controller.output("command"));
        controller.reaction().on(found).sets(command).run(move |_, ctx| {
            let Some(it) = ctx.get(found) else { return };
            println!("found {} at {:?}, mean {}", it.label, it.boxes, it.mean);
            let answer = Command {
                text: format!("turn to the {}", it.label),
                speeds: it.boxes.iter().map(|(x, _)| f64::from(*x) / 2.0).collect(),
                limits: BTreeMap::from([("safe".to_owned(), true)]),
                mask: None,
            };
            ctx.set(command, answer);
        });
        (found, command)
    }
}

fn main() -> Result<(), Failure> {
    run_as_federate("Controller", Controller)
}
