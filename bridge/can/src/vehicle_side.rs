//! The vehicle's end of the bus: frames to commands, true values to frames.

use super::controller_side::{MotorReport, sensor_attitude};
use super::frame::Frame;
use super::layout::{EnableValues, Layout};
use super::message::{CounterWatch, DriveRole, FrameFault, MessageCodec, Quantity};
use sidehill_bridge::drives::{MeasuredMotorSpeeds, MotorCommand};
use sidehill_plant::frames::{Attitude, Pose, wrap_angle};
use sidehill_plant::sample::Stamped;
use std::sync::Arc;

/// Validates the controller's frames.
pub struct CommandReader {
    layout: Arc<Layout>,
    enable_values: EnableValues,
    watches: Vec<CounterWatch>,
    traction: Option<(f64, f64)>,
    steer: Option<(f64, f64)>,
    enable: bool,
    refused: u64,
}

impl CommandReader {
    /// Returns a reader without a command, for drives that are enabled by these values.
    pub fn new(layout: Arc<Layout>, enable_values: EnableValues) -> Self {
        let watches = layout
            .command
            .iter()
            .map(|message| CounterWatch::new(message, layout.counter_skip_max))
            .collect();
        Self {
            layout,
            enable_values,
            watches,
            traction: None,
            steer: None,
            enable: false,
            refused: 0,
        }
    }

    /// Returns the number of frames refused.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Returns the newest command, with the instant of its oldest part; none before both motors have
    /// been commanded.
    pub fn command(&self) -> Option<Stamped<MotorCommand>> {
        let ((traction_s, traction_m_s), (steer_s, steer_m_s)) = (self.traction?, self.steer?);
        Some(Stamped {
            time_s: traction_s.min(steer_s),
            value: MotorCommand {
                speeds: MeasuredMotorSpeeds {
                    traction_m_s,
                    steer_m_s,
                },
                enable: self.enable,
            },
        })
    }

    /// Takes a frame that arrived at `time_s`. Frames with other identifiers have no effect.
    ///
    /// # Errors
    /// Which check the frame failed. It then changes nothing.
    pub fn take(&mut self, frame: &Frame, time_s: f64) -> Result<(), FrameFault> {
        let found = self
            .layout
            .command
            .iter()
            .zip(&mut self.watches)
            .find(|(message, _)| message.id() == frame.id);
        let Some((message, watch)) = found else {
            return Ok(());
        };
        let decoded = message.decode(frame).and_then(|contents| {
            if let Some(contents) = &contents {
                watch.check(contents.counter)?;
            }
            Ok(contents)
        });
        let contents = match decoded {
            Ok(Some(contents)) => contents,
            Ok(None) => return Ok(()),
            Err(fault) => {
                self.refused += 1;
                return Err(fault);
            }
        };
        if let Some(speed_m_s) = contents.get(Quantity::Command(DriveRole::Traction)) {
            self.traction = Some((time_s, speed_m_s));
        }
        if let Some(speed_m_s) = contents.get(Quantity::Command(DriveRole::Steer)) {
            self.steer = Some((time_s, speed_m_s));
        }
        if let Some(value) = contents.get(Quantity::CommandEnable) {
            self.enable = (value - self.enable_values.on).abs() < 1e-9;
        }
        Ok(())
    }
}

/// Everything a vehicle sends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleReport {
    /// Of the drives, in the order of the layout; none where they report by themselves.
    pub drives: Option<[MotorReport; 2]>,
    /// Roll and pitch, where there is a new reading.
    pub attitude: Option<Attitude>,
    /// Yaw rate, rad/s, where there is a new reading; sent where the layout has a message for it.
    pub yaw_rate_rad_s: Option<f64>,
    /// Pose, where there is a new reading.
    pub pose: Option<Pose>,
}

/// Turns reports into frames and counts them.
pub struct ReportWriter {
    layout: Arc<Layout>,
    feedback_counter: u32,
    attitude_counter: u32,
    yaw_rate_counter: u32,
    pose_counter: u32,
}

impl ReportWriter {
    /// Returns a writer whose first frames have counter 0.
    pub fn new(layout: Arc<Layout>) -> Self {
        Self {
            layout,
            feedback_counter: 0,
            attitude_counter: 0,
            yaw_rate_counter: 0,
            pose_counter: 0,
        }
    }

    /// Passes the frames of a report to `send`; with `frozen`, the counters stand still.
    ///
    /// # Errors
    /// A value that does not fit its signal.
    pub fn write(
        &mut self,
        report: &VehicleReport,
        frozen: bool,
        mut send: impl FnMut(Frame),
    ) -> Result<(), FrameFault> {
        let layout = Arc::clone(&self.layout);
        let step = u32::from(!frozen);
        for (drive, report) in layout.drives.iter().zip(report.drives.iter().flatten()) {
            let value_of = |quantity| match quantity {
                Quantity::Speed(_) => report.speed_m_s,
                Quantity::DriveState => drive.states.value(report.mode).unwrap_or(f64::NAN),
                _ => f64::NAN,
            };
            send(encode(&drive.message, self.feedback_counter, value_of)?);
        }
        self.feedback_counter = self.feedback_counter.wrapping_add(step);
        if let Some(attitude) = &report.attitude {
            let [roll_rad, pitch_rad] = sensor_attitude(layout.attitude_convention, attitude);
            let value_of = |quantity| match quantity {
                Quantity::Roll => roll_rad,
                Quantity::Pitch => pitch_rad,
                _ => f64::NAN,
            };
            send(encode(&layout.attitude, self.attitude_counter, value_of)?);
            self.attitude_counter = self.attitude_counter.wrapping_add(step);
        }
        if let (Some(yaw_rate_rad_s), Some(message)) = (report.yaw_rate_rad_s, &layout.yaw_rate) {
            send(encode(message, self.yaw_rate_counter, |_| yaw_rate_rad_s)?);
            self.yaw_rate_counter = self.yaw_rate_counter.wrapping_add(step);
        }
        if let Some(pose) = &report.pose {
            let value_of = |quantity| match quantity {
                Quantity::X => pose.x_m,
                Quantity::Y => pose.y_m,
                Quantity::Z => pose.z_m,
                Quantity::Yaw => wrap_angle(pose.yaw_rad),
                _ => f64::NAN,
            };
            for message in [&layout.position, &layout.heading] {
                send(encode(message, self.pose_counter, value_of)?);
            }
            self.pose_counter = self.pose_counter.wrapping_add(step);
        }
        Ok(())
    }
}

fn encode(
    message: &MessageCodec,
    counter: u32,
    value_of: impl Fn(Quantity) -> f64,
) -> Result<Frame, FrameFault> {
    message.encode(counter % message.counter_modulus(), value_of)
}
