//! The command `hprm`: what a person types to check, run and look after programs.
//!
//! It is thin. The front end checks, the RTI coordinates, Python runs the bodies; the command finds
//! them, starts them, and says in one message what went wrong. It never embeds an interpreter.

#![forbid(unsafe_code)]
// The command is where the world outside begins.
#![allow(clippy::disallowed_methods, clippy::disallowed_types)]

mod args;
mod bag;
mod bodies;
mod check;
mod columns;
#[cfg(test)]
mod commands_page;
mod compose;
mod declare;
mod diagram;
mod diff;
mod doctor;
mod draft;
mod executable;
mod explain;
mod frames;
mod generate;
mod hosts;
mod join;
mod launch;
mod launcher;
mod limits;
mod machines;
mod message;
mod new;
mod outputs;
mod parameters;
mod probe;
mod python;
mod registry;
mod remote;
mod ros;
mod roster;
mod rti;
mod run;
mod secret;
mod signals;
mod sim;
mod source;
mod threads;
mod top;
mod trace;
mod trace_file;
mod usage;
mod variables;
mod verify;
mod watching;

use std::process::ExitCode;

use crate::args::Command;

fn main() -> ExitCode {
    match limits::check_stack() {
        Ok(()) => command(),
        Err(error) => {
            error.show();
            ExitCode::FAILURE
        }
    }
}

/// What was asked for; apart, because it needs more of the stack than there may be.
#[inline(never)]
fn command() -> ExitCode {
    let words: Vec<_> = std::env::args_os().collect();
    let arguments = match variables::parse(&words) {
        Ok(arguments) => arguments,
        Err(wrong) => return usage::show(wrong, &words),
    };
    message::speak_json(match &arguments.command {
        Command::Run(run) => run.failures.json,
        Command::Rti(rti) => rti.failures.json,
        Command::Federate(federate) => federate.failures.json,
        Command::Explain(wanted) => wanted.json,
        _ => false,
    });
    if let Command::Run(run) = &arguments.command {
        message::also_write_to(run.failures_to.as_deref());
    }
    // If the system refuses, a file that is too long ends the process, as it does others.
    let _ = signals::survive_long_files();
    if let Err(wrong) = variables::obey(&arguments.command) {
        return usage::show(wrong, &words);
    }
    if let Err(error) = frames::put_into_environment(&arguments.command) {
        error.show();
        return ExitCode::FAILURE;
    }
    let outcome = match arguments.command {
        Command::New(new) => new::new(&new),
        Command::Run(run) => run::run(&run),
        Command::Check(check) => Ok(check::check(&check)),
        Command::Diagram(wanted) => diagram::diagram(&wanted),
        Command::Explain(wanted) => explain::explain(&wanted),
        Command::Diff(diff) => diff::diff(&diff),
        Command::Trace(trace) => trace_file::trace(&trace),
        Command::Verify(verify) => verify::verify(&verify),
        Command::Echo(echo) => watching::echo(&echo),
        Command::Rate(rate) => watching::rate(&rate),
        Command::Mirror(wanted) => Err(watching::become_mirror(&wanted)),
        Command::Bag(wanted) => bag::bag(&wanted),
        Command::Rti(rti) => rti::rti(rti),
        Command::Federate(federate) => run::federate(&federate),
        Command::Compose(compose) => compose::compose(&compose),
        Command::Ros(wanted) => ros::ros(&wanted),
        Command::Launch(wanted) => ros::launch(&wanted),
        Command::Top(wanted) => top::top(&wanted),
        Command::Machines(wanted) => machines::machines(&wanted),
        Command::Agent(wanted) => machines::agent(&wanted),
        Command::StandIn => remote::stand_in(),
        Command::Starter(wanted) => remote::starter(&wanted),
        Command::Sim(sim) => sim::sim(&sim),
        Command::Doctor(doctor) => doctor::doctor(&doctor),
        Command::Completions(wanted) => generate::completions(&wanted),
        Command::Man(wanted) => generate::man(&wanted),
    };
    match outcome {
        Ok(_) if message::is_unwritten() => ExitCode::FAILURE,
        Ok(code) => code,
        Err(error) => {
            error.show();
            ExitCode::FAILURE
        }
    }
}
