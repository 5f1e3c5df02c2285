//! Dead reckoning: equation (12) integrated over a step.

use crate::frames::{Attitude, BodyVelocity, Pose, PoseRate, Tilt, pose_rate};

/// Body velocity and attitude at one instant of a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepMotion {
    /// Velocity in body axes.
    pub velocity: BodyVelocity,
    /// Roll and pitch.
    pub attitude: Attitude,
}

/// Returns the pose after `dt_s`, by the classical fourth-order Runge-Kutta rule on equation (12).
///
/// `motion` gives velocity and attitude for the share of the step that has passed (0 to 1) and the
/// yaw then, rad; it is asked four times. So the attitude may follow from the heading, as on a plane,
/// or from samples, as in [`advance_between`]. The error of a step is of fifth order in `dt_s` where
/// `motion` is smooth.
pub fn advance(pose: &Pose, dt_s: f64, motion: impl Fn(f64, f64) -> StepMotion) -> Pose {
    integrate(pose, dt_s, |instant, yaw_rad| {
        let StepMotion { velocity, attitude } = motion(SHARES[instant], yaw_rad);
        pose_rate(&velocity, &attitude, yaw_rad)
    })
}

/// Returns the pose after `dt_s` with velocity and attitude changing evenly from `from` to `to`, as
/// between two samples.
pub fn advance_between(pose: &Pose, dt_s: f64, from: &StepMotion, to: &StepMotion) -> Pose {
    let tilts = StepTilts::between(&from.attitude, &to.attitude);
    tilts.advance(pose, dt_s, &from.velocity, &to.velocity)
}

/// The attitude in the course of a step between two samples, the same whatever velocity is tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StepTilts([Tilt; 3]);

impl StepTilts {
    /// Returns the attitude that changes evenly.
    pub(crate) fn between(from: &Attitude, to: &Attitude) -> Self {
        Self(SHARES.map(|share| {
            Tilt::of(&Attitude {
                roll_rad: between(share, from.roll_rad, to.roll_rad),
                pitch_rad: between(share, from.pitch_rad, to.pitch_rad),
            })
        }))
    }

    /// Returns the pose after `dt_s` with a velocity that changes evenly.
    pub(crate) fn advance(
        &self,
        pose: &Pose,
        dt_s: f64,
        from: &BodyVelocity,
        to: &BodyVelocity,
    ) -> Pose {
        integrate(pose, dt_s, |instant, yaw_rad| {
            let share = SHARES[instant];
            let velocity = BodyVelocity {
                right_m_s: between(share, from.right_m_s, to.right_m_s),
                forward_m_s: between(share, from.forward_m_s, to.forward_m_s),
                yaw_rate_rad_s: between(share, from.yaw_rate_rad_s, to.yaw_rate_rad_s),
            };
            self.0[instant].pose_rate(&velocity, yaw_rad)
        })
    }
}

/// Share of a step that has passed at its beginning, in its middle and at its end.
const SHARES: [f64; 3] = [0.0, 0.5, 1.0];

fn between(share: f64, a: f64, b: f64) -> f64 {
    a + share * (b - a)
}

/// The Runge-Kutta rule, on the rate at an instant of [`SHARES`] and a yaw, rad.
fn integrate(pose: &Pose, dt_s: f64, rate_at: impl Fn(usize, f64) -> PoseRate) -> Pose {
    let yaw_rad = pose.yaw_rad;
    // Position does not enter (12), so only yaw is carried from stage to stage.
    let first = rate_at(0, yaw_rad);
    let second = rate_at(1, yaw_rad + 0.5 * dt_s * first.yaw_rad_s);
    let third = rate_at(1, yaw_rad + 0.5 * dt_s * second.yaw_rad_s);
    let fourth = rate_at(2, yaw_rad + dt_s * third.yaw_rad_s);
    let after = |start: f64, rate: fn(&PoseRate) -> f64| {
        let sum = rate(&first) + 2.0 * (rate(&second) + rate(&third)) + rate(&fourth);
        start + dt_s / 6.0 * sum
    };
    Pose {
        x_m: after(pose.x_m, |rate| rate.x_m_s),
        y_m: after(pose.y_m, |rate| rate.y_m_s),
        z_m: after(pose.z_m, |rate| rate.z_m_s),
        yaw_rad: after(pose.yaw_rad, |rate| rate.yaw_rad_s),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    const TURN: BodyVelocity = BodyVelocity {
        right_m_s: 0.1,
        forward_m_s: 0.5,
        yaw_rate_rad_s: 0.4,
    };

    #[test]
    fn a_turn_on_level_ground_is_a_circle() {
        let motion = StepMotion {
            velocity: TURN,
            attitude: Attitude::LEVEL,
        };
        let mut pose = Pose::default();
        for _ in 0..100 {
            pose = advance(&pose, 0.05, |_, _| motion);
        }
        // Closed form of the integral of Rz(0.4 t) (0.1, 0.5) over 5 s.
        let (sin, cos) = 2.0_f64.sin_cos();
        assert!((pose.x_m - (0.1 * sin - 0.5 * (1.0 - cos)) / 0.4).abs() < 1e-9);
        assert!((pose.y_m - (0.5 * sin + 0.1 * (1.0 - cos)) / 0.4).abs() < 1e-9);
        assert!((pose.yaw_rad - 2.0).abs() < 1e-12 && pose.z_m == 0.0);
    }

    #[test]
    fn on_a_plane_the_height_stays_on_the_plane() {
        let normal = Vector3::new(0.2, -0.3, 1.0).normalize();
        let mut pose = Pose::default();
        for _ in 0..400 {
            pose = advance(&pose, 0.05, |_, yaw_rad| StepMotion {
                velocity: TURN,
                attitude: Attitude::on_plane(&normal, yaw_rad),
            });
        }
        let plane_m = -(normal.x * pose.x_m + normal.y * pose.y_m) / normal.z;
        assert!((pose.z_m - plane_m).abs() < 1e-7, "{} {plane_m}", pose.z_m);
        assert!(pose.x_m.hypot(pose.y_m) > 0.1);
    }

    #[test]
    fn halving_the_step_divides_the_error_by_sixteen() {
        let drive = |steps: u32| {
            let dt_s = 4.0 / f64::from(steps);
            let motion = |step: u32| {
                let t = f64::from(step) * dt_s;
                StepMotion {
                    velocity: TURN,
                    attitude: Attitude {
                        roll_rad: 0.1,
                        pitch_rad: 0.05 * t,
                    },
                }
            };
            (0..steps).fold(Pose::default(), |pose, step| {
                advance_between(&pose, dt_s, &motion(step), &motion(step + 1))
            })
        };
        let error = |steps| (drive(steps).x_m - drive(1024).x_m).abs();
        let ratio = error(8) / error(16);
        assert!((12.0..20.0).contains(&ratio), "{ratio}");
    }
}
