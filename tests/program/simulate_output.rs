//! What `sidehill simulate` prints and writes, and what it refuses.

use crate::{Course, assert_says, fail, keys, runs, sidehill, stdout, succeed};
use ndarray::{Array0, Array1, Array2};
use ndarray_npy::NpzReader;
use serde_json::Value;
use std::collections::BTreeSet;

/// Fields of a run, design of the program's contract.
const FIELDS: [&str; 24] = [
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
    "mean_speed_m_s",
    "time_s",
    "tread_speed_max_m_s",
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
    let mut npz = NpzReader::new(std::fs::File::open(&file).unwrap()).unwrap();
    let times_s: Array1<f64> = npz.by_name("time_s").unwrap();
    let starts: Array1<i64> = npz.by_name("A_indptr").unwrap();
    let columns: Array1<i64> = npz.by_name("A_indices").unwrap();
    let equalities: Array0<i64> = npz.by_name("equalities").unwrap();
    let equalities = equalities.into_scalar() as usize;
    let mut rows = |name: &str| -> Array2<f64> { npz.by_name(name).unwrap() };
    let (a, b, x) = (rows("A_data"), rows("b"), rows("x"));
    assert!(times_s.len() > 20, "{}", times_s.len());
    assert_eq!([a.nrows(), b.nrows(), x.nrows()], [times_s.len(); 3]);
    assert_eq!(starts.len(), x.ncols() + 1);
    assert_eq!([columns.len(), a.ncols()], [starts[x.ncols()] as usize; 2]);
    assert!(a.iter().chain(&b).chain(&x).all(|value| value.is_finite()));
    // Each solution keeps the limits of its QP.
    for ((a, b), x) in a.rows().into_iter().zip(b.rows()).zip(x.rows()) {
        let mut slack = b.to_owned();
        for (column, x) in x.iter().enumerate() {
            for entry in starts[column] as usize..starts[column + 1] as usize {
                slack[columns[entry] as usize] -= a[entry] * x;
            }
        }
        for (row, slack) in slack.iter().enumerate() {
            let equal = row < equalities;
            let kept = if equal {
                slack.abs() < 1e-4
            } else {
                *slack > -1e-4
            };
            assert!(kept, "row {row}: {slack}");
        }
    }
    let text = fail(&mut record(&["icrik-mpc"]));
    assert_says(&text, &["qps.npz", "--force"]);
}

#[test]
fn what_was_learned_is_kept_in_a_file_that_is_refused_where_it_is_wrong() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let eight = std::fs::read_to_string(root.join("config/scenarios/figure_eight_10deg.yaml"));
    let vehicles = root.join("config/vehicles/");
    let eight = eight
        .unwrap()
        .replace("../vehicles/", vehicles.to_str().unwrap())
        .replace(
            "\ncontroller:\n",
            "\nlaps: 2\nfriction: {kind: patches, minimum: 0.6, maximum: 0.9, cell_size_m: 2}\n\
             controller:\n  memory: {}\n",
        );
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let file = folder.path().join(name);
        std::fs::write(&file, text).unwrap();
        file
    };
    let kept = folder.path().join("j8.learned");
    let simulate = |scenario: &std::path::Path, arguments: &[&std::ffi::OsStr]| {
        let mut command = sidehill();
        command.arg("simulate").arg(scenario);
        command.args([
            "--controller",
            "icrik-mpc",
            "--plant",
            "contact",
            "--format",
            "json",
        ]);
        command.args(arguments);
        command
    };
    let (two, one) = (
        file("two.yaml", &eight),
        file("one.yaml", &eight.replace("laps: 2", "laps: 1")),
    );
    let (write, read) = ("--learned-out".as_ref(), "--learned".as_ref());
    let rms = |run: &Value| run["cross_track_rms_m"].as_f64().unwrap();
    let run = runs(&succeed(&mut simulate(&two, &[write, kept.as_os_str()]))).remove(0);
    let laps = run["laps"].as_array().unwrap();
    assert_eq!(laps.len(), 2, "{run}");
    let (first, second) = (rms(&laps[0]), rms(&laps[1]));
    assert!(second < first, "{first} {second}");
    let fresh = runs(&succeed(&mut simulate(&one, &[]))).remove(0);
    assert!(fresh.get("laps").is_none());
    let restarted = simulate(&one, &[read, kept.as_os_str()]).output().unwrap();
    let restarted = runs(&String::from_utf8(restarted.stdout).unwrap()).remove(0);
    assert!(rms(&restarted) < rms(&fresh), "{restarted} {fresh}");
    // A recording contains the learned parameters its controller started from.
    let recording = folder.path().join("restarted.mcap");
    let record = ["--learned".as_ref(), kept.as_os_str(), "--record".as_ref()];
    succeed(simulate(&one, &record).arg(&recording));
    let mut replay = sidehill();
    let replay = replay.arg("replay").arg(&recording);
    let replayed = succeed(replay.args(["--format", "json"]));
    let replayed: Value = serde_json::from_str(&replayed).unwrap();
    assert_eq!(replayed["different"], 0, "{replayed}");
    // Another vehicle, a damaged file, a cut one, none at all, and memory off.
    let other = eight.replace("\nlaps: 2", "\nmodel_error: {y_icr: 1.1}\nlaps: 1");
    let other = file("other.yaml", &other);
    let why = fail(&mut simulate(&other, &[read, kept.as_os_str()]));
    assert_says(&why, &["refused", "it was learned by j8"]);
    let whole = std::fs::read_to_string(&kept).unwrap();
    for (damaged, says) in [
        (whole.replacen("error_way_m", "eror_way_m", 1), "damaged"),
        (whole[..whole.len() / 2].to_owned(), "cut short"),
        ("gains: 1\n".to_owned(), "no file of what was learned"),
    ] {
        let damaged = file("damaged.learned", &damaged);
        let why = fail(&mut simulate(&one, &[read, damaged.as_os_str()]));
        assert_says(&why, &["damaged.learned", "refused", says]);
    }
    let off = file("off.yaml", &eight.replace("memory: {}", "memory: null"));
    let why = fail(&mut simulate(&off, &[write, kept.as_os_str()]));
    assert_says(&why, &["--learned-out", "memory"]);
}

#[test]
fn a_course_that_asks_more_than_is_allowed_says_so_with_both_keys() {
    let folder = tempfile::tempdir().unwrap();
    let warning = |course: &str, speed: &str| {
        let text = format!(
            "{{name: fast, vehicle: {}, terrain: {{kind: level}}, course: {course}, speed: {speed}, \
             controllers: [pure-pursuit], plant: icrik, seed: 1, step_s: 0.005}}",
            crate::repository("config/vehicles/j8.yaml").display()
        );
        let file = folder.path().join("fast.yaml");
        std::fs::write(&file, text).unwrap();
        let out = sidehill().arg("simulate").arg(file).output().unwrap();
        String::from_utf8(out.stderr).unwrap()
    };
    let straight = "{shape: straight, length_m: 2, speed_m_s: 3}";
    let by_default = warning(straight, "{}");
    assert_says(
        &by_default,
        &[
            "course.speed_m_s: 3.00 m/s is asked",
            "speed.speed_m_s allows 0.80 m/s",
        ],
    );
    let by_motors = warning(straight, "{speed_m_s: 5}");
    assert_says(&by_motors, &["controller.limits.traction.speed_m_s allows"]);
    let timed = warning(
        "{shape: circle, radius_m: 1, turns: 0.2, speed_m_s: 3}",
        "{}",
    );
    assert_says(&timed, &["course: 3.00 m/s is asked", "controller.limits"]);
    let slow = warning("{shape: straight, length_m: 2, speed_m_s: 0.5}", "{}");
    assert!(!slow.contains("is asked"), "{slow}");
}
