//! The authority: it says which machines belong together, by signing their certificates and the roster.
//!
//! It is a folder of one user on one machine, and no process: whoever can read its key can be any machine.

use std::path::PathBuf;

use rcgen::{
    BasicConstraints, CertificateParams, CertificateSigningRequestParams, DistinguishedName,
    DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose,
};
use time::{Duration, OffsetDateTime};

use super::roster::{self, MACHINES, Roster};
use super::{certificate, files};
use crate::Failure;

/// For how many days the certificates of machines and of an authority are valid, and how far clocks may be behind.
const MACHINE_DAYS: i64 = 365;
const AUTHORITY_DAYS: i64 = 3650;
const BEHIND: Duration = Duration::DAY;

/// See the module.
pub(super) struct Authority {
    folder: PathBuf,
    /// Its certificate, in PEM.
    pub(super) certificate: String,
    key: KeyPair,
    pub(super) roster: Roster,
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

impl Authority {
    /// Makes one, unless there is one.
    pub(super) fn make() -> Result<Self, Failure> {
        let folder = files::folder("authority")?;
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
        valid_for(&mut params, AUTHORITY_DAYS);
        let certificate = params.self_signed(&key).map_err(|error| crypto(&error))?.pem();
        let authority = Self { folder, certificate, key, roster: Roster::default() };
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
        let folder = files::folder("authority")?;
        let path = folder.join("authority.key");
        if !path.exists() {
            let text = format!("this user has no authority: {} is not there", path.display());
            return Err(Failure::new(text).hint("hprm agent authority makes one"));
        }
        files::check_key(&path)?;
        let key = KeyPair::from_pem(&files::read(&path)?).map_err(|error| crypto(&error))?;
        let certificate = files::read(&folder.join("authority.pem"))?;
        let mut authority = Self { folder, certificate, key, roster: Roster::default() };
        authority.reload()?;
        Ok(authority)
    }

    /// Signs a certificate for a machine that has made a request, and puts the machine on the roster.
    pub(super) fn admit(
        &mut self,
        name: &str,
        is_router: bool,
        request: &str,
    ) -> Result<Admission, Failure> {
        let lock = files::lock(&self.folder)?;
        self.reload()?;
        if self.roster.machines.len() >= MACHINES {
            return Err(Failure::new(format!("an authority has at most {MACHINES} machines")));
        }
        let mut request = CertificateSigningRequestParams::from_pem(request)
            .map_err(|error| Failure::new(format!("the request of {name} is none: {error}")))?;
        let subject = self.roster.admit(name, is_router);
        // Of the request, only the key counts.
        request.params = machine(&subject);
        let issuer = Issuer::from_ca_cert_pem(&self.certificate, &self.key);
        let signed = issuer.and_then(|issuer| request.signed_by(&issuer));
        let certificate = signed.map_err(|error| crypto(&error))?.pem();
        let roster = self.save()?;
        drop(lock);
        Ok(Admission { certificate, authority: self.certificate.clone(), roster })
    }

    /// Takes a machine out of the roster.
    pub(super) fn revoke(&mut self, name: &str) -> Result<(), Failure> {
        let lock = files::lock(&self.folder)?;
        self.reload()?;
        if !self.roster.revoke(name) {
            let mut known: Vec<_> = self.roster.machines.iter().map(|it| &*it.name).collect();
            known.sort_unstable();
            let text = format!("no machine has the name {name}; there are: {}", known.join(", "));
            return Err(Failure::new(text));
        }
        self.save()?;
        drop(lock);
        Ok(())
    }

    /// The roster as it is signed.
    pub(super) fn signed(&self) -> Result<String, Failure> {
        files::read(&self.folder.join("roster.json"))
    }

    /// Where it is.
    pub(super) fn folder(&self) -> &std::path::Path {
        &self.folder
    }

    fn reload(&mut self) -> Result<(), Failure> {
        let path = self.folder.join("roster.json");
        let key = certificate::public_key(&self.certificate).map_err(Failure::new)?;
        let read = Roster::read(files::read(&path)?.as_bytes(), &key);
        self.roster =
            read.map_err(|why| Failure::new(format!("cannot use {}: {why}", path.display())))?;
        Ok(())
    }

    fn save(&self) -> Result<String, Failure> {
        let key = roster::key(self.key.serialized_der()).map_err(Failure::new)?;
        let text = self.roster.sign(&key).map_err(Failure::new)?;
        files::write(&self.folder.join("roster.json"), text.as_bytes())?;
        Ok(text)
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
    valid_for(&mut params, MACHINE_DAYS);
    params
}

fn valid_for(params: &mut CertificateParams, days: i64) {
    let now = OffsetDateTime::now_utc();
    params.not_before = now - BEHIND;
    params.not_after = now + Duration::days(days);
}

fn crypto(error: &dyn std::fmt::Display) -> Failure {
    Failure::new(format!("a certificate cannot be made: {error}"))
}
