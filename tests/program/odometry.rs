//! `sidehill odometry` on the paper's first validation, see `plant/tests/data/README.md`.

use crate::{Course, assert_says, fail, repository, sidehill, succeed, text};
use serde_json::Value;

/// Slope of the experiment, rad.
const SLOPE_RAD: f64 = 3.6 * std::f64::consts::PI / 180.0;

/// Returns the replay as a log: ICRIK's poses are the truth, the attitude is that of equation (1)
/// there, and the effective tread speeds are divided by c_l and c_r, as a log's are measured.
fn log() -> String {
    let reference = text("plant/tests/data/dead_reckoning_exp1.csv");
    let mut table = csv::Reader::from_reader(reference.as_bytes());
    let header = table.headers().unwrap().clone();
    let at = |name: &str| header.iter().position(|column| column == name).unwrap();
    let mut log =
        "time_s,v_left_m_s,v_right_m_s,roll_rad,pitch_rad,x_m,y_m,z_m,yaw_rad\n".to_owned();
    for row in table.records().map(Result::unwrap) {
        let number = |name: &str| row[at(name)].parse::<f64>().unwrap();
        let (sin, cos) = number("icrik_yaw_rad").sin_cos();
        let columns = [
            number("time_s"),
            number("v_left_m_s") / 1.004,
            number("v_right_m_s") / 1.011,
            -SLOPE_RAD * sin,
            SLOPE_RAD * cos,
            number("icrik_x_m"),
            number("icrik_y_m"),
            number("icrik_z_m"),
            number("icrik_yaw_rad"),
        ];
        log += &(columns.map(|value| value.to_string()).join(",") + "\n");
    }
    log
}

#[test]
fn the_papers_first_validation_gives_its_errors() {
    let course = Course::new("");
    let log = course.write("exp1.csv", &log());
    let text = succeed(
        sidehill()
            .arg("odometry")
            .arg(&log)
            .arg("--vehicle")
            .arg(repository("config/vehicles/j8.yaml"))
            .args(["--format", "json"]),
    );
    let figures: Value = serde_json::from_str(&text).unwrap();
    let error = |model: &str, key: &str| figures[model][key].as_f64().unwrap();
    // Dead reckoning starts at the first of 478 poses.
    assert_eq!(figures["samples"], 477);
    let icrhk_y = error("icrhk", "mse_y");
    assert!((icrhk_y / 0.80 - 1.0).abs() < 0.03, "{icrhk_y} m^2");
    for key in ["mse_x", "mse_y", "mse_z", "mse_yaw", "j_over_n"] {
        let value = error("icrik", key);
        assert!((0.0..1e-4).contains(&value), "{key}: {value}");
    }
}

#[test]
fn a_bad_log_is_named_with_its_row() {
    let course = Course::new("");
    let vehicle = repository("config/vehicles/j8.yaml");
    let header = "time_s,v_left_m_s,v_right_m_s,roll_rad,pitch_rad,x_m,y_m,z_m,yaw_rad\n";
    for (rows, says) in [
        (
            "0,0.1,0.1,0,0,0,0,0,0\n1,0.1,quick,0,0,0,0,0,0\n",
            &["row 2", "v_right_m_s", "quick"][..],
        ),
        (
            "0,0.1,0.1,0,0,0,0,0,0\n1,0.1,0.1,3,0,0,0,0,0\n",
            &["row 2", "roll_rad", "3"],
        ),
        (
            "1,0.1,0.1,0,0,0,0,0,0\n0.5,0.1,0.1,0,0,0,0,0,0\n",
            &["row 2", "time"],
        ),
    ] {
        let log = course.write("bad.csv", &format!("{header}{rows}"));
        let message = fail(
            sidehill()
                .arg("odometry")
                .arg(&log)
                .arg("--vehicle")
                .arg(&vehicle),
        );
        assert_says(&message, &["bad.csv"]);
        assert_says(&message, says);
    }
}
