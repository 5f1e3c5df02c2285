//! A law of the user's own, driven as a controller is.

use super::Driver;
use crate::config::ControllerConfig;
use crate::controller::{Decision, Status};
use crate::reference::{Progress, Reference, stands};
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::MotorSpeeds;

/// A law of the user's own: a function of the newest readings and of the reference with the vehicle's progress along
/// it, none before there is a pose. It returns the effective command until the next cycle, or none to end the run.
pub struct OwnLaw<F> {
    law: F,
    config: ControllerConfig,
    reference: Reference,
    /// Each reading as it came last.
    newest: Sample,
    last: MotorSpeeds,
}

impl<F: FnMut(&Sample, &Reference, Option<&Progress>) -> Option<MotorSpeeds>> OwnLaw<F> {
    /// Returns a law that follows `reference`; of the settings the control period, the limits and the tracked point
    /// count.
    pub fn new(config: ControllerConfig, reference: Reference, law: F) -> Self {
        Self {
            law,
            config,
            reference,
            newest: Sample {
                time_s: 0.0,
                tread_speeds: None,
                attitude: None,
                yaw_rate: None,
                pose: None,
            },
            last: MotorSpeeds::STOP,
        }
    }

    /// Moves the reference on to where the newest pose is.
    fn advance(&mut self, elapsed_s: f64) -> Option<Progress> {
        let pose = self.newest.pose?.value;
        let attitude = self
            .newest
            .attitude
            .map_or_else(Default::default, |a| a.value);
        let normal = attitude.plane_normal(pose.yaw_rad);
        let point = self.tracked_point().of(&pose.planar(), &normal);
        Some(self.reference.advance(elapsed_s, &point, stands(self.last)))
    }
}

impl<F: FnMut(&Sample, &Reference, Option<&Progress>) -> Option<MotorSpeeds>> Driver for OwnLaw<F> {
    fn step(&mut self, sample: &Sample) -> Decision {
        let elapsed_s = sample.time_s - self.newest.time_s;
        self.newest = Sample {
            time_s: sample.time_s,
            tread_speeds: sample.tread_speeds.or(self.newest.tread_speeds),
            attitude: sample.attitude.or(self.newest.attitude),
            yaw_rate: sample.yaw_rate.or(self.newest.yaw_rate),
            pose: sample.pose.or(self.newest.pose),
        };
        let progress = self.advance(elapsed_s);
        let ended = progress.is_some_and(|progress| progress.ended);
        let wanted = (!ended)
            .then(|| (self.law)(&self.newest, &self.reference, progress.as_ref()))
            .flatten();
        let stopping = || {
            self.config
                .limits
                .stop_step(self.last, self.config.period_s)
        };
        self.last = wanted.unwrap_or_else(stopping);
        let status = match wanted {
            Some(_) => Status::Tracking,
            None => Status::Finished,
        };
        Decision {
            progress,
            reference: self.reference.number(),
            ..Decision::of_command(sample.time_s, self.last, status)
        }
    }

    fn reference(&self) -> Option<&Reference> {
        Some(&self.reference)
    }

    fn config(&self) -> &ControllerConfig {
        &self.config
    }
}
