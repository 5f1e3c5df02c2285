use super::*;
use crate::messages::LoopCycle;
use serde_json::json;
use sidehill_bridge::ros2::message::cdr::to_cdr;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;
use std::time::Instant;
use tungstenite::client::IntoClientRequest;
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

const HERE: &str = "127.0.0.1:0";
/// Longest wait for what another thread does.
const LIMIT: Duration = Duration::from_secs(20);

fn here(token: Option<&str>) -> LiveAddress {
    LiveAddress {
        address: HERE.parse().unwrap(),
        token: token.map(str::to_owned),
    }
}

fn view() -> LiveView {
    let parameters = Values::from([("stages".to_owned(), serde_json::json!(40))]);
    LiveView::start(here(None), parameters).unwrap()
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
        ("file://", false),
        ("chrome-extension://abcdef", false),
        ("localhost", false),
        ("http://127.0.0.1.example.org:80", false),
        ("http://localhost:8080", true),
        ("https://127.0.0.1", true),
        ("http://[::1]:8765", true),
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
    let (view, control) = LiveView::start_playback(here(None), Values::new(), [5, 95]).unwrap();
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
    for i in 0..4 * door::QUEUE as u64 {
        view.put(Topic::Pose, i, &large);
    }
    assert!(view.dropped() > 0);
}

/// Sends a request and returns the whole answer.
fn request(view: &LiveView, target: &str) -> String {
    let mut stream = TcpStream::connect(view.address()).unwrap();
    stream.set_read_timeout(Some(LIMIT)).unwrap();
    let text = format!("GET {target} HTTP/1.1\r\nHost: {}\r\n\r\n", view.address());
    stream.write_all(text.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

/// Connects with a protocol and a query, or returns the status of the refusal.
fn open(
    view: &LiveView,
    protocol: &'static str,
    query: &str,
) -> Result<WebSocket<MaybeTlsStream<TcpStream>>, u16> {
    let url = format!("ws://{}/{query}", view.address());
    let mut request = url.into_client_request().unwrap();
    let name = tungstenite::http::HeaderValue::from_static(protocol);
    request.headers_mut().insert("Sec-WebSocket-Protocol", name);
    let stream = TcpStream::connect(view.address()).unwrap();
    stream.set_read_timeout(Some(LIMIT)).unwrap();
    match tungstenite::client::client(request, MaybeTlsStream::Plain(stream)) {
        Ok((socket, _)) => Ok(socket),
        Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(response))) => {
            Err(response.status().as_u16())
        }
        Err(error) => panic!("{error}"),
    }
}

/// Returns the next message of a page.
fn next(socket: &mut WebSocket<MaybeTlsStream<TcpStream>>) -> serde_json::Value {
    loop {
        match socket.read().unwrap() {
            Message::Text(text) => return serde_json::from_str(text.as_str()).unwrap(),
            Message::Ping(_) => {}
            other => panic!("{other:?}"),
        }
    }
}

/// Puts cycles of the loop, one a frame.
fn put_cycles(view: &mut LiveView, seconds: std::ops::Range<u64>) {
    for i in seconds.start * 5..seconds.end * 5 {
        let cycle = LoopCycle {
            state: "driving".to_owned(),
            traction_m_s: 0.01 * i as f64,
            ..LoopCycle::default()
        };
        view.put(Topic::LoopCycle, i * 200_000_000, &to_cdr(&cycle).unwrap());
    }
}

#[test]
fn a_browser_gets_a_page_that_needs_nothing_else() {
    let view = view();
    let answer = request(&view, "/");
    let (head, page) = answer.split_once("\r\n\r\n").unwrap();
    assert!(head.starts_with("HTTP/1.1 200 OK\r\n"), "{head}");
    assert!(head.contains("text/html"), "{head}");
    assert!(
        head.contains(&format!("Content-Length: {}", page.len())),
        "{head}"
    );
    assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</script>\n"));
    assert!(page.len() < 300_000);
    for elsewhere in [" src=", "@import", "url(", "fetch(", "//cdn"] {
        assert!(!page.contains(elsewhere), "{elsewhere}");
    }
    // The page sends nothing: it has no words for the server.
    assert!(!page.contains(".send("));
    assert!(request(&view, "/etc/passwd").starts_with("HTTP/1.1 404 "));
}

#[test]
fn a_page_gets_what_happens_and_cannot_say_anything() {
    let mut view = view();
    put_cycles(&mut view, 0..2);
    let mut socket = open(&view, page::PROTOCOL, "").unwrap();
    let first = next(&mut socket);
    let columns = first["hello"]["columns"].as_array().unwrap();
    let column = |name: &str| columns.iter().position(|column| column == name).unwrap();
    // A frame is made of what was known before its time.
    let frame = &first["frames"][0];
    assert_eq!(frame.as_array().unwrap().len(), columns.len());
    assert_eq!(frame[column("t")], json!(1.8));
    assert_eq!(frame[column("traction_command")], json!(0.08));
    let state = frame[column("state")].as_u64().unwrap() as usize;
    assert_eq!(first["hello"]["states"][state], "driving");
    assert_eq!(first["parts"]["status"]["state"], "driving");
    put_cycles(&mut view, 2..3);
    let begin = Instant::now();
    let newest = loop {
        let message = next(&mut socket);
        if let Some(frame) = message["frames"]
            .as_array()
            .and_then(|frames| frames.last())
        {
            break frame[0].clone();
        }
        assert!(begin.elapsed() < LIMIT);
    };
    assert_eq!(newest, json!(2.8));
    // Whatever it says, the connection ends.
    let arm = json!({ "op": "setParameters", "parameters": [{ "name": "stages", "value": 3 }] });
    socket.send(Message::text(arm.to_string())).unwrap();
    let begin = Instant::now();
    loop {
        assert!(begin.elapsed() < LIMIT);
        match socket.read() {
            Ok(Message::Text(text)) => assert!(!text.contains("stages"), "{text}"),
            Ok(Message::Ping(_)) => {}
            Ok(Message::Close(_)) | Err(_) => break,
            Ok(other) => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_page_gets_the_place_on_earth_also_after_a_player_has_gone_back() {
    let mut view = view();
    let datum = GeodeticOrigin {
        latitude_deg: 45.0,
        longitude_deg: 7.0,
        elevation_m: 0.0,
    };
    view.place(&datum);
    put_cycles(&mut view, 2..4);
    put_cycles(&mut view, 0..2);
    let first = next(&mut open(&view, page::PROTOCOL, "").unwrap());
    let earth: [[f64; 2]; 6] = serde_json::from_value(first["parts"]["earth"].clone()).unwrap();
    // Degrees of latitude and longitude on WGS 84 at 45 deg have 111,132 m and 78,847 m.
    assert!((1.0 / earth[2][0] - 111_132.0).abs() < 2.0, "{earth:?}");
    assert!((1.0 / earth[1][1] - 78_847.0).abs() < 2.0, "{earth:?}");
    for (x_m, y_m) in [
        (0.0, 0.0),
        (30.0, -40.0),
        (-6000.0, 8000.0),
        (7000.0, 7000.0),
    ] {
        let powers = [1.0, x_m, y_m, x_m * x_m, x_m * y_m, y_m * y_m];
        let [latitude, longitude] = [0, 1].map(|k| {
            earth
                .iter()
                .zip(powers)
                .map(|(term, power)| term[k] * power)
                .sum()
        });
        let place = datum.project(latitude, longitude);
        let aside_m = (place.x_m - x_m).hypot(place.y_m - y_m);
        assert!(aside_m < 0.05, "{aside_m} m at {x_m}, {y_m}");
    }
}

#[test]
fn a_monitoring_system_gets_metrics() {
    let mut view = view();
    put_cycles(&mut view, 0..2);
    let answer = request(&view, "/metrics");
    let (head, text) = answer.split_once("\r\n\r\n").unwrap();
    assert!(head.starts_with("HTTP/1.1 200 OK\r\n"), "{head}");
    let kind = "Content-Type: application/openmetrics-text; version=1.0.0; charset=utf-8\r\n";
    assert!(head.contains(kind), "{head}");
    assert!(
        head.contains(&format!("Content-Length: {}", text.len())),
        "{head}"
    );
    assert!(text.contains("\nsidehill_cycles_total 10\n"), "{text}");
    assert!(text.ends_with("# EOF\n"), "{text}");
}

#[test]
fn without_the_token_nothing_is_shown() {
    let view = LiveView::start(here(Some("correct-horse")), Values::new()).unwrap();
    for query in [
        "",
        "?token=",
        "?token=correct-horsf",
        "?token=correct-horse2",
        "?other=correct-horse",
    ] {
        for path in ["/", "/metrics"] {
            let answer = request(&view, &format!("{path}{query}"));
            assert!(answer.starts_with("HTTP/1.1 403 "), "{query}: {answer}");
            assert!(!answer.contains("# EOF"));
        }
        let answer = request(&view, &format!("/{query}"));
        assert!(!answer.contains("<script>") && !answer.contains("correct-horse"));
        for protocol in [page::PROTOCOL, protocol::NAMES[0], "other"] {
            assert_eq!(open(&view, protocol, query).err(), Some(403), "{query}");
        }
    }
    let query = "?since=x&token=correct-horse";
    assert!(request(&view, &format!("/{query}")).starts_with("HTTP/1.1 200 "));
    let mut socket = open(&view, page::PROTOCOL, query).unwrap();
    assert_eq!(
        next(&mut socket)["hello"]["run"]
            .as_str()
            .map(str::is_empty),
        Some(false)
    );
    assert!(open(&view, protocol::NAMES[1], query).is_ok());
    assert_eq!(open(&view, "other", query).err(), Some(400));
}

#[test]
fn clients_that_ask_for_nothing_lock_nobody_out() {
    let view = view();
    let mut idle: Vec<_> = (0..100)
        .map(|i| {
            let mut stream = TcpStream::connect(view.address()).unwrap();
            stream.set_read_timeout(Some(LIMIT)).unwrap();
            if i % 2 == 0 {
                stream.write_all(b"GET / HTTP/1.1\r\nHost: x\r\n").unwrap();
            }
            stream
        })
        .collect();
    let mut trickling = TcpStream::connect(view.address()).unwrap();
    assert!(request(&view, "/").starts_with("HTTP/1.1 200 "));
    let mut shown = open(&view, page::PROTOCOL, "").unwrap();
    next(&mut shown);
    drop(connect(&view));
    // Those that do not finish are let go, also one that says a little at a time.
    let begin = Instant::now();
    while trickling.write_all(b"GET / H".get(..1).unwrap()).is_ok() {
        assert!(begin.elapsed() < LIMIT);
        std::thread::sleep(Duration::from_millis(100));
    }
    for stream in &mut idle {
        let mut answer = [0; 16];
        assert!(matches!(stream.read(&mut answer), Ok(0) | Err(_)));
    }
}

#[test]
fn no_kind_of_client_takes_places_of_another() {
    let view = view();
    let foxglove: Vec<_> = (0..shared::CLIENTS_MAX).map(|_| connect(&view)).collect();
    assert_eq!(open(&view, protocol::NAMES[0], "").err(), Some(503));
    let mut pages: Vec<_> = (0..shared::CLIENTS_MAX)
        .map(|_| open(&view, page::PROTOCOL, "").unwrap())
        .collect();
    assert_eq!(open(&view, page::PROTOCOL, "").err(), Some(503));
    assert!(request(&view, "/").starts_with("HTTP/1.1 200 "));
    next(&mut pages[0]);
    drop((foxglove, pages));
    // A place is free again when its client has gone.
    drop(connect(&view));
}

#[test]
fn a_page_on_a_slow_link_gets_the_newest() {
    let mut view = view();
    put_cycles(&mut view, 0..1);
    let mut socket = open(&view, page::PROTOCOL, "").unwrap();
    next(&mut socket);
    // It does not answer while much happens.
    put_cycles(&mut view, 1..400);
    let message = loop {
        let message = next(&mut socket);
        if message["frames"].is_array() {
            break message;
        }
    };
    let frames = message["frames"].as_array().unwrap();
    assert!(frames.len() <= 5, "{}", frames.len());
    assert_eq!(frames.last().unwrap()[0], json!(399.8));
}
