//! The two stages.

use super::determined::{DeterminedParameters, allowed_level, allowed_slide};
use super::fit::{
    FitStage, FittedParameter, IdentificationError, IdentificationSettings, PULL_ICRS_M,
    PULL_SLIDE_M, StageReport, Warning, cut, smoothed,
};
use super::segments::Segment;
use crate::log::DriveLog;
use crate::odometry::KinematicModel;
use crate::vehicle::Vehicle;

/// Returns the vehicle with its report if all its parameters are in range.
fn checked(
    vehicle: Vehicle,
    found: DeterminedParameters,
) -> Result<(Vehicle, StageReport, Vec<FittedParameter>), IdentificationError> {
    match vehicle.validated() {
        Ok(vehicle) => Ok((vehicle, found.report, found.undetermined)),
        Err(reason) => Err(IdentificationError::NotAVehicle {
            reason,
            warnings: found.report.warnings,
        }),
    }
}

/// Returns the vehicle with c_l, c_r and the ICRs of level ground fitted to logs of driving on level
/// ground: the first stage.
///
/// # Errors
/// Says so when there are too few segments, or names the parameter that came out of range.
pub fn identify_level(
    logs: &[DriveLog],
    vehicle: &Vehicle,
    settings: &IdentificationSettings,
) -> Result<(Vehicle, StageReport), IdentificationError> {
    level(logs, vehicle, settings, &|stage, segments, start| {
        stage.run_all(segments, start)
    })
    .map(|(vehicle, report, _)| (vehicle, report))
}

/// Returns what [`identify_level`] does, but parameters that the logs do not determine keep the values of
/// `vehicle` and are returned last, as they were estimated: c_l and c_r with a 95 % interval of more than
/// +- 0.1, ICRs with more than +- 30 % of half their distance.
///
/// # Errors
/// As [`identify_level`].
pub fn identify_level_determined(
    logs: &[DriveLog],
    vehicle: &Vehicle,
    settings: &IdentificationSettings,
) -> Result<(Vehicle, StageReport, Vec<FittedParameter>), IdentificationError> {
    level(logs, vehicle, settings, &|stage, segments, start| {
        stage.run_determined(segments, start, &allowed_level)
    })
}

/// Fits a stage to segments from start values.
type StageRun<'a> = &'a dyn Fn(
    &FitStage<'_>,
    &[Segment<'_>],
    &[f64],
) -> Result<DeterminedParameters, IdentificationError>;

fn level(
    logs: &[DriveLog],
    vehicle: &Vehicle,
    settings: &IdentificationSettings,
    run: StageRun<'_>,
) -> Result<(Vehicle, StageReport, Vec<FittedParameter>), IdentificationError> {
    let stage = FitStage {
        names: &[
            "correction_left",
            "correction_right",
            "x_icr_left_m",
            "x_icr_right_m",
            "y_icr_m",
        ],
        model: KinematicModel::Icrhk,
        baseline: KinematicModel::DifferentialDrive,
        vehicle_with: &|parameters| {
            let mut vehicle = vehicle.clone();
            if let [left, right, icr_left, icr_right, icr_forward] = *parameters {
                vehicle.encoder_scale.left = left;
                vehicle.encoder_scale.right = right;
                vehicle.icrs.left_m = icr_left;
                vehicle.icrs.right_m = icr_right;
                vehicle.icrs.forward_m = icr_forward;
            }
            vehicle
        },
        pull_m: &[PULL_ICRS_M; 5],
    };
    let start = [
        vehicle.encoder_scale.left,
        vehicle.encoder_scale.right,
        vehicle.icrs.left_m,
        vehicle.icrs.right_m,
        vehicle.icrs.forward_m,
    ];
    let logs = smoothed(logs, settings);
    let found = run(&stage, &cut(&logs, settings), &start)?;
    checked((stage.vehicle_with)(&found.parameters), found)
}

/// Returns the vehicle with lambda_1 and lambda_2 fitted to logs of turning on a slope: the second
/// stage, whose `vehicle` should come from the first.
///
/// # Errors
/// Says so when there are too few segments, or names the parameter that came out of range.
pub fn identify_slope(
    logs: &[DriveLog],
    vehicle: &Vehicle,
    settings: &IdentificationSettings,
) -> Result<(Vehicle, StageReport), IdentificationError> {
    slope(logs, vehicle, settings, &|stage, segments, start| {
        stage.run_all(segments, start)
    })
    .map(|(vehicle, report, _)| (vehicle, report))
}

/// Returns what [`identify_slope`] does, but a gain that the logs do not determine keeps the value of
/// `vehicle` and is returned last, as it was estimated: one with a 95 % interval of more than +- 75 % of
/// its value (so that it holds 0, or nearly) and +- 0.1 s/rad.
///
/// # Errors
/// As [`identify_slope`].
pub fn identify_slope_determined(
    logs: &[DriveLog],
    vehicle: &Vehicle,
    settings: &IdentificationSettings,
) -> Result<(Vehicle, StageReport, Vec<FittedParameter>), IdentificationError> {
    slope(logs, vehicle, settings, &|stage, segments, start| {
        stage.run_determined(segments, start, &allowed_slide)
    })
}

fn slope(
    logs: &[DriveLog],
    vehicle: &Vehicle,
    settings: &IdentificationSettings,
    run: StageRun<'_>,
) -> Result<(Vehicle, StageReport, Vec<FittedParameter>), IdentificationError> {
    const SHIFT: &str = "lambda_1_s_per_rad";
    const AGGRAVATED: &str = "lambda_2_s_per_rad";
    let slide_with = |shift: f64, aggravated: f64| {
        let mut vehicle = vehicle.clone();
        vehicle.slide.shift_s_per_rad = shift;
        vehicle.slide.aggravated_s_per_rad = aggravated;
        vehicle
    };
    let logs = smoothed(logs, settings);
    let segments = cut(&logs, settings);
    let stage = |names, vehicle_with| FitStage {
        names,
        model: KinematicModel::Icrik,
        baseline: KinematicModel::Icrhk,
        vehicle_with,
        pull_m: &[PULL_SLIDE_M; 2],
    };
    let both = |p: &[f64]| slide_with(p[0], p[1]);
    let start = [
        vehicle.slide.shift_s_per_rad,
        vehicle.slide.aggravated_s_per_rad,
    ];
    let found = run(&stage(&[SHIFT, AGGRAVATED], &both), &segments, &start)?;
    let negative = |mut rest: DeterminedParameters, name, value| {
        rest.report
            .warnings
            .push(Warning::NegativeSlide { name, value });
        rest
    };
    let [shift, aggravated] = [found.parameters[0], found.parameters[1]];
    if shift < 0.0 {
        let only = |p: &[f64]| slide_with(0.0, p[0].max(0.0));
        let rest = run(&stage(&[AGGRAVATED], &only), &segments, &start[1..])?;
        checked(only(&rest.parameters), negative(rest, SHIFT, shift))
    } else if aggravated < 0.0 {
        let only = |p: &[f64]| slide_with(p[0].max(0.0), 0.0);
        let rest = run(&stage(&[SHIFT], &only), &segments, &start[..1])?;
        checked(
            only(&rest.parameters),
            negative(rest, AGGRAVATED, aggravated),
        )
    } else {
        checked(both(&found.parameters), found)
    }
}
