//! Which of a federation's hosts (`at`) are this machine, for a launcher that starts all federates
//! here.
//!
//! A federate that is to run elsewhere is not started here instead, because it may need what only that machine has. The
//! RTI is at home where the launcher is, so that is only told: programs of Lingua Franca name hosts for it that exist
//! in a network of containers alone.
//!
//! Nothing is looked up: a name server may take seconds, and a launch must not.

use std::net::{IpAddr, UdpSocket};

use hprm_model::{Compiled, Diagnostic, PlacedAt, Severity};

/// Errors about federates that are to run elsewhere. `is_asked_for` says of which the user has said where to run them.
pub(crate) fn federates(
    compiled: &Compiled,
    is_asked_for: impl Fn(&str) -> bool,
) -> Vec<Diagnostic> {
    let stated = |placed: &PlacedAt| {
        let name = placed.federate.as_ref().filter(|name| !is_asked_for(name))?;
        let PlacedAt { host, span, .. } = placed;
        Some(Diagnostic {
            code: "LF0804",
            severity: Severity::Error,
            message: format!("federate `{name}` is to run at `{host}`, which is not this machine"),
            span: *span,
            labels: Vec::new(),
            hint: Some(format!(
                "with agents, --fleet-key FILE starts it there (handbook page howto/agents); by hand, `hprm rti` and \
                 `hprm federate` do (handbook page howto/deployment); `hprm run --at {name}=localhost` starts it here"
            )),
        })
    };
    elsewhere(compiled).filter_map(stated).collect()
}

/// A warning about an RTI that is to run elsewhere.
pub(crate) fn rti(compiled: &Compiled) -> Vec<Diagnostic> {
    let stated = elsewhere(compiled).filter(|placed| placed.federate.is_none());
    let warning = |PlacedAt { host, span, .. }: &PlacedAt| Diagnostic {
        code: "LF0805",
        severity: Severity::Warning,
        message: format!("the RTI is to run at `{host}`, and `hprm run` starts it here"),
        span: *span,
        labels: Vec::new(),
        hint: Some("`hprm rti` starts it alone (handbook page howto/deployment)".to_owned()),
    };
    stated.map(warning).collect()
}

fn elsewhere(compiled: &Compiled) -> impl Iterator<Item = &PlacedAt> {
    compiled.hosts.iter().filter(|placed| !is_this_machine(&placed.host))
}

/// Whether `host`, as programs write it, means this machine.
pub(crate) fn is_this_machine(host: &str) -> bool {
    is_here(host, &rustix::system::uname().nodename().to_string_lossy())
}

/// Whether `host` (`user@host:port`) means the machine that calls itself `own`.
fn is_here(host: &str, own: &str) -> bool {
    let without_user = host.rsplit_once('@').map_or(host, |(_, rest)| rest);
    let without_user = without_user.trim_start_matches('[');
    let name = match without_user.split_once(']') {
        Some((address, _)) => address,
        None if without_user.matches(':').count() == 1 => {
            without_user.split(':').next().unwrap_or_default()
        }
        None => without_user,
    };
    if let Ok(address) = name.parse::<IpAddr>() {
        // Only an address of this machine can be bound.
        return UdpSocket::bind((address, 0)).is_ok();
    }
    let first = |name: &str| name.split('.').next().unwrap_or_default().to_ascii_lowercase();
    let local = first(name) == "localhost" || name.to_ascii_lowercase().ends_with(".localhost");
    local || first(name) == first(own)
}

#[cfg(test)]
mod tests {
    use super::is_here;

    #[test]
    fn this_machine_is_told_from_others() {
        for host in [
            "localhost",
            "LOCALHOST:15045",
            "127.0.0.1",
            "pi@127.0.0.1:22",
            "0.0.0.0",
            "robot",
            "robot.local",
            "pi@robot.lab.example:15045",
        ] {
            assert!(is_here(host, "robot"), "{host}");
        }
        // Addresses for documentation belong to no machine.
        for host in ["192.0.2.1", "[2001:db8::1]:15045", "pi@[2001:db8::1]", "other.local", "rob"] {
            assert!(!is_here(host, "robot"), "{host}");
        }
    }
}
