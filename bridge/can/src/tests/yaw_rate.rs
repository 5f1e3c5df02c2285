//! The yaw rate of a gyroscope, which a layout may have.

use super::*;

/// The layout with the yaw rate that `can.yaml` shows as a comment.
fn yaw_rate_yaml() -> String {
    YAML.replace("# yaw_rate:", "yaw_rate:").replace(
        "per_unit: -57.29577951308232}, latency_s: 0.0",
        "per_unit: -57.29577951308232}, latency_s: 0.02",
    )
}

pub(super) fn yaw_rate_layout() -> Arc<Layout> {
    let config: CanConfig = serde_yaml::from_str(&yaw_rate_yaml()).unwrap();
    let database = Database::parse("j8.dbc", DBC).unwrap();
    Arc::new(Layout::new(&config, &database).unwrap())
}

#[test]
fn a_yaw_rate_arrives_where_the_layout_has_one() {
    let without = reported(&mut ReportWriter::new(layout()), &report(0.4), false);
    assert_eq!(without.len(), 5);
    let layout = yaw_rate_layout();
    let mut reader = VehicleReader::new(Arc::clone(&layout));
    let frames = reported(
        &mut ReportWriter::new(Arc::clone(&layout)),
        &report(0.4),
        false,
    );
    let message = layout.yaw_rate.as_ref().unwrap();
    assert!(layout.received_ids().contains(&message.id()));
    for frame in &frames {
        reader.take(frame, 3.0).unwrap();
    }
    let reading = reader.readings().yaw_rate.unwrap();
    assert!(
        (reading.value + 0.4).abs() < 1e-4 && reading.time_s == 2.98,
        "{reading:?}"
    );
    // Counter-clockwise is up, and this sensor's z points down: 22.92 deg/s in steps of 0.01.
    let frame = frames
        .iter()
        .find(|frame| frame.id == message.id())
        .unwrap();
    assert_eq!(frame.data[..2], 2292_i16.to_be_bytes());
    // Without a reading nothing is sent.
    let silent = VehicleReport {
        yaw_rate_rad_s: None,
        ..report(0.4)
    };
    assert_eq!(
        reported(&mut ReportWriter::new(layout), &silent, false).len(),
        5
    );
}

#[test]
fn a_refused_yaw_rate_is_counted_and_leaves_the_other_readings() {
    let layout = yaw_rate_layout();
    let mut reader = VehicleReader::new(Arc::clone(&layout));
    let id = layout.yaw_rate.as_ref().unwrap().id();
    let mut writer = ReportWriter::new(layout);
    for (cycle, frame) in [0, 1].into_iter().flat_map(|cycle| {
        let frames = reported(&mut writer, &report(0.4), false);
        frames.into_iter().map(move |frame| (cycle, frame))
    }) {
        let mut frame = frame;
        if cycle == 1 && frame.id == id {
            frame.data[0] ^= 1;
            let refused = reader.take(&frame, f64::from(cycle));
            assert!(
                matches!(refused, Err(FrameFault::Checksum { .. })),
                "{refused:?}"
            );
        } else {
            reader.take(&frame, f64::from(cycle)).unwrap();
        }
    }
    let readings = reader.readings();
    assert_eq!((readings.taken, readings.refused), (11, 1));
    assert_eq!(readings.yaw_rate.unwrap().time_s, -0.02);
    assert_eq!(readings.attitude.unwrap().time_s, 1.0);
    assert_eq!(readings.drives.map(|drive| drive.unwrap().time_s), [1.0; 2]);
    assert_eq!(readings.pose.unwrap().time_s, 1.0);
}

#[test]
fn a_yaw_rate_that_the_layout_has_wrong_is_named() {
    for (from, to, says) in [
        (
            "message: AhrsYawRate",
            "message: AhrsRate",
            "j8.dbc: message AhrsRate is not defined",
        ),
        (
            "message: AhrsYawRate",
            "message: AhrsAttitude",
            "message AhrsAttitude has no signal YawRate",
        ),
        (
            "latency_s: 0.02",
            "latency_s: 2",
            "message AhrsYawRate: latency_s: 2",
        ),
    ] {
        let error = refusal(DBC, &yaw_rate_yaml().replace(from, to));
        assert!(error.to_string().contains(says), "{error}");
    }
}
