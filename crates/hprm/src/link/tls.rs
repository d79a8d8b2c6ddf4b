//! TLS on TCP connections: the files that a user names for it, and whether this build has it.
//!
//! `channel.rs` encrypts. Because what it stands on takes long to compile, and all links of one machine do without, it
//! is there only with the feature `tls`; otherwise `absent.rs` takes its place, which refuses such files.

use std::path::PathBuf;

#[cfg_attr(not(feature = "tls"), path = "tls/absent.rs")]
mod channel;

pub(super) use channel::{Configs, TlsChannel};

/// The files of a member of an encrypted federation, in PEM.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct TlsFiles {
    /// Its certificate, with those between it and the authority, if there are any.
    pub certificate: PathBuf,
    /// The key of that certificate.
    pub key: PathBuf,
    /// The authorities that may have signed the certificate at the other end.
    pub authority: PathBuf,
}
