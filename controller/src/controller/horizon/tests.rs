#![allow(clippy::unwrap_used)]

use super::*;
use crate::config::{ControllerConfig, ControllerKind};
use crate::course::{Course, Cusp, Straight};
use crate::reference::Tracking;
use crate::speed_profile::SpeedConfig;
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::sample::Stamped;
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use sidehill_plant::vehicle::Vehicle;

/// Returns the readings of a vehicle that stands on level ground.
fn sample(time_s: f64, pose: &PlanarPose) -> Sample {
    Sample {
        time_s,
        tread_speeds: Some(Stamped {
            time_s,
            value: MeasuredTreadSpeeds::default(),
        }),
        attitude: Some(Stamped {
            time_s,
            value: Attitude::default(),
        }),
        yaw_rate: None,
        pose: Some(Stamped {
            time_s,
            value: Pose {
                x_m: pose.x_m,
                y_m: pose.y_m,
                z_m: 0.0,
                yaw_rad: pose.yaw_rad,
            },
        }),
    }
}

/// Returns a controller of the J8 on a cusp, at `arc_m` from the cusp, that has seen the vehicle `past_m` past it along
/// its tangent for two cycles. Errors have their weight at once.
fn past_the_cusp(kind: ControllerKind, arc_m: f64, past_m: f64) -> Controller {
    let mut config = ControllerConfig::default();
    config.contact.start_ramp_s = 0.0;
    let limits = SpeedConfig::default().limits(&config.limits, &Vehicle::j8());
    let trajectory = Course::Cusp(Cusp::default()).trajectory(&limits).unwrap();
    let path = trajectory.path().unwrap();
    let cusp_m = path.cusps_m().next().unwrap();
    let end = path.at(cusp_m.next_down());
    let (sin, cos) = end.travel_heading_rad().sin_cos();
    let pose = PlanarPose {
        x_m: end.position.x_m - past_m * sin,
        y_m: end.position.y_m + past_m * cos,
        yaw_rad: end.heading_rad,
    };
    let reference =
        Reference::new(trajectory, Tracking::Path { lead_max_m: 0.3 }).starting_at(cusp_m + arc_m);
    let mut controller = Controller::new(kind, config, &Vehicle::j8()).unwrap();
    controller.follow(reference);
    for time_s in [0.0, 0.05] {
        controller.step(&sample(time_s, &pose), None);
    }
    controller
}

#[test]
fn a_plan_past_a_cusp_is_weighed_as_one_beside_the_path() {
    let kind = ControllerKind::ContactMpc;
    let heaviest = |arc_m, past_m| {
        let controller = past_the_cusp(kind, arc_m, past_m);
        let targets = controller.horizon.targets.iter();
        let weights = targets.map(|target| target.weights.along_per_m2);
        weights.fold(0.0, f64::max)
    };
    let config = ControllerConfig::default();
    for arc_m in [-0.05, 0.1] {
        assert!(heaviest(arc_m, 0.3) > 0.2 * config.weights.cross_per_m2);
        assert!(heaviest(arc_m, -0.3) < 2.0 * config.contact.along_per_m2);
    }
}

/// Returns the first cycle's weights along the path, and how far short of a cusp their targets are, for a vehicle
/// beside the start whose errors have their weight at once.
fn along_weights(kind: ControllerKind, right_m: f64) -> Vec<(f64, f64)> {
    let mut config = ControllerConfig::default();
    config.contact.start_ramp_s = 0.0;
    let limits = SpeedConfig::default().limits(&config.limits, &Vehicle::j8());
    let course = Course::Cusp(Cusp {
        radius_m: 1.5,
        ..Cusp::default()
    });
    let trajectory = course.trajectory(&limits).unwrap();
    let reference = Reference::new(trajectory, Tracking::Time);
    let (mut pose, cusp_m) = (reference.ahead(0.0).pose(), reference.stop_at_m());
    pose.x_m += right_m * pose.yaw_rad.cos();
    pose.y_m += right_m * pose.yaw_rad.sin();
    let mut controller = Controller::new(kind, config, &Vehicle::j8()).unwrap();
    controller.follow(reference);
    controller.step(&sample(0.0, &pose), None);
    let Law::Mpc(mpc) = &controller.law else {
        return Vec::new();
    };
    let (reference, delay_s) = (
        controller.reference.as_ref().unwrap(),
        controller.config.delay_s(),
    );
    let ends_s = mpc.stage_times().ends_s().iter();
    let short_m = ends_s.map(|end_s| cusp_m - reference.ahead(delay_s + end_s).arc_length_m);
    let weights = controller.horizon.targets.iter();
    weights
        .map(|target| target.weights.along_per_m2)
        .zip(short_m)
        .collect()
}

#[test]
fn contact_mpc_may_lag_on_the_path_but_not_at_a_cusp() {
    let contact = ControllerConfig::default().contact;
    let weights = along_weights(ControllerKind::ContactMpc, 0.0);
    for wanted in [
        contact.along_on_path * contact.along_per_m2,
        contact.along_per_m2,
    ] {
        assert!(
            weights
                .iter()
                .any(|(weight, _)| (weight - wanted).abs() < 1e-9)
        );
    }
    for (weight, short_m) in &weights {
        let whole = (weight - contact.along_per_m2).abs() < 1e-9;
        assert_eq!(whole, *short_m <= ON_TIME_M, "{weight} at {short_m} m");
    }
    // Beside the path it is to get on as well.
    for (weight, _) in along_weights(ControllerKind::ContactMpc, 1.0) {
        assert!(weight > 0.99 * contact.along_per_m2);
    }
    let others = ControllerConfig::default().weights.along_per_m2;
    for (weight, _) in along_weights(ControllerKind::IcrikMpc, 0.0) {
        assert_eq!(weight, others);
    }
}

#[test]
fn errors_gain_weight_after_a_standstill_and_not_after_a_new_path() {
    let config = ControllerConfig::default();
    let period_s = config.period_s;
    let limits = SpeedConfig::default().limits(&config.limits, &Vehicle::j8());
    let course = Course::Straight(Straight::default());
    let reference = || Reference::new(course.trajectory(&limits).unwrap(), Tracking::Time);
    let pose = reference().ahead(0.0).pose();
    let mut controller =
        Controller::new(ControllerKind::ContactMpc, config, &Vehicle::j8()).unwrap();
    controller.follow(reference());
    let mut cycle = 0;
    // Heading's weight at the end of the first stage after so many cycles more, over that without a ramp.
    let mut share_after = |controller: &mut Controller, cycles: usize| {
        for _ in 0..cycles {
            cycle += 1;
            controller.step(&sample(f64::from(cycle) * period_s, &pose), None);
        }
        let weights = controller.horizon.targets[0].weights;
        weights.heading_per_rad2 / controller.config.weights.heading_per_rad2
    };
    let first = share_after(&mut controller, 1);
    let ahead_s = controller.config.delay_s() + controller.config.step_s;
    let ramp_s = controller.config.contact.start_ramp_s;
    let share = |driving_s: f64| ((driving_s + ahead_s) / ramp_s).powi(2);
    assert!((first - share(0.0)).abs() < 1e-3, "{first}");
    let driving = share_after(&mut controller, 10);
    assert!((driving - share(10.0 * period_s)).abs() < 1e-3, "{driving}");
    controller.follow(reference());
    let new_path = share_after(&mut controller, 2);
    assert!(
        (new_path - share(12.0 * period_s)).abs() < 1e-3,
        "{new_path}"
    );
    controller.request_stop();
    share_after(&mut controller, 20);
    assert_eq!(controller.issued.last(), MotorSpeeds::STOP);
    controller.rearm();
    let again = share_after(&mut controller, 1);
    assert!(again < share(2.0 * period_s), "{again}");
}
