//! `hprm verify`: a program is the same on every run, or here is where it is not.
//!
//! It runs the program as a user would, each time in another way, and compares the logical traces
//! with that of the first run. What varies is in [`variant`]; what is compared, in `trace`.

mod variant;

use std::fs;
use std::io::Read;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use hprm::Failure;
use hprm::launch::unstarted;
use hprm::supervisor::{SIGNAL_DEBOUNCE, Signal};
use hprm::trace::line::End;
use hprm::trace::{Reader, remove_abandoned};
use rustix::process::{self, Pid, kill_process, kill_process_group};
use serde_json::json;

use self::variant::{Deployment, Subject, Variant, left_out};
use crate::args::Verify;
use crate::diff::{DIVERGENCE, as_json, extent, hash, print_more};
use crate::message::{self, Error, print_line};
use crate::trace::{Comparison, Judge, clocks, sentence};
use crate::{check, python, signals};

/// How often to look whether a run is over.
const PATIENCE: Duration = Duration::from_millis(5);

/// How much of what a failed run says is shown.
const SAID: usize = 4_000;

/// How the folders of traces are called that nothing keeps, before the number of the process.
const OWN: &str = "hprm-verify-";

/// Verifies a program.
///
/// # Errors
///
/// If it cannot be run, or a run fails.
pub(crate) fn verify(arguments: &Verify) -> Result<ExitCode, Error> {
    message::or_json(arguments.verdict.json, run_all(arguments))
}

fn run_all(arguments: &Verify) -> Result<ExitCode, Error> {
    let compiled = match check::checked(&arguments.program())? {
        Ok(compiled) => compiled,
        Err(code) => {
            let name = arguments.file.display();
            let wrong = Error::new(format!("{name} has errors, which hprm check names"));
            return if arguments.verdict.json { Err(wrong) } else { Ok(code) };
        }
    };
    check::show_warnings(&compiled);
    // From now on there is something to tidy up.
    let (asks, asked) = channel();
    signals::watch(move |signal| asks.send(signal).is_ok())
        .map_err(|error| Error::new(format!("cannot watch for Ctrl-C: {error}")))?;
    let folder = Folder::of(arguments)?;
    let subject = Subject::of(&compiled);
    let stated = arguments.properties.stated();
    let runs: Vec<Run> = (1..=arguments.runs)
        .map(|number| Run {
            variant: Variant::of(number, subject).keeping(&stated),
            trace: folder.path.join(format!("{number}.trace")),
        })
        .collect();
    if let Some(why) = left_out(arguments.runs, subject, &stated)
        && !arguments.verdict.json
    {
        print_line(why);
    }
    let judge = Judge { physical: arguments.verdict.physical };
    let mut total: Option<Comparison> = None;
    for run in &runs {
        if let Some(signal) = run.perform(arguments, &asked)? {
            Error::from(Failure::Interrupted { signal: signal.0 }).show();
            return Ok(ExitCode::from(u8::try_from(signal.exit_code()).unwrap_or(u8::MAX)));
        }
        if run.variant.number == 1 {
            continue;
        }
        let found = compare(judge, &runs[0], run)?;
        if found.divergence.is_some() {
            return report(arguments, &found, [&runs[0], run]);
        }
        total = Some(total.map_or(found.clone(), |total| least(total, found)));
    }
    let total = total.unwrap_or_default();
    confirm(arguments, &total, &runs, &hash(&runs[0].trace, judge, &total)?.to_string())
}

/// Says that all runs did the same.
fn confirm(
    arguments: &Verify,
    total: &Comparison,
    runs: &[Run],
    hash: &str,
) -> Result<ExitCode, Error> {
    let tardy = runs.iter().map(|run| Ok(run.end()?.tardy)).sum::<Result<u64, Error>>()?;
    let marked = marked(runs)?;
    if arguments.verdict.json {
        let mut verdict = as_json(total, ["", ""]);
        verdict["hash"] = json!(hash);
        verdict["runs"] = json!(runs.len());
        verdict["tardy"] = json!(tardy);
        verdict["clocks"] = json!(marked);
        print_line(&verdict.to_string());
    } else {
        print_clocks(&marked);
        print_line(&format!("{hash}  {} runs did the same: {}", runs.len(), extent(total)));
        if tardy > 0 {
            print_line(&format!("{tardy} inputs came too late for their tags, alike in all runs"));
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The runs on which clocks decided.
fn marked<'a>(runs: impl IntoIterator<Item = &'a Run>) -> Result<Vec<String>, Error> {
    let marked = runs.into_iter().map(|run| Ok(run.end()?.physical.then(|| run.name())));
    marked.filter_map(Result::transpose).collect()
}

fn print_clocks(marked: &[String]) {
    let marked: Vec<&str> = marked.iter().map(String::as_str).collect();
    if let Some(line) = clocks(&marked) {
        print_line(&line);
    }
}

/// One run of the program.
struct Run {
    variant: Variant,
    trace: PathBuf,
}

fn compare(judge: Judge, a: &Run, b: &Run) -> Result<Comparison, Error> {
    judge.compare(&mut Reader::open(&a.trace)?, &mut Reader::open(&b.trace)?)
}

/// What two comparisons have both covered.
fn least(a: Comparison, b: Comparison) -> Comparison {
    let limit = [a.limit, b.limit].into_iter().flatten().min();
    if b.limit.is_some() && b.limit == limit {
        Comparison { limit, ..b }
    } else {
        Comparison { limit, ..a }
    }
}

/// Says where two runs part.
fn report(arguments: &Verify, found: &Comparison, runs: [&Run; 2]) -> Result<ExitCode, Error> {
    let marked = marked(runs)?;
    let names = runs.map(Run::name);
    let names = names.each_ref().map(String::as_str);
    if arguments.verdict.json {
        let mut verdict = as_json(found, names);
        verdict["ways"] = json!(runs.map(|run| run.variant.to_string()));
        verdict["clocks"] = json!(marked);
        print_line(&verdict.to_string());
    } else if let Some(divergence) = &found.divergence {
        print_clocks(&marked);
        print_line(&sentence(divergence, names));
        for run in runs {
            print_line(&format!("  run {}: {}", run.variant.number, run.variant));
        }
        print_more(found, names);
    }
    Ok(ExitCode::from(DIVERGENCE))
}

impl Run {
    /// What sentences call it.
    fn name(&self) -> String {
        format!("run {}", self.variant.number)
    }

    /// Runs the program to its end. Returns the signal by which this process was asked to stop, if it was.
    fn perform(
        &self,
        arguments: &Verify,
        asked: &Receiver<Signal>,
    ) -> Result<Option<Signal>, Error> {
        let mut command = self.command(arguments)?;
        // Its group, so that nothing of it is left if it must be ended.
        command.process_group(0).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let failed = |error| Error::new(format!("cannot run the program: {error}"));
        let mut child = command.spawn().map_err(failed)?;
        let busy = AtomicBool::new(true);
        let mut stderr = child.stderr.take();
        let (ended, said) = thread::scope(|scope| {
            let load = || {
                while busy.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            };
            let read = || {
                let mut said = Vec::new();
                let read = stderr.as_mut().map(|stderr| stderr.read_to_end(&mut said));
                read.transpose().map(|_| said).unwrap_or_default()
            };
            let start = || {
                let loads = 0..self.variant.load;
                loads
                    .into_iter()
                    .try_for_each(|_| thread::Builder::new().spawn_scoped(scope, load).map(drop))?;
                thread::Builder::new().spawn_scoped(scope, read)
            };
            let started = start();
            // Without its threads, the run would not be the one that it is to be.
            let time = if started.is_ok() { arguments.run_timeout } else { Duration::ZERO };
            let ended = wait(&mut child, time, asked);
            busy.store(false, Ordering::Relaxed);
            let said = started.map(|said| said.join().unwrap_or_default());
            (ended, said)
        });
        let said = said.map_err(|error| unstarted("cannot run the program", &error))?;
        let run = format!("run {} ({})", self.variant.number, self.variant);
        match ended.map_err(failed)? {
            Ended::Code(0) => Ok(None),
            Ended::Asked(signal) => Ok(Some(signal)),
            Ended::Code(code) => {
                let said =
                    String::from_utf8_lossy(&said[said.len().saturating_sub(SAID)..]).into_owned();
                Err(Error::new(format!("{run} ended with exit code {code}\n{said}")))
            }
            Ended::Late => {
                Err(Error::new(format!("{run} did not end in {:?}", arguments.run_timeout))
                    .hint("allow more with --run-timeout, or end the program with --timeout '5 s'"))
            }
        }
    }

    fn command(&self, arguments: &Verify) -> Result<Command, Error> {
        let whole = self.variant.deployment == Deployment::Whole;
        let mut command = if whole {
            python::module(&python::find(&arguments.interpreter)?, "run")
        } else {
            let own = std::env::current_exe()
                .map_err(|error| Error::new(format!("cannot find the command hprm: {error}")))?;
            let mut command = Command::new(own);
            command.arg("run");
            if let Some(python) = &arguments.interpreter.python {
                command.arg("--python").arg(python);
            }
            if self.variant.deployment == Deployment::Threads {
                command.arg("--in-process");
            }
            command
        };
        command.arg("--die-with-parent").arg(std::process::id().to_string());
        command.arg("--logical-trace").arg(&self.trace);
        command.args(arguments.properties.options());
        command.args(self.variant.properties().map(|stated| format!("--property={stated}")));
        match whole {
            true => command.arg("--").arg(&arguments.file),
            false => command.arg(&arguments.file).arg("--"),
        };
        command.args(arguments.arguments.all());
        command.env("PYTHONHASHSEED", self.variant.hash_seed.to_string());
        Ok(command)
    }

    /// What its trace says last.
    fn end(&self) -> Result<End, Error> {
        Ok(Reader::open(&self.trace)?.end)
    }
}

/// How a run has ended.
enum Ended {
    /// With an exit code; -1, if a signal ended it.
    Code(i32),
    /// It took too long, and was ended.
    Late,
    /// This process was asked to stop, by this signal first.
    Asked(Signal),
}

/// Waits for a process, and ends it with all its descendants if it takes too long. A signal that asks this process to stop
/// goes to that one, and a second one ends it.
fn wait(child: &mut Child, timeout: Duration, asked: &Receiver<Signal>) -> std::io::Result<Ended> {
    let launched = Instant::now();
    let mut first: Option<(Signal, Instant)> = None;
    // It is this one's child, and has not been waited for, so the number is its own.
    let group = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    while first.is_some() || launched.elapsed() < timeout {
        if let Some(status) = child.try_wait()? {
            let code = Ended::Code(status.code().unwrap_or(-1));
            return Ok(first.map_or(code, |(signal, _)| Ended::Asked(signal)));
        }
        match (asked.try_recv(), first) {
            (Ok(signal), None) => {
                first = Some((signal, Instant::now()));
                if let Some((pid, signal)) = group.zip(process::Signal::from_named_raw(signal.0)) {
                    let _ = kill_process(pid, signal);
                }
            }
            (Ok(_), Some((_, at))) if at.elapsed() > SIGNAL_DEBOUNCE => break,
            _ => {}
        }
        thread::sleep(PATIENCE);
    }
    if let Some(group) = group {
        // It may have ended this moment.
        let _ = kill_process_group(group, process::Signal::KILL);
    }
    child.wait()?;
    Ok(first.map_or(Ended::Late, |(signal, _)| Ended::Asked(signal)))
}

/// Where the traces are.
struct Folder {
    path: PathBuf,
    kept: bool,
}

impl Folder {
    fn of(arguments: &Verify) -> Result<Self, Error> {
        let kept = arguments.keep.clone();
        let own = || {
            remove_abandoned(&std::env::temp_dir(), OWN);
            own(std::process::id())
        };
        let folder = Self { kept: kept.is_some(), path: kept.unwrap_or_else(own) };
        let made = fs::create_dir_all(&folder.path);
        made.map_err(|error| unwritable(&folder.path, &error))?;
        Ok(folder)
    }
}

/// The folder of the process `pid`.
fn own(pid: u32) -> PathBuf {
    std::env::temp_dir().join(format!("{OWN}{pid}"))
}

fn unwritable(path: &Path, error: &std::io::Error) -> Error {
    Error::new(format!("cannot write traces to {}: {}", path.display(), message::reason(error)))
}

impl Drop for Folder {
    fn drop(&mut self) {
        if !self.kept {
            // If it fails, only temporary files are left.
            let _ = fs::remove_dir_all(&self.path);
        }
    }
}
