//! The authority's side of an enrolment: one machine is invited, by a code that a person carries there.
//!
//! Nothing listens except while a machine is being enrolled, and what comes costs a bounded number of bytes.

use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use hprm::agent::{Rest, has_come};
use hprm::{Clock, random_bytes};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::authority::Authority;
use super::code::Code;
use super::exchange::{ATTEMPTS, GREETING, Invitation, MAGIC, Nonce, REQUEST_LIMIT, Refusal, Said};
use super::lifetime::now;
use crate::Failure;

/// How many connections may be open; the oldest makes room for another one.
const CONNECTIONS: usize = 64;

/// How long a machine that was admitted may take to read it.
const READING: Duration = Duration::from_secs(10);

/// A connection that has not said all.
struct Connection {
    stream: TcpStream,
    nonce: Nonce,
    received: Vec<u8>,
}

/// A machine that is invited.
pub(super) struct Host {
    listener: TcpListener,
    rest: Rest,
    invitation: Invitation,
    until: Instant,
    is_router: bool,
    connections: Vec<Connection>,
}

impl Host {
    /// Listens for a machine. Returns the code, too.
    pub(super) fn listen(
        place: &str,
        name: &str,
        is_router: bool,
        valid: Duration,
    ) -> Result<(Self, Code), Failure> {
        let failed = |error: io::Error| {
            Failure::new(format!("cannot listen at {place}: {error}"))
                .hint("name another port: --listen HOST:PORT")
        };
        let listener = TcpListener::bind(place).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let code = Code::new(random()?);
        let until = Instant::now() + valid;
        let invitation = Invitation::new(name, code.clone(), until);
        let (rest, connections) = (Rest::default(), Vec::new());
        Ok((Self { listener, rest, invitation, until, is_router, connections }, code))
    }

    /// Where it listens.
    pub(super) fn place(&self) -> String {
        let place = self.listener.local_addr();
        place.map(|place| place.to_string()).unwrap_or_default()
    }

    /// Waits until the machine is admitted; it is on the roster then.
    pub(super) fn admit(mut self, authority: &mut Authority) -> Result<(), Failure> {
        loop {
            let now = Instant::now();
            if now >= self.until {
                return Err(Failure::new("the code has expired, and nobody has used it")
                    .hint("hprm agent invite makes another one"));
            }
            if self.invitation.is_void() {
                return Err(Failure::new(format!(
                    "{ATTEMPTS} wrong codes have come: this one is void"
                ))
                .hint("hprm agent invite makes another one; somebody may be guessing"));
            }
            self.wait(self.until - now);
            self.accept()?;
            for connection in std::mem::take(&mut self.connections) {
                if self.serve(connection, authority)? {
                    return Ok(());
                }
            }
        }
    }

    fn wait(&self, at_most: Duration) {
        let streams = self.connections.iter().map(|connection| connection.stream.as_fd());
        let listener = self.rest.until().is_none().then(|| self.listener.as_fd());
        let fds = listener.into_iter().chain(streams);
        let mut fds: Vec<_> = fds.map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN)).collect();
        let rest = self.rest.until().map(|until| until.since(Clock::local()).max(0).unsigned_abs());
        let at_most = rest.map_or(at_most, |rest| at_most.min(Duration::from_nanos(rest)));
        let timeout = Timespec::try_from(at_most).unwrap_or(Timespec { tv_sec: 1, tv_nsec: 0 });
        // A signal that does not end the process has ended the wait, which is as good.
        let _ = poll(&mut fds, Some(&timeout));
    }

    fn accept(&mut self) -> Result<(), Failure> {
        let now = Clock::local();
        while self.rest.is_over(now) {
            let mut stream = match self.listener.accept() {
                Ok((stream, _)) => stream,
                Err(error) => {
                    let begins = has_come(&self.listener) && self.rest.begins_after(&error, now);
                    if begins && !self.connections.is_empty() {
                        self.connections.remove(0);
                    }
                    break;
                }
            };
            let nonce: Nonce = random()?;
            let mut greeting = Vec::with_capacity(GREETING);
            greeting.extend(MAGIC);
            greeting.extend(nonce);
            // The buffer of a new connection takes it.
            if stream.set_nonblocking(true).is_ok() && stream.write_all(&greeting).is_ok() {
                self.connections.push(Connection { stream, nonce, received: Vec::new() });
            }
            if self.connections.len() > CONNECTIONS {
                self.connections.remove(0);
            }
        }
        Ok(())
    }

    /// Takes what a machine says. Returns whether it is admitted.
    fn serve(&mut self, mut one: Connection, authority: &mut Authority) -> Result<bool, Failure> {
        let mut buffer = [0; 4096];
        while one.received.len() <= 2 * REQUEST_LIMIT {
            match one.stream.read(&mut buffer) {
                Ok(0) => return Ok(false),
                Ok(count) => one.received.extend_from_slice(&buffer[..count]),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(_) => return Ok(false),
            }
        }
        let judged = match Said::read(&one.received) {
            Ok(None) => {
                self.connections.push(one);
                return Ok(false);
            }
            Ok(Some(said)) => {
                let judged = self.invitation.judge(Instant::now(), &one.nonce, &said);
                judged.map(|request| (said, request))
            }
            Err(refusal) => Err(refusal),
        };
        let (said, request) = match judged {
            Ok(judged) => judged,
            Err(refusal) => {
                refuse(&one.stream, refusal);
                return Ok(false);
            }
        };
        let admitted = authority.admit(&request.name, self.is_router, &request.request, now());
        let admission = admitted.inspect_err(|_| refuse(&one.stream, Refusal::Failed))?;
        let answer = self.invitation.answer(&one.nonce, &said, &admission);
        let sent = one.stream.set_nonblocking(false);
        let sent = sent.and_then(|()| one.stream.set_write_timeout(Some(READING)));
        sent.and_then(|()| one.stream.write_all(&answer)).map_err(|error| {
            let text = format!("{} was admitted, and does not know it: {error}", request.name);
            Failure::new(text).hint("invite it again; what it was given then counts no more")
        })?;
        Ok(true)
    }
}

fn refuse(mut stream: &TcpStream, refusal: Refusal) {
    // The machine may have ended.
    let _ = stream.write_all(&[refusal.number()]);
}

fn random<const N: usize>() -> Result<[u8; N], Failure> {
    random_bytes().map_err(|error| Failure::new(error.report().message))
}
