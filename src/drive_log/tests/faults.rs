//! Logs whose sources have faults.

use super::*;

#[test]
fn stamps_of_two_clocks_are_refused_and_times_of_recording_taken() {
    let mut messages = straight(
        |time_ns| vec![joints(time_ns, 2.0, 2.0)],
        &UnitQuaternion::identity(),
    );
    // The Imu stamps with the time of GPS, 18 s ahead of UTC.
    for (topic, _, time_ns, data) in &mut messages {
        if *topic == "/imu" {
            let ahead = imu(
                *time_ns + 18_000_000_000,
                "base_link",
                &UnitQuaternion::identity(),
            );
            *data = ahead.3;
        }
    }
    let found = error(JOINTS, &messages);
    assert!(
        found.contains("/imu")
            && found.contains("18.00 s apart")
            && found.contains("time: received"),
        "{found}"
    );
    let log = log(&format!("{JOINTS}time: received"), &messages);
    assert_eq!(log.rows().len() as i64, STEPS);
}

#[test]
fn values_that_are_no_numbers_are_left_out_and_topics_without_any_refused() {
    let forward = |time_ns| vec![joints(time_ns, 2.0, 2.0)];
    let mut messages = straight(forward, &UnitQuaternion::identity());
    let lost = Isometry3::from_parts(
        Translation3::new(f64::NAN, 0.0, 0.0),
        UnitQuaternion::identity(),
    );
    let time_ns = START_NS + 10 * 50_000_000;
    for message in &mut messages {
        if message.0 == "/pose" && message.2 == time_ns {
            *message = posed(time_ns, &lost);
        }
    }
    assert_eq!(log(JOINTS, &messages).pose_count() as i64, STEPS - 1);
    for message in &mut messages {
        if message.0 == "/pose" {
            *message = posed(message.2, &lost);
        }
    }
    let found = error(JOINTS, &messages);
    assert!(
        found.contains(
            "topic /pose: none of its 260 messages can be used; of the first position is not finite"
        ),
        "{found}"
    );
}

/// A drive with one message of a topic changed, by its step.
fn changed(topic: &str, change: impl Fn(i64, Recorded) -> Recorded) -> Vec<Recorded> {
    let forward = |time_ns| vec![joints(time_ns, 2.0, 2.0)];
    let messages = straight(forward, &UnitQuaternion::identity()).into_iter();
    let changed = messages.map(|message| {
        let step = (message.2 - START_NS) / 50_000_000;
        match message.0 == topic {
            true => change(step, message),
            false => message,
        }
    });
    changed.collect()
}

#[test]
fn a_clock_that_is_set_and_a_frame_that_changes_are_named_with_their_message() {
    let back = changed("/imu", |step, message| {
        let set_s = if step < 100 { 0 } else { 5 };
        let stamp_ns = message.2 - set_s * 1_000_000_000;
        let of_imu = imu(stamp_ns, "base_link", &UnitQuaternion::identity());
        (message.0, message.1, message.2, of_imu.3)
    });
    let found = error(JOINTS, &back);
    for says in ["topic /imu, message 101", "4.95 s before", "time: received"] {
        assert!(found.contains(says), "{found}");
    }
    let log = log(&format!("{JOINTS}time: received"), &back);
    assert_eq!(log.rows().len() as i64, STEPS);
    let other = changed("/pose", |step, message| {
        let frame = if step < 200 { "map" } else { "odom" };
        let pose = PoseStamped {
            header: header(message.2, frame),
            pose: to_pose(&Isometry3::identity()),
        };
        recorded("/pose", choice::POSE_STAMPED, message.2, &pose)
    });
    let found = error(JOINTS, &other);
    for says in ["topic /pose, message 201", "\"odom\"", "\"map\""] {
        assert!(found.contains(says), "{found}");
    }
}

#[test]
fn joints_without_velocities_are_named_with_bag_topic_and_key() {
    let lost = changed("/joint_states", |step, message| match step % 50 {
        7 => joints(message.2, f64::NAN, 2.0),
        _ => message,
    });
    let (_folder, path) = bag(&lost);
    let found = crate::bag::Bag::open(&path, None).unwrap();
    let chosen = Chosen::of(&found, reader(JOINTS).topics.as_ref()).unwrap();
    let notes = series::read(&found, &chosen).unwrap().notes;
    assert!(
        notes
            .iter()
            .any(|note| note.contains("/joint_states: 6 velocities of left_wheel are not finite")),
        "{notes:?}"
    );
    let short = changed("/joint_states", |_, message| {
        let state = JointState {
            header: header(message.2, ""),
            name: ["right_wheel", "left_wheel"].map(str::to_owned).to_vec(),
            velocity: vec![2.0],
            ..JointState::default()
        };
        recorded("/joint_states", choice::JOINT_STATE, message.2, &state)
    });
    let found = error(JOINTS, &short);
    for says in [
        "/joint_states: joint left_wheel has no velocities",
        "--topics",
    ] {
        assert!(found.contains(says), "{found}");
    }
}
