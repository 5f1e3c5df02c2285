//! Speeds along a path that the motors can follow.

use crate::mpc::limits::InputLimits;
use crate::path::{Path, PathError, PathPoint, SAMPLE_STEP_M};
use crate::trajectory::{Ending, Motion, NODE_STEP_S, Node, SpotTurn, Trajectory};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};
use sidehill_plant::vehicle::Vehicle;

/// What bounds the speed along a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedLimits {
    /// Speed wanted on the open stretch, m/s.
    pub speed_max_m_s: f64,
    /// Largest traction |tau|, m/s.
    pub traction_max_m_s: f64,
    /// Largest steer |sigma|, m/s.
    pub steer_max_m_s: f64,
    /// Largest speed of a tread, |tau| + |sigma|, m/s; infinite where only the motors bind.
    pub tread_max_m_s: f64,
    /// Largest rate at which the speed grows, m/s^2.
    pub acceleration_m_s2: f64,
    /// Largest rate at which the speed falls, m/s^2.
    pub deceleration_m_s2: f64,
    /// Largest |d sigma/dt|, m/s^2; infinite for none.
    pub steer_acceleration_m_s2: f64,
    /// Largest |curvature| speed^2, m/s^2; infinite for none.
    pub lateral_acceleration_m_s2: f64,
    /// Effective distance D between the tread ICRs, m: sigma = yaw rate * D/2.
    pub track_width_m: f64,
    /// Speed at the start of the path, m/s; lowered to what the path allows.
    pub initial_speed_m_s: f64,
}

/// How fast a path without times is driven, as the configuration file gives it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpeedConfig {
    /// Speed on the open stretch.
    pub speed_m_s: f64,
    /// Share of the motors' limits that the profile uses. The rest is left to feedback and slope.
    pub motor_share: f64,
    /// Largest
    pub lateral_acceleration_m_s2: f64,
}

impl Default for SpeedConfig {
    fn default() -> Self {
        Self {
            speed_m_s: 0.8,
            motor_share: 0.5,
            lateral_acceleration_m_s2: 1.0,
        }
    }
}

impl SpeedConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        Bounds::new(0.01, 20.0, "m/s").check("speed.speed_m_s", self.speed_m_s)?;
        Bounds::new(0.05, 1.0, "").check("speed.motor_share", self.motor_share)?;
        Bounds::new(0.01, 100.0, "m/s^2").check(
            "speed.lateral_acceleration_m_s2",
            self.lateral_acceleration_m_s2,
        )?;
        Ok(())
    }

    /// Returns the bounds on the speed of `vehicle` with motors of `limits`, from a standing start.
    pub fn limits(&self, limits: &InputLimits, vehicle: &Vehicle) -> SpeedLimits {
        let share = self.motor_share;
        SpeedLimits {
            speed_max_m_s: self.speed_m_s,
            traction_max_m_s: limits.traction.speed_m_s,
            steer_max_m_s: share * limits.steer.speed_m_s,
            tread_max_m_s: limits.tread_speed_m_s,
            acceleration_m_s2: share * limits.traction.acceleration_m_s2,
            deceleration_m_s2: share * limits.traction.deceleration_m_s2,
            steer_acceleration_m_s2: share * limits.steer.acceleration_m_s2,
            lateral_acceleration_m_s2: self.lateral_acceleration_m_s2,
            track_width_m: vehicle.icrs.right_m - vehicle.icrs.left_m,
            initial_speed_m_s: 0.0,
        }
    }
}

/// Largest yaw rate at a corner, rad/s.
const TURN_MAX_RAD_S: f64 = 0.5;

impl SpeedLimits {
    /// Returns the yaw rate at a corner, rad/s: the treads move no faster than the vehicle is to drive.
    fn turn_rad_s(&self) -> f64 {
        let tread_m_s = self
            .speed_max_m_s
            .min(self.steer_max_m_s)
            .min(self.tread_max_m_s);
        (2.0 * tread_m_s / self.track_width_m).min(TURN_MAX_RAD_S)
    }

    fn check(&self) -> Result<(), RangeError> {
        // Infinity means no limit.
        let positive = |key, value: f64| {
            if value == f64::INFINITY {
                return Ok(value);
            }
            Bounds::positive("").check(key, value)
        };
        positive("speed_max_m_s", self.speed_max_m_s)?;
        positive("traction_max_m_s", self.traction_max_m_s)?;
        positive("steer_max_m_s", self.steer_max_m_s)?;
        positive("tread_max_m_s", self.tread_max_m_s)?;
        positive("acceleration_m_s2", self.acceleration_m_s2)?;
        positive("deceleration_m_s2", self.deceleration_m_s2)?;
        positive("steer_acceleration_m_s2", self.steer_acceleration_m_s2)?;
        positive("lateral_acceleration_m_s2", self.lateral_acceleration_m_s2)?;
        Bounds::new(1e-3, 50.0, "m/s").check("speed_max_m_s", self.speed_max_m_s)?;
        Bounds::new(1e-3, 100.0, "m").check("track_width_m", self.track_width_m)?;
        Bounds::new(0.0, 50.0, "m/s").check("initial_speed_m_s", self.initial_speed_m_s)?;
        Ok(())
    }

    /// Returns the largest speed at a curvature, m/s, by all bounds on speeds.
    fn speed_at(&self, curvature_per_m: f64) -> f64 {
        let curvature = curvature_per_m.abs();
        // sigma = D/2 * curvature * v
        let steer_share = 0.5 * self.track_width_m * curvature;
        self.speed_max_m_s
            .min(self.traction_max_m_s)
            .min(self.steer_max_m_s / steer_share)
            .min(self.tread_max_m_s / (1.0 + steer_share))
            .min((self.lateral_acceleration_m_s2 / curvature).sqrt())
    }
}

/// Returns the fastest trajectory along `path` within `limits`, the speeds of its own stretches and, at each point,
/// `speed_cap_m_s` (as for a slope), with a stop at every cusp and corner and at the end.
///
/// With w = v^2 on a grid of arc length, speed and curvature bounds cap w, and the bounds on
/// traction and steer acceleration,
///   -deceleration <= dw/ds / 2 <= acceleration,
///   |d(sigma)/dt| = D/2 |curvature' w + curvature dw/ds / 2| <= steer acceleration,
/// are linear in neighbouring w; one pass backward and one forward give the largest w. A closed path
/// is driven once round. The steer may step where the vehicle stands.
///
/// # Errors
/// [`PathError::Range`] for a limit or cap that is not positive.
pub fn speed_profile(
    path: &Path,
    limits: &SpeedLimits,
    speed_cap_m_s: impl Fn(&PathPoint) -> f64,
) -> Result<Trajectory, PathError> {
    limits.check()?;
    let mut stops_m: Vec<f64> = vec![0.0];
    stops_m.extend(path.stops_m());
    stops_m.push(path.length_m());
    let (mut knots, mut allowed) = (Vec::new(), Vec::new());
    for (index, ends) in stops_m.windows(2).enumerate() {
        let initial_m_s = if index == 0 {
            limits.initial_speed_m_s
        } else {
            0.0
        };
        let mut stretch = Stretch::new(path, ends[0], ends[1], limits, &speed_cap_m_s)?;
        stretch.lower_where_curvature_changes();
        allowed.extend(stretch.knots(f64::INFINITY, f64::INFINITY));
        knots.extend(stretch.knots(initial_m_s, 0.0));
    }
    timed(path, limits, &knots, evenly_spaced(path, &allowed))
}

/// Returns the speeds of knots, m/s, at arc lengths a uniform step apart.
fn evenly_spaced(path: &Path, knots: &[Knot]) -> Vec<f64> {
    let intervals = (path.length_m() / SAMPLE_STEP_M).ceil().max(1.0) as usize;
    let mut knot = 0;
    (0..=intervals)
        .map(|i| {
            let arc_length_m = path.length_m() * i as f64 / intervals as f64;
            while knot + 2 < knots.len() && knots[knot + 1].arc_length_m <= arc_length_m {
                knot += 1;
            }
            let (a, b) = (&knots[knot], &knots[knot + 1]);
            let span_m = (b.arc_length_m - a.arc_length_m).max(f64::MIN_POSITIVE);
            let ratio = ((arc_length_m - a.arc_length_m) / span_m).clamp(0.0, 1.0);
            a.speed() + ratio * (b.speed() - a.speed())
        })
        .collect()
}

/// A place on the path and the squared speed there.
#[derive(Debug, Clone, Copy)]
struct Knot {
    arc_length_m: f64,
    speed_squared: f64,
}

/// A part of the path between stops, on a uniform grid.
struct Stretch<'a> {
    limits: &'a SpeedLimits,
    start_m: f64,
    step_m: f64,
    curvatures: Vec<f64>,
    caps: Vec<f64>,
}

impl<'a> Stretch<'a> {
    fn new(
        path: &Path,
        start_m: f64,
        end_m: f64,
        limits: &'a SpeedLimits,
        speed_cap_m_s: impl Fn(&PathPoint) -> f64,
    ) -> Result<Self, PathError> {
        let intervals = ((end_m - start_m) / SAMPLE_STEP_M).ceil().max(4.0) as usize;
        let step_m = (end_m - start_m) / intervals as f64;
        let mut curvatures = Vec::with_capacity(intervals + 1);
        let mut local_caps = Vec::with_capacity(intervals + 1);
        for i in 0..=intervals {
            // The end belongs to this stretch, not to the one after a cusp, nor to the next lap.
            let point = path.at((start_m + i as f64 * step_m).min(end_m.next_down()));
            let at_m = point.arc_length_m;
            let own = path.slowest_m_s((at_m - step_m).max(start_m), (at_m + step_m).min(end_m));
            let cap = speed_cap_m_s(&point);
            if cap.is_nan() || cap <= 0.0 {
                return Err(PathError::Range(RangeError {
                    key: "speed_cap_m_s",
                    value: cap,
                    bounds: Bounds::positive("m/s"),
                }));
            }
            curvatures.push(point.curvature_per_m);
            local_caps.push(cap.min(own));
        }
        let caps = (0..=intervals)
            .map(|i| {
                // Neighbours count, so that the bound holds between the knots too.
                let beside = i.saturating_sub(1)..=(i + 1).min(intervals);
                let speed = beside
                    .map(|j| limits.speed_at(curvatures[j]).min(local_caps[j]))
                    .fold(f64::INFINITY, f64::min);
                speed * speed
            })
            .collect();
        Ok(Self {
            limits,
            start_m,
            step_m,
            curvatures,
            caps,
        })
    }

    /// Lowers the largest speeds to those at which steer follows changes of the curvature.
    fn lower_where_curvature_changes(&mut self) {
        let yaw_acceleration = self.yaw_acceleration();
        for i in 0..self.caps.len() - 1 {
            let slope = (self.curvatures[i + 1] - self.curvatures[i]).abs() / self.step_m;
            for j in [i, i + 1] {
                self.caps[j] = self.caps[j].min(yaw_acceleration / slope);
            }
        }
    }

    fn yaw_acceleration(&self) -> f64 {
        2.0 * self.limits.steer_acceleration_m_s2 / self.limits.track_width_m
    }

    /// Returns the largest speeds from one at the start, m/s, to one at the end.
    fn knots(&self, initial_m_s: f64, final_m_s: f64) -> Vec<Knot> {
        let last = self.caps.len() - 1;
        let yaw_acceleration = self.yaw_acceleration();
        let mut squares = self.caps.clone();
        squares[0] = squares[0].min(initial_m_s * initial_m_s);
        squares[last] = squares[last].min(final_m_s * final_m_s);
        for i in (0..last).rev() {
            let bound = squares[i + 1] + 2.0 * self.step_m * self.limits.deceleration_m_s2;
            squares[i] = squares[i].min(bound);
            for [here, there] in self.steer_rate_weights(i) {
                let rest = there * squares[i + 1];
                squares[i] = squares[i].min(steer_bound(here, rest, yaw_acceleration));
            }
        }
        for i in 0..last {
            let bound = squares[i] + 2.0 * self.step_m * self.limits.acceleration_m_s2;
            squares[i + 1] = squares[i + 1].min(bound);
            for [there, here] in self.steer_rate_weights(i) {
                let rest = there * squares[i];
                squares[i + 1] = squares[i + 1].min(steer_bound(here, rest, yaw_acceleration));
            }
        }
        squares
            .into_iter()
            .enumerate()
            .map(|(i, speed_squared)| Knot {
                arc_length_m: self.start_m + i as f64 * self.step_m,
                speed_squared,
            })
            .collect()
    }

    /// Returns the factors of w at knots `index` and `index + 1` in 2/D d(sigma)/dt, just after the
    /// one and just before the other; between them it is linear in arc length.
    fn steer_rate_weights(&self, index: usize) -> [[f64; 2]; 2] {
        let (a, b) = (self.curvatures[index], self.curvatures[index + 1]);
        let half = 0.5 / self.step_m;
        [
            [half * (2.0 * b - 3.0 * a), half * a],
            [half * -b, half * (3.0 * b - 2.0 * a)],
        ]
    }
}

/// Returns the largest w with |weight * w + rest| <= limit, where 0 meets it or nothing does.
fn steer_bound(weight: f64, rest: f64, limit: f64) -> f64 {
    if weight == 0.0 {
        f64::INFINITY
    } else if weight > 0.0 {
        ((limit - rest) / weight).max(0.0)
    } else {
        ((limit + rest) / -weight).max(0.0)
    }
}

/// Puts the knots, between which the acceleration is constant, on a uniform grid of time, with the turns on the spot.
fn timed(
    path: &Path,
    limits: &SpeedLimits,
    knots: &[Knot],
    allowed_m_s: Vec<f64>,
) -> Result<Trajectory, PathError> {
    let mut corners = path.corners().peekable();
    let mut turns: Vec<SpotTurn> = Vec::new();
    let mut times_s = vec![0.0];
    let mut duration_s = 0.0;
    for pair in knots.windows(2) {
        let length_m = pair[1].arc_length_m - pair[0].arc_length_m;
        if length_m > 1e-9 {
            duration_s += 2.0 * length_m / (pair[0].speed() + pair[1].speed());
        } else if let Some(corner) =
            corners.next_if(|corner| corner.arc_length_m <= pair[1].arc_length_m)
        {
            let from_s = duration_s;
            duration_s += corner.turn_rad.abs() / limits.turn_rad_s();
            turns.push(SpotTurn {
                arc_length_m: corner.arc_length_m,
                from_s,
                to_s: duration_s,
                from_rad: corner.from_rad,
                to_rad: corner.from_rad + corner.turn_rad,
            });
        }
        times_s.push(duration_s);
    }
    let intervals = (duration_s / NODE_STEP_S).ceil().max(1.0) as usize;
    let step_s = duration_s / intervals as f64;
    let mut nodes = Vec::with_capacity(intervals + 1);
    let mut knot = 0;
    for i in 0..=intervals {
        let time_s = (i as f64 * step_s).min(duration_s);
        while knot + 2 < knots.len() && times_s[knot + 1] <= time_s {
            knot += 1;
        }
        let (a, b) = (&knots[knot], &knots[knot + 1]);
        let (since_s, span_s) = (time_s - times_s[knot], times_s[knot + 1] - times_s[knot]);
        let acceleration_m_s2 = if span_s > 0.0 {
            (b.speed() - a.speed()) / span_s
        } else {
            0.0
        };
        let speed_m_s = (a.speed() + acceleration_m_s2 * since_s).max(0.0);
        let arc_length_m = (a.arc_length_m
            + since_s * (a.speed() + 0.5 * acceleration_m_s2 * since_s))
            .min(b.arc_length_m);
        // The end of a closed path belongs to this lap.
        let point = path.at(arc_length_m.min(path.length_m().next_down()));
        let node = Node {
            arc_length_m,
            position: point.position,
            heading_rad: point.heading_rad,
            speed_m_s: point.direction.sign() * speed_m_s,
            yaw_rate_rad_s: point.curvature_per_m * speed_m_s,
            motion: Motion::Drive,
        };
        let turn = turns.get(turns.partition_point(|turn| turn.to_s <= time_s));
        nodes.push(match turn.filter(|turn| turn.from_s <= time_s) {
            Some(turn) => Node {
                heading_rad: turn.heading_at(time_s),
                speed_m_s: 0.0,
                yaw_rate_rad_s: turn.yaw_rate_rad_s(),
                motion: Motion::Pivot,
                ..node
            },
            None => node,
        });
    }
    let trajectory = Trajectory::new(nodes, step_s, Some(path.clone()), Ending::Stop, allowed_m_s)?;
    Ok(trajectory.with_turns(turns))
}

impl Knot {
    fn speed(&self) -> f64 {
        self.speed_squared.sqrt()
    }
}
