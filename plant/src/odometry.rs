//! Odometry of a log by four kinematic models, and its errors against the log's poses (Table II).

use crate::contact::ContactPrediction;
use crate::dead_reckoning::StepTilts;
use crate::frames::{Attitude, BodyVelocity, Pose, wrap_angle};
use crate::log::{DriveLog, GAP_MAX_S, LogRow};
use crate::speeds::{MeasuredTreadSpeeds, MotorSpeeds};
use crate::vehicle::Vehicle;
use std::borrow::Cow;

/// What turns measured tread speeds and attitude into a body velocity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KinematicModel {
    /// ICRs that move with the attitude: equations (4)-(11).
    Icrik,
    /// ICRIK and the terms of the vehicle's extension, with the parameters identified with them; ICRIK
    /// where it has none.
    Extended,
    /// The balance of wheel friction with what is known of the vehicle's wheels.
    Contact,
    /// ICRs on level ground: equations (4) and (11).
    Icrhk,
    /// Ideal differential drive: wheels on the base's sides that do not slip, speeds as measured.
    DifferentialDrive,
}

impl KinematicModel {
    /// Returns the body velocity for tread speeds as measured, before c_l and c_r.
    pub fn body_velocity(
        self,
        vehicle: &Vehicle,
        attitude: Attitude,
        measured: MeasuredTreadSpeeds,
    ) -> BodyVelocity {
        let parameters = self.parameters(vehicle);
        self.velocity_with(
            &parameters,
            &mut self.contact(&parameters),
            attitude,
            measured,
        )
    }

    /// Returns the model that predicts a vehicle's motion best by what its file knows: the balance of wheel
    /// friction where its wheels are known, the extended model otherwise.
    pub fn best_for(vehicle: &Vehicle) -> Self {
        if vehicle.contact.is_some() {
            Self::Contact
        } else {
            Self::Extended
        }
    }

    /// Returns the balance of wheel friction where this model is it.
    fn contact(self, vehicle: &Vehicle) -> Option<ContactPrediction> {
        (self == Self::Contact)
            .then(|| ContactPrediction::new(&vehicle.contact_vehicle()).ok())
            .flatten()
    }

    /// Returns the vehicle with the parameters that hold for this model.
    fn parameters(self, vehicle: &Vehicle) -> Cow<'_, Vehicle> {
        match self {
            Self::Extended => Cow::Owned(vehicle.extended()),
            Self::Contact => Cow::Owned(vehicle.on_wheels()),
            Self::Icrik | Self::Icrhk | Self::DifferentialDrive => Cow::Borrowed(vehicle),
        }
    }

    fn velocity_with(
        self,
        vehicle: &Vehicle,
        contact: &mut Option<ContactPrediction>,
        attitude: Attitude,
        measured: MeasuredTreadSpeeds,
    ) -> BodyVelocity {
        let treads = vehicle.encoder_scale.apply(measured);
        if let Some(contact) = contact {
            return contact
                .body_velocity(attitude, MotorSpeeds::from(treads))
                .velocity;
        }
        match self {
            Self::Extended => vehicle.extended_velocity(attitude, treads),
            Self::Icrik => vehicle.body_velocity(attitude, treads),
            Self::Icrhk => vehicle.icrhk().body_velocity(treads),
            // Wheels that cannot be a contact vehicle are taken as ones that do not slip.
            Self::Contact | Self::DifferentialDrive => BodyVelocity {
                right_m_s: 0.0,
                forward_m_s: 0.5 * (measured.right_m_s + measured.left_m_s),
                yaw_rate_rad_s: 0.5 * (measured.right_m_s - measured.left_m_s)
                    / vehicle.base_half_width_m,
            },
        }
    }

    /// Returns the pose at every row, from `start` at the first: equation (12), between rows with
    /// evenly changing velocity and attitude.
    pub fn dead_reckon<'a>(
        self,
        vehicle: &'a Vehicle,
        rows: &'a [LogRow],
        start: Pose,
    ) -> impl Iterator<Item = Pose> + 'a {
        self.dead_reckon_tilted(vehicle, rows, tilts(rows), start)
    }

    /// Does so with the attitudes' sines and cosines between the rows, from [`tilts`].
    pub(crate) fn dead_reckon_tilted<'a>(
        self,
        vehicle: &'a Vehicle,
        rows: &'a [LogRow],
        tilts: impl IntoIterator<Item = StepTilts, IntoIter: 'a>,
        start: Pose,
    ) -> impl Iterator<Item = Pose> + 'a {
        let parameters = self.parameters(vehicle);
        let mut contact = self.contact(&parameters);
        let mut tilts = tilts.into_iter();
        let mut before: Option<(f64, BodyVelocity)> = None;
        let mut pose = start;
        rows.iter().map(move |row| {
            let velocity = self.velocity_with(&parameters, &mut contact, row.attitude, row.speeds);
            let step = before.and_then(|before| Some((before, tilts.next()?)));
            if let Some(((time_s, from), tilts)) = step {
                pose = tilts.advance(&pose, row.time_s - time_s, &from, &velocity);
            }
            before = Some((row.time_s, velocity));
            pose
        })
    }
}

/// Returns the attitudes between the rows, one fewer than them.
pub(crate) fn tilts(rows: &[LogRow]) -> impl Iterator<Item = StepTilts> + '_ {
    rows.windows(2)
        .map(|rows| StepTilts::between(&rows[0].attitude, &rows[1].attitude))
}

/// The velocities of a vehicle by one model, for samples that come one after the other: the balance of wheel
/// friction begins where that of the sample before has ended.
#[derive(Debug, Clone)]
pub struct VelocityModel {
    model: KinematicModel,
    parameters: Vehicle,
    contact: Option<ContactPrediction>,
}

impl VelocityModel {
    /// Returns a model of a vehicle.
    pub fn new(model: KinematicModel, vehicle: &Vehicle) -> Self {
        let parameters = model.parameters(vehicle).into_owned();
        Self {
            contact: model.contact(&parameters),
            parameters,
            model,
        }
    }

    /// Returns the body velocity for tread speeds as measured, before c_l and c_r.
    pub fn body_velocity(
        &mut self,
        attitude: Attitude,
        measured: MeasuredTreadSpeeds,
    ) -> BodyVelocity {
        let contact = &mut self.contact;
        self.model
            .velocity_with(&self.parameters, contact, attitude, measured)
    }
}

/// Where odometry was when the log knew where the vehicle was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Instant, s.
    pub time_s: f64,
    /// The log's pose.
    pub measured: Pose,
    /// The model's pose.
    pub estimated: Pose,
}

impl Comparison {
    /// Returns estimated minus measured x, y, z (m) and yaw (rad, within half a turn).
    pub fn error(&self) -> [f64; 4] {
        let (estimated, measured) = (&self.estimated, &self.measured);
        [
            estimated.x_m - measured.x_m,
            estimated.y_m - measured.y_m,
            estimated.z_m - measured.z_m,
            wrap_angle(estimated.yaw_rad - measured.yaw_rad),
        ]
    }
}

/// Mean squared errors, a column of Table II.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeanSquaredErrors {
    /// Number N of poses compared.
    pub samples: usize,
    /// In X_g, m^2.
    pub x_m2: f64,
    /// In Y_g, m^2.
    pub y_m2: f64,
    /// In Z_g, m^2.
    pub z_m2: f64,
    /// In yaw, rad^2.
    pub yaw_rad2: f64,
}

impl MeanSquaredErrors {
    /// Returns the errors of these comparisons; zeros for none.
    pub fn of(comparisons: &[Comparison]) -> Self {
        let mut sums = [0.0; 4];
        for comparison in comparisons {
            for (sum, error) in sums.iter_mut().zip(comparison.error()) {
                *sum += error * error;
            }
        }
        let [x_m2, y_m2, z_m2, yaw_rad2] = sums.map(|sum| sum / comparisons.len().max(1) as f64);
        Self {
            samples: comparisons.len(),
            x_m2,
            y_m2,
            z_m2,
            yaw_rad2,
        }
    }

    /// Returns the mean fitness J/N of equation (13), squares of m and rad added.
    pub fn fitness(&self) -> f64 {
        self.x_m2 + self.y_m2 + self.z_m2 + self.yaw_rad2
    }
}

/// Returns the model's pose for each pose of the log except those from which it starts: the first,
/// and the first after each gap of more than [`GAP_MAX_S`], over which nothing is known of the motion.
///
/// # Errors
/// Says so when no two poses are without a gap between them.
pub fn compare(
    log: &DriveLog,
    vehicle: &Vehicle,
    model: KinematicModel,
) -> Result<Vec<Comparison>, OdometryError> {
    let mut comparisons = Vec::new();
    for rows in log.pieces(GAP_MAX_S) {
        let start = rows.iter().position(|row| row.pose.is_some());
        let Some((first, start)) = start.and_then(|first| Some((first, rows[first].pose?))) else {
            continue;
        };
        let rows = &rows[first..];
        let estimates = model.dead_reckon(vehicle, rows, start);
        let compared = rows.iter().zip(estimates).skip(1);
        comparisons.extend(compared.filter_map(|(row, estimated)| {
            Some(Comparison {
                time_s: row.time_s,
                measured: row.pose?,
                estimated,
            })
        }));
    }
    if comparisons.is_empty() {
        return Err(OdometryError::TooFewPoses {
            poses: log.pose_count(),
        });
    }
    Ok(comparisons)
}

/// Why odometry cannot be judged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OdometryError {
    /// There is nothing to compare with.
    #[error(
        "{poses} poses in the log, at least 2 without a gap of more than {GAP_MAX_S} s between them are needed"
    )]
    TooFewPoses {
        /// Poses found.
        poses: usize,
    },
}

#[cfg(test)]
mod tests;
