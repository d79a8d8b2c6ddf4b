//! The authority: it says which machines belong together, by signing their certificates and the roster.
//!
//! It is a folder of one user on one machine, and no process: whoever can read its key can be any machine.

use std::path::{Path, PathBuf};

use hprm::random_bytes;
use rcgen::{
    BasicConstraints, CertificateParams, CertificateSigningRequestParams, DistinguishedName,
    DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose, SerialNumber,
    SubjectPublicKeyInfo,
};
use time::OffsetDateTime;

use super::bundle::Bundle;
use super::certificate::{Anchor, Certificate};
use super::lifetime::{AUTHORITY_DAYS, DAY, date, is_due, new_end};
use super::roster::{self, MACHINES, Member, Roster};
use super::{CERTIFICATES, files};
use crate::Failure;

/// How far clocks may be behind.
const BEHIND: i64 = DAY;

/// See the module.
pub(super) struct Authority {
    folder: PathBuf,
    /// Its certificate, in PEM.
    pub(super) certificate: String,
    /// The same, as certificates are judged by it.
    anchor: Anchor,
    key: KeyPair,
    pub(super) roster: Roster,
    /// The certificates of the machines, as far as they are known.
    bundle: Bundle,
}

/// What a machine gets that is admitted.
#[derive(Clone, PartialEq, Eq, Debug, serde::Serialize, serde::Deserialize)]
pub(super) struct Admission {
    /// Its certificate, in PEM.
    pub(super) certificate: String,
    /// That of the authority.
    pub(super) authority: String,
    /// The roster, signed.
    pub(super) roster: String,
}

/// Which certificates are renewed.
pub(super) enum Which<'a> {
    /// Those of all machines.
    All,
    /// Those of machines with these names.
    Named(&'a [String]),
    /// Those of which less than a third of their life is left.
    Due,
}

/// What has come of a renewal.
#[derive(PartialEq, Eq, Debug, Default)]
pub(super) struct Renewed {
    /// The machines with new certificates, and until when these are valid.
    pub(super) machines: Vec<String>,
    pub(super) ends: i64,
    /// The machines of which the certificates, and so the keys, are not known here.
    pub(super) unknown: Vec<String>,
}

impl Authority {
    /// Makes one, unless there is one.
    pub(super) fn make(now: i64) -> Result<Self, Failure> {
        Self::make_in(files::folder("authority")?, now)
    }

    pub(super) fn make_in(folder: PathBuf, now: i64) -> Result<Self, Failure> {
        files::make(&folder)?;
        let lock = files::lock(&folder)?;
        if folder.join("authority.key").exists() {
            let text = format!("this user has an authority already, in {}", folder.display());
            return Err(Failure::new(text).hint("hprm agent invite MACHINE admits machines"));
        }
        let key = KeyPair::generate().map_err(|error| crypto(&error))?;
        let mut name = DistinguishedName::new();
        name.push(DnType::CommonName, "HPRM authority");
        let mut params = CertificateParams::default();
        params.distinguished_name = name;
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::DigitalSignature];
        valid_for(&mut params, now - BEHIND, now + AUTHORITY_DAYS * DAY)?;
        let certificate = params.self_signed(&key).map_err(|error| crypto(&error))?.pem();
        let anchor = Anchor::read(&certificate).map_err(Failure::new)?;
        let (roster, bundle) = Default::default();
        let authority = Self { folder, certificate, anchor, key, roster, bundle };
        authority.save()?;
        files::write(&authority.folder.join("authority.pem"), authority.certificate.as_bytes())?;
        // Last of all: with it, the authority is there.
        let key = authority.key.serialize_pem();
        files::write(&authority.folder.join("authority.key"), key.as_bytes())?;
        drop(lock);
        Ok(authority)
    }

    /// That of this user.
    pub(super) fn open() -> Result<Self, Failure> {
        let path = files::folder("authority")?.join("authority.key");
        Self::find()?.ok_or_else(|| {
            let text = format!("this user has no authority: {} is not there", path.display());
            Failure::new(text).hint("hprm agent authority makes one")
        })
    }

    /// That of this user, if there is one.
    pub(super) fn find() -> Result<Option<Self>, Failure> {
        let folder = files::folder("authority")?;
        folder.join("authority.key").exists().then(|| Self::open_in(folder)).transpose()
    }

    pub(super) fn open_in(folder: PathBuf) -> Result<Self, Failure> {
        let path = folder.join("authority.key");
        files::check_key(&path)?;
        let key = KeyPair::from_pem(&files::read(&path)?).map_err(|error| crypto(&error))?;
        let certificate = files::read(&folder.join("authority.pem"))?;
        let anchor = Anchor::read(&certificate).map_err(Failure::new)?;
        let (roster, bundle) = Default::default();
        let mut authority = Self { folder, certificate, anchor, key, roster, bundle };
        authority.reload()?;
        Ok(authority)
    }

    /// Signs a certificate for a machine that has made a request, and puts the machine on the roster.
    pub(super) fn admit(
        &mut self,
        name: &str,
        is_router: bool,
        request: &str,
        now: i64,
    ) -> Result<Admission, Failure> {
        let lock = files::lock(&self.folder)?;
        self.reload()?;
        self.check_end(now)?;
        if self.roster.machines.len() >= MACHINES {
            return Err(Failure::new(format!("an authority has at most {MACHINES} machines")));
        }
        let request = CertificateSigningRequestParams::from_pem(request)
            .map_err(|error| Failure::new(format!("the request of {name} is none: {error}")))?;
        let subject = self.roster.admit(name, is_router);
        // Of the request, only the key counts.
        let mut params = machine(&subject);
        valid_for(&mut params, now - BEHIND, new_end(now, self.anchor.ends))?;
        let issuer = Issuer::from_ca_cert_pem(&self.certificate, &self.key);
        let signed = issuer.and_then(|issuer| params.signed_by(&request.public_key, &issuer));
        let certificate = signed.map_err(|error| crypto(&error))?.pem();
        self.bundle.take([Certificate::read(&certificate).map_err(Failure::new)?]);
        self.save_bundle()?;
        let roster = self.save()?;
        drop(lock);
        Ok(Admission { certificate, authority: self.certificate.clone(), roster })
    }

    /// Takes a machine out of the roster.
    pub(super) fn revoke(&mut self, name: &str) -> Result<(), Failure> {
        let lock = files::lock(&self.folder)?;
        self.reload()?;
        if !self.roster.revoke(name) {
            return Err(self.unknown(name));
        }
        self.save_bundle()?;
        self.save()?;
        drop(lock);
        Ok(())
    }

    /// Signs certificates of machines once more: with the same names and keys, and a later end. `known` has certificates of
    /// machines of which this authority may not know them.
    pub(super) fn renew(
        &mut self,
        which: &Which<'_>,
        known: &[u8],
        now: i64,
    ) -> Result<Renewed, Failure> {
        let lock = files::lock(&self.folder)?;
        self.reload()?;
        self.check_end(now)?;
        // What is wrong with them is told by the agent that they come from.
        self.bundle.take(self.bundle.news(known, &self.roster, &self.anchor).unwrap_or_default());
        let ends = new_end(now, self.anchor.ends);
        let mut renewed = Renewed { ends, ..Renewed::default() };
        let mut signed = Vec::new();
        for member in self.chosen(which)? {
            let Some(old) = self.bundle.get(&member.subject) else {
                renewed.unknown.push(member.name.clone());
                continue;
            };
            if matches!(which, Which::Due) && !(is_due(old.ends, now) && ends >= old.ends + DAY) {
                continue;
            }
            if old.ends < ends {
                signed.push(self.sign_again(old, ends)?);
            }
            renewed.machines.push(member.name.clone());
        }
        if self.bundle.take(signed) {
            self.save_bundle()?;
        }
        drop(lock);
        Ok(renewed)
    }

    fn chosen(&self, which: &Which<'_>) -> Result<Vec<&Member>, Failure> {
        let Which::Named(names) = which else { return Ok(self.roster.machines.iter().collect()) };
        let find = |name: &String| self.roster.member(name).ok_or_else(|| self.unknown(name));
        names.iter().map(find).collect()
    }

    fn sign_again(&self, old: &Certificate, ends: i64) -> Result<Certificate, Failure> {
        let key = SubjectPublicKeyInfo::from_der(&old.key).map_err(|error| crypto(&error))?;
        let mut params = machine(&old.subject);
        // Where a clock is far behind, the old one is valid; so has the new one to be.
        valid_for(&mut params, old.begins, ends)?;
        let mut serial: [u8; 16] =
            random_bytes().map_err(|error| Failure::new(error.report().message))?;
        // A positive number.
        serial[0] = serial[0] & 0x7f | 0x40;
        params.serial_number = Some(SerialNumber::from_slice(&serial));
        let issuer = Issuer::from_ca_cert_pem(&self.certificate, &self.key);
        let signed = issuer.and_then(|issuer| params.signed_by(&key, &issuer));
        let signed = signed.map_err(|error| crypto(&error))?;
        Certificate::read(&signed.pem()).map_err(Failure::new)
    }

    fn unknown(&self, name: &str) -> Failure {
        let mut known: Vec<_> = self.roster.machines.iter().map(|it| &*it.name).collect();
        known.sort_unstable();
        let text = format!("no machine has the name {name}; there are: {}", known.join(", "));
        Failure::new(text)
    }

    /// Refuses to sign what would not be valid.
    fn check_end(&self, now: i64) -> Result<(), Failure> {
        let ends = self.anchor.ends;
        if now < ends {
            return Ok(());
        }
        let text = format!("the certificate of the authority has ended on {}", date(ends));
        let folder = self.folder.display();
        Err(Failure::new(text).hint(format!(
            "move {folder} away, make another one with hprm agent authority, and enroll all machines again"
        )))
    }

    /// The roster as it is signed.
    pub(super) fn signed(&self) -> Result<String, Failure> {
        files::read(&self.folder.join("roster.json"))
    }

    /// The certificates of the machines, in PEM.
    pub(super) fn certificates(&self) -> String {
        self.bundle.text()
    }

    /// The key with which its signatures are verified.
    pub(super) fn public_key(&self) -> &[u8] {
        &self.anchor.key
    }

    /// Until when its certificate is valid, in seconds since 1970.
    pub(super) fn ends(&self) -> i64 {
        self.anchor.ends
    }

    /// Where it is.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    fn reload(&mut self) -> Result<(), Failure> {
        let path = self.folder.join("roster.json");
        let read = Roster::read(files::read(&path)?.as_bytes(), &self.anchor.key);
        self.roster = read.map_err(|why| files::unusable(&path, &why))?;
        self.bundle = Bundle::default();
        let path = self.folder.join(CERTIFICATES);
        if path.exists() {
            let read = self.bundle.news(files::read(&path)?.as_bytes(), &self.roster, &self.anchor);
            self.bundle.take(read.map_err(|why| files::unusable(&path, &why))?);
        }
        Ok(())
    }

    fn save(&self) -> Result<String, Failure> {
        let key = roster::key(self.key.serialized_der()).map_err(Failure::new)?;
        let text = self.roster.sign(&key).map_err(Failure::new)?;
        files::write(&self.folder.join("roster.json"), text.as_bytes())?;
        Ok(text)
    }

    fn save_bundle(&mut self) -> Result<(), Failure> {
        self.bundle.retain(&self.roster);
        files::write(&self.folder.join(CERTIFICATES), self.bundle.text().as_bytes())
    }
}

/// A key for a machine, and the request for a certificate; both in PEM.
pub(super) fn request(name: &str) -> Result<(String, String), Failure> {
    let key = KeyPair::generate().map_err(|error| crypto(&error))?;
    let request = machine(name).serialize_request(&key).and_then(|request| request.pem());
    Ok((key.serialize_pem(), request.map_err(|error| crypto(&error))?))
}

fn machine(subject: &str) -> CertificateParams {
    let mut name = DistinguishedName::new();
    name.push(DnType::CommonName, subject);
    let mut params = CertificateParams::default();
    params.distinguished_name = name;
    params.is_ca = IsCa::ExplicitNoCa;
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.extended_key_usages =
        vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
    params
}

/// From when until when, in seconds since 1970.
fn valid_for(params: &mut CertificateParams, begins: i64, ends: i64) -> Result<(), Failure> {
    let moment = |seconds| OffsetDateTime::from_unix_timestamp(seconds);
    params.not_before = moment(begins).map_err(|error| crypto(&error))?;
    params.not_after = moment(ends).map_err(|error| crypto(&error))?;
    Ok(())
}

fn crypto(error: &dyn std::fmt::Display) -> Failure {
    Failure::new(format!("a certificate cannot be made: {error}"))
}
