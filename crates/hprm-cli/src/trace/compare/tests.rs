//! Comparing traces that are written out here.

use std::io::Cursor;

use super::super::{sentence, share};
use super::*;

const DONE: &str = r#"{"end":[20,0],"outcome":"done"}"#;

fn text(lines: &[&str]) -> String {
    lines.iter().map(|line| format!("{line}\n")).collect()
}

/// A trace with these lines after its header.
fn trace(name: &str, lines: &str) -> Reader<Cursor<String>> {
    let header = r#"{"hprm_logical_trace":2,"program":"M","federated":false}"#;
    Reader::new(name, Cursor::new(format!("{header}\n{lines}"))).unwrap()
}

fn compared(judge: Judge, a: &[&str], b: &[&str]) -> Comparison {
    judge.compare(&mut trace("A", &text(a)), &mut trace("B", &text(b))).unwrap()
}

/// The sentence for the first difference, which is the same whichever trace comes first.
fn parting(a: &[&str], b: &[&str]) -> Option<String> {
    let found = compared(Judge::default(), a, b);
    let other = compared(Judge::default(), b, a);
    assert_eq!(found.divergence.is_some(), other.divergence.is_some());
    found.divergence.map(|divergence| sentence(&divergence, ["A", "B"]))
}

fn entry(rest: &str) -> String {
    format!(r#"{{"tag":[10,0],"reaction":"M.a.1"{rest}}}"#)
}

fn value(number: u8) -> String {
    format!(r#"{{"digest":"{number:032x}","text":"{number}"}}"#)
}

#[test]
fn equal_traces_are_equal() {
    let lines = [&entry(&format!(r#","sets":[{{"port":"M.a.out","value":{}}}]"#, value(1))), DONE];
    let found = compared(Judge::default(), &lines, &lines);
    assert_eq!(found, Comparison { equal: 1, ..Comparison::default() });
    assert_eq!(share(&found), "1 reaction compared");
}

#[test]
fn each_kind_of_difference_has_its_sentence() {
    let set =
        |port: &str, number| format!(r#","sets":[{{"port":"{port}","value":{}}}]"#, value(number));
    let call =
        |at: &str, rest: &str| format!(r#","schedules":[{{"action":"M.a.act","at":{at}{rest}}}]"#);
    let with = |number| format!(r#","value":{}"#, value(number));
    let read = |number, rest: &str| {
        format!(r#","reads":[{{"from":"M.a.in","value":{}{rest}}}]"#, value(number))
    };
    let enter = |how: &str| format!(r#","enters":[{{"mode":"M.a.m","how":"{how}"}}]"#);
    let here = "at (10 ns, 0), reaction M.a.1";
    for (a, b, expected) in [
        (set("M.a.x", 1), set("M.a.x", 2), "sets M.a.x to 1 in A, and sets M.a.x to 2 in B"),
        (set("M.a.x", 1), String::new(), "sets M.a.x to 1 in A, and does not set M.a.x in B"),
        (read(1, ""), read(2, ""), "reads M.a.in as 1 in A, and reads M.a.in as 2 in B"),
        (read(1, ""), String::new(), "reads M.a.in as 1 in A, and finds M.a.in absent in B"),
        (
            read(1, ""),
            read(1, r#","remembered":true"#),
            "reads M.a.in as 1 in A, and remembers M.a.in as 1 in B",
        ),
        (
            r#","reads":[{"from":"M.a.act"}]"#.to_owned(),
            String::new(),
            "reads M.a.act without a value in A, and finds M.a.act absent in B",
        ),
        (
            call("[12,0]", ""),
            call("[13,0]", ""),
            "schedules M.a.act for (12 ns, 0) in A, and schedules M.a.act for (13 ns, 0) in B",
        ),
        (
            call("[12,0]", &with(1)),
            call("[12,0]", &with(2)),
            "schedules M.a.act with 1 in A, and schedules M.a.act with 2 in B",
        ),
        (
            call("\"dropped\"", ""),
            String::new(),
            "schedules M.a.act in vain, too close to the event before in A, and schedules only 0 \
             actions in B",
        ),
        (
            enter("reset"),
            enter("history"),
            "asks for mode M.a.m with a reset in A, and asks for mode M.a.m with its history in B",
        ),
        (r#","stops":true"#.to_owned(), String::new(), "asks for the end in A, but not in B"),
        (
            r#","body":"deadline""#.to_owned(),
            String::new(),
            "misses its deadline in A, but not in B",
        ),
        (
            r#","tardy":[9,0]"#.to_owned(),
            String::new(),
            "has an input that came too late for (9 ns, 0) in A, and its inputs in time in B",
        ),
    ] {
        let said = parting(&[&entry(&a), DONE], &[&entry(&b), DONE]);
        assert_eq!(said, Some(format!("{here} {expected}")));
    }
}

#[test]
fn values_with_one_text_are_told_apart() {
    let set = |digest: u8| {
        entry(&format!(
            r#","sets":[{{"port":"p","value":{{"digest":"{digest:032x}","text":"list of 2"}}}}]"#
        ))
    };
    let said = parting(&[&set(1), DONE], &[&set(2), DONE]).unwrap();
    assert!(
        said.ends_with("sets p to list of 2 in A, and sets p to another list of 2 in B"),
        "{said}"
    );
}

#[test]
fn a_reaction_that_ran_in_one_run_only_is_named() {
    let other = r#"{"tag":[9,0],"reaction":"M.b.1"}"#;
    let said = parting(&[&entry(""), DONE], &[other, &entry(""), DONE]);
    assert_eq!(said.unwrap(), "at (9 ns, 0), reaction M.b.1 runs in B, but not in A");
}

#[test]
fn what_ran_before_is_named_rather_than_what_it_led_to() {
    let (other, changed) = (r#"{"tag":[10,0],"reaction":"M.0"}"#, entry(r#","stops":true"#));
    let said = parting(&[&entry(""), DONE], &[other, &changed, DONE]);
    assert_eq!(said.unwrap(), "at (10 ns, 0), reaction M.0 runs in B, but not in A");
    let said = parting(&[&entry(""), DONE], &[&changed, other, DONE]);
    assert!(said.unwrap().contains("M.a.1 asks for the end"));
}

#[test]
fn a_missed_deadline_is_named_rather_than_what_it_led_to() {
    let late = r#","body":"deadline","physical":true"#;
    let follows = r#"{"tag":[10,0],"reaction":"M.b.1"}"#;
    let met = "at (10 ns, 0), reaction M.a.1 misses its deadline in B, but not in A";
    // The handler has read the clock.
    let said = parting(&[&entry(""), follows, DONE], &[&entry(late), DONE]);
    assert_eq!(said.as_deref(), Some(met));
    // So has the body.
    let clock = entry(r#","physical":true"#);
    let found = compared(Judge::default(), &[&clock, follows, DONE], &[entry(late).as_str(), DONE]);
    assert_eq!(sentence(&found.divergence.unwrap(), ["A", "B"]), met);
    assert_eq!(found.consequence.unwrap().reaction, "M.b.1");
    // Nothing that is compared depends on it.
    assert_eq!(parting(&[&clock, DONE], &[&entry(late), DONE]), None);
    // What was missed in both is no difference.
    let both = parting(&[&entry(late), follows, DONE], &[&entry(late), DONE]).unwrap();
    assert!(both.contains("M.b.1 runs in A"), "{both}");
}

#[test]
fn the_order_within_a_tag_is_no_difference() {
    let other = r#"{"tag":[10,0],"reaction":"M.b.1"}"#;
    assert_eq!(parting(&[&entry(""), other, DONE], &[other, &entry(""), DONE]), None);
}

#[test]
fn the_physical_world_is_left_out_unless_asked_for() {
    let sensed = r#"{"tag":[5,0],"reaction":"M.s.1","physical":true}"#;
    let both = entry(r#","physical":true"#);
    let (a, b) = ([sensed, &both, DONE], [entry(""), DONE.to_owned()]);
    let b = [b[0].as_str(), &b[1]];
    let found = compared(Judge::default(), &a, &b);
    assert_eq!((found.left_out, &found.divergence), (2, &None));
    assert!(share(&found).contains("2 left out"), "{}", share(&found));
    let found = compared(Judge { physical: true }, &a, &b);
    assert_eq!(found.divergence.unwrap().reaction, "M.s.1");
}

#[test]
fn the_tag_of_a_physical_action_depends_on_the_clock() {
    let call = |at: &str| {
        entry(&format!(r#","schedules":[{{"action":"M.a.p","at":{at},"physical":true}}]"#))
    };
    assert_eq!(parting(&[&call("[11,0]"), DONE], &[&call("[12,0]"), DONE]), None);
}

#[test]
fn runs_that_were_stopped_are_compared_up_to_the_earlier_end() {
    let later = r#"{"tag":[15,0],"reaction":"M.a.1"}"#;
    let stopped = r#"{"end":[12,0],"outcome":"interrupted"}"#;
    // Whether this is after the end depends on the end.
    let call = |at: &str| entry(&format!(r#","schedules":[{{"action":"M.a.x","at":{at}}}]"#));
    let (a, b) = ([&call("[15,0]"), later, DONE], [&call("\"after-stop\""), stopped]);
    let found = compared(Judge::default(), &a, &b);
    assert_eq!((found.limit, found.divergence), (Some((12, 0)), None));
    let earlier = call("[11,0]");
    assert!(parting(&[&earlier, later, DONE], &b).is_some());
}

#[test]
fn runs_are_compared_up_to_the_tag_at_which_the_clock_has_a_federate_leave() {
    let at = |time: u64, reaction: &str, rest: &str| {
        format!(r#"{{"tag":[{time},0],"reaction":"M.{reaction}"{rest}}}"#)
    };
    let leaves = r#","leaves":true,"physical":true"#;
    let (first, left) = (at(1, "a.1", ""), at(2, "a.2", leaves));
    let (later, received) = (at(3, "a.1", ""), at(3, "b.1", ""));
    let short = [&first, &left, DONE];
    let long = [&first, &later, &received, &at(4, "a.2", leaves), DONE];
    assert_eq!(parting(&short, &long), None);
    let found = compared(Judge::default(), &short, &long);
    assert_eq!((found.equal, found.limit), (1, Some((2, 1))));
    // Both leave: what the others do is compared.
    assert!(parting(&[&first, &left, DONE], &[&first, &left, &received, DONE]).is_some());
    // What comes before the leave is compared, and what is at its tag.
    assert!(parting(&[&left, DONE], &long).is_some());
    assert!(parting(&short, &[&first, &at(2, "b.1", ""), &later, DONE]).is_some());
    // The program decides on a leave without a mark.
    let logical = at(2, "a.2", r#","leaves":true"#);
    assert!(parting(&[&first, &logical, DONE], &long).is_some());
    assert!(compared(Judge { physical: true }, &short, &long).divergence.is_some());
}

#[test]
fn an_end_at_another_tag_is_a_difference_if_the_run_was_not_stopped() {
    let earlier = r#"{"end":[12,0],"outcome":"done"}"#;
    let said = parting(&[&entry(""), DONE], &[&entry(""), earlier]).unwrap();
    assert_eq!(said, "the program ends at (20 ns, 0) in A, and at (12 ns, 0) in B");
    let chance = r#"{"end":[12,0],"outcome":"done","physical":true}"#;
    assert_eq!(parting(&[&entry(""), DONE], &[&entry(""), chance]), None);
}

#[test]
fn federates_that_stop_agree_on_a_tag_by_chance() {
    let earlier = r#"{"end":[12,0],"outcome":"done"}"#;
    let differ = |with: &str| {
        let [a, b] = [DONE, earlier].map(|end| text(&[&entry(with), end]));
        let mut federated = trace("B", &b);
        federated.header.federated = true;
        let found = Judge::default().compare(&mut trace("A", &a), &mut federated).unwrap();
        found.divergence.is_some()
    };
    assert!(differ(""));
    assert!(!differ(r#","stops":true"#));
}

#[test]
fn the_last_tag_of_a_run_that_failed_is_not_compared() {
    let failed = r#"{"end":[10,0],"outcome":"failed","message":"no"}"#;
    let other = r#"{"tag":[10,0],"reaction":"M.b.1"}"#;
    assert_eq!(parting(&[&entry(""), other, DONE], &[&entry(""), failed]), None);
}

#[test]
fn the_digest_is_of_what_is_compared() {
    let digest_of = |lines: &[&str], limit| {
        digest(Judge::default(), &mut trace("A", &text(lines)), limit).unwrap()
    };
    let sensed = r#"{"tag":[5,0],"reaction":"M.s.1","physical":true}"#;
    let later = r#"{"tag":[15,0],"reaction":"M.a.1"}"#;
    let plain = digest_of(&[&entry(""), DONE], None);
    let reads = entry(&format!(r#","reads":[{{"from":"M.a.in","value":{}}}]"#, value(1)));
    assert_ne!(digest_of(&[&reads, DONE], None), plain);
    assert_eq!(digest_of(&[sensed, &entry(""), DONE], None), plain);
    assert_eq!(digest_of(&[&entry(""), later, DONE], Some((15, 0))), plain);
    assert_ne!(digest_of(&[&entry(""), later, DONE], None), plain);
}

#[test]
fn traces_of_different_programs_are_not_compared() {
    let mut other = trace("B", "");
    other.header.program = "N".to_owned();
    let error = Judge::default().compare(&mut trace("A", ""), &mut other).unwrap_err();
    assert!(format!("{error:?}").contains("A is a trace of M, and B one of N"));
}

#[test]
fn a_reaction_is_called_as_one_of_the_programs_names_it() {
    let named = |name: &str, lines: &[&str], names: &str| {
        let header =
            format!(r#"{{"hprm_logical_trace":2,"program":"M","federated":false{names}}}"#);
        Reader::new(name, Cursor::new(format!("{header}\n{}", text(lines)))).unwrap()
    };
    let names = r#","names":{"M.a.1":"M.a.detect"}"#;
    let ran = [&entry(""), DONE];
    for given in [["", names], [names, ""], [names, names]] {
        let [mut a, mut b] = [named("A", &ran, given[0]), named("B", &[DONE], given[1])];
        let found = Judge::default().compare(&mut a, &mut b).unwrap();
        let divergence = found.divergence.unwrap();
        assert_eq!(divergence.reaction, "M.a.1");
        assert_eq!(
            sentence(&divergence, ["A", "B"]),
            "at (10 ns, 0), reaction M.a.detect runs in A, but not in B"
        );
    }
    // Names are no difference, and not in the digest.
    let [mut a, mut b] = [named("A", &ran, names), named("B", &ran, "")];
    assert_eq!(Judge::default().compare(&mut a, &mut b).unwrap().divergence, None);
    let digests = [names, ""]
        .map(|names| digest(Judge::default(), &mut named("A", &ran, names), None).unwrap());
    assert_eq!(digests[0], digests[1]);
}
