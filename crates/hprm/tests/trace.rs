//! The logical trace of a program in one process: what is in the file, and when it is there.

use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::sync::Arc;

use hprm::trace::{Described, Digester, Trace};
use hprm::{Failure, Host, Inbox, run_whole_traced};
use hprm_core::{
    Body, ChannelId, Delay, Direction, Effect, Origin, Payload, PortId, Program, ProgramBuilder,
    Properties, ReactionId, ReactionSpec, Reading, Scheduler, Trigger,
};
use hprm_store::{Object, StoreAllocator};
use rustix::fs::OFlags;

/// Sets ports to the number of the reaction, and schedules actions without a value.
struct Numbers {
    program: Arc<Program>,
    /// The time at which everything goes wrong.
    fails_at: i64,
}

impl Host for Numbers {
    type Value = u32;

    fn react(
        &mut self,
        scheduler: &mut Scheduler<u32>,
        reaction: ReactionId,
        _: Body,
    ) -> Result<(), Failure> {
        for effect in &self.program.reactions[reaction].effects {
            match effect {
                Effect::Port(port) => _ = scheduler.set(*port, reaction.0),
                Effect::Mode(..) => unreachable!("there are no modes"),
                Effect::Action(action) => {
                    scheduler.schedule(*action, 0, None, scheduler.start_time());
                }
            }
        }
        if scheduler.tag().time >= self.fails_at {
            return Err(Failure::Quit { said: "it went wrong\nand this is why".to_owned() });
        }
        Ok(())
    }

    fn describe(&mut self, value: &u32) -> Described {
        let mut digester = Digester::new();
        digester.write(&value.to_le_bytes());
        Described { digest: digester.finish(), text: value.to_string(), opaque: false }
    }

    fn encode(
        &mut self,
        _: &StoreAllocator,
        _: ChannelId,
        _: &u32,
        _: bool,
    ) -> Result<Payload, Failure> {
        unreachable!("there is no network")
    }

    fn receive(
        &mut self,
        _: ChannelId,
        _: Payload,
        _: Vec<Object>,
        _: impl Reading,
        _: bool,
    ) -> Result<u32, Failure> {
        unreachable!("there is no network")
    }

    fn warn(&mut self, message: &str) {
        panic!("{message}");
    }
}

/// A sink before its source, so that the order of the program is not that of the levels.
fn program() -> Arc<Program> {
    let properties = Properties { timeout: Some(10), fast: true, ..Properties::default() };
    let mut b = ProgramBuilder::new("Main", properties);
    let [sink, source] = ["sink", "source"].map(|name| b.reactor(b.main(), name));
    let input = b.port(sink, "in", Direction::Input);
    let output: PortId = b.port(source, "out", Direction::Output);
    b.connect(output, input, Delay::None);
    let action = b.action(source, "again", Origin::Logical, 10);
    let on = |trigger| ReactionSpec { triggers: vec![trigger], ..ReactionSpec::default() };
    b.reaction(sink, on(Trigger::Port(input)));
    let effects = vec![Effect::Port(output), Effect::Action(action)];
    b.reaction(source, ReactionSpec { effects, ..on(Trigger::Startup) });
    b.reaction(source, on(Trigger::Action(action)));
    Arc::new(b.build().unwrap())
}

fn run(path: &Path, fails_at: i64) -> Result<(), Failure> {
    let program = program();
    let trace = Trace::create(path, &program)?;
    let mut host = Numbers { program: Arc::clone(&program), fails_at };
    run_whole_traced(&program, &mut host, &Inbox::new().unwrap(), Some(trace), None)
}

const HEADER: &str = r#"{"hprm_logical_trace":2,"program":"Main","federated":false}"#;
const FIRST: [&str; 2] = [
    r#"{"tag":[0,0],"reaction":"Main.source.1","sets":[{"port":"Main.source.out","value":{"digest":"ONE","text":"1"}}],"schedules":[{"action":"Main.source.again","at":[10,0]}]}"#,
    r#"{"tag":[0,0],"reaction":"Main.sink.1","reads":[{"from":"Main.sink.in","value":{"digest":"ONE","text":"1"}}]}"#,
];

/// The lines, with the digest of one by name.
fn lines(path: &Path) -> Vec<String> {
    let mut digester = Digester::new();
    digester.write(&1_u32.to_le_bytes());
    let one = digester.finish().to_string();
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().map(|line| line.replace(&one, "ONE")).collect()
}

#[test]
fn a_trace_has_a_header_an_entry_for_each_reaction_and_an_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.trace");
    run(&path, i64::MAX).unwrap();
    let last = [
        r#"{"tag":[10,0],"reaction":"Main.source.2","reads":[{"from":"Main.source.again"}]}"#,
        r#"{"end":[10,0],"outcome":"done"}"#,
    ];
    assert_eq!(lines(&path), [&[HEADER], &FIRST[..], &last].concat());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside it");
}

#[test]
fn the_trace_of_a_run_that_fails_is_kept_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.trace");
    assert!(run(&path, 10).unwrap_err().to_string().contains("it went wrong"));
    let end = r#"{"end":[10,0],"outcome":"failed","message":"it went wrong"}"#;
    assert_eq!(lines(&path), [&[HEADER], &FIRST[..], &[end]].concat());
}

#[test]
fn a_trace_that_cannot_be_written_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let failure = run(&folder.path().join("no/such/folder.trace"), i64::MAX).unwrap_err();
    assert!(failure.to_string().contains("cannot write the trace"), "{failure}");
}

#[test]
fn a_trace_that_cannot_be_written_any_more_leaves_nothing_and_is_an_error() {
    let failure = run(Path::new("/dev/full"), i64::MAX).unwrap_err();
    assert_eq!(failure.kind(), hprm::Kind::Trace);
    let text = failure.report().text(hprm::Label::Error, false);
    assert!(text.contains("cannot write the trace /dev/full: No space left on device"), "{text}");
    assert!(text.contains("hint: make room there"), "{text}");
}

#[test]
fn what_is_no_plain_file_is_written_to_and_stays() {
    let folder = tempfile::tempdir().unwrap();
    let [real, link] = ["real", "link"].map(|name| folder.path().join(name));
    std::fs::write(&real, "what was there before, and longer than a trace\n".repeat(99)).unwrap();
    std::os::unix::fs::symlink(&real, &link).unwrap();
    run(&link, i64::MAX).unwrap();
    assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(lines(&real).len(), 5);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is left beside it");

    let pipe = folder.path().join("pipe");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(made.success());
    let unread = run(&pipe, i64::MAX).unwrap_err().to_string();
    assert!(unread.contains("pipe: nothing reads this pipe"), "{unread}");
    let at_once = OFlags::NONBLOCK.bits().cast_signed();
    let reader = std::fs::OpenOptions::new().read(true).custom_flags(at_once).open(&pipe);
    run(&pipe, i64::MAX).unwrap();
    assert_eq!(std::io::read_to_string(reader.unwrap()).unwrap().lines().count(), 5);
    assert!(!std::fs::metadata(&pipe).unwrap().is_file());
}

#[test]
fn a_folder_is_refused_before_anything_runs() {
    let folder = tempfile::tempdir().unwrap();
    let failure = Trace::create(folder.path(), &program()).unwrap_err();
    let name = folder.path().display();
    assert_eq!(failure.to_string(), format!("cannot write the trace {name}: is a directory"));
    assert!(!folder.path().with_extension("partial").exists());
}
