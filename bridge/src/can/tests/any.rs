//! Whatever is on the bus, and whatever stands in a database or layout.

use super::*;
use proptest::prelude::*;

const CANOPEN_DBC: &str = include_str!("../../../../config/bridge/cia402.dbc");
const CANOPEN_YAML: &str = include_str!("../../../../config/bridge/cia402.yaml");

/// Text with pieces cut out, doubled and replaced.
fn mangled(text: &'static str) -> impl Strategy<Value = String> {
    let edit = (
        any::<prop::sample::Index>(),
        any::<prop::sample::Index>(),
        0..4u8,
        "[ -~\n]{0,6}",
    );
    prop::collection::vec(edit, 1..6).prop_map(move |edits| {
        let mut text = text.to_owned();
        for (at, length, kind, insert) in edits {
            let at = at.index(text.len() + 1).min(text.len());
            let end = (at + length.index(24)).min(text.len());
            if !text.is_char_boundary(at) || !text.is_char_boundary(end) {
                continue;
            }
            let piece = text[at..end].to_owned();
            match kind {
                0 => text.replace_range(at..end, ""),
                1 => text.insert_str(at, &piece),
                2 => text.replace_range(at..end, &insert),
                _ => text.insert_str(at, &insert),
            }
        }
        text
    })
}

/// Whatever is accepted works: every signal round-trips within the frame.
fn check_sane(layout: &Layout) {
    for message in layout.command.iter().chain(layout.from_vehicle()) {
        assert!((1..=8).contains(&message.length));
        for field in message.fields() {
            assert!(field.codec.fits(usize::from(message.length)));
            assert!(field.codec.scale != 0.0 && field.per_unit != 0.0);
            assert!(field.codec.scale.is_finite() && field.per_unit.is_finite());
            assert!(field.codec.encode(f64::NAN, &mut [0; 8]).is_err());
        }
        match message.encode(0, |_| 0.0) {
            Ok(frame) => assert!(message.decode(&frame).is_ok()),
            Err(fault) => assert!(matches!(fault, FrameFault::Value { .. }), "{fault}"),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn any_frame_is_refused_or_within_range(extended: bool, id in 0..6usize, length in 0..=8u8, data: [u8; 8]) {
        let layout = layout();
        let id = match (extended, layout.from_vehicle().get(id)) {
            (_, Some(message)) => message.id(),
            (true, None) => FrameId::Extended(u32::from_le_bytes([data[0], data[1], data[2], data[3] & 0x1F])),
            (false, None) => layout.command[0].id(),
        };
        let frame = Frame::new(id, &data[..usize::from(length)]).unwrap();
        let mut reader = VehicleReader::new(Arc::clone(&layout));
        let _ = reader.take(&frame, 0.0);
        let readings = *reader.readings();
        for motor in readings.drives.into_iter().flatten() {
            prop_assert!(motor.value.speed_m_s.abs() <= 3.5);
        }
        if let Some(attitude) = readings.attitude {
            prop_assert!(attitude.value.is_finite());
        }
        let mut drives = told_by(&layout);
        let _ = drives.take(&frame, 0.0);
        if let Some(told) = drives.told() {
            prop_assert!(told.order.motors.traction_m_s.abs() < 3.2 && told.order.motors.steer_m_s.abs() < 3.2);
        }
    }

    #[test]
    fn a_right_checksum_on_any_payload_is_still_checked_for_range(data: [u8; 8]) {
        // The widest acceptance there is: the checksum made to fit.
        let layout = layout();
        let mut frame = Frame::new(layout.drives[0].message.id(), &data).unwrap();
        if let Err(FrameFault::Checksum { computed, .. }) = layout.drives[0].message.decode(&frame) {
            frame.data[7] = computed;
        }
        let mut reader = VehicleReader::new(layout);
        match reader.take(&frame, 0.0) {
            Ok(()) => {
                let speed = reader.readings().drives[0].unwrap().value.speed_m_s;
                prop_assert!(speed.abs() <= 3200.05 / 940.0, "{}", speed);
            }
            Err(FrameFault::Value { .. } | FrameFault::State { .. }) => {}
            Err(other) => prop_assert!(false, "{other}"),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    #[test]
    fn a_mangled_database_is_refused_or_usable(text in mangled(DBC)) {
        if let Ok(database) = Database::parse("j8.dbc", &text)
            && let Ok(layout) = Layout::new(&config(), &database)
        {
            check_sane(&layout);
        }
    }

    #[test]
    fn a_mangled_database_of_canopen_is_refused_or_usable(text in mangled(CANOPEN_DBC)) {
        let config: CanConfig = serde_yaml::from_str(CANOPEN_YAML).unwrap();
        match Database::parse("cia402.dbc", &text) {
            Err(error) => prop_assert!(error.to_string().starts_with("cia402.dbc: ")),
            Ok(database) => if let Ok(layout) = Layout::new(&config, &database) {
                check_sane(&layout);
            }
        }
    }

    #[test]
    fn a_mangled_layout_is_refused_or_usable(text in mangled(YAML)) {
        if let Ok(config) = serde_yaml::from_str::<CanConfig>(&text)
            && let Ok(layout) = Layout::new(&config, &Database::parse("j8.dbc", DBC).unwrap())
        {
            check_sane(&layout);
        }
    }

    #[test]
    fn any_text_is_no_database(text in "\\PC*") {
        if let Ok(database) = Database::parse("x", &text) {
            prop_assert_eq!(database.message_count(), 0);
        }
    }
}
