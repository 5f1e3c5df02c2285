//! Poses that the filter rejects, and when it accepts them after all.
//!
//! A pose far from the prediction is an outlier, or the model is wrong by more than the filter knows: treads
//! that slip, a vehicle that was carried. Outliers contradict each other; poses of a vehicle whose model is
//! wrong agree with each other. So rejected poses between which the vehicle can have moved form a run, and a
//! run that lasts is accepted: the covariance of the predicted pose is inflated such that the pose passes.
//! From then on dead reckoning is trusted less, until innovations are small again for a while.

use super::EstimatorSettings;
use nalgebra::{Matrix3, Vector3};
use sidehill_plant::frames::{BodyVelocity, wrap_angle};

/// Factor on the variance of dead reckoning once a run has been accepted.
const NOISE_FACTOR: f64 = 100.0;
/// Time constant with which that factor decays to 1, s.
const NOISE_DECAY_S: f64 = 10.0;
/// Share of the gate from which an innovation keeps the factor up.
const STILL_LARGE: f64 = 0.25;
/// Standard deviations of two poses' difference within which noise may move them.
const NOISE_SIGMAS: f64 = 4.0 * std::f64::consts::SQRT_2;
/// How fast a vehicle may slide and turn in addition to the motion of its treads, m/s and rad/s.
const SLIDE_M_S: f64 = 0.3;
const SLIDE_RAD_S: f64 = 0.3;

/// A rejected pose with the prediction for its time, (x, y, yaw).
#[derive(Debug, Clone, Copy)]
pub(super) struct RefusedPose {
    pub(super) time_s: f64,
    pub(super) pose: Vector3<f64>,
    pub(super) predicted: Vector3<f64>,
    /// What the treads give without what was learned, which may be what is wrong.
    pub(super) unlearned: BodyVelocity,
}

/// Rejected poses that agree with each other.
#[derive(Debug, Clone, Copy)]
struct RejectedRun {
    since_s: f64,
    newest: RefusedPose,
}

/// Standard deviations of a pose, m and rad.
#[derive(Debug, Clone, Copy)]
pub(super) struct PoseSigmas {
    pub(super) position_m: f64,
    pub(super) heading_rad: f64,
}

impl PoseSigmas {
    pub(super) fn of(settings: &EstimatorSettings) -> Self {
        Self {
            position_m: settings.pose_sigma_m,
            heading_rad: settings.pose_sigma_rad,
        }
    }

    /// Returns the covariance of (x, y, yaw).
    pub(super) fn covariance(&self) -> Matrix3<f64> {
        let (position, heading) = (self.position_m.powi(2), self.heading_rad.powi(2));
        Matrix3::from_diagonal(&Vector3::new(position, position, heading))
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct PoseGate {
    believed_after_s: f64,
    run: Option<RejectedRun>,
    noise_factor: f64,
    time_s: f64,
}

impl PoseGate {
    pub(super) fn new(believed_after_s: f64) -> Self {
        Self {
            believed_after_s,
            run: None,
            noise_factor: 1.0,
            time_s: f64::NEG_INFINITY,
        }
    }

    /// Factor on the variance by which dead reckoning grows; 1 unless a run was accepted.
    pub(super) fn noise_factor(&self) -> f64 {
        self.noise_factor
    }

    /// How long rejected poses have agreed with each other, s, and the time of the newest; none where the
    /// last pose was accepted.
    pub(super) fn doubted(&self) -> Option<(f64, f64)> {
        self.run
            .map(|run| (run.newest.time_s - run.since_s, run.newest.time_s))
    }

    /// Takes a pose that passed; `share` is its normalised innovation squared over the gate.
    pub(super) fn passed(&mut self, time_s: f64, share: f64) {
        self.run = None;
        let elapsed_s = time_s - self.time_s;
        self.time_s = self.time_s.max(time_s);
        if self.noise_factor > 1.0 && elapsed_s > 0.0 {
            if share > STILL_LARGE {
                self.noise_factor = NOISE_FACTOR;
            } else {
                let kept = (-elapsed_s / NOISE_DECAY_S).exp();
                self.noise_factor = 1.0 + kept * (self.noise_factor - 1.0);
            }
        }
    }

    /// Takes a pose that did not pass; returns the covariance to add to the prediction's where the pose is
    /// accepted now.
    pub(super) fn refused(
        &mut self,
        refused: RefusedPose,
        sigmas: &PoseSigmas,
    ) -> Option<Matrix3<f64>> {
        let since_s = match &self.run {
            Some(run) if agree(&run.newest, &refused, sigmas) => run.since_s,
            _ => refused.time_s,
        };
        self.run = Some(RejectedRun {
            since_s,
            newest: refused,
        });
        // Rounding of the times must not make it a pose longer.
        if refused.time_s - since_s < self.believed_after_s - 1e-6 {
            return None;
        }
        self.run = None;
        self.noise_factor = NOISE_FACTOR;
        self.time_s = refused.time_s;
        let off = refused.pose - refused.predicted;
        let distance_squared = off.xy().norm_squared();
        let turn = wrap_angle(off.z);
        Some(Matrix3::from_diagonal(&Vector3::new(
            distance_squared,
            distance_squared,
            turn * turn,
        )))
    }
}

/// Returns whether a vehicle can have moved from one pose to the other: by anything from nothing to twice
/// what its treads say, with or without what was learned, and by a slide.
fn agree(before: &RefusedPose, after: &RefusedPose, sigmas: &PoseSigmas) -> bool {
    let time_s = after.time_s - before.time_s;
    if time_s <= 0.0 {
        return false;
    }
    let seen = after.pose - before.pose;
    let reckoned = after.predicted - before.predicted;
    let off_m = (seen - reckoned).xy().norm();
    let off_rad = wrap_angle(seen.z - reckoned.z).abs();
    let unlearned = &after.unlearned;
    let speed_m_s = unlearned.right_m_s.hypot(unlearned.forward_m_s);
    let moved_m = reckoned.xy().norm().max(speed_m_s * time_s);
    let turned_rad = wrap_angle(reckoned.z)
        .abs()
        .max(unlearned.yaw_rate_rad_s.abs() * time_s);
    off_m <= moved_m + SLIDE_M_S * time_s + NOISE_SIGMAS * sigmas.position_m
        && off_rad <= turned_rad + SLIDE_RAD_S * time_s + NOISE_SIGMAS * sigmas.heading_rad
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGMAS: PoseSigmas = PoseSigmas {
        position_m: 0.01,
        heading_rad: 0.0087,
    };

    fn refused(time_s: f64, x_m: f64, predicted_x_m: f64) -> RefusedPose {
        RefusedPose {
            time_s,
            pose: Vector3::new(x_m, 0.0, 0.0),
            predicted: Vector3::new(predicted_x_m, 0.0, 0.0),
            unlearned: BodyVelocity::default(),
        }
    }

    #[test]
    fn poses_agree_where_what_was_learned_says_that_the_vehicle_stands() {
        let run_s = |forward_m_s| {
            let mut gate = PoseGate::new(1.0);
            for i in 0..8 {
                let mut pose = refused(0.1 * f64::from(i), 0.12 * f64::from(i), 0.0);
                pose.unlearned.forward_m_s = forward_m_s;
                assert_eq!(gate.refused(pose, &SIGMAS), None);
            }
            gate.doubted().unwrap().0
        };
        assert_eq!(run_s(0.0), 0.0);
        assert!((run_s(0.8) - 0.7).abs() < 1e-12);
    }

    #[test]
    fn poses_of_treads_that_slip_are_believed_after_the_stated_time() {
        let mut gate = PoseGate::new(1.0);
        for i in 0..10 {
            let time_s = 0.1 * f64::from(i);
            let x_m = 0.06 * f64::from(i);
            assert_eq!(
                gate.refused(refused(time_s, 0.7 * x_m, 0.2 + x_m), &SIGMAS),
                None
            );
            let (doubted_s, newest_s) = gate.doubted().unwrap();
            assert!((doubted_s - time_s).abs() < 1e-12 && newest_s == time_s);
        }
        let inflation = gate.refused(refused(1.0, 0.42, 0.8), &SIGMAS).unwrap();
        assert!((inflation[(0, 0)] - 0.38 * 0.38).abs() < 1e-12);
        assert_eq!(gate.doubted(), None);
        assert_eq!(gate.noise_factor(), NOISE_FACTOR);
    }

    #[test]
    fn poses_that_contradict_each_other_are_never_believed() {
        let mut gate = PoseGate::new(1.0);
        for i in 0..100 {
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            let pose = refused(0.1 * f64::from(i), side, 0.0);
            assert_eq!(gate.refused(pose, &SIGMAS), None);
            assert_eq!(gate.doubted().unwrap().0, 0.0);
        }
    }

    #[test]
    fn a_pose_that_passes_ends_the_run_and_trust_returns() {
        let mut gate = PoseGate::new(0.1);
        gate.refused(refused(0.0, 1.0, 0.0), &SIGMAS);
        gate.passed(0.1, 0.5);
        assert_eq!((gate.doubted(), gate.noise_factor()), (None, 1.0));
        gate.refused(refused(0.2, 1.0, 0.0), &SIGMAS);
        assert!(gate.refused(refused(0.3, 1.0, 0.0), &SIGMAS).is_some());
        gate.passed(0.4, 0.5);
        assert_eq!(gate.noise_factor(), NOISE_FACTOR);
        for i in 5..1000 {
            gate.passed(0.1 * f64::from(i), 0.01);
        }
        assert!(gate.noise_factor() < 1.1);
    }
}
