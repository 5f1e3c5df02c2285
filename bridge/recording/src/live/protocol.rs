//! The Foxglove WebSocket protocol, as far as a server that only shows needs it.

use super::parameters::{LiveParameters, Values, listed};
use crate::messages::Topic;
use serde::Deserialize;
use serde_json::{Value, json};

/// Names of the protocol that are understood; a client offers at least one of them.
pub(super) const NAMES: [&str; 2] = ["foxglove.websocket.v1", "foxglove.sdk.v1"];

/// What a client says; anything else is refused.
#[derive(Debug, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
pub(super) enum ClientRequest {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
    #[serde(rename_all = "camelCase")]
    GetParameters {
        #[serde(default)]
        parameter_names: Vec<String>,
        #[serde(default)]
        id: Option<String>,
    },
    SetParameters {
        parameters: Vec<ShownParameter>,
        #[serde(default)]
        id: Option<String>,
    },
    #[serde(rename_all = "camelCase")]
    SubscribeParameterUpdates {
        parameter_names: Vec<String>,
    },
    #[serde(rename_all = "camelCase")]
    UnsubscribeParameterUpdates {
        parameter_names: Vec<String>,
    },
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Subscription {
    pub(super) id: u32,
    pub(super) channel_id: u32,
}

/// A parameter that is to be set; without a value it is to be removed, which none can be.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct ShownParameter {
    pub(super) name: String,
    #[serde(default)]
    pub(super) value: Value,
}

/// Returns the bit of a topic in a set of topics.
pub(super) fn bit(topic: Topic) -> u32 {
    1 << channel(topic)
}

fn channel(topic: Topic) -> u32 {
    Topic::ALL
        .iter()
        .position(|other| *other == topic)
        .map_or(31, |index| index as u32)
}

/// Returns the topic of a channel.
pub(super) fn topic(channel_id: u32) -> Option<Topic> {
    Topic::ALL.get(usize::try_from(channel_id).ok()?).copied()
}

/// Returns the first message to a client; `range_ns` are the first and last times of a recording that is played.
pub(super) fn greeting(range_ns: Option<[u64; 2]>) -> [String; 2] {
    let mut info = json!({
        "op": "serverInfo",
        "name": format!("sidehill {}", env!("CARGO_PKG_VERSION")),
        "capabilities": ["parameters", "parametersSubscribe"],
        "supportedEncodings": [],
        "metadata": {},
        "sessionId": std::process::id().to_string(),
    });
    if let (Some([from_ns, to_ns]), Some(capabilities)) =
        (range_ns, info["capabilities"].as_array_mut())
    {
        capabilities.push(json!("playbackControl"));
        info["dataStartTime"] = instant(from_ns);
        info["dataEndTime"] = instant(to_ns);
    }
    let channels: Vec<Value> = Topic::ALL
        .into_iter()
        .map(|topic| {
            json!({
                "id": channel(topic),
                "topic": topic.name(),
                "encoding": "cdr",
                "schemaName": topic.type_name(),
                "schema": topic.schema(),
                "schemaEncoding": "ros2msg",
            })
        })
        .collect();
    let advertise = json!({ "op": "advertise", "channels": channels });
    [info.to_string(), advertise.to_string()]
}

fn instant(time_ns: u64) -> Value {
    const SECOND_NS: u64 = 1_000_000_000;
    json!({ "sec": time_ns / SECOND_NS, "nsec": time_ns % SECOND_NS })
}

/// Returns the parameters of these names, or all.
pub(super) fn parameters(all: &LiveParameters, names: &[String], id: Option<String>) -> String {
    parameter_values(&all.values(names), id)
}

/// Returns the message to a client with these values.
pub(super) fn parameter_values(values: &Values, id: Option<String>) -> String {
    let mut values = json!({ "op": "parameterValues", "parameters": listed(values) });
    if let Some(id) = id {
        values["id"] = Value::String(id);
    }
    values.to_string()
}

/// Returns the message to a client whose request is refused.
pub(super) fn refusal(reason: &str) -> String {
    json!({ "op": "status", "level": 1, "message": reason }).to_string()
}

/// Returns a message of a subscription as it is sent.
pub(super) fn data(subscription: u32, time_ns: u64, message: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(13 + message.len());
    bytes.push(1);
    bytes.extend(subscription.to_le_bytes());
    bytes.extend(time_ns.to_le_bytes());
    bytes.extend(message);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_topic_is_a_bit_and_a_channel() {
        let mut all = 0_u32;
        for kind in Topic::ALL {
            assert_eq!(all & bit(kind), 0);
            all |= bit(kind);
            assert_eq!(topic(channel(kind)), Some(kind));
        }
        assert_eq!(topic(99), None);
    }

    #[test]
    fn what_would_command_is_no_request() {
        for text in [
            r#"{"op":"advertise","channels":[]}"#,
            r#"{"op":"advertiseServices","services":[]}"#,
            r#"{"op":"publish"}"#,
            r#"{"subscriptions":[]}"#,
            "[]",
        ] {
            assert!(
                serde_json::from_str::<ClientRequest>(text).is_err(),
                "{text}"
            );
        }
        let text = r#"{"op":"subscribe","subscriptions":[{"id":7,"channelId":2}]}"#;
        let request: ClientRequest = serde_json::from_str(text).unwrap();
        assert!(matches!(request, ClientRequest::Subscribe { subscriptions }
            if subscriptions[0].id == 7 && subscriptions[0].channel_id == 2));
    }
}
