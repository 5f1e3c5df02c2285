//! Any frame on the bus, and any text in a database or layout.

use super::*;
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use std::cell::Cell;

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

/// Whatever is accepted works: every signal lies and round-trips within the frame.
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

/// Runs `check` on many values and returns the share of those that it accepted, so that a test cannot
/// pass because everything is refused.
fn accepted_share<S: Strategy>(
    cases: u32,
    values: S,
    check: impl Fn(S::Value) -> Result<bool, TestCaseError>,
) -> f64 {
    let accepted = Cell::new(0u32);
    let mut runner = TestRunner::new(Config {
        failure_persistence: None,
        ..Config::with_cases(cases)
    });
    let result = runner.run(&values, |value| {
        accepted.set(accepted.get() + u32::from(check(value)?));
        Ok(())
    });
    result.unwrap_or_else(|error| panic!("{error}"));
    f64::from(accepted.get()) / f64::from(cases)
}

/// Any payload, half of the time with the right checksum of the message.
fn payload() -> impl Strategy<Value = (bool, [u8; 8])> {
    (any::<bool>(), any::<[u8; 8]>())
}

fn frame_of(message: &MessageCodec, (seal, data): (bool, [u8; 8])) -> Frame {
    let mut frame = Frame::new(message.id(), &data[..usize::from(message.length)]).unwrap();
    if seal && let Err(FrameFault::Checksum { computed, .. }) = message.decode(&frame) {
        frame.data[message.checksum.as_ref().unwrap().byte] = computed;
    }
    frame
}

/// With the right checksum, only a value or a state can be wrong.
fn is_accepted(seal: bool, result: Result<(), FrameFault>) -> Result<bool, TestCaseError> {
    match result {
        Ok(()) => Ok(true),
        Err(FrameFault::Value { .. } | FrameFault::State { .. }) => Ok(false),
        Err(fault) => {
            prop_assert!(!seal, "{fault}");
            Ok(false)
        }
    }
}

#[test]
fn any_frame_from_the_vehicle_is_refused_or_within_range() {
    let layout = super::yaw_rate::yaw_rate_layout();
    for index in 0..Layout::FROM_VEHICLE_MAX {
        let share = accepted_share(4000, payload(), |(seal, data)| {
            let frame = frame_of(layout.from_vehicle().nth(index).unwrap(), (seal, data));
            let mut reader = VehicleReader::new(Arc::clone(&layout));
            let accepted = is_accepted(seal, reader.take(&frame, 0.0))?;
            let readings = *reader.readings();
            for motor in readings.drives.into_iter().flatten() {
                prop_assert!(motor.value.speed_m_s.abs() <= 3200.05 / 940.0);
            }
            prop_assert!(readings.attitude.is_none_or(|a| a.value.is_finite()));
            prop_assert!(
                readings
                    .yaw_rate
                    .is_none_or(|y| y.value.abs() <= 300.005_f64.to_radians())
            );
            prop_assert_eq!(readings.refused, u64::from(!accepted));
            Ok(accepted)
        });
        assert!(share > 0.001, "message {index}: {share} accepted");
    }
}

#[test]
fn any_frame_to_the_drives_is_refused_or_within_range() {
    let layout = layout();
    for message in &layout.command {
        let share = accepted_share(4000, payload(), |(seal, data)| {
            let mut drives = command_reader(&layout);
            let accepted = is_accepted(seal, drives.take(&frame_of(message, (seal, data)), 0.0))?;
            if let Some(command) = drives.command() {
                let speeds = command.value.speeds;
                prop_assert!(speeds.traction_m_s.abs() < 3.2 && speeds.steer_m_s.abs() < 3.2);
            }
            Ok(accepted)
        });
        assert!(share > 0.001, "{}: {share} accepted", message.name);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn any_frame_of_another_length_or_identifier_changes_nothing(extended: bool, id: u32, length in 0..=8u8, data: [u8; 8]) {
        let layout = layout();
        let id = if extended { FrameId::Extended(id & 0x1FFF_FFFF) } else { FrameId::Standard((id & 0x7FF) as u16) };
        let frame = Frame::new(id, &data[..usize::from(length)]).unwrap();
        let known = layout.from_vehicle().any(|message| message.id() == id && message.length == length);
        prop_assume!(!known);
        let mut reader = VehicleReader::new(layout);
        let _ = reader.take(&frame, 0.0);
        prop_assert_eq!(reader.readings().drives, [None; 2]);
        prop_assert!(reader.readings().attitude.is_none() && reader.readings().pose.is_none());
    }

    #[test]
    fn any_text_is_no_database(text in "\\PC*") {
        match Database::parse("x", &text) {
            Ok(database) => prop_assert_eq!(database.message_count(), 0),
            Err(error) => prop_assert!(error.to_string().starts_with("x: ")),
        }
    }
}

/// Asserts that a mangled text is refused, with an error that names the file where it is the
/// database's, or usable; and that both happen.
fn check_mangled(
    text: &'static str,
    make: impl Fn(&str) -> Result<Layout, String>,
    names_the_file: impl Fn(&str) -> bool,
) {
    let share = accepted_share(1500, mangled(text), |text| match make(&text) {
        Ok(layout) => {
            check_sane(&layout);
            Ok(true)
        }
        Err(error) => {
            prop_assert!(names_the_file(&error), "{error}");
            Ok(false)
        }
    });
    println!("{:.1} % of the mangled texts are accepted", 100.0 * share);
    assert!((0.01..0.99).contains(&share), "{share} accepted");
}

fn layout_of(file: &str, database: &str, config: &CanConfig) -> Result<Layout, String> {
    let database = Database::parse(file, database).map_err(|error| error.to_string())?;
    Layout::new(config, &database).map_err(|error| error.to_string())
}

#[test]
fn a_mangled_database_is_refused_or_usable() {
    let config = config();
    let make = |text: &str| layout_of("j8.dbc", text, &config);
    check_mangled(DBC, make, |error| error.contains("j8.dbc"));
}

#[test]
fn a_mangled_database_of_canopen_is_refused_or_usable() {
    let config: CanConfig = serde_yaml::from_str(CANOPEN_YAML).unwrap();
    let make = |text: &str| layout_of("cia402.dbc", text, &config);
    check_mangled(CANOPEN_DBC, make, |error| error.contains("cia402.dbc"));
}

#[test]
fn a_mangled_layout_is_refused_or_usable() {
    let make = |text: &str| {
        let config = serde_yaml::from_str::<CanConfig>(text).map_err(|error| error.to_string())?;
        layout_of("j8.dbc", DBC, &config)
    };
    check_mangled(YAML, make, |error| !error.is_empty());
}
