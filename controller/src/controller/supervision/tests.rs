#![allow(clippy::unwrap_used)]

use super::super::horizon::tests::{following, start};
use crate::config::ControllerKind;
use crate::course::{Circle, Course, Cusp, Straight, Turn};

/// Returns the speed that motors, bend and stops allow a vehicle so far along a course: traction and steer reach 1 m/s, and
/// half of their decelerations are 1 m/s^2.
fn allowed_m_s(course: &Course, at_m: f64) -> f64 {
    let controller = following(ControllerKind::IcrikMpc, course, at_m, 1, start);
    let limits = &controller.config.limits;
    assert_eq!(
        (limits.traction.speed_m_s, limits.steer.speed_m_s),
        (1.0, 1.0)
    );
    assert_eq!(limits.traction.deceleration_m_s2, 2.0);
    let mut reference = controller.reference.clone().unwrap();
    let pose = reference.ahead(0.0).pose();
    let progress = reference.advance(0.0, &pose, true);
    assert!((progress.arc_length_m - at_m).abs() < 0.05, "{progress:?}");
    controller.allowed_m_s(&progress)
}

#[test]
fn a_vehicle_is_expected_to_be_no_faster_than_motors_bend_and_stops_allow() {
    let straight = Course::Straight(Straight::default());
    assert!((allowed_m_s(&straight, 10.0) - 0.98).abs() < 1e-9);
    for at_m in [0.3, 19.6] {
        let way_m = f64::min(at_m, 20.0 - at_m);
        let expected_m_s = f64::sqrt(2.0 * way_m);
        assert!(
            (allowed_m_s(&straight, at_m) - expected_m_s).abs() < 0.06,
            "{at_m}"
        );
    }
    // It comes nearer to the end, however slowly.
    assert_eq!(allowed_m_s(&straight, 19.8), 0.0);
    // A drive begins at a cusp.
    let cusp = Course::Cusp(Cusp::default());
    let cusp_m = following(ControllerKind::IcrikMpc, &cusp, 0.0, 0, start)
        .reference
        .unwrap()
        .stop_at_m();
    let after_m_s = allowed_m_s(&cusp, cusp_m + 0.2);
    assert!((after_m_s - f64::sqrt(0.4)).abs() < 0.06, "{after_m_s}");
    let circle = Course::Circle(Circle {
        radius_m: 0.6,
        speed_m_s: 0.2,
        turns: 2.0,
        turn: Turn::Left,
    });
    let half_track_m = following(ControllerKind::IcrikMpc, &circle, 0.0, 0, start)
        .horizon
        .half_track_m;
    let in_bend_m_s = allowed_m_s(&circle, 1.5);
    assert!(
        (in_bend_m_s - 0.8 * 0.6 / half_track_m).abs() < 0.01,
        "{in_bend_m_s}"
    );
}
