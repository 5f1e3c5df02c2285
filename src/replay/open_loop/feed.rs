//! Feeds the readings of a log to a controller.

use super::drives::{Drive, measured};
use crate::replay::step::Step;
use sidehill_controller::controller::{Controller, Status};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::vehicle::Vehicle;

/// Times closer than this count as equal, s: sums of periods are rounded.
const SAME_TIME_S: f64 = 1e-6;

/// A cycle of the controller beside what was measured.
pub(super) struct Fed {
    pub(super) step: Step,
    pub(super) status: Status,
    /// Effective speeds of the motors by the newest tread speeds.
    pub(super) measured: MotorSpeeds,
    /// Whether a drive begins with it.
    pub(super) first: bool,
    /// Whether the motors could not yet have come from zero to the speeds at which the drive begins.
    pub(super) starting: bool,
}

/// Feeds the readings of a drive, in their order and once per control period, to a new controller.
pub(super) fn feed(drive: &Drive<'_>, mut controller: Controller, vehicle: &Vehicle) -> Vec<Fed> {
    let (period_s, limits) = (controller.config().period_s, controller.config().limits);
    controller.follow(drive.reference.clone());
    let start_s = drive.rows[0].time_s;
    let from = measured(&drive.rows[0], vehicle);
    let starting_s = (from.traction_m_s.abs() / limits.traction.acceleration_m_s2)
        .max(from.steer_m_s.abs() / limits.steer.acceleration_m_s2);
    let mut left = drive.rows.iter().peekable();
    let mut cycles: Vec<Fed> = Vec::new();
    let mut newest = MotorSpeeds::STOP;
    while left.peek().is_some() {
        let time_s = start_s + cycles.len() as f64 * period_s;
        let mut sample = Sample {
            time_s,
            tread_speeds: None,
            attitude: None,
            yaw_rate: None,
            pose: None,
        };
        while let Some(row) = left.next_if(|row| row.time_s <= time_s + SAME_TIME_S) {
            let read_s = row.time_s.min(time_s);
            let stamped = |value| Stamped {
                time_s: read_s,
                value,
            };
            sample.pose = row.pose.map(stamped).or(sample.pose);
            sample.tread_speeds = Some(Stamped {
                time_s: read_s,
                value: row.speeds,
            });
            sample.attitude = Some(Stamped {
                time_s: read_s,
                value: row.attitude,
            });
            newest = measured(row, vehicle);
        }
        let decision = controller.step(&sample, None);
        // The vehicle does not follow the commands, so an error along the path would only accumulate.
        if let Some(at) = decision.progress {
            controller.follow(drive.reference.clone().starting_at(at.arc_length_m));
        }
        cycles.push(Fed {
            step: Step::of(&decision),
            status: decision.status,
            measured: newest,
            first: cycles.is_empty(),
            starting: time_s < start_s + starting_s,
        });
    }
    cycles
}
