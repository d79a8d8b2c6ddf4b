//! What this program reads in certificates. Whether they are valid is verified by TLS, in Zenoh.

use x509_parser::pem::parse_x509_pem;

/// The key in a certificate, as signatures are verified with it.
pub(super) fn public_key(pem: &str) -> Result<Vec<u8>, String> {
    read(pem, |certificate| Ok(certificate.public_key().subject_public_key.data.to_vec()))
}

/// The common name of the subject of a certificate.
pub(super) fn subject(pem: &str) -> Result<String, String> {
    read(pem, |certificate| {
        let name = certificate.subject().iter_common_name().next();
        let name = name.and_then(|name| name.as_str().ok());
        name.map(str::to_owned).ok_or_else(|| "a certificate has no name".to_owned())
    })
}

fn read<T>(
    pem: &str,
    take: impl FnOnce(&x509_parser::certificate::X509Certificate<'_>) -> Result<T, String>,
) -> Result<T, String> {
    let wrong = |error: &dyn std::fmt::Display| format!("it is no certificate: {error}");
    let (_, pem) = parse_x509_pem(pem.as_bytes()).map_err(|error| wrong(&error))?;
    let certificate = pem.parse_x509().map_err(|error| wrong(&error))?;
    take(&certificate)
}
