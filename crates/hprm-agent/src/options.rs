//! What the command line may say, and what of it is refused.

use std::fs::File;
use std::io::Write;
use std::net::{SocketAddr, ToSocketAddrs};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use clap::Parser;
use hprm::agent::is_name;

use crate::Failure;
use crate::credentials::{Credentials, Word, lifetime_of, now};
use crate::limits::Limits;

/// Lead links between processes of federations on different machines, through Zenoh.
///
/// One agent runs on each machine. A process reaches one on another machine by the address agent:MACHINE/NAME:
/// `hprm rti --listen agent:robot1/rti` on one machine, `hprm federate --rti agent:robot1/rti` on the others.
/// `hprm machines` lists the machines whose agents see one another.
#[derive(Parser, Debug)]
#[command(name = "hprm-agent", version, args_conflicts_with_subcommands = true)]
pub(crate) struct Arguments {
    /// What to do instead of running an agent
    #[command(subcommand)]
    pub(crate) word: Option<Word>,
    /// The name of this machine; by default as it was enrolled, or its host name
    #[arg(long)]
    name: Option<String>,
    /// Where other agents reach this one; by default 0.0.0.0:7650 if it has a certificate, and 127.0.0.1:7650 otherwise
    #[arg(long, value_name = "HOST:PORT")]
    listen: Vec<String>,
    /// Where another agent listens
    #[arg(long, value_name = "HOST:PORT")]
    connect: Vec<String>,
    /// Connect only where --connect says, and not also where agents listen of which those tell
    #[arg(long)]
    connect_only: bool,
    /// Lead what agents send to one another that reach this one, but not one another; a machine that was enrolled is a
    /// router if it was invited as one
    #[arg(long)]
    router: bool,
    /// The certificate of this machine, in PEM, instead of that with which it was enrolled
    #[arg(long, value_name = "FILE", requires_all = ["tls_key", "tls_ca"])]
    tls_cert: Option<PathBuf>,
    /// Its key
    #[arg(long, value_name = "FILE", requires_all = ["tls_cert", "tls_ca"])]
    tls_key: Option<PathBuf>,
    /// Certificates of the authorities that have signed those of all agents
    #[arg(long, value_name = "FILE", requires_all = ["tls_cert", "tls_key"])]
    tls_ca: Option<PathBuf>,
    /// Start programs for those who have one of the keys in this file; it is made, with a key, if it is missing
    #[arg(long, value_name = "FILE")]
    fleet_keys: Option<PathBuf>,
    /// Start programs also as root
    #[arg(long, requires = "fleet_keys")]
    allow_root: bool,
    #[command(flatten)]
    limits: Limits,
}

/// How an agent runs, checked.
#[derive(Debug)]
pub(crate) struct Options {
    pub(crate) name: String,
    pub(crate) listen: Vec<String>,
    pub(crate) connect: Vec<String>,
    /// Whether it connects nowhere else.
    pub(crate) connect_only: bool,
    /// Whether it is asked to be a router.
    router: bool,
    pub(crate) tls: Option<Tls>,
    /// What this machine has from its authority, if it was enrolled.
    pub(crate) credentials: Option<Credentials>,
    pub(crate) programs: Option<Programs>,
}

/// For whom the agent starts programs.
#[derive(Clone, Debug)]
pub(crate) struct Programs {
    /// The file with their keys.
    pub(crate) keys: PathBuf,
    pub(crate) allow_root: bool,
    pub(crate) limits: Limits,
}

/// The files of a certificate.
#[derive(Debug)]
pub(crate) struct Tls {
    pub(crate) cert: PathBuf,
    pub(crate) key: PathBuf,
    pub(crate) ca: PathBuf,
}

impl Arguments {
    /// Refuses what would let other machines in without a certificate, and names that cannot be used.
    pub(crate) fn check(self) -> Result<Options, Failure> {
        let credentials = match self.tls_cert {
            Some(_) => None,
            None => Credentials::open_newest()?,
        };
        let name = name(self.name, credentials.as_ref())?;
        if !is_name(&name) {
            return Err(Failure::new(format!("'{name}' cannot be the name of a machine"))
                .hint("write --name NAME with letters, digits, and '-', '_' or '.' between them"));
        }
        if let Some(credentials) = credentials.as_ref().filter(|it| self.router && !it.is_router())
        {
            let name = credentials.name();
            return Err(Failure::new(format!("{name} was not invited as a router")).hint(format!(
                "`hprm agent invite {name} --router` on the authority's machine makes it one; \
                     a router can read and change what it leads"
            )));
        }
        let tls = match (self.tls_cert, self.tls_key, self.tls_ca) {
            (Some(cert), Some(key), Some(ca)) => Some(Tls { cert, key, ca }),
            _ => credentials.as_ref().map(Credentials::tls),
        };
        let listen = match self.listen.is_empty() {
            false => self.listen,
            true if tls.is_some() => vec!["0.0.0.0:7650".to_owned()],
            true => vec!["127.0.0.1:7650".to_owned()],
        };
        if let Some(tls) = tls.as_ref().filter(|_| credentials.is_none()) {
            lifetime_of(&name, tls).map_or(Ok(()), |it| it.check(now()))?;
        }
        for file in tls.iter().flat_map(|tls| [&tls.cert, &tls.key, &tls.ca]) {
            std::fs::read(file).map_err(|error| {
                Failure::new(format!("cannot read {}: {error}", file.display()))
            })?;
        }
        for (place, what) in listen
            .iter()
            .map(|place| (place, "listen at"))
            .chain(self.connect.iter().map(|place| (place, "connect to")))
        {
            if tls.is_none() && !is_loopback(place)? {
                return Err(Failure::new(format!(
                    "the agent does not {what} {place} without a certificate: other machines reach that, and could \
                     read and change what federates send"
                ))
                .hint(
                    "enroll this machine, with `hprm agent enroll`, or name the files: --tls-cert, --tls-key and --tls-ca",
                ));
            }
        }
        let (allow_root, limits) = (self.allow_root, self.limits);
        let programs = self.fleet_keys.map(|keys| {
            make_keys(&keys)?;
            // The agent may change its folder, and what it starts has another one.
            let keys = std::path::absolute(&keys).unwrap_or(keys);
            Ok(Programs { keys, allow_root, limits })
        });
        let programs = programs.transpose()?;
        let Self { connect, connect_only, router, .. } = self;
        Ok(Options { name, listen, connect, connect_only, router, tls, credentials, programs })
    }
}

impl Options {
    /// Whether the agent leads what others send, with these credentials: the authority says so, or else the command line.
    pub(crate) fn is_router(&self, credentials: Option<&Credentials>) -> bool {
        credentials.map_or(self.router, Credentials::is_router)
    }
}

/// What this machine is called: as in its certificate, if it was enrolled.
fn name(stated: Option<String>, credentials: Option<&Credentials>) -> Result<String, Failure> {
    let Some(credentials) = credentials else { return Ok(stated.unwrap_or_else(host_name)) };
    let enrolled = credentials.name();
    match stated {
        Some(stated) if stated != enrolled => Err(Failure::new(format!(
            "this machine was enrolled as {enrolled}, and not as {stated}"
        ))
        .hint(format!(
            "`hprm agent invite {stated}` on the authority's machine gives it that name"
        ))),
        _ => Ok(enrolled.to_owned()),
    }
}

/// Whether only processes of this machine reach an address.
fn is_loopback(place: &str) -> Result<bool, Failure> {
    let wrong = |error: &dyn std::fmt::Display| {
        Failure::new(format!("'{place}' is no address: {error}")).hint("write HOST:PORT")
    };
    if let Ok(address) = place.parse::<SocketAddr>() {
        return Ok(address.ip().is_loopback());
    }
    let mut addresses = place.to_socket_addrs().map_err(|error| wrong(&error))?;
    Ok(addresses.all(|address| address.ip().is_loopback()))
}

/// Makes a file with a key, unless there is such a file; others must not read it.
fn make_keys(path: &Path) -> Result<(), Failure> {
    let failed = |error: std::io::Error| {
        Failure::new(format!("cannot use the fleet keys in {}: {error}", path.display()))
    };
    let options = File::options().write(true).create_new(true).mode(0o600).open(path);
    match options {
        Ok(mut file) => {
            let key =
                hprm::random_federation().map_err(|error| Failure::new(error.report().message))?;
            writeln!(file, "{key}").map_err(failed)
        }
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {
            let mode = std::fs::metadata(path).map_err(failed)?.permissions().mode();
            if mode & 0o077 != 0 {
                let text = format!("others can read the fleet keys in {}", path.display());
                return Err(Failure::new(text).hint(format!("chmod 600 {}", path.display())));
            }
            Ok(())
        }
        Err(error) => Err(failed(error)),
    }
}

/// The first part of the name of this host.
pub(crate) fn host_name() -> String {
    let name = rustix::system::uname().nodename().to_string_lossy().into_owned();
    name.split('.').next().unwrap_or_default().to_owned()
}
