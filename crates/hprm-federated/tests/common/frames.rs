//! The promise about any bytes on a link: frames, an error, or too few of them. Shared with the fuzz
//! target in `fuzz/`.

use std::sync::Arc;

use hprm_federated::codec::{self, Decoded, Decoder};
use hprm_federated::{
    Attempt, Federate, FederationId, Frame, HostId, Input, Rti, RtiInput, Topology,
};
use hprm_federated::{LinkId, PROTOCOL};

use hprm_core::{
    Connection, Delay, Direction, Effect, FederateId, PhysicalTime, Program, ProgramBuilder,
    Properties, ReactionSpec, Trigger,
};

/// Reads the frames that `bytes` begin with, and returns them. Each must be read again as it was
/// when it is written, and whatever is missing must be little enough to ask for.
pub(crate) fn frames(mut bytes: &[u8]) -> Vec<Frame> {
    let mut frames = Vec::new();
    let mut decoder = Decoder::default();
    loop {
        let plain = decoder.next_plain(bytes);
        let next = decoder.next(bytes);
        if let Some((frame, len)) = plain {
            assert_eq!(next, Ok(Decoded::Frame(frame, len)));
        }
        match next {
            Ok(Decoded::Frame(frame, len)) => {
                assert!(len > 0 && len <= bytes.len(), "a frame of {len} bytes");
                let mut again = Vec::new();
                codec::encode(&frame, &mut again).expect("there is memory");
                assert_eq!(codec::decode(&again), Ok(Some((frame.clone(), again.len()))));
                frames.push(frame);
                bytes = &bytes[len..];
            }
            Ok(Decoded::Chunk { taken, message_len }) => {
                assert!(
                    taken > 0 && taken <= bytes.len() && message_len > 0,
                    "{taken} bytes of {message_len}"
                );
                bytes = &bytes[taken..];
            }
            Ok(Decoded::Missing(more)) => {
                assert!(more > 0 && more <= hprm_core::limits::FRAME_LIMIT + 8);
                return frames;
            }
            Err(_) => return frames,
        }
    }
}

/// Hands the frames to an RTI and to a federate of its federation, from any sender. Both accept each
/// frame or return a fault.
pub(crate) fn tell(program: &Program, frames: Vec<Frame>) {
    let federation = FederationId(1);
    let agreed = Arc::new(program.fingerprint());
    let fingerprint = agreed.digest();
    let mut rti = Rti::new(Topology::new(program), federation, Arc::clone(&agreed), 1_000);
    let mut now = PhysicalTime(0);
    for (link, federate) in program.federates.ids().enumerate() {
        let link = LinkId(u32::try_from(link).unwrap_or(0));
        let listen = Some("here".to_owned());
        let (protocol, host) = (PROTOCOL, HostId(1));
        let attempt = Attempt { process: federate.0.into(), number: 0 };
        let hello = Frame::Hello {
            protocol,
            federation,
            fingerprint,
            federate,
            host,
            listen,
            attempt,
            launched: false,
        };
        for frame in [hello, Frame::Loaded, Frame::Ready { now }] {
            let _ = rti.handle(now, RtiInput::Frame { link, frame });
        }
    }
    let listen = Some("there".to_owned());
    let me = FederateId(1);
    let mut federate = Federate::new(me, program, federation, agreed, HostId(1), listen, 7);
    let _ = federate.handle(now, Input::Loaded);
    for (at, frame) in frames.into_iter().enumerate() {
        now = now.plus(1_000);
        let link = LinkId(u32::try_from(at % 3).unwrap_or(0));
        let _ = rti.handle(now, RtiInput::Frame { link, frame: frame.clone() });
        while rti.poll().is_some() {}
        let input = match at % 4 {
            3 => Input::FromPeer { from: FederateId(0), frame },
            _ => Input::FromRti(frame),
        };
        let _ = federate.handle(now, input);
        while federate.poll().is_some() {}
    }
}

/// Two federates that send to each other, one way at once.
pub(crate) fn program() -> Program {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let ends = ["a", "b"].map(|name| {
        let reactor = b.reactor(b.main(), name);
        b.federate(reactor, name, 0, None);
        let input = b.port(reactor, "in", Direction::Input);
        let output = b.port(reactor, "out", Direction::Output);
        let (triggers, effects) = (vec![Trigger::Port(input)], vec![Effect::Port(output)]);
        b.reaction(reactor, ReactionSpec { triggers, effects, ..ReactionSpec::default() });
        (input, output)
    });
    for (from, to, delay) in [(0, 1, Delay::None), (1, 0, Delay::Time(10))] {
        b.connection(Connection {
            from: ends[from].1,
            to: ends[to].0,
            delay,
            physical: false,
            serializer: None,
            absent_after: 0,
            compress: false,
            bound: None,
            mode: None,
        });
    }
    b.build().expect("the federation is sound")
}
