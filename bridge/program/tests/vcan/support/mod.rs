//! Folders, programs, an observer of the bus, and faults of the bus, for the tests on a real one.

use crate::program::{repository, sidehill};
use crate::running::Running;
pub use rustix::process::Signal;
use serde_json::Value;
use sidehill::config::{ConfigFile, load_layout};
use sidehill_can::layout::Layout;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// The interface of all tests.
pub const BUS: &str = "vcan0";

mod adapter;
mod observer;
mod truth;
pub use adapter::Adapter;
pub use observer::{Observer, Seen};
pub use truth::{Truth, cross_track_rms_m, standing_after_s};

/// Tolerance on documented limits for a 100 Hz scheduler, s.
pub const TOLERANCE_S: f64 = 0.06;

/// A folder for the files of one test.
pub struct Folder(pub PathBuf);

impl Folder {
    /// Makes an empty folder and a bus that works.
    pub fn new(name: &str) -> Self {
        assert!(
            std::env::var_os("SIDEHILL_VCAN").is_some(),
            "this test changes network interfaces and runs under its own kernel: use .ci/vcan"
        );
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
            .join("vcan")
            .join(name);
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        ensure_bus();
        Self(folder)
    }

    /// Returns the true states that the virtual vehicle wrote.
    pub fn truth(&self) -> Vec<Truth> {
        csv::Reader::from_path(self.0.join("truth.csv"))
            .unwrap()
            .deserialize()
            .collect::<Result<_, _>>()
            .unwrap()
    }

    /// Returns the times of the controller's first and last cycle, s.
    pub fn cycle_times_s(&self) -> (f64, f64) {
        let mut cycles = csv::Reader::from_path(self.0.join("run/cycles.csv")).unwrap();
        let headers = cycles.headers().unwrap();
        let column = headers.iter().position(|name| name == "time_s").unwrap();
        let times_s: Vec<f64> = cycles
            .records()
            .map(|row| row.unwrap()[column].parse().unwrap())
            .collect();
        (times_s[0], *times_s.last().unwrap())
    }

    /// Returns the controller's events.
    pub fn events(&self) -> String {
        std::fs::read_to_string(self.0.join("run/events.jsonl")).unwrap()
    }
}

impl Drop for Folder {
    /// Prints the programs' output if the test has failed.
    fn drop(&mut self) {
        if !std::thread::panicking() {
            return;
        }
        for name in ["run/events.jsonl", "run.out", "vehicle.out"] {
            if let Ok(text) = std::fs::read_to_string(self.0.join(name)) {
                println!("{name} of {}:\n{text}", self.0.display());
            }
        }
    }
}

/// Makes the bus if it is gone, and switches it on.
pub fn ensure_bus() {
    if !Path::new("/sys/class/net").join(BUS).exists() {
        ip(&["link", "add", BUS, "type", "vcan"]);
    }
    ip(&["link", "set", BUS, "up"]);
}

/// Runs `ip`.
pub fn ip(arguments: &[&str]) {
    command("ip", arguments);
}

/// Runs a command that must succeed.
pub fn command(name: &str, arguments: &[&str]) {
    let status = Command::new(name).args(arguments).status().unwrap();
    assert!(status.success(), "{name} {arguments:?}: {status}");
}

/// A running `sidehill`; killed where it is dropped.
pub struct Program {
    process: Running,
    output: PathBuf,
}

impl Program {
    /// Starts a virtual vehicle; `faults` is YAML, a list.
    pub fn vehicle(folder: &Folder, faults: &str) -> Self {
        let faults = if faults.is_empty() { "[]" } else { faults };
        Self::vehicle_changed(folder, |text| {
            text.replace("faults: []", &format!("faults: {faults}"))
        })
    }

    /// Starts a virtual vehicle with a changed configuration.
    pub fn vehicle_changed(folder: &Folder, change: impl Fn(String) -> String) -> Self {
        let config = configuration(folder, "vehicle_vcan0.yaml", change);
        let truth = folder.0.join("truth.csv");
        let arguments = ["vehicle", &config, "--truth", &truth.display().to_string()];
        Self::start(folder, "vehicle.out", &arguments)
    }

    /// Starts a controller on an interface; `arguments` are added.
    pub fn run_on(folder: &Folder, interface: &str, arguments: &[&str]) -> Self {
        let change =
            |text: String| text.replace("interface: vcan0", &format!("interface: {interface}"));
        Self::run_changed(folder, change, arguments)
    }

    /// Starts a controller with a changed configuration.
    pub fn run_changed(
        folder: &Folder,
        change: impl Fn(String) -> String,
        arguments: &[&str],
    ) -> Self {
        let config = configuration(folder, "run_vcan0.yaml", change);
        let out = folder.0.join("run").display().to_string();
        let mut all = vec!["run", &config, "--out", &out];
        all.extend(arguments);
        Self::start(folder, "run.out", &all)
    }

    /// Starts a controller.
    pub fn run(folder: &Folder, arguments: &[&str]) -> Self {
        Self::run_on(folder, BUS, arguments)
    }

    /// Starts a controller that takes its paths over ROS 2 in a domain. It has real-time priority, as
    /// on a vehicle: the kernel has one CPU for all that talk to it.
    pub fn run_for_goals(folder: &Folder, domain: u16) -> Self {
        let config = configuration(folder, "run_can_ros2.yaml", |text| {
            assert!(text.contains("# realtime: {fifo_priority: 50, "));
            text.replace("# realtime: {", "realtime: {")
                .replace("cpu: 1", "cpu: 0")
        });
        let out = folder.0.join("run").display().to_string();
        let domain = domain.to_string();
        let environment = [
            ("ROS_DOMAIN_ID", domain.as_str()),
            ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp"),
        ];
        let arguments = ["run", &config, "--out", &out];
        Self::start_with(folder, "run.out", &arguments, &environment)
    }

    /// Starts `can monitor` with text.
    pub fn can_monitor(folder: &Folder, config: &str) -> Self {
        let arguments = ["can", "monitor", config, "--format", "text"];
        Self::start(folder, "monitor.out", &arguments)
    }

    fn start(folder: &Folder, output: &str, arguments: &[&str]) -> Self {
        Self::start_with(folder, output, arguments, &[])
    }

    fn start_with(
        folder: &Folder,
        output: &str,
        arguments: &[&str],
        environment: &[(&str, &str)],
    ) -> Self {
        let output = folder.0.join(output);
        let file = File::create(&output).unwrap();
        let process = Running::start(
            sidehill()
                .args(arguments)
                .envs(environment.iter().copied())
                .stdin(Stdio::null())
                .stderr(file.try_clone().unwrap())
                .stdout(file),
        );
        Self { process, output }
    }

    /// Sends a signal.
    pub fn signal(&self, signal: Signal) {
        let id = rustix::process::Pid::from_raw(self.process.0.id() as i32).unwrap();
        rustix::process::kill_process(id, signal).unwrap();
    }

    /// Returns its output.
    pub fn output(&self) -> String {
        std::fs::read_to_string(&self.output).unwrap()
    }

    /// Process number.
    pub fn id(&self) -> u32 {
        self.process.0.id()
    }

    /// Number of the thread of this name.
    pub fn thread(&self, name: &str) -> u32 {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.id())).unwrap();
        tasks
            .map(|task| task.unwrap())
            .find(|task| {
                let comm = std::fs::read_to_string(task.path().join("comm"));
                comm.is_ok_and(|comm| comm.trim() == name)
            })
            .unwrap_or_else(|| panic!("no thread {name}"))
            .file_name()
            .to_string_lossy()
            .parse()
            .unwrap()
    }

    /// Waits for the end and returns the exit status.
    pub fn end(mut self) -> Option<i32> {
        wait_until("end", || self.process.0.try_wait().unwrap().is_some());
        self.process.0.wait().unwrap().code()
    }

    /// Waits for the end and returns the last line of the output.
    pub fn wait(mut self, at_most: Duration) -> Value {
        let start = Instant::now();
        while self.process.0.try_wait().unwrap().is_none() {
            let text = || std::fs::read_to_string(&self.output).unwrap();
            assert!(start.elapsed() < at_most, "did not end:\n{}", text());
            std::thread::sleep(Duration::from_millis(50));
        }
        let text = std::fs::read_to_string(&self.output).unwrap();
        let last = text.lines().last().unwrap_or_default();
        serde_json::from_str(last).unwrap_or_else(|error| panic!("{error}:\n{text}"))
    }
}

/// Writes a configuration of the repository into the folder, with absolute names and changes.
pub fn configuration(folder: &Folder, name: &str, change: impl Fn(String) -> String) -> String {
    let text = crate::configuration::configuration(&format!("bridge/{name}"));
    let layout = repository("config/bridge/can.yaml");
    let text = text.replace("can: can.yaml", &format!("can: {}", layout.display()));
    let file = folder.0.join(name);
    std::fs::write(&file, change(text)).unwrap();
    file.display().to_string()
}

/// The layout of the repository.
pub fn layout() -> Layout {
    let file = repository("config/bridge/can.yaml");
    load_layout(&ConfigFile::read(&file).unwrap()).unwrap()
}

/// Now, s since 1970.
pub fn unix_now_s() -> f64 {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap()
        .as_secs_f64()
}

/// Waits until something holds.
pub fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < Duration::from_secs(20), "no {what}");
        sleep_s(0.02);
    }
}

/// Sleeps.
pub fn sleep_s(seconds: f64) {
    std::thread::sleep(Duration::from_secs_f64(seconds));
}

/// Runs a script of this folder.
pub fn python(script: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new("python3");
    command
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .arg(repository("bridge/program/tests/vcan/support").join(script))
        .args(arguments);
    command
}

/// Returns a database of the repository.
pub fn database(name: &str) -> String {
    repository("config/bridge").join(name).display().to_string()
}

/// Lets cantools decode the log of the bus by a database and compare it with the program's own log.
pub fn decode_with_cantools(folder: &Folder, name: &str) {
    let file = |name: &str| folder.0.join("run").join(name).display().to_string();
    let (candump, cycles) = (file("candump.log"), file("cycles.csv"));
    let output = python("compare_logs.py", &[&database(name), &candump, &cycles])
        .output()
        .unwrap();
    println!("{}", String::from_utf8_lossy(&output.stdout));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cantools disagrees: {errors}");
}
