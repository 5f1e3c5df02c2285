//! Progress along a trajectory: which part of it the horizon covers now.

use crate::path::{Path, Point2, Projection, Window};
use crate::trajectory::{Ending, ReferencePoint, Trajectory};
use sidehill_plant::frames::PlanarPose;

/// How the reference moves on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tracking {
    /// With the clock: the trajectory is tracked as given.
    Time,
    /// With the clock as long as it leads the vehicle by at most this arc length, m.
    Path {
        /// Largest lead, m.
        lead_max_m: f64,
    },
}

/// A trajectory and how far it has been followed.
pub struct Reference {
    trajectory: Trajectory,
    tracking: Tracking,
    laps: u32,
    time_s: f64,
    projection: Projection,
    cusps_m: Vec<f64>,
}

/// Where the vehicle stands against the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// The reference of this cycle.
    pub point: ReferencePoint,
    /// Arc length of the nearest point of the path, m; of the reference on a turn on the spot.
    pub arc_length_m: f64,
    /// Distance from the path, m, positive to the left of travel; from the reference's position,
    /// positive, on a turn on the spot.
    pub cross_track_m: f64,
    /// Whether the trajectory has ended.
    pub ended: bool,
}

/// How far behind and ahead of the last nearest point the next one is looked for, m.
const PROJECTION_REACH_M: f64 = 1.0;

impl Reference {
    /// Returns a reference at the start of `trajectory`; `laps` counts rounds of a periodic one.
    pub fn new(trajectory: Trajectory, tracking: Tracking, laps: u32) -> Self {
        let cusps_m = trajectory
            .path()
            .map_or_else(Vec::new, |path| path.cusps_m().collect());
        Self {
            trajectory,
            tracking,
            laps,
            time_s: 0.0,
            projection: Projection::starting_at(0.0),
            cusps_m,
        }
    }

    /// Returns the trajectory.
    pub fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    /// Returns the time on the trajectory, s.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Returns the time at which the trajectory ends, s.
    pub fn end_s(&self) -> f64 {
        match self.trajectory.ending() {
            Ending::Periodic => self.trajectory.duration_s() * f64::from(self.laps),
            Ending::Stop => self.trajectory.duration_s(),
        }
    }

    /// Returns the reference `ahead_s` after the present one.
    pub fn ahead(&self, ahead_s: f64) -> ReferencePoint {
        self.trajectory.at(self.time_s + ahead_s)
    }

    /// Returns the path, where there is one.
    pub fn path(&self) -> Option<&Path> {
        self.trajectory.path()
    }

    /// Returns the arc length up to which the present drive goes: the next cusp or the end.
    pub fn stop_at_m(&self) -> f64 {
        if self.trajectory.ending() == Ending::Periodic {
            return f64::INFINITY;
        }
        let here = self.projection.arc_length_m().unwrap_or(0.0);
        self.cusps_m
            .iter()
            .copied()
            .find(|&cusp| cusp > here + 1e-3)
            .unwrap_or(self.trajectory.length_m())
    }

    /// Moves on by `elapsed_s` and returns the progress of a vehicle at `pose`.
    pub fn advance(&mut self, elapsed_s: f64, pose: &PlanarPose) -> Progress {
        self.time_s += elapsed_s;
        let (arc_length_m, cross_track_m) = match self.trajectory.path() {
            Some(path) => {
                let window = Window::symmetric(PROJECTION_REACH_M);
                match self.projection.update(path, pose, &window) {
                    Some(projected) => (projected.point.arc_length_m, projected.cross_track_m),
                    None => (f64::NAN, f64::NAN),
                }
            }
            None => {
                let point = self.trajectory.at(self.time_s);
                let here = Point2 {
                    x_m: pose.x_m,
                    y_m: pose.y_m,
                };
                (point.arc_length_m, point.position.distance_m(&here))
            }
        };
        if let (Tracking::Path { lead_max_m }, Some(_)) = (self.tracking, self.trajectory.path()) {
            let reach_m = arc_length_m + lead_max_m;
            if self.trajectory.at(self.time_s).arc_length_m > reach_m {
                // Never back: at a cusp the nearest point falls behind while the vehicle turns.
                let before_s = self.time_s - elapsed_s;
                self.time_s = self.trajectory.time_at(reach_m).max(before_s);
            }
        }
        let ended = match (self.trajectory.ending(), self.tracking) {
            // A reference that waits does so at the end of the last round too.
            (Ending::Periodic, Tracking::Path { .. }) => {
                arc_length_m >= self.trajectory.length_m() * f64::from(self.laps)
            }
            _ => self.time_s >= self.end_s() - 1e-9,
        };
        Progress {
            point: self.trajectory.at(self.time_s),
            arc_length_m,
            cross_track_m,
            ended,
        }
    }
}
