//! The command and real processes, with a shell script in the place of the interpreter.
//!
//! What needs reactions that run is tested in Python; here is what the command does on its own.

#![allow(clippy::disallowed_methods, clippy::disallowed_types)]

use std::io::{BufRead, BufReader, Read};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::PathBuf;
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

const FEDERATION: &str = "\
target Python
reactor Node {
  reaction(startup) {= pass =}
}
federated reactor {
  a = new Node()
  b = new Node()
}
";
const PROGRAM: &str = "\
target Python
main reactor {
  reaction(startup) {= pass =}
}
";

/// Held while a script is written and while a process is started: a process that is just being
/// started by another test holds the open script for a moment, and then it cannot be executed.
static TURN: Mutex<()> = Mutex::new(());

/// A folder with the command, an interpreter and a program.
struct ProgramFolder {
    folder: TempDir,
}

impl ProgramFolder {
    /// `script` is what the interpreter does; the name of the federate is `$NAME`.
    fn new(program: &str, script: &str) -> Self {
        let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = Self { folder: tempfile::tempdir().unwrap() };
        symlink(env!("CARGO_BIN_EXE_hprm"), folder.path("hprm")).unwrap();
        std::fs::write(folder.path("Main.lf"), program).unwrap();
        std::fs::write(folder.path("python3"), format!("#!/bin/sh\nNAME=${{11}}\n{script}\n"))
            .unwrap();
        std::fs::set_permissions(folder.path("python3"), PermissionsExt::from_mode(0o755)).unwrap();
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(self.path("hprm"));
        command.args(arguments).current_dir(self.folder.path()).env_remove("HPRM_FEDERATION_ID");
        command
    }

    fn run(&self, arguments: &[&str]) -> Output {
        start(&mut self.command(arguments)).wait_with_output().unwrap()
    }
}

fn start(command: &mut Command) -> Child {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The lines that are errors of the command itself.
fn errors(output: &Output) -> Vec<String> {
    let text = text(&output.stderr);
    text.lines().filter(|line| line.starts_with("error: ")).map(str::to_owned).collect()
}

/// Whether a process runs; one that has ended and not been reaped does not.
fn runs(pid: &str) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit_once(") ").is_some_and(|(_, state)| !state.starts_with(['Z', 'X']))
}

#[track_caller]
fn wait_until_gone(pid: &str) {
    let deadline = Instant::now() + Duration::from_secs(10);
    while runs(pid) {
        assert!(Instant::now() < deadline, "process {pid} is left");
        std::thread::yield_now();
    }
}

#[test]
fn one_process_takes_the_place_of_the_command() {
    let folder = ProgramFolder::new(PROGRAM, "echo \"$*\"; exit 7");
    let output = folder.run(&["run", "Main.lf", "--", "--rounds", "3"]);
    assert_eq!(text(&output.stdout), "-m hprm run -- Main.lf --rounds 3\n");
    assert_eq!(output.status.code(), Some(7));
}

#[test]
fn a_wrong_program_starts_no_interpreter() {
    let wrong = PROGRAM.replace("reaction(startup) {= pass =}", "a = new BAD()");
    let folder = ProgramFolder::new(&wrong, "echo started");
    let output = folder.run(&["run", "Main.lf"]);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(text(&output.stdout), "");
    let shown = text(&output.stderr);
    assert!(shown.contains("Main.lf:3:"), "{shown}");
    assert!(!shown.contains('\x1b'), "{shown}");
}

#[test]
fn check_goes_on_after_a_file_that_is_not_there() {
    let folder = ProgramFolder::new(PROGRAM, "");
    let output = folder.run(&["check", "Gone.lf", "Main.lf"]);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(errors(&output), ["error: cannot read Gone.lf: No such file or directory"]);
    assert_eq!(text(&output.stdout), "2 programs checked: 1 error, no warnings\n");
}

#[test]
fn lines_of_federates_come_whole_and_unchanged() {
    let script = r#"
        [ "$NAME" = a ] && printf 'caf\351\nunfinished' && printf 'on the side\n' >&2
        exit 3"#;
    let output = ProgramFolder::new(FEDERATION, script).run(&["run", "Main.lf"]);
    assert_eq!(output.stdout, b"[a] caf\xe9\n[a] unfinished\n");
    assert!(text(&output.stderr).contains("[a] on the side\n"));
    assert_eq!(output.status.code(), Some(3));
    let errors = errors(&output);
    assert_eq!(errors.len(), 1, "{errors:?}");
    assert!(errors[0].contains("exited with code 3 before it joined"), "{errors:?}");
}

#[test]
fn the_secret_is_not_on_the_command_line() {
    let script = "echo \"$*\"; echo \"id $HPRM_FEDERATION_ID\"; exit 1";
    let output =
        ProgramFolder::new(FEDERATION, script).run(&["run", "Main.lf", "one", "--", "--two"]);
    let shown = text(&output.stdout);
    let id = shown.lines().find_map(|line| line.strip_prefix("[a] id ")).expect("a has an id");
    assert_eq!(id.len(), 32);
    let arguments =
        shown.lines().find(|line| line.starts_with("[a] -m hprm federate --rti unix:@hprm-"));
    let arguments = arguments.expect("a was started");
    assert!(!arguments.contains(id), "{arguments}");
    assert!(
        arguments.contains(" --launched --die-with-parent ")
            && arguments.ends_with(" -- Main.lf a one --two"),
        "{arguments}"
    );
    assert!(shown.contains(&format!("[b] id {id}\n")), "both are members of one federation");
}

#[test]
fn a_signal_is_named_and_the_others_do_not_stay() {
    let script = r#"
        [ "$NAME" = b ] && kill -9 $$
        echo "pid $$"; exec sleep 60"#;
    let output = ProgramFolder::new(FEDERATION, script).run(&["run", "Main.lf"]);
    assert_eq!(errors(&output), ["error: federate b was killed by signal 9 (SIGKILL)"]);
    assert_eq!(output.status.code(), Some(1));
    for line in text(&output.stdout).lines() {
        wait_until_gone(line.strip_prefix("[a] pid ").expect("only a tells its number"));
    }
}

#[test]
fn federates_that_do_not_join_are_named_and_ended() {
    let script = "echo \"$$\"; exec sleep 60";
    let folder = ProgramFolder::new(FEDERATION, script);
    let output = folder.run(&["run", "--join-timeout", "0.5", "Main.lf"]);
    assert_eq!(errors(&output), ["error: federates a, b did not join within 0.5 s"]);
    assert_eq!(output.status.code(), Some(1));
    for line in text(&output.stdout).lines() {
        wait_until_gone(line.split_once(' ').expect("a name and a number").1);
    }
}

/// Starts a federation whose federates tell their numbers and then wait, and reads those.
fn waiting(script: &str) -> (ProgramFolder, Child, BufReader<ChildStdout>, Vec<String>) {
    let folder = ProgramFolder::new(FEDERATION, &format!("{script}\necho \"$$\"; sleep 60 & wait"));
    let mut child = start(&mut folder.command(&["run", "Main.lf"]));
    let mut output = BufReader::new(child.stdout.take().unwrap());
    let pids = [(); 2].map(|()| {
        let mut line = String::new();
        output.read_line(&mut line).unwrap();
        line.trim().rsplit_once(' ').expect("a name and a number").1.to_owned()
    });
    (folder, child, output, pids.to_vec())
}

fn interrupt(child: &Child) {
    kill_process(Pid::from_child(child), Signal::INT).unwrap();
}

#[test]
fn an_interrupt_ends_everything() {
    let (_folder, mut child, _output, pids) = waiting("");
    interrupt(&child);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    pids.iter().for_each(|pid| wait_until_gone(pid));
    let mut errors = String::new();
    child.stderr.take().unwrap().read_to_string(&mut errors).unwrap();
    assert_eq!(errors, "", "an end that was asked for needs no message");
}

#[test]
fn a_second_interrupt_ends_what_refuses() {
    let (_folder, mut child, _output, pids) = waiting("trap '' TERM");
    let begun = Instant::now();
    // The same signal may be seen once if it comes twice at once.
    while child.try_wait().unwrap().is_none() {
        interrupt(&child);
        assert!(begun.elapsed() < Duration::from_secs(10), "it is still there");
        std::thread::yield_now();
    }
    assert_eq!(child.wait().unwrap().code(), Some(130));
    pids.iter().for_each(|pid| wait_until_gone(pid));
}

#[test]
fn without_an_interpreter_there_is_a_hint() {
    let folder = ProgramFolder::new(PROGRAM, "");
    std::fs::remove_file(folder.path("python3")).unwrap();
    let mut command = folder.command(&["run", "Main.lf"]);
    command.env_remove("VIRTUAL_ENV").env("PATH", "/nowhere");
    let output = start(&mut command).wait_with_output().unwrap();
    assert_eq!(errors(&output), ["error: there is no python3 to run reactions with"]);
    assert!(text(&output.stderr).contains("  hint: "));
    assert_eq!(output.status.code(), Some(1));
}

#[test]
fn an_rti_needs_a_federation_and_a_secret_for_the_network() {
    let folder = ProgramFolder::new(PROGRAM, "");
    let output = folder.run(&["rti", "Main.lf", "--listen", "unix:@hprm-test"]);
    assert_eq!(errors(&output), ["error: Main.lf is not a federation"]);
    let folder = ProgramFolder::new(FEDERATION, "");
    let output = folder.run(&["rti", "Main.lf", "--listen", "tcp:0.0.0.0:0"]);
    assert!(errors(&output)[0].contains("this federation has no secret"));
    assert_eq!(output.status.code(), Some(1));
}

#[test]
fn a_federate_that_does_not_exist_is_answered_with_those_that_do() {
    let folder = ProgramFolder::new(FEDERATION, "");
    let id = "0123456789abcdef0123456789abcdef";
    let output = folder.run(&["federate", "Main.lf", "c", "--rti", "unix:@x", "--federation", id]);
    assert_eq!(errors(&output), ["error: Main.lf has no federate c"]);
    assert!(text(&output.stderr).contains("its federates: a, b"));
}

#[test]
fn check_says_that_the_bodies_were_not_checked() {
    let folder = ProgramFolder::new(PROGRAM, "echo 'No module named hprm' >&2; exit 1");
    let output = folder.run(&["check", "Main.lf"]);
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(text(&output.stdout), "1 program checked: no errors, 1 warning\n");
    let said = text(&output.stderr);
    assert!(said.starts_with("warning: the Python of reactions was not looked into: No module"));
    let output = folder.run(&["check", "--json", "Main.lf"]);
    let line: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&line["code"], &line["severity"]), (&"LF1002".into(), &"warning".into()));
    assert_eq!(output.stderr, b"");
    let output = folder.run(&["check", "--no-bodies", "Main.lf"]);
    assert_eq!((output.status.code(), text(&output.stderr).as_str()), (Some(0), ""));
}

#[test]
fn check_asks_one_interpreter_about_all_programs() {
    let answer = r#"{"program":"B.lf","code":"LF1001","severity":"error","message":"no","hint":null,
        "file":"B.lf","line":3,"column":3,"end_line":3,"end_column":3}"#;
    let answer = answer.replace('\n', "");
    let folder = ProgramFolder::new(PROGRAM, &format!("echo \"$@\" >> asked; echo '{answer}'"));
    std::fs::copy(folder.path("Main.lf"), folder.path("B.lf")).unwrap();
    std::fs::write(folder.path("Wrong.lf"), "target Python").unwrap();
    let output = folder.run(&["check", "Main.lf", "B.lf", "Wrong.lf"]);
    assert_eq!(output.status.code(), Some(1));
    let asked = std::fs::read_to_string(folder.path("asked")).unwrap();
    assert_eq!(asked, "-m hprm syntax -- Main.lf B.lf\n");
    let said = text(&output.stderr);
    assert!(said.starts_with("error[LF1001]: no\n --> B.lf:3:3\n"), "{said}");
    assert!(said.contains("no main reactor"), "{said}");
}

#[test]
fn what_a_failed_federate_has_started_may_tidy_up() {
    // What is left of a refuses until it has seen that a is gone. It starts no process for that, which may take long.
    let script = r#"
        if [ "$NAME" = a ]; then
            (trap 'while read -r stat 2>/dev/null < /proc/$$/stat && [ "${stat#*) Z }" = "$stat" ]; do :; done
                   : > tidy; exit' TERM
             : > ready; sleep 60 & wait) &
            while ! [ -e ready ]; do :; done
            exit 3
        fi
        exec sleep 60"#;
    let folder = ProgramFolder::new(FEDERATION, script);
    let output = folder.run(&["run", "Main.lf"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(folder.path("tidy").exists());
}

#[test]
fn what_a_failed_federate_has_started_does_not_stay() {
    let script = r#"
        [ "$NAME" = b ] && exec sleep 60
        (trap '' TERM; echo "pid $(exec sh -c 'echo $PPID')"; touch ready; while :; do sleep 1; done) &
        while ! [ -e ready ]; do :; done
        exit 3"#;
    let output = ProgramFolder::new(FEDERATION, script).run(&["run", "Main.lf"]);
    assert_eq!(output.status.code(), Some(3));
    let shown = text(&output.stdout);
    wait_until_gone(shown.trim().strip_prefix("[a] pid ").expect("it tells its number"));
}

#[test]
fn the_end_of_the_terminal_is_an_interrupt() {
    let (_folder, mut child, _output, pids) = waiting("");
    kill_process(Pid::from_child(&child), Signal::HUP).unwrap();
    let code = child.wait().unwrap().code();
    let mut errors = String::new();
    child.stderr.take().unwrap().read_to_string(&mut errors).unwrap();
    assert_eq!((code, errors.as_str()), (Some(129), ""));
    pids.iter().for_each(|pid| wait_until_gone(pid));
}

#[test]
fn output_that_cannot_be_written_is_an_error() {
    for (program, script, words) in
        [(PROGRAM, "", "check"), (FEDERATION, "echo hello; exec sleep 60", "run")]
    {
        let folder = ProgramFolder::new(program, script);
        let mut command = folder.command(&[words, "Main.lf"]);
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        command.stdin(Stdio::null()).stdout(full).stderr(Stdio::piped());
        let output = command.spawn().unwrap().wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(1));
        let expected = "error: cannot write to the standard output: No space left on device";
        assert_eq!(errors(&output), [expected]);
    }
}

#[test]
fn errors_are_json_too_where_that_is_wanted() {
    let folder = ProgramFolder::new(PROGRAM, "exec sleep 60");
    std::fs::write(folder.path("Wrong.lf"), "target Python").unwrap();
    for (words, expected) in [
        (&["verify", "--json", "--run-timeout", "0.000001", "Main.lf"][..], "did not end"),
        (&["verify", "--json", "Wrong.lf"], "Wrong.lf has errors"),
        (&["diff", "--json", "nowhere", "nowhere"], "cannot read the trace nowhere"),
    ] {
        let output = folder.run(words);
        assert_eq!(output.status.code(), Some(1));
        let answer: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let message = answer["error"]["message"].as_str().unwrap();
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn a_trace_that_breaks_off_is_compared_with_a_warning() {
    let folder = ProgramFolder::new(PROGRAM, "");
    let header = "{\"hprm_logical_trace\":2,\"program\":\"M\",\"federated\":false}\n";
    let entries = "{\"tag\":[0,0],\"reaction\":\"M.1\"}\n{\"tag\":[5,0],\"reaction\":\"M.1\"}\n";
    let end = "{\"end\":[5,0],\"outcome\":\"done\"}\n";
    std::fs::write(folder.path("whole"), format!("{header}{entries}{end}")).unwrap();
    std::fs::write(folder.path("cut"), format!("{header}{entries}{}", &end[..9])).unwrap();
    let output = folder.run(&["diff", "whole", "cut"]);
    assert_eq!(output.status.code(), Some(0));
    let warning = "warning: cut breaks off at (5 ns, 0): what came then is not compared\n";
    assert_eq!(text(&output.stderr), warning);
    let output = folder.run(&["diff", "--json", "cut", "whole"]);
    let answer: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(answer["cut"], serde_json::json!(["cut"]));
    assert_eq!(folder.run(&["diff", "whole", "whole"]).stderr, b"");
}
