//! Names of hosts, `user@host:port`: whether they have the form of one. They are not looked up.

use std::net::{Ipv4Addr, Ipv6Addr};

use crate::declaration::Name;
use crate::diagnostic::{Diagnostic, Report};

/// Warns about a name that cannot be right.
pub(super) fn check(host: &Name, report: &mut Report) {
    let Err(wrong) = parts(&host.text) else { return };
    report
        .add(Diagnostic::warning("LF0803", host.span, format!("this is not {wrong}")).hint(
            "write a host as `10.0.0.1`, `[::1]`, `robot.local` or `user@robot.local:15045`",
        ));
}

fn parts(host: &str) -> Result<(), &'static str> {
    let inner = host.strip_prefix('[').and_then(|rest| rest.split_once(']'));
    let (user, address, port) = match inner {
        // The user of an IPv6 address is inside the brackets, or before them.
        Some((inside, port)) => {
            let (user, address) = split_user(inside);
            (user, Err(address), port)
        }
        None => {
            let (user, rest) = split_user(host);
            match rest.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
                Some((address, port)) => (user, Err(address), port),
                None => {
                    let end = rest.find(':').unwrap_or(rest.len());
                    (user, Ok(&rest[..end]), &rest[end..])
                }
            }
        }
    };
    if !user.is_none_or(is_user) {
        return Err("the name of a user");
    }
    match address {
        Err(address) if address.parse::<Ipv6Addr>().is_err() => return Err("an IPv6 address"),
        Ok(name) if name.ends_with(|c: char| c.is_ascii_digit()) && is_numeric(name) => {
            name.parse::<Ipv4Addr>().map_err(|_| "an IPv4 address")?;
        }
        Ok(name) if !is_name(name) => return Err("the name of a host"),
        _ => {}
    }
    match port.strip_prefix(':') {
        Some(port) if port.parse::<u16>().is_err() => Err("a port"),
        None if !port.is_empty() => Err("a port"),
        _ => Ok(()),
    }
}

fn split_user(text: &str) -> (Option<&str>, &str) {
    text.split_once('@').map_or((None, text), |(user, host)| (Some(user), host))
}

fn is_user(user: &str) -> bool {
    let fits = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
    user.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') && user.chars().all(fits)
}

fn is_numeric(name: &str) -> bool {
    name.chars().all(|c| c.is_ascii_digit() || c == '.')
}

fn is_name(name: &str) -> bool {
    let label = |label: &str| {
        let fits = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        !label.is_empty() && label.len() <= 63 && label.chars().all(fits) && !label.starts_with('-')
    };
    name.len() <= 253 && name.split('.').all(label) && !name.ends_with('-')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_are_told_from_slips() {
        for host in [
            "localhost",
            "10.0.0.1",
            "robot-2.lab.example:15045",
            "pi@10.0.0.1:22",
            "[::1]:15045",
            "[pi@fe80::1]",
            "pi@[::1]",
            "3com.example",
        ] {
            assert_eq!(parts(host), Ok(()), "{host}");
        }
        assert_eq!(parts("10.0.0.256"), Err("an IPv4 address"));
        assert_eq!(parts("10.0.1"), Err("an IPv4 address"));
        assert_eq!(parts("[::g]"), Err("an IPv6 address"));
        assert_eq!(parts("robot..lab"), Err("the name of a host"));
        assert_eq!(parts("robot-"), Err("the name of a host"));
        assert_eq!(parts("1pi@robot"), Err("the name of a user"));
        assert_eq!(parts("robot:70000"), Err("a port"));
        assert_eq!(parts("[::1]15045"), Err("a port"));
    }
}
