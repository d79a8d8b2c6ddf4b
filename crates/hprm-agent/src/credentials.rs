//! What a machine has from its authority: a certificate with its name, its key, and the roster of all machines.
//!
//! `authority.rs` signs, `code.rs`, `exchange.rs`, `invite.rs` and `enroll.rs` bring a certificate to a new machine,
//! `roster.rs` says who belongs together, `certificate.rs` reads and judges certificates, `lifetime.rs` says when they
//! end and what then, `bundle.rs` is what is known of those of all machines, `files.rs` is where all of it is kept. What
//! follows from the roster for what machines may say is in `access.rs`, how it gets around in `membership.rs`, and how renewed
//! certificates do in `renewal.rs`.

mod authority;
mod bundle;
mod certificate;
mod code;
mod enroll;
mod exchange;
mod files;
mod invite;
mod lifetime;
mod roster;
mod words;

#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use self::authority::Admission;
use self::bundle::Bundle;
pub(crate) use self::bundle::LIMIT as BUNDLE_LIMIT;
use self::certificate::Anchor;
pub(crate) use self::certificate::Certificate;
pub(crate) use self::lifetime::{Lifetime, Notice, now};
pub(crate) use self::roster::{Member, Roster};
pub(crate) use self::words::{Word, renew_due, run};
use crate::Failure;
use crate::options::Tls;

/// The folder of an agent's credentials, and the files in it.
const FOLDER: &str = "agent";
const CERTIFICATE: &str = "machine.pem";
const KEY: &str = "machine.key";
const AUTHORITY: &str = "authority.pem";
const ROSTER: &str = "roster.json";
const CERTIFICATES: &str = "certificates.pem";

/// See the module.
#[derive(Clone, Debug)]
pub(crate) struct Credentials {
    folder: PathBuf,
    /// The name of this machine.
    name: String,
    certificate: Certificate,
    /// What verifies rosters and certificates.
    authority: Anchor,
    roster: Roster,
    /// The roster as the authority has signed it.
    text: Vec<u8>,
    /// The certificates of all machines, as far as they are known. Clones share them.
    bundle: Arc<Mutex<Bundle>>,
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
        Self::read_in(folder, None)
    }

    /// The same once more, when something in their folder has changed. What is known of certificates is not verified again.
    ///
    /// # Errors
    ///
    /// If they cannot be used.
    pub(crate) fn read_again(&self) -> Result<Option<Self>, Failure> {
        Self::read_in(self.folder.clone(), Some(self))
    }

    fn read_in(folder: PathBuf, before: Option<&Self>) -> Result<Option<Self>, Failure> {
        if !folder.join(CERTIFICATE).exists() {
            return Ok(None);
        }
        files::check_key(&folder.join(KEY))?;
        let unusable = |file: &str, why: String| {
            files::unusable(&folder.join(file), &why)
                .hint("enroll this machine again: hprm agent enroll --authority HOST:PORT")
        };
        let certificate = Certificate::read(&files::read(&folder.join(CERTIFICATE))?)
            .map_err(|why| unusable(CERTIFICATE, why))?;
        let name = roster::name_of(&certificate.subject);
        let name = name.ok_or_else(|| unusable(CERTIFICATE, "it names no machine".to_owned()))?;
        let name = name.to_owned();
        let authority = Anchor::read(&files::read(&folder.join(AUTHORITY))?)
            .map_err(|why| unusable(AUTHORITY, why))?;
        let text = files::read(&folder.join(ROSTER))?.into_bytes();
        let roster = Roster::read(&text, &authority.key).map_err(|why| unusable(ROSTER, why))?;
        let before = before.filter(|it| it.authority.key == authority.key);
        let mut bundle = before.map_or_else(Bundle::default, |it| it.bundle().clone());
        bundle.retain(&roster);
        let bundle = Arc::new(Mutex::new(bundle));
        let read = Self { folder, name, certificate, authority, roster, text, bundle };
        // Others are told of nothing that they would refuse.
        let own = read.news(read.certificate.pem().as_bytes()).unwrap_or_default();
        read.bundle().take(own);
        // A file that is wrong is told when it is looked at; without it, others have the certificates.
        let _ = read.look_at_bundle();
        Ok(Some(read))
    }

    /// The same for an agent, which needs a certificate that has not ended: the newest one that is in the folder, where it may
    /// have been brought by hand.
    ///
    /// # Errors
    ///
    /// If the certificate of this machine has ended all the same, and as [`Self::open`].
    pub(crate) fn open_newest() -> Result<Option<Self>, Failure> {
        let Some(credentials) = Self::open()? else { return Ok(None) };
        credentials.adopt()?;
        credentials.lifetime().check(now())?;
        Self::open()
    }

    /// Refuses credentials that do not count any more.
    ///
    /// # Errors
    ///
    /// If this machine is not on its own roster.
    pub(crate) fn check_membership(&self) -> Result<(), Failure> {
        let name = &self.name;
        if self.roster.member(name).is_some_and(|member| member.subject == self.certificate.subject)
        {
            return Ok(());
        }
        Err(Failure::new(format!("the authority has taken {name} out of its machines")).hint(
            format!("`hprm agent invite {name}` on the machine of the authority admits it again"),
        ))
    }

    /// Whether another roster is in the folder than this one, or another certificate of this machine.
    pub(crate) fn is_stale(&self) -> bool {
        let certificate = files::read(&self.folder.join(CERTIFICATE));
        let certificate = certificate.ok().and_then(|text| Certificate::read(&text).ok());
        files::read(&self.folder.join(ROSTER)).is_ok_and(|text| text.as_bytes() != self.text)
            || certificate.is_some_and(|certificate| certificate != self.certificate)
    }

    /// Until which day the certificate of this machine is valid, if that was less long before.
    pub(crate) fn renewed_since(&self, before: &Self) -> Option<String> {
        let (ends, before) = (self.certificate.ends, before.certificate.ends);
        (ends > before).then(|| lifetime::date(ends))
    }

    /// Until when the certificate of this machine is valid.
    pub(crate) fn lifetime(&self) -> Lifetime {
        // It may just have been renewed.
        let end = std::fs::read(self.folder.join(CERTIFICATE)).ok();
        let end = end.and_then(|text| certificate::end(&text).ok());
        Lifetime {
            name: self.name.clone(),
            ends: end.unwrap_or(self.certificate.ends),
            authority_ends: Some(self.authority.ends),
        }
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
        tls_in(&self.folder)
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
        Roster::read(text, &self.authority.key)
            .is_ok_and(|roster| roster.number > self.roster.number)
    }

    /// Keeps a roster that is newer than this one, and than any that has been kept since. Anything else changes nothing.
    ///
    /// # Errors
    ///
    /// If it cannot be kept.
    pub(crate) fn learn(&self, text: &[u8]) -> Result<(), Failure> {
        let path = self.folder.join(ROSTER);
        let number = |text: &[u8]| Some(Roster::read(text, &self.authority.key).ok()?.number);
        // Several agents answer, and not all of them have the latest.
        let kept = files::read(&path).ok().and_then(|text| number(text.as_bytes()));
        match number(text) > kept.max(Some(self.roster.number)) {
            true => files::write(&path, text),
            false => Ok(()),
        }
    }

    /// The certificates that are known, in PEM, for an agent of which those that it knows have this digest; none if they are
    /// the same.
    pub(crate) fn certificates_beside(&self, digest: &str) -> Option<String> {
        let bundle = self.bundle();
        (bundle.digest() != digest).then(|| bundle.text())
    }

    /// A number that only the same certificates have.
    pub(crate) fn digest(&self) -> String {
        self.bundle().digest()
    }

    /// What of certificates in PEM is later than what is known, of machines on the roster.
    ///
    /// # Errors
    ///
    /// What is wrong with it; then nothing of it counts.
    pub(crate) fn news(&self, text: &[u8]) -> Result<Vec<Certificate>, String> {
        // A copy, so that the loop does not wait while much is verified.
        let known = self.bundle().clone();
        known.news(text, &self.roster, &self.authority)
    }

    /// Keeps such certificates, and takes this machine's own one.
    ///
    /// # Errors
    ///
    /// If they cannot be kept.
    pub(crate) fn keep_certificates(&self, news: Vec<Certificate>) -> Result<(), Failure> {
        let lock = files::lock(&self.folder)?;
        // Another process may have written some there; if they are wrong, they go.
        let _ = self.look_at_bundle();
        self.bundle().take(news);
        let (path, text) = (self.folder.join(CERTIFICATES), self.bundle().text());
        if files::read(&path).ok().as_ref() != Some(&text) {
            files::write(&path, text.as_bytes())?;
        }
        drop(lock);
        self.adopt()
    }

    /// Takes what is in the folder of certificates of machines.
    ///
    /// # Errors
    ///
    /// What is wrong with it; then nothing of it counts.
    pub(crate) fn look_at_bundle(&self) -> Result<(), Failure> {
        let path = self.folder.join(CERTIFICATES);
        if !path.exists() {
            return Ok(());
        }
        let news = self.news(files::read(&path)?.as_bytes());
        let unusable = |why: String| {
            files::unusable(&path, &why)
                .hint("what was known takes its place; copy the file of this machine's authority")
        };
        self.bundle().take(news.map_err(unusable)?);
        Ok(())
    }

    /// Takes the certificate of this machine that ends last, if it is not the one that there is.
    fn adopt(&self) -> Result<(), Failure> {
        let lock = files::lock(&self.folder)?;
        let path = self.folder.join(CERTIFICATE);
        // This machine may have been enrolled again meanwhile, with another key.
        let here = Certificate::read(&files::read(&path)?).map_err(Failure::new)?;
        let newest = self.bundle().get(&here.subject).cloned();
        let newest = newest.filter(|one| one.key == here.key && one.ends > here.ends);
        if let Some(newest) = newest {
            files::write(&path, newest.pem().as_bytes())?;
        }
        drop(lock);
        Ok(())
    }

    fn bundle(&self) -> MutexGuard<'_, Bundle> {
        self.bundle.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps what the authority has given this machine. The roster comes last: agents look at it.
    fn keep(key: &str, admission: &Admission) -> Result<Self, Failure> {
        let folder = files::folder(FOLDER)?;
        files::make(&folder)?;
        let lock = files::lock(&folder)?;
        files::write(&folder.join(AUTHORITY), admission.authority.as_bytes())?;
        files::write(&folder.join(KEY), key.as_bytes())?;
        files::write(&folder.join(CERTIFICATE), admission.certificate.as_bytes())?;
        files::write(&folder.join(ROSTER), admission.roster.as_bytes())?;
        drop(lock);
        Self::open()?.ok_or_else(|| Failure::new("the certificate is gone"))
    }
}

/// The files for TLS in a folder of credentials.
pub(crate) fn tls_in(folder: &Path) -> Tls {
    let file = |name| folder.join(name);
    Tls { cert: file(CERTIFICATE), key: file(KEY), ca: file(AUTHORITY) }
}

/// Until when the certificate in a file is valid.
pub(crate) fn lifetime_of(name: &str, tls: &Tls) -> Option<Lifetime> {
    let ends = certificate::end(&std::fs::read(&tls.cert).ok()?).ok()?;
    Some(Lifetime { name: name.to_owned(), ends, authority_ends: None })
}
