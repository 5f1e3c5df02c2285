//! The search of a balance: the minimum of the potential, by damped Newton steps.

use super::loads::{LoadCase, Loads};
use super::sums::{Expansion, ForceSums};
use crate::speeds::TreadSpeeds;
use nalgebra::{Matrix3, Vector3};

/// A search ends where less than this is left over, force as a share of the weight, and Newton's step is
/// shorter than this, m/s or rad/s. That step is still taken: what is left then is about its square over
/// the slip scale.
pub(super) const TOLERANCE: f64 = 3e-8;
/// The same for a velocity that is summed up over a roll-out.
pub(super) const TOLERANCE_OF_ROLL_OUT: f64 = 3e-5;
/// Rounding of the potential over the weight, m/s.
const ROUNDING: f64 = 1e-14;
/// Largest number of steps of a search. From the previous solution two or three suffice; from far away
/// at the limit of grip it takes about forty.
const ITERATIONS_MAX: usize = 150;
/// Damping of a search's step after the first that did not descend, and factor for each further one.
const DAMPING: (f64, f64) = (1e-3, 10.0);
/// Attempts with less and less of the pull along the ground where friction does not hold all of it.
const ATTEMPTS: usize = 6;
/// Share of the friction limit that the first of these attempts pulls with.
const HELD_SHARE: f64 = 0.9;
/// Largest speed at which a vehicle counts as held, m/s or rad/s.
pub(super) const SPEED_MAX: f64 = 20.0;
/// Speed up to which a search may pass on its way, m/s or rad/s.
const SEARCHED_MAX: f64 = 100.0;

/// A search's end.
pub(super) struct BalanceSolution {
    pub(super) velocity: Vector3<f64>,
    pub(super) inverse_hessian: Matrix3<f64>,
    pub(super) pull_share: f64,
    pub(super) holds: bool,
}

impl ForceSums<'_> {
    /// Returns the balance nearest to the request: with all of the pull along the ground where
    /// friction holds it, otherwise with less.
    pub(super) fn settle(
        &self,
        start: Vector3<f64>,
        loads: &Loads,
        stance: &LoadCase,
        tolerance: f64,
    ) -> BalanceSolution {
        let pull = stance.pull(&self.ground.centre);
        let along = stance.weight.xy().norm();
        // Friction forces of all wheels together never exceed this.
        let lateral = self.ground.lateral_squared.sqrt().max(1.0);
        let limit = self.ground.friction * lateral * -stance.weight.z;
        let mut pull_share = 1.0;
        if along > limit {
            pull_share = HELD_SHARE * limit / along;
        }
        let mut begin = if start.norm() < SPEED_MAX {
            start
        } else {
            Vector3::zeros()
        };
        for attempt in 0..=ATTEMPTS {
            if attempt > 0 {
                let held = self.ground.friction * self.ground.lateral_squared.sqrt().min(1.0);
                let less = HELD_SHARE * held * -stance.weight.z / along.max(1e-9);
                pull_share = if attempt == 1 {
                    less.min(HELD_SHARE * pull_share)
                } else {
                    0.5 * pull_share
                };
                begin = Vector3::new(0.0, self.mean_tread_m_s(), 0.0);
            }
            let pulled = pull_share * pull;
            if let Some((velocity, inverse_hessian)) = self.search(begin, loads, &pulled, tolerance)
            {
                return BalanceSolution {
                    velocity,
                    inverse_hessian,
                    holds: pull_share >= 1.0 && loads.stands,
                    pull_share,
                };
            }
        }
        // Not reached but by values that are not finite: stand still, insensitive to everything.
        BalanceSolution {
            velocity: Vector3::zeros(),
            inverse_hessian: Matrix3::zeros(),
            pull_share: 0.0,
            holds: false,
        }
    }

    /// Searches the balance; none where there is none within [`SPEED_MAX`].
    ///
    /// Each step goes to the minimum of a parabola of curvature H + d M, with H the Hessian and M the
    /// [majorant](Self::majorant). With d = 0 it is Newton's step, which ends the search within a few
    /// steps but leads anywhere where wheels slip by much more than the slip scale. With d = 1 it
    /// descends from everywhere, but slowly near the end of grip. d grows where a step does not descend
    /// and shrinks where it does (Levenberg-Marquardt), so that the minimum is found from any start.
    fn search(
        &self,
        start: Vector3<f64>,
        loads: &Loads,
        pull: &Vector3<f64>,
        tolerance: f64,
    ) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let mut velocity = start;
        let mut here = self.expand(&velocity, loads, pull);
        let mut damping = 0.0;
        for _ in 0..ITERATIONS_MAX {
            let Some(inverse) = self
                .curvature(&velocity, &here, loads, damping)
                .try_inverse()
            else {
                damping = more(damping)?;
                continue;
            };
            let step = -inverse * here.gradient;
            if damping == 0.0 && here.gradient.norm() < tolerance && step.norm() < tolerance {
                velocity += step;
                return (velocity.norm() <= SPEED_MAX).then_some((velocity, inverse));
            }
            let candidate = velocity + step;
            if candidate.norm() > SEARCHED_MAX {
                damping = more(damping)?;
                continue;
            }
            let there = self.expand(&candidate, loads, pull);
            let descends = there.value < here.value + 1e-4 * here.gradient.dot(&step);
            // Near the minimum, rounding hides the descent of the potential, not of its gradient.
            let flattens = there.value < here.value + ROUNDING
                && there.gradient.norm() < 0.7 * here.gradient.norm();
            if descends || flattens {
                (velocity, here) = (candidate, there);
                damping = less(damping);
            } else if damping == 0.0 && here.gradient.norm() < tolerance {
                // Rounding ends the search where the balance is so flat that it hides the step.
                return (velocity.norm() <= SPEED_MAX).then_some((velocity, inverse));
            } else {
                damping = more(damping)?;
            }
        }
        None
    }

    fn curvature(
        &self,
        velocity: &Vector3<f64>,
        here: &Expansion,
        loads: &Loads,
        damping: f64,
    ) -> Matrix3<f64> {
        if damping > 0.0 {
            here.hessian + damping * self.majorant(velocity, loads)
        } else {
            here.hessian
        }
    }

    fn mean_tread_m_s(&self) -> f64 {
        let TreadSpeeds {
            left_m_s,
            right_m_s,
        } = self.treads;
        0.5 * (left_m_s + right_m_s)
    }
}

/// Returns the next larger damping; none beyond the one that always descends, so that there is no balance
/// or its potential is not finite.
fn more(damping: f64) -> Option<f64> {
    let (first, factor) = DAMPING;
    let next = if damping > 0.0 {
        factor * damping
    } else {
        first
    };
    (next < 2.0 * factor).then_some(next)
}

fn less(damping: f64) -> f64 {
    let (first, factor) = DAMPING;
    if damping > first {
        damping / factor
    } else {
        0.0
    }
}
