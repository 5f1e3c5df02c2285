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

    fn rows(&self, name: &str) -> Vec<String> {
        self.text(name).lines().map(str::to_owned).collect()
    }

    fn merge(&self, parts: &[&str], out: &str) -> Command {
        let mut command = sidehill();
        command
            .args(["campaign", "--merge"])
            .args(parts.iter().map(|part| self.path(part)))
            .arg("--out")
            .arg(self.path(out));
        command
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
    // What a kill in the middle of a write would leave.
    let text = short.text("killed.csv");
    let torn = text.trim_end().len() - 7;
    std::fs::write(short.path("killed.csv"), &text[..torn]).unwrap();

    succeed(&mut short.command("killed.csv", &[]));
    assert_eq!(short.text("killed.csv"), short.text("whole.csv"));
    // Nothing is left to do.
    succeed(&mut short.command("killed.csv", &[]));
    assert_eq!(short.text("killed.csv"), short.text("whole.csv"));
}

#[test]
fn parts_merge_into_the_file_of_one_machine() {
    let short = Short::new(DRAWS);
    succeed(&mut short.command("whole.csv", &["--runs", "12"]));
    // The first and second overlap, and the last one comes first.
    for (name, range) in [("a.csv", "7..12"), ("b.csv", "0..4"), ("c.csv", "3..7")] {
        let table = succeed(&mut short.command(name, &["--range", range]));
        assert_says(&table, &["icrik-mpc", "100.0 %"]);
    }
    assert_eq!(short.rows("c.csv").len(), 1 + 4 * 2);
    succeed(&mut short.merge(&["a.csv", "b.csv", "c.csv"], "merged.csv"));
    assert_eq!(short.text("merged.csv"), short.text("whole.csv"));
    // Without --out the result goes to standard output, without the incomplete last line.
    let text = short.text("b.csv");
    short.write("torn.csv", &text[..text.len() - 7]);
    let printed = sidehill()
        .args(["campaign", "--merge"])
        .args(["torn.csv", "c.csv", "a.csv"].map(|part| short.path(part)))
        .output()
        .unwrap();
    assert!(printed.status.success());
    assert_eq!(printed.stdout, short.text("whole.csv").as_bytes());
    assert_says(&crate::stderr(&printed), &["torn.csv", "torn"]);
    // Existing rows of `--out` are kept.
    succeed(&mut short.merge(&["b.csv"], "c.csv"));
    let both = short.text("c.csv");
    assert_eq!(both, short.text("whole.csv")[..both.len()]);
    assert_eq!(both.lines().count(), 1 + 7 * 2);
    // `campaign` continues from a merged file.
    succeed(&mut short.command("c.csv", &["--runs", "12"]));
    assert_eq!(short.text("c.csv"), short.text("whole.csv"));
}

#[test]
fn the_slurm_array_of_the_examples_makes_the_file_of_one_machine() {
    let short = Short::new(DRAWS);
    succeed(&mut short.command("whole.csv", &["--runs", "6"]));
    let program = PathBuf::from(env!("CARGO_BIN_EXE_sidehill"));
    let path = std::env::var("PATH").unwrap();
    let path = format!("{}:{path}", program.parent().unwrap().display());
    for task in ["0", "1", "2"] {
        succeed(
            Command::new(repository("examples/campaign/array.sbatch"))
                .args([short.path("campaign.yaml"), short.path("parts")])
                .env("PATH", &path)
                .env("SLURM_ARRAY_TASK_ID", task)
                .env("SHARE", "2"),
        );
    }
    let parts = [
        "parts/part_00000.csv",
        "parts/part_00001.csv",
        "parts/part_00002.csv",
    ];
    succeed(&mut short.merge(&parts, "all.csv"));
    assert_eq!(short.text("all.csv"), short.text("whole.csv"));
}

#[test]
fn parts_that_do_not_belong_together_are_refused() {
    let short = Short::new(DRAWS);
    succeed(&mut short.command("a.csv", &["--range", "0..2"]));
    let text = short.text("a.csv");

    // The same run and controller with another figure.
    let rms = &short.records("a.csv")[1]["cross_track_rms_m"];
    short.write("unequal.csv", &text.replace(rms.as_str(), "0.5"));
    let message = fail(&mut short.merge(&["a.csv", "unequal.csv"], "none.csv"));
    assert_says(
        &message,
        &["unequal.csv", "line 3", "run 0", "cross_track_rms_m", "0.5"],
    );

    short.campaign(2, DRAWS);
    succeed(&mut short.command("seed.csv", &["--range", "2..3"]));
    let message = fail(&mut short.merge(&["a.csv", "seed.csv"], "none.csv"));
    assert_says(&message, &["seed.csv", "line 2", "fingerprint"]);

    short.campaign(1, "{key: start.right_m, uniform: [0, 0.1]}");
    succeed(&mut short.command("draws.csv", &["--range", "2..3"]));
    let message = fail(&mut short.merge(&["a.csv", "draws.csv"], "none.csv"));
    assert_says(&message, &["draws.csv", "columns"]);

    short.write("other.csv", "time_s,x_m\n0,1\n");
    let message = fail(&mut short.merge(&["other.csv"], "none.csv"));
    assert_says(&message, &["other.csv", "columns"]);
    let message = fail(&mut short.merge(&["a.csv", "missing.csv"], "none.csv"));
    assert_says(&message, &["missing.csv"]);
    assert!(!short.path("none.csv").exists());
    assert_eq!(short.text("a.csv"), text);

    for range in ["3..3", "4..3", "3", "a..b", "-1..3"] {
        let range = format!("--range={range}");
        assert_says(
            &fail(&mut short.command("none.csv", &[&range])),
            &["0..500"],
        );
    }
    let message = fail(&mut short.command("none.csv", &["--range", "0..2", "--runs", "2"]));
    assert_says(&message, &["cannot be used with"]);
}

#[test]
fn one_thread_and_two_give_the_same_and_fewer_runs_are_the_first() {
    let short = Short::new(DRAWS);
    succeed(&mut short.command("one.csv", &["--threads", "1", "--runs", "6"]));
    succeed(&mut short.command("two.csv", &["--threads", "2", "--runs", "6"]));
    assert_eq!(short.text("one.csv"), short.text("two.csv"));
    succeed(&mut short.command("one.csv", &["--runs", "8"]));
    let longer = short.rows("one.csv");
    assert_eq!(longer.len(), 1 + 8 * 2);
    assert_eq!(short.rows("two.csv"), longer[..1 + 6 * 2]);
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
            "mean_speed_m_s",
            "time_s",
            "tread_speed_max_m_s",
        ] {
            let of_row: f64 = row[figure].parse().unwrap();
            assert_eq!(run[figure].as_f64().unwrap(), of_row, "{figure}");
            assert!(of_row.is_finite());
        }
        let held: f64 = row["cross_track_bound_held"].parse().unwrap();
        assert!((0.5..=1.0).contains(&held), "{held}");
    }
    // A run of less than 4 s has no cycle whose prediction can be compared.
    let held: Vec<f64> = rows
        .iter()
        .filter_map(|row| row["cross_track_ahead_bound_held"].parse().ok())
        .collect();
    assert!(!held.is_empty());
    assert!(
        held.iter().all(|held| (0.5..=1.0).contains(held)),
        "{held:?}"
    );
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

#[test]
fn rows_of_another_build_are_not_taken_for_those_of_this_one() {
    let short = Short::new(DRAWS);
    succeed(&mut short.command("own.csv", &["--runs", "2"]));
    let rows = short.records("own.csv");
    let (campaign, build) = rows[0]["campaign"].split_once('-').unwrap();
    assert_eq!((campaign.len(), build.len()), (16, 16));
    let other = "0123456789abcdef";
    short.write("other.csv", &short.text("own.csv").replace(build, other));
    let before = short.text("other.csv");
    let says = fail(&mut short.command("other.csv", &["--runs", "3"]));
    assert_says(
        &says,
        &[
            "other.csv",
            &format!("made by build {other}"),
            build,
            "another --out",
        ],
    );
    assert_eq!(short.text("other.csv"), before);
    let says = fail(&mut short.merge(&["own.csv", "other.csv"], "merged.csv"));
    assert_says(&says, &["other.csv", "build"]);
}
