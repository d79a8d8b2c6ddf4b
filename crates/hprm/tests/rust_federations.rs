//! Federations of programs in Rust, in real processes: this executable is the test, the launcher and the federates.
//!
//! Each test starts this executable again, with the name of a scenario, and looks at what that prints and how it ends.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::disallowed_methods,
    reason = "scenarios are programs of users"
)]

mod scenarios;

use std::process::{Child, Command, ExitCode, Output, Stdio};
use std::time::{Duration, Instant};

use libtest_mimic::{Arguments, Failed, Trial};
use rustix::process::{Pid, Signal, kill_process, test_kill_process};

/// How long a scenario may take, on a machine that does much else.
const PATIENCE: Duration = Duration::from_secs(60);

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    if let [option, name, rest @ ..] = words.as_slice()
        && option == "--scenario"
    {
        return scenarios::run(name, rest);
    }
    libtest_mimic::run(&Arguments::from_args(), tests()).exit_code()
}

type Test = (&'static str, fn());

fn tests() -> Vec<Trial> {
    const TESTS: &[Test] = &[
        ("federates_are_processes_of_this_executable", federates_are_processes_of_this_executable),
        (
            "a_federation_in_one_process_prints_the_same",
            a_federation_in_one_process_prints_the_same,
        ),
        ("values_of_all_kinds_travel", values_of_all_kinds_travel),
        ("the_logical_trace_is_that_of_one_process", the_logical_trace_is_that_of_one_process),
        ("a_federate_that_busy_polls_does_not_sleep", a_federate_that_busy_polls_does_not_sleep),
        ("a_bank_of_federates", a_bank_of_federates),
        ("a_program_states_how_large_its_stores_are", a_program_states_how_large_its_stores_are),
        ("connections_have_delays_and_clocks", connections_have_delays_and_clocks),
        ("an_error_of_a_reaction_ends_the_federation", an_error_of_a_reaction_ends_the_federation),
        ("a_panic_of_a_reaction_ends_the_federation", a_panic_of_a_reaction_ends_the_federation),
        (
            "the_death_of_any_federate_ends_the_federation",
            the_death_of_any_federate_ends_the_federation,
        ),
        ("signals_stop_a_federation_in_order", signals_stop_a_federation_in_order),
        ("federates_end_with_their_launcher", federates_end_with_their_launcher),
        (
            "a_federate_whose_launcher_has_ended_launches_nothing",
            a_federate_whose_launcher_has_ended_launches_nothing,
        ),
        ("what_differs_in_each_process_is_named", what_differs_in_each_process_is_named),
        ("federates_have_names_of_their_own", federates_have_names_of_their_own),
        ("a_federate_has_a_name_of_one_line", a_federate_has_a_name_of_one_line),
        ("a_main_may_run_several_federations", a_main_may_run_several_federations),
        (
            "federations_of_one_name_in_threads_are_told_apart",
            federations_of_one_name_in_threads_are_told_apart,
        ),
        ("a_federation_has_one_name_in_all_processes", a_federation_has_one_name_in_all_processes),
        ("an_executable_may_be_deleted_while_it_runs", an_executable_may_be_deleted_while_it_runs),
        (
            "a_program_that_a_federate_starts_is_no_federate",
            a_program_that_a_federate_starts_is_no_federate,
        ),
        ("threads_schedule_physical_actions", threads_schedule_physical_actions),
        ("a_federate_alone_says_what_it_needs", a_federate_alone_says_what_it_needs),
        ("code_after_run_is_the_launchers", code_after_run_is_the_launchers),
    ];
    let trial = |(name, test): &Test| {
        let test = *test;
        Trial::test(*name, move || {
            test();
            Ok::<_, Failed>(())
        })
    };
    TESTS.iter().map(trial).collect()
}

fn scenario(words: &[&str]) -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.arg("--scenario").args(words);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn run(words: &[&str]) -> Output {
    ended(scenario(words).spawn().unwrap())
}

fn ended(mut child: Child) -> Output {
    let until = Instant::now() + PATIENCE;
    while child.try_wait().unwrap().is_none() {
        if Instant::now() > until {
            child.kill().unwrap();
            let output = child.wait_with_output().unwrap();
            panic!("it does not end: {output:?}");
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    child.wait_with_output().unwrap()
}

/// What an output says on the standard error, and its code. A busy machine lags; that is no mistake.
fn errors(output: &Output) -> (String, Option<i32>) {
    let mut shown = String::new();
    let all = text(&output.stderr);
    let mut lines = all.lines();
    while let Some(line) = lines.next() {
        if line.contains("warning: ") && line.contains(" lag") {
            // Its hint.
            lines.next();
        } else {
            shown.push_str(line);
            shown.push('\n');
        }
    }
    (shown, output.status.code())
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn sorted(bytes: &[u8]) -> Vec<String> {
    let mut lines: Vec<_> = text(bytes).lines().map(str::to_owned).collect();
    lines.sort();
    lines
}

const COORDINATIONS: [&str; 2] = ["centralized", "decentralized"];

fn federates_are_processes_of_this_executable() {
    for coordination in COORDINATIONS {
        let output = run(&["counting", coordination]);
        assert_eq!(text(&output.stderr), "");
        assert_eq!(output.status.code(), Some(0));
        assert_eq!(text(&output.stdout), "[adder] 0ns: 1\n[adder] 1ms: 3\n[adder] 2ms: 6\n");
    }
}

fn a_federation_in_one_process_prints_the_same() {
    let output = run(&["counting", "one process"]);
    assert_eq!(errors(&output), (String::new(), Some(0)));
    assert_eq!(text(&output.stdout), "0ns: 1\n1ms: 3\n2ms: 6\n");
}

fn values_of_all_kinds_travel() {
    for coordination in COORDINATIONS {
        let output = run(&["values", coordination]);
        assert_eq!(errors(&output), (String::new(), Some(0)));
        assert_eq!(text(&output.stdout), "[controller] 30 values arrived as they were sent\n");
    }
}

fn the_logical_trace_is_that_of_one_process() {
    let folder = tempfile::tempdir().unwrap();
    let traces = ["one process", "centralized", "decentralized"].map(|how| {
        let file = folder.path().join(how);
        let output = run(&["values", how, file.to_str().unwrap()]);
        assert_eq!(errors(&output), (String::new(), Some(0)));
        std::fs::read_to_string(file).unwrap()
    });
    assert!(traces[0].lines().count() > 30, "{}", traces[0]);
    assert_eq!(traces[0], traces[1]);
    assert_eq!(traces[1], traces[2]);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
}

/// Without polling, one federate of a pair sleeps in each round. The other need not: where both share a processor, the
/// kernel may run the receiver at once, so that the answer is there before the sender waits for it.
fn a_federate_that_busy_polls_does_not_sleep() {
    let outputs = ["1", "0"].map(|seconds| run(&["spinning", seconds]));
    for output in &outputs {
        assert_eq!(output.status.code(), Some(0), "{output:?}");
    }
    assert_eq!(sorted(&outputs[0].stdout), ["[hub] polls", "[node] polls"]);
    assert!(text(&outputs[1].stdout).contains("sleeps"), "{:?}", outputs[1]);
}

fn a_bank_of_federates() {
    let output = run(&["bank"]);
    assert_eq!(errors(&output), (String::new(), Some(0)));
    assert_eq!(text(&output.stdout), "[sum] 0 + 1 + 2\n");
}

fn a_program_states_how_large_its_stores_are() {
    let why = "a value of 8000000 bytes is larger than the federate's object store, which takes at most 4000000; send \
               it in parts or raise the limit of the object store (--store-limit; `Federation::store_limit` in Rust)";
    let output = run(&["large", "travels"]);
    let warning = format!("[source] warning: {why}; the value travels inside its message\n");
    assert_eq!((text(&output.stderr), output.status.code()), (warning, Some(0)));
    assert_eq!(text(&output.stdout), "[sink] [8, 1000000]\n");
    let output = run(&["large"]);
    let error = format!("Error: federate source: the object store: {why}\n");
    assert_eq!((text(&output.stderr), output.status.code()), (error, Some(1)));
}

fn connections_have_delays_and_clocks() {
    for coordination in COORDINATIONS {
        let output = run(&["delays", coordination]);
        assert_eq!(errors(&output), (String::new(), Some(0)));
        assert_eq!(
            sorted(&output.stdout),
            ["[sink] after 5ms", "[sink] by the clock", "[sink] direct"]
        );
    }
}

fn an_error_of_a_reaction_ends_the_federation() {
    for coordination in COORDINATIONS {
        let output = run(&["error", coordination]);
        let expected = "Error: federate parser: reaction Failing.parser.1 failed at (0 ns, 0): invalid digit found in \
                        string\n";
        assert_eq!((text(&output.stderr).as_str(), output.status.code()), (expected, Some(1)));
    }
}

fn a_panic_of_a_reaction_ends_the_federation() {
    let output = run(&["panic"]);
    let shown = text(&output.stderr);
    assert!(
        shown.contains("[parser] thread 'main'") && shown.contains("it panics here"),
        "{shown}"
    );
    assert!(shown.contains("Error: federate parser"), "{shown}");
    assert_eq!(output.status.code(), Some(1));
}

fn the_death_of_any_federate_ends_the_federation() {
    for coordination in COORDINATIONS {
        for victim in ["camera", "detector", "controller"] {
            let output = run(&["death", coordination, victim]);
            let shown = text(&output.stderr);
            let expected = format!("Error: federate {victim} was killed by signal 9");
            assert!(shown.starts_with(&expected), "{shown}");
            assert_eq!(
                (shown.lines().filter(|line| line.contains("rror")).count(), output.status.code()),
                (1, Some(1))
            );
        }
    }
}

fn signals_stop_a_federation_in_order() {
    for (signal, number) in [(Signal::INT, 2), (Signal::TERM, 15)] {
        let mut child = scenario(&["endless"]).spawn().unwrap();
        wait_for_line(&mut child, "[b] is there");
        kill_process(Pid::from_child(&child), signal).unwrap();
        let output = ended(child);
        assert_eq!(text(&output.stderr), format!("Error: stopped by signal {number}\n"));
        assert_eq!(sorted(&output.stdout), ["[a] shutdown", "[b] shutdown"]);
    }
}

/// Reads lines until that one has come.
fn wait_for_line(child: &mut Child, line: &str) {
    use std::io::Read;
    let mut read = String::new();
    let stdout = child.stdout.as_mut().unwrap();
    while !read.lines().any(|other| other == line) || !read.ends_with('\n') {
        let mut byte = [0];
        assert_eq!(stdout.read(&mut byte).unwrap(), 1, "it has ended after {read:?}");
        read.push(char::from(byte[0]));
    }
}

fn federates_end_with_their_launcher() {
    let mut child = scenario(&["endless"]).spawn().unwrap();
    wait_for_line(&mut child, "[b] is there");
    let children = children_of(Pid::from_child(&child));
    assert_eq!(children.len(), 2);
    child.kill().unwrap();
    child.wait().unwrap();
    let until = Instant::now() + PATIENCE;
    while children.iter().any(|pid| test_kill_process(*pid).is_ok() && !is_zombie(*pid)) {
        assert!(Instant::now() < until, "a federate outlives its launcher");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn a_federate_whose_launcher_has_ended_launches_nothing() {
    let mut child = scenario(&["orphan"]).spawn().unwrap();
    let output = ended_with_all(&mut child);
    assert!(output.contains("the launcher of this federate has ended"), "{output}");
    assert!(!output.contains("[adder]"), "{output}");
}

/// What a process and all that it has started write on the standard error, and the output.
fn ended_with_all(child: &mut Child) -> String {
    use std::io::Read;
    let mut text = String::new();
    child.stdout.take().unwrap().read_to_string(&mut text).unwrap();
    child.stderr.take().unwrap().read_to_string(&mut text).unwrap();
    child.wait().unwrap();
    text
}

fn children_of(parent: Pid) -> Vec<Pid> {
    let number = parent.as_raw_nonzero();
    let text = std::fs::read_to_string(format!("/proc/{number}/task/{number}/children")).unwrap();
    text.split_whitespace().filter_map(|pid| Pid::from_raw(pid.parse().ok()?)).collect()
}

fn is_zombie(pid: Pid) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", pid.as_raw_nonzero()));
    stat.is_ok_and(|stat| stat.contains(") Z "))
}

fn what_differs_in_each_process_is_named() {
    let output = run(&["random"]);
    let shown = text(&output.stderr);
    assert!(
        shown.contains("assembles another program than it has declared to its launcher"),
        "{shown}"
    );
    assert!(shown.contains("timer Random.ticker.tick has another offset or period"), "{shown}");
    assert_eq!(output.status.code(), Some(1));
}

fn federates_have_names_of_their_own() {
    let output = run(&["same_name"]);
    let shown = text(&output.stderr);
    let expected = "Error: LF0201: the name `camera` is already taken in Same, at ";
    assert!(shown.starts_with(expected) && shown.contains("hint: "), "{shown}");
    assert_eq!(output.status.code(), Some(1));
}

fn a_program_that_a_federate_starts_is_no_federate() {
    let output = run(&["nested"]);
    assert_eq!(errors(&output), (String::new(), Some(0)));
    assert_eq!(
        text(&output.stdout),
        "[outer] [adder] 0ns: 1\n[outer] [adder] 1ms: 3\n[outer] [adder] 2ms: 6\n"
    );
}

fn threads_schedule_physical_actions() {
    let output = run(&["thread"]);
    assert_eq!(errors(&output), (String::new(), Some(0)));
    assert_eq!(text(&output.stdout), "[reader] the line is 42\n");
}

fn a_federate_alone_says_what_it_needs() {
    let output = run(&["alone"]);
    let shown = text(&output.stderr);
    assert!(
        shown.starts_with(
            "Error: Camera is a federate of a program that is described elsewhere\n  hint: "
        ),
        "{shown}"
    );
    assert_eq!(output.status.code(), Some(1));
}

fn code_after_run_is_the_launchers() {
    let output = run(&["after"]);
    assert_eq!(text(&output.stdout), "after the run\n");
}

fn a_federate_has_a_name_of_one_line() {
    for (name, shown) in [("", "\"\""), ("a\nb", "\"a\\nb\"")] {
        let output = run(&["names", name]);
        let expected = format!(
            "Error: {shown} is no name of a federate\n  hint: a name is one line of text, and not empty\n"
        );
        assert_eq!((text(&output.stderr), output.status.code()), (expected, Some(1)));
    }
    assert_eq!(errors(&run(&["names", "front left"])), (String::new(), Some(0)));
}

fn a_main_may_run_several_federations() {
    let output = run(&["several"]);
    assert_eq!(errors(&output), (String::new(), Some(0)));
    assert_eq!(text(&output.stdout), "[speaker] first\n[speaker] second\n[speaker] third\n");
}

fn federations_of_one_name_in_threads_are_told_apart() {
    let output = run(&["threads", "named"]);
    assert_eq!(errors(&output), (String::new(), Some(0)));
    assert_eq!(text(&output.stdout), "[speaker] first\n[speaker] second\n");
    let output = run(&["threads"]);
    let shown = text(&output.stderr);
    assert!(
        shown.contains("Error: two threads assemble a federation with the name Same at "),
        "{shown}"
    );
    assert_eq!(output.status.code(), Some(1));
}

fn a_federation_has_one_name_in_all_processes() {
    let output = run(&["renamed"]);
    let expected = "Error: federate speaker exited with code 0 before it joined\n  hint: its own output may say why; \
                    `main` has to come to the `run` of this federation, by the same name, in each process\n";
    assert_eq!((text(&output.stderr).as_str(), output.status.code()), (expected, Some(1)));
}

fn an_executable_may_be_deleted_while_it_runs() {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("copy");
    std::fs::copy(std::env::current_exe().unwrap(), &copy).unwrap();
    // The shell has it open, and deletes it before it begins.
    let mut command = Command::new("sh");
    command
        .args(["-c", "exec 9<\"$0\"; rm \"$0\"; exec /proc/self/fd/9 --scenario several"])
        .arg(&copy);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let output = ended(command.spawn().unwrap());
    assert_eq!(errors(&output), (String::new(), Some(0)));
    assert!(text(&output.stdout).ends_with("[speaker] third\n"));
}
