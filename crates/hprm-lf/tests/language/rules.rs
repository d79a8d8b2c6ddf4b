//! The rules of the language, one program each: what breaks it is found, and by its code.
//!
//! What people read is in the other tests; here it is only that no rule is forgotten, that none is
//! a warning where it should be an error, and that a program beside it, which obeys, has nothing to
//! be said about it.

use crate::common::compile_files;
use hprm_model::{Diagnostic, Severity};

const ERRORS: &[(&str, &str)] = &[
    // Types, bodies, values.
    ("LF0202", "main reactor { state x: int = 0 }"),
    ("LF0202", "main reactor { method f(x: int) {= pass =} }"),
    ("LF0202", "reactor A<T> { } main reactor { a = new A<int>() }"),
    ("LF0006", "main reactor { state x(0) }"),
    ("LF0210", "main reactor { reaction(startup) }"),
    (
        "LF0210",
        "reactor A { input i output o } main reactor { a = new A()\nreaction(startup)\na.o -> a.i }",
    ),
    ("LF0209", "main reactor { action a }"),
    ("LF0408", "main reactor { logical action a(0, 0, \"never\") }"),
    ("LF0203", "main reactor(p) { }"),
    ("LF0203", "main reactor(p = q, q = 0) { }"),
    ("LF0203", "main reactor(q = 0, p = [q]) { }"),
    ("LF0203", "main reactor { method f(x = 1, y) {= pass =} }"),
    ("LF0203", "main reactor(p = 0) { method f(x = p) {= pass =} }"),
    ("LF0306", "main reactor { state x = p }"),
    ("LF0306", "reactor A { } main reactor { a = new A(p = 1) }"),
    // Widths.
    ("LF0404", "reactor A { input[{= 2 =}] i } main reactor { }"),
    ("LF0404", "reactor A { } main reactor { a = new[{= 2 =}] A() }"),
    ("LF0409", "reactor A { input i input[widthof(i)] j } main reactor { }"),
    ("LF0405", "reactor A { input[0] i } main reactor { }"),
    ("LF0405", "reactor A { input[-1] i } main reactor { }"),
    ("LF0405", "reactor A { input[] i } main reactor { }"),
    // Main reactors and names.
    ("LF0205", "main reactor { } federated reactor { }"),
    ("LF0206", "reactor A { }"),
    ("LF0213", "main reactor Other { }"),
    ("LF0207", "main reactor { input i }"),
    ("LF0207", "main reactor { output o }"),
    ("LF0204", "reactor { } main reactor { }"),
    ("LF0201", "main reactor { state x = 0 state x = 1 }"),
    ("LF0201", "main reactor { initial mode A { timer t } mode B { timer t } }"),
    ("LF0201", "reactor A { } reactor A { } main reactor { }"),
    ("LF0208", "main reactor { timer lambda }"),
    ("LF0208", "main reactor { state __x = 0 }"),
    ("LF0307", "reactor B { b = new Main() } main reactor Main { }"),
    ("LF0308", "reactor A { b = new B() } reactor B { a = new A() } main reactor { }"),
    ("LF0216", "reactor A extends B { } reactor B extends A { } main reactor { }"),
    ("LF0217", "reactor A { input x } reactor B extends A { output x } main reactor { }"),
    // Connections.
    (
        "LF0502",
        "reactor A { input i output o } main reactor { a = new A() b = new A()\na.o -> b.i\nreaction(startup) -> b.i {= pass =} }",
    ),
    (
        "LF0502",
        "reactor A { input i output o } main reactor { a = new A() b = new A()\na.o -> b.i; b.o -> b.i after 0 }",
    ),
    (
        "LF0503",
        "reactor A { input i output o reaction(i) -> o {= pass =} } main reactor { a = new A()\na.o -> a.i }",
    ),
    (
        "LF0404",
        "reactor A { input i output o } main reactor { a = new A()\na.o -> a.i after {= 1 =} }",
    ),
    (
        "LF0403",
        "reactor A { input i output o } main reactor { a = new A()\na.o -> a.i after \"1 s\" }",
    ),
    (
        "LF0310",
        "reactor A { input[2] i output[2] o } main reactor { a = new A()\ninterleaved(a.o) -> a.i after 0 }",
    ),
    (
        "LF0310",
        "reactor A { output[2] o } main reactor { a = new[2] A() reaction(interleaved(a.o)) {= pass =} }",
    ),
    // Triggers, sources, effects.
    ("LF0305", "reactor A { input i } main reactor { a = new A() reaction(a.i) {= pass =} }"),
    ("LF0305", "reactor A { output o reaction(o) {= pass =} } main reactor { }"),
    (
        "LF0305",
        "reactor A { input i } main reactor { a = new A() reaction(startup) a.i {= pass =} }",
    ),
    ("LF0305", "reactor A { input i reaction(startup) -> i {= pass =} } main reactor { }"),
    (
        "LF0305",
        "reactor A { output o } main reactor { a = new A() reaction(startup) -> a.o {= pass =} }",
    ),
    ("LF0309", "reactor A { input i reaction(i) i {= pass =} } main reactor { }"),
    ("LF0311", "main reactor { timer t reaction(t as x) {= pass =} }"),
    // Times.
    ("LF0403", "reactor A { timer t(5) } main reactor { }"),
    ("LF0401", "main reactor { timer t(5 parsec) }"),
    ("LF0403", "reactor A(p = 5) { timer t(p) } main reactor { a = new A() }"),
    ("LF0407", "reactor A { logical action a(-1 s) } main reactor { }"),
    // Modes.
    ("LF0901", "main reactor { mode A { } }"),
    ("LF0901", "main reactor { initial mode A { } initial mode B { } }"),
    ("LF0905", "federated reactor { initial mode A { } }"),
    ("LF0906", "main reactor { reset state x }"),
    (
        "LF0907",
        "main reactor { timer t initial mode A { reaction(t) -> reset(B) {= pass =} } mode B { state x = 0 } }",
    ),
    // Attributes and hosts.
    ("LF0211", "@unknown main reactor { }"),
    ("LF0211", "@timeout(1 s) main reactor { }"),
    ("LF0212", "reactor A { } main reactor { @maxwait(0) a = new A() }"),
    (
        "LF0212",
        "reactor A { input i output o } main reactor { a = new A() @absent_after(0) a.o -> a.i after 0 }",
    ),
    (
        "LF0212",
        "reactor A { input i output o } main reactor { a = new A() @compress a.o -> a.i after 0 }",
    ),
    (
        "LF0212",
        "reactor A { input i output o } federated reactor { a = new A() b = new A() @compress(1) a.o -> b.i }",
    ),
    ("LF0212", "reactor A { } federated reactor { @compress a = new A() }"),
    ("LF0212", "reactor A { } main reactor { @transient a = new A() }"),
    ("LF0212", "reactor A { } federated reactor { @restart(\"always\") a = new A() }"),
    ("LF0212", "reactor A { } main reactor { @restart(\"no\") a = new A() }"),
    ("LF0212", "reactor A { @side(\"up\") input i } main reactor { }"),
    ("LF0212", "main reactor { @label(\"x\") preamble {= pass =} }"),
    ("LF0802", "main reactor at localhost { }"),
    ("LF0802", "reactor A { } main reactor { a = new A() at localhost; }"),
    (
        "LF0507",
        "reactor A { input i output o } main reactor { a = new A() @bound(2, \"block\") a.o ~> a.i }",
    ),
    // Target properties.
    ("LF0603", "target Python { docker: 1 } main reactor { }"),
    ("LF0603", "target Python { docker: { runner-bas: \"x\" } } main reactor { }"),
    ("LF0603", "target Python { docker: { env-file: true } } main reactor { }"),
    ("LF0603", "target Python { docker: { no-build: \"x\" } } main reactor { }"),
    ("LF0603", "target Python { clock-sync: maybe } main reactor { }"),
    ("LF0603", "target Python { cmake-include: { a: 1 } } main reactor { }"),
    ("LF0603", "target Python { store-limit: \"2 parsec\" } main reactor { }"),
    ("LF0603", "target Python { store-limit: -1 } main reactor { }"),
    ("LF0603", "target Python { cpus: [] } main reactor { }"),
    ("LF0603", "target Python { store-full: panic } main reactor { }"),
    ("LF0604", "target Python { fast: true, FAST: false } main reactor { }"),
    ("LF0605", "target Python { fast: true, coordination: decentralized } federated reactor { }"),
    (
        "LF0605",
        "target Python { fast: true } reactor A { } federated reactor { @transient a = new A() }",
    ),
    (
        "LF0605",
        "target Python { fast: true } reactor A { input i output o reaction(i) -> o {==} } \
         federated reactor { a = new A() b = new A() a.o ~> b.i }",
    ),
    ("LF0605", "target Python { fast: true } main reactor { physical action a }"),
    ("LF0605", "target Python { single-threaded: true } federated reactor { }"),
    ("LF0605", "target Python { single-threaded: true, tracing: true } main reactor { }"),
    ("LF0605", "target Python { workers: 2, single-threaded: true } main reactor { }"),
    ("LF0601", "target Rust main reactor { }"),
    ("LF0609", "target Python { timout: 300 ms } main reactor { }"),
    ("LF0609", "target Python { Keepalvie: true } main reactor { }"),
    ("LF0301", "main reactor { a = new Missing() }"),
];

const WARNINGS: &[(&str, &str)] = &[
    (
        "LF0501",
        "reactor A { input[2] i output[3] o } main reactor { a = new A()\na.o -> a.i after 0 }",
    ),
    (
        "LF0501",
        "reactor A { input[3] i output[2] o } main reactor { a = new A()\na.o -> a.i after 0 }",
    ),
    (
        "LF0501",
        "reactor A { input[3] i output[2] o } main reactor { a = new A()\n(a.o)+ -> a.i after 0 }",
    ),
    ("LF0104", "import Unused from \"Other.lf\" main reactor { }"),
    ("LF0214", "main reactor { reaction() {= pass =} }"),
    ("LF0218", "main reactor(timeout = 0) { }"),
    ("LF0219", "private preamble {= pass =} main reactor { }"),
    ("LF0219", "main reactor { public preamble {= pass =} }"),
    ("LF0220", "@property(name = \"p\") main reactor { }"),
    (
        "LF0220",
        "reactor A { input i output o } federated reactor { a = new A() @maxwait(0) a.o -> a.i after 0 }",
    ),
    ("LF0505", "reactor A { input i reaction(i) {= pass =} } main reactor { a = new A() }"),
    ("LF0506", "reactor A { output o reaction(startup) {= pass =} } main reactor { a = new A() }"),
    ("LF0602", "target Python { unknown: 1 } main reactor { }"),
    ("LF0602", "target Python { cmake: \"a.cmake\" } main reactor { }"),
    ("LF0606", "target Python { sst: {} } main reactor { }"),
    ("LF0606", "target Python { logging: debug } main reactor { }"),
    ("LF0606", "target Python { scheduler: STATIC } main reactor { }"),
    ("LF0607", "target Python { build-type: Debug } main reactor { }"),
    ("LF0607", "target Python { cmake-include: [\"a\", b/c.cmake] } main reactor { }"),
    ("LF0803", "reactor A { } federated reactor { a = new A() at 10.0.0.256; }"),
    (
        "LF0908",
        "main reactor { timer t initial mode A { reaction(t) -> B {= B.set() =} } mode B { } }",
    ),
    (
        "LF0911",
        "main reactor { timer t initial mode A { reaction(t) -> reset(B) {= pass =} } mode B { } }",
    ),
];

fn diagnostics(text: &str) -> Vec<Diagnostic> {
    let target = if text.starts_with("target") { "" } else { "target Python\n" };
    let main = format!("{target}{text}");
    let files = [("Main.lf", main.as_str()), ("Other.lf", "target Python reactor Unused { }")];
    compile_files(&files).map_or_else(|failure| failure.diagnostics, |compiled| compiled.warnings)
}

fn codes(text: &str, severity: Severity) -> Vec<&'static str> {
    let mut codes: Vec<_> =
        diagnostics(text).iter().filter(|d| d.severity == severity).map(|d| d.code).collect();
    codes.dedup();
    codes
}

#[test]
fn what_is_forbidden_is_an_error() {
    let found = |(code, text): &&(&str, &str)| codes(text, Severity::Error) != [*code];
    let wrong: Vec<_> = ERRORS.iter().filter(found).map(|r| (r, diagnostics(r.1))).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn what_is_doubtful_is_a_warning() {
    for (code, text) in WARNINGS {
        assert_eq!(codes(text, Severity::Error), [""; 0], "{text}");
        assert_eq!(codes(text, Severity::Warning), [*code], "{text}");
    }
}

#[test]
fn what_is_allowed_is_passed_over() {
    for text in ALLOWED {
        let found = diagnostics(text);
        assert!(found.is_empty(), "{text}: {found:?}");
    }
}

/// A name that a reactor cannot have is no advice.
#[test]
fn a_file_whose_name_no_reactor_can_have_needs_no_named_main_reactor() {
    for (path, advice) in
        [("Arm.lf", "remove the name, or change it to `Arm`"), ("1-a b.lf", "remove the name")]
    {
        let mut loader = |_: &str| Ok("target Python\nmain reactor Other { }".to_owned());
        let failure = hprm_lf::compile(path, &mut loader).unwrap_err();
        let [error] = &failure.diagnostics[..] else { panic!("{failure}") };
        assert_eq!((error.code, error.hint.as_deref()), ("LF0213", Some(advice)));
    }
}

/// One run tells of several errors, in the text's order.
#[test]
fn errors_are_collected() {
    let text =
        "reactor A { input i: int  input[0] j  timer t(5)  reaction(startup) -> i {= pass =} }
reactor B extends Missing { }
main reactor Other { a = new A(p = 1)  reaction(nothing) {= pass =} }";
    assert_eq!(codes(text, Severity::Error), ["LF0305", "LF0301", "LF0213", "LF0303"]);
    let text = "reactor A { input i: int  reaction(startup) }
main reactor Other { a = new A(p = 1)  action b }";
    assert_eq!(codes(text, Severity::Error), ["LF0202", "LF0210", "LF0213", "LF0306", "LF0209"]);
    let text = "reactor A { input[0] j  timer t(5) }
reactor B(n = 0, d = 1) { input[n] i  timer t(d) }
main reactor { b = new B() }";
    let found = codes(text, Severity::Error);
    assert_eq!(found, ["LF0405", "LF0403", "LF0405", "LF0403"]);
}

const ALLOWED: &[&str] = &[
    // Inputs that are optional, that a reaction of the container sets, or that lead nowhere.
    "reactor A { input i input j timer t reaction(t) i {= pass =} reaction(i, j) {= pass =} }
     reactor B { input i a = new A() i -> a.i }
     main reactor { b = new B() a = new A() reaction(startup) -> b.i, a.j {= pass =} }",
    // Outputs that only a contained reactor drives, one of several reactions sets, or all arguments
    // together hold; and those that no reaction reads.
    "reactor A { output o output p output q timer t
       reaction(t) -> o, p {= o.set(1) =} reaction(t) -> p {= p.set(1) =}
       reaction(t) -> q {= publish(locals()) =} }
     reactor B { output o a = new A() a.o -> o }
     main reactor { b = new B() }",
    // Named reactions, mutations, other names, handlers in their order.
    "reactor A { input x output o
       reaction first(x as y) -> o as z {= z.set(1) =} tardy {= pass =} deadline(1 s) {= pass =}
       mutation(x) {= pass =} tardy deadline(0) {= pass =};
       reaction(x) {= pass =} STP(1 s) {= pass =}
       reaction(x) {= pass =} STAA(0) {= pass =} }
     main reactor { a = new A() t = new A();
       reaction(startup) -> t.x {= pass =}
       reaction(startup) t.o -> a.x as q {= pass =}
       reaction(a.o as p) {= pass =} }",
    // Methods.
    "main reactor { const method f(x, y = 2, z = {= [] =}) {= return x =}; method g() {= pass =} }",
    // Interleaved, on both sides and among others; serializers; iteration.
    "reactor A { input[2] i output[2] o } reactor B { input[4] i output[4] o }
     main reactor { a = new[2] A() b = new B() c = new[2] A() d = new B()
       interleaved(a.o) -> b.i
       b.o -> interleaved(c.i)
       (c.o)+ -> d.i after 1 ms serializer \"pickle\";
       d.o ~> interleaved(a.i) }",
    // Attributes.
    "@label(\"the program\") @icon(\"a.svg\") federated reactor {
       @maxwait(10 ms) @label(\"first\") a = new A() at 10.0.0.1:1;
       @maxwait(forever) b = new A() at user@host.example
       @absent_after(0) @label(\"x\") a.o -> b.i }
     @layout(option=\"spacing\", value=\"3\") reactor A {
       @side(\"north\") input i @SIDE(\"South\") output o @label(\"r\") reaction(startup, i) -> o {= o.set(1) =} }",
    // A reactor called like the main one, which nothing refers to by its name.
    "reactor Main { } main reactor { m = new Main() }",
    // Properties that change nothing, in any case.
    "target Python { Docker: false, auth: false, clock-sync: off, comm-type: TCP, DNET: false,
       no-compile: False, single-threaded: false, workers: 2, tracing: false, logging: Info,
       scheduler: NP }
     main reactor { }",
    // Properties for containers, which only `hprm compose` reads.
    "target Python { docker: { Runner-Base: \"a/b:1\", rti-image: \"c\", no-build: true, builder-base: \"d\" } }
     main reactor { }",
    // The same name for a state variable, a port and an instance.
    "reactor A { output x state x = 0 } main reactor { x = new A() }",
    // An effect and a connection to one port, in different modes.
    "reactor A { input i output o } main reactor { a = new A() b = new A() timer t(0, 1 s)
       initial mode One { a.o -> b.i  reaction(t) -> reset(Two) {= Two.set() =} }
       mode Two { reaction(t) -> b.i, history(One) {= One.set() =} } }",
];
