//! From the estimate to the reference ahead: the horizon that the MPC solves for.

use super::overshoot::Overshoot;
use super::unrolling::Unrolling;
use super::{Controller, Law, Phase};
use crate::config::{AttitudePreview, WeightFactors};
use crate::estimator::{Estimate, slide_share};
use crate::mpc::{Model, StageTarget, StepStart};
use crate::path::Point2;
use crate::reference::{Progress, Reference};
use crate::tracked_point::{TrackedPoint, heading_difference_after};
use crate::trajectory::Motion;
use nalgebra::Vector3;
use sidehill_plant::contact::BodyState;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::MotorSpeeds;

/// Largest difference between the headings of body and path that a target has, rad.
const MOST_RAD: f64 = 1.2;

/// Length of the path before a cusp or the end on which the weight of errors along the path is whole: a vehicle that
/// comes there late cuts the cusp, or stops short.
const ON_TIME_M: f64 = 1.0;

impl Controller {
    /// Moves the reference on; it waits for a vehicle that has been stopped.
    pub(super) fn advance_reference(
        &mut self,
        estimate: Option<&Estimate>,
        elapsed_s: f64,
    ) -> Option<Progress> {
        let elapsed_s = match self.phase {
            Phase::Stopped(_) => 0.0,
            Phase::Driving { .. } | Phase::Finished => match &self.guard {
                Some(guard) => elapsed_s * guard.share(),
                None => elapsed_s,
            },
        };
        let pose = &estimate?.pose;
        let point = self.tracked_point().of(pose, &estimate?.normal_in_world);
        Some(self.reference.as_mut()?.advance(elapsed_s, &point))
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
        let previous = self.issued.last();
        let Law::Mpc(mpc) = &mut self.law else {
            return;
        };
        let factors = match mpc.model_mut() {
            Model::Icr(_) => WeightFactors::NONE,
            Model::Contact(_) => self.config.contact.factors(
                progress.cross_track_m,
                self.issued.driving_s(estimate.time_s),
            ),
        };
        let mut caution = 0.0;
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
            let error = estimate.model_error_m_s / self.config.caution.error_m_s;
            caution = error.powi(2).min(1.0);
        }
        self.horizon.elapsed_s = elapsed_s;
        self.learn_places(estimate, sample, elapsed_s);
        (self.horizon.start, self.horizon.moving) = self.roll_forward(estimate, progress);
        self.horizon.previous = previous;
        self.horizon.change_weights = self.config.change_weights(caution);
        self.horizon.change_weights.steer *= factors.steer_change;
        let point = self
            .tracked_point()
            .of(&estimate.pose, &estimate.normal_in_world);
        self.standstill.observe(elapsed_s, progress, &point);
        self.fill_targets(estimate, progress, caution, &factors);
    }

    /// Puts the reference over the horizon into its targets.
    fn fill_targets(
        &mut self,
        estimate: &Estimate,
        progress: &Progress,
        caution: f64,
        factors: &WeightFactors,
    ) {
        let half_track_m = self.horizon.half_track_m;
        self.horizon.targets.clear();
        let (Some(reference), Law::Mpc(mpc)) = (&self.reference, &self.law) else {
            return;
        };
        let ends_s = mpc.stage_times().ends_s();
        let config = &self.config;
        let tracked_point = self.tracked_point();
        let map = self
            .terrain
            .as_ref()
            .filter(|_| config.attitude_preview == AttitudePreview::Terrain);
        let guard = self.guard.as_ref().filter(|guard| guard.slows());
        let mut slowed_s = guard.map_or(0.0, |guard| guard.after_s(0.0, config.delay_s()));
        let lag_until_m = reference.stop_at_m() - ON_TIME_M;
        let weights = &config.weights;
        let mut unrolling = (weights.along_per_m2 != weights.cross_per_m2)
            .then(|| Unrolling::new(reference, progress));
        for (k, end_s) in ends_s.iter().enumerate() {
            let (ahead_s, share) = match guard {
                Some(guard) => {
                    slowed_s = guard.after_s(slowed_s, mpc.stage_times().step_s(k));
                    (slowed_s, guard.share_at(slowed_s))
                }
                None => (config.delay_s() + end_s, 1.0),
            };
            let point = reference.ahead(ahead_s);
            // Beyond the map's edge the plane under the vehicle is the best available guess.
            let normal_in_world = map
                .and_then(|map| map.surface(point.position.x_m, point.position.y_m).ok())
                .map_or(estimate.normal_in_world, |surface| surface.normal_in_world);
            let planned = mpc.planned_state(k, self.horizon.elapsed_s);
            let mut overshoot = None;
            let (pose, along_heading_rad) = match (&mut unrolling, planned) {
                (Some(unrolling), Some(planned)) => {
                    let lever = tracked_point.lever(&normal_in_world, planned.z);
                    let place = Point2 {
                        x_m: planned.x + lever.offset_m.0,
                        y_m: planned.y + lever.offset_m.1,
                    };
                    overshoot = Overshoot::of(reference, &point, &place);
                    unrolling.target(&point, &place)
                }
                _ => (point.pose(), point.heading_rad),
            };
            let (mut pose, mut slip) = (pose, Vector3::zeros());
            if let Some(memory) = self.memory.as_ref().filter(|memory| memory.config.by_place) {
                let known = memory.known(&point.pose(), estimate.time_s);
                let (sin, cos) = along_heading_rad.sin_cos();
                pose.x_m += cos * known.aim_right_m;
                pose.y_m += sin * known.aim_right_m;
                let input = mpc.plan().map(|plan| plan.inputs[k].traction_m_s);
                let speed_m_s = input.unwrap_or(share * point.speed_m_s).abs();
                slip = slide_share(progress.cross_track_m) * speed_m_s * known.slip_per_m;
            }
            let mut weights = config.stage_weights(point.motion, caution, *end_s);
            if point.motion == Motion::Drive {
                if point.arc_length_m < lag_until_m {
                    weights.along_per_m2 *= factors.along;
                }
                weights = weights.scaled(factors.errors(config.delay_s() + end_s));
            }
            if let Some(overshoot) = overshoot {
                overshoot.weigh(&mut pose, along_heading_rad, &mut weights);
            }
            self.horizon.targets.push(StageTarget {
                pose,
                tracked_point,
                along_heading_rad,
                normal_in_world,
                feedforward: MotorSpeeds {
                    traction_m_s: share * point.speed_m_s,
                    steer_m_s: share * half_track_m * point.yaw_rate_rad_s,
                },
                slip,
                weights: self.standstill.urge(weights),
            });
        }
        if !tracked_point.is_origin() {
            self.turn_targets(tracked_point);
        }
    }

    /// Turns the targets' headings from those of the path to those of a vehicle whose tracked point
    /// follows it on level ground, and their inputs to those of its origin.
    ///
    /// A point ahead of the line through the ICRs swings the body into its direction, from the heading
    /// that the vehicle has; one behind it, or one ahead in reverse, must be led there by headings that
    /// follow from those at the end of the horizon.
    fn turn_targets(&mut self, point: TrackedPoint) {
        let half_track_m = self.horizon.half_track_m;
        let (Some(reference), Law::Mpc(mpc)) = (&self.reference, &self.law) else {
            return;
        };
        let ahead_m = point.forward_m - self.vehicle.icrs.forward_m;
        let times = mpc.stage_times();
        let targets = &mut self.horizon.targets;
        let begin_s = self.config.delay_s();
        let first = reference.ahead(begin_s);
        let mut before_rad = first.heading_rad;
        let mut difference_rad =
            wrap_angle(self.horizon.start.yaw_rad - before_rad).clamp(-MOST_RAD, MOST_RAD);
        for (k, target) in targets.iter_mut().enumerate() {
            let way_m = target.feedforward.traction_m_s * times.step_s(k);
            let path_rad = target.along_heading_rad;
            difference_rad -= path_rad - before_rad;
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
                    0 => first.heading_rad,
                    _ => targets[k - 1].along_heading_rad,
                };
                difference_rad += path_rad - before_rad;
                difference_rad = difference_after(difference_rad, -way_m, ahead_m);
            } else {
                difference_rad = targets[k].pose.yaw_rad - path_rad;
            }
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
        let path = self.reference.as_ref().and_then(Reference::path);
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
        let begin_s = estimate.time_s - self.config.delay_s();
        for (command, time_s) in self.issued.between(begin_s, estimate.time_s) {
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

/// Returns the difference between the headings of body and path after a way along it, within bounds.
fn difference_after(difference_rad: f64, way_m: f64, ahead_m: f64) -> f64 {
    let within = difference_rad.clamp(-MOST_RAD, MOST_RAD);
    if ahead_m == 0.0 {
        return 0.0;
    }
    heading_difference_after(within, way_m, ahead_m)
}

#[cfg(test)]
mod tests;
