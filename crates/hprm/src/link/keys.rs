//! The secret of a federation and certificates, and on which links they have to be proved.

use std::io;

use hprm_federated::FederationId;
use rustix::rand::{GetRandomFlags, getrandom};

use super::proof::{self, Handshake, Nonce, Purpose, Role};
use super::rings::Rings;
use super::socket::Socket;
use super::stream::{Stream, Way};
use super::tls::{Channel, Configs, TlsFiles};
use crate::notifier::Notifier;
use crate::{Address, Failure};

/// How the links of a federation are protected. All of its processes must agree on it.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Security {
    /// The target property `auth`: the ends of a Unix socket prove that they know the secret too.
    /// Those of a TCP connection always do; that both ends of a Unix socket belong to the same user
    /// is known from the kernel.
    pub auth: bool,
    /// The target property `comm-type: TLS`: no TCP connection is without TLS.
    pub encrypt: bool,
    /// With these, TCP connections have TLS, whatever the program says.
    pub tls: Option<TlsFiles>,
}

/// See the module.
#[derive(Clone, Debug)]
pub(crate) struct Keys {
    secret: FederationId,
    security: Security,
    configs: Option<Configs>,
}

impl Keys {
    /// Reads the files that are needed.
    pub(crate) fn new(secret: FederationId, security: Security) -> Result<Self, Failure> {
        let configs = security.tls.as_ref().map(Configs::read).transpose()?;
        Ok(Self { secret, security, configs })
    }

    /// What frames may say instead of the secret.
    pub(crate) fn name(&self) -> FederationId {
        proof::name_of(self.secret)
    }

    /// Whether links to or from this address can be protected as they should.
    pub(crate) fn suffice_for(&self, address: &Address) -> Result<(), Failure> {
        if address.is_unix() || !self.security.encrypt || self.configs.is_some() {
            return Ok(());
        }
        Err(Failure::Option {
            message: format!(
                "the program says `comm-type: TLS`, and there is no certificate for {address}"
            ),
            hint: Some("name the files: --tls-cert, --tls-key and --tls-ca"),
        })
    }

    /// A new connection, encrypted if it should be, and with memory if both ends can share it.
    pub(super) fn stream(
        &self,
        socket: Socket,
        role: Role,
        notifier: &Notifier,
    ) -> io::Result<Stream> {
        let way = match (&self.configs, role) {
            (_, Role::Opener) if socket.is_unix() => {
                Way::Rings(Box::new(Rings::offered(notifier.clone())))
            }
            (_, Role::Acceptor) if socket.is_unix() => {
                Way::Rings(Box::new(Rings::expected(notifier.clone())))
            }
            (Some(configs), role) => Way::Encrypted(Box::new(Channel::new(configs, role)?)),
            (None, _) => Way::Plain,
        };
        Ok(Stream::new(socket, way))
    }

    /// The handshake that a new connection begins with, if it needs one.
    pub(super) fn handshake(
        &self,
        socket: &Socket,
        role: Role,
        purpose: Purpose,
    ) -> io::Result<Option<Handshake>> {
        if socket.is_unix() && !self.security.auth {
            return Ok(None);
        }
        Ok(Some(Handshake::new(self.secret, role, purpose, nonce()?)))
    }
}

fn nonce() -> io::Result<Nonce> {
    let mut nonce = Nonce::default();
    // So few bytes come in one piece, once the system has any.
    let count = getrandom(&mut nonce, GetRandomFlags::empty())?;
    if count < nonce.len() {
        return Err(io::Error::other("the system has no randomness"));
    }
    Ok(nonce)
}
