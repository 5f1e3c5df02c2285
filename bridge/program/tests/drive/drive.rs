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
