//! The way ahead along a reference: what it asks for where the plan has the vehicle.

use crate::config::Weights;
use crate::mpc::StageWeights;
use crate::mpc::limits::InputLimits;
use crate::path::{Path, Point2};
use crate::reference::{PROJECTION_WINDOW, Reference};
use crate::tracked_point::TrackedPoint;
use crate::trajectory::{Motion, SpotTurn};
use nalgebra::Vector3;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::speeds::MotorSpeeds;

/// Share of the traction motor's largest speed that is asked for.
const TRACTION_SHARE: f64 = 0.98;
/// Share of the steer motor's largest speed that a bend may take: what is left corrects.
const STEER_SHARE: f64 = 0.8;
/// Share of the motors' largest decelerations with which a drive ends.
const BRAKING_SHARE: f64 = 0.5;
/// Lowest speed that is asked for on the way, m/s.
const SPEED_MIN_M_S: f64 = 0.02;
/// Distance from the end of a drive that counts as being there, m, and turn, rad.
const AT_END: f64 = 1e-3;
/// Distance behind the begin of a drive that counts as being there, m.
const AT_START_M: f64 = 0.01;
/// Time from the begin of the horizon over which the weight across the path grows to its full value, s.
const CROSS_RAMP_S: f64 = 0.6;
/// Weights of the position, 1/m^2, and of the heading, 1/rad^2, during a turn on the spot, and their factor where it ends:
/// what a vehicle has slid across its last heading stays.
const PIVOT_POSITION_PER_M2: f64 = 5.0;
const PIVOT_HEADING_PER_RAD2: f64 = 20.0;
const PIVOT_END: f64 = 10.0;
/// Time that a turn on the spot takes to gain and lose speed, s, and how much longer than asked for it takes.
const PIVOT_RAMPS_S: f64 = 1.0;
const PIVOT_SLOWER: f64 = 1.2;
/// Largest cost of a way at the speed asked for, 1/s: that of errors of 1 m at the default weights. A plan that hardly
/// moves has no way to divide by; with a bound of 0.2 m one that leads away from the path stands there.
const WAY_COST_MAX: f64 = 50.0;
/// Growth of the price of speed with the cost of a way.
const PRICE_BY_WAY: f64 = 2.0;
/// Step with which the time for a length is summed, m.
pub(super) const SUM_STEP_M: f64 = 0.1;

/// What bounds speeds as it is known now.
#[derive(Debug, Clone, Copy)]
pub(super) struct SpeedsNow {
    traction_m_s: f64,
    steer_m_s: f64,
    tread_m_s: f64,
    /// Rate at which the steer motor gains speed, m/s^2.
    steer_rate_m_s2: f64,
    /// Rates at which a drive ends, m/s^2.
    traction_braking_m_s2: f64,
    steer_braking_m_s2: f64,
    half_track_m: f64,
}

impl SpeedsNow {
    pub(super) fn new(limits: &InputLimits, half_track_m: f64) -> Self {
        Self {
            traction_m_s: TRACTION_SHARE * limits.traction.speed_m_s,
            steer_m_s: STEER_SHARE * limits.steer.speed_m_s,
            tread_m_s: limits.tread_speed_m_s,
            steer_rate_m_s2: limits.steer.acceleration_m_s2,
            traction_braking_m_s2: BRAKING_SHARE * limits.traction.deceleration_m_s2,
            steer_braking_m_s2: BRAKING_SHARE * limits.steer.deceleration_m_s2,
            half_track_m,
        }
    }

    /// Returns the largest speed so far from the begin and from the end of a drive, at both of which the vehicle
    /// stands, m/s; at both that of a step from there.
    pub(super) fn between_stops(&self, from_begin_m: f64, to_end_m: f64) -> f64 {
        let to_stop_m = from_begin_m.min(to_end_m).max(SUM_STEP_M);
        (2.0 * self.traction_braking_m_s2 * to_stop_m).sqrt()
    }

    /// Returns the largest yaw rate on the spot, rad/s.
    pub(super) fn yaw_rate_rad_s(&self) -> f64 {
        self.steer_m_s / self.half_track_m
    }

    /// Returns the largest speed in a bend, m/s.
    pub(super) fn at(&self, curvature_per_m: f64) -> f64 {
        let steer_share = self.half_track_m * curvature_per_m.abs();
        self.traction_m_s
            .min(self.steer_m_s / steer_share)
            .min(self.tread_m_s / (1.0 + steer_share))
    }
}

/// What the reference asks of a stage.
#[derive(Debug, Clone, Copy)]
pub(super) struct StageRequest {
    pub(super) motion: Motion,
    /// Whether the plan is at the end of the drive here.
    pub(super) ends: bool,
    /// Whether the plan is behind the begin of the drive here.
    pub(super) behind: bool,
    /// Point of the path nearest to the plan, with its heading; on the spot the heading to which the allowed yaw rate
    /// takes the vehicle.
    pub(super) pose: PlanarPose,
    /// How the heading asked for turns for each metre ahead of the vehicle, rad/m.
    pub(super) curvature_per_m: f64,
    /// Inputs of the flat model.
    pub(super) inputs: MotorSpeeds,
    /// Speed allowed here without braking, m/s, positive.
    pub(super) scale_m_s: f64,
    /// Speed along the path with which the plan comes here, over that asked for.
    pub(super) pace: f64,
}

impl StageRequest {
    /// Returns what is asked of a vehicle that stands at a pose.
    fn stand(pose: &PlanarPose) -> Self {
        Self {
            motion: Motion::Stand,
            ends: true,
            behind: false,
            pose: *pose,
            curvature_per_m: 0.0,
            inputs: MotorSpeeds::STOP,
            scale_m_s: 1.0,
            pace: 1.0,
        }
    }

    /// Returns the weights of a stage that ends here, `end_s` after the begin of the horizon, on a way that costs so much:
    /// near the begin an error across the path is left as it is, since motors are too slow to correct it. At both ends of
    /// a drive the distance along the path is one from it as well.
    ///
    /// A plan ends after a time. One that waits, beside the path or before a place that is hard to pass, leaves what the
    /// way would have cost to the next plan, which waits as well. So to stand must cost what the way costs that is not
    /// driven: of that, a stage drives less where less speed is asked for.
    pub(super) fn weights(&self, w: &Weights, way_cost_per_m: f64, end_s: f64) -> StageWeights {
        let speed = w.speed + PRICE_BY_WAY * way_cost_per_m * self.scale_m_s;
        let ramp = (end_s / CROSS_RAMP_S).min(1.0);
        let end = if self.ends { PIVOT_END } else { 1.0 };
        match self.motion {
            Motion::Drive | Motion::Stand => StageWeights {
                along_per_m2: match (self.ends, self.behind) {
                    (true, _) => w.cross_per_m2,
                    (false, true) => ramp * w.cross_per_m2,
                    (false, false) => 0.0,
                },
                cross_per_m2: ramp * w.cross_per_m2,
                heading_per_rad2: w.heading_per_rad2,
                speed_s2_per_m2: speed / (self.scale_m_s * self.scale_m_s),
            },
            Motion::Pivot => StageWeights {
                along_per_m2: end * PIVOT_POSITION_PER_M2,
                cross_per_m2: end * PIVOT_POSITION_PER_M2,
                heading_per_rad2: end * PIVOT_HEADING_PER_RAD2,
                speed_s2_per_m2: 0.0,
            },
        }
    }
}

/// A way along a reference from where the vehicle will be, as the plan has it.
pub(super) struct Walk<'a> {
    reference: &'a Reference,
    now: SpeedsNow,
    start: PlanarPose,
    /// How far the plan has come, m; on the spot its heading, rad.
    at: f64,
    /// Heading to which the allowed yaw rate takes it on the spot, rad.
    allowed_rad: f64,
    /// Steer speed asked for on the spot, m/s, positive counter-clockwise. It grows as the motor can.
    steer_m_s: f64,
    /// Where the plan had the vehicle before, and when.
    before: Option<(Point2, f64)>,
    time_s: f64,
    /// Largest speed allowed on the path so far, m/s; infinite where the vehicle drives on none.
    fastest_m_s: f64,
    way: Way,
}

/// What a plan drives of a path, and how well. The pace p is the speed along the path over that asked for.
#[derive(Debug, Clone, Copy, Default)]
struct Way {
    /// Integral of p, s.
    driven_s: f64,
    /// Integrals of the speed asked for, m, and of 1, s.
    asked_m: f64,
    time_s: f64,
    /// Integrals of p times the squares of the distance from the path, m^2 s, and of the heading error, rad^2 s.
    distances_m2_s: f64,
    headings_rad2_s: f64,
    /// Integral of (1 - p)^2, s.
    slowness_s: f64,
}

impl Way {
    fn add(&mut self, time_s: f64, asked: &StageRequest, cross_m: f64, heading_rad: f64) {
        let pace = asked.pace.clamp(0.0, 1.0);
        self.driven_s += time_s * pace;
        self.asked_m += time_s * asked.scale_m_s;
        self.time_s += time_s;
        self.distances_m2_s += time_s * pace * cross_m.powi(2);
        self.headings_rad2_s += time_s * pace * heading_rad.powi(2);
        self.slowness_s += time_s * (1.0 - pace).powi(2);
    }
}

impl<'a> Walk<'a> {
    pub(super) fn new(
        reference: &'a Reference,
        now: SpeedsNow,
        start: &PlanarPose,
        moving: MotorSpeeds,
    ) -> Self {
        let at = match reference.turn() {
            None => reference.arc_length_m(),
            Some(_) => reference.unwrapped(start.yaw_rad),
        };
        Self {
            reference,
            now,
            start: *start,
            at,
            allowed_rad: at,
            steer_m_s: moving.steer_m_s,
            before: None,
            time_s: 0.0,
            fastest_m_s: match reference.driven_path() {
                Some(_) => 0.0,
                None => f64::INFINITY,
            },
            way: Way::default(),
        }
    }

    /// Returns what a way like the plan's costs, 1/m: its errors and its slowness over what it drives of the path.
    pub(super) fn way_cost_per_m(&self, weights: &Weights) -> f64 {
        let way = &self.way;
        let cost = weights.cross_per_m2 * way.distances_m2_s
            + weights.heading_per_rad2 * way.headings_rad2_s
            + weights.speed * way.slowness_s;
        let cost_per_s = (cost / way.driven_s.max(f64::MIN_POSITIVE)).min(WAY_COST_MAX);
        cost_per_s * way.time_s / way.asked_m.max(f64::MIN_POSITIVE)
    }

    /// Returns the largest speed allowed so far on the path, m/s, braking left out; infinite on the spot.
    pub(super) fn fastest_m_s(&self) -> f64 {
        self.fastest_m_s
    }

    /// Goes to where the plan has the vehicle at (x, y, yaw) `end_s` after the start, at a share of the allowed speeds.
    pub(super) fn to(
        &mut self,
        state: &Vector3<f64>,
        tracked_point: TrackedPoint,
        normal_in_world: &Vector3<f64>,
        end_s: f64,
        share: f64,
    ) -> StageRequest {
        let step_s = end_s - self.time_s;
        self.time_s = end_s;
        let (path, turn) = (self.reference.path(), self.reference.turn());
        if let Some(turn) = turn {
            self.at = self.reference.unwrapped(self.start.yaw_rad) + (state.z - self.start.yaw_rad);
            return self.turning(turn, state.z, step_s, share);
        }
        let Some(path) = path else {
            return StageRequest::stand(&self.start);
        };
        let lever = tracked_point.lever(normal_in_world, state.z);
        let place = Point2 {
            x_m: state.x + lever.offset_m.0,
            y_m: state.y + lever.offset_m.1,
        };
        let before = self.before.replace((place, end_s));
        let moved_m = before.map_or(0.0, |(before, _)| before.distance_m(&place));
        let guess_m = (self.at + moved_m).min(self.reference.stop_at_m().next_down());
        let nearest = path.nearest_from(&place, guess_m, guess_m, &PROJECTION_WINDOW);
        self.at = nearest.arc_length_m.max(self.at);
        let (along_m, cross_m) = nearest.offsets_to(&place);
        let mut asked = self.driving(path, state.z, share);
        self.fastest_m_s = self.fastest_m_s.max(asked.scale_m_s);
        asked.behind = self.at <= self.reference.drive_from_m() && along_m < -AT_START_M;
        if let Some((before, before_s)) = before {
            let (sin, cos) = asked.pose.yaw_rad.sin_cos();
            let (dx, dy) = (place.x_m - before.x_m, place.y_m - before.y_m);
            let along_m_s = (cos * dy - sin * dx) / (end_s - before_s);
            asked.pace = along_m_s / asked.inputs.traction_m_s;
            if !asked.ends {
                // The heading of a body whose point beside the origin follows the path is another one than the path's.
                let heading_rad = match tracked_point.is_origin() {
                    true => state.z - asked.pose.yaw_rad,
                    false => 0.0,
                };
                self.way.add(step_s, &asked, cross_m, heading_rad);
            }
        }
        asked
    }

    /// Returns the time from the reference's place to here at the trajectory's own speeds, s.
    pub(super) fn time_ahead_s(&self) -> f64 {
        match self.reference.driven_path() {
            Some(_) => {
                let time_s = self.reference.trajectory().time_at(self.at);
                (time_s - self.reference.time_s()).max(0.0)
            }
            None => 0.0,
        }
    }

    /// Returns the time that so much of the path takes, or what is left of the drive, at most `most_s`, s; on the spot that
    /// of what is left of the turn, at most half a round.
    pub(super) fn time_for_s(&self, length_m: f64, most_s: f64) -> f64 {
        if let Some(turn) = self.reference.turn() {
            let to_go_rad = (turn.to_rad - self.at).abs().min(std::f64::consts::PI);
            let yaw_rate_rad_s = turn.yaw_rate_rad_s().abs().min(self.now.yaw_rate_rad_s());
            return (PIVOT_RAMPS_S + PIVOT_SLOWER * to_go_rad / yaw_rate_rad_s).min(most_s);
        }
        let Some(path) = self.reference.driven_path() else {
            return 0.0;
        };
        let to_m = (self.at + length_m).min(self.reference.stop_at_m());
        let (mut at_m, mut time_s) = (self.at, 0.0);
        while at_m < to_m && time_s < most_s {
            let curvature_per_m = path.at(at_m).curvature_per_m;
            time_s += SUM_STEP_M / self.speed_at(at_m, curvature_per_m);
            at_m += SUM_STEP_M;
        }
        time_s.min(most_s)
    }

    /// Returns the speed at an arc length without braking, m/s.
    fn speed_at(&self, arc_length_m: f64, curvature_per_m: f64) -> f64 {
        let allowed_m_s = self.reference.trajectory().speed_at(arc_length_m);
        allowed_m_s
            .min(self.now.at(curvature_per_m))
            .max(SPEED_MIN_M_S)
    }

    /// Returns what a drive asks for here of a vehicle with a heading, whose turns are counted on.
    fn driving(&self, path: &Path, yaw_rad: f64, share: f64) -> StageRequest {
        let stop_m = self.reference.stop_at_m();
        let at = self.reference.on_drive(path, self.at);
        let to_go_m = (stop_m - self.at).max(0.0);
        let braking_m_s = (2.0 * self.now.traction_braking_m_s2 * to_go_m).sqrt();
        let scale_m_s = self.speed_at(self.at, at.curvature_per_m);
        let speed_m_s = share * scale_m_s.min(braking_m_s);
        let sign = at.direction.sign();
        let ends = to_go_m <= AT_END;
        StageRequest {
            motion: Motion::Drive,
            ends,
            behind: false,
            curvature_per_m: if ends { 0.0 } else { sign * at.curvature_per_m },
            pose: PlanarPose {
                x_m: at.position.x_m,
                y_m: at.position.y_m,
                yaw_rad: yaw_rad + wrap_angle(at.heading_rad - yaw_rad),
            },
            inputs: MotorSpeeds {
                traction_m_s: sign * speed_m_s,
                steer_m_s: self.now.half_track_m * at.curvature_per_m * speed_m_s,
            },
            scale_m_s,
            pace: 1.0,
        }
    }

    /// Returns what a turn on the spot asks for here of a vehicle with a heading, whose turns are counted on.
    fn turning(&mut self, turn: &SpotTurn, yaw_rad: f64, step_s: f64, share: f64) -> StageRequest {
        // One that has gone too far is asked back.
        let to_go_rad = turn.to_rad - self.allowed_rad;
        let sense = to_go_rad.signum();
        let half_track_m = self.now.half_track_m;
        let asked_m_s = half_track_m * turn.yaw_rate_rad_s().abs();
        let braking = (2.0 * self.now.steer_braking_m_s2 * half_track_m * to_go_rad.abs()).sqrt();
        let most_m_s = share * asked_m_s.min(self.now.steer_m_s).min(braking);
        let gained_m_s = (sense * self.steer_m_s).max(0.0) + self.now.steer_rate_m_s2 * step_s;
        self.steer_m_s = sense * gained_m_s.min(most_m_s);
        let turn_rad = step_s * self.steer_m_s / half_track_m;
        self.allowed_rad += turn_rad.clamp(-to_go_rad.abs(), to_go_rad.abs());
        let place = turn.at(turn.time_of(self.allowed_rad));
        StageRequest {
            motion: Motion::Pivot,
            ends: (turn.to_rad - self.allowed_rad).abs() <= AT_END,
            behind: false,
            pose: PlanarPose {
                yaw_rad: yaw_rad + self.allowed_rad - self.at,
                ..place.pose()
            },
            curvature_per_m: 0.0,
            inputs: MotorSpeeds {
                traction_m_s: 0.0,
                steer_m_s: self.steer_m_s,
            },
            scale_m_s: asked_m_s,
            pace: 1.0,
        }
    }
}

#[cfg(test)]
mod tests;
