//! Targets of a vehicle whose tracked point is not its origin.

use super::*;

#[test]
fn rounds_between_the_headings_of_vehicle_and_path_turn_no_target_of_a_tracked_point() {
    let course = Course::Slalom(Slalom::default());
    for forward_m in [0.4, -0.4] {
        let turns_rad = |rounds: f64| -> Vec<f64> {
            let mut controller = following(ControllerKind::IcrikMpc, &course, 0.0, 0, start);
            controller.config.tracked_point.forward_m = forward_m;
            let mut pose = start(controller.reference.as_ref().unwrap());
            pose.yaw_rad += rounds * std::f64::consts::TAU;
            see(&mut controller, &pose, 0..1);
            let targets = controller.horizon.targets.iter();
            targets
                .map(|target| target.pose.yaw_rad - pose.yaw_rad)
                .collect()
        };
        let same = turns_rad(0.0);
        assert_eq!(same.len(), ControllerConfig::default().stages);
        for rounds in [-1.0, 2.0] {
            for (turn_rad, same_rad) in turns_rad(rounds).iter().zip(&same) {
                assert!((turn_rad - same_rad).abs() < 1e-9, "{forward_m} {rounds}");
            }
        }
    }
}

#[test]
fn a_body_that_leads_its_tracked_point_is_held_to_its_heading_where_the_horizon_ends() {
    let course = Course::Slalom(Slalom::default());
    let heading_weights = |forward_m: f64| -> Vec<f64> {
        let mut controller = following(ControllerKind::ContactMpc, &course, 3.0, 0, |reference| {
            reference.path().unwrap().at(3.0).pose()
        });
        controller.config.tracked_point.forward_m = forward_m;
        let pose = controller.reference.as_ref().unwrap().ahead(0.0).pose();
        see(&mut controller, &pose, 0..1);
        let targets = controller.horizon.targets.iter();
        targets
            .map(|target| target.weights.heading_per_rad2)
            .collect()
    };
    let same = |weights: &[f64]| weights.windows(2).all(|pair| pair[0] == pair[1]);
    assert!(same(&heading_weights(0.4)));
    let led = heading_weights(-0.4);
    let (end, others) = led.split_last().unwrap();
    assert!(same(others));
    // As an error across the path of the distance that the point is behind the ICRs, for each rad.
    assert!(*end > 40.0 * 50.0 * 0.4 * 0.4, "{end}");
}

/// Returns how a body's heading differs from its path's after `way_m` along an arc that its point follows, `ahead_m` ahead
/// of the ICRs: d delta/ds = -sin(delta) / ahead - curvature, in small steps.
fn difference_on_arc(
    mut difference_rad: f64,
    way_m: f64,
    ahead_m: f64,
    curvature_per_m: f64,
) -> f64 {
    for _ in 0..1000 {
        difference_rad -= way_m / 1000.0 * (difference_rad.sin() / ahead_m + curvature_per_m);
    }
    difference_rad
}

#[test]
fn headings_and_inputs_of_a_body_whose_tracked_point_drives_an_arc_are_those_of_its_geometry() {
    for (ahead_m, off_rad) in [(0.5, 0.6), (0.5, -0.6), (-0.5, 0.3)] {
        let mut controller = following(ControllerKind::IcrikMpc, &circle(6.0), 3.0, 0, start);
        controller.vehicle.icrs.forward_m = 0.1;
        controller.config.tracked_point = TrackedPoint {
            right_m: 0.2,
            forward_m: ahead_m + 0.1,
        };
        let mut pose = start(controller.reference.as_ref().unwrap());
        pose.yaw_rad += off_rad;
        let lever = controller
            .tracked_point()
            .lever(&Vector3::z(), pose.yaw_rad);
        pose.x_m -= lever.offset_m.0;
        pose.y_m -= lever.offset_m.1;
        see(&mut controller, &pose, 0..1);
        let (targets, times) = (
            &controller.horizon.targets,
            controller.mpc().unwrap().stage_times(),
        );
        let differences: Vec<f64> = targets
            .iter()
            .map(|target| wrap_angle(target.pose.yaw_rad - target.along_heading_rad))
            .collect();
        let way_m = |k: usize| targets[k].speed_m_s * times.step_s(k);
        let mut expected_rad = off_rad;
        for k in 0..targets.len() - 1 {
            if ahead_m > 0.0 {
                expected_rad = difference_on_arc(expected_rad, way_m(k), ahead_m, 1.0 / 6.0);
            } else {
                // Led from the end of the horizon.
                let left = (k + 1..targets.len()).rev();
                expected_rad = left.fold(0.0, |d, k| {
                    difference_on_arc(d, -way_m(k), ahead_m, 1.0 / 6.0)
                });
            }
            let found = differences[k];
            assert!(
                (found - expected_rad).abs() < 0.03,
                "{ahead_m} {k}: {found} {expected_rad}"
            );
            let (target, next) = (&targets[k], &targets[k + 1]);
            let rate_rad_s =
                wrap_angle(next.pose.yaw_rad - target.pose.yaw_rad) / times.step_s(k + 1);
            let inputs = next.feedforward;
            let forward_m_s = next.speed_m_s * differences[k + 1].cos() - 0.2 * rate_rad_s;
            assert!((inputs.traction_m_s - forward_m_s).abs() < 1e-9, "{k}");
            let half_track_m = controller.horizon.half_track_m;
            assert!(
                (inputs.steer_m_s - half_track_m * rate_rad_s).abs() < 1e-9,
                "{k}"
            );
        }
    }
}

#[test]
fn a_body_follows_its_point_or_leads_it_and_keeps_its_heading_where_the_point_stands() {
    let course = Course::Straight(Straight {
        length_m: 30.0,
        ..Straight::default()
    });
    let path_rad = 0.3;
    let mut controller = following(ControllerKind::IcrikMpc, &course, 0.0, 1, start);
    controller.horizon.start.yaw_rad = path_rad + 0.4;
    for (traction_m_s, ahead_m) in [(0.5, 0.5), (0.5, -0.5), (-0.5, 0.5), (-0.5, -0.5)] {
        for stands_from in [25, 40] {
            let mut controller = controller.clone();
            controller.vehicle.icrs.forward_m = 0.2;
            for (k, target) in controller.horizon.targets.iter_mut().enumerate() {
                target.along_heading_rad = path_rad;
                target.feedforward.traction_m_s = if k < stands_from { traction_m_s } else { 0.0 };
                target.weights.heading_per_rad2 = 3.0;
                target.weights.cross_per_m2 = 7.0;
            }
            let point = TrackedPoint {
                right_m: 0.0,
                forward_m: ahead_m + 0.2,
            };
            controller.turn_targets(point, path_rad);
            let targets = &controller.horizon.targets;
            let leads = traction_m_s * ahead_m < 0.0;
            let mut before_rad = 0.4;
            for (k, target) in targets.iter().enumerate() {
                let own_rad = target.pose.yaw_rad - path_rad;
                if leads {
                    assert!(
                        own_rad.abs() < 1e-12,
                        "{traction_m_s} {ahead_m} {k}: {own_rad}"
                    );
                } else if k < stands_from {
                    assert!(own_rad > 0.0 && own_rad < before_rad, "{k}: {own_rad}");
                } else {
                    assert!((own_rad - before_rad).abs() < 1e-12, "{k}: {own_rad}");
                }
                before_rad = own_rad;
            }
            // As much as an error across the path of the distance of point and ICRs, for each rad.
            let leads_at_end = leads && stands_from == 40;
            let expected = 3.0 + if leads_at_end { 40.0 * 7.0 * 0.25 } else { 0.0 };
            let weight = targets.last().unwrap().weights.heading_per_rad2;
            assert!((weight - expected).abs() < 1e-9, "{weight} {expected}");
        }
    }
}
