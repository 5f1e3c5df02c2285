//! What systemd is told of a run.

use super::{SIMULATED, configuration};
use crate::running::Running;
use crate::sidehill;
use rustix::process::{Pid, Signal, kill_process};
use std::os::unix::net::UnixDatagram;
use std::process::Stdio;
use std::time::{Duration, Instant};

/// The next message; none after `longest`.
fn message(socket: &UnixDatagram, longest: Duration) -> Option<String> {
    let mut buffer = [0; 4096];
    socket.set_read_timeout(Some(longest)).unwrap();
    let count = socket.recv(&mut buffer).ok()?;
    Some(
        std::str::from_utf8(&buffer[..count])
            .unwrap()
            .trim()
            .to_owned(),
    )
}

#[test]
fn systemd_hears_that_it_is_ready_what_it_does_and_that_it_is_alive() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    let file = configuration("service", &SIMULATED);
    let mut run = Running::start(
        sidehill()
            .args(["run", file.to_str().unwrap(), "--format", "text"])
            .env("NOTIFY_SOCKET", &path)
            .env("WATCHDOG_USEC", "600000")
            .stdout(Stdio::null()),
    );
    let begun = Instant::now();
    let mut told: Vec<String> = Vec::new();
    let signs = |told: &[String]| told.iter().filter(|sign| *sign == "WATCHDOG=1").count();
    let state = |told: &[String]| {
        told.iter()
            .find(|state| state.starts_with("STATUS="))
            .cloned()
    };
    while signs(&told) < 5 || state(&told).is_none() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{told:?}");
        told.extend(message(&socket, Duration::from_secs(20)));
    }
    assert_eq!(told[0], "READY=1");
    let state = state(&told).unwrap();
    assert!(state.contains("waits for SIGUSR1 to arm"), "{state}");

    // A program that hangs is silent, once what it has sent is read.
    let id = Pid::from_raw(i32::try_from(run.0.id()).unwrap()).unwrap();
    kill_process(id, Signal::STOP).unwrap();
    while message(&socket, Duration::from_millis(500)).is_some() {
        assert!(begun.elapsed() < Duration::from_secs(60));
    }
    assert_eq!(message(&socket, Duration::from_secs(1)), None);
    kill_process(id, Signal::CONT).unwrap();
    kill_process(id, Signal::TERM).unwrap();
    assert_eq!(run.0.wait().unwrap().code(), Some(3));
}
