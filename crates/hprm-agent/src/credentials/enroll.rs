//! A machine's side of an enrolment.

use std::io::{self, BufRead, IsTerminal, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use hprm::random_bytes;

use super::authority::{self, Admission};
use super::code::{Code, PROOF};
use super::exchange::{ADMISSION_LIMIT, GREETING, MAGIC, Nonce, Refusal, Request, Said};
use crate::Failure;

/// How long the authority may take to be reached, and to answer.
const CONNECTING: Duration = Duration::from_secs(10);
const ANSWERING: Duration = Duration::from_secs(30);

/// What a machine has after its enrolment: the key is made here, the rest comes.
pub(super) struct Enrolled {
    pub(super) key: String,
    pub(super) admission: Admission,
}

/// Asks the authority at `place` for a certificate.
pub(super) fn enroll(place: &str, name: &str, code: &Code) -> Result<Enrolled, Failure> {
    let mut stream = connect(place)?;
    let broken = |error: io::Error| Failure::new(format!("the link to {place} has ended: {error}"));
    let mut greeting = [0; GREETING];
    stream.read_exact(&mut greeting).map_err(broken)?;
    let (magic, nonce) = greeting.split_at(MAGIC.len());
    if magic != MAGIC {
        return Err(Failure::new(format!(
            "no authority of this version of hprm listens at {place}"
        ))
        .hint("on its machine, `hprm agent invite` says where it listens"));
    }
    let nonce: Nonce = nonce.try_into().expect("the rest is the nonce");
    let (key, request) = authority::request(name)?;
    let mine = random_bytes().map_err(|error| Failure::new(error.report().message))?;
    let said = Said::new(code, &nonce, mine, &Request { name: name.to_owned(), request });
    stream.write_all(&said.bytes()).map_err(broken)?;
    let mut verdict = [0];
    stream.read_exact(&mut verdict).map_err(broken)?;
    if verdict[0] != 0 {
        let why = Refusal::of_number(verdict[0]);
        let why = why.map_or_else(|| "it does not say why".to_owned(), |why| why.to_string());
        return Err(Failure::new(format!("the authority refuses {name}: {why}"))
            .hint(format!("`hprm agent invite {name}` on its machine makes a new code")));
    }
    let mut len = [0; 4];
    stream.read_exact(&mut len).map_err(broken)?;
    let len = u32::from_be_bytes(len) as usize;
    if len > ADMISSION_LIMIT {
        return Err(Failure::new("whoever answers is not the authority: the answer is too long"));
    }
    // As much as comes, not as much as is announced.
    let (mut admission, mut proof) = (Vec::new(), [0; PROOF]);
    let taken = (&mut stream).take(len as u64).read_to_end(&mut admission).map_err(broken)?;
    if taken < len {
        return Err(broken(io::ErrorKind::UnexpectedEof.into()));
    }
    stream.read_exact(&mut proof).map_err(broken)?;
    let admission = said.admitted(code, &nonce, &admission, &proof).map_err(|why| {
        Failure::new(why).hint("somebody may stand between both machines: make sure of the address")
    })?;
    Ok(Enrolled { key, admission })
}

fn connect(place: &str) -> Result<TcpStream, Failure> {
    let failed = |error: io::Error| {
        Failure::new(format!("no authority listens at {place}: {error}"))
            .hint("on its machine, `hprm agent invite MACHINE` listens until the code is used or has expired")
    };
    let mut last = io::ErrorKind::AddrNotAvailable.into();
    for address in place.to_socket_addrs().map_err(failed)? {
        match TcpStream::connect_timeout(&address, CONNECTING) {
            Ok(stream) => {
                let set = stream.set_read_timeout(Some(ANSWERING));
                set.and_then(|()| stream.set_write_timeout(Some(ANSWERING))).map_err(failed)?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(failed(last))
}

/// Asks a person for the code, or reads it from the standard input: in the list of processes, others would see it.
pub(super) fn ask() -> Result<Code, Failure> {
    let input = io::stdin();
    if input.is_terminal() {
        eprint!("code: ");
    }
    let mut line = String::new();
    let read = input.lock().take(256).read_line(&mut line);
    read.map_err(|error| Failure::new(format!("cannot read the code: {error}")))?;
    Code::read(&line).ok_or_else(|| {
        Failure::new("that is no code: one has 16 letters and digits, as in 7K2Q-X3M2-P9RT-BWZ4")
            .hint("`hprm agent invite` on the authority's machine prints it")
    })
}
