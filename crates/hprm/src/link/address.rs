//! Where a process listens, as text and as data.

use std::fmt;
use std::str::FromStr;

/// The address of an RTI or a federate.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Address {
    /// `unix:@name`: a Unix socket in the abstract namespace, which leaves no file behind.
    Abstract(String),
    /// `unix:/path`: a Unix socket in the file system.
    Path(String),
    /// `tcp:host:port`.
    Tcp(String),
}

/// Why a text is not an address.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("'{0}' is not an address: write unix:@NAME, unix:/PATH or tcp:HOST:PORT")]
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
            ("tcp", rest) => match rest.rsplit_once(':') {
                Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok() => {
                    Ok(Self::Tcp(rest.to_owned()))
                }
                _ => Err(error()),
            },
            _ => Err(error()),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Abstract(name) => write!(f, "unix:@{name}"),
            Self::Path(path) => write!(f, "unix:{path}"),
            Self::Tcp(host) => write!(f, "tcp:{host}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Address;

    #[test]
    fn text_and_back() {
        for text in ["unix:@hprm-1", "unix:/run/rti", "tcp:127.0.0.1:15045", "tcp:[::1]:0"] {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn what_is_no_address_says_what_is() {
        for text in ["", "unix:", "unix:@", "unix:relative", "tcp:host", "tcp::1", "udp:a:1"] {
            let error = text.parse::<Address>().unwrap_err().to_string();
            assert!(error.contains("tcp:HOST:PORT"), "{error}");
        }
    }
}
