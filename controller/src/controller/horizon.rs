//! From the estimate to the horizon that the MPC is asked for.

use super::{Controller, Law};
use crate::config::AttitudePreview;
use crate::estimator::Estimate;
use crate::mpc::{Model, StageTarget};
use crate::reference::Progress;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::speeds::MotorSpeeds;

impl Controller {
    /// Makes the horizon of this cycle: the reference from the instant at which a command given now
    /// acts, seen from where the vehicle will then be. A law that does not predict has none.
    pub(super) fn look_ahead(&mut self, estimate: &Estimate, progress: &Progress, elapsed_s: f64) {
        let half_track_m = 0.5 * (self.vehicle.icrs.right_m - self.vehicle.icrs.left_m);
        let previous = self.last_command();
        let Law::Mpc(mpc) = &mut self.law else {
            return;
        };
        let mut caution = 0.0;
        if self.adapts {
            match mpc.model_mut() {
                Model::Icr(model) => {
                    let gains = estimate.bounded_gains(half_track_m, progress.cross_track_m);
                    model.set_slip_gains(&gains);
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
        self.horizon.start = self.roll_forward(estimate);
        self.horizon.previous = previous;
        self.horizon.change_weights = self.config.change_weights(caution);
        self.fill_targets(estimate, half_track_m, caution);
    }

    /// Puts the reference over the horizon into its targets.
    fn fill_targets(&mut self, estimate: &Estimate, half_track_m: f64, caution: f64) {
        self.horizon.targets.clear();
        let (Some(reference), Law::Mpc(mpc)) = (&self.reference, &self.law) else {
            return;
        };
        let ends_s = mpc.stage_times().ends_s();
        let config = &self.config;
        let map = self
            .terrain
            .as_ref()
            .filter(|_| config.attitude_preview == AttitudePreview::Terrain);
        for end_s in ends_s {
            let point = reference.ahead(config.delay_s() + end_s);
            // Beyond the map's edge the plane the vehicle stands on is the best guess there is.
            let normal_in_world = map
                .and_then(|map| map.surface(point.position.x_m, point.position.y_m).ok())
                .map_or(estimate.normal_in_world, |surface| surface.normal_in_world);
            self.horizon.targets.push(StageTarget {
                pose: point.pose(),
                along_heading_rad: point.heading_rad,
                normal_in_world,
                feedforward: MotorSpeeds {
                    traction_m_s: point.speed_m_s,
                    steer_m_s: half_track_m * point.yaw_rate_rad_s,
                },
                weights: config.stage_weights(point.motion, caution),
            });
        }
    }

    /// Returns where the vehicle will be when a command given now acts: the estimate moved on
    /// through the commands in flight.
    fn roll_forward(&mut self, estimate: &Estimate) -> PlanarPose {
        let mut pose = estimate.pose;
        let Law::Mpc(mpc) = &mut self.law else {
            return pose;
        };
        let begin_s = estimate.time_s - self.config.delay_s();
        for (i, issued) in self.issued.iter().enumerate() {
            let until_s = self
                .issued
                .get(i + 1)
                .map_or(estimate.time_s, |next| next.time_s);
            let time_s = until_s - issued.time_s.max(begin_s);
            if time_s > 0.0 {
                let step = mpc.model_mut().step_on_plane(
                    &estimate.normal_in_world,
                    pose.yaw_rad,
                    issued.command,
                    time_s,
                );
                pose.x_m += step.increment.x;
                pose.y_m += step.increment.y;
                pose.yaw_rad += step.increment.z;
            }
        }
        pose
    }
}
