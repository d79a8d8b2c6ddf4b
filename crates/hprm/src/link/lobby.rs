//! Where links of others arrive, and wait until they have said who they are.
//!
//! A link leaves with its first frame, and whoever listens decides about it. One that says nothing,
//! or something else, is closed and costs little until then; nobody waits for it.

use std::collections::VecDeque;
use std::io;
use std::os::fd::AsFd;

use hprm_core::{Nanos, PhysicalTime};
use hprm_federated::Frame;

use super::{Address, Arrival, Keys, Purpose};
use crate::wait::Interest;
use crate::wire::{Gate, Wire};

/// How long a link may take to its first frame.
const PATIENCE: Nanos = 10_000_000_000;

/// The most links that may be on their way to it. One more costs the oldest its place: a member is
/// through in a few round trips, so the oldest is the one least likely to be one.
const STRANGERS: usize = 64;

/// See the module.
#[derive(Debug)]
pub(crate) struct Lobby {
    gates: Vec<Gate>,
    strangers: VecDeque<(Wire, PhysicalTime)>,
    purpose: Purpose,
    keys: Keys,
}

impl Lobby {
    pub(crate) fn new(gates: Vec<Gate>, purpose: Purpose, keys: Keys) -> Self {
        Self { gates, strangers: VecDeque::new(), purpose, keys }
    }

    /// Where it listens.
    pub(crate) fn addresses(&self) -> impl Iterator<Item = &Address> {
        self.gates.iter().map(Gate::address)
    }

    /// The links whose first frame has come, with that frame. It is `now` by the local clock, which
    /// nobody sets.
    pub(crate) fn admit(&mut self, now: PhysicalTime) -> io::Result<Vec<(Wire, Frame)>> {
        self.accept(now.plus(PATIENCE))?;
        let mut admitted = Vec::new();
        for (mut link, until) in std::mem::take(&mut self.strangers) {
            match first_frame(&mut link) {
                Ok(Some(frame)) => admitted.push((link, frame)),
                Ok(None) if now < until => self.strangers.push_back((link, until)),
                // Whoever broke off, or took too long, is no concern of the federation.
                Ok(None) | Err(Stranger) => {}
            }
        }
        Ok(admitted)
    }

    fn accept(&mut self, until: PhysicalTime) -> io::Result<()> {
        for gate in &self.gates {
            // However many come: the members have their turn, too.
            for _ in 0..STRANGERS {
                let Some(link) = gate.accept(self.purpose, &self.keys)? else { break };
                self.strangers.push_back((link, until));
                if self.strangers.len() > STRANGERS {
                    self.strangers.pop_front();
                }
            }
        }
        Ok(())
    }

    /// What a loop has to wait for.
    pub(crate) fn interests(&self) -> impl Iterator<Item = Interest<'_>> {
        let gates = self.gates.iter().map(|gate| Interest { fd: gate.as_fd(), write: false });
        gates.chain(
            self.strangers
                .iter()
                .map(|(link, _)| Interest { fd: link.as_fd(), write: link.has_outbound() }),
        )
    }

    /// When somebody has taken too long, by the local clock.
    pub(crate) fn next_wakeup(&self) -> Option<PhysicalTime> {
        self.strangers.iter().map(|(_, until)| *until).min()
    }
}

/// The other end is not, or no longer, one to wait for.
struct Stranger;

fn first_frame(link: &mut Wire) -> Result<Option<Frame>, Stranger> {
    loop {
        let arrival = link.read().map_err(|_| Stranger)?;
        link.flush().map_err(|_| Stranger)?;
        if let Some((frame, _)) = link.next_frame().map_err(|_| Stranger)? {
            return Ok(Some(frame));
        }
        match arrival {
            Arrival::Bytes | Arrival::Rest => {}
            Arrival::Nothing => return Ok(None),
            Arrival::Closed => return Err(Stranger),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::TcpStream;

    use hprm_federated::FederationId;

    use super::*;
    use crate::link::Security;
    use crate::wire::Network;

    const NOW: PhysicalTime = PhysicalTime(1_000);

    fn lobby() -> (Lobby, String) {
        let gate = Network::sockets().unwrap().listen(&"127.0.0.1:0".parse().unwrap()).unwrap();
        let Address::Tcp(address) = gate.address().clone() else { panic!("it is TCP") };
        let keys = Keys::new(FederationId(7), Security::default()).unwrap();
        (Lobby::new(vec![gate], Purpose::Coordination, keys), address)
    }

    /// Whether the other end has hung up without a word.
    fn is_hung_up(stream: &mut TcpStream) -> bool {
        stream
            .read(&mut [0])
            .map_or_else(|error| error.kind() == io::ErrorKind::ConnectionReset, |count| count == 0)
    }

    #[test]
    fn who_is_silent_is_hung_up_on_and_the_loop_woken_for_that() {
        let (mut lobby, address) = lobby();
        let mut silent = TcpStream::connect(address).unwrap();
        assert!(lobby.admit(NOW).unwrap().is_empty());
        let wakeup = lobby.next_wakeup().unwrap();
        assert_eq!(wakeup, NOW.plus(PATIENCE));
        assert_eq!(lobby.interests().count(), 2);
        assert!(lobby.admit(wakeup).unwrap().is_empty());
        assert_eq!(lobby.next_wakeup(), None);
        assert!(is_hung_up(&mut silent));
    }

    #[test]
    fn who_does_not_speak_the_protocol_hears_nothing() {
        for words in [&b"GET / HTTP/1.1\r\n\r\n"[..], &[0; 4096], b"HPRM-L00", b"\xff"] {
            let (mut lobby, address) = lobby();
            let mut stranger = TcpStream::connect(address).unwrap();
            stranger.write_all(words).unwrap();
            assert!(lobby.admit(NOW).unwrap().is_empty());
            while lobby.next_wakeup().is_some() {
                assert!(lobby.admit(NOW).unwrap().is_empty());
            }
            assert!(is_hung_up(&mut stranger));
        }
    }

    #[test]
    fn a_crowd_of_strangers_is_bounded_and_the_latest_has_a_place() {
        let (mut lobby, address) = lobby();
        let mut crowd = Vec::new();
        for _ in 0..STRANGERS + 3 {
            crowd.push(TcpStream::connect(&address).unwrap());
            assert!(lobby.admit(NOW).unwrap().is_empty());
        }
        assert_eq!(lobby.strangers.len(), STRANGERS);
        assert!(crowd[..3].iter_mut().all(is_hung_up));
    }
}
