//! The state of a federation as one JSON object; docs/howto/top.md says what is in it.

use hprm_core::Tag;
use serde_json::{Value, json};

use super::federation::{Federation, Member};
use super::rates::{Flow, flows, tag_rate};
use super::why::{Part, Wait};

/// Everything.
pub(crate) fn object(before: Option<&Federation>, now: &Federation, only: Option<usize>) -> Value {
    let shown = (0..now.members.len()).filter(|number| only.is_none_or(|only| only == *number));
    let federates: Vec<_> = shown.map(|number| federate(before, now, number)).collect();
    let name = only.map(|only| now.members[only].name.as_str());
    let flows = flows(before, now);
    let connections: Vec<_> = flows
        .iter()
        .filter(|flow| name.is_none_or(|name| flow.from == name || flow.to == name))
        .map(connection)
        .collect();
    let rti = now.rti.as_ref().map(|rti| {
        json!({
            "process": rti.process.pid,
            "host": rti.process.host,
            "does": now.doing(Part::Rti).text,
            "state": now.doing(Part::Rti).kind.word(),
        })
    });
    json!({
        "federation": now.name,
        "id": now.id,
        "coordination": if now.centralized { "centralized" } else { "decentralized" },
        "elapsed_ns": now.elapsed(),
        "rti": rti,
        "federates": federates,
        "connections": connections,
    })
}

fn federate(before: Option<&Federation>, now: &Federation, number: usize) -> Value {
    let Member { name, process, board, restarts, .. } = &now.members[number];
    let part = Part::Federate(number);
    let doing = now.doing(part);
    let chain = now.chain(part);
    let titles: Vec<_> = chain.iter().map(|part| title(now, *part)).collect();
    let waits: Vec<_> = doing.waits.iter().map(|it| wait(now, it)).collect();
    let mut object = json!({
        "name": name,
        "process": process.as_ref().map(|it| it.pid),
        "host": process.as_ref().map(|it| &it.host),
        "state": doing.kind.word(),
        "restarts": restarts,
        "does": doing.text,
        "waits_for": waits,
        "chain": titles,
        "cause": titles.last(),
    });
    let Some(board) = board else { return object };
    let state = &board.state;
    let holders = state.store.held.iter().map(|(by, bytes)| {
        let name = now.members.get(usize::from(*by)).map(|it| it.name.as_str());
        json!({ "federate": name, "bytes": bytes })
    });
    let reactions = board.reactions.iter().filter(|_| board.begun.is_some());
    let more = json!({
        "tag": tag(board.tag()),
        "next_tag": tag(Some(state.next).filter(|next| *next < Tag::FOREVER)),
        "lag_ns": board.lag(),
        "tags": state.tags,
        "tags_per_second": before.and_then(|before| tag_rate(before, now, number)),
        "reactions": reactions
            .map(|it| json!({ "name": it.label, "place": it.place }))
            .collect::<Vec<_>>(),
        "reacts_for_ns": board.begun.map(|(_, since)| board.ago(since)),
        "tardy": state.tardy,
        "dropped": state.dropped,
        "store": {
            "in_use": state.store.in_use,
            "mapped": state.store.mapped,
            "limit": state.store.limit,
            "found_no_room": state.store.fallbacks,
            "held": holders.collect::<Vec<_>>(),
        },
    });
    if let (Value::Object(object), Value::Object(more)) = (&mut object, more) {
        object.extend(more);
    }
    object
}

fn connection(flow: &Flow) -> Value {
    json!({
        "from": flow.name.from_port,
        "to": flow.name.to_port,
        "from_federate": flow.from,
        "to_federate": flow.to,
        "physical": flow.name.physical,
        "messages": flow.messages,
        "bytes": flow.bytes,
        "last_tag": tag(flow.last),
        "messages_per_second": flow.message_rate,
        "bytes_per_second": flow.byte_rate,
        "in_transit": flow.in_transit,
    })
}

fn wait(federation: &Federation, wait: &Wait) -> Value {
    let on: Vec<_> = wait.on.iter().map(|part| title(federation, *part)).collect();
    json!({ "kind": wait.kind, "text": wait.text, "on": on })
}

fn title(federation: &Federation, part: Part) -> &str {
    match part {
        Part::Federate(_) => federation.title(part),
        Part::Rti => "RTI",
    }
}

fn tag(tag: Option<Tag>) -> Value {
    tag.map_or(Value::Null, |tag| json!({ "time_ns": tag.time, "microstep": tag.microstep }))
}
