//! Progress along a trajectory, drive by drive.
//!
//! A drive goes up to the next cusp or corner, or to the end of the path. How far it has come is where the vehicle is,
//! not how late it is: the reference of a cycle is the point of the path nearest to the vehicle, with the speed allowed
//! there. A turn on the spot, at a corner or as all there is, is a drive in heading.

use crate::path::{Path, PathPoint, Point2, Window};
use crate::trajectory::{Ending, ReferencePoint, SpotTurn, Trajectory};
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::{PlanarPose, wrap_angle};

/// A trajectory and how far it has been followed.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    trajectory: Trajectory,
    laps: u32,
    number: u64,
    /// Arc lengths at which drives end; none where the path goes on for ever.
    ends_m: Vec<f64>,
    /// Drives along the path that are done.
    drives_done: usize,
    /// The turn on the spot that the vehicle is in.
    turn: Option<SpotTurn>,
    /// Arc length of the point nearest to the vehicle, m.
    arc_length_m: f64,
    /// Heading of the vehicle on a turn on the spot, rad, unwrapped.
    heading_rad: f64,
    /// Time on the trajectory at which a vehicle that keeps its times is there, s.
    time_s: f64,
    /// Whether the vehicle has been seen on this path.
    begun: bool,
    /// Least that was left of the present drive, m, or rad on the spot, and the time since the vehicle came nearer, s.
    least_to_go: f64,
    no_nearer_s: f64,
    /// Whether it has gone away from there again.
    leaves: bool,
}

/// Position of the vehicle relative to the reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// The reference of this cycle.
    pub point: ReferencePoint,
    /// Arc length of the nearest point of the path, m; 0 on a turn on the spot.
    pub arc_length_m: f64,
    /// Distance from the path, m, positive to the left of travel; from the reference's position,
    /// positive, on a turn on the spot.
    pub cross_track_m: f64,
    /// Whether the vehicle is where the last drive ends.
    pub ended: bool,
}

/// Part of the path around the vehicle's last place that is searched for the nearest point, so that it cannot
/// jump to another branch at a crossing.
pub const PROJECTION_WINDOW: Window = Window {
    behind_m: 2.0,
    ahead_m: 1.0,
};

/// Distance from the end of a drive at which it is over, m.
const ARRIVED_M: f64 = 0.05;
/// Distances from the end of the last drive, and of one before, within which it is over for a vehicle that comes no nearer,
/// m: near its end a drive asks for speeds that may be too low for a motor to move at.
const NEAR_M: f64 = 0.3;
const NEAR_STOP_M: f64 = 0.1;
/// Way by which a vehicle comes nearer, m, or turn, rad.
const NEARER: f64 = 0.01;
/// Time without that after which a drive is over at its end, and near it, s: a vehicle that goes away from there again has
/// that shorter time as well.
const AT_END_S: f64 = 1.0;
const NEAR_END_S: f64 = 3.0;
/// Heading error at which a turn on the spot is over, rad, and that for a vehicle that comes no nearer for
/// [`NEAR_END_S`].
const ARRIVED_RAD: f64 = 0.02;
const NEAR_RAD: f64 = 0.1;
/// Motor speed below which a vehicle stands, m/s.
const STANDING_M_S: f64 = 0.02;

/// Distance that a vehicle at the start of a path must be nearer to a point ahead to begin there, m.
const ENTRY_GAIN_M: f64 = 0.5;
/// Distance that counts as much as a heading error of 1 rad, m.
const ENTRY_M_PER_RAD: f64 = 1.0;
/// Distance between the points at which a path may be begun, m.
const ENTRY_STEP_M: f64 = 0.1;
/// Share of a path that must be to come where it is begun.
const ENTRY_TO_COME: f64 = 0.5;

impl Reference {
    /// Returns a reference for one lap of `trajectory`.
    pub fn new(trajectory: Trajectory) -> Self {
        let ends_m = match (trajectory.ending(), trajectory.path()) {
            (Ending::Stop, Some(path)) => path.stops_m().chain([path.length_m()]).collect(),
            _ => Vec::new(),
        };
        let heading_rad = trajectory.at(0.0).heading_rad;
        let turn = match trajectory.path() {
            Some(_) => None,
            None => trajectory.turn_at(0.0).copied(),
        };
        Self {
            turn,
            trajectory,
            laps: 1,
            number: 0,
            ends_m,
            drives_done: 0,
            arc_length_m: 0.0,
            heading_rad,
            time_s: 0.0,
            begun: false,
            least_to_go: f64::INFINITY,
            no_nearer_s: 0.0,
            leaves: false,
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

    /// Returns this reference moved on to where the trajectory has come `arc_length_m` far.
    pub fn starting_at(mut self, arc_length_m: f64) -> Self {
        self.begun = arc_length_m > 0.0;
        self.move_to(arc_length_m);
        self.drives_done = self.ends_m.partition_point(|end_m| *end_m <= arc_length_m);
        self.drives_done = self.drives_done.min(self.ends_m.len().saturating_sub(1));
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

    /// Returns the time at which a vehicle that keeps the trajectory's times is where this one is, s.
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

    /// Returns where a vehicle that keeps the trajectory's times is `ahead_s` after the place of this one.
    pub fn ahead(&self, ahead_s: f64) -> ReferencePoint {
        self.trajectory.at(self.time_s + ahead_s)
    }

    /// Returns the arc length of the point of the path nearest to the vehicle, m.
    pub fn arc_length_m(&self) -> f64 {
        self.arc_length_m
    }

    /// Returns whether a vehicle at the end of its drive comes no nearer to it, or leaves it again. One that has turned too
    /// far on the spot comes back.
    pub(crate) fn stays(&self) -> bool {
        self.no_nearer_s >= AT_END_S || (self.leaves && self.turn.is_none())
    }

    /// Returns whether the vehicle is close to the end of its drive and comes nearer to it, if slowly.
    pub(crate) fn approaches_end(&self) -> bool {
        self.stop_at_m() - self.arc_length_m <= NEAR_M && self.no_nearer_s < NEAR_END_S
    }

    /// Keeps account of how the vehicle comes nearer to the end of its drive.
    fn come_nearer(&mut self, elapsed_s: f64, to_go: f64) {
        self.no_nearer_s += elapsed_s;
        if to_go < self.least_to_go - NEARER {
            (self.least_to_go, self.no_nearer_s) = (to_go, 0.0);
        }
        self.leaves = to_go > self.least_to_go + NEARER;
    }

    /// Returns the path, where there is one.
    pub fn path(&self) -> Option<&Path> {
        self.trajectory.path()
    }

    /// Returns the arc length up to which the present drive goes, m: the next cusp or the end; infinite on a path
    /// without an end.
    pub fn stop_at_m(&self) -> f64 {
        self.ends_m
            .get(self.drives_done)
            .copied()
            .unwrap_or(f64::INFINITY)
    }

    /// Returns the point of the present drive at an arc length, which is clamped to it.
    pub(crate) fn on_drive(&self, path: &Path, arc_length_m: f64) -> PathPoint {
        path.at(arc_length_m.clamp(self.drive_from_m(), self.stop_at_m().next_down()))
    }

    /// Returns the arc length from which the present drive goes, m.
    pub(crate) fn drive_from_m(&self) -> f64 {
        match self.drives_done.checked_sub(1) {
            Some(before) => self.ends_m[before],
            None => 0.0,
        }
    }

    /// Returns the turn on the spot that the vehicle is in.
    pub(crate) fn turn(&self) -> Option<&SpotTurn> {
        self.turn.as_ref()
    }

    /// Returns the path that the vehicle drives along; none while it turns on the spot.
    pub(crate) fn driven_path(&self) -> Option<&Path> {
        self.path().filter(|_| self.turn.is_none())
    }

    /// Returns the distance of a place, which is about `way_m` ahead of the vehicle's, from the path of the present drive, m,
    /// left of travel positive; none on a turn on the spot.
    pub(crate) fn cross_track_further_m(&self, place: &Point2, way_m: f64) -> Option<f64> {
        let path = self.driven_path()?;
        let around_m = (self.arc_length_m + way_m).min(self.stop_at_m().next_down());
        let nearest = path.nearest_from(place, around_m, around_m, &PROJECTION_WINDOW);
        Some(nearest.offsets_to(place).1)
    }

    /// Returns what tells one drive from the next.
    pub(crate) fn drive(&self) -> (usize, bool) {
        (self.drives_done, self.turn.is_some())
    }

    /// Returns the heading of a vehicle on a turn on the spot, rad, counted on over whole turns.
    pub(crate) fn unwrapped(&self, yaw_rad: f64) -> f64 {
        self.heading_rad + wrap_angle(yaw_rad - self.heading_rad)
    }

    /// Returns what is left of a turn on the spot, rad, counter-clockwise positive.
    pub(crate) fn turn_to_go_rad(&self) -> f64 {
        self.turn.map_or(0.0, |turn| turn.to_rad - self.heading_rad)
    }

    /// Takes the vehicle's pose, which must be finite, and its last command, and returns its progress.
    ///
    /// A drive is over where the vehicle has come to rest at its end, or comes no nearer to it; then the next one begins.
    pub fn advance(&mut self, elapsed_s: f64, pose: &PlanarPose, stands: bool) -> Progress {
        let here = Point2 {
            x_m: pose.x_m,
            y_m: pose.y_m,
        };
        if let Some(turn) = self.turn {
            let progress = self.advance_turn(elapsed_s, &turn, &here, pose.yaw_rad);
            if !progress.ended || self.path().is_none() {
                return progress;
            }
            self.turn = None;
            (self.least_to_go, self.no_nearer_s) = (f64::INFINITY, 0.0);
        }
        if !self.begun {
            self.begun = true;
            self.begin_where_it_fits(pose);
        }
        let mut cross_track_m = self.project(&here);
        let to_go_m = self.stop_at_m() - self.arc_length_m;
        self.come_nearer(elapsed_s, to_go_m);
        let last = self.drives_done + 1 >= self.ends_m.len();
        let waits_s = if self.leaves { AT_END_S } else { NEAR_END_S };
        let near_m = if last { NEAR_M } else { NEAR_STOP_M };
        let near = to_go_m <= near_m && self.no_nearer_s >= waits_s;
        let arrived = to_go_m <= ARRIVED_M || near;
        if arrived && !last && (stands || self.stays()) {
            self.drives_done += 1;
            (self.least_to_go, self.no_nearer_s) = (f64::INFINITY, 0.0);
            self.arc_length_m = self.drive_from_m();
            if let Some(turn) = self.trajectory.turn_at(self.arc_length_m).copied() {
                self.turn = Some(turn);
                self.heading_rad = turn.from_rad;
                return Progress {
                    ended: false,
                    ..self.advance_turn(0.0, &turn, &here, pose.yaw_rad)
                };
            }
            cross_track_m = self.project(&here);
        }
        let ended = match self.trajectory.ending() {
            Ending::Periodic => {
                self.arc_length_m >= self.trajectory.length_m() * f64::from(self.laps)
            }
            Ending::Stop => arrived && last,
        };
        Progress {
            point: self.point(ended),
            arc_length_m: self.arc_length_m,
            cross_track_m,
            ended,
        }
    }

    fn move_to(&mut self, arc_length_m: f64) {
        self.arc_length_m = arc_length_m;
        self.time_s = self.trajectory.time_at(arc_length_m);
    }

    /// Returns the point of the vehicle's place with the speed allowed there.
    fn point(&self, ended: bool) -> ReferencePoint {
        let Some(path) = self.trajectory.path() else {
            return self.trajectory.at(self.time_s);
        };
        let at = self.on_drive(path, self.arc_length_m);
        let ended = ended && self.trajectory.ending() == Ending::Stop;
        let point = ReferencePoint {
            arc_length_m: self.arc_length_m,
            ..ReferencePoint::driving(
                self.time_s,
                &at,
                self.trajectory.speed_at(self.arc_length_m),
            )
        };
        if ended { point.standing() } else { point }
    }

    /// Moves to the point of the present drive nearest to the vehicle and returns the distance from the path.
    fn project(&mut self, here: &Point2) -> f64 {
        let Some(path) = self.trajectory.path() else {
            return 0.0;
        };
        let around_m = self.arc_length_m;
        let mut window = PROJECTION_WINDOW;
        if !self.ends_m.is_empty() {
            let (from_m, to_m) = (self.drive_from_m(), self.stop_at_m());
            window.behind_m = window.behind_m.min(around_m - from_m.next_up()).max(0.0);
            window.ahead_m = window.ahead_m.min(to_m.next_down() - around_m).max(0.0);
        }
        let nearest = path.nearest_within(here, around_m, &window);
        let cross_track_m = nearest.cross_track_m;
        self.move_to(nearest.point.arc_length_m);
        cross_track_m
    }

    /// Begins at the point of the path that the vehicle's place and heading fit best, where that is clearly ahead of
    /// the start.
    fn begin_where_it_fits(&mut self, pose: &PlanarPose) {
        let Some(path) = self.trajectory.path() else {
            return;
        };
        let place = Point2 {
            x_m: pose.x_m,
            y_m: pose.y_m,
        };
        let misfit_m = |arc_length_m: f64| {
            let point = path.at(arc_length_m);
            let turned_rad = wrap_angle(pose.yaw_rad - point.heading_rad);
            point.position.distance_m(&place) + ENTRY_M_PER_RAD * turned_rad.abs()
        };
        let steps = (ENTRY_TO_COME * path.length_m() / ENTRY_STEP_M) as usize;
        let near_start = (PROJECTION_WINDOW.ahead_m / ENTRY_STEP_M) as usize;
        let best_of = |steps: std::ops::RangeInclusive<usize>| {
            steps
                .map(|i| ENTRY_STEP_M * i as f64)
                .map(|arc_length_m| (misfit_m(arc_length_m), arc_length_m))
                .min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let (Some(start), Some(best)) = (best_of(0..=near_start), best_of(0..=steps)) else {
            return;
        };
        if best.0 < start.0 - ENTRY_GAIN_M {
            self.move_to(best.1);
            self.drives_done = self.ends_m.partition_point(|end_m| *end_m <= best.1);
        }
    }

    /// Returns the progress of a turn on the spot.
    fn advance_turn(
        &mut self,
        elapsed_s: f64,
        turn: &SpotTurn,
        here: &Point2,
        yaw_rad: f64,
    ) -> Progress {
        self.heading_rad = self.unwrapped(yaw_rad);
        let sense = (turn.to_rad - turn.from_rad).signum();
        let mut to_go_rad = sense * (turn.to_rad - self.heading_rad);
        if self.path().is_none() {
            // At a corner the next drive corrects a turn that has gone too far; here nothing else does.
            to_go_rad = to_go_rad.abs();
        }
        self.come_nearer(elapsed_s, to_go_rad);
        let near = to_go_rad <= NEAR_RAD && self.no_nearer_s >= NEAR_END_S;
        let ended = to_go_rad <= ARRIVED_RAD || near;
        let heading_rad = if ended { turn.to_rad } else { self.heading_rad };
        let mut point = turn.at(turn.time_of(heading_rad));
        self.time_s = turn.time_of(self.heading_rad);
        if ended && self.path().is_none() {
            point = self.trajectory.at(turn.to_s);
        }
        Progress {
            point,
            arc_length_m: turn.arc_length_m,
            cross_track_m: point.position.distance_m(here),
            ended,
        }
    }
}

/// Returns whether a command lets the vehicle stand.
pub fn stands(command: sidehill_plant::speeds::MotorSpeeds) -> bool {
    command.traction_m_s.abs() < STANDING_M_S && command.steer_m_s.abs() < STANDING_M_S
}
