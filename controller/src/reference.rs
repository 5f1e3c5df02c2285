//! Progress along a trajectory: which part of it the horizon covers now.

use crate::path::{Path, PathPoint, Point2, Window};
use crate::trajectory::{Ending, Motion, ReferencePoint, Trajectory};
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::PlanarPose;

/// How the reference moves on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tracking {
    /// With the clock: the trajectory is tracked as given. It waits only for a vehicle that cannot
    /// follow, as without grip, since a plan for a place that the vehicle has not reached is useless.
    Time,
    /// With the clock as long as it is not too far ahead of the vehicle.
    Path {
        /// Largest lead in the direction of travel, m.
        lead_max_m: f64,
    },
    /// As `Path`, and at a cusp it waits until the vehicle is there too: a law that looks at one point
    /// ahead would turn back where the point does.
    PathByCusps {
        /// Largest lead in the direction of travel, m.
        lead_max_m: f64,
    },
}

/// A trajectory and how far it has been followed.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    trajectory: Trajectory,
    tracking: Tracking,
    laps: u32,
    number: u64,
    time_s: f64,
    cusps_m: Vec<f64>,
}

/// Position of the vehicle relative to the reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
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

/// Part of the path around the reference that is searched for the nearest point. It moves with the
/// reference, so the nearest point can neither jump to another branch at a crossing nor stay behind
/// on the way into a cusp.
pub const PROJECTION_WINDOW: Window = Window {
    behind_m: 2.0,
    ahead_m: 1.0,
};

/// Largest lead of a reference given in time, m: more than a start from standstill takes.
const TIMED_LEAD_MAX_M: f64 = 0.6;

impl Reference {
    /// Returns a reference at the start of `trajectory`, for one lap; see
    /// [`ControllerConfig::reference`](crate::config::ControllerConfig::reference) for the tracking
    /// that suits a trajectory.
    pub fn new(trajectory: Trajectory, tracking: Tracking) -> Self {
        let cusps_m = trajectory
            .path()
            .map_or_else(Vec::new, |path| path.cusps_m().collect());
        Self {
            trajectory,
            tracking,
            laps: 1,
            number: 0,
            time_s: 0.0,
            cusps_m,
        }
    }

    /// Returns this reference for `laps` rounds of a periodic trajectory.
    pub fn for_laps(self, laps: u32) -> Self {
        Self { laps, ..self }
    }

    /// Returns the rounds of a periodic trajectory.
    pub fn laps(&self) -> u32 {
        self.laps
    }

    /// Returns this reference with a number of the caller's choice, which decisions report.
    pub fn numbered(self, number: u64) -> Self {
        Self { number, ..self }
    }

    /// Returns this reference tracked for a law that looks at one point of it and knows no time.
    pub(crate) fn for_pursuit(self, lead_max_m: f64) -> Self {
        Self {
            tracking: Tracking::PathByCusps { lead_max_m },
            ..self
        }
    }

    /// Returns this reference moved on to where the trajectory has come `arc_length_m` far.
    pub fn starting_at(mut self, arc_length_m: f64) -> Self {
        self.time_s = self.trajectory.time_at(arc_length_m);
        self
    }

    /// Returns the caller's number; 0 where none was given.
    pub fn number(&self) -> u64 {
        self.number
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
        let here = self.trajectory.at(self.time_s).arc_length_m;
        self.cusps_m
            .iter()
            .copied()
            .find(|&cusp| cusp > here)
            .unwrap_or(self.trajectory.length_m())
    }

    /// Returns the first cusp at an arc length or after it, as the end of the way there.
    pub(crate) fn cusp_after(&self, arc_length_m: f64) -> Option<PathPoint> {
        let cusp_m = self
            .cusps_m
            .iter()
            .find(|&&cusp_m| cusp_m >= arc_length_m)?;
        Some(self.path()?.at(cusp_m.next_down()))
    }

    /// Moves on by `elapsed_s` and returns the progress of a vehicle at `pose`, which must be finite.
    pub fn advance(&mut self, elapsed_s: f64, pose: &PlanarPose) -> Progress {
        let here = Point2 {
            x_m: pose.x_m,
            y_m: pose.y_m,
        };
        let next = self.trajectory.at(self.time_s + elapsed_s);
        if !self.leads_too_far(&next, &here) {
            self.time_s += elapsed_s;
        }
        let point = self.trajectory.at(self.time_s);
        let (arc_length_m, cross_track_m) = match self.trajectory.path() {
            Some(path) => {
                let nearest = path.nearest_within(&here, point.arc_length_m, &PROJECTION_WINDOW);
                (nearest.point.arc_length_m, nearest.cross_track_m)
            }
            None => (point.arc_length_m, point.position.distance_m(&here)),
        };
        let ended = match (self.trajectory.ending(), self.tracking) {
            // A reference that waits does so at the end of the last round too.
            (Ending::Periodic, Tracking::Path { .. } | Tracking::PathByCusps { .. }) => {
                arc_length_m >= self.trajectory.length_m() * f64::from(self.laps)
            }
            _ => self.time_s >= self.end_s() - 1e-9,
        };
        Progress {
            point,
            arc_length_m,
            cross_track_m,
            ended,
        }
    }

    /// Returns whether a cusp lies between the reference and `next` that the vehicle is short of.
    fn cusp_to_come(&self, next: &ReferencePoint, here: &Point2) -> bool {
        /// Near enough to a cusp, m.
        const TOLERANCE_M: f64 = 0.1;
        let before_m = self.trajectory.at(self.time_s).arc_length_m;
        let cusp = self.cusp_after(before_m.next_up());
        cusp.is_some_and(|end| {
            end.arc_length_m < next.arc_length_m && -end.offsets_to(here).0 > TOLERANCE_M
        })
    }

    /// Returns whether a point is farther ahead of the vehicle than allowed, seen along its own
    /// direction of travel: past a cusp that direction is the new one, so the reference gets there.
    fn leads_too_far(&self, point: &ReferencePoint, here: &Point2) -> bool {
        let lead_max_m = match self.tracking {
            Tracking::Path { lead_max_m } => lead_max_m,
            Tracking::PathByCusps { lead_max_m } => {
                if self.cusp_to_come(point, here) {
                    return true;
                }
                lead_max_m
            }
            Tracking::Time => TIMED_LEAD_MAX_M,
        };
        match point.motion {
            Motion::Drive => point.ahead_of_m(here) > lead_max_m,
            Motion::Pivot | Motion::Stand => false,
        }
    }
}
