//! Paths with the speeds allowed along them, and the times of a vehicle that keeps these speeds.

use crate::path::{Corner, Path, PathError, PathPoint, Point2};
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::PlanarPose;

/// What the vehicle does at a point of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// It drives along a path.
    Drive,
    /// It turns on the spot.
    Pivot,
    /// It stands, before the start or after the end.
    Stand,
}

/// What a trajectory does after its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// It begins again where it ended; heading and arc length go on counting.
    Periodic,
    /// It stays in its last pose.
    Stop,
}

/// Where the vehicle should be at a time, and how it should move there.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ReferencePoint {
    /// Time since the start of the trajectory, s, as requested.
    pub time_s: f64,
    /// Distance travelled, m.
    pub arc_length_m: f64,
    /// Position in the world.
    pub position: Point2,
    /// Heading psi of the vehicle, rad, unwrapped.
    pub heading_rad: f64,
    /// Speed along the vehicle's heading, m/s, negative in reverse.
    pub speed_m_s: f64,
    /// Rate of the heading, rad/s, counter-clockwise positive.
    pub yaw_rate_rad_s: f64,
    /// What the vehicle does.
    pub motion: Motion,
}

impl ReferencePoint {
    /// Returns a vehicle that drives at a speed, m/s, at a point of its path.
    pub(crate) fn driving(time_s: f64, at: &PathPoint, speed_m_s: f64) -> Self {
        Self {
            time_s,
            arc_length_m: at.arc_length_m,
            position: at.position,
            heading_rad: at.heading_rad,
            speed_m_s: at.direction.sign() * speed_m_s,
            yaw_rate_rad_s: at.curvature_per_m * speed_m_s,
            motion: Motion::Drive,
        }
    }

    /// Returns a vehicle that stands here.
    pub(crate) fn standing(self) -> Self {
        Self {
            speed_m_s: 0.0,
            yaw_rate_rad_s: 0.0,
            motion: Motion::Stand,
            ..self
        }
    }

    /// Returns where the vehicle should be, heading included.
    pub fn pose(&self) -> PlanarPose {
        PlanarPose {
            x_m: self.position.x_m,
            y_m: self.position.y_m,
            yaw_rad: self.heading_rad,
        }
    }
}

/// A path, or a turn on the spot, with the speeds allowed along it.
///
/// Its times are those of a vehicle that always has the speed allowed, and turns on the spot at corners.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawTrajectory", into = "RawTrajectory")]
pub struct Trajectory {
    path: Option<Path>,
    ending: Ending,
    length_m: f64,
    /// Largest speed, m/s, and the time that driving there takes, s, at arc lengths a uniform step apart, the first at 0,
    /// the last at the end.
    speeds_m_s: Vec<f64>,
    times_s: Vec<f64>,
    /// In the order of time.
    turns: Vec<SpotTurn>,
}

/// A turn on the spot during a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct SpotTurn {
    /// Where on the path it is, m.
    pub(crate) arc_length_m: f64,
    /// The place about which the vehicle's origin turns, and how far forward of the origin that is, m.
    pub(crate) centre: Point2,
    pub(crate) centre_forward_m: f64,
    /// When it begins and ends, s.
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
    /// Headings with which it begins and ends, rad, unwrapped.
    pub(crate) from_rad: f64,
    pub(crate) to_rad: f64,
}

impl SpotTurn {
    /// Returns the yaw rate, rad/s, counter-clockwise positive.
    pub(crate) fn yaw_rate_rad_s(&self) -> f64 {
        (self.to_rad - self.from_rad) / (self.to_s - self.from_s)
    }

    /// Returns the time at which the trajectory has a heading, s.
    pub(crate) fn time_of(&self, heading_rad: f64) -> f64 {
        let share = (heading_rad - self.from_rad) / (self.to_rad - self.from_rad);
        self.from_s + share.clamp(0.0, 1.0) * (self.to_s - self.from_s)
    }

    /// Returns where the vehicle is at a time of the trajectory.
    pub(crate) fn at(&self, time_s: f64) -> ReferencePoint {
        let within_s = time_s.clamp(self.from_s, self.to_s) - self.from_s;
        let heading_rad = self.from_rad + within_s * self.yaw_rate_rad_s();
        let (sin, cos) = heading_rad.sin_cos();
        ReferencePoint {
            time_s,
            arc_length_m: self.arc_length_m,
            position: Point2 {
                x_m: self.centre.x_m + self.centre_forward_m * sin,
                y_m: self.centre.y_m - self.centre_forward_m * cos,
            },
            heading_rad,
            speed_m_s: 0.0,
            yaw_rate_rad_s: self.yaw_rate_rad_s(),
            motion: Motion::Pivot,
        }
    }
}

#[derive(Serialize, Deserialize)]
struct RawTrajectory {
    path: Option<Path>,
    ending: Ending,
    length_m: f64,
    speeds_m_s: Vec<f64>,
    turns: Vec<SpotTurn>,
}

impl From<Trajectory> for RawTrajectory {
    fn from(trajectory: Trajectory) -> Self {
        Self {
            path: trajectory.path,
            ending: trajectory.ending,
            length_m: trajectory.length_m,
            speeds_m_s: trajectory.speeds_m_s,
            turns: trajectory.turns,
        }
    }
}

impl TryFrom<RawTrajectory> for Trajectory {
    type Error = PathError;

    fn try_from(raw: RawTrajectory) -> Result<Self, PathError> {
        if !raw.turns.iter().all(|turn| turn.from_s < turn.to_s) {
            return Err(PathError::ZeroLength);
        }
        match (raw.path, raw.turns.first()) {
            (Some(path), _) => Ok(Self {
                turns: raw.turns,
                ..Self::along(path, raw.ending, raw.length_m, raw.speeds_m_s)?
            }),
            (None, Some(turn)) => Ok(Self::turning(*turn)),
            (None, None) => Err(PathError::ZeroLength),
        }
    }
}

impl Trajectory {
    /// Makes a trajectory of a length along a path from the speeds at arc lengths a uniform step apart. A closed path may be
    /// driven more than once.
    ///
    /// # Errors
    /// [`PathError::ZeroLength`] of fewer than two speeds, and where they or the length are not positive.
    pub(crate) fn along(
        path: Path,
        ending: Ending,
        length_m: f64,
        speeds_m_s: Vec<f64>,
    ) -> Result<Self, PathError> {
        let positive = |value: &f64| value.is_finite() && *value > 0.0;
        if speeds_m_s.len() < 2 || !positive(&length_m) || !speeds_m_s.iter().all(positive) {
            return Err(PathError::ZeroLength);
        }
        let step_m = length_m / (speeds_m_s.len() - 1) as f64;
        let mut times_s = vec![0.0];
        times_s.extend(speeds_m_s.windows(2).scan(0.0, |time_s, pair| {
            *time_s += 2.0 * step_m / (pair[0] + pair[1]);
            Some(*time_s)
        }));
        Ok(Self {
            path: Some(path),
            ending,
            length_m,
            speeds_m_s,
            times_s,
            turns: Vec::new(),
        })
    }

    /// Makes a trajectory of one turn on the spot, which begins at time 0.
    pub(crate) fn turning(turn: SpotTurn) -> Self {
        Self {
            path: None,
            ending: Ending::Stop,
            length_m: 0.0,
            speeds_m_s: vec![0.0, 0.0],
            times_s: vec![0.0, 0.0],
            turns: vec![turn],
        }
    }

    /// Returns this trajectory with turns on the spot at the corners of its path, at a yaw rate, rad/s.
    pub(crate) fn turning_at_corners(mut self, yaw_rate_rad_s: f64) -> Self {
        let corners: Vec<Corner> = self.path.iter().flat_map(Path::corners).collect();
        for corner in corners {
            let from_s = self.time_at(corner.arc_length_m);
            self.turns.push(SpotTurn {
                arc_length_m: corner.arc_length_m,
                centre: corner.position,
                centre_forward_m: 0.0,
                from_s,
                to_s: from_s + corner.turn_rad.abs() / yaw_rate_rad_s,
                from_rad: corner.from_rad,
                to_rad: corner.from_rad + corner.turn_rad,
            });
        }
        self
    }

    /// Returns the turn on the spot at an arc length.
    pub(crate) fn turn_at(&self, arc_length_m: f64) -> Option<&SpotTurn> {
        self.turns
            .iter()
            .find(|turn| turn.arc_length_m == arc_length_m)
    }

    /// Returns the largest speed at an arc length, m/s, without that which braking to a stop allows.
    ///
    /// It is the speed that was asked for, lowered where bends, rates or ground do not allow it.
    pub fn speed_at(&self, arc_length_m: f64) -> f64 {
        let within_m = match self.ending {
            Ending::Periodic => arc_length_m.rem_euclid(self.length_m),
            Ending::Stop => arc_length_m,
        };
        let (low, ratio) = self.place(within_m);
        (1.0 - ratio) * self.speeds_m_s[low] + ratio * self.speeds_m_s[low + 1]
    }

    /// Returns the index of the last speed before an arc length of a period, and the share of the step to the next.
    fn place(&self, arc_length_m: f64) -> (usize, f64) {
        let last = self.speeds_m_s.len() - 1;
        let within_m = arc_length_m.clamp(0.0, self.length_m);
        let place = within_m / self.length_m.max(f64::MIN_POSITIVE) * last as f64;
        let low = (place as usize).min(last - 1);
        (low, (place - low as f64).clamp(0.0, 1.0))
    }

    /// Returns the time that driving to an arc length of a period takes, without turns on the spot, s.
    fn driving_s(&self, arc_length_m: f64) -> f64 {
        if self.length_m == 0.0 {
            return 0.0;
        }
        let (low, ratio) = self.place(arc_length_m);
        let (from, to) = (self.speeds_m_s[low], self.speeds_m_s[low + 1]);
        let speed_m_s = (from * from + ratio * (to * to - from * from)).sqrt();
        let step_s = self.times_s[low + 1] - self.times_s[low];
        self.times_s[low] + ratio * (from + to) / (from + speed_m_s) * step_s
    }

    /// Returns the arc length of a period that driving for a time reaches, m.
    fn driven_m(&self, driving_s: f64) -> f64 {
        let last = self.times_s.len() - 1;
        let after = self.times_s.partition_point(|time_s| *time_s <= driving_s);
        let low = after.clamp(1, last) - 1;
        let (from, to) = (self.speeds_m_s[low], self.speeds_m_s[low + 1]);
        let span_s = self.times_s[low + 1] - self.times_s[low];
        let share = ((driving_s - self.times_s[low]) / span_s).clamp(0.0, 1.0);
        let way = share * (2.0 * from + share * (to - from)) / (from + to);
        self.length_m * (low as f64 + way) / last as f64
    }

    /// Returns this trajectory as seen from another frame, in which the origin of its own is at
    /// `frame`: `frame.yaw_rad` is the turn from the other axes to its own.
    pub fn seen_from(mut self, frame: &PlanarPose) -> Self {
        for turn in &mut self.turns {
            turn.centre = turn.centre.seen_from(frame);
            turn.from_rad += frame.yaw_rad;
            turn.to_rad += frame.yaw_rad;
        }
        self.path = self.path.map(|path| path.seen_from(frame));
        self
    }

    /// Returns the duration, s; of one period where the trajectory is periodic.
    pub fn duration_s(&self) -> f64 {
        self.within_period_s(self.length_m, self.turns.last())
    }

    /// Returns the distance travelled until the end, or in one period, m.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Returns what happens after the end.
    pub fn ending(&self) -> Ending {
        self.ending
    }

    /// Returns the path under the trajectory; `None` where the vehicle only turns on the spot.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_ref()
    }

    /// Returns the reference at a time, without allocation.
    ///
    /// Before the start the vehicle stands in the first pose; after the end it does what [`Trajectory::ending`] says.
    pub fn at(&self, time_s: f64) -> ReferencePoint {
        let duration_s = self.duration_s();
        let periods = match self.ending {
            Ending::Stop => 0.0,
            Ending::Periodic => (time_s / duration_s).floor().max(0.0),
        };
        let within_s = (time_s - periods * duration_s).clamp(0.0, duration_s);
        let point = ReferencePoint {
            time_s,
            ..self.within(within_s, periods)
        };
        let ended = self.ending == Ending::Stop && time_s >= duration_s;
        if time_s < 0.0 || ended {
            return point.standing();
        }
        point
    }

    /// Returns the reference at a time of a period.
    fn within(&self, time_s: f64, periods: f64) -> ReferencePoint {
        let Some(path) = &self.path else {
            return self.turns[0].at(time_s);
        };
        let done = self.turns.partition_point(|turn| turn.to_s <= time_s);
        if let Some(turn) = self.turns.get(done).filter(|turn| turn.from_s <= time_s) {
            return turn.at(time_s);
        }
        let driving_s = match self.turns[..done].last() {
            Some(turn) => time_s - turn.to_s + self.driving_s(turn.arc_length_m),
            None => time_s,
        };
        let mut arc_length_m = self.driven_m(driving_s);
        let speed_m_s = self.speed_at(arc_length_m);
        if self.ending == Ending::Stop {
            // The end of a closed path belongs to this lap.
            arc_length_m = arc_length_m.min(path.length_m().next_down());
        }
        let at = path.at(arc_length_m + periods * self.length_m);
        ReferencePoint::driving(time_s, &at, speed_m_s)
    }

    /// Returns the earliest time at which `arc_length_m` has been travelled, s; of arc lengths
    /// before the start 0, beyond the end the duration, or counted on where the trajectory is
    /// periodic.
    pub fn time_at(&self, arc_length_m: f64) -> f64 {
        let periods = match self.ending {
            Ending::Periodic => (arc_length_m / self.length_m).floor().max(0.0),
            Ending::Stop => 0.0,
        };
        let within_m = arc_length_m - periods * self.length_m;
        let done = self
            .turns
            .partition_point(|turn| turn.arc_length_m < within_m);
        periods * self.duration_s() + self.within_period_s(within_m, self.turns[..done].last())
    }

    /// Returns the time of a period at an arc length behind the last turn before it, s.
    fn within_period_s(&self, arc_length_m: f64, turn: Option<&SpotTurn>) -> f64 {
        let driving_s = self.driving_s(arc_length_m);
        turn.map_or(driving_s, |turn| {
            turn.to_s + driving_s - self.driving_s(turn.arc_length_m)
        })
    }
}
