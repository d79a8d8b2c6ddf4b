//! The cells in iceoryx2: publishers and subscribers, and events if a process sleeps. Nothing is discarded.

use std::env;
use std::error::Error;
use std::hint::spin_loop;
use std::mem::MaybeUninit;
use std::process::{self, Child, Command};
use std::thread;
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use crate::cell::{
    Cell, HUB, NODE, Numbered, Rounds, Waiting, Words, Workload, bytes, now, number, pin,
};

/// A byte of a loan that the hub does not write.
type Unwritten = MaybeUninit<u8>;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// How many messages may wait for a reader.
const MANY: usize = 256;
const FEW: usize = 2;

/// The number of the last message.
const STOP: u64 = u64::MAX;

/// Runs the hub in this process and the node in another one.
pub(crate) fn run(cell: &Cell) -> Result<()> {
    let name = format!("hprm-bench-{}", process::id());
    let mut command = Command::new(env::current_exe()?);
    let mut child = command.args(["node", &serde_json::to_string(cell)?, &name]).spawn()?;
    let done = hub(cell, &name, &mut child);
    if done.is_err() {
        child.kill()?;
        child.wait()?;
    }
    done
}

/// Waits for the node, which takes the last message from memory of this process.
fn ended(node: &mut Child) -> Result<()> {
    let status = node.wait()?;
    if status.success() { Ok(()) } else { Err(format!("the node has failed: {status}").into()) }
}

/// What a process has: its side of both directions.
struct Side<P, S> {
    publisher: P,
    subscriber: S,
    events: Option<(Notifier<ipc::Service>, Listener<ipc::Service>)>,
    _node: Node<ipc::Service>,
}

macro_rules! open {
    ($cell:expr, $name:expr, $from:expr, $to:expr, $payload:ty $(, $setting:ident)?) => {
        open!($cell, $name, $from => $payload, $to => $payload $(, $setting)?)
    };
    ($cell:expr, $name:expr, $from:expr => $in:ty, $to:expr => $out:ty $(, $setting:ident)?) => {{
        let (cell, name): (&Cell, &str) = ($cell, $name);
        let size = size_of_slice(cell);
        let node = NodeBuilder::new()
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()?;
        let queue = if size <= 65_536 { MANY } else { FEW };
        macro_rules! data {
            ($way:expr, $payload:ty) => {{
                let name = ServiceName::new(&format!("{name}/{}", $way))?;
                let builder = node.service_builder(&name).publish_subscribe::<$payload>();
                let builder = builder.enable_safe_overflow(false).history_size(0);
                let builder = builder.subscriber_max_buffer_size(queue);
                builder.max_subscribers(1).max_publishers(1).open_or_create()?
            }};
        }
        let event = |way: &str| {
            let name = ServiceName::new(&format!("{name}/{way}/event"))?;
            Ok::<_, Box<dyn Error>>(node.service_builder(&name).event().open_or_create()?)
        };
        let (from, to) = (data!($from, $in), data!($to, $out));
        let subscriber = from.subscriber_builder().buffer_size(queue).create()?;
        let publisher = to.publisher_builder();
        $(let publisher = publisher.$setting(size);)?
        let publisher =
            publisher.backpressure_strategy(BackpressureStrategy::RetryUntilDelivered).create()?;
        let (hears, tells) = (event($from)?, event($to)?);
        let events = match cell.waiting {
            Waiting::Polling => None,
            Waiting::Sleeping => {
                let listener = hears.listener_builder().create()?;
                while tells.dynamic_config().number_of_listeners() == 0 {
                    thread::sleep(Duration::from_millis(1));
                }
                Some((tells.notifier_builder().create()?, listener))
            }
        };
        while to.dynamic_config().number_of_subscribers() == 0
            || from.dynamic_config().number_of_publishers() == 0
        {
            thread::sleep(Duration::from_millis(1));
        }
        publisher.update_connections()?;
        // Opens this end of the connection.
        subscriber.has_samples()?;
        Side { publisher, subscriber, events, _node: node }
    }};
}

fn size_of_slice(cell: &Cell) -> usize {
    match cell.workload {
        Workload::Array | Workload::Struct => crate::cell::SMALL,
        Workload::Loan(size) | Workload::Rate(size) => size,
    }
}

impl<P, S> Side<P, S> {
    fn tell(&self) -> Result<()> {
        if let Some((notifier, _)) = &self.events {
            notifier.notify()?;
        }
        Ok(())
    }

    /// The next message, with a function that looks for one.
    fn next<T>(&self, receive: impl Fn() -> Result<Option<T>>) -> Result<T> {
        loop {
            if let Some(received) = receive()? {
                return Ok(received);
            }
            match &self.events {
                None => spin_loop(),
                Some((_, listener)) => {
                    listener.timed_wait(|_| (), Duration::from_secs(5))?;
                }
            }
        }
    }
}

type Sides<T> = Side<Publisher<ipc::Service, T, ()>, Subscriber<ipc::Service, T, ()>>;

impl Sides<[u8]> {
    fn send(&self, bytes: &[u8]) -> Result<()> {
        self.publisher.loan_slice_uninit(bytes.len())?.write_from_slice(bytes).send()?;
        self.tell()
    }

    fn take(&self) -> Result<Sample<ipc::Service, [u8], ()>> {
        self.next(|| Ok(self.subscriber.receive()?))
    }
}

impl Sides<Words> {
    fn send(&self, words: Words) -> Result<()> {
        self.publisher.loan_uninit()?.write_payload(words).send()?;
        self.tell()
    }

    fn take(&self) -> Result<Sample<ipc::Service, Words, ()>> {
        self.next(|| Ok(self.subscriber.receive()?))
    }
}

fn hub(cell: &Cell, name: &str, child: &mut Child) -> Result<()> {
    set_log_level(LogLevel::Error);
    pin(HUB)?;
    match cell.workload {
        Workload::Struct => {
            let side = open!(cell, name, "up", "down", Words);
            rounds(cell, |number| {
                let began = now();
                side.send(Words::numbered(number))?;
                let reply = side.take()?;
                let took = now() - began;
                assert_eq!(reply.number(), number);
                Ok(took as f64 / 2.0)
            })?;
            side.send(Words::numbered(STOP))?;
            ended(child)
        }
        Workload::Array => {
            let side = open!(cell, name, "up", "down", [u8], initial_max_slice_len);
            rounds(cell, |sent| {
                let began = now();
                side.send(&bytes(sent))?;
                let reply = side.take()?;
                let took = now() - began;
                assert_eq!(number(&reply), sent);
                Ok(took as f64 / 2.0)
            })?;
            side.send(&bytes(STOP))?;
            ended(child)
        }
        Workload::Loan(size) => {
            let side = open!(cell, name, "up" => u64, "down" => [Unwritten], initial_max_slice_len);
            let loan = |size| -> Result<_> {
                let loan = side.publisher.loan_slice_uninit(size)?;
                // The compiler makes nothing of it: nothing is written.
                Ok(loan.write_from_fn(|_| Unwritten::uninit()))
            };
            rounds(cell, |_| {
                let loan = loan(size)?;
                let began = now();
                loan.send()?;
                side.tell()?;
                Ok((*side.next(|| Ok(side.subscriber.receive()?))? - began) as f64)
            })?;
            loan(1)?.send()?;
            side.tell()?;
            ended(child)
        }
        Workload::Rate(size) => {
            let side = open!(cell, name, "up", "down", [u8], initial_max_slice_len);
            let mut began = 0;
            let message = vec![0; size];
            // Until the node has opened its end of the connection, what is too much for its queue is discarded.
            side.take()?;
            for sent in 0..cell.rounds + cell.warm_up {
                if sent == cell.warm_up {
                    began = now();
                }
                side.send(&message)?;
            }
            cell.write((number(&side.take()?) - began) as f64 / cell.rounds as f64);
            side.send(&bytes(STOP))?;
            ended(child)
        }
    }
}

fn rounds(cell: &Cell, round: impl Fn(u64) -> Result<f64>) -> Result<()> {
    let mut rounds = Rounds::of(cell);
    for number in 1.. {
        if rounds.add(round(number)?) {
            break;
        }
    }
    cell.write(rounds.median());
    Ok(())
}

/// The other process.
pub(crate) fn node(cell: &Cell, name: &str) -> Result<()> {
    set_log_level(LogLevel::Error);
    pin(NODE)?;
    match cell.workload {
        Workload::Struct => {
            let side = open!(cell, name, "down", "up", Words);
            loop {
                let words = side.take()?;
                if words.number() == STOP {
                    return Ok(());
                }
                side.send(*words)?;
            }
        }
        Workload::Array => {
            let side = open!(cell, name, "down", "up", [u8], initial_max_slice_len);
            loop {
                let message = side.take()?;
                if number(&message) == STOP {
                    return Ok(());
                }
                side.send(&message)?;
            }
        }
        Workload::Loan(size) => {
            let side = open!(cell, name, "down" => [Unwritten], "up" => u64);
            loop {
                let message = side.next(|| Ok(side.subscriber.receive()?))?;
                let came = now();
                if message.len() != size {
                    return Ok(());
                }
                // The hub has room for one more only when this one is free.
                drop(message);
                side.publisher.send_copy(came)?;
                side.tell()?;
            }
        }
        Workload::Rate(_) => {
            let side = open!(cell, name, "down", "up", [u8], initial_max_slice_len);
            side.send(&bytes(0))?;
            for _ in 0..cell.rounds + cell.warm_up {
                side.take()?;
            }
            side.send(&now().to_le_bytes())?;
            // The hub takes the reply from memory of this process.
            side.take()?;
            Ok(())
        }
    }
}
