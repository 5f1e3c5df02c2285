//! What was learned is bounded before it is driven by.

use nalgebra::Vector3;
use sidehill_controller::estimator::Estimate;
use sidehill_plant::frames::{Attitude, PlanarPose};
use sidehill_plant::slip_gains::{SlipGains, Terms};

const HALF_TRACK_M: f64 = 1.0;

/// On a slope of 0.25 rad.
fn estimate(gains: SlipGains) -> Estimate {
    let slope_rad = 0.25_f64;
    Estimate {
        normal_in_world: Vector3::new(0.0, -slope_rad.sin(), slope_rad.cos()),
        slip_gains: gains,
        ..Estimate::standing(0.0, PlanarPose::default())
    }
}

fn small() -> SlipGains {
    SlipGains::from_fn(|i, j| 0.01 * (i + j) as f64)
}

#[test]
fn a_learned_slide_is_doubted_away_from_the_path() {
    let gains = small();
    let at = |off_path_m| estimate(gains).bounded_gains(HALF_TRACK_M, off_path_m);
    for near_m in [0.0, 0.09, -0.09] {
        assert_eq!(at(near_m), gains);
    }
    for far_m in [0.5, -0.5, 2.0] {
        assert_eq!(at(far_m).fixed_rows::<2>(0).norm(), 0.0);
        assert_eq!(at(far_m).row(2), gains.row(2));
    }
    let half = at(-0.3).fixed_rows::<2>(0) - 0.5 * gains.fixed_rows::<2>(0);
    assert!(half.norm() < 1e-12);
}

#[test]
fn learned_gains_never_turn_the_vehicle_against_its_treads() {
    let small = small();
    assert_eq!(estimate(small).bounded_gains(HALF_TRACK_M, 0.0), small);
    // What spinning treads teach: steer does not turn.
    let mut spun = small;
    for (k, gain) in [-0.9, 1.0, -2.0, 1.5, -1.5].into_iter().enumerate() {
        spun[(2, k)] = gain;
    }
    let bounded = estimate(spun).bounded_gains(HALF_TRACK_M, 0.0);
    assert_eq!(bounded.row(0), spun.row(0));
    assert!((bounded[(2, 1)] / bounded[(2, 0)] - spun[(2, 1)] / spun[(2, 0)]).abs() < 1e-12);
    for heading in 0..36 {
        let heading_rad = f64::from(heading).to_radians() * 10.0;
        let attitude = Attitude::on_plane(&estimate(small).normal_in_world, heading_rad);
        for steer_m_s in [-0.5, 0.5] {
            let own = steer_m_s / HALF_TRACK_M;
            let learned = (bounded * Terms::at(attitude, steer_m_s, 1e-9).value).z;
            assert!((learned / own).abs() < 0.62, "{heading_rad} {learned}");
        }
    }
}
