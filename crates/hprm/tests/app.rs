//! Programs whose bodies are closures.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use hprm::{App, Context, Kind, Properties, Trigger};

const MS: Duration = Duration::from_millis(1);

fn fast() -> Properties {
    Properties { fast: true, ..Properties::default() }
}

/// What a program reports, in order.
type Log = Arc<Mutex<Vec<String>>>;

fn note(log: &Log, text: String) {
    log.lock().unwrap().push(text);
}

fn lines(log: &Log) -> Vec<String> {
    log.lock().unwrap().clone()
}

#[test]
fn reactions_share_their_state_and_run_in_order() {
    let log = Log::default();
    let mut app = App::<u32>::new("Main", fast());
    app.reactor("counter", 10, |counter| {
        let tick = counter.timer("tick", Duration::ZERO, MS);
        let again = counter.logical_action("again", 2 * MS);
        counter.reaction().on(tick).schedules(again).run(move |count, ctx| {
            *count += 1;
            if ctx.elapsed() == MS {
                ctx.schedule(again, MS, *count);
                ctx.request_stop();
            }
        });
        let log = Arc::clone(&log);
        counter.reaction().on(tick).on(again).on(Trigger::Shutdown).run(
            move |count: &mut u32, ctx: &mut Context<'_, u32>| {
                note(&log, format!("{} {count} {:?}", ctx.tag(), ctx.get(again)));
            },
        );
    });
    app.run().unwrap();
    let expected = ["(0 ns, 0) 11 None", "(1000000 ns, 0) 12 None", "(1000000 ns, 1) 12 None"];
    assert_eq!(lines(&log), expected);
}

#[test]
fn values_pass_through_reactors_inside_others() {
    let log = Log::default();
    let mut app = App::<String>::new("Main", fast());
    let out = app.reactor("source", (), |source| {
        let out = source.output("out");
        let body = move |(): &mut (), ctx: &mut Context<'_, String>| ctx.set(out, "a".to_owned());
        source.reaction().on(Trigger::Startup).sets(out).run(body);
        out
    });
    let inp = app.reactor("outer", (), |outer| {
        let (inp, back) = (outer.input("inp"), outer.input("back"));
        let (child_in, child_out) = outer.reactor("inner", (), |inner| {
            let (inp, out) = (inner.input("inp"), inner.output("out"));
            inner.reaction().on(inp).sets(out).run(move |(), ctx| {
                let got = ctx.get(inp).cloned().unwrap_or_default();
                ctx.set(out, got + "b");
            });
            (inp, out)
        });
        outer.connect(inp, child_in);
        outer.connect_after(child_out, back, 5 * MS);
        let log = Arc::clone(&log);
        outer.reaction().on(back).reads(inp).run(move |(), ctx| {
            note(&log, format!("{} {:?} {}", ctx.tag(), ctx.get(back), ctx.is_present(inp)));
        });
        inp
    });
    app.connect(out, inp);
    app.run().unwrap();
    assert_eq!(lines(&log), ["(5000000 ns, 0) Some(\"ab\") false"]);
}

#[test]
fn a_missed_deadline_runs_the_handler() {
    let log = Log::default();
    let mut app = App::<()>::new("Main", fast());
    app.reactor("late", (), |late| {
        let [body, handler] = [Arc::clone(&log), Arc::clone(&log)];
        late.reaction()
            .on(Trigger::Startup)
            .deadline(Duration::ZERO, move |(), ctx| {
                assert!(ctx.misses_deadline());
                note(&handler, "handler".to_owned());
            })
            .run(move |(), _| note(&body, "body".to_owned()));
    });
    app.run().unwrap();
    assert_eq!(lines(&log), ["handler"]);
}

#[test]
fn an_error_ends_the_program_and_names_the_reaction() {
    let mut app = App::<()>::new("Main", fast());
    app.reactor("a", (), |a| {
        a.reaction().on(Trigger::Startup).run(|(), _| "x".parse::<u8>().map(|_| ()));
    });
    let failure = app.run().unwrap_err();
    let message = "reaction Main.a.1 failed: invalid digit found in string";
    let report = failure.report();
    assert_eq!((failure.to_string(), failure.exit_code()), (message.to_owned(), 1));
    assert_eq!((report.kind, report.tag), (Kind::Reaction, Some((0, 0))));
    assert_eq!(report.reaction.as_deref(), Some("Main.a.1"));
}

#[test]
fn a_graph_that_is_no_program_is_refused() {
    let mut app = App::<()>::new("Main", fast());
    let [(a_in, a_out), (b_in, b_out)] = ["a", "b"].map(|name| {
        app.reactor(name, (), |reactor| {
            let (inp, out) = (reactor.input("inp"), reactor.output("out"));
            reactor.reaction().on(inp).sets(out).run(move |(), ctx| ctx.set(out, ()));
            (inp, out)
        })
    });
    app.connect(a_out, b_in);
    app.connect(b_out, a_in);
    let message = app.run().unwrap_err().to_string();
    assert!(message.starts_with("reactions depend on one another"), "{message}");
}

#[test]
fn another_thread_schedules_and_stops() {
    let log = Log::default();
    let keepalive = Properties { keepalive: true, ..Properties::default() };
    let mut app = App::<u32>::new("Main", keepalive);
    let key = app.reactor("keys", (), |keys| {
        let key = keys.physical_action("key", Duration::ZERO);
        let log = Arc::clone(&log);
        keys.reaction().on(key).run(move |(), ctx| {
            note(&log, format!("{:?}", ctx.get(key)));
            if ctx.get(key) == Some(&2) {
                ctx.request_stop();
            }
        });
        key
    });
    let sender = app.sender().unwrap();
    let from = sender.clone();
    let thread = std::thread::spawn(move || {
        assert!(from.schedule(key, Duration::ZERO, 1));
        assert!(from.schedule(key, Duration::ZERO, 2));
    });
    app.run().unwrap();
    thread.join().unwrap();
    assert_eq!(lines(&log), ["Some(1)", "Some(2)"]);
    assert!(!sender.schedule(key, Duration::ZERO, None));
}

fn with_an_undeclared(body: fn(&mut Context<'_, u32>, hprm::OutputPort, hprm::LogicalAction)) {
    let mut app = App::<u32>::new("Main", fast());
    app.reactor("a", (), |a| {
        let (out, action) = (a.output("out"), a.logical_action("act", MS));
        a.reaction().on(Trigger::Startup).run(move |(), ctx| body(ctx, out, action));
    });
    app.run().unwrap();
}

#[test]
#[should_panic(expected = "reaction Main.a.1 cannot set Main.a.out, which it does not declare")]
fn setting_what_is_not_declared_is_a_mistake() {
    with_an_undeclared(|ctx, out, _| ctx.set(out, 1));
}

#[test]
#[should_panic(expected = "cannot schedule act, which it does not declare; add `.schedules(...)`")]
fn scheduling_what_is_not_declared_is_a_mistake() {
    with_an_undeclared(|ctx, _, action| ctx.schedule(action, MS, None));
}

#[test]
#[should_panic(expected = "reaction Main.a.1 cannot read Main.a.out, which it does not declare")]
fn reading_what_is_not_declared_is_a_mistake() {
    with_an_undeclared(|ctx, out, _| assert_eq!(ctx.get(out), None));
}
