//! `sidehill campaign`: nothing lost, nothing twice, every row again by `simulate`.

use crate::{assert_says, fail, repository, sidehill, succeed};
use serde_json::Value;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A folder with a campaign of short runs in it.
struct Short {
    folder: tempfile::TempDir,
}

impl Short {
    fn new(draws: &str) -> Self {
        let short = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        short.write(
            "scenario.yaml",
            &format!(
                "name: base\n\
                 vehicle: {}\n\
                 terrain: {{kind: plane, slope_deg: 0, uphill_heading_deg: 60}}\n\
                 course: {{shape: straight, length_m: 2, speed_m_s: 0.5}}\n\
                 controllers: [icrik-mpc]\n\
                 plant: icrik\n\
                 seed: 1\n\
                 step_s: 0.005\n",
                repository("config/vehicles/j8.yaml").display()
            ),
        );
        short.campaign(1, draws);
        short
    }

    fn campaign(&self, seed: u32, draws: &str) {
        self.write(
            "campaign.yaml",
            &format!(
                "name: short\n\
                 seed: {seed}\n\
                 runs: 30\n\
                 controllers: [icrik-mpc, pure-pursuit]\n\
                 scenario: scenario.yaml\n\
                 conditions: realistic\n\
                 draws: [{draws}]\n"
            ),
        );
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    fn command(&self, out: &str, arguments: &[&str]) -> Command {
        let mut command = sidehill();
        command
            .arg("campaign")
            .arg(self.path("campaign.yaml"))
            .arg("--out")
            .arg(self.path(out))
            .args(arguments);
        command
    }

    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    /// The lines of a file, sorted: threads finish in any order.
    fn rows(&self, name: &str) -> Vec<String> {
        let mut rows: Vec<String> = self.text(name).lines().map(str::to_owned).collect();
        rows.sort();
        rows
    }

    fn records(&self, name: &str) -> Vec<std::collections::BTreeMap<String, String>> {
        let mut reader = csv::Reader::from_path(self.path(name)).unwrap();
        reader.deserialize().map(Result::unwrap).collect()
    }
}

const DRAWS: &str = "{key: terrain.slope_deg, uniform: [0, 10]}, \
     {key: course.length_m, one_of: [1.5, 2.5]}, {key: start.right_m, uniform: [-0.2, 0.2]}";

#[test]
fn a_killed_campaign_is_resumed_without_a_row_lost_or_twice() {
    let short = Short::new(DRAWS);
    succeed(&mut short.command("whole.csv", &["--threads", "2"]));
    assert_eq!(short.rows("whole.csv").len(), 1 + 30 * 2);

    let mut child = short
        .command("killed.csv", &["--threads", "2"])
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let begin = Instant::now();
    let lines =
        || std::fs::read_to_string(short.path("killed.csv")).map_or(0, |text| text.lines().count());
    while lines() < 6 {
        assert!(begin.elapsed() < Duration::from_secs(120), "no rows come");
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let held = lines();
    assert!((6..61).contains(&held), "{held} lines when it was killed");
    // What a kill in the middle of a write would have left.
    let text = short.text("killed.csv");
    let torn = text.trim_end().len() - 7;
    std::fs::write(short.path("killed.csv"), &text[..torn]).unwrap();

    succeed(&mut short.command("killed.csv", &[]));
    assert_eq!(short.rows("killed.csv"), short.rows("whole.csv"));
    // Nothing is left to do.
    succeed(&mut short.command("killed.csv", &[]));
    assert_eq!(short.rows("killed.csv"), short.rows("whole.csv"));
}

#[test]
fn one_thread_and_two_give_the_same_and_fewer_runs_are_the_first() {
    let short = Short::new(DRAWS);
    succeed(&mut short.command("one.csv", &["--threads", "1", "--runs", "6"]));
    succeed(&mut short.command("two.csv", &["--threads", "2", "--runs", "6"]));
    assert_eq!(short.rows("one.csv"), short.rows("two.csv"));
    succeed(&mut short.command("one.csv", &["--runs", "8"]));
    let longer = short.rows("one.csv");
    assert_eq!(longer.len(), 1 + 8 * 2);
    assert!(short.rows("two.csv").iter().all(|row| longer.contains(row)));
}

#[test]
fn a_row_run_alone_by_simulate_gives_the_same_figures() {
    let short = Short::new(DRAWS);
    succeed(&mut short.command("all.csv", &["--runs", "4"]));
    succeed(&mut short.command("elsewhere.yaml", &["--write-scenario", "3"]));
    let json = succeed(
        sidehill()
            .arg("simulate")
            .arg(short.path("elsewhere.yaml"))
            .args(["--format", "json"]),
    );
    let again: Value = serde_json::from_str(&json).unwrap();
    let again = again["runs"].as_array().unwrap();
    assert_eq!(again.len(), 2);
    let rows = short.records("all.csv");
    for run in again {
        let row = rows
            .iter()
            .find(|row| row["index"] == "3" && run["controller"] == row["controller"].as_str())
            .unwrap();
        assert_eq!(run["seed"].to_string(), row["seed"]);
        for figure in [
            "cross_track_rms_m",
            "cross_track_p95_m",
            "along_track_rms_m",
            "heading_rms_rad",
            "steer_total_variation_m_s",
            "goal_error_m",
        ] {
            let of_row: f64 = row[figure].parse().unwrap();
            assert_eq!(run[figure].as_f64().unwrap(), of_row, "{figure}");
            assert!(of_row.is_finite());
        }
    }
}

#[test]
fn a_run_that_cannot_start_is_a_row_with_its_reason() {
    let short = Short::new("{key: start.right_m, uniform: [200, 300]}");
    let table = succeed(&mut short.command("bad.csv", &["--runs", "3"]));
    assert_says(&table, &["icrik-mpc", "0.0 %"]);
    let rows = short.records("bad.csv");
    assert_eq!(rows.len(), 6);
    for row in rows {
        assert_eq!(row["completed"], "false");
        assert_says(&row["ended_by"], &["start.right_m", "from -100 to 100 m"]);
        assert_eq!(row["cross_track_rms_m"], "");
    }
}

#[test]
fn results_of_another_campaign_are_not_mixed_in() {
    let short = Short::new(DRAWS);
    succeed(&mut short.command("mine.csv", &["--runs", "1"]));
    let before = short.text("mine.csv");
    short.campaign(2, DRAWS);
    let message = fail(&mut short.command("mine.csv", &["--runs", "1"]));
    assert_says(&message, &["mine.csv", "fingerprint"]);
    short.campaign(1, "{key: start.right_m, uniform: [0, 0.1]}");
    let message = fail(&mut short.command("mine.csv", &["--runs", "1"]));
    assert_says(&message, &["mine.csv", "columns"]);
    assert_eq!(short.text("mine.csv"), before);
}

#[test]
fn what_is_wrong_with_a_campaign_is_named() {
    let short = Short::new("{key: terrain.slop_deg, uniform: [0, 1]}");
    let message = fail(&mut short.command("none.csv", &[]));
    assert_says(&message, &["campaign.yaml", "slop_deg"]);
    short.campaign(1, "{key: start.right_m, uniform: [1, 0]}");
    let message = fail(&mut short.command("none.csv", &[]));
    assert_says(&message, &["campaign.yaml", "start.right_m", "in order"]);
    assert!(!short.path("none.csv").exists());
}
