//! How federates reach one another: how long to look, where to listen, and which address to use.
//!
//! The search for the RTI is in `search`. What travels over the resulting links is in `links`.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::os::unix::fs::MetadataExt;
use std::time::Duration;

use hprm_federated::{HostId, addresses_in};

use super::FederateOptions;
use crate::agent::Place;
use crate::link::{Keys, Link, LinkListener, Network};
use crate::{Address, Failure};

/// What [`Reach::advertise`] says of a federate that others reach through the agent of its machine, wherever the RTI
/// is.
pub const THROUGH_AGENT: &str = "agent:";

/// How long to look for the RTI, and where peers find this federate.
#[derive(Clone, Debug)]
pub struct Reach {
    /// How long to try to reach the RTI, which may be started later.
    pub connect_timeout: Duration,
    /// `HOST` or `HOST:PORT` under which other machines reach this federate, if that is not where
    /// its connection to the RTI begins; or [`THROUGH_AGENT`].
    pub advertise: Option<String>,
    /// Called with a message for the user: once if the RTI is not there yet, and once for each peer to which no link
    /// opens for some seconds.
    pub notice: Option<fn(&str)>,
    /// Whether the user has interrupted the search.
    pub interrupted: Option<fn() -> bool>,
}

impl Default for Reach {
    fn default() -> Self {
        Self {
            connect_timeout: Duration::from_secs(60),
            advertise: None,
            notice: None,
            interrupted: None,
        }
    }
}

/// Where to reach a peer that listens at `addresses`: over a Unix socket if it runs on the same host.
///
/// # Errors
///
/// Why it cannot be reached at any of them.
pub(super) fn peer_address(addresses: &str, same_host: bool) -> Result<Address, String> {
    let unreachable = |error: &dyn std::fmt::Display| format!("at {addresses}: {error}");
    let mut parsed = Vec::new();
    for text in addresses_in(addresses) {
        parsed.push(text.parse::<Address>().map_err(|error| unreachable(&error))?);
    }
    let preferred = parsed.iter().position(|address| address.is_unix() == same_host);
    let chosen = preferred.or_else(|| parsed.iter().position(|address| !address.is_unix()));
    chosen.map(|at| parsed.swap_remove(at)).ok_or_else(|| {
        unreachable(&"from another machine\n  hint: start it with `hprm federate --advertise HOST`")
    })
}

/// Listens for peers. Returns also the addresses of this federate, as peers read them.
pub(super) fn listen(
    options: &FederateOptions,
    rti: &Link,
    keys: &Keys,
    network: &Network,
) -> Result<(Vec<LinkListener>, String), Failure> {
    let mut listeners = Vec::new();
    let mut addresses: Vec<String> = Vec::new();
    // With the number of the process: a transient federate may have a predecessor.
    let mine = format!("{}-{}", options.federate.0, std::process::id());
    let unix = match &options.rti {
        Address::Abstract(rti) => Address::Abstract(format!("{rti}-{mine}")),
        Address::Path(rti) => Address::Path(format!("{rti}-{mine}")),
        // For peers on the same host, which share memory.
        Address::Tcp(_) | Address::Agent(_) => Address::Abstract(format!("hprm-{}", uuid())),
    };
    listeners.push(bind(network, &unix)?);
    addresses.push(unix.to_string());
    if is_reached_through_agent(options) {
        let listener = bind(network, &Address::Agent(Place::here(&uuid())))?;
        addresses.push(listener.address().to_string());
        listeners.push(listener);
    } else if let Some(advertise) = &options.reach.advertise {
        let (host, port) = host_and_port(advertise)?;
        let any = if host.starts_with('[') { "[::]" } else { "0.0.0.0" };
        let any = Address::Tcp(format!("{any}:{port}"));
        keys.check_for(&any)?;
        let listener = bind(network, &any)?;
        addresses.push(format!("tcp:{host}:{}", port_of(listener.address())));
        listeners.push(listener);
    } else if !rti.is_local() {
        let here = rti.local_address().map_err(|error| cannot_listen(&options.rti, &error))?;
        let listener = bind(network, &Address::Tcp(SocketAddr::new(here.ip(), 0).to_string()))?;
        addresses.push(listener.address().to_string());
        listeners.push(listener);
    }
    Ok((listeners, addresses.join(" ")))
}

/// Whether federates of other machines reach this one through the agent of this machine.
pub(super) fn is_reached_through_agent(options: &FederateOptions) -> bool {
    let has_joined = matches!(options.rti, Address::Agent(_));
    has_joined && options.reach.advertise.is_none()
        || options.reach.advertise.as_deref() == Some(THROUGH_AGENT)
}

fn bind(network: &Network, address: &Address) -> Result<LinkListener, Failure> {
    network.listen(address).map_err(|error| cannot_listen(address, &error))
}

fn cannot_listen(address: &Address, error: &io::Error) -> Failure {
    Failure::listen(false, address, error)
}

/// Parses `HOST`, `HOST:PORT`, or an IPv6 address with or without brackets.
fn host_and_port(advertise: &str) -> Result<(String, u16), Failure> {
    if let Ok(IpAddr::V6(ip)) = advertise.parse() {
        return Ok((format!("[{ip}]"), 0));
    }
    if advertise.starts_with('[') && advertise.ends_with(']') {
        return Ok((advertise.to_owned(), 0));
    }
    match advertise.rsplit_once(':') {
        None if !advertise.is_empty() => Ok((advertise.to_owned(), 0)),
        Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok() => {
            Ok((host.to_owned(), port.parse().unwrap_or_default()))
        }
        _ => Err(Failure::option(format!(
            "cannot be reached at '{advertise}': write HOST or HOST:PORT"
        ))),
    }
}

fn port_of(address: &Address) -> &str {
    match address {
        Address::Tcp(text) => text.rsplit_once(':').map_or("0", |(_, port)| port),
        Address::Abstract(_) | Address::Path(_) | Address::Agent(_) => "0",
    }
}

/// The number of this host; federates with the same number share memory. The links of federates that have
/// joined over Unix sockets carry descriptors. Of federates that have joined over TCP, only direct links with one
/// another do, if this federate is `linked` so. For that they must be in one network namespace and belong to one user;
/// and if they have joined through an `agent`, use the same one, because an agent stands for a machine.
pub(super) fn host_id(local: bool, linked: bool, agent: Option<&Address>) -> HostId {
    let read = |name| std::fs::read_to_string(format!("/proc/sys/kernel/random/{name}"));
    let number = |text: String| {
        let digits: String = text.chars().filter(char::is_ascii_hexdigit).collect();
        u128::from_str_radix(&digits, 16).unwrap_or_default()
    };
    let boot = read("boot_id").map(number).unwrap_or_default();
    match (local, linked, std::fs::metadata("/proc/self/ns/net")) {
        (true, _, _) => HostId(boot).joined_over_unix_socket(),
        (false, true, Ok(namespace)) => {
            let user = rustix::process::geteuid().as_raw();
            let number = boot ^ u128::from(namespace.ino()) << 64 ^ u128::from(user) << 32;
            let agent = agent.map_or(0, |address| scrambled(&address.to_string()));
            HostId(number ^ u128::from(agent) << 16).joined_over_tcp()
        }
        (false, _, _) => HostId(read("uuid").map(number).unwrap_or_default()).joined_over_tcp(),
    }
}

/// A number that two texts share by chance only (FNV-1a).
fn scrambled(text: &str) -> u64 {
    let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    text.bytes().fold(0xcbf2_9ce4_8422_2325, step)
}

fn uuid() -> String {
    let text = std::fs::read_to_string("/proc/sys/kernel/random/uuid").unwrap_or_default();
    text.trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_may_have_a_port() {
        let read = |text: &str| host_and_port(text).unwrap();
        assert_eq!(read("robot.local"), ("robot.local".to_owned(), 0));
        assert_eq!(read("10.0.0.1:7000"), ("10.0.0.1".to_owned(), 7000));
        assert_eq!(read("fe80::1"), ("[fe80::1]".to_owned(), 0));
        assert_eq!(read("[fe80::1]"), ("[fe80::1]".to_owned(), 0));
        assert_eq!(read("[fe80::1]:7000"), ("[fe80::1]".to_owned(), 7000));
        for text in ["", ":1", "a:b"] {
            assert!(host_and_port(text).is_err(), "{text}");
        }
    }

    #[test]
    fn federates_know_with_which_others_they_share_memory() {
        assert_eq!(host_id(true, false, None), host_id(true, true, None));
        assert_eq!(host_id(false, true, None), host_id(false, true, None));
        assert_ne!(host_id(false, false, None), host_id(false, false, None));
        assert_ne!(host_id(true, true, None), host_id(false, true, None));
        let agents = ["unix:@one", "unix:@other"].map(|text| text.parse::<Address>().unwrap());
        let [one, other] = agents.map(|agent| host_id(false, true, Some(&agent)));
        assert_ne!(one, other);
        assert_eq!(one, host_id(false, true, Some(&"unix:@one".parse().unwrap())));
    }
}
