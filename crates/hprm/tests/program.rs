//! Programs in Rust: what their reactions see, and what becomes of mistakes.

use std::error::Error;
use std::fmt;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use hprm::Kind;
use hprm::prelude::*;

const MS: Duration = Duration::from_millis(1);

/// What a program reports, in order.
#[derive(Clone, Default)]
struct Log(Arc<Mutex<Vec<String>>>);

impl Log {
    fn note(&self, text: impl Into<String>) {
        self.0.lock().unwrap().push(text.into());
    }

    fn lines(&self) -> Vec<String> {
        self.0.lock().unwrap().clone()
    }
}

#[test]
fn reactions_share_their_state_and_run_in_order() {
    let log = Log::default();
    let mut program = Program::new("Main").fast();
    program.reactor("counter", 10, |counter| {
        let tick = counter.timer("tick", Duration::ZERO, MS);
        let again = counter.logical_action("again", 2 * MS);
        counter.reaction().on(tick).schedules(again).run(move |count, ctx| {
            *count += 1;
            if ctx.elapsed() == MS {
                ctx.schedule(again, MS, *count);
                ctx.request_stop();
            }
        });
        let log = log.clone();
        counter.reaction().on(tick).on(again).on(Shutdown).run(move |count, ctx| {
            log.note(format!("{} {count} {:?}", ctx.tag(), ctx.get(again)));
        });
    });
    program.run().unwrap();
    let expected = ["(0 ns, 0) 11 None", "(1000000 ns, 0) 12 None", "(1000000 ns, 1) 12 None"];
    assert_eq!(log.lines(), expected);
}

/// A value of more than eight words.
#[derive(Clone, PartialEq, Debug)]
struct Image {
    pixels: [u16; 100],
}

#[test]
fn values_of_several_types_pass_through_reactors_inside_others() {
    let log = Log::default();
    let mut program = Program::new("Main").fast();
    let (image, text) = program.reactor("source", (), |source| {
        let (image, text) = (source.output("image"), source.output("text"));
        source.reaction().on(Startup).sets(image).sets(text).run(move |(), ctx| {
            ctx.set(image, Image { pixels: [7; 100] });
            ctx.set(text, "a".to_owned());
        });
        (image, text)
    });
    let (image_in, text_in) = program.reactor("outer", (), |outer| {
        let (image, text, back) = (outer.input("image"), outer.input("text"), outer.input("back"));
        let (child_in, child_out) = outer.reactor("inner", (), |inner| {
            let (inp, out) = (inner.input::<String>("inp"), inner.output("out"));
            inner.reaction().on(inp).sets(out).run(move |(), ctx| {
                let got = ctx.get(inp).cloned().unwrap_or_default();
                ctx.set(out, Some(got + "b"));
            });
            (inp, out)
        });
        let pass = outer.reactor("pass", (), |pass| {
            let (inp, out) = (pass.input("inp"), pass.output("out"));
            pass.connect(inp, out).after(5 * MS);
            (inp, out)
        });
        outer.connect(text, child_in);
        outer.connect(child_out, pass.0);
        let log = log.clone();
        let early = log.clone();
        outer.reaction().on(image).run(move |(), ctx| {
            early.note(format!(
                "{} {}",
                ctx.tag(),
                ctx.get(image) == Some(&Image { pixels: [7; 100] })
            ));
        });
        outer.reaction().on(pass.1).reads(text).on(back).run(move |(), ctx| {
            assert_eq!(ctx.get(back), None::<&u8>);
            log.note(format!("{} {:?} {}", ctx.tag(), ctx.get(pass.1), ctx.is_present(text)));
        });
        (image, text)
    });
    program.connect(image, image_in);
    program.connect(text, text_in);
    program.run().unwrap();
    let expected = ["(0 ns, 0) true", "(5000000 ns, 0) Some(Some(\"ab\")) false"];
    assert_eq!(log.lines(), expected);
}

/// Sends its index on each of its outputs but the one that has this index.
struct Worker {
    index: usize,
}

impl Reactor for Worker {
    type Ports = Vec<OutputPort<usize>>;

    fn assemble(&mut self, worker: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let outs = worker.outputs("out", 3);
        let all = outs.clone();
        worker.reaction().on(Startup).sets(&outs).run(move |worker, ctx| {
            for (index, out) in all.iter().enumerate().filter(|(index, _)| *index != worker.index) {
                ctx.set(*out, 10 * worker.index + index);
            }
        });
        outs
    }
}

#[test]
fn banks_and_multiports_are_connected_one_by_one() {
    let log = Log::default();
    let mut program = Program::new("Main").fast();
    let workers = program.bank("worker", (0..2).map(|index| Worker { index }));
    let inputs = program.reactor("sum", (), |sum| {
        let inputs = sum.inputs("inp", 6);
        let (all, log) = (inputs.clone(), log.clone());
        sum.reaction().on(&inputs).run(move |(), ctx| {
            log.note(format!("{:?}", ctx.present(&all).collect::<Vec<_>>()));
        });
        inputs
    });
    program.connect_each(workers.into_iter().flatten(), inputs);
    program.run().unwrap();
    assert_eq!(log.lines(), ["[(1, 1), (2, 2), (3, 10), (5, 12)]"]);
}

#[test]
fn a_physical_connection_keeps_the_newest_value() {
    let log = Log::default();
    let mut program = Program::new("Main").fast().timeout(Duration::from_secs(100));
    let out = program.reactor("source", 0, |source| {
        let tick = source.timer("tick", Duration::ZERO, Duration::from_secs(50));
        let out = source.output("out");
        source.reaction().on(tick).sets(out).run(move |count, ctx| {
            *count += 1;
            ctx.set(out, *count);
        });
        out
    });
    let inp = program.reactor("sink", (), |sink| {
        let (inp, log) = (sink.input::<i32>("inp"), log.clone());
        sink.reaction().on(inp).run(move |(), ctx| log.note(format!("{:?}", ctx.get(inp))));
        inp
    });
    program.connect(out, inp).bound(1, Overflow::Replace);
    program.run().unwrap();
    assert!(!log.lines().is_empty());
}

#[test]
fn modes_are_entered_anew_or_as_they_were_left() {
    let log = Log::default();
    let mut program = Program::new("Main").fast().timeout(7 * MS);
    program.reactor("modal", 0, |modal| {
        let [first, second] = [modal.initial_mode("first"), modal.mode("second")];
        let tick = modal.timer("tick", 2 * MS, 2 * MS);
        let entered = log.clone();
        modal.reaction().on(tick).enters(first.history()).enters(second.reset()).run(
            move |count: &mut i32, ctx| {
                *count += 1;
                ctx.enter(if *count % 2 == 0 { first.history() } else { second.reset() });
                entered.note(format!("{} enters", ctx.tag()));
            },
        );
        for (mode, name) in [(first, "first"), (second, "second")] {
            let log = log.clone();
            modal.in_mode(mode, |modal| {
                modal.reactor(&format!("in_{name}"), (), |inside| {
                    let tick = inside.timer("tick", MS * 3 / 2, Duration::ZERO);
                    let anew = log.clone();
                    inside.reaction().on(tick).run(move |(), ctx| {
                        log.note(format!("{} {name}", ctx.tag()));
                    });
                    inside
                        .reaction()
                        .on(Reset)
                        .run(move |(), _| anew.note(format!("reset {name}")));
                });
            });
        }
    });
    program.run().unwrap();
    let expected = [
        "(1500000 ns, 0) first",
        "(2000000 ns, 0) enters",
        "reset second",
        "(3500000 ns, 0) second",
        "(4000000 ns, 0) enters",
        "(6000000 ns, 0) enters",
        "reset second",
    ];
    assert_eq!(log.lines(), expected);
}

#[test]
fn a_missed_deadline_runs_the_handler() {
    let log = Log::default();
    let mut program = Program::new("Main").fast();
    program.reactor("late", (), |late| {
        let [body, handler] = [log.clone(), log.clone()];
        late.reaction()
            .on(Startup)
            .deadline(Duration::ZERO, move |(), ctx| {
                assert!(ctx.misses_deadline());
                handler.note("handler");
            })
            .run(move |(), _| body.note("body"));
    });
    program.run().unwrap();
    assert_eq!(log.lines(), ["handler"]);
}

/// An error with a cause.
#[derive(Debug)]
struct BadReading(std::num::ParseIntError);

impl fmt::Display for BadReading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the sensor has sent nonsense")
    }
}

impl Error for BadReading {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        Some(&self.0)
    }
}

#[test]
fn an_error_ends_the_program_and_names_the_reaction_its_tag_and_the_causes() {
    for workers in [1, 2] {
        let mut program = Program::new("Main").fast().workers(workers);
        for name in ["a", "b"] {
            program.reactor(name, (), |a| {
                let tick = a.timer("tick", 2 * MS, Duration::ZERO);
                a.reaction().on(tick).run(|(), _| "x".parse::<u8>().map(drop).map_err(BadReading));
            });
        }
        let failure = program.run().unwrap_err();
        let message = "reaction Main.a.1 failed at (2000000 ns, 0): the sensor has sent nonsense";
        let report = failure.report();
        assert_eq!((failure.to_string(), failure.exit_code()), (message.to_owned(), 1));
        assert_eq!((report.kind, report.tag), (Kind::Reaction, Some((2_000_000, 0))));
        assert_eq!(report.reaction.as_deref(), Some("Main.a.1"));
        let shown = format!("{message}\ncaused by: invalid digit found in string");
        assert_eq!(format!("{failure:?}"), shown);
        let error = failure.source().unwrap();
        assert!(error.is::<BadReading>());
        assert!(error.source().unwrap().is::<std::num::ParseIntError>());
    }
}

#[test]
fn a_graph_that_is_no_program_is_refused() {
    let mut program = Program::new("Main").fast();
    let [(a_in, a_out), (b_in, b_out)] = ["a", "b"].map(|name| {
        program.reactor(name, (), |reactor| {
            let (inp, out) = (reactor.input("inp"), reactor.output("out"));
            reactor.reaction().on(inp).sets(out).run(move |(), ctx| ctx.set(out, ()));
            (inp, out)
        })
    });
    program.connect(a_out, b_in);
    program.connect(b_out, a_in);
    let message = program.run().unwrap_err().to_string();
    assert!(message.starts_with("reactions depend on one another"), "{message}");
}

/// The mistakes of a program with a reactor `a` that has a reactor `b` inside, and a reactor `c` beside them.
fn mistakes(
    make: impl FnOnce(&mut Program, [InputPort<u8>; 3], [OutputPort<u8>; 3]),
) -> Vec<String> {
    let mut program = Program::new("Main").fast();
    fn ports(r: &mut ReactorBuilder<'_, ()>) -> (InputPort<u8>, OutputPort<u8>) {
        (r.input("inp"), r.output("out"))
    }
    let (a, b) = program.reactor("a", (), |a| (ports(a), a.reactor("b", (), ports)));
    let c = program.reactor("c", (), ports);
    make(&mut program, [a.0, b.0, c.0], [a.1, b.1, c.1]);
    let reports = program.build().err().expect("there are mistakes").reports();
    assert!(reports.iter().all(|report| report.kind == Kind::Program && report.hint.is_some()));
    reports.into_iter().map(|report| report.message).collect()
}

#[test]
fn what_is_out_of_reach_is_refused_by_name() {
    let found = mistakes(|program, [_, b_in, c_in], [a_out, b_out, _]| {
        program.connect(a_out, b_in);
        program.connect(b_out, c_in);
    });
    let expected = [
        "the connection Main.a.out -> Main.a.b.inp does not lie in one reactor",
        "the connection Main.a.b.out -> Main.c.inp does not lie in one reactor",
    ];
    assert_eq!(found, expected);
    let found = mistakes(|program, [a_in, _, c_in], [a_out, _, c_out]| {
        program.connect(a_in, c_in);
        program.connect(a_out, c_out);
    });
    let expected = [
        "the connection Main.a.inp -> Main.c.inp leads from an input to an input",
        "the connection Main.a.out -> Main.c.out leads from an output to an output",
    ];
    assert_eq!(found, expected);
    let found = mistakes(|program, [a_in, b_in, _], [_, b_out, c_out]| {
        let timer = program.reactor("d", (), |d| {
            let timer = d.timer("t", MS, MS);
            d.reaction().on(a_in).reads(b_out).sets(b_in).sets(c_out).run(|(), _| ());
            timer
        });
        program.main().reaction().on(timer).sets(a_in).run(|(), _| ());
    });
    let expected = [
        "reaction Main.d.1 cannot read Main.a.inp",
        "reaction Main.d.1 cannot read Main.a.b.out",
        "reaction Main.d.1 cannot set Main.a.b.inp",
        "reaction Main.d.1 cannot set Main.c.out",
        "reaction Main.1 cannot be triggered by timer Main.d.t",
    ];
    assert_eq!(found, expected);
    let found = mistakes(|program, [_, _, c_in], outs| _ = program.connect_each(outs, [c_in]));
    assert_eq!(found, ["cannot connect 3 ports (Main.a.out, …) to one port (Main.c.inp)"]);
}

/// The reports of a program, each with the line of this file that it names.
fn located_mistakes(program: Program) -> Vec<(String, u32)> {
    let reports = program.build().err().expect("there are mistakes").reports();
    let line = |report: &hprm::Report| {
        assert_eq!(report.file.as_deref(), Some(file!()));
        report.line.expect("it names a line")
    };
    reports.iter().map(|report| (report.message.clone(), line(report))).collect()
}

/// Everything in it has a number that parts of another program have as well.
fn other_program() -> (Program, InputPort<u8>, OutputPort<u8>, PhysicalAction<u8>, Timer, Mode) {
    let mut program = Program::new("Other").fast();
    let (inp, out, action, timer, mode) = program.reactor("b", (), |b| {
        let mode = b.initial_mode("calm");
        let action = b.physical_action("act", MS);
        b.reaction().on(action).run(|(), _| ());
        (b.input("inp"), b.output("out"), action, b.timer("tick", MS, MS), mode)
    });
    (program, inp, out, action, timer, mode)
}

#[test]
fn a_handle_of_another_program_is_refused_by_name_and_line() {
    let (other, b_in, b_out, act, tick, calm) = other_program();
    let mut program = Program::new("Main").fast();
    let line = line!();
    program.reactor("a", (), |a| {
        let (inp, out) = (a.input("inp"), a.output("out"));
        a.connect(inp, b_in);
        a.connect(b_out, out).after(MS);
        a.bound(act, 1, WhenFull::Wait);
        a.space(act, Spacing { min: 1, policy: Policy::Drop });
        a.in_mode(calm, |_| ());
        let reaction = a.reaction().on([tick]).on(act).reads(b_in);
        reaction.sets([b_out]).schedules(act).enters(calm.reset()).run(|(), _| ());
    });
    let sender = program.sender(act);
    assert!(sender.schedule(MS, 1).is_err());
    let theirs = |text: &str, after: u32| {
        (format!("{text}, which belongs to another program"), line + after)
    };
    let expected = [
        theirs("program Main cannot connect port Other.b.inp", 3),
        theirs("program Main cannot connect port Other.b.out", 4),
        theirs("reactor Main.a cannot bound action Other.b.act", 5),
        theirs("reactor Main.a cannot space action Other.b.act", 6),
        theirs("reactor Main.a cannot put parts into mode Other.b.calm", 7),
        theirs("a reaction of Main.a cannot be triggered by timer Other.b.tick", 8),
        theirs("a reaction of Main.a cannot be triggered by action Other.b.act", 8),
        theirs("a reaction of Main.a cannot read port Other.b.inp", 8),
        theirs("a reaction of Main.a cannot set port Other.b.out", 9),
        theirs("a reaction of Main.a cannot schedule action Other.b.act", 9),
        theirs("a reaction of Main.a cannot enter mode Other.b.calm", 9),
        theirs("program Main has no sender for action Other.b.act", 11),
    ];
    assert_eq!(located_mistakes(program), expected);
    drop(other);
    let mut program = Program::new("Main").fast();
    program.main().reaction().on(b_out).run(|(), _| ());
    let found = located_mistakes(program);
    assert_eq!(
        found[0].0,
        "a reaction of Main cannot be triggered by a port of a program that has ended"
    );
}

#[test]
#[should_panic(expected = "cannot read port Other.b.inp, which belongs to another program")]
fn a_body_cannot_read_a_port_of_another_program_of_the_same_number() {
    let (_other, b_in, ..) = other_program();
    let mut program = Program::new("Main").fast();
    program.reactor("a", (), |a| {
        let inp = a.input::<u8>("inp");
        a.reaction().on(Startup).reads(inp).run(move |(), ctx| _ = ctx.get(b_in));
    });
    program.run().unwrap();
}

#[test]
fn parts_of_another_reactor_are_refused_by_name_and_line() {
    let mut program = Program::new("Main").fast();
    let (act, mode) =
        program.reactor("a", (), |a| (a.physical_action::<u8>("act", MS), a.initial_mode("calm")));
    let line = line!();
    program.reactor("b", (), |b| {
        b.space(act, Spacing { min: 1, policy: Policy::Drop });
        b.bound(act, 1, WhenFull::Wait);
        b.in_mode(mode, |b| b.timer("tick", MS, MS));
    });
    let theirs = |text: &str, after: u32| {
        (format!("{text}, which belongs to another reactor"), line + after)
    };
    let expected = [
        theirs("reactor Main.b cannot space action Main.a.act", 2),
        theirs("reactor Main.b cannot bound action Main.a.act", 3),
        theirs("reactor Main.b cannot put parts into mode Main.a.calm", 4),
    ];
    assert_eq!(located_mistakes(program), expected);
    let mut program = Program::new("Main").fast();
    let strange = program.reactor("a", (), |a| a.input::<u8>("inp"));
    let line = line!();
    program.reactor("b", (), |b| {
        b.reaction().on(Startup).reads(strange).run(|(), _| ());
        let inp = b.input("inp");
        b.connect(strange, inp);
    });
    let expected = [
        (
            "the connection Main.a.inp -> Main.b.inp leads from an input to an input".to_owned(),
            line + 4,
        ),
        ("reaction Main.b.1 cannot read Main.a.inp".to_owned(), line + 2),
    ];
    assert_eq!(located_mistakes(program), expected);
}

#[test]
fn what_makes_the_graph_wrong_is_located() {
    fn ports(r: &mut ReactorBuilder<'_, ()>) -> (InputPort<u8>, OutputPort<u8>) {
        let (inp, out) = (r.input("inp"), r.output("out"));
        r.reaction().on(inp).sets(out).run(|(), _| ());
        (inp, out)
    }
    let mut program = Program::new("Main").fast();
    let [a, b, c] = ["a", "b", "c"].map(|name| program.reactor(name, (), ports));
    program.connect(a.1, c.0);
    let line = line!();
    program.connect(b.1, c.0);
    let expected = [("port Main.c.inp has two sources".to_owned(), line + 1)];
    assert_eq!(located_mistakes(program), expected);

    let mut program = Program::new("Main").fast();
    let line = line!();
    let (inp, out) = program.reactor("a", (), |a| {
        let (inp, out) = (a.input::<u8>("inp"), a.output::<u8>("out"));
        a.reaction().on(inp).sets(out).run(|(), _| ());
        (inp, out)
    });
    program.connect(out, inp);
    let found = located_mistakes(program);
    assert!(found[0].0.starts_with("reactions depend on one another in a cycle"), "{found:?}");
    assert_eq!(found[0].1, line + 3);
}

#[test]
fn a_name_is_taken_once_in_a_reactor() {
    let mut program = Program::new("Main").fast();
    let line = line!();
    for name in ["a", "a"] {
        program.reactor(name, (), |_| ());
    }
    program.reactor("b", (), |b| {
        // A reactor inside may have the name of a port, as in an `.lf` file.
        let (_, _) = (b.input::<u8>("x"), b.reactor("x", (), |_| ()));
        b.outputs::<u8>("x", 2);
        b.timer("x", MS, MS);
        b.logical_action::<u8>("x", MS);
        b.mode("x");
        b.reactor("inside", (), |inside| _ = inside.input::<u8>("x"));
    });
    program.bank("b", std::iter::empty::<Worker>());
    let taken = |name: &str, reactor: &str, first: (u32, u32), after: u32| {
        let (first, column) = (line + first.0, first.1);
        let at = format!("{}:{first}:{column}", file!());
        let text = format!("the name `{name}` is already taken in {reactor}, at {at}");
        (text, line + after)
    };
    let expected = [
        taken("a", "Main", (2, 17), 2),
        taken("x", "Main.b", (6, 25), 7),
        taken("x", "Main.b", (6, 25), 8),
        taken("x", "Main.b", (6, 25), 9),
        taken("x", "Main.b", (6, 25), 10),
        taken("b", "Main", (4, 13), 13),
    ];
    assert_eq!(located_mistakes(program), expected);
    let mut federation = Federation::new("Names");
    for name in ["a", "a"] {
        federation.reactor(name, (), |_| ());
    }
    let reports = federation.run_in_one_process().unwrap_err().reports();
    let [report] = reports.as_slice() else { panic!("{reports:?}") };
    assert_eq!(report.diagnostic.as_deref(), Some("LF0201"));
}

fn with_an_undeclared(body: fn(&mut Context<'_>, OutputPort<u32>, LogicalAction<u8>, Mode)) {
    let mut program = Program::new("Main").fast();
    program.reactor("a", (), |a| {
        let (out, action) = (a.output("out"), a.logical_action("act", MS));
        let mode = a.initial_mode("calm");
        a.reaction()
            .on(Startup)
            .enters(mode.reset())
            .run(move |(), ctx| body(ctx, out, action, mode));
    });
    program.run().unwrap();
}

#[test]
#[should_panic(expected = "reaction Main.a.1 cannot set Main.a.out, which it does not declare")]
fn setting_what_is_not_declared_is_a_mistake() {
    with_an_undeclared(|ctx, out, _, _| ctx.set(out, 1));
}

#[test]
#[should_panic(expected = "cannot schedule act, which it does not declare; add `.schedules(...)`")]
fn scheduling_what_is_not_declared_is_a_mistake() {
    with_an_undeclared(|ctx, _, action, _| ctx.schedule(action, MS, 1));
}

#[test]
#[should_panic(expected = "reaction Main.a.1 cannot read Main.a.out, which it does not declare")]
fn reading_what_is_not_declared_is_a_mistake() {
    with_an_undeclared(|ctx, out, _, _| assert_eq!(ctx.get(out), None));
}

#[test]
#[should_panic(expected = "cannot enter mode calm, which it does not declare; add `.enters(...)`")]
fn entering_a_mode_in_a_way_that_is_not_declared_is_a_mistake() {
    with_an_undeclared(|ctx, _, _, mode| ctx.enter(mode.history()));
}

#[test]
fn what_is_wrong_with_the_graph_has_a_hint() {
    let hint = |wrong: fn(&mut Program)| {
        let mut program = Program::new("Main");
        wrong(&mut program);
        let failure = program.run().unwrap_err();
        failure.report().hint.unwrap_or_else(|| panic!("{failure} has no hint"))
    };
    let twice = hint(|program| {
        let input = program.reactor("sink", (), |sink| sink.input::<u8>("inp"));
        for name in ["first", "second"] {
            let output = program.reactor(name, (), |source| source.output("out"));
            program.connect(output, input);
        }
    });
    assert!(twice.contains("`inputs(name, 2)`"), "{twice}");
    let cycle = hint(|program| {
        let (input, output) = program.reactor("echo", (), |echo| {
            let (input, output) = (echo.input::<u8>("inp"), echo.output("out"));
            echo.reaction().on(input).sets(output).run(move |(), ctx| ctx.set(output, 1));
            (input, output)
        });
        program.connect(output, input);
    });
    assert!(cycle.contains("`.after(Duration::ZERO)`"), "{cycle}");
    let modes = hint(|program| {
        program.main().mode("idle");
    });
    assert!(modes.contains("`initial_mode`"), "{modes}");
}
