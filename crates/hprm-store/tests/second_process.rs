//! A reader in a process of its own: it gets a descriptor and a reference, and nothing else.
//!
//! The test starts itself again as the reader. The descriptor arrives as its standard input, so no
//! unsafe code and no socket is needed; hence a `main` of its own instead of the test harness.

use std::fmt::Display;
use std::fs;
use std::io::{self, BufRead, BufReader, Write};
use std::os::fd::AsFd;
use std::process::{Child, Command, Stdio};

use hprm_core::{FederateId, ObjectRef};
use hprm_store::{Store, StoreLimits};

const A: FederateId = FederateId(0);
const B: FederateId = FederateId(1);
/// The first argument of the reader.
const READER: &str = "as-reader";

fn main() {
    let args: Vec<String> = std::env::args().collect();
    if args.get(1).is_some_and(|arg| arg == READER) {
        read(&args[2..]);
    } else {
        a_reader_sees_the_bytes_and_its_death_leaves_nothing();
        print("a_reader_sees_the_bytes_and_its_death_leaves_nothing ... ok");
    }
}

fn print(line: impl Display) {
    writeln!(io::stdout(), "{line}").expect("the standard output is open");
}

/// The reader: maps its standard input, opens the object, reports it, and waits to be killed.
fn read(args: &[String]) {
    let numbers: Vec<u64> = args.iter().map(|arg| arg.parse().expect("a number")).collect();
    let [segment_len, serial, segment, offset, len] = numbers[..] else { panic!("{args:?}") };
    let segment = u32::try_from(segment).expect("a segment number");
    let mut store = Store::new(B, StoreLimits::default());
    let fd = io::stdin().as_fd().try_clone_to_owned().expect("a descriptor");
    store.attach(A, segment, segment_len, fd).expect("a sealed segment");
    let object =
        store.open(ObjectRef { owner: A, serial, segment, offset, len }).expect("an object");
    let sum: u64 = object.as_bytes().iter().map(|byte| u64::from(*byte)).sum();
    print(sum);
    loop {
        std::thread::park();
    }
}

fn a_reader_sees_the_bytes_and_its_death_leaves_nothing() {
    let named = shared_memory_names();
    let mut store = Store::new(A, StoreLimits::default());
    let image: Vec<u8> = (0..5_000_000_u32).map(|i| i.to_be_bytes()[3]).collect();
    let object = store.put(&image, &[B]).expect("memory for 5 MB");
    let announcements = store.unannounced(B);
    let [announcement] = &announcements[..] else { panic!("{announcements:?}") };

    let fd = announcement.as_fd().try_clone_to_owned().expect("a descriptor");
    let mut reader = start_reader(announcement.len, object, fd.into());
    let seen = first_line(&mut reader);
    assert_eq!(shared_memory_names(), named, "the store has no name in the file system");
    reader.kill().expect("the reader runs");
    reader.wait().expect("the reader was killed");

    let sum: u64 = image.iter().map(|byte| u64::from(*byte)).sum();
    assert_eq!(seen, sum.to_string());
    assert_eq!(store.stats().bytes_in_use, 5_001_216, "the reader held the object until its end");
    store.reader_lost(B);
    assert_eq!(store.stats().bytes_in_use, 0);
}

fn start_reader(segment_len: u64, object: ObjectRef, segment: Stdio) -> Child {
    let ObjectRef { serial, offset, len, .. } = object;
    let numbers = [segment_len, serial, object.segment.into(), offset, len];
    Command::new(std::env::current_exe().expect("the path of this program"))
        .arg(READER)
        .args(numbers.map(|number| number.to_string()))
        .stdin(segment)
        .stdout(Stdio::piped())
        .spawn()
        .expect("this program starts again")
}

fn first_line(reader: &mut Child) -> String {
    let output = reader.stdout.as_mut().expect("the output is a pipe");
    let line = BufReader::new(output).lines().next();
    line.expect("the reader reports what it saw").expect("the pipe is read")
}

/// The names of this store in /dev/shm; other programs of the host may add and remove theirs.
fn shared_memory_names() -> Vec<String> {
    let entries = fs::read_dir("/dev/shm").into_iter().flatten().flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.filter(|name| name.contains("hprm")).collect()
}
