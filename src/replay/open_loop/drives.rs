//! The drives of a log, each with the path that was driven as its reference.

use crate::route::thinning::{Settings, path};
use anyhow::Result;
use sidehill_controller::config::ControllerConfig;
use sidehill_controller::path::{Direction, Point2, RawPoint, Smoothing, smooth};
use sidehill_controller::reference::Reference;
use sidehill_controller::speed_profile::{SpeedConfig, speed_profile};
use sidehill_plant::log::{DriveLog, GAP_MAX_S, LogRow};
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::vehicle::Vehicle;

/// Slower than this the vehicle stands or turns on the spot, m/s.
const MOVING_MIN_M_S: f64 = 0.03;
/// Longest time for which it may do so within a drive, s.
const STAND_MAX_S: f64 = 1.0;
/// Lowest speed of a reference, m/s: where the vehicle stood, the reference waits for it.
const SPEED_MIN_M_S: f64 = 0.05;
/// Speed above which a drive ends in motion, m/s.
const ENDS_IN_MOTION_M_S: f64 = 0.1;
/// Length at the end of a path that defines its direction, m.
const END_M: f64 = 0.3;
/// Finer than a route to be driven: where the path cuts a curve, the controller steers towards it all along.
const THINNING: Settings = Settings {
    smoothing_m: 0.1,
    tolerance_m: 0.002,
};
/// Largest curvature of the path, 1/m: sharper curves are rounded off.
const CURVATURE_MAX_PER_M: f64 = 2.0;

/// Driving in one direction without a gap or a stop.
pub(super) struct Drive<'a> {
    pub(super) rows: &'a [LogRow],
    /// The driven path at the driven speeds.
    pub(super) reference: Reference,
}

/// Returns the effective speeds of the motors as they were measured.
pub(super) fn measured(row: &LogRow, vehicle: &Vehicle) -> MotorSpeeds {
    vehicle.encoder_scale.apply(row.speeds).into()
}

/// Returns the drives of a log, and for stretches without a drive the time of their first row and the reason.
pub(super) fn drives<'a>(
    log: &'a DriveLog,
    vehicle: &Vehicle,
    config: &ControllerConfig,
) -> (Vec<Drive<'a>>, Vec<(f64, anyhow::Error)>) {
    let (mut drives, mut left_out) = (Vec::new(), Vec::new());
    for (rows, direction) in log
        .pieces(GAP_MAX_S)
        .flat_map(|piece| stretches(piece, vehicle))
    {
        match reference(rows, direction, vehicle, config) {
            Ok(reference) => drives.push(Drive { rows, reference }),
            Err(error) => left_out.push((rows[0].time_s, error)),
        }
    }
    (drives, left_out)
}

/// Returns the stretches of a piece without gaps in which the vehicle moves in one direction.
fn stretches<'a>(piece: &'a [LogRow], vehicle: &Vehicle) -> Vec<(&'a [LogRow], Direction)> {
    let mut found: Vec<(usize, usize, Direction)> = Vec::new();
    for (index, row) in piece.iter().enumerate() {
        let traction_m_s = measured(row, vehicle).traction_m_s;
        if traction_m_s.abs() < MOVING_MIN_M_S {
            continue;
        }
        let direction = if traction_m_s > 0.0 {
            Direction::Forward
        } else {
            Direction::Reverse
        };
        match found.last_mut() {
            Some((_, last, before))
                if *before == direction && row.time_s - piece[*last].time_s <= STAND_MAX_S =>
            {
                *last = index;
            }
            _ => found.push((index, index, direction)),
        }
    }
    let rows = |(first, last, direction)| (&piece[first..=last], direction);
    found.into_iter().map(rows).collect()
}

/// Returns the path that was driven, with the speeds that were driven as far as the motors' limits allow them.
fn reference(
    rows: &[LogRow],
    direction: Direction,
    vehicle: &Vehicle,
    config: &ControllerConfig,
) -> Result<Reference> {
    let poses = rows.iter().filter_map(|row| Some((row, row.pose?)));
    let positions: Vec<[f64; 3]> = poses
        .map(|(row, pose)| {
            let normal = row.attitude.plane_normal(pose.yaw_rad);
            let point = config.tracked_point.of(&pose.planar(), &normal);
            [point.x_m, point.y_m, pose.z_m]
        })
        .collect();
    let thinned = path(&positions, &THINNING)?;
    let tractions: Vec<f64> = rows
        .iter()
        .map(|row| measured(row, vehicle).traction_m_s.abs())
        .collect();
    let mut points_m = thinned.points_m;
    let last_m_s = tractions.last().copied().unwrap_or(0.0);
    if last_m_s > ENDS_IN_MOTION_M_S {
        // Room to stop, so that the reference passes the end of the log as fast as the vehicle did.
        let room_m = 0.5 * last_m_s.powi(2) / config.limits.traction.deceleration_m_s2;
        points_m.extend(straight_on(&points_m, room_m));
    }
    let points: Vec<RawPoint> = points_m
        .iter()
        .map(|&[x_m, y_m, _]| RawPoint {
            position: Point2 { x_m, y_m },
            elevation_m: None,
            direction: Some(direction),
        })
        .collect();
    let smoothing = Smoothing {
        max_curvature_per_m: CURVATURE_MAX_PER_M,
        ..Smoothing::default()
    };
    let path = smooth(&points, &smoothing)?.path;
    // The treads give the distance driven at each row, apart from slip.
    let mut ways_m = vec![0.0];
    let mut way_m = 0.0;
    for (rows, tractions) in rows.windows(2).zip(tractions.windows(2)) {
        way_m += 0.5 * (tractions[0] + tractions[1]) * (rows[1].time_s - rows[0].time_s);
        ways_m.push(way_m);
    }
    let grip = thinned.length_m / way_m;
    let speed_at = |along_m: f64| {
        let row = ways_m.partition_point(|way_m| grip * way_m < along_m);
        (grip * tractions[row.min(tractions.len() - 1)]).max(SPEED_MIN_M_S)
    };
    let fastest_m_s = tractions.iter().copied().fold(0.0, f64::max);
    let mut limits = SpeedConfig {
        speed_m_s: (grip * fastest_m_s).max(SPEED_MIN_M_S),
        motor_share: 1.0,
        lateral_acceleration_m_s2: f64::INFINITY,
    }
    .limits(&config.limits, vehicle);
    limits.initial_speed_m_s = speed_at(0.0);
    let trajectory = speed_profile(&path, &limits, |point| speed_at(point.arc_length_m))?;
    Ok(Reference::new(trajectory))
}

/// Returns the point `room_m` ahead of the last point of a path.
fn straight_on(points_m: &[[f64; 3]], room_m: f64) -> Option<[f64; 3]> {
    let [x_m, y_m, z_m] = *points_m.last()?;
    let from = |point: &[f64; 3]| (x_m - point[0], y_m - point[1]);
    let (east_m, north_m) = points_m
        .iter()
        .rev()
        .map(from)
        .find(|(east_m, north_m)| east_m.hypot(*north_m) >= END_M)?;
    let share = room_m / east_m.hypot(north_m);
    Some([x_m + share * east_m, y_m + share * north_m, z_m])
}
