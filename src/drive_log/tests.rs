use super::*;
use crate::bag::tests::{Recorded, bag};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::Serialize;
use sidehill_bridge::ros2::conversions::{stamp, to_pose, to_quaternion, to_transform};
use sidehill_bridge::ros2::message::cdr::to_cdr;
use sidehill_bridge::ros2::message::{
    Header, Imu, JointState, NavSatFix, PoseStamped, TfMessage, TransformStamped, Twist,
    TwistStamped, Vector3 as Vector3Message,
};
use sidehill_plant::frames::{Attitude, ros_quaternion};
use std::path::Path;

mod faults;

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
        max_bytes: None,
        topics: Some(("topics.yaml".to_owned(), TopicMap::read(&file).unwrap())),
    }
}

fn error(map: &str, messages: &[Recorded]) -> String {
    let (_folder, path) = bag(messages);
    format!("{:#}", reader(map).read(&path, drop).unwrap_err())
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
    let log = reader(&map).read(&path, drop).unwrap();
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
    let log = reader(&map).read(&path, drop).unwrap();
    let pose = log.rows()[9].pose.unwrap();
    // 9e-6 deg of latitude at 36.7 deg north are 0.9989 m; heading 0 is north, and the antenna is ahead.
    assert!(
        (pose.y_m - (0.9989 - 0.5)).abs() < 1e-3 && pose.x_m.abs() < 1e-6,
        "{pose:?}"
    );
    assert!((pose.z_m - (0.9 - 1.5)).abs() < 1e-9, "{pose:?}");
    let bag = crate::bag::Bag::open(&path, None).unwrap();
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
        found.contains("/joint_states and /other come from two clocks")
            && found.contains("time: received"),
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
    let csv = reader.read(&csv, drop).unwrap();
    for storage in ["mcap", "by_file"] {
        let bag = repository
            .join("tests/data/bags/warthog_2023")
            .join(storage);
        let log = reader.read(&bag, drop).unwrap();
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
        let scale = EncoderScale {
            left: 1.5,
            right: 1.5,
        };
        reader(map).read_commands(&path, &scale, drop)
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

fn log(map: &str, messages: &[Recorded]) -> DriveLog {
    let (_folder, path) = bag(messages);
    reader(map).read(&path, drop).unwrap()
}

const STEPS: i64 = 260;

/// A drive straight ahead at 1 m/s on level ground: joints, Imu and poses at 20 Hz.
fn straight(joints: impl Fn(i64) -> Vec<Recorded>, imu_of: &UnitQuaternion<f64>) -> Vec<Recorded> {
    let ahead = ros_quaternion(&Attitude::LEVEL, 0.0);
    let mut messages = Vec::new();
    for step in 0..STEPS {
        let time_ns = START_NS + step * 50_000_000;
        messages.extend(joints(time_ns));
        messages.push(imu(time_ns, "base_link", imu_of));
        let at = Translation3::new(0.0, 0.05 * step as f64, 0.0);
        messages.push(posed(time_ns, &Isometry3::from_parts(at, ahead)));
    }
    messages
}

fn posed(time_ns: i64, pose: &Isometry3<f64>) -> Recorded {
    let message = PoseStamped {
        header: header(time_ns, "map"),
        pose: to_pose(pose),
    };
    recorded("/pose", choice::POSE_STAMPED, time_ns, &message)
}

fn named_joints(time_ns: i64, joints: &[(&str, f64)]) -> Recorded {
    let message = JointState {
        header: header(time_ns, ""),
        name: joints.iter().map(|(name, _)| (*name).to_owned()).collect(),
        velocity: joints.iter().map(|(_, velocity)| *velocity).collect(),
        ..JointState::default()
    };
    recorded("/joint_states", choice::JOINT_STATE, time_ns, &message)
}

#[test]
fn joints_are_of_the_side_that_their_names_tell_and_arms_are_no_wheels() {
    let level = UnitQuaternion::identity();
    for names in [
        ["lf_wheel", "lr_wheel", "rf_wheel", "rr_wheel"],
        ["fl_wheel", "rl_wheel", "fr_wheel", "rr_wheel"],
        [
            "WheelFrontLeft",
            "WheelBackLeft",
            "WheelFrontRight",
            "WheelBackRight",
        ],
    ] {
        let joints = |time_ns| {
            let mut joints = names.map(|name| (name, 2.0)).to_vec();
            joints[2].1 = 3.0;
            joints.push(("left_arm_shoulder", 40.0));
            vec![named_joints(time_ns, &joints)]
        };
        let log = log(JOINTS, &straight(joints, &level));
        let speeds = log.rows()[5].speeds;
        assert_eq!(
            (speeds.left_m_s, speeds.right_m_s),
            (1.0, 1.25),
            "{names:?}"
        );
    }
    let unnamed = |time_ns| vec![named_joints(time_ns, &[("a_wheel", 1.0), ("b_wheel", 1.0)])];
    let found = error(JOINTS, &straight(unnamed, &level));
    assert!(
        found.contains("do not tell left from right; they are: a_wheel, b_wheel"),
        "{found}"
    );
    let no_velocity = |time_ns| {
        let message = JointState {
            header: header(time_ns, ""),
            name: vec!["left_wheel".to_owned(), "right_wheel".to_owned()],
            position: vec![1.0, 2.0],
            ..JointState::default()
        };
        vec![recorded(
            "/joint_states",
            choice::JOINT_STATE,
            time_ns,
            &message,
        )]
    };
    let found = error(JOINTS, &straight(no_velocity, &level));
    assert!(found.contains("have no velocities"), "{found}");
    let uneven = |time_ns| {
        let joints = [
            ("left_wheel_1", 1.0),
            ("left_wheel_2", 1.0),
            ("right_wheel", 1.0),
        ];
        vec![named_joints(time_ns, &joints)]
    };
    let found = error(JOINTS, &straight(uneven, &level));
    assert!(
        found.contains("2 joints on the left") && found.contains("`left`"),
        "{found}"
    );
}

#[test]
fn sides_with_messages_of_their_own_make_tread_speeds() {
    let apart = |time_ns| {
        vec![
            named_joints(time_ns, &[("left_wheel", 2.0)]),
            named_joints(time_ns + 7_000_000, &[("right_wheel", 4.0)]),
        ]
    };
    let log = log(JOINTS, &straight(apart, &UnitQuaternion::identity()));
    assert!(log.rows().len() > 50);
    let speeds = log.rows()[20].speeds;
    assert_eq!((speeds.left_m_s, speeds.right_m_s), (1.0, 2.0));
}

#[test]
fn a_side_that_counts_backwards_is_named_and_reversed_by_its_key() {
    let backwards = |time_ns| vec![joints(time_ns, 2.0, -2.0)];
    let messages = straight(backwards, &UnitQuaternion::identity());
    let found = log(JOINTS, &messages).suspicions();
    assert!(
        matches!(
            found[..],
            [sidehill_plant::log::Suspicion::SideReversed { side: "right" }]
        ),
        "{found:?}"
    );
    let map = JOINTS.replace("0.5}", "0.5, reversed: right}");
    assert_eq!(log(&map, &messages).suspicions(), []);
}

#[test]
fn an_imu_with_other_axes_is_named_and_turned_by_its_key() {
    let slope = Attitude {
        roll_rad: 0.2,
        pitch_rad: -0.1,
    };
    let world_from_base = ros_quaternion(&slope, 0.7);
    let forward = |time_ns| vec![joints(time_ns, 2.0, 2.0)];
    let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    // The same rotation between north, east, down and forward, right, down, by its matrix.
    let swap = nalgebra::Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let flip = nalgebra::Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    let ned = swap * world_from_base.to_rotation_matrix().matrix() * flip;
    let ned = UnitQuaternion::from_matrix(&ned);
    for (sensor, axes) in [(world_from_base * over, "upside_down"), (ned, "ned")] {
        let messages = straight(forward, &sensor);
        if axes == "upside_down" {
            let found = error(JOINTS, &messages);
            assert!(
                found.contains("on its back") && found.contains("axes: ned"),
                "{found}"
            );
        }
        let map = format!("{JOINTS}attitude: {{kind: imu, axes: {axes}}}");
        let attitude = log(&map, &messages).rows()[3].attitude;
        assert!(
            (attitude.roll_rad - 0.2).abs() < 1e-6,
            "{axes}: {attitude:?}"
        );
        assert!(
            (attitude.pitch_rad + 0.1).abs() < 1e-6,
            "{axes}: {attitude:?}"
        );
    }
}

#[test]
fn poses_with_a_stamp_and_transforms_give_the_attitude() {
    let slope = Attitude {
        roll_rad: 0.15,
        pitch_rad: 0.05,
    };
    let mut messages = Vec::new();
    for step in 0..10 {
        let time_ns = START_NS + step * 50_000_000;
        let pose = Isometry3::from_parts(
            Translation3::new(1.0, 2.0, 3.0),
            ros_quaternion(&slope, 0.3),
        );
        messages.push(joints(time_ns, 2.0, 2.0));
        messages.push(posed(time_ns, &pose));
        messages.push(transform("/tf", time_ns, ["map", "base_link"], &pose));
    }
    for attitude in ["{kind: pose_stamped}", "{kind: tf, frame: map}"] {
        let log = log(&format!("{JOINTS}attitude: {attitude}"), &messages);
        let row = log.rows()[4];
        assert!(
            (row.attitude.roll_rad - 0.15).abs() < 1e-9,
            "{attitude}: {row:?}"
        );
        assert!(
            (row.pose.unwrap().yaw_rad - 0.3).abs() < 1e-9,
            "{attitude}: {row:?}"
        );
    }
}

#[test]
fn a_route_knows_no_heights_gaps_or_jumps_that_were_not_recorded() {
    let drive = |place: &dyn Fn(i64) -> Option<[f64; 3]>| {
        let mut messages = Vec::new();
        for step in 0..100 {
            let time_ns = START_NS + step * 200_000_000;
            let Some([latitude, longitude, altitude]) = place(step) else {
                continue;
            };
            let fix = NavSatFix {
                header: header(time_ns, "gps"),
                latitude,
                longitude,
                altitude,
                ..NavSatFix::default()
            };
            messages.push(recorded("/fix", choice::NAV_SAT_FIX, time_ns, &fix));
        }
        let (folder, path) = bag(&messages);
        let bag = crate::bag::Bag::open(&path, None).unwrap();
        let found = positions(&bag, None).map_err(|error| format!("{error:#}"));
        drop(folder);
        found
    };
    let at = |step: i64| 46.5 + 2e-6 * step as f64;
    let plain = drive(&|step| Some([at(step), 11.3, 300.0])).unwrap();
    assert!(
        plain.has_heights && plain.notes.len() == 1,
        "{:?}",
        plain.notes
    );
    let flat = drive(&|step| Some([at(step), 11.3, f64::NAN])).unwrap();
    assert_eq!((flat.points_m.len(), flat.has_heights), (100, false));
    assert!(
        flat.points_m
            .iter()
            .flatten()
            .all(|value| value.is_finite())
    );
    let zeros = drive(&|step| {
        Some(if step % 9 == 0 {
            [0.0; 3]
        } else {
            [at(step), 11.3, 300.0]
        })
    })
    .unwrap();
    assert_eq!(zeros.points_m.len(), 88);
    assert!(
        zeros
            .notes
            .iter()
            .any(|note| note.contains("12 fixes without a position"))
    );
    let gone = drive(&|step| (!(40..60).contains(&step)).then(|| [at(step), 11.3, 300.0])).unwrap();
    assert!(
        gone.notes
            .iter()
            .any(|note| note.contains("missing 1 times, for 4.2 s and 4.7 m")),
        "{:?}",
        gone.notes
    );
    let error = drive(&|_| Some([f64::NAN; 3])).unwrap_err();
    assert!(
        error.contains("none of its 100 fixes has a position"),
        "{error}"
    );
    let error =
        drive(&|step| Some([at(step) + f64::from(u8::from(step > 50)), 11.3, 300.0])).unwrap_err();
    assert!(
        error.contains("positions jump by 111") && error.contains("10.00 s after"),
        "{error}"
    );
}
