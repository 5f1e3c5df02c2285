//! Errors of a run against its path, and their sums.

use crate::config::ControllerConfig;
use crate::controller::Status;
use crate::mpc::limits::{InputLimits, MotorLimits};
use crate::path::{Path, Point2};
use crate::reference::{PROJECTION_WINDOW, Reference};
use crate::tracked_point::TrackedPoint;
use crate::trajectory::{Ending, ReferencePoint};
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::wrap_angle;
use sidehill_plant::simulation::TrueState;
use sidehill_plant::speeds::{MotorSpeeds, TreadSpeeds};
use sidehill_plant::statistics::quantile;
use std::time::Duration;

/// Time at the start that does not count in the figures: the vehicle has to get under way, s.
pub const SETTLING_S: f64 = 2.0;

/// How far a vehicle is from its reference.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct TrackingErrors {
    /// Distance from the path, m, left of travel positive; from the reference's position, positive,
    /// where there is no path.
    pub cross_track_m: f64,
    /// Distance by which the vehicle is ahead of the reference along the path, m.
    pub along_track_m: f64,
    /// Heading less that of the reference, rad.
    pub heading_error_rad: f64,
}

/// How well a reference has been followed. Errors and the steer command are counted after the first
/// 2 s, in which the vehicle gets under way; errors are those of the true state, at the plant's rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrackingFigures {
    /// Root mean square of the distance from the path, m.
    pub cross_track_rms_m: f64,
    /// 95 % quantile of its absolute value, m.
    pub cross_track_p95_m: f64,
    /// Largest absolute value, m.
    pub cross_track_max_m: f64,
    /// Root mean square of the origin's distance from the path, m, where another point is tracked.
    pub origin_cross_track_rms_m: Option<f64>,
    /// Root mean square of the error along the path, m.
    pub along_track_rms_m: f64,
    /// Root mean square of the difference from the path's heading, rad.
    pub heading_rms_rad: f64,
    /// Sum of the absolute changes of the steer command, m/s.
    pub steer_total_variation_m_s: f64,
    /// Distance from the end of the path now, m.
    pub goal_error_m: f64,
    /// Distance that the tracked point travelled in plan over the time of the run, m/s.
    pub mean_speed_m_s: f64,
    /// Time of the run from its start, s.
    pub time_s: f64,
    /// Largest effective speed of a tread, m/s.
    pub tread_speed_max_m_s: f64,
    /// Distance now from where a finished run has to be, m: the end of the path; the path itself
    /// where it is periodic, since it has no end to stop at.
    pub miss_m: f64,
    /// Commands outside bounds or rates.
    pub constraint_violations: u32,
    /// Cycles that drove on the previous plan.
    pub fallbacks: u32,
    /// Cycles that took longer than the control period.
    pub deadline_misses: u32,
}

/// How well a lap was driven.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct LapFigures {
    /// Root mean square of the distance from the path, m.
    pub cross_track_rms_m: f64,
    /// Largest absolute value, m.
    pub cross_track_max_m: f64,
    #[serde(skip)]
    squares: f64,
    #[serde(skip)]
    count: u32,
}

/// Sums and extremes of a run under way.
#[derive(Clone)]
pub struct Account {
    limits: InputLimits,
    period_s: f64,
    errors: TrackingErrors,
    cross_tracks_m: Vec<f64>,
    along_squares: f64,
    heading_squares: f64,
    last_command: MotorSpeeds,
    steer_variation_m_s: f64,
    violations: u32,
    fallbacks: u32,
    deadline_misses: u32,
    position: Point2,
    travelled_m: f64,
    time_s: f64,
    tread_speed_max_m_s: f64,
    tracked_point: TrackedPoint,
    origin_squares: f64,
    lap_m: f64,
    /// Number of the last lap, from 0.
    last_lap: f64,
    laps: Vec<LapFigures>,
}

impl Account {
    /// Returns the account of a run that begins where `reference` is.
    pub fn new(reference: &Reference, config: &ControllerConfig) -> Self {
        Self {
            limits: config.limits,
            period_s: config.period_s,
            errors: TrackingErrors::default(),
            cross_tracks_m: Vec::new(),
            along_squares: 0.0,
            heading_squares: 0.0,
            last_command: MotorSpeeds::STOP,
            steer_variation_m_s: 0.0,
            violations: 0,
            fallbacks: 0,
            deadline_misses: 0,
            position: reference.ahead(0.0).position,
            travelled_m: 0.0,
            time_s: 0.0,
            tread_speed_max_m_s: 0.0,
            tracked_point: config.tracked_point.along(reference.path()),
            origin_squares: 0.0,
            lap_m: reference.trajectory().length_m(),
            last_lap: match reference.trajectory().ending() {
                Ending::Periodic => {
                    (reference.end_s() / reference.trajectory().duration_s()).round() - 1.0
                }
                Ending::Stop => 0.0,
            },
            laps: Vec::new(),
        }
    }

    /// Returns the point of the vehicle that is measured.
    pub fn tracked_point(&self) -> TrackedPoint {
        self.tracked_point
    }

    /// Measures the true state against the path and `reference`.
    fn measure(&mut self, path: Option<&Path>, state: &TrueState, reference: &ReferencePoint) {
        self.position = tracked_position(&self.tracked_point, state);
        let (cross_track_m, along_track_m) = match path {
            Some(path) => {
                let nearest =
                    path.nearest_within(&self.position, reference.arc_length_m, &PROJECTION_WINDOW);
                (
                    nearest.cross_track_m,
                    nearest.point.arc_length_m - reference.arc_length_m,
                )
            }
            None => (reference.position.distance_m(&self.position), 0.0),
        };
        self.errors = TrackingErrors {
            cross_track_m,
            along_track_m,
            heading_error_rad: wrap_angle(state.pose.yaw_rad - reference.heading_rad),
        };
    }

    /// Counts one step of the plant.
    pub fn step(&mut self, path: Option<&Path>, state: &TrueState, reference: &ReferencePoint) {
        let before = self.position;
        self.measure(path, state, reference);
        self.travelled_m += before.distance_m(&self.position);
        self.time_s = state.time_s;
        let TreadSpeeds {
            left_m_s,
            right_m_s,
        } = state.treads;
        let faster_m_s = left_m_s.abs().max(right_m_s.abs());
        self.tread_speed_max_m_s = self.tread_speed_max_m_s.max(faster_m_s);
        if state.time_s > SETTLING_S {
            self.cross_tracks_m.push(self.errors.cross_track_m);
            self.count_lap(reference.arc_length_m);
            self.along_squares += self.errors.along_track_m.powi(2);
            if let (Some(path), false) = (path, self.tracked_point.is_origin()) {
                let origin = Point2 {
                    x_m: state.pose.x_m,
                    y_m: state.pose.y_m,
                };
                let nearest =
                    path.nearest_within(&origin, reference.arc_length_m, &PROJECTION_WINDOW);
                self.origin_squares += nearest.cross_track_m.powi(2);
            }
            self.heading_squares += self.errors.heading_error_rad.powi(2);
        }
    }

    /// Adds the error to the lap in which the reference is.
    fn count_lap(&mut self, arc_length_m: f64) {
        let error_m = self.errors.cross_track_m.abs();
        let lap = (arc_length_m / self.lap_m).clamp(0.0, self.last_lap) as usize;
        if lap == self.laps.len() {
            self.laps.push(LapFigures::default());
        }
        if let Some(lap) = self.laps.last_mut() {
            lap.count += 1;
            lap.squares += error_m * error_m;
            lap.cross_track_rms_m = (lap.squares / f64::from(lap.count)).sqrt();
            lap.cross_track_max_m = lap.cross_track_max_m.max(error_m);
        }
    }

    /// Returns how well each lap so far has been driven.
    pub fn laps(&self) -> &[LapFigures] {
        &self.laps
    }

    /// Counts the command that a control cycle gives and returns the errors in which it began.
    pub fn cycle(
        &mut self,
        path: Option<&Path>,
        state: &TrueState,
        reference: &ReferencePoint,
        command: MotorSpeeds,
    ) -> TrackingErrors {
        self.measure(path, state, reference);
        if state.time_s > SETTLING_S {
            self.steer_variation_m_s += (command.steer_m_s - self.last_command.steer_m_s).abs();
        }
        if !self.permitted(command) {
            self.violations += 1;
        }
        self.last_command = command;
        self.errors
    }

    /// Counts what the controller says of a cycle, and the time that it took.
    pub(super) fn judge(&mut self, status: Status, duration: Duration) {
        self.fallbacks += u32::from(matches!(status, Status::Fallback { .. }));
        self.deadline_misses += u32::from(duration.as_secs_f64() > self.period_s);
    }

    /// Returns whether a command keeps bounds and rates, independently of the controller's own
    /// projection except for the definition of the limits.
    fn permitted(&self, command: MotorSpeeds) -> bool {
        const ROUNDING: f64 = 1e-9;
        let one = |now: f64, before: f64, motor: &MotorLimits| {
            let change = motor.change(before, self.period_s);
            now.abs() <= motor.speed_m_s + ROUNDING
                && now - before <= change.rise + ROUNDING
                && before - now <= change.fall + ROUNDING
        };
        let (now, before) = (command, self.last_command);
        command.is_finite()
            && one(now.traction_m_s, before.traction_m_s, &self.limits.traction)
            && one(now.steer_m_s, before.steer_m_s, &self.limits.steer)
            && now.traction_m_s.abs() + now.steer_m_s.abs()
                <= self.limits.tread_speed_m_s + ROUNDING
    }

    /// Returns how well the reference, which is now at `point`, has been followed so far.
    pub fn figures(
        &self,
        reference: Option<&Reference>,
        point: &ReferencePoint,
    ) -> TrackingFigures {
        let trajectory = reference.map(Reference::trajectory);
        let periodic = trajectory.is_some_and(|t| t.ending() == Ending::Periodic);
        let goal = match trajectory {
            Some(trajectory) if !periodic => trajectory.at(trajectory.duration_s()).position,
            _ => point.position,
        };
        let goal_error_m = goal.distance_m(&self.position);
        let count = self.cross_tracks_m.len().max(1) as f64;
        let root_mean = |squares: f64| (squares / count).sqrt();
        // The sum of nothing is -0 in Rust.
        let squares = 0.0 + self.cross_tracks_m.iter().map(|e| e * e).sum::<f64>();
        let mut absolute: Vec<f64> = self.cross_tracks_m.iter().map(|e| e.abs()).collect();
        absolute.sort_by(f64::total_cmp);
        TrackingFigures {
            cross_track_rms_m: root_mean(squares),
            cross_track_p95_m: quantile(&absolute, 0.95).unwrap_or(0.0),
            cross_track_max_m: absolute.last().copied().unwrap_or(0.0),
            origin_cross_track_rms_m: (!self.tracked_point.is_origin())
                .then(|| root_mean(self.origin_squares)),
            along_track_rms_m: root_mean(self.along_squares),
            heading_rms_rad: root_mean(self.heading_squares),
            steer_total_variation_m_s: self.steer_variation_m_s,
            goal_error_m,
            mean_speed_m_s: if self.time_s > 0.0 {
                self.travelled_m / self.time_s
            } else {
                0.0
            },
            time_s: self.time_s,
            tread_speed_max_m_s: self.tread_speed_max_m_s,
            miss_m: if periodic {
                self.errors.cross_track_m.abs()
            } else {
                goal_error_m
            },
            constraint_violations: self.violations,
            fallbacks: self.fallbacks,
            deadline_misses: self.deadline_misses,
        }
    }
}

/// Returns where the tracked point truly is.
pub(super) fn tracked_position(point: &TrackedPoint, state: &TrueState) -> Point2 {
    let normal = state.attitude.plane_normal(state.pose.yaw_rad);
    let pose = point.of(&state.pose.planar(), &normal);
    Point2 {
        x_m: pose.x_m,
        y_m: pose.y_m,
    }
}
