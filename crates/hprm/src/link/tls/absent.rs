//! What stands in the place of the channel in a build without TLS: there are no keys, so there is no channel.

use std::io;

use super::TlsFiles;
use crate::Failure;
use crate::link::proof::Role;
use crate::link::socket::Socket;

/// There are none.
#[derive(Clone, Debug)]
pub(in crate::link) enum Configs {}

impl Configs {
    pub(in crate::link) fn read(_: &TlsFiles) -> Result<Self, Failure> {
        Err(Failure::Option {
            message: "this build of HPRM has no TLS, and certificates were given".to_owned(),
            hint: Some(
                "in a clone of HPRM: make build, or pip install .; in Rust: the feature `tls` of the crate hprm",
            ),
        })
    }
}

/// There is none.
#[derive(Debug)]
pub(in crate::link) enum TlsChannel {}

impl TlsChannel {
    pub(in crate::link) fn new(configs: &Configs, _: Role) -> io::Result<Self> {
        match *configs {}
    }

    pub(in crate::link) fn receive(&mut self, _: &Socket, _: &mut [u8]) -> io::Result<usize> {
        match *self {}
    }

    pub(in crate::link) fn send(&mut self, _: &Socket, _: &[u8]) -> io::Result<usize> {
        match *self {}
    }

    pub(in crate::link) fn pump(&mut self, _: &Socket) -> io::Result<()> {
        match *self {}
    }

    pub(in crate::link) fn has_outbound(&self) -> bool {
        match *self {}
    }

    pub(in crate::link) fn has_begun_handshake(&self) -> bool {
        match *self {}
    }

    pub(in crate::link) fn has_unread(&self) -> bool {
        match *self {}
    }

    pub(in crate::link) fn finish(&mut self, _: &Socket) -> io::Result<()> {
        match *self {}
    }

    pub(in crate::link) fn binding(&self) -> io::Result<Vec<u8>> {
        match *self {}
    }
}
