mod any;
mod yaw_rate;

use super::config::CanConfig;
use super::controller_side::{CommandWriter, MotorReport, VehicleReader};
use super::database::{Database, DatabaseFault};
use super::frame::{Frame, FrameId};
use super::layout::{Layout, LayoutError, Profile};
use super::message::{FrameFault, MessageCodec};
use super::vehicle_side::{CommandReader, ReportWriter, VehicleReport};
use sidehill_bridge::drives::DriveMode;
use sidehill_bridge::drives::{MeasuredMotorSpeeds, MotorCommand};
use sidehill_plant::frames::{Attitude, Pose};
use std::sync::{Arc, LazyLock};

const DBC: &str = include_str!("../../../config/bridge/j8.dbc");
const YAML: &str = include_str!("../../../config/bridge/can.yaml");

fn config() -> CanConfig {
    serde_yaml::from_str(YAML).unwrap()
}

fn layout() -> Arc<Layout> {
    // Read once: tests of any frame ask for it in each of thousands of cases.
    static LAYOUT: LazyLock<Arc<Layout>> = LazyLock::new(|| {
        let database = Database::parse("j8.dbc", DBC).unwrap();
        Arc::new(Layout::new(&config(), &database).unwrap())
    });
    Arc::clone(&LAYOUT)
}

fn writer(layout: &Arc<Layout>) -> CommandWriter {
    let Profile::Values(enable) = layout.profile else {
        panic!("not switched by values");
    };
    CommandWriter::new(Arc::clone(layout), enable)
}

fn command_reader(layout: &Arc<Layout>) -> CommandReader {
    let Profile::Values(enable) = layout.profile else {
        panic!("not switched by values");
    };
    CommandReader::new(Arc::clone(layout), enable)
}

fn refusal(dbc: &str, yaml: &str) -> LayoutError {
    let config: CanConfig = serde_yaml::from_str(yaml).unwrap();
    Layout::new(&config, &Database::parse("j8.dbc", dbc).unwrap())
        .err()
        .unwrap()
}

fn order(traction_m_s: f64, steer_m_s: f64, enable: bool) -> MotorCommand {
    MotorCommand {
        speeds: MeasuredMotorSpeeds {
            traction_m_s,
            steer_m_s,
        },
        enable,
    }
}

fn frames(writer: &mut CommandWriter, order: &MotorCommand) -> Vec<Frame> {
    let mut frames = Vec::new();
    writer
        .write::<FrameFault>(order, |frame| {
            frames.push(*frame);
            Ok(())
        })
        .unwrap();
    frames
}

fn report(speed_m_s: f64) -> VehicleReport {
    let motor = |speed_m_s| MotorReport {
        speed_m_s,
        mode: DriveMode::Enabled,
    };
    VehicleReport {
        drives: Some([motor(speed_m_s), motor(-speed_m_s)]),
        attitude: Some(Attitude {
            roll_rad: 0.2,
            pitch_rad: -0.3,
        }),
        yaw_rate_rad_s: Some(-0.4),
        pose: Some(Pose {
            x_m: 1.234,
            y_m: -56.789,
            z_m: 0.5,
            yaw_rad: 2.0,
        }),
    }
}

fn reported(writer: &mut ReportWriter, report: &VehicleReport, frozen: bool) -> Vec<Frame> {
    let mut frames = Vec::new();
    writer
        .write(report, frozen, |frame| frames.push(frame))
        .unwrap();
    frames
}

/// The same bytes and values as cantools, an independent implementation.
#[test]
fn signals_are_coded_as_cantools_codes_them() {
    let dbc = include_str!("../tests/data/codec.dbc");
    let vectors = include_str!("../tests/data/codec_vectors.csv");
    let database = Database::parse("codec.dbc", dbc).unwrap();
    let mut rows = 0;
    for row in csv::Reader::from_reader(vectors.as_bytes()).records() {
        let row = row.unwrap();
        let message = database.message(&row[0]).unwrap();
        let id: u32 = row[3].parse().unwrap();
        let expected_id = if &row[4] == "1" {
            FrameId::Extended(id)
        } else {
            FrameId::Standard(id as u16)
        };
        assert_eq!(message.id, expected_id);
        let mut expected = [0; 8];
        for (i, byte) in expected[..usize::from(message.length)]
            .iter_mut()
            .enumerate()
        {
            *byte = u8::from_str_radix(&row[5][2 * i..2 * i + 2], 16).unwrap();
        }
        let mut data = [0; 8];
        for (name, value) in row[1].split(' ').zip(row[2].split(' ')) {
            let value: f64 = value.parse().unwrap();
            let signal = message.signal(name).unwrap();
            signal.codec.encode(value, &mut data).unwrap();
            let back = signal.codec.decode(&expected).unwrap();
            let tolerance = 1e-6 * value.abs().max(1.0);
            assert!((back - value).abs() < tolerance, "{name}: {back} {value}");
            if let Some((switch, page)) = signal.page {
                assert_eq!(switch.extract(&expected), page);
            }
        }
        assert_eq!(data, expected, "{row:?}");
        rows += 1;
    }
    assert_eq!(rows, 300);
}

#[test]
fn a_command_reaches_the_drives_and_a_report_the_controller() {
    let layout = layout();
    let mut drives = command_reader(&layout);
    let mut writer = writer(&layout);
    assert_eq!(drives.command(), None);
    for frame in frames(&mut writer, &order(0.5, -0.25, true)) {
        drives.take(&frame, 7.0).unwrap();
    }
    let told = drives.command().unwrap();
    assert!(told.value.enable && told.time_s == 7.0);
    assert!((told.value.speeds.traction_m_s - 0.5).abs() < 1e-4);
    assert!((told.value.speeds.steer_m_s + 0.25).abs() < 1e-4);

    let mut reader = VehicleReader::new(Arc::clone(&layout));
    for frame in reported(&mut ReportWriter::new(layout), &report(0.4), false) {
        reader.take(&frame, 3.0).unwrap();
    }
    let readings = reader.readings();
    let (traction, attitude, pose) = (
        readings.drives[0].unwrap().value,
        readings.attitude.unwrap().value,
        readings.pose.unwrap().value,
    );
    assert!((traction.speed_m_s - 0.4).abs() < 1e-4 && traction.mode == DriveMode::Enabled);
    assert!((attitude.roll_rad - 0.2).abs() < 1e-4);
    assert!((attitude.pitch_rad + 0.3).abs() < 1e-4);
    assert!((pose.y_m + 56.789).abs() < 1e-3 && (pose.yaw_rad - 2.0).abs() < 1e-4);
}

#[test]
fn speeds_that_are_not_finite_or_too_large_are_not_sent() {
    let mut writer = writer(&layout());
    for speed in [f64::NAN, f64::INFINITY, 3.3, -1e9] {
        let result = writer.write::<FrameFault>(&order(speed, 0.0, true), |_| Ok(()));
        assert!(
            matches!(result, Err(FrameFault::Value { .. })),
            "{result:?}"
        );
    }
}

#[test]
fn frames_that_repeat_skip_or_are_damaged_are_refused() {
    let layout = layout();
    let mut reader = VehicleReader::new(Arc::clone(&layout));
    let mut writer = ReportWriter::new(Arc::clone(&layout));
    let first = reported(&mut writer, &report(0.1), false);
    reader.take(&first[0], 0.0).unwrap();
    assert!(matches!(
        reader.take(&first[0], 0.1),
        Err(FrameFault::CounterRepeated { counter: 0 })
    ));
    for _ in 0..2 {
        reported(&mut writer, &report(0.1), false);
    }
    // Two counts missing pass, three do not, and counting goes on from there.
    let after_gap = reported(&mut writer, &report(0.2), false);
    reader.take(&after_gap[0], 0.2).unwrap();
    for _ in 0..3 {
        reported(&mut writer, &report(0.1), false);
    }
    let lost = reported(&mut writer, &report(0.3), false);
    assert!(matches!(
        reader.take(&lost[0], 0.3),
        Err(FrameFault::CounterSkipped {
            before: 3,
            counter: 7
        })
    ));
    let next = reported(&mut writer, &report(0.4), false);
    reader.take(&next[0], 0.4).unwrap();

    let good = reported(&mut writer, &report(0.5), false)[0];
    for bit in 0..64 {
        let mut damaged = good;
        damaged.data[bit / 8] ^= 1 << (bit % 8);
        assert!(matches!(
            reader.take(&damaged, 0.5),
            Err(FrameFault::Checksum { .. })
        ));
    }
    let mut short = good;
    short.length = 7;
    assert!(matches!(
        reader.take(&short, 0.5),
        Err(FrameFault::Length { .. })
    ));
    // The same number as an extended identifier is another message.
    let mut extended = good;
    extended.id = FrameId::Extended(257);
    let before = *reader.readings();
    reader.take(&extended, 0.5).unwrap();
    assert_eq!(*reader.readings(), before);
    reader.take(&good, 0.5).unwrap();
    assert_eq!(reader.readings().drives[0].unwrap().time_s, 0.5);
}

#[test]
fn halves_of_different_poses_make_none() {
    let layout = layout();
    let mut reader = VehicleReader::new(Arc::clone(&layout));
    let mut writer = ReportWriter::new(layout);
    let (one, two) = (
        reported(&mut writer, &report(0.1), false),
        reported(&mut writer, &report(0.1), false),
    );
    reader.take(&one[3], 0.0).unwrap();
    reader.take(&two[4], 0.1).unwrap();
    assert_eq!(reader.readings().pose, None);
}

#[test]
fn names_that_are_unknown_or_unusable_are_named_with_their_file() {
    let error = refusal(
        DBC,
        &YAML.replace("signal: TractionSpeed", "signal: TractionSped"),
    );
    assert_eq!(
        error.to_string(),
        "j8.dbc: message DriveCommand has no signal TractionSped; near to it: TractionSpeed"
    );
    for (wrong, says) in [
        (
            "Ahrs",
            "Ahrs is not defined; near to it: AhrsYawRate, AhrsAttitude",
        ),
        (
            "ahrs_attitude",
            "ahrs_attitude is not defined; near to it: AhrsAttitude, AhrsYawRate",
        ),
        ("Lamps", "Lamps is not defined"),
    ] {
        let error = refusal(
            DBC,
            &YAML.replace("message: AhrsAttitude", &format!("message: {wrong}")),
        );
        assert_eq!(error.to_string(), format!("j8.dbc: message {says}"));
    }
    for (text, says) in [
        ("", "defines no message"),
        ("FormatVersion=6.0\nTitle=\"a\"\n", "cantools convert"),
    ] {
        let error = Database::parse("j8.dbc", text).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
    let error = refusal(
        &DBC.replace("SG_ Roll : 7|16@0-", "SG_ Roll : 7|17@0-"),
        YAML,
    );
    assert!(
        error.to_string().contains("signals Pitch and Roll overlap"),
        "{error}"
    );
    let error = refusal(
        &DBC.replace("SG_ Roll : 7|16@0-", "SG_ Roll : 41|16@0-"),
        YAML,
    );
    assert!(
        error
            .to_string()
            .contains("signal Roll: 16 bits from bit 41 do not fit"),
        "{error}"
    );
    let error = refusal(&DBC.replace("PoseHeading: 8", "PoseHeading: 64"), YAML);
    assert!(
        error.to_string().contains("PoseHeading: 64 bytes"),
        "{error}"
    );
    let error = refusal(&DBC.replace("(0.005,0)", "(0,0)"), YAML);
    assert!(
        error.to_string().contains("scale 0 is not usable"),
        "{error}"
    );
    let error = refusal(DBC, &YAML.replace("fault: [3]", "fault: [9]"));
    assert!(error.to_string().contains("cannot hold 9"), "{error}");
    let error = refusal(DBC, &YAML.replace("per_unit: 940.0", "per_unit: 0"));
    assert!(
        error.to_string().contains("per_unit: 0 is out of range"),
        "{error}"
    );
    let error = refusal(
        DBC,
        &YAML.replace("message: SteerFeedback", "message: TractionFeedback"),
    );
    assert!(
        matches!(error, LayoutError::SharedMessage { .. }),
        "{error}"
    );
    let error = Database::parse("j8.dbc", &DBC.replace("BO_ 256 ", "BO_ 65792 ")).unwrap_err();
    assert!(
        matches!(error.fault, DatabaseFault::Identifier { id: 65792, .. }),
        "{error}"
    );
    let error = Database::parse("j8.dbc", &DBC.replace("BO_ 257 ", "BO_ 258 ")).unwrap_err();
    assert!(
        matches!(error.fault, DatabaseFault::DuplicateMessage { .. }),
        "{error}"
    );
}

#[test]
fn what_the_database_holds_wrongly_is_named_with_its_file() {
    for (from, to, says) in [
        (
            "SG_ Mode : 32|2@1+ (1,0)",
            "SG_ Mode : 32|2@1+ (11,0)",
            "j8.dbc: message DriveCommand, signal Mode: cannot hold 1",
        ),
        (
            "SG_ AliveCounter : 35|4@0+",
            "SG_ AliveCounter : 35|4@0-",
            "j8.dbc: message AhrsAttitude: counter AliveCounter must be unsigned",
        ),
        (
            "SG_ Checksum : 47|8@0+",
            "SG_ Checksum : 47|7@0+",
            "j8.dbc: message AhrsAttitude: checksum Checksum must fill one byte",
        ),
    ] {
        assert!(DBC.contains(from), "{from}");
        let error = refusal(&DBC.replace(from, to), YAML);
        assert!(error.to_string().starts_with(says), "{error}");
    }
}

#[test]
fn what_looks_like_a_message_in_a_comment_is_none() {
    let comment =
        "\nCM_ BO_ 256 \"Was once\nBO_ 99999 Old: 8 Vector\nas \\\"BO_ 70000\\\" says\";\n";
    let plain = Database::parse("j8.dbc", DBC).unwrap().message_count();
    let commented = Database::parse("j8.dbc", &format!("{DBC}{comment}")).unwrap();
    assert_eq!(commented.message_count(), plain);
}
