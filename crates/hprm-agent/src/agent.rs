//! The loop of an agent: one task that waits for processes of this machine, for packets, and for time (`waiting.rs`).

mod belonging;

use std::backtrace::{Backtrace, BacktraceStatus};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::os::unix::net::UnixStream;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use hprm::agent::{Answer, Place, Request};
use hprm::{Clock, Pipe, SHIPMENTS, ShippingDock, ShippingService, WantedLink, random_bytes};
use hprm_core::{Nanos, PhysicalTime};
use hprm_federated::relay::{Bytes, Input, Relay};

use crate::Failure;
use crate::carrier::{AgentId, BATCHES, Carrier, Event, FRAME, LinkId, Opening, Way};
use crate::lingering::Lingering;
use crate::link::Link;
use crate::local::{Local, answer};
use crate::membership::Membership;
use crate::near::Near;
use crate::options::Options;
use crate::others::{Others, Reached};
use crate::renewal::Daily;
use crate::starters::{Spawns, Starters};
use crate::telling::{self, tell};
use crate::threads;
use crate::waiting::{Token, Waiting, Watch, Watched, may_block};

/// The most links: each may hold some megabytes for a slow reader.
const LINKS: usize = 1024;

/// How long Zenoh may take an agent for alive that has ended while the network was broken: its lease, and a moment.
const LEASE: Nanos = 12_000_000_000;

/// How many events are taken before sockets are looked at again.
const EVENTS: usize = 256;

/// How many bytes may be on their way to other agents while the loop gives Zenoh more of them without [`may_block`], and how many
/// more it then takes from processes before it looks again: Zenoh has room for that many ([`BATCHES`]).
const QUIET: u64 = 256 << 10;
const _: () = assert!(2 * QUIET <= BATCHES as u64 * FRAME as u64);

/// See the module.
struct Agent {
    me: AgentId,
    waiting: Waiting,
    /// What asks the agent to end.
    stop: Watched<UnixStream>,
    /// Everything that is waited for but `stop` and the links, and when to look at it at the latest.
    control: Watch,
    look_at: PhysicalTime,
    /// Which links are waited for.
    tokens: BTreeMap<Token, LinkId>,
    carrier: Carrier,
    local: Local,
    starters: Starters,
    /// What follows from the authority, if this machine was enrolled.
    membership: Option<Membership>,
    daily: Daily,
    links: BTreeMap<LinkId, Link>,
    /// The other agents that are there.
    others: Others,
    /// Since when an older agent of the same name is there.
    rival_since: Option<PhysicalTime>,
    /// Where the shipping service is, and whether it leads what others send one another.
    dock: Watched<ShippingDock>,
    leads_shipments: Arc<AtomicBool>,
    lingering: Lingering,
}

/// Runs an agent until a signal ends it.
pub(crate) fn run(options: Options) -> Result<(), Failure> {
    let (stop, stops) = UnixStream::pair().map_err(system)?;
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        let stops = stops.try_clone().map_err(system)?;
        signal_hook::low_level::pipe::register(signal, stops).map_err(system)?;
    }
    let failed = end_with_threads(stops);
    let runtime = threads::runtime();
    let waiting = {
        let _entered = runtime.enter();
        Waiting::new().map_err(system)?
    };
    let (agent, shipping, spawns) = Agent::open(&options, waiting, stop)?;
    let leads = match options.is_router(options.credentials.as_ref()) {
        true => ", and is a router",
        false => "",
    };
    println!("the agent of {} listens at {}{leads}", options.name, options.listen.join(" and "));
    agent.starters.limited_text().iter().for_each(|text| println!("{text}"));
    // Without a reader of the lines, the agent runs as well.
    let _ = io::stdout().flush();
    ship(shipping).map_err(system)?;
    let running = runtime.spawn(agent.run(options, failed));
    spawns.start();
    runtime.block_on(running).unwrap_or_else(|error| resume_unwind(error.into_panic()))
}

fn system(error: io::Error) -> Failure {
    Failure::new(format!("the agent cannot run: {error}"))
}

/// Has a thread take large values to other machines.
fn ship(service: ShippingService) -> io::Result<()> {
    let thread = thread::Builder::new().name("shipping".to_owned());
    let ship = move || {
        let Err(error) = service.run();
        // It ends when the agent does.
        if error.kind() != io::ErrorKind::BrokenPipe {
            tell(&format!("warning: this agent ships no large values any more: {error}"));
        }
    };
    thread.spawn(ship).map(drop)
}

/// Has the loop end when a thread of Zenoh panics, and returns whether one has.
///
/// Its locks are poisoned then, and the session carries nothing more, whatever it says. Processes of this machine are better told
/// at once than by the silence of their links.
fn end_with_threads(stops: UnixStream) -> Arc<AtomicBool> {
    let failed = Arc::new(AtomicBool::new(false));
    let has_failed = Arc::clone(&failed);
    std::panic::set_hook(Box::new(move |panic| {
        let (thread, trace) = (thread::current(), Backtrace::capture());
        let trace = (trace.status() == BacktraceStatus::Captured).then(|| format!("\n{trace}"));
        let name = thread.name().unwrap_or("without a name");
        tell(&format!("thread {name} {panic}{}", trace.unwrap_or_default()));
        has_failed.store(true, Ordering::SeqCst);
        // Without a reader, the loop has ended already.
        let _ = (&stops).write(&[1]);
    }));
    failed
}

impl Agent {
    fn open(
        options: &Options,
        mut waiting: Waiting,
        stop: UnixStream,
    ) -> Result<(Self, ShippingService, Spawns), Failure> {
        let control = waiting.watch();
        // First of all, so that a second agent of this machine disturbs nothing.
        let local = Local::listen(control.clone())?;
        let epoch = Clock::local().0.unsigned_abs();
        let me = AgentId { machine: options.name.clone(), epoch };
        let enrolled = options.credentials.clone();
        let now = Clock::local();
        let membership = enrolled.map(|it| Membership::new(it, now, &control)).transpose()?;
        let (starters, spawns) = Starters::new(&options.name, options.programs.clone());
        let (limited, mark) = (starters.limited(), waiting.mark());
        let enrolled = options.credentials.as_ref();
        let carrier = Carrier::open(options, enrolled, me.clone(), limited, mark)?;
        let (shipping, dock) = ShippingService::open(&options.name, tell).map_err(system)?;
        let leads_shipments = shipping.leads();
        leads_shipments.store(options.is_router(enrolled), Ordering::Relaxed);
        let agent = Self {
            me,
            stop: waiting.watch().until_readable(stop).map_err(system)?,
            waiting,
            dock: control.until_readable(dock).map_err(system)?,
            control,
            look_at: PhysicalTime(0),
            tokens: BTreeMap::new(),
            carrier,
            local,
            starters,
            membership,
            daily: Daily::new(Clock::local()),
            links: BTreeMap::new(),
            others: Others::default(),
            rival_since: None,
            leads_shipments,
            lingering: Lingering::new(),
        };
        Ok((agent, shipping, spawns))
    }

    async fn run(mut self, options: Options, failed: Arc<AtomicBool>) -> Result<(), Failure> {
        loop {
            let next = self.next_wakeup();
            let done = match self.waiting.wait(next).await {
                Ok(ready) if ready.contains(&self.stop.token()) => break,
                // Once for all that may wait: each time, another thread takes over what this one did.
                Ok(ready) if self.may_wait(&ready) => {
                    may_block(|| self.proceed(&ready, u64::MAX, &options))
                }
                Ok(ready) => self.proceed(&ready, QUIET, &options),
                Err(error) => Err(system(error)),
            };
            if done.is_err() {
                may_block(|| self.end());
                return done;
            }
        }
        if failed.load(Ordering::SeqCst) {
            self.end_without_carrier();
        }
        may_block(|| self.end());
        Ok(())
    }

    /// Whether what there is to do may wait for something.
    fn may_wait(&self, ready: &[Token]) -> bool {
        self.is_busy() || self.carrier.has_rare_events() || self.is_to_look(ready)
    }

    /// Whether so much is on its way that Zenoh may have no room for more.
    fn is_busy(&self) -> bool {
        self.links.values().map(Link::in_flight).sum::<u64>() > QUIET
    }

    /// Whether something has happened that is not about what links carry, or it is time to look for that.
    fn is_to_look(&self, ready: &[Token]) -> bool {
        ready.contains(&self.control.token()) || Clock::local() >= self.look_at
    }

    /// Does what there is to do. Of what processes send, it takes about so many bytes.
    fn proceed(&mut self, ready: &[Token], most: u64, options: &Options) -> Result<(), Failure> {
        self.take_events();
        // Links first: a process waits for what comes over one, and there are few requests.
        self.drive_links(ready, most);
        if self.is_to_look(ready) {
            may_block(|| self.look(options))?;
            self.look_at = PhysicalTime::FOREVER;
        }
        self.wait_for_links();
        Ok(())
    }

    /// Does what is not about what links carry.
    fn look(&mut self, options: &Options) -> Result<(), Failure> {
        self.take_requests();
        self.starters.reap();
        self.lingering.look();
        self.look_at_ends(options);
        self.belong(options)?;
        if self.is_second() {
            let text = format!("another agent has the name '{}' already", options.name);
            return Err(Failure::new(text).hint("give each machine a name of its own: --name NAME"));
        }
        Ok(())
    }

    /// When there is something to do, even if nothing happens.
    fn next_wakeup(&mut self) -> PhysicalTime {
        let rival = self.rival_since.map(|since| since.plus(LEASE));
        let roster = self.membership.as_ref().map(Membership::next_wakeup);
        let looks = [rival, roster, self.starters.next_wakeup(), self.local.next_wakeup()];
        let looks = looks.into_iter().flatten();
        let looks = looks.chain([self.daily.next_wakeup(), self.lingering.next_wakeup()]);
        self.look_at = looks.fold(self.look_at, PhysicalTime::min);
        self.links.values().map(Link::next_wakeup).fold(self.look_at, PhysicalTime::min)
    }

    /// Waits for what links can read and write from now on.
    fn wait_for_links(&mut self) {
        let now = Clock::local();
        for link in self.links.values_mut() {
            if let Err(error) = link.wait_for_near() {
                link.handle(now, Input::Abort(format!("the agent cannot wait for it: {error}")));
            }
        }
    }

    /// Takes what has happened elsewhere, and then does what follows from the packets among that.
    fn take_events(&mut self) {
        for taken in 0..=EVENTS {
            let Some(event) = self.carrier.next() else { break };
            let now = Clock::local();
            match event {
                Event::Packet { link, packet } => self.packet(now, &link, packet),
                event => may_block(|| self.take(now, event)),
            }
            if taken == EVENTS {
                // More may be there; the next wait must not sleep.
                self.carrier.mark();
            }
        }
        let now = Clock::local();
        self.links.values_mut().for_each(|link| link.catch_up(now));
    }

    /// Takes what has happened elsewhere, and is rare.
    fn take(&mut self, now: PhysicalTime, event: Event) {
        match event {
            Event::Packet { link, packet } => self.packet(now, &link, packet),
            Event::Opening(opening) => self.open_here(now, opening),
            Event::Opened { link, answer } => self.opened(now, &link, answer),
            Event::Agent { agent, is_there } => self.other(now, agent, is_there),
            Event::Route { router, agent, is_there } => self.route(now, router, agent, is_there),
            Event::News(news) => self.hear(&news),
        }
    }

    fn packet(&mut self, now: PhysicalTime, id: &LinkId, packet: Bytes) {
        match self.links.get_mut(id) {
            Some(link) => link.packet(now, packet),
            None => self.refuse(id, &packet),
        }
    }

    /// Tells the other end that this agent knows nothing of a link.
    fn refuse(&self, id: &LinkId, packet: &[u8]) {
        if let Some(refusal) = Relay::refusal(packet) {
            self.carrier.send_once(id, &refusal);
        }
    }

    /// Another machine opens a link to a listener here.
    fn open_here(&mut self, now: PhysicalTime, opening: Opening) {
        let done = self.accept(now, &opening.link, &opening.name);
        let answer = done.err().unwrap_or_else(|| Answer::Done(self.me.machine.clone()));
        self.carrier.answer(opening, answer);
    }

    fn accept(&mut self, now: PhysicalTime, id: &LinkId, name: &str) -> Result<(), Answer> {
        let from = &id.agent.machine;
        if self.links.contains_key(id) || self.links.len() >= LINKS {
            return Err(self.refused(&format!("it has {} links", self.links.len())));
        }
        if let Some(router) = id.router.as_ref().filter(|_| self.others.reaches(from)) {
            // A router is believed only of those that it alone reaches.
            let here = &self.me.machine;
            let text = format!("the agent of {here} reaches {from}, and not through {router}");
            return Err(Answer::Absent(text));
        }
        let epoch = epoch().map_err(|error| self.refused(&error))?;
        let watch = self.waiting.watch();
        let token = watch.token();
        let near = match name {
            SHIPMENTS => self.accept_shipments(watch)?,
            _ => self.accept_process(name, watch)?,
        };
        let here = &self.me.machine;
        let near = near.ok_or_else(|| Answer::Absent(absent(here, name)))?;
        // Of an agent that asks for what is not there, Zenoh has nothing to remember.
        let way = self.carrier.way(id).map_err(|error| self.refused(&error))?;
        let what = format!("of {from} to agent:{here}/{name}{}", through(id));
        let mut link = Link::new(epoch, way, what, near);
        link.opened(now);
        self.insert((id.clone(), token), link);
        Ok(())
    }

    /// Hands a link to the shipping service; none if that has ended.
    fn accept_shipments(&self, watch: Watch) -> Result<Option<Near>, Answer> {
        let (mine, theirs) = Pipe::pair().map_err(|error| self.refused(&error))?;
        Ok(self.dock.get().hand_over(theirs).then(|| Near::shipping(mine, &watch)))
    }

    /// Hands a link to the process that listens under a name, or starts one; none if there is none.
    fn accept_process(&mut self, name: &str, watch: Watch) -> Result<Option<Near>, Answer> {
        let (mine, other) = UnixStream::pair().map_err(|error| self.refused(&error))?;
        mine.set_nonblocking(true).map_err(|error| self.refused(&error))?;
        if Starters::is_meant(name) {
            self.starters.start(&other).map_err(Answer::Refused)?;
        } else if !self.local.hand_over(name, &other) {
            return Ok(None);
        }
        Ok(Some(Near::process(mine, &watch)))
    }

    /// The other machine has opened a link, or has not.
    fn opened(&mut self, now: PhysicalTime, id: &LinkId, opened: Answer) {
        let Some(link) = self.links.get_mut(id) else { return };
        link.answer(&opened);
        match opened {
            Answer::Done(_) => link.opened(now),
            Answer::Absent(why) | Answer::Refused(why) => {
                link.handle(now, Input::Abort(why));
                self.links.remove(id);
                self.tokens.retain(|_, it| it != id);
                self.hear_only_others();
            }
        }
    }

    /// Another agent comes or goes, as Zenoh tells; it does not know whether only the network is broken.
    fn other(&mut self, now: PhysicalTime, agent: AgentId, is_there: bool) {
        self.carrier_is(now, is_there, |link| match &link.router {
            Some(router) => *router == agent.machine,
            None => link.agent == agent,
        });
        if agent != self.me {
            self.carrier.reaches(&agent, is_there);
            if is_there {
                // Also of links that are not known here any more: it is told so. If that fails, links to it cannot be opened.
                let _ = self.carrier.hear(&agent);
            }
            self.others.set(agent, is_there);
            self.hear_only_others();
            if let Some(membership) = self.membership.as_mut().filter(|_| is_there) {
                membership.rounds.hurry(now);
            }
        }
        self.look_for_rivals(now);
    }

    /// Hears those agents no longer that are not there and have no link.
    fn hear_only_others(&mut self) {
        let Self { carrier, others, links, .. } = self;
        let have_link = |agent: &AgentId| links.keys().any(|link| link.agent == *agent);
        carrier.hear_only(|agent| others.are_direct(agent) || have_link(agent));
    }

    /// A router reaches another agent, or does not any more.
    fn route(&mut self, now: PhysicalTime, router: String, agent: AgentId, is_there: bool) {
        if agent == self.me || router == self.me.machine {
            return;
        }
        self.carrier_is(now, is_there, |link| {
            link.router.as_ref() == Some(&router) && link.agent == agent
        });
        self.others.set_behind(now, router, agent, is_there);
        self.look_for_rivals(now);
    }

    /// Some links are carried again, or not at the moment.
    fn carrier_is(&mut self, now: PhysicalTime, up: bool, is_meant: impl Fn(&LinkId) -> bool) {
        for (_, link) in self.links.iter_mut().filter(|(id, _)| is_meant(id)) {
            link.handle(now, if up { Input::CarrierUp } else { Input::CarrierDown });
        }
    }

    fn look_for_rivals(&mut self, now: PhysicalTime) {
        // With certificates, a name belongs to one machine, and what a router says ends no agent.
        let is_anonymous = self.membership.is_none();
        self.rival_since = match self.others.have_older(&self.me, is_anonymous) {
            true => self.rival_since.or(Some(now)),
            false => None,
        };
    }

    /// Whether an older agent has the same name, and is not about to be forgotten.
    fn is_second(&self) -> bool {
        self.rival_since.is_some_and(|since| Clock::local() >= since.plus(LEASE))
    }

    fn take_requests(&mut self) {
        self.dock.get().wanted().into_iter().for_each(|wanted| self.connect_shipping(wanted));
        for (stream, request) in self.local.requests() {
            match request {
                Request::Listen(place) => self.local.register(&self.me.machine, &place, stream),
                Request::Connect(place) if place.is_on(&self.me.machine) => {
                    self.connect_here(&place, &stream);
                }
                Request::Connect(place) => self.connect(&place, stream),
                Request::Machines => self.tell_machines(stream),
                Request::Route(machine) => answer(&stream, &self.route_to(&machine)),
            }
        }
    }

    /// Both processes are on this machine: one connection is enough, and the agent has no part in it.
    fn connect_here(&mut self, place: &Place, stream: &UnixStream) {
        if self.local.listens(&place.name) {
            answer(stream, &Answer::Done(self.me.machine.clone()));
            // If it has ended this moment, the connection ends, too.
            self.local.hand_over(&place.name, stream);
        } else {
            answer(stream, &Answer::Absent(absent(&self.me.machine, &place.name)));
        }
    }

    /// A process wants a link to another machine.
    fn connect(&mut self, place: &Place, stream: UnixStream) {
        match self.other_end(place) {
            Ok(other) => {
                let watch = self.waiting.watch();
                self.begin(other, place, (watch.token(), Near::process(stream, &watch)));
            }
            Err(why) => answer(&stream, &Answer::Absent(why)),
        }
    }

    /// The shipping service wants one.
    fn connect_shipping(&mut self, wanted: WantedLink) {
        let place = Place { machine: wanted.machine.clone(), name: SHIPMENTS.to_owned() };
        match (self.other_end(&place), Pipe::pair()) {
            (Ok(other), Ok((mine, theirs))) => {
                let watch = self.waiting.watch();
                let token = watch.token();
                let near = Near::wanted(mine, &watch, (wanted, theirs));
                self.begin(other, &place, (token, near));
            }
            (Err(why), _) => wanted.answer(Err(io::Error::other(why))),
            (_, Err(error)) => wanted.answer(Err(error)),
        }
    }

    /// Where a link to a place on another machine leads, or why there is none.
    fn other_end(&self, place: &Place) -> Result<Reached, String> {
        let now = Clock::local();
        self.others.find(&place.machine, now).ok_or_else(|| {
            let known = self.machines(now).join(", ");
            format!("no agent has the name {}; there are: {known}", place.machine)
        })
    }

    fn refused(&self, error: &dyn std::fmt::Display) -> Answer {
        Answer::Refused(format!("the agent of {} cannot open a link: {error}", self.me.machine))
    }

    /// Begins a link of which the other end is not there yet.
    fn begin(&mut self, other: Reached, place: &Place, (token, mut near): (Token, Near)) {
        match self.new_link(other) {
            Ok((id, epoch, way)) => {
                let what = format!("to agent:{place}{}", through(&id));
                self.carrier.open_link(&id, &place.name);
                self.insert((id, token), Link::new(epoch, way, what, near));
            }
            Err(why) => near.answer(&Answer::Refused(why)),
        }
    }

    fn insert(&mut self, (id, token): (LinkId, Token), link: Link) {
        self.tokens.insert(token, id.clone());
        self.links.insert(id, link);
    }

    /// The number of a new link, that of the life of this end, and its way.
    fn new_link(&mut self, other: Reached) -> Result<(LinkId, u64, Way), String> {
        if self.links.len() >= LINKS {
            return Err(format!("the agent of {} has {LINKS} links already", self.me.machine));
        }
        let id = LinkId { agent: other.agent, number: epoch()?, router: other.router };
        let way = self.carrier.way(&id)?;
        Ok((id, epoch()?, way))
    }

    /// The machine next on the way to another one.
    fn route_to(&self, machine: &str) -> Answer {
        match self.others.find(machine, Clock::now()) {
            _ if machine == self.me.machine => Answer::Done(machine.to_owned()),
            Some(other) => Answer::Done(other.router.unwrap_or_else(|| machine.to_owned())),
            None => Answer::Absent(format!("no agent has the name {machine}")),
        }
    }

    fn tell_machines(&self, stream: UnixStream) {
        self.carrier.tell_machines(self.others.all(Clock::local()), stream);
    }

    /// The names of all machines, this one too.
    fn machines(&self, now: PhysicalTime) -> Vec<String> {
        let others = self.others.all(now).into_iter().map(|other| other.agent.machine);
        let mut names: Vec<_> = others.chain([self.me.machine.clone()]).collect();
        names.sort();
        names.dedup();
        names
    }

    /// Reads and writes what processes send and take, of whom some are ready, and lets time pass.
    fn drive_links(&mut self, ready: &[Token], mut most: u64) {
        let now = Clock::local();
        for token in ready {
            let link = self.tokens.get(token).and_then(|id| self.links.get_mut(id));
            if let Some(link) = link.filter(|link| link.is_open()) {
                link.near_ready(now, &mut most);
            }
        }
        for link in self.links.values_mut() {
            if link.next_wakeup() <= now {
                link.handle(now, Input::Wake);
            }
        }
        if self.links.values().any(|link| link.is_over(now)) {
            // Zenoh is to forget their keys.
            may_block(|| {
                self.links.retain(|_, link| !link.is_over(now));
                self.hear_only_others();
            });
            self.tokens.retain(|_, id| self.links.contains_key(id));
        }
    }

    /// Ends the process and leaves nothing behind here. What Zenoh has is not touched any more.
    fn end_without_carrier(self) -> ! {
        let Self { local, links, starters, carrier: _carrier, .. } = self;
        links.into_values().for_each(Link::leave_carrier);
        drop((local, starters));
        let text = format!("Zenoh has failed, so the agent of {} ends", self.me.machine);
        let hint = "start it again, and report what it says above to its developers";
        Failure::new(text).hint(hint).tell();
        telling::end();
        std::process::exit(1)
    }

    /// Tells the other ends of all links, and leaves nothing behind.
    fn end(mut self) {
        let now = Clock::local();
        for link in self.links.values_mut() {
            link.abort_at_last(now, format!("the agent of {} has ended", self.me.machine));
        }
        self.links.clear();
        self.carrier.close();
    }
}

/// A listener that is not there, perhaps not yet.
fn absent(machine: &str, name: &str) -> String {
    format!("no process listens at agent:{machine}/{name}")
}

/// Which way a link leads, for people.
fn through(link: &LinkId) -> String {
    link.router.as_ref().map(|router| format!(" through {router}")).unwrap_or_default()
}

/// A number that no other life of a link has.
fn epoch() -> Result<u64, String> {
    let bytes =
        random_bytes().map_err(|error| format!("the system has no random numbers: {error}"))?;
    Ok(u64::from_le_bytes(bytes))
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    #[test]
    fn a_thread_that_panics_wakes_the_loop_and_is_remembered() {
        let (mut stop, stops) = UnixStream::pair().unwrap();
        let failed = end_with_threads(stops);
        assert!(!failed.load(Ordering::SeqCst));
        assert!(thread::spawn(|| panic!("as a thread of Zenoh does")).join().is_err());
        assert!(failed.load(Ordering::SeqCst));
        stop.read_exact(&mut [0]).unwrap();
        drop(std::panic::take_hook());
    }
}
