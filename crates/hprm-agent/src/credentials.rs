//! What a machine has from its authority: a certificate with its name, its key, and the roster of all machines.
//!
//! `authority.rs` signs, `code.rs`, `exchange.rs`, `invite.rs` and `enroll.rs` bring a certificate to a new machine,
//! `roster.rs` says who belongs together, `files.rs` is where all of it is kept. What follows from the roster for
//! what machines may say is in `access.rs`, how it gets around in `membership.rs`.

mod authority;
mod certificate;
mod code;
mod enroll;
mod exchange;
mod files;
mod invite;
mod roster;
mod words;

use std::path::{Path, PathBuf};

use self::authority::Admission;
pub(crate) use self::roster::{Member, Roster};
pub(crate) use self::words::{Word, run};
use crate::Failure;
use crate::options::Tls;

/// The folder of an agent's credentials, and the files in it.
const FOLDER: &str = "agent";
const CERTIFICATE: &str = "machine.pem";
const KEY: &str = "machine.key";
const AUTHORITY: &str = "authority.pem";
const ROSTER: &str = "roster.json";

/// See the module.
#[derive(Clone, Debug)]
pub(crate) struct Credentials {
    folder: PathBuf,
    /// The name of this machine.
    name: String,
    /// The same, as its certificate says.
    subject: String,
    /// The key that verifies rosters.
    authority: Vec<u8>,
    roster: Roster,
    /// The roster as the authority has signed it.
    text: Vec<u8>,
}

impl Credentials {
    /// Those of this user, if this machine was enrolled.
    ///
    /// # Errors
    ///
    /// If they cannot be used, or this machine does not belong to the others any more.
    pub(crate) fn open() -> Result<Option<Self>, Failure> {
        let credentials = Self::read()?;
        credentials.as_ref().map(Self::check_membership).transpose()?;
        Ok(credentials)
    }

    /// The same, of a machine that may have been taken out.
    ///
    /// # Errors
    ///
    /// If they cannot be used.
    pub(crate) fn read() -> Result<Option<Self>, Failure> {
        // Without a folder for any credentials, there are none.
        let Ok(folder) = files::folder(FOLDER) else { return Ok(None) };
        if !folder.join(CERTIFICATE).exists() {
            return Ok(None);
        }
        files::check_key(&folder.join(KEY))?;
        let unusable = |file: &str, why: String| {
            Failure::new(format!("cannot use {}: {why}", folder.join(file).display()))
                .hint("enroll this machine again: hprm agent enroll --authority HOST:PORT")
        };
        let subject = certificate::subject(&files::read(&folder.join(CERTIFICATE))?)
            .map_err(|why| unusable(CERTIFICATE, why))?;
        let name = roster::name_of(&subject);
        let name = name.ok_or_else(|| unusable(CERTIFICATE, "it names no machine".to_owned()))?;
        let name = name.to_owned();
        let authority = certificate::public_key(&files::read(&folder.join(AUTHORITY))?)
            .map_err(|why| unusable(AUTHORITY, why))?;
        let text = files::read(&folder.join(ROSTER))?.into_bytes();
        let roster = Roster::read(&text, &authority).map_err(|why| unusable(ROSTER, why))?;
        Ok(Some(Self { folder, name, subject, authority, roster, text }))
    }

    /// Refuses credentials that do not count any more.
    ///
    /// # Errors
    ///
    /// If this machine is not on its own roster.
    pub(crate) fn check_membership(&self) -> Result<(), Failure> {
        let name = &self.name;
        if self.roster.member(name).is_some_and(|member| member.subject == self.subject) {
            return Ok(());
        }
        Err(Failure::new(format!("the authority has taken {name} out of its machines")).hint(
            format!("`hprm agent invite {name}` on the machine of the authority admits it again"),
        ))
    }

    /// Whether another roster is in the folder than this one.
    pub(crate) fn is_stale(&self) -> bool {
        files::read(&self.folder.join(ROSTER)).is_ok_and(|text| text.as_bytes() != self.text)
    }

    /// The name of this machine.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Whether this machine leads what others send.
    pub(crate) fn is_router(&self) -> bool {
        self.roster.is_router(&self.name)
    }

    /// Where the credentials are, and with them the roster when another process changes it.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// The files, for TLS.
    pub(crate) fn tls(&self) -> Tls {
        let file = |name| self.folder.join(name);
        Tls { cert: file(CERTIFICATE), key: file(KEY), ca: file(AUTHORITY) }
    }

    pub(crate) fn roster(&self) -> &Roster {
        &self.roster
    }

    /// The roster as it is signed.
    pub(crate) fn signed_roster(&self) -> &[u8] {
        &self.text
    }

    /// Whether it is a roster that the authority has signed after this one.
    pub(crate) fn is_newer(&self, text: &[u8]) -> bool {
        Roster::read(text, &self.authority).is_ok_and(|roster| roster.number > self.roster.number)
    }

    /// Keeps such a roster. Anything else changes nothing.
    ///
    /// # Errors
    ///
    /// If it cannot be kept.
    pub(crate) fn learn(&self, text: &[u8]) -> Result<(), Failure> {
        match self.is_newer(text) {
            true => files::write(&self.folder.join(ROSTER), text),
            false => Ok(()),
        }
    }

    /// Keeps what the authority has given this machine. The roster comes last: agents look at it.
    fn keep(key: &str, admission: &Admission) -> Result<Self, Failure> {
        let folder = files::folder(FOLDER)?;
        files::make(&folder)?;
        files::write(&folder.join(AUTHORITY), admission.authority.as_bytes())?;
        files::write(&folder.join(KEY), key.as_bytes())?;
        files::write(&folder.join(CERTIFICATE), admission.certificate.as_bytes())?;
        files::write(&folder.join(ROSTER), admission.roster.as_bytes())?;
        Self::open()?.ok_or_else(|| Failure::new("the certificate is gone"))
    }
}
