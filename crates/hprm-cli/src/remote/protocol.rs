//! What a stand-in and a starter say to one another, as frames on a stream: a length of four bytes, the least
//! significant first, and a message as postcard writes it.
//!
//! ```text
//! starter: Challenge    stand-in: Proof      both have the key
//! starter: Proved       stand-in: Program
//! starter: Missing      stand-in: Bytes ...  the files that are not in the cache, one after the other
//! starter: Started, Output ..., Recorded ..., Trace ..., Ended; meanwhile the stand-in: Signal ...
//! ```
//!
//! Where the run is traced, the stand-in also asks for the `Clock`: some times before `Program`, and now and then while the
//! federate runs. The starter answers that; in the latter case if nothing else is on its way at that moment.
//!
//! Instead of anything, the starter may say `Failed`, and end.

use std::io::{self, Read, Write};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// The version of these messages.
pub(super) const VERSION: u32 = 3;

/// The most bytes of a message.
pub(super) const MESSAGE_LIMIT: usize = 4 << 20;

/// How many bytes of a file, or of what a federate prints, are in one message.
pub(super) const CHUNK: usize = 128 << 10;

/// A random number that is used once.
pub(super) type Nonce = [u8; 32];

/// A proof that one has the key.
pub(super) type Proof = [u8; 32];

/// The digest of a file (SHA-256).
pub(super) type Digest = [u8; 32];

/// What a stand-in says.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) enum Asked {
    /// That it has the key.
    Proof { nonce: Nonce, proof: Proof },
    /// What is to be started.
    Program(Box<Manifest>),
    /// What comes next of the missing files.
    Bytes(Vec<u8>),
    /// A signal for the federate.
    Signal(i32),
    /// What the clock there shows; it was asked at this time of the clock here.
    Clock(i64),
}

/// What a starter says.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) enum Told {
    /// What the proof must be about.
    Challenge { version: u32, nonce: Nonce },
    /// That it has the key, too.
    Proved(Proof),
    /// Which files it does not have, by their places in the manifest.
    Missing(Vec<u32>),
    /// The federate runs.
    Started,
    /// The federate has written this, to its standard error or its standard output.
    Output { is_error: bool, bytes: Vec<u8> },
    /// What comes next of the federate's share of the logical trace.
    Trace(Vec<u8>),
    /// The federate has ended.
    Ended(Ended),
    /// It cannot be started.
    Failed { message: String, hint: Option<String> },
    /// What comes next of what the federate has recorded for the trace of the run; nothing now and then, when nothing comes.
    Recorded(Vec<u8>),
    /// What the clock has shown, when it was asked for at that time of the other one.
    Clock { asked: i64, shown: i64 },
}

/// How a federate has ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) enum Ended {
    /// With this exit code.
    Code(i32),
    /// By this signal.
    Signal(i32),
    /// By the system, because all of its processes together may have that many bytes of memory.
    Memory(u64),
}

/// A federate that is to be started, and the files that it needs.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct Manifest {
    /// The program: one of the files and, for some programs in Python, the name of a reactor.
    pub(super) main: String,
    pub(super) reactor: Option<String>,
    pub(super) federate: String,
    /// Where the RTI listens.
    pub(super) rti: String,
    /// The secret of the federation.
    pub(super) federation: String,
    /// Target properties that override those of the program, `KEY=VALUE` each.
    pub(super) properties: Vec<String>,
    /// What the program finds in `sys.argv`.
    pub(super) arguments: Vec<String>,
    /// Whether the federate writes a share of a logical trace, and what the user calls that.
    pub(super) trace: Option<String>,
    /// Whether the federate records for the trace of the run, and how many records wait for each of its threads at most.
    pub(super) record: Option<u64>,
    pub(super) files: Vec<Listed>,
}

/// A file of a program.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct Listed {
    /// Where it lies below the folder of the program's files: names with `/` between them.
    pub(super) path: String,
    pub(super) len: u64,
    pub(super) digest: Digest,
    pub(super) is_executable: bool,
}

/// Writes a message.
///
/// # Errors
///
/// If the stream takes no more, or the message is too long.
pub(super) fn write(mut stream: impl Write, message: &impl Serialize) -> io::Result<()> {
    let text = postcard::to_allocvec(message).map_err(io::Error::other)?;
    let len = u32::try_from(text.len()).ok().filter(|_| text.len() <= MESSAGE_LIMIT);
    let len = len.ok_or_else(|| io::Error::other("a message is too long"))?;
    let mut frame = len.to_le_bytes().to_vec();
    frame.extend(text);
    stream.write_all(&frame)
}

/// Reads the next message; none if the stream has ended before it.
///
/// # Errors
///
/// If the stream ends within a message, or has none.
pub(super) fn read<T: DeserializeOwned>(mut stream: impl Read) -> io::Result<Option<T>> {
    let mut len = [0; 4];
    let mut filled = 0;
    while filled < len.len() {
        match stream.read(&mut len[filled..]) {
            Ok(0) if filled == 0 => return Ok(None),
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => filled += count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    let len = u32::from_le_bytes(len) as usize;
    let invalid = || io::Error::new(io::ErrorKind::InvalidData, "that is no message");
    if len > MESSAGE_LIMIT {
        return Err(invalid());
    }
    // As much as comes, not as much as is announced.
    let mut text = Vec::new();
    stream.take(len as u64).read_to_end(&mut text)?;
    if text.len() < len {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    postcard::from_bytes(&text).map(Some).map_err(|_| invalid())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_arrive_as_they_were_sent_and_others_are_refused() {
        let file =
            Listed { path: "a/b.py".to_owned(), len: 3, digest: [7; 32], is_executable: true };
        let manifest = Manifest {
            main: "Main.lf".to_owned(),
            reactor: None,
            federate: "camera".to_owned(),
            rti: "agent:a/b".to_owned(),
            federation: "0".repeat(32),
            properties: vec!["workers=2".to_owned()],
            arguments: Vec::new(),
            trace: Some("trace".to_owned()),
            record: Some(8),
            files: vec![file],
        };
        let sent =
            [Asked::Signal(15), Asked::Program(Box::new(manifest)), Asked::Bytes(vec![0; 9])];
        let mut stream = Vec::new();
        sent.iter().for_each(|message| write(&mut stream, message).unwrap());
        let mut rest = stream.as_slice();
        for message in &sent {
            assert_eq!(read::<Asked>(&mut rest).unwrap().as_ref(), Some(message));
        }
        assert_eq!(read::<Asked>(&mut rest).unwrap(), None);
        for cut in 1..stream.len() {
            let mut rest = &stream[..cut];
            while let Ok(Some(_)) = read::<Asked>(&mut rest) {}
            assert!(rest.is_empty());
        }
        assert!(read::<Asked>([255; 64].as_slice()).is_err());
        assert!(read::<Asked>([2, 0, 0, 0, 99, 99].as_slice()).is_err());
        assert!(write(io::sink(), &Asked::Bytes(vec![0; MESSAGE_LIMIT])).is_err());
    }
}
