//! What `sidehill simulate` prints and writes, and what it refuses.

use crate::{Course, assert_says, fail, keys, runs, sidehill, stdout, succeed};
use std::collections::BTreeSet;

/// Fields of a run, design of the program's contract.
const FIELDS: [&str; 21] = [
    "controller",
    "plant",
    "scenario",
    "seed",
    "completed",
    "cross_track_rms_m",
    "cross_track_p95_m",
    "cross_track_max_m",
    "along_track_rms_m",
    "heading_rms_rad",
    "steer_total_variation_m_s",
    "goal_error_m",
    "constraint_violations",
    "fallbacks",
    "deadline_misses",
    "qp_iterations_mean",
    "qp_working_set",
    "qp_interior_point",
    "qp_cut_short",
    "solve_us",
    "cycle_us",
];

#[test]
fn json_has_the_fields_of_the_contract_and_no_others() {
    let course = Course::new("");
    let runs = runs(&succeed(course.simulate().args(["--format", "json"])));
    let controllers: Vec<_> = runs.iter().map(|run| &run["controller"]).collect();
    assert_eq!(controllers, ["icrik-mpc", "icrhk-mpc"]);
    for run in &runs {
        assert_eq!(keys(run), BTreeSet::from(FIELDS));
        for times in ["solve_us", "cycle_us"] {
            assert_eq!(
                keys(&run[times]),
                BTreeSet::from(["p50", "p99", "p999", "max"])
            );
        }
        assert_eq!(run["completed"], true);
        assert_eq!(run["scenario"], "short");
        assert_eq!(run["plant"], "icrik");
        assert_eq!(run["seed"], 1);
        for count in ["constraint_violations", "fallbacks", "deadline_misses"] {
            assert!(run[count].is_u64(), "{count}");
        }
        for figure in ["cross_track_rms_m", "goal_error_m", "heading_rms_rad"] {
            assert!(run[figure].as_f64().unwrap().is_finite(), "{figure}");
        }
    }
}

#[test]
fn out_gets_a_table_for_each_run_and_a_report() {
    let course = Course::new("");
    let out = course.path("made/results");
    succeed(course.simulate().arg("--out").arg(&out));
    let names: BTreeSet<_> = out
        .read_dir()
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    assert_eq!(names, ["icrhk-mpc.csv", "icrik-mpc.csv", "report.html"]);
    let mut table = csv::Reader::from_path(out.join("icrik-mpc.csv")).unwrap();
    let columns = table.headers().unwrap().clone();
    let at = |name: &str| columns.iter().position(|column| column == name).unwrap();
    let (time, y, cross_track) = (at("time_s"), at("y_m"), at("cross_track_m"));
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    let number = |row: &csv::StringRecord, column: usize| row[column].parse::<f64>().unwrap();
    for (index, row) in rows.iter().enumerate() {
        assert!(
            (number(row, time) - 0.05 * index as f64).abs() < 1e-9,
            "{row:?}"
        );
        assert!(number(row, cross_track).abs() < 0.05, "{row:?}");
    }
    let end = rows.last().unwrap();
    assert!((number(end, y) - 2.0).abs() < 0.05, "{end:?}");
    let report = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert_says(&report, &["<svg", "icrik-mpc", "icrhk-mpc", "short"]);
}

#[test]
fn a_run_that_does_not_complete_says_why_and_ends_with_another_status() {
    let course = Course::new("start: {right_m: 20}\n");
    let output = course.simulate().output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert_says(&stdout(&output), &["icrik-mpc did not complete:"]);
    let output = course
        .simulate()
        .args(["--format", "json"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    for run in runs(&stdout(&output)) {
        assert_eq!(run["completed"], false);
        assert!(!run["ended_by"].as_str().unwrap().is_empty());
    }
}

#[test]
fn what_is_wrong_with_conditions_is_named_by_their_file() {
    let course = Course::new("");
    for (text, parts) in [
        (
            "friction: {kind: uniform, coefficient: 9}\n",
            ["coefficient: 9", "from 0.05 to 2"],
        ),
        ("controller: {stage: 40}\n", ["controller", "stage"]),
        (
            "controller: {weights: {cross_per_m2: -5}}\n",
            ["cross_per_m2", "-5"],
        ),
        ("terrain: {kind: level}\n", ["terrain", "unknown field"]),
    ] {
        let file = course.write("bad.yaml", &format!("name: bad\n{text}"));
        let message = fail(course.simulate().arg("--conditions").arg(&file));
        assert_says(&message, &["bad.yaml"]);
        assert_says(&message, &parts);
    }
}

#[test]
fn arguments_that_mean_nothing_are_refused() {
    let course = Course::new("");
    let message = fail(course.simulate().args(["--controller", "magic"]));
    assert_says(&message, &["magic", "icrik-mpc", "pure-pursuit"]);
    let message = fail(sidehill().args(["simulate", "no_such_scenario.yaml"]));
    assert_says(&message, &["no_such_scenario.yaml"]);
    let message = fail(course.simulate().args(["--path", "no_such_path.csv"]));
    assert_says(&message, &["no_such_path.csv"]);
}

#[test]
fn the_qps_of_a_run_are_recorded_for_other_solvers() {
    let course = Course::new("");
    let file = course.path("qps.npz");
    let record = |controllers: &[&str]| {
        let mut command = course.simulate();
        for name in controllers {
            command.args(["--controller", name]);
        }
        command.arg("--record-qps").arg(&file);
        command
    };
    let text = fail(&mut record(&["icrik-mpc", "icrhk-mpc"]));
    assert_says(&text, &["--record-qps", "2", "--controller"]);
    let text = fail(&mut record(&["pure-pursuit"]));
    assert_says(&text, &["--record-qps", "pure-pursuit"]);
    assert!(!file.exists());
    succeed(&mut record(&["icrik-mpc"]));
    let qps = sidehill::qp_recording::read(&file).unwrap();
    let first = &qps[0];
    assert!(qps.len() > 20, "{}", qps.len());
    for qp in &qps {
        assert_eq!(
            (&qp.p.rowval, &qp.a.colptr),
            (&first.p.rowval, &first.a.colptr)
        );
        assert!(qp.is_finite());
    }
    let text = fail(&mut record(&["icrik-mpc"]));
    assert_says(&text, &["qps.npz", "--force"]);
    let spoiled = course.write("spoiled.npz", "no archive");
    let error = sidehill::qp_recording::read(&spoiled).unwrap_err();
    assert!(format!("{error:#}").contains("spoiled.npz"), "{error:#}");
}
