use super::*;
use nalgebra::{Isometry3, UnitQuaternion};
use sidehill_bridge::ros2::conversions::{stamp, to_pose, to_quaternion, to_transform};
use sidehill_bridge::ros2::convert::world_from_base_link;
use sidehill_bridge::ros2::message::NavSatStatus;
use sidehill_bridge::ros2::message::{TransformStamped, Twist, Vector3};
use sidehill_bridge::ros2::settings::topics::{AntennaConfig, PoseConfig};
use sidehill_controller::path::GeodeticOrigin;
use std::f64::consts::{FRAC_PI_2, PI};

/// NewestReadings with simulated time, and the clock that sets it.
fn readings(change: impl FnOnce(&mut InputsConfig)) -> (NewestReadings, ExternalClock) {
    let clock = ExternalClock::default();
    clock.set(10.0);
    let local = clock.clone();
    let mut config = InputsConfig::default();
    change(&mut config);
    let context = PortContext {
        frames: Frames::default(),
        mapping: TwistMapping { track_width_m: 2.0 },
        time: RosTime::simulated(move || local.now_s().unwrap_or(0.0)),
        clock: Some(clock.clone()),
        shared: Arc::default(),
        fixes: None,
    };
    (NewestReadings::new(config, context), clock)
}

fn header(time_s: f64, frame: &str) -> Header {
    Header {
        stamp: stamp((time_s * 1e9) as i64),
        frame_id: frame.to_owned(),
    }
}

/// Who has sent all messages.
const PUBLISHER: Gid = Gid::ZERO;

const SLOPE: Attitude = Attitude {
    roll_rad: 0.2,
    pitch_rad: -0.1,
};

fn odometry(time_s: f64) -> Odometry {
    let pose = Pose {
        x_m: 1.0,
        y_m: 2.0,
        z_m: 0.5,
        yaw_rad: 0.3,
    };
    let mut message = Odometry {
        header: header(time_s, "odom"),
        child_frame_id: "base_link".to_owned(),
        ..Odometry::default()
    };
    message.pose.pose = to_pose(&world_from_base_link(&pose, &SLOPE));
    message.twist.twist.linear.x = 0.5;
    message.twist.twist.angular.z = 0.1;
    message
}

#[track_caller]
fn assert_rejected(readings: &NewestReadings, count: u64, reason: &str) {
    let shared = &readings.context.shared;
    let last = shared.last_rejection();
    assert_eq!(shared.rejected(), count, "{last}");
    assert!(last.contains(reason), "{last}");
}

#[test]
fn odometry_gives_pose_and_speeds_and_attitude_where_configured() {
    for source in [AttitudeSource::Imu, AttitudeSource::Odometry] {
        let (mut readings, _) = readings(|config| config.attitude = source);
        readings.odometry(&odometry(9.9), PUBLISHER);
        let LatestInputs {
            pose,
            attitude,
            motors,
            yaw_rate: None,
            forwarded: None,
        } = readings.latest()
        else {
            panic!("nobody forwards commands, and odometry gives no yaw rate");
        };
        let pose = pose.unwrap();
        assert!((pose.time_s - 9.9).abs() < 1e-9);
        assert!((pose.value.x_m - 1.0).abs() < 1e-9 && (pose.value.yaw_rad - 0.3).abs() < 1e-9);
        // v_r - v_l = b omega, with b = 2 m.
        let motors = motors.unwrap().value;
        assert_eq!((motors.traction_m_s, motors.steer_m_s), (0.5, 0.1));
        match source {
            AttitudeSource::Imu => assert_eq!(attitude, None),
            AttitudeSource::Odometry => {
                let attitude = attitude.unwrap().value;
                assert!((attitude.roll_rad - SLOPE.roll_rad).abs() < 1e-9);
                assert!((attitude.pitch_rad - SLOPE.pitch_rad).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn poses_of_another_topic_replace_those_of_odometry() {
    let (mut readings, _) = readings(|config| {
        config.attitude = AttitudeSource::Odometry;
        config.pose = Some(PoseConfig {
            topic: "gps".to_owned(),
            ..PoseConfig::default()
        });
    });
    // The wheels have their own frame, and a pose that means nothing.
    let mut wheels = odometry(9.9);
    wheels.header.frame_id = "wheels".to_owned();
    wheels.pose.pose.position.x = f64::NAN;
    readings.odometry(&wheels, PUBLISHER);
    assert_rejected(&readings, 0, "");
    let read = readings.latest();
    assert_eq!((read.pose, read.attitude), (None, None));
    assert_eq!(read.motors.unwrap().value.traction_m_s, 0.5);
    let mut pose = odometry(9.8);
    for (frame, child, reason) in [
        (
            "odom",
            Some("antenna"),
            "gps: it is in antenna, must be in base_link",
        ),
        ("map", None, "gps: it is in map, must be in odom"),
    ] {
        pose.header.frame_id = frame.to_owned();
        readings.pose(&pose.header, child, &pose.pose.pose, PUBLISHER);
        let rejected = readings.context.shared.rejected();
        assert_rejected(&readings, rejected, reason);
        assert_eq!(readings.latest().pose, None);
    }
    pose.header.frame_id = "odom".to_owned();
    readings.pose(&pose.header, Some("base_link"), &pose.pose.pose, PUBLISHER);
    let read = readings.latest();
    assert!((read.pose.unwrap().time_s - 9.8).abs() < 1e-9);
    assert!((read.pose.unwrap().value.y_m - 2.0).abs() < 1e-9);
    assert!((read.attitude.unwrap().value.roll_rad - SLOPE.roll_rad).abs() < 1e-9);
    assert!((read.motors.unwrap().time_s - 9.9).abs() < 1e-9);
}

#[test]
fn speeds_below_the_thresholds_count_as_zero() {
    let (mut readings, _) = readings(|_| {});
    readings.context.shared.set_velocity_thresholds([0.6, 0.05]);
    readings.odometry(&odometry(10.0), PUBLISHER);
    let motors = readings.latest().motors.unwrap().value;
    assert_eq!((motors.traction_m_s, motors.steer_m_s), (0.0, 0.1));
}

#[test]
fn bad_messages_are_rejected_with_topic_and_reason_and_change_nothing() {
    let (mut readings, _) = readings(|_| {});
    type Damage = fn(&mut Odometry);
    let damages: [(Damage, &str); 6] = [
        (
            |m| m.header.frame_id = "map".to_owned(),
            "odom: it is in map, must be in odom",
        ),
        (|m| m.child_frame_id.clear(), "must be in base_link"),
        (|m| m.header = header(10.6, "odom"), "0.600 s ahead"),
        (
            |m| m.header.stamp.nanosec = 1_000_000_000,
            "must be below 1e9",
        ),
        (
            |m| m.pose.pose.position.x = f64::NAN,
            "position is not finite",
        ),
        (
            |m| {
                m.twist.twist = Twist::default();
                m.twist.twist.linear.x = f64::INFINITY;
            },
            "twist is not finite",
        ),
    ];
    for (count, (damage, reason)) in damages.into_iter().enumerate() {
        let mut message = odometry(10.0);
        damage(&mut message);
        readings.odometry(&message, PUBLISHER);
        assert_rejected(&readings, count as u64 + 1, reason);
        assert_eq!(readings.latest(), LatestInputs::default());
    }
}

#[test]
fn a_stamp_is_never_later_than_now() {
    let (mut readings, _) = readings(|_| {});
    readings.odometry(&odometry(10.08), PUBLISHER);
    assert_eq!(readings.latest().pose.unwrap().time_s, 10.0);
}

#[test]
fn a_clock_that_arrives_after_the_messages_ages_none_of_the_next() {
    let (mut readings, clock) = readings(|_| {});
    readings.odometry(&odometry(10.4), PUBLISHER);
    assert_eq!(readings.latest().pose.unwrap().time_s, 10.0);
    clock.set(10.45);
    readings.odometry(&odometry(10.44), PUBLISHER);
    assert_eq!(readings.latest().pose.unwrap().time_s, 10.44);
    assert!(readings.context.shared.take_notes().is_empty());
    readings.odometry(&odometry(11.0), PUBLISHER);
    assert_rejected(&readings, 1, "ahead");
}

/// Publishes how the IMU is mounted.
fn mount_imu(readings: &mut NewestReadings, base_from_imu: UnitQuaternion<f64>) {
    let transform = TransformStamped {
        header: header(0.0, "base_link"),
        child_frame_id: "imu_link".to_owned(),
        transform: to_transform(&Isometry3::from_parts(
            nalgebra::Translation3::identity(),
            base_from_imu,
        )),
    };
    let transforms = vec![transform];
    readings.transforms(&TfMessage { transforms }, true);
}

#[test]
fn the_mounting_of_the_imu_is_taken_out() {
    let (mut readings, _) = readings(|_| {});
    let world_from_base = world_from_base_link(&Pose::default(), &SLOPE).rotation;
    let base_from_imu = UnitQuaternion::from_euler_angles(0.0, 0.0, FRAC_PI_2);
    let message = Imu {
        header: header(9.9, "imu_link"),
        orientation: to_quaternion(&(world_from_base * base_from_imu)),
        ..Imu::default()
    };
    readings.imu(&message, PUBLISHER);
    assert_rejected(&readings, 1, "no transform between imu_link and base_link");
    mount_imu(&mut readings, base_from_imu);
    readings.imu(&message, PUBLISHER);
    let attitude = readings.latest().attitude.unwrap().value;
    assert!((attitude.roll_rad - SLOPE.roll_rad).abs() < 1e-9);
    assert!((attitude.pitch_rad - SLOPE.pitch_rad).abs() < 1e-9);
}

/// A level IMU in the vehicle's frame, while the vehicle turns left.
fn turning_imu() -> Imu {
    let mut message = Imu {
        header: header(9.9, "base_link"),
        ..Imu::default()
    };
    message.orientation.w = 1.0;
    message.angular_velocity.z = 0.4;
    message
}

#[test]
fn the_yaw_rate_is_read_where_it_is_asked_for() {
    for attitude in [AttitudeSource::Imu, AttitudeSource::Odometry] {
        for yaw_rate in [YawRateSource::Imu, YawRateSource::None] {
            let (mut readings, _) = readings(|config| {
                config.attitude = attitude;
                config.yaw_rate = yaw_rate;
            });
            readings.imu(&turning_imu(), PUBLISHER);
            assert_rejected(&readings, 0, "");
            let latest = readings.latest();
            assert_eq!(latest.attitude.is_some(), attitude == AttitudeSource::Imu);
            match yaw_rate {
                YawRateSource::None => assert_eq!(latest.yaw_rate, None),
                YawRateSource::Imu => {
                    let read = latest.yaw_rate.unwrap();
                    assert!((read.time_s - 9.9).abs() < 1e-9 && (read.value - 0.4).abs() < 1e-12);
                }
            }
        }
    }
}

#[test]
fn the_yaw_rate_is_about_the_vehicles_upward_axis_however_the_imu_is_mounted() {
    // The vehicle rolls at 0.05 rad/s, pitches at -0.1 and yaws at 0.4; what the IMU reads of it is worked out by hand.
    let upside_down = UnitQuaternion::from_euler_angles(PI, 0.0, 0.0);
    let on_its_left_side = UnitQuaternion::from_euler_angles(-FRAC_PI_2, 0.0, 0.0);
    for (base_from_imu, [x, y, z]) in [
        (upside_down, [0.05, 0.1, -0.4]),
        (on_its_left_side, [0.05, -0.4, -0.1]),
    ] {
        let (mut readings, _) = readings(|config| {
            config.attitude = AttitudeSource::Odometry;
            config.yaw_rate = YawRateSource::Imu;
        });
        let mut message = Imu {
            header: header(9.9, "imu_link"),
            angular_velocity: Vector3 { x, y, z },
            ..Imu::default()
        };
        // It has no orientation.
        message.orientation_covariance[0] = -1.0;
        message.orientation.w = 0.0;
        readings.imu(&message, PUBLISHER);
        assert_rejected(&readings, 1, "no transform between imu_link and base_link");
        mount_imu(&mut readings, base_from_imu);
        readings.imu(&message, PUBLISHER);
        assert_eq!(readings.context.shared.rejected(), 1);
        let yaw_rate = readings.latest().yaw_rate.unwrap().value;
        assert!((yaw_rate - 0.4).abs() < 1e-12, "{yaw_rate}");
        assert_eq!(readings.latest().attitude, None);
    }
}

#[test]
fn a_bad_yaw_rate_is_rejected_with_its_field_and_the_attitude_beside_it_is_used() {
    type Damage = fn(&mut Imu);
    let damages: [(Damage, &str); 4] = [
        (
            |m| m.angular_velocity_covariance[0] = -1.0,
            "imu: angular_velocity_covariance[0] is -1",
        ),
        (
            |m| m.angular_velocity.z = f64::NAN,
            "imu: angular_velocity is not finite",
        ),
        (
            |m| m.angular_velocity.x = f64::INFINITY,
            "imu: angular_velocity is not finite",
        ),
        (
            |m| m.angular_velocity.z = -35.1,
            "imu: angular_velocity is 35.1 rad/s, must be at most 35 rad/s",
        ),
    ];
    for (damage, reason) in damages {
        let (mut readings, _) = readings(|config| config.yaw_rate = YawRateSource::Imu);
        let mut message = turning_imu();
        damage(&mut message);
        readings.imu(&message, PUBLISHER);
        assert_rejected(&readings, 1, reason);
        assert_eq!(readings.latest().yaw_rate, None);
        assert!(readings.latest().attitude.is_some());
    }
    // An attitude without a yaw rate has no use for the field.
    let (mut readings, _) = readings(|_| {});
    let mut message = turning_imu();
    message.angular_velocity_covariance[0] = -1.0;
    readings.imu(&message, PUBLISHER);
    assert_rejected(&readings, 0, "");
}

#[test]
fn an_imu_without_an_orientation_gives_no_attitude() {
    let (mut readings, _) = readings(|_| {});
    let mut message = turning_imu();
    message.orientation_covariance[0] = -1.0;
    readings.imu(&message, PUBLISHER);
    assert_rejected(&readings, 1, "imu: orientation_covariance[0] is -1");
    assert_eq!(readings.latest().attitude, None);
}

#[test]
fn joints_of_other_parts_are_ignored() {
    let (mut readings, _) = readings(|config| config.speeds = SpeedSource::JointStates);
    let mut message = JointState {
        header: header(9.9, ""),
        name: vec!["mast_joint".to_owned()],
        velocity: vec![1.0],
        ..JointState::default()
    };
    readings.joint_states(&message, PUBLISHER);
    assert_rejected(&readings, 0, "");
    message.name = vec![
        "right_tread_joint".to_owned(),
        "left_tread_joint".to_owned(),
    ];
    message.velocity = vec![0.6, 0.4];
    readings.joint_states(&message, PUBLISHER);
    let motors = readings.latest().motors.unwrap().value;
    assert!((motors.traction_m_s - 0.5).abs() < 1e-12 && (motors.steer_m_s - 0.1).abs() < 1e-12);
    message.velocity[0] = f64::NAN;
    readings.joint_states(&message, PUBLISHER);
    assert_rejected(&readings, 1, "joint_states: velocity is not finite");
}

/// `map` to a child, stamped with a time.
fn transform(child: &str, time_s: f64, x_m: f64) -> TransformStamped {
    TransformStamped {
        header: header(time_s, "map"),
        child_frame_id: child.to_owned(),
        transform: to_transform(&Isometry3::translation(x_m, 0.0, 0.0)),
    }
}

#[test]
fn a_bad_transform_does_not_drop_the_good_ones_of_its_message() {
    let (mut readings, _) = readings(|_| {});
    readings.clock(&Clock {
        clock: stamp(10_000_000_000),
    });
    let mut no_rotation = transform("a", 10.0, 1.0);
    no_rotation.transform.rotation.w = 0.0;
    let mut no_stamp = transform("b", 10.0, 1.0);
    no_stamp.header.stamp.nanosec = 1_000_000_000;
    let transforms = vec![
        no_rotation,
        no_stamp,
        transform("c", 3610.0, 1.0),
        transform("odom", 10.0, 2.0),
    ];
    readings.transforms(&TfMessage { transforms }, false);
    assert_rejected(&readings, 3, "tf, c: its stamp is 3600.000 s ahead");
    let transforms = readings.context.shared.transforms();
    let odom = transforms.look_up("map", "odom", 10.0, 0.0).unwrap();
    assert_eq!(odom.translation.x, 2.0);
    for child in ["a", "b", "c"] {
        assert!(transforms.look_up("map", child, 10.0, 1.0).is_err());
    }
}

#[test]
fn a_mounting_on_tf_holds_however_old_it_is() {
    let (mut readings, clock) = readings(|_| {});
    let mounting = TransformStamped {
        header: header(10.0, "base_link"),
        child_frame_id: "imu".to_owned(),
        transform: to_transform(&Isometry3::rotation(nalgebra::Vector3::z() * FRAC_PI_2)),
    };
    let transforms = vec![mounting];
    readings.transforms(&TfMessage { transforms }, false);
    clock.set(100.0);
    let upright = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.0);
    let message = Imu {
        header: header(99.9, "imu"),
        orientation: to_quaternion(&upright),
        ..Imu::default()
    };
    readings.imu(&message, PUBLISHER);
    assert_rejected(&readings, 0, "");
    assert!(readings.latest().attitude.is_some());
}

#[test]
fn a_clock_of_a_publisher_that_is_set_by_less_than_half_a_second_is_followed_and_said() {
    for step_s in [-0.4, 0.4] {
        let (mut readings, clock) = readings(|_| {});
        let (local, system) = (clock.clone(), clock.clone());
        let now_s = |clock: &ExternalClock| clock.now_s().unwrap_or_default();
        readings.context.time =
            RosTime::of_clocks(move || now_s(&local), move || (1e9 * now_s(&system)) as i64);
        for index in 0..40 {
            let now_s = 10.0 + 0.05 * f64::from(index);
            clock.set(now_s);
            let off_s = if index < 20 { 0.0 } else { step_s };
            readings.odometry(&odometry(now_s + off_s - 0.01), PUBLISHER);
            let age_s = now_s - readings.latest().motors.unwrap().time_s;
            assert!((0.0..0.06).contains(&age_s), "{step_s}: {age_s}");
        }
        assert_rejected(&readings, 0, "");
        let notes = readings.context.shared.take_notes();
        let [note] = notes.as_slices().0 else {
            panic!("{notes:?}");
        };
        assert!(
            note.message.contains("odom: its stamps are corrected by"),
            "{note:?}"
        );
    }
}

#[test]
fn a_jump_of_the_clock_drops_readings_and_transforms() {
    for (to_s, jumps) in [(10.5, 0), (13.0, 1), (9.0, 1)] {
        let (mut readings, clock) = readings(|_| {});
        let at = |time_s: f64| Clock {
            clock: stamp((time_s * 1e9) as i64),
        };
        readings.clock(&at(10.0));
        readings.odometry(&odometry(10.0), PUBLISHER);
        let mut transform = TransformStamped {
            header: header(10.0, "map"),
            child_frame_id: "odom".to_owned(),
            ..TransformStamped::default()
        };
        transform.transform.rotation.w = 1.0;
        let transforms = vec![transform];
        readings.transforms(&TfMessage { transforms }, false);
        readings.clock(&at(to_s));
        assert_eq!(clock.now_s(), Some(to_s));
        let shared = &readings.context.shared;
        assert_eq!(shared.clock_jumps.load(Ordering::Relaxed), jumps);
        assert_eq!(readings.latest().pose.is_some(), jumps == 0);
        let found = shared.transforms().look_up("map", "odom", 10.0, 1.0);
        assert_eq!(found.is_ok(), jumps == 0, "{found:?}");
    }
}

fn fixes(change: impl FnOnce(&mut PoseConfig)) -> NewestReadings {
    let mut pose = PoseConfig {
        topic: "fix".to_owned(),
        message: PoseMessage::NavSatFix,
        heading: Some(HeadingConfig {
            topic: "heading".to_owned(),
            ..HeadingConfig::default()
        }),
        antenna: None,
    };
    change(&mut pose);
    let (mut readings, _) = readings(|config| config.pose = Some(pose.clone()));
    readings.context.fixes = Some(FixSettings {
        datum: GeodeticOrigin {
            latitude_deg: 36.7,
            longitude_deg: -4.5,
            elevation_m: 0.0,
        },
        sigma_max_m: 0.03,
        heading_sigma_max_rad: 0.03,
    });
    NewestReadings::new(readings.config.clone(), readings.context.clone())
}

/// A fix at the datum.
fn fix(time_s: f64) -> NavSatFix {
    NavSatFix {
        header: header(time_s, "gps"),
        status: NavSatStatus {
            status: 2,
            service: 1,
        },
        latitude: 36.7,
        longitude: -4.5,
        ..NavSatFix::default()
    }
}

/// A level imu in a frame.
fn level_imu(time_s: f64, frame: &str) -> Imu {
    Imu {
        header: header(time_s, frame),
        ..Imu::default()
    }
}

/// A rotation about the vertical.
fn upright(yaw_rad: f64) -> Quaternion {
    to_quaternion(&UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad))
}

/// The frame of a sensor in base_link.
fn mounted(frame: &str, place: [f64; 3], yaw_rad: f64) -> TfMessage {
    let pose = Isometry3::from_parts(
        nalgebra::Translation3::from(place),
        UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad),
    );
    TfMessage {
        transforms: vec![TransformStamped {
            header: header(1.0, "base_link"),
            child_frame_id: frame.to_owned(),
            transform: to_transform(&pose),
        }],
    }
}

#[test]
fn the_heading_of_a_fix_is_east_based_or_a_compass_and_mounted_or_offset() {
    let antenna = AntennaConfig::default();
    // The vehicle looks east: psi is -90 deg.
    for (offset_deg, compass, measured_deg) in [
        (Some(0.0), false, 0.0),
        (Some(0.0), true, 90.0),
        // From the left antenna to the right one.
        (Some(90.0), false, -90.0),
        (Some(90.0), true, 180.0),
        // The frame of the sensor is turned to the left by 30 deg.
        (None, false, 30.0),
        (None, true, 60.0),
    ] {
        let mut readings = fixes(|pose| {
            pose.antenna = Some(antenna);
            let heading = pose.heading.as_mut().unwrap();
            (heading.offset_deg, heading.compass) = (offset_deg, compass);
        });
        readings.transforms(&mounted("north", [0.0; 3], 30f64.to_radians()), true);
        readings.imu(&level_imu(9.9, "base_link"), PUBLISHER);
        let orientation = upright(f64::to_radians(measured_deg));
        readings.heading(&header(9.9, "north"), &orientation, None, PUBLISHER);
        readings.fix(&fix(9.9), PUBLISHER);
        assert_rejected(&readings, 0, "");
        let found = readings.latest().pose.unwrap().value.yaw_rad;
        assert!(
            (found + FRAC_PI_2).abs() < 1e-9,
            "{offset_deg:?} {compass}: {found}"
        );
    }
}

#[test]
fn a_heading_that_is_no_heading_is_refused() {
    let mut readings = fixes(|_| {});
    let mut heading = |frame, variance| {
        readings.heading(&header(9.9, frame), &upright(0.0), variance, PUBLISHER);
        readings.context.shared.last_rejection()
    };
    // ublox_gps without a valid heading, a driver without an orientation.
    for (frame, variance, reason) in [
        (
            "base_link",
            1000.0,
            "heading: its heading has a standard deviation of 31.623 rad",
        ),
        ("base_link", -1.0, "no orientation"),
        ("base_link", f64::NAN, "standard deviation of NaN"),
        (
            "gps",
            1e-4,
            "heading: there is no transform between gps and base_link; publish it, or give `heading.offset_deg`",
        ),
    ] {
        let said = heading(frame, Some(variance));
        assert!(said.contains(reason), "{said}");
    }
}

#[test]
fn the_antenna_is_where_the_settings_or_its_frame_say() {
    for by_frame in [false, true] {
        let mut readings = fixes(|pose| {
            pose.antenna = (!by_frame).then_some(AntennaConfig {
                forward_m: 0.5,
                left_m: -0.2,
                up_m: 1.5,
            });
        });
        readings.fix(&fix(9.8), PUBLISHER);
        match by_frame {
            true => assert_rejected(
                &readings,
                1,
                "fix: there is no transform between base_link and gps; publish it, or give `antenna`",
            ),
            false => assert_rejected(&readings, 0, ""),
        }
        readings.transforms(&mounted("gps", [0.5, -0.2, 1.5], 1.0), true);
        readings.imu(&level_imu(9.9, "base_link"), PUBLISHER);
        // Looks north.
        readings.heading(
            &header(9.9, "base_link"),
            &upright(FRAC_PI_2),
            Some(1e-4),
            PUBLISHER,
        );
        readings.fix(&fix(9.9), PUBLISHER);
        let pose = readings.latest().pose.unwrap();
        assert!((pose.time_s - 9.9).abs() < 1e-9);
        let pose = pose.value;
        assert!(
            (pose.x_m + 0.2).abs() < 1e-6 && (pose.y_m + 0.5).abs() < 1e-6,
            "{pose:?}"
        );
        assert!((pose.z_m + 1.5).abs() < 1e-6);
    }
}

#[test]
fn poses_of_transforms_are_as_new_as_the_oldest_of_their_chain() {
    let (mut readings, clock) = readings(|config| {
        config.pose = Some(PoseConfig {
            message: PoseMessage::Transform,
            ..PoseConfig::default()
        });
    });
    readings.context.frames.odometry = "map".to_owned();
    let mut send = |time_s: f64, parent: &str, child: &str, x_m: f64| {
        clock.set(time_s);
        let pose = Isometry3::translation(x_m, 0.0, 0.0);
        let message = TfMessage {
            transforms: vec![TransformStamped {
                header: header(time_s, parent),
                child_frame_id: child.to_owned(),
                transform: to_transform(&pose),
            }],
        };
        readings.transforms(&message, false);
        readings
            .latest()
            .pose
            .map(|pose| (pose.time_s, pose.value.x_m))
    };
    let close = |found: Option<(f64, f64)>, time_s: f64, x_m: f64| {
        let (found_s, found_m) = found.unwrap();
        assert!(
            (found_s - time_s).abs() < 1e-6 && (found_m - x_m).abs() < 1e-6,
            "{found:?}"
        );
    };
    assert_eq!(send(10.0, "odom", "base_link", 1.0), None);
    close(send(10.1, "map", "odom", 5.0), 10.0, 6.0);
    close(send(10.2, "odom", "base_link", 2.0), 10.1, 6.5);
    // Without localisation the pose grows old.
    close(send(10.3, "odom", "base_link", 3.0), 10.1, 6.5);
    close(send(10.4, "map", "odom", 5.0), 10.3, 8.0);
}
