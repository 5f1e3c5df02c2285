//! Logs of the paper's identification procedure, driven by a motion model in simulation.

use crate::bounds::RangeError;
use crate::drive_train::DriveTrainConfig;
use crate::frames::{Attitude, PlanarPose, Pose};
use crate::log::{DriveLog, LogError, LogRow};
use crate::motion::Motion;
use crate::sensors::SensorsConfig;
use crate::simulation::{Plant, Simulation, SimulationError, SimulationSetup, TrueState};
use crate::speeds::EncoderScale;
use crate::speeds::{MeasuredTreadSpeeds, MotorSpeeds};
use crate::terrain::{PlaneTerrain, Terrain};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

/// Motor speeds held for a while.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// For how long, s.
    pub duration_s: f64,
    /// What the driver commands.
    pub motors: MotorSpeeds,
}

/// What is driven in the two stages.
#[derive(Debug, Clone, PartialEq)]
pub struct Procedure {
    /// On level ground.
    pub level: Vec<Leg>,
    /// On the slope.
    pub slope: Vec<Leg>,
    /// On the slope for the terms beyond ICRIK: straight lines at several headings and speeds. It is no
    /// part of the paper's procedure, and its two stages do not use it.
    pub across: Vec<Leg>,
    /// The slope, degrees.
    pub slope_deg: f64,
}

impl Procedure {
    /// Returns the paper's procedure: on level ground straight lines, curves of several radii and
    /// speeds both ways and turns on the spot, in all four minutes; on 4 degrees of slope a minute of
    /// turning on the spot at 0.33 m/s each way. Added are straight lines on the slope.
    pub fn of_the_paper() -> Self {
        let leg = |duration_s, traction_m_s, steer_m_s| Leg {
            duration_s,
            motors: MotorSpeeds {
                traction_m_s,
                steer_m_s,
            },
        };
        let mut level = Vec::new();
        for sense in [1.0, -1.0] {
            level.push(leg(8.0, 0.5, 0.0));
            level.push(leg(10.0, 0.5, sense * 0.15));
            level.push(leg(10.0, 0.3, -sense * 0.3));
            level.push(leg(12.0, 0.0, sense * 0.33));
            level.push(leg(8.0, -0.4, 0.0));
            level.push(leg(10.0, -0.4, sense * 0.2));
            level.push(leg(8.0, 0.8, 0.0));
            level.push(leg(10.0, 0.8, -sense * 0.25));
            level.push(leg(4.0, 0.0, 0.0));
            level.push(leg(10.0, 0.2, sense * 0.4));
            level.push(leg(12.0, 0.6, -sense * 0.4));
            level.push(leg(12.0, 0.0, -sense * 0.25));
        }
        let mut across = Vec::new();
        for (index, speed_m_s) in [0.3, 0.6, 0.3, 0.6, 0.3, 0.6, 0.3, 0.6]
            .into_iter()
            .enumerate()
        {
            across.push(leg(16.0, speed_m_s, 0.0));
            across.push(leg(16.0, -speed_m_s, 0.0));
            // About an eighth of a turn for the J8, one way and then the other.
            let sense = if index < 4 { 1.0 } else { -1.0 };
            across.push(leg(2.5, 0.0, sense * 0.33));
        }
        Self {
            level,
            across,
            slope: vec![leg(60.0, 0.0, 0.33), leg(60.0, 0.0, -0.33)],
            slope_deg: 4.0,
        }
    }

    /// Returns the ground of the second stage.
    ///
    /// # Errors
    /// Says so when the slope is out of range.
    pub fn slope_terrain(&self) -> Result<Terrain, RangeError> {
        Ok(Terrain::Plane(PlaneTerrain::new(self.slope_deg, 0.0)?))
    }
}

/// Standard deviations of a log's noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogNoise {
    /// Of a tread speed, as a share of it.
    pub speed_share: f64,
    /// Of roll and pitch, rad.
    pub attitude_rad: f64,
    /// Of each coordinate of a pose, m.
    pub position_m: f64,
    /// Of the yaw of a pose, rad.
    pub yaw_rad: f64,
}

impl LogNoise {
    /// Returns the noise of usual sensors: speeds 1 %, attitude 0.3 deg, poses 2 cm and 0.5 deg.
    pub fn usual() -> Self {
        Self {
            speed_share: 0.01,
            attitude_rad: 0.3_f64.to_radians(),
            position_m: 0.02,
            yaw_rad: 0.5_f64.to_radians(),
        }
    }
}

/// The vehicle and the ground of a simulated log.
pub struct ProcedureDrive<'a> {
    /// What moves the vehicle.
    pub motion: Box<dyn Motion>,
    /// The true c_l and c_r.
    pub encoder_scale: EncoderScale,
    /// The ground.
    pub terrain: Terrain,
    /// What is driven.
    pub legs: &'a [Leg],
}

const DT_S: f64 = 0.005;
/// Time between rows, s, and rows between poses: 20 Hz and 10 Hz, the paper's rates.
const ROW_S: f64 = 0.05;
const ROWS_A_POSE: u64 = 2;
/// A driver's hand, s.
const DRIVER_LAG_S: f64 = 0.4;

/// Returns the log of driving `drive`'s legs, with noise of `seed`: speeds and attitude at 20 Hz,
/// poses at 10 Hz.
///
/// # Errors
/// Says when and why the vehicle could not go on.
pub fn drive(
    drive: ProcedureDrive,
    noise: &LogNoise,
    seed: u64,
) -> Result<DriveLog, ProcedureError> {
    let mut simulation = Simulation::new(SimulationSetup {
        terrain: drive.terrain,
        motion: drive.motion,
        drive_train: DriveTrainConfig::default(),
        sensors: SensorsConfig::default(),
        encoder_scale: drive.encoder_scale,
        start: PlanarPose::default(),
        dt_s: DT_S,
        seed,
    })?;
    drive_plant(
        &mut simulation,
        drive.legs,
        &drive.encoder_scale,
        noise,
        seed,
    )
}

/// Returns the log of driving `legs` with any vehicle, as [`drive`] does. Its steps must divide the 0.05 s between rows;
/// `encoder_scale` is what makes its true tread speeds of the measured ones.
///
/// # Errors
/// Why the vehicle could not go on.
pub fn drive_plant<P: Plant>(
    plant: &mut P,
    legs: &[Leg],
    encoder_scale: &EncoderScale,
    noise: &LogNoise,
    seed: u64,
) -> Result<DriveLog, ProcedureError<P::Error>> {
    let step_s = plant.step_s();
    let row_steps = (ROW_S / step_s).round() as u64;
    let pose_steps = ROWS_A_POSE * row_steps;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut row = |state: &TrueState| {
        let has_pose = state.step_index.is_multiple_of(pose_steps);
        noisy_row(state, has_pose, encoder_scale, noise, &mut random)
    };
    let mut rows = vec![row(&plant.state())];
    let mut command = MotorSpeeds::STOP;
    for leg in legs {
        for _ in 0..(leg.duration_s / step_s).round() as u64 {
            let share = step_s / DRIVER_LAG_S;
            command.traction_m_s += share * (leg.motors.traction_m_s - command.traction_m_s);
            command.steer_m_s += share * (leg.motors.steer_m_s - command.steer_m_s);
            let state = plant.step(command).map_err(ProcedureError::Plant)?;
            if state.step_index.is_multiple_of(row_steps) {
                rows.push(row(&state));
            }
        }
    }
    Ok(DriveLog::new(rows)?)
}

fn noisy_row(
    state: &TrueState,
    has_pose: bool,
    encoder_scale: &EncoderScale,
    noise: &LogNoise,
    random: &mut ChaCha8Rng,
) -> LogRow {
    let mut gaussian = || -> f64 { StandardNormal.sample(random) };
    let measured = encoder_scale.invert(state.treads);
    LogRow {
        time_s: state.time_s,
        speeds: MeasuredTreadSpeeds {
            left_m_s: measured.left_m_s * (1.0 + noise.speed_share * gaussian()),
            right_m_s: measured.right_m_s * (1.0 + noise.speed_share * gaussian()),
        },
        attitude: Attitude {
            roll_rad: state.attitude.roll_rad + noise.attitude_rad * gaussian(),
            pitch_rad: state.attitude.pitch_rad + noise.attitude_rad * gaussian(),
        },
        pose: has_pose.then(|| Pose {
            x_m: state.pose.x_m + noise.position_m * gaussian(),
            y_m: state.pose.y_m + noise.position_m * gaussian(),
            z_m: state.pose.z_m + noise.position_m * gaussian(),
            yaw_rad: state.pose.yaw_rad + noise.yaw_rad * gaussian(),
        }),
    }
}

/// Why a log could not be driven.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProcedureError<E = SimulationError> {
    /// The vehicle could not go on.
    #[error(transparent)]
    Plant(E),
    /// The drive does not make a valid log.
    #[error(transparent)]
    Log(#[from] LogError),
}

impl From<SimulationError> for ProcedureError {
    fn from(error: SimulationError) -> Self {
        Self::Plant(error)
    }
}
