//! Connections that the agent of this machine leads to other machines.
//!
//! The agent is a process beside this one; `crate::agent` has the lines that both exchange. Of a connection that leads
//! to another machine, this process sees only a socket. It carries no descriptors, and its other end proves that it
//! belongs to the federation, as over TCP.

use std::io::{self, Read, Write};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::time::Duration;

use rustix::net::{RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, recvmsg};

use super::socket::connect_unix;
use crate::agent::{Answer, LINE_LIMIT, Machine, Place, Request, agent_address};
use crate::wait::{Deadline, Interest};
use crate::{Address, Clock, nanoseconds};

/// How long the agent may take to register a listener.
const REGISTRATION: Duration = Duration::from_secs(20);

/// How long the agent may take to ask all others of their machines.
const MACHINES: Duration = Duration::from_secs(10);

/// The most bytes of what it says of them.
const MACHINES_LIMIT: usize = 64 << 20;

/// Connects to a listener on another machine.
pub(super) fn connect(place: &Place, deadline: Deadline) -> io::Result<UnixStream> {
    ask(&Request::Connect(place.clone()), deadline).map(|(stream, _)| stream)
}

/// The same, within a time.
pub(crate) fn connect_through_agent(place: &Place, time: Duration) -> io::Result<UnixStream> {
    connect(place, within(time))
}

/// Registers a listener. Returns also the place that it has.
pub(crate) fn listen(place: &Place) -> io::Result<(UnixStream, Place)> {
    let deadline = within(REGISTRATION);
    let (registration, machine) = ask(&Request::Listen(place.clone()), deadline)?;
    Ok((registration, Place { machine, name: place.name.clone() }))
}

/// The next connection that the agent hands over, if there is one.
pub(crate) fn accept(registration: &UnixStream) -> io::Result<Option<UnixStream>> {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
    let mut control = RecvAncillaryBuffer::new(&mut space);
    let mut byte = [0];
    let mut buffers = [io::IoSliceMut::new(&mut byte)];
    let message = recvmsg(registration, &mut buffers, &mut control, RecvFlags::CMSG_CLOEXEC)?;
    if message.bytes == 0 {
        let text = "the agent of this machine has ended";
        return Err(io::Error::new(io::ErrorKind::BrokenPipe, text));
    }
    let descriptors = control.drain().filter_map(|ancillary| match ancillary {
        RecvAncillaryMessage::ScmRights(mut descriptors) => descriptors.next(),
        _ => None,
    });
    let descriptor: Option<OwnedFd> = descriptors.last();
    Ok(descriptor.map(UnixStream::from))
}

/// The machine next on the way to another one.
pub(crate) fn route(machine: &str, time: Duration) -> io::Result<String> {
    let answer = ask(&Request::Route(machine.to_owned()), within(time));
    answer.map(|(_, text)| text).map_err(unanswered)
}

/// What the agent knows of all machines.
pub(crate) fn ask_for_machines() -> io::Result<Vec<Machine>> {
    read_machines().map_err(unanswered)
}

fn read_machines() -> io::Result<Vec<Machine>> {
    let deadline = within(MACHINES);
    let (mut stream, _) = ask(&Request::Machines, deadline)?;
    let (mut text, mut buffer) = (Vec::new(), [0; 4096]);
    loop {
        match stream.read(&mut buffer) {
            Ok(0) => break,
            Ok(len) if text.len() + len <= MACHINES_LIMIT => text.extend(&buffer[..len]),
            Ok(_) => return Err(io::ErrorKind::InvalidData.into()),
            Err(error) => wait_if_blocked(&stream, error, deadline)?,
        }
    }
    Ok(serde_json::from_slice(&text)?)
}

fn within(time: Duration) -> Deadline {
    Deadline::at(Clock::now().plus(nanoseconds(time)))
}

/// Sends a request to the agent, and waits for its answer.
fn ask(request: &Request, deadline: Deadline) -> io::Result<(UnixStream, String)> {
    let invalid = |text| io::Error::new(io::ErrorKind::InvalidInput, text);
    let address = agent_address().map_err(invalid)?;
    let mut stream = connect_unix(&address).map_err(|error| no_agent(&address, &error))?;
    stream.set_nonblocking(true)?;
    // The buffer of a new socket takes more than a line.
    stream.write_all(request.to_string().as_bytes())?;
    match Answer::read(&read_line(&mut stream, deadline)?) {
        Answer::Done(text) => Ok((stream, text)),
        Answer::Absent(text) => Err(io::Error::new(io::ErrorKind::NotFound, text)),
        Answer::Refused(text) => Err(invalid(text)),
    }
}

/// Reads the answer and no byte after it, which belongs to the link.
fn read_line(stream: &mut UnixStream, deadline: Deadline) -> io::Result<String> {
    let mut line = Vec::new();
    loop {
        let mut byte = [0];
        match stream.read(&mut byte) {
            Ok(0) => return Err(io::ErrorKind::ConnectionReset.into()),
            Ok(_) if byte == *b"\n" => break,
            Ok(_) if line.len() < LINE_LIMIT => line.extend(byte),
            Ok(_) => return Err(io::ErrorKind::InvalidData.into()),
            Err(error) => wait_if_blocked(stream, error, deadline)?,
        }
    }
    String::from_utf8(line).map_err(|_| io::ErrorKind::InvalidData.into())
}

/// Waits until more can be read, if that was all that was wrong.
fn wait_if_blocked(stream: &UnixStream, error: io::Error, deadline: Deadline) -> io::Result<()> {
    match error.kind() {
        io::ErrorKind::Interrupted => Ok(()),
        io::ErrorKind::WouldBlock => {
            deadline.wait(Interest { fd: stream.as_fd(), write: false }).map(drop)
        }
        _ => Err(error),
    }
}

/// Why an answer does not come that the agent gives without waiting for others for long.
fn unanswered(error: io::Error) -> io::Error {
    let text = match error.kind() {
        io::ErrorKind::TimedOut => "the agent of this machine does not answer: is it stopped?",
        io::ErrorKind::ConnectionReset => "the agent of this machine has ended meanwhile",
        _ => return error,
    };
    io::Error::new(error.kind(), text)
}

fn no_agent(address: &Address, error: &io::Error) -> io::Error {
    let text = format!("no agent runs on this machine, at {address}: start `hprm agent`");
    match error.kind() {
        io::ErrorKind::ConnectionRefused | io::ErrorKind::NotFound => {
            io::Error::new(io::ErrorKind::NotFound, text)
        }
        kind => io::Error::new(kind, format!("the agent of this machine, at {address}: {error}")),
    }
}
