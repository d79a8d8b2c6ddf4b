//! What a machine may say and hear in the network of agents: Zenoh's access control, from the roster.
//!
//! At both ends of each connection, TLS tells Zenoh whose certificate the other end has. A machine of the roster is given
//! the keys that belong to its name, and no others: it cannot say that another machine is there, send in its name, or
//! have what is meant for it. Who has a certificate and is not on the roster can only compare rosters. A router may say in
//! addition what it has heard from others (`router.rs`), with keys that tell that it was led; so it cannot say what is heard
//! as said by another machine itself.
//!
//! The keys are those of `carrier.rs`.

use serde_json::{Value, json};

use crate::carrier::ROOT;
use crate::credentials::{Member, Roster};

/// Where rosters are compared.
pub(crate) const ROSTER: &str = "hprm/agents/2/roster";

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
        let mut own = machine(member);
        own.extend(member.is_router.then(|| router(member)).into_iter().flatten());
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
    let name = &member.name;
    let token = ["liveliness_token"];
    let ask_for_tokens = ["liveliness_query", "declare_liveliness_subscriber"];
    let tokens = ["machines/*/*", "routes/*/*/*"];
    // Itself, and through a router; what it says to a router, that only leads on as said by it.
    let to_it = [
        format!("open/{name}/**"),
        format!("about/{name}/*"),
        format!("certificates/{name}/*"),
        format!("by/*/open/{name}/**"),
        format!("by/*/about/{name}/*"),
    ];
    let from_it = [
        format!("open/*/*/{name}/*"),
        "about/*/*".to_owned(),
        "certificates/*/*".to_owned(),
        format!("to/*/open/*/*/{name}/*"),
        "to/*/about/*/*".to_owned(),
    ];
    let told_of = [format!("links/*/*/{name}/*"), "by/**".to_owned(), "to/**".to_owned()];
    let links_to_it = [format!("links/{name}/**"), format!("by/*/links/{name}/**")];
    let links_from_it = [format!("links/*/*/{name}/*"), format!("to/*/links/*/*/{name}/*")];
    let rule = Rules(member);
    vec![
        rule.of("is there", &token, &["ingress"], &[format!("machines/{name}/*")]),
        rule.of("hears who is there", &token, &["egress"], &tokens),
        rule.of("asks who is there", &ask_for_tokens, &["ingress", "egress"], &tokens),
        rule.of("sends", &["put"], &["ingress"], &links_from_it),
        rule.of("receives", &["declare_subscriber"], &["ingress"], &links_to_it),
        rule.of("is sent to", &["put"], &["egress"], &links_to_it),
        // Others need not know of a subscription that is meant by one machine (`hearing.rs`).
        rule.of("is told", &["declare_subscriber"], &["egress"], &told_of),
        rule.of("asks", &["query"], &["ingress"], &from_it),
        rule.of("is answered", &["reply"], &["egress"], &from_it),
        rule.of("answers", &["reply", "declare_queryable"], &["ingress"], &to_it),
        rule.of("is asked", &["query"], &["egress"], &to_it),
        rule.of(
            "is offered answers",
            &["declare_queryable"],
            &["egress"],
            &["open/**", "about/*/*", "certificates/*/*", "by/**", "to/**"],
        ),
    ]
}

/// What a router may say besides: whom it reaches, and what it leads. It is sent what it is to lead.
fn router(member: &Member) -> [Value; 8] {
    let name = &member.name;
    let routes = [format!("routes/{name}/*/*")];
    let packets = [format!("to/{name}/links/**")];
    let questions = [format!("to/{name}/open/**"), format!("to/{name}/about/**")];
    let led_packets = [format!("by/{name}/links/**")];
    let led_questions = [format!("by/{name}/open/**"), format!("by/{name}/about/**")];
    let rule = Rules(member);
    [
        rule.of("reaches", &["liveliness_token"], &["ingress"], &routes),
        rule.of("takes packets", &["declare_subscriber"], &["ingress"], &packets),
        rule.of("is sent packets", &["put"], &["egress"], &packets),
        rule.of("leads packets", &["put"], &["ingress"], &led_packets),
        rule.of("takes questions", &["declare_queryable", "reply"], &["ingress"], &questions),
        rule.of("is sent questions", &["query"], &["egress"], &questions),
        rule.of("leads questions", &["query"], &["ingress"], &led_questions),
        rule.of("is sent answers", &["reply"], &["egress"], &led_questions),
    ]
}

/// The rules of one member.
struct Rules<'a>(&'a Member);

impl Rules<'_> {
    fn of(&self, what: &str, messages: &[&str], flows: &[&str], keys: &[impl AsRef<str>]) -> Value {
        let keys: Vec<_> = keys.iter().map(|key| format!("{ROOT}/{}", key.as_ref())).collect();
        rule(&format!("{} {what}", self.0.subject), messages, flows, &keys)
    }
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
