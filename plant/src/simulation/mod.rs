//! The vehicle in its world, advanced in fixed steps: drive train, motion, terrain and sensors.

use crate::bounds::{Bounds, RangeError};
use crate::drive_train::{DriveTrain, DriveTrainConfig};
use crate::frames::{Attitude, BodyVelocity, PlanarPose, Pose, PoseRate, pose_rate};
use crate::motion::{GroundState, Motion, MotionError, MotionModel};
use crate::sample::{Sample, Stamped};
use crate::sensors::{Sensors, SensorsConfig, Truth};
use crate::speeds::EncoderScale;
use crate::speeds::{MotorSpeeds, TreadSpeeds};
use crate::terrain::{Terrain, TerrainError};
use serde::{Deserialize, Serialize};

/// What a simulation is made of.
pub struct SimulationSetup {
    /// The ground.
    pub terrain: Terrain,
    /// What moves the vehicle over it.
    pub motion: Box<dyn Motion>,
    /// Between command and treads.
    pub drive_train: DriveTrainConfig,
    /// Between truth and controller.
    pub sensors: SensorsConfig,
    /// The true c_l and c_r, by which encoders read less than the effective tread speeds.
    pub encoder_scale: EncoderScale,
    /// Pose of the vehicle at time 0.
    pub start: PlanarPose,
    /// Step, s, from 1e-5 to 1.
    pub dt_s: f64,
    /// Seed of everything random.
    pub seed: u64,
}

/// Everything that is true at the end of a step.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct TrueState {
    /// Steps since the start.
    pub step_index: u64,
    /// `step_index` times the step, s.
    pub time_s: f64,
    /// Pose, its height the terrain's.
    pub pose: Pose,
    /// Roll and pitch of the ground there.
    pub attitude: Attitude,
    /// Effective motor speeds, reached by the end of the step and held through it.
    pub motors: MotorSpeeds,
    /// Effective tread speeds V_l, V_r of these.
    pub treads: TreadSpeeds,
    /// Body velocity that moved the vehicle through the step.
    pub velocity: BodyVelocity,
}

impl TrueState {
    /// Returns what ideal sensors read now, with encoders that need `scale`.
    pub fn sample(&self, scale: &EncoderScale) -> Sample {
        let time_s = self.time_s;
        Sample {
            time_s,
            tread_speeds: Some(Stamped {
                time_s,
                value: scale.invert(self.treads),
            }),
            attitude: Some(Stamped {
                time_s,
                value: self.attitude,
            }),
            yaw_rate: None,
            pose: Some(Stamped {
                time_s,
                value: self.pose,
            }),
        }
    }
}

/// A vehicle in its world as a closed loop sees it: readings out, commands in.
///
/// [`Simulation`] is one. Whatever else has sensors and obeys commands can be another: a model of the
/// user's own, another physics engine, or a recorded drive that is replayed.
pub trait Plant {
    /// Why it cannot go on.
    type Error: std::error::Error;

    /// Returns what is true now; what a plant does not know stays at its default.
    fn state(&self) -> TrueState;

    /// Returns the readings that have arrived since the last call.
    fn sample(&mut self) -> Sample;

    /// Returns the duration of a step, s.
    fn step_s(&self) -> f64;

    /// Moves on by one step under an effective command and returns what is true then.
    ///
    /// Send [`MeasuredMotorSpeeds::reaching`] the command to a plant that has drives of its own.
    ///
    /// # Errors
    /// Why the next step failed; the plant's run is then over.
    ///
    /// [`MeasuredMotorSpeeds::reaching`]: crate::speeds::MeasuredMotorSpeeds::reaching
    fn step(&mut self, command_effective: MotorSpeeds) -> Result<TrueState, Self::Error>;
}

/// A vehicle in its world; deterministic for a setup and its commands.
#[derive(Clone)]
pub struct Simulation {
    terrain: Terrain,
    motion: Box<dyn Motion>,
    drive_train: DriveTrain,
    sensors: Sensors,
    encoder_scale: EncoderScale,
    dt_s: f64,
    command: MotorSpeeds,
    state: TrueState,
}

impl Simulation {
    /// Returns the simulation of a vehicle at its start, at standstill, with its sensors read once.
    ///
    /// # Errors
    /// Names the step or start coordinate that is out of range, or says why ground is missing at
    /// the start.
    pub fn new(setup: SimulationSetup) -> Result<Self, SimulationError> {
        let dt_s = Bounds::new(1e-5, 1.0, "s").check("dt_s", setup.dt_s)?;
        let start = setup.start;
        Bounds::new(-1e6, 1e6, "rad").check("start yaw_rad", start.yaw_rad)?;
        let (pose, attitude) =
            stand(&setup.terrain, start).map_err(|reason| SimulationError::Terrain {
                time_s: 0.0,
                reason,
            })?;
        let mut simulation = Self {
            terrain: setup.terrain,
            motion: setup.motion,
            drive_train: DriveTrain::new(&setup.drive_train, dt_s),
            sensors: Sensors::new(&setup.sensors, setup.seed, dt_s),
            encoder_scale: setup.encoder_scale,
            dt_s,
            command: MotorSpeeds::STOP,
            state: TrueState {
                pose,
                attitude,
                ..TrueState::default()
            },
        };
        simulation.observe();
        Ok(simulation)
    }

    /// Returns what is true now.
    pub fn state(&self) -> &TrueState {
        &self.state
    }

    /// Puts the vehicle to another place and heading, as a hand or a winch does; its treads and its clock go on.
    ///
    /// # Errors
    /// Why there is no ground; the vehicle then stays where it is.
    pub fn put(&mut self, at: PlanarPose) -> Result<(), SimulationError> {
        let time_s = self.state.time_s;
        let off_ground = |reason| SimulationError::Terrain { time_s, reason };
        (self.state.pose, self.state.attitude) = stand(&self.terrain, at).map_err(off_ground)?;
        Ok(())
    }

    /// Takes the effective command that holds from the next step on, until another.
    ///
    /// # Errors
    /// Returns the command if one of its speeds is not finite; the command before it stays.
    pub fn set_command(&mut self, command: MotorSpeeds) -> Result<(), SimulationError> {
        if !command.is_finite() {
            return Err(SimulationError::CommandNotFinite { command });
        }
        self.command = command;
        Ok(())
    }

    /// Advances by one step and returns what is true then.
    ///
    /// The drive train's speeds at the end of the step hold through it; equation (12) is integrated
    /// by the midpoint rule, asking the motion model at the start and in the middle.
    ///
    /// # Errors
    /// Says when and why ground or motion is undefined. The step is then not taken, and the
    /// simulation is over: the drive train has already moved on.
    pub fn step(&mut self) -> Result<&TrueState, SimulationError> {
        let step_index = self.state.step_index + 1;
        // Multiplied and never accumulated, so that the clock does not drift.
        let time_s = step_index as f64 * self.dt_s;
        let off_ground = |reason| SimulationError::Terrain { time_s, reason };
        let no_motion = |reason| SimulationError::Motion { time_s, reason };

        let motors = self.drive_train.step(self.command);
        let treads = TreadSpeeds::from(motors);
        let here = GroundState {
            position: self.state.pose.planar(),
            attitude: self.state.attitude,
        };
        let braked = self.drive_train.is_braked();
        let velocity_at = |motion: &mut dyn MotionModel, ground: &GroundState, dt_s| {
            if braked {
                motion.braked_velocity(ground, dt_s)
            } else {
                motion.body_velocity(ground, treads, dt_s)
            }
        };
        let velocity = velocity_at(&mut *self.motion, &here, 0.0).map_err(no_motion)?;
        let rate = pose_rate(&velocity, &here.attitude, here.position.yaw_rad);
        let position = moved(here.position, &rate, 0.5 * self.dt_s);
        let midway = GroundState {
            position,
            attitude: self
                .terrain
                .attitude(position.x_m, position.y_m, position.yaw_rad)
                .map_err(off_ground)?,
        };
        let velocity = velocity_at(&mut *self.motion, &midway, self.dt_s).map_err(no_motion)?;
        let rate = pose_rate(&velocity, &midway.attitude, midway.position.yaw_rad);
        let (pose, attitude) =
            stand(&self.terrain, moved(here.position, &rate, self.dt_s)).map_err(off_ground)?;
        self.state = TrueState {
            step_index,
            time_s,
            pose,
            attitude,
            motors,
            treads,
            velocity,
        };
        self.observe();
        Ok(&self.state)
    }

    /// Returns the newest sensor readings that have arrived since the last call.
    pub fn sample(&mut self) -> Sample {
        self.sensors.sample(self.state.time_s)
    }

    fn observe(&mut self) {
        let truth = Truth {
            tread_speeds: self.encoder_scale.invert(self.state.treads),
            attitude: self.state.attitude,
            yaw_rate_rad_s: self.state.velocity.yaw_rate_rad_s,
            pose: self.state.pose,
        };
        self.sensors.observe(self.state.step_index, &truth);
    }
}

impl Plant for Simulation {
    type Error = SimulationError;

    fn state(&self) -> TrueState {
        self.state
    }

    fn sample(&mut self) -> Sample {
        Self::sample(self)
    }

    fn step_s(&self) -> f64 {
        self.dt_s
    }

    fn step(&mut self, command_effective: MotorSpeeds) -> Result<TrueState, SimulationError> {
        self.set_command(command_effective)?;
        Self::step(self).copied()
    }
}

fn moved(from: PlanarPose, rate: &PoseRate, dt_s: f64) -> PlanarPose {
    PlanarPose {
        x_m: from.x_m + dt_s * rate.x_m_s,
        y_m: from.y_m + dt_s * rate.y_m_s,
        yaw_rad: from.yaw_rad + dt_s * rate.yaw_rad_s,
    }
}

/// Pose and attitude of a vehicle on the ground at a place and heading.
fn stand(terrain: &Terrain, at: PlanarPose) -> Result<(Pose, Attitude), TerrainError> {
    let surface = terrain.surface(at.x_m, at.y_m)?;
    let pose = Pose {
        x_m: at.x_m,
        y_m: at.y_m,
        z_m: surface.height_m,
        yaw_rad: at.yaw_rad,
    };
    Ok((
        pose,
        Attitude::on_plane(&surface.normal_in_world, at.yaw_rad),
    ))
}

/// Why a simulation cannot start or go on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimulationError {
    /// The terrain has no ground where the vehicle is.
    #[error("at {time_s} s: {reason}")]
    Terrain {
        /// Time of the step, s.
        time_s: f64,
        /// Where and why.
        reason: TerrainError,
    },
    /// The motion model has no answer.
    #[error("at {time_s} s: {reason}")]
    Motion {
        /// Time of the step, s.
        time_s: f64,
        /// Where and why.
        reason: MotionError,
    },
    /// A command is not finite.
    #[error(
        "command is not finite: traction {} m/s, steer {} m/s",
        command.traction_m_s, command.steer_m_s
    )]
    CommandNotFinite {
        /// The command.
        command: MotorSpeeds,
    },
    /// A parameter is out of its range.
    #[error(transparent)]
    Parameter(#[from] RangeError),
}

#[cfg(test)]
mod tests;
