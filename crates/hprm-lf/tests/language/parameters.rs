//! Parameters of the main reactor that are stated on the command line, as `main.NAME=VALUE`.

use hprm_lf::compile_with;
use hprm_model::{CompileFailure, Compiled, Value};

const PROGRAM: &str = "target Python
reactor Base(rate = 5) { }
reactor Sensor(rate = 1, period = 1 s) { timer t(0, period) }
main reactor(rate = 10, period = 50 ms, gain = 0.5, loud = false, name = \"front\",
             sizes = [1, 2], model = {= None =},
             offset = 0) {
  sensor = new[rate] Sensor(rate = rate, period = period)
  base = new Base()
}";

fn run_with(stated: &[&str]) -> Result<Compiled, CompileFailure> {
    let stated: Vec<_> = stated.iter().map(|text| (*text).to_owned()).collect();
    compile_with("Main.lf", &stated, &mut |_: &str| Ok(PROGRAM.to_owned()))
}

fn assigned(stated: &str) -> Value {
    let compiled = run_with(&[stated]).unwrap_or_else(|failure| panic!("{failure}"));
    let main = compiled.instances.values().next().unwrap();
    let [(_, value)] = main.assignments.as_slice() else { panic!("{:?}", main.assignments) };
    value.clone()
}

fn wrong(stated: &str) -> String {
    run_with(&[stated]).map_or_else(|failure| failure.to_string(), |_| panic!("it is right"))
}

#[test]
fn a_value_has_the_kind_of_the_default() {
    assert_eq!(assigned("main.rate=30"), Value::Int(30));
    assert_eq!(assigned("main.offset=-3"), Value::Int(-3));
    assert_eq!(assigned("main.period=2 sec"), Value::Time(2_000_000_000));
    assert_eq!(assigned("main.period=0"), Value::Int(0));
    assert_eq!(assigned("main.gain=1.25"), Value::Float(1.25));
    assert_eq!(assigned("main.gain=2"), Value::Int(2));
    for truth in ["true", "True"] {
        assert_eq!(assigned(&format!("main.loud={truth}")), Value::Bool(true));
    }
    assert_eq!(assigned("main.sizes=[3]"), Value::List(vec![Value::Int(3)]));
}

#[test]
fn text_needs_no_quotes() {
    for text in ["rear left", "\"rear left\"", "'rear left'"] {
        assert_eq!(assigned(&format!("main.name={text}")), Value::Str("rear left".to_owned()));
    }
    assert_eq!(assigned("main.name="), Value::Str(String::new()));
    assert_eq!(assigned("main.name=a=b"), Value::Str("a=b".to_owned()));
}

#[test]
fn a_default_of_python_takes_any_value() {
    assert_eq!(assigned("main.model=3"), Value::Int(3));
    assert_eq!(assigned("main.model=nets/yolo.onnx"), Value::Str("nets/yolo.onnx".to_owned()));
    assert_eq!(assigned("main.model=yolo"), Value::Str("yolo".to_owned()));
}

#[test]
fn what_depends_on_a_parameter_follows() {
    let compiled = run_with(&["main.rate=3", "main.rate=2", "main.period=20 ms"]).unwrap();
    assert_eq!(compiled.instances.len(), 1 + 2 + 1, "the bank has two members");
    let periods: Vec<_> = compiled.program.timers.values().map(|timer| timer.period).collect();
    assert_eq!(periods, [20_000_000; 2]);
    let defaults = run_with(&[]).unwrap();
    assert_eq!(defaults.instances.len(), 1 + 10 + 1);
    let names: Vec<_> = defaults.main_parameters().iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["rate", "period", "gain", "loud", "name", "sizes", "model", "offset"]);
}

#[test]
fn a_value_of_another_kind_is_an_error_that_says_what_is_expected() {
    for (stated, expected) in [
        ("main.rate=fast", "the parameter `rate` must be a whole number, such as `3`"),
        ("main.rate=1.5", "must be a whole number"),
        ("main.rate=", "must be a whole number"),
        ("main.rate=3 4", "must be a whole number"),
        ("main.period=30", "the parameter `period` must be a time, such as `10 ms`"),
        ("main.period=30 parsec", "must be a time"),
        ("main.gain=much", "must be a number, such as `0.5`"),
        ("main.loud=1", "must be `true` or `false`"),
        ("main.sizes=[rate]", "must be a list"),
    ] {
        let text = wrong(stated);
        assert!(text.contains(expected), "{stated}: {text}");
        assert!(text.contains("LF0403") && text.contains("::: Main.lf:"), "{stated}: {text}");
        assert_eq!(text.matches("error[").count(), 1, "{text}");
    }
}

#[test]
fn a_name_that_is_no_parameter_is_an_error() {
    let text = wrong("main.rat=3");
    assert!(text.contains("the main reactor has no parameter `rat`"), "{text}");
    assert!(text.contains("`rate`"), "{text}");
}
