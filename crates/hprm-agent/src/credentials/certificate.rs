//! Certificates: what is read in them, and whether an authority has signed one for a machine.
//!
//! The judgement is that of `webpki`, by which TLS judges in Zenoh: a certificate that passes here is not refused there. When a
//! certificate begins and ends plays no part in it; that is in `lifetime.rs`.

use std::time::Duration;

use rustls_pki_types::{CertificateDer, TrustAnchor, UnixTime};
use webpki::{EndEntityCert, KeyUsage};
use x509_parser::prelude::{FromDer, X509Certificate};

use super::roster;

const LABEL: &str = "CERTIFICATE";

/// The certificate of a machine. Where it comes from elsewhere, it counts only after [`Anchor::check`].
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Certificate {
    der: Vec<u8>,
    /// The common name of its subject, as a roster has it.
    pub(super) subject: String,
    /// Its public key, with the algorithm.
    pub(super) key: Vec<u8>,
    /// From when until when it is valid, in seconds since 1970.
    pub(super) begins: i64,
    pub(super) ends: i64,
}

/// The certificate of an authority.
#[derive(Clone, Debug)]
pub(super) struct Anchor {
    trusted: TrustAnchor<'static>,
    /// The key with which signatures are verified.
    pub(super) key: Vec<u8>,
    /// Until when it is valid, in seconds since 1970.
    pub(super) ends: i64,
}

impl Certificate {
    /// Reads one in PEM.
    ///
    /// # Errors
    ///
    /// Why it is none.
    pub(super) fn read(pem: &str) -> Result<Self, String> {
        Self::of(der(pem)?)
    }

    /// Reads several in PEM, one after the other.
    ///
    /// # Errors
    ///
    /// Why one of them is none.
    pub(super) fn read_all(pem: &[u8]) -> Result<Vec<Self>, String> {
        let all = pem::parse_many(pem).map_err(|error| wrong(&error))?;
        all.into_iter().map(|one| Self::of(one.into_contents())).collect()
    }

    fn of(der: Vec<u8>) -> Result<Self, String> {
        let parsed = parse(&der)?;
        let name = parsed.subject().iter_common_name().next();
        let name = name.and_then(|name| name.as_str().ok());
        let subject = name.ok_or("a certificate has no name")?.to_owned();
        let key = parsed.public_key().raw.to_vec();
        let validity = parsed.validity();
        let (begins, ends) = (validity.not_before.timestamp(), validity.not_after.timestamp());
        Ok(Self { subject, key, begins, ends, der })
    }

    /// The same in PEM: however it was written, always these characters.
    pub(super) fn pem(&self) -> String {
        let config = pem::EncodeConfig::new().set_line_ending(pem::LineEnding::LF);
        pem::encode_config(&pem::Pem::new(LABEL, &*self.der), config)
    }

    /// The name of the machine, or all of the subject if that names none.
    pub(super) fn name(&self) -> &str {
        roster::name_of(&self.subject).unwrap_or(&self.subject)
    }
}

impl Anchor {
    /// Reads the certificate of an authority, in PEM.
    ///
    /// # Errors
    ///
    /// Why it is none.
    pub(super) fn read(pem: &str) -> Result<Self, String> {
        let der = der(pem)?;
        let parsed = parse(&der)?;
        let key = parsed.public_key().subject_public_key.data.to_vec();
        let ends = parsed.validity().not_after.timestamp();
        let der = CertificateDer::from(&*der);
        let trusted = webpki::anchor_from_trusted_cert(&der).map_err(|error| wrong(&error))?;
        Ok(Self { trusted: trusted.to_owned(), key, ends })
    }

    /// Refuses what this authority has not signed for a machine.
    ///
    /// # Errors
    ///
    /// What is wrong.
    pub(super) fn check(&self, one: &Certificate) -> Result<(), String> {
        let der = CertificateDer::from(&*one.der);
        // Any moment at which it is valid will do.
        let at = Duration::from_secs(u64::try_from(one.ends).unwrap_or_default());
        let at = UnixTime::since_unix_epoch(at);
        let anchors = std::slice::from_ref(&self.trusted);
        let checked = EndEntityCert::try_from(&der).and_then(|certificate| {
            for usage in [KeyUsage::client_auth(), KeyUsage::server_auth()] {
                let algorithms = [webpki::ring::ECDSA_P256_SHA256];
                certificate.verify_for_usage(&algorithms, anchors, &[], at, usage, None, None)?;
            }
            Ok(())
        });
        checked.map_err(|error| {
            let name = one.name();
            format!("the authority has not signed the certificate of {name} that is there: {error}")
        })
    }
}

/// Until when a certificate is valid, in seconds since 1970; of several, the first one.
pub(super) fn end(pem: &[u8]) -> Result<i64, String> {
    let der = pem::parse(pem).map_err(|error| wrong(&error))?.into_contents();
    parse(&der).map(|certificate| certificate.validity().not_after.timestamp())
}

fn der(pem: &str) -> Result<Vec<u8>, String> {
    pem::parse(pem).map(pem::Pem::into_contents).map_err(|error| wrong(&error))
}

fn parse(der: &[u8]) -> Result<X509Certificate<'_>, String> {
    let (_, certificate) = X509Certificate::from_der(der).map_err(|error| wrong(&error))?;
    Ok(certificate)
}

fn wrong(error: &dyn std::fmt::Display) -> String {
    format!("it is no certificate: {error}")
}
