//! The controller's end of the bus: commands to frames, the vehicle's frames to readings.

use super::cia402::{NodeReading, PowerState};
use super::config::AttitudeConvention;
use super::frame::Frame;
use super::layout::{DriveStates, EnableValues, Layout, Profile};
use super::message::{Contents, CounterWatch, FrameFault, MessageCodec, Quantity};
use sidehill_bridge::drives::DriveMode;
use sidehill_bridge::drives::MotorCommand;
use sidehill_plant::frames::{Attitude, Pose, RosAttitude};
use sidehill_plant::sample::Stamped;
use std::sync::Arc;

/// Turns commands into frames and counts them.
pub struct CommandWriter {
    layout: Arc<Layout>,
    enable: EnableValues,
    counter: u32,
}

impl CommandWriter {
    /// Returns a writer whose first frame has counter 0.
    pub fn new(layout: Arc<Layout>, enable: EnableValues) -> Self {
        Self {
            layout,
            enable,
            counter: 0,
        }
    }

    /// Passes the frames of one cycle to `send`, in the order of the layout, until one fails.
    ///
    /// # Errors
    /// A speed that does not fit its signal, or what `send` returned.
    pub fn write<E: From<FrameFault>>(
        &mut self,
        command: &MotorCommand,
        mut send: impl FnMut(&Frame) -> Result<(), E>,
    ) -> Result<(), E> {
        let enable = self.enable;
        let value_of = |quantity| match quantity {
            Quantity::Command(role) => role.speed_m_s(&command.speeds),
            Quantity::CommandEnable if command.enable => enable.on,
            Quantity::CommandEnable => enable.off,
            // Not in a command: refused by the codec.
            _ => f64::NAN,
        };
        let counter = self.counter;
        self.counter = self.counter.wrapping_add(1);
        for message in &self.layout.command {
            // Encoded first and counted anyway: a peer sees a lost frame as a gap.
            send(&message.encode(counter % message.counter_modulus(), value_of)?)?;
        }
        Ok(())
    }
}

/// Feedback of one drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorReport {
    /// Speed reached, m/s, as the motor counts.
    pub speed_m_s: f64,
    /// State.
    pub mode: DriveMode,
}

/// How often a drive has reported each state, so that none is missed between two looks at the newest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ModeCounts([u32; Self::WORSE.len()]);

impl ModeCounts {
    const WORSE: [DriveMode; 3] = [
        DriveMode::EmergencyStop,
        DriveMode::Fault,
        DriveMode::Disabled,
    ];

    fn count(&mut self, mode: DriveMode) {
        if let Some(i) = Self::WORSE.iter().position(|worse| *worse == mode) {
            self.0[i] = self.0[i].wrapping_add(1);
        }
    }

    /// Returns the worst state that was reported since `before`; enabled if there was none worse.
    pub fn worst_since(&self, before: &Self) -> DriveMode {
        let found = (0..Self::WORSE.len()).find(|i| self.0[*i] != before.0[*i]);
        found.map_or(DriveMode::Enabled, |i| Self::WORSE[i])
    }
}

/// The newest of each reading of the vehicle, with its instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Readings {
    /// Of the drives, in the order of the layout.
    pub drives: [Option<Stamped<MotorReport>>; 2],
    /// The states of the drives, all of them.
    pub modes: [ModeCounts; 2],
    /// The drives as CANopen nodes, where they are.
    pub nodes: [NodeReading; 2],
    /// Roll and pitch.
    pub attitude: Option<Stamped<Attitude>>,
    /// Yaw rate, rad/s.
    pub yaw_rate: Option<Stamped<f64>>,
    /// Pose.
    pub pose: Option<Stamped<Pose>>,
    /// Frames taken.
    pub taken: u64,
    /// Frames refused.
    pub refused: u64,
    /// Why the last one was refused.
    pub last_fault: Option<FrameFault>,
}

/// Which of the vehicle's messages a frame is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ReadingSource {
    Drive(usize),
    Attitude,
    Position,
    Heading,
    YawRate,
}

/// Validates the vehicle's frames and keeps the newest readings.
pub struct VehicleReader {
    layout: Arc<Layout>,
    /// Of [`Layout::from_vehicle`].
    watches: Vec<CounterWatch>,
    /// Position that waits for the heading with the same counter.
    position: Option<Contents>,
    readings: Readings,
}

/// What the messages of [`Layout::from_vehicle`] are.
const SOURCES: [ReadingSource; Layout::FROM_VEHICLE_MAX] = [
    ReadingSource::Drive(0),
    ReadingSource::Drive(1),
    ReadingSource::Attitude,
    ReadingSource::Position,
    ReadingSource::Heading,
    ReadingSource::YawRate,
];

impl VehicleReader {
    /// Returns a reader that has read nothing.
    pub fn new(layout: Arc<Layout>) -> Self {
        let watches = layout
            .from_vehicle()
            .map(|message| CounterWatch::new(message, layout.counter_skip_max))
            .collect();
        Self {
            layout,
            watches,
            position: None,
            readings: Readings::default(),
        }
    }

    /// Returns the newest readings.
    pub fn readings(&self) -> &Readings {
        &self.readings
    }

    /// Takes a frame that arrived at `time_s`. Frames with other identifiers have no effect.
    ///
    /// # Errors
    /// Which check the frame failed. It then changes only the count of refused frames.
    pub fn take(&mut self, frame: &Frame, time_s: f64) -> Result<(), FrameFault> {
        let layout = Arc::clone(&self.layout);
        let mut messages = layout.from_vehicle().enumerate();
        let found = messages.find(|(_, message)| message.id() == frame.id);
        let result = match (found, &layout.profile) {
            (Some((index, message)), _) => self.decode(&layout, index, message, frame, time_s),
            (None, Profile::Cia402(cia402)) => {
                let node = cia402
                    .nodes
                    .iter()
                    .position(|node| node.received_ids().contains(&frame.id));
                let Some(i) = node else { return Ok(()) };
                self.readings.nodes[i].take(cia402.nodes[i], frame, time_s)
            }
            (None, Profile::Values(_)) => return Ok(()),
        };
        match result {
            Ok(()) => self.readings.taken += 1,
            Err(fault) => {
                self.readings.refused += 1;
                self.readings.last_fault = Some(fault);
            }
        }
        result
    }

    /// Takes a frame of the message of [`Layout::from_vehicle`] that has this index.
    fn decode(
        &mut self,
        layout: &Layout,
        index: usize,
        message: &MessageCodec,
        frame: &Frame,
        time_s: f64,
    ) -> Result<(), FrameFault> {
        let Some(contents) = message.decode(frame)? else {
            return Ok(());
        };
        let value = |quantity| contents.get(quantity).unwrap_or(f64::NAN);
        let r = &mut self.readings;
        match SOURCES[index] {
            ReadingSource::Drive(drive) => {
                let codec = &layout.drives[drive];
                // Before the counter is checked, so that a frame with a bad state does not count.
                let state = value(Quantity::DriveState);
                let mode = codec.states.mode(state).ok_or(FrameFault::State {
                    quantity: Quantity::DriveState,
                    value: state,
                })?;
                self.watches[index].check(contents.counter)?;
                r.modes[drive].count(mode);
                r.drives[drive] = Some(Stamped {
                    time_s,
                    value: MotorReport {
                        speed_m_s: value(Quantity::Speed(codec.role)),
                        mode,
                    },
                });
                if codec.states == DriveStates::Statusword {
                    r.nodes[drive].power = PowerState::of(state as u16);
                    r.nodes[drive].statusword = state as u16;
                }
            }
            ReadingSource::Attitude => {
                self.watches[index].check(contents.counter)?;
                r.attitude = Some(Stamped {
                    time_s: time_s - layout.attitude_latency_s,
                    value: paper_attitude(
                        layout.attitude_convention,
                        value(Quantity::Roll),
                        value(Quantity::Pitch),
                    ),
                });
            }
            ReadingSource::YawRate => {
                self.watches[index].check(contents.counter)?;
                r.yaw_rate = Some(Stamped {
                    time_s: time_s - layout.yaw_rate_latency_s,
                    value: value(Quantity::YawRate),
                });
            }
            ReadingSource::Position => {
                self.watches[index].check(contents.counter)?;
                self.position = Some(contents);
            }
            ReadingSource::Heading => {
                self.watches[index].check(contents.counter)?;
                let pair = self
                    .position
                    .take()
                    .filter(|position| position.counter == contents.counter);
                if let Some(position) = pair {
                    r.pose = Some(Stamped {
                        time_s: time_s - layout.pose_latency_s,
                        value: Pose {
                            x_m: position.get(Quantity::X).unwrap_or(f64::NAN),
                            y_m: position.get(Quantity::Y).unwrap_or(f64::NAN),
                            z_m: value(Quantity::Z),
                            yaw_rad: value(Quantity::Yaw),
                        },
                    });
                }
            }
        }
        Ok(())
    }
}

/// Returns the paper's roll and pitch. Neither depends on the heading: both follow from the
/// direction of gravity in the body.
fn paper_attitude(convention: AttitudeConvention, roll_rad: f64, pitch_rad: f64) -> Attitude {
    let ros = |pitch_rad| {
        RosAttitude {
            roll_rad,
            pitch_rad,
            yaw_rad: 0.0,
        }
        .to_paper()
        .0
    };
    match convention {
        AttitudeConvention::Paper => Attitude {
            roll_rad,
            pitch_rad,
        },
        AttitudeConvention::Ros => ros(pitch_rad),
        // Half a turn about x takes z down to z up; it keeps roll and turns pitch around.
        AttitudeConvention::Aerospace => ros(-pitch_rad),
    }
}

/// Returns roll and pitch in the convention of a sensor.
pub(super) fn sensor_attitude(convention: AttitudeConvention, attitude: &Attitude) -> [f64; 2] {
    let ros = RosAttitude::from_paper(attitude, 0.0);
    match convention {
        AttitudeConvention::Paper => [attitude.roll_rad, attitude.pitch_rad],
        AttitudeConvention::Ros => [ros.roll_rad, ros.pitch_rad],
        AttitudeConvention::Aerospace => [ros.roll_rad, -ros.pitch_rad],
    }
}
