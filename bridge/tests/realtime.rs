//! What the system is asked for, as the kernel itself tells it afterwards.
#![allow(clippy::unwrap_used)]

use sidehill_bridge::control_loop::scheduling::{RealtimeConfig, RealtimeError};

/// Scheduling policy and real-time priority of the calling thread.
fn policy_and_priority() -> (u32, u32) {
    let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
    // The name, in parentheses, may have spaces; the state, field 3, follows it.
    let fields: Vec<&str> = stat
        .rsplit_once(')')
        .unwrap()
        .1
        .split_whitespace()
        .collect();
    (
        fields[41 - 3].parse().unwrap(),
        fields[40 - 3].parse().unwrap(),
    )
}

fn status(key: &str) -> String {
    let status = std::fs::read_to_string("/proc/thread-self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with(key)).unwrap();
    line[key.len()..].trim().to_owned()
}

fn locked_kb() -> u64 {
    status("VmLck:").trim_end_matches(" kB").parse().unwrap()
}

/// Applies a part in a thread of its own.
fn applied<T: Send + 'static>(
    config: RealtimeConfig,
    look: impl FnOnce() -> T + Send + 'static,
) -> (Result<(), RealtimeError>, T) {
    std::thread::spawn(move || (config.apply_to_loop(), look()))
        .join()
        .unwrap()
}

/// Where this machine permits a part, the kernel shows it; where it does not, the message says what
/// to do, and this test which part was not seen.
#[test]
fn each_part_is_applied_or_refused_with_what_to_do() {
    const SCHED_FIFO: u32 = 1;
    let config = RealtimeConfig::default;
    let (result, seen) = applied(
        RealtimeConfig {
            fifo_priority: Some(7),
            ..config()
        },
        policy_and_priority,
    );
    match result {
        Ok(()) => assert_eq!(seen, (SCHED_FIFO, 7)),
        Err(error) => {
            assert_ne!(seen.0, SCHED_FIFO);
            assert!(error.to_string().contains("CAP_SYS_NICE"), "{error}");
            println!("lacking on this machine: {error}");
        }
    }

    let allowed = status("Cpus_allowed_list:");
    let first: usize = allowed.split([',', '-']).next().unwrap().parse().unwrap();
    let (result, seen) = applied(
        RealtimeConfig {
            cpu: Some(first),
            ..config()
        },
        || status("Cpus_allowed_list:"),
    );
    // A thread may always keep to one of the CPUs that it has.
    result.unwrap();
    assert_eq!(seen, first.to_string());
    assert_eq!(
        status("Cpus_allowed_list:"),
        allowed,
        "the other threads keep theirs"
    );
    let (result, seen) = applied(
        RealtimeConfig {
            cpu: Some(1023),
            ..config()
        },
        || status("Cpus_allowed_list:"),
    );
    let error = result.unwrap_err().to_string();
    assert!(error.contains("CPU 1023 is not available"), "{error}");
    assert_eq!(seen, allowed);

    let (result, seen) = applied(
        RealtimeConfig {
            lock_memory: true,
            ..config()
        },
        locked_kb,
    );
    match result {
        Ok(()) => assert!(seen > 1000, "{seen} kB"),
        Err(error) => {
            assert!(error.to_string().contains("CAP_IPC_LOCK"), "{error}");
            println!("lacking on this machine: {error}");
        }
    }
}

#[test]
fn settings_out_of_range_are_named() {
    for fifo_priority in [0, 100, 255] {
        let config = RealtimeConfig {
            fifo_priority: Some(fifo_priority),
            ..RealtimeConfig::default()
        };
        let (result, _) = applied(config, || ());
        let error = result.unwrap_err().to_string();
        assert!(error.contains("realtime.fifo_priority"), "{error}");
    }
}
