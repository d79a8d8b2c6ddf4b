//! What shells and `man` are given knows all commands.

use std::fs;
use std::process::{Command, Output};

fn hprm(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hprm")).args(words).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[test]
fn bash_completes_commands_and_options() {
    let script = text(&hprm(&["completions", "bash"]).stdout);
    let completed = |words: &str| {
        let last = words.split(' ').count() - 1;
        let ask = format!(
            "{script}\nCOMP_WORDS=({words}); COMP_CWORD={last}; _hprm hprm \"${{COMP_WORDS[-1]}}\"\n"
        );
        let output =
            Command::new("bash").args(["-c", &format!("{ask}echo \"${{COMPREPLY[@]}}\"")]).output();
        text(&output.unwrap().stdout).trim().to_owned()
    };
    assert_eq!(completed("hprm ver"), "verify");
    assert_eq!(completed("hprm run --in-pro"), "--in-process");
}

#[test]
fn each_command_has_a_manual_page() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("share/man1");
    let output = hprm(&["man", folder.to_str().unwrap()]);
    assert_eq!((output.status.code(), text(&output.stderr).as_str()), (Some(0), ""));
    for command in ["run", "check", "explain", "diff", "verify", "rti", "federate", "sim", "doctor"]
    {
        let page = fs::read_to_string(folder.join(format!("hprm-{command}.1"))).unwrap();
        assert!(page.contains(".SH NAME") && page.contains(".SH OPTIONS"), "{page}");
    }
    assert!(fs::read_to_string(folder.join("hprm.1")).unwrap().contains("hprm\\-run(1)"));
    let output = hprm(&["man", "/dev/null/man1"]);
    assert_eq!(
        text(&output.stderr),
        "error: cannot write manual pages in /dev/null/man1: Not a directory\n"
    );
}
