//! `sidehill can`: drives that are found and watched.

use super::cia402::{Peer, of_cia402, send_as_another};
use super::support::*;
use crate::program::sidehill;
use serde_json::Value;
use sidehill_can::frame::FrameId;
use std::process::Output;

fn config(folder: &Folder) -> String {
    configuration(folder, "run_vcan0.yaml", of_cia402)
}

fn can(arguments: &[&str]) -> Output {
    sidehill().arg("can").args(arguments).output().unwrap()
}

/// Runs a command and returns its status and its JSON.
fn json(arguments: &[&str]) -> (Option<i32>, Vec<Value>) {
    let output = can(&[arguments, &["--format", "json"]].concat());
    let text = String::from_utf8(output.stdout).unwrap();
    println!("{text}{}", String::from_utf8_lossy(&output.stderr));
    let lines = text.lines().map(|line| serde_json::from_str(line).unwrap());
    (output.status.code(), lines.collect())
}

/// Writes a data sheet, in Windows-1252, of the objects that the layout needs.
fn data_sheet(folder: &Folder) -> String {
    let mut text =
        b"[DeviceInfo]\r\nVendorName=M\xfcller\r\nVendorNumber=0x2B\r\nProductNumber=0x402\r\n"
            .to_vec();
    for (section, keys) in [
        ("1016", "DataType=7\r\nAccessType=rw\r\nCompactSubObj=1"),
        ("1017", "DataType=6\r\nAccessType=rw"),
        (
            "1400sub1",
            "DataType=7\r\nAccessType=rw\r\nDefaultValue=$NODEID+0x200",
        ),
        ("1400sub5", "DataType=6\r\nAccessType=rw"),
        ("1800sub5", "DataType=6\r\nAccessType=rw"),
        ("6007", "DataType=3\r\nAccessType=rw"),
        ("605A", "DataType=3\r\nAccessType=rw"),
        ("6060", "DataType=2\r\nAccessType=rw"),
        ("6502", "DataType=7\r\nAccessType=ro\r\nDefaultValue=0xA1"),
        ("6040", "DataType=6\r\nAccessType=rww\r\nPDOMapping=1"),
        ("6041", "DataType=6\r\nAccessType=ro\r\nPDOMapping=1"),
        ("606C", "DataType=4\r\nAccessType=ro\r\nPDOMapping=1"),
        ("60FF", "DataType=4\r\nAccessType=rww\r\nPDOMapping=1"),
    ] {
        text.extend(format!("[{section}]\r\n{keys}\r\n").bytes());
    }
    let path = folder.0.join("drive.eds");
    std::fs::write(&path, text).unwrap();
    path.display().to_string()
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_scan_finds_the_drives_and_says_who_they_are_and_what_was_wrong() {
    let folder = Folder::new("can_scan");
    let config = config(&folder);
    let (status, found) = json(&["scan", &config]);
    assert_eq!(
        (status, found[0]["nodes"].as_array().unwrap().len()),
        (Some(1), 0)
    );
    let complaints = found[0]["complaints"].to_string();
    assert!(complaints.contains("node 1, the traction drive of the configuration, is not there"));

    let mut peer = Peer::start(&folder, 0.0);
    peer.tell("fault steer");
    let (status, found) = json(&["scan", &config]);
    assert_eq!(status, Some(0));
    assert_eq!(found[0]["complaints"], Value::Array(Vec::new()));
    let nodes = &found[0]["nodes"];
    assert_eq!(nodes.as_array().unwrap().len(), 2);
    let (traction, steer) = (&nodes[0], &nodes[1]);
    assert_eq!(
        (&traction["node"], &traction["role"]),
        (&1.into(), &"traction".into())
    );
    assert_eq!(
        (&steer["node"], &steer["role"]),
        (&2.into(), &"steer".into())
    );
    for (node, serial) in [(traction, 1001), (steer, 1002)] {
        assert_eq!(node["device"], "servo drive (CiA 402)");
        assert_eq!(
            (&node["vendor"], &node["product"]),
            (&0x2A.into(), &0x402.into())
        );
        assert_eq!(
            (&node["serial"], &node["cia402"]),
            (&serial.into(), &true.into())
        );
    }
    assert_eq!(traction["errors"], Value::Array(Vec::new()));
    assert_eq!(
        (&steer["power"], &steer["error_register"]),
        (&"fault".into(), &5.into())
    );
    let error = serde_json::json!([{"code": 0x3210, "meaning": "DC link over-voltage"}]);
    assert_eq!(steer["errors"], error);
    // Nothing has been written: the drives are as they were.
    assert_eq!(
        (&traction["power"], &traction["mode"]),
        (&"switch_on_disabled".into(), &0.into())
    );
    let table = can(&["scan", "--interface", BUS]);
    let table = String::from_utf8(table.stdout).unwrap();
    println!("{table}");
    for part in [
        "vcan0, no bit rate: 2 nodes",
        "servo drive (CiA 402)",
        "fault, no mode",
        "error register 0x05: generic, voltage",
        "error 0x3210: DC link over-voltage",
    ] {
        assert!(table.contains(part), "no `{part}`");
    }

    // By the maker's file: the vendor is another, the steer drive lacks a mode.
    let (status, found) = json(&["scan", &config, "--eds", &data_sheet(&folder)]);
    assert_eq!(status, Some(1));
    let complaints = found[0]["complaints"].to_string();
    for part in [
        "node 2 is product 0x402 of vendor 0x2A, and",
        "is of product 0x402 of vendor 0x2B",
        "object 0x6060 is to be mode 3, and object 0x6502 has modes 1, 6, 8",
    ] {
        assert!(complaints.contains(part), "no `{part}`: {complaints}");
    }
    drop(peer);

    // The virtual drives, while a controller has set them up.
    let folder = Folder::new("can_scan_virtual");
    let _vehicle = Program::vehicle_changed(&folder, of_cia402);
    let _run = Program::run_changed(&folder, of_cia402, &[]);
    sleep_s(3.0);
    let (status, found) = json(&["scan", &config]);
    assert_eq!(status, Some(0));
    assert_eq!(found[0]["nodes"][0]["nmt"], "operational");
    assert_eq!(found[0]["nodes"][0]["mode"], 3);
    let complaints = found[0]["complaints"].to_string();
    assert!(complaints.contains("node 127 is there and has the number of this program"));
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_bus_that_is_not_there_or_down_is_named_with_what_to_do() {
    let _folder = Folder::new("can_scan_down");
    ip(&["link", "set", BUS, "down"]);
    let output = can(&["scan", "--interface", BUS]);
    let complaint = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{complaint}");
    assert!(complaint.contains("vcan0: the interface is down: ip link set vcan0 up"));
    let output = can(&["scan", "--interface", "nocan7"]);
    let complaint = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{complaint}");
    assert!(complaint.contains("nocan7: there is no such interface"));
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_monitor_tells_what_the_drives_do_and_sends_nothing() {
    let folder = Folder::new("can_monitor");
    let config = config(&folder);
    let mut peer = Peer::start(&folder, 0.0);
    // Everything that a controller or a client sends.
    let sent = [0x000, 0x077F, 0x201, 0x202, 0x601, 0x602].map(FrameId::Standard);
    let observer = Observer::watch(&sent, |frame| {
        let moves = frame.length == 6 && frame.data[2..] != [0; 6];
        Some((moves, !moves))
    });
    let (status, lines) = json(&["monitor", &config, "--duration-s", "2.5"]);
    assert_eq!(status, Some(0));
    assert!((2..5).contains(&lines.len()), "{}", lines.len());
    assert_eq!(lines[1]["controller"], Value::Null);
    assert!(observer.seen().is_empty(), "a monitor sends nothing");

    let run = Program::run_changed(&folder, of_cia402, &["--arm"]);
    wait_until("a drive", || observer.seen().iter().any(|seen| seen.enable));
    let monitor = std::thread::spawn({
        let config = config.clone();
        move || json(&["monitor", &config, "--duration-s", "4"]).1
    });
    sleep_s(2.0);
    peer.tell("fault steer");
    let lines = monitor.join().unwrap();
    drop(run);
    let all = |says: &dyn Fn(&Value) -> bool| lines.iter().any(says);
    assert!(all(&|line| line["controller"] == "operational"));
    assert!(all(&|line| {
        let drive = &line["drives"][0];
        let turns = drive["speed_m_s"].as_f64().unwrap_or(0.0);
        drive["nmt"] == "operational"
            && drive["power"] == "operation_enabled"
            && drive["mode"] == 3
            && turns > 0.1
            // 940 rpm in 1 m/s.
            && (drive["speed_rad_s"].as_f64().unwrap() / turns - 98.44).abs() < 0.01
            && drive["commanded_m_s"].as_f64().unwrap() > 0.1
            && drive["reports_s"].as_f64().unwrap() > 20.0
    }));
    assert!(all(
        &|line| line["bits_s"].as_f64().unwrap() > 10_000.0 && line["lost"] == 0
    ));
    assert!(all(&|line| {
        line["emergencies"][0]["meaning"] == "DC link over-voltage"
            && line["emergencies"][0]["node"] == 2
    }));
    assert!(all(&|line| line["drives"][1]["power"] == "fault"));

    // Text on change, and the end by a signal.
    let monitor = Program::can_monitor(&folder, &config);
    wait_until("text", || monitor.output().contains("steer    node 2:"));
    send_as_another("082#2010090000000000");
    wait_until("an emergency", || {
        let told = "node 2: emergency 0x1020, error register 0x09: generic error";
        monitor.output().contains(told)
    });
    monitor.signal(Signal::INT);
    assert_eq!(monitor.end(), Some(0));
}
