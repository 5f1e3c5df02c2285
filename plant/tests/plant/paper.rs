//! The paper's vehicles and experiments against an independent implementation, see `../data/README.md`.

use sidehill_plant::dead_reckoning::{StepMotion, advance};
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::speeds::TreadSpeeds;
use sidehill_plant::vehicle::Vehicle;
use std::collections::HashMap;
use std::f64::consts::TAU;

fn vehicle(name: &str) -> Vehicle {
    let text = match name {
        "j8" => include_str!("../../../config/vehicles/j8.yaml"),
        "lazaro" => include_str!("../../../config/vehicles/lazaro.yaml"),
        other => panic!("no vehicle {other}"),
    };
    serde_yaml::from_str(text).unwrap()
}

/// Rows of a CSV text by column name, text and number.
fn rows(text: &'static str) -> Vec<HashMap<&'static str, &'static str>> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    lines
        .map(|line| header.iter().copied().zip(line.split(',')).collect())
        .collect()
}

fn number(row: &HashMap<&str, &str>, column: &str) -> f64 {
    row[column].parse().unwrap()
}

#[test]
fn icrik_meets_the_reference_vectors() {
    let rows = rows(include_str!("../data/icrik_vectors.csv"));
    assert_eq!(rows.len(), 480);
    for row in &rows {
        let vehicle = vehicle(row["vehicle"]);
        let attitude = Attitude {
            roll_rad: number(row, "roll_rad"),
            pitch_rad: number(row, "pitch_rad"),
        };
        let treads = TreadSpeeds {
            left_m_s: number(row, "v_left_m_s"),
            right_m_s: number(row, "v_right_m_s"),
        };
        let icrs = vehicle.icrik(attitude, treads);
        let velocity = vehicle.body_velocity(attitude, treads);
        for (column, got) in [
            ("x_icr_left_m", icrs.left_m),
            ("x_icr_right_m", icrs.right_m),
            ("y_icr_m", icrs.forward_m),
            ("v_x_m_s", velocity.right_m_s),
            ("v_y_m_s", velocity.forward_m_s),
            ("omega_z_rad_s", velocity.yaw_rate_rad_s),
        ] {
            let expected = number(row, column);
            assert!((got - expected).abs() < 1e-9, "{column}: {got} for {row:?}");
        }
    }
}

#[test]
fn dead_reckoning_of_experiment_one_meets_the_reference_and_the_papers_error() {
    let j8 = vehicle("j8");
    let rows = rows(include_str!("../data/dead_reckoning_exp1.csv"));
    assert_eq!(rows.len(), 478);
    let slope_rad = 3.6_f64.to_radians();
    let mut icrik = Pose::default();
    let mut icrhk = Pose::default();
    let mut squares_m2 = 0.0;
    for (row, next) in rows.iter().zip(rows.iter().skip(1).map(Some).chain([None])) {
        for (model, pose) in [("icrik", &icrik), ("icrhk", &icrhk)] {
            for (quantity, got) in [
                ("x_m", pose.x_m),
                ("y_m", pose.y_m),
                ("z_m", pose.z_m),
                ("yaw_rad", pose.yaw_rad),
            ] {
                let expected = number(row, &format!("{model}_{quantity}"));
                let time_s = row["time_s"];
                assert!(
                    (got - expected).abs() < 1e-4,
                    "{model} {quantity} at {time_s} s: {got}, expected {expected}"
                );
            }
        }
        squares_m2 += (icrhk.y_m - icrik.y_m).powi(2);
        let Some(next) = next else { break };
        let dt_s = number(next, "time_s") - number(row, "time_s");
        let treads = TreadSpeeds {
            left_m_s: number(row, "v_left_m_s"),
            right_m_s: number(row, "v_right_m_s"),
        };
        icrik = advance(&icrik, dt_s, |_, yaw_rad| {
            let attitude = Attitude::from_slope(slope_rad, yaw_rad);
            StepMotion {
                velocity: j8.body_velocity(attitude, treads),
                attitude,
            }
        });
        icrhk = advance(&icrhk, dt_s, |_, yaw_rad| StepMotion {
            velocity: j8.icrhk().body_velocity(treads),
            attitude: Attitude::from_slope(slope_rad, yaw_rad),
        });
    }
    let mean_m2 = squares_m2 / rows.len() as f64;
    assert!((mean_m2 / 0.80 - 1.0).abs() < 0.03, "{mean_m2} m^2");
}

#[test]
fn lazaros_forward_limit_acts_at_7_6_deg_and_not_at_4_4_deg() {
    let lazaro = vehicle("lazaro");
    let treads = TreadSpeeds {
        left_m_s: 0.21,
        right_m_s: -0.21,
    };
    let acts_at = |tilt_deg: f64| {
        (0..3600).any(|i| {
            let heading_rad = f64::from(i) / 3600.0 * TAU;
            let attitude = Attitude::from_slope(tilt_deg.to_radians(), heading_rad);
            lazaro.icrik(attitude, treads).forward_m.abs() == lazaro.base_half_length_m
        })
    };
    assert!(acts_at(7.6));
    assert!(!acts_at(4.4) && !acts_at(2.5) && !acts_at(0.0));
}
