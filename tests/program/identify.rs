//! `sidehill identify --contact` on the logs of `sidehill simulate --out`.

use crate::{assert_says, repository, sidehill, succeed};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// What moved the vehicle: `config/vehicles/j8_contact.yaml`, with c_l and c_r of `j8.yaml`.
const TRUTH: [(&str, f64); 10] = [
    ("correction_left", 1.004),
    ("correction_right", 1.011),
    ("friction", 0.9),
    ("centre_of_mass_right_m", -0.034),
    ("centre_of_mass_forward_m", 0.193),
    ("centre_of_mass_height_m", 0.4),
    ("inner_load_share", 0.743),
    ("lateral_share", 1.0),
    ("slip_scale_m_s", 0.02),
    ("rolling_resistance", 0.02),
];

/// Returns the log of a scenario driven on wheels with friction.
fn log(scenario: &str, folder: &Path) -> PathBuf {
    let out = folder.join(scenario);
    let file = repository(&format!("config/scenarios/{scenario}.yaml"));
    succeed(
        sidehill()
            .arg("simulate")
            .arg(file)
            .args(["--plant", "contact", "--controller", "icrhk-mpc", "--out"])
            .arg(&out),
    );
    out.join("icrhk-mpc.csv")
}

/// Returns what identification prints, from the base rectangle alone.
fn identify(logs: &[&PathBuf], folder: &Path, format: &str) -> String {
    succeed(
        sidehill()
            .args(["identify", "--contact", "--segment-s", "2", "--force"])
            .args(["--format", format, "--slope"])
            .args(logs)
            .arg("--vehicle")
            .arg(repository("config/vehicles/j8.yaml"))
            .arg("--out")
            .arg(folder.join("found.yaml")),
    )
}

#[test]
fn the_wheels_come_back_within_their_intervals_and_what_is_not_told_apart_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let figure_eight = log("figure_eight", folder.path());
    let slalom = log("slalom", folder.path());

    // One course at one slope: loads and lateral share do the same to it.
    let alone = identify(&[&figure_eight], folder.path(), "table");
    assert_says(
        &alone,
        &["cannot tell apart inner_load_share and lateral_share"],
    );
    let both = identify(&[&figure_eight, &slalom], folder.path(), "json");
    let figures: Value = serde_json::from_str(&both).unwrap();
    let contact = &figures["contact"];
    assert_eq!(contact["settled"], true);
    assert_eq!(contact["not_told_apart"].as_array().unwrap().len(), 0);
    let mut inside = 0;
    for (name, truth) in TRUTH {
        let estimate = &contact["estimates"][name];
        let ends: Vec<f64> = serde_json::from_value(estimate["interval_95"].clone()).unwrap();
        let value = estimate["value"].as_f64().unwrap();
        assert_eq!(estimate["determined"], true, "{name}: {estimate}");
        inside += usize::from((ends[0]..=ends[1]).contains(&truth));
        // Intervals of 95 % may miss a truth, but not by far.
        let half_width = 0.5 * (ends[1] - ends[0]);
        assert!(
            (value - truth).abs() < 2.0 * half_width,
            "{name}: {estimate}"
        );
    }
    assert!(inside >= 9, "{inside} of {}: {contact}", TRUTH.len());

    // What is found is what contact-mpc starts from.
    let text = std::fs::read_to_string(folder.path().join("found.yaml")).unwrap();
    let vehicle: Value = serde_yaml::from_str(&text).unwrap();
    let found = vehicle["contact"]["friction"].as_f64().unwrap();
    let printed = contact["estimates"]["friction"]["value"].as_f64().unwrap();
    assert!((found - printed).abs() < 1e-9, "{found} {printed}");
}
