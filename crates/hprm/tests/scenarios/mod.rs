//! Programs of users, each a federation.

mod spinning;
mod values;

use std::convert::Infallible;
use std::process::{Command, ExitCode, Termination};
use std::thread;
use std::time::{Duration, SystemTime};

use hprm::prelude::*;
use hprm_core::ProgramBuilder;
use rustix::process::{Signal, getpid, kill_process};

const MS: Duration = Duration::from_millis(1);

/// Runs the scenario of that name.
pub(crate) fn run(name: &str, words: &[String]) -> ExitCode {
    let word = words.first().map_or("", String::as_str);
    let outcome = match (name, words) {
        ("counting", _) => counting(word),
        ("values", [coordination]) => values::values(of("Values", coordination)).run(),
        ("values", [how, trace]) => match how.as_str() {
            "one process" => {
                values::values(Federation::new("Values")).logical_trace(trace).run_in_one_process()
            }
            coordination => values::values(of("Values", coordination)).logical_trace(trace).run(),
        },
        ("spinning", _) => {
            spinning::spinning(word.parse().map_or(Duration::ZERO, Duration::from_secs)).run()
        }
        ("bank", _) => bank(),
        ("large", [_]) => large(Federation::new("Large").store_limit(4_000_000)),
        ("large", _) => large(Federation::new("Large").store_limit(4_000_000).store_full_fails()),
        ("delays", _) => delays(of("Delays", word)),
        ("error", _) => failing(of("Failing", word), |text| text.parse::<u8>().map(drop)),
        ("panic", _) => failing(Federation::new("Failing"), |_| -> Result<(), Infallible> {
            panic!("it panics here");
        }),
        ("death", [coordination, victim]) => death(of("Death", coordination), victim),
        ("endless", _) => endless(),
        ("random", _) => random(),
        ("same_name", _) => same_name(),
        ("names", [name]) => {
            let mut federation = Federation::new("Names");
            federation.reactor(name.as_str(), (), |_| ());
            federation.run()
        }
        ("several", _) => several(),
        ("threads", _) => in_threads(!word.is_empty()),
        ("renamed", _) => saying(&format!("Renamed{}", std::process::id()), "it runs").run(),
        ("nested", _) => nested(),
        ("orphan", _) => orphan(),
        ("thread", _) => with_a_thread(),
        ("alone", _) => run_as_federate("Camera", values::Camera),
        ("after", _) => counting_once().run().inspect(|()| println!("after the run")),
        _ => panic!("there is no scenario {name} {words:?}"),
    };
    outcome.report()
}

fn of(name: &str, coordination: &str) -> Federation {
    match coordination {
        "centralized" => Federation::new(name),
        "decentralized" => Federation::new(name).decentralized(),
        other => panic!("{other} is no coordination"),
    }
}

fn counting(how: &str) -> Result<(), Failure> {
    let mut federation = match how {
        "one process" => Federation::new("Counting"),
        coordination => of("Counting", coordination),
    }
    .timeout(2 * MS);
    let count = federation.reactor("counter", 0_u32, |counter| {
        let (tick, out) = (counter.timer("tick", Duration::ZERO, MS), counter.output("out"));
        counter.reaction().on(tick).sets(out).run(move |count, ctx| {
            *count += 1;
            ctx.set(out, *count);
        });
        out
    });
    let number = federation.reactor("adder", 0, |adder| {
        let number = adder.input("number");
        adder.reaction().on(number).run(move |sum, ctx| {
            *sum += ctx.get(number).unwrap_or(&0);
            println!("{:?}: {sum}", ctx.elapsed());
        });
        number
    });
    federation.connect(count, number);
    match how {
        "one process" => federation.run_in_one_process(),
        _ => federation.run(),
    }
}

/// A federation whose one federate says that.
fn saying(name: &str, line: &'static str) -> Federation {
    let mut federation = Federation::new(name).timeout(Duration::ZERO);
    federation.reactor("speaker", (), |speaker| {
        speaker.reaction().on(Startup).run(move |(), _| println!("{line}"));
    });
    federation
}

/// Federations one after the other: the second has the name of the first, and all have the same parts.
fn several() -> Result<(), Failure> {
    for (name, line) in [("A", "first"), ("A", "second"), ("B", "third")] {
        saying(name, line).run()?;
    }
    Ok(())
}

/// Federations of one name and from one place, in threads, which federates start in another order than their launcher:
/// as the tests of a harness.
fn in_threads(named: bool) -> Result<(), Failure> {
    let mut order = ["first", "second"];
    if std::env::var_os("HPRM_HANDOVER").is_some() {
        order.reverse();
    }
    for word in order {
        let thread = thread::Builder::new();
        let thread = if named { thread.name(word.to_owned()) } else { thread };
        let running = thread.spawn(move || saying("Same", word).run());
        running.unwrap().join().unwrap()?;
    }
    Ok(())
}

fn counting_once() -> Federation {
    let mut federation = Federation::new("Once").timeout(Duration::ZERO);
    federation.reactor("counter", (), |_| ());
    federation
}

/// Sends what it is.
struct Member(u32);

impl Reactor for Member {
    type Ports = OutputPort<u32>;

    fn assemble(&mut self, member: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let out = member.output("out");
        member.reaction().on(Startup).sets(out).run(move |member, ctx| ctx.set(out, member.0));
        out
    }
}

fn bank() -> Result<(), Failure> {
    let mut federation = Federation::new("Bank").timeout(MS);
    let outs = federation.bank("member", (0..3).map(Member));
    let inputs = federation.reactor("sum", (), |sum| {
        let inputs = sum.inputs::<u32>("inp", 3);
        let all = inputs.clone();
        sum.reaction().on(&inputs).run(move |(), ctx| {
            let numbers: Vec<_> = ctx.present(&all).map(|(_, number)| number.to_string()).collect();
            println!("{}", numbers.join(" + "));
        });
        inputs
    });
    federation.connect_each(outs, inputs);
    federation.run()
}

/// Sends an array that is larger than the object store.
fn large(mut federation: Federation) -> Result<(), Failure> {
    federation = federation.timeout(MS);
    let out = federation.reactor("source", (), |source| {
        let out = source.output("out");
        source.reaction().on(Startup).sets(out).run(move |(), ctx| {
            ctx.set(out, Array::from(ctx.loan::<u8>(&[8, 1_000_000])));
        });
        out
    });
    let inp = federation.reactor("sink", (), |sink| {
        let inp = sink.input("inp");
        sink.reaction().on(inp).run(move |(), ctx| {
            let array: &Array<u8> = ctx.get(inp).unwrap();
            println!("{:?}", array.shape());
        });
        inp
    });
    federation.connect(out, inp);
    federation.run()
}

fn delays(mut federation: Federation) -> Result<(), Failure> {
    federation = federation.timeout(200 * MS);
    let out = federation.add("source", Member(7));
    let inputs = federation.reactor(Federate::new("sink").maxwait(100 * MS), (), |sink| {
        let inputs =
            [("direct", 0), ("after", 5), ("clock", 0)].map(|(name, _)| sink.input::<u32>(name));
        sink.reaction().on(inputs).run(move |(), ctx| {
            for (index, _) in ctx.present(&inputs) {
                match index {
                    0 => println!("direct{}", if ctx.elapsed().is_zero() { "" } else { ", late" }),
                    1 => println!("after {:?}", ctx.elapsed()),
                    _ => println!("by the clock"),
                }
            }
        });
        inputs
    });
    federation.connect(out, inputs[0]);
    federation.connect(out, inputs[1]).after(5 * MS);
    federation.connect(out, inputs[2]).physical();
    federation.run()
}

fn failing<E: std::error::Error + Send + Sync + 'static>(
    mut federation: Federation,
    parse: fn(&str) -> Result<(), E>,
) -> Result<(), Failure> {
    let out = federation.reactor("reader", (), |reader| {
        let out = reader.output("out");
        reader.reaction().on(Startup).sets(out).run(move |(), ctx| ctx.set(out, "many".to_owned()));
        out
    });
    let inp = federation.reactor("parser", (), |parser| {
        let inp = parser.input::<String>("inp");
        parser
            .reaction()
            .on(inp)
            .run(move |(), ctx| parse(ctx.get(inp).map_or("", String::as_str)));
        inp
    });
    federation.connect(out, inp);
    federation.run()
}

/// Three federates in a row, and back; one of them is killed.
fn death(mut federation: Federation, victim: &str) -> Result<(), Failure> {
    federation = federation.timeout(Duration::from_secs(3600));
    let ends = ["camera", "detector", "controller"].map(|name| {
        let is_victim = name == victim;
        federation.reactor(name, 0, |member| {
            let (inp, out) = (member.input::<u64>("inp"), member.output("out"));
            let tick = member.timer("tick", Duration::ZERO, MS);
            member.reaction().on(tick).on(inp).sets(out).run(move |count, ctx| {
                *count += 1;
                if is_victim && *count == 20 {
                    kill_process(getpid(), Signal::KILL).unwrap();
                }
                ctx.set(out, *count);
            });
            (inp, out)
        })
    });
    for (from, to) in [(0, 1), (1, 2), (2, 0)] {
        federation.connect(ends[from].1, ends[to].0).after(MS);
    }
    federation.run()
}

fn endless() -> Result<(), Failure> {
    let mut federation = Federation::new("Endless");
    let [(_, out), (inp, _)] = ["a", "b"].map(|name| {
        federation.reactor(name, (), |member| {
            let (inp, out) = (member.input::<u64>("inp"), member.output("out"));
            let tick = member.timer("tick", Duration::ZERO, MS);
            member.reaction().on(tick).sets(out).run(move |(), ctx| ctx.set(out, 1));
            member.reaction().on(inp).run(move |(), ctx| {
                if ctx.elapsed() == 3 * MS {
                    println!("is there");
                }
            });
            member.reaction().on(Shutdown).run(|(), _| println!("shutdown"));
            (inp, out)
        })
    });
    federation.connect(out, inp);
    federation.run()
}

/// Declares something else in each process.
fn random() -> Result<(), Failure> {
    let now = SystemTime::UNIX_EPOCH.elapsed().unwrap();
    let mut federation = Federation::new("Random").timeout(MS);
    federation.reactor("ticker", (), |ticker| {
        let tick = ticker.timer("tick", now, MS);
        ticker.reaction().on(tick).run(|(), _| {});
    });
    federation.run()
}

fn same_name() -> Result<(), Failure> {
    let mut federation = Federation::new("Same");
    federation.reactor("camera", (), |_| ());
    federation.reactor("camera", (), |_| ());
    federation.run()
}

fn nested() -> Result<(), Failure> {
    let mut federation = Federation::new("Nested").timeout(Duration::ZERO);
    federation.reactor("outer", (), |outer| {
        outer.reaction().on(Startup).run(|(), _| {
            let mut inner = Command::new(std::env::current_exe()?);
            let output = inner.args(["--scenario", "counting", "centralized"]).output()?;
            print!("{}", String::from_utf8_lossy(&output.stdout));
            eprint!("{}", String::from_utf8_lossy(&output.stderr));
            Ok::<_, std::io::Error>(())
        });
    });
    federation.run()
}

/// Starts a federate that sees another process as its parent than the one that launches it.
fn orphan() -> Result<(), Failure> {
    let program = ProgramBuilder::new("Counting", Properties::default()).build()?;
    let fingerprint = program.fingerprint();
    let (rti, security) = ("unix:@nowhere".parse().unwrap(), hprm::Security::default());
    let meeting =
        hprm::Meeting { rti: &rti, federation: hprm::FederationId(1), security: &security };
    let handover = hprm::Handover::new("adder", &program, &fingerprint, &meeting);
    let mut shell = Command::new("sh");
    // The shell is the parent.
    shell
        .args(["-c", "\"$0\" --scenario counting centralized; true"])
        .arg(std::env::current_exe().unwrap());
    handover.attach(&mut shell).unwrap();
    shell.status().unwrap();
    Ok(())
}

fn with_a_thread() -> Result<(), Failure> {
    let mut federation = Federation::new("Thread");
    federation.reactor("reader", (), |reader| {
        let line = reader.physical_action::<u32>("line", Duration::ZERO);
        let sender = reader.sender(line);
        reader.reaction().on(Startup).run(move |(), _| {
            let sender = sender.clone();
            thread::spawn(move || sender.schedule(Duration::ZERO, 42));
        });
        reader.reaction().on(line).run(move |(), ctx| {
            println!("the line is {}", ctx.get(line).copied().unwrap_or_default());
            ctx.request_stop();
        });
    });
    federation.run()
}
