use super::*;
use serde_json::json;
use std::io::Write;
use std::net::TcpStream;
use std::time::Instant;
use tungstenite::client::IntoClientRequest;
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

const HERE: &str = "127.0.0.1:0";
/// Longest wait for what another thread does.
const LIMIT: Duration = Duration::from_secs(20);

fn view() -> LiveView {
    let parameters = Values::from([("stages".to_owned(), serde_json::json!(40))]);
    LiveView::start(HERE.parse().unwrap(), parameters).unwrap()
}

fn connect(view: &LiveView) -> WebSocket<MaybeTlsStream<TcpStream>> {
    let begin = Instant::now();
    loop {
        // While others take all places, connections are closed.
        if let Some(socket) = try_connect(view) {
            return socket;
        }
        assert!(begin.elapsed() < LIMIT);
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn try_connect(view: &LiveView) -> Option<WebSocket<MaybeTlsStream<TcpStream>>> {
    let url = format!("ws://{}", view.address());
    let mut request = url.into_client_request().unwrap();
    let name = tungstenite::http::HeaderValue::from_static(protocol::NAMES[0]);
    request.headers_mut().insert("Sec-WebSocket-Protocol", name);
    let stream = TcpStream::connect(view.address()).unwrap();
    stream.set_read_timeout(Some(LIMIT)).unwrap();
    let stream = MaybeTlsStream::Plain(stream);
    let (mut socket, _) = tungstenite::client::client(request, stream).ok()?;
    for op in ["serverInfo", "advertise"] {
        let text = socket.read().unwrap().into_text().unwrap();
        assert!(text.contains(op), "{text}");
    }
    Some(socket)
}

fn subscribe(socket: &mut WebSocket<MaybeTlsStream<TcpStream>>, id: u32, topic: Topic) {
    let channel = Topic::ALL.iter().position(|other| *other == topic).unwrap();
    let text =
        format!(r#"{{"op":"subscribe","subscriptions":[{{"id":{id},"channelId":{channel}}}]}}"#);
    socket.send(Message::text(text)).unwrap();
}

/// Puts a message until the client has one.
fn put_until_wanted(view: &mut LiveView, topic: Topic, message: &[u8]) {
    let begin = Instant::now();
    let wanted = |view: &LiveView| {
        let clients = view.shared.clients.lock().unwrap();
        clients
            .iter()
            .any(|client| client.wanted.load(Ordering::Relaxed) & protocol::bit(topic) != 0)
    };
    while !wanted(view) {
        assert!(begin.elapsed() < LIMIT);
        std::thread::sleep(Duration::from_millis(5));
    }
    view.put(topic, 5, message);
}

#[test]
fn a_client_gets_what_it_wants_and_can_command_nothing() {
    let mut view = view();
    view.put(Topic::Path, 1, b"the path");
    view.put(Topic::Pose, 1, b"before anyone looked");
    let mut socket = connect(&view);
    subscribe(&mut socket, 9, Topic::Path);
    let latched = socket.read().unwrap().into_data();
    assert_eq!(latched.as_ref(), protocol::data(9, 1, b"the path"));
    subscribe(&mut socket, 4, Topic::Pose);
    put_until_wanted(&mut view, Topic::Pose, b"now");
    let data = socket.read().unwrap().into_data();
    assert_eq!(data.as_ref(), protocol::data(4, 5, b"now"));
    let set = r#"{"op":"setParameters","parameters":[{"name":"stages","value":3}],"id":"x"}"#;
    socket.send(Message::text(set)).unwrap();
    let refusal = socket.read().unwrap().into_text().unwrap();
    assert!(refusal.contains("stages is fixed"), "{refusal}");
    let values = socket.read().unwrap().into_text().unwrap();
    assert!(values.contains("\"value\":40"), "{values}");
    socket.send(Message::binary(vec![1, 2, 3])).unwrap();
    let refusal = socket.read().unwrap().into_text().unwrap();
    assert!(refusal.contains("nothing can be published"), "{refusal}");
}

/// Connects as a page from `origin` does.
fn connect_from(view: &LiveView, origin: &'static str) -> WebSocket<MaybeTlsStream<TcpStream>> {
    let url = format!("ws://{}", view.address());
    let mut request = url.into_client_request().unwrap();
    let headers = request.headers_mut();
    let name = tungstenite::http::HeaderValue::from_static(protocol::NAMES[0]);
    headers.insert("Sec-WebSocket-Protocol", name);
    let origin = tungstenite::http::HeaderValue::from_static(origin);
    headers.insert("Origin", origin);
    let stream = TcpStream::connect(view.address()).unwrap();
    stream.set_read_timeout(Some(LIMIT)).unwrap();
    let (mut socket, _) =
        tungstenite::client::client(request, MaybeTlsStream::Plain(stream)).unwrap();
    for _ in 0..2 {
        socket.read().unwrap();
    }
    socket
}

fn say(socket: &mut WebSocket<MaybeTlsStream<TcpStream>>, request: serde_json::Value) {
    socket.send(Message::text(request.to_string())).unwrap();
}

fn hear(socket: &mut WebSocket<MaybeTlsStream<TcpStream>>) -> serde_json::Value {
    let text = socket.read().unwrap().into_text().unwrap();
    serde_json::from_str(text.as_str()).unwrap()
}

fn set_speed(value: f64) -> serde_json::Value {
    let parameter = json!({ "name": "speed", "value": value, "type": "float64" });
    json!({ "op": "setParameters", "parameters": [parameter], "id": "1" })
}

/// Answers requests as an owner of a speed from 0 to 2 m/s until the view ends.
fn own_a_speed(view: &LiveView) {
    let (owner, shared) = (view.parameter_owner(), Arc::clone(&view.shared));
    owner.publish(Values::from([("speed".to_owned(), json!(1.0))]));
    std::thread::spawn(move || {
        while !shared.end.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
            let Some(request) = owner.next_request() else {
                continue;
            };
            let speed = request.values["speed"].as_f64().unwrap_or(f64::NAN);
            if (0.0..=2.0).contains(&speed) {
                owner.publish(request.values.clone());
                request.answer(Ok(()));
            } else {
                request.answer(Err(format!("speed: {speed} is out of range")));
            }
        }
    });
}

#[test]
fn parameters_are_set_by_their_owner_and_all_who_watch_are_told() {
    let view = view();
    own_a_speed(&view);
    let (mut one, mut other) = (connect(&view), connect(&view));
    let watch = json!({ "op": "subscribeParameterUpdates", "parameterNames": ["speed", "stages"] });
    say(&mut other, watch);
    // An answer says that the request before it was taken.
    say(
        &mut other,
        json!({ "op": "getParameters", "parameterNames": ["speed"], "id": "a" }),
    );
    let values = hear(&mut other);
    assert_eq!(values["parameters"][0]["value"], 1.0);
    assert_eq!(values["parameters"][0]["type"], "float64");
    say(&mut one, set_speed(1.5));
    let values = hear(&mut one);
    assert_eq!(
        (&values["id"], &values["parameters"][0]["value"]),
        (&json!("1"), &json!(1.5))
    );
    let update = hear(&mut other);
    assert_eq!(
        update["parameters"],
        json!([{ "name": "speed", "value": 1.5, "type": "float64" }])
    );
    say(&mut one, set_speed(7.0));
    let refusal = hear(&mut one);
    assert!(
        refusal["message"]
            .as_str()
            .unwrap()
            .contains("out of range"),
        "{refusal}"
    );
    assert_eq!(hear(&mut one)["parameters"][0]["value"], 1.5);
}

#[test]
fn pages_from_elsewhere_can_look_but_not_set() {
    let view = view();
    own_a_speed(&view);
    for (origin, may_set) in [
        ("https://example.org", false),
        ("http://localhost.example.org", false),
        ("null", false),
        ("http://localhost:8080", true),
        ("file://", true),
    ] {
        let mut socket = connect_from(&view, origin);
        say(&mut socket, set_speed(2.0));
        let answer = hear(&mut socket);
        let set = answer["op"] == "parameterValues";
        assert_eq!(set, may_set, "{origin}: {answer}");
    }
}

#[test]
fn playing_is_controlled_and_every_client_is_told() {
    let (view, control) =
        LiveView::start_playback(HERE.parse().unwrap(), Values::new(), [5, 95]).unwrap();
    let mut socket = connect(&view);
    let state = socket.read().unwrap().into_data();
    assert_eq!(state[..10], [5, 0, 5, 0, 0, 0, 0, 0, 0, 0]);
    let mut request = vec![3, 1, 0, 0, 0, 64, 1];
    request.extend(50_u64.to_le_bytes());
    request.extend([1, 0, 0, 0, b'x']);
    socket.send(Message::binary(request)).unwrap();
    let request = control.next_request(LIMIT).unwrap();
    let expected = PlaybackRequest {
        play: false,
        speed: 2.0,
        seek_ns: Some(50),
        id: "x".to_owned(),
    };
    assert_eq!(request, expected);
    view.tell(&PlaybackState {
        status: PlaybackStatus::Paused,
        time_ns: 50,
        speed: 2.0,
        sought: true,
        id: request.id,
    });
    let state = socket.read().unwrap().into_data();
    assert_eq!(state[..3], [5, 1, 50]);
    assert_eq!(state.last(), Some(&b'x'));
    // Nothing else of what is binary is a request.
    socket.send(Message::binary(vec![1, 2, 3])).unwrap();
    assert_eq!(hear(&mut socket)["op"], "status");
}

#[test]
fn garbage_many_connections_and_clients_that_do_not_read_hold_nobody_up() {
    let mut view = view();
    let mut garbage = TcpStream::connect(view.address()).unwrap();
    garbage.write_all(&[0xff; 4096]).unwrap();
    let crowd: Vec<_> = (0..100)
        .map(|_| TcpStream::connect(view.address()).unwrap())
        .collect();
    drop(crowd);
    drop(garbage);
    // Those that have gone are noticed, and there is place again.
    let mut slow = connect(&view);
    subscribe(&mut slow, 1, Topic::Pose);
    put_until_wanted(&mut view, Topic::Pose, b"first");
    let large = vec![0; 1 << 16];
    for i in 0..4 * QUEUE as u64 {
        view.put(Topic::Pose, i, &large);
    }
    assert!(view.dropped() > 0);
}
