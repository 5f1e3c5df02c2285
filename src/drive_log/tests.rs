#![cfg(feature = "drive")]

use super::*;
use crate::bag::tests::{Recorded, bag};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::Serialize;
use sidehill_bridge::ros2::node::conversions::{stamp, to_quaternion, to_transform};
use sidehill_bridge::ros2::node::message::cdr::to_cdr;
use sidehill_bridge::ros2::node::message::{
    Header, Imu, JointState, NavSatFix, TfMessage, TransformStamped, Twist, TwistStamped,
    Vector3 as Vector3Message,
};
use sidehill_plant::frames::{Attitude, ros_quaternion};
use std::path::Path;

const START_NS: i64 = 1_700_000_000_000_000_000;

fn header(time_ns: i64, frame_id: &str) -> Header {
    Header {
        stamp: stamp(time_ns),
        frame_id: frame_id.to_owned(),
    }
}

fn recorded<T: Serialize>(
    topic: &'static str,
    message_type: &'static str,
    time_ns: i64,
    message: &T,
) -> Recorded {
    (topic, message_type, time_ns, to_cdr(message).unwrap())
}

fn joints(time_ns: i64, left_rad_s: f64, right_rad_s: f64) -> Recorded {
    let message = JointState {
        header: header(time_ns, ""),
        name: vec!["right_wheel".to_owned(), "left_wheel".to_owned()],
        velocity: vec![right_rad_s, left_rad_s],
        ..JointState::default()
    };
    recorded("/joint_states", choice::JOINT_STATE, time_ns, &message)
}

fn imu(time_ns: i64, frame: &str, world_from_sensor: &UnitQuaternion<f64>) -> Recorded {
    let message = Imu {
        header: header(time_ns, frame),
        orientation: to_quaternion(world_from_sensor),
        ..Imu::default()
    };
    recorded("/imu", choice::IMU, time_ns, &message)
}

fn transform(
    topic: &'static str,
    time_ns: i64,
    frames: [&str; 2],
    pose: &Isometry3<f64>,
) -> Recorded {
    let message = TfMessage {
        transforms: vec![TransformStamped {
            header: header(time_ns, frames[0]),
            child_frame_id: frames[1].to_owned(),
            transform: to_transform(pose),
        }],
    };
    recorded(topic, choice::TF_MESSAGE, time_ns, &message)
}

fn reader(map: &str) -> LogReader {
    let file = ConfigFile::with_text(Path::new("topics.yaml"), map.to_owned());
    LogReader {
        columns: ColumnMap::default(),
        topics: Some(("topics.yaml".to_owned(), TopicMap::read(&file).unwrap())),
    }
}

fn error(map: &str, messages: &[Recorded]) -> String {
    let (_folder, path) = bag(messages);
    format!("{:#}", reader(map).read(&path).unwrap_err())
}

const JOINTS: &str = "tread_speeds: {kind: joint_states, radius_m: 0.5}\n";

#[test]
fn transforms_and_the_mounting_of_the_imu_give_the_pose_and_attitude_of_the_vehicle() {
    let attitude = Attitude {
        roll_rad: 0.2,
        pitch_rad: -0.1,
    };
    let base = Isometry3::from_parts(
        Translation3::new(4.0, 5.0, 6.0),
        ros_quaternion(&attitude, 0.7),
    );
    // Looking backwards, 30 degrees down.
    let mounting = Isometry3::from_parts(
        Translation3::new(0.1, 0.2, 0.3),
        UnitQuaternion::from_euler_angles(0.0, 0.5, std::f64::consts::PI),
    );
    // The localisation corrects odometry by a turn and a shift.
    let odom = Isometry3::from_parts(
        Translation3::new(-1.0, 2.0, 0.0),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.4),
    );
    let mut messages = vec![transform(
        "/tf_static",
        START_NS,
        ["base_link", "imu_link"],
        &mounting,
    )];
    for step in 0..10 {
        let time_ns = START_NS + step * 50_000_000;
        messages.push(joints(time_ns, 1.0, 2.0));
        messages.push(imu(
            time_ns,
            "imu_link",
            &(base.rotation * mounting.rotation),
        ));
        if step % 5 == 0 {
            messages.push(transform("/tf", time_ns, ["map", "odom"], &odom));
        }
        messages.push(transform(
            "/tf",
            time_ns,
            ["odom", "base_link"],
            &(odom.inverse() * base),
        ));
    }
    let (_folder, path) = bag(&messages);
    let map = format!("{JOINTS}pose: {{kind: tf, frame: map}}");
    let log = reader(&map).read(&path).unwrap();
    assert_eq!((log.rows().len(), log.pose_count()), (10, 10));
    let row = log.rows()[9];
    assert!((row.time_s - 0.45).abs() < 1e-12);
    assert_eq!((row.speeds.left_m_s, row.speeds.right_m_s), (0.5, 1.0));
    assert!((row.attitude.roll_rad - 0.2).abs() < 1e-9);
    assert!((row.attitude.pitch_rad + 0.1).abs() < 1e-9);
    let pose = row.pose.unwrap();
    let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
    assert!(
        near(pose.x_m, 4.0) && near(pose.y_m, 5.0) && near(pose.z_m, 6.0),
        "{pose:?}"
    );
    assert!(near(pose.yaw_rad, 0.7), "{pose:?}");
    let error = error(
        &format!("{JOINTS}pose: {{kind: tf, frame: world}}"),
        &messages,
    );
    assert!(
        error.contains("do not connect base_link to world; they are: base_link in odom"),
        "{error}"
    );
}

#[test]
fn fixes_are_projected_to_the_origin_of_the_vehicle() {
    let level = ros_quaternion(&Attitude::LEVEL, 0.0);
    let mut messages = Vec::new();
    for step in 0..10 {
        let time_ns = START_NS + step * 100_000_000;
        let fix = NavSatFix {
            header: header(time_ns, "gps"),
            latitude: 36.717 + 1e-6 * step as f64,
            longitude: -4.489,
            altitude: 60.0 + 0.1 * step as f64,
            ..NavSatFix::default()
        };
        messages.push(joints(time_ns, 1.0, 1.0));
        messages.push(imu(time_ns, "base_link", &level));
        messages.push(recorded("/fix", choice::NAV_SAT_FIX, time_ns, &fix));
        let mut none = fix;
        none.status.status = -1;
        none.latitude = f64::NAN;
        messages.push(recorded("/fix", choice::NAV_SAT_FIX, time_ns + 1, &none));
    }
    let (_folder, path) = bag(&messages);
    let map = format!("{JOINTS}pose: {{kind: navsat, antenna_forward_m: 0.5, antenna_up_m: 1.5}}");
    let log = reader(&map).read(&path).unwrap();
    let pose = log.rows()[9].pose.unwrap();
    // 9e-6 deg of latitude at 36.7 deg north are 0.9989 m; heading 0 is north, and the antenna is ahead.
    assert!(
        (pose.y_m - (0.9989 - 0.5)).abs() < 1e-3 && pose.x_m.abs() < 1e-6,
        "{pose:?}"
    );
    assert!((pose.z_m - (0.9 - 1.5)).abs() < 1e-9, "{pose:?}");
    let bag = crate::bag::Bag::open(&path).unwrap();
    let path = positions(&bag, None).unwrap();
    assert_eq!(path.points_m.len(), 10);
    assert!(
        (path.points_m[9][1] - 0.9989).abs() < 1e-3 && (path.points_m[9][2] - 0.9).abs() < 1e-9
    );
    assert!(
        path.notes
            .iter()
            .any(|note| note.contains("10 fixes without a position"))
    );
}

#[test]
fn what_a_bag_lacks_is_named_with_the_key_that_decides() {
    let level = ros_quaternion(&Attitude::LEVEL, 0.0);
    let both = |time_ns| [joints(time_ns, 1.0, 1.0), imu(time_ns, "base_link", &level)];
    let messages: Vec<Recorded> = (0..3)
        .flat_map(|i| both(START_NS + i * 50_000_000))
        .collect();
    let map = "tread_speeds: {kind: joint_states, left: [lft], radius_m: 0.5}";
    let found = error(map, &messages);
    assert!(
        found.contains("no joint lft; there are: left_wheel, right_wheel"),
        "{found}"
    );
    let found = error(&format!("{JOINTS}attitude: {{kind: odometry}}"), &messages);
    assert!(
        found.contains("no topic with messages has the type nav_msgs/msg/Odometry"),
        "{found}"
    );
    assert!(
        found.contains("key `attitude` in topics.yaml")
            && found.contains("/imu (sensor_msgs/msg/Imu, 3"),
        "{found}"
    );
    // Another clock.
    let mut apart = messages.clone();
    apart.extend((0..3).map(|i| {
        let (topic, kind, _, data) = imu(i * 50_000_000 + 5, "base_link", &level);
        ("/other", kind, START_NS, {
            let _ = topic;
            data
        })
    }));
    let found = error(
        &format!("{JOINTS}attitude: {{kind: imu, topic: /other}}"),
        &apart,
    );
    assert!(
        found.contains("have no times in common") && found.contains("time: received"),
        "{found}"
    );
    let found = error(JOINTS, &apart);
    assert!(
        found.contains("several topics have the type sensor_msgs/msg/Imu"),
        "{found}"
    );
    // A message cut off, and an Imu without orientation.
    let mut cut = messages.clone();
    cut[2].3.truncate(30);
    let found = error(JOINTS, &cut);
    assert!(
        found.contains("topic /joint_states, message 2: not a message of this type"),
        "{found}"
    );
    let without = Imu {
        header: header(START_NS, "base_link"),
        orientation_covariance: [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        ..Imu::default()
    };
    let mut no_orientation = messages;
    no_orientation.push(recorded("/imu", choice::IMU, START_NS, &without));
    let found = error(JOINTS, &no_orientation);
    assert!(
        found.contains("topic /imu, message 4: it has no orientation"),
        "{found}"
    );
}

#[test]
fn bags_of_another_program_have_the_rows_of_their_csv() {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"));
    let map = std::fs::read_to_string(repository.join("tests/data/bags/topics.yaml")).unwrap();
    let reader = reader(&map);
    let csv = repository.join("plant/tests/data/drive/warthog_2023/turning.csv");
    let csv = reader.read(&csv).unwrap();
    for storage in ["mcap", "by_file"] {
        let bag = repository
            .join("tests/data/bags/warthog_2023")
            .join(storage);
        let log = reader.read(&bag).unwrap();
        assert_eq!(log.rows().len(), csv.rows().len());
        let start_s = csv.rows()[0].time_s;
        for (row, expected) in log.rows().iter().zip(csv.rows()) {
            let pose = |row: &sidehill_plant::log::LogRow| {
                let pose = row.pose.unwrap();
                [
                    pose.x_m,
                    pose.y_m,
                    pose.z_m,
                    sidehill_plant::frames::wrap_angle(pose.yaw_rad),
                ]
            };
            let mut pairs = vec![
                (row.time_s + start_s, expected.time_s),
                (row.speeds.left_m_s, expected.speeds.left_m_s),
                (row.speeds.right_m_s, expected.speeds.right_m_s),
                (row.attitude.roll_rad, expected.attitude.roll_rad),
                (row.attitude.pitch_rad, expected.attitude.pitch_rad),
            ];
            pairs.extend(pose(row).into_iter().zip(pose(expected)));
            for (found, wanted) in pairs {
                assert!(
                    (found - wanted).abs() < 1e-9,
                    "{storage}: {row:?}, {expected:?}"
                );
            }
        }
    }
}

#[test]
fn commands_of_a_bag_are_twists_and_speeds_at_their_own_times() {
    let ms = 1_000_000;
    let twist = Twist {
        linear: Vector3Message {
            x: 0.4,
            ..Vector3Message::default()
        },
        angular: Vector3Message {
            z: 0.5,
            ..Vector3Message::default()
        },
    };
    let stamped = TwistStamped {
        header: header(START_NS + 10 * ms, ""),
        twist: twist.clone(),
    };
    let at = START_NS + 30 * ms;
    let of = |command: Recorded| {
        let (_folder, path) = bag(&[
            joints(START_NS, 1.0, 3.0),
            command,
            joints(START_NS + 50 * ms, 1.0, 3.0),
        ]);
        let map = "{tread_speeds: {kind: joint_states, radius_m: 0.1}, attitude: {kind: level}, pose: {kind: none},
                    commands: {topic: /cmd_vel, track_width_m: 0.8}}";
        reader(map).read_commands(
            &path,
            &EncoderScale {
                left: 1.5,
                right: 1.5,
            },
        )
    };
    for (command, time_s) in [
        (
            recorded("/cmd_vel", "geometry_msgs/msg/Twist", at, &twist),
            0.03,
        ),
        (
            recorded("/cmd_vel", "geometry_msgs/msg/TwistStamped", at, &stamped),
            0.01,
        ),
    ] {
        let record = of(command).unwrap();
        let [command] = record.commands[..] else {
            panic!("{record:?}")
        };
        assert!((command.time_s - time_s).abs() < 1e-9, "{command:?}");
        assert!((command.speeds.traction_m_s - 0.4).abs() < 1e-12);
        assert!((command.speeds.steer_m_s - 0.2).abs() < 1e-12);
        // Both are as the drives count them, so c_l and c_r do not matter.
        assert_eq!(record.measured.len(), 2);
        assert!((record.measured[1].speeds.traction_m_s - 0.2).abs() < 1e-12);
        assert!((record.measured[1].time_s - 0.05).abs() < 1e-9);
    }
    let other = of(recorded("/cmd", "geometry_msgs/msg/Twist", at, &twist)).unwrap_err();
    assert!(other.to_string().contains("no topic /cmd_vel"), "{other}");
}
