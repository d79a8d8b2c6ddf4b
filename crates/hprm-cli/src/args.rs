//! What can be typed: commands, options, and their help.
//!
//! Nothing is decided here but whether the words are well formed; clap answers the rest with usage
//! and exit code 2.

mod bag;
mod comparing;
mod compose;
mod diagram;
mod frames;
mod machines;
mod mirroring;
mod new;
mod numbers;
mod ros;
mod texts;
mod top;
mod tracing;
mod watching;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, Parser, Subcommand};
use hprm::{Address, TlsFiles};
use hprm::{FederationId, HangTimeout};
use hprm_core::{WhenFull, read_size};
use hprm_lf::PARAMETER;

#[cfg(feature = "completions")]
pub(crate) use self::texts::Shell;
pub(crate) use self::texts::{Completions, Explain, Man};
pub(crate) use crate::args::bag::{Bag, BagCommand, Play, Record, Storage};
pub(crate) use crate::args::comparing::{Diff, Verify};
pub(crate) use crate::args::compose::Compose;
pub(crate) use crate::args::diagram::Diagram;
pub(crate) use crate::args::frames::LogFrames;
pub(crate) use crate::args::machines::{Agent, At, FLEET_KEY, Machines, Starter, federate};
pub(crate) use crate::args::mirroring::Mirror;
pub(crate) use crate::args::new::{Language, New};
use crate::args::numbers::{at_least, whole};
pub(crate) use crate::args::ros::{Launch, Ros, RosCommand, Running};
pub(crate) use crate::args::top::Top;
pub(crate) use crate::args::tracing::{Summary, Trace, TraceCommand, Tracing};
pub(crate) use crate::args::watching::{Echo, Listen, Of, Rate};
use crate::source::Program;

/// Run, check and look after deterministic programs for robots.
#[derive(Parser, Debug)]
#[command(name = "hprm", version, after_help = EXAMPLES)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) command: Command,
}

impl Arguments {
    /// Adds a value of a parameter of the main reactor, for a command that runs a program.
    pub(crate) fn set_parameter(&mut self, name: &str, value: &str) {
        let properties = match &mut self.command {
            Command::Run(run) => &mut run.properties,
            Command::Verify(verify) => &mut verify.properties,
            Command::Rti(rti) => &mut rti.properties,
            Command::Federate(federate) => &mut federate.properties,
            Command::Compose(compose) => &mut compose.properties,
            Command::Diagram(diagram) => &mut diagram.properties,
            Command::New(_)
            | Command::Check(_)
            | Command::Explain(_)
            | Command::Diff(_)
            | Command::Trace(_)
            | Command::Echo(_)
            | Command::Rate(_)
            | Command::Mirror(_)
            | Command::Bag(_)
            | Command::Ros(_)
            | Command::Launch(_)
            | Command::Top(_)
            | Command::Machines(_)
            | Command::Agent(_)
            | Command::StandIn
            | Command::Starter(_)
            | Command::Sim(_)
            | Command::Doctor(_)
            | Command::Completions(_)
            | Command::Man(_) => return,
        };
        properties.stated.push(format!("{PARAMETER}{name}={value}"));
    }
}

/// The option for target properties, which those commands have that run a program.
pub(crate) const PROPERTY: &str = "property";

/// What --join-timeout is for `hprm run` if it is not stated.
const JOIN_TIMEOUT: Duration = Duration::from_secs(30);

const EXAMPLES: &str = "\
Examples:
  hprm new robot              make a project with a program and a test
  hprm run Main.lf            run a program, in one process or as a federation
  hprm run app.py             the same, of a program in Python
  hprm check src/*.lf         say what is wrong, and run nothing
  hprm diagram Main.lf        draw a program
  hprm explain LF0503         what a mistake with this code is, and its cure
  hprm run --trace A.pftrace Main.lf    record when what happens, for Perfetto
  hprm top                    watch a federation that runs: what it does, and what it waits for
  hprm verify Main.lf         run a program several times, and compare what it did
  hprm echo camera.image      print what a federate of a running federation sends
  hprm doctor                 see whether this machine has what HPRM needs

Exit codes: 0 all is well, 1 the program failed or is wrong, 2 wrong usage, 3 two runs differ,
130 Ctrl-C.";

#[derive(Subcommand, Debug)]
pub(crate) enum Command {
    New(New),
    Run(Run),
    Check(Check),
    Diagram(Diagram),
    Explain(Explain),
    Diff(Diff),
    Trace(Trace),
    Verify(Verify),
    Echo(Echo),
    Rate(Rate),
    Mirror(Mirror),
    Bag(Bag),
    Rti(RtiArguments),
    Federate(FederateArguments),
    Compose(Compose),
    Ros(Ros),
    Launch(Launch),
    Top(Top),
    Machines(Machines),
    Agent(Agent),
    #[command(hide = true)]
    StandIn,
    #[command(hide = true)]
    Starter(Starter),
    Sim(Sim),
    Doctor(Doctor),
    Completions(Completions),
    Man(Man),
}

/// Which interpreter runs the bodies.
#[derive(Args, Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Interpreter {
    /// The Python interpreter of the program. Without it: that of the active virtual environment, if HPRM
    /// is installed there, or else the one beside this command.
    #[arg(long, value_name = "PATH", env = PYTHON, hide_env_values = true)]
    pub(crate) python: Option<PathBuf>,
}

/// Where the option --python may stand as well.
pub(crate) const PYTHON: &str = "HPRM_PYTHON";

/// Target properties that override those of the program.
#[derive(Args, Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Properties {
    /// A target property, instead of what the program says of it. May be repeated.
    #[arg(long = PROPERTY, value_name = "KEY=VALUE")]
    stated: Vec<String>,
    /// How many reactions of one process may run at the same time, if they do not depend on one
    /// another; 0 is as many as there are processors. The same as --property workers=N.
    #[arg(short, long, value_name = "N", allow_negative_numbers = true, value_parser = whole::<u32>(0, 1000))]
    workers: Option<u32>,
    /// How long a process busy-polls for messages before it sleeps: a time such as 100us, off, or auto, which
    /// is short, and only where every process has a processor of its own. The same as --property spin=TIME.
    #[arg(long, value_name = "TIME", value_parser = spin)]
    spin: Option<String>,
    /// Run federates and the RTI before all ordinary programs of this machine, in memory that is never
    /// swapped out; with a priority from 1 to 99, which is 50 otherwise. An error if the system forbids
    /// it. The same as --property realtime=PRIORITY.
    #[arg(long, value_name = "PRIORITY", num_args = 0..=1, require_equals = true,
          default_missing_value = "50", value_parser = whole::<u8>(1, 99))]
    realtime: Option<u8>,
    /// The processors of the federates, one each in the order of the program. The same as --property
    /// cpus=[N,...].
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = processor)]
    cpus: Vec<u32>,
    /// The most memory of one federate's object store, such as 512MB or 2GB. The same as the target
    /// property store-limit.
    #[arg(long, value_name = "SIZE", env = STORE_LIMIT, value_parser = size)]
    store_limit: Option<u64>,
    /// What becomes of a large value for which the object store has no room: it travels inside its
    /// message (inline), or the program fails (error). The same as the target property store-full.
    #[arg(long, value_name = "POLICY", env = STORE_FULL, value_parser = when_full)]
    store_full: Option<WhenFull>,
    #[command(flatten)]
    run_time: RunTime,
}

/// Where the option --store-limit may stand as well.
pub(crate) const STORE_LIMIT: &str = "HPRM_STORE_LIMIT";

/// Where the option --store-full may stand as well.
pub(crate) const STORE_FULL: &str = "HPRM_STORE_FULL";

impl Properties {
    /// All of them, as `KEY=VALUE`.
    pub(crate) fn stated(&self) -> Vec<String> {
        let limit = self.store_limit.map(|limit| format!("store-limit={limit}"));
        let full = self.store_full.map(|full| format!("store-full={}", full.word()));
        let workers = self.workers.map(|workers| format!("workers={workers}"));
        let realtime = self.realtime.map(|priority| format!("realtime={priority}"));
        let cpus = (!self.cpus.is_empty()).then(|| format!("cpus={:?}", self.cpus));
        let spin = self.spin.as_ref().map(|spin| format!("spin={spin}"));
        // The environment is for all programs; what is stated here is for this one.
        limit
            .into_iter()
            .chain(full)
            .chain(self.stated.iter().cloned())
            .chain(self.run_time.stated())
            .chain(workers)
            .chain(spin)
            .chain(realtime)
            .chain(cpus)
            .collect()
    }

    /// Adds what the federate that starts this one was given, unless it is stated here too.
    pub(crate) fn inherit<'a>(&mut self, stated: impl Iterator<Item = &'a str>) {
        let inherited: Vec<_> = stated.map(str::to_owned).collect();
        self.stated.splice(0..0, inherited);
    }

    /// The same, as options for another process.
    pub(crate) fn options(&self) -> impl Iterator<Item = String> {
        self.stated().into_iter().map(|stated| format!("--property={stated}"))
    }
}

/// What the program finds in sys.argv, after its own name.
#[derive(Args, Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct ProgramArguments {
    /// What the program finds in sys.argv. What begins with a dash goes behind --, so that a mistyped
    /// option is an error.
    #[arg(value_name = "ARGUMENTS", allow_negative_numbers = true)]
    words: Vec<OsString>,
    #[arg(last = true, hide = true)]
    rest: Vec<OsString>,
}

impl ProgramArguments {
    /// All of them, in their order.
    pub(crate) fn all(&self) -> impl Iterator<Item = &OsString> + Clone {
        self.words.iter().chain(&self.rest)
    }
}

/// The options that programs of Lingua Franca have: target properties by other names.
#[derive(Args, Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct RunTime {
    /// Stop at this time after the start, such as '5 s'.
    #[arg(short = 'o', long, value_name = "TIME", allow_hyphen_values = true, value_parser = time)]
    timeout: Option<String>,
    /// Do not wait for physical time.
    #[arg(short, long, value_name = "true|false", hide_possible_values = true, value_parser = clap::value_parser!(bool))]
    fast: Option<bool>,
    /// Do not stop when nothing is left to do.
    #[arg(short, long, value_name = "true|false", hide_possible_values = true, value_parser = clap::value_parser!(bool))]
    keepalive: Option<bool>,
    /// Start at the next physical time that is a multiple of this one.
    #[arg(short = 'm', long, value_name = "TIME", allow_hyphen_values = true, value_parser = time)]
    start_time_multiple: Option<String>,
}

impl RunTime {
    /// All that are stated, as `KEY=VALUE`.
    pub(crate) fn stated(&self) -> impl Iterator<Item = String> {
        let timeout = self.timeout.as_ref().map(|time| format!("timeout={time}"));
        let fast = self.fast.map(|fast| format!("fast={fast}"));
        let keepalive = self.keepalive.map(|keepalive| format!("keepalive={keepalive}"));
        let multiple = self.start_time_multiple.as_ref();
        let multiple = multiple.map(|time| format!("start-time-multiple={time}"));
        timeout.into_iter().chain(fast).chain(keepalive).chain(multiple)
    }
}

/// Run a program to its end.
///
/// A main reactor runs in one Python process. A federated reactor runs as one process per federate,
/// or as one thread per federate, whose output is shown line by line behind its name. Ctrl-C stops in
/// order; a second one at once.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  hprm run Main.lf
  hprm run app.py:Vision                    a program in Python, and which of its reactors is the main one
  hprm run Main.lf --rate 30                give the main reactor's parameter rate another value
  hprm run Main.lf -- --rounds 10           the program finds --rounds 10 in sys.argv
  hprm run --join-timeout 120 Vision.lf     give federates two minutes to load their models
  hprm run --timeout '5 s' Main.lf          stop after five seconds
  hprm run --in-process Vision.lf           federates share one process, and their arrays

The exit code is 0 if every federate ended well, and else that of the first one that did not.")]
pub(crate) struct Run {
    /// The program: FILE.lf, FILE.py, or FILE.py:NAME for one of several main reactors.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// The program is a federation for sure.
    #[arg(long, hide = true)]
    pub(crate) federation_known: bool,
    /// A file to which failures are written as JSON, whatever is told on the standard error.
    #[arg(long, hide = true, value_name = "FILE")]
    pub(crate) failures_to: Option<PathBuf>,
    /// Never outlive the caller, which is this process.
    #[arg(long, hide = true, value_name = "PID")]
    pub(crate) die_with_parent: Option<i32>,
    /// Run the federates as threads of one process. Arrays go from one to the other without a copy,
    /// and are read-only from then on.
    #[arg(long)]
    pub(crate) in_process: bool,
    /// Seconds that federates may take to join and to load their programs, from the start of their processes to
    /// the start of the federation. With --debug there is no limit.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, default_value = "30", value_parser = seconds)]
    pub(crate) join_timeout: Duration,
    /// Give one federate the terminal, so that breakpoint() in it starts the debugger. What it prints
    /// has no name in front.
    #[arg(long, value_name = "FEDERATE", conflicts_with = "in_process", value_parser = federate)]
    pub(crate) debug: Option<String>,
    #[command(flatten)]
    pub(crate) at: At,
    #[command(flatten)]
    pub(crate) hang: Hang,
    #[command(flatten)]
    pub(crate) failures: Failures,
    /// Write down what every reaction read and did, in a form that does not depend on how the program was run.
    #[arg(long, value_name = "FILE")]
    pub(crate) logical_trace: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) tracing: Tracing,
    #[command(flatten)]
    pub(crate) frames: LogFrames,
    #[command(flatten)]
    pub(crate) properties: Properties,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
    #[command(flatten)]
    pub(crate) arguments: ProgramArguments,
}

impl Run {
    /// Whether it states something that only federations need.
    pub(crate) fn is_for_federation(&self) -> bool {
        self.federation_known
            || self.in_process
            || self.debug.is_some()
            || !self.at.at.is_empty()
            || self.hang.limit.is_some()
            || self.join_timeout != JOIN_TIMEOUT
            || self.frames.are_asked_for()
    }

    /// The program that is meant.
    pub(crate) fn program(&self) -> Program<'_> {
        program(&self.file, &self.properties, &self.interpreter, self.arguments.all())
    }
}

/// How failures are told.
#[derive(Args, Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct Failures {
    /// Print failures as JSON to the standard error, one object a line.
    #[arg(long)]
    pub(crate) json: bool,
}

/// What a federate that does not answer means.
#[derive(Args, Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct Hang {
    /// Give up if a federate does not answer for that many seconds. Without it, the others wait: it
    /// may be busy in a long reaction.
    #[arg(long = "hang-timeout", value_name = "SECONDS", allow_negative_numbers = true, value_parser = seconds)]
    pub(crate) limit: Option<Duration>,
}

impl Hang {
    /// The same, for the RTI.
    pub(crate) fn timeout(self) -> HangTimeout {
        HangTimeout { limit: self.limit.map(hprm::nanoseconds) }
    }
}

/// Say what is wrong with programs, and run nothing.
///
/// `.lf` files that others import can be checked too. The Python in them is compiled, by one interpreter for
/// all files, and not run. A program in Python is imported and makes its reactors; none of its reactions runs.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  hprm check Main.lf
  hprm check --json src/*.lf | jq .message

The exit code is 1 if there is an error; a warning leaves it 0.")]
pub(crate) struct Check {
    /// The programs: FILE.lf, FILE.py or FILE.py:NAME.
    #[arg(value_name = "FILE", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Print one JSON object a line to the standard output, instead of text.
    #[arg(long)]
    pub(crate) json: bool,
    /// Do not look into the Python, which saves the start of an interpreter.
    #[arg(long)]
    pub(crate) no_bodies: bool,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
}

/// Where the secret of a federation comes from.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
pub(crate) struct Secret {
    /// The secret of the federation, 32 hexadecimal digits. As an option, every user of this machine
    /// can see it.
    #[arg(short = 'i', long, visible_alias = "federation-id", value_name = "ID", env = "HPRM_FEDERATION_ID",
          hide_env_values = true, value_parser = federation)]
    pub(crate) federation: Option<FederationId>,
    /// A file with that secret, which only its owner can read; it overrides the option. The RTI makes the
    /// file if it is missing.
    #[arg(long, value_name = "FILE")]
    pub(crate) federation_file: Option<PathBuf>,
}

/// Certificates, for TCP connections that are encrypted.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
pub(crate) struct Tls {
    /// The certificate of this process, in PEM: TCP connections have TLS then. Every process of
    /// the federation needs one.
    #[arg(long = "tls-cert", value_name = "FILE", requires_all = ["key", "authority"])]
    certificate: Option<PathBuf>,
    /// The key of that certificate.
    #[arg(long = "tls-key", value_name = "FILE", requires = "certificate")]
    key: Option<PathBuf>,
    /// The certificates of the authorities that may have signed the others' certificates.
    #[arg(long = "tls-ca", value_name = "FILE", requires = "certificate")]
    authority: Option<PathBuf>,
}

impl Tls {
    /// All three files, if they are given.
    pub(crate) fn files(self) -> Option<TlsFiles> {
        let Self { certificate, key, authority } = self;
        Some(TlsFiles { certificate: certificate?, key: key?, authority: authority? })
    }

    /// The same, as options for another process.
    pub(crate) fn options(&self) -> Vec<OsString> {
        let options = [
            ("--tls-cert", &self.certificate),
            ("--tls-key", &self.key),
            ("--tls-ca", &self.authority),
        ];
        let stated = options.into_iter().filter_map(|(name, path)| Some((name, path.as_ref()?)));
        stated.flat_map(|(name, path)| [name.into(), path.into()]).collect()
    }
}

/// Coordinate a federation whose federates are started by hand, on this machine or others.
///
/// It prints where it listens, and the id of the federation if it had to choose one, which each
/// federate must know; and ends with the federation.
#[derive(Args, Debug)]
#[command(after_help = "\
Example, in three terminals:
  hprm rti Main.lf --listen unix:@robot --federation-file secret
  hprm federate Main.lf camera  --rti unix:@robot --federation-file secret
  hprm federate Main.lf planner --rti unix:@robot --federation-file secret

Across machines, each with a copy of the program and of the secret:
  hprm rti Main.lf --listen 0.0.0.0:15045 --federation-file secret
  hprm federate Main.lf camera --rti robot.local:15045 --federation-file secret")]
pub(crate) struct RtiArguments {
    /// The program, with a federated reactor: FILE.lf, FILE.py or FILE.py:NAME.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// Where to listen: HOST:PORT, unix:@NAME or unix:/PATH. May be repeated: federates on this
    /// machine share memory if they join over a Unix socket.
    #[arg(long, value_name = "ADDRESS", required = true)]
    pub(crate) listen: Vec<Address>,
    /// Seconds that federates may take to join, from when the RTI listens. Then it names those that are
    /// missing, and the federation does not start. How long they load their programs after that is not limited.
    #[arg(long, value_name = "SECONDS", default_value = "60", value_parser = seconds)]
    pub(crate) join_timeout: Duration,
    #[command(flatten)]
    pub(crate) hang: Hang,
    #[command(flatten)]
    pub(crate) tracing: Tracing,
    #[command(flatten)]
    pub(crate) frames: LogFrames,
    #[command(flatten)]
    pub(crate) failures: Failures,
    #[command(flatten)]
    pub(crate) properties: Properties,
    #[command(flatten)]
    pub(crate) secret: Secret,
    #[command(flatten)]
    pub(crate) tls: Tls,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
    /// What a program in Python finds in sys.argv, as its federates do. Behind --.
    #[arg(last = true, value_name = "ARGUMENTS")]
    pub(crate) arguments: Vec<OsString>,
}

impl RtiArguments {
    /// The program that is meant.
    pub(crate) fn program(&self) -> Program<'_> {
        program(&self.file, &self.properties, &self.interpreter, &self.arguments)
    }
}

/// Run one federate of a program.
///
/// If the RTI is not there yet, the federate waits for it.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  hprm federate Main.lf camera --rti unix:@robot --federation-file secret
  HPRM_FEDERATION_ID=0123456789abcdef0123456789abcdef \\
      hprm federate Main.lf camera --rti robot.local:15045")]
pub(crate) struct FederateArguments {
    /// The program: FILE.lf, FILE.py, or FILE.py:NAME for one of several main reactors.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// The name of the federate. A member of a bank has its index: camera__2, or 'camera[2]'.
    #[arg(value_name = "NAME", value_parser = federate)]
    pub(crate) name: String,
    /// Where the RTI listens. Without it, the federation of this program is joined that `hprm run` runs
    /// on this machine, with its target properties; or, if there is none, that of the host at which the
    /// program has its RTI (`federated reactor at HOST:PORT`; without a port, 15045).
    #[arg(long, value_name = "ADDRESS", env = "HPRM_RTI")]
    pub(crate) rti: Option<Address>,
    /// Seconds that the RTI may take to be there, and the file with the secret; and for how long a link
    /// that breaks while it is opened is opened again.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, default_value = "60", value_parser = seconds)]
    pub(crate) connect_timeout: Duration,
    /// The name or address by which other machines reach this one, if that is not where its
    /// connection to the RTI begins. Only federates of a decentralized program connect to others.
    #[arg(long, value_name = "HOST[:PORT]")]
    pub(crate) advertise: Option<String>,
    /// Write down what the reactions of this federate read and did: its share of the logical trace.
    /// Without this, a federate that joins a run of this machine writes for the trace of that run.
    #[arg(long, value_name = "FILE")]
    pub(crate) logical_trace: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) tracing: Tracing,
    #[command(flatten)]
    pub(crate) frames: LogFrames,
    #[command(flatten)]
    pub(crate) failures: Failures,
    #[command(flatten)]
    pub(crate) properties: Properties,
    #[command(flatten)]
    pub(crate) secret: Secret,
    #[command(flatten)]
    pub(crate) tls: Tls,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
    #[command(flatten)]
    pub(crate) arguments: ProgramArguments,
}

/// Run random federations in a simulated network, and compare them with one scheduler.
///
/// The federates, their connections, the network, the clocks and what befalls them are drawn from
/// the seed. The machines are those that run programs; only links and time are simulated. The same
/// seed prints the same text.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  hprm sim --seed 7                    what is drawn from this seed, and what became of it
  hprm sim --seed 7 --schedule         the same, with all that happens
  hprm sim --seed 1 --seeds 100000     this seed and those after it; of a wrong one, everything

The exit code is 1 if a federation does not do what its program does.")]
#[cfg_attr(not(feature = "sim"), allow(dead_code))]
pub(crate) struct Sim {
    /// The first seed.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "0")]
    pub(crate) seed: u64,
    /// How many seeds.
    #[arg(long, value_name = "K", allow_negative_numbers = true, default_value = "1", value_parser = at_least::<u64>(1))]
    pub(crate) seeds: u64,
    /// Print all that happens, also if nothing is wrong.
    #[arg(long)]
    pub(crate) schedule: bool,
}

/// See whether this machine has what HPRM needs.
#[derive(Args, Debug)]
#[command(after_help = "\
The exit code is 1 if something is missing that programs need.")]
pub(crate) struct Doctor {
    /// Print one JSON object a line.
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
}

fn program<'a>(
    path: &'a Path,
    properties: &Properties,
    interpreter: &'a Interpreter,
    arguments: impl IntoIterator<Item = &'a OsString>,
) -> Program<'a> {
    let (properties, arguments) = (properties.stated(), arguments.into_iter().collect());
    Program { path, properties, arguments, interpreter }
}

/// Joins a number with the unit that follows it, behind an option that `takes_time`: programs of Lingua
/// Franca take `--timeout 5 sec`. What follows `--` stays as it is.
pub(crate) fn join_times(
    words: &[OsString],
    takes_time: impl Fn(&OsString) -> bool,
) -> Vec<OsString> {
    let mut joined: Vec<OsString> = Vec::new();
    let mut rest = words;
    while let [option, number, unit, ..] = rest
        && option != "--"
    {
        let both = (takes_time(option) || TIMES.iter().any(|time| option == time))
            .then(|| Some((number.to_str()?, unit.to_str()?)))
            .flatten()
            .filter(|(number, unit)| number.parse::<i64>().is_ok() && hprm_lf::is_unit(unit));
        joined.push(option.clone());
        rest = &rest[1..];
        if let Some((number, unit)) = both {
            joined.push(format!("{number} {unit}").into());
            rest = &rest[2..];
        }
    }
    joined.extend_from_slice(rest);
    joined
}

/// The options whose value is a time.
const TIMES: [&str; 4] = ["--timeout", "-o", "--start-time-multiple", "-m"];

fn time(text: &str) -> Result<String, String> {
    unless(hprm_lf::expected_time(text), text)
}

fn spin(text: &str) -> Result<String, String> {
    unless(hprm_lf::expected_spin(text), text)
}

/// The text, unless something else is expected. A shell would run what is in backquotes.
fn unless(expected: Option<&str>, text: &str) -> Result<String, String> {
    match expected {
        Some(expected) => Err(format!("it must be {}", expected.replace('`', "'"))),
        None => Ok(text.to_owned()),
    }
}

fn processor(text: &str) -> Result<u32, String> {
    text.parse().map_err(|_| "not the number of a processor, as in --cpus 2,3".to_owned())
}

fn seconds(text: &str) -> Result<Duration, String> {
    let found = duration(text).filter(|it| !it.is_zero());
    found.ok_or_else(|| "not a positive number of seconds, such as 2.5".to_owned())
}

/// A number of seconds, if it is one and not negative.
fn duration(text: &str) -> Option<Duration> {
    Duration::try_from_secs_f64(text.parse().ok()?).ok()
}

fn size(text: &str) -> Result<u64, String> {
    read_size(text)
        .ok_or_else(|| "not a size, which is a whole number with a unit, such as 2GB".to_owned())
}

fn when_full(text: &str) -> Result<WhenFull, String> {
    WhenFull::read(text).ok_or_else(|| "not one of inline, error".to_owned())
}

fn federation(text: &str) -> Result<FederationId, String> {
    text.parse().map_err(|_| "an id has 32 hexadecimal digits".to_owned())
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn parsed(words: &[&str]) -> Result<Command, clap::Error> {
        Arguments::try_parse_from(words).map(|arguments| arguments.command)
    }

    #[test]
    fn the_definition_is_sound() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn options_stand_anywhere_and_the_rest_is_for_the_program() {
        let words = ["hprm", "run", "A.lf", "x", "-1", "--in-process", "y", "--", "--rounds", "-3"];
        let Command::Run(run) = parsed(&words).unwrap() else { panic!("not a run") };
        assert_eq!(run.file, PathBuf::from("A.lf"));
        assert!(run.in_process);
        assert!(run.arguments.all().eq(["x", "-1", "y", "--rounds", "-3"]));
        assert_eq!(run.join_timeout, JOIN_TIMEOUT);
        let words =
            ["hprm", "federate", "--rti", "unix:@x", "A.lf", "--workers=2", "a", "--", "-v"];
        let Command::Federate(one) = parsed(&words).unwrap() else { panic!("not a federate") };
        assert_eq!(one.name, "a");
        assert!(one.arguments.all().eq(["-v"]));
    }

    #[test]
    fn a_mistyped_option_is_an_error_wherever_it_stands() {
        for words in [
            &["hprm", "run", "A.lf", "--in-proces"][..],
            &["hprm", "run", "A.lf", "--rounds", "3"],
            &["hprm", "verify", "A.lf", "--run", "3"],
            &["hprm", "federate", "A.lf", "a", "--rti", "unix:@x", "-z"],
        ] {
            let error = parsed(words).unwrap_err();
            assert_eq!(error.kind(), clap::error::ErrorKind::UnknownArgument, "{words:?}");
        }
        let error = parsed(&["hprm", "run", "A.lf", "--in-proces"]).unwrap_err();
        assert!(error.to_string().contains("'--in-process'"), "{error}");
        let error = parsed(&["hprm", "run", "A.lf", "--rounds", "3"]).unwrap_err();
        assert!(error.to_string().contains("'-- --rounds'"), "{error}");
    }

    #[test]
    fn programs_of_lingua_franca_have_these_options() {
        let words =
            ["hprm", "run", "A.lf", "-o", "5 s", "-f", "true", "-k=false", "-w", "2", "-m", "1 s"];
        let Command::Run(run) = parsed(&words).unwrap() else { panic!("not a run") };
        let expected =
            ["timeout=5 s", "fast=true", "keepalive=false", "start-time-multiple=1 s", "workers=2"];
        assert_eq!(run.properties.stated(), expected);
    }

    #[test]
    fn properties_are_handed_on() {
        let words = ["hprm", "run", "--property", "fast=true", "--workers=1", "A.lf"];
        let Command::Run(run) = parsed(&words).unwrap() else { panic!("not a run") };
        let options: Vec<_> = run.properties.options().collect();
        assert_eq!(options, ["--property=fast=true", "--property=workers=1"]);
        let words = ["hprm", "run", "--store-limit", "2 KB", "--store-full=ERROR", "A.lf"];
        let Command::Run(run) = parsed(&words).unwrap() else { panic!("not a run") };
        assert_eq!(run.properties.stated(), ["store-limit=2000", "store-full=error"]);
    }

    #[test]
    fn a_time_is_positive_and_finite() {
        assert_eq!(seconds("0.5"), Ok(Duration::from_millis(500)));
        for text in ["0", "-1", "nan", "inf", "soon", "1e300"] {
            assert!(seconds(text).is_err(), "{text}");
        }
    }

    #[test]
    fn wrong_words_are_usage_errors() {
        for words in [
            &["hprm"][..],
            &["hprm", "run"],
            &["hprm", "check"],
            &["hprm", "juggle"],
            &["hprm", "run", "--workers", "-1", "A.lf"],
            &["hprm", "run", "--workers", "1001", "A.lf"],
            &["hprm", "run", "--store-limit", "much", "A.lf"],
            &["hprm", "run", "--store-full", "explode", "A.lf"],
            &["hprm", "rti", "A.lf", "--listen", "carrier-pigeon"],
            &["hprm", "federate", "A.lf", "a", "--rti", "unix:@x", "--federation", "12"],
        ] {
            let error = parsed(words).unwrap_err();
            assert_eq!(error.exit_code(), 2, "{words:?}");
            assert!(!error.to_string().contains("tip:"), "{error}");
        }
    }
}
