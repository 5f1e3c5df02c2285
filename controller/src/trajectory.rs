//! Time-parametrised references.

use crate::path::{Hermite, Path, PathError, Point2, SAMPLE_STEP_M};
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::PlanarPose;

/// Largest distance in time between the nodes of a trajectory, s.
pub(crate) const NODE_STEP_S: f64 = 0.05;

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
    /// Returns where the vehicle should be, heading included.
    pub fn pose(&self) -> PlanarPose {
        PlanarPose {
            x_m: self.position.x_m,
            y_m: self.position.y_m,
            yaw_rad: self.heading_rad,
        }
    }
}

/// A time-parametrised reference, stored on a uniform grid of time, with the speeds allowed along its path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawTrajectory")]
pub struct Trajectory {
    nodes: Vec<Node>,
    step_s: f64,
    path: Option<Path>,
    ending: Ending,
    /// Largest speed, m/s, at arc lengths a uniform step apart, the first at 0, the last at the end; none without a
    /// path.
    speeds_m_s: Vec<f64>,
    /// In the order of time.
    turns: Vec<SpotTurn>,
}

/// A turn on the spot during a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct SpotTurn {
    /// Where on the path it is, m.
    pub(crate) arc_length_m: f64,
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

    /// Returns the heading at a time of the trajectory, rad.
    pub(crate) fn heading_at(&self, time_s: f64) -> f64 {
        let within_s = time_s.clamp(self.from_s, self.to_s) - self.from_s;
        self.from_rad + within_s * self.yaw_rate_rad_s()
    }

    /// Returns the time at which the trajectory has a heading, s.
    pub(crate) fn time_of(&self, heading_rad: f64) -> f64 {
        let share = (heading_rad - self.from_rad) / (self.to_rad - self.from_rad);
        self.from_s + share.clamp(0.0, 1.0) * (self.to_s - self.from_s)
    }
}

#[derive(Deserialize)]
struct RawTrajectory {
    nodes: Vec<Node>,
    step_s: f64,
    path: Option<Path>,
    ending: Ending,
    speeds_m_s: Vec<f64>,
    turns: Vec<SpotTurn>,
}

impl TryFrom<RawTrajectory> for Trajectory {
    type Error = PathError;

    fn try_from(raw: RawTrajectory) -> Result<Self, PathError> {
        let turns = raw.turns;
        Ok(
            Self::new(raw.nodes, raw.step_s, raw.path, raw.ending, raw.speeds_m_s)?
                .with_turns(turns),
        )
    }
}

/// The state of a trajectory at a time of its grid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Node {
    pub(crate) arc_length_m: f64,
    pub(crate) position: Point2,
    pub(crate) heading_rad: f64,
    /// Along the heading.
    pub(crate) speed_m_s: f64,
    pub(crate) yaw_rate_rad_s: f64,
    /// From this node to the next.
    pub(crate) motion: Motion,
}

impl Trajectory {
    /// Makes a trajectory of nodes a uniform `step_s` apart, whose own speeds are those allowed.
    pub(crate) fn from_nodes(
        nodes: Vec<Node>,
        step_s: f64,
        path: Option<Path>,
        ending: Ending,
    ) -> Result<Self, PathError> {
        let mut own = Self::new(nodes, step_s, path, ending, vec![0.0, 0.0])?;
        let intervals = match own.path {
            Some(_) => (own.length_m() / SAMPLE_STEP_M).ceil().max(1.0) as usize,
            None => return Ok(own),
        };
        own.speeds_m_s = (0..=intervals)
            .map(|i| own.length_m() * i as f64 / intervals as f64)
            .map(|arc_length_m| own.at(own.time_at(arc_length_m)).speed_m_s.abs())
            .collect();
        Ok(own)
    }

    /// Makes a trajectory of nodes a uniform `step_s` apart and the speeds allowed along its path.
    pub(crate) fn new(
        nodes: Vec<Node>,
        step_s: f64,
        path: Option<Path>,
        ending: Ending,
        speeds_m_s: Vec<f64>,
    ) -> Result<Self, PathError> {
        if nodes.len() < 2 || speeds_m_s.len() < 2 || step_s <= 0.0 {
            return Err(PathError::ZeroLength);
        }
        let mut own = Self {
            nodes,
            step_s,
            path,
            ending,
            speeds_m_s,
            turns: Vec::new(),
        };
        if own.path.is_none() {
            own.turns = vec![SpotTurn {
                arc_length_m: 0.0,
                from_s: 0.0,
                to_s: own.duration_s(),
                from_rad: own.nodes[0].heading_rad,
                to_rad: own.last().heading_rad,
            }];
        }
        Ok(own)
    }

    /// Returns this trajectory with the turns on the spot along its path.
    pub(crate) fn with_turns(mut self, turns: Vec<SpotTurn>) -> Self {
        if self.path.is_some() {
            self.turns = turns;
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
        let length_m = self.length_m();
        let last = self.speeds_m_s.len() - 1;
        let within_m = match self.ending {
            Ending::Periodic if length_m > 0.0 => arc_length_m.rem_euclid(length_m),
            _ => arc_length_m.clamp(0.0, length_m),
        };
        let place = within_m / length_m.max(f64::MIN_POSITIVE) * last as f64;
        let low = (place as usize).min(last - 1);
        let ratio = (place - low as f64).clamp(0.0, 1.0);
        (1.0 - ratio) * self.speeds_m_s[low] + ratio * self.speeds_m_s[low + 1]
    }

    /// Returns this trajectory as seen from another frame, in which the origin of its own is at
    /// `frame`: `frame.yaw_rad` is the turn from the other axes to its own.
    pub fn seen_from(mut self, frame: &PlanarPose) -> Self {
        for node in &mut self.nodes {
            node.position = node.position.seen_from(frame);
            node.heading_rad += frame.yaw_rad;
        }
        for turn in &mut self.turns {
            turn.from_rad += frame.yaw_rad;
            turn.to_rad += frame.yaw_rad;
        }
        self.path = self.path.map(|path| path.seen_from(frame));
        self
    }

    /// Returns the duration, s; of one period where the trajectory is periodic.
    pub fn duration_s(&self) -> f64 {
        self.step_s * (self.nodes.len() - 1) as f64
    }

    /// Returns the distance travelled until the end, or in one period, m.
    pub fn length_m(&self) -> f64 {
        self.last().arc_length_m
    }

    /// Returns what happens after the end.
    pub fn ending(&self) -> Ending {
        self.ending
    }

    /// Returns the path under the trajectory; `None` where the vehicle only turns on the spot.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_ref()
    }

    /// Returns the reference at a time, in constant time and without allocation.
    ///
    /// Position, heading and arc length are cubic Hermite interpolations between nodes at most
    /// 0.05 s apart, speed and yaw rate linear ones. Before the start the vehicle stands in the
    /// first pose; after the end it does what [`Trajectory::ending`] says.
    pub fn at(&self, time_s: f64) -> ReferencePoint {
        let duration_s = self.duration_s();
        if time_s < 0.0 {
            return self.standing(time_s, &self.nodes[0]);
        }
        let (periods, within_s) = match self.ending {
            Ending::Stop if time_s >= duration_s => return self.standing(time_s, self.last()),
            Ending::Stop => (0.0, time_s),
            Ending::Periodic => {
                let periods = (time_s / duration_s).floor();
                (periods, (time_s - periods * duration_s).max(0.0))
            }
        };
        let from_start = within_s / self.step_s;
        let index = (from_start as usize).min(self.nodes.len() - 2);
        let (a, b) = (&self.nodes[index], &self.nodes[index + 1]);
        let hermite = Hermite::at(from_start - index as f64, self.step_s);
        let (velocity_a, velocity_b) = (a.velocity_m_s(), b.velocity_m_s());
        let turn_rad = self.last().heading_rad - self.nodes[0].heading_rad;
        ReferencePoint {
            time_s,
            arc_length_m: hermite.value(
                a.arc_length_m,
                a.speed_m_s.abs(),
                b.arc_length_m,
                b.speed_m_s.abs(),
            ) + periods * self.length_m(),
            position: Point2 {
                x_m: hermite.value(a.position.x_m, velocity_a[0], b.position.x_m, velocity_b[0]),
                y_m: hermite.value(a.position.y_m, velocity_a[1], b.position.y_m, velocity_b[1]),
            },
            heading_rad: hermite.value(
                a.heading_rad,
                a.yaw_rate_rad_s,
                b.heading_rad,
                b.yaw_rate_rad_s,
            ) + periods * turn_rad,
            speed_m_s: hermite.linear(a.speed_m_s, b.speed_m_s),
            yaw_rate_rad_s: hermite.linear(a.yaw_rate_rad_s, b.yaw_rate_rad_s),
            motion: a.motion,
        }
    }

    /// Returns the earliest time at which `arc_length_m` has been travelled, s; of arc lengths
    /// before the start 0, beyond the end the duration, or counted on where the trajectory is
    /// periodic.
    pub fn time_at(&self, arc_length_m: f64) -> f64 {
        let length_m = self.length_m();
        let periods = match self.ending {
            Ending::Periodic if length_m > 0.0 => (arc_length_m / length_m).floor().max(0.0),
            _ => 0.0,
        };
        let within_m = arc_length_m - periods * length_m;
        let after = self
            .nodes
            .partition_point(|node| node.arc_length_m < within_m);
        let within_s = if after == 0 {
            0.0
        } else if after == self.nodes.len() {
            self.duration_s()
        } else {
            self.step_s * ((after - 1) as f64 + self.ratio_at(after - 1, within_m))
        };
        periods * self.duration_s() + within_s
    }

    /// Bisects the interpolated arc length between nodes `index` and `index + 1`.
    fn ratio_at(&self, index: usize, arc_length_m: f64) -> f64 {
        let (a, b) = (&self.nodes[index], &self.nodes[index + 1]);
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            let found_m = Hermite::at(middle, self.step_s).value(
                a.arc_length_m,
                a.speed_m_s.abs(),
                b.arc_length_m,
                b.speed_m_s.abs(),
            );
            if found_m < arc_length_m {
                low = middle;
            } else {
                high = middle;
            }
        }
        high
    }

    fn standing(&self, time_s: f64, node: &Node) -> ReferencePoint {
        ReferencePoint {
            time_s,
            arc_length_m: node.arc_length_m,
            position: node.position,
            heading_rad: node.heading_rad,
            speed_m_s: 0.0,
            yaw_rate_rad_s: 0.0,
            motion: Motion::Stand,
        }
    }

    fn last(&self) -> &Node {
        &self.nodes[self.nodes.len() - 1]
    }
}

impl Node {
    fn velocity_m_s(&self) -> [f64; 2] {
        let (sin, cos) = self.heading_rad.sin_cos();
        [-sin * self.speed_m_s, cos * self.speed_m_s]
    }
}
