use super::*;
use nalgebra::{Translation3, UnitQuaternion};

fn isometry(x: f64, y: f64, turn: f64) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(x, y, 0.0),
        UnitQuaternion::from_euler_angles(0.0, 0.0, turn),
    )
}

fn paths() -> Paths {
    Paths::new(crate::ros2::route::tests::settings(), "odom")
}

/// 5 m along y of the frame map, a heading of 0.
fn plan() -> Plan {
    let poses = (0..=50).map(|i| PlanarPose {
        x_m: 0.0,
        y_m: 0.1 * f64::from(i),
        yaw_rad: 0.0,
    });
    Plan {
        frame: "map".to_owned(),
        poses: poses.collect(),
    }
}

const HERE: Whereabouts = Whereabouts {
    pose: PlanarPose {
        x_m: 3.0,
        y_m: 0.0,
        yaw_rad: 0.0,
    },
    speed_m_s: 0.0,
};

fn known() -> Transforms {
    let mut known = Transforms::default();
    known.take("odom", "map", 0.0, isometry(3.0, 0.0, 0.5), false);
    known
}

fn tolerances(transform_s: f64) -> Tolerances {
    Tolerances {
        transform_s,
        failure_s: 1.0,
        ..Tolerances::default()
    }
}

fn until_done(paths: &mut Paths, known: &Transforms) -> Result<Handover, Outcome> {
    for _ in 0..2000 {
        match paths.step(0.1, Some(HERE), known, &tolerances(1.0)) {
            Some(Ok(Prepared::Path(handover))) => return Ok(handover),
            Some(Ok(Prepared::AtGoal(goal))) => panic!("at {goal:?}"),
            Some(Err(outcome)) => return Err(outcome),
            None => {}
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    panic!("nothing came");
}

#[test]
fn a_path_is_brought_to_the_frame_that_is_driven_in() {
    let (mut paths, mut known) = (paths(), known());
    paths.prepare(plan(), 0.0);
    let handover = until_done(&mut paths, &known).unwrap();
    let end = handover.trajectory.at(1e3);
    let (sin, cos) = 0.5_f64.sin_cos();
    for (x_m, y_m, yaw_rad) in [
        (end.position.x_m, end.position.y_m, end.heading_rad),
        (handover.goal.x_m, handover.goal.y_m, handover.goal.yaw_rad),
    ] {
        assert!((x_m - (3.0 - 5.0 * sin)).abs() < 1e-3, "{x_m}");
        assert!((y_m - 5.0 * cos).abs() < 1e-3, "{y_m}");
        assert!((yaw_rad - 0.5).abs() < 1e-3, "{yaw_rad}");
    }
    // A frame that moves takes its path along.
    let pose = HERE.pose;
    assert!(
        paths
            .follow_frame(0.1, &pose, &known, 1.0)
            .unwrap()
            .is_none()
    );
    known.take("odom", "map", 0.2, isometry(3.2, 0.0, 0.5), false);
    let moved = paths
        .follow_frame(0.2, &pose, &known, 1.0)
        .unwrap()
        .unwrap();
    let step_m = moved.trajectory.at(1e3).position.x_m - end.position.x_m;
    assert!((step_m - 0.2).abs() < 1e-9, "{step_m}");
    assert!(
        paths
            .follow_frame(0.2, &pose, &known, 1.0)
            .unwrap()
            .is_none()
    );
    assert!(paths.follow_frame(9.0, &pose, &known, 1.0).is_err());
}

#[test]
fn a_path_that_ends_where_the_vehicle_is_has_been_driven() {
    // Where the vehicle is in the map: the planner gives a single pose, or a few around it.
    let here = PlanarPose {
        x_m: 0.0,
        y_m: 0.0,
        yaw_rad: 1.0,
    };
    let (mut paths, known) = (paths(), known());
    for count in [1, 3] {
        paths.prepare(
            Plan {
                frame: "map".to_owned(),
                poses: vec![here; count],
            },
            0.0,
        );
        let Some(Ok(Prepared::AtGoal(goal))) =
            paths.step(0.1, Some(HERE), &known, &tolerances(1.0))
        else {
            panic!("{count} poses");
        };
        assert!((goal.x_m - 3.0).hypot(goal.y_m) < 1e-9, "{goal:?}");
        assert!((goal.yaw_rad - 1.5).abs() < 1e-9, "{goal:?}");
    }
}

#[test]
fn what_is_missing_for_too_long_ends_the_wait() {
    let nothing = Transforms::default();
    let mut paths = paths();
    paths.prepare(plan(), 0.0);
    assert!(
        paths
            .step(0.5, Some(HERE), &nothing, &tolerances(1.0))
            .is_none()
    );
    let error = paths
        .step(1.5, Some(HERE), &nothing, &tolerances(1.0))
        .unwrap();
    assert_eq!(error.err().unwrap().code, code::TF_ERROR);
    paths.prepare(plan(), 0.0);
    let error = paths.step(1.5, None, &known(), &tolerances(3.0)).unwrap();
    assert_eq!(error.err().unwrap().code, code::TF_ERROR);
}

#[test]
fn a_speed_limit_holds_for_the_path_in_hand_and_those_after_it() {
    let limit = |percentage, speed_limit| SpeedLimit {
        percentage,
        speed_limit,
        ..SpeedLimit::default()
    };
    let (mut paths, known) = (paths(), known());
    assert!(
        paths.limit(&limit(true, 50.0)).is_none(),
        "there is no path"
    );
    paths.prepare(plan(), 0.0);
    let handover = until_done(&mut paths, &known).unwrap();
    let fastest = |handover: &Handover| {
        let times = (0..400).map(|i| 0.1 * f64::from(i));
        times.fold(0.0_f64, |max, s| {
            max.max(handover.trajectory.at(s).speed_m_s)
        })
    };
    assert!((fastest(&handover) - 0.25).abs() < 1e-6);
    let slower = paths.limit(&limit(false, 0.1)).unwrap();
    assert!((fastest(&slower) - 0.1).abs() < 1e-6);
    for ignored in [f64::NAN, -1.0, 0.1] {
        assert!(paths.limit(&limit(false, ignored)).is_none());
    }
    let free = paths.limit(&limit(false, 0.0)).unwrap();
    assert!((fastest(&free) - 0.5).abs() < 1e-6);
}
