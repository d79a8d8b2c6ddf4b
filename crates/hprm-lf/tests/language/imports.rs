//! Which file an import means: by path, and in packages.

use crate::common::errors_in;
use hprm_lf::{SourceLoader, compile};
use hprm_model::{CompileFailure, Compiled};
use insta::assert_snapshot;

/// Files in memory, where a folder is what stands before a slash.
#[derive(Default)]
struct Disk {
    files: Vec<(&'static str, String)>,
    packages: Vec<String>,
    working_folder: Option<String>,
}

impl SourceLoader for Disk {
    fn load(&mut self, path: &str) -> Result<String, String> {
        let file = self.files.iter().find(|(name, _)| *name == path);
        file.map(|(_, text)| text.clone()).ok_or_else(|| "no such file".to_owned())
    }

    fn list(&mut self, folder: &str) -> Vec<String> {
        let inside = self.files.iter().filter_map(|(name, _)| name.strip_prefix(folder));
        let mut entries: Vec<String> = inside
            .filter_map(|rest| rest.strip_prefix('/'))
            .map(|rest| rest.split_inclusive('/').next().unwrap_or_default().to_owned())
            .collect();
        entries.dedup();
        entries
    }

    fn packages(&mut self) -> Vec<String> {
        self.packages.clone()
    }

    fn working_folder(&mut self) -> Option<String> {
        self.working_folder.clone()
    }
}

impl Disk {
    fn new(files: &[&'static str]) -> Self {
        let library = |path: &&'static str| {
            (*path, format!("target Python\nreactor Count {{ state at = \"{path}\" }}"))
        };
        Self { files: files.iter().map(library).collect(), ..Self::default() }
    }

    /// Compiles a program at `path` that imports and instantiates `Count`.
    fn import(mut self, path: &'static str, from: &str) -> Result<Compiled, CompileFailure> {
        let text = format!("import Count from <{from}> main reactor {{ c = new Count() }}");
        self.files.push((path, format!("target Python\n{text}")));
        compile(path, &mut self)
    }
}

/// The file that the program's second class comes from.
fn origin(compiled: Result<Compiled, CompileFailure>) -> String {
    let compiled = compiled.unwrap_or_else(|failure| panic!("{failure}"));
    compiled.sources.path(compiled.classes[1].file).to_owned()
}

const FETCHED: &str = "build/lfc_include/count/src/lib/Count.lf";
const OWN: &str = "lf-packages/count/src/lib/Count.lf";
const SHARED: &str = "/share/count/src/lib/Count.lf";

#[test]
fn packages_are_looked_for_in_order() {
    let shared = |files: &[&'static str]| Disk {
        packages: vec!["/other".to_owned(), "/share".to_owned()],
        ..Disk::new(files)
    };
    let from = "count/Count.lf";
    assert_eq!(origin(shared(&[SHARED, OWN, FETCHED]).import("src/Main.lf", from)), FETCHED);
    assert_eq!(origin(shared(&[SHARED, OWN]).import("src/deep/er/Main.lf", from)), OWN);
    assert_eq!(origin(shared(&[SHARED]).import("src/Main.lf", from)), SHARED);
    assert_eq!(origin(shared(&[OWN]).import("Main.lf", from)), OWN, "without any src");
}

#[test]
fn the_project_is_found_from_inside_src() {
    let path = "/p/build/lfc_include/count/src/lib/Count.lf";
    let disk = || Disk { working_folder: Some("/p/src".to_owned()), ..Disk::new(&[path]) };
    assert_eq!(origin(disk().import("Main.lf", "count/Count.lf")), path);
    assert_eq!(origin(disk().import("sub/Main.lf", "count/Count.lf")), path);
}

#[test]
fn the_file_may_be_left_out() {
    let path = "src/Main.lf";
    assert_eq!(origin(Disk::new(&[FETCHED]).import(path, "count")), FETCHED);
    let below = "build/lfc_include/count/src/lib/sub/Count.lf";
    assert_eq!(origin(Disk::new(&[below]).import(path, "count/sub")), below);
    assert_eq!(origin(Disk::new(&[below]).import(path, "count")), below, "it is searched for");
    let numbered = "lf-packages/count-3-1st/src/lib/Count.lf";
    assert_eq!(origin(Disk::new(&[numbered]).import(path, "count-3-1st")), numbered);
}

#[test]
fn a_package_imports_from_its_neighbour() {
    let mut disk = Disk::new(&[OWN]);
    let middle = "target Python import Count as C from <count>
        reactor Middle { c = new C() }";
    disk.files.push(("lf-packages/middle/src/lib/Middle.lf", middle.to_owned()));
    let main = "target Python import Middle from <middle/Middle.lf>
        main reactor { m = new Middle() }";
    disk.files.push(("src/Main.lf", main.to_owned()));
    let compiled = compile("src/Main.lf", &mut disk).unwrap_or_else(|failure| panic!("{failure}"));
    let names: Vec<_> = compiled.classes.iter().map(|class| class.name.as_str()).collect();
    assert_eq!(names, ["Main", "Middle", "Count"]);
}

#[test]
fn a_missing_package_and_two_reactors_of_no_file() {
    let main = "target Python
import A from <nowhere/A.lf>
import B from <nowhere>
import C, D from <nowhere>
main reactor { }";
    assert_snapshot!(errors_in(&[("Main.lf", main)]), @r#"
    error[LF0105]: cannot find `<nowhere/A.lf>` among the packages
     --> Main.lf:2:15
      |
    2 | import A from <nowhere/A.lf>
      |               ^^^^^^^^^^^^^^
      |
      = help: looked for `nowhere/src/lib/A.lf` in build/lfc_include, lf-packages; the environment variable LF_PACKAGES names more folders

    error[LF0105]: cannot find `<nowhere>` among the packages
     --> Main.lf:3:15
      |
    3 | import B from <nowhere>
      |               ^^^^^^^^^
      |
      = help: looked for `nowhere/src/lib/B.lf` in build/lfc_include, lf-packages; the environment variable LF_PACKAGES names more folders

    error[LF0106]: an import from a package names one reactor, unless it names the file
     --> Main.lf:4:11
      |
    4 | import C, D from <nowhere>
      |           ^
      |
      = help: name the file, `<package/File.lf>`, or write two imports
    "#);
}

#[test]
fn two_files_may_call_one_reactor_differently() {
    let files = [
        (
            "Main.lf",
            "target Python
import Gain as Amplifier from \"Gain.lf\"
import Pair from \"Pair.lf\"
main reactor { a = new Amplifier()  p = new Pair() }",
        ),
        (
            "Pair.lf",
            "target Python
import Gain as Half from \"Gain.lf\"
reactor Pair { l = new Half()  r = new Half() }",
        ),
        ("Gain.lf", "target Python preamble {= once =} reactor Gain { }"),
    ];
    let compiled =
        crate::common::compile_files(&files).unwrap_or_else(|failure| panic!("{failure}"));
    let names: Vec<_> = compiled.classes.iter().map(|class| class.name.as_str()).collect();
    assert_eq!(names, ["Main", "Gain", "Pair"]);
    assert_eq!((compiled.program.reactors.len(), compiled.preambles.len()), (5, 1));
}

#[test]
fn files_may_import_one_another() {
    let files = [
        (
            "Main.lf",
            "target Python
import B from \"Other.lf\"
reactor A { }
main reactor { b = new B() }",
        ),
        (
            "Other.lf",
            "target Python
import A from \"Main.lf\"
reactor B { a = new A() }",
        ),
    ];
    let compiled =
        crate::common::compile_files(&files).unwrap_or_else(|failure| panic!("{failure}"));
    assert_eq!(compiled.program.reactors.len(), 3);
}

#[test]
fn a_file_that_is_not_understood_is_reported_where_it_is_wrong() {
    let main = "target Python\nimport A from \"a.lf\"\nmain reactor { a = new A() }";
    let files = [("Main.lf", main), ("a.lf", "target Python\nreactor A { input }")];
    assert_snapshot!(errors_in(&files), @r#"
    error[LF0003]: expected the name of a port, found `}`
     --> a.lf:2:19
      |
    2 | reactor A { input }
      |                   ^
    "#);
}

#[test]
fn only_a_missing_file_is_a_question_of_the_path() {
    let main = "target Python\nimport A from \"a.lf\"\nmain reactor { a = new A() }";
    let failed = |reason: &str| {
        let mut loader = |path: &str| match path {
            "Main.lf" => Ok(main.to_owned()),
            _ => Err(reason.to_owned()),
        };
        let mut failure = compile("Main.lf", &mut loader).unwrap_err();
        let first = failure.diagnostics.remove(0);
        (failure.diagnostics.len(), first.hint)
    };
    assert_eq!(failed("Is a directory"), (0, None));
    let hint = "the path is relative to the file that imports";
    assert_eq!(failed("No such file or directory"), (0, Some(hint.to_owned())));
}

#[test]
fn a_file_to_import_is_well_by_itself() {
    let text =
        "target Python reactor A(p = 3) { input i reaction(i) {= pass =} } reactor B extends A { }";
    let check = |text: &str| hprm_lf::check("a.lf", &mut |_: &str| Ok(text.to_owned()));
    let checked = check(text).unwrap();
    assert!(checked.program.reactors.len() == 1 && checked.instances.is_empty());
    let names: Vec<_> = checked.classes.iter().map(|class| class.name.as_str()).collect();
    assert_eq!(names, ["A", "B"]);
    assert!(compile("a.lf", &mut |_: &str| Ok(text.to_owned())).is_err());
    // What is wrong in it is found, and so is a file with nothing to import.
    for (text, code) in [
        ("target Python reactor A { reaction(nothing) {= =} }", "LF0303"),
        ("target Python", "LF0206"),
    ] {
        assert_eq!(check(text).unwrap_err().diagnostics[0].code, code);
    }
    // With a main reactor, those without an instance come last.
    let program = check(&format!("{text} main reactor {{ b = new B() }}")).unwrap();
    let names: Vec<_> = program.classes.iter().map(|class| class.name.as_str()).collect();
    assert_eq!(names, ["a", "B", "A"]);
}
