//! Which federation `hprm federate` joins, if the user does not say all about it.

use hprm::Address;

use crate::args::FederateArguments;
use crate::declare;
use crate::message::Error;
use crate::registry::{self, Record};

/// The federation on record that is meant; none if the user has said where it is and what its secret is,
/// or where it is and there is no such record.
///
/// # Errors
///
/// If the user does not say where it is, and no federation of the program runs, or several do.
pub(crate) fn running(arguments: &FederateArguments) -> Result<Option<Record>, Error> {
    let secret = &arguments.secret;
    if let Some(rti) = &arguments.rti {
        let known = secret.federation.is_some() || secret.federation_file.is_some();
        return Ok(if known { None } else { registry::at(rti) });
    }
    if secret.federation_file.is_some() {
        return Err(Error::option("the secret is not enough to find a federation")
            .hint("say where its RTI listens: --rti ADDRESS"));
    }
    let mut found = registry::of_program(&arguments.file);
    if let Some(federation) = secret.federation {
        found.retain(|record| record.federation() == Some(federation));
    }
    if found.is_empty() {
        // A mistyped path is told first.
        declare::is_readable(declare::file_of(&arguments.file))?;
    }
    one(found, &arguments.file.display().to_string()).map(Some)
}

/// Where the RTI listens.
///
/// # Errors
///
/// If what is on record is no address.
pub(crate) fn address(
    arguments: &FederateArguments,
    running: Option<&Record>,
) -> Result<Address, Error> {
    match (&arguments.rti, running) {
        (Some(rti), _) => Ok(rti.clone()),
        (None, Some(record)) => record
            .rti
            .parse()
            .map_err(|error| Error::new(format!("a federation on record: {error}"))),
        (None, None) => unreachable!("without an address, a federation has been found"),
    }
}

fn one(mut found: Vec<Record>, file: &str) -> Result<Record, Error> {
    match found.len() {
        0 => Err(Error::new(format!(
            "no federation of {file} with transient federates runs on this machine"
        ))
        .hint("start it with `hprm run`, or say where its RTI listens: --rti ADDRESS")),
        1 => Ok(found.swap_remove(0)),
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
        assert!(one(Vec::new(), "a.lf").is_err());
        assert_eq!(one(vec![record("unix:@x")], "a.lf").unwrap(), record("unix:@x"));
        let error = one(vec![record("unix:@x"), record("unix:@y")], "a.lf").unwrap_err();
        assert!(format!("{error:?}").contains("one of unix:@x, unix:@y"), "{error:?}");
    }
}
