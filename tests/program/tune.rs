//! `sidehill tune`: better settings or none, and nothing lost by a kill.

use crate::{assert_says, fail, repository, sidehill, succeed};
use serde_json::Value;
use std::path::PathBuf;
use std::process::Command;

/// A folder with a campaign whose controller hardly corrects errors.
struct Bad {
    folder: tempfile::TempDir,
}

impl Bad {
    fn new() -> Self {
        let bad = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        let text = format!(
            "name: bad\n\
             seed: 3\n\
             runs: 100\n\
             controllers: [icrik-mpc]\n\
             scenario: {}\n\
             with:\n\
             \x20 course: {{shape: slalom, length_m: 3, amplitude_m: 0.3, wavelength_m: 3, speed_m_s: 0.5}}\n\
             \x20 controller: {{weights: {{cross_per_m2: 1}}}}\n\
             draws:\n\
             \x20 - {{key: start.right_m, uniform: [-0.3, 0.3]}}\n",
            repository("config/scenarios/slalom.yaml").display()
        );
        std::fs::write(bad.path("bad.yaml"), text).unwrap();
        bad
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    /// Returns a search of one weight with a small budget.
    fn command(&self, out: &str, arguments: &[&str]) -> Command {
        let mut command = self.plain(out);
        command
            .args("--training 4 --held-out 8 --tries 6 --key weights.cross_per_m2".split(' '))
            .args(arguments);
        command
    }

    fn plain(&self, out: &str) -> Command {
        let mut command = sidehill();
        command.arg("tune").arg(self.path("bad.yaml"));
        command.arg("--out").arg(self.path(out));
        command
    }
}

#[test]
fn better_settings_are_conditions_with_their_evidence() {
    let bad = Bad::new();
    let report = bad.path("report.html");
    let mut command = bad.command("tuned.yaml", &["--format", "json", "--report"]);
    let printed: Value = serde_json::from_str(&succeed(command.arg(&report))).unwrap();
    assert_eq!(printed["improved"], true);
    let setting = &printed["settings"][0];
    let after = setting["after"].as_f64().unwrap();
    assert!(setting["key"] == "weights.cross_per_m2" && setting["before"] == 1.0 && after > 1.2);
    let (before_m, after_m) = (
        printed["held_out"]["before"]["median_m"].as_f64().unwrap(),
        printed["held_out"]["after"]["median_m"].as_f64().unwrap(),
    );
    assert!(after_m < before_m);

    let tuned = bad.text("tuned.yaml");
    assert_says(
        &tuned,
        &[
            "# Better: in 8 runs that the search has not seen",
            "# weights.cross_per_m2",
            &format!("cross_per_m2: {after}"),
        ],
    );
    // The file contains conditions, and a complete page shows the same.
    succeed(sidehill().arg("check").arg(bad.path("tuned.yaml")));
    let page = bad.text("report.html");
    assert!(page.starts_with("<!DOCTYPE html>") && page.trim_end().ends_with("</script>"));
    assert_says(
        &page,
        &["Better: in 8 runs", &format!("{:.2}", 100.0 * after_m)],
    );

    // Existing files are kept.
    let refused = fail(&mut bad.command("tuned.yaml", &[]));
    assert_says(&refused, &["tuned.yaml: exists already"]);
}

#[test]
fn a_recording_judges_settings_of_the_estimator() {
    let bad = Bad::new();
    let scenario = bad.path("drive.yaml");
    let text = format!(
        "name: drive\n\
         vehicle: {}\n\
         terrain: {{kind: plane, slope_deg: 8, uphill_heading_deg: 60}}\n\
         course: {{shape: figure_eight, half_width_m: 2.4, half_length_m: 3.9, period_s: 40}}\n\
         laps: 3\n\
         controllers: [icrik-mpc]\n\
         plant: contact\n\
         seed: 1\n\
         step_s: 0.005\n",
        repository("config/vehicles/j8.yaml").display()
    );
    std::fs::write(&scenario, text).unwrap();
    // Realistic noise, and an estimator that learns next to nothing.
    let realistic =
        std::fs::read_to_string(repository("config/conditions/realistic.yaml")).unwrap();
    let conditions = bad.path("conditions.yaml");
    let deaf = realistic.replace(
        "pose_sigma_rad: 0.0087",
        "pose_sigma_rad: 0.0087\n    adaptation: {slope_sigma: 0.001}",
    );
    assert_ne!(deaf, realistic);
    std::fs::write(&conditions, deaf).unwrap();
    let drive = bad.path("drive.mcap");
    let mut simulate = sidehill();
    simulate.arg("simulate").arg(&scenario);
    simulate
        .arg("--conditions")
        .arg(&conditions)
        .arg("--record");
    // The drive may end early; the recording is there.
    simulate.arg(&drive).output().unwrap();
    let tune = |arguments: &[&str]| {
        let mut command = sidehill();
        command.arg("tune").arg(&drive).arg("--out");
        command.arg(bad.path("found.yaml")).args(arguments);
        command
    };
    let key = "estimator.adaptation.slope_sigma";
    let report = bad.path("report.html");
    let mut arguments = vec!["--key", key, "--factor", "1000", "--tries", "12"];
    arguments.extend(["--format", "json"]);
    let printed = succeed(tune(&arguments).arg("--report").arg(&report));
    let printed: Value = serde_json::from_str(&printed).unwrap();
    assert_eq!(
        (&printed["improved"], &printed["subject"]),
        (&true.into(), &"recording".into())
    );
    let after = printed["settings"][0]["after"].as_f64().unwrap();
    assert!(after > 0.01, "{printed}");
    let held_out = &printed["held_out"];
    assert!(held_out["runs"]["start"] == printed["training"]["runs"]["end"]);
    let of = |which: &str, figure: &str| held_out[which][figure].as_f64().unwrap();
    for figure in ["median_m", "p95_m"] {
        let share = of("after", figure) / of("before", figure);
        assert!(share < 0.85, "{figure} {share}: {printed}");
    }
    assert_says(&bad.text("found.yaml"), &[&format!("slope_sigma: {after}")]);
    assert_says(
        &bad.text("report.html"),
        &["judge them by another recording", "uPlot"],
    );
    let refused = fail(&mut tune(&["--force", "--key", "weights.cross_per_m2"]));
    assert_says(
        &refused,
        &["--key weights.cross_per_m2", "scenario or campaign"],
    );
    let refused = fail(&mut tune(&[
        "--force",
        "--training",
        "2",
        "--held-out",
        "120",
    ]));
    assert_says(&refused, &["drive.mcap", "at least 8"]);
}

#[test]
fn a_search_goes_on_where_it_was_killed() {
    let bad = Bad::new();
    let whole = succeed(&mut bad.command("whole.yaml", &["--format", "json"]));
    let lines = bad.text("whole.tried.csv");
    let kept: Vec<&str> = lines.split_inclusive('\n').collect();
    assert!(kept.len() >= 2 + 4, "{lines}");
    // Two trials, and an incomplete third.
    let torn = format!("{}{}", kept[..4].concat(), &kept[4][..5]);
    std::fs::write(bad.path("killed.tried.csv"), torn).unwrap();
    let again = succeed(&mut bad.command("killed.yaml", &["--format", "json", "--threads", "1"]));
    assert_eq!(again, whole);
    assert_eq!(bad.text("killed.tried.csv"), lines);
    assert_eq!(bad.text("killed.yaml"), bad.text("whole.yaml"));

    // Trials of another search are rejected.
    let refused = fail(&mut bad.command("killed.yaml", &["--force", "--calmness", "0.5"]));
    assert_says(&refused, &["killed.tried.csv: made by another search"]);
    let changed = lines.replacen(kept[3], &kept[3].replacen("1.", "1.0001", 1), 1);
    std::fs::write(bad.path("whole.tried.csv"), changed).unwrap();
    let refused = fail(&mut bad.command("whole.yaml", &["--force"]));
    assert_says(&refused, &["whole.tried.csv: try 2 is another"]);
}

#[test]
fn without_proof_nothing_is_written() {
    let bad = Bad::new();
    // No time for a trial: only the present settings were evaluated.
    let output = bad
        .command("tuned.yaml", &["--minutes", "0.001"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let printed = String::from_utf8_lossy(&output.stdout);
    assert_says(&printed, &["Not shown to be better"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_says(
        &said,
        &["tuned.yaml: not written, the present settings stay"],
    );
    assert!(!bad.path("tuned.yaml").exists());
}

#[test]
fn what_is_wrong_is_named_before_anything_runs() {
    let bad = Bad::new();
    for (arguments, part) in [
        (
            "--factor 1",
            "--factor: 1 is out of range, must be from 1.01",
        ),
        ("--training 1", "--training: 1 is out of range"),
        ("--held-out 0", "--held-out: 0 is out of range"),
        ("--tries 0", "--tries: 0 is out of range"),
        ("--minutes NaN", "--minutes: NaN is out of range"),
        ("--threads 0", "--threads: 0 is out of range"),
        (
            "--key weights.cross",
            "weights.cross: there is no such setting",
        ),
        ("--key stages", "stages: 40 is a whole number"),
        (
            "--key weights.cross_per_m2 --key weights.cross_per_m2",
            "weights.cross_per_m2: given twice",
        ),
        ("--key memory", "memory: null is no positive number"),
        ("--controller mpc", "mpc"),
        (
            "--report /none/report.html",
            "/none/report.html: cannot be written",
        ),
    ] {
        let said = fail(bad.plain("tuned.yaml").args(arguments.split(' ')));
        assert_says(&said, &[part]);
    }
    assert!(!bad.path("tuned.yaml").exists());
}

#[test]
fn equal_runs_prove_nothing() {
    let bad = Bad::new();
    let campaign = bad
        .text("bad.yaml")
        .replace("uniform: [-0.3, 0.3]", "one_of: [0.2]");
    std::fs::write(bad.path("bad.yaml"), campaign).unwrap();
    let says = fail(&mut bad.command("equal.yaml", &[]));
    assert_says(&says, &["its 4 training runs are equal", "noise"]);
    assert!(!bad.path("equal.yaml").exists());
}
