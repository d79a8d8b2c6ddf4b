//! TLS 1.3 on a TCP connection: what is encrypted, and with whose certificates.
//!
//! Both ends show certificates that an authority of the user has signed. The names in them are not
//! compared with addresses: every member of a federation may take every role in it anyway, and the
//! proof of the secret, which follows, is bound to this channel (`proof`). Nothing here waits; the
//! record layer is fed from the socket and drained into it.

use std::fmt;
use std::io::{self, Read, Write};
use std::path::Path;
use std::sync::Arc;

use rustls::client::WebPkiServerVerifier;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::pki_types::pem::{self, PemObject};
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use rustls::server::WebPkiClientVerifier;
use rustls::{
    AlertDescription, CertificateError, ClientConfig, ClientConnection, Connection,
    DigitallySignedStruct, Error, InvalidMessage, RootCertStore, ServerConfig, ServerConnection,
    SignatureScheme,
};

use super::TlsFiles;
use crate::link::proof::Role;
use crate::link::socket::Socket;
use crate::{Failure, console};

/// What the secret that both ends of a channel derive is for.
const BINDING: &[u8] = b"EXPORTER-HPRM-federation";

/// What both roles need, read from files.
#[derive(Clone, Debug)]
pub(in crate::link) struct Configs {
    opener: Arc<ClientConfig>,
    acceptor: Arc<ServerConfig>,
}

impl Configs {
    pub(in crate::link) fn read(files: &TlsFiles) -> Result<Self, Failure> {
        let chain = certificates(&files.certificate)?;
        let key = PrivateKeyDer::from_pem_file(&files.key)
            .map_err(|error| not_read(&files.key, "private key", error))?;
        let mut roots = RootCertStore::empty();
        for authority in certificates(&files.authority)? {
            roots.add(authority).map_err(|error| unreadable(&files.authority, &error))?;
        }
        let roots = Arc::new(roots);
        let unusable = |error: &dyn fmt::Display| unreadable(&files.certificate, error);
        let unfit = |error: Error| match error {
            Error::InconsistentKeys(_) => {
                let other =
                    format!("it is not the key of the certificate {}", files.certificate.display());
                unreadable(&files.key, &other)
            }
            error => unusable(&error),
        };
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let versions = [&rustls::version::TLS13];
        let clients =
            WebPkiClientVerifier::builder_with_provider(Arc::clone(&roots), Arc::clone(&provider))
                .build()
                .map_err(|error| unreadable(&files.authority, &error))?;
        let mut acceptor = ServerConfig::builder_with_provider(Arc::clone(&provider))
            .with_protocol_versions(&versions)
            .map_err(|error| unusable(&error))?
            .with_client_cert_verifier(clients)
            .with_single_cert(chain.clone(), key.clone_key())
            .map_err(unfit)?;
        // A federate links once.
        acceptor.send_tls13_tickets = 0;
        let servers = WebPkiServerVerifier::builder_with_provider(roots, Arc::clone(&provider))
            .build()
            .map_err(|error| unreadable(&files.authority, &error))?;
        let opener = ClientConfig::builder_with_provider(provider)
            .with_protocol_versions(&versions)
            .map_err(|error| unusable(&error))?
            .dangerous()
            .with_custom_certificate_verifier(Arc::new(AnyName(servers)))
            .with_client_auth_cert(chain, key)
            .map_err(|error| unusable(&error))?;
        Ok(Self { opener: Arc::new(opener), acceptor: Arc::new(acceptor) })
    }

    fn connection(&self, role: Role) -> Result<Connection, Error> {
        Ok(match role {
            Role::Opener => {
                // It must have one; it is not compared.
                let name = ServerName::try_from("federation").expect("a word is a name");
                ClientConnection::new(Arc::clone(&self.opener), name)?.into()
            }
            Role::Acceptor => ServerConnection::new(Arc::clone(&self.acceptor))?.into(),
        })
    }
}

fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, Failure> {
    let read = CertificateDer::pem_file_iter(path).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let certificates = read.map_err(|error| not_read(path, "certificate", error))?;
    match certificates.is_empty() {
        true => Err(not_read(path, "certificate", pem::Error::NoItemsFound)),
        false => Ok(certificates),
    }
}

/// The file cannot be read, or has nothing of that kind in it.
fn not_read(path: &Path, kind: &str, error: pem::Error) -> Failure {
    match error {
        pem::Error::NoItemsFound => unreadable(path, &format!("there is no {kind} in it")),
        pem::Error::Io(error) => Failure::Option {
            message: format!("TLS cannot read {}: {}", path.display(), console::reason(&error)),
            hint: Some("is the path right? It is relative to the current directory"),
        },
        error => unreadable(path, &error),
    }
}

fn unreadable(path: &Path, error: &dyn fmt::Display) -> Failure {
    Failure::Option {
        message: format!("TLS cannot use {}: {error}", path.display()),
        hint: Some(
            "certificates and keys are files in PEM, see the handbook page howto/deployment",
        ),
    }
}

/// Verifies everything about a certificate but whose name is in it.
#[derive(Debug)]
struct AnyName(Arc<WebPkiServerVerifier>);

impl ServerCertVerifier for AnyName {
    fn verify_server_cert(
        &self,
        certificate: &CertificateDer<'_>,
        between: &[CertificateDer<'_>],
        name: &ServerName<'_>,
        status: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        match self.0.verify_server_cert(certificate, between, name, status, now) {
            // The name is looked at last, when all else is well.
            Err(Error::InvalidCertificate(
                CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. },
            )) => Ok(ServerCertVerified::assertion()),
            verified => verified,
        }
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.0.verify_tls12_signature(message, certificate, signature)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.0.verify_tls13_signature(message, certificate, signature)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.0.supported_verify_schemes()
    }
}

/// An encrypted channel over a socket.
#[derive(Debug)]
pub(in crate::link) struct TlsChannel {
    connection: Connection,
    /// Bytes that have been decrypted and not been read.
    unread: usize,
}

impl TlsChannel {
    pub(in crate::link) fn new(configs: &Configs, role: Role) -> io::Result<Self> {
        let connection = configs.connection(role).map_err(invalid)?;
        Ok(Self { connection, unread: 0 })
    }

    pub(in crate::link) fn receive(
        &mut self,
        socket: &Socket,
        buffer: &mut [u8],
    ) -> io::Result<usize> {
        loop {
            match self.connection.reader().read(buffer) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                // Whether the other end has ended in order is up to its frames.
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(0),
                Err(error) => return Err(error),
                Ok(count) => {
                    self.unread = self.unread.saturating_sub(count);
                    return Ok(count);
                }
            }
            self.connection.read_tls(&mut Raw(socket))?;
            match self.connection.process_new_packets() {
                Ok(state) => self.unread = state.plaintext_bytes_to_read(),
                Err(error) => {
                    // The alert tells the other end what is wrong; this end can do no more.
                    let _ = self.pump(socket);
                    return Err(invalid(error));
                }
            }
        }
    }

    pub(in crate::link) fn send(&mut self, socket: &Socket, bytes: &[u8]) -> io::Result<usize> {
        let mut count = self.connection.writer().write(bytes)?;
        self.pump(socket)?;
        if count == 0 && !bytes.is_empty() {
            // It was full, and perhaps is no longer.
            count = self.connection.writer().write(bytes)?;
            self.pump(socket)?;
        }
        match count {
            0 if !bytes.is_empty() => Err(io::ErrorKind::WouldBlock.into()),
            count => Ok(count),
        }
    }

    /// Writes what has been encrypted, as much as the socket takes.
    pub(in crate::link) fn pump(&mut self, socket: &Socket) -> io::Result<()> {
        while self.connection.wants_write() {
            match self.connection.write_tls(&mut Raw(socket)) {
                Ok(_) => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Whether bytes wait that the socket has not taken.
    pub(in crate::link) fn has_outbound(&self) -> bool {
        self.connection.wants_write()
    }

    /// Whether the first message of TLS has come from the other end.
    pub(in crate::link) fn has_begun_handshake(&self) -> bool {
        self.connection.protocol_version().is_some()
    }

    /// Whether received bytes wait that the socket does not report any more.
    pub(in crate::link) fn has_unread(&self) -> bool {
        self.unread > 0
    }

    pub(in crate::link) fn finish(&mut self, socket: &Socket) -> io::Result<()> {
        self.connection.send_close_notify();
        self.pump(socket)
    }

    /// What only the two ends know.
    pub(in crate::link) fn binding(&self) -> io::Result<Vec<u8>> {
        let secret = self.connection.export_keying_material([0; 32], BINDING, None);
        secret.map(|secret| secret.to_vec()).map_err(invalid)
    }
}

fn invalid(error: Error) -> io::Error {
    let words = match error {
        Error::InvalidMessage(InvalidMessage::InvalidContentType) => {
            "the other end does not use TLS, and this process does: give all processes of the \
             federation certificates, or none"
                .to_owned()
        }
        Error::AlertReceived(
            AlertDescription::BadCertificate
            | AlertDescription::CertificateUnknown
            | AlertDescription::DecryptError
            | AlertDescription::UnknownCA,
        ) => "TLS: the other end does not accept the certificate of this process: has the authority signed it that \
              the other end names with --tls-ca?"
            .to_owned(),
        error => format!("TLS: {error}"),
    };
    io::Error::new(io::ErrorKind::InvalidData, words)
}

/// The socket, as the record layer reads and writes it.
struct Raw<'a>(&'a Socket);

impl Read for Raw<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // No descriptors come over TCP.
        self.0.receive(buffer, &mut std::collections::VecDeque::new())
    }
}

impl Write for Raw<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.send(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
