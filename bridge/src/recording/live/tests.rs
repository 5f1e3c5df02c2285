use super::*;
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
    let parameters = BTreeMap::from([("stages".to_owned(), serde_json::json!(40))]);
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
fn a_client_gets_what_it_wants_and_can_set_nothing() {
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
    assert!(refusal.contains("cannot be set"), "{refusal}");
    let values = socket.read().unwrap().into_text().unwrap();
    assert!(values.contains("\"value\":40"), "{values}");
    socket.send(Message::binary(vec![1, 2, 3])).unwrap();
    let refusal = socket.read().unwrap().into_text().unwrap();
    assert!(refusal.contains("nothing can be published"), "{refusal}");
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
