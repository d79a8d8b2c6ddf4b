//! Where a process listens, as text and as data.

use std::fmt;
use std::net::IpAddr;
use std::str::FromStr;

use crate::agent::Place;

/// The address of an RTI or a federate.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Address {
    /// `unix:@name`: a Unix socket in the abstract namespace, which leaves no file behind.
    Abstract(String),
    /// `unix:/path`: a Unix socket in the file system.
    Path(String),
    /// `tcp:host:port`, or no more than `host:port`.
    Tcp(String),
    /// `agent:machine/name`: a listener on a machine, to which the agents of the machines lead.
    Agent(Place),
}

impl Address {
    /// Whether other machines can reach it, as far as its text tells.
    #[must_use]
    pub fn is_open(&self) -> bool {
        let Self::Tcp(host_and_port) = self else { return matches!(self, Self::Agent(_)) };
        let host = host_and_port.rsplit_once(':').map_or(host_and_port.as_str(), |(host, _)| host);
        let host = host.trim_start_matches('[').trim_end_matches(']');
        !host.parse::<IpAddr>().map_or(host == "localhost", |ip| ip.is_loopback())
    }

    /// Whether it is a Unix socket.
    #[must_use]
    pub fn is_unix(&self) -> bool {
        matches!(self, Self::Abstract(_) | Self::Path(_))
    }
}

/// Why a text is not an address.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("'{0}' is not an address: write HOST:PORT, unix:@NAME, unix:/PATH or agent:MACHINE/NAME")]
pub struct AddressError(String);

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let error = || AddressError(text.to_owned());
        match text.split_once(':').ok_or_else(error)? {
            ("unix", rest) => match rest.strip_prefix('@') {
                Some("") => Err(error()),
                Some(name) => Ok(Self::Abstract(name.to_owned())),
                None if rest.starts_with('/') => Ok(Self::Path(rest.to_owned())),
                None => Err(error()),
            },
            ("agent", rest) if !is_host_and_port(text) => {
                rest.parse().map(Self::Agent).map_err(|()| error())
            }
            ("tcp", rest) if is_host_and_port(rest) => Ok(Self::Tcp(rest.to_owned())),
            ("tcp", _) => Err(error()),
            _ if is_host_and_port(text) => Ok(Self::Tcp(text.to_owned())),
            _ => Err(error()),
        }
    }
}

/// Only an address in brackets has colons of its own.
fn is_host_and_port(text: &str) -> bool {
    text.rsplit_once(':').is_some_and(|(host, port)| {
        let bracketed = host.starts_with('[') && host.ends_with(']');
        !host.is_empty() && (bracketed || !host.contains(':')) && port.parse::<u16>().is_ok()
    })
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Abstract(name) => write!(f, "unix:@{name}"),
            Self::Path(path) => write!(f, "unix:{path}"),
            Self::Tcp(host) => write!(f, "tcp:{host}"),
            Self::Agent(place) => write!(f, "agent:{place}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Address;

    #[test]
    fn text_and_back() {
        for text in [
            "unix:@hprm-1",
            "unix:/run/rti",
            "tcp:127.0.0.1:15045",
            "tcp:[::1]:0",
            "agent:robot1/rti",
        ] {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn what_is_no_address_says_what_is() {
        for text in
            ["", "unix:", "unix:@", "unix:relative", "tcp:host", "tcp::1", "udp:a:1", ":1", "a:b"]
        {
            let error = text.parse::<Address>().unwrap_err().to_string();
            assert!(error.contains("HOST:PORT"), "{error}");
        }
    }

    #[test]
    fn a_host_and_a_port_are_tcp() {
        for text in ["robot.local:15045", "10.0.0.1:1", "[::1]:0"] {
            assert_eq!(text.parse(), Ok(Address::Tcp(text.to_owned())));
        }
    }

    #[test]
    fn what_other_machines_reach_is_open() {
        let open = |text: &str| text.parse::<Address>().unwrap().is_open();
        for text in ["unix:@a", "unix:/run/a", "tcp:127.0.0.1:1", "tcp:[::1]:1", "localhost:1"] {
            assert!(!open(text), "{text}");
        }
        for text in ["tcp:0.0.0.0:1", "tcp:[::]:1", "tcp:robot.local:1", "10.0.0.1:1"] {
            assert!(open(text), "{text}");
        }
    }
}
