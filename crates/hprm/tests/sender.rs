//! Physical actions from other threads: their order, and the bound on how many wait.

use std::env;
use std::process::Command;
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use hprm::prelude::*;

/// A program that waits for keys, has a bound, and ends with the key 0. Returns what the reaction notes, once it is
/// over.
fn keys(
    events: usize,
    when_full: WhenFull,
    mut note: impl FnMut(u32) + Send + 'static,
) -> (Program, Sender<u32>) {
    let mut program = Program::new("Main").keepalive();
    let sender = program.reactor("keys", (), |keys| {
        let key = keys.physical_action("key", Duration::ZERO);
        keys.bound(key, events, when_full);
        keys.reaction().on(key).run(move |(), ctx| {
            let value = ctx.get(key).copied().unwrap();
            note(value);
            if value == 0 {
                ctx.request_stop();
            }
        });
        keys.sender(key)
    });
    (program, sender)
}

#[test]
fn another_thread_schedules_and_stops() {
    let (notes, noted) = channel();
    let (program, sender) = keys(10, WhenFull::Refuse, move |key| notes.send(key).unwrap());
    let from = sender.clone();
    let thread = thread::spawn(move || {
        for key in [3, 2, 1, 0] {
            from.schedule(Duration::ZERO, key).unwrap();
        }
    });
    program.run().unwrap();
    thread.join().unwrap();
    assert_eq!(noted.into_iter().collect::<Vec<_>>(), [3, 2, 1, 0]);
    let error = sender.schedule(Duration::ZERO, 1).unwrap_err();
    assert_eq!(error, ScheduleError::Ended { action: "Main.keys.key".into() });
}

#[test]
fn a_thread_asks_the_program_to_stop() {
    let (program, sender) = keys(1, WhenFull::Refuse, |_| ());
    let thread = thread::spawn(move || sender.request_stop());
    program.run().unwrap();
    thread.join().unwrap();
}

#[test]
fn one_event_too_many_is_refused_by_name() {
    let (program, sender) = keys(2, WhenFull::Refuse, |_| ());
    for key in [1, 0] {
        sender.schedule(Duration::ZERO, key).unwrap();
    }
    let error = sender.schedule(Duration::ZERO, 5).unwrap_err();
    assert_eq!(error, ScheduleError::Full { action: "Main.keys.key".into(), events: 2 });
    let said = error.to_string();
    assert!(said.starts_with("action Main.keys.key cannot be scheduled: 2 events wait"), "{said}");
    assert!(said.contains("\n  hint: "), "{said}");
    program.run().unwrap();
}

#[test]
fn an_event_waits_until_its_reaction_has_run() {
    let (notes, noted) = channel();
    let (program, sender) = keys(1, WhenFull::Refuse, move |key| notes.send(key).unwrap());
    let thread = thread::spawn(move || {
        sender.schedule(Duration::ZERO, 1).unwrap();
        assert_eq!(noted.recv(), Ok(1));
        // The tag is over soon, and then there is room.
        while sender.schedule(Duration::ZERO, 0).is_err() {
            thread::yield_now();
        }
        noted
    });
    program.run().unwrap();
    assert_eq!(thread.join().unwrap().try_recv(), Ok(0));
}

#[test]
fn a_thread_may_wait_for_room() {
    let (notes, noted) = channel();
    let (program, sender) = keys(3, WhenFull::Wait, move |key| notes.send(key).unwrap());
    let thread = thread::spawn(move || {
        (0..1000).rev().try_for_each(|key| sender.schedule(Duration::ZERO, key))
    });
    program.run().unwrap();
    thread.join().unwrap().unwrap();
    assert!(noted.into_iter().eq((0..1000).rev()));
}

#[test]
fn a_thread_that_waits_for_room_learns_of_the_end() {
    let (program, sender) = keys(1, WhenFull::Wait, |_| ());
    sender.schedule(Duration::ZERO, 0).unwrap();
    let thread = thread::spawn(move || {
        // Some of these may find room, but not for ever.
        while sender.schedule(Duration::from_secs(1000), 1).is_ok() {}
    });
    program.run().unwrap();
    thread.join().unwrap();
    let (program, sender) = keys(1, WhenFull::Wait, |_| ());
    sender.schedule(Duration::ZERO, 1).unwrap();
    let thread = thread::spawn(move || sender.schedule(Duration::ZERO, 1));
    drop(program);
    let error = thread.join().unwrap().unwrap_err();
    assert_eq!(error, ScheduleError::Ended { action: "Main.keys.key".into() });
}

#[test]
fn a_reaction_does_not_wait_for_itself() {
    for workers in [1, 2] {
        let mut program = Program::new("Main").keepalive().workers(workers);
        for name in ["a", "b"] {
            program.reactor(name, (), |reactor| {
                let action = reactor.physical_action("act", Duration::ZERO);
                reactor.bound(action, 1, WhenFull::Wait);
                let sender = reactor.sender(action);
                reactor.reaction().on(Startup).run(move |(), ctx| {
                    sender.schedule(Duration::ZERO, 7_u8).unwrap();
                    let error = sender.schedule(Duration::ZERO, 8).unwrap_err();
                    assert!(matches!(error, ScheduleError::Full { events: 1, .. }));
                    ctx.request_stop();
                });
            });
        }
        program.run().unwrap();
    }
}

#[test]
fn the_environment_bounds_the_events_of_programs_that_state_no_bound() {
    const LIMIT: &str = "HPRM_EVENT_LIMIT";
    let test = "the_environment_bounds_the_events_of_programs_that_state_no_bound";
    let mut program = Program::new("Main");
    let action = program.main().physical_action::<u8>("act", Duration::ZERO);
    let sender = program.sender(action);
    match env::var(LIMIT).as_deref() {
        Ok("2") => {
            assert!([1, 2].iter().all(|value| sender.schedule(Duration::ZERO, *value).is_ok()));
            let error = sender.schedule(Duration::ZERO, 3).unwrap_err();
            assert_eq!(error, ScheduleError::Full { action: "Main.act".into(), events: 2 });
        }
        Ok(_) => {
            let message = program.run().unwrap_err().to_string();
            assert!(message.contains("HPRM_EVENT_LIMIT=many is wrong"), "{message}");
        }
        Err(_) => {
            for limit in ["2", "many"] {
                let mut again = Command::new(env::current_exe().unwrap());
                again.args(["--exact", test]).env(LIMIT, limit);
                assert!(again.output().unwrap().status.success(), "{limit}");
            }
        }
    }
}
