//! The prediction of where across the path the vehicle will be, and its bound.

use crate::rig::{Setup, course};
use sidehill_controller::controller::{AHEAD_S, Status};
use sidehill_controller::path::Point2;
use sidehill_controller::reference::PROJECTION_WINDOW;

const NOISY: &str = "{tread_speeds: {timing: {rate_hz: 20}, errors: {noise_std_m_s: 0.005}},
    attitude: {timing: {rate_hz: 20}, errors: {noise_std_deg: 0.1}},
    pose: {timing: {rate_hz: 10, delay_s: 0.1}, errors: {noise_std_m: 0.01, noise_std_yaw_deg: 0.5}}}";

#[test]
fn the_bound_ahead_holds_and_is_not_wide() {
    let mut setup = Setup::new(course("{shape: figure_eight}"));
    setup.sensors = serde_yaml::from_str(NOISY).unwrap();
    setup.config.estimator.slide_sigma_m_per_sqrt_s = 0.005;
    setup.config.estimator.yaw_sigma_rad_per_sqrt_s = 0.005;
    let later = (AHEAD_S / setup.config.period_s).round() as usize;
    let mut rig = setup.build();
    // Poses come late.
    for _ in 0..10 {
        rig.cycle();
    }
    let (mut predicted, mut true_m) = (Vec::new(), Vec::new());
    for _ in 0..1100 {
        let pose = rig.simulation.state().pose;
        let decision = rig.cycle();
        assert_eq!(decision.status, Status::Tracking);
        let progress = decision.progress.unwrap();
        let place = Point2 {
            x_m: pose.x_m,
            y_m: pose.y_m,
        };
        let reference = rig.controller.reference().unwrap();
        let nearest = reference.path().unwrap().nearest_within(
            &place,
            progress.arc_length_m,
            &PROJECTION_WINDOW,
        );
        true_m.push(nearest.cross_track_m);
        if let Some(ahead) = decision.ahead {
            let bound_now_m = decision.cross_track_bound_m().unwrap();
            assert!(bound_now_m > 1e-3 && ahead.bound_m >= bound_now_m);
        }
        predicted.push(decision.ahead);
    }
    // The first 2 s are the start from standstill.
    let compared: Vec<_> = predicted[later..]
        .iter()
        .map(|ahead| ahead.unwrap())
        .zip(&true_m[2 * later..])
        .collect();
    let held = compared
        .iter()
        .filter(|(ahead, true_m)| (*true_m - ahead.cross_track_m).abs() <= ahead.bound_m)
        .count() as f64;
    let share = held / compared.len() as f64;
    let mean_m =
        compared.iter().map(|(ahead, _)| ahead.bound_m).sum::<f64>() / compared.len() as f64;
    assert!(share > 0.85, "{share}, bound {mean_m} m");
    assert!(mean_m < 0.05, "{mean_m} m");
}
