//! Frames on a CAN bus, as both sides of it take them. An input is a list of frames: which identifier, length and time,
//! and eight bytes of data.
#![no_main]
use sidehill::config::{ConfigFile, load_layout};
use sidehill_bridge::drives::{MeasuredMotorSpeeds, MotorCommand, SendError};
use sidehill_can::canopen::{Master, VirtualDrives};
use sidehill_can::controller_side::VehicleReader;
use sidehill_can::frame::{Frame, FrameId};
use sidehill_can::layout::{Layout, Profile};
use sidehill_can::vehicle_side::CommandReader;
use sidehill_fuzz::{repository, target};
use std::sync::{Arc, LazyLock};

static LAYOUTS: LazyLock<[Arc<Layout>; 2]> = LazyLock::new(|| {
    ["can.yaml", "cia402.yaml"].map(|name| {
        let file = ConfigFile::read(&repository("config/bridge").join(name)).expect("a file");
        Arc::new(load_layout(&file).expect("a layout"))
    })
});

/// Frames that are taken of an input.
const FRAMES: usize = 500;
const SPEEDS: MeasuredMotorSpeeds = MeasuredMotorSpeeds {
    traction_m_s: 0.5,
    steer_m_s: 0.1,
};

fn frames(data: &[u8], ids: &[FrameId]) -> Vec<(Frame, f64)> {
    let mut time_s = 0.0;
    let chunks = data.chunks_exact(11).take(FRAMES);
    let frame = chunks.map(|chunk| {
        time_s += f64::from(chunk[2]) * 1e-3;
        let id = ids.get(usize::from(chunk[0])).copied();
        let id = id.unwrap_or(FrameId::Standard(u16::from_le_bytes([
            chunk[0],
            chunk[1] & 7,
        ])));
        let length = usize::from(chunk[1] >> 4).min(8);
        let frame = Frame::new(id, &chunk[3..3 + length]).expect("at most eight bytes");
        (frame, time_s)
    });
    frame.collect()
}

target!(|data| {
    for layout in LAYOUTS.iter() {
        let ids: Vec<FrameId> = layout
            .received_ids()
            .into_iter()
            .chain(layout.own_ids())
            .collect();
        let frames = frames(data, &ids);
        let mut reader = VehicleReader::new(layout.clone());
        match &layout.profile {
            Profile::Values(values) => {
                let mut commands = CommandReader::new(layout.clone(), *values);
                for (frame, time_s) in &frames {
                    let _ = reader.take(frame, *time_s);
                    let _ = commands.take(frame, *time_s);
                    if let Some(command) = commands.command() {
                        let speeds = command.value.speeds;
                        assert!(speeds.traction_m_s.is_finite() && speeds.steer_m_s.is_finite());
                    }
                }
            }
            Profile::Cia402(cia402) => {
                let mut master = Master::new(layout.clone(), cia402.clone());
                let mut drives = VirtualDrives::new(layout.clone(), cia402);
                for (frame, time_s) in &frames {
                    let _ = reader.take(frame, *time_s);
                    let _ = drives.take(frame, *time_s);
                    let _ = drives.step(*time_s, &SPEEDS, false);
                    while drives.next_frame().is_some() {}
                    let command = MotorCommand {
                        speeds: SPEEDS,
                        enable: true,
                    };
                    let fault_reset = frame.data[0] & 1 > 0;
                    let send = |_: &Frame| Ok::<_, SendError>(());
                    let _ = master.write(
                        *time_s,
                        &command,
                        fault_reset,
                        reader.readings(),
                        |_, _| {},
                        send,
                    );
                    for drive in 0..2 {
                        let _ = master.report(drive, reader.readings());
                    }
                }
            }
        }
        let readings = reader.readings();
        assert!(readings.yaw_rate.is_none_or(|rate| rate.value.is_finite()));
        assert!(
            readings
                .pose
                .is_none_or(|pose| pose.value.x_m.is_finite() && pose.value.yaw_rad.is_finite())
        );
        assert!(
            readings
                .drives
                .iter()
                .flatten()
                .all(|report| report.value.speed_m_s.is_finite())
        );
    }
});
