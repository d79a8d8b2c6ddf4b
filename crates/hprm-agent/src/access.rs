//! What a machine may say and hear in the network of agents: Zenoh's access control, from the roster.
//!
//! At both ends of each connection, TLS tells Zenoh whose certificate the other end has. A machine of the roster is given
//! the keys that belong to its name, and no others: it cannot say that another machine is there, send in its name, or
//! have what is meant for it. Who has a certificate and is not on the roster can only compare rosters.
//!
//! The keys are those of `carrier.rs`.

use serde_json::{Value, json};

use crate::carrier::ROOT;
use crate::credentials::{Member, Roster};

/// Where rosters are compared.
pub(crate) const ROSTER: &str = "hprm/agents/1/roster";

/// The subject that everybody with a certificate is.
const ANYONE: &str = "anyone";

/// What Zenoh calls `access_control`, for an agent with this roster.
pub(crate) fn control(roster: &Roster) -> Value {
    let mut rules = vec![rule(
        "rosters",
        &["query", "reply", "declare_queryable"],
        &["ingress", "egress"],
        &[ROSTER.to_owned()],
    )];
    let mut subjects = vec![json!({ "id": ANYONE })];
    let mut policies = vec![json!({ "id": ANYONE, "rules": ["rosters"], "subjects": [ANYONE] })];
    for member in &roster.machines {
        let own = if member.is_router { router(member) } else { machine(member) };
        let ids: Vec<_> = own.iter().map(|rule| rule["id"].clone()).collect();
        let subject = &member.subject;
        subjects.push(json!({ "id": subject, "cert_common_names": [subject] }));
        policies.push(json!({ "id": subject, "rules": ids, "subjects": [subject] }));
        rules.extend(own);
    }
    json!({
        "enabled": true,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    })
}

/// What a machine may say here (ingress), and what of this one it gets (egress).
fn machine(member: &Member) -> Vec<Value> {
    let Member { name, subject, .. } = member;
    let key = |rest: &str| format!("{ROOT}/{rest}");
    let to_it = [key(&format!("open/{name}/**")), key(&format!("about/{name}/*"))];
    let from_it = [key(&format!("open/*/*/{name}/*")), key("about/*/*")];
    let links_to_it = [key(&format!("links/{name}/**"))];
    let id = |what: &str| format!("{subject} {what}");
    let one = |what: &str, messages: &[&str], flow: &str, keys: &[String]| {
        rule(&id(what), messages, &[flow], keys)
    };
    vec![
        one("is there", &["liveliness_token"], "ingress", &[key(&format!("machines/{name}/*"))]),
        one("hears who is there", &["liveliness_token"], "egress", &[key("machines/*/*")]),
        rule(
            &id("asks who is there"),
            &["liveliness_query", "declare_liveliness_subscriber"],
            &["ingress", "egress"],
            &[key("machines/*/*")],
        ),
        one("sends", &["put"], "ingress", &[key(&format!("links/*/*/{name}/*/*"))]),
        one("receives", &["declare_subscriber"], "ingress", &links_to_it),
        one("is sent to", &["put"], "egress", &links_to_it),
        one("is told", &["declare_subscriber"], "egress", &[key("links/**")]),
        one("asks", &["query"], "ingress", &from_it),
        one("is answered", &["reply"], "egress", &from_it),
        one("answers", &["reply", "declare_queryable"], "ingress", &to_it),
        one("is asked", &["query"], "egress", &to_it),
        one(
            "is offered answers",
            &["declare_queryable"],
            "egress",
            &[key("open/**"), key("about/*/*")],
        ),
    ]
}

/// A router leads what all machines say, and may say it in their names.
fn router(member: &Member) -> Vec<Value> {
    let messages = [
        "put",
        "declare_subscriber",
        "query",
        "reply",
        "declare_queryable",
        "liveliness_token",
        "liveliness_query",
        "declare_liveliness_subscriber",
    ];
    let id = format!("{} leads", member.subject);
    vec![rule(&id, &messages, &["ingress", "egress"], &[format!("{ROOT}/**")])]
}

fn rule(id: &str, messages: &[&str], flows: &[&str], keys: &[String]) -> Value {
    json!({
        "id": id,
        "messages": messages,
        "flows": flows,
        "permission": "allow",
        "key_exprs": keys,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zenoh_takes_the_rules_of_a_large_roster() {
        let member = |number: u32| Member {
            name: format!("robot{number}"),
            subject: format!("robot{number}#{number}"),
            is_router: number == 0,
        };
        let roster = Roster { number: 100, machines: (0..100).map(member).collect() };
        let mut config = zenoh::Config::default();
        config.insert_json5("access_control", &control(&roster).to_string()).unwrap();
        let none = Roster::default();
        config.insert_json5("access_control", &control(&none).to_string()).unwrap();
    }
}
