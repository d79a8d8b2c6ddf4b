//! Which federation `hprm federate` joins, if the user does not say all about it: the one that runs on this machine, or the
//! one whose RTI is where the program says.

use hprm::Address;
use hprm_model::Compiled;

use crate::args::FederateArguments;
use crate::declare;
use crate::message::Error;
use crate::registry::{self, Record};

/// The port of an RTI whose host is named without one, as in Lingua Franca.
const PORT: u16 = 15045;

/// What is known of the federation before the program is.
#[derive(Debug)]
pub(crate) enum Found {
    /// Where it is, by the user or by the record of a federation that runs here.
    Running(Option<Record>),
    /// Nothing, unless the program says where its RTI is; otherwise this is wrong.
    Nothing(Error),
}

/// The federation on record that is meant; no record if the user has said where it is and what its secret is,
/// or where it is and there is no such record.
///
/// # Errors
///
/// If the user does not say where it is, and several federations of the program run.
pub(crate) fn running(arguments: &FederateArguments) -> Result<Found, Error> {
    let secret = &arguments.secret;
    if let Some(rti) = &arguments.rti {
        let known = secret.federation.is_some() || secret.federation_file.is_some();
        return Ok(Found::Running(if known { None } else { registry::at(rti) }));
    }
    if secret.federation_file.is_some() {
        return Ok(Found::Nothing(
            Error::option("the secret is not enough to find a federation").hint(WHERE),
        ));
    }
    let mut found = registry::of_program(&arguments.file);
    if let Some(federation) = secret.federation {
        found.retain(|record| record.federation() == Some(federation));
    }
    if found.is_empty() {
        // A mistyped path is told first.
        declare::is_readable(declare::file_of(&arguments.file))?;
    }
    one(found, &arguments.file.display().to_string())
}

/// How a user says where the RTI is.
const WHERE: &str =
    "say where its RTI listens, --rti ADDRESS, or in the program: `federated reactor at HOST:PORT`";

/// Where the RTI listens: as the user says, on record, or as the program says.
///
/// # Errors
///
/// If what is on record, or what the program says, is no address.
pub(crate) fn address(
    arguments: &FederateArguments,
    running: Option<&Record>,
    program: Option<&Compiled>,
) -> Result<Address, Error> {
    if let Some(rti) = &arguments.rti {
        return Ok(rti.clone());
    }
    let (what, text) = match (running, program.and_then(|it| it.rti_host.as_ref())) {
        (Some(record), _) => ("a federation on record", record.rti.clone()),
        (None, Some(host)) => ("where the program has its RTI", host_and_port(host)),
        (None, None) => unreachable!("without an address, a federation has been found"),
    };
    text.parse().map_err(|error| Error::new(format!("{what}: {error}")))
}

/// A host as programs write it, `user@host:port`, as an address.
fn host_and_port(host: &str) -> String {
    let host = host.rsplit_once('@').map_or(host, |(_, host)| host);
    let has_port = match host.rsplit_once(':') {
        Some((name, _)) => !name.starts_with('[') || name.ends_with(']'),
        None => false,
    };
    if has_port { format!("tcp:{host}") } else { format!("tcp:{host}:{PORT}") }
}

fn one(mut found: Vec<Record>, file: &str) -> Result<Found, Error> {
    match found.len() {
        0 => Ok(Found::Nothing(
            Error::new(format!(
                "no federation of {file} with transient federates runs on this machine"
            ))
            .hint(format!("start it with `hprm run`, or {WHERE}")),
        )),
        1 => Ok(Found::Running(Some(found.swap_remove(0)))),
        count => {
            let addresses: Vec<_> = found.iter().map(|record| record.rti.as_str()).collect();
            Err(Error::option(format!("{count} federations of {file} run on this machine"))
                .hint(format!("say which: --rti ADDRESS, one of {}", addresses.join(", "))))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use clap::Parser;
    use hprm::FederationId;

    use super::*;
    use crate::args::{Arguments, Command};

    #[test]
    fn a_program_that_is_not_there_is_told_first() {
        let words = ["hprm", "federate", "/nowhere/Main.lf", "motor"];
        let Command::Federate(arguments) = Arguments::parse_from(words).command else {
            panic!("another command")
        };
        let error = format!("{:?}", running(&arguments).unwrap_err());
        assert!(error.contains("cannot read /nowhere/Main.lf: No such file"), "{error}");
    }

    #[test]
    fn of_several_federations_none_is_chosen() {
        let record = |rti: &str| {
            let rti = rti.parse().unwrap();
            Record::new(Path::new("/a.lf"), &rti, FederationId(1), Vec::new(), Path::new("python3"))
        };
        assert!(matches!(one(Vec::new(), "a.lf").unwrap(), Found::Nothing(_)));
        let found = one(vec![record("unix:@x")], "a.lf").unwrap();
        assert!(matches!(found, Found::Running(Some(it)) if it == record("unix:@x")));
        let error = one(vec![record("unix:@x"), record("unix:@y")], "a.lf").unwrap_err();
        assert!(format!("{error:?}").contains("one of unix:@x, unix:@y"), "{error:?}");
    }

    #[test]
    fn a_host_has_the_port_that_is_stated_or_that_of_lingua_franca() {
        for (host, address) in [
            ("rti.local", "tcp:rti.local:15045"),
            ("pi@rti.local", "tcp:rti.local:15045"),
            ("rti.local:7", "tcp:rti.local:7"),
            ("pi@10.0.0.1:7", "tcp:10.0.0.1:7"),
            ("[::1]", "tcp:[::1]:15045"),
            ("pi@[::1]:7", "tcp:[::1]:7"),
        ] {
            assert_eq!(host_and_port(host), address);
            assert_eq!(host_and_port(host).parse::<Address>().unwrap().to_string(), address);
        }
    }
}
