//! A virtual rover is driven to the end.

use super::{SIMULATED, configuration, run_to_end};

#[test]
fn a_simulated_vehicle_is_driven_in_real_time() {
    // The longest possible time-outs, because other tests may keep the machine busy.
    let file = configuration("simulated", &SIMULATED);
    let recording = file.with_file_name("drive.mcap");
    let recording = recording.to_str().unwrap();
    let page = file.with_file_name("drive.html");
    let output = run_to_end(&[
        "run",
        file.to_str().unwrap(),
        "--arm",
        "--log-level",
        "debug",
        "--duration-s",
        "6",
        "--record",
        recording,
        "--report",
        page.to_str().unwrap(),
        "--force",
    ]);
    let text = String::from_utf8(output.stdout).unwrap();
    let events = String::from_utf8(output.stderr).unwrap();
    let lines: Vec<serde_json::Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let (ending, cycles) = lines.split_last().unwrap();
    assert_eq!(ending["ended"], "time_over", "{text}\n{events}");
    assert_eq!(output.status.code(), Some(0));
    let position = |line: &serde_json::Value| {
        let value = |key: &str| line[key].as_f64();
        Some([value("x_m")?, value("y_m")?])
    };
    let positions: Vec<[f64; 2]> = cycles.iter().filter_map(position).collect();
    let [first, last] = [positions.first(), positions.last()].map(|found| found.unwrap());
    let driven_m = f64::hypot(last[0] - first[0], last[1] - first[1]);
    // The course begins at 0.5 m/s, and at least 3 s of the 6 s are driven.
    assert!(driven_m > 0.5, "{driven_m} m\n{text}\n{events}");
    // Standing, arming and driving are replayed as they were.
    let output = run_to_end(&["replay", recording, "--format", "json"]);
    let replayed: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(replayed["different"], 0, "{replayed}");
    assert!(replayed["cycles"].as_u64().unwrap() > 100, "{replayed}");
    assert_eq!(output.status.code(), Some(0));
    // The page at the end has the figures that `report` finds.
    let output = run_to_end(&["report", recording, "--format", "json"]);
    let facts: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let page = std::fs::read_to_string(page).unwrap();
    let held = page.split_once("<script id=\"facts\" type=\"application/json\">");
    let (held, _) = held.unwrap().1.split_once("</script>").unwrap();
    assert_eq!(
        serde_json::from_str::<serde_json::Value>(held).unwrap(),
        facts
    );
    let stops = facts["stops"].as_array().unwrap();
    assert_eq!(stops.len(), 1, "{facts}");
    assert_eq!(stops[0]["kind"], "asked");
    assert_eq!(stops[0]["cause"], "the time limit of the run is reached");
    // A chord is no longer than the way.
    let distance_m = facts["driven"]["distance_m"].as_f64().unwrap();
    assert!(distance_m > 0.9 * driven_m, "{facts}, {driven_m} m");
}

#[test]
fn a_route_is_driven_at_its_speeds_and_its_actions_are_events() {
    let file = configuration("route_with_actions", &SIMULATED);
    let text = std::fs::read_to_string(&file).unwrap();
    let course = "course: {shape: figure_eight}";
    assert!(text.contains(course));
    std::fs::write(&file, text.replace(course, "route: {file: route.csv}")).unwrap();
    // The last action is where the vehicle stops. It starts at the origin and looks along (0.776, 0.631).
    let rows = [
        (0.0, "", ""),
        (0.5, "", "\"gate, left\""),
        (1.0, "0.2", ""),
        (1.6, "5", "probe"),
        (2.6, "", "gate"),
    ];
    let rows = rows.map(|(at_m, speed, action)| {
        let (x_m, y_m) = (0.776 * at_m, 0.631 * at_m);
        format!("{x_m},{y_m},{speed},{action}\n")
    });
    let route = format!("x_m,y_m,speed_m_s,action\n{}", rows.concat());
    std::fs::write(file.with_file_name("route.csv"), route).unwrap();
    let out = file.with_file_name("run");
    let recording = file.with_file_name("drive.mcap");
    let output = run_to_end(&[
        "run",
        file.to_str().unwrap(),
        "--arm",
        "--format",
        "text",
        "--duration-s",
        "60",
        "--out",
        out.to_str().unwrap(),
        "--record",
        recording.to_str().unwrap(),
        "--force",
    ]);
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("ended: finished"), "{said}");
    let expected = ["gate, left", "probe", "gate"];
    let shown: Vec<&str> = said
        .lines()
        .filter_map(|line| line.split_once("s  action: ").map(|(_, text)| text))
        .collect();
    assert_eq!(shown, expected, "{said}");
    let events = std::fs::read_to_string(out.join("events.jsonl")).unwrap();
    let events: Vec<serde_json::Value> = events
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .filter(|event: &serde_json::Value| event["event"] == "action")
        .collect();
    let reasons: Vec<&str> = events
        .iter()
        .map(|e| e["reason"].as_str().unwrap())
        .collect();
    assert_eq!(reasons, expected);
    // Each is told in the cycle in which the vehicle passes.
    let mut rows = csv::Reader::from_path(out.join("cycles.csv")).unwrap();
    let header = rows.headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|column| column == name).unwrap();
    let columns = ["time_s", "arc_length_m", "traction_m_s"].map(column);
    let rows: Vec<[f64; 3]> = rows
        .records()
        .map(|row| {
            let row = row.unwrap();
            columns.map(|column| row[column].parse().unwrap_or(f64::NAN))
        })
        .collect();
    for (event, at_m) in events.iter().zip([0.5, 1.6, 2.6]) {
        let time_s = event["time_s"].as_f64().unwrap();
        let row = rows.iter().find(|row| row[0] == time_s).unwrap();
        assert!((row[1] - at_m).abs() < 0.1, "{event}: {row:?}");
    }
    let fastest = |from_m: f64, to_m: f64| {
        let driven = rows.iter().filter(|row| (from_m..to_m).contains(&row[1]));
        driven.map(|row| row[2]).fold(0.0, f64::max)
    };
    assert!(
        (0.1..0.21).contains(&fastest(1.0, 1.6)),
        "{}",
        fastest(1.0, 1.6)
    );
    assert!(fastest(1.8, 2.6) > 0.3);
    // The recorded path has its speeds: the commands are the same again.
    let replayed = run_to_end(&["replay", recording.to_str().unwrap(), "--format", "json"]);
    let replayed: serde_json::Value = serde_json::from_slice(&replayed.stdout).unwrap();
    assert_eq!(replayed["different"], 0, "{replayed}");
}

#[test]
fn a_route_is_driven_on_wheels() {
    let changes = [
        ("run_vcan0.yaml", "port: can", "port: simulated"),
        (
            "run_vcan0.yaml",
            "vehicles/j8.yaml",
            "vehicles/j8_contact_identified.yaml",
        ),
        (
            "run_vcan0.yaml",
            "course: {shape: figure_eight}",
            "route: {file: ../route.csv}",
        ),
        (
            "vehicle_vcan0.yaml",
            "scenario: ../scenarios/figure_eight.yaml",
            "scenario: ../scenarios/across_slope.yaml",
        ),
        ("vehicle_vcan0.yaml", "# plant: contact", "plant: contact"),
    ];
    let file = configuration("route_on_wheels", &changes);
    let route = "x_m,y_m\n0,0\n0.5,0\n1,0\n1.5,0\n2,0\n";
    std::fs::write(
        file.parent().unwrap().parent().unwrap().join("route.csv"),
        route,
    )
    .unwrap();
    let output = run_to_end(&["run", file.to_str().unwrap(), "--arm", "--duration-s", "30"]);
    let text = String::from_utf8(output.stdout).unwrap();
    let events = String::from_utf8(output.stderr).unwrap();
    let ending = text.lines().last().unwrap();
    assert!(
        ending.contains("\"ended\":\"finished\""),
        "{text}\n{events}"
    );
}
