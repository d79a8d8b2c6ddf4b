//! The secret of a federation and its certificates, and on which links the ends have to prove them.

use std::io;

use hprm_federated::FederationId;

use super::proof::{self, Handshake, Purpose, Role};
use super::rings::Rings;
use super::socket::Socket;
use super::stream::{Stream, Transport};
use super::tls::{Configs, TlsChannel, TlsFiles};
use crate::notifier::Notifier;
use crate::{Address, Failure, random};

/// How the links of a federation are protected. All of its processes must agree on it.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Security {
    /// The target property `auth`: the ends of a Unix socket prove that they know the secret too.
    /// The ends of a TCP connection always do; the kernel tells that both ends of a Unix socket belong to the
    /// same user.
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

    /// The name of the federation, which frames contain instead of the secret.
    pub(crate) fn name(&self) -> FederationId {
        proof::name_of(self.secret)
    }

    /// Whether links to or from this address can be protected as they should.
    pub(crate) fn check_for(&self, address: &Address) -> Result<(), Failure> {
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

    /// The stream of a new connection: encrypted if it should be, and with ring buffers if both ends can share
    /// memory.
    pub(super) fn stream(
        &self,
        socket: Socket,
        role: Role,
        notifier: &Notifier,
    ) -> io::Result<Stream> {
        let way = match (&self.configs, role) {
            (_, Role::Opener) if socket.is_unix() => {
                Transport::Rings(Box::new(Rings::offered(notifier.clone())))
            }
            (_, Role::Acceptor) if socket.is_unix() => {
                Transport::Rings(Box::new(Rings::expected(notifier.clone())))
            }
            (Some(configs), role) => {
                Transport::Encrypted(Box::new(TlsChannel::new(configs, role)?))
            }
            (None, _) => Transport::Plain,
        };
        Ok(Stream::new(socket, way))
    }

    /// The handshake with which a new connection begins, if it needs one.
    pub(super) fn handshake(
        &self,
        socket: &Socket,
        role: Role,
        purpose: Purpose,
    ) -> io::Result<Option<Handshake>> {
        if socket.is_unix() && !self.security.auth {
            return Ok(None);
        }
        Ok(Some(Handshake::new(self.secret, role, purpose, random::fill()?)))
    }
}
