//! Which federates `hprm run` starts on which other machines.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use hprm::agent::{self, Machine, Place};
use hprm_core::{FederateId, Program};

use super::stand_in::probe;
use super::{clocks, key};
use crate::args::{At, FLEET_KEY};
use crate::hosts::is_this_machine;
use crate::message::{self, Error};

/// How long machines may take to meet: their agents connect again when one of them has been enrolled or taken out.
const MEETING: Duration = Duration::from_secs(4);
const PAUSE: Duration = Duration::from_millis(200);

/// The federates that are to run on other machines.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Places {
    machines: BTreeMap<FederateId, String>,
    /// This machine, as its agent is named.
    here: String,
    /// The file with the key that those machines know.
    key: PathBuf,
}

impl Places {
    /// The machine of a federate that is not to run on this one.
    pub(crate) fn machine_of(&self, federate: FederateId) -> Option<&str> {
        self.machines.get(&federate).map(String::as_str)
    }

    /// Refuses the terminal to a federate of another machine.
    ///
    /// # Errors
    ///
    /// If it is to have it.
    pub(crate) fn refuse_terminal(
        &self,
        program: &Program,
        debugged: Option<FederateId>,
    ) -> Result<(), Error> {
        let elsewhere = debugged.and_then(|it| Some((it, self.machine_of(it)?)));
        let Some((federate, machine)) = elsewhere else { return Ok(()) };
        let name = &program.federates[federate].name;
        let what =
            format!("--debug: the federate {name} is to run on {machine}, without a terminal");
        Err(Error::option(what).hint(format!("--at {name}=localhost runs it here")))
    }

    /// The file with the key.
    pub(crate) fn key(&self) -> &Path {
        &self.key
    }

    /// A listener of this machine that others reach.
    pub(crate) fn listener(&self, name: String) -> hprm::Address {
        hprm::Address::Agent(Place { machine: self.here.clone(), name })
    }
}

/// Refuses a key that cannot be read and that an option names, also if no federate turns out to need it. The environment
/// names one for all programs, most of which need none.
///
/// # Errors
///
/// What is wrong with its file.
pub(crate) fn check_key(wanted: &At) -> Result<(), Error> {
    let is_environment = |key: &PathBuf| {
        std::env::var_os(FLEET_KEY).is_some_and(|set| set.as_os_str() == key.as_os_str())
    };
    let stated = wanted.fleet_key.as_ref().filter(|key| !is_environment(key));
    stated.map_or(Ok(()), |key| key::read(key).map(drop))
}

/// Where the federates of a program are to run, if any of them is to run on another machine: what the program says
/// (`at`), or what is asked for instead. Agents are asked only if a key is given.
///
/// # Errors
///
/// If there is no such federate or machine, or no key for it.
pub(crate) fn places(program: &Program, wanted: &At) -> Result<Option<Places>, Error> {
    let stated = stated(program, &wanted.at)?;
    let Some(key) = &wanted.fleet_key else {
        return match wanted.at.iter().find(|(_, machine)| !is_this_machine(machine)) {
            Some((federate, machine)) => Err(no_key(federate, machine)),
            None => Ok(None),
        };
    };
    let mut machines = stated;
    for (id, federate) in program.federates.iter() {
        if let Some(host) = federate.host.as_ref().filter(|host| !is_this_machine(host)) {
            machines.entry(id).or_insert_with(|| without_user(host).to_owned());
        }
    }
    if machines.values().all(|machine| is_this_machine(machine)) {
        return Ok(None);
    }
    // Before agents are asked.
    key::read(key)?;
    let known = known(&machines)?;
    let here = known.iter().find(|machine| machine.is_here).map(|here| here.name.clone());
    let here = here.ok_or_else(|| Error::new("the agent of this machine does not name it"))?;
    machines.retain(|_, machine| *machine != here && !is_this_machine(machine));
    for (federate, machine) in &machines {
        check(&program.federates[*federate].name, machine, &known)?;
    }
    let mut asked: Vec<_> = machines.values().collect();
    asked.sort();
    asked.dedup();
    asked.into_iter().try_for_each(|machine| probe(machine, key))?;
    let machine_of = |federate| machines.get(&federate).map(String::as_str);
    for warning in clocks::warnings(program, &here, machine_of, &known) {
        warning.show_as_warning();
    }
    let places = Places { machines, here, key: key.clone() };
    Ok((!places.machines.is_empty()).then_some(places))
}

/// The machines that the agent of this one knows, once it knows all that are named; or after a moment without some of them.
fn known(named: &BTreeMap<FederateId, String>) -> Result<Vec<Machine>, Error> {
    let until = Instant::now() + MEETING;
    loop {
        let known = agent::machines().map_err(|error| {
            let why = message::reason(&error);
            Error::new(format!("federates cannot run on other machines: {why}"))
        })?;
        let is_there = |name: &String| {
            is_this_machine(name) || known.iter().any(|it| it.name == *name && it.about.is_some())
        };
        if named.values().all(is_there) || Instant::now() >= until {
            return Ok(known);
        }
        thread::sleep(PAUSE);
    }
}

/// What `--at` says, federate by federate.
fn stated(
    program: &Program,
    at: &[(String, String)],
) -> Result<BTreeMap<FederateId, String>, Error> {
    let mut machines = BTreeMap::new();
    for (name, machine) in at {
        let meant: Vec<_> = program.federates_meant(name).collect();
        if meant.is_empty() {
            let names: Vec<_> = program.federates.values().map(|it| it.name.as_str()).collect();
            return Err(Error::option(format!(
                "--at {name}={machine}: no federate is called {name}"
            ))
            .hint(format!("the federates are {}", names.join(", "))));
        }
        machines.extend(meant.into_iter().map(|id| (id, machine.clone())));
    }
    Ok(machines)
}

fn check(federate: &str, machine: &str, known: &[Machine]) -> Result<(), Error> {
    let wrong = |why: String| {
        Err(Error::new(format!("federate {federate} cannot run on {machine}: {why}"))
            .hint("`hprm machines` lists the machines; --at FEDERATE=MACHINE names another one"))
    };
    match known.iter().find(|it| it.name == machine) {
        Some(Machine { about: Some(_), .. }) => Ok(()),
        Some(_) => wrong("its agent does not answer".to_owned()),
        None => {
            let names: Vec<_> = known.iter().map(|it| it.name.as_str()).collect();
            wrong(format!("no agent has that name; there are: {}", names.join(", ")))
        }
    }
}

fn no_key(federate: &str, machine: &str) -> Error {
    Error::option(format!("--at {federate}={machine} needs a fleet key")).hint(
        "name the file that the agent of that machine has, --fleet-key FILE, or set HPRM_FLEET_KEY \
         (handbook page howto/agents)",
    )
}

/// The name or address in `user@host:port`.
fn without_user(host: &str) -> &str {
    let host = host.rsplit_once('@').map_or(host, |(_, host)| host);
    match host.rsplit_once(':') {
        Some((name, port)) if port.parse::<u16>().is_ok() && !name.contains(':') => name,
        _ => host,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn program() -> Program {
        let mut b = hprm_core::ProgramBuilder::new("Main", hprm_core::Properties::default());
        for name in ["camera", "sink__0", "sink__1", "sink__x"] {
            let reactor = b.reactor(b.main(), name);
            b.federate(reactor, name, 0, None);
        }
        b.build().unwrap()
    }

    fn at(federate: &str) -> Vec<(String, String)> {
        vec![(federate.to_owned(), "robot1".to_owned())]
    }

    #[test]
    fn a_bank_has_all_of_its_members_on_a_machine_unless_one_is_named() {
        let count = |name| stated(&program(), &at(name)).unwrap().len();
        assert_eq!((count("camera"), count("sink"), count("sink[1]")), (1, 2, 1));
        for name in ["sin", "sink__", "sink__2", "camera__0"] {
            let error = stated(&program(), &at(name)).unwrap_err();
            assert!(format!("{error:?}").contains("the federates are camera, sink__0"), "{name}");
        }
    }

    #[test]
    fn hosts_have_names() {
        for (host, name) in [
            ("robot1", "robot1"),
            ("pi@robot1:22", "robot1"),
            ("192.0.2.1:15045", "192.0.2.1"),
            ("fe80::1", "fe80::1"),
        ] {
            assert_eq!(without_user(host), name);
        }
    }

    #[test]
    fn machines_are_known_before_anything_starts() {
        let machine = |name: &str, about| Machine {
            name: name.to_owned(),
            is_here: false,
            about,
            clock: None,
            through: None,
        };
        let known = [machine("robot1", None), machine("robot2", None)];
        let error = |name| format!("{:?}", check("camera", name, &known).unwrap_err());
        assert!(error("robot1").contains("its agent does not answer"));
        assert!(error("robot9").contains("there are: robot1, robot2"));
    }
}
