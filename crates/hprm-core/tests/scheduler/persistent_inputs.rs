//! Persistent inputs: what a port remembers while it is absent.

use crate::common::{at, on, run};
use hprm_core::{Delay, Direction, Effect, ProgramBuilder, Properties, ReactionSpec, Trigger};

#[test]
fn a_port_remembers_once_it_was_told_to() {
    let mut b = ProgramBuilder::new("Main", Properties { timeout: Some(40), ..Default::default() });
    let main = b.main();
    let out = b.port(main, "out", Direction::Output);
    let quiet = b.port(main, "quiet", Direction::Input);
    let kept = b.port(main, "kept", Direction::Input);
    for input in [quiet, kept] {
        b.connect(out, input, Delay::None);
    }
    let startup = b.reaction(main, on(&[Trigger::Startup]));
    let sends = b.timer(main, "sends", 10, 20);
    let spec = ReactionSpec {
        triggers: vec![Trigger::Timer(sends)],
        effects: vec![Effect::Port(out)],
        ..ReactionSpec::default()
    };
    let sender = b.reaction(main, spec);
    let reads = b.timer(main, "reads", 0, 10);
    let spec = ReactionSpec {
        triggers: vec![Trigger::Timer(reads)],
        sources: vec![quiet, kept],
        ..ReactionSpec::default()
    };
    let reader = b.reaction(main, spec);

    let mut seen = Vec::new();
    let log = run(b.build().unwrap(), |scheduler, reaction| {
        if reaction == startup {
            assert_eq!(scheduler.keep(kept, -1), None);
        } else if reaction == sender {
            scheduler.set(out, scheduler.tag().time);
        } else if reaction == reader {
            let read = |port| scheduler.latest(port).copied();
            seen.push((read(quiet), read(kept), scheduler.port(kept).is_some()));
        }
    });
    assert_eq!(log[0], at(0, 0, "Main.1"), "the first value arrives before a reaction reads");
    assert_eq!(
        seen,
        [
            (None, Some(-1), false),
            (Some(10), Some(10), true),
            (None, Some(10), false),
            (Some(30), Some(30), true),
            (None, Some(30), false),
        ]
    );
}
