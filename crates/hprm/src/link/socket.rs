//! Sockets: Unix, TCP and those of agents with one interface, never blocking.

use std::collections::VecDeque;
use std::io::{self, IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::net::{SocketAddr as InternetAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use rustix::io::Errno;
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, ReturnFlags,
    SendAncillaryBuffer, SendAncillaryMessage, SendFlags, SocketFlags, SocketType, recvmsg, send,
    sendmsg, sockopt,
};

use super::ends::CloseInChild;
use super::{Address, agents};
use crate::wait::{Deadline, Interest};

/// How soon a TCP connection to a machine that has vanished ends. This long after the last bytes the kernel
/// sends the first question (keepalive), and then this many, at these intervals.
const SILENCE: Duration = Duration::from_secs(5);
const QUESTIONS: u32 = 5;
const QUESTION_INTERVAL: Duration = Duration::from_secs(2);

/// How long what was sent may stay without an answer, in milliseconds: as long as silence and questions
/// take together.
const UNHEARD: u32 = 15_000;

/// How often to look whether a signal has come, while a name is resolved.
const LOOKING: Duration = Duration::from_millis(20);

/// The most descriptors that one read brings, or one write sends.
const DESCRIPTORS: usize = 8;

/// How many connections wait in the kernel until they are accepted.
const BACKLOG: i32 = 1024;

/// A connected socket.
#[derive(Debug)]
pub(crate) struct Socket {
    _end: CloseInChild,
    fd: OwnedFd,
    unix: bool,
}

/// A listening socket.
#[derive(Debug)]
pub(crate) struct SocketListener {
    _end: CloseInChild,
    kind: SocketKind,
    address: Address,
}

#[derive(Debug)]
enum SocketKind {
    Unix(UnixListener),
    Tcp(TcpListener),
    /// The agent of this machine hands over what other machines open.
    Agent(UnixStream),
}

impl Socket {
    pub(super) fn connect(address: &Address, deadline: Deadline) -> io::Result<Self> {
        match address {
            Address::Abstract(_) | Address::Path(_) => Self::unix(connect_unix(address)?),
            Address::Agent(place) => Self::led_by_agent(agents::connect(place, deadline)?),
            Address::Tcp(host) => {
                let mut last = io::Error::from(io::ErrorKind::AddrNotAvailable);
                for address in resolve(host, deadline)? {
                    match connect_tcp(address, deadline).and_then(Self::tcp) {
                        Ok(socket) => return Ok(socket),
                        Err(error) => last = error,
                    }
                }
                Err(last)
            }
        }
    }

    fn unix(stream: UnixStream) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        check_user(&stream)?;
        Ok(Self { _end: CloseInChild::of(&stream), fd: stream.into(), unix: true })
    }

    /// The other end is on another machine, although the kernel sees a Unix socket to the agent.
    fn led_by_agent(stream: UnixStream) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        Ok(Self { _end: CloseInChild::of(&stream), fd: stream.into(), unix: false })
    }

    fn tcp(stream: TcpStream) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        sockopt::set_socket_keepalive(&stream, true)?;
        sockopt::set_tcp_keepidle(&stream, SILENCE)?;
        sockopt::set_tcp_keepintvl(&stream, QUESTION_INTERVAL)?;
        sockopt::set_tcp_keepcnt(&stream, QUESTIONS)?;
        sockopt::set_tcp_user_timeout(&stream, UNHEARD)?;
        Ok(Self { _end: CloseInChild::of(&stream), fd: stream.into(), unix: false })
    }

    /// The address of the other end, if it is TCP.
    pub(super) fn peer_address(&self) -> io::Result<InternetAddr> {
        let address = rustix::net::getpeername(&self.fd)?.ok_or(io::ErrorKind::NotConnected)?;
        InternetAddr::try_from(address).map_err(|_| io::ErrorKind::Unsupported.into())
    }

    /// The address of this end, if it is TCP.
    pub(super) fn local_address(&self) -> io::Result<InternetAddr> {
        let address = rustix::net::getsockname(&self.fd)?;
        InternetAddr::try_from(address).map_err(|_| io::ErrorKind::Unsupported.into())
    }

    pub(super) fn is_unix(&self) -> bool {
        self.unix
    }

    pub(super) fn send(&self, bytes: &[u8]) -> io::Result<usize> {
        Ok(send(&self.fd, bytes, SendFlags::NOSIGNAL)?)
    }

    /// Nothing more will be sent.
    pub(super) fn finish(&self) -> io::Result<()> {
        Ok(rustix::net::shutdown(&self.fd, rustix::net::Shutdown::Write)?)
    }

    /// Sends bytes, and descriptors with the first of them.
    pub(super) fn send_with(&self, bytes: &[u8], fds: &[BorrowedFd<'_>]) -> io::Result<usize> {
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(DESCRIPTORS))];
        let mut control = SendAncillaryBuffer::new(&mut space);
        let fits = control.push(SendAncillaryMessage::ScmRights(fds));
        assert!(fits, "there is space for a few descriptors");
        Ok(sendmsg(&self.fd, &[IoSlice::new(bytes)], &mut control, SendFlags::NOSIGNAL)?)
    }

    /// Receives bytes, and the descriptors that came with them.
    pub(super) fn receive(
        &self,
        buffer: &mut [u8],
        descriptors: &mut VecDeque<OwnedFd>,
    ) -> io::Result<usize> {
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(DESCRIPTORS))];
        let mut control = RecvAncillaryBuffer::new(&mut space);
        let flags = RecvFlags::CMSG_CLOEXEC;
        let message = recvmsg(&self.fd, &mut [IoSliceMut::new(buffer)], &mut control, flags)?;
        for ancillary in control.drain() {
            if let RecvAncillaryMessage::ScmRights(fds) = ancillary {
                descriptors.extend(fds);
            }
        }
        if message.flags.contains(ReturnFlags::CTRUNC) {
            // If one were lost, this process could not tell it from others that come later.
            return Err(io::Error::from(Errno::MFILE));
        }
        Ok(message.bytes)
    }
}

impl AsFd for Socket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}

impl SocketListener {
    pub(crate) fn bind(address: &Address) -> io::Result<Self> {
        let (end, kind, address) = match address {
            Address::Abstract(_) | Address::Path(_) => {
                let listener = UnixListener::bind_addr(&unix_address(address)?)?;
                listener.set_nonblocking(true)?;
                (CloseInChild::of(&listener), SocketKind::Unix(listener), address.clone())
            }
            Address::Agent(place) => {
                let (registration, place) = agents::listen(place)?;
                let end = CloseInChild::of(&registration);
                (end, SocketKind::Agent(registration), Address::Agent(place))
            }
            Address::Tcp(host) => {
                let listener = TcpListener::bind(host.as_str())?;
                // During a flood, the kernel keeps the connections of members that come meanwhile.
                rustix::net::listen(&listener, BACKLOG)?;
                listener.set_nonblocking(true)?;
                // The port may have been zero.
                let address = Address::Tcp(listener.local_addr()?.to_string());
                (CloseInChild::of(&listener), SocketKind::Tcp(listener), address)
            }
        };
        Ok(Self { _end: end, kind, address })
    }

    /// Where it listens; a port of zero has become a real one.
    pub(crate) fn address(&self) -> &Address {
        &self.address
    }

    /// The next connection, if one waits.
    pub(crate) fn accept(&self) -> io::Result<Option<Socket>> {
        let accepted = match &self.kind {
            SocketKind::Unix(listener) => listener.accept().map(|(stream, _)| Socket::unix(stream)),
            SocketKind::Tcp(listener) => listener.accept().map(|(stream, _)| Socket::tcp(stream)),
            SocketKind::Agent(registration) => match agents::accept(registration) {
                Ok(Some(stream)) => Ok(Socket::led_by_agent(stream)),
                Ok(None) => return Ok(None),
                Err(error) => Err(error),
            },
        };
        match accepted {
            // A connection that this process must not serve, or that has ended, is no reason to stop
            // listening.
            Ok(socket) => Ok(socket.ok()),
            Err(error) if Errno::from_io_error(&error).is_some_and(is_its_own_fault) => Ok(None),
            Err(error) => Err(error),
        }
    }
}

/// Whether `accept` failed for a reason that lies in that connection, and the next one may be well.
fn is_its_own_fault(error: Errno) -> bool {
    matches!(
        error,
        Errno::AGAIN
            | Errno::INTR
            | Errno::CONNABORTED
            | Errno::PERM
            | Errno::PROTO
            | Errno::NOPROTOOPT
            | Errno::OPNOTSUPP
            | Errno::NETDOWN
            | Errno::NETUNREACH
            | Errno::HOSTDOWN
            | Errno::HOSTUNREACH
            | Errno::NONET
    )
}

impl Drop for SocketListener {
    fn drop(&mut self) {
        if let Address::Path(path) = &self.address {
            // It may have been removed already, which is as good.
            let _ = std::fs::remove_file(path);
        }
    }
}

impl AsFd for SocketListener {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match &self.kind {
            SocketKind::Unix(listener) => listener.as_fd(),
            SocketKind::Tcp(listener) => listener.as_fd(),
            SocketKind::Agent(registration) => registration.as_fd(),
        }
    }
}

/// The addresses of a host. To ask for them may take long, and no signal ends that; so another thread
/// does, unless it is an address already.
fn resolve(host: &str, deadline: Deadline) -> io::Result<Vec<InternetAddr>> {
    if let Ok(address) = host.parse() {
        return Ok(vec![address]);
    }
    let (answer, answers) = mpsc::channel();
    let name = host.to_owned();
    thread::Builder::new().name("resolver".to_owned()).spawn(move || {
        let addresses = name.to_socket_addrs().map(Iterator::collect);
        // The other end may not wait for it any more.
        let _ = answer.send(addresses);
    })?;
    loop {
        match answers.recv_timeout(LOOKING) {
            Ok(addresses) => return addresses,
            Err(mpsc::RecvTimeoutError::Timeout) => deadline.check()?,
            Err(mpsc::RecvTimeoutError::Disconnected) => {
                return Err(io::Error::other("the name cannot be resolved"));
            }
        }
    }
}

/// Connects without blocking anywhere but in [`Deadline::wait`].
fn connect_tcp(address: InternetAddr, deadline: Deadline) -> io::Result<TcpStream> {
    let family = if address.is_ipv4() { AddressFamily::INET } else { AddressFamily::INET6 };
    let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
    let socket = rustix::net::socket_with(family, SocketType::STREAM, flags, None)?;
    match rustix::net::connect(&socket, &address) {
        Ok(()) => {}
        Err(Errno::INPROGRESS) => {
            let connected = Interest { fd: socket.as_fd(), write: true };
            while !deadline.wait(connected)? {}
            sockopt::socket_error(&socket)??;
        }
        Err(error) => return Err(error.into()),
    }
    Ok(socket.into())
}

fn unix_address(address: &Address) -> io::Result<SocketAddr> {
    match address {
        Address::Abstract(name) => SocketAddr::from_abstract_name(name),
        Address::Path(path) => SocketAddr::from_pathname(path),
        Address::Tcp(_) | Address::Agent(_) => unreachable!("it is no Unix address"),
    }
}

/// Connects to a Unix socket of a process of the same user.
pub(super) fn connect_unix(address: &Address) -> io::Result<UnixStream> {
    let stream = UnixStream::connect_addr(&unix_address(address)?)?;
    check_user(&stream)?;
    Ok(stream)
}

/// An abstract name has no permissions, so this process checks what the kernel tells about the peer.
fn check_user(stream: &UnixStream) -> io::Result<()> {
    if sockopt::socket_peercred(stream)?.uid == rustix::process::geteuid() {
        return Ok(());
    }
    let text = "the process at the other end belongs to another user";
    Err(io::Error::new(io::ErrorKind::PermissionDenied, text))
}
