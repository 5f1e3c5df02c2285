//! From the estimate to the reference ahead: the horizon that the MPC solves for.

use super::walk::{SpeedsNow, Walk};
use super::{Controller, Law};
use crate::config::{AttitudePreview, Weights};
use crate::estimator::{Estimate, slide_share};
use crate::guard::Guard;
use crate::memory::Memory;
use crate::mpc::{Model, Mpc, StageTarget, StepStart};
use crate::reference::{Progress, Reference, stands};
use crate::tracked_point::{TrackedPoint, heading_difference_after};
use crate::trajectory::Motion;
use nalgebra::Vector3;
use sidehill_plant::contact::BodyState;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::terrain::Terrain;

/// Largest difference between the headings of body and path that a target has, rad.
const MOST_RAD: f64 = 1.2;

/// Length of the path that the horizon covers at least, in half track widths: a vehicle has to begin a turn before
/// it, and slides through it.
const LENGTH_MIN: f64 = 1.6;
/// Largest factor by which the stages are stretched for that.
const STRETCH_MAX: f64 = 8.0;
/// Time over which the cost of a way is averaged, s: one plan may be far worse than the next.
const WAY_COST_S: f64 = 0.25;
/// Largest factor between the stretches of two cycles.
const STRETCH_CHANGE: f64 = 1.05;

/// Largest speed of traction over the largest speed allowed along the horizon: what it has more brings a vehicle back to
/// its path.
const FASTER_MAX: f64 = 1.25;

/// Weight of the heading of a body that must lead its tracked point, at the end of the horizon, over that of the error
/// into which it turns. Without it each plan would swing the point to the path at its end, and the next one again.
const LEADING_END: f64 = 40.0;

/// Factor on the weight of a change of steer on the path, where most of what steer would answer is the poses' noise, and
/// far beside it.
const STEER_CHANGE_ON_PATH: f64 = 2.5;
const STEER_CHANGE_OFF_PATH: f64 = 0.25;
/// Distance from the path at which that factor is half way between both, m.
const OFF_PATH_M: f64 = 0.05;

/// Noise of positions from which on a change of steer has its full weight, m: with less the weight falls as the
/// noise's variance does, as far as this share.
const NOISY_M: f64 = 0.01;
const NOISE_SHARE_MIN: f64 = 1.0 / 16.0;

impl Controller {
    /// Returns how far the vehicle has come.
    pub(super) fn advance_reference(
        &mut self,
        estimate: Option<&Estimate>,
        elapsed_s: f64,
    ) -> Option<Progress> {
        let pose = &estimate?.pose;
        let point = self.tracked_point().of(pose, &estimate?.normal_in_world);
        let stands = stands(self.issued.last());
        let reference = self.reference.as_mut()?;
        let (before, progress) = (
            reference.drive(),
            reference.advance(elapsed_s, &point, stands),
        );
        // The plan ends where the drive before has ended.
        if reference.drive() != before {
            self.way_cost_per_m = 0.0;
            self.discard_plan();
        }
        Some(progress)
    }

    /// Returns what bounds the speed at a place, as known now.
    pub(super) fn speed_limits(&self) -> SpeedsNow {
        SpeedsNow::new(
            &self.drives.limits(&self.config.limits),
            self.horizon.half_track_m,
        )
    }

    /// Returns the factor by which stages are stretched so that the horizon is long enough at the speeds ahead.
    fn stretch(&self, mpc: &Mpc, speeds: SpeedsNow) -> f64 {
        let Some(reference) = &self.reference else {
            return 1.0;
        };
        let length_m = LENGTH_MIN * self.horizon.half_track_m;
        let most_s = STRETCH_MAX * mpc.stage_times().whole_s();
        let (start, moving) = (&self.horizon.start, self.horizon.previous);
        let time_s = Walk::new(reference, speeds, start, moving).time_for_s(length_m, most_s);
        let wanted = (time_s / mpc.stage_times().whole_s()).max(1.0);
        let now = mpc.stage_times().stretch();
        match mpc.plan() {
            Some(_) => wanted.clamp(now / STRETCH_CHANGE, now * STRETCH_CHANGE),
            None => wanted,
        }
    }

    /// Makes the horizon of this cycle: the reference from the instant at which a command given now
    /// acts, seen from where the vehicle will then be. A law that does not predict has none.
    pub(super) fn look_ahead(
        &mut self,
        estimate: &Estimate,
        progress: &Progress,
        elapsed_s: f64,
        sample: &Sample,
    ) {
        let half_track_m = self.horizon.half_track_m;
        let previous = self.drives.followed(self.drives.asked(self.issued.last()));
        let Law::Mpc(mpc) = &mut self.law else {
            return;
        };
        if self.adapts {
            match mpc.model_mut() {
                Model::Icr(model) => {
                    let gains = estimate.bounded_gains(half_track_m, progress.cross_track_m);
                    model.set_slip_gains(&gains);
                    if let Some(memory) = &mut self.memory {
                        memory.gains = gains;
                    }
                }
                Model::Contact(model) => {
                    if let Some(learned) = &estimate.contact {
                        model.set_parameters(&learned.parameters);
                    }
                }
            }
        }
        let speeds = self.speed_limits();
        self.learn_places(estimate, sample, elapsed_s);
        (self.horizon.start, self.horizon.moving) = self.roll_forward(estimate, progress);
        self.horizon.previous = previous;
        self.horizon.change_weights = self.config.weights.changes();
        self.horizon.change_weights.steer *=
            steer_change(progress.cross_track_m) * noise_share(estimate.pose_noise_m);
        let Law::Mpc(mpc) = &self.law else {
            return;
        };
        let stretch = self.stretch(mpc, speeds);
        // A vehicle so much slower has the same problem in so much more time.
        self.horizon.change_weights.traction *= stretch.powi(3);
        self.horizon.change_weights.steer *= stretch.powi(3);
        self.fill_targets(estimate, progress, speeds, elapsed_s, stretch);
    }

    /// Moves the plan on and puts into the horizon's targets what the path asks for where the plan has the vehicle. A
    /// plan that a drive towards the path is far better than is replaced by that.
    fn fill_targets(
        &mut self,
        estimate: &Estimate,
        progress: &Progress,
        speeds: SpeedsNow,
        elapsed_s: f64,
        stretch: f64,
    ) {
        let tracked_point = self.tracked_point();
        let (Some(reference), Law::Mpc(mpc)) = (&self.reference, &mut self.law) else {
            self.horizon.targets.clear();
            return;
        };
        let config = &self.config;
        let normal_at_end = self
            .horizon
            .targets
            .last()
            .map_or(estimate.normal_in_world, |target| target.normal_in_world);
        mpc.move_on(elapsed_s, stretch, &normal_at_end);
        let ahead = HorizonInputs {
            reference,
            speeds,
            tracked_point,
            map: self
                .terrain
                .as_ref()
                .filter(|_| config.attitude_preview == AttitudePreview::Terrain),
            guard: self.guard.as_ref().filter(|guard| guard.slows()),
            memory: self.memory.as_ref().filter(|memory| memory.config.by_place),
            estimate,
            progress,
            weights: &config.weights,
            way_cost_per_m: self.way_cost_per_m,
            certain_share: certain_share(
                estimate.bound_across_m(progress.point.heading_rad)
                    / config.supervisor.cross_track_uncertainty_max_m,
            ),
        };
        let start = self.horizon.start;
        if mpc.wants_first_plan() {
            let mut walk = ahead.walk(&start, self.horizon.previous);
            mpc.try_first_plan(&self.horizon, |end_s, state, input| {
                ahead.target(&mut walk, end_s, state, input)
            });
        }
        self.horizon.targets.clear();
        let mut fastest_m_s = f64::INFINITY;
        if let Some(plan) = mpc.plan() {
            // The plan's headings are counted on from its own.
            let mut start = start;
            start.yaw_rad = plan.states[0].z;
            let mut walk = ahead.walk(&start, self.horizon.previous);
            for (k, (state, input)) in plan.states[1..].iter().zip(&plan.inputs).enumerate() {
                let end_s = mpc.stage_times().end_s(k);
                let target = ahead.target(&mut walk, end_s, state, *input);
                self.horizon.targets.push(target);
            }
            fastest_m_s = walk.fastest_m_s();
            let change_per_m = walk.way_cost_per_m(&config.weights) - self.way_cost_per_m;
            self.way_cost_per_m += (elapsed_s / WAY_COST_S).min(1.0) * change_per_m;
        }
        let mut limits = self.drives.limits(&config.limits);
        limits.traction.speed_m_s = limits.traction.speed_m_s.min(FASTER_MAX * fastest_m_s);
        mpc.set_motor_limits(limits.traction, limits.steer);
        if !tracked_point.is_origin() {
            self.turn_targets(tracked_point, progress.point.heading_rad);
        }
    }

    /// Turns the targets' headings from those of the path to those of a vehicle whose tracked point
    /// follows it on level ground, and their inputs to those of its origin.
    ///
    /// A point ahead of the line through the ICRs swings the body into its direction, from the heading
    /// that the vehicle has; one behind it, or one ahead in reverse, must be led there by headings that
    /// follow from those at the end of the horizon.
    fn turn_targets(&mut self, point: TrackedPoint, heading_rad: f64) {
        let half_track_m = self.horizon.half_track_m;
        let Law::Mpc(mpc) = &self.law else {
            return;
        };
        let ahead_m = point.forward_m - self.vehicle.icrs.forward_m;
        let times = mpc.stage_times();
        let targets = &mut self.horizon.targets;
        let mut before_rad = heading_rad;
        let mut difference_rad =
            wrap_angle(self.horizon.start.yaw_rad - before_rad).clamp(-MOST_RAD, MOST_RAD);
        for (k, target) in targets.iter_mut().enumerate() {
            let way_m = target.feedforward.traction_m_s * times.step_s(k);
            let path_rad = target.along_heading_rad;
            difference_rad -= wrap_angle(path_rad - before_rad);
            difference_rad = if way_m * ahead_m < 0.0 {
                0.0
            } else {
                difference_after(difference_rad, way_m, ahead_m)
            };
            target.pose.yaw_rad = path_rad + difference_rad;
            before_rad = path_rad;
        }
        let mut difference_rad = 0.0;
        for k in (0..targets.len()).rev() {
            let path_rad = targets[k].along_heading_rad;
            let way_m = targets[k].feedforward.traction_m_s * times.step_s(k);
            if way_m * ahead_m < 0.0 {
                targets[k].pose.yaw_rad = path_rad + difference_rad;
                let before_rad = match k {
                    0 => heading_rad,
                    _ => targets[k - 1].along_heading_rad,
                };
                difference_rad += wrap_angle(path_rad - before_rad);
                difference_rad = difference_after(difference_rad, -way_m, ahead_m);
            } else {
                difference_rad = targets[k].pose.yaw_rad - path_rad;
            }
        }
        if let Some(end) = targets.last_mut()
            && end.feedforward.traction_m_s * ahead_m < 0.0
        {
            end.weights.heading_per_rad2 +=
                LEADING_END * end.weights.cross_per_m2 * ahead_m.powi(2);
        }
        let mut before_rad = self.horizon.start.yaw_rad;
        for (k, target) in targets.iter_mut().enumerate() {
            if target.feedforward.traction_m_s == 0.0 {
                continue;
            }
            let yaw_rate_rad_s = wrap_angle(target.pose.yaw_rad - before_rad) / times.step_s(k);
            before_rad = target.pose.yaw_rad;
            let difference_rad = target.pose.yaw_rad - target.along_heading_rad;
            let forward_m_s = target.feedforward.traction_m_s * difference_rad.cos();
            target.feedforward = MotorSpeeds {
                traction_m_s: forward_m_s - point.right_m * yaw_rate_rad_s,
                steer_m_s: half_track_m * yaw_rate_rad_s,
            };
        }
    }

    /// Returns what memory knows of the slip where the vehicle is, per metre, (x, y, yaw) in the world.
    fn slip_here(&self, estimate: &Estimate, progress: &Progress) -> Vector3<f64> {
        let memory = self.memory.as_ref().filter(|memory| memory.config.by_place);
        let path = self.reference.as_ref().and_then(Reference::driven_path);
        let (Some(memory), Some(path)) = (memory, path) else {
            return Vector3::zeros();
        };
        let here = path.at(progress.arc_length_m).pose();
        let known = memory.known(&here, estimate.time_s);
        slide_share(progress.cross_track_m) * known.slip_per_m
    }

    /// Returns where the vehicle will be when a command given now acts, and how it moves there: the estimate moved on
    /// through the commands in flight.
    fn roll_forward(
        &mut self,
        estimate: &Estimate,
        progress: &Progress,
    ) -> (PlanarPose, BodyState) {
        let mut pose = estimate.pose;
        let mut moving = BodyState {
            velocity: estimate.velocity.vector(),
            force: estimate.tyre_force,
        };
        let slip_per_m = self.slip_here(estimate, progress);
        let Law::Mpc(mpc) = &mut self.law else {
            return (pose, moving);
        };
        let begin_s = estimate.time_s - self.drives.response().delay_s;
        let limits = self.drives.limits(&self.config.limits);
        for (command, time_s) in self.issued.between(begin_s, estimate.time_s) {
            let asked = limits.within_bounds(self.drives.asked(command));
            let command = self.drives.followed(asked);
            let step = mpc.model_mut().step_near(
                &mut StepStart::default(),
                &estimate.normal_in_world,
                pose.yaw_rad,
                command,
                time_s,
                &mut moving,
            );
            let moved = step.increment + time_s * command.traction_m_s.abs() * slip_per_m;
            pose.x_m += moved.x;
            pose.y_m += moved.y;
            pose.yaw_rad += moved.z;
        }
        (pose, moving)
    }
}

/// What the targets of a cycle follow from.
struct HorizonInputs<'a> {
    reference: &'a Reference,
    speeds: SpeedsNow,
    tracked_point: TrackedPoint,
    map: Option<&'a Terrain>,
    /// Where it slows the vehicle down.
    guard: Option<&'a Guard>,
    /// Where it knows places.
    memory: Option<&'a Memory>,
    estimate: &'a Estimate,
    progress: &'a Progress,
    weights: &'a Weights,
    way_cost_per_m: f64,
    /// Share of the speeds with which a vehicle drives that does not know well where it is.
    certain_share: f64,
}

impl<'a> HorizonInputs<'a> {
    fn walk(&self, start: &PlanarPose, moving: MotorSpeeds) -> Walk<'a> {
        Walk::new(self.reference, self.speeds, start, moving)
    }

    /// Returns the target of a stage that a plan ends at `state`, `end_s` after the begin of the horizon, with `input`.
    ///
    /// On a path it is the point nearest to the vehicle, in place across the path and in speed along it, and, once the
    /// drive's end is reached, that end. On a turn on the spot it is the position and the yaw rate, and the heading once
    /// that is reached.
    fn target(
        &self,
        walk: &mut Walk<'a>,
        end_s: f64,
        state: &Vector3<f64>,
        input: MotorSpeeds,
    ) -> StageTarget {
        let estimate = self.estimate;
        let share = self
            .guard
            .map_or(1.0, |guard| guard.share_at(walk.time_ahead_s()))
            .min(self.certain_share);
        let normal = &estimate.normal_in_world;
        let asked = walk.to(state, self.tracked_point, normal, end_s, share);
        // Beyond the map's edge the plane under the vehicle is the best available guess.
        let normal_in_world = self
            .map
            .and_then(|map| map.surface(asked.pose.x_m, asked.pose.y_m).ok())
            .map_or(estimate.normal_in_world, |surface| surface.normal_in_world);
        let (mut pose, mut slip) = (asked.pose, Vector3::zeros());
        if let Some(memory) = self.memory {
            let known = memory.known(&pose, estimate.time_s);
            let (sin, cos) = asked.pose.yaw_rad.sin_cos();
            pose.x_m += cos * known.aim_right_m;
            pose.y_m += sin * known.aim_right_m;
            let speed_m_s = input.traction_m_s.abs();
            slip = slide_share(self.progress.cross_track_m) * speed_m_s * known.slip_per_m;
        }
        let mut errors_share = 1.0;
        let weights = asked.weights(self.weights, self.way_cost_per_m, end_s);
        if asked.motion == Motion::Drive && !asked.ends {
            // Errors count by the way that is driven with them, ahead or back.
            errors_share = asked.pace.powi(2).min(1.0);
        }
        StageTarget {
            pose,
            tracked_point: self.tracked_point,
            along_heading_rad: asked.pose.yaw_rad,
            curvature_per_m: asked.curvature_per_m,
            normal_in_world,
            feedforward: asked.inputs,
            speed_m_s: asked.inputs.traction_m_s,
            slip,
            weights,
            errors_share,
        }
    }
}

/// Returns the factor on the weight of a change of steer at a distance from the path.
fn steer_change(cross_track_m: f64) -> f64 {
    let squared = (cross_track_m / OFF_PATH_M).powi(2);
    let off_path = squared / (1.0 + squared);
    STEER_CHANGE_ON_PATH + off_path * (STEER_CHANGE_OFF_PATH - STEER_CHANGE_ON_PATH)
}

/// Returns the share of the weight of a change of steer at a noise of positions: what steer answers of it moves the
/// vehicle to and fro.
fn noise_share(pose_noise_m: f64) -> f64 {
    (pose_noise_m / NOISY_M).powi(2).clamp(NOISE_SHARE_MIN, 1.0)
}

/// Returns the share of the speeds at a share of the largest uncertainty: whole up to half of it, from there falling
/// to a third.
fn certain_share(uncertainty: f64) -> f64 {
    (1.0 - 4.0 / 3.0 * (uncertainty - 0.5)).clamp(1.0 / 3.0, 1.0)
}

/// Returns the difference between the headings of body and path after a way along it, within bounds.
fn difference_after(difference_rad: f64, way_m: f64, ahead_m: f64) -> f64 {
    let within = difference_rad.clamp(-MOST_RAD, MOST_RAD);
    if ahead_m == 0.0 {
        return 0.0;
    }
    heading_difference_after(within, way_m, ahead_m)
}

#[cfg(test)]
pub(super) mod tests;
