//! The process on another machine that starts a federate for a stand-in, and ends it when the link to that ends.

use std::io::{self, Read};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use hprm::launch::{Group, die_with_parent};
use hprm::recorder::{Outbox, TRACE};
use hprm::{Clock, printable};
use rustix::process::{
    Pid, Signal, WaitId, WaitIdOptions, kill_process, kill_process_group, waitid,
};

use super::cache::{self, Cache, Laid};
use super::key::{self, Occasion, Side};
use super::limits::Limits;
use super::protocol::{self, Asked, CHUNK, Ended, Listed, Manifest, Told};
use super::recording::Sending;
use crate::args::{Interpreter, Starter};
use crate::launch::{FEDERATION_ID, PROPERTIES};
use crate::message::{self, Error, print_error};
use crate::python;

/// How long the stand-in may take to say what it wants, and how long a pause in a file may be.
const ASKING: Duration = Duration::from_secs(30);

/// How long a federate may take to end that has lost its stand-in, and what it has written to be read.
const ENDING: Duration = Duration::from_secs(3);
const LAST_WORDS: Duration = Duration::from_secs(30);

/// The signal by which the system ends processes, too.
const KILL: i32 = Signal::KILL.as_raw();

/// Where a federate writes its share of the logical trace, and what it records in physical time, beside the files of its
/// program.
const SHARE: &str = ".logical-trace";
const RECORDED: &str = ".trace";

/// Starts a federate, as the stand-in at the other end of the standard input says, and follows it to its end.
///
/// # Errors
///
/// What the stand-in is told as well.
pub(crate) fn starter(wanted: &Starter) -> Result<ExitCode, Error> {
    let failed = |error: io::Error| Error::new(format!("cannot start a federate: {error}"));
    if !die_with_parent(wanted.agent).map_err(failed)? {
        return Ok(ExitCode::FAILURE);
    }
    let stream = io::stdin().as_fd().try_clone_to_owned().map_err(failed)?;
    let stream = UnixStream::from(stream);
    stream.set_read_timeout(Some(ASKING)).map_err(failed)?;
    match serve(&stream, wanted) {
        Ok(()) => Ok(ExitCode::SUCCESS),
        Err(error) => {
            let report = error.report();
            let (message, hint) = (report.message.clone(), report.hint.clone());
            // The stand-in may have ended.
            let _ = protocol::write(&stream, &Told::Failed { message, hint });
            Err(error)
        }
    }
}

fn serve(stream: &UnixStream, wanted: &Starter) -> Result<(), Error> {
    let machine = &wanted.machine;
    let failed = |what: &str, error: &io::Error| {
        Error::new(format!("{machine} cannot {what}: {}", message::reason(error)))
    };
    if rustix::process::geteuid().is_root() && !wanted.allow_root {
        return Err(Error::new(format!("the agent of {machine} runs as root, and starts no programs"))
            .hint("run it as another user; or, if programs of others may be root there, with --allow-root"));
    }
    let owner = admit(stream, wanted)?;
    let Some(manifest) = wanted_program(stream)? else { return Ok(()) };
    if let Some(mistake) = cache::mistake(&manifest.main, &manifest.files) {
        return Err(Error::new(mistake));
    }
    let cache = Cache::open().map_err(|error| failed("keep files of programs", &error))?;
    fetch(stream, &cache, &manifest.files)
        .map_err(|error| failed("take the files of the program", &error))?;
    let laid = cache.lay_out(&manifest.files);
    let laid = laid.map_err(|error| failed("lay out the files of the program", &error))?;
    let mut command = command(&manifest, &laid)?;
    let outbox = manifest.record.map(|_| Outbox::create(laid.folder().join(RECORDED))).transpose();
    let outbox = outbox.map_err(|error| failed("keep what the federate records", &error))?;
    if let Some((outbox, capacity)) = outbox.as_ref().zip(manifest.record) {
        let capacity = usize::try_from(capacity).unwrap_or(usize::MAX);
        command.env(TRACE, outbox.request(capacity).variable());
    }
    let Starter { memory, processes, files, .. } = *wanted;
    let limits = Limits { memory, processes, files };
    limits.apply().map_err(|error| failed("limit what a program uses", &error))?;
    let group = wanted.group.clone().map(Group::at);
    let child = match &group {
        Some(group) => group.start(&mut command),
        None => command.spawn(),
    };
    let child = child.map_err(|error| failed("start an interpreter", &error))?;
    let Manifest { federate, main, .. } = &*manifest;
    let (federate, main) = (printable(federate), printable(main));
    print_error(format!("federate {federate} of {main} has been started for {owner}\n").as_bytes());
    let stream = stream.try_clone().map_err(|error| failed("run", &error))?;
    let run = Run { stream: Arc::new(Mutex::new(stream)), group, memory };
    let share = manifest.trace.is_some().then(|| laid.folder().join(SHARE));
    let ended = run.follow(child, share.as_deref(), outbox);
    let ended = ended.map_err(|error| failed("follow it", &error))?;
    // The files are gone before the launcher knows that all is over.
    drop(laid);
    // The stand-in may have ended.
    let _ = run.tell(&Told::Ended(ended));
    Ok(())
}

/// What the stand-in wants to have started; it may ask for the time before. Nothing, if the launcher only wanted to know
/// whether it might.
fn wanted_program(stream: &UnixStream) -> Result<Option<Box<Manifest>>, Error> {
    let unsaid = || Error::new("the stand-in does not say what is to be started");
    loop {
        match protocol::read(stream) {
            Ok(Some(Asked::Clock(asked))) => {
                let told = Told::Clock { asked, shown: Clock::local().0 };
                protocol::write(stream, &told).map_err(|_| unsaid())?;
            }
            Ok(Some(Asked::Program(manifest))) => return Ok(Some(manifest)),
            Ok(None) => return Ok(None),
            _ => return Err(unsaid()),
        }
    }
}

/// Has the stand-in prove that it may, and returns what the owner of its key is called.
fn admit(stream: &UnixStream, wanted: &Starter) -> Result<String, Error> {
    let machine = &wanted.machine;
    let refused = || {
        Error::new(format!("{machine} does not know the fleet key")).hint(format!(
            "add its line to the file that the agent of {machine} has as --fleet-keys"
        ))
    };
    let mine = key::nonce()?;
    let gone = |_| Error::new("the stand-in has ended");
    protocol::write(stream, &Told::Challenge { version: protocol::VERSION, nonce: mine })
        .map_err(gone)?;
    let Ok(Some(Asked::Proof { nonce, proof })) = protocol::read(stream) else {
        return Err(refused());
    };
    let occasion = Occasion { machine, nonces: [mine, nonce] };
    // Read each time, so that a key that is taken out of the file counts no more.
    let keys = key::read(&wanted.keys)?;
    let known = keys.iter().find(|key| key.is_proved(Side::StandIn, &occasion, &proof));
    let known = known.ok_or_else(refused)?;
    protocol::write(stream, &Told::Proved(known.prove(Side::Starter, &occasion))).map_err(gone)?;
    Ok(if known.owner.is_empty() { "a key without a name".to_owned() } else { known.owner.clone() })
}

/// Takes the files that are not there yet.
fn fetch(stream: &UnixStream, cache: &Cache, listed: &[Listed]) -> io::Result<()> {
    let missing = cache.missing(listed);
    let places = missing.iter().map(|place| u32::try_from(*place).unwrap_or(u32::MAX)).collect();
    protocol::write(stream, &Told::Missing(places))?;
    for place in missing {
        cache.keep(&listed[place], Incoming { stream, bytes: Vec::new(), taken: 0 })?;
    }
    Ok(())
}

/// What comes of a file.
struct Incoming<'a> {
    stream: &'a UnixStream,
    bytes: Vec<u8>,
    taken: usize,
}

impl Read for Incoming<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.taken == self.bytes.len() {
            self.bytes = match protocol::read(self.stream)? {
                Some(Asked::Bytes(bytes)) => bytes,
                Some(_) => return Err(io::ErrorKind::InvalidData.into()),
                None => return Err(io::ErrorKind::UnexpectedEof.into()),
            };
            self.taken = 0;
        }
        let count = (&self.bytes[self.taken..]).read(buffer)?;
        self.taken += count;
        Ok(count)
    }
}

/// The interpreter that runs the federate, as a launcher on this machine would start it.
fn command(manifest: &Manifest, laid: &Laid) -> Result<Command, Error> {
    let main = laid.folder().join(&manifest.main);
    let home = main.parent().unwrap_or(laid.folder());
    let mut name = main.clone().into_os_string();
    if let Some(reactor) = &manifest.reactor {
        name.push(":");
        name.push(reactor);
    }
    let mut command = python::module(&python::find(&Interpreter::default())?, "federate");
    command.arg("--rti").arg(&manifest.rti);
    if let Some(trace) = &manifest.trace {
        command.arg("--logical-trace").arg(laid.folder().join(SHARE));
        command.arg("--share-of").arg(trace);
    }
    command.args(manifest.properties.iter().map(|stated| format!("--property={stated}")));
    command.arg("--launched");
    command.arg("--die-with-parent").arg(std::process::id().to_string());
    command.arg("--").arg(name).arg(&manifest.federate).args(&manifest.arguments);
    command.current_dir(home).process_group(0);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.env(FEDERATION_ID, &manifest.federation);
    command.env(PROPERTIES, manifest.properties.join("\n"));
    Ok(command)
}

/// A federate that runs.
#[derive(Clone)]
struct Run {
    stream: Arc<Mutex<UnixStream>>,
    /// What all of its processes are in, and how many bytes they may have together.
    group: Option<Group>,
    memory: u64,
}

impl Run {
    /// Follows the federate to its end.
    fn follow(
        &self,
        mut child: Child,
        share: Option<&Path>,
        outbox: Option<Outbox>,
    ) -> io::Result<Ended> {
        let pid = Pid::from_child(&child);
        let has_ended = Arc::new(AtomicBool::new(false));
        self.tell(&Told::Started)?;
        let run = self.clone();
        let sending = outbox.map(|it| Sending::start(it, move |told: &Told| run.tell(told)));
        let (said, words) = channel::<()>();
        let pipes: [(bool, Option<Box<dyn Read + Send>>); 2] = [
            (false, child.stdout.take().map(|pipe| Box::new(pipe) as _)),
            (true, child.stderr.take().map(|pipe| Box::new(pipe) as _)),
        ];
        for (is_error, pipe) in pipes {
            let (run, said) = (self.clone(), said.clone());
            thread::spawn(move || {
                pipe.into_iter().for_each(|pipe| run.copy(pipe, is_error));
                drop(said);
            });
        }
        drop(said);
        let reader = self.stream.lock().unwrap_or_else(PoisonError::into_inner).try_clone()?;
        reader.set_read_timeout(None)?;
        let (run, ended) = (self.clone(), Arc::clone(&has_ended));
        thread::spawn(move || run.obey(&reader, pid, &ended));
        // Not reaped yet, so that its number stays its own.
        while waitid(WaitId::Pid(pid), WaitIdOptions::EXITED | WaitIdOptions::NOWAIT).is_err() {}
        has_ended.store(true, Ordering::SeqCst);
        // What it has started ends with it.
        let _ = kill_process_group(pid, Signal::KILL);
        self.group.iter().for_each(Group::kill);
        // All that they have written is on its way then; unless, without a control group, a process has left that of the
        // federate, and writes for ever.
        let _ = words.recv_timeout(LAST_WORDS);
        let status = child.wait()?;
        let has_lacked_memory = self.group.as_ref().is_some_and(Group::has_lacked_memory);
        // What is not gone by then, the agent removes.
        let _ = self.group.as_ref().is_some_and(|group| group.end(ENDING));
        sending.into_iter().for_each(Sending::finish);
        self.send_share(share)?;
        Ok(match (status.code(), status.signal().unwrap_or_default()) {
            (Some(code), _) => Ended::Code(code),
            (None, KILL) if has_lacked_memory => Ended::Memory(self.memory),
            (None, signal) => Ended::Signal(signal),
        })
    }

    fn tell(&self, told: &Told) -> io::Result<()> {
        let stream = self.stream.lock().unwrap_or_else(PoisonError::into_inner);
        protocol::write(&*stream, told)
    }

    /// Leads what the federate writes to the stand-in.
    fn copy(&self, mut pipe: impl Read, is_error: bool) {
        let mut buffer = vec![0; CHUNK];
        while let Ok(count @ 1..) = pipe.read(&mut buffer) {
            let bytes = buffer[..count].to_vec();
            if self.tell(&Told::Output { is_error, bytes }).is_err() {
                return;
            }
        }
    }

    fn send_share(&self, share: Option<&Path>) -> io::Result<()> {
        let Some(mut file) = share.and_then(|path| std::fs::File::open(path).ok()) else {
            return Ok(());
        };
        let mut buffer = vec![0; CHUNK];
        loop {
            match file.read(&mut buffer)? {
                0 => return Ok(()),
                count => self.tell(&Told::Trace(buffer[..count].to_vec()))?,
            }
        }
    }

    /// Sends the federate the signals that come; ends it when no more can.
    fn obey(&self, stream: &UnixStream, pid: Pid, has_ended: &AtomicBool) {
        let send = |signal: Signal| {
            if !has_ended.load(Ordering::SeqCst) {
                // It may end this moment; it is not reaped before what it has started is ended.
                let _ = match signal {
                    Signal::INT => kill_process(pid, signal),
                    _ => kill_process_group(pid, signal),
                };
            }
        };
        loop {
            match protocol::read(stream) {
                Ok(Some(Asked::Signal(number))) => {
                    Signal::from_named_raw(number).into_iter().for_each(send);
                }
                Ok(Some(Asked::Clock(asked))) => self.tell_time(asked),
                _ => break,
            }
        }
        send(Signal::TERM);
        thread::sleep(ENDING);
        send(Signal::KILL);
    }

    /// Tells what the clock shows, unless the stream is in use: signals do not wait for that, and an answer that waits says
    /// little.
    fn tell_time(&self, asked: i64) {
        if let Ok(stream) = self.stream.try_lock() {
            // Without a stand-in, the federate is about to be ended.
            let _ = protocol::write(&*stream, &Told::Clock { asked, shown: Clock::local().0 });
        }
    }
}
