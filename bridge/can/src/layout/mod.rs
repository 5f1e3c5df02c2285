//! The layout of the bus: every name of `can.yaml` found in the database.

mod builder;
mod cia402;
mod drives;
mod error;

pub use drives::{DriveCodec, DriveStates, EnableValues};
pub use error::LayoutError;

use builder::Builder;

use super::cia402::{Cia402, SYNC};
use super::config::{AttitudeConvention, CanConfig, DriveMessage, EnableSignal};
use super::database::{Database, DatabaseFault};
use super::frame::FrameId;
use super::message::{DriveRole, MessageCodec, Quantity};
use sidehill_bridge::drives::{DriveMode, MeasuredMotorSpeeds};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::speeds::MeasuredTreadSpeeds;

/// Everything that encodes and decodes the frames of a vehicle.
#[derive(Clone)]
pub struct Layout {
    /// Messages to the drives, all sent every cycle.
    pub command: Vec<MessageCodec>,
    /// How the drives are switched on and off.
    pub profile: Profile,
    /// What the drives report: traction and steer, or left and right.
    pub drives: [DriveCodec; 2],
    /// From the attitude sensor.
    pub attitude: MessageCodec,
    /// What its angles mean.
    pub attitude_convention: AttitudeConvention,
    /// Age of an attitude when it arrives, s.
    pub attitude_latency_s: f64,
    /// From a gyroscope, where there is one.
    pub yaw_rate: Option<MessageCodec>,
    /// Age of a yaw rate when it arrives, s.
    pub yaw_rate_latency_s: f64,
    /// First message of a pose.
    pub position: MessageCodec,
    /// Second message of a pose.
    pub heading: MessageCodec,
    /// Age of a pose when it arrives, s.
    pub pose_latency_s: f64,
    /// Missing counts that are still accepted.
    pub counter_skip_max: u32,
}

/// How drives are switched on and off.
#[derive(Debug, Clone, PartialEq)]
pub enum Profile {
    /// By a signal with two values.
    Values(EnableValues),
    /// By the controlword of CiA 402; the messages of `Layout::command` belong to the drives in
    /// their order.
    Cia402(Cia402),
}

impl Layout {
    /// Returns the layout that `config` describes in the terms of `database`.
    ///
    /// # Errors
    /// [`LayoutError`] names the file, message and signal that is unknown or cannot be used.
    pub fn new(config: &CanConfig, database: &Database) -> Result<Self, LayoutError> {
        let (a, p) = (&config.attitude, &config.pose);
        let attitude = Builder::new(database, &a.message)?
            .scaled(Quantity::Roll, &a.roll)?
            .scaled(Quantity::Pitch, &a.pitch)?
            .finish(&a.protection)?;
        let yaw_rate = config
            .yaw_rate
            .as_ref()
            .map(|y| {
                Builder::new(database, &y.message)?
                    .scaled(Quantity::YawRate, &y.rate)?
                    .finish(&y.protection)
            })
            .transpose()?;
        let yaw_rate_latency_s = match &config.yaw_rate {
            Some(y) => latency(&y.message, y.latency_s)?,
            None => 0.0,
        };
        let position = Builder::new(database, &p.position.message)?
            .scaled(Quantity::X, &p.position.x)?
            .scaled(Quantity::Y, &p.position.y)?
            .finish(&p.position.protection)?;
        let heading = Builder::new(database, &p.heading.message)?
            .scaled(Quantity::Z, &p.heading.z)?
            .scaled(Quantity::Yaw, &p.heading.yaw)?
            .finish(&p.heading.protection)?;
        for message in [&position, &heading] {
            if message.counter.is_none() {
                return Err(LayoutError::NoCounter {
                    message: message.name.clone(),
                });
            }
        }
        let (command, drives, profile) = match (&config.feedback, &config.cia402) {
            (Some(f), None) => {
                let (command, enable) = command(config, database)?;
                let drives = [
                    drive(database, DriveRole::Traction, &f.traction)?,
                    drive(database, DriveRole::Steer, &f.steer)?,
                ];
                (command, drives, Profile::Values(enable))
            }
            (None, Some(cia402)) if config.command.is_empty() => {
                let (command, drives, cia402) = cia402::layout(cia402, database)?;
                (command, drives, Profile::Cia402(cia402))
            }
            _ => return Err(LayoutError::Profile),
        };
        let layout = Self {
            command,
            profile,
            drives,
            attitude,
            attitude_convention: a.convention,
            attitude_latency_s: latency(&a.message, a.latency_s)?,
            yaw_rate,
            yaw_rate_latency_s,
            position,
            heading,
            pose_latency_s: latency(&p.heading.message, p.latency_s)?,
            counter_skip_max: config.counter_skip_max,
        };
        layout.check_messages_differ()?;
        if let Profile::Cia402(cia402) = &layout.profile {
            layout.check_no_service(cia402, database)?;
        }
        Ok(layout)
    }

    /// How many of [`Layout::from_vehicle`] the vehicle cannot drive without: all but the yaw rate.
    pub const FROM_VEHICLE_NEEDED: usize = 5;
    /// Most messages that the vehicle sends.
    pub const FROM_VEHICLE_MAX: usize = 6;

    /// Returns the messages that the vehicle sends: those of the drives, attitude, position and heading, and
    /// the yaw rate where there is one.
    pub fn from_vehicle(&self) -> impl Iterator<Item = &MessageCodec> {
        [
            &self.drives[0].message,
            &self.drives[1].message,
            &self.attitude,
            &self.position,
            &self.heading,
        ]
        .into_iter()
        .chain(&self.yaw_rate)
    }

    /// Returns the speeds of the motors where the drives have these, in the order of `drives`, m/s.
    pub fn motors(&self, [first_m_s, second_m_s]: [f64; 2]) -> MeasuredMotorSpeeds {
        if self.drives[0].role == DriveRole::Left {
            MeasuredMotorSpeeds::from(MeasuredTreadSpeeds {
                left_m_s: first_m_s,
                right_m_s: second_m_s,
            })
        } else {
            MeasuredMotorSpeeds {
                traction_m_s: first_m_s,
                steer_m_s: second_m_s,
            }
        }
    }

    /// Returns the identifiers of the frames that the controller's side receives.
    pub fn received_ids(&self) -> Vec<FrameId> {
        let mut ids = self
            .from_vehicle()
            .map(MessageCodec::id)
            .collect::<Vec<_>>();
        if let Profile::Cia402(cia402) = &self.profile {
            ids.extend(cia402.nodes.iter().flat_map(|node| node.received_ids()));
        }
        ids
    }

    /// Returns the identifiers of the frames that only the controller's side sends.
    pub fn own_ids(&self) -> Vec<FrameId> {
        let mut ids = self
            .command
            .iter()
            .map(MessageCodec::id)
            .collect::<Vec<_>>();
        if let Profile::Cia402(cia402) = &self.profile {
            ids.push(cia402.own.heartbeat());
            ids.extend(cia402.sync.then_some(SYNC));
        }
        ids
    }

    fn check_no_service(&self, cia402: &Cia402, database: &Database) -> Result<(), LayoutError> {
        let services = cia402.service_ids();
        match self
            .command
            .iter()
            .chain(self.from_vehicle())
            .find(|message| services.contains(&message.id))
        {
            None => Ok(()),
            Some(message) => Err(database
                .fail(DatabaseFault::ServiceId {
                    message: message.name.clone(),
                    id: message.id,
                })
                .into()),
        }
    }

    fn check_messages_differ(&self) -> Result<(), LayoutError> {
        let all: Vec<&MessageCodec> = self.command.iter().chain(self.from_vehicle()).collect();
        for (i, message) in all.iter().enumerate() {
            if let Some(other) = all[..i].iter().find(|other| other.id == message.id) {
                return Err(LayoutError::SharedMessage {
                    message: message.name.clone(),
                    other: other.name.clone(),
                });
            }
        }
        Ok(())
    }
}

fn latency(message: &str, latency_s: f64) -> Result<f64, LayoutError> {
    Bounds::new(0.0, 1.0, "s")
        .check("latency_s", latency_s)
        .map_err(|error| LayoutError::Range {
            message: message.to_owned(),
            error,
        })
}

fn command(
    config: &CanConfig,
    database: &Database,
) -> Result<(Vec<MessageCodec>, EnableValues), LayoutError> {
    let count = |what, times, allowed: bool, expected| {
        if allowed {
            Ok(())
        } else {
            Err(LayoutError::Command {
                what,
                times,
                expected,
            })
        }
    };
    let messages = &config.command;
    let tractions = messages.iter().filter(|m| m.traction.is_some()).count();
    let steers = messages.iter().filter(|m| m.steer.is_some()).count();
    let mut enables = messages.iter().filter_map(|m| m.enable.as_ref());
    count("traction", tractions, tractions == 1, "1")?;
    count("steer", steers, steers == 1, "1")?;
    let first = enables.next();
    let Some(EnableSignal { off, on, .. }) = first.filter(|first| first.off != first.on) else {
        return Err(LayoutError::Command {
            what: "enable with different off and on",
            times: 0,
            expected: "1 or more",
        });
    };
    let differing = enables.filter(|e| e.off != *off || e.on != *on).count();
    count("another off or on", differing, differing == 0, "0")?;
    let command = messages
        .iter()
        .map(|m| {
            let mut builder = Builder::new(database, &m.message)?;
            if let Some(signal) = &m.traction {
                builder = builder.scaled(Quantity::Command(DriveRole::Traction), signal)?;
            }
            if let Some(signal) = &m.steer {
                builder = builder.scaled(Quantity::Command(DriveRole::Steer), signal)?;
            }
            if let Some(enable) = &m.enable {
                builder = builder.value(Quantity::CommandEnable, &enable.signal)?;
                builder.check_holds(&enable.signal, &[enable.off, enable.on])?;
            }
            builder.finish(&m.protection)
        })
        .collect::<Result<_, LayoutError>>()?;
    Ok((command, EnableValues { off: *off, on: *on }))
}

fn drive(
    database: &Database,
    role: DriveRole,
    config: &DriveMessage,
) -> Result<DriveCodec, LayoutError> {
    let builder = Builder::new(database, &config.message)?
        .scaled(Quantity::Speed(role), &config.speed)?
        .value(Quantity::DriveState, &config.state.signal)?;
    let states = states(&builder, config)?;
    Ok(DriveCodec {
        role,
        message: builder.finish(&config.protection)?,
        states,
    })
}

fn states(builder: &Builder<'_>, config: &DriveMessage) -> Result<DriveStates, LayoutError> {
    let signal = &config.state;
    let mut values: Vec<(f64, DriveMode)> = Vec::new();
    let fail = |what: String| LayoutError::States {
        message: config.message.clone(),
        signal: signal.signal.clone(),
        what,
    };
    for (list, mode, name) in [
        (&signal.disabled, DriveMode::Disabled, "disabled"),
        (&signal.enabled, DriveMode::Enabled, "enabled"),
        (
            &signal.emergency_stop,
            DriveMode::EmergencyStop,
            "emergency_stop",
        ),
        (&signal.fault, DriveMode::Fault, "fault"),
    ] {
        if list.is_empty() {
            return Err(fail(format!("{name} has no value")));
        }
        builder.check_holds(&signal.signal, list)?;
        for value in list {
            if values.iter().any(|(other, _)| other == value) {
                return Err(fail(format!("{value} is listed twice")));
            }
            values.push((*value, mode));
        }
    }
    Ok(DriveStates::Values(values))
}
