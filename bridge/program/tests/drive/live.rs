//! The live page of a drive, fetched as a browser does.

use super::running::Running;
use super::{SIMULATED, configuration, repository, run_to_end, sidehill};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Longest wait for an answer.
const WAIT: Duration = Duration::from_secs(60);
/// What a browser asks for to open the socket of the page; the key is that of RFC 6455, section 1.3.
const UPGRADE: &str = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
                       Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: sidehill.page.v1\r\n";

/// An empty pong of a client, masked with zeros (RFC 6455, section 5.5.3).
const PONG: [u8; 6] = [0x8a, 0x80, 0, 0, 0, 0];

/// Sends a request and returns what is answered until a text is in it, or all.
fn ask(host: &str, target: &str, headers: &str, until: &str) -> String {
    let mut stream = TcpStream::connect(host).unwrap();
    stream.set_read_timeout(Some(WAIT)).unwrap();
    let request = format!("GET {target} HTTP/1.1\r\nHost: {host}\r\n{headers}\r\n");
    stream.write_all(request.as_bytes()).unwrap();
    let (mut answer, mut bytes) = (Vec::new(), [0; 4096]);
    loop {
        let text = String::from_utf8_lossy(&answer);
        let count = if !until.is_empty() && text.contains(until) {
            0
        } else {
            stream.read(&mut bytes).unwrap()
        };
        if count == 0 {
            return text.into_owned();
        }
        answer.extend(&bytes[..count]);
        if !until.is_empty() {
            // The server asks after each message whether it has arrived.
            stream.write_all(&PONG).unwrap();
        }
    }
}

#[test]
fn a_drive_is_shown_on_a_page_to_who_knows_the_token() {
    let file = configuration("live_page", &SIMULATED);
    let mut command: Command = sidehill();
    command
        .args(["run", file.to_str().unwrap(), "--arm"])
        .args(["--live", "127.0.0.1:0", "--token", "--duration-s", "60"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    let mut run = Running::start(&mut command);
    let errors = BufReader::new(run.0.stderr.take().unwrap());
    let mut lines = errors.lines();
    let line = lines
        .find_map(|line| Some(line.ok()?.strip_prefix("live view: http://")?.to_owned()))
        .unwrap();
    // The rest is read so that nothing waits for it.
    std::thread::spawn(move || lines.for_each(drop));
    let (host, rest) = line.split_once('/').unwrap();
    let target = format!("/{}", rest.split(' ').next().unwrap());
    assert!(target.len() > "/?token=".len() + 8, "{target}");

    let page = ask(host, &target, "", "");
    assert!(page.starts_with("HTTP/1.1 200 OK\r\n"), "{page}");
    assert!(page.contains("Sidehill") && page.ends_with("</script>\n"));
    let stream = ask(host, &target, UPGRADE, "\"state\":\"driving\"");
    assert!(stream.starts_with("HTTP/1.1 101 "), "{stream}");
    // RFC 6455 has this answer to its key.
    assert!(stream.contains("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), "{stream}");
    for part in ["\"hello\":", "\"frames\":[[", "\"path\":[", "\"vehicle\":{"] {
        assert!(stream.contains(part), "{part}");
    }
    let metrics = loop {
        // Diagnostics come once a second.
        let text = ask(host, &target.replacen('/', "/metrics", 1), "", "");
        if text.contains("sidehill_cross_track_meters") {
            break text;
        }
        std::thread::sleep(Duration::from_millis(100));
    };
    assert_all_panels_have_data(&metrics);
    for headers in ["", UPGRADE] {
        for target in ["/", "/metrics", "/?token=", "/?token=0000000000"] {
            let refused = ask(host, target, headers, "");
            assert!(refused.starts_with("HTTP/1.1 403 "), "{refused}");
        }
    }
}

/// Asserts that each query of the dashboard for Grafana asks for metrics that there are.
fn assert_all_panels_have_data(metrics: &str) {
    let text = std::fs::read_to_string(repository("bridge/package/grafana_dashboard.json"));
    let dashboard: serde_json::Value = serde_json::from_str(&text.unwrap()).unwrap();
    for panel in dashboard["panels"].as_array().unwrap() {
        let targets = panel["targets"].as_array().unwrap();
        assert!(!targets.is_empty(), "{panel}");
        for target in targets {
            let query = target["expr"].as_str().unwrap();
            let mut words = query.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
            let name = words.find(|word| word.starts_with("sidehill_")).unwrap();
            let sample = |line: &str| line.split([' ', '{']).next() == Some(name);
            assert!(metrics.lines().any(sample), "{query}\n{metrics}");
        }
    }
}

#[test]
fn an_address_of_the_network_needs_a_token() {
    let file = configuration("live_token", &SIMULATED);
    for (arguments, reason) in [
        (&["--live", "0.0.0.0:0"][..], "add --token"),
        (&["--live", "[::]:0"], "add --token"),
        (&["--live", "0.0.0.0:0", "--token", "short"], "8 or more"),
        (
            &["--live", "127.0.0.1:0", "--token", "with&sign=1"],
            "letters",
        ),
        (&["--token", "long-enough"], "--live"),
    ] {
        let all = [&["run", file.to_str().unwrap()][..], arguments].concat();
        let output = run_to_end(&all);
        let errors = String::from_utf8(output.stderr).unwrap();
        assert!(errors.contains(reason), "{errors}");
        assert_ne!(output.status.code(), Some(0));
    }
}
