//! The share of one process: its records as they are, in a file that may end anywhere.
//!
//! The file begins with [`MAGIC`], the length of the [`Names`] as JSON, and these. Then come blocks: what it is, a
//! number, a length, and so many bytes. All numbers are those of this machine: a share is read by the same version, here or on
//! another machine, and all machines for which HPRM is made have the same numbers. What a process has written before it is
//! killed is all there.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, ErrorKind, Read, Write};
use std::path::Path;

use super::collector::Reader;
use super::names::{Member, Names};
use super::record::{Record, Words};

const MAGIC: &[u8; 8] = b"HPRMrec1";

/// Longer names than those of any program.
const MOST_NAMES: u64 = 1 << 30;

const RECORDS: u32 = 1;
const NAME: u32 = 2;
const END: u32 = 3;

/// A share of another order of bytes would be read as something else.
const _: () = assert!(cfg!(target_endian = "little"), "shares travel between machines as they are");

/// The name of the file that is the share of a member.
pub(super) fn file_of(member: Member) -> String {
    match member {
        Member::Whole => "whole".to_owned(),
        Member::Rti => "rti".to_owned(),
        Member::Federate(number) => format!("federate-{number}"),
    }
}

/// Writes a share.
#[derive(Debug)]
pub(super) struct ShareWriter {
    out: BufWriter<File>,
}

impl ShareWriter {
    pub(super) fn create(path: &Path, names: &Names) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 16, File::create(path)?);
        let names = serde_json::to_vec(names)?;
        out.write_all(MAGIC)?;
        out.write_all(&(names.len() as u64).to_ne_bytes())?;
        out.write_all(&names)?;
        out.flush()?;
        Ok(Self { out })
    }

    fn block(&mut self, what: u32, number: u32, len: usize) -> io::Result<()> {
        self.out.write_all(&what.to_ne_bytes())?;
        self.out.write_all(&number.to_ne_bytes())?;
        self.out.write_all(&(len as u64).to_ne_bytes())
    }
}

impl Reader for ShareWriter {
    fn name(&mut self, number: u32, name: &str) -> io::Result<()> {
        self.block(NAME, number, name.len())?;
        self.out.write_all(name.as_bytes())
    }

    fn records(&mut self, lane: usize, records: &[Words]) -> io::Result<()> {
        let lane = u32::try_from(lane).unwrap_or(u32::MAX);
        self.block(RECORDS, lane, size_of_val(records))?;
        self.out.write_all(bytemuck::cast_slice(records))?;
        // What is in the file outlives this process.
        self.out.flush()
    }

    fn end(&mut self) -> io::Result<()> {
        self.block(END, 0, 0)?;
        self.out.flush()
    }
}

/// What a share contains, piece by piece.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Content {
    /// Tracepoints with this number have this name.
    Name(u32, String),
    /// Records of a lane, in their order.
    Records(u32, Vec<Record>),
    /// The process has ended in order.
    End,
}

/// Reads a share.
#[derive(Debug)]
pub struct ShareReader<R> {
    input: R,
    /// What the numbers in its records mean.
    pub names: Names,
}

impl ShareReader<BufReader<File>> {
    /// Opens a share.
    ///
    /// # Errors
    ///
    /// If it cannot be read, or is none.
    pub fn open(path: &Path) -> io::Result<Self> {
        Self::new(BufReader::new(File::open(path)?))
    }
}

impl<R: Read> ShareReader<R> {
    /// Reads a share from its beginning.
    ///
    /// # Errors
    ///
    /// If that is none.
    pub fn new(mut input: R) -> io::Result<Self> {
        let mut magic = [0; MAGIC.len()];
        input.read_exact(&mut magic)?;
        let len = number(&mut input)?;
        if &magic != MAGIC || len > MOST_NAMES {
            return Err(io::Error::new(ErrorKind::InvalidData, "no share of a trace"));
        }
        let mut names = Vec::new();
        input.by_ref().take(len).read_to_end(&mut names)?;
        Ok(Self { input, names: serde_json::from_slice(&names)? })
    }

    /// The next piece; none where the file ends, in order or not.
    ///
    /// # Errors
    ///
    /// If it cannot be read, or what is there is no share.
    pub fn next_content(&mut self) -> io::Result<Option<Content>> {
        match self.read_block() {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(None),
            other => other.map(Some),
        }
    }

    fn read_block(&mut self) -> io::Result<Content> {
        let both = number(&mut self.input)?.to_ne_bytes();
        let [what, subject] =
            [[both[0], both[1], both[2], both[3]], [both[4], both[5], both[6], both[7]]];
        let (what, subject) = (u32::from_ne_bytes(what), u32::from_ne_bytes(subject));
        let len = number(&mut self.input)?;
        let mut bytes = Vec::new();
        self.input.by_ref().take(len).read_to_end(&mut bytes)?;
        let is_whole = bytes.len() as u64 == len;
        match what {
            RECORDS => {
                let records = bytes
                    .chunks_exact(size_of::<Words>())
                    .filter_map(|chunk| Record::of_words(bytemuck::pod_read_unaligned(chunk)));
                Ok(Content::Records(subject, records.collect()))
            }
            NAME if is_whole => {
                Ok(Content::Name(subject, String::from_utf8_lossy(&bytes).into_owned()))
            }
            END => Ok(Content::End),
            NAME => Err(ErrorKind::UnexpectedEof.into()),
            _ => Err(io::Error::new(ErrorKind::InvalidData, "no share of a trace")),
        }
    }
}

fn number(input: &mut impl Read) -> io::Result<u64> {
    let mut bytes = [0; 8];
    input.read_exact(&mut bytes)?;
    Ok(u64::from_ne_bytes(bytes))
}

#[cfg(test)]
pub(super) mod tests {
    use hprm_core::Tag;

    use super::super::names::Member;
    use super::super::record::{Flags, Kind};
    use super::*;

    pub(in super::super) fn names(member: Member) -> Names {
        Names {
            program: "Main".to_owned(),
            member,
            process: 7,
            federates: vec!["a".to_owned(), "b".to_owned()],
            reactions: vec!["Main.a.1".to_owned(), "Main.b.1".to_owned()],
            channels: vec![super::super::names::ChannelName {
                from: "Main.a.out".to_owned(),
                to: "Main.b.in".to_owned(),
                physical: false,
            }],
            actions: vec!["Main.a.go".to_owned()],
        }
    }

    fn contents(bytes: &[u8]) -> Vec<Content> {
        let mut share = ShareReader::new(bytes).unwrap();
        std::iter::from_fn(|| share.next_content().unwrap()).collect()
    }

    #[test]
    fn a_share_that_ends_anywhere_has_what_was_before() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let record = Record::new(Kind::Scheduled, Flags::NONE, 0, Tag::new(5, 1));
        let mut writer = ShareWriter::create(&path, &names(Member::Federate(0))).unwrap();
        let begin = path.metadata().unwrap().len();
        writer.name(1, "grasp").unwrap();
        writer.records(2, &[record.words(), record.words()]).unwrap();
        writer.end().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let whole = [
            Content::Name(1, "grasp".to_owned()),
            Content::Records(2, vec![record, record]),
            Content::End,
        ];
        assert_eq!(contents(&bytes), whole);
        for end in usize::try_from(begin).unwrap()..bytes.len() {
            for (part, whole) in contents(&bytes[..end]).iter().zip(&whole) {
                match (part, whole) {
                    (Content::Records(_, some), Content::Records(_, all)) => {
                        assert!(all.starts_with(some));
                    }
                    (part, whole) => assert_eq!(part, whole),
                }
            }
        }
        assert!(ShareReader::new(&b"no share at all, but long enough"[..]).is_err());
    }
}
