//! Unix sockets that carry records: each arrives whole, with its descriptors, or not at all.
//!
//! So an end that never waits need not keep half a record. A long record travels in a file without a name, of which the
//! socket carries the descriptor.

use std::fs::File;
use std::io::{self, IoSlice, IoSliceMut, Read, Seek, Write};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use hprm_core::zeroed;
use rustix::fs::{MemfdFlags, memfd_create};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, ReturnFlags,
    SendAncillaryBuffer, SendAncillaryMessage, SendFlags, SocketAddrUnix, SocketFlags, SocketType,
    accept_with, bind, connect, listen, recvmsg, sendmsg, socket_with, sockopt,
};
use rustix::process::{Uid, geteuid};
use smallvec::SmallVec;

use crate::link::CloseInChild;

/// The longest record that travels in the socket itself, in bytes: so the kernel has room for several.
pub(crate) const SHORT: usize = 32 << 10;

/// How many connections wait until they are accepted.
const BACKLOG: i32 = 16;

/// The most descriptors with one record: that of a long record, and one more.
const DESCRIPTORS: usize = 2;

/// What comes first in each datagram: whether the record is what follows, or in a file.
const HERE: u8 = 0;
const IN_A_FILE: u8 = 1;

/// One end of a connection.
#[derive(Debug)]
pub(crate) struct RecordSocket {
    _end: CloseInChild,
    fd: OwnedFd,
}

/// A record, and the descriptor that came with it.
pub(crate) type Received = (Vec<u8>, Option<OwnedFd>);

impl RecordSocket {
    /// Connects to the process that listens at an abstract name, which must be one of the same user.
    pub(crate) fn connect(name: &str) -> io::Result<Self> {
        let socket = new_socket(SocketFlags::CLOEXEC)?;
        connect(&socket, &SocketAddrUnix::new_abstract_name(name.as_bytes())?)?;
        Self::of(socket, geteuid())
    }

    /// A socket whose other end must be a process of that user.
    fn of(fd: OwnedFd, user: Uid) -> io::Result<Self> {
        // An abstract name has no permissions, so this process checks what the kernel tells about the peer.
        if sockopt::socket_peercred(&fd)?.uid != user {
            return Err(io::ErrorKind::PermissionDenied.into());
        }
        Ok(Self { _end: CloseInChild::of(&fd), fd })
    }

    /// Has it never wait from now on.
    pub(crate) fn do_not_wait(&self) -> io::Result<()> {
        Ok(rustix::io::ioctl_fionbio(&self.fd, true)?)
    }

    /// Sends a record, and a descriptor with it.
    ///
    /// # Errors
    ///
    /// `WouldBlock` if there is no room for it now, and the socket does not wait; then nothing has been sent.
    pub(crate) fn send(&self, record: &[u8], with: Option<BorrowedFd<'_>>) -> io::Result<()> {
        let file = (record.len() > SHORT).then(|| in_a_file(record)).transpose()?;
        let mut descriptors: SmallVec<[BorrowedFd<'_>; DESCRIPTORS]> = SmallVec::new();
        descriptors.extend(file.as_ref().map(AsFd::as_fd));
        descriptors.extend(with);
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(DESCRIPTORS))];
        let mut control = SendAncillaryBuffer::new(&mut space);
        if !descriptors.is_empty() {
            let fits = control.push(SendAncillaryMessage::ScmRights(&descriptors));
            assert!(fits, "there is space for two descriptors");
        }
        let (place, here) = if file.is_some() { (IN_A_FILE, &[][..]) } else { (HERE, record) };
        let pieces = [IoSlice::new(std::slice::from_ref(&place)), IoSlice::new(here)];
        match sendmsg(&self.fd, &pieces, &mut control, SendFlags::NOSIGNAL) {
            Ok(_) => Ok(()),
            // Too many descriptors are on their way already, or there is no memory for one more datagram.
            Err(Errno::TOOMANYREFS | Errno::NOBUFS | Errno::NOMEM) => {
                Err(io::ErrorKind::WouldBlock.into())
            }
            Err(error) => Err(error.into()),
        }
    }

    /// The next record; none if the other end is closed.
    pub(crate) fn receive(&self) -> io::Result<Option<Received>> {
        self.receive_up_to(u64::MAX)
    }

    /// The same, from a process that may send no more than so many bytes at once.
    pub(crate) fn receive_up_to(&self, limit: u64) -> io::Result<Option<Received>> {
        let mut buffer = [0; 1 + SHORT];
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(DESCRIPTORS))];
        let mut control = RecvAncillaryBuffer::new(&mut space);
        let flags = RecvFlags::CMSG_CLOEXEC;
        let came = recvmsg(&self.fd, &mut [IoSliceMut::new(&mut buffer)], &mut control, flags)?;
        let mut descriptors: SmallVec<[OwnedFd; DESCRIPTORS]> = SmallVec::new();
        for ancillary in control.drain() {
            if let RecvAncillaryMessage::ScmRights(fds) = ancillary {
                descriptors.extend(fds);
            }
        }
        if came.flags.intersects(ReturnFlags::CTRUNC | ReturnFlags::TRUNC) {
            return Err(Errno::MSGSIZE.into());
        }
        let mut descriptors = descriptors.into_iter();
        Ok(match buffer[..came.bytes].split_first() {
            None => None,
            Some((&HERE, record)) => Some((record.to_vec(), descriptors.next())),
            Some(_) => {
                let file = descriptors.next().ok_or(io::ErrorKind::InvalidData)?;
                Some((whole(file.into(), limit)?, descriptors.next()))
            }
        })
    }
}

impl AsFd for RecordSocket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}

/// Accepts connections at an abstract name. It never waits, and neither do the sockets that it accepts.
#[derive(Debug)]
pub(crate) struct RecordListener {
    _end: CloseInChild,
    fd: OwnedFd,
}

impl RecordListener {
    pub(crate) fn bind(name: &str) -> io::Result<Self> {
        let fd = new_socket(SocketFlags::CLOEXEC | SocketFlags::NONBLOCK)?;
        bind(&fd, &SocketAddrUnix::new_abstract_name(name.as_bytes())?)?;
        listen(&fd, BACKLOG)?;
        Ok(Self { _end: CloseInChild::of(&fd), fd })
    }

    /// The next connection, if one waits. It fails if that is one of another user, or if this process has no descriptor left
    /// for it: then it waits on.
    pub(crate) fn accept(&self) -> Option<io::Result<RecordSocket>> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        match accept_with(&self.fd, flags) {
            Ok(fd) => Some(RecordSocket::of(fd, geteuid())),
            Err(Errno::AGAIN) => None,
            Err(error) => Some(Err(error.into())),
        }
    }
}

impl AsFd for RecordListener {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}

fn new_socket(flags: SocketFlags) -> io::Result<OwnedFd> {
    Ok(socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?)
}

fn in_a_file(record: &[u8]) -> io::Result<OwnedFd> {
    let mut file = File::from(memfd_create("hprm-record", MemfdFlags::CLOEXEC)?);
    file.write_all(record)?;
    Ok(file.into())
}

fn whole(mut file: File, limit: u64) -> io::Result<Vec<u8>> {
    let len = file.metadata()?.len();
    if len > limit {
        return Err(io::ErrorKind::InvalidData.into());
    }
    let len = usize::try_from(len).map_err(|_| io::ErrorKind::OutOfMemory)?;
    let mut record = zeroed(len).map_err(|_| io::ErrorKind::OutOfMemory)?;
    file.rewind()?;
    file.read_exact(&mut record)?;
    Ok(record)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(name: &str) -> (RecordSocket, RecordSocket) {
        let name = format!("hprm-test-{name}-{}", std::process::id());
        let listener = RecordListener::bind(&name).unwrap();
        assert!(listener.accept().is_none());
        let client = RecordSocket::connect(&name).unwrap();
        (client, listener.accept().unwrap().unwrap())
    }

    #[test]
    fn records_arrive_whole_whatever_their_length() {
        let (client, server) = pair("length");
        for len in [0, 1, SHORT, SHORT + 1, 10 * SHORT] {
            let record = vec![7; len];
            server.send(&record, None).unwrap();
            let (received, descriptor) = client.receive().unwrap().unwrap();
            assert!(received == record && descriptor.is_none(), "{len}");
        }
        drop(server);
        assert!(client.receive().unwrap().is_none());
    }

    #[test]
    fn a_descriptor_comes_with_its_record() {
        let (client, server) = pair("descriptor");
        for len in [3, 2 * SHORT] {
            let file = in_a_file(b"another file").unwrap();
            server.send(&vec![1; len], Some(file.as_fd())).unwrap();
            let (record, descriptor) = client.receive().unwrap().unwrap();
            assert_eq!(record.len(), len);
            assert_eq!(whole(descriptor.unwrap().into(), 100).unwrap(), b"another file");
        }
    }

    #[test]
    fn both_ends_refuse_a_process_of_another_user() {
        let (client, server) = pair("user");
        let other = Uid::from_raw(geteuid().as_raw() + 1);
        for end in [client, server] {
            let refused = RecordSocket::of(end.fd, other).unwrap_err();
            assert_eq!(refused.kind(), io::ErrorKind::PermissionDenied);
        }
    }

    #[test]
    fn a_server_does_not_wait_for_a_client_that_does_not_read() {
        let (client, server) = pair("full");
        let mut sent = 0;
        while server.send(&[5; 1_000], None).is_ok() {
            sent += 1;
        }
        assert!(sent > 10);
        assert_eq!(server.receive().unwrap_err().kind(), io::ErrorKind::WouldBlock);
        // What has been sent is whole.
        for _ in 0..sent {
            assert_eq!(client.receive().unwrap().unwrap().0, [5; 1_000]);
        }
        server.send(b"again", None).unwrap();
        assert_eq!(client.receive().unwrap().unwrap().0, b"again");
    }
}
