//! What federates compare: any edit that changes what a program does is found and named; comments,
//! spaces, names of files and what a machine may have of its own are not.

use std::collections::BTreeMap;

use hprm_core::Fingerprint;
use hprm_lf::compile_with;
use hprm_model::Compiled;
use proptest::prelude::*;

type Files = BTreeMap<String, String>;

fn compiled_of(path: &str, files: &Files, properties: &[&str]) -> Compiled {
    let properties: Vec<_> = properties.iter().map(|text| (*text).to_owned()).collect();
    let mut loader = |path: &str| files.get(path).cloned().ok_or_else(|| format!("no file {path}"));
    compile_with(path, &properties, &mut loader).unwrap_or_else(|failure| panic!("{failure}"))
}

fn fingerprint(text: &str) -> Fingerprint {
    of_files(text, &[])
}

fn of_files(text: &str, beside: &[(&str, &str)]) -> Fingerprint {
    let own = |(path, text): (&str, &str)| (path.to_owned(), text.to_owned());
    let files = beside.iter().copied().chain([("Main.lf", text)]).map(own).collect();
    compiled_of("Main.lf", &files, &[]).fingerprint()
}

fn differences(one: &Fingerprint, other: &Fingerprint) -> Vec<String> {
    one.differences("the RTI", &other.report(), "federate b")
}

/// A program. The numbers $0 to $6 are drawn.
const PROGRAM: &str = r#"
target Python {
  coordination: decentralized, timeout: $0 s, keepalive: true, scheduler: NP, DNET: true
}
preamble {= one = $1 =}
reactor Inner(gain = $2) {
  input in0
  input in1
  output out0
  logical action later($3 ms)
  physical action other($4 ms, 5 ms, "defer")
  state total = $5
  method double(x) {= return x * 2 =}
  reaction(in0) -> out0, later {=
    value = in0.value
    if value > 5:
        value = 0
    out0.set(value)
  =} deadline($6 ms) {= pass =}
  reaction(later) {= print("later") =}
}
reactor A {
  input inp
  output out
  timer t(0, $1 ms)
  timer u(0)
  inner = new[2] Inner()
  modal = new Modal()
  reaction(t) -> out {= out.set(b"p") =}
  reaction(u) {= pass =}
}
reactor Modal {
  initial mode First {
    timer v(0, $2 ms)
    reaction(v) -> reset(Second) {= Second.set() =}
  }
  mode Second { reset state n = 0 }
}
reactor B {
  input inp
  output out
  reaction(inp) -> out {= out.set(1) =}
}
federated reactor {
  a = new A()
  b = new B()
  a.out -> b.inp
  b.out -> a.inp after $3 ms
}
"#;

/// What is edited in the program, and how the difference is told. `$7` is a number that is not there.
const EDITS: [(&str, &str, &str); 44] = [
    ("decentralized", "centralized", "property coordination is centralized at federate b and"),
    ("timeout: $0 s", "timeout: $7 s", "property timeout is"),
    ("timeout: $0 s,", "", "property timeout is not set at federate b and"),
    ("keepalive: true", "keepalive: false", "property keepalive is false at federate b and true"),
    ("NP", "GEDF_NP", "property scheduler is GEDF_NP at federate b and NP at the RTI"),
    ("DNET: true", "DNET: false", "property DNET is"),
    ("one = $1", "one = $7", "preamble 1 of the program (Main.lf:5) differs"),
    ("gain = $2", "gain = $7", "parameter gain of reactor Inner is"),
    ("later($3 ms)", "later($7 ms)", "action a.inner[0].later is logical ("),
    ("later($3 ms)", "later($3 ms, 5 ms)", "action a.inner[0].later is"),
    ("physical action other", "logical action other", "action a.inner[0].other is logical ("),
    ("other($4 ms", "other($7 ms", "action a.inner[0].other is"),
    ("\"defer\"", "\"drop\"", "action a.inner[0].other is"),
    ("total = $5", "total = $7", "state total of reactor Inner is"),
    ("total = $5", "total", "state total of reactor Inner is not set at federate b and"),
    ("double(x)", "double(x, y)", "method double of reactor Inner (Main.lf:13) differs"),
    ("return x * 2", "return x * 3", "method double of reactor Inner (Main.lf:13) differs"),
    ("value > 5", "value > 6", "the body of reaction 1 of reactor Inner (Main.lf:14) differs"),
    ("        value = 0", "    value = 0", "the body of reaction 1 of reactor Inner"),
    ("deadline($6 ms)", "deadline($7 ms)", "reaction 1 of a.inner[0] is"),
    ("{= pass =}\n  reaction(l", "{= 1 =}\n  reaction(l", "the deadline handler of reaction 1 of"),
    ("\"later\"", "\"Later\"", "the body of reaction 2 of reactor Inner (Main.lf:20) differs"),
    ("reaction(in0) ->", "reaction(in0) in1 ->", "reaction 1 of a.inner[0] is (in0) in1 ->"),
    ("reaction(in0) ->", "reaction(in0, in1) ->", "reaction 1 of a.inner[0] is (in0, in1) ->"),
    ("-> out0, later", "-> later, out0", "reaction 1 of a.inner[0] is"),
    ("input in1", "input in2", "port a.inner[0].in1 is in the program of the RTI, not in that of"),
    ("timer t(0, $1 ms)", "timer t(0, $7 ms)", "timer a.t is (0, "),
    ("timer t(0,", "timer t($7 ms,", "timer a.t is ("),
    ("new[2] Inner()", "new[3] Inner()", "reactor a.inner[2] is in the program of federate b"),
    ("new[2] Inner()", "new[2] Inner(gain = $7)", "parameter gain of a.inner[0] is in"),
    ("new[2] Inner()", "new[2] Modal()", "the class of a.inner[0] is Modal at federate b and"),
    ("b\"p\"", "{1: 2}", "the body of reaction 1 of reactor A (Main.lf:29) differs"),
    ("reaction(u) {= pass =}", "", "reaction 2 of a is in the program of the RTI, not in that of"),
    ("reaction(u)", "reaction(t)", "reaction 2 of a is (t) at federate b and (u) at the RTI"),
    ("timer v(0, $2 ms)", "timer v(0, $7 ms)", "timer a.modal.v is"),
    ("reset(Second)", "history(Second)", "reaction 1 of a.modal is (v) -> history(Second) in"),
    ("n = 0 }", "n = 0  reset state m = 0 }", "the state that is reset in a.modal is n, m at"),
    ("= new B()", "= new A()", "the class of b is A at federate b and B at the RTI"),
    ("inp) -> out {= out.set(1) =}", "inp) -> out {= out.set(1) =} tardy", "reaction 1 of b is"),
    ("  b = new", "  @maxwait($7 ms)\n  b = new", "maxwait of federate b is"),
    ("a.out -> b.inp", "a.out ~> b.inp", "the connection a.out -> b.inp is physical at"),
    ("a.out -> b.inp", "a.out -> b.inp after 0", "the connection a.out -> b.inp is after 0"),
    ("after $3 ms", "after $7 ms", "the connection b.out -> a.inp is after"),
    ("  b = new", "  c = new B()\n  b = new", "the list of federates is a, c, b at federate b and"),
];

/// Edits that leave the program to do the same.
const NO_EDITS: [(&str, &str); 3] = [
    ("reactor Modal {", "reactor Unused { timer t(0, 1 s) }\nreactor Modal {"),
    ("timer t(0, $1 ms)", "timer t(0, $1000 us)"),
    ("federated reactor", "federated reactor Main"),
];

fn drawn(text: &str, numbers: &[u32]) -> String {
    let texts = numbers.iter().enumerate();
    texts.fold(text.to_owned(), |text, (index, number)| {
        text.replace(&format!("${index}"), &number.to_string())
    })
}

/// The same program, with other comments and spaces.
fn respaced(text: &str) -> String {
    let mut inside = false;
    let lines = text.lines().map(|line| {
        let (opens, closes) = (line.contains("{="), line.contains("=}"));
        let was_inside = inside;
        inside = (inside || opens) && !closes;
        match (was_inside, opens) {
            (_, true) if closes => line.replace("{= ", "{=\n    ").replace(" =}", " # why\n=}"),
            (true, false) if !closes => format!("\n # so\n   {}  # why", line.replace(" = ", "=")),
            (false, false) => format!("\n\n /* so */ {}// why", line.replace(", ", " ,\n  ")),
            _ => line.to_owned(),
        }
    });
    lines.map(|line| line + "\n").collect()
}

/// Numbers for the program, all of which differ, and one more.
fn numbers() -> impl Strategy<Value = Vec<u32>> {
    (1_u32..90).prop_map(|first| (0..8).map(|index| first + index * 90).collect())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, failure_persistence: None, ..<_>::default() })]

    #[test]
    fn an_edit_that_changes_what_a_program_does_is_named(numbers in numbers()) {
        let original = fingerprint(&drawn(PROGRAM, &numbers));
        for (from, to, words) in EDITS {
            prop_assert!(PROGRAM.contains(from), "{}", from);
            let edited = fingerprint(&drawn(&PROGRAM.replacen(from, to, 1), &numbers));
            prop_assert_ne!(original.digest(), edited.digest(), "{}", to);
            let differences = differences(&original, &edited);
            let named = differences.iter().any(|difference| difference.starts_with(words));
            prop_assert!(named, "{} is not among {:#?}", words, differences);
        }
    }

    #[test]
    fn an_edit_that_does_not_is_none(numbers in numbers()) {
        let text = drawn(PROGRAM, &numbers);
        let original = fingerprint(&text);
        let same = NO_EDITS.map(|(from, to)| drawn(&PROGRAM.replacen(from, to, 1), &numbers));
        for edited in [respaced(&text)].iter().chain(&same) {
            let edited = fingerprint(edited);
            prop_assert_eq!(differences(&original, &edited), Vec::<String>::new());
            prop_assert_eq!(original.digest(), edited.digest());
        }
    }
}

#[test]
fn a_machine_may_have_another_file_and_properties_of_its_own() {
    let text = drawn(PROGRAM, &[1, 2, 3, 4, 5, 6, 7]).replace("decentralized", "centralized");
    let original = fingerprint(&text);
    let files = Files::from([("/robot/Other.lf".to_owned(), text)]);
    let own = [
        "workers=4",
        "spin=off",
        "logging=debug",
        "store-limit=\"1 GB\"",
        "store-full=error",
        "realtime=50",
        "cpus=[0, 1]",
        "comm-type=TLS",
        "clock-sync=on",
        "auth=true",
    ];
    let elsewhere = compiled_of("/robot/Other.lf", &files, &own).fingerprint();
    assert_eq!(differences(&original, &elsewhere), Vec::<String>::new());
    assert_eq!(original.digest(), elsewhere.digest());
}

const TRANSIENT: &str = "
target Python { timeout: 1 s }
reactor Up { output out  timer t(0, 10 ms)  reaction(t) -> out {= out.set(1) =} }
reactor Child { input inp  timer t(0, 10 ms)  reaction(inp, t) {= pass =} }
reactor Mid(gain = 1) {
  input inp
  output out
  child = new Child()
  inp -> child.inp
  reaction(inp) -> out {= out.set(inp.value) =}
}
reactor Down { input inp  reaction(inp) {= print(inp.value) =} }
federated reactor {
  up = new Up()
  down = new Down()
  @transient
  mid = new Mid()
  up.out -> mid.inp
  mid.out -> down.inp
}";

#[test]
fn a_transient_federate_may_be_another_one_inside() {
    let original = fingerprint(TRANSIENT);
    for (from, to) in [
        ("out.set(inp.value)", "out.set(2 * inp.value)"),
        ("timer t(0, 10 ms)  reaction(inp, t)", "timer t(0, 5 ms)  reaction(t, inp)"),
        ("gain = 1", "gain = 2"),
        ("new Mid()", "new Mid(gain = 7)"),
        ("  child = new Child()\n  inp -> child.inp", "  state n = 0  physical action a"),
        ("reactor Mid(", "reactor Other { reaction(startup) {= =} } reactor Mid("),
    ] {
        let edited = fingerprint(&TRANSIENT.replacen(from, to, 1));
        assert_eq!(differences(&original, &edited), Vec::<String>::new(), "{to}");
        assert_eq!(original.digest(), edited.digest(), "{to}");
    }
}

#[test]
fn a_transient_federate_has_the_ports_that_the_others_know() {
    let original = fingerprint(TRANSIENT);
    for (from, to, words) in [
        ("print(inp.value)", "print(1)", "the body of reaction 1 of reactor Down (Main.lf:12)"),
        (
            "output out\n",
            "output out\n  output more\n",
            "port mid.more is in the program of federate",
        ),
        ("@transient", "", "federate mid is not transient at federate b and transient at the RTI"),
        ("-> out {= out.set(inp.value) =}", "{= =}", "the connection mid.out -> down.inp is"),
        ("mid.out -> down.inp", "mid.out -> down.inp after 0", "the connection mid.out -> down"),
    ] {
        let found = differences(&original, &fingerprint(&TRANSIENT.replacen(from, to, 1)));
        assert!(found.iter().any(|difference| difference.starts_with(words)), "{found:?}");
    }
}

#[test]
fn modules_beside_the_program_are_compared_where_both_have_them() {
    let text = "
target Python { timeout: 1 s, files: [\"lib/used.py\"] }
preamble {= import helper =}
reactor A { preamble {= from parts.arm import Arm =}  reaction(startup) {= import used =} }
federated reactor { a = new A() }";
    let files = [
        ("helper.py", "import deeper\nx = 1"),
        ("deeper.py", "def f(): return 1"),
        ("parts/__init__.py", ""),
        ("parts/arm.py", "class Arm: pass"),
        ("lib/used.py", "y = 1"),
        ("other.py", "z = 1"),
    ];
    let original = of_files(text, &files);
    let edited = |path: &str, text_of: &str| {
        let mut files = files.to_vec();
        let file = files.iter_mut().find(|(name, _)| *name == path).unwrap();
        file.1 = text_of;
        differences(&original, &of_files(text, &files))
    };
    assert_eq!(edited("helper.py", "import deeper\nx = 2"), ["module helper differs"]);
    assert_eq!(edited("deeper.py", "def f(): return 2"), ["module deeper differs"]);
    assert_eq!(edited("parts/arm.py", "class Arm: x = 1"), ["module parts.arm differs"]);
    assert_eq!(edited("lib/used.py", "y = 2"), ["module used differs"]);
    assert!(edited("other.py", "z = 2").is_empty(), "nothing imports it");
    assert!(edited("helper.py", "import deeper\n# one\nx  =  1").is_empty());
    for missing in 0..files.len() {
        let there: Vec<_> =
            files.iter().enumerate().filter(|(at, _)| *at != missing).map(|(_, f)| *f).collect();
        assert!(differences(&original, &of_files(text, &there)).is_empty(), "{missing}");
    }
}
