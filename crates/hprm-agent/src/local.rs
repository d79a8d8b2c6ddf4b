//! What processes of this machine want of the agent: their connections until a link begins, and the listeners that
//! they have registered.

use std::collections::BTreeMap;
use std::io::{self, IoSlice, Read, Write};
use std::mem::MaybeUninit;
use std::os::fd::AsFd;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};

use hprm::agent::{Answer, LINE_LIMIT, Place, Request, Rest, agent_address, has_come};
use hprm::{Address, Clock, SHIPMENTS};
use hprm_core::PhysicalTime;
use rustix::net::{SendAncillaryBuffer, SendAncillaryMessage, SendFlags, sendmsg, sockopt};

use crate::Failure;
use crate::starters::Starters;
use crate::telling::tell;
use crate::waiting::{Watch, Watched};

/// How many connections may wait for their first line; the oldest makes room for another one.
const GREETINGS: usize = 64;

/// See the module.
pub(crate) struct Local {
    watch: Watch,
    listener: Watched<UnixListener>,
    rest: Rest,
    path: Option<String>,
    /// Connections whose first line is not complete.
    greetings: Vec<(Watched<UnixStream>, Vec<u8>)>,
    registrations: BTreeMap<String, Watched<UnixStream>>,
}

impl Local {
    /// Listens for processes of this user.
    pub(crate) fn listen(watch: Watch) -> Result<Self, Failure> {
        let address = agent_address().map_err(Failure::new)?;
        let failed = |error: io::Error| match error.kind() {
            io::ErrorKind::AddrInUse => {
                Failure::new(format!("an agent runs on this machine already, at {address}"))
                    .hint("`hprm machines` asks it; HPRM_AGENT names another address")
            }
            _ => Failure::new(format!("the agent cannot listen at {address}: {error}")),
        };
        let socket = socket_address(&address).map_err(failed)?;
        let listener = UnixListener::bind_addr(&socket).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let listener = watch.until_readable(listener).map_err(failed)?;
        let path = match address {
            Address::Path(path) => Some(path),
            _ => None,
        };
        let (greetings, registrations, rest) = (Vec::new(), BTreeMap::new(), Rest::default());
        Ok(Self { watch, listener, rest, path, greetings, registrations })
    }

    /// When connections are accepted again that there was no descriptor for.
    pub(crate) fn next_wakeup(&self) -> Option<PhysicalTime> {
        self.rest.until()
    }

    /// The requests that are complete now.
    pub(crate) fn requests(&mut self) -> Vec<(UnixStream, Request)> {
        let (mut requests, now) = (Vec::new(), Clock::local());
        while self.rest.is_over(now) {
            let stream = match self.listener.get().accept() {
                Ok((stream, _)) => stream,
                Err(error) => {
                    if has_come(self.listener.get()) && self.rest.begins_in_agent(&error, now, tell)
                    {
                        self.make_room(&mut requests);
                    }
                    break;
                }
            };
            let is_mine = sockopt::socket_peercred(&stream)
                .is_ok_and(|peer| peer.uid == rustix::process::geteuid());
            if is_mine
                && stream.set_nonblocking(true).is_ok()
                // Without memory for that, the process is told the same as by an agent that has ended.
                && let Ok(stream) = self.watch.until_readable(stream)
            {
                self.greetings.push((stream, Vec::new()));
            }
            if self.greetings.len() > GREETINGS {
                self.make_room(&mut requests);
            }
        }
        // It can be read as long as it rests.
        let _ = self.listener.set(self.rest.until().is_none());
        self.registrations.retain(|_, stream| is_open(stream.get()));
        self.read_greetings(&mut requests);
        requests
    }

    /// Ends the connection that has been idle for longest, if there are too many, or no descriptor for another one.
    fn make_room(&mut self, requests: &mut Vec<(UnixStream, Request)>) {
        // Those that have said what they want, however many came at once, are not among the idle.
        let before = self.greetings.len();
        self.read_greetings(requests);
        if self.greetings.len() == before && before > 0 {
            self.greetings.remove(0);
        }
    }

    /// Reads the first lines of connections, as far as they have come.
    fn read_greetings(&mut self, requests: &mut Vec<(UnixStream, Request)>) {
        for (stream, mut line) in std::mem::take(&mut self.greetings) {
            match read_line(stream.get(), &mut line) {
                Ok(false) => self.greetings.push((stream, line)),
                Ok(true) => match Request::read(&String::from_utf8_lossy(&line)) {
                    Ok(request) => requests.push((stream.into_inner(), request)),
                    Err(wrong) => answer(stream.get(), &Answer::Refused(wrong)),
                },
                // The process has ended, or says more than a line.
                Err(_) => {}
            }
        }
    }

    /// Registers a listener, or says why not.
    pub(crate) fn register(&mut self, machine: &str, place: &Place, stream: UnixStream) {
        self.registrations.retain(|_, stream| is_open(stream.get()));
        let refusal = if !place.is_on(machine) {
            Some(format!("this machine is {machine}: listen at agent:{machine}/{}", place.name))
        } else if Starters::is_meant(&place.name) {
            Some(format!("agent:{machine}/{} is where the agent starts programs", place.name))
        } else if self.registrations.contains_key(&place.name) || place.name == SHIPMENTS {
            Some(format!("another process listens at agent:{machine}/{} already", place.name))
        } else {
            None
        };
        if let Some(text) = refusal {
            return answer(&stream, &Answer::Refused(text));
        }
        answer(&stream, &Answer::Done(machine.to_owned()));
        // A connection that cannot be watched ends, and the process learns that.
        if let Ok(stream) = self.watch.until_readable(stream) {
            self.registrations.insert(place.name.clone(), stream);
        }
    }

    /// Whether a process listens under a name.
    pub(crate) fn listens(&self, name: &str) -> bool {
        self.registrations.get(name).is_some_and(|stream| is_open(stream.get()))
    }

    /// Hands a connection to the process that listens under a name. Returns whether there is one.
    pub(crate) fn hand_over(&mut self, name: &str, connection: &UnixStream) -> bool {
        let Some(stream) = self.registrations.get(name) else { return false };
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
        let mut control = SendAncillaryBuffer::new(&mut space);
        let descriptors = [connection.as_fd()];
        let fits = control.push(SendAncillaryMessage::ScmRights(&descriptors));
        let sent = sendmsg(stream.get(), &[IoSlice::new(&[1])], &mut control, SendFlags::NOSIGNAL);
        fits && sent.is_ok()
    }
}

impl Drop for Local {
    fn drop(&mut self) {
        if let Some(path) = &self.path {
            // It may have been removed already, which is as good.
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Answers a request. The buffer of a new connection takes a line.
pub(crate) fn answer(mut stream: &UnixStream, answer: &Answer) {
    // The process may have ended.
    let _ = stream.write_all(answer.to_string().as_bytes());
}

fn socket_address(address: &Address) -> io::Result<SocketAddr> {
    match address {
        Address::Abstract(name) => SocketAddr::from_abstract_name(name),
        Address::Path(path) => SocketAddr::from_pathname(path),
        Address::Tcp(_) | Address::Agent(_) => Err(io::ErrorKind::InvalidInput.into()),
    }
}

/// Reads a line as far as it has come. Returns whether it is complete. A process writes nothing after it before it has
/// an answer.
fn read_line(mut stream: &UnixStream, line: &mut Vec<u8>) -> io::Result<bool> {
    let mut buffer = [0; LINE_LIMIT];
    loop {
        match stream.read(&mut buffer) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => line.extend_from_slice(&buffer[..count]),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(false),
            Err(error) => return Err(error),
        }
        match line.iter().position(|byte| *byte == b'\n') {
            Some(end) if end + 1 == line.len() => {
                line.truncate(end);
                return Ok(true);
            }
            Some(_) => return Err(io::ErrorKind::InvalidData.into()),
            None if line.len() >= LINE_LIMIT => return Err(io::ErrorKind::InvalidData.into()),
            None => {}
        }
    }
}

/// Whether a registered process is still there; it sends nothing.
fn is_open(mut stream: &UnixStream) -> bool {
    matches!(stream.read(&mut [0]), Err(error) if error.kind() == io::ErrorKind::WouldBlock)
}
